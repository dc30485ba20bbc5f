"""``graspbox/Clear-v0``: clear a table, or a bin, of several objects.

Objects lie packed, in a pile or in a bin (`graspbox.simulation.layouts`); with ``layout="single"`` one lies as in
`graspbox.envs.grasp_pose`, and its workspace is that of packed ones. A step is a decision, as the one of
`graspbox.envs.grasp_pose`: the agent chooses a hand pose and a preshape; the hand closes there, lifts and holds.
Objects that it holds at the end are taken away, the hand returns to where it waited, the others come to rest, and the
next observation shows them. Objects that end outside the workspace, or the bin, are lost.

An episode ends when nothing is left, or after ``max_failures`` failed attempts in a row, as the rounds of VGN do
(Breyer et al., "Volumetric Grasping Network", 2020). Under ``gymnasium.make`` it is truncated after 30 attempts.

Keywords
--------
Those of `graspbox.envs.grasp_pose`, with another default of ``layout``, and ``max_failures``.

Action
------
As in `graspbox.envs.grasp_pose`.

The open hand reaches its pose on a straight approach of 0.10 m along its z, at 0.2 m/s, and pushes aside what it
touches.
An attempt is ``infeasible`` if the rotation is degenerate, if the hand collides with something where the approach begins
(both move nothing), or if the protective stop of 60 N ends the approach, as on the table or a wall. On an ``arm`` the hand
pushes nothing aside, and an attempt without a path is infeasible (`graspbox.envs.grasp_pose`).

Observation
-----------
As in `graspbox.envs.grasp_pose`. ``state`` is **privileged**; it describes the object that reaches highest.

Images show every object. In ``segmentation`` the first object is 2, the others follow the links of the hand; an object
keeps its label while it is there, and walls have that of the table. ``amodal`` has one channel for each object, in the
same order. Once the last object is taken away, the observation shows it in the hand.

Reward
------
The weighted sum of the terms, as in `graspbox.envs.grasp_pose`; ``reward="sparse"`` is 1 for every attempt that
succeeds. The terms describe the object on which the closed hand presses most.

Info
----
As in `graspbox.envs.grasp`, and the entries below. ``is_success``, ``is_secure``, ``lift``, ``failure``, ``touches``
and ``object`` describe the last attempt; an attempt that lifts two objects at once succeeds once and clears two.

<!-- generated: further info of Clear-v0 -->

| entry | type | unit | meaning |
|---|---|---|---|
| infeasible | bool |  | the hand could not reach its pose |
| survives_shake | bool |  | the object was still in the hand after the shake; False without `trial=TrialConfig(shake=...)` |
| attempts | int |  | attempts since the episode began |
| cleared | int |  | objects taken away so far |
| lost | int |  | objects that left the workspace otherwise |
| remaining | int |  | objects that are still there |
| disturbed | int |  | objects still there that the last attempt moved by more than 1 cm |

<!-- end -->

VGN's success rate is the number of attempts that succeed over ``attempts``; its declutter rate is ``cleared`` over the
number of objects after the reset, which is ``remaining`` then.

Options of a reset
------------------
``world_from_hand``, ``preshape``, ``friction``, ``mass`` and ``cameras``, as in `graspbox.envs.grasp_pose`. Objects and
layout follow only from the seed, except that a single object takes its options too.

Version history
---------------
v0: first version.
"""  # noqa: E501 (tables)

from graspbox.envs.settings import ClearConfig, ClearVectorConfig
from graspbox.envs.single import SingleEnv
from graspbox.envs.vector import NativeVectorEnv

__all__ = ["ClearEnv", "ClearVectorEnv"]


class ClearEnv(SingleEnv, config=ClearConfig):
    """Decisions until a scene is cleared: see the module for its tables, and `graspbox.envs.single.SingleEnv`."""


class ClearVectorEnv(NativeVectorEnv, config=ClearVectorConfig):
    """Vector environment of ``Clear-v0``: ``gymnasium.make_vec("graspbox/Clear-v0", num_envs=16)``.

    Each environment equals the single one bit for bit. The methods are those of `graspbox.envs.vector.NativeVectorEnv`.
    """
