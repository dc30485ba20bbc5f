"""Data sets: the same rows however they are made, resumption, errors, the manifest."""

import errno
import hashlib
import json
from collections.abc import Iterator
from multiprocessing import active_children
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import graspbox
from datasets_for_tests import OBJECTS, config, contents, run
from graspbox import errors, object_sets
from graspbox.data import trials as dataset
from graspbox.planning.plan_files import mesh_hash

pytest.importorskip("pyarrow")


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("made")
    dataset.generate(OBJECTS, folder, config=config(images=True), runner=dataset.local(1))
    return folder


def test_workers_do_not_change_a_byte(made: Path, tmp_path: Path) -> None:
    seen: list[dataset.Progress] = []
    result = dataset.generate(
        OBJECTS, tmp_path, config=config(images=True), runner=dataset.local(2), progress=seen.append
    )
    assert contents(tmp_path) == contents(made)
    assert result.made == len(seen) - 1 == 6
    assert (seen[0].trials, seen[0].remaining) == (0, float("inf"))
    assert (seen[-1].trials, seen[-1].total, seen[-1].remaining) == (60, 60, 0.0)
    assert seen[-1].rate > 0


def test_rows_can_be_replayed(made: Path) -> None:
    """A row holds all that its outcome depends on: another simulation gives the same outcome, bit for bit."""
    table = dataset.load(made)
    column = {name: dataset.column(table, name) for name in ("success", "failure", "lift", "time", "preshape", "mass")}
    factors = [dataset.column(table, f"{name}_factor") for name in ("friction", "mass")]
    poses, rests = dataset.matrices(table, "executed_object_from_hand"), dataset.matrices(table, "world_from_object")
    scenes = dataset.column(table, "scene")
    assert column["success"].any()
    assert not column["success"].all()
    for name in np.unique(scenes):
        rows = np.flatnonzero(scenes == name)
        first = rows[0]
        mesh = object_sets.load(str(dataset.column(table, "source")[first]))[0].load()
        assert mesh_hash(mesh) == dataset.column(table, "sha256")[first]
        np.testing.assert_allclose(column["mass"][rows], mesh.mass * factors[1][rows], rtol=1e-15)
        again = graspbox.Scene(mesh, world_from_object=rests[first])
        # Settling again from the resting pose moves the object by no more than it moved at rest.
        assert np.abs(again.world_from_object - rests[first]).max() < 1e-3
        out = again.simulate(poses[rows], column["preshape"][rows], friction=factors[0][rows], mass=factors[1][rows])
        same = (out.success == column["success"][rows]).mean()
        assert same >= 0.9


def test_columns_agree_with_each_other(made: Path) -> None:
    table = dataset.load(made)
    assert table.column_names == [column.name for column in dataset.TRIALS]
    rest = dataset.matrices(table, "world_from_object")
    for name in ("", "executed_"):
        world, inside = (dataset.matrices(table, f"{name}{frame}_from_hand") for frame in ("world", "object"))
        np.testing.assert_allclose(rest @ inside, world, atol=1e-12)
    nominal, executed = (dataset.matrices(table, f"{name}world_from_hand") for name in ("", "executed_"))
    error = np.linalg.inv(nominal) @ executed
    settings = config()
    assert np.abs(error[:, :3, 3]).max() <= settings.hand_position
    angle = np.arccos(np.clip((np.trace(error[:, :3, :3], axis1=1, axis2=2) - 1) / 2, -1, 1))
    assert angle.max() <= np.sqrt(3) * settings.hand_rotation
    assert angle.min() > 0
    for name in ("friction", "mass"):
        low, high = getattr(settings, name)
        factor = dataset.column(table, f"{name}_factor")
        assert low <= factor.min() < factor.max() <= high
    assert len(set(zip(table["scene"].to_pylist(), table["trial"].to_pylist(), strict=True))) == len(table) == 60
    planned = dataset.column(table, "candidate") == "planner"
    assert (dataset.column(table, "rank")[planned] >= 0).all()
    assert (dataset.column(table, "rank")[~planned] == -1).all()
    assert np.isnan(dataset.column(table, "score")[~planned]).all()
    cameras = dataset.matrices(table, "world_from_camera")
    assert cameras.shape == (60, 2, 4, 4)


def test_outcomes_are_those_of_the_simulation(made: Path) -> None:
    """Every field of an outcome is a column, found by its name: a new field becomes a column of its own."""
    names = [column.name for column in dataset.TRIALS if column.meaning.startswith("outcome: ")]
    assert names == list(graspbox.Outcome.__dataclass_fields__)
    assert all(len(column.meaning) > 12 for column in dataset.TRIALS)
    table = dataset.load(made)
    success = dataset.column(table, "success")
    assert ((dataset.column(table, "failure") == "") == success).all()
    assert (dataset.column(table, "lift")[success] >= 0.15).all()


def test_success_can_be_shaken(tmp_path: Path) -> None:
    trial = graspbox.TrialConfig(shake=graspbox.ShakeConfig())
    dataset.generate("procedural:can:0", tmp_path, config=config(rests=1, trial=trial), runner=dataset.local(1))
    table = dataset.load(tmp_path)
    success, survives = dataset.column(table, "success"), dataset.column(table, "survives_shake")
    assert (np.isfinite(dataset.column(table, "shake_shift")) == success).all()
    assert success[survives].all()
    assert success.any()


def test_manifest_tells_what_there_is(made: Path) -> None:
    found = json.loads((made / "manifest.json").read_text())
    assert found["complete"] is True
    assert found["versions"]["graspbox"] == graspbox.__version__
    assert sum(shard["trials"] for shard in found["shards"]) == 60
    for shard in found["shards"]:
        content = (made / "trials" / shard["name"]).read_bytes()
        assert hashlib.sha256(content).hexdigest() == shard["sha256"]
    table = dataset.load(made)
    for split, counts in found["counts"].items():
        rows = dataset.load(made, split)
        assert counts["trials"] == len(rows)
        assert counts["success"] == dataset.column(rows, "success").sum()
    assert {o["name"]: o["sha256"] for o in found["objects"]} == dict(
        zip(table["object"].to_pylist(), table["sha256"].to_pylist(), strict=True)
    )
    assert all(o["licence"].startswith("Apache-2.0") for o in found["objects"])
    assert {o["name"]: o["split"] for o in found["objects"]} == {s.name: s.split for s in object_sets.load(OBJECTS)}


def test_resumes_what_is_missing(made: Path, tmp_path: Path) -> None:
    settings = config(images=True)
    dataset.generate(OBJECTS, tmp_path, config=settings, runner=dataset.local(1))
    shards = sorted(path.name for path in (tmp_path / "trials").iterdir())
    (tmp_path / "trials" / shards[1]).unlink()
    (tmp_path / "images" / shards[3]).unlink()
    (tmp_path / "trials" / f".{shards[0][:-8]}-0a1b2c3d.parquet").write_bytes(b"half")
    result = dataset.generate(OBJECTS, tmp_path, config=settings, runner=dataset.local(1))
    assert (result.made, result.resumed, result.trials) == (2, 4, 20)
    assert contents(tmp_path) == contents(made)


def test_a_part_of_a_data_set_is_diverse(tmp_path: Path) -> None:
    order: list[str] = []
    splits: list[str] = []

    def stop(shards: Any, *_: Any) -> Iterator[Any]:
        order.extend(shard.tasks[0].target.spec.family for shard in shards)
        splits.extend(shard.name.partition("-")[0] for shard in shards)
        yield from ()

    objects = ["procedural:can:0-29", "procedural:box:0-29"]
    dataset.generate(objects, tmp_path, config=config(rests=1), runner=stop)
    assert len(order) == 60
    assert 5 < order[:20].count("can") < 15
    assert sorted(order) != order
    assert sorted(order, reverse=True) != order
    # Two workers soon have trials to learn from and to validate with.
    assert splits[:3] == ["train", "validation", "test"]
    assert splits[3:] != sorted(splits[3:], key=["train", "validation", "test"].index)


def test_other_settings_are_refused(made: Path) -> None:
    before = contents(made)
    with pytest.raises(errors.ConfigError, match=r"config\.seed was 0, is now 1"):
        dataset.generate(OBJECTS, made, config=config(images=True, seed=1))
    with pytest.raises(errors.ConfigError, match=r"1 objects more \(can-000002\)"):
        dataset.generate([*OBJECTS, "procedural:can:2"], made, config=config(images=True))
    with pytest.raises(errors.ConfigError, match="panda"):
        dataset.generate(OBJECTS, made, config=config(images=True), hand="panda_gripper")
    with pytest.raises(errors.ConfigError, match="holds a data set already"):
        dataset.generate(OBJECTS, made, config=config(images=True), resume=False)
    assert contents(made) == before


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"poses": 0}, "poses is 0"),
        ({"views": -1}, "views is -1"),
        ({"friction": (0.0, 1.0)}, "friction is"),
        ({"hand_position": 1.0}, "hand_position is 1.0"),
        ({"candidates": dataset.CandidateShares(planner=0.5)}, "sum to 1"),
        ({"images": True, "views": 0}, "views is 0"),
    ],
)
def test_bad_settings_are_named(tmp_path: Path, change: dict[str, object], words: str) -> None:
    with pytest.raises(errors.ConfigError, match=words):
        dataset.generate(OBJECTS, tmp_path / "x", config=config(**change))
    assert not (tmp_path / "x").exists()


def test_shards_without_a_manifest_are_refused(tmp_path: Path) -> None:
    settings = config(rests=1)
    dataset.generate("procedural:can:0", tmp_path, config=settings, runner=dataset.local(1))
    (tmp_path / "manifest.json").unlink()
    with pytest.raises(errors.ConfigError, match=r"shards but no manifest\.json"):
        dataset.generate("procedural:can:0", tmp_path, config=settings)


def test_two_writers_are_refused(tmp_path: Path) -> None:
    """While one makes a data set, another learns that the folder is in use."""
    refused = []

    def second(_: dataset.Progress) -> None:
        try:
            dataset.generate("procedural:can:0", tmp_path, config=config(rests=1))
        except errors.ConfigError as error:
            refused.append(str(error))

    dataset.generate("procedural:can:0", tmp_path, config=config(rests=1), runner=dataset.local(1), progress=second)
    assert len(refused) == 2
    assert "another process is writing" in refused[0]


def test_a_killed_worker_is_reported(made: Path, tmp_path: Path) -> None:
    """As when memory runs out: an error says so, complete shards stay, and the same call resumes."""

    def kill(progress: dataset.Progress) -> None:
        if progress.made:
            for child in active_children():
                child.kill()

    settings = config(images=True)
    with pytest.raises(errors.GraspboxError, match="a worker process was killed"):
        dataset.generate(OBJECTS, tmp_path, config=settings, runner=dataset.local(2), progress=kill)
    whole = contents(made)
    assert all(whole[path] == content for path, content in contents(tmp_path).items() if path.endswith(".parquet"))
    dataset.generate(OBJECTS, tmp_path, config=settings, runner=dataset.local(1))
    assert contents(tmp_path) == whole


def test_full_disk_loses_nothing(made: Path, tmp_path: Path) -> None:
    """The disk is full; complete shards stay, and the same call resumes."""
    name = sorted(path.name for path in (made / "trials").iterdir())[2]
    (tmp_path / "trials").mkdir()
    (tmp_path / "trials" / name).symlink_to("/dev/full")
    with pytest.raises(errors.FileError, match=r"No space left.*of 6 shards are complete") as caught:
        dataset.generate(OBJECTS, tmp_path, config=config(images=True), runner=dataset.local(1))
    assert caught.value.errno == errno.ENOSPC
    complete = {path: content for path, content in contents(tmp_path).items() if path.startswith("trials/")}
    assert 0 < len(complete) < 6
    assert all(contents(made)[path] == content for path, content in complete.items())
    (tmp_path / "trials" / name).unlink()
    dataset.generate(OBJECTS, tmp_path, config=config(images=True), runner=dataset.local(1))
    assert contents(tmp_path) == contents(made)


def test_objects_that_are_refused_are_named(tmp_path: Path) -> None:
    (tmp_path / "flat.off").write_text("OFF\n3 1 0\n0 0 0\n0.1 0 0\n0 0.1 0\n3 0 1 2\n")
    result = dataset.generate(
        ["procedural:can:0", str(tmp_path / "flat.off")],
        tmp_path / "out",
        config=config(rests=1),
        runner=dataset.local(1),
    )
    assert list(result.manifest["refused"]) == ["flat/0"]
    assert "MeshError" in result.manifest["refused"]["flat/0"]
    assert result.manifest["complete"]
    assert result.trials == 10


def test_scene_without_a_free_pose_is_named(tmp_path: Path) -> None:
    """A small hand that must keep 5 cm away grasps nothing: there are no rows, and the manifest says why."""
    planning = graspbox.PlanConfig(clearance=0.05, poses=graspbox.PoseConfig(standoffs=()))
    settings = config(rests=1, views=0, planning=planning)
    result = dataset.generate(
        "procedural:can:0", tmp_path, hand="panda_gripper", config=settings, runner=dataset.local(1)
    )
    assert result.manifest["complete"]
    assert "no candidate pose of can-000000/0 is free" in result.manifest["refused"]["can-000000/0"]
    assert (result.trials, len(dataset.load(tmp_path))) == (0, 0)


def test_scenes_need_no_camera(tmp_path: Path) -> None:
    dataset.generate("procedural:can:0", tmp_path, config=config(rests=1, views=0), runner=dataset.local(1))
    table = dataset.load(tmp_path)
    assert dataset.matrices(table, "world_from_camera").shape == (10, 0, 4, 4)
    assert dataset.one_to_many(table) == dataset.many_to_one(table) == []


def test_replays_are_for_held_out_splits(tmp_path: Path) -> None:
    objects = object_sets.load("procedural:0-3")
    chosen = [next(spec for spec in objects if spec.split == split) for split in ("train", "validation", "test")]
    settings = config(poses=6, rests=1, replays=3, shard_trials=6)
    result = dataset.generate(
        object_sets.ObjectSet("three", tuple(chosen)), tmp_path, config=settings, runner=dataset.local(1)
    )
    assert not result.manifest["refused"]
    for split, replays in (("train", 0), ("validation", 3), ("test", 3)):
        rows = dataset.load(tmp_path, split)
        assert (dataset.column(rows, "replays") == replays).all()
        wins, secure = (dataset.column(rows, f"replay_{name}") for name in ("successes", "secure"))
        assert (secure <= wins).all()
        assert (wins <= replays).all()
    held_out = dataset.load(tmp_path, "validation")
    assert dataset.column(held_out, "replay_successes").sum() > 0


def test_same_files_share_a_split(tmp_path: Path) -> None:
    """Copies under names whose own splits differ stay on one side."""
    names = {"train": "", "test": ""}
    for i in range(200):
        names[object_sets.ObjectSpec(f"copy{i}").split] = f"copy{i}"
    content = object_sets.load("ycb:062_dice")[0].path.read_bytes()  # type: ignore[union-attr]
    for name in (names["train"], names["test"]):
        (tmp_path / f"{name}.stl").write_bytes(content)
    from graspbox.data.trials.manifest import grouped_objects

    grouped = grouped_objects(object_sets.load(f"dir:{tmp_path}").objects)
    assert len({one.split for one in grouped}) == 1
    assert len({one.group for one in grouped}) == 1
    assert len({one.spec.split for one in grouped}) == 2


def test_command_line(tmp_path: Path) -> None:
    first = run(tmp_path / "out", "--json", "--workers", "1", "--images", "--image-size", "16")
    assert first.returncode == 0, first.stderr
    table = json.loads(first.stdout)
    assert table["complete"]
    assert table["shards"] == {"made": 6, "resumed": 0}
    assert sum(counts["trials"] for counts in table["counts"].values()) == 60
    again = run(tmp_path / "out", "--json", "--workers", "1", "--images", "--image-size", "16")
    assert json.loads(again.stdout)["shards"] == {"made": 0, "resumed": 6}
    other = run(tmp_path / "out", "--workers", "1", "--images", "--image-size", "16", "--seed", "3")
    assert (other.returncode, "config.seed was 0, is now 3" in other.stderr) == (2, True)
    kept = run(tmp_path / "out", "--no-resume", "--images", "--image-size", "16")
    assert (kept.returncode, "holds a data set already" in kept.stderr) == (2, True)
