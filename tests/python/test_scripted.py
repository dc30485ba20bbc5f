"""Scripted motions of the hand: releasing a grasp, and leaving a camera's image."""

from typing import Any

import gymnasium
import numpy as np
import pytest

import graspbox
from acting import EACH
from graspbox import errors
from graspbox.configs import CameraConfig, TrialConfig
from graspbox.configs.cameras import camera_pose, lens
from graspbox.envs.coding import Codec
from graspbox.envs.expert import ExpertGrasp, planned
from graspbox.envs.scripted import MotionOptions, ScriptedGrasp, ScriptedMotion, ScriptedRelease
from graspbox.policies._hand_view import HandView

#: Labels of the hand in ``segmentation`` begin here.
HAND_LABEL = 3


@pytest.mark.parametrize("fingers", ["synergy", "each"])
@pytest.mark.parametrize("control", ["twist", "delta_pose", "target_pose"])
def test_a_release_puts_the_object_down_and_leaves_it(control: str, fingers: str) -> None:
    options = MotionOptions(control=control, fingers=fingers, control_freq=20)
    env: Any = gymnasium.make("graspbox/Grasp-v0", objects="procedural:can:0", **options).unwrapped
    codec = Codec(control, fingers=fingers)
    state, _ = env.reset(seed=0)
    lay = codec.pose(state, "object")
    plan = planned(env.objects[0].load(), state, control=control)
    expert = ExpertGrasp(state, plan.poses[0], plan.preshape[0], **options)
    while expert.time < expert.lifts_at + 0.3:
        state, *_ = env.step(expert.act(state))
    assert codec.column(state, "on_table")[0] == 0.0
    lifted = codec.pose(state, "hand")
    release = ScriptedRelease(lifted, expert.goal, float(plan.preshape[0]), [lifted], **options)
    while not release.finished:
        state, *_ = env.step(release.follow(codec.pose(state, "hand")))
    assert codec.column(state, "on_table")[0] == 1.0
    assert codec.column(state, "contact").sum() == 0.0
    assert np.abs(codec.column(state, "actuator")).max() < 0.05
    np.testing.assert_allclose(codec.pose(state, "object")[:3, 3], lay[:3, 3], atol=0.02)
    np.testing.assert_allclose(codec.pose(state, "hand")[:3, 3], lifted[:3, 3], atol=0.01)


@pytest.mark.parametrize(("hand", "preshape"), [("leap", 0.0), ("inspire", 1.0), ("reflex", 0.0)])
def test_fingers_open_as_far_as_the_preshape_says(hand: str, preshape: float) -> None:
    """Once, a released LEAP hand opened to the ends of its travel, and its second attempts failed."""
    options = MotionOptions(control="twist", fingers="each", control_freq=20, hand=hand)
    env: Any = gymnasium.make("graspbox/Grasp-v0", objects="procedural:can:0", **options).unwrapped
    codec, loaded = Codec("twist", hand, fingers="each"), graspbox.load_hand(hand)
    wanted = loaded.open_positions(preshape)

    def follow(motion: ScriptedMotion, state: Any, seconds: float) -> Any:
        for _ in range(round(20 * seconds)):
            state, *_ = env.step(motion.follow(codec.pose(state, "hand"), codec.column(state, "actuator")))
        return state

    state, _ = env.reset(seed=0)
    high = codec.pose(state, "hand")
    high[2, 3] = 0.45
    # On the way to a grasp.
    grasp = ScriptedGrasp(codec.pose(state, "hand"), high, preshape, 0.1, **options)
    state = follow(grasp, state, grasp.closes_at)
    np.testing.assert_allclose(codec.column(state, "actuator"), wanted, atol=0.05)
    state = follow(grasp, state, 1.0)
    closed = codec.column(state, "actuator")
    assert np.abs(closed - wanted).max() > 0.5
    # And as it lets go.
    release = ScriptedRelease(high, high, preshape, **options)
    state = follow(release, state, 2.0)
    np.testing.assert_allclose(codec.column(state, "actuator"), wanted, atol=0.05)


def test_the_hand_backs_off_before_it_goes_elsewhere() -> None:
    goal = np.diag([1.0, -1.0, -1.0, 1.0])
    goal[2, 3] = 0.1
    elsewhere = goal.copy()
    elsewhere[:3, 3] = 0.3, 0.0, 0.5
    release = ScriptedRelease(goal, goal, 0.0, [elsewhere], control_freq=20)
    heights = []
    while not release.finished:
        heights.append(release._wanted(release.time)[:3, 3])
        release.follow(goal)
    path = np.array(heights)
    aside = np.flatnonzero(path[:, 0] > 1e-6)[0]
    assert path[aside - 1, 2] == pytest.approx(0.1 + TrialConfig().standoff, abs=0.03)
    np.testing.assert_allclose(path[-1], elsewhere[:3, 3], atol=0.02)


def camera_of(name: str) -> CameraConfig:
    """Make a camera in front of the table, over it, or one that sees all of the workspace."""
    if name == "front":
        return CameraConfig()
    if name == "above":
        return CameraConfig("above", eye=(0.0, 0.0, 0.7), target=(0.0, 0.0, 0.0), up=(1.0, 0.0, 0.0))
    return CameraConfig("all", eye=(-3.0, 0.0, 1.0), target=(0.0, 0.0, 0.3), fov=1.0)


@pytest.mark.parametrize("name", ["front", "above"])
def test_a_hand_that_leaves_the_image_is_not_rendered_there(name: str) -> None:
    """The segmentation of the environment is the truth: before, it shows the hand; after, only table and object."""
    camera = camera_of(name)
    cameras = graspbox.CamerasConfig(cameras=(camera,), image_size=(96, 96))
    env: Any = gymnasium.make(
        "graspbox/Grasp-v0", objects="procedural:can:0", obs=("segmentation", "proprio"), cameras=cameras, **EACH
    ).unwrapped
    codec = Codec("twist", vector="proprio")
    view = HandView(graspbox.load_hand("reflex"), camera_pose(camera), lens(camera.fov, (96, 96)), (96, 96))
    for seed in range(6):
        seen, _ = env.reset(seed=seed)
        hand = codec.pose(seen["proprio"], "hand")
        stops = view.leave(hand, 0.0)
        # A hand in the image is always detected; one close to its border may count as visible.
        assert stops or not (seen["segmentation"] >= HAND_LABEL).any()
        motion = ScriptedMotion([hand, *stops], 0.0, **EACH)
        while not motion.finished:
            seen, *_ = env.step(motion.follow(codec.pose(seen["proprio"], "hand")))
        assert not (seen["segmentation"] >= HAND_LABEL).any()
        assert (seen["segmentation"] == 2).any()
        assert view.leave(codec.pose(seen["proprio"], "hand"), 0.0) == []


def test_a_camera_that_always_sees_the_hand_is_refused() -> None:
    camera = camera_of("all")
    view = HandView(graspbox.load_hand("reflex"), camera_pose(camera), lens(camera.fov, (64, 64)), (64, 64))
    hand = np.diag([1.0, -1.0, -1.0, 1.0])
    hand[2, 3] = 0.3
    with pytest.raises(errors.ConfigError, match="sees the hand wherever it goes"):
        view.leave(hand, 0.0)
