"""What a real depth image shows: the things on a table, the one to grasp, and everything that a hand could hit.

Rendered scenes have one table and clean depth (`graspbox.perception.depth_views.DepthView.seen`). Real images also have
walls, the robot, specks of noise and neighbours:

| what | how |
|---|---|
| noise | a pixel is above the table from a height that grows with the square of the distance, as the noise below the table does; groups below 2 % of the largest are specks |
| the thing to grasp | the mask, or the group that is large, whole, near the middle of the image and no larger than the crop |
| the crop | lies around the thing to grasp |
| obstacles | all other points that are seen above the table, also beyond the crop |

Assumptions that may be wrong are returned as sentences: `Look.warnings`.
"""  # noqa: E501 (a table)

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from graspbox import _core
from graspbox._common.arguments import floats
from graspbox.errors import ConfigError
from graspbox.perception.configs import EVERYTHING, CropConfig
from graspbox.perception.crops import Crops, crop
from graspbox.perception.depth_images import check_table, is_cut_out, points_of
from graspbox.perception.depth_views import DepthView, Seen, voxels_of

__all__ = ["MOST_THINGS", "Look", "Survey", "Things", "crop_of_a_thing", "look", "survey", "things"]

#: Noise of a table: the greatest height that it may have, divided by the square of the depth, 1/m; how far below the
#: table it reaches, metres; pixels there that are too few to tell; the share of them that is taken, and the factor
#: from there to all noise.
_MOST_NOISE, _DEEPEST, _FEWEST, _NEARLY_ALL, _SAFE = 0.012, 0.03, 200, 0.95, 1.5
#: A group with less than this share of the pixels of the largest is noise.
_LEAST_SHARE = 0.02
#: Most things of an image, the largest ones.
MOST_THINGS = 100
#: Widest gap between pixels of one thing in plan view, metres.
_GAP = 0.03
#: Seen points from this height above the table are obstacles, and so far from the crop's middle, metres.
_OBSTACLE, _REACH = 0.012, 0.5
#: Distance between obstacles, metres.
_SPACING = 0.006
#: What a thing loses, compared with the logarithm of its number of pixels: at the image's border, for each half image
#: size from the middle, and if it exceeds the crop.
_CUT, _AWAY, _LARGE = 2.0, 1.0, 1.0
#: Greatest distances of the principal point from the image's middle, as shares of the image's size: along one axis, and
#: along both towards the same corner, as intrinsics of an image of another size are. Real ones of 94 captures are off
#: by up to 0.034 along one, 0.013 along both.
_OFF_CENTRE, _SCALED = 0.06, 0.025
#: Corrections of a given pose above either are told, radians and metres: half of the greatest ones.
_CORRECTED = (0.03, 0.02)
#: Distances of things that policies learned from, metres.
_LEARNED = (0.4, 1.2)


class Things(NamedTuple):
    """The things in a depth image: their labels (H, W), 1 for the largest and 0 for none, and heights (H, W), metres.

    Heights are over the table, medians of a pixel and its neighbours, NaN without depth.
    """

    labels: NDArray[np.uint32]
    heights: NDArray[np.float32]


class Survey(NamedTuple):
    """A real depth image: its levelled view, its things, and what was assumed.

    `points` (H, W, 3) are those of all pixels, table's frame, metres; pixels `over` (H, W) the table may be obstacles.
    """

    view: DepthView
    things: Things
    over: NDArray[np.bool_]
    points: NDArray[np.float64]
    warnings: tuple[str, ...]


class Look(NamedTuple):
    """A crop around the thing to grasp, its pixels (h, w), and what was assumed.

    Its seen points, and those of obstacles, are (k, 3), in the table's frame, metres, 6 mm apart.
    """

    seen: Seen
    object: NDArray[np.bool_]
    surface: NDArray[np.float64]
    keep_off: NDArray[np.float64]
    warnings: tuple[str, ...]


def things(
    view: DepthView, config: CropConfig, within: NDArray[np.bool_] | None = None, *, bare: bool = False
) -> Things:
    """Find the things on a table.

    Parameters
    ----------
    view : DepthView
        The image.
    config : CropConfig
        Its `min_height` and `min_pixels`.
    within : (H, W) bool, optional
        Pixels among which things are searched; by default all.
    bare : bool
        Whether the image shows no table: then every pixel is one of a thing.

    Raises
    ------
    ConfigError
        For arrays of another shape or type.
    """
    depth, lens, pose = _arrays(view)
    heights = _core.pixel_heights(depth, lens, pose)
    growth = _MOST_NOISE if bare else _noise(heights, depth)
    noise = np.maximum(config.min_height, growth * depth**2)
    above = np.nan_to_num(heights, nan=-1.0) > (-noise if bare else noise)
    labels = _core.pixel_groups(depth, lens, pose, above, _GAP)
    largest = int((labels == 1).sum())
    if within is not None:
        labels = _core.pixel_groups(depth, lens, pose, above & within, _GAP)
    sizes = np.bincount(labels.ravel(), minlength=2)[1:]
    kept = min(int(np.count_nonzero(sizes >= max(config.min_pixels, _LEAST_SHARE * largest))), MOST_THINGS)
    return Things(np.where(labels > kept, 0, labels).astype(np.uint32), heights)


def _noise(heights: NDArray[np.float32], depth: NDArray[np.float32]) -> float:
    """Return the noise of a table by its pixels (H, W) that seem to be below it, where only noise is.

    Heights up to this number times the square of the depth may be noise, 1/m.
    """
    below = (heights < 0.0) & (heights > -_DEEPEST)
    if np.count_nonzero(below) < _FEWEST:
        return _MOST_NOISE
    # The square of a tiny depth would be 0 in single precision.
    growths = -heights[below] / np.square(depth[below], dtype=np.float64)
    return float(min(_SAFE * np.quantile(growths, _NEARLY_ALL), _MOST_NOISE))


def survey(
    view: DepthView,
    config: CropConfig,
    *,
    within: NDArray[np.bool_] | None = None,
    pose_given: bool = False,
    assumed: str | None = None,
) -> Survey:
    """Level the camera of a real depth image, and find all its things.

    Parameters
    ----------
    view : DepthView
        The image.
    config : CropConfig
        The crop.
    within : (H, W) bool, optional
        Pixels among which things are searched; by default all.
    pose_given : bool
        Whether the camera's pose is known, and not found in the image: then the table need not be seen.
    assumed : str, optional
        The warning of a table that is not seen.

    Raises
    ------
    ConfigError
        If the camera's pose does not fit the image, or for arrays of another shape or type.
    """
    given = floats(view.world_from_camera, "world_from_camera")
    view = view if assumed else view.leveled()
    depth, lens, pose = _arrays(view)
    unseen = check_table(np.asarray(depth, np.float64), lens, pose) if pose_given else assumed
    warnings = [*_warnings_of_lens(lens, depth.shape), *([] if unseen is None else [unseen])]
    warnings += _warnings_of_pose(given, pose) if pose_given else []
    found = things(view, config, within, bare=unseen is not None)
    if pose_given and not found.labels.any() and is_cut_out(depth):
        found = things(view, config, within, bare=True)
        warnings.append("nothing rises above the table, so all that the image shows is the thing to grasp")
    over = np.nan_to_num(found.heights, nan=-1.0) > _OBSTACLE
    return Survey(view, found, over, _points(view), tuple(warnings))


def look(
    scene: Survey,
    config: CropConfig,
    *,
    mask: NDArray[np.bool_] | None = None,
    together: bool = False,
    num_threads: int | None = None,
) -> Look:
    """Look at the thing to grasp in a real depth image, and at what stands around it.

    Parameters
    ----------
    scene : Survey
        The image.
    config : CropConfig
        The crop.
    mask : (H, W) bool, optional
        Pixels of the thing to grasp; by default the best group of pixels above the table.
    together : bool
        Whether the volume shows all things of the crop, for a policy that takes a target among them, or only the one to
        grasp.
    num_threads : int, optional
        By default one per core.

    Raises
    ------
    ConfigError
        If no thing is seen, the mask shows none, or it is too far away.
    """
    view, found = scene.view, scene.things
    depth, lens, pose = _arrays(view)
    if mask is None:
        best = _best(scene, config)
        if not best:
            raise ConfigError(_no_thing(depth))
        own = found.labels == best
    else:
        own = mask & (depth > 0)
        if own.sum() < config.min_pixels:
            raise ConfigError(
                f"the mask has {int(own.sum())} pixels with a depth; pass the mask of a thing that the image shows"
            )
    labels = own | (found.labels > 0) if together else own
    made = crop(
        depth[None], lens, pose[None], labels=labels[None], middle=own[None], config=config, num_threads=num_threads
    )
    if not made.found[0]:
        raise ConfigError(
            "the thing to grasp is more than 5 m from the table's origin; check the depth scale and the pose"
        )
    frame = made.world_from_crop[0]
    surface = scene.points[own]
    target = voxels_of(surface, frame, config)
    warnings = (*scene.warnings, *_warnings_of_thing(scene, own, target, config))
    # Where it is alone, nothing need be told apart.
    others = voxels_of(scene.points[labels & ~own], frame, config)
    seen = Seen(made, target, view, others) if others.any() else Seen(made, None, view)
    return Look(seen, own, _spaced(surface), _obstacles(scene, own, frame, config), warnings)


def crop_of_a_thing(view: DepthView, config: CropConfig, rng: np.random.Generator) -> Crops:
    """Make the crop of a thing that is drawn, for training: larger things are drawn more often.

    As in `look`, a crop in which everything is one object (`EVERYTHING`) shows its neighbours too. Without a thing the
    crop has found none.
    """
    depth, lens, pose = _arrays(view)
    labels = things(view, config).labels
    sizes = np.bincount(labels.ravel(), minlength=2)[1:]
    drawn = 1 + int(rng.choice(len(sizes), p=sizes / sizes.sum())) if sizes.any() else 0
    own = (labels == drawn) & (labels > 0)
    shown = labels > 0 if config.gap >= EVERYTHING else own
    return crop(depth[None], lens, pose[None], labels=shown[None], middle=own[None], config=config)


def _arrays(view: DepthView) -> tuple[NDArray[np.float32], NDArray[np.float64], NDArray[np.float64]]:
    """Return depth (H, W), metres, intrinsics and pose of a view, as the core takes them."""
    return (
        np.ascontiguousarray(view.metres(), dtype=np.float32),
        floats(view.intrinsics, "intrinsics"),
        floats(view.world_from_camera, "world_from_camera"),
    )


def _points(view: DepthView) -> NDArray[np.float64]:
    """Return the points (H, W, 3) of all pixels, table's frame, metres."""
    depth, lens, pose = _arrays(view)
    points = np.zeros((*depth.shape, 3))
    points[depth > 0] = points_of(depth, lens) @ pose[:3, :3].T + pose[:3, 3]
    return points


def _spaced(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Keep one point of each cell."""
    if not len(points):
        return points
    cells = np.floor(points / _SPACING).astype(np.int64)
    cells -= cells.min(axis=0)
    # One number for each cell: numbers are sorted faster than rows.
    _, columns, layers = cells.max(axis=0) + 1
    numbers = (cells[:, 0] * columns + cells[:, 1]) * layers + cells[:, 2]
    return np.asarray(points[np.sort(np.unique(numbers, return_index=True)[1])])


def _no_thing(depth: NDArray[np.float32]) -> str:
    measured = depth[depth > 0]
    return (
        f"no object rises above the table, at depths of {measured.min():.3g} to {measured.max():.3g} m; check the "
        "camera's pose, the intrinsics and the depth scale, or pass another region or a mask"
    )


def _is_cut(own: NDArray[np.bool_]) -> bool:
    """Whether pixels touch the image's border."""
    return bool(own[:2].any() or own[-2:].any() or own[:, :2].any() or own[:, -2:].any())


def _extent(points: NDArray[np.float64]) -> float:
    """Return the greater extent of points (n, 3) along the table's x and y, metres."""
    return float(np.ptp(points[:, :2], axis=0).max()) if len(points) else 0.0


def _best(scene: Survey, config: CropConfig) -> int:
    """Choose the thing to grasp; 0 if there is none."""
    best, chosen, labels = -np.inf, 0, scene.things.labels
    middle = np.array(labels.shape) / 2
    for label in range(1, int(labels.max()) + 1):
        own = labels == label
        away = np.linalg.norm((np.array([places.mean() for places in np.nonzero(own)]) - middle) / middle)
        large = _extent(scene.points[own]) > config.side
        score = np.log(own.sum()) - _CUT * _is_cut(own) - _AWAY * away - _LARGE * large
        if score > best:
            best, chosen = float(score), label
    return chosen


def _obstacles(
    scene: Survey, own: NDArray[np.bool_], frame: NDArray[np.float64], config: CropConfig
) -> NDArray[np.float64]:
    """Return the seen points above the table but those of the thing to grasp in the crop, table's frame.

    Those of its neighbours in the crop are among them: a completed shape may lack what is seen.
    """
    points = scene.points[scene.over]
    local = (points - frame[:3, 3]) @ frame[:3, :3]
    least = np.array(config.origin)
    grasped = ((local >= least) & (local < least + config.side)).all(axis=1) & own[scene.over]
    return _spaced(points[~grasped & (np.linalg.norm(local[:, :2], axis=1) < _REACH)])


def _warnings_of_lens(lens: NDArray[np.float64], shape: tuple[int, ...]) -> list[str]:
    """Warn of a principal point far from the middle."""
    across, down = (float(lens[1 - axis, 2] / shape[axis] - 0.5) for axis in (1, 0))
    scaled = across * down > 0.0 and min(abs(across), abs(down)) > _SCALED
    if max(abs(across), abs(down)) <= _OFF_CENTRE and not scaled:
        return []
    return [
        f"the principal point ({lens[0, 2]:.0f}, {lens[1, 2]:.0f}) is far from the middle of an image of {shape[1]} x "
        f"{shape[0]} pixels: unless the image was cut, the intrinsics belong to one of another size"
    ]


def _warnings_of_pose(given: NDArray[np.float64], leveled: NDArray[np.float64]) -> list[str]:
    """Warn of a pose that the table in the image corrects by much."""
    turned = float(np.arccos(np.clip(given[2, :3] @ leveled[2, :3], -1.0, 1.0)))
    moved = abs(float(leveled[2, 3] - given[2, 3]))
    if turned <= _CORRECTED[0] and moved <= _CORRECTED[1]:
        return []
    return [
        f"the table in the image corrects the camera's pose by {np.degrees(turned):.1f} degrees and its height by "
        f"{1e3 * moved:.0f} mm; check the pose, the intrinsics and the depth scale"
    ]


def _warnings_of_thing(
    scene: Survey, own: NDArray[np.bool_], target: NDArray[np.bool_], config: CropConfig
) -> list[str]:
    """Warn of a thing that is cut, too large, or at an unusual distance."""
    found = []
    if _is_cut(own):
        found.append(
            "the image's border cuts the thing to grasp: it may be a wall or the robot; pass a mask or a region"
        )
    extent = _extent(scene.points[own])
    if extent > config.side or not target.any():
        found.append(
            f"the thing to grasp extends over {extent:.2f} m, more than the {config.side:.2f} m that the policy sees; "
            "pass the mask of one thing, and check intrinsics and depth scale"
        )
    distance = float(np.median(scene.view.metres()[own]))
    if not _LEARNED[0] <= distance <= _LEARNED[1]:
        found.append(
            f"the thing to grasp is {distance:.2f} m away, but policies learned from {_LEARNED[0]} to {_LEARNED[1]} m; "
            "check the depth scale"
        )
    return found
