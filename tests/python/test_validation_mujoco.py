"""The same hand in MuJoCo, compared with closed forms and with the core."""

import json
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

pytest.importorskip("mujoco", reason="the comparison needs mujoco, from the extra 'dev'")

import mujoco

import graspbox
from graspbox.configs import PhysicsConfig
from validate import main
from validation import mujoco as judge
from validation.mujoco.replay import Replay

#: Coarse enough for a quick test of results that do not depend on the step.
COARSE = judge.Numerics(timestep=0.001)
#: The palm faces the table and everything is out of reach of the fingers.
HIGH = 0.6


def above(height: float) -> NDArray[np.float64]:
    """Give ``world_from_hand`` with the palm facing down."""
    pose = np.diag([1.0, -1.0, -1.0, 1.0])
    pose[2, 3] = height
    return pose


def cube(side: float = 0.06, mass: float = 0.2) -> judge.ObjectData:
    half = 0.5 * side
    corners = np.array([[x, y, z] for x in (-half, half) for y in (-half, half) for z in (-half, half)])
    rest = np.eye(4)
    rest[2, 3] = half
    inertia = np.eye(3) * mass * side**2 / 6.0
    return judge.ObjectData("cube", [corners], mass, np.zeros(3), inertia, rest)


@pytest.fixture(scope="module")
def hand() -> judge.HandDescription:
    return judge.describe()


def cube_mesh() -> graspbox.Mesh:
    (points,) = cube().parts
    faces = [[0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1]]
    faces += [[2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3]]
    return graspbox.mesh_from_arrays(np.asarray(points), np.array(faces), mass=0.2, name="cube")


def test_both_read_the_same_hand(hand: judge.HandDescription) -> None:
    """Shapes of the closed, spread hand stand where the core puts them."""
    core = graspbox.load_hand("reflex")
    positions = [0.7, 0.3, 0.2, 0.9, 0.6, 1.4, 1.1]
    poses, half, pads, _ = core.shapes(np.array(positions))
    scene = judge.build(hand, cube())
    run = Replay(scene, np.eye(4), positions[0])
    for (address, _), position in zip(scene.joints.values(), positions[1:], strict=True):
        run.data.qpos[address] = position
    mujoco.mj_kinematics(run.model, run.data)
    shapes = [shape for link in hand.links for shape in link.shapes]
    assert len(shapes) == len(poses)
    for shape in shapes:
        geom = run.model.geom(shape.name).id
        place = run.data.geom_xpos[geom]
        (index,) = np.flatnonzero(np.linalg.norm(poses[:, :3, 3] - place, axis=1) < 1e-6)
        np.testing.assert_allclose(np.sort(run.model.geom_size[geom]), np.sort(half[index]), atol=1e-9)
        assert (shape.friction == 1.0) == pads[index]


def test_tendon_statics_against_the_closed_form(hand: judge.HandDescription) -> None:
    """Without gravity a slowly closed finger rests where ``r T`` balances the springs, on both joints."""
    short = replace(hand, actuators=tuple(replace(a, travel=(0.0, 1.2)) for a in hand.actuators))
    scene = judge.build(short, cube(), PhysicsConfig(gravity=0.0), COARSE)
    run = Replay(scene, above(HIGH), 0.0)
    for _ in range(8000):
        run.step()
    for i, tendon in enumerate(hand.tendons):
        states = [run.joint(link) for link, _ in tendon.arms]
        assert max(abs(speed) for _, speed in states) < 1e-3
        spool = hand.actuators[i].spool
        assert spool is not None
        stretch = spool[1] * 1.2 - sum(arm * q for (_, arm), (q, _) in zip(tendon.arms, states, strict=True))
        assert run.load(i) == pytest.approx(tendon.stiffness * stretch, rel=1e-3)
        for (link, arm), (q, _) in zip(tendon.arms, states, strict=True):
            spring = hand.links[link].spring
            assert arm * run.load(i) == pytest.approx(spring.stiffness * (q - spring.reference), rel=2e-3)


def test_free_closing_agrees_with_the_core() -> None:
    """The hand closes on air: angles within 0.06 rad (2 % of the way) and tensions within 2 N, until fingers meet.

    The difference is due to the core's step of 2 ms: at 0.5 ms it is within 0.02 rad of MuJoCo.
    """
    scene = graspbox.Scene(cube_mesh())
    pose = np.linalg.inv(scene.world_from_object) @ above(HIGH)
    _, core = scene.trace(pose, 0.3)
    theirs = judge.replay(judge.build(judge.describe(), judge.object_data(scene)), above(HIGH), 0.3, trace=True)
    # The first 30 ms are the jerk of a tendon that goes taut.
    rows = [i for i, time in enumerate(core.time) if 0.03 < time < 0.54]
    assert len(rows) > 45
    trace = [theirs.trace[round(core.time[i] / 0.01)] for i in rows]
    assert np.abs([sample.time for sample in trace] - core.time[rows]).max() < 1e-3
    angles = np.array([sample.joints for sample in trace])
    tensions = np.array([sample.loads[:3] for sample in trace])
    assert angles[-1, ::2].min() > 1.6
    # The core's first joint is the swivel, which MuJoCo's model has as a pose.
    assert np.abs(angles - core.joints[rows, 1:]).max() < 0.06
    late = core.time[rows] > 0.15
    assert np.abs(tensions - core.tensions[rows])[late].max() < 2.0


def test_a_tendon_at_its_limit_keeps_a_fifth_of_its_damping(hand: judge.HandDescription) -> None:
    """The closed hand pulls with all its force; then a joint loses its speed at the rate of both dampings."""
    run = Replay(judge.build(hand, cube(), PhysicsConfig(gravity=0.0), COARSE), above(HIGH), 0.0)
    damping = np.array([hand.links[link].spring.damping for link in run.scene.joints])
    np.testing.assert_array_equal(run.model.dof_damping[run.drive.dofs], damping)
    for _ in range(1300):
        run.step()
    column = {link: i for i, link in enumerate(run.scene.joints)}
    expected = damping.copy()
    for tendon, load in zip(hand.tendons, run.drive.loads(run.data), strict=False):
        assert load == tendon.max_tension
        for link, arm in tendon.arms:
            expected[column[link]] += 0.2 * tendon.damping * arm**2
    np.testing.assert_allclose(run.model.dof_damping[run.drive.dofs], expected, rtol=1e-12)


def test_the_lift_is_the_trial_s(hand: judge.HandDescription) -> None:
    """The carriage follows the minimum-jerk rise under any motion of the fingers."""
    run = Replay(judge.build(hand, cube(), numerics=COARSE), above(0.11), 0.0)
    heights = []
    for _ in range(3300):
        run.step()
        heights.append(run.data.qpos[run.model.joint("carriage").qposadr[0]])
    assert heights[1299] == 0.0
    assert heights[1799] == pytest.approx(0.1, abs=1e-4)
    assert heights[-1] == pytest.approx(0.2, abs=1e-12)


def test_pair_friction_is_the_product_of_factors(hand: judge.HandDescription) -> None:
    """A cube on the tilted table slides at the angle of friction: 0.5, not MuJoCo's maximum of both."""
    for tilt, slides in ((0.48, False), (0.52, True)):
        scene = judge.build(hand, cube(), numerics=COARSE)
        angle = np.arctan(tilt)
        scene.model.opt.gravity[:] = [9.81 * np.sin(angle), 0.0, -9.81 * np.cos(angle)]
        run = Replay(scene, above(HIGH), 0.0)
        for _ in range(500):
            run.step()
        moved = run.data.xpos[scene.object_body, 0]
        expected = 0.5 * 9.81 * (np.sin(angle) - 0.5 * np.cos(angle)) * 0.25
        assert moved == pytest.approx(expected, rel=0.05) if slides else abs(moved) < 5e-4


def test_a_sliding_box_hops_in_mujoco(hand: judge.HandDescription) -> None:
    """Why the labels of objects that are dragged over the table differ: friction lifts them off it.

    MuJoCo relaxes friction to a convex problem. A cube that slides at 0.3 m/s is off the table most of the time, at
    for any time step; on average its weight and the friction are right. In the core it stays on the table
    (`a_sliding_box_stays_on_the_table` in ``tests/rust/physics_truths.rs``).
    """
    for timestep in (0.0005, 0.0001):
        scene = judge.build(hand, cube(), numerics=judge.Numerics(timestep=timestep))
        run = Replay(scene, above(HIGH), 0.0)
        for _ in range(round(0.2 / timestep)):
            run.step()
        assert run.contacts()[0]
        dof = run.model.joint("object").dofadr[0]
        run.data.qvel[dof] = 0.3
        steps = round(0.04 / timestep)
        touching = 0
        for _ in range(steps):
            run.step()
            touching += run.contacts()[0]
        assert 0.1 < touching / steps < 0.5
        assert run.data.qvel[dof] == pytest.approx(0.3 - 0.5 * 9.81 * 0.04, rel=0.1)


def test_labels_of_plain_cases_agree() -> None:
    """A cube held from above is a success in both, a hand that closes beside it touches nothing in either."""
    scene = graspbox.Scene(cube_mesh())
    to_object = np.linalg.inv(scene.world_from_object)
    beside = above(0.115)
    beside[0, 3] = 0.4
    worlds = [above(0.11), beside]
    ours = scene.simulate(np.stack([to_object @ w for w in worlds]), np.zeros(2))
    built = judge.build(judge.describe(), judge.object_data(scene))
    theirs = [judge.replay(built, world, 0.0) for world in worlds]
    assert [bool(x) for x in ours.success] == [t.success for t in theirs] == [True, False]
    assert ours.failure[1] == theirs[1].failure == "no_contact"
    # How far the fingers curl before friction locks them hangs on details of the way there.
    assert theirs[0].lift == pytest.approx(ours.lift[0], abs=0.03)


def test_buried_hand_is_infeasible(hand: judge.HandDescription) -> None:
    assert judge.replay(judge.build(hand, cube()), above(0.03), 0.0).failure == "infeasible"


def test_missing_goal_fails_the_command(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    """The exit status follows the share of equal labels."""
    import validation.mujoco.command as command

    held = judge.Outcome(True, None, 0.2, 0.0, (4, 4), 0.0, 3.3)
    row = judge.Row("cube", False, "slipped", 0.0, held, np.eye(4), np.eye(4), 0.0, halved=(False, True))
    monkeypatch.setattr(command, "compare", lambda *_, **__: judge.Report(rows=[row]))
    assert main(["mujoco", "--json"]) == 1
    facts = json.loads(capsys.readouterr().out)
    assert facts["share"] == 0.0
    assert facts["by_kind"] == {"slipped / success": 1}
    assert facts["by_why"] == {"engines disagree": 1}
    assert facts["bias"] == -1.0
    monkeypatch.setattr(command, "compare", lambda *_, **__: judge.Report(rows=[replace(row, success=True)]))
    assert main(["mujoco", "--json"]) == 0
    # Nine of ten equal labels are enough for the share; that the tenth is ours alone is too much of a bias.
    rows = [replace(row, success=True)] * 9 + [replace(row, success=True, mujoco=replace(held, success=False))]
    monkeypatch.setattr(command, "compare", lambda *_, **__: judge.Report(rows=rows))
    assert main(["mujoco", "--json"]) == 1


def test_a_few_trials_of_procedural_objects() -> None:
    report = judge.compare(["procedural:can:0", "procedural:box:0"], trials=4, seed=1, repeat="none")
    assert len(report.rows) + report.infeasible == 4
    assert report.core_seconds > 0.0
    assert report.mujoco_seconds > 0.0
    assert report.equal >= 3


@pytest.mark.parametrize(
    ("option", "message"),
    [(("--trials", "0"), "trials is 0; give 1 or more"), (("--timestep", "0"), "timestep is 0.0; give at most 0.01 s")],
)
def test_arguments_out_of_range_are_named(
    option: tuple[str, str], message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["mujoco", *option]) == 2
    assert message in capsys.readouterr().err
