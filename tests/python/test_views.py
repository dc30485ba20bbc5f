"""Views of an object, and the free and unknown space that they determine."""

from typing import Any

import numpy as np
import pytest

import graspbox
from graspbox import errors, object_sets
from graspbox.meshes.views import PLANS, ViewPlan

BALL = "procedural:ball:0"


@pytest.fixture(scope="module")
def ball() -> graspbox.Mesh:
    return object_sets.load(BALL)[0].load()


def test_the_study_stands_where_it_says(ball: graspbox.Mesh) -> None:
    seen = graspbox.views(ball, count=40, seed=1, image_size=32)
    eyes = seen.world_from_camera[:, :3, 3]
    low, high = ball.bounds
    target = np.array([0.0, 0.0, (high[2] - low[2]) / 2])
    distance = np.linalg.norm(eyes - target, axis=1)
    assert (np.abs(distance - 0.7) <= 0.05 * np.sqrt(3)).all()
    assert distance.std() > 0.01
    to_eye = (eyes - target) / distance[:, None]
    angle = np.degrees(np.arccos(to_eye @ np.array([-1.0, 0.0, 1.0]) / np.sqrt(2)))
    # Within the cap, but for the shift.
    assert (angle <= 15 + np.degrees(0.05 * np.sqrt(3) / 0.7)).all()
    assert angle.max() > 10


@pytest.mark.parametrize("plan", PLANS)
def test_poses_and_images_agree(ball: graspbox.Mesh, plan: str) -> None:
    """The middle of the object is seen, labelled and as deep as its pose in the camera's frame says."""
    seen = graspbox.views(ball, plan=plan, count=12, image_size=(96, 128), images=("rgb", "segmentation"))
    assert len(seen) == 12
    assert seen.rgb is not None
    assert seen.rgb.shape == (12, 96, 128, 3)
    assert seen.segmentation is not None
    low, high = ball.bounds
    radius = (high - low).min() / 2
    for depth, labels, pose in zip(seen.depth, seen.segmentation, seen.camera_from_object, strict=True):
        center = pose[:3, :3] @ ((low + high) / 2) + pose[:3, 3]
        u, v, w = seen.intrinsics @ center
        row, column = int(v / w), int(u / w)
        assert labels[row, column] == 2
        assert depth[row, column] == pytest.approx(center[2] - radius, abs=0.25 * radius)
        np.testing.assert_array_equal(depth > 0, labels > 0)


def test_without_levels_of_detail_the_mesh_itself_is_seen_whatever_was_rendered_before() -> None:
    def rendered(mesh: graspbox.Mesh, levels: bool) -> Any:
        return graspbox.views(mesh, count=3, image_size=64, table=False, images=(), levels=levels).depth

    one, other = (object_sets.load("procedural:kettle:3")[0].load() for _ in range(2))
    whole = rendered(one, levels=False)
    coarse = rendered(other, levels=True)
    np.testing.assert_array_equal(rendered(other, levels=False), whole)
    np.testing.assert_array_equal(rendered(one, levels=True), coarse)
    both = (whole > 0) & (coarse > 0)
    assert both.sum() > 0.95 * (whole > 0).sum()
    assert 0.0 < np.median(np.abs(whole - coarse)[both]) < 0.002


def test_random_views_depend_on_the_seed_alone(ball: graspbox.Mesh) -> None:
    plan = ViewPlan("random", distance=(0.4, 0.6), cap=1.0)
    few, many, other = (
        graspbox.views(ball, plan=plan, count=n, seed=s, image_size=24, images=("rgb",), num_threads=t)
        for n, s, t in ((3, 7, 1), (8, 7, 2), (3, 8, 1))
    )
    np.testing.assert_array_equal(few.depth, many.depth[:3])
    np.testing.assert_array_equal(few.rgb, many.rgb[:3] if many.rgb is not None else None)
    assert not np.array_equal(few.depth, other.depth)
    assert few.segmentation is None


def test_space_around_a_ball_is_told(ball: graspbox.Mesh) -> None:
    """Seen from all sides: outside free, the surface occupied, the inside unseen."""
    seen = graspbox.views(ball, plan="grid", count=24, image_size=128, fov=0.3, table=False, images=())
    n, side = 32, float((ball.bounds[1] - ball.bounds[0]).max()) * 1.5
    middle = ball.bounds.mean(axis=0)
    origin = middle - side / 2
    object_from_camera = np.linalg.inv(seen.camera_from_object)
    known = graspbox.occupancy(seen.depth, seen.intrinsics, object_from_camera, n, origin, side)
    centers = origin + (np.indices((n, n, n)).transpose(1, 2, 3, 0) + 0.5) * side / n - middle
    size = side / n
    radius = (ball.bounds[1] - ball.bounds[0]) / 2
    # From above: the lower half may stay unseen.
    upper = centers[..., 2] > 0
    reach = np.linalg.norm(centers / radius, axis=-1)
    margin = 2.0 * size / radius.min()
    assert (known[upper & (reach > 1 + margin)] == 1).mean() > 0.98
    assert (known[reach < 1 - margin] == 0).mean() > 0.98
    assert (known[upper & (np.abs(reach - 1) < 0.25 * size / radius.max())] == 2).mean() > 0.9


def test_what_cannot_be_viewed_is_refused(ball: graspbox.Mesh) -> None:
    with pytest.raises(errors.ConfigError, match="plan"):
        graspbox.views(ball, plan="around")
    with pytest.raises(errors.ConfigError, match="heat"):
        graspbox.views(ball, images=("heat",))
    with pytest.raises(errors.ConfigError, match="fov"):
        graspbox.views(ball, fov=7.0)
    seen = graspbox.views(ball, count=1, image_size=16)
    with pytest.raises(errors.ConfigError, match="depth"):
        graspbox.occupancy(-seen.depth, seen.intrinsics, seen.world_from_camera, 8, [0, 0, 0], 1.0)
    with pytest.raises(errors.ConfigError, match="depth"):
        graspbox.occupancy(seen.depth[0], seen.intrinsics, seen.world_from_camera, 8, [0, 0, 0], 1.0)


def test_one_image_can_be_named(ball: graspbox.Mesh) -> None:
    one, several = (graspbox.views(ball, count=1, image_size=16, images=images) for images in ("rgb", ("rgb",)))
    assert one.rgb is not None
    assert one.segmentation is None
    np.testing.assert_array_equal(one.rgb, several.rgb)


def test_integer_depth_is_millimetres_or_refused(ball: graspbox.Mesh) -> None:
    """As 16-bit cameras give it; taken as metres it would leave nothing but free space."""
    seen = graspbox.views(ball, count=3, image_size=64, table=False, images=())
    cube = (np.linalg.inv(seen.camera_from_object), 24, ball.bounds.mean(axis=0) - 0.06, 0.12)
    metres = graspbox.occupancy(seen.depth, seen.intrinsics, *cube)
    millimetres = graspbox.occupancy(graspbox.depth_millimetres(seen.depth), seen.intrinsics, *cube)
    assert (metres == 2).sum() > 50
    # Half a millimetre in 5 mm: few voxels change sides.
    assert (metres != millimetres).mean() < 0.03
    exact = graspbox.depth_millimetres(seen.depth) * np.float32(1e-3)
    np.testing.assert_array_equal(graspbox.occupancy(exact, seen.intrinsics, *cube), millimetres)
    with pytest.raises(errors.ConfigError, match="depth is of dtype int32"):
        graspbox.occupancy(graspbox.depth_millimetres(seen.depth).astype(np.int32), seen.intrinsics, *cube)


def test_millimetres_are_rounded_and_bounded() -> None:
    depth = np.array([[0.0, 0.0004, 0.0006], [1.2345, 65.535, 70.0]], np.float32)
    np.testing.assert_array_equal(graspbox.depth_millimetres(depth), np.array([[0, 0, 1], [1235, 65535, 0]], np.uint16))
    for bad in (-0.1, np.nan):
        with pytest.raises(errors.ConfigError, match="depth"):
            graspbox.depth_millimetres([bad])
