"""``graspbox/GraspPose-v0``: one decision per episode.

An object rests near the middle of a table. The agent names one hand pose and a preshape; the hand closes
there, lifts and holds; the episode ends.

Keywords
--------
Those of `graspbox.envs.grasp`; instead of ``control`` and ``frame_skip`` there is ``trial``, which sets how the hand
closes, lifts and holds. An episode ends after one step, and ``max_episode_steps`` is 1: under ``gymnasium.make`` and
``make_vec`` that step also truncates it, but ``terminated`` is True first of all.

<!-- generated: keywords of GraspPose-v0 -->

| keyword | default | environment |
|---|---|---|
| num_envs | 1 | vector |
| objects | 'procedural' | both |
| split | None | both |
| obs | 'state' | both |
| reward | 'sparse' | both |
| reward_weights | None | both |
| success | None | both |
| info | 'full' | both |
| image_size | None | both |
| randomization | None | both |
| render_mode | None | both |
| num_threads | None | both |
| remote | None | both |
| physics | PhysicsConfig() | both |
| hand | 'reflex' | both |
| cameras | CamerasConfig() | both |
| picture | PictureConfig() | both |
| trial | TrialConfig() | both |
| autoreset_mode | AutoresetMode.NEXT_STEP | vector |
| max_episode_steps | None | vector |
| prepare_files | 128 | vector |
| copy | True | vector |

<!-- end -->

Action
------
``Box(-1, 1, (10,), float32)``, in the world's frame (z up, table top at z = 0). The box of positions is fixed in the
world; the object is not at its centre.

<!-- generated: action of grasp_pose -->

| index | name | -1 | 1 | unit | meaning |
|---|---|---|---|---|---|
| 0 | x | -0.25 | 0.25 | m | hand position, world |
| 1 | y | -0.25 | 0.25 | m | hand position, world |
| 2 | z | 0 | 0.4 | m | hand position, world |
| 3-8 | rotation | -1 | 1 | 1 | first two columns of world_from_hand, any length; degenerate ones name no pose |
| 9 | preshape | 0 | pi/2 | rad | preshape |

<!-- end -->

The two columns are made orthonormal in this order. Where that is impossible (a column shorter than 0.001, or the two
within a thousandth of a radian of parallel), or where the hand collides with the object or the table at the pose or
on the straight approach of 0.10 m along its -z, the attempt is ``infeasible``: no trial, reward 0.

Observation
-----------
``obs="state"``, or another name, gives a ``Box(float32)``; several names give a ``Dict``. Columns and clipping are as
in `graspbox.envs.grasp`. ``state`` is **privileged** and describes the object alone.

<!-- generated: vectors of GraspPose-v0 -->

| vector | shape | dtype | privileged |
|---|---|---|---|
| proprio | 28 | float32 | no |
| state | 19 | float32 | yes |
| tactile | 27 | float32 | no |

<!-- end -->

<!-- generated: columns of GraspPose-v0 -->

| column | proprio | state | tactile | min | max | unit | meaning |
|---|---|---|---|---|---|---|---|
| hand_position | 0-2 |  |  | -1 | 1 | m | grasp frame as the arm knows it, world |
| hand_rotation | 3-8 |  |  | -1 | 1 | 1 | first two columns of world_from_hand |
| hand_velocity | 9-11 |  |  | -1 | 1 | m/s | of the grasp frame, hand axes |
| hand_spin | 12-14 |  |  | -4 | 4 | rad/s | angular velocity, hand axes |
| proximal | 15-17 |  |  | -0.5 | 3.33 | rad | position of proximal_joint_1, proximal_joint_2, proximal_joint_3 |
| actuator | 18-20 |  |  | 0 | 3.6 | rad | position of each actuator but the preshape's |
| actuator_speed | 21-23 |  |  | -3.5 | 3.5 | rad/s | its speed |
| load | 24-26 |  |  | 0 | 50 | N | its load: the tension of its tendon, or the force on its joints |
| preshape | 27 |  |  | 0 | pi/2 | rad | position of the preshape's actuator |
| object_position |  | 0-2 |  | -1 | 1 | m | origin of the object's frame, world |
| object_rotation |  | 3-8 |  | -1 | 1 | 1 | first two columns of world_from_object |
| center_of_mass |  | 9-11 |  | -1 | 1 | m | of the object, world |
| bounds_center |  | 12-14 |  | -1 | 1 | m | middle of the bounds along the object's axes, world |
| half_extents |  | 15-17 |  | 0 | 1 | m | half sides of these bounds |
| mass |  | 18 |  | 0 | 10 | kg | of the object |
| tactile |  |  | 0-26 | 0 | 20 | N | force on each sensor |

<!-- end -->

Before the decision the hand waits, open, where ``Grasp-v0`` would begin but 0.35 m higher, and all of that tipped by 50
degrees about the table's middle towards +y: its palm faces the object from 0.5 to 0.65 m, and neither the camera
``front`` nor one overhead sees it. ``proprio`` and ``tactile`` are its own. The camera ``palm`` looks between the
fingers, often past an object so far away; an eye in hand that sees it from there is, in ``cameras``,
``CameraConfig("wrist", "hand", eye=(0, 0.075, 0), target=(0, 0, 0.6), up=(-1, 0, 0), fov=1.2)``.

Images (``rgb``, ``depth``, ``rgbd``, ``segmentation``, ``points``, ``voxels``, and those of single cameras, as
``depth_palm``; `graspbox.envs.grasp` has the table of shapes, units and bounds) do not contain the object's pose. The
last observation of an episode shows the scene after the attempt.

Reward
------
The sum of weights times terms, as in `graspbox.envs.grasp`; ``reward_weights`` replaces weights by name.
``reward="sparse"`` is 1 for a success as `graspbox.simulation` defines it, else 0; ``reward="dense"`` has the weights
`graspbox.envs.reward.DECISION`, ``reward="firm"`` those of `graspbox.envs.reward.FIRM_DECISION`. The terms of an attempt, of which those of ``Grasp-v0`` that are missing here are 0:

<!-- generated: reward of GraspPose-v0 -->

| term | min | max | meaning |
|---|---|---|---|
| reach | 0 | 1 | 1 - d / 0.4 m, with d the distance from the grasp centre to the object's core before the hand closes |
| contact | 0 | 1 | mean of the share of fingers that touch and how far two of them oppose, when the hand has closed |
| closure | 0 | 1 | epsilon quality of the contacts, when the hand has closed |
| lift | 0 | 1 | greatest rise of the centre of mass, as a share of the lift height |
| hold | 0 | 1 | share of the hold time at the end |
| success | 0 | 1 | 1 at success |
| failure | -1 | 0 | -1 if the attempt is infeasible |
| push | -1 | 0 | minus how far the object was moved sideways while the hand closed, up to 0.2 m, as a share |
| secure | 0 | 1 | 1 at a secure success |
| slip | -1 | 0 | minus how far the object moved in the hand since it left the table, as a share of what a secure grasp allows |

<!-- end -->

Info
----
As in `graspbox.envs.grasp`:

<!-- generated: info of GraspPose-v0 -->

| entry | type | unit | meaning |
|---|---|---|---|
| is_success | bool |  | the grasp succeeded |
| is_secure | bool |  | it succeeded without shifting or turning in the hand |
| failure | str |  | kind of the failure if the episode ended now; empty for a success, and before the first step |
| lift | float | m | rise of the object's centre of mass above its resting height |
| object | str |  | name of the object |
| resting | int |  | index of the object's resting pose; -1 if it was dropped at a given pose |
| touches | bool |  | the hand touches the object |
| protective_stop | bool |  | the protective stop held the hand at some time in the last step |
| infeasible | bool |  | the hand could not reach its pose |
| survives_shake | bool |  | the object was still in the hand after the shake; False without `trial=TrialConfig(shake=...)` |
| reward_terms | dict |  | reward terms of the last step (float) by name; zeros after a reset |

<!-- end -->

``trial=graspbox.TrialConfig(shake=graspbox.ShakeConfig())`` shakes what an attempt holds, for ``survives_shake``. The shake
happens in a copy of the world: reward, other infos and the last observation are those of the end of the hold.

Options of a reset
------------------
As in `graspbox.envs.grasp`; but an object that is dropped at ``world_from_object`` comes to rest before it is observed,
and ``world_from_hand`` (within 1 m) and ``preshape`` set how the hand waits, not how it grasps. The randomization is the
same too: a calibration error moves the hand away from the pose of the action.

Version history
---------------
v0: first version.
"""  # noqa: E501 (tables)

from typing import Unpack

from graspbox.envs.core import GraspCore
from graspbox.envs.settings import (
    NUM_ENVS,
    OBJECTS,
    RENDER_MODES,
    GraspPoseSettings,
    GraspPoseVectorSettings,
    ObjectsArgument,
    signed,
)
from graspbox.envs.single import SingleEnv
from graspbox.envs.vector import NativeVectorEnv

__all__ = ["GraspPoseEnv", "GraspPoseVectorEnv"]


# The sections Parameters are written by scripts/generate_docs.py.
class GraspPoseEnv(SingleEnv):
    """One decision per episode: see the module for its tables, and `graspbox.envs.single.SingleEnv` for its methods.

    Parameters
    ----------
    objects : str, Path, ObjectSet or sequence of str
        Object sets to sample from: see `graspbox.object_sets`.
    split : {"train", "validation", "test"}, optional
        Sample from this split only.
    obs : str or sequence of str
        Observation: a name, or several names, which give a ``Dict``.
    reward : {"sparse", "dense", "firm"}
        Weights of the reward terms.
    reward_weights : mapping of str to float, optional
        Weights that replace those of the same name in `reward`.
    success : SuccessCriterion, optional
        What counts as success; by default ``SuccessCriterion()``, or that of `trial`.
    info : {"full", "numeric"}
        Contents of the info dictionary. ``numeric`` is flat and holds numbers alone, for clients that turn infos into
        tensors: ``failure`` is a code (the index in ``graspbox.envs.spaces.tables(hand)["failures"]``), ``object`` an
        index into ``env.objects``, and reward terms are entries ``reward_reach`` and so on.
    image_size : int or pair of int, optional
        Rows and columns of the images, 16 to 1024; by default those of `cameras`.
    randomization : "standard" or Randomization, optional
        What varies besides object and start; by default nothing.
    render_mode : {"human", "rgb_array"}, optional
        ``rgb_array``: `render` returns pictures. ``human``: a window shows every reset and step (needs the extra
        ``human``); of a vector environment it shows the first environment.
    num_threads : int, optional
        Threads to use; by default ``GRASPBOX_THREADS``, else all. Results do not depend on it.
    remote : str, sequence of str or RemoteConfig, optional
        Address of a server that steps the environments (``ws://HOST:PORT``: see ``graspbox serve``), or several, over
        which they are spread. Results do not depend on it.
    physics : PhysicsConfig
        Settings of the engine; the time step must divide 0.05 s.
    hand : str, Hand or pair of paths
        See `graspbox.load_hand`.
    cameras : CamerasConfig
        Cameras, shadows, voxels; `obs` names the images.
    picture : PictureConfig
        Size, samples per pixel and camera of the pictures of `render`.
    trial : TrialConfig
        How the hand closes, lifts and holds.

    Raises
    ------
    ConfigError, ObjectSetError, MissingExtraError, HandError
        For a wrong argument; objects are read when they are first sampled.
    """

    metadata = {"render_modes": [*RENDER_MODES], "render_fps": 1}  # noqa: RUF012 (as Gymnasium declares it)

    @signed(GraspPoseSettings)
    def __init__(self, objects: ObjectsArgument = OBJECTS.default, **settings: Unpack[GraspPoseSettings]) -> None:
        super().__init__(GraspCore(GraspPoseSettings, 1, objects, settings))


class GraspPoseVectorEnv(NativeVectorEnv):
    """Decisions side by side, their trials in one call: ``gymnasium.make_vec("graspbox/GraspPose-v0", num_envs=64)``.

    Every environment is the single one, bit for bit. Its methods are those of `graspbox.envs.vector.NativeVectorEnv`.
    With ``max_episode_steps=1``, as registered, the step that ends an episode also truncates it, as under
    ``gymnasium.make``.

    Parameters
    ----------
    num_envs : int
        Number of environments.
    objects : str, Path, ObjectSet or sequence of str
        Object sets to sample from: see `graspbox.object_sets`.
    split : {"train", "validation", "test"}, optional
        Sample from this split only.
    obs : str or sequence of str
        Observation: a name, or several names, which give a ``Dict``.
    reward : {"sparse", "dense", "firm"}
        Weights of the reward terms.
    reward_weights : mapping of str to float, optional
        Weights that replace those of the same name in `reward`.
    success : SuccessCriterion, optional
        What counts as success; by default ``SuccessCriterion()``, or that of `trial`.
    info : {"full", "numeric"}
        Contents of the info dictionary. ``numeric`` is flat and holds numbers alone, for clients that turn infos into
        tensors: ``failure`` is a code (the index in ``graspbox.envs.spaces.tables(hand)["failures"]``), ``object`` an
        index into ``env.objects``, and reward terms are entries ``reward_reach`` and so on.
    image_size : int or pair of int, optional
        Rows and columns of the images, 16 to 1024; by default those of `cameras`.
    randomization : "standard" or Randomization, optional
        What varies besides object and start; by default nothing.
    render_mode : {"human", "rgb_array"}, optional
        ``rgb_array``: `render` returns pictures. ``human``: a window shows every reset and step (needs the extra
        ``human``); of a vector environment it shows the first environment.
    num_threads : int, optional
        Threads to use; by default ``GRASPBOX_THREADS``, else all. Results do not depend on it.
    remote : str, sequence of str or RemoteConfig, optional
        Address of a server that steps the environments (``ws://HOST:PORT``: see ``graspbox serve``), or several, over
        which they are spread. Results do not depend on it.
    physics : PhysicsConfig
        Settings of the engine; the time step must divide 0.05 s.
    hand : str, Hand or pair of paths
        See `graspbox.load_hand`.
    cameras : CamerasConfig
        Cameras, shadows, voxels; `obs` names the images.
    picture : PictureConfig
        Size, samples per pixel and camera of the pictures of `render`.
    trial : TrialConfig
        How the hand closes, lifts and holds.
    autoreset_mode : AutoresetMode or its value
        When a finished environment begins again.
    max_episode_steps : int, optional
        Episodes are truncated after this number of steps.
    prepare_files : int
        The first reset prepares all objects before the first step if some are mesh files, and at most this many; 0:
        only those of the first episodes. The first time that takes about a second for each file, later results come
        from the cache. Episodes do not depend on it.
    copy : bool
        Whether observations are fresh arrays; otherwise they are views into buffers that the next call overwrites.

    Raises
    ------
    ConfigError, ObjectSetError, MissingExtraError, HandError
        For a wrong argument; objects are read when they are first sampled.
    """

    @signed(GraspPoseVectorSettings)
    def __init__(
        self,
        num_envs: int = NUM_ENVS.default,
        objects: ObjectsArgument = OBJECTS.default,
        **settings: Unpack[GraspPoseVectorSettings],
    ) -> None:
        super().__init__(GraspCore(GraspPoseVectorSettings, num_envs, objects, settings), settings.get("copy", True))
