"""``graspbox/GraspPose-v0``: its own behaviour; ``test_conformance`` has the requirements of all environments."""

from typing import Any

import gymnasium
import numpy as np
import pytest

import graspbox
from graspbox import errors
from graspbox.configs import FRONT, CameraConfig, CamerasConfig
from graspbox.envs.coding import encode_action, object_pose


def test_make_with_the_module_prefix() -> None:
    env = gymnasium.make("graspbox:graspbox/GraspPose-v0", objects="procedural:ball:0")
    assert env.reset(seed=0)[1]["object"] == "ball-000000"


def where(env: Any) -> np.ndarray:
    """Tell where the object is in the world, (4, 4)."""
    pose: np.ndarray = env._core.pool.poses()[0][0]
    return pose


def test_a_planned_grasp_gives_the_reward_that_simulate_promises() -> None:
    """The environment and `simulate` run the same trial: the same verdicts, some of them a success."""
    env: Any = gymnasium.make("graspbox/GraspPose-v0", objects=["procedural:can:0-3", "procedural:box:0-3"]).unwrapped
    verdicts = []
    for seed in range(6):
        _, info = env.reset(seed=seed)
        lies = where(env)
        scene = graspbox.Scene(env.objects[env.objects.names.index(info["object"])].load(), world_from_object=lies)
        plan = graspbox.plan(scene.mesh, world_from_object=lies, seed=seed)
        if not plan.feasible.any():
            continue
        pose, preshape = plan.poses[0], plan.preshape[0]
        promised = scene.simulate(pose[None], [preshape])
        _, reward, terminated, truncated, info = env.step(encode_action(lies @ pose, preshape))
        assert terminated
        assert not truncated
        assert reward == float(info["is_success"])
        verdicts.append((info["is_success"], bool(promised.success[0])))
        if verdicts[-1][0] == verdicts[-1][1]:
            assert info["lift"] == pytest.approx(promised.lift[0], abs=0.02)
    assert len(verdicts) >= 4
    assert any(env_says for env_says, _ in verdicts)
    # The action is float32, so that the pose differs in its last digits.
    assert sum(a == b for a, b in verdicts) >= len(verdicts) - 1


def good_grasp(env: Any) -> np.ndarray:
    """Take the planner's first pose for the object as it lies."""
    mesh = env.objects[0].load()
    plan = graspbox.plan(mesh, world_from_object=where(env))
    return encode_action(where(env) @ plan.poses[0], plan.preshape[0])


def test_the_dense_reward_rises_from_nowhere_to_a_held_object() -> None:
    env: Any = gymnasium.make("graspbox/GraspPose-v0", objects="procedural:can:0", reward="dense").unwrapped
    env.reset(seed=0)
    grasp = good_grasp(env)
    beside, above, inside, nowhere = grasp.copy(), grasp.copy(), grasp.copy(), np.zeros(10, dtype=np.float32)
    # The upper corner of the box of positions, 20 cm higher, and 4 cm lower, in the object or the table.
    beside[:3] = [1.0, 1.0, 0.9]
    above[2] += 1.0
    inside[2] -= 0.2
    rewards, terms, failures = [], [], []
    for action in (nowhere, beside, above, grasp):
        env.reset(seed=0)
        _, reward, _, _, info = env.step(action)
        rewards.append(reward)
        terms.append(info["reward_terms"])
        failures.append(info["failure"])
    assert failures == ["infeasible", "no_contact", "no_contact", ""]
    assert rewards == sorted(rewards)
    assert terms[0]["failure"] == -1.0
    assert terms[1]["contact"] == terms[2]["contact"] == 0.0
    # The engine lets a resting object breathe by micrometres.
    assert terms[2]["lift"] < 1e-4
    assert 0.0 <= terms[1]["reach"] < terms[2]["reach"] < terms[3]["reach"] <= 1.0
    assert min(terms[3][name] for name in ("contact", "closure", "lift", "hold", "success")) > 0.0
    env.reset(seed=0)
    blocked = env.step(inside)[4]
    assert blocked["infeasible"]
    assert blocked["reward_terms"]["reach"] > terms[2]["reach"]
    weighed: Any = gymnasium.make(
        "graspbox/GraspPose-v0", objects="procedural:can:0", reward_weights={"lift": 2.0}
    ).unwrapped
    weighed.reset(seed=0)
    assert weighed.step(grasp)[1] == pytest.approx(1.0 + 2.0 * terms[3]["lift"])


def test_an_object_comes_to_rest_from_where_it_is_let_go() -> None:
    """Tipped and 5 cm up: it is observed as it lies then, and grasped as well as any other."""
    env: Any = gymnasium.make("graspbox/GraspPose-v0", objects="procedural:box:1").unwrapped
    env.reset(seed=0)
    tipped = np.eye(4)
    angle = np.pi / 2 - 0.1
    tipped[1:3, 1:3] = [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
    tipped[:3, 3] = 0.05, -0.02, 0.3
    state, _ = env.reset(seed=0, options={"world_from_object": tipped})
    lies = where(env)
    assert lies[2, 3] < 0.25
    np.testing.assert_allclose(object_pose(state), lies, atol=1e-6)
    settled = graspbox.Scene(env.objects[0].load(), world_from_object=lies).world_from_object
    np.testing.assert_allclose(settled[:3, :3], lies[:3, :3], atol=5e-3)
    assert not env.step(good_grasp(env))[4]["infeasible"]


def test_an_error_of_calibration_moves_the_hand() -> None:
    settings: dict[str, Any] = {"objects": "procedural:can:0"}
    exact: Any = gymnasium.make("graspbox/GraspPose-v0", **settings).unwrapped
    vague: Any = gymnasium.make("graspbox/GraspPose-v0", randomization="standard", **settings).unwrapped
    shifts = []
    for seed in range(4):
        hands = []
        for env in (exact, vague):
            env.reset(seed=seed)
            # High above everything.
            env.step(np.array([0, 0, 1, 1, 0, 0, 0, -1, 0, -1], dtype=np.float32))
            hands.append(env._core.pool.poses()[1][0][:3, 3])
        shifts.append(hands[1] - hands[0])
    assert 1e-4 < np.abs(shifts).max() < 0.005 + 1e-6


def test_the_hand_waits_where_it_is_asked_to() -> None:
    """Aside by default, unseen from in front and from overhead, and seeing the object; elsewhere on request."""
    obs = ("proprio", "tactile", "segmentation", "segmentation_overhead", "segmentation_wrist")
    overhead = CameraConfig("overhead", eye=(0.0, 0.0, 0.8), target=(0.0, 0.0, 0.0), up=(1.0, 0.0, 0.0), fov=0.6)
    wrist = CameraConfig("wrist", "hand", eye=(0.0, 0.075, 0.0), target=(0.0, 0.0, 0.6), up=(-1.0, 0.0, 0.0), fov=1.2)
    settings: dict[str, Any] = {
        "objects": "procedural:box:0-4",
        "cameras": CamerasConfig(cameras=(FRONT, overhead, wrist)),
    }
    env: Any = gymnasium.make("graspbox/GraspPose-v0", obs=obs, **settings).unwrapped
    above: Any = gymnasium.make("graspbox/Grasp-v0", objects="procedural:box:0-4", obs="proprio").unwrapped
    # Table 1, object 2, then the hand.
    of_object = 2
    for seed in range(12):
        seen, info = env.reset(seed=seed)
        lower, same = above.reset(seed=seed)
        assert info["object"] == same["object"]
        # As there, but further off, and tipped to the side about the table's middle.
        down, aside = np.array([0, 0, 0.35]), np.eye(3)
        aside[1:, 1:] = np.array([[np.cos(0.873), np.sin(0.873)], [-np.sin(0.873), np.cos(0.873)]])
        np.testing.assert_allclose(seen["proprio"][:3], aside @ (lower[:3] + down), atol=1e-6)
        np.testing.assert_allclose(seen["proprio"][3:6], aside @ lower[3:6], atol=1e-6)
        np.testing.assert_array_equal(seen["proprio"][9:], lower[9:])
        assert not seen["tactile"].any()
        assert seen["segmentation"].max() == seen["segmentation_overhead"].max() == of_object
        # The fingers may stand before a camera beside the palm, but not before all of the object.
        assert (seen["segmentation_wrist"] == of_object).sum() > 20
        env.step(np.array([0, 0, 1, 1, 0, 0, 0, -1, 0, -1], dtype=np.float32))
    near = np.diag([1.0, -1.0, -1.0, 1.0])
    near[:3, 3] = 0.1, 0.05, 0.4
    seen, _ = env.reset(seed=0, options={"world_from_hand": near, "preshape": 0.5})
    np.testing.assert_allclose(seen["proprio"][:3], near[:3, 3], atol=1e-6)
    assert seen["proprio"][-1] == pytest.approx(0.5)
    # 5 cm below the middle of the table's top.
    near[:3, 3] = 0.0, 0.0, -0.05
    with pytest.raises(errors.ConfigError, match="world_from_hand"):
        env.reset(options={"world_from_hand": near})


def test_how_the_hand_waits_changes_nothing_else() -> None:
    env: Any = gymnasium.make("graspbox/GraspPose-v0", objects="procedural:can:0").unwrapped
    ends = []
    elsewhere = np.diag([1.0, -1.0, -1.0, 1.0])
    elsewhere[:3, 3] = 0.1, 0.05, 0.4
    for options in ({}, {"world_from_hand": elsewhere, "preshape": 0.5}):
        first, _ = env.reset(seed=3, options=options)
        ends.append((first, *env.step(good_grasp(env))))
    # The engine computes in the hand's frame: where that waits, poses in the world are rounded.
    np.testing.assert_allclose(ends[0][0], ends[1][0], atol=1e-6)
    assert ends[0][2] == ends[1][2] == 1.0
    assert ends[0][5]["lift"] == pytest.approx(ends[1][5]["lift"], abs=2e-3)


def test_proprioception_after_an_attempt_tells_of_the_hand() -> None:
    """It has closed and risen; the arm's reading differs by the calibration error alone."""
    obs = ("proprio", "tactile")
    env: Any = gymnasium.make("graspbox/GraspPose-v0", objects="procedural:can:0", obs=obs).unwrapped
    env.reset(seed=3)
    grasp = good_grasp(env)
    seen, *_, info = env.step(grasp)
    assert info["is_success"]
    low, high = np.array([-0.25, -0.25, 0.0]), np.array([0.25, 0.25, 0.40])
    place = low + (grasp[:3] + 1) / 2 * (high - low)
    place[2] += env._core.config.trial.lift_height
    np.testing.assert_allclose(seen["proprio"][:3], place, atol=1e-3)
    # The three spools have turned, and something presses on the sensors.
    assert (seen["proprio"][18:21] > 1.0).all()
    assert seen["tactile"].max() > 0.5


def test_the_limit_of_one_step_is_that_of_the_single_environment() -> None:
    settings: dict[str, Any] = {"objects": "procedural:can:0"}
    single = gymnasium.make("graspbox/GraspPose-v0", **settings)
    several = gymnasium.make_vec("graspbox/GraspPose-v0", num_envs=2, **settings)
    single.reset(seed=0)
    several.reset(seed=0)
    action = np.array([0, 0, 1, 1, 0, 0, 0, -1, 0, -1], dtype=np.float32)
    one, all_of_them = single.step(action), several.step(np.stack([action, action]))
    assert [bool(flag) for flag in one[2:4]] == [bool(flags[0]) for flags in all_of_them[2:4]] == [True, True]


def test_degenerate_and_colliding_actions_are_infeasible() -> None:
    env = gymnasium.make("graspbox/GraspPose-v0", objects="procedural:can:0").unwrapped
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


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"obs": "deep"}, "no observation 'deep'"),
        ({"reward": "fair"}, "no reward 'fair'"),
        ({"control": "twist"}, "control is 'twist'; choose from grasp_pose, grasp_point"),
        ({"objects": "cupboard"}, "no object set"),
        ({"split": "x"}, "split"),
    ],
)
def test_wrong_arguments_are_explained(wrong: dict[str, Any], message: str) -> None:
    with pytest.raises(errors.GraspboxError, match=message):
        gymnasium.make("graspbox/GraspPose-v0", **wrong)


def test_chosen_object() -> None:
    env = gymnasium.make("graspbox/GraspPose-v0", objects="procedural:ball:0-2")
    assert env.reset(options={"object": "ball-000002"})[1]["object"] == "ball-000002"
    with pytest.raises(errors.ConfigError, match="no object"):
        env.reset(options={"object": "moon"})
