"""Depth images that show the robot: its arm and hand are neither things nor obstacles."""

import json
import re
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest
from numpy.typing import NDArray

import graspbox
import tiny_policy
from graspbox import _core, arms, errors, object_sets
from graspbox.arms import Arm, Reason
from graspbox.hands.conventions import mechanism_of
from graspbox.perception import add_depth_noise
from graspbox.perception.depth_images import points_of

LENS = np.array([[420.0, 0.0, 240.0], [0.0, 420.0, 180.0], [0.0, 0.0, 1.0]])
SIZE = (360, 480)
#: The arm stands at the origin, the thing before it; the camera looks at both from beyond the thing.
BASE, THING = np.eye(4), np.eye(4)
THING[:3, 3] = 0.45, -0.12, 0.0
HAND = "reflex"
#: Home, and the hand beside the thing.
HOME = Arm.named("fr3").home
NEAR = np.array([0.15, 0.35, 0.1, -2.1, 0.0, 2.4, 0.9])


def rotation(rpy: list[float]) -> NDArray[np.float64]:
    (cr, cp, cy), (sr, sp, sy) = np.cos(rpy), np.sin(rpy)
    x = np.array([[1, 0, 0], [0, cr, -sr], [0, sr, cr]])
    y = np.array([[cp, 0, sp], [0, 1, 0], [-sp, 0, cp]])
    z = np.array([[cy, -sy, 0], [sy, cy, 0], [0, 0, 1]])
    return np.asarray(z @ y @ x)


def prism(outline: NDArray[np.float64], low: float, high: float) -> graspbox.Mesh:
    """Make a mesh of a convex outline (n, 2), counterclockwise, between two heights."""
    n = len(outline)
    corners = np.concatenate([np.column_stack([outline, np.full(n, z)]) for z in (low, high)])
    faces = [[i, (i + 1) % n, n + i] for i in range(n)] + [[(i + 1) % n, n + (i + 1) % n, n + i] for i in range(n)]
    faces += [[0, i + 1, i] for i in range(1, n - 1)] + [[n, n + i, n + i + 1] for i in range(1, n - 1)]
    return graspbox.mesh_from_arrays(corners, faces, name="prism")


def links_of(arm: Arm) -> list[tuple[graspbox.Mesh, str, NDArray[np.float64]]]:
    """Make a mesh of each collision shape, with its link and its pose there."""
    found = []
    for link in ElementTree.fromstring(arm.files[0]).iter("link"):
        for collision in link.iter("collision"):
            origin, pose = collision.find("origin"), np.eye(4)
            if origin is not None:
                pose[:3, :3] = rotation([float(x) for x in origin.get("rpy", "0 0 0").split()])
                pose[:3, 3] = [float(x) for x in origin.get("xyz", "0 0 0").split()]
            box, cylinder = collision.find("geometry/box"), collision.find("geometry/cylinder")
            if box is not None:
                x, y, z = (0.5 * float(side) for side in box.attrib["size"].split())
                mesh = prism(np.array([[-x, -y], [x, -y], [x, y], [-x, y]]), -z, z)
            else:
                assert cylinder is not None
                turns, half = np.linspace(0, 2 * np.pi, 24, endpoint=False), 0.5 * float(cylinder.attrib["length"])
                round_ = float(cylinder.attrib["radius"]) * np.column_stack([np.cos(turns), np.sin(turns)])
                mesh = prism(round_, -half, half)
            found.append((mesh, link.attrib["name"], pose))
    return found


def camera() -> NDArray[np.float64]:
    """Return the pose of a camera that looks back at the robot."""
    pose, eye, at = np.eye(4), np.array([1.2, -0.35, 0.75]), np.array([0.35, -0.05, 0.15])
    forward = (at - eye) / np.linalg.norm(at - eye)
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    pose[:3, :3] = np.column_stack([right, np.cross(forward, right), forward])
    pose[:3, 3] = eye
    return pose


def image(joints: NDArray[np.float64] | None, name: str = HAND) -> NDArray[np.float64]:
    """Render the depth of table and thing, and of the arm with a hand, metres."""
    arm, hand = Arm.named("fr3"), graspbox.load_hand(name)
    table = prism(np.array([[-1.5, -1.5], [1.5, -1.5], [1.5, 1.5], [-1.5, 1.5]]), -0.05, 0.0)
    thing = object_sets.load("procedural:can:3")[0].load()
    solids = [(table, np.eye(4)), (thing, THING @ thing.resting_poses()[0][0])]
    held = None
    if joints is not None:
        frames = dict(zip(arm.links, arm.link_frames(joints), strict=True))
        solids += [(mesh, BASE @ frames[link] @ pose) for mesh, link, pose in links_of(arm)]
        base = BASE @ arm.flange_poses(joints[None])[0] @ arm.flange_from_base_of(hand)
        held = (hand, base @ mechanism_of(hand).base_from_hand, hand.open(0.0))
    light = {"direction": [0.0, 0.3, -1.0], "intensity": 0.6, "ambient": 0.4, "softness": 0.02}
    light |= {"sky": (1.0, 1.0, 1.0), "floor": (1.0, 1.0, 1.0)}
    config = {"image_size": SIZE, "samples": 1, "near": 0.01, "far": 4.0, "light": light}
    _, depth = _core.render(
        [mesh for mesh, _ in solids],
        np.array([pose for _, pose in solids]),
        np.full((len(solids), 3), 0.5),
        [False] * len(solids),
        held,
        LENS,
        camera(),
        config,
        None,
    )
    return depth.astype(np.float64)


def measured(depth: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.asarray(add_depth_noise(depth[None].astype(np.float32), LENS, 3)[0] / 1000.0)


@pytest.fixture(scope="module")
def tiny(tmp_path_factory: pytest.TempPathFactory) -> Path:
    pytest.importorskip("onnx", reason="small networks are made with onnx, from the extra 'dev'")
    pytest.importorskip("onnxruntime", reason="networks run in onnxruntime, from the extra 'onnx'")
    folder = tmp_path_factory.mktemp("policies") / "tiny"
    tiny_policy.make(folder)
    return folder


@pytest.mark.parametrize("joints", [HOME, NEAR])
def test_points_of_the_arm_and_its_hand_are_told_from_others(joints: NDArray[np.float64]) -> None:
    empty, depth = image(None), image(joints)
    robot = (depth > 0) & ((empty == 0) | (depth < empty - 1e-4))
    assert robot.sum() > 10_000
    points = points_in(depth)
    shown = np.zeros(SIZE, dtype=bool)
    shown[depth > 0] = arms.on_arm("fr3", joints, points[depth > 0], BASE, hand=HAND, distance=0.006)
    assert shown[robot].all()
    # Of all else, only the table at its foot.
    assert np.linalg.norm(points[shown & ~robot][:, :2], axis=1).max(initial=0.0) < 0.25
    bare = arms.on_arm("fr3", joints, points[depth > 0], BASE, distance=0.006)
    assert 300 < shown.sum() - bare.sum() < shown.sum()


def points_in(depth: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the points (H, W, 3) of an image, table's frame; NaN without depth."""
    found = np.full((*depth.shape, 3), np.nan)
    found[depth > 0] = points_of(depth, LENS) @ camera()[:3, :3].T + camera()[:3, 3]
    return found


@pytest.mark.parametrize("joints", [HOME, NEAR])
def test_the_robot_in_the_image_blocks_no_grasp_if_its_joints_are_given(
    joints: NDArray[np.float64], tiny: Path
) -> None:
    from graspbox.policies.grasp_image import ImageGrasper

    grasper, place = ImageGrasper(tiny), (LENS, camera())
    arm: dict[str, Any] = {"arm": "fr3", "base": BASE}
    alone = grasper.find(measured(image(None)), *place, count=5, **arm)
    assert alone.reach is not None
    assert alone.reach.reached.any()
    depth = measured(image(joints))
    seen = grasper.find(depth, *place, count=5, joints=joints, **arm)
    assert seen.reach is not None
    assert seen.reach.reached.sum() >= alone.reach.reached.sum() - 1
    assert (seen.reach.reason != Reason.TOUCHES_POINTS).all()
    assert not any("would be" in warning for warning in seen.warnings)
    # The same thing, but for what the robot hides of it.
    assert (seen.object & ~alone.object).sum() < 0.05 * alone.object.sum()
    assert (seen.object & alone.object).sum() > 0.6 * alone.object.sum()
    # Only at the edges of the robot some pixels of noise remain; none is on it.
    left = points_in(seen.depth)[seen.depth > 0]
    assert not arms.on_arm("fr3", joints, left, BASE, hand=HAND, distance=0.015).any()
    blind = grasper.find(depth, *place, count=5, **arm)
    assert blind.reach is not None
    assert not blind.reach.reached.any()
    assert any("would be" in warning for warning in blind.warnings)
    everything = grasper.find_all(depth, *place, count=2, joints=joints, **arm)
    assert len(everything.grasps) == 1


def test_a_tilted_pose_is_levelled_before_the_arm_is_looked_for(tiny: Path) -> None:
    """A pose off by 2 degrees puts the arm 4 cm from where it is seen at a depth of 1.2 m."""
    from graspbox.policies.grasp_image import ImageGrasper

    tilt, angle = camera(), np.radians(2.0)
    turn = np.eye(4)
    turn[1:3, 1:3] = [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
    given: dict[str, Any] = {"arm": "fr3", "base": BASE, "joints": NEAR}
    found = ImageGrasper(tiny).find(measured(image(NEAR)), LENS, tilt @ turn, count=5, **given)
    assert found.reach is not None
    assert found.reach.reached.any()
    assert (found.reach.reason != Reason.TOUCHES_POINTS).all()
    assert any("corrects the camera's pose by 1.9 degrees" in warning for warning in found.warnings)


def test_an_arm_at_home_without_joints_is_told(tiny: Path) -> None:
    from graspbox.policies.grasp_image import ImageGrasper

    grasper, place = ImageGrasper(tiny), (LENS, camera())
    found = grasper.find(measured(image(HOME)), *place, arm="fr3", base=BASE)
    assert any(
        "where the arm fr3 at home would be; if the image shows the arm, pass joints" in w for w in found.warnings
    )
    quiet = grasper.find(measured(image(None)), *place, arm="fr3", base=BASE)
    assert not any("at home" in warning for warning in quiet.warnings)
    with pytest.raises(errors.ConfigError, match="base, mount and joints place an arm; pass arm too"):
        grasper.find(image(None), *place, joints=HOME)


def test_the_command_takes_joints(tiny: Path, tmp_path: Path) -> None:
    from command_line import invoke

    np.save(tmp_path / "depth.npy", measured(image(HOME)))
    np.save(tmp_path / "pose.npy", camera())
    words = ["grasp-image", str(tmp_path / "depth.npy"), "--intrinsics", "420", "420", "240", "180"]
    words += ["--policy", str(tiny), "--camera-pose", str(tmp_path / "pose.npy"), "--json"]
    words += ["--arm", "fr3", "--base", "0", "0", "0", "0"]
    reached = invoke([*words, "--joints", " ".join(f"{x:.4f}" for x in HOME)])
    assert reached.exit_code == 0, reached.output
    assert json.loads(reached.stdout)["grasps"][0]["arm"]["reached"]
    wrong = invoke([*words, "--joints", "0 -45 0 -135 0 90 45"])
    assert isinstance(wrong.exception, errors.ConfigError)
    assert re.search(
        r"joints put joint2 of the arm fr3 at -45, beyond its range -1\.78 \.\. 1\.78", str(wrong.exception)
    )


def test_wrong_arguments_are_named() -> None:
    points = np.zeros((2, 3))
    cases: list[tuple[dict[str, Any], str]] = [
        ({"joints": HOME[:5]}, r"joints have shape \(5,\); the arm fr3 has 7: joint1, joint2"),
        ({"joints": np.full(7, np.nan)}, "joints"),
        ({"points": np.zeros(3)}, r"points have the shape \(3,\)"),
        ({"distance": np.zeros(3)}, r"distance has shape \(3,\); give one of 0 m or more, or one per point"),
        ({"distance": -0.1}, "one of 0 m or more"),
        ({"world_from_base": np.zeros((4, 4))}, "not a rigid motion"),
    ]
    for given, message in cases:
        arguments: dict[str, Any] = {"joints": HOME, "points": points, "world_from_base": BASE, **given}
        with pytest.raises(errors.ConfigError, match=message):
            arms.on_arm("fr3", **arguments)
