"""Policies for scenes of several objects."""

from abc import abstractmethod
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from graspbox import planning
from graspbox._common.arguments import floats, natural, shown
from graspbox._core import Hand
from graspbox.configs import CamerasConfig
from graspbox.envs.coding import codec, encode_action
from graspbox.errors import ConfigError
from graspbox.hands.conventions import frame_from_hand
from graspbox.hands.geometry import corners_of
from graspbox.perception.configs import CropConfig, DepthNoise
from graspbox.perception.depth_views import DepthView
from graspbox.perception.shapes.tsdf import VOXEL_SIZE, WORLD_FROM_WORKSPACE, cameras_around, tsdf_of
from graspbox.policies._observer import Observer
from graspbox.policies.base import Actions, SeededPolicy, Task
from graspbox.policies.baselines.planner import MAX_PRESS
from graspbox.simulation import load_hand
from graspbox.simulation.layouts import Arrangement

__all__ = ["ScenePlanner", "TopDown", "TsdfPlan", "TsdfPolicy"]

#: From a field (1, 40, 40, 40) float32 and the side of its voxels to n grasps: poses (n, 4, 4), widths (n,) and scores
#: (n,): see `TsdfPolicy`.
TsdfPlan = Callable[[NDArray[np.float32], float], tuple[ArrayLike, ArrayLike, ArrayLike]]

#: ``world_from_hand`` (4, 4), metres, and preshape.
_Pose = tuple[NDArray[np.float64], float]

#: Poses of an object that are compared with earlier attempts.
_RANKED = 16
#: Distance (m) and angle (rad) up to which two poses are about the same grasp.
_SAME = (0.01, 0.2)
#: How far the closing hand reaches below the highest point, metres.
_BELOW = 0.02
#: Least distance of the open hand from the table, metres.
_OVER_TABLE = 0.003
#: Entries of a pose's rotation differ by at most this from those of an orthonormal one.
_ORTHONORMAL = 1e-3
#: A pose that an action names is at most this far from the one it was made of, metres.
_NAMED = 1e-4
#: Distance from the highest point within which others determine its long axis, metres.
_AROUND = 0.05


class _OneLook(SeededPolicy):
    """Looks before each attempt, and chooses one pose or none."""

    _names_poses = True
    #: Whether the last look at each environment found no grasp.
    _nothing: tuple[bool, ...]

    def bind(self, task: Task) -> None:
        """Prepare for environments, at which it has not looked yet."""
        if task.closed_loop:
            raise ConfigError(f"the policy {self.name!r} chooses poses; it does not act in {task.env_id!r}")
        super().bind(task)
        self._nothing = (False,) * task.num_envs

    def act(self, observation: Any) -> Actions:
        """Look at every environment; zeros where there is no grasp."""
        chosen = [self._choose(env, observation) for env in range(self.task.num_envs)]
        self._nothing = tuple(action is None for action in chosen)
        actions = self._zeros()
        for row, action in zip(actions, chosen, strict=True):
            if action is not None:
                row[:] = action
        return actions

    @abstractmethod
    def _choose(self, env: int, observation: Any) -> NDArray[np.float32] | None:
        """Choose the action of one environment; None if there is no grasp."""

    def found_nothing(self, env: int) -> bool:
        """Whether its last look at an environment found no grasp."""
        return self._nothing[env]


class TopDown(_OneLook):
    """Grasps straight down at the highest point of a depth image, across the long axis of what is around it."""

    name = "top_down"
    obs: str | tuple[str, ...] | None = ("depth", "proprio")

    def _bind(self, task: Task) -> None:
        self._hand = load_hand(task.hand)
        self._observer = Observer(task, self._hand)

    def _choose(self, env: int, observation: Any) -> NDArray[np.float32] | None:
        row, seed = {"depth": observation["depth"][env]}, int(self._streams[env].integers(2**62))
        points = _above_table(self._observer.look(row, seed).leveled())
        if not len(points):
            return None
        return encode_action(_down_at(points, self._hand), self._hand.preshape_limits[0], hand=self._hand)


class ScenePlanner(_OneLook):
    """Plans for every object among its neighbours, and takes the first-ranked pose of all; **privileged**.

    A pose may push neighbours aside where they yield (`graspbox.PlanConfig.max_press`). Poses near ones that it has
    tried in
    the same episode rank last. It uses the scenes, which no observation holds, in environments of this process
    (`Task.scenes`).
    """

    name = "scene_planner"
    env_id: str | None = "graspbox/Clear-v0"

    def _bind(self, task: Task) -> None:
        self._hand = load_hand(task.hand)
        self._tried: list[list[_Pose]] = [[] for _ in range(task.num_envs)]

    def _begin(self, env: int, seed: int | None, info: dict[str, Any]) -> None:
        del seed, info
        self._tried[env] = []

    def _choose(self, env: int, observation: Any) -> NDArray[np.float32] | None:
        del observation
        chosen = self._best(self.task.scene(env, self.name), self._tried[env])
        if chosen is None:
            return None
        self._tried[env].append(chosen)
        return encode_action(*chosen, hand=self._hand)

    def _best(self, scene: Arrangement, tried: Sequence[_Pose]) -> _Pose | None:
        """Find the first-ranked pose of all objects, and its preshape."""
        best, chosen = (False, -np.inf), None
        for index, (mesh, pose) in enumerate(zip(scene.meshes, scene.world_from_objects, strict=True)):
            around = scene.without(index)
            plan = planning.plan(
                mesh, hand=self._hand, world_from_object=pose, neighbours=around, max_press=MAX_PRESS
            ).best(_RANKED if tried else 1)
            for row in range(len(plan)):
                one = (pose @ plan.poses[row], float(plan.preshape[row]))
                rank = (not any(_is_near(one, other) for other in tried), float(plan.score[row]))
                if rank > best:
                    best, chosen = rank, one
        return chosen


def _is_near(one: _Pose, other: _Pose) -> bool:
    """Return whether two poses of the hand are about the same grasp."""
    (first, preshape), (second, other_preshape) = one, other
    way = np.linalg.norm(first[:3, 3] - second[:3, 3])
    cosine = (np.sum(first[:3, :3] * second[:3, :3]) - 1.0) / 2.0
    return bool(way < _SAME[0] and cosine > np.cos(_SAME[1]) and preshape == other_preshape)


class TsdfPolicy(_OneLook):
    """Grasps where a function plans in a truncated signed distance field of the table, as VGN does.

    Before each attempt it fuses depth images from VGN's cameras, and executes the grasp with the highest score that is
    in reach and no wider than the hand opens. Without one, its actions are zeros.

    Parameters
    ----------
    plan : callable
        Called with a field (1, 40, 40, 40) float32, 0 to 1, and the side of its voxels, metres: see
        `graspbox.perception.shapes.tsdf`. Returns n grasps: poses (n, 4, 4) in the frame of the workspace, metres;
        widths (n,) between the fingers, metres; scores (n,), greater is better. The frame of a pose has its origin
        on the palm, z along the approach and y along which the fingers close
        (``graspbox.hands.conventions.frame_from_hand(hand, "vgn")``).
    views : int
        Number of cameras, evenly around the table.
    name : str
        Name in results.
    noise : DepthNoise
        Noise that is added to the depth that the environments render.

    Raises
    ------
    ConfigError
        For no view; when it acts, for grasps of another shape, that are not finite or are no poses, or if all of them
        are out of reach.
    """

    def __init__(
        self,
        plan: TsdfPlan,
        *,
        views: int = 1,
        name: str = "tsdf",
        noise: DepthNoise = DepthNoise(),  # noqa: B008 (frozen)
    ) -> None:
        cameras = cameras_around(natural(views, "views"))
        self._plan, self._noise, self._views, self.name = plan, noise, len(cameras), name
        self.obs = ("depth", *(f"depth_{camera.name}" for camera in cameras[1:]))
        self.settings = {"cameras": CamerasConfig(cameras=cameras), "image_size": (480, 640)}

    def _bind(self, task: Task) -> None:
        if len(task.cameras.cameras) < self._views:
            raise ConfigError(
                f"cameras has {len(task.cameras.cameras)} cameras; the policy {self.name!r} needs {self._views}"
            )
        self._hand = load_hand(task.hand)
        self._vgn_from_hand = frame_from_hand(self._hand, "vgn")
        self._observers = [Observer(task, self._hand, self._noise, camera) for camera in range(self._views)]

    def _choose(self, env: int, observation: Any) -> NDArray[np.float32] | None:
        seeds = self._streams[env].integers(2**62, size=self._views)
        row = {name: observation[name][env] for name in self.obs or ()}
        looks = [one.look(row, int(seed)) for one, seed in zip(self._observers, seeds, strict=True)]
        field = tsdf_of(
            [1e-3 * np.asarray(one.depth, dtype=np.float64) for one in looks],
            looks[0].intrinsics,
            [np.asarray(one.world_from_camera) for one in looks],
        )
        return self._best(*self._planned(field))

    def _planned(self, field: NDArray[np.float32]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Plan, check, and return poses (n, 4, 4) in the frame ``vgn`` and scores (n,) of grasps that fit the hand."""
        planned = self._plan(field, VOXEL_SIZE)
        if not isinstance(planned, tuple) or len(planned) != 3:
            raise ConfigError(f"plan returns {shown(planned)}; return a tuple of poses, widths and scores")
        poses, widths, scores = (
            floats(values, name) for values, name in zip(planned, ("poses", "widths", "scores"), strict=True)
        )
        # An empty list has no shape to check.
        poses = poses if poses.size else poses.reshape(0, 4, 4)
        count = len(poses)
        if poses.shape != (count, 4, 4) or widths.shape != (count,) or scores.shape != (count,):
            raise ConfigError(
                f"plan returns poses {poses.shape}, widths {widths.shape} and scores {scores.shape}; "
                "return (n, 4, 4), (n,) and (n,)"
            )
        if not all(np.isfinite(values).all() for values in (poses, widths, scores)):
            raise ConfigError("plan returns numbers that are not finite; leave such grasps out")
        turns = poses[:, :3, :3]
        errors = np.abs(turns @ turns.transpose(0, 2, 1) - np.eye(3)).max(axis=(1, 2))
        wrong = (errors > _ORTHONORMAL) | (np.linalg.det(turns) < 0) | (poses[:, 3] != (0, 0, 0, 1)).any(axis=1)
        if wrong.any():
            raise ConfigError(
                f"plan returns poses[{int(np.argmax(wrong))}], which is no pose; return a rotation and (0, 0, 0, 1)"
            )
        fits = widths <= self._hand.widest
        return poses[fits], scores[fits]

    def _best(self, poses: NDArray[np.float64], scores: NDArray[np.float64]) -> NDArray[np.float32] | None:
        """Encode the grasp with the highest score that is in reach; None if there is no grasp."""
        preshape, coding = self._hand.preshape_limits[0], codec("grasp_pose", self._hand)
        for index in np.argsort(-scores, kind="stable"):
            pose = WORLD_FROM_WORKSPACE @ poses[index] @ self._vgn_from_hand
            action = coding.encode_action(pose, preshape)
            if np.abs(coding.decode_grasp(action)[0][:3, 3] - pose[:3, 3]).max() < _NAMED:
                return action
        if len(scores):
            raise ConfigError(
                f"plan returns {len(scores)} grasps, all of them out of reach, such as at {poses[0, :3, 3]}; "
                "return metres in the frame of the workspace"
            )
        return None


def _above_table(view: DepthView) -> NDArray[np.float64]:
    """Return the points (n, 3) of an image that are above the table and near its middle, world frame, metres."""
    depth, k = 1e-3 * np.asarray(view.depth, dtype=np.float64), np.asarray(view.intrinsics)
    rows, columns = np.nonzero(depth)
    z = depth[rows, columns]
    rays = np.stack([(columns + 0.5 - k[0, 2]) / k[0, 0] * z, (rows + 0.5 - k[1, 2]) / k[1, 1] * z, z], axis=1)
    pose = np.asarray(view.world_from_camera)
    points = rays @ pose[:3, :3].T + pose[:3, 3]
    near = np.abs(points[:, :2]).max(axis=1, initial=0.0) < CropConfig.side / 2
    return np.asarray(points[near & (points[:, 2] > 2 * CropConfig.min_height)])


def _down_at(points: NDArray[np.float64], hand: Hand) -> NDArray[np.float64]:
    """Choose the pose of a hand that closes below the highest point, facing down."""
    # A single stray pixel is no top.
    height = float(np.quantile(points[:, 2], 1 - min(1.0, 5 / len(points))))
    highest = points[points[:, 2] >= height - 0.005]
    # Objects of equal height have their tops apart; the mean of all would lie between them.
    nearest = highest[np.argmin(np.linalg.norm(highest[:, :2] - highest[:, :2].mean(axis=0), axis=1))]
    top = highest[np.linalg.norm(highest[:, :2] - nearest[:2], axis=1) < _AROUND].mean(axis=0)
    around = points[(np.linalg.norm(points[:, :2] - top[:2], axis=1) < _AROUND) & (points[:, 2] > height - 0.03)]
    _, _, axes = np.linalg.svd(around[:, :2] - around[:, :2].mean(axis=0), full_matrices=False)
    across = np.append(axes[-1], 0.0)
    preshape = hand.preshape_limits[0]
    corners = corners_of(hand, hand.open(preshape))
    # The fingers oppose each other along the axis in which the open hand is wider.
    fingers = np.ptp(corners_of(hand, hand.open(preshape), "fingers")[:, :2], axis=0)
    down = np.array([0.0, 0.0, -1.0])
    columns = (
        (across, np.cross(down, across), down) if fingers[0] >= fingers[1] else (np.cross(across, down), across, down)
    )
    pose = np.eye(4)
    pose[:3, :3] = np.stack(columns, axis=1)
    center = pose[:3, :3] @ hand.closing_center(preshape)
    pose[:3, 3] = np.array([*top[:2], max(height - _BELOW, 0.0)]) - center
    lowest = float((pose[:3, :3] @ corners.T + pose[:3, 3:])[2].min())
    pose[2, 3] += max(0.0, _OVER_TABLE - lowest)
    return pose
