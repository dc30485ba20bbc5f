"""The protocol of DexGraspBench: six forces and a lift, force closure, sources of grasps, and the command."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("mujoco", reason="the protocol needs mujoco, from the extra 'dev'")
pytest.importorskip("scipy", reason="force closure needs scipy, from the extra 'dev'")

import graspbox
from graspbox import errors
from graspbox.tools import exchange
from validate import main
from validation.forces.command import ENGINES, judge
from validation.forces.config import Contact, ForceConfig, Verdict
from validation.forces.measures import ferrari_canny, residual, wrenches
from validation.forces.report import SourceResult, markdown
from validation.forces.report import to_json as table_of
from validation.forces.sources import Batch, chosen, closing_step, from_files, planned

CAN = "procedural:can:2"
#: A short protocol.
QUICK = ForceConfig(pull_time=0.3)


def contact(point: tuple[float, float, float], inward: tuple[float, float, float], friction: float) -> Contact:
    return Contact(0, np.array(point), np.array(inward) / np.linalg.norm(inward), friction)


def around(friction: float, size: float = 1.0) -> list[Contact]:
    """Four contacts on a circle of radius `size`, that press towards its middle, and one on either side."""
    points = [(1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0), (0.3, 0, 1), (-0.3, 0, -1)]
    return [contact((size * x, size * y, size * z), (-x, -y, -z), friction) for x, y, z in points]


def test_q1_is_the_ball_in_the_hull() -> None:
    """In every direction the strongest wrench is at least Q1, and in some direction hardly more."""
    contacts = around(0.5)
    radius, points = ferrari_canny(contacts), wrenches(contacts).reshape(-1, 6)
    directions = np.random.default_rng(0).normal(size=(100_000, 6))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    strongest = (directions @ points.T).max(axis=1)
    assert radius > 0.1
    assert strongest.min() >= radius - 1e-12
    worst = directions[np.argmin(strongest)]
    for _ in range(2000):
        # Steepest descent of the strongest wrench, a convex function, towards its least value on the sphere.
        worst = worst - 1e-3 * points[np.argmax(points @ worst)]
        worst /= np.linalg.norm(worst)
    assert (points @ worst).max() == pytest.approx(radius, rel=0.02)


def test_q1_knows_grasps_that_resist_nothing() -> None:
    assert ferrari_canny([]) == 0.0
    assert ferrari_canny(around(0.5)[:1]) == 0.0
    # Two points resist no torque about their line, and contacts on one side no force towards them.
    assert ferrari_canny([contact((1, 0, 0), (-1, 0, 0), 0.5), contact((-1, 0, 0), (1, 0, 0), 0.5)]) == 0.0
    assert ferrari_canny([contact((x, y, 0), (0, 0, 1), 0.5) for x, y in ((0, 0), (1, 0), (0, 1), (1, 1))]) == 0.0
    assert ferrari_canny(around(0.5)) == pytest.approx(ferrari_canny(around(0.5, size=0.03)))
    assert ferrari_canny(around(0.8)) > ferrari_canny(around(0.4)) == pytest.approx(ferrari_canny(around(0.8), 0.5))


def test_q1_takes_contacts_that_nearly_coincide() -> None:
    """A grasp of five places. By default Qhull rejects it where a third of these sixth contacts is added."""
    places = [
        contact((-0.0167246, 0.04492903, 1.06961172), (0.2913057, -0.85815891, -0.42273428), 0.6),
        contact((-0.0202328, -0.00523807, 1.02558141), (0.40434425, 0.91458743, -0.005963), 0.6),
        contact((0.01771609, 0.02840552, 1.05018495), (-0.85935972, -0.51113228, 0.01564146), 0.6),
        contact((0.01610644, 0.00761849, 1.02581087), (-0.87695378, 0.48023612, 0.0180373), 0.6),
        contact((0.00144442, -0.00642014, 1.06917605), (-0.31972325, 0.94187433, -0.10319779), 0.6),
    ]
    for shift in np.random.default_rng(0).normal(size=(20, 3)) * 1e-14:
        again = replace(places[2], point=places[2].point + shift)
        assert ferrari_canny([*places[:3], again, *places[3:]]) == pytest.approx(0.227320, abs=1e-6)


def test_the_residual_of_one_contact_has_a_closed_form() -> None:
    """It presses with 1 along x: pulls along x leave 0.9 and 1.1, and across it 1 where friction carries them."""
    one = [contact((0.2, 0.1, 0), (1, 0, 0), 0.5)]
    assert residual(one) == pytest.approx((0.9 + 1.1 + 4.0) / 6.0, abs=1e-5)
    assert residual(one, friction=0.0) == pytest.approx((0.9 + 1.1 + 4.0 * np.sqrt(1.01)) / 6.0, abs=1e-5)
    assert residual(around(0.5)) == pytest.approx(0.0, abs=1e-4)
    assert np.isnan(residual([]))


@pytest.fixture(scope="module")
def batch() -> Batch:
    """Two grasps of a can, one 40 cm above it, and one whose palm is inside it."""
    found = next(planned([CAN], 2, 0))
    above, inside = np.eye(4), np.eye(4)
    above[2, 3] = 0.4
    inside[:3, 3] = found.scene.center_of_mass
    poses = np.concatenate([found.poses, above[None], inside[None]])
    return Batch(found.scene, poses, np.concatenate([found.preshape, [0.0, 0.0]]))


@pytest.mark.parametrize("engine", ENGINES)
def test_engines_judge_alike(batch: Batch, engine: str) -> None:
    good, other, missed, deep = judge(batch, engine, QUICK, 2)
    for verdict in (good, other):
        assert verdict.holds
        assert verdict.keeps
        assert verdict.links >= 3
        assert verdict.shift.max() < 0.002
        assert 0.0 < verdict.closed_depth < 0.001
        assert ferrari_canny(verdict.contacts) > 0.1
    assert good.passes
    assert good.lifts
    assert not any((missed.passes, missed.holds, missed.lifts, missed.keeps, missed.contacts))
    # At 10 m/s2 an object is 5 cm away after 0.1 s: it is lost at that look, or at the next, after 11 cm.
    assert ((missed.shift[:6] >= 0.05) & (missed.shift[:6] < 0.115)).all()
    np.testing.assert_allclose(missed.shift[6], 0.1, rtol=0.05)
    assert deep.start_depth > QUICK.max_depth
    assert np.isnan(deep.shift).all()
    assert not any((deep.passes, deep.holds, deep.lifts, deep.keeps))


def test_settings_reach_both_engines(batch: Batch) -> None:
    """A tenth of a newton on each contact holds no kilogram; limits of nearly nothing are kept by no grasp."""
    one = Batch(batch.scene, batch.poses[:1], batch.preshape[:1])
    for engine in ("implicit", "mujoco"):
        assert not judge(one, engine, replace(QUICK, mass=20.0, friction=0.1), 1)[0].holds
        assert not judge(one, engine, replace(QUICK, max_shift=1e-4), 1)[0].passes
    with pytest.raises(errors.ConfigError, match="`pull_time` is -1"):
        judge(one, "implicit", replace(QUICK, pull_time=-1.0), 1)


def test_the_number_of_threads_does_not_matter(batch: Batch) -> None:
    for engine in ("implicit", "mujoco"):
        one, two = (judge(batch, engine, QUICK, threads) for threads in (1, 2))
        for first, second in zip(one, two, strict=True):
            np.testing.assert_array_equal(first.shift, second.shift)


def verdict(passes: bool, holds: bool) -> Verdict:
    nothing = np.zeros(7)
    return Verdict(passes, holds, passes, holds, nothing, nothing, 0.0, 0.001, around(0.5))


def test_the_report_counts() -> None:
    result = SourceResult("some", missing=1, own=(3, 2))
    result.verdicts["implicit"] = [verdict(True, True), verdict(False, True), Verdict.refused(0.02)]
    result.verdicts["mujoco"] = [verdict(True, True), verdict(True, True), Verdict.refused(0.02)]
    (row,) = table_of([result])
    implicit = row["engines"]["implicit"]
    counts = [implicit[name] for name in ("grasps", "passes", "holds", "lifts", "too_deep", "links")]
    assert counts == [4, 1, 2, 1, 1, 1.0]
    assert implicit["q1"] == pytest.approx(ferrari_canny(around(0.5)))
    first = row["agreements"][0]
    assert (first["verdict"], first["equal"], first["grasps"]) == ("passes", 2, 3)
    assert json.loads(json.dumps(row)) == row
    text = markdown([row])
    assert "| some | its own trials | 4 | success 75.0 % (30.1 to 95.4), secure 50.0 % (15.0 to 85.0) |" in text
    assert "| some | implicit | 4 | 25.0 % (4.6 to 69.9) | 50.0 % (15.0 to 85.0) |" in text
    assert "| some | implicit and mujoco | six forces | 2 of 3 | 0.40 |" in text


def test_a_policy_that_decides_once() -> None:
    """The planner's first pose is read back from its action."""
    found = chosen("planner", [CAN], 2, 0)
    assert found.result.succeeded == 2
    for one in found.batches:
        assert one is not None
        best = graspbox.plan(one.scene.mesh, world_from_object=one.scene.world_from_object).best(1)
        np.testing.assert_allclose(one.poses, best.poses, atol=2e-3)
        assert one.preshape == pytest.approx(best.preshape, abs=1e-3)
        assert judge(one, "implicit", QUICK, 1)[0].holds


def test_a_policy_that_moves_step_by_step() -> None:
    """The expert closes near a pose of the planner, above the can."""
    found = chosen("expert", [CAN], 1, 0)
    assert found.result.succeeded == 1
    (one,) = found.batches
    assert one is not None
    plan = graspbox.plan(one.scene.mesh, world_from_object=one.scene.world_from_object).best(40)
    nearest = np.linalg.norm(plan.poses[:, :3, 3] - one.poses[0, :3, 3], axis=1).min()
    assert nearest < 0.01
    assert judge(one, "implicit", QUICK, 1)[0].holds


def test_the_step_at_which_a_hand_closes() -> None:
    travel = np.array([0.0, 0.2, 0.9, 0.05, 0.02, 0.5, 1.0, 1.0])[:, None]
    assert closing_step(travel) == 4
    assert closing_step(np.zeros((5, 3))) is None


def test_files_are_judged(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("yaml")
    mesh = graspbox.object_sets.load(CAN)[0].load()
    plan = graspbox.plan(mesh).best(20)
    plan = plan[plan.preshape == 0.0][:2]
    assert len(plan) == 2
    exchange.save(exchange.simulated(exchange.from_plan(plan), mesh), tmp_path / "can.yaml", "isaac")
    (read,) = from_files([tmp_path / "can.yaml"], [CAN], preshape=0.0)
    np.testing.assert_allclose(read.poses, plan.poses, atol=1e-6)
    told = ["forces", "--grasps", str(tmp_path / "can.yaml"), "--preshape", "0", "--engines", "implicit", "--json"]
    assert main([*told, "--objects", CAN]) == 0
    (row,) = json.loads(capsys.readouterr().out)
    assert row["source"] == "files"
    assert row["engines"]["implicit"]["holds"] == 2
    assert main([*told, "--objects", "procedural:box:0-1"]) == 2
    assert "which is none of the objects; name it with --objects" in capsys.readouterr().err


def test_the_command_plans(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["forces", "--objects", CAN, "--poses", "1", "--engines", "implicit"]) == 0
    out = capsys.readouterr()
    assert "| planner | implicit | 1 |" in out.out
    assert "objects" in out.err
    for wrong in (["--poses", "0"], ["--seed", "-1"], ["--engines", "bullet"], ["--poses", "2", "--policies", "depth"]):
        with pytest.raises(SystemExit) as error:
            main(["forces", *wrong])
        assert error.value.code == 2
