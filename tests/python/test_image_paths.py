"""Paths of an arm to grasps found in a depth image: from the joints in the image to the grasp, and on to a place."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from command_line import invoke
from graspbox import errors, policies
from graspbox.arms import Arm, Trajectory
from graspbox.captures import Capture
from graspbox.hands.conventions import mechanism_of
from graspbox.policies.image_grasps import ImageGrasps, SceneGrasps
from test_arm_in_image import BASE, LENS, NEAR, camera, image, measured

pytest.importorskip("ruckig", reason="timing needs the extra 'arm'")
pytest.importorskip("onnxruntime", reason="networks run in onnxruntime, from the extra 'onnx'")

POLICY = Path(__file__).parents[2] / "policies/panda_clutter"
PLACE = (0.05, -0.2, 0.6)


@pytest.fixture(scope="module")
def found() -> ImageGrasps:
    from graspbox.policies.grasp_image import ImageGrasper

    arm: dict[str, Any] = {"arm": "fr3", "base": BASE, "joints": NEAR}
    return ImageGrasper(POLICY).find(measured(image(NEAR, "panda_gripper")), LENS, camera(), count=10, **arm)


def hand_poses(grasps: ImageGrasps, path: Trajectory, phase: str) -> np.ndarray[Any, np.dtype[np.float64]]:
    """Return the poses of the hand's grasp frame in a phase, table's frame."""
    arm, hand = Arm.named("fr3"), grasps.hand
    flange = BASE @ arm.flange_poses(path.positions[path.phases == phase])
    return np.asarray(flange @ arm.flange_from_base_of(hand) @ mechanism_of(hand).base_from_hand)


def test_a_path_leads_from_the_joints_in_the_image_to_a_free_grasp_and_on(found: ImageGrasps) -> None:
    path = found.path(place=PLACE)
    np.testing.assert_allclose(path.positions[0], NEAR, atol=1e-12)
    assert found.free[path.grasp]
    assert found.reach is not None
    assert found.reach.reached[path.grasp]
    closing, opening = hand_poses(found, path, "close")[-1], hand_poses(found, path, "open")[-1]
    np.testing.assert_allclose(closing, found.table_from_hand[path.grasp], atol=1e-5)
    # The object is moved as asked, and turned about its middle.
    moved = opening @ np.linalg.inv(closing)
    middle = found._completed().vertices.mean(axis=0) @ found.table_from_crop[:3, :3].T + found.table_from_crop[:3, 3]
    there = moved[:3, :3] @ middle + moved[:3, 3]
    np.testing.assert_allclose(there - middle, [PLACE[0], PLACE[1], 0.0], atol=1e-4)
    cosine, sine = np.cos(PLACE[2]), np.sin(PLACE[2])
    np.testing.assert_allclose(moved[:3, :3], [[cosine, -sine, 0], [sine, cosine, 0], [0, 0, 1]], atol=1e-4)


def test_what_is_seen_besides_the_object_is_an_obstacle(found: ImageGrasps) -> None:
    assert found.keep_off[:, 2].min() > 0.01
    heights, angles = np.arange(0.0, 0.5, 0.01), np.linspace(0, 2 * np.pi, 60, endpoint=False)
    h, a = (grid.ravel() for grid in np.meshgrid(heights, angles))
    middle = found.table_from_crop[:2, 3]
    wall = np.column_stack([middle[0] + 0.12 * np.cos(a), middle[1] + 0.12 * np.sin(a), h])
    with pytest.raises(errors.PathError, match="no path to any of"):
        replace(found, keep_off=wall).path()


def test_a_pose_of_the_camera_may_be_given_beside_an_image_without_one() -> None:
    policy, given = policies.load(POLICY), {"arm": "fr3", "base": BASE, "joints": NEAR}
    seen = Capture(measured(image(NEAR, "panda_gripper")), LENS)
    with pytest.raises(errors.ConfigError, match="pass table_from_camera"):
        policy.grasps(seen, **given)  # type: ignore[attr-defined]
    found = policy.grasps(seen, table_from_camera=camera(), **given)  # type: ignore[attr-defined]
    assert found.path(place=PLACE).phases[-1] == "retreat"


def test_no_grasp_no_arm_or_no_object_are_told(found: ImageGrasps) -> None:
    with pytest.raises(errors.ConfigError, match="a path needs an arm; pass arm and base"):
        replace(found, arm=None).path()
    with pytest.raises(errors.ConfigError, match=r"place has the shape \(2,\); give \(3,\): x and y"):
        found.path(place=(0.1, 0.2))
    with pytest.raises(errors.PathError, match="the arm fr3 reaches none of the 0 free grasps") as caught:
        replace(found, free=np.zeros_like(found.free)).path()
    assert caught.value.reason == "not_reached"
    with pytest.raises(errors.PathError, match="has completed no object") as caught:
        replace(found, occupancy=np.zeros_like(found.occupancy)).path()
    assert caught.value.reason == "no_object"
    with pytest.raises(errors.PathError, match=r"takes .* s, longer than max_duration \(0.5 s\)"):
        found.path(max_duration=0.5)


def test_of_several_things_the_first_with_a_path_is_taken(found: ImageGrasps) -> None:
    blocked = replace(found, free=np.zeros_like(found.free), success=np.ones_like(found.success))
    labels = np.zeros(found.depth.shape, dtype=np.int64)
    label, path = SceneGrasps(labels, {1: blocked, 2: found}, {}).path(hz=20.0)
    assert label == 2
    assert found.free[path.grasp]
    with pytest.raises(errors.PathError, match="no thing has a path: thing 1: the arm fr3 reaches none"):
        SceneGrasps(labels, {1: blocked}, {}).path()


def test_the_command_writes_the_path(tmp_path: Path) -> None:
    np.save(tmp_path / "depth.npy", measured(image(NEAR, "panda_gripper")))
    np.save(tmp_path / "pose.npy", camera())
    words = ["grasp-image", str(tmp_path / "depth.npy"), "--intrinsics", "420", "420", "240", "180"]
    words += ["--policy", str(POLICY), "--camera-pose", str(tmp_path / "pose.npy"), "--json"]
    placed = ["--arm", "fr3", "--base", "0", "0", "0", "0", "--joints", " ".join(map(str, NEAR))]
    file = tmp_path / "path.csv"
    made = invoke([*words, *placed, "--path", str(file), "--place", "0.05", "-0.2", "30"])
    assert made.exit_code == 0, made.output
    assert json.loads(made.stdout)["grasps"]
    lines = file.read_text().splitlines()
    assert lines[0].startswith("time,joint1.position")
    assert lines[-1].endswith("retreat")
    assert "a path of" in made.stderr
    late = invoke([*words, *placed, "--path", str(file), "--max-duration", "0.5"])
    assert late.exit_code == 1
    assert "longer than max_duration" in late.stderr
    for wrong, message in [
        (["--path", str(file)], "--path is that of an arm; pass --arm and --base too"),
        ([*placed, "--path", str(tmp_path / "path.txt")], "has none of the suffixes"),
        ([*placed, "--place", "0", "0.3", "0"], "are those of --path; pass it too"),
    ]:
        refused = invoke([*words, *wrong])
        assert isinstance(refused.exception, errors.ConfigError)
        assert message in str(refused.exception)
