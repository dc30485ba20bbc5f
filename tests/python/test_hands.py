"""The hands of the package: each goes through plan, trial, environments, pictures and MuJoCo."""

import pickle
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

import graspbox
from acting import CAMERAS
from graspbox import errors, object_sets
from graspbox.envs import spaces
from graspbox.envs.expert import ExpertGrasp, planned
from graspbox.pictures import PosedHand
from graspbox.pictures.hands import glyphs

NAMES = graspbox.Hand.names()
OTHERS = [name for name in NAMES if name != "reflex"]


def test_names() -> None:
    assert NAMES == ["reflex", "panda_gripper", "soft_hand", "robotiq_2f_85", "leap", "inspire"]
    for name in NAMES:
        assert graspbox.load_hand(name).name == name
    with pytest.raises(errors.ConfigError, match=f"choose from {', '.join(map(repr, NAMES))}"):
        graspbox.load_hand("claw")


@pytest.mark.parametrize("name", NAMES)
def test_a_hand_tells_what_it_is(name: str) -> None:
    hand = graspbox.load_hand(name)
    low, high = hand.preshape_limits
    open_, closed = hand.open(low), hand.closed(low, 1.0)
    assert open_.shape == closed.shape == (len(hand.joints),) == (len(hand.joint_chains),)
    limits = hand.joint_limits
    assert (limits[:, 0] - 1e-9 <= open_).all()
    assert (closed <= limits[:, 1] + 1e-9).all()
    assert not np.allclose(open_, closed)
    assert set(hand.joint_chains) <= set(range(len(hand.chains)))
    assert all(low <= value <= high for value in hand.preshapes.values())
    frames, _, pads, carriers = hand.shapes(closed)
    joints, chains, revolute = hand.joint_frames(closed)
    assert len(joints) == len(chains) == len(revolute) > carriers.max()
    assert pads.any()
    assert frames[:, 3].tolist() == [[0, 0, 0, 1]] * len(frames)
    again = pickle.loads(pickle.dumps(hand))
    np.testing.assert_array_equal(again.shapes(closed)[0], frames)
    fingers = PosedHand(hand, np.eye(4), closed).skeleton()
    assert len(fingers) == len(hand.chains)
    assert len(glyphs(hand, np.eye(4)[None], np.array([low]))[0]) == 1 + sum(len(f.points) + 1 for f in fingers)


def bottle() -> Any:
    return object_sets.load("procedural:bottle:0")[0].load()


@pytest.mark.parametrize("name", NAMES)
def test_the_first_pose_holds_a_bottle(name: str) -> None:
    scene = graspbox.Scene(bottle(), hand=name)
    plan = graspbox.plan(scene.mesh, hand=name, world_from_object=scene.world_from_object)
    outcomes = scene.simulate(plan.best(5))
    assert outcomes.success[0], outcomes
    _, trace = scene.trace(plan.poses[0], plan.preshape[0])
    hand = graspbox.load_hand(name)
    sizes = [len(hand.joints), len(hand.actuators), len(hand.actuators), len(hand.tendons)]
    assert [row.shape[1] for row in (trace.joints, trace.actuators, trace.loads, trace.tensions)] == sizes


@pytest.mark.parametrize("name", OTHERS)
def test_mujoco_agrees_on_the_first_pose(name: str) -> None:
    pytest.importorskip("mujoco", reason="the comparison needs mujoco, from the extra 'dev'")
    from validation import mujoco as judge

    scene = graspbox.Scene(bottle(), hand=name)
    plan = graspbox.plan(scene.mesh, hand=name, world_from_object=scene.world_from_object).best(1)
    built = judge.build(judge.describe(name), judge.object_data(scene))
    outcome = judge.replay(built, scene.world_from_object @ plan.poses[0], float(plan.preshape[0]))
    assert outcome.success, outcome


@pytest.mark.parametrize("name", OTHERS)
@pytest.mark.parametrize("env_id", ["graspbox/Grasp-v0", "graspbox/GraspPose-v0"])
def test_environments_take_the_hand(name: str, env_id: str) -> None:
    env = gymnasium.make(env_id, objects="procedural:bottle:0", hand=name, obs=("state", "depth"), cameras=CAMERAS)
    check_env(env.unwrapped, skip_render_check=True)


@pytest.mark.parametrize("name", NAMES)
def test_the_expert_grasps_with_it(name: str) -> None:
    env: Any = gymnasium.make("graspbox/Grasp-v0", objects="procedural:bottle:0", hand=name).unwrapped
    state, info = env.reset(seed=1)
    plan = planned(env.objects[0].load(), state, hand=name)
    expert, done = ExpertGrasp(state, plan.poses[0], plan.preshape[0], hand=name), False
    while not done and not expert.finished:
        state, _, done, _, info = env.step(expert.act(state))
    assert info["is_success"], info


def test_tables_follow_the_hand() -> None:
    tables = spaces.tables(graspbox.load_hand("panda_gripper"))
    columns = {row["name"]: row for row in tables["observations"]["twist"]["each"]["state"]}
    assert columns["finger_joint1"]["unit"] == columns["actuator"]["unit"] == "m"
    assert not columns["finger_joint1"]["privileged"]
    assert columns["load"]["high"] == 140.0
    assert "preshape" not in columns
    assert columns["contact"]["size"] == 3
    assert [row["name"] for row in tables["actions"]["twist"]["each"]] == ["linear", "angular", "actuator"]
    assert [row["name"] for row in tables["actions"]["twist"]["synergy"]] == ["linear", "angular", "close"]
    assert sum(row["size"] for row in tables["decision"]["actions"]) == 9, "a pose, and no preshape"
    observations = spaces.tables(graspbox.load_hand("soft_hand"))["observations"]["twist"]["each"]
    soft = {row["name"]: row for row in observations["state"]}
    groups = {name: soft[name]["size"] for name in ("abduction", "thumb_abduction", "inner", "outer")}
    assert groups == {"abduction": 4, "thumb_abduction": 1, "inner": 4, "outer": 10}
    assert all(soft[name]["privileged"] for name in groups), "the hand has no joint encoders"


def test_rapier_names_itself_where_it_cannot() -> None:
    physics = graspbox.PhysicsConfig(engine="rapier")
    with pytest.raises(errors.SimulationError, match=r"the engine `rapier` cannot simulate the hand `panda_gripper`"):
        graspbox.Scene(bottle(), hand="panda_gripper", physics=physics)


@pytest.mark.parametrize("name", NAMES)
def test_observations_have_entries_or_do_not_exist(name: str) -> None:
    """A bug here: a space without entries, or an error that does not name the missing sensor."""
    hand = graspbox.load_hand(name)
    tables = spaces.tables(hand)
    closed_loop = [vectors for by_fingers in tables["observations"].values() for vectors in by_fingers.values()]
    for vectors in (*closed_loop, tables["decision"]["observations"]):
        assert all(spaces.size(columns) > 0 for columns in vectors.values())
        assert sorted([*vectors, *tables["absent"]]) == ["proprio", "state", "tactile"]
    assert tables["absent"] == ([] if name == "reflex" else ["tactile"])
    for env_id in ("graspbox/Grasp-v0", "graspbox/GraspPose-v0") if tables["absent"] else ():
        with pytest.raises(errors.ConfigError, match="this hand has no tactile sensors, so there is no observation"):
            gymnasium.make(env_id, objects="procedural:bottle:0", hand=name, obs=("proprio", "tactile"))
