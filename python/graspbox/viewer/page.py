"""`Page`, the interface of all kinds of views, and the options that they share."""

from abc import ABC, abstractmethod
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

from graspbox.hands import HandLike
from graspbox.viewer.canvas import Canvas

__all__ = ["Options", "Page"]


@dataclass(frozen=True)
class Options:
    """Options of a view; each kind uses those that apply to it.

    Attributes
    ----------
    hand : str, Hand or pair of paths
        See `graspbox.load_hand`.
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
    policy : str or None
        Policy of an environment or of a depth image: a name or a folder.
    intrinsics : sequence of 4 float, or None
        fx, fy, cx, cy of a depth image, pixels.
    depth_scale : float or None
        Metres per unit of a depth image; by default 1 for floats, 0.001 for integers.
    camera_pose : path or None
        File of ``table_from_camera`` of a depth image; by default the table is found in the image.
    """

    hand: HandLike = "reflex"
    objects: str | None = None
    layout: str | None = None
    objects_per_scene: int | None = None
    scale: float = 1.0
    seed: int = 0
    poses: int = 200
    policy: str | None = None
    intrinsics: tuple[float, float, float, float] | None = None
    depth_scale: float | None = None
    camera_pose: str | Path | None = None


class Page(ABC):
    """A view: its scene, its controls, and their callbacks.

    Parameters
    ----------
    content : object
        Content of the page, from its recogniser.
    canvas : Canvas
        The canvas of the page.
    options : Options
        Options of the view.

    Attributes
    ----------
    title : str
        Kind of the content, in errors and as the label of the panel.
    """

    title: ClassVar[str] = "view"

    def __init__(self, content: Any, canvas: Canvas, options: Options) -> None:
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
