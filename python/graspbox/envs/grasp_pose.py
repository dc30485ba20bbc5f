"""``graspbox/GraspPose-v0``: one decision per episode.

An object rests near the middle of a table, with or without others around it. The agent chooses a hand pose and a preshape; the
hand closes there, lifts and holds, and the episode ends.

Keywords
--------
Those of `graspbox.envs.grasp`, with ``trial`` (by default ``TrialConfig()``), which sets how the hand closes, lifts and
holds, instead of ``fingers`` and ``control_freq``, and with other values of ``control``. An episode ends after one step, and ``max_episode_steps`` is 1: under
``gymnasium.make`` and ``make_vec`` that step sets both ``terminated`` and ``truncated``.

Action
------
``Box(-1, 1, float32)``, in the world frame (z up, table top at z = 0). The range of positions is fixed in the world, not
centred on the object. ``control="grasp_pose"``, any pose of the hand:

<!-- generated: action of grasp_pose -->

| index | name | -1 | 1 | unit | meaning |
|---|---|---|---|---|---|
| 0 | x | -0.25 | 0.25 | m | hand position, world |
| 1 | y | -0.25 | 0.25 | m | hand position, world |
| 2 | z | 0 | 0.4 | m | hand position, world |
| 3-8 | rotation | -1 | 1 | 1 | first two columns of world_from_hand, any length; degenerate ones name no pose |
| 9 | preshape | 0 | pi/2 | rad | preshape |

<!-- end -->

``control="grasp_point"``, where the grasp centre goes, and how the hand tilts and turns from facing down. Agents learn it
from success alone, because one or two in a hundred of its actions grasp something by chance:

<!-- generated: action of grasp_point -->

| index | name | -1 | 1 | unit | meaning |
|---|---|---|---|---|---|
| 0 | center_x | -0.12 | 0.12 | m | grasp centre of the hand, world |
| 1 | center_y | -0.12 | 0.12 | m | grasp centre of the hand, world |
| 2 | center_z | 0 | 0.25 | m | grasp centre of the hand, world |
| 3-4 | tilt | -pi/4 | pi/4 | rad | rotation vector along the world's x and y, after the yaw; its length is cut to the upper limit |
| 5 | yaw | -pi | pi | rad | about the vertical, from a hand that faces down with its x along the world's |
| 6 | preshape | 0 | pi/2 | rad | preshape |

<!-- end -->

The two columns of a rotation are orthonormalised in this order. If they are degenerate (one shorter than 0.001, or both parallel to
within a thousandth of a radian), or if the hand collides with the object or the table at the pose or on the straight
approach of 0.10 m along its z, the attempt is ``infeasible``: there is no trial, and the sparse reward is 0.

Among others (``layout="packed"``, ``"pile"`` or ``"bin"``: see `graspbox.envs.grasp`) a hand that touches something on
its approach pushes it aside, as in `graspbox.envs.clear`: an attempt is ``infeasible`` only if the rotation is
degenerate, if the hand collides where the approach begins, or if the protective stop of 60 N ends the approach. The
trial is about the target: one that lifts only a neighbour fails.

Observation
-----------
``obs="state"``, or another name, gives a ``Box(float32)``; several names give a ``Dict``. Columns and clipping are as
in `graspbox.envs.grasp`. ``state`` is **privileged** and describes only the object.

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

Before the decision the hand waits open, at a start pose of ``Grasp-v0`` raised by 0.35 m and then rotated by 50 degrees
about the table's middle towards +y. Its palm faces the object from 0.5 to 0.65 m, and neither the camera ``front`` nor
one overhead sees the hand. ``proprio`` and ``tactile`` describe this waiting hand. The camera ``palm`` looks between the
fingers and often misses an object at that distance; a hand camera that sees it from there is
``CameraConfig("wrist", "hand", eye=(0, 0.075, 0), target=(0, 0, 0.6), up=(-1, 0, 0), fov=1.2)`` in ``cameras``.

With ``arm`` (as in `graspbox.envs.grasp`) the arm waits at home instead. It runs a path of `graspbox.arms.plan_path` to the
grasp and up with the object, on which neither arm nor hand come near anything else: so the trial is that of a hand alone.
Without a path the attempt is infeasible, ``arm_blocked`` is true, and the arm stays; the hand pushes nothing aside.

Images (``rgb``, ``depth``, ``rgbd``, ``segmentation``, ``amodal``, ``points``, ``voxels``, and those of one camera, such as
``depth_palm``; `graspbox.envs.grasp` has the table of shapes, units and bounds) do not contain the object's pose. The
last observation of an episode shows the scene after the attempt.

Reward
------
The weighted sum of the terms, as in `graspbox.envs.grasp`; ``reward_weights`` replaces weights by name.
``reward="sparse"`` is 1 for a success as defined in `graspbox.simulation`, else 0; ``reward="dense"`` has the weights
`graspbox.envs.reward.DECISION`, and ``reward="firm"`` has `graspbox.envs.reward.FIRM_DECISION`. The terms of an attempt
(other terms of ``Grasp-v0`` are 0):

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
As in `graspbox.envs.grasp`, those with a target included, and:

<!-- generated: further info of GraspPose-v0 -->

| entry | type | unit | meaning |
|---|---|---|---|
| infeasible | bool |  | the hand could not reach its pose |
| survives_shake | bool |  | the object was still in the hand after the shake; False without `trial=TrialConfig(shake=...)` |

<!-- end -->

``trial=graspbox.TrialConfig(shake=graspbox.ShakeConfig())`` adds a shake after the hold, which sets ``survives_shake``. It
runs in a copy of the world: the reward, the other infos and the last observation are those at the end of the hold.

Options of a reset
------------------
As in `graspbox.envs.grasp`, except that an object dropped at ``world_from_object`` comes to rest before it is observed,
and ``world_from_hand`` (within 1 m, not with an arm) and ``preshape`` apply to the waiting hand, not to the grasp. The randomization is
also the same: a calibration error moves the hand away from the pose of the action.

Version history
---------------
v0: first version.
"""  # noqa: E501 (tables)

from graspbox.envs.settings import GraspPoseConfig, GraspPoseVectorConfig
from graspbox.envs.single import SingleEnv
from graspbox.envs.vector import NativeVectorEnv

__all__ = ["GraspPoseEnv", "GraspPoseVectorEnv"]


class GraspPoseEnv(SingleEnv, config=GraspPoseConfig):
    """One decision per episode: see the module for its tables, and `graspbox.envs.single.SingleEnv` for its methods."""


class GraspPoseVectorEnv(NativeVectorEnv, config=GraspPoseVectorConfig):
    """Vector environment of ``GraspPose-v0``: ``gymnasium.make_vec("graspbox/GraspPose-v0", num_envs=64)``.

    Each environment equals the single one bit for bit. The methods are those of `graspbox.envs.vector.NativeVectorEnv`.
    With ``max_episode_steps=1``, as registered, the step that ends an episode also truncates it, as under
    ``gymnasium.make``.
    """
