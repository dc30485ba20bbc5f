"""`Page`, the interface of all kinds of views, and the options that they share."""

import os
from abc import ABC, abstractmethod
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

from graspbox.hands import HandLike
from graspbox.perception.real import DepthKind
from graspbox.tools.viewer.canvas import Canvas


@dataclass(frozen=True)
class ViewerOptions:
    """Options of a view; each kind of view uses those that apply to it.

    Attributes
    ----------
    hand : str, Hand, pair of paths or None
        See `graspbox.load_hand`; by default that of the policy, else ``reflex``.
    objects : str or None
        The object of a plan, if its name is not enough; the objects of an environment.
    layout : str or None
        How the objects of an environment lie: ``single``, ``packed``, ``pile`` or ``bin``; by default as the
        environment or the policy has it.
    objects_per_scene : int or None
        Number of objects of a layout.
    scale : float
        Metres per unit of mesh files.
    seed : int
        Seed of plans, episodes and refinements.
    poses : int
        Poses of a plan that are simulated at once, the best first; the page has a button for the rest.
    policy : str, PathLike or None
        Policy of an environment or of a depth image: a name or a folder.
    intrinsics : sequence of 4 float, or None
        fx, fy, cx, cy of a depth image, pixels; by default those of its file or of `camera_info`.
    camera_info : path or None
        File with the intrinsics of a depth image (`graspbox.captures.read_capture`).
    depth_scale : float or None
        Metres per unit of a depth image; by default as its file states, else 1 for floats, 0.001 for integers.
    depth_is, limits : str, and (float, float) or None
        As of `graspbox.captures.read_capture`.
    camera_pose : path or None
        File of ``table_from_camera`` of a depth image; by default it is fitted to the table in the image.
    mask : path or None
        Numbers of the things in a depth image, 0 for none, ``.npy`` or ``.png``: each has its grasps.
    topic, time : str and float, or None
        Of a recording, as of `graspbox.captures.read_capture`.
    """

    hand: HandLike | None = None
    objects: str | None = None
    layout: str | None = None
    objects_per_scene: int | None = None
    scale: float = 1.0
    seed: int = 0
    poses: int = 200
    policy: str | os.PathLike[str] | None = None
    intrinsics: tuple[float, float, float, float] | None = None
    camera_info: str | Path | None = None
    depth_scale: float | None = None
    depth_is: DepthKind = "z"
    limits: tuple[float, float] | None = None
    camera_pose: str | Path | None = None
    mask: str | Path | None = None
    topic: str | None = None
    time: float | None = None

    def hand_or(self, other: HandLike = "reflex") -> HandLike:
        """Return the hand, or another one if none is named."""
        return other if self.hand is None else self.hand


class Page(ABC):
    """A view of the content that its recogniser returns; `title` is its kind, in errors and on the panel."""

    title: ClassVar[str] = "view"

    def __init__(self, content: Any, canvas: Canvas, options: ViewerOptions) -> None:
        self.content, self.canvas, self.options = content, canvas, options

    @abstractmethod
    def build(self) -> None:
        """Draw the first picture and the controls; longer work begins in the background.

        Raises
        ------
        GraspboxError
            If the content cannot be shown.
        """

    def close(self) -> None:  # noqa: B027 (most pages have nothing to close)
        """End players and environments of the page; the canvas ends its own threads."""
