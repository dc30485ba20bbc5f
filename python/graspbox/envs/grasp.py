"""``graspbox/Grasp-v0``: a hand, a table, an object; closed loop at 20 Hz.

An object lies near the middle of a table in one of its resting poses. The hand begins open, somewhere above it, and has
no plan: the agent moves it, closes it, lifts. An episode ends with success, which is that of `graspbox.simulation` (the
object is held for 0.5 s, 0.15 m above where it lay, free and still), or when the object is lost for good: off the
table, or further than 0.5 m from its middle.

The object lies within 5 cm of the table's middle, turned by any angle. The grasp frame begins within 10 cm of the
middle, 0.15 to 0.30 m above the table, the palm facing down but for a tilt of up to 0.2 rad, turned about the vertical
by any angle; where the hand would stand in the object it begins higher, in steps of 5 cm.

Keywords
--------
Of the single environment, of the native vector environment (`gymnasium.make_vec`), or of both; what they mean stands
with the classes. ``gymnasium.make`` and ``make_vec`` take ``max_episode_steps`` too, 200 by default.

| keyword | default | environment |
|---|---|---|
| num_envs | 1 | vector |
| objects | 'procedural' | both |
| split | None | both |
| obs | 'state' | both |
| reward | 'sparse' | both |
| reward_weights | None | both |
| image_size | None | both |
| control | 'twist' | both |
| frame_skip | 1 | both |
| randomization | None | both |
| autoreset_mode | AutoresetMode.NEXT_STEP | vector |
| max_episode_steps | None | vector |
| render_mode | None | both |
| copy | True | vector |
| num_threads | None | both |
| physics | PhysicsConfig() | both |
| hand | 'reflex' | both |
| cameras | CamerasConfig() | both |
| picture | PictureConfig() | both |

Action
------
``Box(-1, 1, float32)``; numbers beyond are clipped. Accelerations are limited to 5 m/s2 and 20 rad/s2, speeds to what
``twist`` allows; what ``delta_pose`` adds up never runs further ahead of the hand than 5 cm and 0.2 rad. The palm cannot
be driven into the table nor out of the workspace, and a protective stop ends motion against more than 60 N. The hand is shaped
before it closes: fingers that are closed keep their preshape, since one that is swivelled under load, by however little,
lets go of what it holds.

``control="twist"``, a velocity in the hand's axes:

| index | name | -1 | 1 | unit | meaning |
|---|---|---|---|---|---|
| 0-2 | linear | -0.5 | 0.5 | m/s | velocity in the hand's axes; its length is cut to the upper limit |
| 3-5 | angular | -2 | 2 | rad/s | angular velocity in the hand's axes; its length is cut to the upper limit |
| 6 | spool | -3.5 | 3.5 | rad/s | speed of a finger's spool; positive closes |
| 7 | spool | -3.5 | 3.5 | rad/s | speed of a finger's spool; positive closes |
| 8 | spool | -3.5 | 3.5 | rad/s | speed of a finger's spool; positive closes |
| 9 | preshape | 0 | pi/2 | rad | target of the preshape, followed while no spool is beyond 0.5 rad |

``control="delta_pose"``, a step in the hand's axes:

| index | name | -1 | 1 | unit | meaning |
|---|---|---|---|---|---|
| 0-2 | step | -0.025 | 0.025 | m | change of position in the hand's axes |
| 3-5 | turn | -0.1 | 0.1 | rad | rotation vector in the hand's axes |
| 6 | spool | -3.5 | 3.5 | rad/s | speed of a finger's spool; positive closes |
| 7 | spool | -3.5 | 3.5 | rad/s | speed of a finger's spool; positive closes |
| 8 | spool | -3.5 | 3.5 | rad/s | speed of a finger's spool; positive closes |
| 9 | preshape | 0 | pi/2 | rad | target of the preshape, followed while no spool is beyond 0.5 rad |

``control="target_pose"``, a pose in the world:

| index | name | -1 | 1 | unit | meaning |
|---|---|---|---|---|---|
| 0 | x | -0.35 | 0.35 | m | hand position, world |
| 1 | y | -0.35 | 0.35 | m | hand position, world |
| 2 | z | 0 | 0.75 | m | hand position, world |
| 3-8 | rotation | -1 | 1 | 1 | first two columns of world_from_hand, any length; degenerate ones hold the last one |
| 9 | spool | -3.5 | 3.5 | rad/s | speed of a finger's spool; positive closes |
| 10 | spool | -3.5 | 3.5 | rad/s | speed of a finger's spool; positive closes |
| 11 | spool | -3.5 | 3.5 | rad/s | speed of a finger's spool; positive closes |
| 12 | preshape | 0 | pi/2 | rad | target of the preshape, followed while no spool is beyond 0.5 rad |

Observation
-----------
``obs="state"``, or another name, gives a ``Box(float32)``; ``obs=("proprio", "tactile")`` gives a ``Dict``. The columns
named like an observation say where a field stands in it, for the control mode ``twist``; ``last_action`` is as long as
an action. Values beyond their range are clipped. ``state`` is **privileged**: no sensor of a real robot gives it.
``proprio``, ``tactile`` and the images hold nothing of the object's pose.

| vector | shape | dtype | privileged |
|---|---|---|---|
| proprio | 28 | float32 | no |
| state | 88 | float32 | yes |
| tactile | 27 | float32 | no |

| field | proprio | state | tactile | min | max | unit | meaning |
|---|---|---|---|---|---|---|---|
| hand_position | 0-2 | 0-2 |  | -1 | 1 | m | grasp frame as the arm knows it, world |
| hand_rotation | 3-8 | 3-8 |  | -1 | 1 | 1 | first two columns of world_from_hand |
| hand_velocity | 9-11 | 9-11 |  | -1 | 1 | m/s | of the grasp frame, hand axes |
| hand_spin | 12-14 | 12-14 |  | -4 | 4 | rad/s | angular velocity, hand axes |
| proximal | 15-17 | 15-17 |  | -0.5 | 3.2 | rad | proximal encoder of each finger |
| spool | 18-20 | 18-20 |  | 0 | 3.6 | rad | spool encoder of each finger |
| spool_speed | 21-23 | 21-23 |  | -3.5 | 3.5 | rad/s | speed of each finger's spool |
| load | 24-26 | 24-26 |  | 0 | 50 | N | load of each finger's motor: the tension of its tendon |
| preshape | 27 | 27 |  | 0 | pi/2 | rad | preshape angle |
| distal |  | 28-30 |  | -0.5 | 3.2 | rad | distal angle of each finger |
| object_position |  | 31-33 |  | -1 | 1 | m | origin of the object's frame, world |
| object_rotation |  | 34-39 |  | -1 | 1 | 1 | first two columns of world_from_object |
| object_in_hand_position |  | 40-42 |  | -1.5 | 1.5 | m | origin of the object's frame, true hand frame |
| object_in_hand_rotation |  | 43-48 |  | -1 | 1 | 1 | first two columns of hand_from_object |
| object_velocity |  | 49-51 |  | -5 | 5 | m/s | of its centre of mass relative to the hand, hand axes |
| object_spin |  | 52-54 |  | -50 | 50 | rad/s | relative to the hand, hand axes |
| center_of_mass |  | 55-57 |  | -1.5 | 1.5 | m | of the object, hand frame |
| bounds_center |  | 58-60 |  | -1.5 | 1.5 | m | middle of the bounds along the object's axes, hand frame |
| half_extents |  | 61-63 |  | 0 | 1 | m | half sides of these bounds |
| mass |  | 64 |  | 0 | 10 | kg | of the object |
| contact |  | 65-71 |  | 0 | 1 | 1 | 1 where the object touches: proximal and distal link of each finger, palm |
| on_table |  | 72 |  | 0 | 1 | 1 | 1 while the object touches table or ground |
| lift |  | 73 |  | -1 | 1 | m | rise of the centre of mass above its resting height |
| held |  | 74 |  | 0 | 1 | 1 | share of the hold time for which the object has been held |
| shift |  | 75 |  | 0 | 1 | m | shift in the hand since the object left the table |
| turn |  | 76 |  | 0 | pi | rad | turn in the hand since the object left the table |
| closure |  | 77 |  | 0 | 1 | 1 | epsilon quality of the present contacts |
| last_action |  | 78-87 |  | -1 | 1 | 1 | the last action; zeros after a reset |
| tactile |  |  | 0-26 | 0 | 20 | N | force on each sensor |

Images are taken by the first camera of ``cameras``, ``front`` by default, in front of the workspace; ``depth_palm`` by the
camera ``palm``, on the palm; so for every kind and camera. ``voxels`` is made of the depth images of all cameras, for a
cube of 0.4 m over the table's middle, whose lowest layer has the table's top in its middle; ``voxels_front`` of one. A
camera's frame has z forward, x right, y down; ``cameras()`` tells where the cameras are. At the default size of 64 x 64
(``image_size``), and with one bound where it is that of all channels:

| image | shape | dtype | min | max | camera | frame | unit | missing | privileged | meaning |
|---|---|---|---|---|---|---|---|---|---|---|
| rgb | 64 x 64 x 3 | uint8 | 0 | 255 | front | camera | 1 | the background's colour | no | red, green, blue |
| depth | 64 x 64 x 1 | float32 | 0 | 2 | front | camera | m | 0 | no | distance along the optical axis (not along the ray) |
| rgbd | 64 x 64 x 4 | float32 | 0, 0, 0, 0 | 1, 1, 1, 2 | front | camera | 1; m | the background's colour; 0 | no | red, green, blue in [0, 1], then depth |
| segmentation | 64 x 64 x 1 | uint8 | 0 | 11 | front | camera | 1 | 0 | yes | 0 background, 1 table and ground, 2 object, 3 + i link i of the hand |
| points | 64 x 64 x 3 | float32 | -0.511, -0.511, 0 | 0.511, 0.511, 2 | front | camera | m | 0, 0, 0 | no | the point seen: x right, y down, z forward from the camera |
| voxels | 32 x 32 x 32 | uint8 | 0 | 2 | front, palm | world | 1 | 0 | no | 0 unseen, 1 free, 2 occupied (by table, object or hand); axes x, y, z |

Links of the ReFlex, from label 3 on: base; swivel, proximal and distal link of finger 1; the same of finger 2; proximal
and distal link of finger 3. ``segmentation`` is privileged, since its labels come from the simulation.

Reward
------
The sum of weights times terms. ``reward="sparse"`` is 1 for a success, else 0; ``reward="dense"`` has the weights of
`graspbox.envs.reward.DENSE`. ``reward_weights`` replaces weights by name.

| term | min | max | meaning |
|---|---|---|---|
| reach | -1 | 1 | change of 1 - d / 0.4 m, with d the distance from the grasp centre to the object's core |
| contact | -1 | 1 | change of the mean of the share of fingers that touch and how far two of them oppose |
| closure | -1 | 1 | change of the epsilon quality of the present contacts |
| lift | -1 | 1 | change of the share of the lift height, while the hand holds the object off the table |
| hold | -1 | 1 | change of the share of the hold time |
| success | 0 | 1 | 1 at success |
| failure | -1 | 0 | -1 where the object is lost for good |
| effort | -1 | 0 | minus the mean square of hand and spool speeds as shares of their limits |
| push | -1 | 1 | minus the change of how far the object was moved sideways, up to 0.2 m |
| table | -1 | 0 | -1 while the hand touches the table |
| stop | -1 | 0 | -1 while the protective stop holds the hand |

Info
----
After a reset and after a step: ``is_success``, ``is_secure`` (bool, as `graspbox.simulation` defines them), ``failure``
(str: what the failure would be called if the episode ended now; empty for a success), ``lift`` (m), ``object`` (str),
``resting`` (int: which resting pose; -1 where it was let go at a pose), ``touches`` (bool: the hand touches the object), ``protective_stop`` (bool) and
``reward_terms`` (float by name).

Options of a reset
------------------
What is named is taken, the rest is drawn; the draws of what is not named stay the same.

| option | value |
|---|---|
| object | name of an object, or its index |
| resting | index of its resting pose, the most probable first |
| place | x, y (m) and turn about the vertical (rad) of the resting pose; over the table, 0.6 m to each side |
| world_from_object | pose (4, 4), instead of both: the object is let go there, over the table and up to 1 m above it |
| world_from_hand | pose (4, 4), in the workspace: 0.35 m to each side, up to 0.75 m above the table |
| preshape | rad |
| friction, mass | factor on the object's |
| cameras | ``{name: pose}``: poses (4, 4) of cameras in the world, or in the grasp frame if the hand carries them |

Pictures
--------
``render_mode="rgb_array"`` makes ``render`` give smooth pictures of 480 x 640 pixels from the side; ``picture`` chooses
their size and camera.

Version history
---------------
v0: first version.
"""  # noqa: E501 (the table of images)

from collections.abc import Mapping, Sequence
from typing import Any, Literal

import gymnasium
import numpy as np
from numpy.typing import NDArray

from graspbox import object_sets
from graspbox.configs import CamerasConfig, PhysicsConfig, PictureConfig, Randomization
from graspbox.envs.core import (
    FPS,
    Control,
    GraspCore,
    HandArgument,
    ObjectsArgument,
    RenderMode,
    Reward,
    checked_seed,
    fresh_seed,
    options_json,
)


class GraspEnv(gymnasium.Env[Any, NDArray[np.float32]]):
    """One environment: see the module for what it takes and gives.

    Parameters
    ----------
    objects : str, Path, ObjectSet or sequence of str
        Object sets to draw from: see `graspbox.object_sets`.
    split : {"train", "validation", "test"}, optional
        Draw from this split only.
    obs : str or sequence of str
        What is observed: a name, or names, which give a ``Dict``.
    reward : {"sparse", "dense"}
        What is rewarded.
    reward_weights : mapping of str to float, optional
        Weights of reward terms, instead of those of the same name in `reward`.
    image_size : int or pair of int, optional
        Rows and columns of the images, 16 to 1024; by default those of `cameras`.
    control : {"twist", "delta_pose", "target_pose"}
        What an action means.
    frame_skip : int
        Control periods of 0.05 s that a step lasts: its action holds for all of them, and its reward terms are their
        sums. Slower control is easier to explore.
    randomization : "standard" or Randomization, optional
        What varies beside object and start; by default nothing.
    render_mode : "rgb_array", optional
        Whether `render` gives pictures.
    num_threads : int, optional
        Threads to use; by default ``GRASPBOX_THREADS``, else all. Results do not depend on it.
    physics : PhysicsConfig
        The engine; its time step must divide 0.05 s.
    hand : str, Hand or pair of paths
        See `graspbox.load_hand`.
    cameras : CamerasConfig
        Cameras, shadows, voxels; `obs` names the images.
    picture : PictureConfig
        Size, smoothness and camera of the pictures that `render` gives.

    Raises
    ------
    ConfigError, ObjectSetError, MissingExtraError, HandError
        If an argument is out of place; objects are read when they are drawn first.
    """

    metadata = {"render_modes": ["rgb_array"], "render_fps": FPS}  # noqa: RUF012 (as Gymnasium declares it)

    def __init__(
        self,
        objects: ObjectsArgument = "procedural",
        *,
        split: object_sets.Split | None = None,
        obs: str | Sequence[str] = "state",
        reward: Reward = "sparse",
        reward_weights: Mapping[str, float] | None = None,
        image_size: int | tuple[int, int] | None = None,
        control: Control = "twist",
        frame_skip: int = 1,
        randomization: Literal["standard"] | Randomization | None = None,
        render_mode: RenderMode = None,
        num_threads: int | None = None,
        physics: PhysicsConfig = PhysicsConfig(),  # noqa: B008 (frozen)
        hand: HandArgument = "reflex",
        cameras: CamerasConfig = CamerasConfig(),  # noqa: B008 (frozen)
        picture: PictureConfig = PictureConfig(),  # noqa: B008 (frozen)
    ) -> None:
        core = GraspCore(
            1,
            objects,
            split=split,
            obs=obs,
            reward=reward,
            reward_weights=reward_weights,
            image_size=image_size,
            cameras=cameras,
            picture=picture,
            control=control,
            frame_skip=frame_skip,
            randomization=randomization,
            render_mode=render_mode,
            num_threads=num_threads,
            physics=physics,
            hand=hand,
            autoreset="disabled",
            max_episode_steps=None,
        )
        self._take(core, render_mode)
        self.metadata = {**self.metadata, "render_fps": FPS / frame_skip}

    def _take(self, core: GraspCore, render_mode: RenderMode) -> None:
        """Become the environment of a pool of one."""
        self._core = core
        self.objects = core.object_set
        self.render_mode = render_mode
        self.observation_space = core.observation_space
        self.action_space = core.action_space
        self._begun = False

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        """Begin an episode.

        Parameters
        ----------
        seed : int, optional
            Begins the environment's random stream anew; without it the stream goes on (the first time: from a random
            seed, which ``np_random_seed`` tells).
        options : dict, optional
            What of the start is given instead of drawn: see the module.

        Raises
        ------
        ConfigError
            If a seed or an option cannot be; then the episode goes on as if nothing had been asked.
        MeshError, FileError, SimulationError
            If the object cannot be read or simulated.
        """
        if seed is None and not self._begun:
            seed = fresh_seed()
        seed = None if seed is None else checked_seed(seed)
        arrays = self._core.pool.reset(None if seed is None else [seed], None, options_json(options))
        super().reset(seed=seed)
        self._begun = True
        return self._core.first(arrays)

    def step(self, action: NDArray[np.float32]) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """Act for one step: ``frame_skip`` control periods of 0.05 s, or one decision.

        Parameters
        ----------
        action : (n,) array
            As the table says; numbers beyond [-1, 1] are clipped.

        Raises
        ------
        ConfigError
            If the action has another size or holds numbers that are not finite, or the episode is over.
        """
        if not self._begun:
            raise gymnasium.error.ResetNeeded("call reset before step")
        arrays, _ = self._core.pool.step(self._core.action(action, 1))
        observation, info = self._core.first(arrays)
        return observation, float(self._core.rewards(arrays)[0]), bool(arrays["terminated"][0]), False, info

    def render(self) -> NDArray[np.uint8] | None:
        """Take a picture, (H, W, 3), with ``render_mode="rgb_array"``; nothing without."""
        if self.render_mode is None:
            return None
        if not self._begun:
            raise gymnasium.error.ResetNeeded("call reset before render")
        frame: NDArray[np.uint8] = self._core.pictures()[0]
        return frame

    def cameras(self) -> dict[str, tuple[NDArray[np.float64], NDArray[np.float64]]]:
        """Intrinsics (3, 3) and ``world_from_camera`` (4, 4) of every camera as it stands, by name."""
        return {name: (intrinsics, poses[0]) for name, (intrinsics, poses) in self._core.cameras().items()}

    def get_state(self) -> bytes:
        """Everything that the future of the environment depends on, its random stream included."""
        return self._core.pool.get_state(0)

    def set_state(self, state: bytes) -> tuple[Any, dict[str, Any]]:
        """Take up a state that `get_state` gave: from there the same actions lead to the same bits.

        Returns
        -------
        observation, info
            As they were then.

        Raises
        ------
        ConfigError
            If the state is damaged, of another version, or of other objects, cameras, another hand, control mode or
            frame_skip.
        SimulationError
            If the object of that name has another shape here, or the physics differ.
        """
        arrays = self._core.pool.set_state(0, state)
        if not self._begun:
            # The stream is that of the state, whose seed is not known.
            self._np_random_seed = -1
        self._begun = True
        return self._core.first(arrays)
