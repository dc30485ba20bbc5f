"""``graspbox/Grasp-v0``: a hand, a table and one object or several; closed loop.

An object lies near the middle of a table in one of its resting poses. The hand starts open above it; the agent moves
the hand, closes it and lifts. An episode ends with success as defined in `graspbox.simulation` (``success`` sets the
criterion; by default the object is held free and still for 0.5 s, 0.15 m above its resting height), or when the object is
lost: off the table, or more than 0.5 m from its middle.

The object lies within 5 cm of the table's middle, at any angle about the vertical. The grasp frame starts within 10 cm of
the middle and 0.15 to 0.30 m above the table, the palm facing down with a tilt of up to 0.2 rad, at any angle about the
vertical; if the hand would intersect the object, it starts higher, in steps of 5 cm.

With ``layout="packed"``, ``"pile"`` or ``"bin"`` several objects lie on the table (`graspbox.simulation.layouts`), and "the object"
of this page is one of them, the target: drawn from the seed's stream, uniformly among all that lie there, hidden ones
included. Success, reward, infos and ``state`` are only about the target; the hand may push the others. Factors of
friction and mass apply to all objects, ``object_position`` of the randomization to none of them.

Keywords
--------
`graspbox.envs.settings` documents them: `GraspConfig` for the single environment, and also `VectorConfig` for the vector
environment (``gymnasium.make_vec``). ``gymnasium.make`` and ``make_vec`` also take ``max_episode_steps``, 40 by default.

Action
------
``Box(-1, 1, float32)``; values outside are clipped. An action holds for ``1 / control_freq`` seconds, by default 0.2 s;
where that is longer than 0.05 s, the costs among the reward terms are added up over its parts. Accelerations are limited to 5 m/s2 and
20 rad/s2, speeds to the limits of ``twist``; the goal of ``delta_pose`` is at most 5 cm and 0.2 rad ahead of the hand.
The palm cannot be driven into the table or out of the workspace, and a protective stop ends motion against more than
60 N. A closed hand keeps its preshape, because changing it under load releases the object.

The first n entries move the hand. ``control="twist"``, a velocity in the hand's axes:

<!-- generated: action of twist -->

| index | name | -1 | 1 | unit | meaning |
|---|---|---|---|---|---|
| 0-2 | linear | -0.5 | 0.5 | m/s | velocity in the hand's axes; its length is cut to the upper limit |
| 3-5 | angular | -2 | 2 | rad/s | angular velocity in the hand's axes; its length is cut to the upper limit |

<!-- end -->

``control="delta_pose"``, a motion of the goal in the hand's axes:

<!-- generated: action of delta_pose -->

| index | name | -1 | 1 | unit | meaning |
|---|---|---|---|---|---|
| 0-2 | step | -0.5 | 0.5 | m/s | velocity at which the goal moves, in the hand's axes; its length is cut to the upper limit |
| 3-5 | turn | -2 | 2 | rad/s | angular velocity at which the goal moves, in the hand's axes; its length is cut to the upper limit |

<!-- end -->

``control="target_pose"``, a pose in the world:

<!-- generated: action of target_pose -->

| index | name | -1 | 1 | unit | meaning |
|---|---|---|---|---|---|
| 0 | x | -0.35 | 0.35 | m | hand position, world |
| 1 | y | -0.35 | 0.35 | m | hand position, world |
| 2 | z | 0 | 0.75 | m | hand position, world |
| 3-8 | rotation | -1 | 1 | 1 | first two columns of world_from_hand, any length; degenerate ones hold the last one |

<!-- end -->

``control="top_down"``, a velocity in the world's axes; the hand starts without tilt, and its palm keeps facing down:

<!-- generated: action of top_down -->

| index | name | -1 | 1 | unit | meaning |
|---|---|---|---|---|---|
| 0-2 | linear | -0.5 | 0.5 | m/s | velocity in the world's axes; its length is cut to the upper limit |
| 3 | yaw | -2 | 2 | rad/s | angular velocity about the vertical |

<!-- end -->

``control="joint_velocity"``, on an arm alone (`Arm`_), a speed of every joint; on an ``fr3``:

<!-- generated: action of joint_velocity -->

| index | name | -1 | 1 | unit | meaning |
|---|---|---|---|---|---|
| 0 | joint | -2.62 | 2.62 | rad/s | speed of `joint1` |
| 1 | joint | -2.62 | 2.62 | rad/s | speed of `joint2` |
| 2 | joint | -2.62 | 2.62 | rad/s | speed of `joint3` |
| 3 | joint | -2.62 | 2.62 | rad/s | speed of `joint4` |
| 4 | joint | -5.26 | 5.26 | rad/s | speed of `joint5` |
| 5 | joint | -4.18 | 4.18 | rad/s | speed of `joint6` |
| 6 | joint | -5.26 | 5.26 | rad/s | speed of `joint7` |

<!-- end -->

The entries from n on move the fingers. ``fingers="synergy"``, along the closing motion of the hand's description, in
which all closing actuators move together; other actuators stay where the preshape puts them:

<!-- generated: fingers of synergy -->

| index | name | -1 | 1 | unit | meaning |
|---|---|---|---|---|---|
| n | close | -1 | 1 | 1 | speed along the closing motion of a trial, as a share; positive closes, negative opens |
| n + 1 | preshape | 0 | pi/2 | rad | target of the preshape, followed while no other actuator has closed by more than 14 % of its travel |

<!-- end -->

``fingers="each"``, every actuator by itself:

<!-- generated: fingers of each -->

| index | name | -1 | 1 | unit | meaning |
|---|---|---|---|---|---|
| n | actuator | -3.5 | 3.5 | rad/s | speed of actuator `finger_1`; positive closes |
| n + 1 | actuator | -3.5 | 3.5 | rad/s | speed of actuator `finger_2`; positive closes |
| n + 2 | actuator | -3.5 | 3.5 | rad/s | speed of actuator `finger_3`; positive closes |
| n + 3 | preshape | 0 | pi/2 | rad | target of the preshape, followed while no other actuator has closed by more than 14 % of its travel |

<!-- end -->

Observation
-----------
``obs="state"``, or another name, gives a ``Box(float32)``; ``obs=("proprio", "tactile")`` gives a ``Dict``. The second
table lists the indices of each column in each vector, for ``control="twist"`` and ``fingers="synergy"``; ``last_action``
is as long as an action. Values outside their range are clipped. ``state`` is **privileged**: no sensor of a real robot measures it.
``proprio``, ``tactile`` and the images do not contain the object's pose. A hand without tactile sensors has no
``tactile``: requesting it is an error (``graspbox.envs.spaces.tables(hand)["absent"]`` lists such observations).

<!-- generated: vectors of Grasp-v0 -->

| vector | shape | dtype | privileged |
|---|---|---|---|
| proprio | 28 | float32 | no |
| state | 86 | float32 | yes |
| tactile | 27 | float32 | no |

<!-- end -->

<!-- generated: columns of Grasp-v0 -->

| column | proprio | state | tactile | min | max | unit | meaning |
|---|---|---|---|---|---|---|---|
| hand_position | 0-2 | 0-2 |  | -1 | 1 | m | grasp frame as the arm knows it, world |
| hand_rotation | 3-8 | 3-8 |  | -1 | 1 | 1 | first two columns of world_from_hand |
| hand_velocity | 9-11 | 9-11 |  | -1 | 1 | m/s | of the grasp frame, hand axes |
| hand_spin | 12-14 | 12-14 |  | -4 | 4 | rad/s | angular velocity, hand axes |
| proximal | 15-17 | 15-17 |  | -0.5 | 3.33 | rad | position of proximal_joint_1, proximal_joint_2, proximal_joint_3 |
| actuator | 18-20 | 18-20 |  | 0 | 3.6 | rad | position of each actuator but the preshape's |
| actuator_speed | 21-23 | 21-23 |  | -3.5 | 3.5 | rad/s | its speed |
| load | 24-26 | 24-26 |  | 0 | 50 | N | its load: the tension of its tendon, or the force on its joints |
| preshape | 27 | 27 |  | 0 | pi/2 | rad | position of the preshape's actuator |
| distal |  | 28-30 |  | -0.5 | 3.24889 | rad | position of distal_joint_1, distal_joint_2, distal_joint_3 |
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
| contact |  | 65-71 |  | 0 | 1 | 1 | 1 where the object touches: each moving link with collision shapes, chain by chain from the root to the tip, then the palm |
| on_table |  | 72 |  | 0 | 1 | 1 | 1 while the object touches table or ground |
| lift |  | 73 |  | -1 | 1 | m | rise of the centre of mass above its resting height |
| held |  | 74 |  | 0 | 1 | 1 | share of the hold time for which the object has been held |
| shift |  | 75 |  | 0 | 1 | m | shift in the hand since the object left the table |
| turn |  | 76 |  | 0 | pi | rad | turn in the hand since the object left the table |
| closure |  | 77 |  | 0 | 1 | 1 | epsilon quality of the present contacts |
| last_action |  | 78-85 |  | -1 | 1 | 1 | the last action; zeros after a reset |
| tactile |  |  | 0-26 | 0 | 20 | N | force on each sensor |

<!-- end -->

The first camera of ``cameras``, by default ``front`` in front of the workspace, takes ``depth`` and the other images
without a suffix; the camera ``palm``, on the palm, takes ``depth_palm``, and so on for every kind and camera. ``voxels``
combines the depth images of all cameras in a cube of 0.4 m above the table's middle, with the table top halfway through
its lowest layer; ``voxels_front`` uses one camera. A camera's frame has z forward, x right, y down; ``cameras()`` returns
their poses. At the default size of 64 x 64 (``image_size``; a single bound applies to all channels):

<!-- generated: images -->

| image | shape | dtype | min | max | camera | frame | unit | missing | privileged | meaning |
|---|---|---|---|---|---|---|---|---|---|---|
| rgb | 64 x 64 x 3 | uint8 | 0 | 255 | front | camera | 1 | the background's colour | no | red, green, blue |
| depth | 64 x 64 x 1 | float32 | 0 | 2 | front | camera | m | 0 | no | distance along the optical axis (not along the ray) |
| rgbd | 64 x 64 x 4 | float32 | 0, 0, 0, 0 | 1, 1, 1, 2 | front | camera | 1; m | the background's colour; 0 | no | red, green, blue in [0, 1], then depth |
| segmentation | 64 x 64 x 1 | uint8 | 0 | 11 | front | camera | 1 | 0 | yes | 0 background, 1 table, ground and walls, 2 object (among others the target), 3 + i link i of the hand, then the other objects |
| amodal | 64 x 64 x 1 | uint8 | 0 | 1 | front | camera | 1 | 0 | yes | 1 where an object would be seen if nothing else were there; channels in the order of its labels in `segmentation`, 0 for objects that are gone |
| points | 64 x 64 x 3 | float32 | -0.511, -0.511, 0 | 0.511, 0.511, 2 | front | camera | m | 0, 0, 0 | no | the point seen: x right, y down, z forward from the camera |
| voxels | 32 x 32 x 32 | uint8 | 0 | 2 | front, palm | world | 1 | 0 | no | 0 unseen, 1 free, 2 occupied (by table, object or hand); axes x, y, z |

<!-- end -->

Among others the label 2 is that of the target, in every scene: ``segmentation == 2`` is its mask, and the first channel
of ``amodal`` the mask that it would have if nothing hid it.

Labels of the ReFlex's links, from 3 on: base; swivel, proximal and distal link of finger 1; the same of finger 2;
proximal and distal link of finger 3. ``segmentation`` and ``amodal`` are privileged, because they come from the simulation.

Reward
------
The weighted sum of the terms. ``reward="sparse"`` is 1 for a success, else 0; ``reward="dense"`` has the weights
`graspbox.envs.reward.DENSE`, and ``reward="firm"`` has `graspbox.envs.reward.FIRM`, which rewards a secure hold.
``reward_weights`` replaces weights by name.

<!-- generated: reward of Grasp-v0 -->

| term | min | max | meaning |
|---|---|---|---|
| reach | -1 | 1 | change of 1 - d / 0.4 m, with d the distance from the grasp centre to the object's core |
| contact | -1 | 1 | change of the mean of the share of fingers that touch and how far two of them oppose |
| closure | -1 | 1 | change of the epsilon quality of the present contacts |
| lift | -1 | 1 | change of the share of the lift height, while the hand holds the object off the table |
| hold | -1 | 1 | change of the share of the hold time |
| success | 0 | 1 | 1 at success |
| failure | -1 | 0 | -1 when the object is lost for good |
| effort | -1 | 0 | minus the mean square of the speeds of hand and actuators as shares of their limits, each 0.05 s |
| push | -1 | 1 | minus the change of how far the object was moved sideways, up to 0.2 m, as a share |
| table | -1 | 0 | -1 for each 0.05 s in which the hand touches the table |
| stop | -1 | 0 | -1 for each 0.05 s in which the protective stop holds the hand |
| secure | 0 | 1 | 1 at a secure success |
| slip | -1 | 1 | minus the change of how far the object moved in the hand since it left the table, as a share of what a secure grasp allows |

<!-- end -->

Info
----
Returned by ``reset`` and ``step``; success is defined in `graspbox.simulation`:

<!-- generated: info of Grasp-v0 -->

| entry | type | unit | meaning |
|---|---|---|---|
| is_success | bool |  | the grasp succeeded |
| is_secure | bool |  | it succeeded without shifting or turning in the hand |
| failure | str |  | kind of the failure if the episode ended now; empty for a success, and before the first step |
| lift | float | m | rise of the object's centre of mass above its resting height |
| object | str |  | name of the object |
| resting | int |  | index of the object's resting pose; -1 if it was dropped at a given pose, or lies among others |
| fits | bool |  | the object's least width in plan view, as the episode begins, is within the width that the hand states; True for a hand that states none |
| touches | bool |  | the hand touches the object |
| protective_stop | bool |  | the protective stop held the hand at some time in the last step |
| reward_terms | dict |  | reward terms of the last step (float) by name; zeros after a reset |

<!-- end -->

With a layout of several objects, also:

<!-- generated: further info with a target -->

| entry | type | unit | meaning |
|---|---|---|---|
| neighbours | int |  | other objects in the scene |
| neighbours_moved | int |  | of these, those that are more than 1 cm from where they lay as the episode began |

<!-- end -->

With ``info="numeric"`` it is flat and contains only numbers: ``failure`` is an index into
``graspbox.envs.spaces.tables(hand)["failures"]``, ``object`` an index into ``env.objects``, and every reward term is an
entry such as ``reward_reach``.

Arm
---
``arm="fr3"`` (a name, `graspbox.arms.Arm`, or the paths of a URDF and an ``arm.toml``) puts the hand on an arm whose base
stands at ``base``: by default on the table opposite the camera ``front``, 0.55 of the arm's length from the middle, facing it.

- All control modes mean the same, but the hand's pose follows from the joints by forward kinematics. A wanted twist becomes
  joint speeds by damped least squares, every 0.02 s. The hand accelerates as the joints do: by at most 0.3 m times the least
  acceleration of a joint; a joint without a published one has 10 rad/s2.
- No joint exceeds its range, speed or acceleration. Speeds beyond a limit shrink together, so that the direction stays.
- A seventh joint's freedom turns the arm towards home, at 0.5/s of the way and at most a tenth of the joints' speeds. An arm of
  five joints meets velocities of the grasp frame, and turns as far as it can.
- The links stay 5 mm off each other, the open hand, the table and walls: only speeds are accepted from which the arm can still
  stop. They push objects, whose force stops them as it stops the hand; and they are in the images, with the last label of
  ``segmentation``.
- An episode starts at the first sampled pose of the hand that the arm reaches (of 16), else at home. ``world_from_hand`` as an
  option is refused with the reason if it is out of reach.
- With a calibration error of the hand (``randomization``) the joints put it where ``proprio`` says, and the mount is off.

``proprio`` and ``state`` then have two further columns, and infos one entry; on an ``fr3``, indices in ``state``:

<!-- generated: further columns on an arm -->

| index | column | min | max | unit | meaning |
|---|---|---|---|---|---|
| 15-21 | arm_q | -3.03279 | 4.50595 | rad | position of each joint of the arm, from the base on |
| 22-28 | arm_dq | -5.26 | 5.26 | rad/s | its speed |

<!-- end -->

<!-- generated: further info on an arm -->

| entry | type | unit | meaning |
|---|---|---|---|
| arm_blocked | bool |  | the arm stopped before itself, its hand, the table or a wall, or an object pressed on its links, at some time in the last step; after a decision: it found no path |

<!-- end -->

The engine ``rapier`` takes no arm.

Options of a reset
------------------
Options replace parts of the initial state; all other parts are sampled as without options. A scene of several objects
follows only from the seed: the first four options are refused there.

| option | value |
|---|---|
| object | name of an object, or its index |
| resting | index of its resting pose, the most probable first |
| place | x, y (m) and turn about the vertical (rad) of the resting pose; within 0.5 m of the table's middle |
| world_from_object | pose (4, 4), instead of both: the object is dropped there, within 0.5 m of the table's middle and up to 1 m above it |
| world_from_hand | pose (4, 4), in the workspace: 0.35 m to each side, up to 0.75 m above the table |
| preshape | preshape angle, rad |
| friction | factor on the object's friction, 0.01 to 100 |
| mass | factor on the object's mass, 0.01 to 100 |
| cameras | ``{name: pose}``: poses (4, 4) of cameras in the world, or in the grasp frame if the hand carries them |
| goal | x, y, z (m) of the goal, in `graspbox.envs.goal_tasks` alone |

Pictures
--------
With ``render_mode="rgb_array"``, ``render`` returns antialiased pictures of the whole workspace from the side, 480 x 640
pixels; ``picture`` sets their size and camera. `gymnasium.wrappers.RecordVideo` writes them to videos with moviepy
(``pip install 'graspbox[video]'``). With ``render_mode="human"``, every reset and step shows such a picture in a window
at ``metadata["render_fps"]`` frames per second, until ``close`` (``pip install 'graspbox[human]'``). A vector environment
shows its first environment; ``send`` and ``recv`` do not update the window. `gymnasium.utils.play.play` uses the keys of
`GraspEnv.get_keys_to_action`; give it ``noop=env.unwrapped.idle_action``.

Version history
---------------
v0: first version. Since November 2026 an action moves the fingers by one number (``fingers="synergy"``) and holds for 0.2 s
(``control_freq=5``), and an episode is truncated after 40 steps: the task is the same, but agents learn it from nothing. Before, it
was ``fingers="each"``, ``control_freq=20`` and ``max_episode_steps=200``, which still give that task; ``frame_skip=n`` was
``control_freq=20/n``, and the entries of ``delta_pose`` were the steps of 0.05 s instead of their speeds, with the same motion.
"""  # noqa: E501 (tables)

import itertools

import numpy as np
from numpy.typing import NDArray

from graspbox.envs.settings import RENDER_MODES, GraspConfig
from graspbox.envs.single import SingleEnv
from graspbox.errors import ConfigError

__all__ = ["GraspEnv"]

#: Motion keys of `GraspEnv.get_keys_to_action`: the index of the action entry, and its sign.
_MOTION_KEYS = {
    "d": (0, 1.0), "a": (0, -1.0), "w": (1, 1.0), "s": (1, -1.0), "e": (2, 1.0), "q": (2, -1.0),
    "i": (3, 1.0), "k": (3, -1.0), "u": (4, 1.0), "o": (4, -1.0), "j": (5, 1.0), "l": (5, -1.0),
}  # fmt: skip
#: Keys that close and open all fingers.
_FINGER_KEYS = {" ": 1.0, "x": -1.0}


class GraspEnv(SingleEnv, config=GraspConfig):
    """One environment: see the module for its tables, and `graspbox.envs.single.SingleEnv` for its methods."""

    metadata = {  # noqa: RUF012 (as Gymnasium declares it)
        "render_modes": [*RENDER_MODES],
        "render_fps": round(GraspConfig.control_freq),
    }

    @property
    def idle_action(self) -> NDArray[np.float32]:
        """The action without motion, the ``noop`` of `gymnasium.utils.play.play`; an error for ``target_pose``."""
        if self._core.control == "target_pose":
            raise ConfigError("every action of control='target_pose' names a pose; use another control mode")
        return self._core.idle_action

    def get_keys_to_action(self) -> dict[str, NDArray[np.float32]]:
        """Map keys to actions for `gymnasium.utils.play.play`, in the axes of the control mode.

        The hand's z points out of the palm; those of ``top_down`` are the world's.

        | keys | motion |
        |---|---|
        | d, a; w, s; e, q | along +x, -x; +y, -y; +z, -z |
        | i, k; u, o; j, l | about +x, -x; +y, -y; +z, -z; only i, k of ``top_down``: about +z, -z |
        | space; x | close all fingers; open them |

        A motion key and a finger key can be pressed together.

        Raises
        ------
        ConfigError
            In the control mode ``target_pose``, whose actions are poses.
        """
        idle = self.idle_action
        fingers = self._core.action_places("actuator") | self._core.action_places("close")
        moving = np.flatnonzero(~(fingers | self._core.action_places("preshape")))
        motions = [key for key, (index, _) in _MOTION_KEYS.items() if index in moving]
        actions = {}
        for motion, finger in itertools.product(["", *motions], ["", *_FINGER_KEYS]):
            action = idle.copy()
            if motion:
                index, direction = _MOTION_KEYS[motion]
                action[index] = direction
            if finger:
                action[fingers] = _FINGER_KEYS[finger]
            if motion or finger:
                actions[motion + finger] = action
        return actions
