"""One conformance test over every registered environment, and what is particular to each."""

import warnings
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env, data_equivalence

import graspbox
from graspbox import errors
from graspbox.envs import IDS
from graspbox.envs.grasp_pose import POSITION_HIGH, POSITION_LOW, rotation_from_columns

OBJECTS = ["procedural:ball:0-2", "procedural:can:0-1", "procedural:mug:0"]


@pytest.fixture(params=IDS)
def env(request: pytest.FixtureRequest) -> Any:
    made = gymnasium.make(request.param, objects=OBJECTS)
    yield made
    made.close()


def rollout(env: Any, seed: int, episodes: int = 6) -> list[Any]:
    """Everything that a few episodes with seeded actions return."""
    env.action_space.seed(seed)
    seen: list[Any] = []
    for episode in range(episodes):
        seen.append(env.reset(seed=seed if episode == 0 else None))
        done = False
        while not done:
            *step, terminated, truncated, info = env.step(env.action_space.sample())
            seen.append((*step, terminated, truncated, info))
            done = terminated or truncated
    return seen


def test_gymnasium_finds_nothing_to_complain_about(env: Any) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_env(env.unwrapped)


def test_bounds_are_finite(env: Any) -> None:
    for space in (env.observation_space, env.action_space):
        assert np.isfinite(space.low).all()
        assert np.isfinite(space.high).all()


def test_same_seed_same_bits(env: Any) -> None:
    assert data_equivalence(rollout(env, 7), rollout(env, 7), exact=True)
    again = gymnasium.make(env.spec)
    assert data_equivalence(rollout(again, 7), rollout(env, 7), exact=True)


def test_observations_vary_and_share_no_memory(env: Any) -> None:
    first = [env.reset(seed=seed)[0] for seed in range(12)]
    kept = [obs.copy() for obs in first]
    assert all((a == b).all() for a, b in zip(first, kept, strict=True))
    assert not any(np.shares_memory(a, b) for i, a in enumerate(first) for b in first[:i])
    assert (np.ptp(np.stack(first), axis=0) > 0).sum() >= env.observation_space.shape[0] - 4
    env.reset(seed=0)
    end = env.step(env.action_space.sample())[0]
    assert not any(np.shares_memory(end, obs) for obs in first)


def test_make_with_the_module_prefix() -> None:
    env = gymnasium.make(f"graspbox:{IDS[0]}", objects="procedural:ball:0")
    assert env.reset(seed=0)[1]["object"] == "ball-000000"


def action_for(world_from_hand: np.ndarray, preshape: float) -> np.ndarray:
    """Name a pose as an action of GraspPose-v0."""
    position = (world_from_hand[:3, 3] - POSITION_LOW) / (POSITION_HIGH - POSITION_LOW) * 2 - 1
    columns = world_from_hand[:3, :2].T.ravel()
    return np.concatenate([position, columns, [preshape / (np.pi / 2) * 2 - 1]]).astype(np.float32)


def test_a_planned_grasp_gives_the_reward_that_simulate_promises() -> None:
    """The environment and `simulate` run the same trial: the same verdicts, some of them a success."""
    env: Any = gymnasium.make("graspbox/GraspPose-v0", objects=["procedural:can:0-3", "procedural:box:0-3"]).unwrapped
    verdicts = []
    for seed in range(6):
        _, info = env.reset(seed=seed)
        scene = env._scene
        plan = graspbox.plan(scene.mesh, world_from_object=scene.world_from_object, seed=seed)
        if not plan.feasible.any():
            continue
        pose, preshape = plan.poses[0], plan.preshape[0]
        promised = scene.simulate(pose[None], [preshape])
        world_from_hand = env._world_from_table @ scene.world_from_object @ pose
        _, reward, terminated, truncated, info = env.step(action_for(world_from_hand, preshape))
        assert terminated
        assert not truncated
        assert reward == float(info["is_success"])
        verdicts.append((info["is_success"], bool(promised.success[0])))
    assert any(env_says for env_says, _ in verdicts)
    # The action is float32, so that the pose differs in its last digits.
    assert sum(a == b for a, b in verdicts) >= len(verdicts) - 1


def test_degenerate_and_colliding_actions_are_infeasible() -> None:
    env = gymnasium.make("graspbox/GraspPose-v0", objects="procedural:can:0")
    actions = {
        "no first column": [0, 0, 1, 0, 0, 0, 0, 1, 0, 0],
        "parallel columns": [0, 0, 1, 1, 0, 0, 1, 0, 0, 0],
        "palm in the table": [0, 0, -1, 1, 0, 0, 0, -1, 0, -1],
    }
    for action in actions.values():
        env.reset(seed=0)
        _, reward, terminated, truncated, info = env.step(np.array(action, dtype=np.float32))
        assert reward == 0.0
        assert terminated
        assert not truncated
        assert info["infeasible"]
        assert info["failure"] == "infeasible"
        assert info["is_success"] is False


def test_rotation_from_columns_is_a_rotation() -> None:
    rng = np.random.default_rng(0)
    for _ in range(100):
        rotation = rotation_from_columns(*rng.uniform(-1, 1, (2, 3)))
        assert rotation is not None
        np.testing.assert_allclose(rotation.T @ rotation, np.eye(3), atol=1e-12)
        assert np.linalg.det(rotation) > 0


@pytest.mark.parametrize("wrong", [{"obs": "depth"}, {"reward": "dense"}, {"objects": "cupboard"}, {"split": "x"}])
def test_wrong_arguments_are_explained(wrong: dict[str, Any]) -> None:
    with pytest.raises(errors.GraspboxError):
        gymnasium.make("graspbox/GraspPose-v0", **wrong)


def test_chosen_object() -> None:
    env = gymnasium.make("graspbox/GraspPose-v0", objects="procedural:ball:0-2")
    assert env.reset(options={"object": "ball-000002"})[1]["object"] == "ball-000002"
    with pytest.raises(errors.ConfigError, match="no object"):
        env.reset(options={"object": "moon"})
