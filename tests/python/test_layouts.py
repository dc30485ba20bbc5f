"""Layouts of several objects: `graspbox.arrange`, ``graspbox scenes``, pictures of them."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import graspbox
from command_line import invoke
from graspbox import object_sets
from graspbox.errors import ConfigError, SimulationError
from graspbox.hands import cache_folder
from graspbox.simulation.layouts import SCALES, Layout, bin_points, draw_objects, wall_points

SETS = ["procedural:can:0-1", "procedural:mug:0-1", "procedural:banana:0"]
LAYOUTS: tuple[Layout, ...] = ("packed", "pile", "bin")


@pytest.fixture(scope="module")
def meshes() -> list[graspbox.Mesh]:
    return [spec.load() for spec in object_sets.load(SETS)]


@pytest.mark.parametrize("layout", LAYOUTS)
def test_objects_rest_on_the_table(meshes: list[graspbox.Mesh], layout: Layout) -> None:
    """They stay in the workspace, above the table; equal seeds give equal bits, on any hand's template."""
    found = graspbox.arrange(meshes, layout, seed=3)
    assert 1 <= len(found) == len(found.meshes) == len(found.world_from_objects) <= len(meshes)
    assert [mesh.name for mesh in found.meshes] == [meshes[index].name for index in found.objects]
    for mesh, pose in zip(found.meshes, found.world_from_objects, strict=True):
        heights = mesh.vertices @ pose[2, :3] + pose[2, 3]
        assert -0.002 < heights.min() < 0.3
        assert np.abs(pose[:2, 3]).max() < 0.25
        assert np.allclose(pose[:3, :3] @ pose[:3, :3].T, np.eye(3), atol=1e-9)
    assert found.world_from_walls.shape == ((4 if layout == "bin" else 0), 4, 4)
    assert found.wall_half_extents.shape == ((4 if layout == "bin" else 0), 3)
    again = graspbox.arrange(meshes, layout, seed=3)
    assert again.objects == found.objects
    assert np.array_equal(again.world_from_objects, found.world_from_objects)
    other = graspbox.arrange(meshes, layout, seed=4)
    assert other.objects != found.objects or not np.array_equal(other.world_from_objects, found.world_from_objects)
    assert repr(found).startswith(f"Arrangement('{layout}', {len(found)} objects: ")


def test_a_bin_has_its_sides(meshes: list[graspbox.Mesh]) -> None:
    found = graspbox.arrange(meshes[:2], "bin", inside=(0.4, 0.2, 0.1))
    along = found.world_from_walls[:, 0, 3]
    assert np.isclose(along.max(), 0.4 / 2 + 0.01)
    assert np.isclose(found.world_from_walls[:, 1, 3].min(), -0.2 / 2 - 0.01)
    assert np.allclose(2 * found.wall_half_extents[:, 2], 0.1)


@pytest.mark.parametrize("layout", LAYOUTS)
def test_objects_lie_as_far_apart_as_they_are_spread(meshes: list[graspbox.Mesh], layout: Layout) -> None:
    """Packed objects stand within 7 cm of the middle times the spread; a dropped banana hardly rolls."""

    def places(spread: float) -> np.ndarray:
        small = [mesh.scaled(0.4, None) for mesh in (meshes[:3] if layout == "packed" else meshes[-1:])]
        scenes = [graspbox.arrange(small, layout, spread=spread, seed=seed) for seed in range(12)]
        found = [
            pose[:2, :3] @ mesh.center_of_mass + pose[:2, 3]
            for scene in scenes
            for mesh, pose in zip(scene.meshes, scene.world_from_objects, strict=True)
        ]
        return np.abs(found)

    near, usual, far = (places(spread) for spread in (0.5, 1.0, 2.0))
    assert near.mean() < usual.mean() < far.mean()
    if layout == "packed":
        assert near.max() < 0.5 * 0.07 + 0.01 < far.max() < 2 * 0.07 + 0.01


def test_wrong_arguments_are_named(meshes: list[graspbox.Mesh]) -> None:
    with pytest.raises(ConfigError, match="layout is 'heap'; choose from packed, pile, bin"):
        graspbox.arrange(meshes, "heap")  # type: ignore[arg-type]
    for spread in (0.2, 2.1, float("nan")):
        with pytest.raises(ConfigError, match="spread"):
            graspbox.arrange(meshes, spread=spread)
    with pytest.raises(SimulationError, match="there is no object"):
        graspbox.arrange([])
    with pytest.raises(SimulationError, match="65 objects are too many"):
        graspbox.arrange([meshes[0]] * 65)
    for inside in ((0.3, 0.2), (0.3, 0.2, float("nan")), "wide"):
        with pytest.raises(ConfigError, match="inside is"):
            graspbox.arrange(meshes, "bin", inside=inside)  # type: ignore[arg-type]
    with pytest.raises(ConfigError, match="inside"):
        graspbox.arrange(meshes, "bin", inside=(300.0, 200.0, 100.0))
    with pytest.raises(ConfigError, match="seed"):
        graspbox.arrange(meshes, seed=-1)
    with pytest.raises(ConfigError, match="0 of 5 objects cannot be drawn"):
        draw_objects(object_sets.load(SETS), 0, "pile", 0)


@pytest.mark.parametrize("layout", LAYOUTS)
def test_objects_are_drawn_at_a_scale(layout: Layout) -> None:
    """With replacement, one per attempt, each at its own scale; a known mass grows with the volume."""
    specs = object_sets.load("procedural:can:0-9")
    drawn = draw_objects(specs, 5, layout, 1)
    assert len(drawn) == (12 if layout == "packed" else 5)
    low, high = SCALES[layout]
    assert all(low <= spec.scale <= high for spec in drawn)
    assert len({spec.scale for spec in drawn}) == (1 if low == high else len(drawn))
    names = [{spec.name for spec in draw_objects(specs, 5, layout, seed)} for seed in range(20)]
    assert min(len(chosen) for chosen in names) < min(len(drawn), len(specs)), "no object was drawn twice in 20 scenes"
    assert set().union(*names) == {spec.name for spec in specs}
    assert [spec.scale for spec in draw_objects(specs, 5, layout, 1)] == [spec.scale for spec in drawn]
    ball = draw_objects(object_sets.load("ycb:055_baseball"), 1, layout, 0)[0]
    whole = object_sets.load("ycb:055_baseball")[0]
    assert ball.mass is not None
    assert whole.mass is not None
    assert np.isclose(ball.mass, whole.mass * ball.scale**3)


def test_drawn_objects_are_one_attempt_each(meshes: list[graspbox.Mesh]) -> None:
    """A scene has at most the wanted number of objects; objects that a caller names are all wanted."""
    small = [mesh.scaled(0.3, cache_folder()) for mesh in meshes] * 4
    found = graspbox.arrange(small, "packed", most=3, seed=3)
    assert len(found) == 3
    assert max(graspbox.arrange(small, "packed", most=20, seed=3).objects) < 12
    assert max(graspbox.arrange(small, "packed", seed=3).objects) > 12
    assert graspbox.arrange(small, "pile", most=2, seed=3).objects == (0, 1)
    for most in (-1, 1.5):
        with pytest.raises(ConfigError, match="most is"):
            graspbox.arrange(small, "packed", most=most)  # type: ignore[arg-type]


def test_the_command_lists_and_draws_scenes(tmp_path: Path) -> None:
    picture = tmp_path / "scenes.png"
    command = ["scenes", "--objects", "procedural:can:0-4", "--layout", "bin", "--scenes", "2", "--seed", "5"]
    found = invoke([*command, "--objects-per-scene", "3", "--json", "--picture", str(picture)])
    assert found.exit_code == 0, found.output
    scenes = json.loads(found.stdout)
    assert [scene["seed"] for scene in scenes] == [5, 6]
    for scene in scenes:
        assert scene["layout"] == "bin"
        assert len(scene["objects"]) + scene["missing"] == 3
        assert len(scene["walls"]) == 4
        assert all(np.shape(thing["world_from_object"]) == (4, 4) for thing in scene["objects"])
    assert picture.stat().st_size > 10_000
    table = invoke(command)
    assert table.exit_code == 0
    assert "bin: 2 scenes" in table.stdout


def test_pictures_show_a_few_scenes(tmp_path: Path, meshes: list[graspbox.Mesh]) -> None:
    from graspbox.pictures import save_arrangements

    scene = graspbox.arrange(meshes[:1], "packed")
    with pytest.raises(ConfigError, match="13 arrangements; pass 1 to 12"):
        save_arrangements(tmp_path / "a.png", [scene] * 13)
    with pytest.raises(ConfigError, match="extension"):
        save_arrangements(tmp_path / "a.txt", [scene])
    save_arrangements(tmp_path / "a.png", [scene])
    assert (tmp_path / "a.png").exists()


def test_points_fill_the_walls_of_a_bin(meshes: list[graspbox.Mesh]) -> None:
    points = bin_points((0.3, 0.2, 0.1), spacing=0.01, inset=0.0)
    half = np.array([0.15, 0.1])
    outside = np.abs(points[:, :2]) >= half - 1e-9
    assert outside.any(axis=1).all(), "none stands inside"
    assert points[:, 2].max() == pytest.approx(0.1)
    assert np.abs(points[:, :2]).max(axis=0) == pytest.approx(half + 0.02, abs=1e-9)
    # Every place of a wall has a point nearby.
    rng = np.random.default_rng(0)
    places = np.stack([rng.uniform(0.15, 0.17, 200), rng.uniform(-0.1, 0.1, 200), rng.uniform(0.0, 0.1, 200)], axis=-1)
    nearest = np.linalg.norm(places[:, None] - points, axis=-1).min(axis=1)
    assert nearest.max() <= 0.0087 + 1e-9, "half the diagonal of a cell of 10 mm"
    deeper = bin_points((0.3, 0.2, 0.1))
    assert (np.abs(deeper[:, :2]) >= half + 0.004 - 1e-9).any(axis=1).all()
    found = graspbox.arrange(meshes[:1], "bin", inside=(0.3, 0.2, 0.1))
    np.testing.assert_array_equal(wall_points(found.world_from_walls, found.wall_half_extents), deeper)
    assert wall_points(np.zeros((0, 4, 4)), np.zeros((0, 3))).shape == (0, 3)
    refused: tuple[dict[str, Any], ...] = (
        {"spacing": 0.0},
        {"inset": 0.02},
        {"inside": (0.3, 0.2)},
        {"inside": (0.3, 0.2, 20.0)},
    )
    for wrong in refused:
        with pytest.raises(ConfigError):
            bin_points(**{"inside": (0.3, 0.2, 0.1), **wrong})
