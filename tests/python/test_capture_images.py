"""Depth images of real cameras from files: every kind, its refusals, masks and labels, limits."""

import json
import struct
import sys
import zipfile
import zlib
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pytest
from numpy.typing import NDArray

from graspbox import errors
from graspbox.captures import Capture, read_capture
from graspbox.captures.files import read_image, read_labels
from graspbox.evaluation.captures import Capture as JudgedCapture
from graspbox.perception.depth_images import metric_depth

LENS = np.array([[60.0, 0.0, 32.2], [0.0, 61.0, 23.9], [0.0, 0.0, 1.0]])


def scene() -> NDArray[np.float64]:
    """Make a tilted plane (48, 64), whole millimetres, and pixels without a depth."""
    rows, columns = np.mgrid[:48, :64]
    depth = np.round(0.5 + 0.003 * rows + 0.001 * columns, 3)
    depth[:2, :3] = 0.0
    return np.asarray(depth, dtype=np.float64)


def shifted(right: float, down: float) -> NDArray[np.float64]:
    """Return the intrinsics with another principal point."""
    lens = LENS.copy()
    lens[:2, 2] += right, down
    return lens


def png(values: NDArray[Any], colour: int, depth: int) -> bytes:
    """Write a PNG by hand: Pillow writes no 16-bit colours."""
    rows = b"".join(b"\0" + row.astype(f">u{depth // 8}").tobytes() for row in values)

    def chunk(name: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(name + data))

    header = struct.pack(">IIBBBBB", values.shape[1], values.shape[0], depth, colour, 0, 0, 0)
    end = chunk(b"IDAT", zlib.compress(rows)) + chunk(b"IEND", b"")
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + end


def tiff(values: NDArray[Any], order: Literal["<", ">"] = "<", pages: int = 1, channels: int = 1) -> bytes:
    """Write a TIFF of one strip by hand: with any type of numbers and several pages."""
    data = values.astype(values.dtype.newbyteorder(order)).tobytes()
    numbers = {"u": 1, "i": 2, "f": 3}[values.dtype.kind]
    tags = [(256, values.shape[1]), (257, values.shape[0]), (258, 8 * values.dtype.itemsize), (259, 1), (262, 1),
            (273, 8), (277, channels), (278, values.shape[0]), (279, len(data)), (339, numbers)]  # fmt: skip
    content = (b"II" if order == "<" else b"MM") + struct.pack(order + "HI", 42, 8 + len(data)) + data
    for page in range(pages):
        entries = b"".join(struct.pack(order + "HHII", tag, 4, 1, value) for tag, value in tags)
        after = 0 if page == pages - 1 else len(content) + 6 + len(entries)
        content += struct.pack(order + "H", len(tags)) + entries + struct.pack(order + "I", after)
    return content


def test_arrays_of_every_type_are_read(tmp_path: Path) -> None:
    depth = scene()
    millimetres = (depth * 1000).round()
    for number, values in enumerate(
        (depth, depth.astype(">f4"), depth[..., None], millimetres.astype(np.uint16), millimetres.astype(">i4"))
    ):
        np.save(tmp_path / f"{number}.npy", values)
        np.savez_compressed(tmp_path / f"{number}.npz", picture=values)
        for suffix in ("npy", "npz"):
            seen = read_capture(tmp_path / f"{number}.{suffix}", intrinsics=LENS)
            np.testing.assert_allclose(seen.depth, depth, atol=1e-6)
            np.testing.assert_array_equal(seen.intrinsics, LENS)
            assert (seen.warnings, seen.source) == ((), str(tmp_path / f"{number}.{suffix}"))
            assert len(seen.points()) == (depth > 0).sum()
    # Its intrinsics have the centre of the first pixel at (0, 0).
    np.savez(tmp_path / "both.npz", depth=depth, K=LENS, color=np.zeros((48, 64, 3)))
    moved = shifted(0.5, 0.5)
    np.testing.assert_array_equal(read_capture(tmp_path / "both.npz").intrinsics, moved)
    np.testing.assert_array_equal(read_capture(tmp_path / "both.npz", intrinsics=LENS).intrinsics, LENS)


def test_archives_that_are_no_image_are_refused(tmp_path: Path) -> None:
    def refused(message: str) -> None:
        with pytest.raises(errors.ConfigError, match=message):
            read_capture(tmp_path / "x.npz", intrinsics=LENS)

    np.savez(tmp_path / "x.npz", a=scene(), b=scene())
    refused(r"holds 2 arrays \(a, b\); name the image depth, and its intrinsics K")
    np.savez(tmp_path / "x.npz", a=np.array([{}], dtype=object))
    refused("holds Python objects; save arrays of numbers alone")
    with zipfile.ZipFile(tmp_path / "x.npz", "w") as archive, archive.open("depth.npy", "w") as file:
        np.lib.format.write_array_header_1_0(file, {"descr": "<f4", "fortran_order": False, "shape": (10**5, 10**5)})
    refused("promises an array")
    with zipfile.ZipFile(tmp_path / "x.npz", "w") as archive:
        archive.writestr("depth.npy", b"text")
    refused("cannot be read as an archive of arrays")
    content = bytearray((tmp_path / "x.npz").read_bytes())
    content[8] = content[content.index(b"PK\1\2") + 10] = 93
    (tmp_path / "x.npz").write_bytes(content)
    refused("compressed by a method")
    np.savez(tmp_path / "x.npz", depth=scene(), K=np.eye(2))
    refused("K of .* pass intrinsics")


def test_pictures_are_read_as_they_are(tmp_path: Path) -> None:
    image = pytest.importorskip("PIL.Image", reason="pictures need the extra 'cli'")
    depth = scene()
    millimetres = (depth * 1000).round()
    image.fromarray(millimetres.astype(np.uint16)).save(tmp_path / "depth.png")
    np.testing.assert_allclose(read_capture(tmp_path / "depth.png", intrinsics=LENS).depth, depth, atol=1e-9)
    # As the TUM data sets: 1/5000 m; and a name that does not tell the kind.
    (tmp_path / "tum").write_bytes(png((depth * 5000).round(), 0, 16))
    seen = read_capture(tmp_path / "tum", intrinsics=LENS, depth_scale=1 / 5000)
    np.testing.assert_allclose(seen.depth, depth, atol=1e-9)
    colours = np.repeat(millimetres, 3, axis=1)
    for colour, values in ((2, colours), (4, np.repeat(millimetres, 2, axis=1))):
        content = bytearray(png(values, colour, 16))
        content[16:20] = struct.pack(">I", 64)
        content[29:33] = struct.pack(">I", zlib.crc32(content[12:29]))
        (tmp_path / "colours.png").write_bytes(content)
        for read in (lambda path: read_capture(path, intrinsics=LENS), read_labels):
            with pytest.raises(errors.ConfigError, match="16 bits per value in several channels; save the channel"):
                read(tmp_path / "colours.png")
    image.fromarray(np.full((48, 64), 9, dtype=np.uint8)).save(tmp_path / "grey.png")
    with pytest.raises(errors.ConfigError, match="with 8 bits per value"):
        read_capture(tmp_path / "grey.png", intrinsics=LENS)


@pytest.mark.parametrize("order", ["<", ">"])
def test_tiff_of_one_page_is_read(order: Literal["<", ">"], tmp_path: Path) -> None:
    pytest.importorskip("PIL.Image", reason="pictures need the extra 'cli'")
    depth, path = scene(), tmp_path / "depth.tiff"
    metres = depth.astype(np.float32)
    metres[0, 0] = np.nan
    for values in ((depth * 1000).round().astype(np.uint16), (depth * 1000).round().astype(np.int32), metres):
        path.write_bytes(tiff(values, order))
        np.testing.assert_allclose(read_capture(path, intrinsics=LENS).depth, depth, atol=1e-6)
    for content, message in (
        (tiff(depth, order), "floating-point numbers of 64 bits; read it with the package tifffile"),
        (tiff(depth.astype(np.float16), order), "floating-point numbers of 16 bits"),
        (tiff(metres, order, pages=2), r"several pages, of which one is the image; .*key=0"),
        (tiff(metres, order, channels=3), "3 channels"),
        (tiff((depth * 100).astype(np.uint8), order), "8 bits per value"),
        (tiff(metres, order)[:-30], "ends within its header"),
    ):
        path.write_bytes(content)
        with pytest.raises(errors.ConfigError, match=message):
            read_capture(path, intrinsics=LENS)
        with pytest.raises(errors.ConfigError, match=r"is a TIFF file; read it with graspbox\.captures\.read_capture"):
            read_image(path, "mask")


def test_exr_channels_of_depth_are_found(tmp_path: Path) -> None:
    exr = pytest.importorskip("OpenEXR", reason="EXR files need the extra 'exr'")
    depth, path = scene(), str(tmp_path / "depth.exr")
    header = {"compression": exr.ZIP_COMPRESSION, "type": exr.scanlineimage}
    metres = depth.astype(np.float32)
    for channels in (
        {"Z": metres},
        {"depth.Z": metres, "R": 2 * metres},
        {"V": metres},
        {"Y": metres},
        dict.fromkeys("RGB", metres),
        {"Z": metres.astype(np.float16)},
    ):
        exr.File(header, channels).write(path)
        np.testing.assert_allclose(read_capture(path, intrinsics=LENS).depth, depth, atol=5e-4)
    parts = [exr.Part({"name": name}, {channel: metres}) for name, channel in (("colour", "R"), ("depth", "Z"))]
    exr.File(parts).write(path)
    np.testing.assert_allclose(read_capture(path, intrinsics=LENS).depth, depth, atol=1e-6)
    # A part of the full image, behind which a renderer saw nothing.
    window = {
        **header,
        "dataWindow": (np.array([10, 5], np.int32), np.array([73, 52], np.int32)),
        "displayWindow": (np.array([0, 0], np.int32), np.array([99, 79], np.int32)),
    }
    metres[5, 5] = 1e10
    exr.File(window, {"Z": metres}).write(path)
    full = shifted(10.0, 5.0)
    seen = read_capture(path, intrinsics=full)
    np.testing.assert_allclose(seen.intrinsics, LENS)
    assert seen.depth[5, 5] == 0.0
    assert len(seen.warnings) == 2
    exr.File(header, {"R": metres, "G": 2 * metres, "B": metres}).write(path)
    with pytest.raises(errors.ConfigError, match="has the channels B, G, R, of which none is a depth; name it Z"):
        read_capture(path, intrinsics=LENS)
    Path(path).write_bytes(b"v/1\x01" + bytes(50))
    with pytest.raises(errors.ConfigError, match="cannot be read as OpenEXR"):
        read_capture(path, intrinsics=LENS)


def test_files_of_other_kinds_are_named(tmp_path: Path) -> None:
    """They were called pickled data, with the advice `allow_pickle`."""
    for name, content, message in (
        ("a.jpg", b"\xff\xd8\xff\xe0", "is a JPEG picture, with 8 changed bits"),
        ("a.mkv", b"\x1aE\xdf\xa3", "ffmpeg -i"),
        ("a.oni", b"NI10", "OpenNI"),
        ("a.sens", b"\4\0\0\0", "SensReader"),
        ("a.zdf", b"\0", "Zivid Studio"),
        ("a.h5", b"\x89HDF\r\n\x1a\n", "HDF5"),
        ("a.npy", b"text", r"numpy\.save"),
        ("empty", b"", r"numpy\.save"),
    ):
        (tmp_path / name).write_bytes(content)
        for read in (read_labels, lambda path: read_capture(path, intrinsics=LENS)):
            with pytest.raises(errors.ConfigError, match=message) as raised:
                read(tmp_path / name)
            assert "pickle" not in str(raised.value)
    np.savez(tmp_path / "one.npz", depth=scene())
    with pytest.raises(errors.ConfigError, match=r"an archive of arrays \(\.npz\); read it with"):
        read_labels(tmp_path / "one.npz")
    with pytest.raises(errors.ConfigError, match=r"has shape \(50, 3\), points rather than an image"):
        metric_depth(np.full((50, 3), -0.3))
    with pytest.raises(errors.FileError, match="there is no such depth image"):
        read_capture(tmp_path / "missing.npy", intrinsics=LENS)
    with pytest.raises(errors.ConfigError, match=r"is a folder without metadata\.yaml"):
        read_capture(tmp_path, intrinsics=LENS)


def test_sizes_units_and_arguments_are_checked(tmp_path: Path) -> None:
    path = tmp_path / "depth.npy"
    np.save(path, scene())
    cases: list[tuple[dict[str, Any], str]] = [
        ({}, r"has no intrinsics; pass them: FX FY CX CY of this image \(--intrinsics\)"),
        ({"intrinsics": LENS * 3}, "CX is 96.6, outside"),
        ({"intrinsics": np.eye(2)}, "pass a finite 3x3 matrix"),
        ({"intrinsics": LENS, "depth_scale": 0.001}, "perhaps its unit is metres"),
        ({"intrinsics": LENS, "topic": "/depth"}, "is no recording"),
        ({"intrinsics": LENS, "limits": (2.0, 3.0)}, r"no depth within the limits .* depths are 0.5\d* to 0.7\d* m"),
        ({"intrinsics": LENS, "limits": (2.0, 1.0)}, "pass the nearest and the farthest depth"),
        ({"intrinsics": LENS, "region": (0, 0, 65, 4)}, "left < right <= 64"),
        ({"intrinsics": LENS, "mask": np.ones((4, 4), bool)}, r"pass \(48, 64\), as the image"),
        ({"intrinsics": LENS, "camera_pose": np.eye(4)}, "lets it look up"),
    ]
    for settings, message in cases:
        with pytest.raises(errors.ConfigError, match=message):
            read_capture(path, **settings)
    seen = read_capture(path, intrinsics=LENS, limits=(0.55, 0.6), region=(0, 0, 64, 30))
    kept = (scene() >= 0.55) & (scene() <= 0.6)
    kept[30:] = False
    np.testing.assert_array_equal(seen.depth, np.where(kept, scene(), 0.0))


def test_masks_and_labels_choose_things(tmp_path: Path) -> None:
    image = pytest.importorskip("PIL.Image", reason="pictures need the extra 'cli'")
    path = tmp_path / "depth.npy"
    np.save(path, scene())
    things = np.zeros((48, 64), dtype=np.uint8)
    things[10:20, 10:20], things[30:40, 30:50] = 3, 200
    palette = image.fromarray(things)
    palette.putpalette([*range(255, -1, -1)] * 3)
    palette.save(tmp_path / "things.png")
    with image.open(tmp_path / "things.png") as opened:
        assert opened.mode == "P"
    np.testing.assert_array_equal(read_labels(tmp_path / "things.png"), things)
    seen = read_capture(path, intrinsics=LENS, labels=tmp_path / "things.png")
    assert seen.labels is not None
    np.testing.assert_array_equal(seen.labels, things)
    np.testing.assert_array_equal(seen.mask(200), things == 200)
    assert len(seen.points(seen.mask(3))) == 100
    for label, message in ((7, r"has the label 7; choose from 3, 200"), (None, "are 3, 200; choose one of them")):
        with pytest.raises(errors.ConfigError, match=message):
            seen.mask(label)
    with pytest.raises(errors.ConfigError, match="holds the labels 3, 200; choose one by --label"):
        read_capture(path, intrinsics=LENS, mask=tmp_path / "things.png")
    with pytest.raises(errors.ConfigError, match="pass one of them"):
        read_capture(path, intrinsics=LENS, mask=things > 0, labels=things)
    np.save(tmp_path / "one.npy", things == 3)
    marked = read_capture(path, intrinsics=LENS, mask=tmp_path / "one.npy")
    np.testing.assert_array_equal(marked.mask(), things == 3)
    with pytest.raises(errors.ConfigError, match="has no labels"):
        Capture(seen.depth, seen.intrinsics).mask()


def test_judged_captures_are_read_by_it(tmp_path: Path) -> None:
    image = pytest.importorskip("PIL.Image", reason="pictures need the extra 'cli'")
    np.save(tmp_path / "depth.npy", scene())
    described = {"intrinsics": {"fx": 60.0, "fy": 61.0, "cx": 31.7, "cy": 23.4}, "width": 64, "camera": "toy"}
    (tmp_path / "capture.json").write_text(json.dumps(described))
    things = np.zeros((48, 64), dtype=np.uint8)
    things[10:20, 10:20] = 5
    image.fromarray(things).save(tmp_path / "labels.png")
    seen = JudgedCapture.read(tmp_path)
    np.testing.assert_allclose(seen.intrinsics, LENS)
    np.testing.assert_array_equal(seen.depth, scene())
    assert (seen.camera, seen.things, len(seen.points(seen.mask(5)))) == ("toy", (5,), 100)
    (tmp_path / "capture.json").write_text(json.dumps({**described, "height": 50}))
    with pytest.raises(errors.ConfigError, match=r"images of 64 x 50 pixels, and .* has 64 x 48"):
        JudgedCapture.read(tmp_path)


@pytest.mark.parametrize(
    ("name", "content", "module", "extra"),
    [("a.exr", b"v/1\x01", "OpenEXR", "exr"), ("a.bag", b"#ROSBAG V2.0\n", "rosbags.highlevel", "recordings")],
)
def test_a_missing_package_is_named(
    name: str, content: bytes, module: str, extra: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / name).write_bytes(content)
    monkeypatch.setitem(sys.modules, module, None)
    with pytest.raises(errors.MissingExtraError, match=rf"graspbox\[{extra}\]"):
        read_capture(tmp_path / name)
