"""Requests for grasps and their answers, as arrays or as JSON.

| entry of a request | shape | meaning |
|---|---|---|
| ``depth`` | (H, W), or (k, H, W) for several images | metres as floats, millimetres as integers; 0 where nothing was measured |
| ``intrinsics`` | (3, 3) or (k, 3, 3) | pixels |
| ``camera_pose`` | (4, 4) or (k, 4, 4), optional | ``table_from_camera``: z up, the table at z = 0, metres; by default the table is found in the image |
| ``region`` | 4 integers, optional | left, top, right, bottom: pixels within which the object is searched |
| ``workspace`` | (2, 3), optional | least and greatest corner of a box in which the object is searched, metres |
| ``workspace_frame`` | text, optional | ``table`` or ``camera``, the frame of the box; by default ``table`` with ``camera_pose``, else ``camera`` |
| ``mask`` | (H, W) or (k, H, W), optional | pixels of the object to grasp: bool, or integers that are not 0 there |
| ``labels`` | (H, W) or (k, H, W), optional | numbers of the things, at most 100, 0 for none; instead of ``mask`` |
| ``label`` | integer, optional | the thing of ``labels`` to grasp; by default the only one |
| ``all`` | bool, optional | grasps of every thing: those of ``labels``, or all that rise above the table |
| ``keep_off`` | (n, 3), optional | points of obstacles, at most 8 mm apart, table's frame, metres; needs ``camera_pose`` |
| ``hand_error`` | 2 numbers, optional | error of the hand's pose, one standard deviation: millimetres, degrees |
| ``depth_scale`` | number, optional | metres per unit of ``depth`` |
| ``depth_is`` | text, optional | ``z``, the default, or ``distance``, along the rays of the pixels |
| ``previous`` | map, optional | an earlier answer to such a request in the same still scene, or its entries below: its best grasp stays while no other is clearly better |
| ``count`` | integer, optional | most grasps, 1 to 100; 5 by default |
| ``seed`` | integer, optional | seed of the refinement |

``previous`` holds ``hand``, ``camera_from_hand``, ``table_from_hand`` and ``preshape``, of which the first grasp counts
(in the frame of the table with ``camera_pose``, else of the camera); for ``all`` it holds ``things`` with ``thing`` and
these, and ``labels``, and for several images ``images``. Other entries are ignored, and nothing is remembered between
requests. An optional entry that is None counts as absent.

The camera looks along z, with x to the right and y down. A request of k images has k answers, in ``images``; a request
of one has the entries of `answer_of`, or with ``all`` those of `scene_answer_of`. In JSON an array is a list, or ``{"data": base64, "dtype": "<u2", "shape": [H, W]}``.
"""  # noqa: E501 (a table)

import base64
import binascii
import json
import math
from collections.abc import Mapping
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from graspbox._common.arguments import about, floats, natural, shown
from graspbox._common.rotations import quaternion_from_rotation
from graspbox.captures.capture import listed
from graspbox.errors import ConfigError
from graspbox.hands import Hand
from graspbox.perception.captured import MOST_THINGS
from graspbox.perception.depth_images import check_intrinsics, check_points, check_pose, metric_depth
from graspbox.perception.perturbations import PoseNoise
from graspbox.perception.real import DEPTH_KINDS, FRAMES, Frame, Workspace, z_of_distances
from graspbox.policies.grasp_image import ImageGrasper, ImageGrasps, SceneGrasps
from graspbox.tools.remote.earlier_answers import earlier_grasp, earlier_scene
from graspbox.tools.remote.sent_arrays import sent_array

__all__ = ["ENTRIES", "answer_of", "decide", "from_json", "scene_answer_of", "to_json"]

#: Entries of a request.
ENTRIES = ("depth", "intrinsics", "camera_pose", "region", "workspace", "workspace_frame", "mask", "labels", "label",
           "all", "keep_off", "hand_error", "depth_scale", "depth_is", "previous", "count", "seed")  # fmt: skip
#: Most images of a request, and most pixels of one: those of a camera of 4096 x 3072.
MAX_IMAGES, MAX_PIXELS = 16, 4096 * 3072
#: Most grasps for a thing.
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


def _as_sent(request: Mapping[str, Any], name: str) -> NDArray[np.generic]:
    """Return an entry as an array of the type that it has."""
    return sent_array(request[name], name, "give an image of numbers (H, W)")


def _or(request: Mapping[str, Any], name: str, default: Any) -> Any:
    """Return an entry, or its default where it is absent or None."""
    value = request.get(name)
    return default if value is None else value


def _image(request: Mapping[str, Any]) -> NDArray[np.generic]:
    if "depth" not in request or "intrinsics" not in request:
        raise ConfigError("a request for grasps needs the entries 'depth' and 'intrinsics'")
    depth = _as_sent(request, "depth")
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
    for name in ("mask", "labels"):
        if request.get(name) is not None:
            with about(name):
                marked = _as_sent(request, name)
                if marked.shape != depth.shape:
                    raise ConfigError(f"{name} has shape {marked.shape}; give {depth.shape}, one for each image")
            for part, own in zip(parts, marked, strict=True):
                part[name] = own
    if request.get("previous") is not None:
        with about("previous"):
            images = request["previous"].get("images") if isinstance(request["previous"], Mapping) else None
            if not isinstance(images, list | tuple) or len(images) != len(depth):
                raise ConfigError(
                    f"previous is {shown(request['previous'])}; give images, one for each of {len(depth)}"
                )
        for part, own in zip(parts, images, strict=True):
            part["previous"] = own
    return parts


def _matrices(values: Any, name: str, size: int, images: int) -> Any:
    """Return a matrix for each image; none if the request has one for all, or none."""
    if values is None:
        return ()
    matrices = sent_array(values, name, f"give matrices of numbers ({size}, {size})")
    if matrices.ndim == 3 and len(matrices) != images:
        raise ConfigError(f"{name} has {len(matrices)} matrices; give one for each of {images} images")
    return matrices if matrices.ndim == 3 else ()


def decide(grasper: ImageGrasper, request: Mapping[str, Any]) -> dict[str, Any]:
    """Find the grasps of a request: `answer_of` or `scene_answer_of` the image; for several, a list in ``images``.

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
    answers = [_answer(grasper, one) for one in _separate(request, depth)]
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


def _numbers(request: Mapping[str, Any], name: str, shape: tuple[int, ...]) -> NDArray[np.int64]:
    """Return an entry with a number for each pixel: ``mask`` has one besides 0, ``labels`` several."""
    pixels = _as_sent(request, name)
    if pixels.shape != shape or pixels.dtype.kind not in "biu":
        raise ConfigError(f"{name} is {pixels.dtype} of shape {pixels.shape}; give bool or integers of shape {shape}")
    found = np.unique(pixels)
    low, high = int(found[0]), int(found[-1])
    if low < 0 or high >= 2**63:
        raise ConfigError(f"{name} holds {low if low < 0 else high}; give numbers from 0 below 2^63")
    things = found[found != 0].tolist()
    if not things:
        raise ConfigError(f"{name} is 0 everywhere; mark the pixels to grasp")
    if name == "mask" and len(things) > 1:
        raise ConfigError(f"mask holds the numbers {listed(things)}; give one, or the numbers of several as labels")
    if len(things) > MOST_THINGS:
        raise ConfigError(f"labels has {len(things)} things; give at most {MOST_THINGS}")
    return pixels.astype(np.int64)


def _marked(request: Mapping[str, Any], shape: tuple[int, ...]) -> tuple[bool, NDArray[np.int64] | None]:
    """Return whether all things are asked for, and what marks them; pixels of a single one are 1."""
    mask, labels, label, every = (request.get(name) for name in ("mask", "labels", "label", "all"))
    with about("all"):
        if not isinstance(every, bool | np.bool_ | None):
            raise ConfigError(f"all is {shown(every)}; give True or False")
        if every and (mask is not None or label is not None):
            raise ConfigError("all asks for every thing, mask and label for one; leave either out")
    with about("label"):
        if label is not None and labels is None:
            raise ConfigError(f"label is {shown(label)}, the number of a thing in labels; give labels too")
        number = None if label is None else natural(label, "label", bits=63)
    with about("mask"):
        if mask is not None and labels is not None:
            raise ConfigError("mask and labels both mark pixels; give one of them")
        if mask is not None:
            return False, np.asarray(_numbers(request, "mask", shape) != 0, dtype=np.int64)
    if labels is None:
        return bool(every), None
    with about("labels"):
        numbers = _numbers(request, "labels", shape)
    if every:
        return True, numbers
    with about("label"):
        things = np.unique(numbers[numbers != 0]).tolist()
        if number is None and len(things) > 1:
            raise ConfigError(f"label is missing; give one of the things of labels, {listed(things)}, or all")
        if number is not None and number not in things:
            raise ConfigError(f"label is {number}; the things of labels are {listed(things)}")
    return False, np.asarray(numbers == (things[0] if number is None else number), dtype=np.int64)


def _workspace(request: Mapping[str, Any]) -> Workspace | None:
    frame, corners = request.get("workspace_frame"), None
    with about("workspace_frame"):
        if frame is not None and (not isinstance(frame, str) or frame not in FRAMES):
            raise ConfigError(f"workspace_frame is {shown(frame)}; choose from {', '.join(FRAMES)}")
    with about("workspace"):
        if request.get("workspace") is not None:
            corners = _array(request, "workspace", (2, 3)).ravel().tolist()
        return Workspace.of(corners, cast(Frame | None, frame))


def _options(request: Mapping[str, Any]) -> dict[str, Any]:
    """Return the options of the search that do not depend on the image."""
    options: dict[str, Any] = {"workspace": _workspace(request)}
    with about("region"):
        options["region"] = _region(request)
    if request.get("keep_off") is not None:
        with about("keep_off"):
            if request.get("camera_pose") is None:
                raise ConfigError("keep_off is in the table's frame, which camera_pose fixes; give it too")
            options["keep_off"] = check_points(floats(request["keep_off"], "keep_off"))
    if request.get("hand_error") is not None:
        with about("hand_error"):
            options["hand_error"] = PoseNoise.in_millimetres(*_array(request, "hand_error", (2,)).tolist())
    with about("count"):
        options["count"] = natural(_or(request, "count", 5), "count")
        if not 1 <= options["count"] <= MAX_GRASPS:
            raise ConfigError(f"count is {options['count']}; give 1 to {MAX_GRASPS}")
    with about("seed"):
        options["seed"] = natural(_or(request, "seed", 0), "seed", bits=63)
    return options


def _answer(grasper: ImageGrasper, request: Mapping[str, Any]) -> dict[str, Any]:
    """Answer the request of one image."""
    with about("depth_scale"):
        scale = _scale(request)
    with about("depth_is"):
        kind = _or(request, "depth_is", "z")
        if not isinstance(kind, str) or kind not in DEPTH_KINDS:
            raise ConfigError(f"depth_is is {shown(kind)}; choose from {', '.join(DEPTH_KINDS)}")
    with about("depth"):
        depth = metric_depth(request["depth"], scale)
    with about("intrinsics"):
        lens = check_intrinsics(_array(request, "intrinsics", (3, 3)), (depth.shape[0], depth.shape[1]))
    if kind == "distance":
        depth = z_of_distances(depth, lens)
    pose = None
    if request.get("camera_pose") is not None:
        with about("camera_pose"):
            pose = check_pose(_array(request, "camera_pose", (4, 4)), "camera_pose")
    every, marked = _marked(request, depth.shape)
    options = _options(request)
    before = request.get("previous")
    if every:
        with about("previous"):
            scene = None if before is None else earlier_scene(before, grasper.hand)
        found = grasper.find_all(depth, lens, pose, labels=marked, previous=scene, **options)
        return scene_answer_of(found, grasper.hand)
    with about("previous"):
        one = None if before is None else earlier_grasp(before, grasper.hand)
    mask = None if marked is None else marked != 0
    return answer_of(grasper.find(depth, lens, pose, mask=mask, previous=one, **options), grasper.hand)


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


def scene_answer_of(scene: SceneGrasps, hand: Hand) -> dict[str, Any]:
    """Answer with the grasps of every thing in an image.

    Returns
    -------
    dict
        ``things``, by number: ``thing``, ``pixels`` (of ``labels``), and the entries of `answer_of` or ``refused``, why
        it has no grasp; ``order``, ``thing`` and ``rank`` (from 1) of all grasps, the best first; ``labels`` (h, w)
        int64, the thing of each pixel of the networks' image, 0 for none.
    """
    told = scene.to_json()
    things = [
        row
        if "refused" in row
        else {"thing": row["thing"], "pixels": row["pixels"], **answer_of(scene.grasps[row["thing"]], hand)}
        for row in told["things"]
    ]
    return {"things": things, "order": told["order"], "labels": scene.labels}


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
            # An earlier answer is a map of lists.
            request[name] = value if name == "previous" else _decoded(value, name)
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
