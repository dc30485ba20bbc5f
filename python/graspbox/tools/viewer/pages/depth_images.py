"""A depth image: its points, the crop, the completed object, the best grasp as a hand, all candidates as points."""

from typing import ClassVar

import numpy as np

from graspbox.errors import ConfigError
from graspbox.meshes.shapes import Floats, place, voxels
from graspbox.perception.crops import OCCUPIED
from graspbox.perception.depth_images import check_intrinsics, fit_table, points_of, read_pose, thinned
from graspbox.policies.grasp_image import ImageGrasper, ImageGrasps
from graspbox.tools.viewer.drawn_hand import DrawnHand
from graspbox.tools.viewer.geometry import SUCCESS, depth_picture, legend, ramp
from graspbox.tools.viewer.grasp_points import GraspPoints
from graspbox.tools.viewer.page import Page

#: Greatest number of candidates; grasps similar to a better one are left out.
_COUNT = 40
#: Points farther from the crop's middle are left out, metres.
_FAR = 1.0
_CROP = (120, 120, 120)
_POINT, _OPACITY = 0.0016, 0.7


class DepthImagePage(Page):
    """Page of a depth image; `content` is the image (H, W) in metres, or the `ImageGrasps` of a policy in one."""

    title: ClassVar[str] = "depth image"

    def build(self) -> None:
        """Draw the points; grasps of the policy follow in the background."""
        self.grasps: ImageGrasps | None = self.content if isinstance(self.content, ImageGrasps) else None
        gui = self.canvas.gui
        depth, lens, pose = self._image()
        with gui.add_folder("Image", expand_by_default=False):
            gui.add_image(depth_picture(depth), label="depth")
        self._points(depth, lens, pose)
        self.canvas.table()
        if self.grasps is not None:
            self._show_grasps()
        elif self.options.policy is not None:
            self.canvas.say("the policy is running ...")
            self.canvas.background(self.find)
        else:
            self.canvas.say(f"{depth.shape[1]} x {depth.shape[0]} pixels; name a policy (--policy) to see its grasps")

    def _image(self) -> tuple[Floats, Floats, Floats]:
        """Return depth, intrinsics and the camera's pose over the table."""
        if self.grasps is not None:
            return self.grasps.depth, self.grasps.intrinsics, self.grasps.table_from_camera
        options, depth = self.options, self.content
        if options.intrinsics is None:
            raise ConfigError("intrinsics is missing; pass (fx, fy, cx, cy), pixels (--intrinsics FX FY CX CY)")
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
        self.grasps = grasper.find(self.content, self._lens, self._pose, count=_COUNT, seed=options.seed)
        with self.canvas.lock, self.canvas.server.atomic():
            self._points(self.grasps.depth, self.grasps.intrinsics, self.grasps.table_from_camera)
            self._show_grasps()

    def _show_grasps(self) -> None:
        grasps = self.grasps
        assert grasps is not None
        self._show_object(grasps)
        hand = grasps.hand
        self.poses = GraspPoints(self.canvas, "/grasps", grasps.table_from_hand, self.select)
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
            low, middle, high = (tuple(color) for color in ramp((0.0, 0.5, 1.0)).tolist())
            gui.add_html(legend([(low, "0"), (middle, "0.5, or the middle choice"), (high, "1, or the best choice")]))
            self.rank = gui.add_number("grasp", 1, min=1, max=max(len(grasps), 1), step=1)
            self.reading = gui.add_markdown("")
        self.canvas.on(self.show_points, self.show_crop, self.show_completion, call=self._toggle)
        self.canvas.on(self.least, self.color, call=self.refresh)
        self.canvas.on(self.rank, call=lambda: self.select(int(self.rank.value) - 1))
        self.refresh()
        if len(grasps):
            self.select(0)
        down = np.degrees(np.arcsin(-grasps.table_from_camera[2, 2]))
        self.canvas.say(
            f"policy **{grasps.policy.name}**, hand {grasps.hand.name}  \n{len(grasps)} grasps  \n"
            f"camera {grasps.table_from_camera[2, 3]:.3f} m above the table, tilted down by {down:.1f} degrees"
        )

    def _show_object(self, grasps: ImageGrasps) -> None:
        """Draw the crop, the completed object, and the object's pixels in their colour."""
        crop, pose = grasps.policy.crop, grasps.table_from_crop
        count = grasps.occupancy.shape[0]
        size, origin = count * crop.voxel_size, np.array(crop.origin)
        corners = origin + size * np.array(list(np.ndindex(2, 2, 2)))
        self.crop = self.canvas.frame("/crop", pose)
        self.edges = self.canvas.boxes("/crop/edges", corners[None], [_CROP])
        filled = grasps.occupancy >= OCCUPIED
        self.completion = None
        if filled.any():
            surface = voxels(filled, origin, crop.voxel_size)
            self.completion = self.canvas.mesh("/crop/object", surface, opacity=0.55)
        on_object = grasps.object.ravel()[self._pixels]
        colors = np.where(on_object[:, None], SUCCESS, (170, 170, 170)).astype(np.uint8)
        self.cloud.colors = colors

    def _toggle(self) -> None:
        self.cloud.visible, self.edges.visible = self.show_points.value, self.show_crop.value
        if self.completion is not None:
            self.completion.visible = self.show_completion.value

    def refresh(self) -> None:
        """Show the grasps that the filter keeps, coloured by score: blue low, orange high."""
        grasps = self.grasps
        assert grasps is not None
        values = getattr(grasps, self.color.value)
        if self.color.value == "choice" and len(values):
            values = (values - values.min()) / max(float(np.ptp(values)), 1e-9)
        self.poses.show(grasps.success >= self.least.value, ramp(values))

    def select(self, index: int) -> None:
        """Show the open hand at a grasp."""
        grasps = self.grasps
        if grasps is None or not 0 <= index < len(grasps):
            raise ConfigError(f"the grasp {index + 1} does not exist; there are {0 if grasps is None else len(grasps)}")
        self.rank.value = index + 1
        self.hand.visible = True
        self.hand.pose(grasps.table_from_hand[index], self.hand.hand.open(float(grasps.preshape[index])))
        self.reading.content = (
            f"success {grasps.success[index]:.0%}, secure {grasps.secure[index]:.0%}, "
            f"choice {grasps.choice[index]:.3f}, preshape {grasps.preshape[index]:.2f}"
        )
