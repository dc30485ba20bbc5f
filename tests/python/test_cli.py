"""The command line: its JSON has the promised shape, its numbers are the package's, its exit status is honest."""

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

import graspbox
from graspbox import _core, object_sets
from graspbox.evaluation.planner_trials import ObjectResult, SetResult


def run(*arguments: str | Path) -> subprocess.CompletedProcess[str]:
    """Run ``graspbox`` as a user does."""
    command = [sys.executable, "-m", "graspbox", *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, timeout=300)


def run_json(*arguments: str | Path) -> Any:
    """Run a command that must work, and return its output."""
    result = run(*arguments, "--json")
    assert result.returncode == 0, result.stderr
    return json.loads(result.stdout)


@pytest.mark.parametrize("command", ["objects", "prepare", "plan", "voxelize", "grasp", "evaluate", "demo", "bench"])
def test_every_command_explains_itself(command: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "200")
    result = run(command, "--help")
    assert result.returncode == 0
    assert "Usage" in result.stdout
    text = " ".join(result.stdout.split())
    assert "--json" in text
    # A command has a seed, or says why not.
    assert ("Seed of all random numbers" in text) != ("there is no --seed" in text)


def test_version() -> None:
    assert run("--version").stdout == f"graspbox {graspbox.__version__}\n"


def test_objects() -> None:
    rows = run_json("objects", "ycb")
    assert [row["name"] for row in rows] == list(object_sets.load("ycb").names)
    assert set(rows[0]) == {"name", "split", "mass", "mass_known"}
    tests = run_json("objects", "ycb", "--split", "test")
    assert [row["name"] for row in tests] == [row["name"] for row in rows if row["split"] == "test"]


def test_plan(tmp_path: Path) -> None:
    picture = tmp_path / "can.png"
    found = run_json("plan", "procedural:can:0", "--max-boxes", "3", "--picture", picture)
    keys = {"name", "hand", "world_from_object", "boxes", "poses", "feasible", "seconds", "grasps"}
    assert set(found) == keys
    assert all(set(box) == {"center", "axes", "half_extents", "volume"} for box in found["boxes"])
    tree = graspbox.decompose(object_sets.load("procedural:can:0")[0].load(), max_boxes=3)
    assert [box["volume"] for box in found["boxes"]] == [box.volume for box in tree]
    assert 0 < found["feasible"] <= found["poses"] == len(found["grasps"])
    assert picture.read_bytes()[:4] == b"\x89PNG"


def test_grasp_counts_what_the_package_counts(tmp_path: Path) -> None:
    out = tmp_path / "deep" / "grasps.json"
    arguments = [
        "grasp",
        "--objects",
        "procedural:ball:0",
        "--objects",
        "procedural:can:0",
        "--poses",
        "3",
        "--seed",
        "4",
    ]
    table = run_json(*arguments, "--out", out)
    details = json.loads(out.read_text())
    keys = {"objects", "refused", "tried", "succeeded", "rate", "objects_with_success", "first_rate", "trials_per_s"}
    assert set(table) == keys
    keys = {"name", "tried", "succeeded", "secure", "survived_shake", "legacy_succeeded", "first_succeeded"}
    assert all(set(row) == keys for row in table["objects"])
    assert [row["name"] for row in table["objects"]] == ["ball-000000", "can-000000"]
    assert table["tried"] == sum(row["tried"] for row in table["objects"]) == 6
    assert table["rate"] == table["succeeded"] / table["tried"]
    again = run_json(*arguments, "--threads", "1")
    for found in (table, again):
        del found["trials_per_s"]
    assert again == table
    scene = graspbox.Scene(object_sets.load("procedural:can:0")[0].load())
    plan = graspbox.plan(scene.mesh, world_from_object=scene.world_from_object, seed=4).best(3)
    success = scene.simulate(plan.poses, plan.preshape, config=graspbox.TrialConfig(legacy=True)).success
    row = table["objects"][1]
    assert (row["succeeded"], row["first_succeeded"]) == (int(success.sum()), bool(success[0]))
    del details["trials_per_s"]
    made = details.pop("made")
    assert (made["seed"], made["hand"], made["graspbox"]) == (4, "reflex", graspbox.__version__)
    found = [[row.pop(name) for name in ("source", "scale", "mass")] for row in details["objects"]]
    assert found == [["procedural:ball:0", 1.0, None], ["procedural:can:0", 1.0, None]]
    grasps = [row.pop("grasps") for row in details["objects"]]
    assert [row.pop("error") for row in details["objects"]] == ["", ""]
    assert [row.pop("hand") for row in details["objects"]] == ["reflex", "reflex"]
    assert [row.pop("sha256") for row in details["objects"]][1] == plan.mesh_sha256
    assert details["objects"][1].pop("world_from_object") == scene.world_from_object.tolist()
    del details["objects"][0]["world_from_object"]
    assert details == table
    assert [len(rows) for rows in grasps] == [3, 3]
    assert [g["object_from_hand"] for g in grasps[1]] == plan.poses.tolist()
    assert [g["preshape"] for g in grasps[1]] == plan.preshape.tolist()
    assert [g["success"] for g in grasps[1]] == success.tolist()
    assert all((g["failure"] == "") == g["success"] and isinstance(g["lift"], float) for g in grasps[1])


def test_objects_without_a_pose_count_as_failed() -> None:
    out = graspbox.Scene(object_sets.load("procedural:ball:0")[0].load())
    plan = graspbox.plan(out.mesh, world_from_object=out.world_from_object).best(1)
    good = ObjectResult("good", plan, out.simulate(plan.poses, plan.preshape), 0.5)
    assert good.row()["succeeded"] == 1
    none = ObjectResult("none", plan.best(0), out.simulate(plan.poses[:0], plan.preshape[:0]), 0.0)
    table = SetResult([good, none, ObjectResult("broken", error="MeshError: flat")]).table()
    assert (table["tried"], table["rate"], table["objects_with_success"]) == (1, 1.0, 1)
    assert table["first_rate"] == pytest.approx(1 / 3)
    assert SetResult().table()["rate"] == 0.0


def test_evaluate_takes_a_hand(tmp_path: Path) -> None:
    """By its name or its files; the trials are those of the package with that hand."""
    for name, text in zip(("own.urdf", "own.toml"), graspbox.load_hand("panda_gripper").files, strict=True):
        (tmp_path / name).write_text(text)
    words = ("evaluate", "planner", "--objects", "procedural:bottle:0-2", "--trials", "6")
    files = f"{tmp_path / 'own.urdf'},{tmp_path / 'own.toml'}"
    found = [run_json(*words, "--hand", hand) for hand in ("panda_gripper", files)]
    expected = graspbox.evaluation.evaluate("planner", objects="procedural:bottle:0-2", trials=6, hand="panda_gripper")
    for result in found:
        assert (result["succeeded"], result["fitting"]["trials"]) == (expected.succeeded, len(expected.fitting.trials))
    assert run_json(*words)["fitting"]["trials"] == 6
    wrong = run(*words, "--hand", "panda")
    assert wrong.returncode == 2
    assert "there is no hand 'panda'" in wrong.stderr


def test_exit_status(tmp_path: Path) -> None:
    wrong = run("grasp", "--objects", "cupboard")
    assert (wrong.returncode, wrong.stdout) == (2, "")
    assert "names no object set" in wrong.stderr
    assert "Traceback" not in wrong.stderr
    assert run("grasp", "--poses", "0").returncode == 2
    flat = tmp_path / "flat.off"
    flat.write_text("OFF\n3 1 0\n0 0 0\n0.1 0 0\n0 0.1 0\n3 0 1 2\n")
    result = run("grasp", "--objects", flat, "--poses", "1", "--json")
    assert result.returncode == 1
    assert json.loads(result.stdout)["objects"][0]["tried"] == 0
    assert "flat" in result.stderr
    assert run("plan", flat).returncode == 1
    assert run("plan", tmp_path / "none.stl").returncode == 2


def test_demo_leaves_its_table_and_pictures(tmp_path: Path) -> None:
    done = run("demo", "--out", tmp_path, "--poses", "1", "--json")
    assert done.returncode == 0, done.stderr
    table = json.loads(done.stdout)
    assert json.loads((tmp_path / "grasps.json").read_text()) == table
    names = [row["name"] for row in table["objects"]]
    assert len(names) == 15
    pictures = [*names, "sweep_kettle-000003", "sweep_019_pitcher_base", "kindness", "stages"]
    assert all((tmp_path / f"{name}.png").stat().st_size > 10_000 for name in pictures)
    # Each is named before it is written, since some take seconds.
    assert [line.split()[1] for line in done.stderr.splitlines() if line.strip()] == [
        str(tmp_path / f"{name}.png") for name in pictures
    ]
    markdown = (tmp_path / "grasps.md").read_text()
    assert all(f"| {name} |" in markdown for name in names)


def test_bench_lists_work_value_unit(monkeypatch: pytest.MonkeyPatch) -> None:
    from graspbox.cli import bench

    monkeypatch.setattr(bench, "_MIX", ("procedural:ball:0",))
    can = "procedural:can:0"
    for name, value in {"_SEEN": can, "_OBJECTS": (can,), "_ENVS": 2, "_STEPS": 12}.items():
        monkeypatch.setattr(bench, name, value)
    monkeypatch.setattr(bench, "_FRAMES", 2)
    monkeypatch.setattr(bench, "_FRAME_STEPS", 3)
    monkeypatch.setattr(bench, "_ARM_STEPS", 3)
    rows = bench.measure(1, seed=5)
    assert all(set(row) == {"work", "value", "unit", "goal", "ratio"} for row in rows)
    # Every goal has a row, and a ratio above 1 is a goal met.
    told = {name for name in bench._GOALS for row in rows if row["work"].startswith(name) and row["goal"] is not None}
    assert told == set(bench._GOALS)
    for row in rows:
        if row["goal"]:
            at_least = row["unit"] in ("1/s", "%")
            assert (row["ratio"] >= 1) == (row["value"] >= row["goal"] if at_least else row["value"] <= row["goal"])
    assert all(row["value"] > 0 for row in rows if row["unit"] != "%")
    # The hand is still approaching; a can is on few of the pixels.
    early = bench.idle(rows)
    assert any(sentence.startswith("steps in contact, 2 envs, expert: 0.0 %") for sentence in early)
    assert not bench.idle([{**row, "value": 50.0} for row in rows])
    assert _core.num_threads() >= 1
