"""Meshes, boxes and trials through the boundary: shapes, frames, errors, determinism."""

import contextlib
from pathlib import Path
from typing import Literal

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import graspbox
from graspbox import _core, errors, object_sets

CUBE = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], dtype=float)
CUBE_FACES = [
    [0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1],
    [2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3],
]  # fmt: skip


def cuboid(x: float, y: float, z: float, mass: float = 0.2) -> graspbox.Mesh:
    """Make a box on the table, centred over its origin."""
    corners = (CUBE - [0.5, 0.5, 0.0]) * [x, y, z]
    return graspbox.mesh_from_arrays(corners, CUBE_FACES, name="cuboid", mass=mass)


def from_above(height: float) -> np.ndarray:
    """Hand pose with the palm facing down at a height above the table."""
    pose = np.diag([1.0, -1.0, -1.0, 1.0])
    pose[2, 3] = height
    return pose


def test_mass_properties_of_a_cuboid() -> None:
    mesh = cuboid(0.1, 0.2, 0.3, mass=0.6)
    assert mesh.volume == pytest.approx(0.006)
    assert mesh.area == pytest.approx(0.22)
    assert mesh.watertight
    np.testing.assert_allclose(mesh.center_of_mass, [0, 0, 0.15], atol=1e-12)
    expected = 0.6 / 12 * np.array([0.2**2 + 0.3**2, 0.1**2 + 0.3**2, 0.1**2 + 0.2**2])
    np.testing.assert_allclose(mesh.inertia, np.diag(expected), atol=1e-12)
    np.testing.assert_allclose(mesh.bounds, [[-0.05, -0.1, 0], [0.05, 0.1, 0.3]])


def test_arrays_are_fresh() -> None:
    mesh = cuboid(0.1, 0.1, 0.1)
    assert not np.shares_memory(mesh.vertices, mesh.vertices)
    mesh.vertices[:] = 0.0
    assert mesh.vertices.max() > 0.0
    assert mesh.vertices.flags.c_contiguous
    assert mesh.faces.dtype == np.uint32


def test_samples_lie_on_the_surface() -> None:
    points, normals = cuboid(0.1, 0.2, 0.3).sample(500, 3)
    assert points.shape == normals.shape == (500, 3)
    off = np.abs(np.abs(points - [0, 0, 0.15]) - [0.05, 0.1, 0.15]).min(axis=1)
    assert off.max() < 1e-12
    np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1.0)


def test_resting_poses_of_a_cuboid() -> None:
    poses, probabilities = cuboid(0.1, 0.2, 0.3).resting_poses()
    assert poses.shape == (6, 4, 4)
    assert probabilities.sum() == pytest.approx(1.0)
    assert (np.diff(probabilities) <= 1e-12).all()


def test_least_width_of_a_cuboid_in_plan_view() -> None:
    mesh = cuboid(0.1, 0.2, 0.3)
    poses, _ = mesh.resting_poses()
    found = {round(mesh.least_width(pose), 6) for pose in poses}
    assert found == {0.1, 0.2}, "on its smallest and middle faces 0.1, on the largest 0.2"
    with pytest.raises(errors.ConfigError, match="world_from_object"):
        mesh.least_width(np.eye(3))


@pytest.mark.parametrize(
    ("vertices", "faces", "complaint"),
    [
        (CUBE[:, :2], CUBE_FACES, r"vertices has shape \[8, 2\]; give \(n, 3\)"),
        (CUBE * np.nan, CUBE_FACES, "finite"),
        (CUBE, [[0, 1]], "give"),
        (CUBE, [[0, 1, 99]], "vertex 99"),
        (CUBE, [[0, 1, -2]], "start at 0"),
        (CUBE, np.array(CUBE_FACES, dtype=float), "integers"),
        (CUBE, np.zeros((0, 3), dtype=int), "no triangles"),
    ],
)
def test_bad_arrays_are_named(vertices: np.ndarray, faces: object, complaint: str) -> None:
    with pytest.raises(errors.GraspboxError, match=complaint) as caught:
        graspbox.mesh_from_arrays(vertices, faces)  # type: ignore[arg-type]
    assert isinstance(caught.value, ValueError)


def test_files_that_are_no_meshes(tmp_path: Path) -> None:
    with pytest.raises(OSError, match="No such file") as caught:
        graspbox.load_mesh(tmp_path / "none.stl")
    assert isinstance(caught.value, graspbox.GraspboxError)
    assert caught.value.errno == 2
    (tmp_path / "empty.stl").touch()
    (tmp_path / "cut.stl").write_bytes(b"\0" * 80 + b"\xff\xff\0\0" + b"\0" * 10)
    (tmp_path / "word.doc").write_text("hello")
    for name in ("empty.stl", "cut.stl", "word.doc"):
        with pytest.raises(errors.MeshError, match=name):
            graspbox.load_mesh(tmp_path / name)


def test_box_of_a_cuboid_is_the_cuboid() -> None:
    (box,) = graspbox.decompose(cuboid(0.1, 0.2, 0.3), max_boxes=1)
    assert box.volume == pytest.approx(0.006, rel=1e-3)
    np.testing.assert_allclose(np.sort(box.half_extents), [0.05, 0.1, 0.15], atol=1e-4)
    np.testing.assert_allclose(box.axes.T @ box.axes, np.eye(3), atol=1e-9)
    assert box.contains(box.corners(), 1e-9).all()


@pytest.mark.parametrize("fit", ["minimum", "pca"])
def test_leaves_cover_the_surface(fit: Literal["minimum", "pca"]) -> None:
    mesh = object_sets.load("procedural:mug:1")[0].load()
    tree = graspbox.decompose(mesh, fit=fit, max_boxes=6)
    assert 1 < len(tree) <= 6
    assert len(tree.nodes) == 2 * len(tree) - 1
    points, _ = mesh.sample(2000, 5)
    assert np.any([box.contains(points, 1e-6) for box in tree], axis=0).all()


def test_bad_settings_are_named() -> None:
    mesh = cuboid(0.1, 0.1, 0.1)
    with pytest.raises(errors.ConfigError, match="area_gain"):
        graspbox.decompose(mesh, area_gain=2.0)
    with pytest.raises(errors.ConfigError, match=r"DecomposeConfig\.fit is 'best' \(str\); give 'pca' or 'minimum'"):
        graspbox.decompose(mesh, fit="best")  # type: ignore[arg-type]
    with pytest.raises(TypeError, match="DecomposeConfig has no field 'max_box'; did you mean 'max_boxes'"):
        graspbox.decompose(mesh, max_box=3)  # type: ignore[call-arg]
    scene = graspbox.Scene(mesh)
    with pytest.raises(errors.ConfigError, match="lift_height"):
        scene.simulate(from_above(0.3)[None], 0.0, config=graspbox.TrialConfig(lift_height=0.01))
    with pytest.raises(errors.ConfigError, match="dt"):
        graspbox.Scene(mesh, physics=graspbox.PhysicsConfig(dt=1.0))


def test_scene_is_at_rest_where_the_file_stands() -> None:
    scene = graspbox.Scene(cuboid(0.06, 0.06, 0.1))
    np.testing.assert_allclose(scene.world_from_object, np.eye(4), atol=2e-3)
    assert scene.name == "cuboid"
    lying = np.array([[1, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 0.03], [0, 0, 0, 1.0]])
    laid = graspbox.Scene(cuboid(0.06, 0.06, 0.1), world_from_object=lying)
    np.testing.assert_allclose(laid.world_from_object[:3, :3], lying[:3, :3], atol=2e-2)


@pytest.mark.parametrize("wrong", [np.zeros((4, 4)), np.eye(3), np.diag([1.0, 1.0, -1.0, 1.0]), 2 * np.eye(4)])
def test_poses_must_be_rigid(wrong: np.ndarray) -> None:
    scene = graspbox.Scene(cuboid(0.06, 0.06, 0.1))
    with pytest.raises(errors.ConfigError, match="pose"):
        scene.simulate(wrong[None], 0.0)
    with pytest.raises(errors.ConfigError, match="world_from_object"):
        graspbox.Scene(cuboid(0.06, 0.06, 0.1), world_from_object=wrong)


def test_is_rigid_says_which_poses_are_taken() -> None:
    """The limit is the rounding of a matrix that was printed with six digits."""
    skewed = [np.eye(4) + np.diag([off, 0.0, 0.0, 0.0]) for off in (4e-6, 6e-6)]
    reflected, other_row, no_number = (
        np.diag([1.0, 1.0, -1.0, 1.0]),
        np.diag([1.0, 1.0, 1.0, 2.0]),
        np.full((4, 4), np.nan),
    )
    poses = np.stack([*skewed, reflected, other_row, no_number, np.eye(4)])
    np.testing.assert_array_equal(_core.is_rigid(poses), [True, False, False, False, False, True])
    assert _core.is_rigid(np.zeros((0, 4, 4))).shape == (0,)
    with pytest.raises(errors.ConfigError, match=r"poses has shape \[4, 4\]; give \(n, 4, 4\)"):
        _core.is_rigid(np.eye(4))


def test_outcomes_do_not_depend_on_the_number_of_threads() -> None:
    scene = graspbox.Scene(object_sets.load("procedural:can:1")[0].load())
    height = scene.mesh.bounds[1, 2]
    poses = np.stack([from_above(height + 0.005 + 0.01 * i) for i in range(4)])
    outs = [scene.simulate(poses, np.zeros(4), num_threads=n) for n in (1, 2, 2)]
    for name in ("success", "secure", "failure", "lift", "kindness_rate", "time"):
        first, *others = (getattr(out, name) for out in outs)
        assert all((first == other).all() for other in others), name
    alone = scene.simulate(poses[2:3], 0.0)
    assert alone.lift[0] == outs[0].lift[2]


def test_scores_are_the_weighted_features() -> None:
    mesh = object_sets.load("procedural:bottle:1")[0].load()
    plan = graspbox.plan(mesh, features=True)
    weights = graspbox.planning.rank_weights()
    assert plan.features is not None
    assert plan.features.shape == (len(plan), len(weights))
    np.testing.assert_array_equal(np.isnan(plan.features).any(axis=1), ~plan.feasible)
    best = plan.best(200)
    assert best.features is not None
    lowered = best.features @ list(weights.values()) - best.score
    assert lowered[0] == pytest.approx(0.0, abs=1e-9)
    assert (lowered > -1e-9).all()
    steps = lowered[lowered > 1e-9].min()
    np.testing.assert_allclose(lowered / steps, np.round(lowered / steps), atol=1e-6)
    assert graspbox.plan(mesh).features is None


def test_trace_tells_the_trial() -> None:
    scene = graspbox.Scene(cuboid(0.06, 0.06, 0.12, mass=0.1))
    outcome, trace = scene.trace(from_above(0.14), 0.0)
    assert len(outcome) == 1
    assert np.isfinite(outcome.kindness).all()
    t = len(trace.time)
    assert trace.world_from_hand.shape == (t, 4, 4)
    assert trace.joints.shape == (t, len(scene.hand.joints))
    assert trace.actuators.shape == trace.loads.shape == (t, 4)
    assert trace.tensions.shape == (t, 3)
    np.testing.assert_array_equal(trace.loads[:, :3], trace.tensions)
    np.testing.assert_allclose(np.diff(trace.time), 0.01, atol=1e-9)
    assert trace.world_from_hand[-1, 2, 3] - trace.world_from_hand[0, 2, 3] == pytest.approx(0.20, abs=1e-3)


@pytest.mark.parametrize(("engine", "tolerance"), [("implicit", 1e-4), ("rapier", 0.05)])
def test_contact_forces_of_a_trace_carry_the_object(engine: Literal["implicit", "rapier"], tolerance: float) -> None:
    """In the hold they balance its weight; friction stays within its cone, and normal parts add up to `hand_force`."""
    mesh = cuboid(0.06, 0.06, 0.12, mass=0.1)
    scene = graspbox.Scene(mesh, physics=graspbox.PhysicsConfig(engine=engine))
    outcome, trace = scene.trace(from_above(0.14), 0.0)
    assert outcome.success[0]
    assert trace.tactile.shape == (len(trace.time), 27)
    assert trace.tactile.any()
    normal = np.sum(trace.contact_forces * trace.contact_normals, axis=1)
    across = np.linalg.norm(trace.contact_forces - normal[:, None] * trace.contact_normals, axis=1)
    assert (across <= 1.02 * normal + 0.02).all()  # the pads have a friction of 1
    sums = np.bincount(trace.contact_samples, normal, len(trace.time))
    np.testing.assert_allclose(sums, trace.hand_force, rtol=1e-2, atol=1e-3)
    held = trace.contacts(len(trace.time) - 1)
    points, forces = trace.contact_points[held], trace.contact_forces[held]
    weight = 0.1 * 9.81
    np.testing.assert_allclose(forces.sum(axis=0), [0.0, 0.0, weight], atol=tolerance * weight)
    pose = trace.world_from_object[-1]
    arms = points - (pose[:3, :3] @ mesh.center_of_mass + pose[:3, 3])
    np.testing.assert_allclose(np.cross(arms, forces).sum(axis=0), 0.0, atol=tolerance * weight * 0.06)
    # The points are on the surface of the box, and on the shapes that they name.
    local = (points - pose[:3, 3]) @ pose[:3, :3]
    assert np.abs(np.abs(local - [0, 0, 0.06]) - [0.03, 0.03, 0.06]).min(axis=1).max() < 1e-3
    frames, halves, _, _ = scene.hand.shapes(trace.joints[-1].copy())
    frames = trace.world_from_hand[-1] @ frames[trace.contact_shapes[held]]
    inside = np.einsum("nji,nj->ni", frames[:, :3, :3], points - frames[:, :3, 3])
    assert (np.abs(inside) <= halves[trace.contact_shapes[held]] + 1e-3).all()


def test_trace_of_an_infeasible_pose_is_empty() -> None:
    """A trace judges a pose as `simulate` does: here the palm stands inside the object, or meets it on the way."""
    scene = graspbox.Scene(cuboid(0.06, 0.06, 0.12))
    inside = from_above(0.05)
    sideways = np.array([[0.0, 0.0, -1.0, 0.0], [0.0, 1.0, 0.0, 0.0], [1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]])
    sideways[:3, 3] = [-0.05, 0.0, 0.06]
    poses = np.stack([inside, sideways])
    assert list(scene.simulate(poses, 0.0).failure) == ["infeasible", "infeasible"]
    for pose in poses:
        outcome, trace = scene.trace(pose, 0.0)
        assert list(outcome.failure) == ["infeasible"]
        assert not outcome.success[0]
        assert outcome.time[0] == 0.0
        assert trace.time.shape == trace.distance.shape == trace.hand_force.shape == (0,)
        assert trace.world_from_hand.shape == trace.world_from_object.shape == (0, 4, 4)
        assert trace.joints.shape == (0, 7)
        assert trace.tensions.shape == (0, 3)
        assert trace.contact_points.shape == trace.contact_forces.shape == (0, 3)
        assert trace.contacts(0) == slice(0, 0)


def test_hand_from_its_files(tmp_path: Path) -> None:
    hand = graspbox.load_hand()
    assert hand.name.lower() == "reflex"
    assert len(hand.chains) == 3
    assert len(hand.joints) == len(hand.joint_chains) == len(hand.joint_limits) == 7
    assert hand.actuators == ["finger_1", "finger_2", "finger_3", "preshape"]
    assert hand.closing_speeds == [3.0] * 3
    np.testing.assert_allclose(hand.preshape_limits, (0.0, np.pi / 2))
    np.testing.assert_array_equal(hand.open(0.7), [0.7, 0, 0, 0, 0, 0, 0])
    np.testing.assert_allclose(hand.closed(0.7, 1.0)[1:], hand.joint_limits[1:, 1])
    poses, halves, pads, joints = hand.shapes(hand.open(0.0))
    frames, chains, revolute = hand.joint_frames(hand.open(0.0))
    assert len(frames) == len(chains) == len(revolute) == 8, "swivel 2 follows swivel 1"
    assert set(joints) == {-1, 1, 2, 4, 5, 6, 7}, "swivels have no shapes"
    assert poses.shape == (len(halves), 4, 4)
    assert pads.any()
    assert not pads.all()
    with pytest.raises(errors.ConfigError, match="no hand"):
        graspbox.load_hand("claw")
    with pytest.raises(OSError, match="No such file"):
        graspbox.load_hand((tmp_path / "a.urdf", tmp_path / "hand.toml"))
    (tmp_path / "a.urdf").write_text("<robot/>")
    (tmp_path / "hand.toml").write_text("")
    with pytest.raises(errors.HandError):
        graspbox.load_hand((tmp_path / "a.urdf", tmp_path / "hand.toml"))


@settings(max_examples=20, deadline=None)
@given(st.binary(max_size=300))
def test_no_bytes_crash_the_reader(tmp_path_factory: pytest.TempPathFactory, data: bytes) -> None:
    path = tmp_path_factory.mktemp("fuzz") / "x.stl"
    path.write_bytes(b"solid x\n" + data)
    with contextlib.suppress(errors.MeshError, errors.ConfigError):
        graspbox.load_mesh(path)
