"""Requests for grasps and their answers, as arrays or as JSON.

| entry of a request | shape | meaning |
|---|---|---|
| ``depth`` | (H, W), or (k, H, W) for several images | metres as floats, millimetres as integers; 0 where nothing was measured |
| ``intrinsics`` | (3, 3) or (k, 3, 3) | pixels |
| ``camera_pose`` | (4, 4) or (k, 4, 4), optional | ``table_from_camera``: z up, the table at z = 0, metres; by default the table is found in the image |
| ``region`` | 4 integers, optional | left, top, right, bottom: pixels within which the object is searched |
| ``hand_error`` | 2 numbers, optional | error of the hand's pose, one standard deviation: millimetres, degrees |
| ``depth_scale`` | number, optional | metres per unit of ``depth`` |
| ``count`` | integer, optional | most grasps, 1 to 100; 5 by default |
| ``seed`` | integer, optional | seed of the refinement |

The camera looks along z, with x to the right and y down. A request of k images has k answers, in ``images``; a request
of one has the entries of `answer_of`. In JSON an array is a list, or ``{"data": base64, "dtype": "<u2", "shape": [H, W]}``.
"""  # noqa: E501 (a table)

import base64
import binascii
import json
import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from graspbox._common.arguments import about, natural, shown
from graspbox._common.rotations import quaternion_from_rotation
from graspbox.errors import ConfigError
from graspbox.hands import Hand
from graspbox.perception.depth_images import check_intrinsics, check_pose, metric_depth
from graspbox.perception.perturbations import PoseNoise
from graspbox.policies.grasp_image import ImageGrasper, ImageGrasps

__all__ = ["ENTRIES", "answer_of", "decide", "from_json", "to_json"]

#: Entries of a request.
ENTRIES = ("depth", "intrinsics", "camera_pose", "region", "hand_error", "depth_scale", "count", "seed")
#: Most images of a request, and most pixels of one: those of a camera of 4096 x 3072.
MAX_IMAGES, MAX_PIXELS = 16, 4096 * 3072
#: Most grasps for an image.
MAX_GRASPS = 100
#: Largest scale of depth, metres per unit; longest name of an entry that an error repeats.
_LARGEST_SCALE, _MAX_NAME = 1e6, 100


def _array(request: Mapping[str, Any], name: str, shape: tuple[int, ...]) -> NDArray[np.float64]:
    """Return an entry as an array of finite numbers of a shape."""
    wanted = f"{shape[0]} finite numbers" if len(shape) == 1 else f"finite numbers of shape {shape}"
    try:
        array = np.asarray(request[name], dtype=np.float64)
    except (OverflowError, TypeError, ValueError):
        raise ConfigError(f"{name} is {shown(request[name])}; give {wanted}") from None
    if array.shape != shape:
        raise ConfigError(f"{name} has shape {array.shape}; give {wanted}")
    if not np.isfinite(array).all():
        raise ConfigError(f"{name} holds {array[~np.isfinite(array)][0]}; give {wanted}")
    return array


def _image(request: Mapping[str, Any]) -> NDArray[np.generic]:
    if "depth" not in request or "intrinsics" not in request:
        raise ConfigError("a request for grasps needs the entries 'depth' and 'intrinsics'")
    try:
        depth: NDArray[np.generic] = np.asarray(request["depth"])
    except (OverflowError, ValueError):
        raise ConfigError("depth has rows of different lengths; give an image (H, W)") from None
    if depth.dtype.kind not in "fiu" or depth.ndim not in (2, 3):
        raise ConfigError(f"depth is {depth.dtype} of shape {depth.shape}; give numbers (H, W), or (k, H, W)")
    if not depth.size:
        raise ConfigError(f"depth has shape {depth.shape}, without a pixel; give an image (H, W)")
    if depth.ndim == 3 and depth.shape[2] == 1 and depth.shape[0] > MAX_IMAGES:
        depth = depth[..., 0]
    images = depth.shape[0] if depth.ndim == 3 else 1
    if images > MAX_IMAGES or depth.size > images * MAX_PIXELS:
        raise ConfigError(f"depth has shape {depth.shape}; at most {MAX_IMAGES} images of {MAX_PIXELS} pixels fit")
    return depth


def _separate(request: Mapping[str, Any], depth: NDArray[np.generic]) -> list[dict[str, Any]]:
    """Make one request per image."""
    if depth.ndim == 2:
        return [{**request, "depth": depth}]
    parts: list[dict[str, Any]] = [{**request, "depth": image} for image in depth]
    for name, size in (("intrinsics", 3), ("camera_pose", 4)):
        with about(name):
            matrices = _matrices(request.get(name), name, size, len(depth))
        for part, own in zip(parts, matrices, strict=False):
            part[name] = own
    return parts


def _matrices(values: Any, name: str, size: int, images: int) -> Any:
    """Return a matrix for each image; none if the request has one for all, or none."""
    try:
        several = values is not None and np.ndim(values) == 3
    except ValueError:
        raise ConfigError(f"{name} has rows of different lengths; give matrices ({size}, {size})") from None
    if several and len(values) != images:
        raise ConfigError(f"{name} has {len(values)} matrices; give one for each of {images} images")
    return values if several else ()


def decide(grasper: ImageGrasper, request: Mapping[str, Any]) -> dict[str, Any]:
    """Find the grasps of a request: `answer_of` the image; for several, a list of them in ``images``.

    Raises
    ------
    ConfigError
        For a wrong, missing or unknown entry, named in `GraspboxError.field`, or for an image without an object.
    """
    for name in request:
        if name not in ENTRIES:
            with about(shown(name) if not isinstance(name, str) else name[:_MAX_NAME]):
                choices = ", ".join(ENTRIES)
                raise ConfigError(f"a request for grasps has no entry {shown(name)}; choose from {choices}")
    with about("intrinsics" if "depth" in request and "intrinsics" not in request else "depth"):
        depth = _image(request)
    hand = grasper.hand
    answers = [answer_of(_grasps_of(grasper, one), hand) for one in _separate(request, depth)]
    return answers[0] if depth.ndim == 2 else {"images": answers}


def _scale(request: Mapping[str, Any]) -> float | None:
    scale = request.get("depth_scale")
    if scale is None:
        return None
    known = isinstance(scale, int | float | np.integer | np.floating) and not isinstance(scale, bool)
    if not known or not 0.0 < scale <= _LARGEST_SCALE:
        raise ConfigError(f"depth_scale is {shown(scale)}; give metres per unit of depth, such as 0.001")
    return float(scale)


def _region(request: Mapping[str, Any]) -> tuple[int, int, int, int] | None:
    if request.get("region") is None:
        return None
    corners = _array(request, "region", (4,))
    if (corners != np.round(corners)).any() or (np.abs(corners) > MAX_PIXELS).any():
        raise ConfigError(f"region is {shown(request['region'])}; give the pixels left, top, right, bottom")
    left, top, right, bottom = (int(x) for x in corners)
    return left, top, right, bottom


def _grasps_of(grasper: ImageGrasper, request: Mapping[str, Any]) -> ImageGrasps:
    with about("depth_scale"):
        scale = _scale(request)
    with about("depth"):
        depth = metric_depth(request["depth"], scale)
    with about("intrinsics"):
        lens = check_intrinsics(_array(request, "intrinsics", (3, 3)), (depth.shape[0], depth.shape[1]))
    pose = error = None
    if request.get("camera_pose") is not None:
        with about("camera_pose"):
            pose = check_pose(_array(request, "camera_pose", (4, 4)), "camera_pose")
    with about("region"):
        region = _region(request)
    if request.get("hand_error") is not None:
        with about("hand_error"):
            error = PoseNoise.in_millimetres(*_array(request, "hand_error", (2,)).tolist())
    with about("count"):
        count = natural(request.get("count", 5), "count")
        if not 1 <= count <= MAX_GRASPS:
            raise ConfigError(f"count is {count}; give 1 to {MAX_GRASPS}")
    with about("seed"):
        seed = natural(request.get("seed", 0), "seed", bits=63)
    return grasper.find(depth, lens, pose, count=count, region=region, hand_error=error, seed=seed)


def answer_of(grasps: ImageGrasps, hand: Hand) -> dict[str, Any]:
    """Answer with the grasps of an image, the best first.

    Returns
    -------
    dict
        ``camera_from_hand``, ``table_from_hand`` (n, 4, 4); ``position`` (n, 3) and ``quaternion_wxyz`` (n, 4) of
        ``camera_from_hand``; ``preshape``, ``choice``, ``success``, ``secure``, ``free`` and ``lift_free`` (n,) as of
        `ImageGrasps`; ``joint_names`` and ``joint_positions`` (n, c) of the open hand; ``table_from_camera`` (4, 4);
        ``hand``; ``warnings``; and ``actions`` (1, 8), position, quaternion and preshape of the best grasp, or (0, 8).
    """
    in_camera = grasps.camera_from_hand
    rotations = quaternion_from_rotation(in_camera[:, :3, :3])
    positions = in_camera[:, :3, 3]
    best = np.concatenate([positions, rotations, grasps.preshape[:, None]], axis=1)[:1]
    return {
        "hand": grasps.hand.name,
        "camera_from_hand": in_camera,
        "table_from_hand": grasps.table_from_hand,
        "position": np.ascontiguousarray(positions),
        "quaternion_wxyz": rotations,
        "preshape": grasps.preshape,
        "choice": grasps.choice,
        "success": grasps.success,
        "secure": grasps.secure,
        "free": grasps.free,
        "lift_free": grasps.lift_free,
        "warnings": list(grasps.warnings),
        "joint_names": hand.joints,
        "joint_positions": np.array([hand.open(float(p)) for p in grasps.preshape]).reshape(-1, len(hand.joints)),
        "table_from_camera": grasps.table_from_camera,
        "actions": np.ascontiguousarray(best),
    }


def from_json(body: bytes) -> dict[str, Any]:
    """Read a request from JSON; a `ConfigError` refuses other values than an object, and wrong arrays in it."""
    try:
        fields = json.loads(body)
    except (ValueError, RecursionError) as error:
        raise ConfigError(f"the body is not JSON: {error}") from None
    if not isinstance(fields, dict):
        raise ConfigError("the body is JSON, but not an object; send {'depth': ..., 'intrinsics': ...}")
    request: dict[str, Any] = {}
    for name, value in fields.items():
        with about(name[:_MAX_NAME]):
            request[name] = _decoded(value, name)
    return request


def _decoded(value: Any, name: str) -> Any:
    if not isinstance(value, dict):
        return value
    try:
        dtype, shape = np.dtype(value["dtype"]), tuple(int(n) for n in value["shape"])
        data = base64.b64decode(value["data"], validate=True)
    except (KeyError, OverflowError, SyntaxError, TypeError, ValueError, binascii.Error):
        raise ConfigError(
            f"{name} is {shown(value)}; an array is {{'data': base64, 'dtype': '<u2', 'shape': [H, W]}}"
        ) from None
    if (
        dtype.kind not in "biuf"
        or min(shape, default=0) < 0
        or len(shape) > 3
        or dtype.itemsize * math.prod(shape) != len(data)
        or not data
    ):
        raise ConfigError(f"{name} has {len(data)} bytes; dtype {dtype} and shape {shape} do not fit them")
    return np.frombuffer(data, dtype=dtype).reshape(shape)


def to_json(answer: Mapping[str, Any]) -> str:
    """Write an answer as JSON; arrays are lists."""

    def plain(value: Any) -> Any:
        if isinstance(value, np.ndarray):
            return value.tolist()
        if isinstance(value, Mapping):
            return {name: plain(item) for name, item in value.items()}
        return [plain(item) for item in value] if isinstance(value, list) else value

    return json.dumps(plain(answer))
