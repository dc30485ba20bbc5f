"""`Canvas`: a viser server as pages use it: guarded callbacks, background work, a line for messages, common parts.

Callbacks of controls run one at a time, under `Canvas.lock`. An error in one is shown in the page; it ends neither
the page nor the server.
"""

import functools
import logging
import threading
from collections.abc import Callable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from graspbox.errors import ConfigError, GraspboxError
from graspbox.meshes import Mesh, Surroundings
from graspbox.meshes.shapes import BOX_EDGES, Floats, Triangles
from graspbox.planning import Box
from graspbox.tools.viewer.geometry import EDGES, OBJECT, Color, sphere, split, strips

_log = logging.getLogger(__name__)
#: Side of the cells of the table's grid, and of the table, metres.
_CELL, _TABLE = 0.05, 0.8
#: Colour of its lines, and half their width, metres.
_GREY, _LINE = (205, 205, 205), 0.0006


class Canvas:
    """A viser server (`viser.ViserServer`) as pages use it."""

    def __init__(self, server: Any) -> None:
        self.server, self.scene, self.gui = server, server.scene, server.gui
        self.lock = threading.RLock()
        self.closed = threading.Event()
        #: Shows another thing instead of this page; set by the viewer.
        self.open: Callable[[Any], object] = self._cannot_open
        self._worker = ThreadPoolExecutor(1, thread_name_prefix="graspbox-viewer")
        self.status = self.gui.add_markdown("")
        self.problem = self.gui.add_markdown("", visible=False)

    def _cannot_open(self, source: Any) -> None:
        raise ConfigError(f"this canvas has no viewer that could show {source!r}; open another view")

    def say(self, text: str) -> None:
        """Show a line of text (Markdown) at the top of the panel."""
        self.status.content = text

    def complain(self, text: str) -> None:
        """Show an error at the top of the panel; an empty text removes it."""
        self.problem.visible = bool(text)
        self.problem.content = f"**Error.** {text}" if text else ""

    def guarded(self, work: Callable[..., Any]) -> Callable[..., Any]:
        """Show errors of a function in the page instead of raising them."""

        @functools.wraps(work)
        def run(*arguments: Any) -> Any:
            try:
                return work(*arguments)
            except GraspboxError as error:
                self.complain(str(error))
            except Exception as error:  # a bug must not end the thread of the page
                if not self.closed.is_set():
                    _log.exception("a page failed")
                    self.complain(f"this is a bug in graspbox, please report it: {type(error).__name__}: {error}")
            return None

        return run

    def on(self, *controls: Any, call: Callable[[], object]) -> None:
        """Call a function when one of the controls changes or is pressed."""
        for control in controls:
            (control.on_click if hasattr(control, "on_click") else control.on_update)(self.under_lock(call))

    def under_lock(self, call: Callable[[], object]) -> Callable[[Any], None]:
        """Make a callback of a function: one at a time, with its errors in the page."""

        def changed(_: Any) -> None:
            with self.lock:
                if not self.closed.is_set():
                    self.complain("")
                    self.guarded(call)()

        return changed

    def background(self, work: Callable[[], object]) -> "Future[Any]":
        """Run work in the background, after earlier work; errors are shown in the page."""
        return self._worker.submit(self.guarded(work))

    def thread(self, work: Callable[[], object], name: str) -> threading.Thread:
        """Run a loop that ends with `closed` in its own thread."""
        thread = threading.Thread(target=self.guarded(work), name=f"graspbox-viewer-{name}", daemon=True)
        thread.start()
        return thread

    def close(self) -> None:
        """End the background work, without the tasks that have not begun."""
        self.closed.set()
        self._worker.shutdown(wait=True, cancel_futures=True)

    def look(self, target: ArrayLike, distance: float, direction: Sequence[float] = (0.75, -1.0, 0.6)) -> None:
        """Place the camera of all present and later browsers; metres."""
        way = np.asarray(direction, dtype=np.float64)
        at = np.asarray(target, dtype=np.float64)
        eye = at + distance * way / np.linalg.norm(way)
        first = self.server.initial_camera
        first.near = 0.005
        for camera in (first, *(client.camera for client in self.server.get_clients().values())):
            camera.position = tuple(float(x) for x in eye)
            camera.look_at = tuple(float(x) for x in at)

    def table(self, height: float = 0.0) -> None:
        """Draw the table as a grid at a height, metres: a mesh, which software renderers draw faster than viser's."""
        half, count = _TABLE / 2, round(_TABLE / _CELL) + 1
        at = np.linspace(-half, half, count)
        zero, low, high = np.zeros(count), np.full(count, -half), np.full(count, half)
        along = np.stack([np.stack([at, low, zero], axis=1), np.stack([at, high, zero], axis=1)], axis=1)
        lines = np.concatenate([along, along[..., [1, 0, 2]]])
        self.scene.add_mesh_simple(
            "/table", *strips(lines, _LINE), color=_GREY, side="double", position=(0.0, 0.0, height), cast_shadow=False
        )

    def mesh(
        self,
        name: str,
        mesh: Mesh | Triangles,
        pose: Floats | None = None,
        *,
        color: Color = OBJECT,
        opacity: float | None = None,
    ) -> Any:
        """Draw a mesh at a pose (4, 4); returns its node."""
        shape = mesh if isinstance(mesh, tuple) else (mesh.vertices, mesh.faces)
        wxyz, position = split(np.eye(4) if pose is None else pose)
        style = {
            "color": color,
            "opacity": opacity,
            "flat_shading": True,
            "side": "front" if shape is mesh else "double",
        }
        return self.scene.add_mesh_simple(name, *shape, **style, wxyz=wxyz, position=position)

    def spheres(self, name: str, radius: float, points: Floats, colors: Any, **options: Any) -> Any:
        """Draw spheres at points (n, 3) in one node, which replaces one with its name in one message."""
        turns = np.tile(np.array([1.0, 0.0, 0.0, 0.0], dtype=np.float32), (len(points), 1))
        shape, places = sphere(radius), points.astype(np.float32)
        return self.scene.add_batched_meshes_simple(
            name,
            *shape,
            batched_wxyzs=turns,
            batched_positions=places,
            batched_colors=np.ascontiguousarray(colors),
            lod="off",
            **options,
        )

    def frame(self, name: str, pose: Floats) -> Any:
        """Add an invisible frame at a pose (4, 4); nodes whose names begin with its name move with it."""
        wxyz, position = split(pose)
        return self.scene.add_frame(name, show_axes=False, wxyz=wxyz, position=position)

    def boxes(self, name: str, corners: Floats, colors: Sequence[Color]) -> Any:
        """Draw the edges of boxes with corners (n, 8, 3), as `Box.corners` orders them, in one node."""
        shade = np.repeat(np.array(colors, dtype=np.uint8), len(BOX_EDGES), axis=0)[:, None].repeat(2, axis=1)
        return self.lines(name, corners[:, BOX_EDGES].reshape(-1, 2, 3), shade)

    def walls(self, around: Surroundings) -> Any:
        """Draw the edges of walls in one node; None without walls."""
        walls = zip(around.world_from_walls, around.wall_half_extents, strict=True)
        corners = [Box(pose[:3, 3], pose[:3, :3], half).corners() for pose, half in walls]
        return self.boxes("/walls", np.stack(corners), [EDGES] * len(corners)) if corners else None

    def lines(self, name: str, segments: Floats, color: Any, width: float = 2.0) -> Any:
        """Draw segments (n, 2, 3), metres, in one colour or in (n, 2, 3)."""
        return self.scene.add_line_segments(name, segments, color, thickness=width, thickness_units="screen")

    def move(self, node: Any, pose: Floats) -> None:
        """Move a node to a pose (4, 4)."""
        node.wxyz, node.position = split(pose)
