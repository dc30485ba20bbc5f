"""A real depth image whose arguments are checked and whose table is known, as the networks see it."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from graspbox.errors import ConfigError
from graspbox.perception.captured import Survey, survey
from graspbox.perception.configs import CropConfig
from graspbox.perception.depth_images import (
    check_gravity,
    check_intrinsics,
    check_pose,
    fit_table,
    points_of,
    table_under,
    thinned,
)
from graspbox.perception.depth_views import DepthView
from graspbox.perception.leveling import level
from graspbox.perception.real.rays import distances_instead, is_flat
from graspbox.perception.real.workspace import Workspace

__all__ = ["RealImage"]

#: A table that leans against gravity by more is seen with other intrinsics, degrees: accelerometers err by 1 to 2.
_LEANING = 4.0
#: Width of the rim around what is left out, as a share of the image's width: 2 pixels of 640.
_MIXED = 0.003
#: Which points (n, 3), table's frame, at depths (n,), metres, are left out.
Hides = Callable[[NDArray[np.float64], NDArray[np.float64]], NDArray[np.bool_]]


@dataclass(frozen=True, eq=False)
class RealImage:
    """A depth image as the networks see it, and what is known about it.

    Attributes
    ----------
    view : DepthView
        The thinned image.
    step : int
        Every `step`-th pixel was kept.
    pose_given : bool
        Whether the camera's pose is known, and not found in the image.
    assumed : str, optional
        The warning of a table that is assumed, not seen.
    inside : (h, w) bool, optional
        Pixels of the view within which things are grasped; by default all.
    warnings : tuple of str
        What may be wrong with the image, as sentences.
    """

    view: DepthView
    step: int
    pose_given: bool
    assumed: str | None
    inside: NDArray[np.bool_] | None
    warnings: tuple[str, ...]

    @classmethod
    def of(
        cls,
        depth: ArrayLike,
        intrinsics: ArrayLike,
        table_from_camera: ArrayLike | None,
        *,
        gravity: ArrayLike | None = None,
        marked: NDArray[np.bool_] | None = None,
        region: tuple[int, int, int, int] | None = None,
        workspace: Workspace | None = None,
        without: Hides | None = None,
    ) -> Self:
        """Check an image, and find its table if the pose is not given.

        Parameters
        ----------
        depth, intrinsics, table_from_camera
            As of `graspbox.policies.grasp_image.ImageGrasper.find`.
        gravity, region, workspace
            As of `graspbox.policies.grasp_image.ImageOptions`.
        marked : (H, W) bool, optional
            Pixels of what is to be grasped, which carries nothing.
        without : callable, optional
            Which points (n, 3), table's frame, at depths (n,), metres, are left out with what they hide, such as the
            robot's; needs `table_from_camera`.

        Raises
        ------
        ConfigError
            If an argument is wrong, no table is found, or nothing is in the region and the workspace.
        """
        image = np.asarray(depth, dtype=np.float64)
        if image.ndim != 2:
            raise ConfigError(f"depth has shape {image.shape}; pass one image (H, W)")
        image = np.where(np.isfinite(image), image, 0.0)
        if (image < 0).any():
            raise ConfigError(f"depth holds {image.min():.3g} m; depths are distances along the optical axis")
        if gravity is not None and table_from_camera is not None:
            raise ConfigError("gravity and table_from_camera both say where up is; pass one of them")
        lens = check_intrinsics(intrinsics, (image.shape[0], image.shape[1]))
        down = None if gravity is None else check_gravity(gravity)
        given = None if table_from_camera is None else check_pose(table_from_camera)
        if without is not None and given is not None:
            image = _left_out(image, lens, given, without)
        inside = None if region is None else _within(region, image.shape)
        on_table = workspace is not None and workspace.in_table_frame(pose_given=given is not None)
        if workspace is not None and not on_table:
            inside = workspace.inside(image, lens, None, inside)
        pose, assumed, warnings = _table(image, lens, given, down, marked, inside)
        if workspace is not None and on_table:
            inside = workspace.inside(image, lens, pose, inside)
        small, lens, step = thinned(image, lens)
        made = cls(DepthView(small, lens, pose), step, given is not None, assumed, None, warnings)
        return made if inside is None else replace(made, inside=made.thinned(inside))

    def survey(self, crop: CropConfig) -> Survey:
        """Find the things in the image, or in a part of it."""
        seen = survey(self.view, crop, within=self.inside, pose_given=self.pose_given, assumed=self.assumed)
        return seen._replace(warnings=(*self.warnings, *seen.warnings))

    def thinned(self, full: NDArray[Any]) -> NDArray[Any]:
        """Take the pixels of the networks' image."""
        rows, columns = np.shape(self.view.depth)
        first = self.step // 2
        return np.ascontiguousarray(full[first :: self.step, first :: self.step][:rows, :columns])

    def own(self, pixels: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Return the pixels (h, w) of a thing in the view that are inside; raises ConfigError if none of some is."""
        if self.inside is None or not pixels.any():
            return pixels
        if not (pixels & self.inside).any():
            raise ConfigError("no pixel of the thing is in the region and the workspace; pass others, or another mask")
        return np.asarray(pixels & self.inside)


def _left_out(
    image: NDArray[np.float64], lens: NDArray[np.float64], given: NDArray[np.float64], without: Hides
) -> NDArray[np.float64]:
    """Take pixels (H, W) as not measured, and those next to them, which may show a mixture of near and far."""
    small, coarse, _ = thinned(image, lens)
    pose = level(small, coarse, given)
    points = points_of(image, lens) @ pose[:3, :3].T + pose[:3, 3]
    hidden = np.zeros(image.shape, dtype=np.bool_)
    hidden[image > 0] = without(points, image[image > 0])
    for _ in range(max(1, round(image.shape[1] * _MIXED))):
        grown = hidden.copy()
        grown[1:] |= hidden[:-1]
        grown[:-1] |= hidden[1:]
        grown[:, 1:] |= hidden[:, :-1]
        grown[:, :-1] |= hidden[:, 1:]
        hidden = grown
    return np.where(hidden, 0.0, image)


def _table(
    image: NDArray[np.float64],
    lens: NDArray[np.float64],
    given: NDArray[np.float64] | None,
    down: NDArray[np.float64] | None,
    marked: NDArray[np.bool_] | None,
    inside: NDArray[np.bool_] | None,
) -> tuple[NDArray[np.float64], str | None, tuple[str, ...]]:
    """Return the camera's pose, the warning of an assumed table, and warnings of another kind of depth or lens."""
    focus = inside if marked is None else marked
    # What is to be grasped carries nothing: its faces are no table.
    around = image if marked is None else np.where(marked, 0.0, image)
    if given is not None and is_flat(around, lens, given):
        return given, None, ()
    found, failure, assumed = None, "", None
    try:
        found = fit_table(around, lens, focus, down)
    except ConfigError as error:
        failure = str(error)
    curved = distances_instead(around, lens, found, focus, down)
    warnings = [] if curved is None else [curved]
    if given is not None:
        return given, None, tuple(warnings)
    if found is None:
        if down is None or marked is None:
            raise ConfigError(failure if curved is None else f"{failure}; {curved}")
        assumed = f"a table is assumed 20 mm under the lowest pixel of the mask ({failure})"
        found = table_under(image, lens, marked, down)
    leaning = 0.0 if down is None else float(np.degrees(np.arccos(np.clip(-found[2, :3] @ down, -1.0, 1.0))))
    if leaning > _LEANING:
        warnings.append(
            f"the table leans by {leaning:.1f} degrees against gravity; check the focal length, and that gravity is in "
            "the camera's frame"
        )
    return found, assumed, tuple(warnings)


def _within(region: tuple[int, int, int, int], shape: tuple[int, ...]) -> NDArray[np.bool_]:
    """Mark the pixels of a region in an image."""
    left, top, right, bottom = region
    if not (0 <= left < right <= shape[1] and 0 <= top < bottom <= shape[0]):
        raise ConfigError(f"region is {region}; pass left < right <= {shape[1]} and top < bottom <= {shape[0]}")
    full = np.zeros(shape, dtype=np.bool_)
    full[top:bottom, left:right] = True
    return full
