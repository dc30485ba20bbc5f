"""``graspbox/GraspPose-v0``: what is particular to it; what all environments must do: ``test_conformance``."""

from typing import Any

import gymnasium
import numpy as np
import pytest

import graspbox
from graspbox import errors
from graspbox.envs.grasp_pose import POSITION_HIGH, POSITION_LOW, rotation_from_columns


def test_make_with_the_module_prefix() -> None:
    env = gymnasium.make("graspbox:graspbox/GraspPose-v0", objects="procedural:ball:0")
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


@pytest.mark.parametrize("wrong", [{"obs": "deep"}, {"reward": "dense"}, {"objects": "cupboard"}, {"split": "x"}])
def test_wrong_arguments_are_explained(wrong: dict[str, Any]) -> None:
    with pytest.raises(errors.GraspboxError):
        gymnasium.make("graspbox/GraspPose-v0", **wrong)


def test_chosen_object() -> None:
    env = gymnasium.make("graspbox/GraspPose-v0", objects="procedural:ball:0-2")
    assert env.reset(options={"object": "ball-000002"})[1]["object"] == "ball-000002"
    with pytest.raises(errors.ConfigError, match="no object"):
        env.reset(options={"object": "moon"})
