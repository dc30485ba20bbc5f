"""Writes motions and grasps of images into a recording of rerun: entities, timelines, columns."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from graspbox._common import colors
from graspbox._common.colors import rgb
from graspbox._common.files import replacing
from graspbox._common.imports import imported
from graspbox._common.rotations import quaternion_from_rotation
from graspbox._core import Hand
from graspbox.errors import ConfigError
from graspbox.meshes.shapes import Floats, boxes, place
from graspbox.policies.grasp_image import ImageGrasps
from graspbox.tools.hand_links import link_boxes, moving_frames
from graspbox.tools.rerun.motions import RecordedMotion

#: Pause between two episodes on the timeline, seconds.
_PAUSE = 0.5
#: Length of an arrow, metres per newton.
_PER_NEWTON = 0.005
_OBJECT, _OTHER, _WALL = map(rgb, (colors.OBJECT, colors.OBJECTS[1], colors.WALL))
_HAND, _LINK = (120, 130, 145), rgb(colors.COLORS[0])
_CONTACT, _NET = map(rgb, (colors.FAILURE, colors.SUCCESS))
#: Grasps of an image that are shown as hands.
_HANDS = 5


def sdk() -> Any:
    """Import the SDK.

    Raises
    ------
    MissingExtraError
        Without rerun-sdk (extra ``rerun``).
    """
    return imported("rerun", "recordings need rerun-sdk, from the extra 'rerun'", "rerun")


def check_file(path: Path) -> Path:
    """Check the name of a recording, and that the SDK is there.

    Raises
    ------
    ConfigError
        If the name does not end in ``.rrd``.
    MissingExtraError
        Without rerun-sdk (extra ``rerun``).
    """
    if path.suffix != ".rrd":
        raise ConfigError(f"{str(path)!r} has the extension {path.suffix!r}; name a file that ends in .rrd")
    sdk()
    return path


@contextmanager
def recording(path: Path, root: str = "") -> Iterator["RecordingWriter"]:
    """Open a recording in a file, which replaces `path` when the block ends without an error.

    `root` is the path above all entities.

    Raises
    ------
    ConfigError, MissingExtraError
        As `check_file`.
    FileError
        If the file cannot be written.
    """
    rr = sdk()
    with replacing(check_file(path)) as temporary:
        stream = rr.RecordingStream("graspbox")
        stream.save(str(temporary), default_blueprint=_blueprint(root.strip("/")))
        try:
            yield RecordingWriter(stream, root)
        finally:
            stream.flush()
            stream.disconnect()


def _blueprint(root: str) -> Any:
    """Arrange the viewer: the scene, images and log on the left, curves on the right."""
    import rerun.blueprint as views

    base = f"/{root}" if root else ""
    curves = {
        "forces": ("hand_force", "net_force", "tactile_sum"),
        "tendons": ("tension/**",),
        "object": ("lift", "distance", "lift_of_others/**"),
        "probability": ("probability", "success", "secure", "choice"),
    }
    plots = [
        views.TimeSeriesView(name=name, origin=f"{base}/plots", contents=[f"$origin/{one}" for one in chosen])
        for name, chosen in curves.items()
    ]
    below = views.Tabs(
        views.TextLogView(name="log", origin=f"{base}/log"),
        views.Spatial2DView(name="colour", origin=f"{base}/world/cameras/rgb"),
        views.Spatial2DView(name="depth", origin=f"{base}/world/cameras/depth"),
    )
    scene = views.Spatial3DView(name="scene", origin=f"{base}/world")
    left = views.Vertical(scene, below, row_shares=[3, 1])
    return views.Blueprint(views.Horizontal(left, views.Vertical(*plots), column_shares=[3, 2]), collapse_panels=True)


class RecordingWriter:
    """Logs into a `rerun.RecordingStream` below the path `root`; motions follow one another on the timeline."""

    def __init__(self, stream: Any, root: str = "") -> None:
        self._rr, self._stream, self._root = sdk(), stream, root.strip("/")
        self._start, self._episode = 0.0, 0
        self._hand: Hand | None = None
        self._others, self._walls, self._hands = 0, False, 0
        self._log("world", self._rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
        table = self._rr.Boxes3D(
            centers=[[0, 0, -0.006]], half_sizes=[[0.3, 0.3, 0.006]], colors=[rgb(colors.TABLE)], fill_mode="solid"
        )
        self._log("world/table", table, static=True)

    def _path(self, name: str) -> str:
        return f"{self._root}/{name}" if self._root else name

    def _log(self, name: str, *things: Any, static: bool = False) -> None:
        self._stream.log(self._path(name), *things, static=static)

    def _columns(self, name: str, time: Floats, columns: Any) -> None:
        indexes = [
            self._rr.TimeColumn("time", duration=self._start + time),
            self._rr.TimeColumn("episode", sequence=np.full(len(time), self._episode)),
        ]
        self._stream.send_columns(self._path(name), indexes=indexes, columns=columns)

    def _at(self, time: float) -> None:
        self._stream.set_time("time", duration=self._start + time)
        self._stream.set_time("episode", sequence=self._episode)

    def motion(self, motion: RecordedMotion) -> None:
        """Log a motion after the earlier ones."""
        self._at(0.0)
        self._hand_meshes(motion.hand)
        self._log("world/object", _mesh(self._rr, motion.mesh.vertices, motion.mesh.faces, _OBJECT))
        self._transforms("world/object", motion.time, motion.world_from_object)
        self._surroundings(motion)
        self._transforms("world/hand", motion.time, motion.world_from_hand)
        frames = np.array([moving_frames(motion.hand, joints) for joints in motion.joints])
        for row, link in enumerate(link_boxes(motion.hand)):
            if row:
                self._transforms(f"world/hand/{link.name}", motion.time, frames[:, row])
        for name, values in motion.scalars.items():
            self._columns(f"plots/{name}", motion.time, self._rr.Scalars.columns(scalars=values))
        self._forces(motion)
        if motion.probability is not None:
            self._log("plots/probability", self._rr.Scalars(motion.probability))
        self._shots(motion)
        self._at(0.0)
        self._log("log", self._rr.TextLog(f"{motion.name}: {motion.outcome}"))
        self._start += float(motion.time[-1]) + _PAUSE
        self._episode += 1

    def _surroundings(self, motion: RecordedMotion) -> None:
        """Log the other objects with their motions, and the walls; those of an earlier motion disappear."""
        for index, mesh in enumerate(motion.others):
            self._log(f"world/others/{index}", _mesh(self._rr, mesh.vertices, mesh.faces, _OTHER))
            self._transforms(f"world/others/{index}", motion.time, motion.world_from_others[:, index])
        for index in range(len(motion.others), self._others):
            self._log(f"world/others/{index}", self._rr.Clear(recursive=True))
        walls = len(motion.world_from_walls) > 0
        if walls:
            turns = quaternion_from_rotation(motion.world_from_walls[:, :3, :3])
            boxes = self._rr.Boxes3D(
                centers=motion.world_from_walls[:, :3, 3],
                half_sizes=motion.wall_half_extents,
                quaternions=np.roll(turns, -1, axis=1),  # rerun has w last
                colors=[_WALL],
            )
            self._log("world/walls", boxes)
        elif self._walls:
            self._log("world/walls", self._rr.Clear(recursive=True))
        self._others, self._walls = len(motion.others), walls

    def _hand_meshes(self, hand: Hand) -> None:
        """Log the meshes of the hand's links, once for each hand."""
        if self._hand is not None and self._hand == hand:
            return
        if self._hand is not None:
            self._log("world/hand", self._rr.Clear(recursive=True))
        for link in link_boxes(hand):
            if len(link.frames):
                shape, color = boxes(link.frames, link.half_extents), _HAND if link.name == "palm" else _LINK
                self._log(f"world/hand/{link.name}", _mesh(self._rr, *shape, color))
        self._hand = hand

    def _transforms(self, name: str, time: Floats, poses: Floats) -> None:
        columns = self._rr.Transform3D.columns(translation=poses[:, :3, 3], mat3x3=poses[:, :3, :3])
        self._columns(name, time, columns)

    def _forces(self, motion: RecordedMotion) -> None:
        """Log the forces of the hand on the object, and the sum of all forces from its motion, as arrows."""
        vectors = _PER_NEWTON * motion.contact_forces
        columns = self._rr.Arrows3D.columns(origins=motion.contact_points, vectors=vectors)
        counts = np.bincount(motion.contact_samples, minlength=len(motion.time))
        self._columns("world/contacts", motion.time, columns.partition(counts))
        self._log("world/contacts", self._rr.Arrows3D.from_fields(colors=[_CONTACT], radii=[0.0012]))
        points, net = motion.contact_force(motion.mesh.center_of_mass)
        arrows = self._rr.Arrows3D.columns(origins=points, vectors=_PER_NEWTON * net)
        self._columns("world/net_force", motion.time, arrows)
        self._log("world/net_force", self._rr.Arrows3D.from_fields(colors=[_NET], radii=[0.002]))
        sizes = self._rr.Scalars.columns(scalars=np.linalg.norm(net, axis=1))
        self._columns("plots/net_force", motion.time, sizes)

    def _shots(self, motion: RecordedMotion) -> None:
        for shot in motion.shots:
            self._at(shot.time)
            self._camera(f"world/cameras/{shot.name}", shot.image, shot.intrinsics, shot.world_from_camera)

    def _camera(self, name: str, image: NDArray[Any], intrinsics: Floats, world_from_camera: Floats) -> None:
        height, width = image.shape[:2]
        rr = self._rr
        pose = rr.Transform3D(translation=world_from_camera[:3, 3], mat3x3=world_from_camera[:3, :3])
        pinhole = rr.Pinhole(
            image_from_camera=intrinsics, resolution=[width, height], camera_xyz=rr.ViewCoordinates.RDF
        )
        self._log(name, pose, pinhole)
        if image.ndim == 3 and image.shape[2] == 3:
            self._log(f"{name}/image", rr.Image(np.ascontiguousarray(image)).compress(jpeg_quality=85))
        elif image.dtype == np.uint8:
            self._log(f"{name}/image", rr.SegmentationImage(image.reshape(height, width)))
        else:
            millimetres = np.clip(np.rint(1000.0 * image.reshape(height, width)), 0, 65535).astype(np.uint16)
            self._log(f"{name}/image", rr.DepthImage(millimetres, meter=1000.0))

    def image_grasps(self, grasps: ImageGrasps, time: float = 0.0) -> None:
        """Log a depth image with its detected grasps: hands, completed shape, probabilities; `time` in seconds."""
        self._at(time)
        self._camera("world/camera", grasps.depth[..., None], grasps.intrinsics, grasps.table_from_camera)
        self._log("world/camera/object", self._rr.SegmentationImage(grasps.object.astype(np.uint8)))
        size = grasps.policy.crop.side / grasps.occupancy.shape[0]
        points = place((np.argwhere(grasps.occupancy > 127) + 0.5) * size, grasps.table_from_crop)
        self._log("world/completion", self._rr.Points3D(points, radii=size / 2, colors=[_OBJECT]))
        for rank in range(len(grasps)):
            self._stream.set_time("rank", sequence=rank + 1)
            for name in ("success", "secure", "choice"):
                self._log(f"plots/{name}", self._rr.Scalars(float(getattr(grasps, name)[rank])))
        self._stream.disable_timeline("rank")
        for rank in range(min(len(grasps), _HANDS)):
            pose = grasps.table_from_hand[rank]
            shapes, half_extents, _, _ = grasps.hand.shapes(grasps.hand.open(float(grasps.preshape[rank])))
            mesh = _mesh(self._rr, *boxes(shapes, half_extents), _HAND)
            placed = self._rr.Transform3D(translation=pose[:3, 3], mat3x3=pose[:3, :3])
            self._log(f"world/grasps/{rank + 1}", mesh, placed)
        for rank in range(len(grasps), self._hands):  # those of the image before
            self._log(f"world/grasps/{rank + 1}", self._rr.Clear(recursive=True))
        self._hands = min(len(grasps), _HANDS)
        self._log("log", self._rr.TextLog(f"{len(grasps)} grasps by {grasps.policy.name}"))
        self._episode += 1


def _mesh(rr: Any, vertices: Floats, faces: NDArray[np.uint32], color: tuple[int, int, int]) -> Any:
    """Make a mesh with flat shading: each face has its own corners."""
    corners = vertices[faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
    count = corners.size // 3
    return rr.Mesh3D(
        vertex_positions=corners.reshape(-1, 3).astype(np.float32),
        triangle_indices=np.arange(count, dtype=np.uint32).reshape(-1, 3),
        vertex_normals=np.repeat(normals, 3, axis=0).astype(np.float32),
        vertex_colors=np.tile(np.array(color, dtype=np.uint8), (count, 1)),
    )


def record_all(recorder: RecordingWriter, things: Sequence[RecordedMotion | ImageGrasps]) -> None:
    """Log motions and grasps of images in turn."""
    for thing in things:
        if isinstance(thing, RecordedMotion):
            recorder.motion(thing)
        else:
            recorder.image_grasps(thing)
