"""Reading data sets with our functions, polars, datasets and Ray Data; images, voxels and pairs of rows."""

from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import graspbox
from datasets_for_tests import OBJECTS, config
from graspbox import errors, object_sets
from graspbox.data import trials as dataset

pa = pytest.importorskip("pyarrow")


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("read")
    dataset.generate(OBJECTS, folder, config=config(images=True), runner=dataset.local(1))
    return folder


@pytest.fixture(scope="module")
def table(made: Path) -> Any:
    return dataset.load(made)


def test_splits_and_columns_can_be_chosen(made: Path, table: Any) -> None:
    parts = [dataset.load(made, split) for split in ("train", "validation", "test") if (made / "trials").glob(split)
             and list((made / "trials").glob(f"{split}-*"))]  # fmt: skip
    assert sum(len(part) for part in parts) == len(table)
    assert all(len(set(part["split"].to_pylist())) == 1 for part in parts)
    assert dataset.load(made, columns=["lift"]).column_names == ["lift"]
    with pytest.raises(errors.ConfigError, match="no split 'tests'"):
        dataset.load(made, "tests")
    with pytest.raises(errors.ConfigError, match="has no trials"):
        dataset.load(made / "images")
    with pytest.raises(errors.ConfigError, match="no column 'lifts'"):
        dataset.column(table, "lifts")
    with pytest.raises(errors.ConfigError, match="does not hold matrices"):
        dataset.matrices(table, "lift")


def test_polars_reads_it(made: Path, table: Any) -> None:
    polars = pytest.importorskip("polars")
    frame = polars.read_parquet(made / "trials" / "*.parquet").sort("scene", "trial")
    ours = table.sort_by([("scene", "ascending"), ("trial", "ascending")])
    assert frame.columns == ours.column_names
    assert frame["success"].to_list() == ours["success"].to_pylist()
    assert (frame["world_from_hand"].to_numpy().reshape(-1, 4, 4) == dataset.matrices(ours, "world_from_hand")).all()
    rate = frame.group_by("candidate").agg(polars.col("success").mean())
    assert len(rate) == len(set(ours["candidate"].to_pylist()))


def test_datasets_reads_it(made: Path, table: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Hugging Face's ``datasets`` finds configurations and splits by itself, offline."""
    monkeypatch.setenv("HF_HOME", str(tmp_path))
    monkeypatch.setenv("HF_HUB_OFFLINE", "1")
    datasets = pytest.importorskip("datasets")
    datasets.disable_progress_bars()
    found = datasets.load_dataset(str(made), cache_dir=str(tmp_path))
    assert set(found) == set(table["split"].to_pylist())
    assert sum(len(part) for part in found.values()) == len(table)
    for split, part in found.items():
        ours = dataset.load(made, split)
        assert part.column_names == ours.column_names
        hands = np.array(part.with_format("numpy", dtype=np.float64)["world_from_hand"][:]).reshape(-1, 4, 4)
        assert (hands == dataset.matrices(ours, "world_from_hand")).all()
    images = datasets.load_dataset(str(made), "images", cache_dir=str(tmp_path))
    assert sum(len(part) for part in images.values()) == 12


@pytest.mark.train
@pytest.mark.filterwarnings("ignore")
def test_ray_data_reads_it(made: Path, table: Any) -> None:
    ray = pytest.importorskip("ray")
    # "local": another test may be running a cluster on this machine, which an unnamed address would join.
    ray.init(address="local", num_cpus=1, include_dashboard=False, log_to_driver=False)
    try:
        found = import_module("ray.data").read_parquet(str(made / "trials"))
        assert found.count() == len(table)
        rows = sorted(found.take_all(), key=lambda row: (row["scene"], row["trial"]))
        ours = table.sort_by([("scene", "ascending"), ("trial", "ascending")])
        assert [row["lift"] for row in rows] == ours["lift"].to_pylist()
        hands = np.stack([np.asarray(row["world_from_hand"]) for row in rows]).reshape(-1, 4, 4)
        assert (hands == dataset.matrices(ours, "world_from_hand")).all()
    finally:
        ray.shutdown()


def test_rows_render_as_views_do(table: Any) -> None:
    """The bulk call gives the images of `graspbox.views`, pixel for pixel."""
    some = table.take([0, 15, 59])
    found = dataset.render(some, image_size=(24, 32), rgb=True)
    assert found.depth.shape == found.segmentation.shape == (3, 2, 24, 32)  # type: ignore[union-attr]
    for row in range(3):
        mesh = object_sets.load(some["source"][row].as_py())[0].load()
        rest = dataset.matrices(some, "world_from_object")[row]
        seen = graspbox.views(
            mesh,
            plan=config().cameras,
            count=2,
            seed=some["view_seed"][row].as_py(),
            image_size=(24, 32),
            images=("rgb", "segmentation"),
            fov=some["fov"][row].as_py(),
            world_from_object=rest,
            target=_middle(mesh, rest),
        )
        np.testing.assert_allclose(seen.world_from_camera, found.world_from_camera[row], atol=1e-12)
        np.testing.assert_allclose(seen.camera_from_object, found.camera_from_object[row], atol=1e-12)
        np.testing.assert_allclose(seen.intrinsics, found.intrinsics, atol=1e-12)
        for name in ("depth", "rgb", "segmentation"):
            assert (getattr(seen, name) == getattr(found, name)[row]).mean() > 0.999
        assert (found.segmentation[row] == 2).any()  # type: ignore[index]


def _middle(mesh: graspbox.Mesh, rest: Any) -> Any:
    points = mesh.vertices @ rest[:3, :3].T + rest[:3, 3]
    return (points.min(axis=0) + points.max(axis=0)) / 2


def test_render_takes_views_threads_and_other_cameras(table: Any) -> None:
    every = dataset.render(table, image_size=16)
    one = dataset.render(table, image_size=16, view=1, num_threads=1)
    assert (one.depth[:, 0] == every.depth[:, 1]).all()
    moved = every.world_from_camera.copy()
    moved[:, :, 2, 3] += 0.05
    other = dataset.render(table, image_size=16, world_from_camera=moved)
    assert (other.depth != every.depth).mean() > 0.5
    with pytest.raises(errors.ConfigError, match="view is 2; the rows have 2 cameras"):
        dataset.render(table, view=2)
    with pytest.raises(errors.ConfigError, match="world_from_camera has shape"):
        dataset.render(table, world_from_camera=moved[:3])
    hashes = pa.array(["0" * 64] * len(table))
    changed = table.set_column(table.column_names.index("sha256"), "sha256", hashes)
    with pytest.raises(errors.ConfigError, match="has changed"):
        dataset.render(changed)


def test_stored_images_are_the_rendered_ones(made: Path, table: Any) -> None:
    stored = dataset.load_images(made)
    depth, labels = dataset.stored_images(stored, (24, 32))
    again = dataset.render(table, image_size=(24, 32))
    rows = {name: row for row, name in enumerate(table["scene"].to_pylist())}
    for index, (name, view) in enumerate(zip(stored["scene"].to_pylist(), stored["view"].to_pylist(), strict=True)):
        row = rows[name]
        assert (depth[index] == graspbox.depth_millimetres(again.depth[row, view])).all()
        assert (labels[index] == again.segmentation[row, view]).all()  # type: ignore[index]
    assert len(stored) == 12
    with pytest.raises(errors.ConfigError, match="768 pixels"):
        dataset.stored_images(stored, 32)


def test_voxels_are_those_of_occupancy(table: Any) -> None:
    """The bulk call equals `graspbox.occupancy` scene by scene; the object is at its place in the image."""
    some = table.take([0, 30])
    seen = dataset.render(some, image_size=48)
    cells = dataset.voxels(seen, resolution=16, side=0.4)
    assert cells.shape == (2, 16, 16, 16)
    from graspbox.data.trials.images import grid_frames

    frames = grid_frames(seen)
    for row in range(2):
        poses = np.linalg.inv(frames[row]) @ seen.world_from_camera[row]
        alone = graspbox.occupancy(seen.depth[row], seen.intrinsics, poses, 16, (-0.2, -0.2, 0.0), 0.4)
        assert (alone == cells[row]).all()
        inside = cells[row][:, :, 1:] == 2
        assert inside.any()
        where = np.argwhere(inside).mean(axis=0)[:2] * 0.025 - 0.2 + 0.0125
        assert np.linalg.norm(where) < 0.05
    bare = dataset.render(some, segmentation=False)
    with pytest.raises(errors.ConfigError, match="no segmentation"):
        dataset.voxels(bare)


def test_pairs_of_images_and_poses(table: Any) -> None:
    success, scenes = dataset.column(table, "success"), dataset.column(table, "scene")
    winning = sorted({str(name) for name in scenes[success]})
    many, one, pooled = (pair(table) for pair in (dataset.one_to_many, dataset.one_to_one, dataset.many_to_one))
    assert sorted(e.scene for e in many) == sorted(e.scene for e in one) == sorted(winning * 2)
    for ambiguous, best in zip(many, one, strict=True):
        assert sorted(ambiguous.rows) == np.flatnonzero(success & (scenes == ambiguous.scene)).tolist()
        assert (ambiguous.views.tolist(), ambiguous.rows[0]) == (best.views.tolist(), best.rows.item())
    assert sorted(e.rows.item() for e in pooled) == np.flatnonzero(success).tolist()
    assert all(e.views.tolist() == [0, 1] for e in pooled)


def test_the_best_pose_is_robust_then_secure_then_still(table: Any) -> None:
    rows = table.slice(0, 4)

    def ordered(**columns: list[Any]) -> list[int]:
        plain: dict[str, list[Any]] = {
            "scene": ["a"] * 4,
            "success": [True] * 4,
            "secure": [True] * 4,
            "replays": [0] * 4,
            "replay_successes": [0] * 4,
            "kindness_rate": [0.1] * 4,
        }
        changed = rows
        for name, values in {**plain, **columns}.items():
            field = changed.schema.field(name)
            changed = changed.set_column(changed.column_names.index(name), field, pa.array(values, type=field.type))
        return list(dataset.one_to_many(changed)[0].rows)

    assert ordered(kindness_rate=[0.4, 0.3, 0.2, 0.1]) == [3, 2, 1, 0]
    assert ordered(kindness_rate=[0.4, 0.3, 0.2, 0.1], secure=[True, False, True, False]) == [2, 0, 3, 1]
    assert ordered(secure=[True, False, False, True], replays=[4] * 4, replay_successes=[1, 4, 2, 3]) == [1, 3, 2, 0]
    assert ordered(success=[True, False, False, True]) == [0, 3]


def test_trials_to_learn_from_are_read_shard_by_shard(made: Path, table: Any) -> None:
    """`GraspTrials.from_dataset` has the values of the rows of a split, and their scenes."""
    from graspbox.learn.models.trials import GraspTrials

    for split in sorted(set(table["split"].to_pylist())):
        rows = dataset.load(made, split)
        found = GraspTrials.from_dataset(made, split)
        assert len(found) == len(rows)
        np.testing.assert_array_equal(found.success, dataset.column(rows, "success"))
        np.testing.assert_array_equal(found.secure, dataset.column(rows, "secure"))
        np.testing.assert_array_equal(found.world_from_hand, dataset.matrices(rows, "executed_world_from_hand"))
        np.testing.assert_array_equal(
            found.world_from_object[found.scene_of], dataset.matrices(rows, "world_from_object")
        )
        assert found.source[found.scene_of].tolist() == rows["source"].to_pylist()
        assert found.slip.tolist() == [kind in ("slipped", "dropped") for kind in rows["failure"].to_pylist()]
    with pytest.raises(errors.ConfigError, match="no split"):
        GraspTrials.from_dataset(made, "tests")
