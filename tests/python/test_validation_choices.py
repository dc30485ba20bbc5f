"""MuJoCo as a second judge of the grasps that policies choose."""

import json
from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("mujoco", reason="the comparison needs mujoco, from the extra 'dev'")

from graspbox import object_sets
from graspbox.errors import ConfigError
from validate import main
from validation import mujoco as judge
from validation.choices import ChoicesReport, command, compare_choices
from validation.mujoco.replay import Replay

COARSE = judge.Numerics(timestep=0.001)
#: Speed of a spinning top, rad/s, and its moment of inertia about the vertical.
SPIN, INERTIA = 20.0, 1e-4


def spinning_top() -> judge.ObjectData:
    """Give a double pyramid that stands on its tip and hardly tilts, for its other moments of inertia are huge."""
    points = 0.03 * np.array([[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1.0]])
    rest = np.eye(4)
    rest[2, 3] = 0.03
    return judge.ObjectData("top", [points], 0.2, np.zeros(3), np.diag([1.0, 1.0, INERTIA]), rest)


@pytest.mark.parametrize("patch", [0.0, 0.002, 0.004])
def test_a_patch_slows_a_spinning_top(patch: float) -> None:
    """The moment of friction is ``friction * patch * weight``: closed form of the speed, also without a patch."""
    pose = np.diag([1.0, -1.0, -1.0, 1.0])
    pose[2, 3] = 0.6
    run = Replay(judge.build(judge.describe(), spinning_top(), numerics=COARSE, patch=patch), pose, 0.0)
    for _ in range(200):
        run.step()
    assert run.contacts()[0]
    dof = run.model.joint("object").dofadr[0]
    run.data.qvel[dof + 5] = SPIN
    for _ in range(250):
        run.step()
    moment = 0.5 * patch * 0.2 * 9.81
    assert run.data.qvel[dof + 5] == pytest.approx(SPIN - moment / INERTIA * 0.25, rel=0.02)


def test_both_engines_judge_the_choices_of_a_policy() -> None:
    """All trials count, and the core's verdict on a replayed grasp is that of the trial."""
    sets = object_sets.load(["procedural:can:0", "procedural:box:0"])
    counts: list[int] = []
    report = compare_choices("planner", sets, 4, 3, numerics=COARSE, progress=counts.append)
    assert counts == [1, 2, 3, 4]
    assert (report.policy, report.hand, report.trials) == ("planner", "reflex", 4)
    assert len(report.compared.rows) + report.missing + report.compared.infeasible == 4
    facts = report.to_json()
    assert facts["successes"]["core"]["count"] == report.core
    assert facts["successes"]["mujoco"]["count"] == report.mujoco
    # None of these grasps is in collision in MuJoCo.
    assert report.compared.infeasible == 0
    assert report.core == sum(row.success for row in report.compared.rows) >= 2
    low, high = facts["successes"]["core"]["ci95"]
    assert low < report.core / 4 < high or report.core == 4


@pytest.mark.parametrize("patch", [-0.001, 1.0, float("nan")])
def test_a_patch_out_of_range_is_refused(patch: float) -> None:
    with pytest.raises(ConfigError, match=r"patch is .*; give metres, 0 to 0.02"):
        compare_choices("planner", "procedural:can:0", 1, patch=patch)


def report(core: int, mujoco: int, trials: int = 100) -> ChoicesReport:
    """Give a report of `trials` with so many successes in either engine."""
    held = judge.Outcome(True, None, 0.2, 0.0, (4, 4), 0.0, 3.3)
    row = judge.Row("cube", True, "", 0.2, held, np.eye(4), np.eye(4), 0.0)
    lost = replace(held, success=False, failure="slipped")
    rows = [
        replace(row, success=i < core, failure="" if i < core else "slipped", mujoco=held if i < mujoco else lost)
        for i in range(trials - 1)
    ]
    return ChoicesReport("some", "reflex", trials, core, 1, judge.Report(rows=rows))


@pytest.mark.parametrize(("mujoco", "status"), [(90, 0), (87, 0), (93, 0), (86, 1), (94, 1)])
def test_the_exit_status_follows_the_rates(
    mujoco: int, status: int, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Rates that differ by more than 3 points fail; the trial without a grasp counts in both."""
    seen: list[tuple[int, float]] = []

    def compare(policy: str, objects: object, trials: int, seed: int, **options: object) -> ChoicesReport:
        assert isinstance(options["patch"], float)
        seen.append((trials, options["patch"]))
        return report(90, mujoco)

    monkeypatch.setattr(command, "compare_choices", compare)
    assert main(["choices", "some", "--trials", "7", "--patch", "1", "--json"]) == status
    assert [trials for trials, _ in seen] == [7, 7]
    assert [patch for _, patch in seen] == pytest.approx([0.001, 0.001])
    facts = json.loads(capsys.readouterr().out)
    assert [entry["objects"] for entry in facts] == ["procedural:unseen:0-19", "ycb"]
    assert facts[0]["difference"] == pytest.approx((90 - mujoco) / 100)
    assert facts[0]["missing"] == 1
    assert main(["choices", "some", "--objects", "ycb"]) == status
    assert "90.0%" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("--trials", "0"), "trials is 0; give 1 or more"),
        (("--timestep", "0"), "timestep is 0.0; give at most 0.01 s"),
        (("--patch", "50"), "patch is 0.05"),
    ],
)
def test_arguments_out_of_range_are_named(
    options: tuple[str, str], message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["choices", "planner", "--objects", "procedural:can:0", *options]) == 2
    assert message in capsys.readouterr().err
