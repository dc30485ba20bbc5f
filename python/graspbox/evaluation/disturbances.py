"""Real captures with wrong intrinsics, units and kinds of depth: how many pass without a warning.

| kind | what is wrong | factors |
|---|---|---|
| ``K`` | intrinsics of an image of another size | 0.5 to 1.5 |
| ``focal`` | the focal length alone | 0.5 to 1.5 |
| ``unit`` | the depth scale | 0.1 to 10 |
| ``distance`` | distances along rays are read as depths | 1 |

An image is *told* if it is refused, or a warning is among those of the disturbed image and not, whatever its numbers,
among those of the right one. It passes in *silence* if it has no warning at all.
"""

import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from graspbox.errors import ConfigError
from graspbox.evaluation.captures import Capture, Given
from graspbox.perception.depth_images import metric_depth
from graspbox.perception.real import z_of_distances
from graspbox.policies.grasp_image import ImageGrasper

__all__ = ["DISTURBANCES", "Disturbance", "DisturbedCapture", "disturb_captures", "silence"]


@dataclass(frozen=True)
class Disturbance:
    """What is wrong with an image: the kind and its factor, 1 for nothing."""

    kind: str
    factor: float

    def of(self, capture: Capture) -> Capture:
        """Return the disturbed image; raises ConfigError if no such depth is read."""
        lens = capture.intrinsics.copy()
        if self.kind == "K":
            lens = np.diag([self.factor, self.factor, 1.0]) @ lens
        if self.kind == "focal":
            lens[[0, 1], [0, 1]] *= self.factor
        depth = capture.depth
        if self.kind == "unit":
            depth = metric_depth(depth, self.factor)
        if self.kind == "distance":
            flat = z_of_distances(np.ones_like(depth), lens)
            depth = depth / flat
        return replace(capture, depth=depth, intrinsics=lens)


_SCALES, _UNITS = (0.5, 0.75, 0.9, 1.1, 1.25, 1.5), (0.1, 0.2, 0.25, 0.5, 2.0, 4.0, 5.0, 10.0)
#: What is tried with each capture.
DISTURBANCES = (
    *(Disturbance(kind, scale) for kind in ("K", "focal") for scale in _SCALES),
    *(Disturbance("unit", unit) for unit in _UNITS),
    Disturbance("distance", 1.0),
)


@dataclass(frozen=True)
class DisturbedCapture:
    """What was said of a disturbed image.

    Attributes
    ----------
    capture, camera : str
        As of `graspbox.evaluation.captures.JudgedCapture`.
    kind, factor : str, float
        As of `Disturbance`.
    refused : str, optional
        Why it was refused.
    warnings : tuple of str
        Those of the image.
    told : bool
        Whether it was refused, or has a warning that the right image lacks.
    """

    capture: str
    camera: str
    kind: str
    factor: float
    refused: str | None
    warnings: tuple[str, ...]
    told: bool

    @property
    def silent(self) -> bool:
        """Whether nothing at all was said."""
        return self.refused is None and not self.warnings


def disturb_captures(
    grasper: ImageGrasper,
    folders: tuple[Path, ...],
    *,
    given: Given = "depth",
    progress: Callable[[int], None] = lambda done: None,
) -> Iterator[DisturbedCapture]:
    """Check each image with each of `DISTURBANCES`, without grasps; those that are refused undisturbed are left out.

    Raises
    ------
    ConfigError, FileError
        For a capture that cannot be read, and for things that are `given` one by one.
    """
    if given not in ("depth", "pose"):
        raise ConfigError(f"given is {given!r}; whole images are disturbed: choose depth or pose")
    for done, folder in enumerate(folders):
        shown = Capture.read(folder).shown(given, None)
        right, refused = ((), "no plane") if shown is None else _said(grasper, shown, Disturbance("none", 1.0))
        if shown is not None and refused is None:
            known = {_kind_of(warning) for warning in right}
            for one in DISTURBANCES:
                warnings, refused = _said(grasper, shown, one)
                told = refused is not None or any(_kind_of(warning) not in known for warning in warnings)
                yield DisturbedCapture(shown.name, shown.camera, one.kind, one.factor, refused, warnings, told)
        progress(done + 1)


def _said(grasper: ImageGrasper, capture: Capture, disturbance: Disturbance) -> tuple[tuple[str, ...], str | None]:
    """Return the warnings of a disturbed image, and why it is refused."""
    try:
        seen = disturbance.of(capture)
        return grasper.check(seen.depth, seen.intrinsics, seen.table_from_camera), None
    except ConfigError as error:
        return (), str(error)


def _kind_of(warning: str) -> str:
    """Return a warning without its numbers."""
    return re.sub(r"[-\d.]+", "#", warning)


def silence(rows: list[DisturbedCapture]) -> dict[str, dict[str, Any]]:
    """Count images for each kind and factor, and for each kind: ``of``, ``refused``, ``told``, ``silent``."""
    groups: dict[str, list[DisturbedCapture]] = {}
    for row in rows:
        groups.setdefault(f"{row.kind} x {row.factor:g}", []).append(row)
    for row in rows:
        groups.setdefault(f"{row.kind}, all", []).append(row)
    return {
        name: {
            "of": len(own),
            "refused": sum(row.refused is not None for row in own),
            "told": sum(row.told for row in own),
            "silent": sum(row.silent for row in own),
        }
        for name, own in groups.items()
    }
