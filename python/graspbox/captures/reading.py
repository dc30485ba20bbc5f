"""One way in for depth data: the kind of a source by content, then the same checks of units, sizes and frames."""

import os
from collections.abc import Generator
from contextlib import closing
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from graspbox._common.arguments import floats, natural
from graspbox.captures.averaging import average, check_count
from graspbox.captures.cameras import read_camera
from graspbox.captures.capture import Camera, Capture, Found, listed
from graspbox.captures.clouds import MOST_POINTS, organised, rendered, turned
from graspbox.captures.distortion import undistorted
from graspbox.captures.files import kind_of, read_labels, read_pose, refusal
from graspbox.captures.images import read_array_file, read_exr, read_picture
from graspbox.captures.pcd import read_pcd
from graspbox.captures.ply import read_ply
from graspbox.captures.recordings import check_place, is_recording, read_recording, recorded_images
from graspbox.errors import ConfigError, FileError
from graspbox.perception.depth_images import check_intrinsics, check_pose, metric_depth
from graspbox.perception.real import DEPTH_KINDS, DepthKind, z_of_distances

__all__ = ["PathLike", "capture_of", "check_depth_kind", "check_limits", "given_camera", "read_capture", "read_found"]

PathLike = str | os.PathLike[str]

#: Coarser images of clouds are warned of: focal length, pixels.
_COARSE = 150.0
#: Given and estimated intrinsics of an organised cloud may differ by this share, and by so many pixels.
_SAME_FOCAL, _SAME_CENTER = 0.02, 4.0


def read_capture(
    source: PathLike,
    *,
    intrinsics: ArrayLike | PathLike | None = None,
    depth_scale: float | None = None,
    depth_is: DepthKind = "z",
    camera_pose: ArrayLike | PathLike | None = None,
    mask: NDArray[np.bool_] | PathLike | None = None,
    labels: NDArray[np.integer] | PathLike | None = None,
    topic: str | None = None,
    time: float | None = None,
    frame: int | None = None,
    frames: int = 1,
    limits: tuple[float, float] | None = None,
    region: tuple[int, int, int, int] | None = None,
) -> Capture:
    """Read a depth image or a cloud of a real camera as the image of an ideal pinhole camera.

    Images: ``.npy``, ``.npz`` (one array, or ``depth`` and ``K``), 16-bit PNG, TIFF, EXR (extra ``exr``). Clouds in the
    camera's frame: ``.ply``, ``.pcd``, ``.npy`` of floats (n, 3) or (H, W, 3); an organised cloud contains its
    intrinsics, another one is rendered by a virtual camera. ROS recordings (extra ``recordings``): ``.bag``, folders of
    ROS 2, ``.db3``, ``.mcap``.

    Parameters
    ----------
    source : str or PathLike
        The file or folder.
    intrinsics : (3, 3) array or path, optional
        Pixels; the centre of the first pixel is (0.5, 0.5). Files (ROS CameraInfo as YAML or JSON, OpenCV, RealSense,
        Open3D, BOP, ``.npy`` or text of 9 numbers) have it at (0, 0) and are converted. By default those of the source.
    depth_scale : float, optional
        Metres per unit; by default that of the source or of the file of intrinsics, else 1 for floats and 0.001 for
        integers.
    depth_is : {"z", "distance"}
        What an image holds: depths along the optical axis, or distances from the camera along the rays of the pixels,
        as some simulators and time-of-flight cameras write.
    camera_pose : (4, 4) array or path, optional
        ``table_from_camera``, metres.
    mask : (H, W) bool array or path, optional
        Pixels of one thing, not 0; a file with several numbers is refused.
    labels : (H, W) int array or path, optional
        Numbers of things, 0 or less for none, instead of a mask.
    topic, time, frame : str, float, int, optional
        Of a recording: the topic, by default the only one with depth; seconds since its first message, or the number
        of the message.
    frames : int
        How many images of a recording, from there on, are averaged (`graspbox.captures.average`): the scene is still.
    limits : (float, float), optional
        Nearest and farthest depth, metres; others count as not measured.
    region : (int, int, int, int), optional
        Columns and rows, left, top, right and bottom; pixels outside count as not measured.

    Raises
    ------
    FileError
        If a file does not exist or cannot be read.
    ConfigError
        If a file is broken or of another kind, there are no intrinsics, a size or unit is wrong, or an argument is.
    MissingExtraError
        If the kind needs a package that is not installed.
    """
    path = Path(source)
    check_count(natural(frames, "frames"))
    given = given_camera(intrinsics, path)
    # A reader that is left before its end keeps its recording open.
    with closing(_founds(path, topic, time, frame, frames, depth_scale)) as founds:
        return average(
            capture_of(
                found,
                given,
                depth_scale=depth_scale,
                depth_is=depth_is,
                camera_pose=camera_pose,
                mask=mask,
                labels=labels,
                limits=limits,
                region=region,
            )
            for found in founds
        )


def _founds(
    path: Path, topic: str | None, time: float | None, frame: int | None, frames: int, scale: float | None
) -> Generator[Found, None, None]:
    """Read a source, or some images of a recording one after another; arguments and errors as of `read_capture`."""
    if frames == 1:
        yield read_found(path, topic, time, frame, scale)
        return
    if not is_recording(path, "" if path.is_dir() else kind_of(path)):
        raise ConfigError(f"{path} is no recording; frames are averaged of one, or pass several files")
    check_place(time, frame)
    begun, found = None, 0
    with closing(recorded_images(path, topic, scale)) as images:
        for number, (stamp, decode) in enumerate(images):
            begun = stamp if begun is None else begun
            # Seconds since 1970 are exact to less than a microsecond.
            if number >= (frame or 0) and stamp - begun > (time or 0.0) - 1e-6:
                found += 1
                yield decode()
            if found == frames:
                return
    raise ConfigError(f"{path} has {found} images from there on, not {frames}; pass fewer frames")


def capture_of(
    found: Found,
    given: Camera | None = None,
    *,
    depth_scale: float | None = None,
    depth_is: DepthKind = "z",
    camera_pose: ArrayLike | PathLike | None = None,
    mask: NDArray[np.bool_] | PathLike | None = None,
    labels: NDArray[np.integer] | PathLike | None = None,
    limits: tuple[float, float] | None = None,
    region: tuple[int, int, int, int] | None = None,
) -> Capture:
    """Check what a reader found, and convert it; arguments and errors as of `read_capture`, with the camera `given`."""
    scale = found.scale if depth_scale is None else depth_scale
    if scale is None and given is not None:
        scale = given.depth_scale
    check_depth_kind(depth_is)
    if found.points is not None:
        if depth_is != "z":
            raise ConfigError(
                f"{found.name} is a cloud, which has no depths along rays; leave out depth_is (--depth-is)"
            )
        depth, camera = _of_cloud(found, scale, given)
    else:
        assert found.image is not None
        depth, camera = metric_depth(found.image, scale, found.name), _camera_of(found, given)
    shape = (depth.shape[0], depth.shape[1])
    _check_size(camera, found, shape)
    lens = check_intrinsics(camera.matrix, shape)
    things = _labels(mask, labels, shape)
    warnings = [*found.warnings, *camera.notes]
    if camera.coefficients:
        depth, things = _straightened(camera, depth, things, warnings)
    if depth_is == "distance":
        depth = z_of_distances(depth, lens)
    depth = _bounded(depth, limits, region, found.name)
    pose = _pose(camera_pose)
    return Capture(depth, lens, things, pose, tuple(warnings), found.name)


@np.errstate(invalid="ignore", over="ignore")  # broken files hold signalling NaN and huge numbers
def read_found(
    path: Path,
    topic: str | None = None,
    time: float | None = None,
    frame: int | None = None,
    depth_scale: float | None = None,
) -> Found:
    """Read a source by its kind; arguments and errors as of `read_capture`."""
    if not path.is_file() and not path.is_dir():
        raise FileError(2, "there is no such depth image", str(path))
    kind = "" if path.is_dir() else kind_of(path)
    if is_recording(path, kind):
        return read_recording(path, topic, time, frame, depth_scale)
    if path.is_dir():
        raise ConfigError(f"{path} is a folder without metadata.yaml; pass a depth image, a cloud or a recording")
    if topic is not None or time is not None or frame is not None:
        raise ConfigError(f"{path} is no recording; topic, time and frame choose a message of one")
    if kind in ("npy", "npz"):
        return read_array_file(path, kind)
    if kind in ("png", "tiff", "tif"):
        return read_picture(path, "png" if kind == "png" else "tiff")
    if kind == "exr":
        return read_exr(path)
    if kind == "ply":
        return Found(str(path), points=read_ply(path))
    if kind == "pcd":
        points, notes = read_pcd(path)
        return Found(str(path), points=points, warnings=notes)
    raise refusal(path, kind)


def given_camera(intrinsics: ArrayLike | PathLike | None, path: Path) -> Camera | None:
    """Return the camera of an argument, for the image `path`; errors as of `read_capture`."""
    if intrinsics is None:
        return None
    if isinstance(intrinsics, str | os.PathLike):
        return read_camera(Path(intrinsics), path.name)
    matrix = floats(intrinsics, "intrinsics")
    if matrix.shape != (3, 3) or not np.isfinite(matrix).all():
        raise ConfigError(f"intrinsics have shape {matrix.shape}; pass a finite 3x3 matrix")
    return Camera(matrix, "intrinsics")


def _camera_of(found: Found, given: Camera | None) -> Camera:
    """Return the camera of an image: the given one before that of the source; moved if the image is a part."""
    camera = given or found.camera
    if camera is None:
        raise ConfigError(
            f"{found.name} has no intrinsics; pass them: FX FY CX CY of this image (--intrinsics), or the camera's "
            "file (--camera-info)"
        )
    if found.offset != (0, 0):
        moved = camera.matrix.copy()
        moved[:2, 2] -= found.offset
        note = (
            f"the image begins at column {found.offset[0]} and row {found.offset[1]} of the full one: cx, cy are moved"
        )
        camera = Camera(moved, camera.name, camera.size, camera.model, camera.coefficients, None, (*camera.notes, note))
    return camera


def _check_size(camera: Camera, found: Found, shape: tuple[int, int]) -> None:
    """Refuse intrinsics of an image of another size."""
    size = found.full_size or (shape[1], shape[0])
    if camera.size is not None and camera.size != size:
        raise ConfigError(
            f"{camera.name} belongs to images of {camera.size[0]} x {camera.size[1]} pixels, and {found.name} has "
            f"{size[0]} x {size[1]}; pass the intrinsics of this image"
        )


@np.errstate(invalid="ignore", over="ignore")
def _of_cloud(found: Found, scale: float | None, given: Camera | None) -> tuple[NDArray[np.float64], Camera]:
    """Return the depth image of a cloud, metres, and its camera."""
    points = np.asarray(found.points)
    if points.size > 3 * MOST_POINTS or points.size < 3:
        raise ConfigError(f"{found.name} has {points.size // 3} points; pass 1 to {MOST_POINTS}")
    cloud, negated = turned(points.astype(np.float64) * (1.0 if scale is None else scale))
    if negated:
        found.warnings.append("z is negative, as in RealSense's PLY files: y and z are negated")
    # The unit, of the depths alone.
    z = np.where(np.isfinite(cloud).all(axis=-1), cloud[..., 2], 0.0).reshape(1, -1)
    metric_depth(np.maximum(z, 0.0) / (scale or 1.0), scale, found.name)
    why = ""
    if cloud.ndim == 3:
        grid = organised(cloud)
        if not isinstance(grid, str):
            return grid[0], _agreeing(Camera(grid[1], f"the points of {found.name}"), given)
        why = f" ({grid})"
    if given is not None:
        raise ConfigError(
            f"{found.name} is a cloud{why}, which is rendered by a camera of its own; pass no intrinsics with it"
        )
    depth, lens, share = rendered(cloud.reshape(-1, 3)[np.isfinite(cloud).reshape(-1, 3).all(axis=1)])
    left = f"; {1 - share:.1%} of the points are behind or far beside it and left out" if share < 0.999 else ""
    found.warnings.append(
        f"the cloud is no image{why}: it is rendered by a camera at its origin, {depth.shape[1]} x {depth.shape[0]} "
        f"pixels, f = {lens[0, 0]:.0f}, as points in the camera's frame (x right, y down, z forward){left}"
    )
    if lens[0, 0] < _COARSE:
        found.warnings.append(
            f"the cloud is sparse: a pixel of its image is {600 / lens[0, 0]:.1f} mm wide at 0.6 m; pass the full cloud"
        )
    return depth, Camera(lens, "the virtual camera")


def _agreeing(estimated: Camera, given: Camera | None) -> Camera:
    """Refuse given intrinsics that differ from those of an organised cloud."""
    if given is None or given.coefficients:
        return estimated
    apart = np.abs(given.matrix - estimated.matrix)
    focal = max(apart[0, 0] / estimated.matrix[0, 0], apart[1, 1] / estimated.matrix[1, 1])
    if focal > _SAME_FOCAL or apart[:2, 2].max() > _SAME_CENTER:
        fx, fy, cx, cy = (estimated.matrix[i] for i in ((0, 0), (1, 1), (0, 2), (1, 2)))
        raise ConfigError(
            f"{given.name} does not fit {estimated.name}, which are those of fx {fx:.1f}, fy {fy:.1f}, cx {cx:.1f}, cy "
            f"{cy:.1f}; pass no intrinsics with an organised cloud"
        )
    return estimated


def _labels(
    mask: NDArray[np.bool_] | PathLike | None, labels: NDArray[np.integer] | PathLike | None, shape: tuple[int, int]
) -> NDArray[np.int64] | None:
    """Return labels (H, W), those of a mask being 1."""
    if mask is not None and labels is not None:
        raise ConfigError("mask and labels both mark pixels; pass one of them")
    marked = mask if labels is None else labels
    if marked is None:
        return None
    name = str(marked) if isinstance(marked, str | os.PathLike) else "mask" if labels is None else "labels"
    if isinstance(marked, str | os.PathLike):
        values: NDArray[np.generic] = read_labels(marked)
    else:
        values = np.asarray(marked)
    if values.shape != shape or values.dtype.kind not in "biu":
        raise ConfigError(f"{name} is {values.dtype} of shape {values.shape}; pass {shape}, as the image")
    if values.size and int(values.max()) >= 1 << 62:
        raise ConfigError(f"{name} holds the number {int(values.max())}; pass numbers below 2^62")
    numbers = np.maximum(values.astype(np.int64), 0)
    if labels is None:
        known = np.unique(numbers)
        known = known[known != 0]
        if len(known) != 1:
            raise ConfigError(
                f"{name} marks no single thing: it holds the labels {listed(known.tolist()) or 'none'}; choose one by "
                "--label, or pass labels"
            )
        return np.asarray(numbers != 0, dtype=np.int64)
    return numbers


def _straightened(
    camera: Camera, depth: NDArray[np.float64], labels: NDArray[np.int64] | None, warnings: list[str]
) -> tuple[NDArray[np.float64], NDArray[np.int64] | None]:
    """Undo the distortion of the image and its labels."""
    images = (depth,) if labels is None else (depth, labels)
    moved = undistorted(camera, *images)
    if moved is None:
        return depth, labels
    warnings.append(
        f"the distortion of {camera.name} ({camera.model}) was undone, as for an image as the sensor gives it; if the "
        "depth is rectified or aligned to colour, pass the intrinsics as numbers"
    )
    straight = np.asarray(moved[0], dtype=np.float64)
    if not straight.any():
        raise ConfigError(f"the distortion of {camera.name} leaves nothing of the image; check its coefficients")
    return straight, None if labels is None else np.asarray(moved[1], dtype=np.int64)


def check_depth_kind(kind: str) -> None:
    """Raise ConfigError for an unknown kind of depth."""
    if kind not in DEPTH_KINDS:
        raise ConfigError(f"depth_is is {kind!r}; choose from {', '.join(DEPTH_KINDS)}")


def check_limits(limits: tuple[float, float]) -> tuple[float, float]:
    """Return the nearest and the farthest depth, metres; raises ConfigError if they are none."""
    near, far = floats(limits, "limits").tolist() if np.size(limits) == 2 else (1.0, 0.0)
    if not 0.0 <= near < far:
        raise ConfigError(f"limits are {limits}; pass the nearest and the farthest depth, metres")
    return near, far


def _bounded(
    depth: NDArray[np.float64],
    limits: tuple[float, float] | None,
    region: tuple[int, int, int, int] | None,
    name: str,
) -> NDArray[np.float64]:
    """Set depths outside of the limits and the region to 0."""
    kept = np.ones(depth.shape, dtype=np.bool_)
    if limits is not None:
        near, far = check_limits(limits)
        kept &= (depth >= near) & (depth <= far)
    if region is not None:
        left, top, right, bottom = region
        if not (0 <= left < right <= depth.shape[1] and 0 <= top < bottom <= depth.shape[0]):
            raise ConfigError(
                f"region is {region}; pass left < right <= {depth.shape[1]} and top < bottom <= {depth.shape[0]}"
            )
        inside = np.zeros(depth.shape, dtype=np.bool_)
        inside[top:bottom, left:right] = True
        kept &= inside
    if not (kept & (depth > 0)).any():
        low, high = depth[depth > 0].min(), depth.max()
        raise ConfigError(
            f"{name} has no depth within the limits and the region; its depths are {low:.3g} to {high:.3g} m"
        )
    return np.where(kept, depth, 0.0)


def _pose(camera_pose: ArrayLike | PathLike | None) -> NDArray[np.float64] | None:
    if camera_pose is None:
        return None
    return read_pose(camera_pose) if isinstance(camera_pose, str | os.PathLike) else check_pose(camera_pose)
