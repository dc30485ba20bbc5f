"""Goal tasks: observations, rewards, ends, goals and states; single, vector and on a server."""

import copy
import pickle
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import data_equivalence

from acting import OBJECTS
from graspbox import errors
from graspbox.envs import GOAL_IDS
from graspbox.tools.remote import EnvironmentServer, ServerSettings

ROOT = Path(__file__).parents[2]
REACH, PLACE = GOAL_IDS
KEYS = ["achieved_goal", "desired_goal", "observation"]
#: Grasp centre of `panda_gripper`, hand frame, metres: its file has it.
GRASP_CENTER = np.array([0.0, 0.0, 0.0374])
EVERY = pytest.mark.parametrize("env_id", GOAL_IDS)


def make(env_id: str, **keywords: Any) -> Any:
    return gymnasium.make(env_id, objects=OBJECTS, **keywords)


def make_vec(env_id: str, num_envs: int = 3, **keywords: Any) -> Any:
    return gymnasium.make_vec(env_id, num_envs=num_envs, objects=OBJECTS, **keywords)


def towards(seen: dict[str, Any]) -> Any:
    """Move the grasp centre to the goal: an action of ``top_down`` at 5 Hz, which moves by up to 0.1 m."""
    wanted = np.clip((seen["desired_goal"] - seen["achieved_goal"]) / 0.1, -1, 1)
    rest = np.zeros_like(wanted)
    rest[..., 2] = -1.0
    return np.concatenate([wanted, rest], axis=-1)


@EVERY
@pytest.mark.parametrize("reward", ["sparse", "dense"])
def test_the_reward_of_a_step_is_that_of_its_goals(env_id: str, reward: str) -> None:
    """So is `is_success`; -1 and 0, or the distance; in a vector environment through the ends of episodes too."""
    envs: Any = make_vec(env_id, reward=reward, threshold=0.08, autoreset_mode="SameStep", max_episode_steps=7)
    single: Any = make(env_id, reward=reward, threshold=0.08).unwrapped
    seen, _ = envs.reset(seed=1)
    assert sorted(seen) == KEYS
    rewards, hits = [], []
    for _ in range(30):
        seen, found, terminated, truncated, info = envs.step(towards(seen))
        assert not terminated.any()
        last = info.get("final_obs")
        ends = [row if last is None or last[i] is None else last[i] for i, row in enumerate(rows(seen))]
        goals = [np.stack([end[key] for end in ends]) for key in KEYS[:2]]
        away = np.linalg.norm(goals[0].astype(float) - goals[1], axis=1)
        assert np.allclose(found, -away if reward == "dense" else np.where(away > 0.08, -1.0, 0.0), atol=1e-6)
        assert (single.compute_reward(*goals, [{}, {}, {}]) == found).all()
        assert [single.compute_reward(a, d, None) for a, d in zip(*goals, strict=True)] == found.tolist()
        success = np.where(
            truncated, info["final_info"]["is_success"] if last is not None else False, info["is_success"]
        )
        assert (success == (away <= 0.08)).all()
        rewards.append(found)
        hits.append(success)
    assert np.ptp(rewards) > 0
    assert np.any(hits) or env_id == PLACE


def rows(seen: dict[str, Any]) -> list[dict[str, Any]]:
    return [{key: values[i] for key, values in seen.items()} for i in range(len(seen["desired_goal"]))]


def test_compute_reward_takes_any_goals() -> None:
    env: Any = make(REACH).unwrapped
    near, far = [0.1, 0.2, 0.3], [0.1, 0.2, 0.36]
    assert env.compute_reward(near, near, {}) == 0.0
    assert env.compute_reward(near, far, {}) == -1.0
    found = env.compute_reward(np.array([near, far]), np.array([near, near], np.float32), None)
    assert found.dtype == np.float64
    assert found.tolist() == [0.0, -1.0]
    with pytest.raises(errors.ConfigError, match=r"shapes \(2,\) and \(3,\)"):
        env.compute_reward([0, 0], near, {})


def test_what_achieves_the_goal() -> None:
    """The grasp centre, in front of the palm; the object's centre of mass."""
    reach, place = (make(env_id, obs="state", hand="panda_gripper") for env_id in GOAL_IDS)
    for env in (reach, place):
        env.reset(seed=3)
        seen = env.step(env.action_space.sample())[0]
        state = seen["observation"]
        x, y = state[3:6].astype(float), state[6:9].astype(float)
        world_from_hand = np.column_stack([x, y, np.cross(x, y)])
        columns = {row["name"]: i for row, i in indexed(env)}
        mass = columns["center_of_mass"]
        point = GRASP_CENTER if env is reach else state[mass : mass + 3]
        assert np.allclose(seen["achieved_goal"], state[:3] + world_from_hand @ point, atol=1e-5)


def indexed(env: Any) -> Iterator[tuple[Any, int]]:
    core, first = env.unwrapped._core, 0
    for row in core.tables["observations"][core.control][core.config.fingers]["state"]:
        yield row, first
        first += row["size"]


def test_goals_are_where_they_may_be() -> None:
    """Half of those of the object are on the table; few episodes begin with success."""
    reach, place = make(REACH), make(PLACE)
    found = [reach.reset(seed=seed)[0] for seed in range(200)]
    goals = np.array([seen["desired_goal"] for seen in found])
    assert (np.abs(goals[:, :2]) <= 0.15).all()
    assert (goals[:, 2] <= 0.5).all()
    assert (goals[:, 2] >= 0.05).all()
    resets = [place.reset(seed=seed) for seed in range(400)]
    rises = np.array([seen["desired_goal"][2] - seen["achieved_goal"][2] for seen, _ in resets])
    assert rises.max() > 0.22
    assert (rises <= 0.25).all()
    assert (rises >= -1e-3).all()
    assert 0.4 < (rises < 1e-3).mean() < 0.6
    assert 0.005 < np.mean([info["is_success"] for _, info in resets]) < 0.05


@EVERY
def test_a_goal_follows_from_the_seed_and_changes_nothing_else(env_id: str) -> None:
    """In single and vector environments of any number; `goal` replaces it, all else stays as without goals."""
    env, grasp = make(env_id, obs="state"), gymnasium.make("graspbox/Grasp-v0", objects=OBJECTS, control="top_down")
    first = env.reset(seed=5)[0]
    many = make_vec(env_id, 4, obs="state").reset(seed=2)[0]
    assert data_equivalence(rows(many)[3], first, exact=True)
    assert (first["observation"] == grasp.reset(seed=5)[0]).all()
    given = env.reset(seed=5, options={"goal": [0.1, -0.2, 0.4]})[0]
    assert (given["desired_goal"] == np.array([0.1, -0.2, 0.4], np.float32)).all()
    assert (given["observation"] == first["observation"]).all()


@EVERY
def test_vectors_singles_and_servers_have_the_same_bits(env_id: str) -> None:
    keywords: dict[str, Any] = {"obs": "proprio", "randomization": "standard", "reward": "dense"}
    with EnvironmentServer(ServerSettings(port=0)) as server:
        pools = [make_vec(env_id, 2, **keywords), make_vec(env_id, 2, remote=server.url, **keywords)]
        singles = [make(env_id, **keywords), make(env_id, remote=server.url, **keywords)]
        starts = [envs.reset(seed=3) for envs in pools]
        assert data_equivalence(starts[0], starts[1], exact=True)
        alone = [env.reset(seed=4) for env in singles]
        assert data_equivalence(alone[0], alone[1], exact=True)
        actions = np.random.default_rng(0).uniform(-1, 1, (8, 2, 6)).astype(np.float32)
        for action in actions:
            steps = [envs.step(action) for envs in pools]
            assert data_equivalence(steps[0], steps[1], exact=True)
            alone = [env.step(action[1]) for env in singles]
            assert data_equivalence(alone[0], alone[1], exact=True)
            assert data_equivalence(rows(steps[0][0])[1], alone[0][0], exact=True)
            assert steps[0][1][1] == alone[0][1]


@EVERY
def test_an_episode_ends_at_success_only_if_asked(env_id: str) -> None:
    """It is truncated after 50 steps."""
    where = {"place": [0.0, 0.0, 0.0], "goal": [0.0, 0.0, 0.05]} if env_id == PLACE else {}
    for ends in (False, True):
        env = make(env_id, terminate_on_success=ends, threshold=0.1)
        seen, _ = env.reset(seed=2, options=where)
        steps, over = 0, [False, False]
        while not any(over):
            seen, reward, *over, info = env.step(towards(seen) if env_id == REACH else np.zeros(6))
            steps += 1
        assert over == [ends, not ends]
        assert info["is_success"]
        assert reward == 0.0
        assert (steps < 10) == ends
        assert ends or steps == 50


def swept(env_id: str, aside: float) -> list[Any]:
    """Return the steps of a hand that sweeps a ball towards the edge of the table, from a little aside, metres."""
    options = {
        "object": "ball-000000",
        "place": [0.0, 0.3, 0.0],
        "world_from_hand": [[1, 0, 0, aside], [0, -1, 0, 0.1], [0, 0, -1, 0.1], [0, 0, 0, 1]],
    }
    env = make(env_id, obs="state", control="top_down")
    env.reset(seed=0, options=options)
    steps = [env.step(np.array([0, 0, -0.5, 0, -1, 0])) for _ in range(3)]
    while len(steps) < 30 and not steps[-1][2]:
        steps.append(env.step(np.array([0, 1, 0, 0, -1, 0])))
    return steps


def test_a_lost_object_ends_nothing() -> None:
    """To end there would be better than -1 in every further step. Where the ball bounces off the hand, it may stay."""
    for aside in (0.0, 0.002, 0.004, 0.006, 0.008, -0.002, -0.004, -0.006):
        steps = swept(PLACE, aside)
        assert len(steps) == 30
        if steps[-1][0]["achieved_goal"][2] < -0.5:
            break
    else:
        pytest.fail("no ball falls off the table")
    assert steps[-1][1] == -1.0
    ended = swept("graspbox/Grasp-v0", aside)
    assert len(ended) < 30
    assert ended[-1][4]["failure"] != ""


@EVERY
def test_a_state_and_a_copy_keep_the_goal(env_id: str) -> None:
    env: Any = make(env_id, obs="state").unwrapped
    env.reset(seed=6, options={"goal": [0.0, 0.1, 0.2]})
    env.step(np.zeros(6))
    copies = [pickle.loads(pickle.dumps(env)), copy.deepcopy(env), make(env_id, obs="state").unwrapped]
    copies[2].set_state(env.get_state())
    action = np.full(6, 0.3, dtype=np.float32)
    ours = env.step(action)
    assert (ours[0]["desired_goal"] == np.array([0.0, 0.1, 0.2], np.float32)).all()
    assert all(data_equivalence(ours, other.step(action), exact=True) for other in copies)
    for other in (make(PLACE if env_id == REACH else REACH, obs="state"), make(env_id, threshold=0.3)):
        with pytest.raises(errors.ConfigError, match="another goal task, threshold or end"):
            other.unwrapped.set_state(env.get_state())


def test_a_picture_shows_the_goal_and_no_observation_does() -> None:
    env = make(REACH, obs="rgb", render_mode="rgb_array")
    pictures, seen = [], []
    for goal in ([0.2, -0.2, 0.1], [-0.2, 0.2, 0.5]):
        seen.append(env.reset(seed=1, options={"goal": goal})[0]["observation"])
        pictures.append(env.render())
    assert (seen[0] == seen[1]).all()
    red = [(picture[..., 0].astype(int) - picture[..., 1] > 100).sum() for picture in pictures]
    assert min(red) > 20
    assert (pictures[0] != pictures[1]).any()


@pytest.mark.parametrize(
    ("keywords", "message"),
    [
        ({"reward": "firm"}, "no reward 'firm'; choose from sparse, dense"),
        ({"reward_weights": {"goal": 2.0}}, "reward_weights is .* leave it out"),
        ({"layout": "pile"}, "layout is 'pile'.* one object"),
        ({"obs": ("state", "proprio")}, "obs is .* name one observation"),
        ({"obs": "moon"}, "no observation 'moon'"),
        ({"threshold": 0.0}, "threshold"),
    ],
)
def test_refused_keywords_are_named(keywords: dict[str, Any], message: str) -> None:
    with pytest.raises(errors.ConfigError, match=message) as caught:
        make(PLACE, **keywords)
    assert caught.value.field in (*keywords, "")


def test_refused_goals_are_named() -> None:
    env = make(REACH)
    with pytest.raises(errors.ConfigError, match=r"goal.*keep it between"):
        env.reset(seed=0, options={"goal": [0.0, 0.0, 0.9]})
    with pytest.raises(errors.ConfigError, match="no goals; leave it out"):
        gymnasium.make("graspbox/Grasp-v0", objects=OBJECTS).reset(seed=0, options={"goal": [0.0, 0.0, 0.2]})


def test_views_compute_rewards_where_there_are_goals() -> None:
    envs = make_vec(PLACE, 2)
    goals = np.zeros((5, 3)), np.ones((5, 3))
    assert [found.tolist() for found in envs.call("compute_reward", *goals, [{}] * 5)] == [[-1.0] * 5] * 2
    others: Any = gymnasium.make_vec("graspbox/Grasp-v0", objects=OBJECTS)
    assert not hasattr(others.envs[0], "compute_reward")


@EVERY
@pytest.mark.train
def test_hindsight_experience_replay_learns(env_id: str) -> None:
    """Stable-Baselines3 relabels with the reward of the environment: relabelled transitions succeed."""
    sb3 = pytest.importorskip("stable_baselines3")
    from graspbox.sb3 import VecEnv

    env = VecEnv.make(env_id, 2, objects=OBJECTS, max_episode_steps=10)
    found = env.env_method("compute_reward", np.zeros((4, 3)), np.zeros((4, 3)), [{}] * 4, indices=[0])
    assert [one.tolist() for one in found] == [[0.0] * 4]
    normalized = sb3.common.vec_env.VecNormalize(env, norm_reward=False)
    buffer = sb3.HerReplayBuffer
    model = sb3.SAC(
        "MultiInputPolicy", normalized, replay_buffer_class=buffer, learning_starts=40, seed=0, device="cpu"
    )
    model.learn(60)
    rewards = model.replay_buffer.sample(200).rewards.numpy()
    assert set(np.unique(rewards)) == {-1.0, 0.0}
    assert (rewards == 0).mean() > 0.2
