"""A depth image: its points, the crop, the object as a policy completes it, and candidate grasps by score."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from graspbox.errors import ConfigError
from graspbox.perception.depth_images import check_intrinsics, fit_table, points_of, read_pose, thinned
from graspbox.policies.grasp_image import ImageGrasper, ImageGrasps
from graspbox.viewer.drawn_hand import DrawnHand, PoseSet
from graspbox.viewer.geometry import OBJECT, SUCCESS, Floats, depth_picture, place, ramp, voxels
from graspbox.viewer.page import Page

__all__ = ["DepthImage", "DepthImagePage"]

#: Most candidates; grasps much like a better one are left out.
_COUNT = 40
#: Voxels with at least this value are shown; perception counts them as occupied.
_OCCUPIED = 64
#: Points farther from the crop's middle are left out, metres.
_FAR = 1.0
_CROP = (120, 120, 120)
_POINT, _OPACITY = 0.0016, 0.7


@dataclass(frozen=True, eq=False)
class DepthImage:
    """A depth image (H, W) in metres, or grasps that a policy found in one."""

    depth: NDArray[np.float64] | None = None
    found: ImageGrasps | None = None


class DepthImagePage(Page):
    """Page of a depth image; `content` is a `DepthImage`."""

    title: ClassVar[str] = "depth image"

    def build(self) -> None:
        """Draw the points; grasps of the policy follow in the background."""
        content: DepthImage = self.content
        self.found: ImageGrasps | None = content.found
        gui = self.canvas.gui
        depth, lens, pose = self._image()
        with gui.add_folder("Image", expand_by_default=False):
            gui.add_image(depth_picture(depth), label="depth")
        self._points(depth, lens, pose)
        self.canvas.table()
        if self.found is not None:
            self._show_grasps()
        elif self.options.policy is not None:
            self.canvas.say("the policy looks for grasps ...")
            self.canvas.background(self.find)
        else:
            self.canvas.say(f"{depth.shape[1]} x {depth.shape[0]} pixels; name a policy (--policy) to see its grasps")

    def _image(self) -> tuple[Floats, Floats, Floats]:
        """Return depth, intrinsics and the camera's pose over the table."""
        if self.found is not None:
            return self.found.depth, self.found.intrinsics, self.found.table_from_camera
        options, depth = self.options, self.content.depth
        if options.intrinsics is None:
            raise ConfigError(
                "intrinsics is missing; give (fx, fy, cx, cy) of the image, pixels (--intrinsics FX FY CX CY)"
            )
        fx, fy, cx, cy = options.intrinsics
        lens = check_intrinsics(np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]]), depth.shape)
        self._pose = fit_table(depth, lens) if options.camera_pose is None else read_pose(options.camera_pose)
        self._lens = lens
        small, thin, _ = thinned(depth, lens)
        return small, thin, self._pose

    def _points(self, depth: Floats, lens: Floats, pose: Floats) -> None:
        """Draw the visible points in the frame of the table, coloured by height."""
        seen = depth > 0
        points = place(points_of(depth, lens), pose)
        middle = np.median(points, axis=0)
        near = np.linalg.norm(points - middle, axis=1) < _FAR
        points = points[near].astype(np.float32)
        self._pixels = np.flatnonzero(seen)[near]
        self.cloud = self.canvas.scene.add_point_cloud(
            "/points", points, ramp(points[:, 2] / 0.2), point_size=_POINT, precision="float32", point_shading="flat"
        )
        camera = self.canvas.frame("/camera", pose)
        camera.show_axes, camera.axes_length, camera.axes_radius, camera.origin_radius = True, 0.05, 0.001, 0.003
        self.canvas.look(np.array([*middle[:2], 0.05]), 0.7)

    def find(self) -> None:
        """Let the policy find grasps; runs in the background."""
        options = self.options
        assert options.policy is not None
        grasper = ImageGrasper(options.policy)
        self.found = grasper.find(self.content.depth, self._lens, self._pose, count=_COUNT, seed=options.seed)
        with self.canvas.lock, self.canvas.server.atomic():
            self._points(self.found.depth, self.found.intrinsics, self.found.table_from_camera)
            self._show_grasps()

    def _show_grasps(self) -> None:
        found = self.found
        assert found is not None
        self._show_object(found)
        hand = found.hand
        self.poses = PoseSet(self.canvas, "/grasps", hand, found.table_from_hand, found.preshape, self.select)
        self.hand = DrawnHand(self.canvas, "/hand", hand, _OPACITY)
        self.hand.visible = False
        gui = self.canvas.gui
        with gui.add_folder("Show"):
            self.show_points = gui.add_checkbox("points", True)
            self.show_crop = gui.add_checkbox("crop", True)
            self.show_completion = gui.add_checkbox("completed object", True)
        with gui.add_folder("Grasps"):
            self.least = gui.add_slider("least success", 0.0, 1.0, 0.01, 0.0)
            self.color = gui.add_dropdown("colour", ("success", "secure", "choice"), initial_value="success")
            self.rank = gui.add_number("grasp", 1, min=1, max=max(len(found), 1), step=1)
            self.reading = gui.add_markdown("")
        self.canvas.on(self.show_points, self.show_crop, self.show_completion, call=self._toggle)
        self.canvas.on(self.least, self.color, call=self.refresh)
        self.canvas.on(self.rank, call=lambda: self.select(int(self.rank.value) - 1))
        self.refresh()
        if len(found):
            self.select(0)
        down = np.degrees(np.arcsin(-found.table_from_camera[2, 2]))
        self.canvas.say(
            f"policy **{found.policy.name}**, hand {found.hand.name}  \n{len(found)} grasps  \n"
            f"camera {found.table_from_camera[2, 3]:.3f} m above the table, tilted down by {down:.1f} degrees"
        )

    def _show_object(self, found: ImageGrasps) -> None:
        """Draw the crop, the completed object, and the object's pixels in their colour."""
        crop, pose = found.policy.crop, found.table_from_crop
        count = found.occupancy.shape[0]
        size, origin = count * crop.voxel_size, np.array(crop.origin)
        corners = origin + size * np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)])
        self.crop = self.canvas.frame("/crop", pose)
        self.edges = self.canvas.boxes("/crop/edges", corners[None], [_CROP])
        filled = found.occupancy >= _OCCUPIED
        self.completion = None
        if filled.any():
            self.completion = self.canvas.scene.add_mesh_simple(
                "/crop/object", *voxels(filled, origin, crop.voxel_size), color=OBJECT, opacity=0.55, flat_shading=True
            )
        on_object = found.object.ravel()[self._pixels]
        colors = np.where(on_object[:, None], SUCCESS, (170, 170, 170)).astype(np.uint8)
        self.cloud.colors = colors

    def _toggle(self) -> None:
        self.cloud.visible, self.edges.visible = self.show_points.value, self.show_crop.value
        if self.completion is not None:
            self.completion.visible = self.show_completion.value

    def refresh(self) -> None:
        """Show the grasps that the filter keeps, coloured by score: blue low, orange high."""
        found = self.found
        assert found is not None
        values = getattr(found, self.color.value)
        if self.color.value == "choice" and len(values):
            values = (values - values.min()) / max(float(np.ptp(values)), 1e-9)
        self.poses.show(found.success >= self.least.value, ramp(values))

    def select(self, index: int) -> None:
        """Show the open hand at a grasp."""
        found = self.found
        if found is None or not 0 <= index < len(found):
            raise ConfigError(f"the grasp {index + 1} does not exist; there are {0 if found is None else len(found)}")
        self.rank.value = index + 1
        self.hand.visible = True
        self.hand.pose(found.table_from_hand[index], self.hand.hand.open(float(found.preshape[index])))
        self.reading.content = (
            f"success {found.success[index]:.0%}, secure {found.secure[index]:.0%}, "
            f"choice {found.choice[index]:.3f}, preshape {found.preshape[index]:.2f}"
        )
