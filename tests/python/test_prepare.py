"""Preparing objects: progress, the same results, and the cache that processes share."""

import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest

import graspbox
from graspbox._common.progress import ProgressBar

OBJECTS = ["procedural:ball:0-1", "procedural:can:0"]


def observations(prepare: bool) -> list[np.ndarray]:
    """Ten steps of episodes of three steps each, which begin with other objects all the time."""
    env = gym.make_vec(
        "graspbox/Grasp-v0", num_envs=3, objects=OBJECTS, max_episode_steps=3, physics=graspbox.PhysicsConfig(dt=0.0025)
    )
    if prepare:
        env.prepare()  # type: ignore[attr-defined]
    found = [env.reset(seed=1)[0]]
    zeros = np.zeros_like(env.action_space.sample())
    found += [env.step(zeros)[0] for _ in range(10)]
    env.close()
    return found


def test_preparing_changes_no_result() -> None:
    # The first environment is gone when the second is made, and so are its objects.
    for a, b in zip(observations(False), observations(True), strict=True):
        np.testing.assert_array_equal(a, b)


@pytest.mark.parametrize("name", ["graspbox/Grasp-v0", "graspbox/GraspPose-v0"])
def test_single_environments_show_their_progress(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    env = gym.make(name, objects=OBJECTS, obs="depth")
    env.unwrapped.prepare(progress=True)  # type: ignore[attr-defined]
    captured = capsys.readouterr()
    assert captured.out == ""
    assert captured.err.splitlines()[-1].endswith(" 3/3")
    env.unwrapped.prepare()  # type: ignore[attr-defined]
    assert capsys.readouterr().err == ""
    env.close()
    with pytest.raises(gym.error.ClosedEnvironmentError):
        env.unwrapped.prepare()  # type: ignore[attr-defined]


def test_an_object_that_cannot_be_prepared_is_an_error(tmp_path: Path) -> None:
    (tmp_path / "flat.obj").write_text("v 0 0 0\nv 0.1 0 0\nv 0 0.1 0\nf 1 2 3\n")
    env = gym.make("graspbox/Grasp-v0", objects=f"dir:{tmp_path}")
    with pytest.raises(graspbox.GraspboxError, match="flat"):
        env.unwrapped.prepare()  # type: ignore[attr-defined]


def write_mesh(path: Path, name: str) -> None:
    """Write a procedural object as an OBJ file."""
    made = graspbox.object_sets.load(name)[0].load()
    lines = [f"v {x} {y} {z}" for x, y, z in made.vertices] + [f"f {a + 1} {b + 1} {c + 1}" for a, b, c in made.faces]
    path.write_text("\n".join(lines) + "\n")


@pytest.mark.parametrize(
    ("settings", "entries"), [({}, 3), ({"prepare_files": 2}, 1), ({"autoreset_mode": "Disabled"}, 1)]
)
def test_the_first_reset_prepares_mesh_files(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, settings: dict[str, Any], entries: int
) -> None:
    cache = tmp_path / "cache"
    monkeypatch.setenv("GRASPBOX_CACHE", str(cache))
    files = [tmp_path / f"can{seed}.obj" for seed in range(3)]
    for seed, file in enumerate(files):
        write_mesh(file, f"procedural:can:{seed}")
    (tmp_path / "flat.obj").write_text("v 0 0 0\nv 0.1 0 0\nv 0 0.1 0\nf 1 2 3\n")
    objects = [str(file) for file in files]
    if not settings:
        # One that cannot be prepared is left to the episode that uses it.
        objects.append(str(tmp_path / "flat.obj"))
    env = gym.make_vec("graspbox/Grasp-v0", num_envs=1, objects=objects, **settings)
    # Nothing is prepared ahead here: with seeds for every episode, or before the background thread has begun.
    env.reset(seed=0, options={"object": "can0"})
    found = len([*cache.glob("*.parts")])
    assert found == entries if entries == 3 else found >= entries
    env.close()


@pytest.mark.parametrize("wrong", [-1, 2.5, "all"])
def test_a_number_of_files_that_makes_no_sense_is_refused(wrong: Any) -> None:
    with pytest.raises(graspbox.errors.ConfigError, match="prepare_files"):
        gym.make_vec("graspbox/Grasp-v0", num_envs=1, objects=OBJECTS, prepare_files=wrong)


def test_the_command_fills_the_cache_of_other_processes(tmp_path: Path) -> None:
    mesh = tmp_path / "mug.obj"
    write_mesh(mesh, "procedural:mug:2")
    cache = tmp_path / "cache"
    command = [sys.executable, "-m", "graspbox", "prepare", str(mesh)]
    done = subprocess.run(
        command, env={**os.environ, "GRASPBOX_CACHE": str(cache)}, capture_output=True, text=True, check=True
    )
    assert "1 objects" in done.stdout
    (entry,) = cache.glob("*.parts")
    before = entry.stat().st_mtime_ns
    graspbox.Scene(graspbox.load_mesh(mesh), cache=cache)
    assert [*cache.glob("*.parts")] == [entry]
    assert entry.stat().st_mtime_ns == before


def test_a_bar_waits_for_its_delay(capsys: pytest.CaptureFixture[str]) -> None:
    with ProgressBar("work", 2, delay=3600.0) as bar:
        bar.update(2)
    assert capsys.readouterr().err == ""


def test_a_bar_in_a_log_file_has_at_most_ten_lines(capsys: pytest.CaptureFixture[str]) -> None:
    with ProgressBar("work", 1000) as bar:
        for done in range(1, 1001):
            bar.update(done)
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == 10
    assert lines[-1] == "work [" + "#" * 30 + "] 1000/1000"
