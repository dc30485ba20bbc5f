"""Grasps in real depth images, judged by what the camera saw; no robot executes them.

A folder of captures holds a folder for each:

| file | contents |
|---|---|
| ``depth.npy`` or ``depth.png`` | as `graspbox.captures.read_capture` reads it |
| ``capture.json`` | ``intrinsics``: ``fx``, ``fy``, ``cx``, ``cy``, pixels, centres of pixels at integers; ``camera``; others are ignored |
| ``labels.png`` | (H, W): 0, or the number of a thing |

``plane`` in ``capture.json`` is optional: the table, or what carries the things, is ``normal @ x = offset``, metres, in
the camera's frame.

A grasp is *on* a thing if the point on which the hand closes is within 2 cm of its seen points, and *near* it within
4 cm. It is *in collision* if points of the image, of whatever thing, are more than 3 mm inside the open hand. A table
is *right* if it is within 2 degrees and, at the things, within 12 mm of the plane.
"""  # noqa: E501 (a table)

import json
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, Literal, Self

import numpy as np
from numpy.typing import NDArray

from graspbox import captures
from graspbox._common.files import read_bounded
from graspbox.errors import ConfigError, FileError
from graspbox.hands import Hand
from graspbox.hands.description import describe
from graspbox.perception.depth_images import camera_over_plane
from graspbox.policies.grasp_image import ImageGrasper, ImageGrasps

__all__ = ["Capture", "Given", "JudgedCapture", "captures_in", "judge_captures", "summary"]

#: Greatest distance of a grasp that is on, and near, a thing, and least depth of a collision, metres.
ON, NEAR, DEEP = 0.02, 0.04, 0.003
#: Greatest angle and, at the things, distance of a right table, degrees and metres.
TILT, OFF = 2.0, 0.012
#: What a policy is given: the whole image, also the camera's pose over the plane, also the mask of a thing, or a thing
#: alone with the camera's pose, where nothing else was measured.
Given = Literal["depth", "pose", "mask", "alone"]
#: Fewer pixels with a depth are no thing.
_LEAST_PIXELS = 20
#: Points farther from the hand cannot be inside, metres.
_REACH = 0.4
#: Greatest size of ``capture.json``, bytes.
_LARGEST = 1 << 20


@dataclass(frozen=True, eq=False)
class Capture(captures.Capture):
    """A depth image with its camera and the things in it, whose `labels` are known.

    Attributes
    ----------
    name, camera : str
        The folder's name, and the kind of camera.
    plane : (3,) float64 and float, optional
        Unit normal and offset of what carries the things: ``normal @ x = offset``, metres, camera's frame.
    """

    name: str = ""
    camera: str = "unknown"
    plane: tuple[NDArray[np.float64], float] | None = None

    @classmethod
    def read(cls, folder: Path) -> Self:
        """Read a capture; raises FileError and ConfigError for a missing or wrong file."""
        image = next((path for path in (folder / "depth.npy", folder / "depth.png") if path.is_file()), None)
        if image is None:
            raise FileError(2, "there is no depth.npy or depth.png", str(folder))
        described = folder / "capture.json"
        seen = captures.read_capture(image, intrinsics=described, labels=folder / "labels.png")
        told = json.loads(read_bounded(described, _LARGEST))
        camera, plane = str(told.get("camera", "unknown")), _plane(told.get("plane"), described)
        return cls(**vars(seen), name=folder.name, camera=camera, plane=plane)

    def posed(self) -> Self | None:
        """Return the image with the camera's pose over the plane; None without a plane."""
        pose = None if self.plane is None else camera_over_plane(*self.plane)
        return None if pose is None else replace(self, table_from_camera=pose)

    def shown(self, given: Given, thing: int | None) -> Self | None:
        """Return what a policy is given, of a thing or of all; None if that needs a plane, and there is none."""
        if given in ("depth", "mask"):
            return self
        if (posed := self.posed()) is None or thing is None:
            return posed
        return replace(posed, depth=np.where(self.labels == thing, self.depth, 0.0))

    @property
    def things(self) -> tuple[int, ...]:
        """Numbers of the things of which enough pixels have a depth."""
        assert self.labels is not None
        numbers, counts = np.unique(self.labels[self.depth > 0], return_counts=True)
        return tuple(int(n) for n, count in zip(numbers, counts, strict=True) if n and count >= _LEAST_PIXELS)


@dataclass(frozen=True)
class JudgedCapture:
    """The best grasp of a thing, or of any thing of a capture, as it is judged.

    Attributes
    ----------
    capture, camera : str
        As of `Capture`.
    thing : int, optional
        The thing that was given; None if the policy chose.
    refused : str, optional
        Why there is no grasp; the other values are then None.
    distance : float, optional
        From the point on which the hand closes to the seen points of the thing, metres.
    inside : int, optional
        Number of seen points in the open hand.
    success : float, optional
        Stated probability of success.
    free : bool, optional
        Whether the answer states that the open hand touches nothing.
    tilt, off : float, optional
        Angle between the table and the plane of the capture, degrees, and their distance at the things, metres; None
        without a plane, or if the camera's pose was given.
    warnings : tuple of str
        Those of the result.
    """

    capture: str
    camera: str
    thing: int | None
    refused: str | None = None
    distance: float | None = None
    inside: int | None = None
    success: float | None = None
    free: bool | None = None
    tilt: float | None = None
    off: float | None = None
    warnings: tuple[str, ...] = ()

    def to_json(self) -> dict[str, Any]:
        """Plain values."""
        return asdict(self)


def captures_in(folder: Path) -> tuple[Path, ...]:
    """Return the folders of captures in a folder, in order; raises FileError if there are none."""
    found = tuple(sorted(path.parent for path in folder.glob("*/capture.json")))
    if not found:
        raise FileError(2, "there is no capture (NAME/capture.json)", str(folder))
    return found


def judge_captures(
    grasper: ImageGrasper,
    folders: tuple[Path, ...],
    *,
    given: Given = "depth",
    seed: int = 0,
    progress: Callable[[int], None] = lambda done: None,
    draw: Callable[[str, ImageGrasps], None] = lambda name, grasps: None,
) -> Iterator[JudgedCapture]:
    """Judge the best grasp in each capture, or of each thing that is given; `draw` gets all answers, with a name.

    Raises
    ------
    ConfigError, FileError
        For a capture that cannot be read. An image that the policy refuses is a result.
    """
    for done, folder in enumerate(folders):
        capture = Capture.read(folder)
        for thing in (None,) if given in ("depth", "pose") and capture.things else capture.things:
            if (shown := capture.shown(given, thing)) is not None:
                yield _judged(grasper, capture, shown, thing, seed, draw)
        progress(done + 1)


def _judged(
    grasper: ImageGrasper,
    capture: Capture,
    shown: Capture,
    thing: int | None,
    seed: int,
    draw: Callable[[str, ImageGrasps], None],
) -> JudgedCapture:
    """Judge the best grasp in what is shown of a capture."""
    assert capture.labels is not None
    own = capture.labels > 0 if thing is None else capture.labels == thing
    told = JudgedCapture(capture.name, capture.camera, thing)
    pose = shown.table_from_camera
    try:
        found = grasper.find(
            shown.depth, shown.intrinsics, pose, count=1, mask=None if thing is None else own, seed=seed
        )
    except ConfigError as error:
        return replace(told, refused=str(error))
    draw(capture.name if thing is None else f"{capture.name}_{thing}", found)
    told = replace(told, warnings=found.warnings)
    seen = capture.points(own)
    if capture.plane is not None and pose is None:
        tilt, off = _table_error(found.table_from_camera, *capture.plane, seen.mean(axis=0))
        told = replace(told, tilt=tilt, off=off)
    if not len(found):
        return replace(told, refused="no grasp of the thing is feasible")
    hand_pose, preshape = found.camera_from_hand[0], float(found.preshape[0])
    point = hand_pose[:3, :3] @ found.hand.closing_center(preshape) + hand_pose[:3, 3]
    inside = depth_inside(found.hand, preshape, hand_pose, capture.points())
    return replace(
        told,
        distance=float(np.linalg.norm(seen - point, axis=1).min()),
        inside=int((inside > DEEP).sum()),
        success=float(found.success[0]),
        free=bool(found.free[0]),
    )


def _table_error(
    table_from_camera: NDArray[np.float64], normal: NDArray[np.float64], offset: float, middle: NDArray[np.float64]
) -> tuple[float, float]:
    """Return the angle between a table and a plane, degrees, and their distance at a point, metres."""
    up = table_from_camera[2, :3]
    angle = float(np.degrees(np.arccos(min(abs(float(up @ normal)), 1.0))))
    # The point of the plane below the things, in the table's frame.
    below = middle - (normal @ middle - offset) * normal
    return angle, abs(float(up @ below + table_from_camera[2, 3]))


def _plane(told: Any, file: Path) -> tuple[NDArray[np.float64], float] | None:
    """Read the plane of a capture."""
    if told is None:
        return None
    try:
        normal, offset = np.array(told["normal"], dtype=np.float64), float(told["offset"])
    except (KeyError, TypeError, ValueError):
        normal, offset = np.zeros(0), 0.0
    if normal.shape != (3,) or not np.isclose(np.linalg.norm(normal), 1.0, atol=1e-3):
        raise ConfigError(f"{file}: plane is {told!r}; pass a unit normal of 3 numbers and an offset, metres")
    return normal / np.linalg.norm(normal), offset


def depth_inside(
    hand: Hand, preshape: float, pose: NDArray[np.float64], points: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return how deep points (n, 3) near an open hand at a pose (4, 4) are inside its collision shapes, metres.

    Points outside have negative values.
    """
    near = (points - pose[:3, 3]) @ pose[:3, :3]
    near = near[np.linalg.norm(near, axis=1) < _REACH]
    poses, half, _, _ = hand.shapes(hand.open(preshape))
    kinds = [shape.kind for link in describe(hand).links for shape in link.shapes]
    deepest = np.full(len(near), -np.inf)
    for frame, size, kind in zip(poses, half, kinds, strict=True):
        local = (near - frame[:3, 3]) @ frame[:3, :3]
        if kind == "box":
            depth = (size - np.abs(local)).min(axis=1)
        elif kind == "cylinder":
            depth = np.minimum(size[0] - np.hypot(local[:, 0], local[:, 1]), size[2] - np.abs(local[:, 2]))
        else:
            depth = size[0] - np.linalg.norm(local, axis=1)
        deepest = np.maximum(deepest, depth)
    return deepest


def summary(rows: list[JudgedCapture]) -> dict[str, Any]:
    """Count the results of a camera, or of all: ``of``, ``answered``, ``on``, ``near``, ``in_collision``, ``warned``.

    ``untold`` counts collisions of which the answer says that the hand is free, ``planes`` those whose table can be
    judged, ``right_planes`` the right ones of these. ``sure_and_wrong`` counts grasps that are not near and state more
    than 0.7, ``success_of_near`` is the mean stated probability of the others.
    """
    answered = [row for row in rows if row.distance is not None]
    near = [row for row in answered if (row.distance or 0.0) < NEAR]
    wrong = [row for row in answered if row not in near]
    planes = [(row.tilt, row.off) for row in rows if row.tilt is not None and row.off is not None]
    return {
        "of": len(rows),
        "answered": len(answered),
        "on": sum((row.distance or 0.0) < ON for row in answered),
        "near": len(near),
        "in_collision": sum(bool(row.inside) for row in answered),
        "untold": sum(bool(row.inside and row.free) for row in answered),
        "warned": sum(bool(row.warnings) for row in answered),
        "planes": len(planes),
        "right_planes": sum(tilt < TILT and off < OFF for tilt, off in planes),
        "sure_and_wrong": sum((row.success or 0.0) > 0.7 for row in wrong),
        "success_of_near": float(np.mean([row.success for row in near])) if near else None,
    }
