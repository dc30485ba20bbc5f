"""Depth policies that are told, by its pixels, which of several objects to grasp."""

import json
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode
from numpy.typing import NDArray
from PIL import Image

import graspbox
from command_line import invoke
from graspbox.captures import read_capture
from graspbox.errors import ConfigError, FileError
from graspbox.perception.configs import CropConfig
from graspbox.perception.depth_views import DepthView
from graspbox.perception.reachability import belonging
from graspbox.policies import Task, load
from graspbox.policies.grasp_image import grasp_image

POLICY = Path(__file__).parents[2] / "policies" / "panda_clutter"
HAND = "panda_gripper"
LENS = np.array([[230.0, 0.0, 64.0], [0.0, 230.0, 64.0], [0.0, 0.0, 1.0]])


def environments(num_envs: int = 4, **settings: Any) -> Any:
    chosen = {"layout": "packed", "hand": HAND, "image_size": 128, "obs": ("depth", "proprio", "segmentation")}
    return gymnasium.make_vec(
        "graspbox/GraspPose-v0",
        num_envs,
        objects=["procedural:unseen:0-9"],
        autoreset_mode=AutoresetMode.DISABLED,
        **{**chosen, **settings},
    )


def test_ownership_spreads_from_what_is_seen() -> None:
    """Two blocks that touch, of which a camera sees the tops."""
    occupancy = np.zeros((12, 8, 8), dtype=np.uint8)
    occupancy[1:5, 1:6, :6] = occupancy[5:9, 1:6, :4] = 200
    surface = np.zeros_like(occupancy)
    surface[1:5, 1:6, 5] = surface[5:9, 1:6, 3] = 255
    target = surface > 0
    target[:5] = False
    others = (surface > 0) & ~target
    own = belonging(occupancy, others, target)
    assert (own[5:9, 1:6, :4] >= 200).all()
    assert own[:5, :, 4:].max() == 0
    # Below the higher top both are as near, at the border between them.
    assert own[:3].max() == 0
    assert own[9:].max() == 0
    # What hangs on neither stays out.
    occupancy[11, 7, 7] = 255
    assert belonging(occupancy, others, target)[11].max() == 0


def test_pixels_fill_the_voxels_that_they_see() -> None:
    down = np.eye(4)
    down[:3, :3], down[2, 3] = np.diag([1.0, -1.0, -1.0]), 0.5
    view = DepthView(np.full((128, 128), 0.45), LENS, down)
    mask = np.zeros((128, 128), dtype=np.bool_)
    mask[60:68, 60:68] = True
    config = CropConfig()
    found = view.voxels(mask, np.eye(4), config)
    cells = np.argwhere(found)
    points = (cells + 0.5) * config.voxel_size + config.origin
    assert np.abs(points[:, 2] - 0.05).max() <= config.voxel_size
    assert np.abs(points[:, :2]).max() < 0.45 * 4 / 230 + config.voxel_size
    millimetres = DepthView(np.full((128, 128), 450, dtype=np.uint16), LENS, down)
    assert (millimetres.voxels(mask, np.eye(4), config) == found).all()
    wrongs: tuple[Any, ...] = (mask[1:], mask.astype(np.uint8))
    for wrong in wrongs:
        with pytest.raises(ConfigError, match=r"pass bool \(128, 128\)"):
            view.voxels(wrong, np.eye(4), config)


def test_a_policy_grasps_the_target() -> None:
    """The grasps of a policy for any object are near the target; without its pixels most are elsewhere."""
    env = environments(16)
    policy: Any = load(str(POLICY))
    policy.bind(Task.of(env))
    assert policy.needed_obs(target=True) == ("depth", "proprio", "segmentation")
    seen, info = env.reset(seed=3)
    policy.reset(3, info=info)
    policy.act(seen)
    near, hand = [], graspbox.load_hand(HAND)
    for index, found in enumerate(policy.found):
        if found is None:
            continue
        scene = env.unwrapped.arrangement(index)
        center = found.world_from_hand @ [*hand.closing_center(found.preshape), 1.0]
        distances = [
            np.linalg.norm((pose[:3, :3] @ mesh.vertices.T).T + pose[:3, 3] - center[:3], axis=1).min()
            for mesh, pose in zip(scene.meshes, scene.world_from_objects, strict=True)
        ]
        near.append(int(np.argmin(distances)) == scene.target)
    env.close()
    assert len(near) >= 8
    assert np.mean(near) >= 0.75


def test_the_segmentation_is_asked_for() -> None:
    env = environments(1, obs=("depth", "proprio"))
    with pytest.raises(ConfigError, match=r"needs obs=.*segmentation"):
        load(str(POLICY)).bind(Task.of(env))
    env.close()
    env = environments(1)
    policy = load("partial_view_planner")
    policy.bind(Task.of(env))
    seen, info = env.reset(seed=0)
    policy.reset(0, info=info)
    with pytest.raises(ConfigError, match="cannot take a target"):
        policy.act(seen)
    env.close()


def test_it_is_evaluated_among_others() -> None:
    arguments = ["evaluate", str(POLICY), "--layout", "packed", "--objects", "procedural:unseen:0-9", "--trials", "6"]
    done = invoke([*arguments, "--json"])
    assert done.exit_code == 0, done.output
    row = json.loads(done.stdout)
    assert row["trials"] == 6
    assert row["succeeded"] >= 3


@pytest.fixture(scope="module")
def image() -> tuple[NDArray[np.float64], NDArray[np.uint8], NDArray[np.float64], NDArray[np.float64]]:
    """Depth, labels, intrinsics and camera of a packed scene."""
    meshes = [spec.load() for spec in graspbox.object_sets.load("procedural:can:0-3")]
    scene = graspbox.arrange(meshes, "packed", seed=1, hand=HAND)
    seen = graspbox.views(
        scene.meshes[0],
        world_from_object=scene.world_from_objects[0],
        neighbours=scene.without(0),
        count=1,
        image_size=160,
        target=(0.0, 0.0, 0.05),
    )
    assert seen.segmentation is not None
    return seen.depth[0].astype(np.float64), seen.segmentation[0], seen.intrinsics, seen.world_from_camera[0]


def test_a_mask_chooses_the_object_of_an_image(image: Any, tmp_path: Path) -> None:
    depth, labels, lens, pose = image
    shown = [label for label in range(2, int(labels.max()) + 1) if (labels == label).sum() > 60]
    assert len(shown) >= 2
    places = []
    for label in shown[:2]:
        found = grasp_image(depth, lens, pose, POLICY, mask=labels == label, count=1)
        if len(found):
            places.append(found.table_from_hand[0, :2, 3])
    assert len(places) == 2
    assert np.linalg.norm(places[0] - places[1]) > 0.02
    with pytest.raises(ConfigError, match="the mask has 0 pixels with a depth"):
        grasp_image(depth, lens, pose, POLICY, mask=np.zeros(depth.shape, dtype=np.bool_))
    with pytest.raises(ConfigError, match="mask is uint8"):
        grasp_image(depth, lens, pose, POLICY, mask=(labels == 2).astype(np.uint8))


def test_the_command_reads_masks(image: Any, tmp_path: Path) -> None:
    depth, labels, lens, pose = image
    np.save(tmp_path / "depth.npy", depth)
    np.save(tmp_path / "pose.npy", pose)
    Image.fromarray((255 * (labels == 2)).astype(np.uint8)).save(tmp_path / "mask.png")
    arguments = ["grasp-image", str(tmp_path / "depth.npy"), "--policy", str(POLICY), "--json", "--count", "1"]
    arguments += ["--intrinsics", *map(str, (lens[0, 0], lens[1, 1], lens[0, 2], lens[1, 2]))]
    arguments += ["--camera-pose", str(tmp_path / "pose.npy"), "--mask", str(tmp_path / "mask.png")]
    done = invoke(arguments)
    assert done.exit_code == 0, done.output


def test_masks_are_read_from_files(tmp_path: Path) -> None:
    mask = np.zeros((6, 8), dtype=np.bool_)
    mask[2:4, 3:6] = True
    np.save(tmp_path / "depth.npy", np.full((6, 8), 0.6))
    np.save(tmp_path / "mask.npy", mask)
    Image.fromarray(mask).save(tmp_path / "mask.png")
    lens = np.array([[10.0, 0, 4], [0, 10.0, 3], [0, 0, 1]])
    for name in ("mask.npy", "mask.png"):
        seen = read_capture(tmp_path / "depth.npy", intrinsics=lens, mask=tmp_path / name)
        np.testing.assert_array_equal(seen.mask(), mask)
    Image.fromarray(np.zeros((6, 8, 3), dtype=np.uint8)).save(tmp_path / "rgb.png")
    np.save(tmp_path / "empty.npy", np.zeros((6, 8), dtype=np.uint8))
    for name, message in (("rgb.png", "pass one label per pixel"), ("empty.npy", "marks no single thing")):
        with pytest.raises(ConfigError, match=message):
            read_capture(tmp_path / "depth.npy", intrinsics=lens, mask=tmp_path / name)
    with pytest.raises(FileError, match="no such image of labels"):
        read_capture(tmp_path / "depth.npy", intrinsics=lens, mask=tmp_path / "missing.png")
