"""Grasps for a user's own depth image: files and their units, the camera's pose, the command, the picture."""

import json
import re
import struct
import zlib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import tiny_policy
from graspbox import errors, object_sets
from graspbox.captures import read_capture
from graspbox.captures.files import read_points, read_pose
from graspbox.meshes.views import ViewPlan, Views, views
from graspbox.perception import add_depth_noise, depth_images
from graspbox.perception.depth_images import (
    camera_over_table,
    check_intrinsics,
    fit_table,
    points_of,
    thinned,
)


def read_depth(path: Path, scale: float | None = None) -> NDArray[np.float64]:
    """Read an image of any size."""
    lens = np.array([[600.0, 0.0, 2.0], [0.0, 600.0, 2.0], [0.0, 0.0, 1.0]])
    return read_capture(path, intrinsics=lens, depth_scale=scale).depth


@pytest.fixture(scope="module")
def seen() -> Views:
    """Render a mug, in an image of another size than policies learn from."""
    mesh = object_sets.load("procedural:mug:3")[0].load()
    plan = ViewPlan("random", axis=(-1.0, 0.0, 1.2), cap=0.2, distance=(0.6, 0.6))
    return views(mesh, plan=plan, count=2, seed=2, image_size=(240, 320), images="depth", fov=0.5)


@pytest.fixture(scope="module")
def depth(seen: Views) -> NDArray[np.float64]:
    return np.asarray(add_depth_noise(seen.depth, seen.intrinsics, 1)[0] / 1000.0)


def test_units_are_recognized(tmp_path: Path, depth: NDArray[np.float64]) -> None:
    cases: list[tuple[Any, float | None, str | None]] = [
        (depth.astype(np.float32), None, None),
        ((depth * 1000).round().astype(np.uint16), None, None),
        ((depth * 10_000).round().astype(np.uint16), 0.0001, None),
        (depth[..., None], None, None),
        ((depth * 1000).astype(np.float32), None, r"perhaps its unit is millimetres \(depth scale 0.001\), which"),
        ((depth * 1000).astype(np.uint16), 1.0, r"perhaps its unit is millimetres \(depth"),
        (depth, 0.001, r"perhaps its unit is metres \(depth scale 1\)"),
        (depth * 100, 0.01, None),
        ((depth * 100).astype(np.float32), None, r"perhaps .* centimetres \(depth scale 0.01\) or inches \(depth sc"),
        ((depth * 100).astype(np.float32), 0.001, r"perhaps .* centimetres \(depth scale 0.01\) or inches"),
        ((depth * 100).astype(np.uint16), None, r"perhaps .* centimetres \(depth scale 0.01\) or inches"),
        (depth / 0.0254, None, r"perhaps .* inches \(depth scale 0.0254\) or centimetres \(depth scale 0.01\)"),
        ((depth * 10_000).astype(np.uint16), None, r"tenths of millimetres \(depth scale 0.0001\)"),
        (depth * 1e9, None, "pass the depth scale, in metres per unit of the image; here it is 1"),
        (depth * 0, None, "no pixel with a depth"),
        (-depth, None, "distances along the optical axis"),
        (depth[:, :, None].repeat(4, axis=2), None, r"one depth image \(H, W\)"),
        (depth, -1.0, "the depth scale is -1"),
    ]
    for number, (values, scale, message) in enumerate(cases):
        path = tmp_path / f"{number}.npy"
        np.save(path, values)
        if message is None:
            np.testing.assert_allclose(read_depth(path, scale), depth, atol=1e-4)
        else:
            with pytest.raises(errors.ConfigError, match=message):
                read_depth(path, scale)
    holes = depth.copy()
    holes[0, :2] = np.nan, np.inf
    np.save(tmp_path / "holes.npy", holes)
    assert read_depth(tmp_path / "holes.npy")[0, :2].tolist() == [0.0, 0.0]
    with pytest.raises(errors.FileError, match=r"^there is no such depth image: .*/missing\.npy$"):
        read_depth(tmp_path / "missing.npy")
    (tmp_path / "text.npy").write_text("text")
    with pytest.raises(errors.ConfigError, match=r"numpy\.save"):
        read_depth(tmp_path / "text.npy")
    # A header that promises more than the file holds, or than fits.
    for shape in ((9000, 9000), (10**9, 10**9)):
        with (tmp_path / "huge.npy").open("wb") as file:
            header = {"descr": "<f4", "fortran_order": False, "shape": shape}
            np.lib.format.write_array_header_1_0(file, header)
        with pytest.raises(errors.ConfigError, match=r"numpy\.save"):
            read_depth(tmp_path / "huge.npy")
    with (tmp_path / "huge.npy").open("ab") as file:
        file.truncate(10**9)
    with pytest.raises(errors.ConfigError, match=r"numpy\.save"):
        read_depth(tmp_path / "huge.npy")


def test_pictures_of_16_bits_are_read(tmp_path: Path, depth: NDArray[np.float64]) -> None:
    image = pytest.importorskip("PIL.Image", reason="pictures need the extra 'cli'")
    image.fromarray((depth * 1000).round().astype(np.uint16)).save(tmp_path / "depth.png")
    np.testing.assert_allclose(read_depth(tmp_path / "depth.png"), depth, atol=1e-9)
    image.fromarray(np.zeros((4, 4), dtype=np.uint8)).save(tmp_path / "grey.png")
    with pytest.raises(errors.ConfigError, match="8 bits per value"):
        read_depth(tmp_path / "grey.png")


@pytest.mark.parametrize("side", [8200, 10_000, 20_000])
def test_a_picture_of_too_many_pixels_is_refused_unread(side: int, tmp_path: Path) -> None:
    """Pillow warns of some and raises for others."""
    image = pytest.importorskip("PIL.Image", reason="pictures need the extra 'cli'")
    image.fromarray(np.ones((4, 4), dtype=np.uint16)).save(tmp_path / "small.png")
    content = bytearray((tmp_path / "small.png").read_bytes())
    content[16:24] = struct.pack(">II", side, side)
    content[29:33] = struct.pack(">I", zlib.crc32(content[12:29]))
    (tmp_path / "large.png").write_bytes(content)
    with pytest.raises(errors.ConfigError, match="has more than 67108864 pixels; pass a smaller image"):
        read_depth(tmp_path / "large.png")


def test_the_table_is_found_in_the_image(seen: Views) -> None:
    for number, clean in enumerate(seen.depth):
        measured = add_depth_noise(clean[None], seen.intrinsics, number)[0] / 1000.0
        true, found = seen.world_from_camera[number], fit_table(measured, seen.intrinsics)
        assert found[2, 3] == pytest.approx(true[2, 3], abs=0.003)
        # Up, as the camera sees it.
        assert np.degrees(np.arccos(np.clip(found[2, :3] @ true[2, :3], -1, 1))) < 0.5
        np.testing.assert_allclose(found[:3, :3] @ found[:3, :3].T, np.eye(3), atol=1e-9)
        # The x axis is where the camera looks.
        assert found[1, 2] == pytest.approx(0.0, abs=1e-9)
        assert found[0, 2] > 0


@pytest.mark.parametrize("roll", [-0.4, 0.0, 1.2])
def test_a_rolled_camera_over_a_plane_is_found(roll: float) -> None:
    true = camera_over_table(0.7, 0.9, roll)
    lens = np.array([[200.0, 0, 80], [0, 200.0, 60], [0, 0, 1.0]])
    columns, rows = np.meshgrid(np.arange(160) + 0.5, np.arange(120) + 0.5)
    rays = np.stack([columns, rows, np.ones_like(rows)], axis=-1) @ np.linalg.inv(lens).T
    depth = -true[2, 3] / (rays @ true[2, :3])
    np.testing.assert_allclose(fit_table(depth, lens), true, atol=1e-6)


def test_a_fine_image_has_the_same_table(seen: Views, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of 8000 x 6000 pixels 40 s were spent on it; a part of them is enough."""
    counts = []

    def counted(*given: Any) -> NDArray[np.float64]:
        points = points_of(*given)
        counts.append(len(points))
        return points

    monkeypatch.setattr(depth_images, "points_of", counted)
    measured = add_depth_noise(seen.depth[:1], seen.intrinsics, 1)[0] / 1000.0
    coarse = fit_table(measured, seen.intrinsics)
    finer = seen.intrinsics * np.array([[6.0], [6.0], [1.0]])
    fine = fit_table(np.kron(measured, np.ones((6, 6))), finer)
    assert counts[0] == np.count_nonzero(measured[::2, ::2])
    assert counts[1] < 40_000
    np.testing.assert_allclose(fine, coarse, atol=1e-3)


def test_what_is_no_table_is_refused() -> None:
    lens = np.array([[200.0, 0, 80], [0, 200.0, 60], [0, 0, 1.0]])
    with pytest.raises(errors.ConfigError, match="as a wall is"):
        fit_table(wall(lens), lens)
    rough = np.random.default_rng(0).uniform(0.3, 3.0, (120, 160))
    with pytest.raises(errors.ConfigError, match="no table was found"):
        fit_table(rough, lens)


def wall(lens: NDArray[np.float64]) -> NDArray[np.float64]:
    """Depth of a wall beside a camera that looks along it."""
    columns = np.arange(160) + 0.5
    slope = (columns - lens[0, 2]) / lens[0, 0]
    return np.tile(np.where(slope > 0.05, 0.3 / np.maximum(slope, 0.05), 0.0), (120, 1))


def test_poses_of_cameras_are_checked(tmp_path: Path) -> None:
    pose = camera_over_table(0.5, np.pi / 2)
    np.testing.assert_allclose(pose[:3, :3] @ [0, 0, 1], [0, 0, -1], atol=1e-12)
    # The upper border of the image is where x points.
    np.testing.assert_allclose(pose[:3, :3] @ [0, -1, 0], [1, 0, 0], atol=1e-12)
    assert np.linalg.det(camera_over_table(0.5, 0.7, 0.3)[:3, :3]) == pytest.approx(1.0)
    np.save(tmp_path / "pose.npy", pose)
    (tmp_path / "pose.json").write_text(json.dumps(pose.tolist()))
    np.savetxt(tmp_path / "pose.txt", pose)
    np.savetxt(tmp_path / "pose.csv", pose, delimiter=",")
    for suffix in ("npy", "json", "txt", "csv"):
        np.testing.assert_allclose(read_pose(tmp_path / f"pose.{suffix}"), pose, atol=1e-12)
    for change, message in (
        (np.eye(4), "lets it look up; pass the camera's pose in the table's frame, not its inverse"),
        (np.diag([2.0, 2.0, 2.0, 1.0]), "not a rigid motion"),
        (np.diag([1.0, 1.0, -1.0, 1.0]), "mirrors"),
        (np.eye(3), "holds 9 numbers"),
    ):
        np.save(tmp_path / "wrong.npy", change)
        with pytest.raises(errors.ConfigError, match=message):
            read_pose(tmp_path / "wrong.npy")
    far = pose.copy()
    far[0, 3] = 1e155
    for text, message in (
        ("{}", "cannot be read as numbers"),
        ("[" * 100_000, "cannot be read as numbers"),
        (f"[{'9' * 400}]", "cannot be read as numbers"),
        ('["x"]', "cannot be read as numbers"),
        (json.dumps(far.tolist()), "pass metres, at most 10000"),
    ):
        (tmp_path / "wrong.json").write_text(text)
        with pytest.raises(errors.ConfigError, match=message):
            read_pose(tmp_path / "wrong.json")
    with pytest.raises(errors.ConfigError, match="height is -1"):
        camera_over_table(-1.0, 1.0)
    with pytest.raises(errors.ConfigError, match="tilt is 120"):
        camera_over_table(1.0, np.radians(120))


def test_intrinsics_of_another_image_are_refused() -> None:
    good = np.array([[300.0, 0, 160], [0, 300.0, 120], [0, 0, 1]])
    assert check_intrinsics(good, (240, 320))[0, 0] == 300.0
    with pytest.raises(errors.ConfigError, match="CX is 160, outside of an image of 128 x 128"):
        check_intrinsics(good, (128, 128))
    with pytest.raises(errors.ConfigError, match=r"focal length is 0\.9"):
        check_intrinsics(np.diag([0.003, 0.003, 1.0]) @ good, (240, 320))
    with pytest.raises(errors.ConfigError, match="shape"):
        check_intrinsics(np.eye(2), (240, 320))


def test_thinning_keeps_the_rays() -> None:
    lens = np.array([[930.0, 0, 401.5], [0, 930.0, 299.0], [0, 0, 1.0]])
    image = np.arange(600 * 800, dtype=np.float64).reshape(600, 800)
    small, scaled, step = thinned(image, lens)
    assert step == 4
    assert small[10, 20] == image[42, 82]
    ray, same = (np.linalg.inv(m) @ p for m, p in ((lens, [82.5, 42.5, 1.0]), (scaled, [20.5, 10.5, 1.0])))
    np.testing.assert_allclose(ray, same, atol=1e-12)


@pytest.fixture(scope="module")
def tiny(tmp_path_factory: pytest.TempPathFactory) -> Path:
    pytest.importorskip("onnx", reason="small networks are made with onnx, from the extra 'dev'")
    pytest.importorskip("onnxruntime", reason="networks run in onnxruntime, from the extra 'onnx'")
    folder = tmp_path_factory.mktemp("policies") / "tiny"
    tiny_policy.make(folder)
    return folder


def test_grasps_are_ranked_and_differ(seen: Views, depth: NDArray[np.float64], tiny: Path) -> None:
    from graspbox.policies.grasp_image import grasp_image

    found = grasp_image(depth, seen.intrinsics, seen.world_from_camera[0], tiny, count=4)
    assert len(found) == 4
    assert (np.diff(found.choice) <= 0).all()
    np.testing.assert_allclose(found.table_from_camera @ found.camera_from_hand, found.table_from_hand, atol=1e-9)
    # Above the table, and within reach of the mug at the origin.
    assert (found.table_from_hand[:, 2, 3] > 0).all()
    assert (np.linalg.norm(found.table_from_hand[:, :2, 3], axis=1) < 0.3).all()
    apart = np.linalg.norm(found.table_from_hand[0, :3, 3] - found.table_from_hand[1:, :3, 3], axis=1)
    turned = np.einsum("nij,ij->n", found.table_from_hand[1:, :3, :3], found.table_from_hand[0, :3, :3])
    assert ((apart >= 0.01) | (np.arccos(np.clip((turned - 1) / 2, -1, 1)) >= 0.26)).all()
    # The same in another frame of the table, and where the region holds the mug.
    turn = np.eye(4)
    turn[:2, :2], turn[:2, 3] = [[0.0, -1.0], [1.0, 0.0]], (0.3, -0.2)
    moved = grasp_image(depth, seen.intrinsics, turn @ seen.world_from_camera[0], tiny, count=4)
    np.testing.assert_allclose(moved.camera_from_hand, found.camera_from_hand, atol=2e-3)
    rows, columns = np.nonzero(found.object)
    step = thinned(depth, seen.intrinsics)[2]
    box = (columns.min() * step - 4, rows.min() * step - 4, columns.max() * step + 5, rows.max() * step + 5)
    within = grasp_image(depth, seen.intrinsics, seen.world_from_camera[0], tiny, region=tuple(int(x) for x in box))  # type: ignore[arg-type]
    assert (within.object == found.object).mean() > 0.999
    with pytest.raises(errors.ConfigError, match="no object rises above the table"):
        grasp_image(depth, seen.intrinsics, seen.world_from_camera[0], tiny, region=(0, 0, 20, 20))
    with pytest.raises(errors.ConfigError, match="the camera's pose does not fit the image: 4% of the image"):
        grasp_image(depth, seen.intrinsics, np.linalg.inv(seen.world_from_camera[0]), tiny)
    with pytest.raises(errors.ConfigError, match="left < right"):
        grasp_image(depth, seen.intrinsics, seen.world_from_camera[0], tiny, region=(20, 0, 10, 20))


def test_grasps_keep_off_what_stands_there(seen: Views, depth: NDArray[np.float64], tiny: Path, tmp_path: Path) -> None:
    """A wall beside the mug, where some of the grasps without it have a finger."""
    from graspbox.policies.grasp_image import ImageGrasper, ImageGrasps

    grasper = ImageGrasper(tiny)
    steps = np.arange(-0.15, 0.15, 0.008)
    wall = np.stack(np.meshgrid([0.06, 0.068], steps, np.arange(0.004, 0.2, 0.008)), axis=-1).reshape(-1, 3)
    grid = grasper._finder.grid

    def touching(found: ImageGrasps) -> int:
        crop = np.linalg.inv(found.table_from_crop)
        poses, points = crop @ found.table_from_hand, wall @ crop[:3, :3].T + crop[:3, 3]
        nothing = np.zeros_like(found.occupancy)
        return int((~grid.meets(nothing, poses, found.preshape, obstacles=points)[0]).sum())

    pose = seen.world_from_camera[0]
    assert touching(grasper.find(depth, seen.intrinsics, pose, count=20)) > 0
    found = grasper.find(depth, seen.intrinsics, pose, count=20, keep_off=wall)
    assert len(found) >= 5
    assert touching(found) == 0
    np.save(tmp_path / "wall.npy", wall)
    np.testing.assert_array_equal(read_points(tmp_path / "wall.npy"), wall)
    for wrong, message in (
        (wall[:, :2], r"shape \(\d+, 2\); pass points \(k, 3\)"),
        (wall * 1000, "has a coordinate of 196; pass metres"),
        (np.full((2, 3), np.nan), "keep_off"),
        ([[0.0, 0.0], [0.0]], "keep_off"),
    ):
        with pytest.raises(errors.ConfigError, match=message):
            grasper.find(depth, seen.intrinsics, pose, keep_off=wrong)
    with pytest.raises(errors.ConfigError, match="pass table_from_camera"):
        grasper.find(depth, seen.intrinsics, keep_off=wall)
    with pytest.raises(errors.FileError, match="there is no such file of points"):
        read_points(tmp_path / "none.npy")


def test_grasps_that_an_arm_reaches_come_first(
    seen: Views, depth: NDArray[np.float64], tiny: Path, tmp_path: Path
) -> None:
    from graspbox.policies.grasp_image import ImageGrasper

    grasper, base = ImageGrasper(tiny), np.eye(4)
    place = (depth, seen.intrinsics, seen.world_from_camera[0])
    base[:3, 3] = -0.1, -0.55, 0.0
    found = grasper.find(*place, count=5, arm="fr3", base=base)
    assert found.reach is not None
    assert len(found) == len(found.reach) == 5
    assert found.reach.reached[0]
    assert (np.diff(found.reach.reached.astype(int)) <= 0).all()
    told = found.to_json()["grasps"][0]["arm"]
    assert (told["name"], told["reached"], len(told["joints"])) == ("fr3", True, 7)
    plain = grasper.find(*place, count=5)
    assert plain.reach is None
    assert "arm" not in plain.to_json()["grasps"][0]
    things = grasper.find_all(*place, count=2, arm="fr3", base=base)
    assert all(one.reach is not None and len(one.reach) == len(one) for one in things.grasps.values())
    base[0, 3] = -3.0
    far = grasper.find(*place, count=5, arm="fr3", base=base)
    assert far.reach is not None
    assert not far.reach.reached.any()
    assert re.search(r"the arm fr3 reaches none of \d+ grasps: too far \(\d+\); move its base", far.warnings[-1])
    base[2, 3] = -1.0
    with pytest.raises(errors.ConfigError, match=r"the base of the arm is at z = -1.000 m, under the table"):
        grasper.find_all(*place, arm="fr3", base=base)
    with pytest.raises(errors.ArmError, match=r'weighs .* kg, but arm "so101" carries 0.20 kg'):
        grasper.find(*place, arm="so101", base=np.eye(4))
    with pytest.raises(errors.ConfigError, match="an arm needs its place: pass base"):
        grasper.find(*place, arm="fr3")
    with pytest.raises(errors.ConfigError, match="base, mount and joints place an arm; pass arm too"):
        grasper.find(*place, base=base)
    with pytest.raises(errors.ConfigError, match="base is in the table's frame, which a table found in the image"):
        grasper.find(*place[:2], arm="fr3", base=base)


@pytest.mark.parametrize(("height", "tilt"), [(0.035, 0.0), (-0.035, 0.0), (0.0, 3.0), (0.0, -3.0), (0.02, 1.0)])
def test_a_pose_that_is_a_little_wrong_is_corrected(
    height: float, tilt: float, seen: Views, depth: NDArray[np.float64], tiny: Path
) -> None:
    """It was refused at 2 cm and 2 degrees, before it was corrected."""
    from graspbox.policies.grasp_image import grasp_image

    true = np.asarray(seen.world_from_camera[0])
    c, s = np.cos(np.radians(tilt)), np.sin(np.radians(tilt))
    wrong = true @ np.array([[1, 0, 0, 0], [0, c, -s, 0], [0, s, c, 0], [0, 0, 0, 1]])
    wrong[2, 3] += height
    found = grasp_image(depth, seen.intrinsics, wrong, tiny)
    assert abs(found.table_from_camera[2, 3] - true[2, 3]) < 0.003
    assert np.degrees(np.arccos(found.table_from_camera[2, :3] @ true[2, :3])) < 0.5
    with pytest.raises(errors.ConfigError, match="does not fit the image"):
        grasp_image(depth, seen.intrinsics, wrong + np.array([[0], [0], [0.1], [0]]) * np.eye(4)[3], tiny)


def test_the_table_is_searched_for_where_no_pose_is_given(seen: Views, depth: NDArray[np.float64], tiny: Path) -> None:
    from graspbox.policies.grasp_image import grasp_image

    found = grasp_image(depth, seen.intrinsics, None, tiny)
    pose = fit_table(depth, seen.intrinsics)
    np.testing.assert_array_equal(
        found.table_from_hand, grasp_image(depth, seen.intrinsics, pose, tiny).table_from_hand
    )


def test_a_scorer_that_gives_nan_is_refused(seen: Views, depth: NDArray[np.float64], tmp_path: Path) -> None:
    """Such numbers are no rank, and JSON does not hold them."""
    pytest.importorskip("onnxruntime", reason="networks run in onnxruntime, from the extra 'onnx'")
    from graspbox.policies.grasp_image import grasp_image

    tiny_policy.make(tmp_path)
    tiny_policy.give_nan(tmp_path, "scorer", "secure")
    with pytest.raises(errors.ConfigError, match=r"scorer\.onnx: output 'secure' is not finite"):
        grasp_image(depth, seen.intrinsics, seen.world_from_camera[0], tmp_path)


def test_the_command_writes_grasps_and_a_picture(
    seen: Views, depth: NDArray[np.float64], tiny: Path, tmp_path: Path
) -> None:
    pytest.importorskip("typer", reason="the command line needs the extra 'cli'")
    image = pytest.importorskip("PIL.Image")
    from command_line import invoke

    np.save(tmp_path / "depth.npy", (depth * 1000).round().astype(np.uint16))
    np.save(tmp_path / "pose.npy", seen.world_from_camera[0])
    lens = [str(seen.intrinsics[i, j]) for i, j in ((0, 0), (1, 1), (0, 2), (1, 2))]
    words = ["grasp-image", str(tmp_path / "depth.npy"), "--policy", str(tiny), "--intrinsics", *lens, "--count", "2"]
    out, picture = tmp_path / "grasps.json", tmp_path / "grasps.png"
    result = invoke([*words, "--out", str(out), "--picture", str(picture)])
    assert result.exit_code == 0, result.output
    written = json.loads(out.read_text())
    assert [grasp["rank"] for grasp in written["grasps"]] == [1, 2]
    assert written["policy"] == "tiny"
    with image.open(picture) as opened:
        pixels = np.asarray(opened.convert("RGB"))
    assert pixels.shape[0] > 400
    # The best grasp is drawn in green.
    assert (np.abs(pixels.astype(int) - [0, 158, 115]).sum(axis=2) < 20).sum() > 50
    posed = invoke([*words, "--camera-pose", str(tmp_path / "pose.npy"), "--json"])
    assert posed.exit_code == 0
    pose = np.array(json.loads(posed.stdout)["table_from_camera"])
    np.testing.assert_allclose(pose, seen.world_from_camera[0])
    both = invoke([*words, "--camera-pose", str(tmp_path / "pose.npy"), "--camera-height", "1"])
    assert isinstance(both.exception, errors.ConfigError)
    erring = invoke([*words, "--hand-error", "6", "6", "--json"])
    choices = [grasp["choice"] for grasp in json.loads(erring.stdout)["grasps"]]
    assert choices == sorted(choices, reverse=True)
    assert choices != [grasp["choice"] for grasp in written["grasps"]]
    huge = invoke([*words, "--hand-error", "600", "6"])
    assert "the hand's error is 600 mm and 6 degrees; pass 0 to 50 mm" in str(huge.exception)
    armed = [*words, "--camera-pose", str(tmp_path / "pose.npy"), "--arm", "fr3"]
    reached = invoke([*armed, "--base", "-0.1", "-0.55", "0", "90", "--json"])
    assert json.loads(reached.stdout)["grasps"][0]["arm"]["reached"]
    far = invoke([*armed, "--base", "-3", "0", "0", "0"])
    assert far.exit_code == 1
    assert "the arm fr3 reaches no grasp of the object" in far.output
    half = invoke([*words, "--tilt", "30"])
    assert "needs both --camera-height and --tilt" in str(half.exception)


def test_the_command_reads_what_cameras_write(
    seen: Views, depth: NDArray[np.float64], tiny: Path, tmp_path: Path
) -> None:
    """A cloud instead of an image, a file of the camera instead of numbers, one of several labels, limits."""
    pytest.importorskip("typer", reason="the command line needs the extra 'cli'")
    from command_line import invoke

    options = ["--policy", str(tiny), "--count", "2", "--json"]
    np.save(tmp_path / "depth.npy", depth)
    lens = seen.intrinsics
    k = [lens[0, 0], 0.0, lens[0, 2] - 0.5, 0.0, lens[1, 1], lens[1, 2] - 0.5, 0.0, 0.0, 1.0]
    (tmp_path / "info.json").write_text(json.dumps({"width": 320, "height": 240, "k": k}))
    words = ["grasp-image", str(tmp_path / "depth.npy"), *options, "--camera-info", str(tmp_path / "info.json")]
    by_file = invoke(words)
    assert by_file.exit_code == 0, by_file.output
    numbers = [str(lens[i, j]) for i, j in ((0, 0), (1, 1), (0, 2), (1, 2))]
    by_numbers = invoke(["grasp-image", str(tmp_path / "depth.npy"), *options, "--intrinsics", *numbers])
    found, same = json.loads(by_file.stdout), json.loads(by_numbers.stdout)
    np.testing.assert_allclose(found["grasps"][0]["camera_from_hand"], same["grasps"][0]["camera_from_hand"], atol=1e-6)
    # Warnings of the source are printed, and in the result.
    points = points_of(depth, lens)
    np.save(tmp_path / "cloud.npy", points * [1, -1, -1])
    cloud = invoke(["grasp-image", str(tmp_path / "cloud.npy"), *options])
    assert cloud.exit_code == 0, cloud.output
    warnings = json.loads(cloud.stdout)["warnings"]
    assert "y and z are negated" in warnings[0]
    assert f"warning: {warnings[0]}" in cloud.stderr
    things = np.zeros(depth.shape, dtype=np.int64)
    things[:120], things[120:] = 4, 9
    np.save(tmp_path / "things.npy", things)
    for added, message in (
        (["--mask", str(tmp_path / "things.npy")], "holds the labels 4, 9; choose one by --label"),
        (["--mask", str(tmp_path / "things.npy"), "--label", "5"], "has the label 5; choose from 4, 9"),
        (["--label", "5"], "--label chooses an object of --mask"),
        (["--intrinsics", *numbers], "both state the intrinsics; pass one"),
        (["--limits", "2", "3"], "no depth within the limits"),
        (["--topic", "/depth"], "is no recording"),
        (["--time", "1"], "is no recording"),
    ):
        assert message in str(invoke([*words, *added]).exception)
