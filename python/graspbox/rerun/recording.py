"""Writes motions and grasps of images into a recording of rerun: entities, timelines, columns."""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from graspbox._common.extras import imported
from graspbox._common.files import replacing
from graspbox._common.rotations import quaternion_from_rotation
from graspbox._core import Hand, Mesh
from graspbox.errors import ConfigError
from graspbox.policies.grasp_image import ImageGrasps
from graspbox.rerun.links import boxes_mesh, links
from graspbox.rerun.motions import Motion
from graspbox.rerun.sensed import hand_links

__all__ = ["Recorder", "check_file", "record_all", "recording", "sdk"]

Floats = NDArray[np.float64]
#: Pause between two episodes on the timeline, seconds.
_PAUSE = 0.5
#: Length of an arrow, metres per newton.
_PER_NEWTON = 0.005
_OBJECT, _HAND, _PAD = (216, 183, 140), (120, 130, 145), (0, 114, 178)
_OTHER, _WALL = (143, 179, 217), (185, 188, 194)
_CONTACT, _NET = (213, 94, 0), (0, 158, 115)
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
def recording(path: Path, root: str = "") -> Iterator["Recorder"]:
    """Open a recording in a file, which replaces `path` when the block ends without an error.

    Parameters
    ----------
    path : Path
        The file, ``.rrd``.
    root : str
        Path above all entities.

    Raises
    ------
    ConfigError
        If the name does not end in ``.rrd``.
    FileError
        If the file cannot be written.
    MissingExtraError
        Without rerun-sdk.
    """
    rr = sdk()
    with replacing(check_file(path)) as temporary:
        stream = rr.RecordingStream("graspbox")
        stream.save(str(temporary), default_blueprint=_blueprint(root.strip("/")))
        try:
            yield Recorder(stream, root)
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


class Recorder:
    """Logs into a recording stream; motions follow one another on the timeline ``time``.

    Parameters
    ----------
    stream : rerun.RecordingStream
        The stream.
    root : str
        Path above all entities.
    """

    def __init__(self, stream: Any, root: str = "") -> None:
        self._rr, self._stream, self._root = sdk(), stream, root.strip("/")
        self._start, self._episode = 0.0, 0
        self._hand: Hand | None = None
        self._others, self._walls = 0, False
        self._log("world", self._rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
        table = self._rr.Boxes3D(
            centers=[[0, 0, -0.006]], half_sizes=[[0.3, 0.3, 0.006]], colors=[(226, 218, 203)], fill_mode="solid"
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

    def motion(self, motion: Motion) -> None:
        """Log a motion after the earlier ones."""
        self._at(0.0)
        self._hand_meshes(motion.hand)
        self._log("world/object", _mesh(self._rr, motion.mesh))
        self._transforms("world/object", motion.time, motion.world_from_object)
        self._surroundings(motion)
        self._transforms("world/hand", motion.time, motion.world_from_hand)
        frames = np.array([hand_links(motion.hand, joints) for joints in motion.joints])
        for row, link in enumerate(links(motion.hand)):
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

    def _surroundings(self, motion: Motion) -> None:
        """Log the other objects with their motions, and the walls; those of an earlier motion disappear."""
        for index, mesh in enumerate(motion.others):
            self._log(f"world/others/{index}", _mesh(self._rr, mesh, _OTHER))
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
        for link in links(hand):
            if link.boxes:
                vertices, faces, normals = boxes_mesh(link.boxes)
                color = _HAND if link.name == "palm" else _PAD
                colors = np.tile(np.array(color, dtype=np.uint8), (len(vertices), 1))
                mesh = self._rr.Mesh3D(
                    vertex_positions=vertices, triangle_indices=faces, vertex_normals=normals, vertex_colors=colors
                )
                self._log(f"world/hand/{link.name}", mesh)
        self._hand = hand

    def _transforms(self, name: str, time: Floats, poses: Floats) -> None:
        columns = self._rr.Transform3D.columns(translation=poses[:, :3, 3], mat3x3=poses[:, :3, :3])
        self._columns(name, time, columns)

    def _forces(self, motion: Motion) -> None:
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

    def _shots(self, motion: Motion) -> None:
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

    def image_grasps(self, found: ImageGrasps) -> None:
        """Log a depth image with the grasps that a policy found in it: hands, completed shape, probabilities."""
        self._at(0.0)
        self._camera("world/camera", found.depth[..., None], found.intrinsics, found.table_from_camera)
        self._log("world/camera/object", self._rr.SegmentationImage(found.object.astype(np.uint8)))
        cells = np.argwhere(found.occupancy > 127)
        size = found.policy.crop.side / found.occupancy.shape[0]
        middles = (cells + 0.5) * size
        points = middles @ found.table_from_crop[:3, :3].T + found.table_from_crop[:3, 3]
        self._log("world/completion", self._rr.Points3D(points, radii=size / 2, colors=[_OBJECT]))
        hand = found.hand
        for rank in range(len(found)):
            self._stream.set_time("rank", sequence=rank + 1)
            for name, values in _probabilities(found).items():
                self._log(f"plots/{name}", self._rr.Scalars(float(values[rank])))
        self._stream.disable_timeline("rank")
        for rank in range(min(len(found), _HANDS)):
            self._open_hand(f"world/grasps/{rank + 1}", hand, found.table_from_hand[rank], float(found.preshape[rank]))
        self._log("log", self._rr.TextLog(f"{len(found)} grasps by {found.policy.name}"))
        self._episode += 1

    def _open_hand(self, name: str, hand: Hand, pose: Floats, preshape: float) -> None:
        """Log an open hand at a pose, as one mesh."""
        frames = hand_links(hand, hand.open(preshape))
        boxes = [
            (frame @ box, half) for frame, link in zip(frames, links(hand), strict=True) for box, half in link.boxes
        ]
        vertices, faces, normals = boxes_mesh(tuple(boxes))
        colors = np.tile(np.array(_HAND, dtype=np.uint8), (len(vertices), 1))
        mesh = self._rr.Mesh3D(
            vertex_positions=vertices, triangle_indices=faces, vertex_normals=normals, vertex_colors=colors
        )
        self._log(name, mesh, self._rr.Transform3D(translation=pose[:3, 3], mat3x3=pose[:3, :3]))


def _probabilities(found: ImageGrasps) -> Mapping[str, Floats]:
    return {"success": found.success, "secure": found.secure, "choice": found.choice}


def _mesh(rr: Any, mesh: Mesh, color: tuple[int, int, int] = _OBJECT) -> Any:
    """Convert a mesh with flat shading: each face has its own corners."""
    corners = mesh.vertices[mesh.faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
    vertices = corners.reshape(-1, 3)
    return rr.Mesh3D(
        vertex_positions=vertices.astype(np.float32),
        triangle_indices=np.arange(len(vertices), dtype=np.uint32).reshape(-1, 3),
        vertex_normals=np.repeat(normals, 3, axis=0).astype(np.float32),
        vertex_colors=np.tile(np.array(color, dtype=np.uint8), (len(vertices), 1)),
    )


def record_all(recorder: Recorder, things: Sequence[Motion | ImageGrasps]) -> None:
    """Log motions and grasps of images in turn."""
    for thing in things:
        if isinstance(thing, Motion):
            recorder.motion(thing)
        else:
            recorder.image_grasps(thing)
