"""The observation ``goal``: the grasp of another policy in the hand's frame, alike in every environment."""

import doctest
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.wrappers.vector import RecordEpisodeStatistics
from numpy.typing import NDArray

from graspbox import evaluation, load_hand, policies
from graspbox.data.episodes import Demonstrations, record
from graspbox.envs.coding import Codec, rotation_from_columns
from graspbox.errors import ConfigError
from graspbox.policies import Task, goals
from graspbox.policies.goals import GOAL, GoalPolicy, Goals, goal_space, plain_settings
from graspbox.sb3 import goal_env
from graspbox.tools.demonstrations import to_minari
from graspbox.tools.remote import EnvironmentServer, ServerSettings

OBJECTS = ("procedural:can:0-3", "procedural:box:0-3")
SETTINGS: dict[str, Any] = {"objects": OBJECTS, "fingers": "each", "control_freq": 5, "max_episode_steps": 50}
PROPRIO = Codec("twist", load_hand("reflex"), "proprio")


def entries(rows: NDArray[np.float32], name: str) -> NDArray[np.float64]:
    """Take some entries of goals, by their name."""
    names = [row[0] for row in GOAL]
    start = sum(row[1] for row in GOAL[: names.index(name)])
    return rows[..., start : start + GOAL[names.index(name)][1]].astype(np.float64)


def make(num_envs: int = 2, **more: Any) -> goal_env.GoalVectorEnv:
    keywords = {**SETTINGS, "obs": ("proprio", "goal"), "goal_from": "partial_view_planner", **more}
    found = goal_env.make_vec("graspbox/Grasp-v0", num_envs, autoreset_mode="SameStep", **keywords)
    assert isinstance(found, goal_env.GoalVectorEnv)
    return found


def follow(seen: dict[str, NDArray[Any]]) -> NDArray[np.float32]:
    """Rise until there is a goal, go to it, close once it is near."""
    rows = seen["goal"]
    found, shift = entries(rows, "found")[:, 0] > 0, entries(rows, "shift")
    actions = np.zeros((len(rows), 10), dtype=np.float32)
    actions[:, :3] = np.where(found[:, None], np.clip(shift, -1, 1), [0, 0, -1])
    actions[:, 6:9] = (found & (np.linalg.norm(shift, axis=1) < 0.1))[:, None]
    return actions


@pytest.mark.parametrize("module", [goals, goal_env])
def test_examples_run(module: Any) -> None:
    assert doctest.testmod(module, extraglobs={"np": np}).failed == 0


def test_a_goal_is_the_grasp_that_was_found_seen_from_the_hand() -> None:
    envs = make()
    base = envs.goals.base
    seen, _ = envs.reset(seed=3)
    shown = 0
    for _ in range(12):
        assert envs.observation_space.contains(seen)
        for env in range(2):
            row, found = seen["goal"][env], base.found[env]
            if not base.has_looked(env):
                assert not row.any()
                continue
            assert found is not None
            hand_from_goal = np.eye(4)
            hand_from_goal[:3, 3] = 0.1 * entries(row, "shift")
            hand_from_goal[:3, :3] = rotation_from_columns(*np.split(entries(row, "turn"), 2))
            world_from_goal = PROPRIO.pose(seen["proprio"][env], "hand") @ hand_from_goal
            np.testing.assert_allclose(world_from_goal, found.world_from_hand, atol=1e-5)
            assert 0.0 < entries(row, "top")[0] * 0.1 < 0.4
            shown += 1
        seen, *_ = envs.step(follow(seen))
    assert shown > 10
    envs.close()


def test_time_runs_from_the_look() -> None:
    envs = make(1)
    seen, _ = envs.reset(seed=0)
    times: list[float] = []
    while len(times) < 4:
        if entries(seen["goal"], "found")[0, 0]:
            times.append(entries(seen["goal"], "time")[0, 0])
        seen, *_ = envs.step(follow(seen))
    np.testing.assert_allclose(times, [0.0, 0.02, 0.04, 0.06], atol=1e-6)
    envs.close()


def test_the_last_observation_has_a_goal_and_the_next_episode_begins_without() -> None:
    envs = make(2, max_episode_steps=8)
    seen, _ = envs.reset(seed=5)
    for _ in range(8):
        before = seen
        seen, _, terminated, truncated, info = envs.step(follow(seen))
    assert (terminated | truncated).all()
    assert (entries(before["goal"], "found") == 1.0).all()
    for env in range(2):
        last = info["final_obs"][env]
        assert sorted(last) == ["goal", "proprio"]
        assert envs.single_observation_space.contains(last)
        assert entries(last["goal"], "found")[0] == entries(before["goal"][env], "found")[0]
        assert entries(seen["goal"][env], "time")[0] == 0.0
    envs.close()


def test_a_partial_reset_passes_wrappers_that_remove_the_mask() -> None:
    """The goals of all environments were forgotten, also of those whose episodes went on."""
    envs = make(2)
    envs.env = RecordEpisodeStatistics(envs.env)
    seen, _ = envs.reset(seed=5)
    while not (entries(seen["goal"], "found") == 1.0).all():
        seen = envs.step(follow(seen))[0]
    options = {"reset_mask": np.array([False, True])}
    seen, _ = envs.reset(seed=[None, 3], options=options)
    assert sorted(options) == ["reset_mask"]
    assert entries(seen["goal"], "found")[:, 0].tolist() == [1.0, 0.0]
    envs.close()


def test_results_do_not_depend_on_neighbours() -> None:
    def result(num_envs: int) -> Any:
        policy = GoalPolicy(policies.load("partial_view_planner"), follow)
        return evaluation.evaluate(policy, trials=5, seed=2, num_envs=num_envs, **SETTINGS)

    assert result(1).trials == result(4).trials


def test_with_goals_follows_the_keywords() -> None:
    policy = policies.load("zero")
    same, settings = goal_env.with_goals(policy, {"obs": "state"})
    assert (same, settings) == (policy, {"obs": "state"})
    changed, settings = goal_env.with_goals(
        policy, {"obs": ["tactile", "goal"], "goal_from": "partial_view_planner", "control_freq": 5}
    )
    assert changed.obs == settings["obs"] == ("tactile", "depth", "proprio")
    assert settings["control_freq"] == 5
    assert "goal_from" not in settings


@pytest.mark.parametrize(
    "settings",
    [
        {"obs": ("proprio", "goal")},
        {"obs": "goal", "goal_from": "partial_view_planner"},
        {"obs": ("proprio",), "goal_from": "partial_view_planner"},
        {"obs": ("proprio", "goal"), "goal_from": "planner"},
    ],
)
def test_goals_need_something_that_looks(settings: dict[str, Any]) -> None:
    with pytest.raises(ConfigError, match="goal"):
        goal_env.make_vec("graspbox/Grasp-v0", 1, autoreset_mode="SameStep", **settings)


def test_goals_are_for_grasp_v0() -> None:
    base = policies.load("partial_view_planner")
    envs = gymnasium.make_vec("graspbox/GraspPose-v0", num_envs=1, **plain_settings({"obs": ("goal",)}, base))
    with pytest.raises(ConfigError, match="Grasp-v0"):
        Goals(base).bind(Task.of(envs))
    envs.close()


def test_goals_are_recorded_with_demonstrations(tmp_path: Path) -> None:
    """They are those of the demonstrator's own grasp, and a clone's environment makes them anew."""
    pytest.importorskip("pyarrow")
    names = ("proprio", "goal")
    made = record("partial_view_planner", tmp_path / "shown", obs=names, episodes=2, num_envs=2, keep="all", **SETTINGS)
    for one in made.read():
        rows = one.observations["goal"]
        assert rows.shape == (len(one.actions) + 1, *goal_space().shape)
        looked = np.flatnonzero(entries(rows, "found")[:, 0])
        assert looked[-1] == len(one.actions)
        assert (np.diff(looked) == 1).all()
        np.testing.assert_allclose(np.diff(entries(rows[looked], "time")[:, 0]), 0.02, atol=1e-6)
        # The hand comes to where it was sent.
        assert np.linalg.norm(entries(rows[looked], "shift"), axis=1).min() < 0.1
    env_id, keywords = Demonstrations(tmp_path / "shown").environment(names)
    assert (env_id, keywords["goal_from"], keywords["obs"]) == (
        "graspbox/Grasp-v0",
        "partial_view_planner",
        list(names),
    )
    assert "goal_from" not in made.environment(("proprio",))[1]
    pytest.importorskip("minari")
    with pytest.raises(ConfigError, match="goal"):
        to_minari(made, "graspbox/goals-v0")


def test_goals_are_the_same_in_environments_on_a_server() -> None:
    with EnvironmentServer(ServerSettings(port=0)) as server:
        seen = [make(remote=remote) for remote in (None, server.url)]
        rows = [envs.reset(seed=3)[0] for envs in seen]
        for _ in range(12):
            for name, values in rows[0].items():
                np.testing.assert_array_equal(values, rows[1][name])
            rows = [envs.step(follow(row))[0] for envs, row in zip(seen, rows, strict=True)]
        assert (entries(rows[0]["goal"], "found") > 0).any()
