"""A judge of arm paths: MuJoCo's kinematics and collisions, and points on the true surfaces, every 0.005 rad.

It shares no code with the planner's check: the arm is MuJoCo's reading of its URDF, its contacts are MuJoCo's, objects
are points on their meshes, and a point is inside a link if it is inside one of its shapes.
"""

import math
import re
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

import graspbox
from graspbox.arms import Arm, Trajectory
from graspbox.arms.timing import Limits
from graspbox.hands.conventions import mechanism_of

__all__ = ["Judge", "Verdict", "limit_ratios"]

Array = NDArray[np.float64]
Placed = tuple[graspbox.Mesh, Array]

#: Between postures that are looked at no joint moves farther, rad.
STEP = 0.005
#: Points per object.
POINTS = 2000
#: Depth from which something counts as a collision, metres: rounding of the two kinematics.
TOLERANCE = 1e-5
#: Depth by which a carried object may enter the table or another one beyond where it stood, metres.
SUNK = 1e-3


@dataclass
class Verdict:
    """What a path touches: sentences with the time and the depth in metres; and how many postures were looked at."""

    touches: list[str] = field(default_factory=list)
    postures: int = 0


@dataclass
class Judge:
    """An arm with a hand among objects; `target` is grasped.

    Attributes
    ----------
    arm, hand : Arm, Hand
        The robot.
    world_from_base : (4, 4) array
        Pose of its base.
    objects : list of (Mesh, (4, 4) array)
        Other objects with their poses.
    target : (Mesh, (4, 4) array)
        The object that is grasped.
    """

    arm: Arm
    hand: graspbox.Hand
    world_from_base: Array
    objects: list[Placed]
    target: Placed
    place: Array | None = None

    def __post_init__(self) -> None:
        import mujoco

        self._mujoco = mujoco
        # MuJoCo merges fixed links, unless it is told not to.
        told = '<mujoco><compiler fusestatic="false" discardvisual="true"/></mujoco>'
        self._urdf = self.arm.files[0].replace("</robot>", f"{told}</robot>")
        link = re.search(r'^flange = "([\w-]+)"', self.arm.files[1], re.MULTILINE)
        assert link is not None
        self._flange = link[1]
        self._points = [_Cloud(_surface(mesh, place)) for mesh, place in self.objects]

    def _model(self, preshape: float, share: float) -> Any:
        """Return the arm with the boxes of the hand on its flange, and which geoms those are."""
        spec = self._mujoco.MjSpec.from_string(self._urdf)
        flange = spec.body(self._flange)
        open_hand = self.hand.open(preshape) if share == 0 else self.hand.closed(preshape, share)
        poses, half, _, _ = self.hand.shapes(open_hand)
        flange_from_hand = self.arm.flange_from_base_of(self.hand) @ mechanism_of(self.hand).base_from_hand
        for pose, size in zip(flange_from_hand @ poses, half, strict=True):
            quat = np.zeros(4)
            self._mujoco.mju_mat2Quat(quat, pose[:3, :3].ravel())
            flange.add_geom(
                name=f"hand{len(flange.geoms)}",
                type=self._mujoco.mjtGeom.mjGEOM_BOX,
                size=size,
                pos=pose[:3, 3],
                quat=quat,
            )
        return spec.compile(), flange_from_hand

    def __call__(self, path: Trajectory) -> Verdict:
        """Look at a path."""
        verdict = Verdict()
        times = _times(path)
        sample = path.sample(times)
        model, flange_from_hand = self._model(path.preshape, 0.0)
        robot = _Robot(self._mujoco, model, self._flange, self.world_from_base @ np.eye(4), self._exceptions(model))
        target_mesh, target_pose = self.target
        own = _surface(target_mesh, np.eye(4))
        grasp_time = float(path.times[path.phases == "approach"][-1])
        grasp = robot.flange(path.sample([grasp_time]).positions[0]) @ flange_from_hand
        hand_from_target = np.linalg.inv(grasp) @ target_pose
        first_depth: dict[str, float] = {}
        cloud, still = _Cloud(own), np.eye(4)
        for time, posture, phase in zip(times, sample.positions, sample.phases.tolist(), strict=True):
            verdict.postures += 1
            robot.move(posture)
            carried = phase in ("lift", "carry", "lower")
            after = phase in ("open", "retreat")
            pose = robot.flange_pose() @ flange_from_hand @ hand_from_target if carried else target_pose
            if after:
                assert self.place is not None
                pose = self.place
            if carried or pose is not still:
                cloud, still = _Cloud(own @ pose[:3, :3].T + pose[:3, 3]), pose
            found = [(what, depth, TOLERANCE) for what, depth in robot.contacts()]
            found += [
                (f"{what} in an object", depth, TOLERANCE) for what, depth in robot.inside(self._points, hand=True)
            ]
            with_hand = phase in ("reach", "approach", "retreat")
            found += [
                (f"{what} in the target", depth, TOLERANCE) for what, depth in robot.inside([cloud], hand=with_hand)
            ]
            found += [(f"{what} in the table", depth, TOLERANCE) for what, depth in robot.below()]
            if carried:
                for what, depth in self._carried(cloud):
                    found.append((what, depth - first_depth.setdefault(what, max(depth, 0.0)), SUNK))
            verdict.touches += [f"{time:.3f} s, {phase}: {what} ({d:.5f} m)" for what, d, limit in found if d > limit]
        return verdict

    def _carried(self, cloud: "_Cloud") -> list[tuple[str, float]]:
        """Return how deep the carried object is in the table and in other objects."""
        import igl

        found = [("the target in the table", float(-cloud.low[2]))]
        for number, ((mesh, place), around) in enumerate(zip(self.objects, self._points, strict=True)):
            if (around.low > cloud.high).any() or (around.high < cloud.low).any():
                continue
            local = (cloud.points - place[:3, 3]) @ place[:3, :3]
            distance = igl.signed_distance(local, mesh.vertices, mesh.faces.astype(np.int64))[0]
            found.append((f"the target in object {number}", float(-distance.min())))
        return found

    def _exceptions(self, model: Any) -> set[frozenset[int]]:
        """Return pairs of bodies that may touch: neighbours over one joint, and those that touch by design."""

        def name(body: int) -> str:
            return str(self._mujoco.mj_id2name(model, self._mujoco.mjtObj.mjOBJ_BODY, body))

        rigid = [model.body_weldid[body] for body in range(model.nbody)]
        solid = {rigid[model.geom_bodyid[geom]] for geom in range(model.ngeom)}

        def before(body: int) -> int:
            """Return the next body towards the base that has shapes."""
            at = rigid[model.body_parentid[body]]
            while at not in solid and at != 0:
                at = rigid[model.body_parentid[at]]
            return int(at)

        pairs = {frozenset((int(body), before(body))) for body in solid if body != 0}
        by_name = {name(body): int(rigid[body]) for body in range(model.nbody)}
        return pairs | {frozenset((by_name[a], by_name[b])) for a, b in self.arm.touching_by_design}


class _Cloud:
    """Points with their bounds."""

    def __init__(self, points: Array) -> None:
        self.points, self.low, self.high = points, points.min(axis=0), points.max(axis=0)


class _Robot:
    """MuJoCo's arm with a hand, in the world of the objects."""

    def __init__(
        self, mujoco: Any, model: Any, flange: str, world_from_base: Array, exceptions: set[frozenset[int]]
    ) -> None:
        self._mujoco, self._model, self._data = mujoco, model, mujoco.MjData(model)
        self._flange = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, flange)
        self._base, self._exceptions = world_from_base, exceptions
        names = [mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_GEOM, geom) or "" for geom in range(model.ngeom)]
        self._is_hand = np.array([name.startswith("hand") for name in names])
        # The base does not move.
        self._moves = np.array([model.body_weldid[body] != 0 for body in model.geom_bodyid])
        self._radius = model.geom_rbound.copy()

    def move(self, posture: Array) -> None:
        self._data.qpos[:] = posture
        self._mujoco.mj_kinematics(self._model, self._data)
        self._mujoco.mj_comPos(self._model, self._data)
        self._mujoco.mj_collision(self._model, self._data)
        rotation = self._data.geom_xmat.reshape(-1, 3, 3)
        self._rotations = self._base[:3, :3] @ rotation
        self._places = self._data.geom_xpos @ self._base[:3, :3].T + self._base[:3, 3]

    def flange_pose(self) -> Array:
        pose = np.eye(4)
        pose[:3, :3] = self._data.xmat[self._flange].reshape(3, 3)
        pose[:3, 3] = self._data.xpos[self._flange]
        return self._base @ pose

    def flange(self, posture: Array) -> Array:
        self.move(posture)
        return self.flange_pose()

    def _name(self, geom: int) -> str:
        if self._is_hand[geom]:
            return "hand"
        body = self._model.geom_bodyid[geom]
        return str(self._mujoco.mj_id2name(self._model, self._mujoco.mjtObj.mjOBJ_BODY, body))

    def contacts(self) -> list[tuple[str, float]]:
        """Return contacts of the robot with itself."""
        found = []
        for contact in self._data.contact:
            one, two = contact.geom
            rigid = [int(self._model.body_weldid[self._model.geom_bodyid[geom]]) for geom in (one, two)]
            hands = self._is_hand[one] + self._is_hand[two]
            if rigid[0] == rigid[1] or hands == 2 or frozenset(rigid) in self._exceptions:
                continue
            found.append((f"{self._name(one)} in {self._name(two)}", float(-contact.dist)))
        return found

    def inside(self, clouds: "list[_Cloud]", *, hand: bool) -> list[tuple[str, float]]:
        """Return how deep points are in the shapes that move."""
        if not clouds:
            return []
        low = np.stack([cloud.low for cloud in clouds])[:, None]
        high = np.stack([cloud.high for cloud in clouds])[:, None]
        outside = np.maximum(np.maximum(low - self._places, self._places - high), 0.0)
        near = (np.square(outside).sum(axis=2) < self._radius**2) & self._moves & (hand | ~self._is_hand)
        found = []
        for index, geom in np.argwhere(near).tolist():
            local = (clouds[index].points - self._places[geom]) @ self._rotations[geom]
            depth = float(self._depth(geom, local).max())
            if depth > 0:
                found.append((self._name(geom), depth))
        return found

    def _depth(self, geom: int, local: Array) -> Array:
        kind, size = self._model.geom_type[geom], self._model.geom_size[geom]
        if kind == self._mujoco.mjtGeom.mjGEOM_BOX:
            return np.asarray((size - np.abs(local)).min(axis=1))
        if kind == self._mujoco.mjtGeom.mjGEOM_CYLINDER:
            side, end = size[0] - np.linalg.norm(local[:, :2], axis=1), size[1] - np.abs(local[:, 2])
            return np.asarray(np.minimum(side, end))
        assert kind == self._mujoco.mjtGeom.mjGEOM_SPHERE
        return np.asarray(size[0] - np.linalg.norm(local, axis=1))

    def below(self) -> list[tuple[str, float]]:
        """Return how deep shapes that move are in the table."""
        found = []
        for geom in np.flatnonzero(self._moves & (self._places[:, 2] < self._radius)).tolist():
            up, size = self._rotations[geom][2], self._model.geom_size[geom]
            kind = self._model.geom_type[geom]
            if kind == self._mujoco.mjtGeom.mjGEOM_BOX:
                half = float(np.abs(up) @ size)
            elif kind == self._mujoco.mjtGeom.mjGEOM_CYLINDER:
                half = float(abs(up[2]) * size[1] + math.hypot(up[0], up[1]) * size[0])
            else:
                half = float(size[0])
            found.append((self._name(geom), half - float(self._places[geom, 2])))
        return found


def _surface(mesh: graspbox.Mesh, place: Array) -> Array:
    points = np.concatenate([mesh.sample(POINTS, 1)[0], mesh.vertices])
    return np.asarray(points @ place[:3, :3].T + place[:3, 3])


def _times(path: Trajectory) -> Array:
    """Return times between which no joint moves by more than `STEP`."""
    fine = np.linspace(0.0, path.duration, max(int(path.duration * 2000), 2))
    moved = np.abs(np.diff(path.sample(fine).positions, axis=0)).max(axis=1)
    return np.asarray(
        fine[np.unique(np.append(np.searchsorted(np.cumsum(moved), np.arange(0, moved.sum(), STEP)), len(moved)))]
    )


def limit_ratios(path: Trajectory, limits: Limits, hz: float = 10_000.0) -> Array:
    """Return the greatest speed, acceleration and jerk of a path as shares of the limits, and of the speed near ends.

    Each is a difference of the positions, speeds and accelerations over 0.1 ms: at most the greatest in it.
    """
    dense = path.resampled(hz)
    step = np.diff(dense.times[:-1])[:, None]
    rows = [dense.positions[:-1], dense.velocities[:-1], dense.accelerations[:-1]]
    rates = [np.abs(np.diff(row, axis=0) / step) for row in rows]
    plain = (limits.speed, limits.acceleration, limits.jerk)
    shares = [(rate / limit).max() for rate, limit in zip(rates, plain, strict=True)]
    least, greatest, rate, offset = limits.slowing.T
    positions, velocities = dense.positions[:-1], dense.velocities[:-1]
    left = np.where(velocities > 0, greatest - positions, positions - least)
    slowed = np.sqrt(rate * left) - offset
    return np.array([*shares, (np.abs(velocities) / slowed).max()])
