"""Environments in which an arm carries the hand: what Python adds to the core's."""

import json
import pickle
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
from numpy.typing import NDArray

import graspbox
from graspbox import arms, policies
from graspbox.configs import CameraConfig, CamerasConfig
from graspbox.envs import spaces
from graspbox.envs.coding import Codec, encode_action, object_pose, rotation_from_columns
from graspbox.errors import ArmError, ConfigError
from graspbox.evaluation import evaluate
from graspbox.hands.description import describe
from graspbox.policies.arm_reach import ArmAt
from graspbox.policies.baselines.planner import Planner

GRASP = "graspbox/Grasp-v0"
HAND = "panda_gripper"
#: A camera that sees the whole arm.
WIDE = CameraConfig(name="wide", eye=(-0.6, -0.9, 0.8), target=(0.1, 0.0, 0.3), fov=1.1)


def test_the_hand_is_where_the_joints_put_it() -> None:
    env: Any = gymnasium.make(GRASP, objects="procedural:box:1", hand=HAND, arm="fr3", obs="proprio").unwrapped
    arm, hand = arms.load_arm("fr3"), graspbox.load_hand(HAND)
    columns = spaces.tables(hand, arm)["observations"]["twist"]["synergy"]["proprio"]
    places = {row["name"]: slice(start, start + row["size"]) for row, start in _starts(columns)}
    seen, _ = env.reset(seed=3)
    env.action_space.seed(3)
    fastest = 0.0
    flange_from_hand = arm.flange_from_base_of(hand) @ describe(hand).base_from_hand
    for _ in range(6):
        q = seen[places["arm_q"]].astype(np.float64)
        assert ((arm.joint_limits[:, 0] <= q) & (q <= arm.joint_limits[:, 1])).all()
        expected = env.world_from_arm @ arm.flange_poses(q[None])[0] @ flange_from_hand
        np.testing.assert_allclose(seen[places["hand_position"]], expected[:3, 3], atol=1e-5)
        np.testing.assert_allclose(seen[places["hand_rotation"]], expected[:3, :2].T.ravel(), atol=1e-5)
        seen = env.step(env.action_space.sample())[0]
        fastest = max(fastest, float(np.abs(seen[places["arm_dq"]]).max()))
    assert fastest > 0.01


def _starts(columns: Any) -> Any:
    ends = np.cumsum([row["size"] for row in columns])
    return zip(columns, ends - [row["size"] for row in columns], strict=True)


def test_tables_have_the_joints_of_the_arm_alone() -> None:
    hand, arm = graspbox.load_hand(HAND), arms.load_arm("ur5e")
    free, carried = spaces.tables(hand), spaces.tables(hand, arm)
    assert "joint_velocity" not in free["actions"]
    assert "joint_velocity" in carried["actions"]
    joints = [row for row in carried["actions"]["joint_velocity"]["synergy"] if row["name"] == "joint"]
    assert [row["high"] for row in joints] == pytest.approx(arm.speeds)
    names = [row["name"] for row in carried["observations"]["twist"]["synergy"]["state"]]
    assert {"arm_q", "arm_dq"} <= set(names)
    assert {row["name"] for row in carried["info"]} - {row["name"] for row in free["info"]} == {"arm_blocked"}


@pytest.mark.parametrize("base", [None, [[1.0, 0, 0, -0.55], [0, 1.0, 0, 0.1], [0, 0, 1.0, 0], [0, 0, 0, 1.0]]])
def test_vector_environments_equal_the_single_one(base: Any) -> None:
    keywords: dict[str, Any] = {"objects": "procedural:can:2", "hand": HAND, "arm": "xarm7", "base": base}
    single = gymnasium.make(GRASP, **keywords)
    vector = gymnasium.make_vec(GRASP, num_envs=3, **keywords)
    seen, _ = vector.reset(seed=5)
    for index in (0, 2):
        assert (single.reset(seed=5 + index)[0] == seen[index]).all()
    copy = pickle.loads(pickle.dumps(single.unwrapped))
    rng = np.random.default_rng(0)
    for _ in range(8):
        actions = rng.uniform(-1, 1, vector.action_space.shape).astype(np.float32)
        seen, rewards, *_ = vector.step(actions)
        alone, reward, *_ = single.step(actions[2])
        assert (alone == seen[2]).all()
        assert reward == rewards[2]
        assert (copy.step(actions[2])[0] == alone).all()
    if base is not None:
        assert (np.asarray(base) == single.unwrapped.world_from_arm).all()  # type: ignore[attr-defined]
    again = gymnasium.make(gymnasium.envs.registration.EnvSpec.from_json(single.spec.to_json()))  # type: ignore[union-attr]
    assert (again.reset(seed=5)[0] == vector.reset(seed=5)[0][0]).all()


def images(arm: str | None) -> tuple[dict[str, NDArray[Any]], Any]:
    env = gymnasium.make(
        GRASP, objects="procedural:box:1", hand=HAND, arm=arm, obs=("rgb", "depth", "segmentation", "points"),
        layout="packed", objects_per_scene=3, image_size=96, cameras=CamerasConfig(cameras=(WIDE,)),
    )  # fmt: skip
    return env.reset(seed=1)[0], env


def test_images_show_the_arm() -> None:
    (seen, env), (free, other) = images("fr3"), images(None)
    label = int(env.observation_space["segmentation"].high.max())
    assert label == int(other.observation_space["segmentation"].high.max()) + 1
    arm = seen["segmentation"][..., 0] == label
    assert arm.mean() > 0.02
    assert not (free["segmentation"] == label).any()
    # Where the arm is seen, something near and of its colour is.
    assert (seen["depth"][..., 0][arm] > 0.1).all()
    assert (seen["points"][arm][:, 2] > 0.1).all()
    assert np.abs(seen["rgb"][arm].astype(int) - free["rgb"][arm]).mean() > 5


def test_a_gripper_reaches_down_by_its_joints() -> None:
    env: Any = gymnasium.make(
        GRASP, objects="procedural:box:1", hand=HAND, arm="fr3", control="joint_velocity"
    ).unwrapped
    env.reset(seed=0)
    action = env.idle_action
    still, *_ = env.step(action)
    moved, *_ = env.step(action)
    joints = slice(15, 22)
    assert np.abs(moved[joints] - still[joints]).max() < 1e-3
    action[0] = 1.0
    turned, *_ = env.step(action)
    assert turned[15] - moved[15] > 0.05
    assert np.abs(turned[16:22] - moved[16:22]).max() < 1e-3
    keys = env.get_keys_to_action()
    assert all(action.shape == env.action_space.shape for action in keys.values())


@pytest.mark.parametrize(
    ("keywords", "error", "words"),
    [
        ({"base": np.eye(4).tolist(), "arm": None}, ConfigError, "base"),
        ({"base": [[1.0, 0.0]]}, ConfigError, "homogeneous"),
        ({"base": (np.eye(4) + np.diag([0, 0, 1], -1)).tolist()}, ConfigError, "base"),
        ({"arm": "fr4"}, ConfigError, "there is no arm 'fr4'"),
        ({"arm": None, "control": "joint_velocity"}, ConfigError, "name an arm"),
        ({"arm": "so101"}, ArmError, "carries"),
        ({"physics": graspbox.PhysicsConfig(engine="rapier")}, graspbox.errors.SimulationError, "arm"),
        ({"remote": "ws://127.0.0.1:1", "arm": ("a.urdf", "arm.toml")}, ConfigError, "by its name"),
    ],
)
def test_wrong_arms_are_refused(keywords: dict[str, Any], error: type[Exception], words: str) -> None:
    with pytest.raises(error, match=words):
        gymnasium.make(GRASP, **{"hand": HAND, "arm": "fr3", "objects": "procedural:box:1", **keywords}).reset(seed=0)


DECIDES = "graspbox/GraspPose-v0"
DECIDED: dict[str, Any] = {"hand": HAND, "objects": "procedural:can:3"}


def planned(world_from_object: NDArray[np.float64], base: NDArray[np.float64]) -> tuple[Any, Any]:
    """Return actions for planned grasps of the can that an FR3 reaches, and for ones that it does not."""
    mesh = graspbox.object_sets.load(DECIDED["objects"])[0].load()
    plan = graspbox.plan(mesh, hand=HAND, seed=0, world_from_object=world_from_object).best(40)
    reached = plan.reachable("fr3", base, mesh=mesh).reached
    poses, shapes = world_from_object @ plan.poses, plan.preshape
    actions = np.stack([encode_action(pose, shape, hand=HAND) for pose, shape in zip(poses, shapes, strict=True)])
    return actions[reached], actions[~reached]


def test_a_decision_on_an_arm_is_a_path_and_then_the_trial_of_a_hand_alone() -> None:
    env: Any = gymnasium.make(DECIDES, arm="fr3", **DECIDED).unwrapped
    free: Any = gymnasium.make(DECIDES, **DECIDED).unwrapped
    successes, blocked = 0, 0
    for seed in range(4):
        state, _ = env.reset(seed=seed)
        free.reset(seed=seed)
        pose = object_pose(state, control="grasp_pose", hand=HAND)
        good, bad = planned(pose, env.world_from_arm)
        saved = env.get_state()
        _, reward, ended, _, info = env.step(good[0])
        _, alone, _, _, told = free.step(good[0])
        assert ended
        if info["arm_blocked"]:
            blocked += 1
            assert info["infeasible"]
        else:
            assert (reward, info["failure"]) == (alone, told["failure"])
            successes += info["is_success"]
        env.set_state(saved)
        again = env.step(good[0])
        assert (again[1], again[4]["arm_blocked"]) == (reward, info["arm_blocked"])
        for action in bad[:2]:
            env.set_state(saved)
            _, reward, _, _, info = env.step(action)
            assert info["arm_blocked"]
            assert info["infeasible"]
            assert info["failure"] == "infeasible"
    assert successes >= 2
    assert blocked <= 1


def test_the_arm_waits_at_home_and_ends_where_the_object_is_lifted() -> None:
    env: Any = gymnasium.make(DECIDES, arm="fr3", obs=("state", "proprio"), **DECIDED).unwrapped
    arm, hand = arms.load_arm("fr3"), graspbox.load_hand(HAND)
    columns = spaces.tables(hand, arm)["decision"]["observations"]["proprio"]
    places = {row["name"]: slice(start, start + row["size"]) for row, start in _starts(columns)}
    seen, _ = env.reset(seed=1)
    np.testing.assert_allclose(seen["proprio"][places["arm_q"]], arm.home, atol=1e-6)
    good, bad = planned(object_pose(seen["state"], control="grasp_pose", hand=HAND), env.world_from_arm)
    seen, _, _, _, info = env.step(good[0])
    assert not info["arm_blocked"]
    q = seen["proprio"][places["arm_q"]].astype(np.float64)
    flange_from_hand = arm.flange_from_base_of(hand) @ describe(hand).base_from_hand
    lifted = env.world_from_arm @ arm.flange_poses(q[None])[0] @ flange_from_hand
    grasp = Codec("grasp_pose", HAND).decode_grasp(good[0])[0].copy()
    grasp[2, 3] += graspbox.TrialConfig().lift_height
    np.testing.assert_allclose(lifted, grasp, atol=2e-4)
    env.reset(seed=1)
    seen, _, _, _, info = env.step(bad[0])
    np.testing.assert_allclose(seen["proprio"][places["arm_q"]], arm.home, atol=1e-6)
    with pytest.raises(ConfigError, match="an arm waits at home for a decision"):
        env.reset(seed=1, options={"world_from_hand": np.eye(4)})


def sensed(proprio: NDArray[np.float32], hand: Any, arm: Any) -> NDArray[np.float64]:
    """Return the pose of the hand by the proprioception of decisions."""
    rows = spaces.tables(hand, arm)["decision"]["observations"]["proprio"]
    places = {row["name"]: slice(start, start + row["size"]) for row, start in _starts(rows)}
    pose = np.eye(4)
    columns = proprio[places["hand_rotation"]].astype(np.float64)
    pose[:3, :3] = rotation_from_columns(columns[:3], columns[3:])
    pose[:3, 3] = proprio[places["hand_position"]]
    return pose


def test_the_arm_is_where_the_hand_of_a_failed_grasp_is() -> None:
    """A hand that touches nothing rises, and stops as soon as success is out of reach."""
    given: dict[str, Any] = {"obs": ("state", "proprio"), **DECIDED}
    envs: list[Any] = [gymnasium.make(DECIDES, arm=arm, **given).unwrapped for arm in ("fr3", None)]
    hand = graspbox.load_hand(HAND)
    ends = []
    for env in envs:
        seen, _ = env.reset(seed=1)
        pose = object_pose(seen["state"], control="grasp_pose", hand=HAND)
        beside = np.diag([1.0, -1.0, -1.0, 1.0])
        beside[:3, 3] = pose[0, 3], pose[1, 3] + 0.1, 0.09
        seen, _, _, _, info = env.step(encode_action(beside, 0.0, hand=HAND))
        assert info["failure"] == "no_contact"
        ends.append(sensed(seen["proprio"], hand, env.arm))
    np.testing.assert_allclose(ends[0], ends[1], atol=1e-3)


def test_an_arm_of_five_joints_tries_the_pose_that_it_meets(tmp_path: Path) -> None:
    """It meets a rotation only nearly: what is simulated is where its joints put the hand."""
    folder = Path(__file__).parents[2] / "env/hand/assets/panda_gripper"
    urdf, toml = (tmp_path / name for name in ("panda_gripper.urdf", "hand.toml"))
    urdf.write_text((folder / urdf.name).read_text().replace('value="0.73"', 'value="0.12"'))
    toml.write_text((folder / toml.name).read_text())
    near = np.eye(4)
    near[0, 3] = -0.25
    hand = graspbox.load_hand((urdf, toml))
    envs: list[Any] = [
        gymnasium.make(
            DECIDES, arm=arm, base=base, hand=(str(urdf), str(toml)), objects="procedural:box:1",
            obs=("state", "proprio"), trial={"standoff": 0.02, "lift_height": 0.06}, success={"lift_height": 0.05},
        ).unwrapped
        for arm, base in (("so101", near.tolist()), (None, None))
    ]  # fmt: skip
    env, free = envs
    apart: list[float] = []
    for seed in (10, 11, 13):
        seen, _ = env.reset(seed=seed)
        pose, mesh = object_pose(seen["state"], control="grasp_pose", hand=hand), env.objects[0].load()
        plan = graspbox.plan(mesh, hand=hand, seed=0, world_from_object=pose).best(60)
        reach = plan.reachable("so101", near, mesh=mesh, hand=hand)
        for index in np.flatnonzero(reach.reached & (reach.angle > 0.03)):
            env.reset(seed=seed)
            free.reset(seed=seed)
            wanted = pose @ plan.poses[index]
            seen, reward, _, _, info = env.step(encode_action(wanted, plan.preshape[index], hand=hand))
            if info["infeasible"]:
                continue
            met = sensed(seen["proprio"], hand, env.arm)
            angle = np.arccos(np.clip((np.trace(met[:3, :3].T @ wanted[:3, :3]) - 1) / 2, -1, 1))
            assert 0.01 < angle < 0.21
            met[:3, 3] = wanted[:3, 3]
            _, alone, _, _, told = free.step(encode_action(met, plan.preshape[index], hand=hand))
            assert (reward, info["failure"]) == (alone, told["failure"])
            # At the wanted rotation the object ends elsewhere, unless the hand only pushes it.
            free.reset(seed=seed)
            other = free.step(encode_action(wanted, plan.preshape[index], hand=hand))[0]
            ends = [object_pose(each["state"], control="grasp_pose", hand=hand) for each in (seen, other)]
            apart.append(np.abs(ends[0] - ends[1]).max())
    assert len(apart) >= 5
    assert max(apart) > 1e-3


def test_a_table_is_cleared_by_an_arm() -> None:
    """After each attempt the arm is at home again; vector environments equal the single one."""
    keywords: dict[str, Any] = {"objects": "procedural", "hand": HAND, "arm": "fr3", "objects_per_scene": 3}
    keywords |= {"obs": "proprio", "layout": "packed"}
    single: Any = gymnasium.make("graspbox/Clear-v0", **keywords).unwrapped
    vector = gymnasium.make_vec("graspbox/Clear-v0", num_envs=2, **keywords)
    home, _ = single.reset(seed=4)
    assert (vector.reset(seed=3)[0][1] == home).all()
    lying = single.arrangement()
    picked, blocked, refused = 0, 0, encode_action(np.diag([1.0, 1.0, 1.0, 1.0]), 0.0, hand=HAND)
    for mesh, pose in zip(lying.meshes, lying.world_from_objects, strict=True):
        plan = graspbox.plan(mesh, hand=HAND, seed=0, world_from_object=pose).best(60)
        others = [(m, p) for m, p in zip(lying.meshes, lying.world_from_objects, strict=True) if m is not mesh]
        reached = plan.reachable("fr3", single.world_from_arm, mesh=mesh, objects=others).reached
        above = (pose @ plan.poses)[:, 2, 2] < -0.5
        chosen = np.flatnonzero(reached & above)
        action = refused
        if len(chosen):
            action = encode_action(pose @ plan.poses[chosen[0]], plan.preshape[chosen[0]], hand=HAND)
        seen, _, over, _, info = single.step(action)
        both, *_ = vector.step(np.stack([action, action]))
        picked, blocked = picked + info["is_success"], blocked + info["arm_blocked"]
        if over:
            break
        np.testing.assert_array_equal(seen, home)
        assert (both[1] == seen).all()
    assert picked >= 1
    assert blocked <= 2


@pytest.mark.parametrize("standoff", [0.1, 0.3])
def test_the_planner_chooses_the_first_grasp_to_which_the_arm_has_a_path(
    standoff: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("ruckig", reason="timing needs the extra 'arm'")
    aside = np.eye(4)
    aside[0, 3] = -0.8
    given: dict[str, Any] = {"objects": "procedural:can:3", "trials": 8, "seed": 3, "arm": "fr3", "hand": HAND}
    given |= {"trial": {"standoff": standoff}, "base": aside.tolist()}
    carried = evaluate(policies.load("planner"), DECIDES, **given)
    monkeypatch.setattr(Planner, "_carried", lambda *_: 0)
    first = evaluate(policies.load("planner"), DECIDES, **given)
    assert carried.failures.get("infeasible", 0) + 2 <= first.failures["infeasible"]
    assert carried.succeeded > first.succeeded


def test_policies_are_told_of_arms_whose_place_is_unknown() -> None:
    envs = gymnasium.make_vec(DECIDES, num_envs=2, vectorization_mode="sync", arm="fr3", **DECIDED)
    policies.load("random").bind(policies.Task.of(envs))
    with pytest.raises(ConfigError, match="do not tell where the arm stands; pass base"):
        policies.load("planner").bind(policies.Task.of(envs))
    with pytest.raises(ConfigError, match="bounds what a hand without an arm can do"):
        evaluate(policies.load("robust_oracle"), DECIDES, arm="fr3", trials=1, **DECIDED)


def test_an_error_of_the_hand_pushes_nothing_on_the_way_to_a_grasp() -> None:
    env: Any = gymnasium.make(
        DECIDES, arm="fr3", hand=HAND, objects="procedural", layout="packed",
        randomization=graspbox.Randomization(hand_position=0.02, hand_rotation=0.1),
    ).unwrapped  # fmt: skip
    infeasible = 0
    for seed in range(8):
        env.reset(seed=seed)
        saved, lying = env.get_state(), env.arrangement()
        mesh, pose = lying.meshes[lying.target], lying.world_from_objects[lying.target]
        around = lying.without(lying.target)
        plan = graspbox.plan(mesh, hand=HAND, seed=0, world_from_object=pose, neighbours=around).best(8)
        for grasp, preshape in zip(pose @ plan.poses, plan.preshape, strict=True):
            env.set_state(saved)
            info = env.step(encode_action(grasp, preshape, hand=HAND))[4]
            infeasible += info["infeasible"] and not info["arm_blocked"]
            assert not (info["infeasible"] and info["touches"])
    assert infeasible >= 2


def test_a_depth_policy_chooses_grasps_to_which_the_arm_has_a_path(monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("onnxruntime", reason="networks run in onnxruntime, from the extra 'onnx'")
    pytest.importorskip("ruckig", reason="timing needs the extra 'arm'")
    folder = Path(__file__).parents[2] / "policies/panda"
    given: dict[str, Any] = {"objects": "procedural:can:3", "trials": 8, "seed": 3, "arm": "fr3"}
    carried = evaluate(policies.load(folder), DECIDES, **given)
    assert carried.succeeded >= 6
    # From here only some of the grasps are reached.
    aside = np.eye(4)
    aside[:3, 3] = -0.75, 0.0, 0.0
    farther = evaluate(policies.load(folder), DECIDES, base=aside.tolist(), **given)
    assert farther.failures.get("infeasible", 0) <= 2
    assert farther.succeeded >= 5
    away = aside.copy()
    away[0, 3] = -3.0
    none = evaluate(policies.load(folder), DECIDES, base=away.tolist(), **{**given, "trials": 2})
    assert none.failures == {"infeasible": 2}
    # The best grasp of all would not do.
    monkeypatch.setattr(ArmAt, "carried", lambda *_: 0)
    best = evaluate(policies.load(folder), DECIDES, base=aside.tolist(), **given)
    assert best.failures.get("infeasible", 0) > farther.failures.get("infeasible", 0)


def test_a_printed_evaluation_names_arm_and_base() -> None:
    pytest.importorskip("typer", reason="the command line needs the extra 'cli'")
    pytest.importorskip("ruckig", reason="paths need ruckig, from the extra 'arm'")
    from command_line import invoke

    words = [
        "evaluate",
        "planner",
        "--objects",
        "procedural:can:0",
        "--trials",
        "1",
        "--hand",
        "panda_gripper",
        "--json",
    ]
    made = invoke([*words, "--trials", "1", "--arm", "fr3", "--base", "-0.5", "0", "0", "0"])
    assert made.exit_code == 0, made.output
    answer = json.loads(made.stdout)
    named = {name: answer[name] for name in ("env_id", "hand", "arm", "base")}
    base = [-0.5, 0.0, 0.0, 0.0]
    assert named == {"env_id": "graspbox/GraspPose-v0", "hand": "panda_gripper", "arm": "fr3", "base": base}
