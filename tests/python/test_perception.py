"""Perception without networks: noise, crops and voxels by closed forms, invariances, the same bits on any threads."""

from dataclasses import replace
from math import erf
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import graspbox
from graspbox import errors, object_sets
from graspbox.configs.cameras import CameraConfig, camera_pose, lens
from graspbox.meshes.views import ViewPlan
from graspbox.perception import CropConfig, DepthNoise, add_depth_noise, crop, solid_occupancy

N = CropConfig().resolution
H = CropConfig().voxel_size


def cuboid(*sides: float, at: tuple[float, float] = (0.0, 0.0)) -> graspbox.Mesh:
    """Make a box with its lower side on z = 0, centred over `at`."""
    corners = [[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (0, 1)] * np.array(sides) + [*at, 0]
    faces = [[0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1]]
    faces += [[2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3]]
    return graspbox.mesh_from_arrays(corners, faces)


def seen(mesh: graspbox.Mesh, eye: tuple[float, float, float] = (-0.45, 0.0, 0.4), **settings: Any) -> graspbox.Views:
    """Look at a mesh, as its file has it, from `eye`."""
    middle = mesh.bounds.mean(axis=0)
    axis = tuple(float(x) for x in np.array(eye) - middle)
    reach = float(np.linalg.norm(axis))
    plan = ViewPlan("grid", axis=axis, cap=0.0, distance=(reach, reach), shift=0.0)  # type: ignore[arg-type]
    given = {"count": 1, "image_size": 128, "fov": 0.5, **settings}
    return graspbox.views(mesh, plan=plan, world_from_object=np.eye(4), **given)


def plane(depth: float, size: int = 200) -> tuple[NDArray[np.float32], NDArray[np.float64]]:
    """Give the image of a wall across the camera's axis, and the lens."""
    return np.full((1, size, size), depth, dtype=np.float32), lens(0.3, (size, size))


def test_axial_noise_has_the_deviation_of_its_formula() -> None:
    noise = DepthNoise(lateral=0.0, dropout=0.0)
    for depth in (0.5, 1.5, 3.0):
        image, intrinsics = plane(depth)
        found = add_depth_noise(image, intrinsics, 3, noise)
        assert found.dtype == np.uint16
        # At the middle of a wall the angle is almost 0; rounding to millimetres adds its own variance.
        deviation = np.hypot(0.0012 + 0.0019 * (depth - 0.4) ** 2, 0.001 / np.sqrt(12))
        errors_of = found[0] * 1e-3 - depth
        assert abs(errors_of.mean()) < 0.05 * deviation
        assert errors_of.std() == pytest.approx(deviation, rel=0.03)


def test_steep_surfaces_are_noisier_and_lose_pixels() -> None:
    # A floor 1 m below a camera that looks horizontally: the ray at v pixels below the middle meets it at f / v metres.
    size, focal = 200, 400.0
    intrinsics = np.array([[focal, 0, 100], [0, focal, 0], [0, 0, 1.0]])
    depth = np.repeat((focal / (np.arange(size) + 0.5))[:, None], size, axis=1)[None].astype(np.float32)
    depth[depth > 20] = 0.0
    steep = DepthNoise(lateral=0.0, dropout=0.0, edge_step=10.0, grazing_angle=1.35, grazing_dropout=0.5)
    found = add_depth_noise(depth, intrinsics, 0, steep)[0] * 1e-3
    # The angle between a ray and the floor's normal is atan(z / 1 m) in the middle column.
    angle = np.arctan(depth[0, :, 100])
    far = (angle > 1.36) & (depth[0, :, 100] > 0) & (np.arange(size) > 21)
    near = (angle < 1.3) & (depth[0, :, 100] > 0)
    assert (found[near] > 0).all()
    assert (found[far] == 0).mean() == pytest.approx(0.5, abs=0.05)
    row = int(np.argmin(np.abs(angle - 1.2)))
    ratio = angle[row] / (np.pi / 2 - angle[row])
    z = float(depth[0, row, 100])
    deviation = 0.0012 + 0.0019 * (z - 0.4) ** 2 + 0.0001 / np.sqrt(z) * ratio**2
    middle = found[row - 3 : row + 4, 60:140] - depth[0, row - 3 : row + 4, 60:140]
    assert middle.std() == pytest.approx(deviation, rel=0.1)


def test_edges_lose_pixels_and_nothing_else_changes_without_noise() -> None:
    image, intrinsics = plane(0.6)
    image[0, :, 100:] = 0.9
    found = add_depth_noise(image, intrinsics, 0, DepthNoise(lateral=0.0, dropout=0.0, edge_dropout=1.0))[0]
    assert (found[:, 99:101] == 0).all()
    assert (found[:, :99] > 0).all()
    assert (found[:, 101:] > 0).all()
    exact = add_depth_noise(image + np.float32(0.0004), intrinsics, 0, DepthNoise.none())[0]
    assert set(np.unique(exact).tolist()) == {600, 900}
    missing = add_depth_noise(np.zeros((1, 4, 4)), intrinsics, 0)
    assert not missing.any()


def test_lateral_noise_moves_edges() -> None:
    image, intrinsics = plane(0.6)
    image[0, :, 100:] = 0.9
    sharp = DepthNoise(axial_floor=0, axial_growth=0, axial_grazing=0, dropout=0, edge_dropout=0, lateral=2 / 661.6)
    found = add_depth_noise(image, intrinsics, 0, sharp)[0]
    # Two pixels of standard deviation: a pixel of the near wall, k pixels from the edge, shows the far one where the
    # normal number, rounded, exceeds k.
    shares = (found[:, 90:100] == 900).mean(axis=0)[::-1]
    expected = [0.5 - 0.5 * erf((k + 0.5) / 2 / 2**0.5) for k in range(10)]
    np.testing.assert_allclose(shares, expected, atol=0.08)


def test_noise_of_an_image_depends_on_its_own_seed() -> None:
    image, intrinsics = plane(0.7, 40)
    both = add_depth_noise(np.concatenate([image, image]), intrinsics, [4, 9])
    np.testing.assert_array_equal(both[1], add_depth_noise(image, intrinsics, 9)[0])
    assert (both[0] != both[1]).any()


def test_neighbours_share_a_part_of_the_noise() -> None:
    """Its standard deviation grows with the square of the depth, and it is gone at a multiple of its extent."""
    for depth in (0.6, 1.2):
        image, intrinsics = plane(depth, 160)
        shared = replace(DepthNoise.none(), correlated_growth=0.004, correlation=6.0 / float(intrinsics[0, 0]))
        found = add_depth_noise(np.repeat(image, 40, axis=0), intrinsics, 3, shared) / 1000.0 - depth
        np.testing.assert_allclose(found.std(), 0.004 * depth**2, rtol=0.1)
        beside = (found[:, :, 1:] * found[:, :, :-1]).mean() / found.var()
        apart = (found[:, :, 30:] * found[:, :, :-30]).mean() / found.var()
        assert beside > 0.9
        assert abs(apart) < 0.1


def test_holes_are_patches_of_a_share_of_the_image() -> None:
    image, intrinsics = plane(0.7, 160)
    shared = replace(DepthNoise.none(), holes=0.2, correlation=8.0 / float(intrinsics[0, 0]))
    lost = add_depth_noise(image, intrinsics, 1, shared)[0] == 0
    np.testing.assert_allclose(lost.mean(), 0.2, atol=0.002)
    # Most neighbours of a lost pixel are lost too.
    assert lost[:, 1:][lost[:, :-1]].mean() > 0.8
    # The noise of single pixels does not depend on it.
    plain = add_depth_noise(image, intrinsics, 1)[0]
    holed = add_depth_noise(image, intrinsics, 1, replace(DepthNoise(), holes=0.2))[0]
    np.testing.assert_array_equal(holed[holed > 0], plain[holed > 0])


@pytest.mark.parametrize(
    ("field", "value"),
    [("dropout", 1.5), ("quantum", 0.0), ("edge_step", -1.0), ("holes", 1.1), ("correlation", 0.0)],
)
def test_noise_out_of_range_is_refused(field: str, value: float) -> None:
    image, intrinsics = plane(0.7, 16)
    with pytest.raises(errors.ConfigError, match=field):
        add_depth_noise(image, intrinsics, 0, DepthNoise(**{field: value}))


def test_crop_of_a_cube_is_below_its_middle_and_looks_away_from_the_camera() -> None:
    view = seen(cuboid(0.06, 0.06, 0.06, at=(0.02, -0.01)))
    found = crop(view.depth, view.intrinsics, view.world_from_camera)
    assert found.found.all()
    truth = view.segmentation == 2
    # The lowest pixels of its side are within the noise of the table.
    assert not (found.object & ~truth).any()
    assert found.object.sum() > 0.9 * truth.sum()  # type: ignore[union-attr]
    pose = found.world_from_crop[0]
    # The camera is at y = 0, the cube's middle at y = -0.01: the crop's x axis points from one to the other.
    away = np.array([0.47, -0.01]) / np.hypot(0.47, 0.01)
    np.testing.assert_allclose(pose[:2, 0], away, atol=5e-3)
    np.testing.assert_allclose(pose[2], [0, 0, 1, 0], atol=1e-12)
    np.testing.assert_allclose(pose[:2, 3], [0.02, -0.01], atol=3e-3)


def test_channels_of_a_cube_are_what_its_geometry_says() -> None:
    side = 0.06
    view = seen(cuboid(side, side, side))
    found = crop(view.depth, view.intrinsics, view.world_from_camera)
    surface, unseen, table = (channel.astype(float) / 255 for channel in found.channels[0])
    index = np.stack(np.meshgrid(*[np.arange(N)] * 3, indexing="ij"), axis=-1)
    crop_points = np.array(CropConfig().origin) + (index + 0.5) * H
    pose = found.world_from_crop[0]
    world = crop_points @ pose[:3, :3].T + pose[:3, 3]
    eye = view.world_from_camera[0, :3, 3]
    np.testing.assert_array_equal(table, np.broadcast_to([1.0, 1.0, *[0.0] * (N - 2)], (N, N, N)))

    def inside(points: NDArray[np.float64], grow: float) -> NDArray[np.bool_]:
        low, high = np.array([-side / 2, -side / 2, 0]) - grow, np.array([side / 2, side / 2, side]) + grow
        return np.asarray(((points > low) & (points < high)).all(axis=-1))

    def shadow(grow: float) -> NDArray[np.bool_]:
        """Points from which the way to the camera leads through the cube."""
        shares = np.linspace(0.0, 0.5, 400)[:, None, None, None, None]
        met = np.zeros((N, N, N), dtype=np.bool_)
        for share in shares:
            met |= inside(world + share[0] * (eye - world), grow)
        return met

    above = world[..., 2] > 1.5 * H
    behind = shadow(-1.5 * H) & above
    clear = ~shadow(1.5 * H) & above
    assert behind.sum() > 400
    assert (unseen[behind] == 1.0).all()
    assert (unseen[clear & seen_in(view, world, 1.0)] == 0.0).all()
    outside = ~seen_in(view, world, -1.0)
    assert outside.any()
    assert (unseen[outside] == 1.0).all()
    # The seen faces: the top, and the side towards the camera.
    near = inside(world, 1.0 * H) & ~inside(world, -1.0 * H)
    assert (surface[~near] == 0.0).all()
    top = (np.abs(world[..., :2]).max(axis=-1) < 0.02) & (np.abs(world[..., 2] - side) < 0.25 * H)
    assert top.any()
    assert (surface[top] > 0.3).all()


def seen_in(view: graspbox.Views, points: NDArray[np.float64], margin: float) -> NDArray[np.bool_]:
    """Tell which points are in the image, more than `margin` pixels from its border."""
    inverse = np.linalg.inv(view.world_from_camera[0])
    local = points @ inverse[:3, :3].T + inverse[:3, 3]
    image = local @ view.intrinsics.T
    at = image[..., :2] / image[..., 2:]
    return np.asarray(((at > margin) & (at < 128 - margin)).all(axis=-1))


def test_turning_the_world_turns_nothing_in_the_crop() -> None:
    mesh = object_sets.load("procedural:mug:3")[0].load()
    view = graspbox.views(mesh, plan="study", count=4, image_size=96)
    depth = add_depth_noise(view.depth, view.intrinsics, 0)
    before = crop(depth, view.intrinsics, view.world_from_camera)
    turn, (cosine, sine) = np.eye(4), (np.cos(2.0), np.sin(2.0))
    turn[:2, :2], turn[:2, 3] = [[cosine, -sine], [sine, cosine]], [0.3, -0.2]
    after = crop(depth, view.intrinsics, turn @ view.world_from_camera)
    np.testing.assert_allclose(after.world_from_crop, turn @ before.world_from_crop, atol=5e-3)
    differences = np.abs(after.channels.astype(int) - before.channels.astype(int))
    # Groups of pixels and voxels at the border of a pixel may fall on the other side by rounding.
    assert (differences > 8).mean() < 5e-3


def test_only_the_object_is_found_in_noise() -> None:
    for name in ("mug:3", "bowl:1", "spoon:2", "box:0"):
        mesh = object_sets.load(f"procedural:{name}")[0].load()
        view = graspbox.views(mesh, count=6, image_size=128, fov=0.5)
        depth = add_depth_noise(view.depth, view.intrinsics, 1)
        found = crop(depth, view.intrinsics, view.world_from_camera)
        truth = (view.segmentation == 2) & (depth > 0)
        assert found.found.all(), name
        assert (found.object & truth).sum() > 0.95 * found.object.sum(), name
        assert (found.object & truth).sum() > (0.5 if name.startswith("spoon") else 0.85) * truth.sum(), name


def test_the_largest_of_two_objects_is_taken_unless_labels_say_otherwise() -> None:
    large, small = cuboid(0.06, 0.06, 0.06, at=(0.0, 0.06)), cuboid(0.03, 0.03, 0.03, at=(0.0, -0.08))
    faces = np.concatenate([large.faces, small.faces + 8])
    both = graspbox.mesh_from_arrays(np.concatenate([large.vertices, small.vertices]), faces)
    view = seen(both)
    found = crop(view.depth, view.intrinsics, view.world_from_camera)
    assert found.world_from_crop[0, 1, 3] == pytest.approx(0.06, abs=5e-3)
    # The camera looks along +x: points at y < 0 are in the right half of the image.
    labels = (view.segmentation == 2) & (np.arange(128) > 70)
    other = crop(view.depth, view.intrinsics, view.world_from_camera, labels=labels)
    assert other.world_from_crop[0, 1, 3] == pytest.approx(-0.08, abs=5e-3)
    # Linked by a wide gap they are one object.
    one = crop(view.depth, view.intrinsics, view.world_from_camera, config=CropConfig(gap=0.2))
    assert one.object.sum() > 0.9 * (view.segmentation == 2).sum()  # type: ignore[union-attr]


def test_an_empty_table_holds_no_object() -> None:
    view = seen(cuboid(0.06, 0.06, 0.06))
    nothing = np.where(view.segmentation == 2, 0, view.depth)
    found = crop(nothing, view.intrinsics, view.world_from_camera)
    assert not found.found.any()
    np.testing.assert_array_equal(found.world_from_crop[0], np.eye(4))
    assert not found.channels.any()


def test_solid_of_a_box_has_its_volume_where_it_is() -> None:
    # 8 voxels wide, on the lines of the grid, and half a voxel higher than a whole number of them.
    sides = (8 * H, 8 * H, 4.5 * H)
    solid = solid_occupancy([cuboid(*sides)], [0], np.eye(4)[None])[0] / 255.0
    assert solid.sum() * H**3 == pytest.approx(np.prod(sides), rel=0.003)
    assert (solid[20:28, 20:28, 2:6] == 1.0).all()
    np.testing.assert_allclose(solid[20:28, 20:28, 6], 0.5, atol=0.003)
    moved = np.eye(4)
    moved[:2, 3] = [3 * H, -2 * H]
    elsewhere = solid_occupancy([cuboid(*sides)], [0], moved[None])[0] / 255.0
    np.testing.assert_array_equal(elsewhere, np.roll(solid, (3, -2), (0, 1)))


def test_solids_of_parts_of_an_object_fit_its_own_voxels() -> None:
    mesh = object_sets.load("procedural:mug:3")[0].load()
    solid = solid_occupancy([mesh], [0], graspbox.Scene(mesh).world_from_object[None])[0]
    assert solid.sum() / 255 * H**3 == pytest.approx(mesh.volume, rel=0.03)


def test_results_do_not_depend_on_threads() -> None:
    mesh = object_sets.load("procedural:mug:3")[0].load()
    view = graspbox.views(mesh, count=3, image_size=64)
    at = np.linalg.inv(view.world_from_camera)

    def results(threads: int) -> list[NDArray[Any]]:
        depth = add_depth_noise(view.depth, view.intrinsics, num_threads=threads)
        found = crop(depth, view.intrinsics, view.world_from_camera, num_threads=threads)
        solids = solid_occupancy([mesh], [0, 0, 0], at, num_threads=threads)
        return [depth, found.world_from_crop, found.channels, found.object, solids]

    for one, three in zip(results(1), results(3), strict=True):
        np.testing.assert_array_equal(one, three)


def test_wrong_arrays_are_refused_by_name() -> None:
    view = seen(cuboid(0.06, 0.06, 0.06))
    with pytest.raises(errors.ConfigError, match="world_from_camera"):
        crop(view.depth, view.intrinsics, view.world_from_camera[0])
    with pytest.raises(errors.ConfigError, match="world_from_camera has length 2"):
        crop(view.depth, view.intrinsics, np.repeat(view.world_from_camera, 2, axis=0))
    with pytest.raises(errors.ConfigError, match="labels are of dtype uint8"):
        crop(view.depth, view.intrinsics, view.world_from_camera, labels=view.segmentation)
    with pytest.raises(errors.ConfigError, match="resolution"):
        crop(view.depth, view.intrinsics, view.world_from_camera, config=CropConfig(resolution=2))
    with pytest.raises(errors.ConfigError, match="seeds has length 2"):
        add_depth_noise(view.depth, view.intrinsics, [1, 2])
    with pytest.raises(errors.ConfigError, match="mesh_of holds 1"):
        solid_occupancy([cuboid(0.1, 0.1, 0.1)], [1], np.eye(4)[None])


def test_camera_of_a_config_is_that_of_the_environments() -> None:
    import gymnasium

    env: Any = gymnasium.make("graspbox/GraspPose-v0", objects="procedural:can:0", obs="depth", image_size=(48, 64))
    env.reset(seed=0)
    intrinsics, pose = env.unwrapped.cameras()["front"]
    np.testing.assert_allclose(lens(CameraConfig().fov, (48, 64)), intrinsics)
    np.testing.assert_allclose(camera_pose(CameraConfig()), pose, atol=1e-9)
    with pytest.raises(errors.ConfigError, match="looks at"):
        camera_pose(CameraConfig(eye=(0.0, 0.0, 1.0), target=(0.0, 0.0, 0.0)))
