"""A camera's pose is corrected by the table in its image."""

import numpy as np
import pytest
from numpy.typing import NDArray

import graspbox
from graspbox import object_sets
from graspbox.configs.cameras import lens
from graspbox.errors import ConfigError
from graspbox.meshes.views import Views
from graspbox.perception import PoseNoise, add_depth_noise
from graspbox.perception.leveling import level
from graspbox.perception.perturbations import perturbed


def turned(axis: int, angle: float) -> NDArray[np.float64]:
    """Rotate about x (0) or y (1)."""
    found = np.eye(4)
    i, j = [k for k in range(3) if k != axis]
    found[[i, j], [i, j]], found[i, j], found[j, i] = np.cos(angle), -np.sin(angle), np.sin(angle)
    return found


def plane(intrinsics: NDArray[np.float64], world_from_camera: NDArray[np.float64]) -> NDArray[np.float64]:
    """Render an empty table from above, 48 x 64 pixels, metres."""
    rows, columns = np.indices((48, 64))
    rays = np.stack([columns + 0.5, rows + 0.5, np.ones((48, 64))], axis=-1) @ np.linalg.inv(intrinsics).T
    return np.asarray(-world_from_camera[2, 3] / (rays @ world_from_camera[2, :3]))


ABOVE = np.diag([1.0, -1.0, -1.0, 1.0]) + np.array([[0, 0, 0, 0.1], [0, 0, 0, 0.2], [0, 0, 0, 0.6], [0, 0, 0, 0]])
LENS = lens(0.8, (48, 64))


@pytest.mark.parametrize("axis", [0, 1])
def test_a_tilted_camera_is_found_exactly(axis: int) -> None:
    """On an empty table: the camera is turned about itself, and lifted."""
    true = ABOVE @ turned(axis, 0.03)
    depth = plane(LENS, true)
    wrong = ABOVE.copy()
    wrong[2, 3] += 0.015
    np.testing.assert_allclose(level(depth, LENS, wrong), true, atol=1e-9)
    assert level(depth, LENS, true) is true


def test_small_deviations_are_left_alone_and_large_ones_too() -> None:
    depth = plane(LENS, ABOVE)
    for height, tilt in ((0.0015, 0.0), (0.0, 0.004), (0.06, 0.0), (0.0, 0.1)):
        wrong = ABOVE @ turned(0, tilt)
        wrong[2, 3] += height
        assert level(depth, LENS, wrong) is wrong


def test_images_without_a_table_change_nothing() -> None:
    depth = plane(LENS, ABOVE)
    depth[:, 12:] -= 0.1
    wrong = ABOVE.copy()
    wrong[2, 3] += 0.01
    for given in (depth, np.zeros_like(depth), np.full_like(depth, np.nan)):
        assert level(given, LENS, wrong) is wrong


@pytest.mark.parametrize("name", ["procedural:plate:4", "procedural:kettle:0", "procedural:spoon:3"])
def test_objects_do_not_lift_the_table(name: str) -> None:
    """A plate fills most of the image, some millimetres above the table."""
    seen: Views = graspbox.views(object_sets.load(name)[0].load(), count=6, image_size=128, images="depth")
    noisy = 0.001 * add_depth_noise(seen.depth, seen.intrinsics, 0).astype(np.float64)
    noise = PoseNoise(0.008, 0.015)
    moved = perturbed(np.asarray(seen.world_from_camera), np.random.default_rng(0), noise.position, noise.rotation)
    marks = np.array([[0.1, 0.1, 0, 1], [-0.1, 0.1, 0, 1], [0.0, -0.1, 0, 1]]).T
    for depth, true, wrong in zip(noisy, np.asarray(seen.world_from_camera), moved, strict=True):
        assert level(depth, seen.intrinsics, true) is true
        in_camera = np.linalg.inv(true) @ marks
        found = level(depth, seen.intrinsics, wrong)
        assert np.abs((found @ in_camera)[2]).max() < 0.003
        np.testing.assert_allclose(found[:3, :3] @ found[:3, :3].T, np.eye(3), atol=1e-12)


def test_arrays_of_other_shapes_are_refused() -> None:
    depth = plane(LENS, ABOVE)
    for given, said in (
        ((depth[None], LENS, ABOVE), "depth has shape"),
        ((depth, LENS[:2], ABOVE), "intrinsics has shape"),
        ((depth, LENS, ABOVE[:3]), "world_from_camera has shape"),
        ((depth, np.zeros((3, 3)), ABOVE), "focal lengths"),
        # The fit did not end.
        ((depth, LENS, ABOVE + 1e155 * np.eye(4)[:, [3, 1, 2, 0]]), "pass metres, at most 10000"),
        ((depth, LENS, ABOVE * np.nan), "pass metres, at most 10000"),
    ):
        with pytest.raises(ConfigError, match=said):
            level(*given)
