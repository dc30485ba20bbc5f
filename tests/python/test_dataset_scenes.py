"""Data sets of scenes of several objects: rows, images, replays and training."""

import pickle
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import graspbox
from graspbox.data import trials as dataset
from graspbox.errors import ConfigError
from graspbox.learn.models.cluttered import is_scene, read_scene
from graspbox.learn.models.scenes import SceneConfig
from graspbox.learn.models.trials import GraspTrials
from graspbox.perception import HandGrid, HandGridConfig
from graspbox.perception.anchors import Anchors

HAND = "panda_gripper"
OBJECTS = ["procedural:can:0-3", "procedural:box:0-1"]


def settings(**changes: Any) -> dataset.DatasetConfig:
    values = {
        "layout": "pile",
        "objects_per_scene": (2, 3),
        "poses": 8,
        "views": 1,
        "images": True,
        "image_size": (48, 64),
    }
    return dataset.DatasetConfig(**{**values, **changes})


@pytest.fixture(scope="module")
def piles(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("piles")
    dataset.generate(OBJECTS, folder, hand=HAND, config=settings(), runner=dataset.local(1))
    return folder


def test_neighbours_are_of_the_same_split_and_scaled(piles: Path) -> None:
    table = dataset.load(piles)
    splits = dict(zip(table["object"].to_pylist(), table["split"].to_pylist(), strict=True))
    assert set(table["layout"].to_pylist()) == {"pile"}
    for row in table.to_pylist():
        assert 0.8 <= row["size_factor"] <= 1.0
        for each in row["neighbours"]:
            assert splits.get(each["object"], row["split"]) == row["split"]
            assert 0.8 <= each["size_factor"] <= 1.0
            assert len(each["world_from_object"]) == 16
        assert row["walls"] == []
    assert max(len(each) for each in table["neighbours"].to_pylist()) == 2


def test_rows_do_not_depend_on_the_processes(piles: Path, tmp_path: Path) -> None:
    dataset.generate(OBJECTS, tmp_path, hand=HAND, config=settings(), runner=dataset.local(2))
    files = sorted(path.relative_to(piles) for path in piles.rglob("*.parquet"))
    assert files
    assert all((piles / name).read_bytes() == (tmp_path / name).read_bytes() for name in files)


def test_rendered_images_are_those_stored(piles: Path) -> None:
    """The object has the label 2, each neighbour one of its own."""
    stored = dataset.load_images(piles)
    depth, labels = dataset.stored_images(stored, (48, 64))
    table = dataset.load(piles)
    first = [table["scene"].to_pylist().index(name) for name in stored["scene"].to_pylist()]
    seen = dataset.render(table.take(first), image_size=(48, 64))
    assert seen.segmentation is not None
    assert (seen.segmentation[:, 0] == labels).all()
    assert np.abs(1000.0 * seen.depth[:, 0] - depth)[depth > 0].max() <= 0.51
    neighbours = [len(table["neighbours"][index]) for index in first]
    assert all(image.max() <= 2 + count for image, count in zip(labels, neighbours, strict=True))
    assert any(image.max() > 2 for image in labels)


def test_a_trial_is_repeated(piles: Path) -> None:
    table = dataset.load(piles)
    for index in range(0, len(table), 9):
        row = table.slice(index, 1)
        values = {name: row[name].to_pylist()[0] for name in row.column_names}
        scene = dataset.scene_of(row)
        pose = np.array(values["executed_object_from_hand"]).reshape(4, 4)
        factors = {name: values[f"{name}_factor"] for name in ("friction", "mass")}
        again, trace = scene.trace(pose, values["preshape"], **factors, config=graspbox.TrialConfig())
        assert again.failure[0] == values["failure"]
        assert (len(trace.time) == 0) == (values["failure"] == "infeasible")
    with pytest.raises(ConfigError, match="row has 2 rows"):
        dataset.scene_of(table.slice(0, 2))


def test_bins_have_walls(tmp_path: Path) -> None:
    config = settings(layout="bin", bin_size=(0.24, 0.2, 0.05), images=False)
    dataset.generate(["procedural:can:0-1"], tmp_path, hand=HAND, config=config, runner=dataset.local(1))
    table = dataset.load(tmp_path)
    walls = table["walls"][0].as_py()
    assert len(walls) == 4
    scene = dataset.scene_of(table.slice(0, 1))
    copy = pickle.loads(pickle.dumps(scene))
    assert (copy.world_from_object == scene.world_from_object).all()
    trials = GraspTrials.from_dataset(tmp_path, table["split"][0].as_py())
    assert len(read_scene(str(trials.source[0])).wall_half_extents) == 4


def test_trainings_read_all_objects(piles: Path) -> None:
    table, trials = dataset.load(piles, "train"), GraspTrials.from_dataset(piles, "train")
    assert len(trials) == len(table)
    for source, first in zip(trials.source, np.unique(trials.scene_of, return_index=True)[1], strict=True):
        assert is_scene(str(source))
        placed = read_scene(str(source))
        assert len(placed.meshes) == 1 + len(table["neighbours"][int(first)])
        expected = np.array(table["world_from_object"][int(first)].as_py()).reshape(4, 4)
        np.testing.assert_allclose(placed.world_from_objects[0], expected, atol=1e-6)


@pytest.mark.train
def test_heads_refuse_scenes_of_several_objects(piles: Path) -> None:
    pytest.importorskip("torch")
    from graspbox.learn.models.head.batches import HeadSampler

    trials = GraspTrials.from_dataset(piles, "train")
    grid = HandGrid(graspbox.load_hand(HAND), HandGridConfig())
    sampler = HeadSampler(trials, grid, Anchors(len(grid.hand.preshapes)), SceneConfig(), 0, 1)
    with pytest.raises(ConfigError, match="scenes of one object"):
        sampler.view(0, 0)


def test_trainings_know_the_scale(tmp_path: Path) -> None:
    """Objects of a scaled set are rendered at their scale."""
    objects = graspbox.object_sets.load("procedural:can:0-1", scale=0.8)
    config = settings(layout="single", images=False)
    dataset.generate(objects, tmp_path, hand=HAND, config=config, runner=dataset.local(1))
    (source, *_) = GraspTrials.from_dataset(tmp_path, objects[0].split).source
    (mesh,) = read_scene(str(source)).meshes
    np.testing.assert_allclose(mesh.bounds, objects[0].load().bounds, atol=1e-6)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"layout": "heap"}, "layout is 'heap'; choose from single, packed, pile, bin"),
        ({"objects_per_scene": (3, 2)}, r"objects_per_scene is \(3, 2\)"),
        ({"objects_per_scene": (0, 2)}, "from 1 to 40"),
        ({"objects_per_scene": (1.0, 2)}, "from 1 to 40"),
        ({"spread": 3.0}, "spread is 3.0"),
        ({"layout": "single", "spread": 0.5}, "spread is 0.5, but layout 'single'"),
        ({"layout": "bin", "bin_size": (300.0, 200.0, 100.0)}, "300"),
    ],
)
def test_wrong_settings_are_refused(changes: dict[str, Any], message: str, tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=message):
        dataset.generate(OBJECTS, tmp_path, hand=HAND, config=settings(**changes), runner=dataset.local(1))


def test_only_the_target_counts() -> None:
    meshes = [spec.load() for spec in graspbox.object_sets.load("procedural:can:0-2")]
    found = graspbox.arrange(meshes, "packed", seed=3, hand=HAND)
    assert len(found) > 1
    own, other = (graspbox.Scene.of(found, target=index, hand=HAND) for index in (0, 1))
    assert own.mesh.name == found.meshes[0].name
    plan = graspbox.plan(
        own.mesh, hand=HAND, world_from_object=own.world_from_object, neighbours=found.without(0)
    ).best(4)
    assert own.simulate(plan.poses, plan.preshape).success.any()
    seen_from_other = np.linalg.inv(other.world_from_object) @ own.world_from_object @ plan.poses
    assert not other.simulate(seen_from_other, plan.preshape).success.any()
    with pytest.raises(ConfigError, match="target"):
        graspbox.Scene.of(found, target=7, hand=HAND)
