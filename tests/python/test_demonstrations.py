"""Recording demonstrations and reading them."""

import json
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest

from demonstrations_for_tests import FAST, OBJECTS, OBS, recorded
from graspbox.data.episodes import Demonstrations, record
from graspbox.errors import ConfigError
from graspbox.evaluation import trial_seeds

pytest.importorskip("pyarrow")


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Demonstrations:
    """Three episodes with images, in files of two."""
    return recorded(tmp_path_factory.mktemp("demonstrations") / "shown")


def contents(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in sorted(folder.iterdir()) if path.name != ".lock"}


def same_steps(a: Demonstrations, b: Demonstrations) -> bool:
    """Whether two folders have the same episodes, in any files."""
    pairs = zip(a.read(), b.read(), strict=True)
    return all(
        x.episode == y.episode
        and all((x.observations[name] == y.observations[name]).all() for name in x.observations)
        and (x.actions == y.actions).all()
        and (x.rewards == y.rewards).all()
        for x, y in pairs
    )


def test_episodes_are_those_of_their_seeds(made: Demonstrations) -> None:
    """Recorded actions lead a single environment through the recorded observations and rewards."""
    env = gymnasium.make("graspbox/Grasp-v0", obs=OBS, **FAST)
    seeds = trial_seeds(0, made.trials)
    assert len(made.episodes) == 3
    assert [row.trial for row in made.episodes] == sorted(row.trial for row in made.episodes)
    for one in made.read():
        assert one.episode.secure
        assert one.episode.success
        assert one.episode.seed == seeds[one.episode.trial]
        observation, info = env.reset(seed=one.episode.seed)
        assert info["object"] == one.episode.object
        for step, action in enumerate(one.actions):
            for name in OBS:
                assert (observation[name] == one.observations[name][step]).all()
            observation, reward, terminated, truncated, info = env.step(action)
            assert reward == one.rewards[step]
            assert (terminated, truncated) == (one.terminated[step], one.truncated[step])
        assert info["is_secure"]
        assert terminated
        assert all((observation[name] == one.observations[name][-1]).all() for name in OBS)
        assert one.episode.steps == len(one.actions) == len(one.observations["rgb"]) - 1
        assert one.episode.reward == pytest.approx(one.rewards.sum())
    env.close()


def test_bytes_do_not_depend_on_the_number_of_environments(made: Demonstrations, tmp_path: Path) -> None:
    other = record("expert", tmp_path / "a", episodes=3, obs=OBS, num_envs=5, num_threads=1, file_episodes=2, **FAST)
    mine, its = contents(made.folder), contents(other.folder)
    # The number of threads is a keyword of the environment, and so a setting.
    assert {name: raw for name, raw in mine.items() if name != "manifest.json"} == {
        name: raw for name, raw in its.items() if name != "manifest.json"
    }
    assert len(mine) == 3


def test_an_interrupted_recording_is_continued(made: Demonstrations, tmp_path: Path) -> None:
    """Ctrl-C while the second file is in the making; then two calls with a growing number of episodes."""
    folder = tmp_path / "stopped"

    def stop(kept: int, trials: int) -> None:
        del trials
        if kept == 3:
            raise KeyboardInterrupt

    settings: dict[str, Any] = {"obs": OBS, "num_envs": 2, "file_episodes": 2, **FAST}
    with pytest.raises(KeyboardInterrupt):
        record("expert", folder, episodes=5, progress=stop, **settings)
    assert len(Demonstrations(folder).episodes) == 2
    # A file that was being written when the process was killed.
    (folder / ".episodes-00001-0.parquet").write_bytes(b"PAR1")
    again = record("expert", folder, episodes=3, **settings)
    assert contents(folder) == contents(made.folder)
    before = contents(folder)
    assert record("expert", folder, episodes=3, **settings).episodes == again.episodes
    assert contents(folder) == before
    more = record("expert", folder, episodes=5, **settings)
    whole = record("expert", tmp_path / "whole", episodes=5, **settings)
    assert same_steps(more, whole)
    assert len(more.episodes) == 5


def test_two_recordings_into_a_folder_are_refused(tmp_path: Path) -> None:
    """One that went on after its parent had been killed, beside a new one, once mixed their files."""
    settings: dict[str, Any] = {"obs": OBS, "num_envs": 2, **FAST}

    def second(kept: int, trials: int) -> None:
        del kept, trials
        with pytest.raises(ConfigError, match="another process is writing into"):
            record("expert", tmp_path, episodes=1, **settings)

    assert len(record("expert", tmp_path, episodes=1, progress=second, **settings).episodes) == 1


def test_failures_are_kept_where_told(tmp_path: Path) -> None:
    keywords: dict[str, Any] = {"objects": OBJECTS, "control_freq": 5, "max_episode_steps": 6, "num_envs": 2}
    with pytest.raises(ConfigError, match=r"0 of 120 trials were worth keeping \(keep='success'\), 1 are wanted"):
        record("zero", tmp_path / "none", episodes=1, obs="proprio", keep="success", **keywords)
    found = record("zero", tmp_path / "all", episodes=3, obs="proprio", keep="all", **keywords)
    assert [row.trial for row in found.episodes] == [0, 1, 2]
    assert not any(row.success for row in found.episodes)
    assert all(one.truncated[-1] and not one.truncated[:-1].any() for one in found.read())


def test_noise_disturbs_what_is_done_but_not_what_is_shown(tmp_path: Path) -> None:
    keywords: dict[str, Any] = {"objects": OBJECTS, "fingers": "each", "obs": ("proprio", "state"), "keep": "all"}
    for name, width in (("a", 2), ("b", 3)):
        record("zero", tmp_path / name, episodes=3, noise=0.3, num_envs=width, max_episode_steps=5, **keywords)
    assert contents(tmp_path / "a") == contents(tmp_path / "b")
    done = []
    for one in Demonstrations(tmp_path / "a").read():
        assert (one.actions == 0).all()
        last_action = one.observations["state"][1:, 78:88]
        done.append(last_action)
        assert not np.isclose(last_action, 0).all(axis=1).any()
    assert np.std(done) == pytest.approx(0.3, rel=0.2)


def test_decisions_are_recorded_too(tmp_path: Path) -> None:
    found = record("planner", tmp_path / "d", "graspbox/GraspPose-v0", OBJECTS, 3, ("state", "depth"), image_size=16)
    assert [row.steps for row in found.episodes] == [1, 1, 1]
    observations, actions, rewards, episode = found.steps(("depth",), limit=2)
    assert observations["depth"].shape == (2, 16, 16, 1)
    assert actions.shape == (2, found.action_size)
    assert (rewards == 1.0).all()
    assert episode.tolist() == [0, 1]


def test_rounds_and_targets_are_recorded_and_done_again(tmp_path: Path) -> None:
    """The actions of a round lead an environment of its seed and settings through it again."""
    layout: dict[str, Any] = {"layout": "packed", "objects_per_scene": 2, "hand": "panda_gripper"}
    for policy, env_id in (("scene_planner", "graspbox/Clear-v0"), ("planner", "graspbox/GraspPose-v0")):
        found = record(policy, tmp_path / policy, env_id, OBJECTS, 2, ("state",), keep="all", **layout)
        env: Any = gymnasium.make(env_id, **{**found.environment()[1], "obs": "state"})
        for one in found.read():
            observation, _ = env.reset(seed=one.episode.seed)
            for step, action in enumerate(one.actions):
                assert (observation == one.observations["state"][step]).all()
                observation, reward, terminated, truncated, _ = env.step(action)
                assert reward == one.rewards[step]
                assert (terminated, truncated) == (one.terminated[step], one.truncated[step])
        assert max(row.steps for row in found.episodes) > 1 or env_id == "graspbox/GraspPose-v0"


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"keep": "best"}, "keep is 'best'; choose from secure, success, all"),
        ({"noise": 1.5}, r"noise is 1\.5; it must be between 0 and 1"),
        ({"episodes": 0}, "episodes is 0; it must be 1 or more"),
        ({"num_envs": 0}, "num_envs is 0; it must be 1 or more"),
        ({"obs": ()}, "obs is empty"),
        ({"obs": "colour"}, "colour"),
        ({"env_id": "CartPole-v1"}, "there is no environment 'CartPole-v1'"),
        ({"seed": -1}, "seed"),
    ],
)
def test_wrong_arguments_are_named(changes: dict[str, Any], message: str, tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=message):
        record(**{"policy": "zero", "out": tmp_path / "x", "objects": OBJECTS, **changes})
    assert not (tmp_path / "x").exists()


def test_other_settings_and_other_folders_are_refused(made: Demonstrations, tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"begun with other settings: keep was 'secure', is now 'all'"):
        record("expert", made.folder, episodes=3, obs=OBS, keep="all", file_episodes=2, **FAST)
    with pytest.raises(ConfigError, match="there are no demonstrations in"):
        Demonstrations(tmp_path)
    with pytest.raises(ConfigError, match=r"no observation 'state' in .*; it has proprio, depth, rgb"):
        made.steps(("state",))
    with pytest.raises(ConfigError, match="has 3 such episodes of 3; record more"):
        made.steps(("proprio",), limit=4)


def test_the_command_line_does_the_same(made: Demonstrations, tmp_path: Path, capsys: Any) -> None:
    pytest.importorskip("typer")
    from command_line import invoke

    out = tmp_path / "shown"
    words = [
        "record",
        "expert",
        "--out",
        str(out),
        "--objects",
        OBJECTS,
        "--episodes",
        "3",
        "--json",
        "--num-envs",
        "4",
    ]
    words += [word for name in OBS for word in ("--obs", name)]
    words += [
        word
        for name in ("control_freq", "max_episode_steps", "image_size")
        for word in ("--set", f"{name}={FAST[name]}")
    ]
    done = invoke(words, catch_exceptions=False)
    assert done.exit_code == 0
    assert json.loads(done.stdout)["secure"] == 3
    assert same_steps(Demonstrations(out), made)
    with pytest.raises(ConfigError, match="names no keyword"):
        invoke([*words, "--set", "control_freq"], catch_exceptions=False)
    given = ["export", str(out), "--format", "lerobot", "--out", str(tmp_path / "lerobot")]
    assert invoke(given, catch_exceptions=False).exit_code == 0
    assert (tmp_path / "lerobot/meta/info.json").is_file()
    wrong = invoke([*given, "--format", "zip"])
    assert wrong.exit_code == 2
    assert "'zip' is not one of 'minari', 'lerobot'" in " ".join(wrong.output.replace("│", " ").split())
