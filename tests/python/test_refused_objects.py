"""Unusable objects are left out and named, with their file, by all work on sets, which continues with the others."""

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import gymnasium
import pytest

import graspbox
from graspbox import object_sets
from graspbox._common.refusals import errors_of, is_refusal, reason
from graspbox.data import trials as dataset
from graspbox.data.episodes import Demonstrations, record
from graspbox.data.trials.scenes import GroupedObject, SceneTask
from graspbox.data.trials.shards import Shard, make
from graspbox.envs import SINGLE_OBJECT_IDS
from graspbox.errors import ConfigError, FileError, GraspboxError, InternalError, MeshError, SimulationError
from graspbox.evaluation import evaluate, trial_seeds
from test_cli_files import write_box

POSE, LOOP = SINGLE_OBJECT_IDS
#: Reason of each refusal.
BAD = {"cut": "is truncated", "empty": "no triangles", "huge": "but the open hand", "pin": "cannot be simulated"}


@pytest.fixture(scope="module")
def meshes(tmp_path_factory: pytest.TempPathFactory) -> str:
    """Four boxes and four files that no hand can grasp, as the name of an object set."""
    folder = tmp_path_factory.mktemp("meshes")
    for name, side in (("a", 0.05), ("b", 0.06), ("c", 0.04), ("d", 0.055)):
        write_box(folder / f"{name}.off", side, 0.06, 0.1)
    (folder / "cut.off").write_text("OFF\n3 1 0\n0 0 0\n1 0 0\n")
    (folder / "empty.off").write_text("OFF\n0 0 0\n")
    write_box(folder / "huge.off", 1.0, 1.0, 1.0)
    write_box(folder / "pin.off", 1e-3, 1e-3, 1e-3)
    return f"dir:{folder}"


def check(refused: Any, names: set[str], meshes: str) -> None:
    """Each has its reason and its file."""
    assert set(refused) == names
    for name, why in refused.items():
        assert BAD[name] in why
        assert f"{meshes.removeprefix('dir:')}/{name}.off" in why


def test_errors_of_objects_name_them(meshes: str) -> None:
    for spec in object_sets.load(meshes):
        if spec.name not in BAD:
            continue
        with pytest.raises(GraspboxError, match=BAD[spec.name]) as caught:
            graspbox.Scene(spec.load())
        assert caught.value.object == spec.name
        env = gymnasium.make(LOOP, objects=str(spec.path))
        with pytest.raises(type(caught.value)) as again:
            env.reset(seed=0)
        assert again.value.object == spec.name
        env.close()
    with pytest.raises(ConfigError) as wrong:
        graspbox.Scene(object_sets.load("procedural:can:0")[0].load(), physics=graspbox.PhysicsConfig(dt=1.0))
    assert wrong.value.object is None


def test_only_errors_of_objects_are_refusals() -> None:
    with pytest.raises(ConfigError) as caught, errors_of("mug"):
        raise ConfigError("its centre of mass is outside")
    assert is_refusal(caught.value)
    assert not is_refusal(ConfigError("poses is -1"))
    assert not is_refusal(FileError(28, "No space left on device", "out.parquet"))
    assert is_refusal(SimulationError("it rolls away"))
    with pytest.raises(InternalError) as defect, errors_of("mug"):
        raise InternalError("a defect")
    assert not is_refusal(defect.value)
    path = Path("/meshes/mug.off")
    assert reason(MeshError("it is flat"), path) == "MeshError: it is flat (/meshes/mug.off)"
    assert reason(MeshError("/meshes/mug.off: flat"), path) == "MeshError: /meshes/mug.off: flat"


@pytest.mark.parametrize("env_id", SINGLE_OBJECT_IDS)
def test_an_evaluation_goes_on_with_other_trials(meshes: str, env_id: str) -> None:
    """For any number of environments: first trials of all of them may be refused, or only some."""
    settings: dict[str, Any] = {"max_episode_steps": 2} if env_id == LOOP else {}
    told: list[int] = []
    found = [
        evaluate("random", env_id, meshes, 12, 0, num_envs=width, progress=told.append, **settings) for width in (1, 5)
    ]
    assert found[0] == found[1]
    assert told == 2 * list(range(1, 13))
    for result in found:
        check(result.refused, set(BAD), meshes)
        assert {trial.object for trial in result.trials} <= set("abcd")
    seeds = [trial.seed for trial in found[0].trials]
    assert seeds == [seed for seed in trial_seeds(0, 40) if seed in set(seeds)]
    # A trial of the same seed in an environment by itself has the same object; those in between have a bad one.
    env = gymnasium.make(env_id, objects=meshes)
    for seed in trial_seeds(0, 40)[: trial_seeds(0, 40).index(seeds[-1]) + 1]:
        if seed in seeds:
            assert env.reset(seed=seed)[1]["object"] == found[0].trials[seeds.index(seed)].object
        else:
            with pytest.raises(GraspboxError) as caught:
                env.reset(seed=seed)
            assert caught.value.object in BAD
    env.close()


def test_all_objects_of_a_bad_set_are_named(meshes: str, tmp_path: Path) -> None:
    """A data set or demonstrations cannot be made of them; an evaluation has no trial."""
    files = [str(spec.path) for spec in object_sets.load(meshes) if spec.name in ("empty", "cut")]
    result = evaluate("zero", POSE, files, 1)
    check(result.refused, {"empty", "cut"}, meshes)
    assert (result.trials, result.ci95, result.to_json()["rate"]) == ((), (0.0, 1.0), None)
    words = ("evaluate", "zero", *(word for file in files for word in ("--objects", file)), "--trials", 4)
    out = tmp_path / "out.json"
    done = run(*words, "--out", out)
    assert done.returncode == 1
    assert all(f"{name}: {why}" in done.stderr for name, why in result.refused.items())
    assert done.stdout == "no trial: 2 of 2 objects were tried, and none can be used\n"
    assert json.loads(out.read_text())["refused"] == result.refused
    assert json.loads(run(*words, "--json").stdout)["refused"] == result.refused
    with pytest.raises(MeshError, match=r"empty|cut"):
        record("zero", tmp_path / "out", objects=files, episodes=1)


def run(*words: Any) -> "subprocess.CompletedProcess[str]":
    command = [sys.executable, "-m", "graspbox", *map(str, words)]
    return subprocess.run(command, capture_output=True, text=True, check=False)


def test_evaluate_prints_them_and_says_so_in_its_status(meshes: str, tmp_path: Path) -> None:
    out = tmp_path / "result.json"
    done = run("evaluate", "zero", "--objects", meshes, "--trials", 12, "--json", "--out", out)
    assert done.returncode == 1
    found = json.loads(done.stdout)
    check(found["refused"], set(BAD), meshes)
    assert found["trials"] == 12
    assert found["failures"] == {"infeasible": 12}
    written = json.loads(out.read_text())
    assert len(written["rows"]) == 12
    assert written["refused"] == found["refused"]
    for name, why in found["refused"].items():
        assert f"{name}: {why}" in done.stderr
    shown = run("evaluate", "zero", "--objects", meshes, "--trials", 12)
    assert shown.returncode == 1
    assert "left out: 4 objects that cannot be used: cut, empty, huge, pin" in shown.stdout


def test_recordings_go_on_and_remember_them(meshes: str, tmp_path: Path) -> None:
    settings: dict[str, Any] = {"objects": meshes, "keep": "all", "max_episode_steps": 2, "file_episodes": 2}
    wide = record("zero", tmp_path / "wide", episodes=9, num_envs=8, **settings)
    narrow = record("zero", tmp_path / "narrow", episodes=4, num_envs=1, **settings)
    narrow = record("zero", tmp_path / "narrow", episodes=9, num_envs=1, **settings)
    check(wide.refused, set(wide.refused), meshes)
    assert wide.refused
    assert wide.refused == narrow.refused == Demonstrations(tmp_path / "wide").refused
    assert wide.episodes == narrow.episodes
    assert {episode.object for episode in wide.episodes} <= set("abcd")
    words = ("--objects", meshes, "--keep", "all", "--set", "max_episode_steps=2", "--episodes", 9, "--json")
    done = run("record", "zero", "--out", tmp_path / "command", *words)
    assert done.returncode == 1
    assert json.loads(done.stdout)["refused"] == wide.refused
    assert all(f"{name}: {why}" in done.stderr for name, why in wide.refused.items())


@pytest.mark.parametrize("command", ["prepare", "grasp", "dataset"])
def test_other_commands_go_on_too(meshes: str, tmp_path: Path, command: str) -> None:
    words = {
        "prepare": (meshes,),
        "grasp": ("--objects", meshes, "--poses", 1),
        "dataset": ("--objects", meshes, "--out", tmp_path / "out", "--poses", 2, "--rests", 1, "--workers", 1),
    }
    done = run(command, *words[command], "--json")
    assert done.returncode == 1, done.stderr
    found = json.loads(done.stdout)
    check({name.removesuffix("/0"): why for name, why in found["refused"].items()}, set(BAD), meshes)
    assert all(f"{name}: {why}" in done.stderr for name, why in found["refused"].items())
    if command == "prepare":
        assert found["prepared"] == ["a", "b", "c", "d"]
    if command == "dataset":
        assert found["complete"]
        assert set(dataset.column(dataset.load(tmp_path / "out"), "object")) == set("abcd")
        # Nothing is left to do, and the status says so again.
        again = run(command, *words[command], "--json")
        assert (again.returncode, json.loads(again.stdout)["shards"]["made"]) == (1, 0)


def test_a_mesh_whose_centre_of_mass_is_outside_does_not_stop_a_data_set(monkeypatch: pytest.MonkeyPatch) -> None:
    """Such an error looks like one of a setting, and once ended every attempt to make the data set."""

    class Odd:
        mass = 0.1

        def resting_poses(self) -> Any:
            raise ConfigError("center_of_mass is -0.0277; the centre of mass must lie inside the hull")

    good, odd = object_sets.load("procedural:can:0-1")
    real = object_sets.ObjectSpec.load
    monkeypatch.setattr(object_sets.ObjectSpec, "load", lambda spec: Odd() if spec == odd else real(spec))
    tasks = tuple(SceneTask(GroupedObject(spec, spec.name, "train"), 0) for spec in (odd, good))
    config = dataset.DatasetConfig(poses=2, rests=1, views=0)
    facts = make(Shard("train-00000-of-00001.parquet", tasks, ""), graspbox.load_hand("reflex"), config).facts
    assert list(facts["refused"]) == [f"{odd.name}/0"]
    assert list(facts["objects"]) == [good.name]
    wrong = dataset.DatasetConfig(poses=2, rests=1, views=0, physics=graspbox.PhysicsConfig(dt=1.0))
    with pytest.raises(ConfigError, match="dt"):
        make(Shard("train-00000-of-00001.parquet", tasks[1:], ""), graspbox.load_hand("reflex"), wrong)
