"""Intrinsics from files and messages: ROS CameraInfo, OpenCV, RealSense, Open3D, BOP; pixel centres there are integers.

`camera_of` applies the rules of ROS: which matrix belongs to which topic, binning, region of interest.
"""

import json
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from graspbox._common.arguments import shown
from graspbox._common.files import read_bounded
from graspbox._common.imports import imported
from graspbox.captures.capture import Camera
from graspbox.captures.distortion import standard_model
from graspbox.captures.files import kind_of, read_image
from graspbox.errors import ConfigError, FileError

__all__ = ["camera_of", "read_camera"]

#: Largest files of JSON (BOP has an entry for each image) and of YAML, bytes.
_LARGEST_JSON, _LARGEST_YAML = 1 << 24, 1 << 18
#: Names of a matrix (3, 3) by rows, of a distortion and its model, of columns and rows.
_MATRICES = ("k", "K", "camera_matrix", "cam_K", "intrinsics", "intrinsic_matrix", "depth_intrinsics")
_COEFFICIENTS = ("d", "D", "distortion_coefficients", "dist_coeffs", "distortion", "coeffs")
_MODELS = ("distortion_model", "model")
_SIZES = (("width", "height"), ("image_width", "image_height"))
#: Objects of a file within which intrinsics are searched.
_INSIDE = ("camera_info", "depth_camera", "depth", "intrinsics", "depth_intrinsics", "intrinsic", "camera")
#: In a file that names the focal lengths, ``depth_scale`` is metres per unit below this; else its unit is unknown.
_METRES = 0.05


def read_camera(path: Path, image: str = "") -> Camera:
    """Read intrinsics from a file; `image` is the name of the depth image, which chooses among several of BOP.

    Raises
    ------
    FileError, ConfigError
        If it cannot be read, or states no intrinsics.
    MissingExtraError
        For YAML without PyYAML (extra ``cli``).
    """
    if not path.is_file():
        raise FileError(2, "there is no such file of intrinsics", str(path))
    if kind_of(path) == "npy":
        return _of_numbers(read_image(path, "file of intrinsics")[1], path)
    content = read_bounded(path, _LARGEST_JSON)
    try:
        document = _document(content, path)
        if isinstance(document, str):
            return _of_numbers(np.array([float(word) for word in document.replace(",", " ").split()]), path)
        return _of_document(document, path, image)
    except ConfigError:
        raise
    except (ValueError, TypeError, LookupError, AttributeError, ArithmeticError, RecursionError) as error:
        raise ConfigError(
            f"{path} states no intrinsics ({type(error).__name__}: {shown(str(error))}); pass a ROS CameraInfo, "
            "OpenCV, RealSense, Open3D or BOP file, or FX FY CX CY"
        ) from None


def _of_numbers(values: NDArray[np.generic], path: Path) -> Camera:
    if values.size != 9 or values.dtype.kind not in "fiu":
        raise ConfigError(f"{path} holds {values.size} numbers; pass the 9 of a 3x3 matrix, row by row, in pixels")
    return _camera(_matrix(values.ravel().tolist(), str(path)), str(path))


def _document(content: bytes, path: Path) -> Any:
    """Return the first document of JSON or YAML, or the text of numbers alone."""
    text = content.decode("utf-8-sig")
    if re.fullmatch(r"[-+0-9.eE,;\s]+", text):
        return text
    if text.lstrip()[:1] in ("{", "["):
        try:
            return json.loads(text)
        except ValueError:
            pass  # YAML may begin so too
    if len(content) > _LARGEST_YAML:
        raise ConfigError(f"{path} is neither JSON nor YAML of at most {_LARGEST_YAML} bytes; pass a smaller file")
    yaml = imported("yaml", "camera files in YAML need PyYAML, from the extra 'cli'", "cli")

    class Loader(yaml.SafeLoader):  # type: ignore[misc, name-defined]
        """Reads OpenCV's matrices as mappings."""

    Loader.add_multi_constructor("", lambda loader, tag, node: loader.construct_mapping(node, deep=True))
    # OpenCV's first line is no YAML.
    text = re.sub(r"\A%YAML[^\n]*\n", "", text)
    try:
        return Loader(text).get_data()
    except yaml.YAMLError as error:
        raise ConfigError(f"{path} is neither JSON nor YAML: {shown(str(error))}") from None


def _of_document(document: Any, path: Path, image: str) -> Camera:
    if not isinstance(document, Mapping):
        raise ValueError("no object with names")
    name = str(path)
    if all(isinstance(one, Mapping) and "cam_K" in one for one in document.values()) and document:
        return _of_bop(document, path, image)
    entries = _entries(document)
    if entries is None:
        raise ValueError(f"its names are {', '.join(str(key) for key in list(document)[:8])}")
    if {"fx", "fy"} <= entries.keys():
        return _of_focal_lengths(entries, name)
    key = next(key for key in _MATRICES if key in entries)
    matrix = _numbers(entries[key])
    if key == "intrinsic_matrix":
        matrix = _matrix(matrix, name, by_columns=True)
    scale = None
    if key == "cam_K" and "depth_scale" in entries:
        scale = float(entries["depth_scale"]) / 1000.0
    if key == "intrinsic_matrix" and "depth_scale" in entries:
        scale = 1.0 / float(entries["depth_scale"])
    info = {**entries, "k": matrix, "d": _coefficients(entries), "model": _text(entries, _MODELS)}
    return camera_of(info, name, scale=scale)


def _entries(document: Mapping[Any, Any], depth: int = 0) -> Mapping[Any, Any] | None:
    """Return the object that holds a matrix or focal lengths, with names of those around it, such as the size."""
    if {"fx", "fy"} <= document.keys() or any(_is_matrix(document.get(key)) for key in _MATRICES):
        return document
    for key in _INSIDE:
        inside = document.get(key)
        if isinstance(inside, Mapping) and depth < 3 and (found := _entries(inside, depth + 1)) is not None:
            around = {one: value for one, value in document.items() if not isinstance(value, Mapping | list)}
            return {**around, **found}
    return None


def _is_matrix(value: Any) -> bool:
    try:
        return len(_numbers(value)) == 9
    except (ValueError, TypeError, KeyError):
        return False


def _of_focal_lengths(entries: Mapping[Any, Any], name: str) -> Camera:
    center = ("ppx", "ppy") if "ppx" in entries else ("cx", "cy")
    fx, fy, cx, cy = (float(entries[key]) for key in ("fx", "fy", *center))
    info = {**entries, "k": [fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0], "d": _coefficients(entries)}
    # RealSense writes the model as text; other files use the name for the camera.
    info["model"] = _text(entries, _MODELS) if any(info["d"]) else ""
    scale = float(entries["depth_scale"]) if "depth_scale" in entries else None
    if scale is None or 0.0 < scale < _METRES:
        return camera_of(info, name, scale=scale)
    note = (
        f"the depth_scale {scale:g} of {name} is not used, since the file does not tell its unit; pass the depth scale "
        "in metres per unit if it is not the usual one"
    )
    return camera_of(info, name, notes=(note,))


def _of_bop(document: Mapping[Any, Any], path: Path, image: str) -> Camera:
    """Return the camera of an image of BOP's ``scene_camera.json``, by the number in the name of the image."""
    number = Path(image).stem
    keys = [key for key in document if number.isdigit() and str(key).isdigit() and int(key) == int(number)]
    if not keys and len(document) == 1:
        keys = list(document)
    if not keys:
        raise ConfigError(
            f"{path} has intrinsics of {len(document)} images, none of the number of {image or 'the image'!r}; name "
            "the image as BOP does, such as 000003.png"
        )
    entry = document[keys[0]]
    scale = float(entry["depth_scale"]) / 1000.0 if "depth_scale" in entry else None
    return _camera(_matrix(_numbers(entry["cam_K"]), str(path)), str(path), depth_scale=scale)


def _numbers(value: Any) -> list[float]:
    """Return the numbers of a list, a matrix of rows, or a mapping with ``data``."""
    if isinstance(value, Mapping):
        value = value["data"]
    if isinstance(value, np.ndarray):
        value = value.ravel().tolist()
    if not isinstance(value, Sequence) or isinstance(value, str) or len(value) > 64:
        raise ValueError("a matrix is a list of numbers")
    return [float(one) for row in value for one in (row if isinstance(row, list | tuple) else [row])]


def _matrix(numbers: list[float], name: str, by_columns: bool = False) -> list[float]:
    """Return a matrix by rows; one by columns is recognised by its last row."""
    if len(numbers) != 9:
        raise ConfigError(f"{name} states a matrix of {len(numbers)} numbers; pass the 9 of intrinsics, in pixels")
    transposed = [numbers[i] for i in (0, 3, 6, 1, 4, 7, 2, 5, 8)]
    for one in (transposed, numbers) if by_columns else (numbers,):
        if one[6:] == [0.0, 0.0, 1.0]:
            return one
    raise ConfigError(f"{name} states a matrix whose last row is {numbers[6:]}; pass intrinsics, which end with 0 0 1")


def _coefficients(entries: Mapping[Any, Any]) -> list[float]:
    value: Any = next((entries[key] for key in _COEFFICIENTS if entries.get(key) is not None), [])
    return [] if isinstance(value, str) else _numbers(value)


def _text(entries: Mapping[Any, Any], keys: Sequence[str]) -> str:
    return next((entries[key] for key in keys if isinstance(entries.get(key), str)), "")


def _camera(matrix: Sequence[float], name: str, **values: Any) -> Camera:
    lens = np.array(matrix, dtype=np.float64).reshape(3, 3)
    if not np.isfinite(lens).all():
        raise ConfigError(f"{name} states intrinsics that are not finite; calibrate the camera first")
    lens[:2, 2] += 0.5
    return Camera(lens, name, **values)


def camera_of(
    info: Mapping[str, Any], name: str, use: str = "raw", scale: float | None = None, notes: tuple[str, ...] = ()
) -> Camera:
    """Return the camera of a ROS CameraInfo, whose entries may be named as in ROS 1 or ROS 2.

    Parameters
    ----------
    info : mapping
        ``k`` (9 numbers by rows), and if known ``d``, ``model``, ``p``, the size, binning and ``roi``.
    name : str
        The file or topic, for errors.
    use : {"raw", "rectified", "aligned"}
        The image: as the sensor gives it (K and D); rectified (P); depth aligned to colour, which has no distortion
        (K without D).
    scale : float, optional
        Metres per unit of its depth images.
    notes : tuple of str
        Assumptions so far.

    Raises
    ------
    ConfigError
        If it is not calibrated, is the second camera of a stereo pair, or has an unknown distortion.
    """
    matrix, projection = _numbers(info["k"]), _numbers(_first(info, ("p", "P", "projection_matrix"), []))
    if matrix[0] == 0.0:
        raise ConfigError(f"{name} is not calibrated: its K is 0; calibrate the camera, or pass the intrinsics")
    coefficients, model = tuple(_numbers(info.get("d", []))), str(info.get("model", ""))
    if use == "rectified":
        if len(projection) == 12 and projection[0] != 0.0:
            if projection[3] != 0.0:
                raise ConfigError(
                    f"{name} belongs to the second camera of a stereo pair (P[3] is {projection[3]:g}); depth images "
                    "belong to the first one: pass its intrinsics"
                )
            matrix = [projection[i] for i in (0, 1, 2, 4, 5, 6, 8, 9, 10)]
        elif any(coefficients):
            raise ConfigError(f"{name} has no P, which a rectified image needs; pass the intrinsics of the image")
    if use != "raw":
        coefficients = ()
    model, coefficients = standard_model(model, coefficients, name)
    size = next(((info[w], info[h]) for w, h in _SIZES if info.get(w) and info.get(h)), None)
    camera = _camera(_matrix(list(matrix), name), name, depth_scale=scale, notes=notes)
    lens, size = _binned(camera.matrix, None if size is None else (int(size[0]), int(size[1])), info)
    return Camera(lens, name, size, model, coefficients, scale, notes)


def _first(info: Mapping[str, Any], keys: Sequence[str], default: Any) -> Any:
    return next((info[key] for key in keys if info.get(key) is not None), default)


def _binned(
    lens: NDArray[np.float64], size: tuple[int, int] | None, info: Mapping[str, Any]
) -> tuple[NDArray[np.float64], tuple[int, int] | None]:
    """Apply the region of interest, in pixels of the full image, and then the binning."""
    roi = info.get("roi") or {}
    left, top, width, height = (int(roi.get(key) or 0) for key in ("x_offset", "y_offset", "width", "height"))
    bins = max(int(info.get("binning_x") or 1), 1), max(int(info.get("binning_y") or 1), 1)
    lens = lens.copy()
    lens[0, 2], lens[1, 2] = lens[0, 2] - left, lens[1, 2] - top
    lens[0], lens[1] = lens[0] / bins[0], lens[1] / bins[1]
    if size is not None:
        size = (width or size[0] - left) // bins[0], (height or size[1] - top) // bins[1]
    return lens, size
