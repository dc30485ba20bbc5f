"""Truncated signed distance fields, and the policy whose planner works on them."""

from functools import partial
from typing import Any

import gymnasium
import numpy as np
import pytest
from numpy.typing import NDArray

from graspbox.configs import CamerasConfig
from graspbox.configs.cameras import camera_pose, lens
from graspbox.errors import ConfigError
from graspbox.evaluation.rounds import clear_rounds
from graspbox.perception.configs import DepthNoise
from graspbox.perception.shapes.tsdf import RESOLUTION, SIDE, VOXEL_SIZE, WORLD_FROM_WORKSPACE, cameras_around, tsdf_of
from graspbox.policies import Task, TsdfPolicy

Floats = NDArray[np.float64]
SIZE = (240, 320)
LENS = lens(cameras_around(1)[0].fov, SIZE)
TABLE = 0.05
#: A sphere in the world, metres.
CENTER, RADIUS = np.array([0.01, -0.02, 0.06]), 0.05


def rays() -> Floats:
    """Directions (H, W, 3) of the pixels in the camera, of depth 1."""
    rows, columns = np.indices(SIZE) + 0.5
    across, down = (columns - LENS[0, 2]) / LENS[0, 0], (rows - LENS[1, 2]) / LENS[1, 1]
    found: Floats = np.stack([across, down, np.ones(SIZE)], axis=-1)
    return found


def depth_of(pose: Floats, *, sphere: bool) -> Floats:
    """Depth image (H, W) of the table, and of the sphere on it, from their equations."""
    direction: Floats = rays() @ pose[:3, :3].T
    eye = pose[:3, 3]
    depth = -eye[2] / direction[..., 2]
    if not sphere:
        return np.asarray(depth)
    a = (direction**2).sum(axis=-1)
    b = direction @ (eye - CENTER)
    c = float((eye - CENTER) @ (eye - CENTER)) - RADIUS**2
    hits = b**2 - a * c > 0
    near = (-b - np.sqrt(np.maximum(b**2 - a * c, 0.0))) / a
    return np.asarray(np.where(hits, near, depth))


def field_of(views: int, *, sphere: bool) -> tuple[NDArray[np.float32], list[Floats]]:
    poses = [camera_pose(camera) for camera in cameras_around(views)]
    return tsdf_of([depth_of(pose, sphere=sphere) for pose in poses], LENS, poses)[0], poses


def crossings(field: NDArray[np.float32], axis: int) -> Floats:
    """Points (p, 3) in the world where the field crosses 0.5 between neighbours along an axis."""
    here, there = np.moveaxis(field, axis, 0)[:-1], np.moveaxis(field, axis, 0)[1:]
    crossed = (here > 0) & (there > 0) & ((here - 0.5) * (there - 0.5) < 0)
    index = np.argwhere(crossed).astype(np.float64)
    index[:, 0] += (0.5 - here[crossed]) / (there[crossed] - here[crossed])
    places = np.insert(index[:, 1:], axis, index[:, 0], axis=1)
    return np.asarray((places + 0.5) * VOXEL_SIZE + WORLD_FROM_WORKSPACE[:3, 3])


@pytest.mark.parametrize("views", [1, 6])
def test_the_table_is_where_the_field_is_a_half(views: int) -> None:
    field, _ = field_of(views, sphere=False)
    points = crossings(field, 2)
    assert len(points) == RESOLUTION**2, "every column meets the table"
    assert np.abs(points[:, 2]).max() < VOXEL_SIZE / 2
    heights = (np.arange(RESOLUTION) + 0.5) * VOXEL_SIZE - TABLE
    assert (field[:, :, heights > 0.035] == 0).all(), "free space is unknown, as in VGN"
    assert (field[:, :, heights < -0.03] == 0).all(), "so is what is far behind the surface"
    near = field[:, :, np.abs(heights) < 0.02]
    assert (np.diff(near, axis=2) > 0).all()


@pytest.mark.parametrize("views", [1, 6])
def test_a_sphere_is_where_the_field_is_a_half(views: int) -> None:
    field, poses = field_of(views, sphere=True)
    count = 0
    for axis in range(3):
        points = crossings(field, axis)
        out = points - CENTER
        distance = np.linalg.norm(out, axis=1)
        # Points of the sphere that every camera sees at less than 60 degrees.
        facing = np.min(
            [
                np.einsum("pi,pi->p", out, pose[:3, 3] - points)
                / (distance * np.linalg.norm(pose[:3, 3] - points, axis=1))
                for pose in poses
            ],
            axis=0,
        )
        seen = (facing > 0.5) & (points[:, 2] > 0.03)
        assert np.abs(distance[seen] - RADIUS).max(initial=0.0) < VOXEL_SIZE / 2
        count += int(seen.sum())
    assert count > (60 if views == 1 else 15)


def test_what_no_image_shows_is_unknown() -> None:
    pose = camera_pose(cameras_around(1)[0])
    depth = depth_of(pose, sphere=False)
    assert not tsdf_of(np.zeros((1, *SIZE)), LENS, pose[None]).any()
    whole, half = tsdf_of(depth[None], LENS, pose[None]), depth.copy()
    half[:, : SIZE[1] // 2] = 0.0
    part = tsdf_of(half[None], LENS, pose[None])
    assert part.dtype == np.float32
    assert part.shape == (1, 40, 40, 40)
    assert 0.4 < (part > 0).sum() / (whole > 0).sum() < 0.6
    np.testing.assert_array_equal(part[part > 0], whole[part > 0])
    both = tsdf_of(np.stack([depth, half]), LENS, np.stack([pose, pose]))
    np.testing.assert_allclose(both, whole, atol=1e-6)


def test_cameras_stand_where_those_of_vgn_do() -> None:
    floor = np.array([0.0, 0.0, -TABLE])
    for camera in cameras_around(6):
        away = np.array(camera.eye) - floor
        assert np.linalg.norm(away) == pytest.approx(2 * SIDE)
        assert away[2] == pytest.approx(2 * SIDE * np.cos(np.pi / 6))
        np.testing.assert_allclose(camera.target, floor)
    assert lens(cameras_around(1)[0].fov, (480, 640))[0, 0] == pytest.approx(540)
    with pytest.raises(ConfigError, match="count is 0"):
        cameras_around(0)


def test_arrays_of_another_shape_are_refused() -> None:
    pose = np.eye(4)[None]
    with pytest.raises(ConfigError, match="depths has shape"):
        tsdf_of(np.zeros(SIZE), LENS, pose)
    with pytest.raises(ConfigError, match=r"pass \(3, 3\) and \(2, 4, 4\)"):
        tsdf_of(np.zeros((2, *SIZE)), LENS, pose)


def above(point: Floats, angle: float = 0.0) -> Floats:
    """Pose of a hand that faces down, whose pads are at a point; it closes along y turned by an angle."""
    pose = np.eye(4)
    pose[:3, 1], pose[:3, 2] = (-np.sin(angle), np.cos(angle), 0.0), (0.0, 0.0, -1.0)
    pose[:3, 0] = np.cross(pose[:3, 1], pose[:3, 2])
    pose[:3, 3] = point + np.array([0.0, 0.0, 0.038])
    return pose


def middle(field: NDArray[np.float32], voxel: float) -> tuple[Floats, Floats, Floats]:
    """Grasp the middle of what is over the table from above; a grasp that is too wide and a far one come first."""
    solid = (field[0] > 0) & (field[0] < 0.5)
    solid[:, :, : int(TABLE / voxel) + 2] = False
    if not solid.any():
        return np.zeros((0, 4, 4)), np.zeros(0), np.zeros(0)
    places = (np.argwhere(solid) + 0.5) * voxel
    center = np.append(places[:, :2].mean(axis=0), max(places[:, 2].max() - 0.02, TABLE + 0.015))
    return (
        np.stack([above(center), above(center + 1.0), above(center)]),
        np.array([0.2, 0.05, 0.05]),
        np.array([2.0, 1.0, 0.0]),
    )


def always(grasps: Any, field: NDArray[np.float32], voxel: float) -> Any:
    """Plan the same everywhere."""
    assert field.shape == (1, 40, 40, 40)
    assert voxel == VOXEL_SIZE
    return grasps


@pytest.mark.parametrize("views", [1, 3])
def test_the_policy_executes_what_is_planned(views: int) -> None:
    """Thin cans that stand alone are lifted by a hand that closes at their middle."""
    settings: dict[str, Any] = {"objects": "procedural:can:0-9", "hand": "panda_gripper", "layout": "packed"}
    policy = TsdfPolicy(middle, views=views, name="middle")
    found = clear_rounds(policy, objects_per_scene=1, object_scale=(0.5, 0.6), rounds=3, **settings)
    assert found.policy == "middle"
    assert found.success_rate == 1.0


def test_a_wrong_plan_is_refused() -> None:
    policy = TsdfPolicy(middle, noise=DepthNoise.none())
    env: Any = gymnasium.make(
        "graspbox/Clear-v0", objects="procedural:can:0", hand="panda_gripper", obs=policy.obs, **policy.settings
    )
    observation, info = env.reset(seed=1)
    batch = {name: values[None] for name, values in observation.items()}
    center = np.array([0.15, 0.15, 0.1])
    stretched = above(center)
    stretched[:3, 0] *= 2
    wrong: list[tuple[Any, str]] = [
        ([above(center)], "return a tuple"),
        (([above(center)], [0.05, 0.05], [1.0]), r"poses \(1, 4, 4\), widths \(2,\)"),
        (([above(center)], [0.05], [np.nan]), "not finite"),
        (([above(center), stretched], [0.05, 0.05], [1.0, 0.5]), r"poses\[1\], which is no pose"),
        (([above(center / VOXEL_SIZE)], [0.05], [1.0]), "out of reach"),
    ]
    for grasps, message in wrong:
        policy = TsdfPolicy(partial(always, grasps))
        policy.bind(Task.of(env))
        policy.reset(1, info=info)
        with pytest.raises(ConfigError, match=message):
            policy.act(batch)
    for grasps in (([above(center)], [0.2], [1.0]), ([], [], [])):
        policy = TsdfPolicy(partial(always, grasps))
        policy.bind(Task.of(env))
        policy.reset(1, info=info)
        assert not policy.act(batch).any()
        assert policy.found_nothing(0)
    env.close()


def test_views_need_cameras() -> None:
    with pytest.raises(ConfigError, match="count is 0"):
        TsdfPolicy(middle, views=0)
    policy = TsdfPolicy(middle, views=2)
    with pytest.raises(ConfigError, match="cameras"):
        clear_rounds(policy, objects="procedural:can:0", rounds=1, cameras=CamerasConfig(cameras=cameras_around(1)))
    env: Any = gymnasium.make("graspbox/Grasp-v0", objects="procedural:can:0", obs=policy.obs, **policy.settings)
    with pytest.raises(ConfigError, match="does not act in"):
        policy.bind(Task.of(env))
