"""``GraspPose-v0`` with ``control="grasp_point"``; its actions: `test_coding`."""

from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

from graspbox import evaluation, policies
from graspbox.errors import ConfigError

POSE, CANS = "graspbox/GraspPose-v0", "procedural:can:0-9"
POINT: dict[str, Any] = {"control": "grasp_point", "objects": CANS}


def test_it_is_an_environment() -> None:
    check_env(gymnasium.make(POSE, **POINT).unwrapped, skip_render_check=True)


def test_a_vector_acts_as_single_ones() -> None:
    envs: Any = gymnasium.make_vec(POSE, 3, autoreset_mode="Disabled", **POINT)
    actions = np.random.default_rng(0).uniform(-1, 1, (3, 7)).astype(np.float32)
    seen, _ = envs.reset(seed=[4, 5, 6])
    after, rewards, *_ = envs.step(actions)
    one: Any = gymnasium.make(POSE, **POINT)
    for row, seed in enumerate((4, 5, 6)):
        np.testing.assert_array_equal(one.reset(seed=seed)[0], seen[row])
        found, reward, *_ = one.step(actions[row])
        np.testing.assert_array_equal(found, after[row])
        assert reward == rewards[row]


def test_chance_grasps_something() -> None:
    """With poses it does not, so that success alone teaches nothing."""
    random = evaluation.evaluate("random", POSE, CANS, trials=300, seed=1, control="grasp_point")
    assert 3 <= sum(trial.success for trial in random.trials) <= 30
    random = evaluation.evaluate("random", POSE, CANS, trials=300, seed=1)
    assert sum(trial.success for trial in random.trials) <= 1


@pytest.mark.parametrize("name", ["planner", "expert", "robust_oracle", "partial_view_planner", "top_down"])
def test_policies_of_poses_name_the_control_that_they_need(name: str) -> None:
    policy = policies.load(name)
    envs = gymnasium.make_vec(POSE, 1, obs=policy.needed_obs(target=False) or "state", **POINT)
    with pytest.raises(ConfigError, match=r"names poses; make environments with control='grasp_pose'"):
        policy.bind(policies.Task.of(envs))
    envs.close()


def test_a_saved_state_belongs_to_its_control() -> None:
    about, at = (
        gymnasium.make(POSE, objects=CANS, control=control).unwrapped for control in ("grasp_point", "grasp_pose")
    )
    about.reset(seed=0)
    at.reset(seed=0)
    with pytest.raises(ConfigError, match="it has the control mode `grasp_point`"):
        at.set_state(about.get_state())  # type: ignore[attr-defined]


def test_another_control_is_refused() -> None:
    for control in ("twist", "clear", "point"):
        with pytest.raises(ConfigError, match=f"control is '{control}'; choose from grasp_pose, grasp_point"):
            gymnasium.make(POSE, control=control)
