"""Damaged files of depth data: an error that names the file, or a capture, never another exception or much memory."""

import json
import tracemalloc
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from graspbox import errors
from graspbox.captures import read_capture
from graspbox.captures.cameras import read_camera
from test_capture_cameras import ECHO, OPENCV, ROS, K
from test_capture_clouds import pcd, ply
from test_capture_images import LENS, png, scene, tiff

#: Damaged variants of each file.
COUNT = 150


def damaged(content: bytes, count: int = COUNT) -> Iterator[bytes]:
    """Truncate a file, and change bytes, most of them of the header, to others or to digits."""
    rng = np.random.default_rng(len(content))
    for _ in range(count):
        changed = bytearray(content)
        if rng.random() < 0.4:
            del changed[rng.integers(len(changed)) :]
        head = max(min(len(changed), 400), 1)
        for _ in range(rng.integers(1, 5)):
            if changed:
                place = int(rng.integers(head if rng.random() < 0.7 else len(changed))) % len(changed)
                changed[place] = (rng.integers(256), rng.integers(48, 58), 32, 10)[rng.integers(4)]
        yield bytes(changed)


def points() -> NDArray[np.float64]:
    """Make a few hundred points before a camera, some NaN."""
    v, u = np.mgrid[:12, :16]
    z = 0.6 + 0.01 * v
    found = np.stack([(u - 8) / 40 * z, (v - 6) / 40 * z, z], axis=-1).reshape(-1, 3)
    found[5] = np.nan
    return np.asarray(found)


def check(path: Path, contents: Iterator[bytes], intrinsics: NDArray[np.float64] | None = None) -> None:
    """Read damaged files."""
    for content in contents:
        path.write_bytes(content)
        try:
            seen = read_capture(path, intrinsics=intrinsics)
        except (errors.ConfigError, errors.FileError):
            pass
        else:
            assert np.isfinite(seen.depth).all()
            assert seen.depth.max() > 0


@pytest.mark.parametrize("form", ["ascii", "binary_little_endian", "binary_big_endian"])
def test_damaged_ply(form: str, tmp_path: Path) -> None:
    check(tmp_path / "cloud.ply", damaged(ply(points(), form, before=True)))


@pytest.mark.parametrize("data", ["ascii", "binary", "binary_compressed"])
def test_damaged_pcd(data: str, tmp_path: Path) -> None:
    check(tmp_path / "cloud.pcd", damaged(pcd(points(), data, 16, 12)))


@pytest.mark.parametrize("kind", ["npy", "npz", "png", "tiff"])
def test_damaged_images(kind: str, tmp_path: Path) -> None:
    pytest.importorskip("PIL.Image", reason="pictures need the extra 'cli'")
    path = tmp_path / f"depth.{kind}"
    millimetres = (scene() * 1000).round().astype(np.uint16)
    if kind in ("png", "tiff"):
        path.write_bytes(png(millimetres, 0, 16) if kind == "png" else tiff(millimetres))
    elif kind == "npy":
        np.save(path, millimetres)
    else:
        np.savez_compressed(path, depth=millimetres, K=LENS)
    check(path, damaged(path.read_bytes(), 2 * COUNT), LENS)


def test_damaged_exr(tmp_path: Path) -> None:
    exr = pytest.importorskip("OpenEXR", reason="EXR files need the extra 'exr'")
    path = tmp_path / "depth.exr"
    header = {"compression": exr.ZIP_COMPRESSION, "type": exr.scanlineimage}
    exr.File(header, {"Z": scene().astype(np.float32)}).write(str(path))
    content = path.read_bytes()
    check(path, (content[:size] for size in range(10, len(content), 40)), LENS)


@pytest.mark.parametrize(
    "content",
    [
        json.dumps({"width": 64, "height": 48, "k": K, "d": [0.01, 0, 0, 0, 0], "distortion_model": "plumb_bob"}),
        json.dumps({"width": 64, "height": 48, "fx": 60, "fy": 60, "ppx": 32, "ppy": 24, "coeffs": [0] * 5}),
        json.dumps({"intrinsic_matrix": [60, 0, 0, 0, 60, 0, 32, 24, 1], "depth_scale": 1000}),
        json.dumps({"1": {"cam_K": K, "depth_scale": 1.0}}),
        "60 0 32\n0 60 24\n0 0 1\n",
        ECHO,
        ROS,
        OPENCV,
    ],
)
def test_damaged_intrinsics(content: str, tmp_path: Path) -> None:
    pytest.importorskip("yaml", reason="YAML needs the extra 'cli'")
    path = tmp_path / "camera"
    for changed in damaged(content.encode()):
        path.write_bytes(changed)
        try:
            camera = read_camera(path)
        except (errors.ConfigError, errors.FileError):
            pass
        else:
            assert np.isfinite(camera.matrix).all()


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("a.ply", b"ply\nformat binary_little_endian 1.0\nelement vertex 16000000\n"
                  b"property double x\nproperty double y\nproperty double z\nend_header\n"),
        ("b.ply", b"ply\nformat ascii 1.0\nelement vertex 16000000\n"
                  b"property double x\nproperty double y\nproperty double z\nend_header\n1 2 3\n"),
        ("a.pcd", b"VERSION .7\nFIELDS x y z\nPOINTS 16000000\nDATA binary\n"),
        ("b.pcd", b"VERSION .7\nFIELDS x y z\nPOINTS 16000000\nDATA ascii\n0 0 1\n"),
        ("c.pcd", b"VERSION .7\nFIELDS x y z\nPOINTS 16000000\nDATA binary_compressed\n\1\0\0\0\0\x80\x70\x0b"),
    ],
)  # fmt: skip
def test_a_header_that_promises_much_costs_nothing(name: str, content: bytes, tmp_path: Path) -> None:
    (tmp_path / name).write_bytes(content)
    tracemalloc.start()
    try:
        with pytest.raises(errors.ConfigError, match=name):
            read_capture(tmp_path / name)
        assert tracemalloc.get_traced_memory()[1] < 20_000_000
    finally:
        tracemalloc.stop()
