"""A depth image: its points, the crop, the completed object, the best grasp as a hand, all candidates as points."""

from typing import Any, ClassVar

import numpy as np

from graspbox.captures import Capture
from graspbox.captures.capture import listed
from graspbox.errors import ConfigError
from graspbox.meshes.shapes import Floats, place, voxels
from graspbox.perception.crops import OCCUPIED
from graspbox.perception.depth_images import fit_table, points_of, thinned
from graspbox.policies.grasp_image import ImageGrasper, ImageGrasps, SceneGrasps
from graspbox.tools.viewer.drawn_hand import DrawnHand
from graspbox.tools.viewer.geometry import OTHER, SUCCESS, depth_picture, legend, ramp
from graspbox.tools.viewer.grasp_points import GraspPoints
from graspbox.tools.viewer.page import Page

#: Greatest number of candidates per thing; grasps similar to a better one are left out.
_COUNT = 40
#: Points farther from the crop's middle are left out, metres.
_FAR = 1.0
_CROP = (120, 120, 120)
_POINT, _OPACITY = 0.0016, 0.7
#: The choice of all things.
_ALL = "all"


class DepthImagePage(Page):
    """Page of a depth image; `content` is a `Capture`, or the `ImageGrasps` or `SceneGrasps` of a policy in one."""

    title: ClassVar[str] = "depth image"

    def build(self) -> None:
        """Draw the points; grasps of the policy follow in the background."""
        #: The grasps of all things, those of the thing of the shown grasp, and thing and rank of each point.
        self.scene: SceneGrasps | None = None
        self.grasps: ImageGrasps | None = None
        self.rows: list[tuple[int, int]] = []
        self._parts: list[Any] = []
        self.hand: DrawnHand | None = None
        self.completion: Any = None
        gui = self.canvas.gui
        depth, lens, pose = self._image()
        with gui.add_folder("Image", expand_by_default=False):
            gui.add_image(depth_picture(depth), label="depth")
        self._points(depth, lens, pose)
        self.canvas.table()
        if self.scene is not None:
            self._show_grasps()
        elif self.options.policy is not None:
            self.canvas.say("the policy is running ...")
            self.canvas.background(self.find)
        else:
            said = f"{depth.shape[1]} x {depth.shape[0]} pixels; name a policy (--policy) to see its grasps"
            self.canvas.say(said + self._warnings())

    def _image(self) -> tuple[Floats, Floats, Floats]:
        """Return depth, intrinsics and the camera's pose over the table."""
        content = self.content
        if not isinstance(content, Capture):
            self.scene = _scene_of(content) if isinstance(content, ImageGrasps) else content
            first = _first(self.scene)
            return first.depth, first.intrinsics, first.table_from_camera
        focus = None if content.labels is None else content.labels > 0
        pose = content.table_from_camera
        if pose is None:
            around = content.depth if focus is None else np.where(focus, 0.0, content.depth)
            pose = fit_table(around, content.intrinsics, focus)
        small, lens, _ = thinned(content.depth, content.intrinsics)
        return small, lens, pose

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

    def find(self, every: bool = False) -> None:
        """Let the policy find grasps of the object, or of every thing; runs in the background."""
        options, seen = self.options, self.content
        assert options.policy is not None
        grasper = ImageGrasper(options.policy, hand=options.hand)
        place = (seen.depth, seen.intrinsics, seen.table_from_camera)
        if every or seen.labels is not None:
            scene = grasper.find_all(*place, labels=seen.labels, count=_COUNT, seed=options.seed)
        else:
            scene = _scene_of(grasper.find(*place, count=_COUNT, seed=options.seed))
        first = _first(scene)
        with self.canvas.lock, self.canvas.server.atomic():
            self.scene, self.grasps = scene, None
            self._points(first.depth, first.intrinsics, first.table_from_camera)
            self._show_grasps()

    def _find_all(self) -> None:
        self.everything.disabled = True
        self.canvas.say("the policy is running ...")
        self.canvas.background(self._every)

    def _every(self) -> None:
        try:
            self.find(every=True)
        finally:
            self.everything.disabled = False

    def _show_grasps(self) -> None:
        scene = self.scene
        assert scene is not None
        for part in self._parts:
            part.remove()
        self.rows = [(thing, rank) for thing, one in scene.grasps.items() for rank in range(len(one))]
        poses = np.concatenate([one.table_from_hand for one in scene.grasps.values()])
        self.poses = GraspPoints(self.canvas, "/grasps", poses, self.select)
        self.hand = self.hand or DrawnHand(self.canvas, "/hand", _first(scene).hand, _OPACITY)
        self.hand.visible = False
        self._parts = [self.poses, *self._controls(scene)]
        self.canvas.on(self.show_points, self.show_crop, self.show_completion, call=self._toggle)
        self.canvas.on(self.least, self.color, call=self.refresh)
        self.canvas.on(self.thing, call=self._filter)
        self.canvas.on(self.rank, call=self._select_ranked)
        self.canvas.on(self.everything, call=self._find_all)
        self._show_object(_first(scene))
        self._filter()
        self.canvas.say(self._summary(scene))

    def _controls(self, scene: SceneGrasps) -> list[Any]:
        """Add the controls; returns their folders."""
        gui, several = self.canvas.gui, len(scene.grasps) > 1
        names = tuple(str(thing) for thing in scene.grasps)
        folders = [gui.add_folder("Show"), gui.add_folder("Grasps")]
        with folders[0]:
            self.show_points = gui.add_checkbox("points", True)
            self.show_crop = gui.add_checkbox("crop", True)
            self.show_completion = gui.add_checkbox("completed object", True)
        with folders[1]:
            searched = isinstance(self.content, Capture) and self.content.labels is None
            self.everything = gui.add_button("all things", visible=searched and not several)
            options = (_ALL, *names) if several else names
            self.thing = gui.add_dropdown("thing", options, initial_value=options[0], visible=several)
            self.least = gui.add_slider("least success", 0.0, 1.0, 0.01, 0.0)
            self.color = gui.add_dropdown("colour", ("success", "secure", "choice"), initial_value="success")
            low, middle, high = (tuple(color) for color in ramp((0.0, 0.5, 1.0)).tolist())
            gui.add_html(legend([(low, "0"), (middle, "0.5, or the middle choice"), (high, "1, or the best choice")]))
            self.rank = gui.add_number("grasp", 1, min=1, max=max(len(self.rows), 1), step=1)
            self.reading = gui.add_markdown("")
        return folders

    def _summary(self, scene: SceneGrasps) -> str:
        """Return policy, hand and camera; of several things also those without a grasp."""
        first, several = _first(scene), f" of {len(scene.grasps)} things" if len(scene.grasps) > 1 else ""
        down = np.degrees(np.arcsin(-first.table_from_camera[2, 2]))
        refused = "".join(f"  \nthing {thing}: {why}" for thing, why in scene.refused.items())
        return (
            f"policy **{first.policy.name}**, hand {first.hand.name}  \n{len(self.rows)} grasps{several}  \n"
            f"camera {first.table_from_camera[2, 3]:.3f} m above the table, tilted down by {down:.1f} degrees"
            f"{refused}{self._warnings()}"
        )

    def _warnings(self) -> str:
        """Return what was assumed of the image, and what may be wrong with it, as lines."""
        found = self.content.warnings if isinstance(self.content, Capture) else ()
        each = () if self.scene is None else (one.warnings for one in self.scene.grasps.values())
        every = dict.fromkeys((*found, *(warning for one in each for warning in one)))
        return "".join(f"  \nwarning: {warning}" for warning in every)

    def _show_object(self, grasps: ImageGrasps) -> None:
        """Draw the crop and the completed shape of a thing, its pixels, and those of the others."""
        assert self.scene is not None
        self.grasps = grasps
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
        own, others = (image.ravel()[self._pixels, None] for image in (grasps.object, self.scene.labels > 0))
        colors = np.where(own, SUCCESS, np.where(others, OTHER, (170, 170, 170)))
        self.cloud.colors = colors.astype(np.uint8)
        self._toggle()

    def _toggle(self) -> None:
        self.cloud.visible, self.edges.visible = self.show_points.value, self.show_crop.value
        if self.completion is not None:
            self.completion.visible = self.show_completion.value

    def _order(self) -> list[int]:
        """Return the rows of the chosen things, the best first."""
        assert self.scene is not None
        if self.thing.value == _ALL:
            rows = {row: index for index, row in enumerate(self.rows)}
            return [rows[row] for row in self.scene.best()]
        return [index for index, (thing, _) in enumerate(self.rows) if str(thing) == self.thing.value]

    def _filter(self) -> None:
        """Show the grasps of the chosen things, and the hand at the best."""
        order = self._order()
        self.rank.max = max(len(order), 1)
        self.refresh()
        if order:
            self.select(order[0])

    def refresh(self) -> None:
        """Show the grasps that the filters keep, coloured by score: blue low, orange high."""
        assert self.scene is not None
        each = self.scene.grasps.values()
        values = np.concatenate([getattr(one, self.color.value) for one in each])
        if self.color.value == "choice" and len(values):
            values = (values - values.min()) / max(float(np.ptp(values)), 1e-9)
        kept = np.concatenate([one.success for one in each]) >= self.least.value
        chosen = np.isin(np.arange(len(kept)), self._order())
        self.poses.show(kept & chosen, ramp(values))

    def _select_ranked(self) -> None:
        order, rank = self._order(), int(self.rank.value)
        if not 1 <= rank <= len(order):
            raise ConfigError(f"the grasp {rank} does not exist; there are {len(order)}")
        self.select(order[rank - 1])

    def select(self, index: int) -> None:
        """Show the open hand at a grasp, by its row among all, and the thing that it grasps."""
        assert self.scene is not None
        assert self.hand is not None
        thing, rank = self.rows[index]
        grasps = self.scene.grasps[thing]
        if grasps is not self.grasps:
            self._show_object(grasps)
        self.rank.value = self._order().index(index) + 1
        self.hand.visible = True
        self.hand.pose(grasps.table_from_hand[rank], self.hand.hand.open(float(grasps.preshape[rank])))
        self.reading.content = (
            f"{f'thing {thing}, ' if len(self.scene.grasps) > 1 else ''}success {grasps.success[rank]:.0%}, secure "
            f"{grasps.secure[rank]:.0%}, choice {grasps.choice[rank]:.3f}, preshape {grasps.preshape[rank]:.2f}"
        )


def _scene_of(grasps: ImageGrasps) -> SceneGrasps:
    """Take the grasps of one thing as those of a scene."""
    return SceneGrasps(grasps.object.astype(np.int64), {1: grasps}, {})


def _first(scene: SceneGrasps) -> ImageGrasps:
    """Return the grasps of the first thing; raises ConfigError if there is none."""
    if not scene.grasps:
        reasons = listed([f"thing {thing}: {why}" for thing, why in scene.refused.items()])
        raise ConfigError(f"no thing of the image has grasps{f' ({reasons})' if reasons else ''}; pass another image")
    return next(iter(scene.grasps.values()))
