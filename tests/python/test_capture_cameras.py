"""Intrinsics of real cameras from files, and the images of lenses that distort."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from graspbox import errors
from graspbox.captures import read_capture
from graspbox.captures.cameras import camera_of, read_camera
from graspbox.captures.capture import Camera
from graspbox.captures.distortion import MODELS, source_pixels, standard_model, undistorted

FX, FY, CX, CY = 615.5, 616.25, 318.75, 242.5
K = [FX, 0.0, CX, 0.0, FY, CY, 0.0, 0.0, 1.0]
#: In graspbox's convention.
LENS = np.array([[FX, 0.0, CX + 0.5], [0.0, FY, CY + 0.5], [0.0, 0.0, 1.0]])
SIZE = {"width": 640, "height": 480}
INFO = {"distortion_model": "plumb_bob", "binning_x": 0, "binning_y": 0}

#: `ros2 topic echo` of two messages, a number that YAML 1.1 takes for text, and the file of ROS's calibration program.
ECHO = f"""header:
  stamp:
    sec: 1
  frame_id: camera_depth_optical_frame
height: 480
width: 640
distortion_model: plumb_bob
d:
- 0.0
- 0.0
k:
- {FX}
- 0.0
- {CX}
- 0.0
- {FY}
- {CY}
- 0.0
- 0.0
- 1.0
roi:
  x_offset: 0
  do_rectify: false
---
k: [1, 2, 3]
"""
ROS = f"""image_width: 640
image_height: 480
camera_name: depth
camera_matrix:
  rows: 3
  cols: 3
  data: [{FX}, 0, {CX},
         0, {FY}, {CY}, 0, 0, 1]
distortion_model: plumb_bob
distortion_coefficients: {{rows: 1, cols: 5, data: [1e-05, 0, 0, 0, 0]}}
"""
OPENCV = f"""%YAML:1.0
---
image_width: 640
image_height: 480
camera_matrix: !!opencv-matrix
   rows: 3
   cols: 3
   dt: d
   data: [ {FX}e+00, 0., {CX}, 0., {FY}, {CY}, 0., 0., 1. ]
distortion_coefficients: !!opencv-matrix
   rows: 5
   cols: 1
   dt: d
   data: [ 0., 0., 0., 0., 0. ]
"""


@pytest.mark.parametrize(
    ("content", "scale"),
    [
        (json.dumps({**SIZE, **INFO, "k": K, "d": [0.0] * 5}), None),
        (json.dumps({**SIZE, "K": K, "D": []}), None),
        (json.dumps({"camera_info": {**SIZE, "K": [K[:3], K[3:6], K[6:]]}}), None),
        (json.dumps({**SIZE, "fx": FX, "fy": FY, "ppx": CX, "ppy": CY, "coeffs": [0] * 5, "depth_scale": 1e-4}), 1e-4),
        (json.dumps({"depth": {"intrinsics": {**SIZE, "fx": FX, "fy": FY, "cx": CX, "cy": CY}}}), None),
        (json.dumps({**SIZE, "intrinsic_matrix": [FX, 0, 0, 0, FY, 0, CX, CY, 1], "depth_scale": 5000.0}), 1 / 5000),
        (json.dumps({"intrinsic": {**SIZE, "intrinsic_matrix": [FX, 0, 0, 0, FY, 0, CX, CY, 1]}}), None),
        (json.dumps({**SIZE, "cam_K": K, "depth_scale": 0.1}), 1e-4),
        (ECHO, None),
        (ROS, None),
        (OPENCV, None),
        (" ".join(map(str, K)), None),
        ("\n".join(",".join(map(str, K[i : i + 3])) for i in (0, 3, 6)), None),
    ],
)
def test_files_of_every_kind_have_the_same_camera(content: str, scale: float | None, tmp_path: Path) -> None:
    if content[0] not in "{6":
        pytest.importorskip("yaml", reason="YAML needs the extra 'cli'")
    path = tmp_path / "camera"
    path.write_text(content)
    camera = read_camera(path)
    np.testing.assert_allclose(camera.matrix, LENS)
    assert camera.size == ((640, 480) if content[0] != "6" else None)
    assert camera.depth_scale == (None if scale is None else pytest.approx(scale))
    assert camera.coefficients == ((1e-5,) if "1e-05" in content else ())


def test_bop_has_a_camera_for_each_image(tmp_path: Path) -> None:
    path = tmp_path / "scene_camera.json"
    path.write_text(json.dumps({str(n): {"cam_K": [FX + n, *K[1:]], "depth_scale": 0.1 * n} for n in (1, 3)}))
    assert read_camera(path, "000003.png").matrix[0, 0] == FX + 3
    assert read_camera(path, "000003.png").depth_scale == pytest.approx(0.0003)
    with pytest.raises(errors.ConfigError, match=r"intrinsics of 2 images, none of the number of '000002\.png'"):
        read_camera(path, "000002.png")
    np.save(tmp_path / "000003.npy", np.full((480, 640), 2000, dtype=np.uint16))
    seen = read_capture(tmp_path / "000003.npy", intrinsics=path)
    assert seen.depth[0, 0] == pytest.approx(0.6)
    # A scale without a unit is not guessed.
    path.write_text(json.dumps({"fx": FX, "fy": FY, "cx": CX, "cy": CY, "depth_scale": 0.1}))
    seen = read_capture(tmp_path / "000003.npy", intrinsics=path)
    assert seen.depth[0, 0] == pytest.approx(2.0)
    assert "the depth_scale 0.1 of" in seen.warnings[0]


def test_files_without_a_camera_are_refused(tmp_path: Path) -> None:
    pytest.importorskip("yaml", reason="YAML needs the extra 'cli'")
    path = tmp_path / "camera"
    cases: list[tuple[str, str]] = [
        ("{}", "states no intrinsics"),
        ("[1, 2]", "states no intrinsics"),
        ("1 2 3 4", "holds 4 numbers; pass the 9"),
        ("a: [", "neither JSON nor YAML"),
        ("[" * 5000, "states no intrinsics|neither JSON nor YAML"),
        ("\0", "neither JSON nor YAML"),
        (json.dumps({"k": [0.0] * 9}), "is not calibrated: its K is 0"),
        (json.dumps({"k": [*K[:6], 0, 0, 2]}), "whose last row is"),
        (json.dumps({"k": [float("nan"), *K[1:]]}), "not finite"),
        (json.dumps({"fx": "a", "fy": 1, "cx": 1, "cy": 1}), "states no intrinsics"),
        (json.dumps({"k": K, "d": [0.1] * 4, "distortion_model": "odd"}), "has the distortion 'odd' with 4 coeff"),
        (json.dumps({"k": K, "d": [0.1] * 14, "distortion_model": "rational_polynomial"}), "14 coefficients"),
        (json.dumps({"k": K, "d": [float("inf")]}), "not finite"),
        ("x" * (1 << 19), "nor YAML of at most"),
    ]
    for content, message in cases:
        path.write_text(content)
        with pytest.raises(errors.ConfigError, match=message):
            read_camera(path)
    with pytest.raises(errors.FileError, match="no such file of intrinsics"):
        read_camera(tmp_path / "none.json")
    path.write_text(json.dumps({"width": 1280, "height": 720, "k": K}))
    np.save(tmp_path / "depth.npy", np.full((480, 640), 0.6))
    with pytest.raises(errors.ConfigError, match=r"images of 1280 x 720 pixels, and .* has 640 x 480; pass the"):
        read_capture(tmp_path / "depth.npy", intrinsics=path)


def test_the_matrix_follows_the_image() -> None:
    """Rectified images have P, aligned ones no distortion; binning and regions move the centre."""
    p = [600.0, 0, 320, 0, 0, 600.0, 240, 0, 0, 0, 1, 0]
    info: dict[str, Any] = {**SIZE, "k": K, "d": [0.1, 0.01, 0, 0, 0], "p": p, "model": "plumb_bob"}
    assert camera_of(info, "x").coefficients == (0.1, 0.01)
    assert camera_of(info, "x", "aligned").coefficients == ()
    np.testing.assert_allclose(camera_of(info, "x", "aligned").matrix, LENS)
    rectified = camera_of(info, "x", "rectified")
    assert (rectified.matrix[0, 0], rectified.matrix[0, 2], rectified.coefficients) == (600.0, 320.5, ())
    with pytest.raises(errors.ConfigError, match="the second camera of a stereo pair"):
        camera_of({**info, "p": [*p[:3], -30.0, *p[4:]]}, "x", "rectified")
    with pytest.raises(errors.ConfigError, match="has no P, which a rectified image needs"):
        camera_of({**info, "p": [0.0] * 12}, "x", "rectified")
    roi = {"x_offset": 100, "y_offset": 60, "width": 400, "height": 300}
    part = camera_of({**info, "roi": roi, "binning_x": 2, "binning_y": 2}, "x")
    assert part.size == (200, 150)
    # The same ray: pixel (u, v) of the part is (2 u + 100, 2 v + 60) of the full image, corners at integers.
    ray = np.linalg.inv(part.matrix) @ [50.0, 40.0, 1.0]
    np.testing.assert_allclose(ray, np.linalg.inv(LENS) @ [200.0, 140.0, 1.0])


def brown(x: Any, y: Any, k1: float, k2: float, p1: float, p2: float) -> tuple[Any, Any]:
    r2 = x * x + y * y
    f = 1 + k1 * r2 + k2 * r2**2
    return x * f + 2 * p1 * x * y + p2 * (r2 + 2 * x * x), y * f + 2 * p2 * x * y + p1 * (r2 + 2 * y * y)


def plane(x: NDArray[np.float64], y: NDArray[np.float64]) -> NDArray[np.float64]:
    """Depth of a tilted plane along rays."""
    return np.asarray(0.6 / (1 - 0.1 * x + 0.2 * y))


@pytest.mark.parametrize("model", ["plumb_bob", "equidistant", "rational_polynomial", "Inverse Brown Conrady"])
def test_distortion_is_undone(model: str, tmp_path: Path) -> None:
    """A plane seen through the lens, pixel by pixel, becomes that of a pinhole camera."""
    lens = np.array([[300.0, 0, 200.0], [0, 300.0, 150.0], [0, 0, 1]])
    u, v = np.meshgrid((np.arange(400) + 0.5 - 200) / 300, (np.arange(300) + 0.5 - 150) / 300)
    if model == "Inverse Brown Conrady":  # its polynomial leads to the rays
        d: list[float] = [0.15, -0.1, 0.002, 0.001, 0.0]
        x, y = brown(u, v, *d[:4])
    else:
        d = {
            "plumb_bob": [-0.2, 0.05, 0.002, 0.001, 0.0],
            "equidistant": [0.02, -0.01, 0.0, 0.0],
            "rational_polynomial": [-0.2, 0.05, 0.002, 0.001, 0, 0, 0, 0],
        }[model]
        x, y = u.copy(), v.copy()
        for _ in range(100):  # the rays of the pixels
            if model == "equidistant":
                r = np.hypot(x, y)
                a = np.arctan(r)
                bent = a * (1 + 0.02 * a**2 - 0.01 * a**4) / r
                x, y = x + u - x * bent, y + v - y * bent
            else:
                bx, by = brown(x, y, *d[:4])
                x, y = x + u - bx, y + v - by
    np.save(tmp_path / "depth.npy", plane(x, y))
    k = [300.0, 0, 199.5, 0, 300.0, 149.5, 0, 0, 1]
    (tmp_path / "camera.json").write_text(
        json.dumps({"width": 400, "height": 300, "k": k, "d": d, "distortion_model": model})
    )
    things = np.zeros((300, 400), dtype=np.int64)
    things[:, 300:] = 7
    seen = read_capture(tmp_path / "depth.npy", intrinsics=tmp_path / "camera.json", labels=things)
    np.testing.assert_allclose(seen.intrinsics, lens)
    there = seen.depth > 0
    assert there.mean() > 0.6
    # Less than a pixel of the plane; without it several.
    apart = np.abs(seen.depth - plane(u, v))[there]
    assert apart.max() < 0.001
    assert np.abs(plane(x, y) - plane(u, v)).max() > 0.003
    assert "was undone, as for an image as the sensor gives it" in seen.warnings[0]
    assert seen.labels is not None
    # The labels move with the image: their border is on the rays of column 300.
    border = np.argmax(seen.labels[150] == 7)
    assert abs(u[150, border] - x[150, 300]) < 1.5 / 300
    assert border != 300


def test_distortion_that_moves_nothing_changes_nothing() -> None:
    image = np.arange(48.0 * 64).reshape(48, 64)
    lens = np.array([[60.0, 0, 32], [0, 60.0, 24], [0, 0, 1]])
    assert undistorted(Camera(lens, "x", None, "plumb_bob", (1e-4,)), image) is None
    assert standard_model("plumb_bob", (0.0, 0.0), "x") == ("", ())
    assert standard_model("distortion.inverse_brown_conrady", (0.1,), "x")[0] in MODELS
    # Beyond the radius at which it turns back a polynomial would show the image twice.
    column, row, _ = source_pixels(Camera(lens, "x", None, "plumb_bob", (-2.0,)), (48, 64))
    assert column[24, 32] >= 0
    assert (column[:, 0] == -1).all()
    places = (row * 64 + column)[24]
    assert (np.diff(places[places >= 0]) >= 0).all()
