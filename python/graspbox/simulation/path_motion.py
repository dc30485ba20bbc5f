"""What moves as an arm follows a path: its links, the hand with its fingers, and the object."""

from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from graspbox._common.arguments import floats
from graspbox._core import Arm, Hand, Mesh
from graspbox.arms import ArmLike, Trajectory, load_arm
from graspbox.configs import TrialConfig
from graspbox.errors import ConfigError
from graspbox.hands import HandLike, load_hand
from graspbox.hands.conventions import mechanism_of
from graspbox.meshes import MeshLike, Surroundings, as_mesh, mesh_from_arrays
from graspbox.simulation import Scene

__all__ = ["PathMotion"]

#: Phases in which the object moves with the hand.
_HELD = ("lift", "carry", "lower")


@dataclass(frozen=True, eq=False)
class PathMotion:
    """An arm, its hand and an object at m times of a path. Where the fingers stop is simulated.

    Attributes
    ----------
    arm : Arm
        The arm, with k joints.
    hand : Hand
        The hand, with c independent joints.
    mesh : Mesh
        The object.
    neighbours : Surroundings or None
        Other objects, and walls.
    world_from_base : (4, 4) float64
        Pose of the arm's base.
    times : (m,) float64
        Seconds.
    phases : (m,) str
        See `graspbox.arms.Trajectory`.
    positions : (m, k) float64
        Of the joints of the arm, rad or m.
    world_from_hand : (m, 4, 4) float64
        Poses of the hand's grasp frame.
    joints : (m, c) float64
        Of the hand, rad or m.
    world_from_object : (m, 4, 4) float64
        Poses of the object.
    """

    arm: Arm
    hand: Hand
    mesh: Mesh
    neighbours: Surroundings | None
    world_from_base: NDArray[np.float64]
    times: NDArray[np.float64]
    phases: NDArray[np.str_]
    positions: NDArray[np.float64]
    world_from_hand: NDArray[np.float64]
    joints: NDArray[np.float64]
    world_from_object: NDArray[np.float64]

    @classmethod
    def of(
        cls,
        trajectory: Trajectory,
        arm: ArmLike,
        hand: HandLike,
        world_from_base: ArrayLike,
        *,
        target: tuple[MeshLike, ArrayLike],
        neighbours: Surroundings | None = None,
        mount: ArrayLike | None = None,
        hz: float = 50.0,
    ) -> Self:
        """Follow a trajectory with `hz` samples per second; other arguments as of `graspbox.arms.plan_path`.

        Raises
        ------
        ConfigError
            For another arm or hand than the trajectory's, a pose of another shape, or `hz` as of
            `graspbox.arms.Trajectory.resampled`.
        SimulationError
            If the grasp cannot be simulated.
        """
        loaded, with_hand = load_arm(arm), load_hand(hand)
        for given, own, argument in ((loaded, trajectory.arm, "arm"), (with_hand, trajectory.hand_name, "hand")):
            if given.name != own:
                raise ConfigError(f"{argument} is {given.name!r}, but the trajectory is that of {own!r}; pass that one")
        base, mesh, first = (
            _pose(world_from_base, "world_from_base"),
            as_mesh(target[0]),
            _pose(target[1], "the pose of the target"),
        )
        flange_from_base = loaded.flange_from_base_of(with_hand) if mount is None else _pose(mount, "mount")
        sample = trajectory.resampled(hz)
        hands = base @ loaded.flange_poses(sample.positions) @ flange_from_base @ mechanism_of(with_hand).base_from_hand
        grasp = hands[int(np.flatnonzero(np.isin(sample.phases, ("close", *_HELD)))[0])]
        joints = _closing(with_hand, mesh, first, grasp, trajectory.preshape, sample.hand)
        objects = _carried(first, hands, grasp, sample.phases)
        moving = (sample.times, sample.phases, sample.positions, hands, joints, objects)
        return cls(loaded, with_hand, mesh, neighbours, base, *moving)

    def links(self) -> list[tuple[int, Mesh]]:
        """Return the collision shapes of the links that have some, in the links' frames, with the links' indices."""
        surfaces = self.arm.link_surfaces()
        return [(link, mesh_from_arrays(v, f, name="link", clean=None)) for link, v, f in surfaces]

    def link_frames(self, sample: int) -> NDArray[np.float64]:
        """Return the poses of all links in the world, (l, 4, 4), at a sample."""
        return np.asarray(self.world_from_base @ self.arm.link_frames(self.positions[sample]))


def _closing(
    hand: Hand,
    mesh: Mesh,
    world_from_object: NDArray[np.float64],
    world_from_hand: NDArray[np.float64],
    preshape: float,
    command: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Return the joints (m, c) by the command (m,), from open to where a simulation of the grasp stops them.

    If the open hand cannot be at the grasp, they close without resistance.
    """
    opened, held = hand.open(preshape), hand.closed(preshape, 1.0)
    scene = Scene(mesh, hand=hand, world_from_object=world_from_object)
    _, trace = scene.trace(np.linalg.inv(scene.world_from_object) @ world_from_hand, preshape)
    if len(trace.time):
        held = trace.joints[np.searchsorted(trace.time[:-1], TrialConfig().close_time)]
    return np.asarray(opened + command[:, None] * (held - opened))


def _pose(values: ArrayLike, name: str) -> NDArray[np.float64]:
    pose = floats(values, name)
    if pose.shape != (4, 4):
        raise ConfigError(f"{name} has the shape {pose.shape}; give (4, 4)")
    return pose


def _carried(
    first: NDArray[np.float64], hands: NDArray[np.float64], grasp: NDArray[np.float64], phases: NDArray[np.str_]
) -> NDArray[np.float64]:
    """Return the poses of an object that rests, is carried by a hand (m, 4, 4) that grasped it, and is released."""
    hand_from_object, poses, pose = np.linalg.inv(grasp) @ first, [], first
    for hand, phase in zip(hands, phases, strict=True):
        pose = hand @ hand_from_object if phase in _HELD else pose
        poses.append(pose)
    return np.stack(poses)
