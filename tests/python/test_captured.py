"""What a depth image shows besides one thing: noise, neighbours, walls, a cut background; and real captures."""

import json
import re
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import graspbox
from graspbox.errors import ConfigError
from graspbox.evaluation.captures import Capture, captures_in, depth_inside, judge_captures, summary
from graspbox.hands import load_hand
from graspbox.perception.captured import look, survey, things
from graspbox.perception.configs import CropConfig
from graspbox.perception.depth_images import camera_over_table, check_intrinsics, check_table, fit_table
from graspbox.perception.depth_views import DepthView

REPOSITORY = Path(__file__).parents[2]
CAPTURES = REPOSITORY / "tests" / "captures"
LENS = np.array([[300.0, 0.0, 160.0], [0.0, 300.0, 120.0], [0.0, 0.0, 1.0]])
CROP = CropConfig()


def boxes(*rows: tuple[float, float, float, float], pose: NDArray[np.float64]) -> NDArray[np.float64]:
    """Render square boxes (x, y, half side, height) on a table, depth (240, 320), metres."""
    columns, lines = np.meshgrid(np.arange(320) + 0.5, np.arange(240) + 0.5)
    rays = np.stack([columns, lines, np.ones_like(lines)], axis=-1) @ np.linalg.inv(LENS).T @ pose[:3, :3].T
    start = pose[:3, 3]
    depth = -start[2] / rays[..., 2]
    for x, y, half, height in rows:
        low, high = np.array([x - half, y - half, 0.0]), np.array([x + half, y + half, height])
        ends = np.sort(np.stack([(low - start) / rays, (high - start) / rays]), axis=0)
        enter, leave = ends[0].max(axis=-1), ends[1].min(axis=-1)
        hit = (enter < leave) & (enter > 0)
        depth = np.where(hit, np.minimum(depth, np.where(hit, enter, np.inf)), depth)
    return np.where((depth > 0) & (depth < 5.0), depth, 0.0)


#: A camera 0.7 m away that looks at the table's middle from the side of negative x.
POSE = camera_over_table(0.5, 0.75)
MIDDLE = 0.5 / np.tan(0.75)


def scene(*rows: tuple[float, float, float, float]) -> DepthView:
    return DepthView(boxes(*((x + MIDDLE, y, half, height) for x, y, half, height in rows), pose=POSE), LENS, POSE)


def test_specks_are_no_things() -> None:
    view = scene((0.0, 0.0, 0.03, 0.08))
    depth = np.array(view.depth)
    for row, column in ((200, 60), (210, 250), (60, 40)):
        depth[row : row + 4, column : column + 4] -= 0.02
    labels = things(DepthView(depth, LENS, POSE), CROP).labels
    assert labels.max() == 1
    assert labels[120, 160] == 1


def test_noise_far_away_is_no_thing() -> None:
    """It is as deep below the table as it is high: here bumps and dips of 7 mm at 1 m."""
    pose = camera_over_table(0.8, 0.9)
    depth = boxes((0.8 / np.tan(0.9), 0.0, 0.04, 0.1), pose=pose)
    depth[20:40, 20:300] -= 0.009
    assert things(DepthView(depth, LENS, pose), CROP).labels[20:40].any()
    depth[40:60, 20:300] += 0.009
    labels = things(DepthView(depth, LENS, pose), CROP).labels
    assert not labels[20:40].any()
    assert labels[120, 160] == 1


@pytest.mark.filterwarnings("error")
def test_tiny_depths_are_no_division_by_zero() -> None:
    view = scene((0.0, 0.0, 0.03, 0.08))
    depth = np.array(view.depth)
    depth[:40] = 1e-30
    assert things(DepthView(depth, LENS, POSE), CROP).labels.max() >= 1


def test_the_crop_lies_around_the_mask() -> None:
    view = scene((0.0, 0.0, 0.05, 0.08), (0.05, 0.3, 0.02, 0.05))
    labels = things(view, CROP).labels
    assert labels.max() == 2
    small = labels == 2
    found = look(survey(view, CROP), CROP, mask=small)
    assert np.linalg.norm(found.seen.crops.world_from_crop[0, :2, 3] - (MIDDLE + 0.05, 0.3)) < 0.03
    np.testing.assert_array_equal(found.object, small)
    # Without a mask the larger one near the middle is taken, and the other is an obstacle for both.
    other = look(survey(view, CROP), CROP)
    np.testing.assert_array_equal(other.object, labels == 1)
    assert (np.linalg.norm(other.keep_off[:, :2] - (MIDDLE + 0.05, 0.3), axis=1) < 0.04).all()
    assert (np.linalg.norm(found.keep_off[:, :2] - (MIDDLE, 0.0), axis=1) < 0.08).all()
    assert found.warnings == other.warnings == ()


def test_a_thing_that_the_border_cuts_comes_last() -> None:
    """A wall or the robot is larger than what lies on the table."""
    view = scene((0.0, 0.0, 0.03, 0.08), (0.1, 0.55, 0.3, 0.4))
    found = look(survey(view, CROP), CROP)
    assert found.object[120, 160]
    assert not found.object[:, :2].any()
    alone = look(survey(scene((0.1, 0.55, 0.3, 0.4)), CROP), CROP)
    assert any("the image's border cuts" in warning for warning in alone.warnings)
    assert any("extends over" in warning for warning in alone.warnings)


def test_an_object_alone_needs_a_pose() -> None:
    view = scene((0.0, 0.0, 0.03, 0.08))
    cut = np.where(things(view, CROP).labels == 1, np.asarray(view.depth), 0.0)
    found = look(survey(DepthView(cut, LENS, POSE), CROP, pose_given=True), CROP)
    assert found.object.sum() > 100
    assert any("cannot be checked" in warning for warning in found.warnings)
    # So does a thing that is as low as noise.
    low = scene((0.0, 0.0, 0.04, 0.007))
    own = np.linalg.norm(np.indices((240, 320)) - np.array([[[120]], [[160]]]), axis=0) < 12
    shown = DepthView(np.where(own, np.asarray(low.depth), 0.0), LENS, POSE)
    flat = look(survey(shown, CROP, pose_given=True), CROP)
    assert flat.object.sum() == own.sum()
    assert any("all that the image shows" in warning for warning in flat.warnings)
    raised = POSE.copy()
    raised[2, 3] += 0.5
    with pytest.raises(ConfigError, match="does not fit the image"):
        survey(DepthView(cut, LENS, raised), CROP, pose_given=True)


def test_a_far_pixel_makes_no_level_surface() -> None:
    """It asked for more memory than there is."""
    view = scene((0.0, 0.0, 0.03, 0.08))
    cut = np.where(things(view, CROP).labels == 1, np.asarray(view.depth), 0.0)
    cut[0, 0] = 1e9
    warning = check_table(cut, LENS, POSE)
    assert warning is None or "cannot be checked" in warning
    cut[cut > 0] = 1e9
    with pytest.raises(ConfigError, match="does not fit the image"):
        check_table(cut, LENS, POSE)


def test_masks_and_regions_of_nothing_are_refused(grasper: Any) -> None:
    """Without a camera's pose the table is searched around them."""
    depth = np.asarray(scene((0.0, 0.0, 0.03, 0.08)).depth)
    with pytest.raises(ConfigError, match="the mask has 0 pixels"):
        grasper.find(depth, LENS, mask=np.zeros(depth.shape, dtype=np.bool_))
    assert grasper.find_all(depth, LENS, labels=np.zeros(depth.shape, dtype=np.int64)).best() == []
    far, own = depth.copy(), things(scene((0.0, 0.0, 0.03, 0.08)), CROP).labels == 1
    far[own] = 9.0
    with pytest.raises(ConfigError, match="more than 5 m from the table's origin"):
        grasper.find(far, LENS, mask=own)
    far[own] = -0.5
    with pytest.raises(ConfigError, match=r"depth holds -0\.5 m"):
        grasper.find(far, LENS, mask=own)
    for wrong in (depth[0], depth[None]):
        with pytest.raises(ConfigError, match=r"pass one image \(H, W\)"):
            grasper.find(wrong, LENS, region=(0, 0, 20, 20))


@pytest.mark.parametrize(
    ("scale", "unit", "message"),
    [
        (0.5, 1.0, r"the principal point \(80, 60\) is far from the middle"),
        (1.25, 1.0, "the intrinsics belong to one of another size"),
        (1.0, 2.0, "check the depth scale"),
        (1.0, 0.5, "check the depth scale"),
    ],
)
def test_wrong_intrinsics_and_units_are_told(scale: float, unit: float, message: str) -> None:
    depth = np.asarray(scene((0.0, 0.0, 0.04, 0.09)).depth) * unit
    lens = check_intrinsics(np.diag([scale, scale, 1.0]) @ LENS, depth.shape)
    warnings = look(survey(DepthView(depth, lens, fit_table(depth, lens)), CROP), CROP).warnings
    assert any(re.search(message, warning) for warning in warnings), warnings


def test_the_table_near_the_middle_is_found() -> None:
    """The floor around a small table has more pixels."""
    pose = camera_over_table(1.2, 0.8)
    depth = boxes((0.8 / np.tan(0.8), 0.0, 0.38, 0.4), pose=pose)
    assert fit_table(depth, LENS)[2, 3] == pytest.approx(0.8, abs=0.01)


def test_points_in_an_open_hand_are_counted() -> None:
    hand = load_hand("panda_gripper")
    preshape = hand.preshape_limits[0]
    poses, half, _, _ = hand.shapes(hand.open(preshape))
    centers, pose = poses[:, :3, 3], camera_over_table(0.4, 0.5)
    moved = centers @ pose[:3, :3].T + pose[:3, 3]
    depth = depth_inside(hand, preshape, pose, np.concatenate([moved, moved + 10.0]))
    assert len(depth) == len(centers)
    assert (depth >= half.min(axis=1) - 1e-9).all()


def test_captures_that_cannot_be_read_are_named(tmp_path: Path) -> None:
    with pytest.raises(graspbox.errors.FileError, match="there is no capture"):
        captures_in(tmp_path)
    for name, text in (("empty", ""), ("text", "{}"), ("list", "[1]"), ("number", '{"intrinsics": {"fx": "x"}}')):
        folder = tmp_path / name
        folder.mkdir()
        np.save(folder / "depth.npy", np.ones((4, 4)))
        (folder / "capture.json").write_text(text)
        with pytest.raises(ConfigError, match=r"capture\.json"):
            Capture.read(folder)


@pytest.fixture(scope="module")
def grasper() -> Any:
    pytest.importorskip("onnxruntime", reason="networks run in onnxruntime, from the extra 'onnx'")
    pytest.importorskip("PIL", reason="PNG files need Pillow, from the extra 'cli'")
    from graspbox.policies.grasp_image import ImageGrasper

    return ImageGrasper(REPOSITORY / "policies" / "panda_clutter")


def test_other_kinds_of_policies_are_refused() -> None:
    from graspbox.policies.grasp_image import ImageGrasper

    with pytest.raises(ConfigError, match="of the kind 'head', which acts in environments alone; in your own images"):
        ImageGrasper(REPOSITORY / "policies" / "head")


def test_a_thing_is_rehearsed_alone_and_none_among_others() -> None:
    pytest.importorskip("onnxruntime", reason="networks run in onnxruntime, from the extra 'onnx'")
    pytest.importorskip("PIL", reason="PNG files need Pillow, from the extra 'cli'")
    from graspbox.policies.grasp_image import ImageGrasper

    capture, grasper = Capture.read(CAPTURES / "pcl_milk_clorox"), ImageGrasper(REPOSITORY / "policies" / "leap")
    pose = fit_table(capture.depth, capture.intrinsics)
    place = capture.depth, capture.intrinsics, pose
    among = grasper.find_all(*place, labels=capture.labels).grasps[2]
    rehearsed, plain = (grasper.find(*place, mask=capture.mask(2), rehearsed=number) for number in (None, 0))
    np.testing.assert_array_equal(among.success, plain.success)
    assert not np.array_equal(rehearsed.success, plain.success)


def test_all_things_of_a_scene_are_grasped(grasper: Any) -> None:
    capture = Capture.read(CAPTURES / "pcl_milk_clorox")
    found = grasper.find_all(capture.depth, capture.intrinsics, count=3)
    named = grasper.find_all(capture.depth, capture.intrinsics, labels=capture.labels, count=3)
    assert set(named.grasps) | set(named.refused) == {1, 2, 3}
    for scene in (found, named):
        assert len(scene.grasps) >= 3
        of = [(scene.grasps[label].free[rank], scene.grasps[label].success[rank]) for label, rank in scene.best()]
        assert of == sorted(of, reverse=True)
        written = scene.to_json()
        assert [row["thing"] for row in written["things"]] == sorted({*scene.grasps, *scene.refused})
        assert len(written["order"]) == sum(len(one) for one in scene.grasps.values())
    # A thing alone has the same grasps.
    pose = fit_table(capture.depth, capture.intrinsics)
    posed = grasper.find_all(capture.depth, capture.intrinsics, pose, labels=capture.labels)
    alone = grasper.find(capture.depth, capture.intrinsics, pose, mask=capture.labels == 2)
    np.testing.assert_array_equal(alone.table_from_hand, posed.grasps[2].table_from_hand)
    with pytest.raises(ConfigError, match="labels are float64"):
        grasper.find_all(capture.depth, capture.intrinsics, labels=capture.depth)
    # Less than 0 is no thing; too large numbers, too many things and wrong options are errors of the whole call.
    assert capture.labels is not None
    void = np.where(capture.labels == 2, -1, capture.labels)
    known = grasper.find_all(capture.depth, capture.intrinsics, labels=void, count=1).labels
    assert set(known.ravel().tolist()) == {0, 1, 3}
    wrongs: tuple[tuple[Any, dict[str, Any], str], ...] = (
        (capture.labels.astype(np.uint64) << np.uint64(62), {}, "numbers below 2^62"),
        (np.arange(capture.labels.size).reshape(capture.labels.shape), {}, "pass at most 100"),
        (capture.labels, {"count": 0}, "count is 0"),
        (capture.labels, {"keep_off": [[0.0, 0.0, 0.1]]}, "keep_off is in the table's frame"),
    )
    for labels, keywords, message in wrongs:
        with pytest.raises(ConfigError, match=re.escape(message)):
            grasper.find_all(capture.depth, capture.intrinsics, labels=labels, **keywords)


def test_a_policy_grasps_in_captures(grasper: Any) -> None:
    capture: Any = Capture.read(CAPTURES / "pcl_milk_clorox")
    policy: Any = graspbox.policies.load(str(REPOSITORY / "policies" / "panda_clutter"))
    found = policy.grasps(capture, label=2, count=2)
    mask = capture.labels == 2
    same = grasper.find(capture.depth, capture.intrinsics, mask=mask, count=2)
    np.testing.assert_array_equal(found.table_from_hand, same.table_from_hand)
    assert set(policy.grasps_of_things(capture, count=1).labels.ravel().tolist()) == {0, 1, 2, 3}
    with pytest.raises(ConfigError, match=r"no pixel of .* has the label 7; choose from 1, 2, 3"):
        policy.grasps(capture, label=7)
    with pytest.raises(ConfigError, match="choose one of them"):
        policy.grasps(capture)


def test_gravity_says_which_plane_is_the_table(grasper: Any) -> None:
    """A wall at 45 degrees fills more of the image than the table."""
    view = scene((0.0, 0.0, 0.03, 0.08))
    columns, lines = np.meshgrid(np.arange(320) + 0.5, np.arange(240) + 0.5)
    rays = np.stack([columns, lines, np.ones_like(lines)], axis=-1) @ np.linalg.inv(LENS).T
    down = -POSE[2, :3]
    slope = POSE[:3, :3].T @ (np.array([-1.0, 0.0, 1.0]) / np.sqrt(2.0))
    wall = 0.55 * slope[2] / (rays @ slope)
    depth = np.where((abs(columns - 160) > 60) | (abs(lines - 120) > 48), wall, view.depth)
    assert np.degrees(np.arccos(fit_table(depth, LENS)[2, :3] @ POSE[2, :3])) > 20
    found = fit_table(depth, LENS, gravity=down)
    np.testing.assert_allclose(found[2], POSE[2], atol=0.01)
    # A thing in the air, alone: only its mask and gravity say where it is.
    mask = things(view, CROP).labels == 1
    alone = np.where(mask, np.asarray(view.depth), 0.0)
    held = grasper.find(alone, LENS, mask=mask, gravity=9.81 * down, count=1)
    assert len(held) == 1
    assert "a table is assumed 20 mm under the lowest pixel of the mask" in held.warnings[0]
    point = held.camera_from_hand[0, :3, :3] @ held.hand.closing_center(0.0) + held.camera_from_hand[0, :3, 3]
    points = (POSE[:3, :3] @ point + POSE[:3, 3]) - (MIDDLE, 0.0, 0.04)
    assert np.abs(points).max() < 0.06
    every = grasper.find_all(alone, LENS, labels=mask.astype(np.int64), gravity=down, count=1)
    np.testing.assert_allclose(every.grasps[1].table_from_hand, held.table_from_hand, atol=1e-9)
    for keywords, message in (
        ({"gravity": down, "table_from_camera": POSE}, "pass one of them"),
        ({"gravity": (0.0, 0.0, 0.0)}, "three numbers such as 0 0.7 0.7"),
        ({"gravity": -down}, "the camera does not look down"),
        ({"gravity": down, "mask": None}, "no object rises above the table"),
    ):
        with pytest.raises(ConfigError, match=message):
            grasper.find(alone, LENS, **{"mask": mask, **keywords})


def test_a_lift_under_a_shelf_is_told(grasper: Any) -> None:
    view = scene((0.0, 0.0, 0.03, 0.08))
    steps = np.arange(-0.2, 0.2, 0.006)
    free = grasper.find(view.depth, LENS, POSE, count=3)
    assert free.lift_free.any()
    height = float(free.table_from_hand[0, 2, 3]) + 0.13
    shelf = np.stack(np.meshgrid(MIDDLE + steps, steps, [height]), axis=-1).reshape(-1, 3)
    assert not grasper.find(view.depth, LENS, POSE, count=3, keep_off=shelf).lift_free.any()


@pytest.mark.parametrize(
    ("given", "of", "near", "planes"), [("depth", 8, 8, 8), ("mask", 20, 18, 20), ("alone", 20, 18, 0)]
)
def test_real_captures_are_grasped(given: Any, of: int, near: int, planes: int, grasper: Any) -> None:
    """Before, 5 of these 8 images, and 7 of the 20 things, had a best grasp near a thing."""
    names: list[str] = []
    rows = list(
        judge_captures(grasper, captures_in(CAPTURES), given=given, draw=lambda name, grasps: names.append(name))
    )
    found: dict[str, Any] = summary(rows)
    assert found["of"] == of
    assert found["near"] >= near, [row.to_json() for row in rows]
    assert found["sure_and_wrong"] == 0
    assert given == "alone" or found["untold"] <= 2
    assert (found["planes"], found["right_planes"]) == (planes, planes), [row.to_json() for row in rows]
    assert len(set(names)) == len(names) >= found["answered"]


def test_a_wrong_plane_is_refused(tmp_path: Path) -> None:
    pytest.importorskip("PIL", reason="PNG files need Pillow, from the extra 'cli'")
    folder = shutil.copytree(CAPTURES / "sixdof_mustard", tmp_path / "one")
    told = json.loads((folder / "capture.json").read_text())
    for plane in ({"normal": [0, 0, 2.0], "offset": 1.0}, {"normal": "up"}, [1, 2]):
        (folder / "capture.json").write_text(json.dumps(told | {"plane": plane}))
        with pytest.raises(ConfigError, match="pass a unit normal of 3 numbers and an offset"):
            Capture.read(folder)


def jittered(depth: NDArray[np.float64], number: int) -> NDArray[np.float64]:
    """Return the image of a still scene with noise of 1 mm."""
    return np.where(depth > 0, depth + np.random.default_rng(number).normal(0, 0.001, depth.shape), 0.0)


def test_the_best_grasp_of_a_still_scene_stays(grasper: Any) -> None:
    capture = Capture.read(CAPTURES / "pcl_milk_clorox")
    mask, previous, moved = capture.labels == 1, None, []
    for number in range(6):
        depth = jittered(capture.depth, number)
        found = grasper.find(depth, capture.intrinsics, mask=mask, previous=previous)
        if previous is not None:
            moved.append(np.linalg.norm(found.camera_from_hand[0, :3, 3] - previous.camera_from_hand[0, :3, 3]))
        previous = found
    assert np.sort(moved)[:4].max() < 1e-6, moved
    # Grasps where there is nothing any more are forgotten.
    there = grasper.find(capture.depth, capture.intrinsics, mask=capture.labels == 2)
    fresh = grasper.find(capture.depth, capture.intrinsics, mask=mask)
    np.testing.assert_array_equal(
        grasper.find(capture.depth, capture.intrinsics, mask=mask, previous=there).table_from_hand,
        fresh.table_from_hand,
    )
    # An earlier grasp in the air takes nothing from a thing that is blocked.
    pose = fit_table(capture.depth, capture.intrinsics)
    around = np.random.default_rng(0).uniform(-0.3, 0.3, (4000, 3)) + (fresh.table_from_crop[:3, 3])
    walled = {"mask": mask, "keep_off": around}
    blocked = grasper.find(capture.depth, capture.intrinsics, pose, **walled)
    again = grasper.find(capture.depth, capture.intrinsics, pose, previous=there, **walled)
    assert len(blocked) == len(again) > 0
    other = replace(there, hand=load_hand("reflex"))
    with pytest.raises(ConfigError, match="previous has grasps of reflex, not of panda_gripper"):
        grasper.find(capture.depth, capture.intrinsics, mask=mask, previous=other)


def test_things_of_a_still_scene_keep_their_numbers(grasper: Any) -> None:
    capture = Capture.read(CAPTURES / "pcl_milk_clorox")
    first = grasper.find_all(capture.depth, capture.intrinsics, count=1)
    renamed = replace(first, labels=np.where(first.labels > 0, first.labels + 6, 0))
    second = grasper.find_all(jittered(capture.depth, 1), capture.intrinsics, count=1, previous=renamed)
    # The largest things are seen in both images.
    for label in (7, 8, 9):
        both = (second.labels == label) & (renamed.labels == label)
        assert both.sum() > 0.8 * (renamed.labels == label).sum()
    assert set(second.labels.ravel().tolist()) == {0, *second.grasps, *second.refused}


def test_the_command_grasps_all_objects(grasper: Any, tmp_path: Path) -> None:
    pytest.importorskip("typer", reason="the command line needs the extra 'cli'")
    from command_line import invoke

    folder = CAPTURES / "pcl_milk_clorox"
    words = ["grasp-image", str(folder / "depth.png"), "--camera-info", str(folder / "capture.json"), "--all"]
    words += ["--policy", str(REPOSITORY / "policies" / "panda_clutter"), "--count", "1"]
    out = tmp_path / "grasps.json"
    named = invoke([*words, "--mask", str(folder / "labels.png"), "--out", str(out), "--json"])
    assert named.exit_code == 0, named.output
    told = json.loads(named.stdout)
    assert [row["thing"] for row in told["things"]] == [1, 2, 3]
    assert told == json.loads(out.read_text())
    assert told["order"][0]["thing"] in (1, 2, 3)
    shown = invoke(words)
    assert "object 1, " in shown.output
    assert "--all writes no --picture" in str(invoke([*words, "--label", "2"]).exception)
