"""A box in space within which things are grasped."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, Self, get_args

import numpy as np
from numpy.typing import NDArray

from graspbox._common.arguments import floats
from graspbox.errors import ConfigError
from graspbox.perception.depth_images import points_of

__all__ = ["FRAMES", "Frame", "Workspace"]

#: Frames of a workspace.
Frame = Literal["table", "camera"]
FRAMES = get_args(Frame)


@dataclass(frozen=True)
class Workspace:
    """A box with axes along those of a frame: only what is seen in it is grasped, all else remains an obstacle.

    Attributes
    ----------
    low, high : (float, float, float)
        Corners with the least and the greatest coordinates, metres.
    frame : {"table", "camera"}, optional
        The frame of the corners; by default the table's if the camera's pose is given, else the camera's (x right, y
        down, z forward). The frame of a table that is found in the image has its origin below the camera
        (`graspbox.perception.depth_images.camera_over_table`).

    Raises
    ------
    ConfigError
        If a corner is not three finite numbers, the frame is unknown, or the box is empty.
    """

    low: tuple[float, float, float]
    high: tuple[float, float, float]
    frame: Frame | None = None

    @classmethod
    def of(cls, corners: Sequence[float] | None, frame: Frame | None) -> Self | None:
        """Return the box of six numbers, X Y Z X Y Z, if there are any.

        Raises
        ------
        ConfigError
            For other corners, and for a frame without them.
        """
        if corners is None:
            if frame is not None:
                raise ConfigError(f"workspace_frame is {frame!r}, the frame of a workspace; pass the workspace too")
            return None
        numbers = floats(corners, "workspace")
        if numbers.shape != (6,):
            raise ConfigError(f"workspace has shape {numbers.shape}; pass six numbers, X Y Z X Y Z, metres")
        x, y, z, to_x, to_y, to_z = numbers.tolist()
        return cls((x, y, z), (to_x, to_y, to_z), frame)

    def __post_init__(self) -> None:
        """Check the corners."""
        for name, corner in (("low", self.low), ("high", self.high)):
            numbers = floats(corner, f"the workspace's {name}")
            if numbers.shape != (3,) or not np.isfinite(numbers).all():
                raise ConfigError(f"the workspace has {name} = {corner}; pass three finite numbers, metres")
            object.__setattr__(self, name, tuple(numbers.tolist()))
        if self.frame not in (None, *FRAMES):
            raise ConfigError(f"the workspace is in the frame {self.frame!r}; choose from {', '.join(FRAMES)}")
        for axis, least, greatest in zip("xyz", self.low, self.high, strict=True):
            if not least < greatest:
                empty = "has no extent" if least == greatest else "has its corners swapped"
                raise ConfigError(
                    f"the workspace {empty} along {axis}, from {least:g} to {greatest:g} m; pass the corner with the "
                    "least coordinates, then that with the greatest"
                )

    def in_table_frame(self, *, pose_given: bool) -> bool:
        """Whether the box is in the table's frame."""
        return self.frame == "table" or (self.frame is None and pose_given)

    def inside(
        self,
        depth: NDArray[np.float64],
        intrinsics: NDArray[np.float64],
        table_from_camera: NDArray[np.float64] | None,
        among: NDArray[np.bool_] | None = None,
    ) -> NDArray[np.bool_]:
        """Return the pixels (H, W) of an image, metres, or of those `among` it, that see something in the box.

        The box is in the camera's frame if `table_from_camera` is None.

        Raises
        ------
        ConfigError
            If there are none.
        """
        seen = depth > 0 if among is None else (depth > 0) & among
        points = points_of(np.where(seen, depth, 0.0), intrinsics)
        if table_from_camera is not None:
            points = points @ table_from_camera[:3, :3].T + table_from_camera[:3, 3]
        within = ((points >= self.low) & (points <= self.high)).all(axis=1)
        if not within.any():
            frame = "camera" if table_from_camera is None else "table"
            least, greatest = (
                ("nothing",) * 2 if not len(points) else (_shown(points.min(axis=0)), _shown(points.max(axis=0)))
            )
            raise ConfigError(
                f"nothing is seen in the workspace from {_shown(self.low)} to {_shown(self.high)} m in the {frame}'s "
                f"frame, where the image shows {least} to {greatest} m; check the corners and the frame"
            )
        found = np.zeros(depth.shape, dtype=np.bool_)
        found[seen] = within
        return found


def _shown(corner: tuple[float, float, float] | NDArray[np.float64]) -> str:
    return "({})".format(", ".join(f"{x:.3g}" for x in corner))
