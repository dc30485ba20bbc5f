"""Grasps by whole arms in MuJoCo: the model, the course of the joints, the verdicts, and the report."""

import json
from collections import Counter
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

pytest.importorskip("mujoco", reason="the comparison needs mujoco, from the extra 'dev'")
pytest.importorskip("ruckig", reason="timing needs the extra 'arm'")

import graspbox
from graspbox import arms
from graspbox.configs import PathConfig, TrialConfig
from graspbox.errors import ConfigError
from validate import main
from validation import mujoco as judge
from validation.mujoco import arms_command
from validation.mujoco.arm_replay import ArmOutcome, ArmScene, build_arm, course_of, replay_arm
from validation.mujoco.arm_verdicts import ArmTrial, VerdictReport, VerdictRow, compare_arm, sample_arm_trials

COARSE = judge.Numerics(timestep=0.001)
HAND = "panda_gripper"
BASE = np.eye(4)
BASE[0, 3] = -0.5
LIFT = PathConfig(lift=TrialConfig.lift_height)


@pytest.fixture(scope="module")
def can() -> graspbox.Scene:
    return graspbox.Scene(graspbox.object_sets.load("procedural:can:3")[0].load(), hand=HAND)


@pytest.fixture(scope="module")
def path(can: graspbox.Scene) -> arms.Trajectory:
    plan = graspbox.plan(can.mesh, hand=HAND, world_from_object=can.world_from_object, seed=0).best(40)
    return plan.path("fr3", BASE, mesh=can.mesh, config=LIFT)


@pytest.fixture(scope="module")
def scene(can: graspbox.Scene) -> ArmScene:
    return build_arm(arms.load_arm("fr3"), can.hand, judge.object_data(can), COARSE)


@pytest.mark.parametrize(("arm", "hand"), [("fr3", HAND), ("ur5e", "robotiq_2f_85"), ("xarm7", "reflex")])
def test_an_arm_carries_the_hand_of_the_other_replays(arm: str, hand: str, can: graspbox.Scene) -> None:
    """Shapes, contacts, joints and actuators of the hand and the object are the same; only the carriage is not."""
    item = judge.object_data(can)
    own = build_arm(arms.load_arm(arm), graspbox.load_hand(hand), item, patch=0.002).scene
    model, other = own.model, judge.build(judge.describe(hand), item, patch=0.002).model

    def name(text: str) -> str:
        return text if text.startswith(("object", "table")) else own.prefix + text

    assert model.nv == other.nv - 1 + len(arms.load_arm(arm).joints)
    assert (model.nu, model.neq, model.ntendon, model.npair) == (other.nu, other.neq, other.ntendon, other.npair)
    for index in range(other.ngeom):
        geom = model.geom(name(other.geom(index).name)).id
        for fact in ("friction", "solref", "solimp", "condim", "contype", "size"):
            values = (getattr(model, f"geom_{fact}")[geom], getattr(other, f"geom_{fact}")[index])
            np.testing.assert_array_equal(*values, err_msg=f"{other.geom(index).name} {fact}")
    for index in range(other.njnt):
        if other.joint(index).name != "carriage":
            one, two = model.joint(name(other.joint(index).name)), other.joint(index)
            for fact in ("stiffness", "range", "damping", "armature"):
                np.testing.assert_array_equal(getattr(one, fact), getattr(two, fact))
    for fact in ("pair_friction", "actuator_gainprm", "actuator_biasprm", "actuator_forcerange", "eq_data"):
        np.testing.assert_array_equal(np.sort(getattr(model, fact), axis=0), np.sort(getattr(other, fact), axis=0))
    assert not (own.is_hand & (own.is_object | own.is_scenery)).any()
    assert own.is_hand.sum() == other.ngeom - own.is_object.sum() - own.is_scenery.sum()


def test_the_arm_lifts_straight_up_as_the_core_does(path: arms.Trajectory) -> None:
    arm, times = arms.load_arm("fr3"), judge.TrialTimes()
    way, trial = course_of(path, arm, times, 0.001)
    np.testing.assert_array_equal(way[0], arm.home)
    np.testing.assert_allclose(way[-1], trial[0], atol=1e-5)
    flange = arm.flange_poses(trial)
    wanted = np.repeat(flange[:1], len(flange), axis=0)
    wanted[:, 2, 3] += [times.rise(0.001 * row) for row in range(len(flange))]
    np.testing.assert_allclose(flange, wanted, atol=2e-5)
    assert wanted[-1, 2, 3] - wanted[0, 2, 3] == pytest.approx(TrialConfig.lift_height)
    with pytest.raises(ConfigError, match=r"lifts by 0.2000 m, the trial by 0.1 m; plan it with PathConfig\(lift=0.1"):
        course_of(path, arm, judge.TrialTimes(lift_height=0.1), 0.001)


def test_an_arm_holds_the_can(scene: ArmScene, path: arms.Trajectory) -> None:
    result = replay_arm(scene, BASE, path)
    assert result.trial.success
    assert result.trial.lift == pytest.approx(TrialConfig.lift_height, abs=0.01)
    assert result.distance < 1e-3
    assert np.degrees(result.angle) < 0.5
    assert 0.05 < result.torque < 1.0
    assert not result.touched


def test_an_arm_elsewhere_holds_nothing(scene: ArmScene, path: arms.Trajectory) -> None:
    beside = BASE.copy()
    beside[1, 3] = 0.2
    result = replay_arm(scene, beside, path)
    assert (result.trial.success, result.trial.failure) == (False, "no_contact")
    assert result.distance < 1e-3


def test_a_weak_arm_falls_behind_and_links_in_the_table_are_told(scene: ArmScene, path: arms.Trajectory) -> None:
    weak = replace(scene, torques=0.05 * scene.torques)
    result = replay_arm(weak, BASE, path)
    assert (result.trial.success, result.torque) == (False, 1.0)
    assert result.distance > 0.05
    sunk = BASE.copy()
    sunk[2, 3] = -0.3
    assert replay_arm(scene, sunk, path).touched


def test_half_of_the_trials_fail_in_the_core() -> None:
    arm, hand = arms.load_arm("fr3"), graspbox.load_hand(HAND)

    def sampled() -> tuple[list[ArmTrial], Counter[bool]]:
        executed: Counter[bool] = Counter()
        cases = list(sample_arm_trials(arm, hand, ["procedural:unseen:0-3"], 4, 0, executed))
        assert all(base.shape == (4, 4) for base, _ in cases)
        return [trial for _, trial in cases], executed

    (trials, executed), (again, _) = sampled(), sampled()
    assert sorted(trial.success for trial in trials) == [False, False, True, True]
    assert all((trial.failure == "") is trial.success for trial in trials)
    assert executed[True] > executed[False] >= 2
    for one, two in zip(trials, again, strict=True):
        np.testing.assert_array_equal(one.world_from_hand, two.world_from_hand)
        assert one.path == two.path
        # The core's verdict is that of a hand alone.
        pose = np.linalg.inv(one.scene.world_from_object) @ one.world_from_hand
        assert bool(one.scene.simulate(pose[None], one.path.preshape).success[0]) is one.success


def test_first_grasps_come_as_they_do() -> None:
    """Every reset gives one trial, of another object."""
    executed: Counter[bool] = Counter()
    hand = graspbox.load_hand(HAND)
    cases = list(sample_arm_trials(arms.load_arm("fr3"), hand, ["procedural:can:0-2"], 3, 0, executed, first=True))
    assert executed.total() == len(cases) == 3
    assert len({trial.scene.name for _, trial in cases}) == 3
    assert [sum(trial.success is word for _, trial in cases) for word in (True, False)] == [
        executed[True], executed[False],
    ]  # fmt: skip


def test_both_engines_judge_grasps_by_whole_arms() -> None:
    counts: list[int] = []
    report = compare_arm("fr3", HAND, ["procedural:can:0-3"], 2, 5, numerics=COARSE, progress=counts.append)
    assert counts == list(range(1, len(report.rows) + 1))
    assert sum(row.success and row.arm.trial.success and row.free.success for row in report.rows) == 1
    with pytest.raises(ConfigError, match="trials is 0; give 1 or more"):
        compare_arm("fr3", HAND, ["procedural:can:0"], 0)
    with pytest.raises(ConfigError, match=r"patch is 0.05; give metres, 0 to 0.02"):
        compare_arm("fr3", HAND, ["procedural:can:0"], 2, patch=0.05)


def row(core: bool, arm: bool, free: bool) -> VerdictRow:
    def outcome(success: bool) -> judge.Outcome:
        return judge.Outcome(success, None if success else "slipped", 0.2, 0.0, (2, 2), 0.0, 3.3)

    return VerdictRow(
        "can", core, "" if core else "slipped", ArmOutcome(outcome(arm), 1e-4, 1e-3, 0.5, False), outcome(free)
    )


def report(rows: list[VerdictRow]) -> VerdictReport:
    return VerdictReport("fr3", HAND, Counter({True: 90, False: 10}), rows)


def test_differences_are_those_of_the_arm_or_of_the_engines() -> None:
    some = report([row(True, True, True), row(True, False, True), row(False, True, True), row(False, False, True)])
    facts = some.to_json()
    assert (facts["equal"], facts["share"]) == (2, 0.5)
    assert facts["by_cause"] == {"engines": 1, "arm": 1}
    assert list(facts["confusion"]["arm"].values()) == [1, 1, 1, 1]
    assert facts["confusion"]["free"] == {
        "success, success": 2, "success, failure": 0, "failure, success": 2, "failure, failure": 0,
    }  # fmt: skip
    assert facts["agreements"]["free / arm"]["share"] == 0.5
    # Half of the successes and half of the failures have the same verdict.
    assert facts["unselected"] == pytest.approx(0.9 * 0.5 + 0.1 * 0.5)
    assert report([row(True, True, True), row(False, True, True)]).unselected == pytest.approx(0.9)
    assert np.isnan(report([row(True, True, True)]).unselected)


@pytest.mark.parametrize(("wrong", "status"), [(3, 0), (4, 1)])
def test_the_exit_status_follows_the_verdicts(
    wrong: int, status: int, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """97 of 100 trials with the same verdict are enough."""
    rows = [row(True, index >= wrong, True) for index in range(50)] + [row(False, False, False)] * 50
    asked: list[Any] = []

    def compare(*arguments: object, **options: object) -> VerdictReport:
        asked.append((*arguments[:2], options["first"], options["patch"]))
        return report(rows)

    monkeypatch.setattr(arms_command, "compare_arm", compare)
    assert main(["arms", "--paths", "0", "--arm", "ur5e", "--first", "--patch", "2", "--json"]) == status
    assert asked == [("ur5e", "robotiq_2f_85", True, 0.002)]
    facts = json.loads(capsys.readouterr().out)
    assert facts["paths"] == []
    assert facts["grasps"][0]["equal"] == 100 - wrong
    assert main(["arms", "--paths", "0"]) == status
    assert f"same verdict: {100 - wrong:.1f}%" in capsys.readouterr().out


def test_paths_are_followed_within_a_millimetre(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["arms", "--arm", "xarm7", "--paths", "2", "--seconds", "0.5", "--trials", "0", "--json"]) == 0
    (row,) = json.loads(capsys.readouterr().out)["paths"]
    assert (row["paths"], row["agrees"]) == (2, True)
    assert 0.0 < row["distance"] < 1e-3
