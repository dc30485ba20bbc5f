"""Paths of arms: phases, limits, collisions by a judge of its own, what keeps a path from being found, files."""

import contextlib
import csv
import json
import warnings
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from numpy.typing import NDArray
from PIL import Image

import graspbox
from command_line import invoke
from graspbox import errors
from graspbox._common import imports
from graspbox.arms import Arm, Trajectory, plan_path
from graspbox.arms.timing import limits_of, timed
from graspbox.hands.conventions import mechanism_of
from graspbox.hands.loading import AssumedWarning

pytest.importorskip("ruckig", reason="timing needs the extra 'arm'")

#: An arm half a metre behind a can.
BASE = np.eye(4)
BASE[0, 3] = -0.5
CARRIES = ["reach", "approach", "close", "lift", "carry", "lower", "open", "retreat"]


@pytest.fixture(scope="module")
def can() -> graspbox.Mesh:
    return graspbox.object_sets.load("procedural:can:3")[0].load()


@pytest.fixture(scope="module")
def plan(can: graspbox.Mesh) -> graspbox.Plan:
    return graspbox.plan(can, hand="panda_gripper", seed=0).best(40)


def placed_at(plan: graspbox.Plan, x: float, y: float) -> NDArray[np.float64]:
    place = plan.world_from_object.copy()
    place[:2, 3] += x, y
    return place


def others() -> list[tuple[graspbox.Mesh, NDArray[np.float64]]]:
    """Three things between the can and its place."""
    things = []
    for index, name in enumerate(["procedural:box:1", "procedural:mug:2", "procedural:bottle:4"]):
        mesh = graspbox.object_sets.load(name)[0].load()
        pose = mesh.resting_poses()[0][0].copy()
        pose[:2, 3] += 0.12 * index - 0.12, 0.2
        things.append((mesh, pose))
    return things


@pytest.fixture(scope="module")
def path(plan: graspbox.Plan, can: graspbox.Mesh) -> Trajectory:
    return plan.path("fr3", BASE, mesh=can, objects=others(), place=placed_at(plan, -0.1, 0.4))


def test_a_path_goes_from_home_to_the_grasp_and_on_to_the_place(path: Trajectory, plan: graspbox.Plan) -> None:
    arm, hand = Arm.named("fr3"), graspbox.load_hand("panda_gripper")
    assert list(dict.fromkeys(path.phases.tolist())) == CARRIES
    assert path.joints == tuple(arm.joints)
    np.testing.assert_array_equal(path.positions[0], arm.home)
    assert path.times[0] == 0
    assert path.times[-1] == pytest.approx(path.duration)
    assert (np.diff(path.times) > 0).all()
    # The hand is at the grasp when it closes, and moves only while the arm rests.
    world_from_hand = (plan.world_from_object @ plan.poses)[plan.feasible][path.grasp]
    closing = path.phases == "close"
    flange = BASE @ arm.flange_poses(path.positions[closing])
    there = flange @ arm.flange_from_base_of(hand) @ mechanism_of(hand).base_from_hand
    np.testing.assert_allclose(there, np.broadcast_to(world_from_hand, there.shape), atol=1e-5)
    moves = np.flatnonzero(np.diff(path.hand))
    assert set(path.phases[moves + 1].tolist()) <= {"close", "open", "lift", "retreat"}
    assert path.hand[0] == path.hand[-1] == 0
    assert (path.hand[path.phases == "carry"] == 1).all()
    low, high = arm.joint_limits.T
    assert ((path.positions >= low) & (path.positions <= high)).all()


def test_a_video_shows_the_path(path: Trajectory, plan: graspbox.Plan, can: graspbox.Mesh, tmp_path: Path) -> None:
    from graspbox import pictures

    file, given = tmp_path / "path.webp", {"target": (can, plan.world_from_object)}
    with pytest.raises(errors.ConfigError, match=r"extension '\.png'; use one of \.gif"):
        pictures.save_path(tmp_path / "a.png", path, "fr3", "panda_gripper", BASE, **given)  # type: ignore[arg-type]
    for arm, hand, base, message in (
        ("xarm7", "panda_gripper", BASE, "arm is 'xarm7', but the trajectory is that of 'fr3'"),
        ("fr3", "reflex", BASE, "hand is 'reflex', but the trajectory is that of 'panda_gripper'"),
        ("fr3", "panda_gripper", BASE[:3, 3], "world_from_base has the shape"),
    ):
        with pytest.raises(errors.ConfigError, match=message):
            pictures.save_path(file, path, arm, hand, base, **given)  # type: ignore[arg-type]
    pictures.save_path(file, path, "fr3", "panda_gripper", BASE, **given)  # type: ignore[arg-type]
    with Image.open(file) as video:
        frames, lasts = [], 0.0
        for frame in range(video.n_frames):
            video.seek(frame)
            frames.append(np.asarray(video.convert("RGB"), dtype=int))
            lasts += 0.001 * video.info["duration"]
    assert lasts == pytest.approx(path.duration + 1.0, abs=0.3)
    # The object, which alone has its colour, ends elsewhere.
    brown = [frame[60:, :, 0] - frame[60:, :, 2] > 45 for frame in frames]
    places = [np.argwhere(mask).mean(axis=0) for mask in (brown[0], brown[-1])]
    assert np.linalg.norm(places[0] - places[1]) > 20


@pytest.mark.parametrize("phase", ["approach", "lift", "lower", "retreat"])
def test_straight_lines_are_straight(path: Trajectory, phase: str) -> None:
    arm = Arm.named("fr3")
    start, end = path.times[path.phases == phase][[0, -1]]
    flanges = arm.flange_poses(path.sample(np.linspace(start, end, 500)).positions)
    way = flanges[-1, :3, 3] - flanges[0, :3, 3]
    off = flanges[:, :3, 3] - flanges[0, :3, 3]
    off -= np.outer(off @ way, way) / (way @ way)
    assert np.linalg.norm(off, axis=1).max() < 5e-4
    np.testing.assert_allclose(flanges[:, :3, :3], np.broadcast_to(flanges[0, :3, :3], (500, 3, 3)), atol=2e-3)


@pytest.mark.parametrize(("name", "hand"), [("fr3", "panda_gripper"), ("ur5e", "robotiq_2f_85"), ("xarm7", "leap")])
def test_a_judge_of_its_own_finds_no_collision_and_no_limit_exceeded(name: str, hand: str, can: graspbox.Mesh) -> None:
    """MuJoCo's kinematics and contacts, and points of the true surfaces, every 0.005 rad."""
    pytest.importorskip("mujoco")
    pytest.importorskip("igl")
    from validation.arm_paths import Judge, limit_ratios

    around, limits = others(), limits_of(Arm.named(name))
    planned = graspbox.plan(can, hand=hand, seed=0).best(20)
    place = placed_at(planned, -0.1, 0.4)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", AssumedWarning)
        made = planned.path(name, BASE, hand=hand, mesh=can, objects=around, place=place)
    judge = Judge(Arm.named(name), graspbox.load_hand(hand), BASE, around, (can, planned.world_from_object), place)
    verdict = judge(made)
    assert verdict.touches == []
    assert verdict.postures > 300
    ratios = limit_ratios(made, limits)
    assert (ratios <= 1.0 + 1e-6).all(), ratios
    assert ratios.max() > 0.9, "some limit is used"
    # A path through the things is judged so: the same one, with them where the can is carried along.
    carried = made.sample([float(made.times[made.phases == "carry"].mean())])
    blocked = around[0][1].copy()
    blocked[:3, 3] = (BASE @ Arm.named(name).flange_poses(carried.positions))[0, :3, 3]
    judge = Judge(judge.arm, judge.hand, BASE, [(around[0][0], blocked)], judge.target, place)
    assert judge(made).touches


def test_the_same_arguments_give_the_same_bits(path: Trajectory, plan: graspbox.Plan, can: graspbox.Mesh) -> None:
    given: dict[str, Any] = {"mesh": can, "objects": others(), "place": placed_at(plan, -0.1, 0.4)}
    assert plan.path("fr3", BASE, num_threads=2, **given) == path
    assert plan.path("fr3", BASE, num_threads=1, **given) == path


def test_slower_is_slower_and_samples_are_exact(plan: graspbox.Plan, can: graspbox.Mesh) -> None:
    fast = plan.path("fr3", BASE, mesh=can, hand_time=0.0)
    slow = plan.path("fr3", BASE, mesh=can, hand_time=0.0, speed=0.25)
    assert slow.duration == pytest.approx(4 * fast.duration, rel=1e-9)
    np.testing.assert_allclose(slow.sample([2.0]).positions, fast.sample([0.5]).positions, atol=1e-9)
    dense = fast.resampled(20_000)
    for one, other in (("positions", "velocities"), ("velocities", "accelerations")):
        # The derivative in the middle of two samples; within the time of a change of jerk the error is jerk * step.
        differences = np.diff(getattr(dense, one)[:-1], axis=0) * 20_000
        values = getattr(dense, other)[:-1]
        np.testing.assert_allclose(differences, (values[1:] + values[:-1]) / 2, atol=5000 / 20_000)
    rest = fast.sample([-1.0, fast.duration + 1.0])
    np.testing.assert_array_equal(rest.positions, fast.positions[[0, -1]])
    np.testing.assert_allclose(rest.velocities, 0.0, atol=1e-9)


def test_curves_keep_to_the_limits() -> None:
    """A spline with strong bends: its speeds are limited by accelerations and jerks across the line."""
    limits = replace(limits_of(Arm.named("fr3")), acceleration=np.full(7, 2.0), jerk=np.full(7, 10.0))
    s = np.linspace(0.0, 0.1, 21)
    postures = Arm.named("fr3").home + np.stack([np.sin(40 * s + i) * 0.1 for i in range(7)], axis=1)
    (piece,) = timed("approach", postures, s, limits)
    states = np.abs(piece.at(np.linspace(0, piece.duration, 20_000)))
    for row, limit in zip(states[1:], (limits.speed, limits.acceleration, limits.jerk), strict=True):
        assert (row <= limit).all()
    assert (states[3] / limits.jerk).max() > 0.3
    ends = piece.at(np.array([0.0, piece.duration]))[0]
    np.testing.assert_allclose(ends, postures[[0, -1]], atol=1e-9)
    # A jerk that leaves no room at these speeds: a slower one does.
    tight = replace(limits, acceleration=np.full(7, 20.0), jerk=np.full(7, 0.5))
    (slow,) = timed("approach", postures, s, tight)
    assert slow.duration > piece.duration
    assert (np.abs(slow.at(np.linspace(0, slow.duration, 20_000)))[3] <= tight.jerk).all()
    for count in (2, 3):
        (short,) = timed("approach", postures[:count], s[:count], limits)
        np.testing.assert_allclose(short.at(np.array([short.duration]))[0][0], postures[count - 1], atol=1e-9)


@pytest.mark.parametrize("line", [False, True], ids=["straight", "curve"])
def test_joints_slow_down_near_the_ends_of_their_ranges(line: bool) -> None:
    arm = Arm.named("fr3")
    limits, (low, high) = limits_of(arm), arm.joint_limits.T
    free = replace(limits, slowing=np.tile([-np.inf, np.inf, 1.0, 0.0], (7, 1)))
    s = np.linspace(0.0, 1.0, 41 if line else 2)
    # All joints move to an end, some to the least position; the curve wavers on its way.
    goal = np.where(np.arange(7) % 2, low, high)
    postures = arm.home + s[:, None] * (goal - arm.home) + 0.02 * np.sin(np.pi * s)[:, None] * np.sin(20 * s)[:, None]
    over = {}
    for name, given in (("slowed", limits), ("free", free)):
        (piece,) = timed("approach", postures, s if line else None, given)
        positions, velocities = piece.at(np.linspace(0.0, piece.duration, 20_000))[:2]
        over[name] = (np.abs(velocities) / limits.allowed(positions, velocities)).max(), piece.duration
    assert over["free"][0] > 1.5
    assert 0.5 < over["slowed"][0] <= 1.0
    assert over["slowed"][1] < 4 * over["free"][1]
    # Beyond the range no speed is left.
    beyond = postures.copy()
    beyond[-1, 3] = -0.14
    with pytest.raises(errors.PathError, match="in the phase 'approach' joint4 is at its limit") as stopped:
        timed("approach", np.linspace(beyond[-2], beyond[-1], 5), np.linspace(0.0, 0.1, 5), limits)
    assert stopped.value.reason == "at_limit"
    # At 0.1 rad from the end, by the formula of the maker; away from an end nothing is slowed.
    near = np.full((1, 7), high - 0.1)
    np.testing.assert_allclose(limits.allowed(near, np.ones((1, 7)))[0, 0], np.sqrt(12 * (2.7501 - near[0, 0])) - 0.3)
    np.testing.assert_array_equal(limits.allowed(near, -np.ones((1, 7)))[0, [0, 2, 4, 6]], limits.speed[[0, 2, 4, 6]])


def test_limits_that_an_arm_does_not_state_are_told_once(plan: graspbox.Plan, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("graspbox.arms.timing._TOLD", set())
    with pytest.warns(AssumedWarning, match="arm 'ur5e' states no jerk of shoulder_pan_joint, .* 14 rad/s3"):
        made = plan.path("ur5e", BASE)
    assert "states no jerk" in made.assumptions[0]
    assert plan.path("ur5e", BASE).assumptions == made.assumptions


def wall(center: tuple[float, float, float], size: tuple[float, float, float]) -> tuple[graspbox.Mesh, Any]:
    corners = np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)]) * size
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
    pose = np.eye(4)
    pose[:3, 3] = center
    return graspbox.mesh_from_arrays(corners, np.array(faces), name="wall"), pose


def test_failures_say_where_and_why(plan: graspbox.Plan, can: graspbox.Mesh) -> None:
    def failure(**options: Any) -> errors.PathError:
        with pytest.raises(errors.PathError) as caught:
            plan.path("fr3", BASE, mesh=can, **options)
        return caught.value

    start = failure(objects=[wall((-0.4, 0.0, 0.6), (0.4, 0.4, 0.05))])
    assert (start.phase, start.reason) == ("reach", "touches")
    assert "at the start link" in str(start)
    assert "touches wall" in str(start)
    beyond = failure(start=np.array([0, 0, 0, 1.0, 0, 0, 0]))
    assert str(beyond) == "no path to the grasp: at the start joint4 is beyond its limits"
    assert beyond.reason == "start_beyond_limit"
    lid = failure(objects=[wall((0.0, 0.0, 0.35), (0.6, 0.6, 0.02)), wall((-0.2, 0.0, 0.2), (0.02, 0.6, 0.3))])
    assert len(lid.failures) == plan.feasible.sum()
    assert lid.reason in {"touches", "no_way"}
    there = failure(place=placed_at(plan, -0.1, 0.3), objects=[wall((-0.1, 0.3, 0.1), (0.1, 0.1, 0.2))])
    assert str(there) == "no path to the grasp: at the place the carried object touches wall"
    assert (there.phase, there.reason) == ("lower", "touches")
    far = failure(place=placed_at(plan, 3.0, 0.0))
    assert "at the place too far" in str(far)
    long = failure(max_duration=1.0)
    assert long.reason == "too_long"
    assert "longer than max_duration (1 s)" in str(long)
    assert len(long.failures) == plan.feasible.sum()
    far_base = BASE.copy()
    far_base[0, 3] = -3.0
    with pytest.raises(errors.PathError, match=r"no path to any of \d+ grasps: at the grasp too far \(\d+\)"):
        plan.path("fr3", far_base, mesh=can)


def test_a_grasp_whose_path_takes_too_long_has_none(plan: graspbox.Plan) -> None:
    poses = plan.world_from_object @ plan.poses[plan.feasible][:8]
    preshapes = plan.preshape[plan.feasible][:8]

    def path(order: list[int], **options: Any) -> Trajectory:
        return plan_path("fr3", "panda_gripper", poses[order], preshapes[order], BASE, **options)

    by_duration = []
    for index in range(len(poses)):
        with contextlib.suppress(errors.PathError):
            by_duration.append((path([index]).duration, index))
    by_duration.sort()
    (fast, quick), (slow, long) = by_duration[0], by_duration[-1]
    between = 0.5 * (fast + slow)
    assert path([long, quick]).grasp == 0
    taken = path([long, quick], max_duration=between)
    assert (taken.grasp, taken.duration) == (1, fast)
    with pytest.raises(errors.PathError, match=r"the fastest of 2 paths takes .* s, longer than max_duration"):
        path([long, quick], max_duration=0.5 * fast)


def test_bad_arguments_are_named(plan: graspbox.Plan, can: graspbox.Mesh, monkeypatch: pytest.MonkeyPatch) -> None:
    def refused(match: str, error: type[Exception] = errors.ConfigError, arm: Any = "fr3", **options: Any) -> None:
        with pytest.raises(error, match=match):
            plan.path(arm, options.pop("base", BASE), **options)

    refused("place is the pose of the target", place=np.eye(4))
    refused("speed is 0", speed=0.0)
    refused("hand_time is -1", hand_time=-1.0)
    refused("max_duration is 0", max_duration=0.0)
    refused("hz is -1", hz=-1.0)
    refused("samples; at most 1000000", hz=1e9)
    refused("start has 6 values; give 7", start=np.zeros(6))
    refused("points have the shape", points=np.zeros((3, 2)))
    refused(
        "clearance is 0; it must be 0.001 to 1 m", config=graspbox.PathConfig(reach=graspbox.ReachConfig(clearance=0.0))
    )
    refused("standoff is 2", config=graspbox.PathConfig(standoff=2.0))
    refused("iterations is 2000000", config=graspbox.PathConfig(iterations=2_000_000))
    refused("config is .*; give a PathConfig", config=graspbox.ReachConfig())
    under = BASE.copy()
    under[2, 3] = -0.2
    refused("under the table", base=under)
    refused('weighs 0.76 kg, but arm "so101" carries 0.20 kg', errors.ArmError, arm="so101")
    none = replace(plan, feasible=np.zeros(len(plan), bool))
    with pytest.raises(errors.PlanError, match="no grasp of the plan is feasible"):
        none.path("fr3", BASE)
    monkeypatch.setattr(imports, "import_module", lambda name: (_ for _ in ()).throw(ModuleNotFoundError(name=name)))
    refused(r"timing a path needs the package ruckig.*pip install 'graspbox\[arm\]'", errors.MissingExtraError)


def test_points_are_obstacles_but_not_those_on_the_target(plan: graspbox.Plan, can: graspbox.Mesh) -> None:
    """What a camera sees of the target itself does not block the grasp; a wall of points does."""
    own = can.sample(2000, 0)[0] @ plan.world_from_object[:3, :3].T + plan.world_from_object[:3, 3]
    free = plan.path("fr3", BASE, mesh=can, points=own)
    assert free == plan.path("fr3", BASE, mesh=can)
    # Without a mesh, what the hand encloses is taken along.
    assert plan.path("fr3", BASE, points=own[own[:, 2] > 0.01]).duration > 0
    y, z = np.meshgrid(np.arange(-1.5, 1.5, 0.015), np.arange(0.02, 1.5, 0.015))
    seen = np.stack([np.full(y.size, -0.15), y.ravel(), z.ravel()], axis=1)
    with pytest.raises(errors.PathError, match="touches what is seen"):
        plan.path("fr3", BASE, mesh=can, points=seen)


def test_files_hold_the_samples(path: Trajectory, tmp_path: Path) -> None:
    for name in ("a.npz", "a.csv", "a.json", "a.yaml", "a.yml"):
        path.save(tmp_path / name)
    with np.load(tmp_path / "a.npz") as arrays:
        for name in ("times", "positions", "velocities", "accelerations", "hand", "phases"):
            np.testing.assert_array_equal(arrays[name], getattr(path, name))
        assert json.loads(str(arrays["facts"]))["joints"] == list(path.joints)
    with (tmp_path / "a.csv").open() as file:
        rows = list(csv.reader(file))
    assert rows[0][:2] == ["time", "joint1.position"]
    assert rows[0][-3:] == ["hand", "preshape", "phase"]
    assert {float(row[-2]) for row in rows[1:]} == {path.preshape}
    assert len(rows) == len(path) + 1
    np.testing.assert_array_equal(np.array([row[1:8] for row in rows[1:]], float), path.positions)
    read = json.loads((tmp_path / "a.json").read_text())
    np.testing.assert_array_equal(read["velocities"], path.velocities)
    assert read["duration"] == path.duration
    path.save(tmp_path / "ros.json", format="ros")
    for message in (yaml.safe_load((tmp_path / "a.yaml").read_text()), json.loads((tmp_path / "ros.json").read_text())):
        assert list(message) == ["header", "joint_names", "points"]
        assert message["joint_names"] == list(path.joints)
        assert list(message["points"][0]) == ["positions", "velocities", "accelerations", "effort", "time_from_start"]
        stamps = [point["time_from_start"] for point in message["points"]]
        np.testing.assert_allclose([t["sec"] + 1e-9 * t["nanosec"] for t in stamps], path.times, atol=2e-9)
        np.testing.assert_array_equal([point["positions"] for point in message["points"]], path.positions)
    with pytest.raises(errors.ConfigError, match=r"no file with the suffix '.txt'"):
        path.save(tmp_path / "a.txt")
    with pytest.raises(errors.ConfigError, match=r"no file with the format 'bag'"):
        path.save(tmp_path / "a.json", format="bag")
    with pytest.raises(errors.FileError):
        path.save(tmp_path / "a.csv" / "b.csv")


def test_the_command_writes_a_trajectory_or_says_why_not(tmp_path: Path) -> None:
    out = tmp_path / "path.csv"
    words = ["arm", "path", "procedural:can:3", "--base", "-0.5", "0", "0", "0"]
    made = invoke([*words, "--out", str(out), "--place", "0", "0.3", "90", "--json", "--prefix", "fr3_"])
    assert made.exit_code == 0, made.output
    answer = json.loads(made.stdout)
    assert answer["object"].startswith("can")
    assert set(answer["phases"]) == set(CARRIES)
    assert len(out.read_text().splitlines()) == len(answer["times"]) + 1
    assert out.read_text().startswith("time,fr3_joint1.position,")
    assert answer["joints"][0] == "joint1"
    shown = invoke([*words, "--seed", "3"])
    assert shown.exit_code == 0, shown.output
    assert "approach" in shown.stdout
    far = invoke(["arm", "path", "procedural:can:3", "--base", "-3", "0", "0", "0"])
    assert far.exit_code == 1
    assert "too far" in far.output
    heavy = invoke([*words, "--arm", "so101"])
    assert heavy.exit_code == 2
    assert "carries 0.20 kg" in heavy.output
    for wrong, message in (
        (["--prefix", "fr3_"], "--out; pass it too"),
        (["--json", "--view"], "leave one of them out"),
    ):
        refused = invoke([*words, *wrong])
        assert isinstance(refused.exception, errors.ConfigError)
        assert message in str(refused.exception)
    suffix = invoke([*words, "--out", str(tmp_path / "path.bag")])
    assert isinstance(suffix.exception, errors.ConfigError)
    assert ".yaml" in str(suffix.exception)
