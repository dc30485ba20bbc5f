"""Clouds of real cameras: PLY, PCD and arrays; organised ones contain their camera, others are rendered."""

import struct
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from graspbox import errors
from graspbox.captures import Capture, read_capture
from graspbox.captures.pcd import read_pcd
from graspbox.captures.ply import read_ply
from graspbox.perception.depth_images import camera_over_table, fit_table, points_of

LENS = np.array([[120.0, 0.0, 64.7], [0.0, 121.0, 47.9], [0.0, 0.0, 1.0]])
POSE = camera_over_table(0.6, 0.9)


def image() -> NDArray[np.float64]:
    """Make the image of a table with a block (96, 128), metres, as a tilted camera sees it; a corner without depth."""
    columns, rows = np.meshgrid(np.arange(128) + 0.5, np.arange(96) + 0.5)
    rays = np.stack([columns, rows, np.ones_like(rows)], axis=-1) @ np.linalg.inv(LENS).T
    depth = -POSE[2, 3] / (rays @ POSE[2, :3])
    depth[40:60, 50:80] -= 0.05
    depth[:8, :10] = 0.0
    return np.asarray(depth)


def grid() -> NDArray[np.float64]:
    """Organised points (96, 128, 3) of it, NaN where nothing was measured."""
    points = np.full((96, 128, 3), np.nan)
    depth = image()
    points[depth > 0] = points_of(depth, LENS)
    return points


def ply(points: NDArray[np.float64], form: str = "binary_little_endian", before: bool = False) -> bytes:
    """Write points as PLY, with colours, and elements before the vertices."""
    order = ">" if "big" in form else "<"
    lines = ["ply", f"format {form} 1.0", "comment made by a test"]
    lines += ["element camera 1", "property float f", "element face 2", "property list uchar int i"] if before else []
    lines += [f"element vertex {len(points)}", "property uchar red", *(f"property double {axis}" for axis in "xyz")]
    head = "\n".join([*lines, "end_header", ""]).encode()
    if form == "ascii":
        rows = ["2.5", "3 0 1 2", "2 5 6"] if before else []
        rows += [f"7 {x:.9g} {y:.9g} {z:.9g}" for x, y, z in points]
        return head + "\n".join([*rows, ""]).encode()
    kind = np.dtype([("red", "u1"), ("x", order + "f8"), ("y", order + "f8"), ("z", order + "f8")])
    packed = np.zeros(len(points), kind)
    for axis, column in zip("xyz", points.T, strict=True):
        packed[axis] = column
    skipped = struct.pack(order + "fBiiiBii", 2.5, 3, 0, 1, 2, 2, 5, 6) if before else b""
    return head + skipped + packed.tobytes()


def lzf(data: bytes) -> bytes:
    """Compress as LZF: literals, and references to what repeats at a distance of one value."""
    out, at = bytearray(), 0
    while at < len(data):
        length = 0
        while at >= 4 and length < 264 and at + length < len(data) and data[at + length] == data[at + length - 4]:
            length += 1
        if length >= 3:
            code = length - 2
            out += bytes([min(code, 7) << 5]) + (bytes([code - 7]) if code >= 7 else b"") + bytes([3])
            at += length
        else:
            piece = data[at : at + 4]
            out += bytes([len(piece) - 1]) + piece
            at += len(piece)
    return bytes(out)


def pcd(points: NDArray[np.float64], data: str, width: int, height: int, kind: str = "F 4", head: str = "") -> bytes:
    """Write points as PCD with padding, a field of several values, and a field of another type before them."""
    letter, size = kind.split()
    lines = ["# .PCD v.7 - Point Cloud Data file format", "VERSION .7", "FIELDS label _ x y z normal",
             f"SIZE 2 1 {size} {size} {size} 4", f"TYPE U U {letter} {letter} {letter} F", "COUNT 1 3 1 1 1 2",
             f"WIDTH {width}", f"HEIGHT {height}", head or "VIEWPOINT 0 0 0 1 0 0 0", f"POINTS {len(points)}",
             f"DATA {data}", ""]  # fmt: skip
    code = f"<{letter.lower()}{size}"
    layout = [("label", "<u2"), ("_", "u1", 3), ("x", code), ("y", code), ("z", code), ("normal", "<f4", 2)]
    packed = np.zeros(len(points), layout)
    for axis, column in zip("xyz", points.T, strict=True):
        packed[axis] = column
    header = "\n".join(lines).encode()
    if data == "ascii":
        rows = [f"1 0 0 0 {x:.9g} {y:.9g} {z:.9g} 0 nan \n" for x, y, z in points]
        return header + "".join(rows).encode()
    if data == "binary":
        return header + packed.tobytes()
    fields = b"".join(packed[name].tobytes() for name in ("label", "x", "y", "z", "normal"))
    small = lzf(fields)
    return header + struct.pack("<II", len(small), len(fields)) + small


def check_rendered(seen: Capture) -> None:
    """Points of a rendered cloud lie on the original surfaces, without holes inside."""
    x, y, z = seen.points().T
    column, row = (LENS[0, 0] * x / z + LENS[0, 2]).astype(int), (LENS[1, 1] * y / z + LENS[1, 2]).astype(int)
    inside = (column >= 0) & (column < 128) & (row >= 0) & (row < 96)
    there = image()[row[inside], column[inside]]
    apart = np.abs(there - z[inside])[there > 0]
    assert len(apart) > 0.9 * (image() > 0).sum()
    assert np.quantile(apart, 0.9) < 0.006  # a pixel of the tilted table
    assert np.median(apart) < 0.001
    np.testing.assert_allclose(fit_table(seen.depth, seen.intrinsics), POSE, atol=4e-3)
    filled = seen.depth > 0
    around = np.stack([np.roll(filled, shift, axis) for axis in (0, 1) for shift in (-1, 1)])
    assert (~filled & around.all(axis=0)).sum() == 0


@pytest.mark.parametrize("before", [False, True])
@pytest.mark.parametrize("form", ["ascii", "binary_little_endian", "binary_big_endian"])
def test_ply_is_read(form: str, before: bool, tmp_path: Path) -> None:
    points, path = grid().reshape(-1, 3), tmp_path / "cloud.ply"
    path.write_bytes(ply(points, form, before))
    np.testing.assert_allclose(read_ply(path), points, atol=1e-8)
    seen = read_capture(path)
    check_rendered(seen)
    assert "it is rendered by a camera at its origin" in seen.warnings[0]
    # RealSense looks along -z.
    path.write_bytes(ply(points * [1, -1, -1], form, before))
    turned = read_capture(path)
    np.testing.assert_allclose(turned.depth, seen.depth, atol=1e-8)
    assert "y and z are negated" in turned.warnings[0]


@pytest.mark.parametrize("kind", ["F 4", "F 8", "I 2"])
@pytest.mark.parametrize("data", ["ascii", "binary", "binary_compressed"])
def test_pcd_is_read(data: str, kind: str, tmp_path: Path) -> None:
    points, path = grid(), tmp_path / "cloud.pcd"
    scale = 1.0
    if kind == "I 2":  # millimetres
        points, scale = np.nan_to_num(points * 1000).round(), 0.001
    path.write_bytes(pcd(points.reshape(-1, 3), data, 128, 96, kind))
    np.testing.assert_allclose(read_pcd(path)[0], points, atol=1e-6)
    seen = read_capture(path, depth_scale=scale)
    np.testing.assert_allclose(seen.depth, image(), atol=6e-4 if kind == "I 2" else 1e-6)
    # An organised cloud contains its camera.
    np.testing.assert_allclose(seen.intrinsics, LENS, atol=0.05 if kind == "I 2" else 1e-3)
    assert seen.warnings == ()
    flat = points.reshape(-1, 3)
    path.write_bytes(pcd(flat, data, len(flat), 1, kind, "VIEWPOINT 0 0 1 1 0 0 0"))
    row = read_capture(path, depth_scale=scale)
    check_rendered(row)
    assert "a viewpoint, which is not applied" in row.warnings[0]


def test_old_and_broken_pcd(tmp_path: Path) -> None:
    path = tmp_path / "cloud.pcd"
    points = grid().reshape(-1, 3)
    points = points[np.isfinite(points).all(axis=1)]
    rows = "".join(f"{x:.9g} {y:.9g} {z:.9g}\r\n" for x, y, z in points)
    path.write_text(f"VERSION .5\nCOLUMNS x y z\nPOINTS {len(points)}\nDATA ascii\n{rows}")
    np.testing.assert_allclose(read_pcd(path)[0], points, atol=1e-8)
    good = pcd(points, "binary", len(points), 1)
    packed = pcd(points, "binary_compressed", len(points), 1)
    count = str(len(points)).encode()
    for content, message in (
        (good[:-1], "promises .* points and ends before"),
        (good.replace(b"POINTS " + count, b"POINTS 7"), "states 7 points and"),
        (good.replace(count, b"999999999"), "has 999999999 points; pass 1 to"),
        (good.replace(b"DATA binary", b"DATA binary_zip"), "stores its data as 'binary_zip'"),
        (good.replace(b" x y z ", b" a b c "), "pass points with x, y and z"),
        (good.replace(b"SIZE 2", b"SIZE 3"), "an incomplete header"),
        (packed[:-1], "compressed data that do not fit"),
        (b"# .PCD v.7\nVERSION .7\n", "no complete header"),
    ):
        path.write_bytes(content)
        with pytest.raises(errors.ConfigError, match=message):
            read_capture(path)


def test_broken_ply_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "cloud.ply"
    points = grid().reshape(-1, 3)
    good, text = ply(points), ply(points, "ascii")
    listed = ply(points, before=True)
    for content, message in (
        (good[:-1], "promises 12288 points and ends before"),
        (text[:-200], "holds a line that is not of its points|ends after|ends before"),
        (good.replace(b"vertex 12288", b"vertex 999999999999"), "which PLY does not know|pass 1 to"),
        (good.replace(b"vertex 12288", b"vertex 99999999"), "has 99999999 points; pass 1 to"),
        (good.replace(b"property double x", b"property triple x"), "has the line 'property triple x'"),
        (good.replace(b"property double x", b"property double q"), "pass vertices with x, y and z"),
        (good.replace(b"element vertex", b"element corner"), "has no element 'vertex'"),
        (listed.replace(b"face 2", b"face 999999"), "ends within its element 'face'"),
        (listed.replace(b"face 2", b"face 99999999"), "99999999 lists before its vertices"),
        (b"ply\nformat ascii 1.0\n", "no complete header of PLY"),
    ):
        path.write_bytes(content)
        with pytest.raises(errors.ConfigError, match=message):
            read_capture(path)


def test_arrays_of_points_are_clouds(tmp_path: Path) -> None:
    path, points = tmp_path / "cloud.npy", grid()
    np.save(path, points.astype(np.float32))
    seen = read_capture(path)
    np.testing.assert_allclose(seen.depth, image(), atol=1e-6)
    np.testing.assert_allclose(seen.intrinsics, LENS, atol=1e-3)
    np.testing.assert_allclose(read_capture(path, intrinsics=LENS).intrinsics, LENS, atol=1e-3)
    with pytest.raises(errors.ConfigError, match=r"does not fit the points of .* fx 120\.0, fy 121\.0"):
        read_capture(path, intrinsics=LENS * [[1.1], [1.1], [1.0]])
    # Upside down; a grid that is no image; both as a list of points.
    np.save(path, points * [1, -1, 1])
    with pytest.raises(errors.ConfigError, match="x to the left or y up"):
        read_capture(path)
    mixed = np.random.default_rng(0).permutation(points.reshape(-1, 3))
    np.save(path, mixed.reshape(96, 128, 3))
    seen = read_capture(path)
    check_rendered(seen)
    assert "(its points are not those of a pinhole camera's pixels)" in seen.warnings[0]
    np.save(path, mixed)
    np.testing.assert_array_equal(read_capture(path).depth, seen.depth)
    with pytest.raises(errors.ConfigError, match="is rendered by a camera of its own; pass no intrinsics"):
        read_capture(path, intrinsics=LENS)
    np.save(path, mixed * 1000)
    with pytest.raises(errors.ConfigError, match="perhaps its unit is millimetres"):
        read_capture(path)
    np.testing.assert_allclose(read_capture(path, depth_scale=0.001).depth, seen.depth, atol=1e-9)


@pytest.mark.parametrize("share", [0.2, 0.6])
def test_a_thinned_cloud_has_no_holes(share: float, tmp_path: Path) -> None:
    """The resolution follows the density of the points."""
    path, points = tmp_path / "cloud.npy", grid().reshape(-1, 3)
    points = points[np.isfinite(points).all(axis=1)]
    kept = points[np.random.default_rng(1).random(len(points)) < share]
    np.save(path, kept)
    seen = read_capture(path)
    filled = seen.depth > 0
    around = np.stack([np.roll(filled, shift, axis) for axis in (0, 1) for shift in (-1, 1)])
    assert (~filled & around.all(axis=0)).sum() == 0
    assert seen.intrinsics[0, 0] < 120 * share**0.5
    np.testing.assert_allclose(fit_table(seen.depth, seen.intrinsics)[2], POSE[2], atol=5e-3)
    assert any("the cloud is sparse" in one for one in seen.warnings)


def test_clouds_that_show_nothing_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "cloud.npy"
    thin = np.random.default_rng(2).permutation(grid().reshape(-1, 3)[2000:])[:600]
    cases: list[tuple[Any, str]] = [
        (thin, "are too sparse for a depth image; pass the camera's full cloud"),
        (np.full((20, 3), np.nan), "no pixel with a depth"),
        (np.tile([2.5, 0.0, 0.6], (200, 1)), "0 of 200 points lie before the camera"),
        (grid().reshape(-1, 3)[2000:2030], "30 of 30 points lie before the camera"),
    ]
    for points, message in cases:
        np.save(path, points)
        with pytest.raises(errors.ConfigError, match=message):
            read_capture(path)
