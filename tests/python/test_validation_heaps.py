"""MuJoCo as a second judge of attempts among several objects."""

import json
from dataclasses import replace

import numpy as np
import pytest

import graspbox
from graspbox import object_sets
from graspbox.envs.coding import codec
from graspbox.errors import ConfigError, MeshError
from graspbox.evaluation.rounds import clear_rounds

pytest.importorskip("mujoco")
from graspbox.tools.scene_export.contents import objects_of, walls_of
from validate import main
from validation.mujoco import describe
from validation.mujoco.heaps import HeapJudge
from validation.mujoco.scene import build_heap

HAND = "panda_gripper"
OBJECTS = ("procedural:box:0-3", "procedural:can:0-3")


def arrangement(layout: str, count: int = 3) -> graspbox.Arrangement:
    return graspbox.arrange([spec.load() for spec in object_sets.load(OBJECTS)[:count]], layout, seed=3, hand=HAND)  # type: ignore[arg-type]


def test_a_model_has_every_object_and_wall_where_it_is() -> None:
    found = arrangement("bin")
    core = graspbox.Scene.of(found, hand=HAND)
    scene = build_heap(describe(HAND), objects_of(core), walls_of(core))
    assert len(scene.object_bodies) == len(found) == 3
    model = scene.model
    for number, (mesh, pose) in enumerate(zip(found.meshes, found.world_from_objects, strict=True)):
        body = model.body(f"object_{number}")
        np.testing.assert_allclose(body.pos, pose[:3, 3], atol=1e-3)
        assert float(body.mass[0]) == pytest.approx(mesh.mass, rel=1e-6)
    boxes = [model.geom(i) for i in range(model.ngeom) if model.geom(i).name.startswith("wall_")]
    np.testing.assert_allclose([box.size for box in boxes], found.wall_half_extents, atol=1e-9)
    np.testing.assert_allclose([box.pos for box in boxes], found.world_from_walls[:, :3, 3], atol=1e-9)
    assert scene.is_scenery.sum() == 1 + len(boxes)


def test_engines_agree_on_a_grasp_and_on_thin_air() -> None:
    """The planner's best grasp of a box among others holds; a hand 20 cm above the table finds nothing."""
    found, code = arrangement("packed"), codec("grasp_pose", HAND)
    best = graspbox.plan(
        found.meshes[0], hand=HAND, world_from_object=found.world_from_objects[0], neighbours=found.without(0)
    ).best(1)
    pose = found.world_from_objects[0] @ best.poses[0]
    up = pose.copy()
    up[2, 3] += 0.2
    with HeapJudge(HAND, patch=1e-3) as judge:
        for where, success in ((pose, True), (up, False)):
            judge(found, code.encode_action(where, float(best.preshape[0])), {"is_success": success})
        results = judge.to_json()
    assert results["attempts"] == results["equal"] == 2
    assert results["success_rate"] == 0.5
    assert results["failures"] == {"no_contact": 1}


def test_objects_that_the_hand_cannot_span_are_judged() -> None:
    """`Scene` refuses this object for the hand; a scene of several may hold it."""
    wide = object_sets.load("procedural:box:0", scale=4.0)[0].load()
    with pytest.raises(MeshError, match="open hand"):
        graspbox.Scene(wide, hand=HAND)
    pose = np.eye(4)
    pose[2, 3] = -wide.bounds[0, 2]
    found = replace(arrangement("packed", 1), meshes=(wide,), world_from_objects=pose[None])
    far = np.diag([1.0, -1.0, -1.0, 1.0])
    far[:3, 3] = 0.0, 0.0, 0.9
    with HeapJudge(HAND) as judge:
        judge(found, codec("grasp_pose", HAND).encode_action(far, 0.0), {"is_success": False})
        assert judge.to_json()["equal"] == 1


def test_rounds_have_a_second_judge(capsys: pytest.CaptureFixture[str]) -> None:
    words = ["scene_planner", "--hand", HAND, "--objects", OBJECTS[0], "--layout", "packed", "--json"]
    assert main(["clutter", *words, "--objects-per-scene", "2", "--rounds", "1", "--patch", "1"]) == 0
    (row,) = json.loads(capsys.readouterr().out)
    found = row["mujoco"]
    assert found["attempts"] == row["attempts"] > 0
    assert found["equal"] + found["only_core"] + found["only_mujoco"] == found["attempts"]
    assert row["mujoco_version"]
    with pytest.raises(ConfigError, match=r"patch is 1\.0; give metres, 0 to 0\.02"):
        HeapJudge(HAND, patch=1.0)


def test_a_witness_sees_the_scene_before_each_attempt() -> None:
    seen: list[int] = []
    rounds = clear_rounds(
        "scene_planner",
        objects=OBJECTS,
        layout="packed",
        hand=HAND,
        objects_per_scene=2,
        rounds=1,
        witness=lambda before, action, info: seen.append(len(before)),
    )
    assert len(seen) == rounds.attempts.sum()
    assert seen[0] == rounds.begun[0]
