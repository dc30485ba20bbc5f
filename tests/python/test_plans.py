"""Plans and outcomes can be split, saved, pickled and simulated."""

import contextlib
import copy
import json
import os
import pickle
import stat
from dataclasses import fields, replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any, get_type_hints

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import graspbox
from graspbox import errors, object_sets, planning
from graspbox.planning.plan_files import mesh_hash

COLUMNS = ("poses", "preshape", "feasible", "score", "box", "face", "touch", "press")


@pytest.fixture(scope="module")
def can() -> graspbox.Mesh:
    return object_sets.load("procedural:can:0")[0].load()


@pytest.fixture(scope="module")
def scene(can: graspbox.Mesh) -> graspbox.Scene:
    return graspbox.Scene(can)


@pytest.fixture(scope="module")
def plan(scene: graspbox.Scene) -> graspbox.Plan:
    return graspbox.plan(scene.mesh, world_from_object=scene.world_from_object, features=True)


def same(first: graspbox.Plan, second: graspbox.Plan) -> None:
    """Compare two plans bit for bit."""
    for name in (*COLUMNS, "world_from_object", "features"):
        a, b = getattr(first, name), getattr(second, name)
        assert a.dtype == b.dtype, name
        np.testing.assert_array_equal(a, b, err_msg=name)
    assert [getattr(first, n) for n in ("name", "mesh_sha256", "hand_name")] == [
        getattr(second, n) for n in ("name", "mesh_sha256", "hand_name")
    ]
    np.testing.assert_array_equal(first.tree.children, second.tree.children)
    np.testing.assert_array_equal(first.tree.depth, second.tree.depth)
    for a, b in zip(first.tree.nodes, second.tree.nodes, strict=True):
        for f in fields(a):
            np.testing.assert_array_equal(getattr(a, f.name), getattr(b, f.name))


def test_equal_contents_are_equal(scene: graspbox.Scene, plan: graspbox.Plan, tmp_path: Path) -> None:
    """A plan that was saved and loaded was once not equal to itself."""
    plan.save(tmp_path / "plan.json")
    again = graspbox.Plan.load(tmp_path / "plan.json")
    assert again == plan
    assert np.isnan(plan.features[~plan.feasible]).all() if plan.features is not None else False
    for other in (plan[:-1], plan[::-1], replace(plan, name="x"), replace(plan, features=None), 4, None):
        assert plan != other
        assert other != plan
    for name in COLUMNS:
        changed = getattr(plan, name).copy()
        changed[7] = ~changed[7] if changed.dtype == bool else changed[7] + 1
        assert replace(plan, **{name: changed}) != plan, name
    assert (again[3], again.tree, again.tree[0]) == (plan[3], plan.tree, plan.tree[0])
    assert plan[3] != plan[4]
    boxes = plan.tree.nodes
    assert replace(plan.tree, nodes=(*boxes[:-1], replace(boxes[-1], center=boxes[-1].center + 1e-9))) != plan.tree
    assert plan.tree[0] in again.tree
    trace, voxels = scene.trace(plan[0])[1], graspbox.voxelize(scene.mesh, 4)
    views = graspbox.views(scene.mesh, count=1, image_size=16)
    assert trace == scene.trace(plan[0])[1] != scene.trace(plan[1])[1]
    assert voxels == graspbox.voxelize(scene.mesh, 4) != graspbox.voxelize(scene.mesh, 4, "surface")
    assert views == graspbox.views(scene.mesh, count=1, image_size=16) != graspbox.views(scene.mesh, count=1, seed=1)
    for each in (plan, plan[0], plan.tree, plan.tree[0], trace, voxels, views, scene.simulate(plan[:1])):
        with pytest.raises(TypeError, match="unhashable"):
            hash(each)


def test_a_plan_is_a_sequence_of_grasps(plan: graspbox.Plan) -> None:
    first = plan[:5]
    assert len(first) == 5
    assert first.features is not None
    np.testing.assert_array_equal(first.poses, plan.poses[:5])
    grasps = list(first)
    assert len(grasps) == 5
    np.testing.assert_array_equal(grasps[2].pose, plan.poses[2])
    assert (grasps[2].preshape, grasps[2].score) == (plan.preshape[2], plan.score[2])
    assert (grasps[2].box, grasps[2].face, grasps[2].feasible) == (plan.box[2], plan.face[2], plan.feasible[2])
    np.testing.assert_array_equal(plan[-1].pose, plan.poses[-1])
    np.testing.assert_array_equal(plan[plan.feasible].poses, plan.best().poses)
    np.testing.assert_array_equal(plan[[3, 1]].score, plan.score[[3, 1]])
    with pytest.raises(IndexError):
        plan[len(plan)]
    assert repr(plan).startswith("Plan('can-000000', ")


def test_best_refuses_a_negative_count(plan: graspbox.Plan) -> None:
    with pytest.raises(errors.ConfigError, match="count is -1"):
        plan.best(-1)
    assert len(plan.best(0)) == 0
    assert len(plan.best(np.int64(3))) == 3  # type: ignore[arg-type]


def test_a_saved_plan_comes_back_bit_for_bit(plan: graspbox.Plan, tmp_path: Path) -> None:
    path = tmp_path / "deep" / "plan.json"
    plan.save(path)
    same(graspbox.Plan.load(path), plan)
    document = json.loads(path.read_text())
    assert (document["format"], document["version"], document["hand"]) == ("graspbox.plan", 1, "reflex")
    assert document["units"] == {"length": "m", "angle": "rad"}
    assert document["object"] == {"name": "can-000000", "sha256": plan.mesh_sha256}
    assert document["grasps"][3]["object_from_hand"] == plan.poses[3].tolist()
    empty = plan[:0]
    empty.save(path)
    assert len(graspbox.Plan.load(path)) == 0
    assert [entry.name for entry in path.parent.iterdir()] == ["plan.json"]


def test_saving_keeps_links_and_permissions(plan: graspbox.Plan, tmp_path: Path) -> None:
    target, link = tmp_path / "target.json", tmp_path / "link.json"
    target.write_text("old")
    target.chmod(0o640)
    link.symlink_to(target)
    plan[:1].save(link)
    assert link.is_symlink()
    assert len(graspbox.Plan.load(target)) == 1
    assert stat.S_IMODE(target.stat().st_mode) == 0o640
    umask = os.umask(0o027)
    try:
        plan[:1].save(tmp_path / "new.json")
    finally:
        os.umask(umask)
    assert stat.S_IMODE((tmp_path / "new.json").stat().st_mode) == 0o640


def test_a_plan_that_cannot_be_written_leaves_the_old_file(plan: graspbox.Plan, tmp_path: Path) -> None:
    with pytest.raises(errors.FileError, match="folder"):
        plan.save(tmp_path)
    with pytest.raises(errors.FileError):
        plan.save("/proc/plan.json")
    path = tmp_path / "plan.json"
    path.write_text("old")
    broken = replace(plan, score=np.full(len(plan), np.nan))
    with pytest.raises(errors.ConfigError, match="finite"):
        broken.save(path)
    assert path.read_text() == "old"
    assert len(list(tmp_path.iterdir())) == 1


@pytest.mark.parametrize(
    ("key", "value", "complaint"),
    [
        ("format", "other", "format"),
        ("version", 2, "version is 2"),
        ("object", {"name": 3, "sha256": ""}, "object.name"),
        ("hand", None, "hand"),
        ("world_from_object", [[1]], "world_from_object"),
        ("world_from_object", np.diag([1.0, 1.0, -1.0, 1.0]).tolist(), "rigid"),
        ("boxes", [], "boxes"),
        ("boxes", [{}], r"boxes\[0\] lacks 'center'"),
        ("grasps", {}, "grasps"),
        ("grasps", [{"preshape": 0.0}], r"grasps\[0\] lacks 'object_from_hand'"),
        ("features", [[1.0]], "features"),
    ],
)
def test_a_wrong_plan_file_is_named(
    plan: graspbox.Plan, tmp_path: Path, key: str, value: object, complaint: str
) -> None:
    path = tmp_path / "plan.json"
    plan[:2].save(path)
    document = json.loads(path.read_text())
    document[key] = value
    path.write_text(json.dumps(document))
    with pytest.raises(errors.PlanError, match=complaint) as caught:
        graspbox.Plan.load(path)
    assert "plan.json" in str(caught.value)


def test_plans_that_touch_are_saved(plan: graspbox.Plan, tmp_path: Path) -> None:
    path = tmp_path / "plan.json"
    pushing = replace(plan[:2], touch=np.array([0.01, 0.0]), press=np.array([0.004, 0.0]))
    pushing.save(path)
    assert graspbox.Plan.load(path) == pushing
    document = json.loads(path.read_text())
    del document["grasps"][0]["press"]
    path.write_text(json.dumps(document))
    with pytest.raises(errors.PlanError, match=r"grasps\[0\] lacks 'press'"):
        graspbox.Plan.load(path)


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("preshape", "x"),
        ("preshape", None),
        ("press", None),
        ("feasible", 1),
        ("box", 1.5),
        ("box", 99),
        ("face", 6),
        ("score", 1e999),
    ],
)
def test_wrong_grasps_are_named(plan: graspbox.Plan, tmp_path: Path, key: str, value: object) -> None:
    path = tmp_path / "plan.json"
    plan[:2].save(path)
    document = json.loads(path.read_text())
    document["grasps"][1][key] = value
    path.write_text(json.dumps(document))
    with pytest.raises(errors.PlanError, match=key):
        graspbox.Plan.load(path)


@settings(max_examples=60, deadline=None)
@given(cut=st.integers(0, 4000), swap=st.binary(max_size=4))
def test_no_bytes_crash_the_reader_of_plans(
    plan: graspbox.Plan, tmp_path_factory: pytest.TempPathFactory, cut: int, swap: bytes
) -> None:
    path = tmp_path_factory.mktemp("fuzz") / "plan.json"
    plan[:3].save(path)
    content = path.read_bytes()
    path.write_bytes(content[:cut] + swap + content[cut + len(swap) :])
    with contextlib.suppress(errors.PlanError):
        assert len(graspbox.Plan.load(path)) <= 3


def test_files_that_are_no_plans(tmp_path: Path) -> None:
    (tmp_path / "pipe").touch()
    with pytest.raises(errors.PlanError, match="not JSON"):
        graspbox.Plan.load(tmp_path / "pipe")
    os.mkfifo(tmp_path / "fifo")
    for name in ("fifo", "none.json", "."):
        with pytest.raises(errors.FileError):
            graspbox.Plan.load(tmp_path / name)
    (tmp_path / "deep.json").write_text("[" * 200_000)
    with pytest.raises(errors.PlanError, match="not JSON"):
        graspbox.Plan.load(tmp_path / "deep.json")


def test_a_plan_is_simulated_where_its_object_rests(can: graspbox.Mesh, scene: graspbox.Scene) -> None:
    lying = np.array([[0.0, 0, 1, 0.02], [0, 1, 0, -0.01], [-1, 0, 0, 0.05], [0, 0, 0, 1]])
    laid = graspbox.Scene(can, world_from_object=lying)
    plan = graspbox.plan(can, world_from_object=laid.world_from_object)[:4]
    out = laid.simulate(plan)
    assert out == laid.simulate(plan.poses, plan.preshape)
    assert out[1] == laid.simulate(plan[1:2])[0]
    assert laid.trace(plan[0])[0].lift[0] == pytest.approx(out.lift[0], abs=0.02)
    # It settles again from where it rests, which moves it by less than the labels notice.
    assert list(graspbox.simulate(can, plan).success) == list(out.success)
    assert list(scene.simulate(plan).failure) != list(out.failure)


def test_one_grasp_of_a_plan_is_simulated_alone(scene: graspbox.Scene, plan: graspbox.Plan) -> None:
    assert scene.simulate(plan[0]) == scene.simulate(plan[:1])
    with pytest.raises(errors.ConfigError, match="preshape is given twice"):
        scene.simulate(plan[0], 0.0)


def test_plans_for_others_are_refused(plan: graspbox.Plan, scene: graspbox.Scene) -> None:
    other = graspbox.Scene(object_sets.load("procedural:ball:0")[0].load())
    with pytest.raises(errors.ConfigError, match="another mesh, 'can-000000', than 'ball-000000'"):
        other.simulate(plan)
    claw = replace(plan, hand_name="claw")
    with pytest.raises(errors.ConfigError, match="hand 'claw', not 'reflex'"):
        scene.simulate(claw)
    with pytest.raises(errors.ConfigError, match="preshape is given twice"):
        scene.simulate(plan, 0.0)
    with pytest.raises(errors.ConfigError, match="preshape is given twice"):
        scene.trace(plan[0], 0.0)
    with pytest.raises(errors.ConfigError, match="preshape is missing"):
        scene.simulate(plan.poses)
    with pytest.raises(errors.ConfigError, match="preshape is missing"):
        scene.trace(plan.poses[0])


def test_outcomes_compare_and_slice(scene: graspbox.Scene, plan: graspbox.Plan) -> None:
    out = scene.simulate(plan[:4])
    assert out == scene.simulate(plan[:4])
    assert out != out[:3]
    assert out != 4
    assert [o.success for o in out] == list(out.success)
    assert out[out.success].rate == (1.0 if out.success.any() else 0.0)
    assert out[1].lift == out.lift[1]
    assert type(out[1].success) is bool
    assert type(out[1].failure) is str
    assert repr(out) == f"Outcomes(trials=4, succeeded={out.success.sum()}, secure={out.secure.sum()})"


def test_plans_outcomes_scenes_and_hands_are_copied(scene: graspbox.Scene, plan: graspbox.Plan) -> None:
    """Scenes and hands are immutable, so a copy is the same object."""
    out = scene.simulate(plan[:2])
    for again in (pickle.loads(pickle.dumps(plan)), copy.deepcopy(plan)):
        same(again, plan)
    for found in (pickle.loads(pickle.dumps(out)), copy.deepcopy(out)):
        assert found == out
    assert copy.deepcopy(scene) is scene
    assert copy.copy(scene.hand) is copy.deepcopy(scene.hand) is scene.hand
    hand = pickle.loads(pickle.dumps(scene.hand))
    assert hand == scene.hand
    tree = pickle.loads(pickle.dumps(plan.tree))
    assert [box.volume for box in tree] == [box.volume for box in plan.tree]


def test_a_hand_from_files_is_pickled_with_their_text(tmp_path: Path) -> None:
    urdf, toml = graspbox.load_hand("reflex").files
    (tmp_path / "a.urdf").write_text(urdf)
    (tmp_path / "hand.toml").write_text(toml)
    hand = graspbox.load_hand((tmp_path / "a.urdf", tmp_path / "hand.toml"))
    pickled = pickle.dumps(hand)
    for path in tmp_path.iterdir():
        path.unlink()
    again = pickle.loads(pickled)
    closed = hand.closed(0.3, 0.5)
    for a, b in zip(again.shapes(closed), hand.shapes(closed), strict=True):
        np.testing.assert_array_equal(a, b)
    assert again == hand == graspbox.Hand(urdf, toml)
    assert len({again, hand, graspbox.load_hand()}) == 1
    other = graspbox.Hand(urdf, toml + "# a comment")
    assert other != hand
    assert len({other, hand}) == 2
    assert hand != "reflex"
    with pytest.raises(errors.HandError, match=r"hand\.toml"):
        graspbox.Hand(urdf, "")


def test_a_pickled_scene_gives_the_same_outcomes(can: graspbox.Mesh, plan: graspbox.Plan) -> None:
    start = np.array([[0.0, -1, 0, 0.02], [1, 0, 0, -0.01], [0, 0, 1, 0.01], [0, 0, 0, 1]])
    scene = graspbox.Scene(can, world_from_object=start, physics=graspbox.PhysicsConfig(gravity=9.0))
    assert repr(scene).startswith("Scene('can-000000', ")
    again = pickle.loads(pickle.dumps(scene))
    np.testing.assert_array_equal(again.world_from_object, scene.world_from_object)
    assert again.simulate(plan[:3]) == scene.simulate(plan[:3])
    other = graspbox.Scene(can, world_from_object=start)
    assert other.simulate(plan[:3]) != scene.simulate(plan[:3])


def test_objects_with_vertices_and_faces_are_meshes(can: graspbox.Mesh) -> None:
    foreign: Any = SimpleNamespace(vertices=can.vertices, faces=can.faces.astype(np.int64))
    assert graspbox.plan(foreign).mesh_sha256 == mesh_hash(can)
    assert len(graspbox.decompose(foreign, max_boxes=2)) == len(graspbox.decompose(can, max_boxes=2))
    assert graspbox.Scene(foreign).mesh.volume == can.volume
    calls: list[Any] = [graspbox.plan, graspbox.decompose, graspbox.Scene]
    for wrong in ("mug.stl", None, 3):
        for call in calls:
            with pytest.raises(errors.ConfigError, match="load_mesh"):
                call(wrong)


def test_typed_settings_are_the_fields_of_the_configs() -> None:
    for kind, named, own in (
        (graspbox.DecomposeConfig, planning.DecomposeSettings, set()),
        (graspbox.PlanConfig, planning.PlanSettings, {"seed"}),
    ):
        hints = get_type_hints(kind)
        assert {name: hint for name, hint in hints.items() if name not in own} == get_type_hints(named)


@pytest.mark.parametrize(("setting", "value"), [("max_press", 0.06), ("press_penalty", -1.0)])
def test_limits_of_a_touch_are_checked(can: graspbox.Mesh, setting: str, value: float) -> None:
    with pytest.raises(errors.ConfigError, match=f"`{setting}` is {value:g}"):
        graspbox.plan(can, config=graspbox.PlanConfig(**{setting: value}))  # type: ignore[arg-type]
