"""Trials in a scene of several objects: the trace has the motion of all of them, and every picture of it shows them."""

import pickle
from collections.abc import Iterator
from dataclasses import replace
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Any
from unittest.mock import MagicMock

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image

import graspbox
from graspbox import Mesh, Plan, Scene, Trace, errors
from graspbox.learn.models.scenes import PlacedObjects
from graspbox.meshes import mesh_from_arrays
from graspbox.simulation.outcomes import Outcomes

HAND = "panda_gripper"
#: Index of the tower, on which the cap stands; the cube stands elsewhere.
CAP, TOWER, CUBE = range(3)
#: The cap and the cube among the other objects of the scene.
OTHER_CAP, OTHER_CUBE = range(2)


def cuboid(name: str, *half: float) -> Mesh:
    corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) * half
    sides = ((0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3))
    faces = [face for a, b, c, d in sides for face in ((a, b, c), (a, c, d))]
    return mesh_from_arrays(corners, np.array(faces), name=name)


def at(x: float, y: float, z: float) -> NDArray[np.float64]:
    pose = np.eye(4)
    pose[:3, 3] = x, y, z
    return pose


@pytest.fixture(scope="module")
def placed() -> PlacedObjects:
    meshes = cuboid("cap", 0.015, 0.015, 0.015), cuboid("tower", 0.02, 0.02, 0.06), cuboid("cube", 0.02, 0.02, 0.02)
    poses = np.stack([at(0.0, 0.0, 0.135), at(0.0, 0.0, 0.06), at(0.0, 0.16, 0.02)])
    return PlacedObjects(meshes, poses, np.stack([at(0.1, 0.0, 0.03)]), np.array([[0.005, 0.2, 0.03]]))


@pytest.fixture(scope="module")
def scene(placed: PlacedObjects) -> Scene:
    return Scene.of(placed, target=TOWER, hand=HAND)


@pytest.fixture(scope="module")
def plan(scene: Scene) -> Plan:
    walls = scene.world_from_walls, scene.wall_half_extents
    others = PlacedObjects(scene.others, scene.world_from_others, *walls)
    found = graspbox.plan(scene.mesh, hand=HAND, world_from_object=scene.world_from_object, neighbours=others)
    return found.best(1)


@pytest.fixture(scope="module")
def traced(scene: Scene, plan: Plan) -> tuple[Outcomes, Trace]:
    outcomes, trace = scene.trace(plan[0])
    assert outcomes.success[0]
    return outcomes, trace


def test_a_scene_names_its_other_objects(scene: Scene, placed: PlacedObjects) -> None:
    assert (scene.target, scene.name) == (TOWER, "tower")
    assert [mesh.name for mesh in scene.others] == ["cap", "cube"]
    np.testing.assert_allclose(scene.world_from_others, placed.world_from_objects[[CAP, CUBE]], atol=1e-12)
    np.testing.assert_array_equal(scene.world_from_walls, placed.world_from_walls)
    np.testing.assert_array_equal(scene.wall_half_extents, placed.wall_half_extents)
    copy = pickle.loads(pickle.dumps(scene))
    assert [mesh.name for mesh in copy.others] == ["cap", "cube"]
    np.testing.assert_array_equal(copy.world_from_others, scene.world_from_others)


def test_a_single_object_has_no_others() -> None:
    alone = Scene(cuboid("cube", 0.02, 0.02, 0.02), hand=HAND)
    assert (alone.target, alone.others, alone.world_from_others.shape) == (0, (), (0, 4, 4))
    assert (alone.world_from_walls.shape, alone.wall_half_extents.shape) == ((0, 4, 4), (0, 3))
    plan = graspbox.plan(alone.mesh, hand=HAND, world_from_object=alone.world_from_object).best(1)
    _, trace = alone.trace(plan[0])
    assert len(trace.time) > 100
    assert trace.world_from_others.shape == (len(trace.time), 0, 4, 4)
    _, nothing = alone.trace(np.eye(4), 0.0)
    assert nothing.world_from_others.shape == (0, 0, 4, 4)


def test_a_trace_has_the_motion_of_the_others(scene: Scene, traced: tuple[Outcomes, Trace]) -> None:
    """The cap rides on the tower, which is lifted; nothing touches the cube."""
    outcomes, trace = traced
    assert trace.world_from_others.shape == (len(trace.time), 2, 4, 4)
    assert trace.world_from_others.dtype == np.float64
    np.testing.assert_allclose(trace.world_from_others[0], scene.world_from_others, atol=1e-12)
    rise = trace.world_from_object[-1, 2, 3] - trace.world_from_object[0, 2, 3]
    assert rise == pytest.approx(outcomes.lift[0], abs=1e-3)
    cap, cube = (trace.world_from_others[:, index] for index in (OTHER_CAP, OTHER_CUBE))
    assert cap[-1, 2, 3] - cap[0, 2, 3] == pytest.approx(rise, abs=2e-3)
    np.testing.assert_allclose(cube, np.broadcast_to(cube[0], cube.shape), atol=1e-6)


def test_a_neighbour_that_is_grasped_instead_moves(placed: PlacedObjects) -> None:
    """Without a target the highest object is the scene's, the cap; the trace keeps to it while the tower is grasped."""
    any_target, own = Scene.of(placed, hand=HAND), Scene.of(placed, target=TOWER, hand=HAND)
    assert (any_target.target, [mesh.name for mesh in any_target.others]) == (CAP, ["tower", "cube"])
    others = PlacedObjects(own.others, own.world_from_others)
    plan = graspbox.plan(own.mesh, hand=HAND, world_from_object=own.world_from_object, neighbours=others).best(1)
    cap_from_tower = np.linalg.inv(any_target.world_from_object) @ own.world_from_object
    outcomes, trace = any_target.trace(cap_from_tower @ plan.poses[0], float(plan.preshape[0]))
    assert outcomes.success[0]
    steps = np.abs(np.diff(trace.world_from_object[:, :3, 3], axis=0)).max()
    assert steps < 0.02, "the pose is that of one object at all times"
    towers = trace.world_from_others[:, 0, 2, 3]
    assert towers[-1] - towers[0] > 0.15
    np.testing.assert_allclose(trace.world_from_object[:, 2, 3] - towers, 0.075, atol=3e-3)


# --- pictures --------------------------------------------------------------------------------------------------------


def test_pictures_show_all_objects_where_they_are(scene: Scene, traced: tuple[Outcomes, Trace], tmp_path: Path) -> None:
    trials = import_module("graspbox.pictures.trials")
    outcomes, trace = traced
    tower, cap, cube, wall = trials.objects_at(scene, trace, -1)
    assert [solid.mesh.name for solid in (tower, cap, cube, wall)] == ["tower", "cap", "cube", "wall"]
    assert len({solid.color for solid in (tower, cap, cube, wall)}) == 4
    np.testing.assert_array_equal(tower.world_from_mesh, trace.world_from_object[-1])
    np.testing.assert_array_equal(cap.world_from_mesh, trace.world_from_others[-1, OTHER_CAP])
    np.testing.assert_array_equal(cube.world_from_mesh, trace.world_from_others[-1, OTHER_CUBE])
    trial = trials.Trial(0, 0.0, outcomes, trace)
    trials.save_stages(tmp_path / "stages.png", scene, [trial])
    picture = np.asarray(Image.open(tmp_path / "stages.png").convert("RGB")).astype(int)
    blue = (picture[..., 2] > picture[..., 0] + 25) & (picture[..., 2] > 120)
    quarter = picture.shape[1] // 4
    heights = [np.nonzero(part)[0].min() for part in (blue[:, :quarter], blue[:, 3 * quarter :])]
    assert heights[1] < heights[0] - 20, "the cap is higher in the last stage"


def test_a_trial_is_saved_as_a_video(scene: Scene, traced: tuple[Outcomes, Trace], tmp_path: Path) -> None:
    pictures = import_module("graspbox.pictures")
    outcomes, trace = traced
    trial = pictures.Trial(0, 0.0, outcomes, trace)
    pictures.save_trial(tmp_path / "trial.gif", scene, trial, size=(96, 80))
    with Image.open(tmp_path / "trial.gif") as video:
        frames: Any = video
        assert frames.n_frames == round(10 * float(trace.time[-1])) + 1
        assert frames.size[0] == 96
    infeasible = pictures.Trial(0, 0.0, outcomes, scene.trace(np.eye(4), 0.0)[1])
    with pytest.raises(errors.ConfigError, match="pose 1 is infeasible: nothing moved, so there is no video to show"):
        pictures.save_trial(tmp_path / "none.gif", scene, infeasible)
    with pytest.raises(errors.ConfigError, match="size is"):
        pictures.save_trial(tmp_path / "none.gif", scene, trial, size=(0, 80))
    assert [path.name for path in tmp_path.iterdir()] == ["trial.gif"]


# --- recordings ------------------------------------------------------------------------------------------------------


def test_a_recording_has_the_motion_of_the_others(scene: Scene, plan: Plan) -> None:
    of_trial = import_module("graspbox.tools.rerun.motions").of_trial
    motion = of_trial(scene, plan.poses[0], float(plan.preshape[0]))
    assert [mesh.name for mesh in motion.others] == ["cap", "cube"]
    assert motion.world_from_others.shape == (len(motion.time), 2, 4, 4)
    assert motion.scalars["lift_of_others/0"][-1] > 0.15
    assert abs(motion.scalars["lift_of_others/1"][-1]) < 1e-3
    still = of_trial(scene, np.eye(4), 0.0)
    np.testing.assert_array_equal(still.world_from_others, scene.world_from_others[None])


def test_the_others_of_an_earlier_episode_disappear(scene: Scene, plan: Plan, monkeypatch: pytest.MonkeyPatch) -> None:
    """Rerun itself is replaced here; its own reader is asked in `test_rerun`."""
    recording, motions = import_module("graspbox.tools.rerun.recording"), import_module("graspbox.tools.rerun.motions")
    rr, stream = MagicMock(), MagicMock()
    monkeypatch.setattr(recording, "sdk", lambda: rr)

    def logged(thing: MagicMock) -> set[str]:
        return {call.args[0] for call in stream.log.call_args_list if call.args[1] is thing.return_value}

    recorder = recording.RecordingWriter(stream)
    motion = motions.of_trial(scene, plan.poses[0], float(plan.preshape[0]))
    recorder.motion(motion)
    assert {"world/object", "world/others/0", "world/others/1"} <= logged(rr.Mesh3D)
    assert {"world/others/0", "world/others/1"} <= {call.args[0] for call in stream.send_columns.call_args_list}
    moves = [call.kwargs["translation"] for call in rr.Transform3D.columns.call_args_list]
    assert any(np.array_equal(move, motion.world_from_others[:, OTHER_CAP, :3, 3]) for move in moves)
    assert "world/walls" in logged(rr.Boxes3D)
    np.testing.assert_allclose(rr.Boxes3D.call_args.kwargs["quaternions"], [[0.0, 0.0, 0.0, 1.0]])
    assert not logged(rr.Clear)
    none = {"others": (), "world_from_others": np.zeros((len(motion.time), 0, 4, 4))}
    alone = replace(motion, **none, world_from_walls=np.zeros((0, 4, 4)), wall_half_extents=np.zeros((0, 3)))
    recorder.motion(alone)
    assert logged(rr.Clear) == {"world/others/0", "world/others/1", "world/walls"}


# --- viewer ----------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def viewer(scene: Scene) -> Iterator[Any]:
    if find_spec("viser") is None:
        pytest.skip("the viewer needs viser, from the extra 'view'")
    with import_module("graspbox.tools.viewer").show(scene, port=0, poses=0) as shown:
        yield shown


def test_the_player_moves_the_others(viewer: Any, scene: Scene) -> None:
    page = viewer.page
    cap, cube = page.around.nodes
    np.testing.assert_allclose([cap.position, cube.position], scene.world_from_others[:, :3, 3], atol=1e-9)
    assert viewer.canvas.scene.get_handle_by_name("/walls") is not None
    page.select(0)
    trace = page.player.trace
    page.player.playback.seek(len(trace.time) - 1)
    np.testing.assert_allclose(cap.position, trace.world_from_others[-1, OTHER_CAP, :3, 3])
    assert cap.position[2] > 0.3
    page.select(int(np.flatnonzero(~page.plan.feasible)[0]))
    np.testing.assert_allclose(cap.position, scene.world_from_others[OTHER_CAP, :3, 3], atol=1e-9)


def test_an_arrangement_is_shown_as_a_scene() -> None:
    pytest.importorskip("viser", reason="the viewer needs viser, from the extra 'view'")
    meshes = [spec.load() for spec in graspbox.object_sets.load("procedural:can:0-3")]
    found = graspbox.arrange(meshes, "packed", seed=0, hand=HAND)
    with import_module("graspbox.tools.viewer").show(found, port=0, poses=0, hand=HAND) as shown:
        page: Any = shown.page
        assert len(page.around.nodes) == len(found) - 1
        assert page.scene.hand.name == HAND


def test_a_trace_can_be_pickled(traced: tuple[Outcomes, Trace]) -> None:
    _, trace = traced
    assert pickle.loads(pickle.dumps(trace)) == trace
