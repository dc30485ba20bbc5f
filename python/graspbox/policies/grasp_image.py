"""Ranked grasps for your own depth image, by a published policy; `ImageGrasper` loads the networks once for many."""

import os
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, fields, replace
from functools import partial
from pathlib import Path
from typing import NamedTuple, TypedDict, Unpack

import numpy as np
from numpy.typing import ArrayLike, NDArray

from graspbox.arms import ArmLike
from graspbox.errors import ConfigError
from graspbox.hands import Hand, HandLike, load_hand
from graspbox.perception.captured import MOST_THINGS, Look, Survey, look
from graspbox.perception.configs import EVERYTHING
from graspbox.perception.depth_images import check_points
from graspbox.perception.finder import Query, grasps, sure
from graspbox.perception.outputs import NONE_JUDGED
from graspbox.perception.perturbations import PoseNoise
from graspbox.perception.real import RealImage, Workspace
from graspbox.perception.scoring import Ranked
from graspbox.policies.arm_reach import ArmAt
from graspbox.policies.finders import load_finder
from graspbox.policies.image_grasps import EarlierGrasp, EarlierScene, ImageGrasps, SceneGrasps
from graspbox.policies.published.configs import DepthPolicyConfig
from graspbox.policies.published.downloads import folder_of
from graspbox.policies.published.folders import hand_of, load
from graspbox.policies.published.runtimes import Backend

__all__ = [
    "EARLIER_ENTRIES",
    "EarlierGrasp",
    "EarlierScene",
    "ImageGrasper",
    "ImageGrasps",
    "ImageOptions",
    "SceneGrasps",
    "grasp_image",
]

#: Entries of an answer in JSON from which an `EarlierGrasp` is read again.
EARLIER_ENTRIES = tuple(one.name for one in fields(EarlierGrasp))
#: Grasps nearer than both to a better one are omitted, metres and radians.
_NEAR, _ALIKE = 0.01, 0.26
#: A grasp of a thing closes within these distances of its seen surface, metres: the second if none is within the first.
_OF_SURFACE = (0.04, 0.06)
#: An earlier grasp stays the first while its score is less than this below the best one.
_STAY = 0.15
#: Warning of a thing that no free grasp reaches.
_BLOCKED = "the open hand meets something at every grasp of the thing (free is false); take what is in the way first"
#: Heights over the grasp at which a lift is checked, metres.
_LIFTS = (0.03, 0.06, 0.1)


class ImageOptions(TypedDict, total=False):
    """Options of `grasp_image` and `ImageGrasper.find`.

    Attributes
    ----------
    count : int
        Most grasps, by default 5; near-duplicates of a better grasp are omitted.
    region : (int, int, int, int)
        Columns and rows, left, top, right and bottom: only what is seen within is grasped, and all else is an obstacle;
        by default the object is the largest one on the table.
    workspace : Workspace
        A box in space instead of, or besides, a region.
    mask : (H, W) bool array
        Pixels of one of several objects: grasps are of this one, and keep off the others. For policies that learned
        among several objects.
    gravity : (3,) array
        Direction of gravity in the camera's frame, of any length, as an accelerometer gives it: then only level planes
        are tables, and without one a table 2 cm under the mask's lowest pixel is assumed, with a warning. Instead of
        `table_from_camera`.
    keep_off : (k, 3) array
        Points of known obstacles, such as the walls of a bin (`graspbox.simulation.layouts.bin_points`), close
        together, in the table's frame, metres; needs `table_from_camera`. Grasps keep off them if any can.
    hand_error : PoseNoise
        Expected error of your hand's pose: grasps are then ranked by their mean score under such errors. The
        probabilities remain those of a hand without error, but for rehearsed grasps.
    rehearsed : int
        How many of the best grasps are first tried in simulation on the completed shape, for a single object
        (`graspbox.perception.configs.RehearsalConfig`); by default as in the policy's folder.
    previous : ImageGrasps or EarlierGrasp
        Grasps of an earlier image of the same scene, by the same hand: the first of them is scored again, and stays the
        first while no other is clearly better. Its pose is taken in the table's frame if `table_from_camera` is given,
        else in the camera's.
    arm : str, Arm or pair of paths
        The arm that carries the hand (`graspbox.arms.load_arm`): grasps that it reaches come first, each with its
        joints (`ImageGrasps.reach`). Everything that is seen is an obstacle, but for the arm itself if `joints` are
        given.
    base : (4, 4) array
        Pose of the arm's base in the table's frame, metres; needs `table_from_camera`.
    mount : (4, 4) array
        Pose of the hand's base on the arm's flange; by default as the files of both state it.
    joints : (k,) array
        Positions of the arm's joints when the image was taken, rad or m: pixels within 2 cm of a link or of the hand,
        and 1 cm more at a depth of 1 m, 4 cm at 2 m, are taken as not measured.
    seed : int
        Seed of the refinement, by default 0.
    """

    count: int
    region: tuple[int, int, int, int] | None
    workspace: Workspace | None
    mask: NDArray[np.bool_] | None
    gravity: ArrayLike | None
    keep_off: ArrayLike | None
    hand_error: PoseNoise | None
    rehearsed: int | None
    previous: ImageGrasps | EarlierGrasp | None
    arm: ArmLike | None
    base: ArrayLike | None
    mount: ArrayLike | None
    joints: ArrayLike | None
    seed: int


class _Where(TypedDict):
    """Where things are searched, as of `ImageOptions`."""

    gravity: ArrayLike | None
    region: tuple[int, int, int, int] | None
    workspace: Workspace | None


class ImageGrasper:
    """A published policy, ready to find grasps in depth images; threads may share it.

    Parameters
    ----------
    policy : str or PathLike
        The folder of a published policy of one depth image, the name of an installed one, or ``hf://owner/name``.
    hand : str, Hand or pair of paths, optional
        The hand, for a policy that grasps with any; by default that of the policy.
    backend : {"onnx", "torch"}
        Runs the networks.
    num_threads : int, optional
        Threads of onnxruntime; by default one per core.

    Raises
    ------
    ConfigError, MissingExtraError
        If the folder holds no such policy or lacks a file, or a package is not installed.
    """

    def __init__(
        self,
        policy: str | os.PathLike[str],
        *,
        hand: HandLike | None = None,
        backend: Backend = "onnx",
        num_threads: int | None = None,
    ) -> None:
        folder = folder_of(policy)
        self.config = _read(folder)
        self.hand = load_hand(hand_of(folder, self.config) if hand is None else hand)
        self._finder = load_finder(folder, self.config, self.hand, backend=backend, num_threads=num_threads)

    def find(
        self,
        depth: ArrayLike,
        intrinsics: ArrayLike,
        table_from_camera: ArrayLike | None = None,
        *,
        count: int = 5,
        region: tuple[int, int, int, int] | None = None,
        workspace: Workspace | None = None,
        mask: NDArray[np.bool_] | None = None,
        gravity: ArrayLike | None = None,
        keep_off: ArrayLike | None = None,
        hand_error: PoseNoise | None = None,
        rehearsed: int | None = None,
        previous: ImageGrasps | EarlierGrasp | None = None,
        arm: ArmLike | None = None,
        base: ArrayLike | None = None,
        mount: ArrayLike | None = None,
        joints: ArrayLike | None = None,
        seed: int = 0,
    ) -> ImageGrasps:
        """Find grasps of the object that a depth image shows; further arguments are those of `ImageOptions`.

        Parameters
        ----------
        depth : (H, W) array
            Metres along the optical axis, of any size; 0 where nothing was measured.
        intrinsics : (3, 3) array
            Pixels.
        table_from_camera : (4, 4) array, optional
            Pose of the camera: z forward, x right, y down; the table is the plane z = 0, metres. Small errors of height
            and tilt are corrected (`graspbox.perception.leveling.level`). By default the table is the largest plane in
            the image (`graspbox.perception.depth_images.fit_table`).

        Raises
        ------
        ConfigError
            If no object is found, the pose does not fit the image, an output of the networks is not finite, or an
            argument is wrong.
        """
        marked = None if mask is None else _checked(mask, np.shape(depth))
        place = (depth, intrinsics, table_from_camera)
        placed = ArmAt.of(arm, base, mount, joints, self.hand, pose_given=table_from_camera is not None)
        scene, seen = self._surveyed(place, marked, placed, gravity=gravity, region=region, workspace=workspace)
        chosen = _Chosen(count, keep_off, hand_error, rehearsed, seed, self._known(scene, seen, previous), placed)
        return self._grasps(scene, seen, None if marked is None else scene.thinned(marked), chosen)

    def check(
        self,
        depth: ArrayLike,
        intrinsics: ArrayLike,
        table_from_camera: ArrayLike | None = None,
        *,
        region: tuple[int, int, int, int] | None = None,
        workspace: Workspace | None = None,
        mask: NDArray[np.bool_] | None = None,
        gravity: ArrayLike | None = None,
    ) -> tuple[str, ...]:
        """Return the warnings of an image without grasps, in a tenth of the time; arguments and errors as of `find`."""
        marked = None if mask is None else _checked(mask, np.shape(depth))
        place = (depth, intrinsics, table_from_camera)
        scene, seen = self._surveyed(place, marked, None, gravity=gravity, region=region, workspace=workspace)
        return self._look(scene, seen, None if marked is None else scene.thinned(marked)).warnings

    def find_all(
        self,
        depth: ArrayLike,
        intrinsics: ArrayLike,
        table_from_camera: ArrayLike | None = None,
        *,
        labels: NDArray[np.integer] | None = None,
        region: tuple[int, int, int, int] | None = None,
        workspace: Workspace | None = None,
        gravity: ArrayLike | None = None,
        count: int = 5,
        keep_off: ArrayLike | None = None,
        hand_error: PoseNoise | None = None,
        previous: SceneGrasps | EarlierScene | None = None,
        arm: ArmLike | None = None,
        base: ArrayLike | None = None,
        mount: ArrayLike | None = None,
        joints: ArrayLike | None = None,
        seed: int = 0,
    ) -> SceneGrasps:
        """Find grasps of every thing that a depth image shows; arguments and errors as of `find`.

        Parameters
        ----------
        labels : (H, W) array of integers, optional
            Numbers of the things, 0 or less for none, at most 100; by default groups of pixels above the table.
        previous : SceneGrasps or EarlierScene, optional
            Those of an earlier image of the same scene. Things that are found keep their numbers.
        """
        if labels is not None:
            labels = _numbers(labels, np.shape(depth))
        marked = None if labels is None else labels > 0
        place = (depth, intrinsics, table_from_camera)
        placed = ArmAt.of(arm, base, mount, joints, self.hand, pose_given=table_from_camera is not None)
        scene, seen = self._surveyed(place, marked, placed, gravity=gravity, region=region, workspace=workspace)
        if labels is not None:
            found = scene.thinned(labels).astype(np.int64)
            found = found if scene.inside is None else np.where(scene.inside, found, 0)
        else:
            found = seen.things.labels.astype(np.int64)
            found = found if previous is None else _renumbered(found, previous.labels)
        # Among others no thing is rehearsed: it would be alone.
        chosen = _Chosen(count, keep_off, hand_error, 0, seed, None, placed)
        chosen.query(scene, np.zeros((0, 3)))  # wrong options are no refusals of things

        def of(label: int) -> ImageGrasps | str:
            earlier = None if before is None else before.best_of.get(label)
            own = replace(chosen, known=self._known(scene, seen, earlier))
            try:
                return self._grasps(scene, seen, found == label, own)
            except ConfigError as error:
                return str(error)

        before = previous.earlier() if isinstance(previous, SceneGrasps) else previous
        numbers = np.unique(found[found > 0]).tolist()
        with ThreadPoolExecutor(self._finder.num_threads or os.cpu_count()) as pool:
            each = dict(zip(numbers, pool.map(of, numbers), strict=True))
        return SceneGrasps(
            found,
            {label: one for label, one in each.items() if isinstance(one, ImageGrasps)},
            {label: one for label, one in each.items() if isinstance(one, str)},
        )

    def _surveyed(
        self,
        place: tuple[ArrayLike, ArrayLike, ArrayLike | None],
        marked: NDArray[np.bool_] | None,
        placed: ArmAt | None,
        **where: Unpack[_Where],
    ) -> tuple[RealImage, Survey]:
        """Check an image, intrinsics and pose, and find all things but the arm; errors as of `find`."""
        known = None if placed is None else placed.joints
        shown = None if placed is None or known is None else partial(placed.shown, self.hand, joints=known)
        scene = RealImage.of(*place, marked=marked, without=shown, **where)
        seen = scene.survey(self._finder.crop)
        if placed is not None:
            seen = seen._replace(warnings=(*seen.warnings, *placed.hint(self.hand, seen.points[seen.over])))
        return scene, seen

    def _known(self, scene: RealImage, surveyed: Survey, earlier: ImageGrasps | EarlierGrasp | None) -> "_Known | None":
        """Return the best earlier grasp, in the frame of the table."""
        best = earlier.earlier() if isinstance(earlier, ImageGrasps) else earlier
        if best is None:
            return None
        if best.hand != self.hand.name:
            raise ConfigError(f"previous has grasps of {best.hand}, not of {self.hand.name}; pass those of this hand")
        moved = np.eye(4) if scene.pose_given else np.asarray(surveyed.view.world_from_camera)
        pose = best.table_from_hand if scene.pose_given else best.camera_from_hand
        return _Known((moved @ pose)[None], np.array([best.preshape]))

    def _look(self, scene: RealImage, surveyed: Survey, mask: NDArray[np.bool_] | None) -> Look:
        """Look at one thing."""
        return look(
            surveyed,
            self._finder.crop,
            mask=None if mask is None else scene.own(mask),
            # A crop in which everything is one object shows a policy the neighbours of its target.
            together=self._finder.crop.gap >= EVERYTHING,
            num_threads=self._finder.num_threads,
        )

    def _grasps(
        self, scene: RealImage, surveyed: Survey, mask: NDArray[np.bool_] | None, chosen: "_Chosen"
    ) -> ImageGrasps:
        """Find the grasps of one thing."""
        looked = self._look(scene, surveyed, mask)
        query = chosen.query(scene, looked.keep_off)
        seen, ranked, _ = grasps(looked.seen, query, self._finder)
        assert ranked is not None
        assert seen.view is not None
        frame = seen.crops.world_from_crop[0]
        near = _belongs(self.hand, frame @ ranked.poses, ranked.preshapes, looked.surface)
        erring = query.settings(self._finder.config).hand_error is not None
        ranked = ranked.kept(np.flatnonzero(near))
        first = None if query.known is None else _stays(ranked, np.linalg.inv(frame) @ query.known[0][0])
        count = chosen.count if chosen.arm is None else chosen.arm.among(chosen.count)
        ranked = _distinct(ranked, count, erring, first)
        judged = NONE_JUDGED if ranked.judged is None else ranked.judged
        assert query.keep_off is not None
        obstacles = (query.keep_off - frame[:3, 3]) @ frame[:3, :3]
        free, _ = self._finder.grid.meets(ranked.volume[0], ranked.poses, ranked.preshapes, obstacles=obstacles)
        if first is not None:  # as it was kept
            meets = partial(self._finder.grid.meets, sure(ranked.volume[0]), obstacles=obstacles)
            free[:1], _ = meets(ranked.poses[:1], ranked.preshapes[:1])
        found = ImageGrasps(
            policy=self.config,
            hand=self.hand,
            depth=np.asarray(scene.view.depth),
            intrinsics=np.asarray(scene.view.intrinsics),
            table_from_camera=np.asarray(seen.view.world_from_camera),
            object=looked.object,
            table_from_crop=frame,
            occupancy=ranked.volume[0],
            table_from_hand=frame @ ranked.poses,
            preshape=ranked.preshapes,
            choice=ranked.scores,
            success=judged.success,
            secure=judged.secure,
            free=free,
            lift_free=self._lifts(ranked, obstacles),
            warnings=looked.warnings if free.any() or not len(free) else (*looked.warnings, _BLOCKED),
        )
        if chosen.arm is None:
            return found
        return found.by_arm(chosen.arm, query.keep_off, chosen.count)

    def _lifts(self, ranked: Ranked, obstacles: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Return whether the open hand touches no obstacle as it is lifted, (m,)."""
        free, nothing = np.ones(len(ranked.scores), dtype=np.bool_), np.zeros_like(ranked.volume[0])
        for height in _LIFTS:
            raised = ranked.poses.copy()
            raised[:, 2, 3] += height
            free &= self._finder.grid.meets(nothing, raised, ranked.preshapes, obstacles=obstacles)[0]
        return free


class _Known(NamedTuple):
    """The best earlier grasp: its pose in the frame of the table (1, 4, 4), metres, and preshape (1,)."""

    poses: NDArray[np.float64]
    preshapes: NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class _Chosen:
    """Options of `ImageGrasper.find` that hold for every thing."""

    count: int
    keep_off: ArrayLike | None
    hand_error: PoseNoise | None
    rehearsed: int | None
    seed: int
    known: "_Known | None"
    arm: ArmAt | None

    def query(self, scene: RealImage, seen: NDArray[np.float64]) -> Query:
        """Make the query, with the obstacles that are seen."""
        if self.count < 1:
            raise ConfigError(f"count is {self.count}; pass 1 or more")
        around = seen
        if self.keep_off is not None:
            if not scene.pose_given:
                raise ConfigError(
                    "keep_off is in the table's frame, which a table found in the image does not fix; pass "
                    "table_from_camera"
                )
            around = np.concatenate([check_points(self.keep_off), seen])
        return Query(
            self.seed,
            keep_off=around,
            hand_error=self.hand_error,
            rehearsed=self.rehearsed,
            order=True,
            known=self.known,
        )


def grasp_image(
    depth: ArrayLike,
    intrinsics: ArrayLike,
    table_from_camera: ArrayLike | None,
    policy: str | os.PathLike[str],
    *,
    hand: HandLike | None = None,
    backend: Backend = "onnx",
    **options: Unpack[ImageOptions],
) -> ImageGrasps:
    """Find grasps of the object that a depth image shows: `ImageGrasper.find` for a single image.

    `policy`, `hand` and `backend` are those of `ImageGrasper`, whose errors it raises too.
    """
    return ImageGrasper(policy, hand=hand, backend=backend).find(depth, intrinsics, table_from_camera, **options)


def _numbers(labels: NDArray[np.integer], shape: tuple[int, ...]) -> NDArray[np.int64]:
    """Check the numbers of things (H, W); negative ones are none."""
    array = np.asarray(labels)
    if array.shape != shape or array.dtype.kind not in "iu":
        raise ConfigError(f"labels are {array.dtype} of shape {array.shape}; pass integers {shape}")
    things = np.unique(array[array > 0])
    if len(things) and (len(things) > MOST_THINGS or things[-1] >= 1 << 62):
        raise ConfigError(
            f"labels have {len(things)} things, up to number {things[-1]}; pass at most {MOST_THINGS}, and numbers "
            "below 2^62"
        )
    return np.where(array > 0, array, 0).astype(np.int64)


def _read(folder: Path) -> DepthPolicyConfig:
    """Read the configuration of a policy; raises ConfigError if it does not find grasps in images."""
    published = load(folder)
    if not isinstance(published, DepthPolicyConfig):
        raise ConfigError(
            f"the policy {published.name!r} is of the kind {published.kind!r}, which acts in environments alone; in "
            "your own images choose one of the kind 'depth', such as depth or panda_clutter"
        )
    return published


def _belongs(
    hand: Hand, poses: NDArray[np.float64], preshapes: NDArray[np.float64], surface: NDArray[np.float64]
) -> NDArray[np.bool_]:
    """Return which grasps (m,) close near the seen surface (k, 3) of a thing, not where nothing was measured.

    Without one within the first distance of `_OF_SURFACE`, those within the second.
    """
    centers = {preshape: hand.closing_center(preshape) for preshape in np.unique(preshapes).tolist()}
    local = np.array([centers[preshape] for preshape in preshapes.tolist()]).reshape(-1, 3)
    points = np.einsum("nij,nj->ni", poses[:, :3, :3], local) + poses[:, :3, 3]
    middle = surface.mean(axis=0)
    seen, wanted = surface - middle, points - middle
    # Not by BLAS, whose threads would wait for those of other things.
    squares = (wanted**2).sum(axis=1)[:, None] - 2.0 * np.einsum("ij,kj->ik", wanted, seen) + (seen**2).sum(axis=1)
    distances = np.sqrt(np.maximum(squares.min(axis=1, initial=np.inf), 0.0))
    return np.asarray(distances < (_OF_SURFACE[0] if (distances < _OF_SURFACE[0]).any() else _OF_SURFACE[1]))


def _checked(mask: NDArray[np.bool_], shape: tuple[int, ...]) -> NDArray[np.bool_]:
    pixels = np.asarray(mask)
    if pixels.shape != shape or pixels.dtype != np.bool_:
        raise ConfigError(f"mask is {pixels.dtype} of shape {pixels.shape}; pass bool {shape}, as the image")
    return pixels


def _stays(ranked: Ranked, known: NDArray[np.float64]) -> int | None:
    """Return the index of the earlier grasp ``crop_from_hand`` (4, 4) if it is nearly as good as any other."""
    again = np.flatnonzero(np.isclose(ranked.poses, known, atol=1e-9).all((1, 2)))
    if not len(again):
        return None
    best = int(again[np.argmax(ranked.scores[again])])
    return best if ranked.scores[best] >= ranked.scores.max() - _STAY else None


def _renumbered(found: NDArray[np.int64], earlier: NDArray[np.int64]) -> NDArray[np.int64]:
    """Give things (H, W) the numbers of the earlier ones that they cover most, and new numbers to the others."""
    if earlier.shape != found.shape:
        return found
    given, taken = {0: 0}, {0}
    for label in np.unique(found[found > 0]).tolist():
        numbers, counts = np.unique(np.maximum(earlier[found == label], 0), return_counts=True)
        covered = [
            (count, number)
            for number, count in zip(numbers.tolist(), counts.tolist(), strict=True)
            if number not in taken
        ]
        count, number = max(covered, default=(0, 0))
        if 2 * count >= min((found == label).sum(), (earlier == number).sum()) and number:
            given[label] = number
            taken.add(number)
    spare = int(max(earlier.max(), found.max())) + 1
    for label in np.unique(found).tolist():
        if label not in given:
            given[label], spare = spare, spare + 1
    return np.asarray(np.array([given.get(label, 0) for label in range(int(found.max()) + 1)])[found])


def _distinct(ranked: Ranked, count: int, erring: bool, first: int | None) -> Ranked:
    """Keep the best grasps that differ, best first, but for one that stays `first`."""
    chosen: list[int] = []
    for index in [*([] if first is None else [first]), *ranked.best(len(ranked.scores)).tolist()]:
        pose, kept = ranked.poses[index], ranked.poses[chosen]
        distances = np.linalg.norm(kept[:, :3, 3] - pose[:3, 3], axis=1)
        traces = np.einsum("nij,ij->n", kept[:, :3, :3], pose[:3, :3])
        angles = np.arccos(np.clip((traces - 1) / 2, -1, 1))
        if not ((distances < _NEAR) & (angles < _ALIKE)).any():
            chosen.append(index)
        if len(chosen) == count:
            break
    ranked = ranked.kept(np.array(chosen, dtype=np.int64))
    if ranked.judged is not None and ranked.rehearsed is None and not erring:
        # By the choice of the scorer, without the penalties by which these were selected.
        ranked = ranked._replace(scores=ranked.judged.choice)
    order = ranked.best(count)
    return ranked.kept(order if first is None else np.concatenate([[0], order[order != 0]]))
