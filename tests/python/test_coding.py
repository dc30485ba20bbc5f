"""Poses are read from states and encoded as actions alike for both environments and every control mode."""

import doctest
from typing import Any

import gymnasium
import numpy as np
import pytest

import graspbox
from acting import ACTING
from graspbox import errors, load_hand
from graspbox.envs import coding
from graspbox.envs.coding import Codec, encode_action, hand_pose, object_pose, rotation_from_columns

DECISIONS = ("grasp_pose", "grasp_point")
MODES = ("twist", "delta_pose", "target_pose", "top_down", *DECISIONS)


def make(control: str, **settings: Any) -> Any:
    env_id = "graspbox/GraspPose-v0" if control in DECISIONS else "graspbox/Grasp-v0"
    return gymnasium.make(env_id, objects="procedural:mug:0", control=control, **settings).unwrapped


def test_the_example_of_the_module_runs() -> None:
    result = doctest.testmod(coding)
    assert result.attempted > 5
    assert result.failed == 0


@pytest.mark.parametrize("control", MODES)
def test_the_pose_of_a_state_is_that_of_the_simulation(control: str) -> None:
    env = make(control)
    for seed in range(4):
        state, _ = env.reset(seed=seed)
        poses = env._core.pool.poses()
        pose = object_pose(state)
        np.testing.assert_allclose(pose, poses[0][0], atol=1e-6)
        np.testing.assert_allclose(pose[:3, :3].T @ pose[:3, :3], np.eye(3), atol=1e-14)
        np.testing.assert_array_equal(object_pose(state, control=control), pose)
        np.testing.assert_array_equal(object_pose(state, hand=load_hand()), pose)
        if control in DECISIONS:
            with pytest.raises(errors.ConfigError, match="no column 'hand_rotation'"):
                hand_pose(state)
        else:
            np.testing.assert_allclose(hand_pose(state), poses[1][0], atol=1e-6)


@pytest.mark.parametrize(("control", "fingers"), ACTING)
@pytest.mark.parametrize("control_freq", [5, 10, 20, 50])
def test_an_encoded_action_leads_to_the_pose(control: str, fingers: str, control_freq: float) -> None:
    """A goal 1 cm and 0.03 rad away: the action of a step, held by the next ones, leads there."""
    env = make(control, fingers=fingers, control_freq=control_freq)
    state, _ = env.reset(seed=1)
    start = hand_pose(state)
    goal, angle = start.copy(), 0.03
    turn = np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1.0]])
    goal[:3, :3], goal[:3, 3] = start[:3, :3] @ turn, start[:3, 3] + [0.006, -0.008, 0.004]
    reference = start
    settings: dict[str, Any] = {"control": control, "fingers": fingers, "control_freq": control_freq}
    for _ in range(max(12, round(0.6 * control_freq))):
        begin = hand_pose(state) if control in ("twist", "top_down") else reference
        action = encode_action(goal, 0.3, world_from_start=begin, **settings)
        assert env.action_space.contains(action)
        reference = goal
        state = env.step(action)[0]
    np.testing.assert_allclose(hand_pose(state), goal, atol=2e-3)
    assert np.abs(start - goal).max() > 4e-3
    assert Codec(control, fingers=fingers).column(state, "preshape") == pytest.approx(0.3, abs=1e-2)


def test_actuators_take_their_speeds() -> None:
    pose = np.diag([1.0, -1.0, -1.0, 1.0])
    speeds = [3.5, 0.0, -1.75]
    action = encode_action(pose, 0.0, control="target_pose", fingers="each", actuator_speed=speeds)
    np.testing.assert_allclose(action[9:12], [1.0, 0.0, -0.5])
    np.testing.assert_allclose(action[:9], [0, 0, -1, 1, 0, 0, 0, -1, 0])
    assert action[12] == -1.0
    # Together they take the mean share of 3 rad/s, the speed at which a trial closes them.
    action = encode_action(pose, 0.0, control="target_pose", actuator_speed=speeds)
    np.testing.assert_allclose(action[9:], [(3.5 - 1.75) / 9, -1.0], rtol=1e-6)


@pytest.mark.parametrize("hand", graspbox.Hand.names())
def test_the_speeds_of_a_trial_close_every_hand_fully(hand: str) -> None:
    loaded = load_hand(hand)
    speeds = np.array(loaded.closing_speeds)
    goal = np.diag([1.0, -1.0, -1.0, 1.0])
    for share in (1.0, 0.5, 0.0, -1.0):
        settings: dict[str, Any] = {"hand": hand, "actuator_speed": share * speeds, "world_from_start": goal}
        action = encode_action(goal, loaded.preshape_limits[0], control="top_down", **settings)
        np.testing.assert_allclose(action[:5], [0, 0, 0, 0, share], atol=1e-6)
        assert len(action) <= 6


def test_a_motion_from_above_is_in_the_axes_of_the_world() -> None:
    """Position and yaw; the tilt of the goal is left out."""
    start = np.diag([-1.0, 1.0, -1.0, 1.0])
    goal, angle, tilt = start.copy(), 0.2, 0.1
    yaw = np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1.0]])
    goal[:3, :3], goal[:3, 3] = yaw @ start[:3, :3], [0.01, -0.02, 0.03]
    settings: dict[str, Any] = {"control": "top_down", "world_from_start": start, "control_freq": 10}
    action = encode_action(goal, 0.0, **settings)
    # Shares of 0.5 m/s and 2 rad/s in a step of 0.1 s.
    np.testing.assert_allclose(action, [0.2, -0.4, 0.6, 1.0, 0.0, -1.0], atol=1e-6)
    lean = np.array([[np.cos(tilt), 0, np.sin(tilt)], [0, 1, 0], [-np.sin(tilt), 0, np.cos(tilt)]])
    goal[:3, :3] = lean @ start[:3, :3]
    np.testing.assert_allclose(encode_action(goal, 0.0, **settings)[3], 0.0, atol=1e-6)


def test_a_decision_is_clipped_to_the_box_of_positions() -> None:
    pose = np.diag([1.0, -1.0, -1.0, 1.0])
    pose[:3, 3] = 0.125, -9.0, 0.2
    np.testing.assert_allclose(encode_action(pose, np.pi / 4), [0.5, -1, 0, 1, 0, 0, 0, -1, 0, 0], atol=1e-7)


@pytest.mark.parametrize("hand", graspbox.Hand.names())
def test_a_decision_about_a_point_names_a_pose(hand: str) -> None:
    """Decoded and encoded again it is the same action; the pose has the grasp centre at the point."""
    code, rng, center = Codec("grasp_point", hand), np.random.default_rng(1), load_hand(hand).grasp_center
    size = 6 + int(load_hand(hand).preshape_limits[0] < load_hand(hand).preshape_limits[1])
    for action in rng.uniform(-0.7, 0.7, (20, size)):
        pose, preshape = code.decode_grasp(action)
        np.testing.assert_allclose(code.encode_action(pose, preshape), action, atol=1e-6)
        point = pose[:3, :3] @ center + pose[:3, 3]
        np.testing.assert_allclose(point, [0.12 * action[0], 0.12 * action[1], 0.125 * (1 + action[2])], atol=1e-12)
        # The approach leans by the tilt.
        assert np.arccos(-pose[2, 2]) == pytest.approx(np.pi / 4 * np.linalg.norm(action[3:5]), abs=1e-6)
    down, _ = code.decode_grasp(np.zeros(size))
    np.testing.assert_allclose(down[:3, :3], np.diag([1.0, -1.0, -1.0]), atol=1e-15)
    longest, _ = code.decode_grasp(np.array([0, 0, 0, 1, 1, 0.3, *([0.0] * (size - 6))]))
    assert np.arccos(-longest[2, 2]) == pytest.approx(np.pi / 4, abs=1e-9)


def test_a_decision_about_a_point_is_tried_at_its_pose() -> None:
    """The hand ends where it does after the decision that names the same pose; a lift differs by rounding alone."""
    about, at, rng, lifted = make("grasp_point"), make("grasp_pose"), np.random.default_rng(0), 0
    for seed in range(12):
        action = np.concatenate([rng.uniform(-0.2, 0.2, 2), rng.uniform(-0.8, -0.4, 1), rng.uniform(-0.4, 0.4, 4)])
        outcomes, ends = [], []
        for env, code in ((about, None), (at, Codec("grasp_point"))):
            env.reset(seed=seed)
            info = env.step(encode_action(*code.decode_grasp(action)) if code else action.astype(np.float32))[4]
            outcomes.append(info["failure"])
            ends.append(env._core.pool.poses()[1][0])
        assert outcomes[0] == outcomes[1]
        np.testing.assert_allclose(ends[0], ends[1], atol=1e-5)
        lifted += outcomes[0] == ""
    assert lifted


def test_what_is_no_state_or_pose_is_explained() -> None:
    sizes = {control: Codec(control).state_size for control in ("twist", "target_pose", "grasp_pose")}
    known = rf"obs='state' has length .*{sizes['twist']}, .*{sizes['grasp_pose']}$"
    with pytest.raises(errors.ConfigError, match=known):
        object_pose(np.zeros(3))
    with pytest.raises(errors.ConfigError, match=f"obs='state' has length .*{sizes['target_pose']}"):
        object_pose(np.zeros(sizes["twist"]), control="target_pose")
    with pytest.raises(errors.ConfigError, match="object_rotation of the state"):
        object_pose(np.zeros(sizes["twist"]))
    with pytest.raises(errors.ConfigError, match="world_from_start"):
        encode_action(np.eye(4), 0.0, control="twist")
    with pytest.raises(errors.ConfigError, match=r"world_from_hand has shape \(3, 4\)"):
        encode_action(np.eye(4)[:3], 0.0)
    with pytest.raises(errors.ConfigError, match="3 actuators"):
        encode_action(np.eye(4), 0.0, control="target_pose", actuator_speed=[1.0, 2.0])


def test_rotation_from_columns_is_a_rotation() -> None:
    rng = np.random.default_rng(0)
    for _ in range(100):
        rotation = rotation_from_columns(*rng.uniform(-1, 1, (2, 3)))
        assert rotation is not None
        np.testing.assert_allclose(rotation.T @ rotation, np.eye(3), atol=1e-12)
        assert np.linalg.det(rotation) > 0
    assert rotation_from_columns(np.zeros(3), np.ones(3)) is None
    assert rotation_from_columns(np.ones(3), 2 * np.ones(3)) is None
