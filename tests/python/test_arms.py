"""Arms: their kinematics against MuJoCo's, inverse kinematics, what is reached and why not, errors in their files."""

import pickle
import re
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

import graspbox
from graspbox import ReachConfig, _core, arms, errors
from graspbox.arms import Arm, Reason
from graspbox.arms.drafting import draft_arm
from graspbox.hands.conventions import mechanism_of

NAMES = Arm.names()
#: A plan of a can, and the base of an arm half a metre behind it.
BASE = np.eye(4)
BASE[0, 3] = -0.5


def random_postures(arm: Arm, count: int, seed: int = 0) -> NDArray[np.float64]:
    low, high = arm.joint_limits.T
    return np.asarray(np.random.default_rng(seed).uniform(low, high, (count, len(low))))


@pytest.fixture(scope="module")
def plan() -> graspbox.Plan:
    mesh = graspbox.object_sets.load("procedural:can:3")[0].load()
    return graspbox.plan(mesh, hand="panda_gripper", seed=0).best(40)


@pytest.mark.parametrize("name", NAMES)
def test_flanges_are_where_mujoco_puts_them(name: str) -> None:
    """MuJoCo's compiler reads the same URDF; a difference is a frame or an axis read in another way."""
    mujoco = pytest.importorskip("mujoco")
    arm = Arm.named(name)
    # MuJoCo merges fixed links, unless it is told not to.
    told = '<mujoco><compiler fusestatic="false" discardvisual="false"/></mujoco>'
    model = mujoco.MjModel.from_xml_string(arm.files[0].replace("</robot>", f"{told}</robot>"))
    data = mujoco.MjData(model)
    assert [mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_JOINT, i) for i in range(model.njnt)] == arm.joints
    # A joint that slows down leaves a little of its range out.
    least, greatest, rate, offset = arm.slowing.T
    left_out = (offset + 0.05) ** 2 / rate
    np.testing.assert_allclose(np.maximum(model.jnt_range[:, 0], least + left_out), arm.joint_limits[:, 0], atol=1e-9)
    np.testing.assert_allclose(
        np.minimum(model.jnt_range[:, 1], greatest - left_out), arm.joint_limits[:, 1], atol=1e-9
    )
    assert np.abs(model.jnt_range - arm.joint_limits).max() < 0.012
    postures = random_postures(arm, 100)
    flanges = arm.flange_poses(postures)
    link = re.search(r'^flange = "(\w+)"', arm.files[1], re.MULTILINE)
    assert link is not None
    body = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, link[1])
    for posture, flange in zip(postures, flanges, strict=True):
        data.qpos[:] = posture
        mujoco.mj_kinematics(model, data)
        np.testing.assert_allclose(data.xpos[body], flange[:3, 3], atol=1e-9)
        np.testing.assert_allclose(data.xmat[body].reshape(3, 3), flange[:3, :3], atol=1e-9)
        jacobian = np.zeros((6, model.nv))
        mujoco.mj_comPos(model, data)
        mujoco.mj_jacBody(model, data, jacobian[:3], jacobian[3:], body)
        np.testing.assert_allclose(arm.jacobian(posture), jacobian, atol=1e-9)


@pytest.mark.parametrize("name", NAMES)
def test_postures_are_within_the_limits_and_meet_the_pose(name: str) -> None:
    arm = Arm.named(name)
    poses = arm.flange_poses(random_postures(arm, 300, seed=1))
    found = arms.inverse(name, poses, config=ReachConfig(max_angle=1e-5))
    assert found.reached.mean() > 0.99
    low, high = arm.joint_limits.T
    solved = found.solutions[found.reached]
    given = np.asarray(np.isfinite(solved).all(axis=2))
    assert given[:, 0].all()
    assert ((solved >= low) & (solved <= high))[given].all()
    for column in range(solved.shape[1]):
        rows = given[:, column]
        again = arm.flange_poses(np.ascontiguousarray(solved[rows, column]))
        np.testing.assert_allclose(again, poses[found.reached][rows], atol=2e-5)
    assert (found.room[found.reached] >= 0).all()
    least = np.linalg.svd(arm.jacobian(found.joints[found.reached][0]), compute_uv=False)[-1]
    assert found.singular[found.reached][0] == pytest.approx(least, abs=1e-6)


def test_answers_do_not_depend_on_threads_or_neighbours(plan: graspbox.Plan) -> None:
    one, two = (plan.reachable("xarm7", BASE, num_threads=threads) for threads in (1, 2))
    assert one == two
    part = plan[7:9].reachable("xarm7", BASE, num_threads=2)
    np.testing.assert_array_equal(part.solutions, one[7:9].solutions)


@pytest.mark.parametrize("name", NAMES)
def test_grasps_that_are_reached_put_the_hand_there(name: str, plan: graspbox.Plan) -> None:
    base = BASE.copy()
    base[0, 3] = -0.5 if name != "so101" else -0.25
    if name == "so101":
        with pytest.raises(
            errors.ArmError, match=r"\"panda_gripper\" weighs 0\.76 kg, but arm \"so101\" carries 0\.20 kg"
        ):
            plan.reachable(name, base)
        return
    reach = plan.reachable(name, base)
    assert reach.reached.sum() > 5
    assert len(reach) == len(plan) == len(reach.why)
    arm, hand = Arm.named(name), graspbox.load_hand("panda_gripper")
    flange = base @ arm.flange_poses(reach.joints[reach.reached])
    base_from_hand = mechanism_of(hand).base_from_hand
    there = flange @ arm.flange_from_base_of(hand) @ base_from_hand
    wanted = (plan.world_from_object @ plan.poses)[reach.reached]
    np.testing.assert_allclose(there, wanted, atol=2e-5)
    assert all(bool(why) != reached for why, reached in zip(reach.why, reach.reached, strict=True))
    assert (np.diff(reach.reached[reach.first()].astype(int)) <= 0).all()


def test_reasons_say_what_is_in_the_way(plan: graspbox.Plan) -> None:
    far = BASE.copy()
    far[0, 3] = -3.0
    assert (plan.reachable("fr3", far).reason == Reason.TOO_FAR).all()
    free = plan.reachable("fr3", BASE)
    assert free.reached.any()
    # A wall of points between base and thing, and the same wall as a box.
    y, z = np.meshgrid(np.arange(-1.0, 1.0, 0.015), np.arange(0.02, 1.5, 0.015))
    points = np.stack([np.full(y.size, -0.25), y.ravel(), z.ravel()], axis=1)
    seen = plan.reachable("fr3", BASE, points=points)
    assert not seen.reached.any()
    assert (seen.reason[free.reached] == Reason.TOUCHES_POINTS).all()
    assert re.fullmatch(r"link\d touches what is seen", seen.why[int(np.argmax(free.reached))])
    corners = np.array([[x, y, z] for x in (-0.2, 0.2) for y in (-0.5, 0.5) for z in (-0.2, 0.2)])
    faces = [
        [0, 1, 3],
        [0, 3, 2],
        [4, 6, 7],
        [4, 7, 5],
        [0, 4, 5],
        [0, 5, 1],
        [2, 3, 7],
        [2, 7, 6],
        [0, 2, 6],
        [0, 6, 4],
    ]
    faces += [[1, 5, 7], [1, 7, 3]]
    box = graspbox.mesh_from_arrays(corners, faces, name="box")
    place = np.eye(4)
    place[:3, 3] = -0.25, 0.0, 0.3
    touched = plan.reachable("fr3", BASE, objects=[(box, place)])
    assert (touched.reason[free.reached] != Reason.REACHED).any()
    assert any(box.name in why for why in touched.why)
    low = BASE.copy()
    low[2, 3] = -0.3
    with pytest.raises(errors.ConfigError, match=r"the base of the arm is at z = -0\.300 m, under the table"):
        plan.reachable("fr3", low)
    sunk = plan.world_from_object @ plan.poses
    sunk[:, 2, 3] -= 0.4
    below = arms.reachable("fr3", "panda_gripper", sunk, plan.preshape, BASE)
    assert (below.reason == Reason.TOUCHES_TABLE).any()
    assert any(why.endswith("touches the table") for why in below.why)


def test_five_joints_tell_the_angle_that_remains() -> None:
    arm = Arm.named("so101")
    pose = arm.flange_poses(np.array([[0.3, -0.4, 0.6, 0.9, 0.2]]))
    lean = np.eye(4)
    lean[1:3, 1:3] = [[np.cos(0.6), -np.sin(0.6)], [np.sin(0.6), np.cos(0.6)]]
    # Out of the plane of the arm.
    pose[:, :3, :3] = (lean @ pose)[:, :3, :3]
    loose = arms.inverse(arm, pose, config=ReachConfig(max_angle=1.0))
    assert loose.reached[0]
    assert 0.05 < loose.angle[0] <= 0.6
    there = arm.flange_poses(loose.joints)
    np.testing.assert_allclose(there[0, :3, 3], pose[0, :3, 3], atol=2e-6)
    strict = arms.inverse(arm, pose, config=ReachConfig(max_angle=0.01))
    assert strict.reason[0] == Reason.TURNED
    assert re.fullmatch(r"its rotation is \d+ degrees out of reach", strict.why[0])


def test_reasons_are_those_of_the_core() -> None:
    assert tuple(reason.name for reason in Reason) == _core.REACH_REASONS


def test_wrong_arguments_are_named(plan: graspbox.Plan) -> None:
    for wrong, message in [
        ({"config": ReachConfig(starts=0)}, "starts is 0; it must be 1 to 4096"),
        ({"config": ReachConfig(clearance=-1.0)}, "clearance is -1; it must be 0 to 1 m"),
        ({"points": np.zeros((3, 2))}, r"points have the shape \(3, 2\)"),
        ({"points": np.full((1, 3), np.nan)}, "points holds NaN"),
        ({"hand": "leap"}, "the plan is for the hand 'panda_gripper', not 'leap'"),
        ({"mount": np.zeros((4, 4))}, "mount is not a rigid motion"),
    ]:
        with pytest.raises(errors.ConfigError, match=message):
            plan.reachable("fr3", BASE, **wrong)  # type: ignore[arg-type]
    with pytest.raises(errors.ConfigError, match="there is no arm 'panda'; choose from 'fr3'"):
        arms.load_arm("panda")
    with pytest.raises(errors.ConfigError, match="is one file, but an arm has two"):
        arms.load_arm("arm.urdf")
    fr3 = Arm.named("fr3")
    mounted = np.linalg.inv(fr3.flange_poses(fr3.home[None])[0])  # inside the base
    with pytest.raises(errors.ArmError, match=r"touches link \"link0\" of arm \"fr3\" at home; give its mount"):
        plan.reachable("fr3", BASE, mount=mounted)


def test_files_are_read_and_pickled(tmp_path: Path) -> None:
    urdf, toml = tmp_path / "own.urdf", tmp_path / "arm.toml"
    text = Arm.named("ur5e").files
    urdf.write_text(text[0])
    toml.write_text(text[1])
    arm = arms.load_arm((urdf, toml))
    assert arm == Arm.named("ur5e") == pickle.loads(pickle.dumps(arm))
    assert repr(arm) == 'Arm("ur5e", 6 joints)'
    toml.write_text(text[1].replace('flange = "tool0"', 'flange = "tool"'))
    with pytest.raises(errors.ArmError, match=r"arm\.toml:6: there is no link \"tool\"; known: base_link, .*tool0"):
        arms.load_arm((urdf, toml))
    with pytest.raises(errors.FileError):
        arms.load_arm((tmp_path / "none.urdf", toml))


@pytest.mark.parametrize("hand", graspbox.Hand.names())
@pytest.mark.parametrize("name", ["fr3", "ur5e", "xarm7"])
def test_any_hand_goes_on_any_arm(name: str, hand: str) -> None:
    """At home no mounted hand is inside the arm, and a pose before the base is reached."""
    loaded = graspbox.load_hand(hand)
    low, high = loaded.preshape_limits
    arm = Arm.named(name)
    home = arm.flange_poses(arm.home[None])[0] @ arm.flange_from_base_of(loaded)
    pose = home @ mechanism_of(loaded).base_from_hand
    reach = arms.reachable(name, hand, np.stack([pose, pose]), [low, high], np.eye(4))
    assert reach.reached.all(), reach.why


def test_a_first_file_is_drafted_and_loads(tmp_path: Path) -> None:
    """Of a URDF of an arm with a jaw: the jaw is left out, and what is guessed is told."""
    urdf = tmp_path / "with jaw.urdf"
    inertia = (
        '<inertial><mass value="0.1"/><inertia ixx="1e-4" ixy="0" ixz="0" iyy="1e-4" iyz="0" izz="1e-4"/></inertial>'
    )
    jaw = f'<link name="jaw">{inertia}</link><joint name="gripper" type="revolute"><parent link="flange"/>'
    jaw += '<child link="jaw"/><axis xyz="0 0 1"/><limit lower="0" upper="1" effort="1" velocity="1"/></joint>'
    urdf.write_text(Arm.named("so101").files[0].replace("</robot>", f"{jaw}</robot>").replace('velocity="4.71"', "", 1))
    draft = draft_arm(urdf)
    assert (draft.arm.name, draft.arm.joints) == ("with_jaw", Arm.named("so101").joints)
    assert draft.guesses[0] == "base: 'base_link', the root of the file"
    assert draft.guesses[1].startswith("flange: 'flange'")
    assert draft.guesses[-1] == "speeds of shoulder_pan, which the URDF does not state"
    assert "it is left out" in draft.arm.assumptions[-1]
    np.testing.assert_allclose(draft.arm.home, draft.arm.joint_limits.mean(axis=1), atol=1e-5)
    (tmp_path / "arm.toml").write_text(draft.text)
    with pytest.warns(UserWarning, match=r"it is left out.*"):
        assert arms.load_arm((urdf, tmp_path / "arm.toml")).joints == draft.arm.joints
    with pytest.raises(errors.ArmError, match="there is no link 'hand' for the flange; choose from base_link"):
        draft_arm(urdf, flange="hand")
    with pytest.raises(errors.ArmError, match="no joint moves between 'base_link' and 'base_link'"):
        draft_arm(urdf, flange="base_link")
