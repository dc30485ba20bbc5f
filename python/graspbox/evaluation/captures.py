"""Grasps in real depth images, judged by what the camera saw; no robot executes them.

A folder of captures holds a folder for each:

| file | contents |
|---|---|
| ``depth.npy`` or ``depth.png`` | as `graspbox.captures.read_capture` reads it |
| ``capture.json`` | ``intrinsics``: ``fx``, ``fy``, ``cx``, ``cy``, pixels, centres of pixels at integers; ``camera``; others are ignored |
| ``labels.png`` | (H, W): 0, or the number of a thing |

A grasp is *on* a thing if the point on which the hand closes is within 2 cm of its seen points, and *near* it within
4 cm. It is *in collision* if points of the image, of whatever thing, are more than 3 mm inside the open hand.
"""  # noqa: E501 (a table)

import json
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from graspbox import captures
from graspbox._common.files import read_bounded
from graspbox.errors import ConfigError, FileError
from graspbox.hands import Hand
from graspbox.hands.description import describe
from graspbox.policies.grasp_image import ImageGrasper

__all__ = ["Capture", "JudgedCapture", "captures_in", "judge_captures", "summary"]

#: Greatest distance of a grasp that is on, and near, a thing, and least depth of a collision, metres.
ON, NEAR, DEEP = 0.02, 0.04, 0.003
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
    """

    name: str = ""
    camera: str = "unknown"

    @classmethod
    def read(cls, folder: Path) -> Self:
        """Read a capture; raises FileError and ConfigError for a missing or wrong file."""
        image = next((path for path in (folder / "depth.npy", folder / "depth.png") if path.is_file()), None)
        if image is None:
            raise FileError(2, "there is no depth.npy or depth.png", str(folder))
        described = folder / "capture.json"
        seen = captures.read_capture(image, intrinsics=described, labels=folder / "labels.png")
        camera = str(json.loads(read_bounded(described, _LARGEST)).get("camera", "unknown"))
        return cls(**vars(seen), name=folder.name, camera=camera)

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
        The thing whose mask was given; None if the policy chose.
    refused : str, optional
        Why there is no grasp; the other values are then None.
    distance : float, optional
        From the point on which the hand closes to the seen points of the thing, metres.
    inside : int, optional
        Number of seen points in the open hand.
    success : float, optional
        Stated probability of success.
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
    masks: bool = False,
    seed: int = 0,
    progress: Callable[[int], None] = lambda done: None,
) -> Iterator[JudgedCapture]:
    """Judge the best grasp in each capture, or with `masks` of each thing.

    Raises
    ------
    ConfigError, FileError
        For a capture that cannot be read. An image that the policy refuses is a result.
    """
    for done, folder in enumerate(folders):
        capture = Capture.read(folder)
        for thing in capture.things if masks else (None,):
            if thing is not None or capture.things:
                yield _judged(grasper, capture, thing, seed)
        progress(done + 1)


def _judged(grasper: ImageGrasper, capture: Capture, thing: int | None, seed: int) -> JudgedCapture:
    assert capture.labels is not None
    mask = None if thing is None else capture.labels == thing
    told = partial(JudgedCapture, capture.name, capture.camera, thing)
    try:
        found = grasper.find(capture.depth, capture.intrinsics, count=1, mask=mask, seed=seed)
    except ConfigError as error:
        return told(refused=str(error))
    if not len(found):
        return told(refused="no grasp of the thing is feasible", warnings=found.warnings)
    pose, preshape = found.camera_from_hand[0], float(found.preshape[0])
    point = pose[:3, :3] @ found.hand.closing_center(preshape) + pose[:3, 3]
    of_things = capture.points(capture.labels > 0 if mask is None else mask)
    inside = depth_inside(found.hand, preshape, pose, capture.points())
    return told(
        distance=float(np.linalg.norm(of_things - point, axis=1).min()),
        inside=int((inside > DEEP).sum()),
        success=float(found.success[0]),
        warnings=found.warnings,
    )


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

    ``sure_and_wrong`` counts grasps that are not near and state more than 0.7, ``success_of_near`` is the mean
    stated probability of the others.
    """
    answered = [row for row in rows if row.distance is not None]
    near = [row for row in answered if (row.distance or 0.0) < NEAR]
    wrong = [row for row in answered if row not in near]
    return {
        "of": len(rows),
        "answered": len(answered),
        "on": sum((row.distance or 0.0) < ON for row in answered),
        "near": len(near),
        "in_collision": sum(bool(row.inside) for row in answered),
        "warned": sum(bool(row.warnings) for row in answered),
        "sure_and_wrong": sum((row.success or 0.0) > 0.7 for row in wrong),
        "success_of_near": float(np.mean([row.success for row in near])) if near else None,
    }
