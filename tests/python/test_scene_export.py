"""Exported scenes: MJCF in MuJoCo, URDF as XML, folders, records and errors. `test_scene_export_usd` reads USD."""

import json
import re
import xml.etree.ElementTree as ET
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("mujoco", reason="exported scenes are loaded with mujoco, from the extra 'dev'")
pytest.importorskip("scipy", reason="exported scenes need scipy, from the extra 'scenes'")

import mujoco

import graspbox
from command_line import invoke
from graspbox.configs import FrictionConfig, PhysicsConfig
from graspbox.errors import ConfigError, FileError, MissingExtraError
from graspbox.tools import scene_export
from graspbox.tools.scene_export.elements import number_text
from graspbox.tools.scene_export.mesh_files import hull_faces, obj
from validate import main
from validation.mujoco.exported import drift_at_rest, load_export, replay_export

HANDS = graspbox.Hand.names()


def make_scene(hand: str = "reflex", name: str = "procedural:mug:2") -> graspbox.Scene:
    return graspbox.Scene(graspbox.object_sets.load(name)[0].load(), hand=hand)


def above(scene: graspbox.Scene, height: float) -> np.ndarray:
    """Give ``object_from_hand`` with the palm facing down, high above the table."""
    pose = np.diag([1.0, -1.0, -1.0, 1.0])
    pose[:3, 3] = [0.01, -0.02, height]
    return np.asarray(np.linalg.inv(scene.world_from_object) @ pose)


@pytest.fixture(scope="module")
def mug() -> graspbox.Scene:
    return make_scene()


def load(folder: Path) -> tuple[mujoco.MjModel, mujoco.MjData]:
    """Load the model of an export at its start."""
    model = mujoco.MjModel.from_xml_path(str(folder / "scene.xml"))
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, model.key("start").id)
    mujoco.mj_forward(model, data)
    return model, data


@pytest.mark.parametrize("hand", HANDS)
def test_mujoco_loads_what_the_core_simulates(hand: str, tmp_path: Path) -> None:
    scene = make_scene(hand)
    preshape = scene.hand.preshape_limits[1]
    pose = above(scene, 0.5)
    done = scene_export.export_scene(scene, tmp_path / "out", "mjcf", pose, preshape)
    assert done.files[0] == tmp_path / "out" / "scene.xml"
    assert all(path.is_file() for path in done.files)
    model, data = load(tmp_path / "out")
    body, item = scene.body, model.body("object")
    assert float(item.mass[0]) == body.mass
    np.testing.assert_allclose(item.ipos, body.center_of_mass, atol=1e-12)
    turn = np.empty(9)
    mujoco.mju_quat2Mat(turn, item.iquat)
    found = turn.reshape(3, 3) @ np.diag(item.inertia) @ turn.reshape(3, 3).T
    np.testing.assert_allclose(found, body.inertia, atol=1e-12)
    colliding = [i for i in range(model.ngeom) if model.geom_contype[i] and model.geom_bodyid[i] == item.id]
    assert len(colliding) == len(body.parts)
    visual = model.geom("object_visual")
    assert not visual.contype
    assert model.mesh_vertnum[model.geom_dataid[visual.id]] == len(scene.mesh.vertices)
    # The hand's shapes are where the core has them.
    world_from_hand = scene.world_from_object @ pose
    shapes, _, _, _ = scene.hand.shapes(scene.hand.open(preshape))
    places = (world_from_hand @ shapes)[:, :3, 3]
    is_hand = [i for i in range(model.ngeom) if model.geom_bodyid[i] not in (0, item.id)]
    assert len(is_hand) == len(shapes)
    for geom in is_hand:
        distance = np.linalg.norm(places - data.geom_xpos[geom], axis=1)
        assert distance.min() < 1e-6
    driven_rigidly = ("preshape", "rotation")
    assert model.nu == len([n for n in scene.hand.actuators if n not in driven_rigidly]) + 1
    # Nothing collides at the start but object and table.
    assert {frozenset(data.contact.geom[i]) & set(is_hand) for i in range(data.ncon)} <= {frozenset()}


def test_tendons_stops_and_friction_are_the_hand_s(mug: graspbox.Scene, tmp_path: Path) -> None:
    scene_export.export_scene(mug, tmp_path / "out", "mjcf", above(mug, 0.5), 0.0)
    model, data = load(tmp_path / "out")
    tendon = model.tendon("finger_1").id
    first = int(model.tendon_adr[tendon])
    wraps = range(first, first + int(model.tendon_num[tendon]))
    arms = {model.joint(int(model.wrap_objid[i])).name: float(model.wrap_prm[i]) for i in wraps}
    assert arms == {"proximal_joint_1": 0.01, "distal_joint_1": 0.006}
    actuator = model.actuator("finger_1")
    assert actuator.forcerange.tolist() == [0.0, 50.0]
    assert actuator.gainprm[0] == 5e4
    # A joint pushed 0.1 rad into its stop feels the stop's stiffness and its spring.
    for position, beyond in ((-0.1, 0.1), (2.93, -0.1)):
        data.joint("proximal_joint_1").qpos = position
        mujoco.mj_forward(model, data)
        spring = 0.01 * (-5.0 - position)
        dof = model.joint("proximal_joint_1").dofadr[0]
        assert data.qfrc_spring[dof] == pytest.approx(20.0 * beyond + spring, rel=1e-9)
    assert model.geom("proximal_1_pad").friction[0] == 1.0
    assert model.geom("proximal_1_body").friction[0] == 0.4
    assert model.geom("table").friction[0] == 0.5
    assert model.geom("object_0").friction[0] == 2e-5


def test_the_object_s_friction_scales_its_contacts_alone(tmp_path: Path) -> None:
    mesh = graspbox.object_sets.load("procedural:can:2")[0].load()
    physics = PhysicsConfig(gravity=1.62, friction=FrictionConfig(table=0.4, object=0.5))
    scene = graspbox.Scene(mesh, physics=physics)
    scene_export.export_scene(scene, tmp_path / "out", "mjcf", above(scene, 0.5), 0.0)
    model, _ = load(tmp_path / "out")
    assert model.opt.gravity.tolist() == [0.0, 0.0, -1.62]
    assert model.geom("table").friction[0] == 0.2
    assert model.geom("proximal_1_pad").friction[0] == 0.5
    pads = [model.geom(name).id for name in ("distal_1_pad", "distal_3_pad")]
    table = model.geom("table").id
    rows = {
        (int(model.pair_geom1[i]), int(model.pair_geom2[i])): float(model.pair_friction[i, 0])
        for i in range(model.npair)
    }
    rows |= {(b, a): friction for (a, b), friction in rows.items()}
    assert rows[pads[0], pads[1]] == 1.0
    assert rows[pads[0], table] == 0.4


def test_the_lift_actuator_lifts_the_hand(mug: graspbox.Scene, tmp_path: Path) -> None:
    scene_export.export_scene(mug, tmp_path / "out", "mjcf", above(mug, 0.5), 0.0)
    model, data = load(tmp_path / "out")
    before = data.body("base").xpos[2]
    data.actuator("lift").ctrl = 0.1
    while data.time < 0.3:
        mujoco.mj_step(model, data)
    assert data.body("base").xpos[2] - before == pytest.approx(0.1, abs=1e-4)


def test_labels_of_exports_are_the_judge_s(capsys: pytest.CaptureFixture[str]) -> None:
    """Three trials with both labels; `python tests/validate.py export` measures 200."""
    call = ["export", "--trials", "4", "--seed", "1", "--objects", "procedural:can:2", "procedural:hammer:2", "--json"]
    assert main(call) == 0
    report = json.loads(capsys.readouterr().out)
    assert report["trials"] == report["equal"] == 4
    assert report["successes"]["judge"] == report["successes"]["exported"]
    # Both models step with the same bits.
    assert report["greatest_lift_difference"] < 1e-9


@pytest.mark.parametrize("layout", ["pile", "bin"])
def test_labels_among_others_are_the_judge_s(layout: str, capsys: pytest.CaptureFixture[str]) -> None:
    call = ["export", "--trials", "3", "--layout", layout, "--count", "3", "--hand", "panda_gripper", "--json"]
    assert main(call) == 0
    report = json.loads(capsys.readouterr().out)
    assert report["trials"] == report["equal"] == 3
    assert report["equal_to_core"] >= 2
    # Visual meshes come between the objects of the file, so that contacts may be found in another order.
    assert report["greatest_lift_difference"] < 1e-3
    assert 0 <= report["greatest_drift"] < 0.003


def test_a_trial_above_the_object_touches_nothing(mug: graspbox.Scene, tmp_path: Path) -> None:
    """The replay takes the pose of the hand from the file: nobody tells it."""
    scene_export.export_scene(mug, tmp_path / "out", "mjcf", above(mug, 0.6), 0.0)
    assert replay_export(tmp_path / "out").failure == "no_contact"
    scene_export.export_scene(mug, tmp_path / "deep", "mjcf", np.eye(4), 0.0)
    assert replay_export(tmp_path / "deep").failure == "infeasible"


def test_the_command_fails_below_its_goal(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    import validation.mujoco.export_command as command
    from validation.mujoco.exported import ExportReport, ExportRow
    from validation.mujoco.replay import Outcome

    held = Outcome(True, None, 0.2, 0.0, (3, 3), 0.0, 3.3)
    lost = Outcome(False, "slipped", 0.0, 0.0, (3, 0), 0.0, 3.3)
    report = ExportReport([ExportRow("can", held, held, True)] * 98 + [ExportRow("can", held, lost, True)] * 2)
    monkeypatch.setattr(command, "compare_exports", lambda *_, **__: report)
    assert command.main([]) == 1
    printed = capsys.readouterr().out
    assert "98 of 100" in printed
    assert f"MuJoCo {mujoco.__version__}" in printed
    report.rows.pop()
    assert command.main([]) == 1 - int(98 / 99 >= 0.99)
    report.rows = [ExportRow("can", held, held, True, drift=0.0029)]
    assert command.main([]) == 0
    report.rows = [ExportRow("can", held, held, True, drift=0.0031)]
    assert command.main([]) == 1
    report.rows = []
    assert command.main([]) == 1


def test_damaged_exports_are_named(mug: graspbox.Scene, tmp_path: Path) -> None:
    folder = tmp_path / "out"
    scene_export.export_scene(mug, folder, "mjcf", above(mug, 0.5), 0.0)
    (folder / "scene.xml").write_text("<mujoco><worldbody>")
    with pytest.raises(ConfigError, match=r"MuJoCo does not accept .*scene\.xml"):
        load_export(folder)
    (folder / "scene.xml").unlink()
    with pytest.raises(FileError, match=r"scene\.xml"):
        load_export(folder)
    (folder / "scene.json").write_text("[]")
    with pytest.raises(ConfigError, match="not the record of a scene in MJCF"):
        load_export(folder)


@pytest.mark.parametrize("hand", HANDS)
def test_urdf_files_say_what_the_core_simulates(hand: str, tmp_path: Path) -> None:
    scene = make_scene(hand)
    folder = tmp_path / "out"
    scene_export.export_scene(scene, folder, "urdf", above(scene, 0.5), scene.hand.preshape_limits[0])
    assert (folder / "hand.toml").read_text() == scene.hand.files[1]
    again = graspbox.load_hand((folder / "hand.urdf", folder / "hand.toml"))
    assert repr(again.description) == repr(scene.hand.description)
    robot = ET.parse(folder / "object.urdf").getroot()
    (link,) = robot.findall("link")
    mass, moments = link.find("inertial/mass"), link.find("inertial/inertia")
    origin, contact = link.find("inertial/origin"), link.find("contact/lateral_friction")
    assert mass is not None
    assert moments is not None
    assert origin is not None
    assert contact is not None
    body = scene.body
    assert float(mass.attrib["value"]) == body.mass
    assert [float(x) for x in origin.attrib["xyz"].split()] == body.center_of_mass.tolist()
    for name, at in {"ixx": (0, 0), "ixy": (0, 1), "ixz": (0, 2), "iyy": (1, 1), "iyz": (1, 2), "izz": (2, 2)}.items():
        assert float(moments.attrib[name]) == body.inertia[at]
    assert float(contact.attrib["value"]) == 1.0
    meshes = [element.attrib["filename"] for element in link.iter("mesh")]
    assert len(meshes) == len(body.parts) + 1
    for file, points in zip(meshes[1:], body.parts, strict=True):
        part = graspbox.load_mesh(folder / file)
        assert part.watertight
        assert part.volume > 0
        np.testing.assert_allclose(part.bounds, [points.min(axis=0), points.max(axis=0)], atol=1e-7)
    table = ET.parse(folder / "table.urdf").getroot()
    boxes = [element.attrib["size"] for element in table.iter("box")]
    assert boxes == ["1.2 1.2 0.1"] * 2
    # Bullet holds what has mass 0 in place.
    assert [element.attrib["value"] for element in table.iter("mass")] == ["0"]


def test_the_record_says_where_everything_is(tmp_path: Path) -> None:
    scene = make_scene("panda_gripper")
    pose = above(scene, 0.5)
    done = scene_export.export_scene(scene, tmp_path / "out", "urdf", pose, 0.0)
    record = json.loads((tmp_path / "out" / "scene.json").read_text())
    assert record["not_expressed"] == list(done.not_expressed) == list(scene_export.NOT_EXPRESSED["urdf"])
    assert record["joints"] == {"finger_joint1": 0.04, "finger_joint2": 0.04}
    np.testing.assert_allclose(record["world_from_hand"], scene.world_from_object @ pose, atol=1e-12)
    (drive,) = record["actuators"]
    assert (drive["kind"], drive["speed"], drive["load_limit"]) == ("servo", 0.05, 140.0)
    assert drive["joints"] == [{"name": "finger_joint1", "ratio": -1.0, "offset": 0.04}]


def test_hulls_are_closed_and_outward() -> None:
    half = 0.05
    corners = np.array([[x, y, z] for x in (-half, half) for y in (-half, half) for z in (-half, half)])
    faces = hull_faces(corners)
    solid = graspbox.mesh_from_arrays(corners, faces, clean=None)
    assert solid.watertight
    assert solid.volume == pytest.approx(1e-3)
    a, b, c = corners[faces].transpose(1, 0, 2)
    assert (np.einsum("ij,ij->i", np.cross(b - a, c - a), a) > 0).all()
    flat = corners[corners[:, 2] > 0]
    assert set(hull_faces(flat).ravel()) == {0, 1, 2, 3}


def test_numbers_are_read_back_bit_for_bit() -> None:
    values = [0.1, 1 / 3, -1e-9, 2.0, 5e-324, 123456789.123]
    assert [float(word) for word in number_text(values).split()] == values
    points = np.random.default_rng(0).normal(size=(50, 3)).astype(np.float32)
    lines = [line.split()[1:] for line in obj(points, [[0, 1, 2]], "a b").splitlines() if line.startswith("v ")]
    assert np.array_equal(np.array(lines, dtype=np.float64).astype(np.float32), points)


def test_object_sets_are_folders_of_files(tmp_path: Path) -> None:
    meshes = tmp_path / "meshes"
    meshes.mkdir()
    (meshes / "bad.obj").write_text("v 0 0 0\n")
    sets = ["procedural:can:0-1", f"dir:{meshes}"]
    seen: list[str] = []
    done = scene_export.export_objects(sets, tmp_path / "out", "mjcf", done=seen.append)
    assert len(seen) == 3
    assert list(done.refused) == ["bad"]
    index = json.loads((tmp_path / "out" / "objects.json").read_text())
    assert [row["name"] for row in index["objects"]] == list(done.files) == seen[:2]
    for name, file in done.files.items():
        model = mujoco.MjModel.from_xml_path(str(file))
        record = json.loads((file.parent / "object.json").read_text())
        assert record["object"]["name"] == name
        assert float(model.body("object").mass[0]) == record["object"]["mass"]
        assert model.geom("object_0").friction[0] == 0.5


def test_a_failed_export_leaves_nothing(mug: graspbox.Scene, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(folder: Path, files: object) -> None:
        (folder / "half").write_text("x")
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("graspbox.tools.scene_export.exports.write_all", full)
    with pytest.raises(FileError, match="No space left"):
        scene_export.export_scene(mug, tmp_path / "out", "mjcf", above(mug, 0.5), 0.0)
    assert list(tmp_path.iterdir()) == []


def make_heap(layout: str = "bin", seed: int = 2, **settings: Any) -> tuple[graspbox.Arrangement, graspbox.Scene]:
    meshes = [graspbox.object_sets.load(f"procedural:{name}:1")[0].load() for name in ("box", "mug", "can", "bottle")]
    heap = graspbox.arrange(meshes, layout, seed=seed)  # type: ignore[arg-type]
    assert len(heap) >= 2
    return heap, graspbox.Scene.of(heap, **settings)


def test_objects_walls_and_their_friction_are_the_core_s(tmp_path: Path) -> None:
    """The coefficient of every contact is the product of two factors, whichever object or surface it is."""
    physics = PhysicsConfig(friction=FrictionConfig(table=0.4, object=0.5))
    heap, scene = make_heap(physics=physics)
    scene_export.export_scene(scene, tmp_path / "out", "mjcf", above(scene, 0.5), 0.0)
    model, data = load(tmp_path / "out")
    for number, (mesh, pose) in enumerate(zip(heap.meshes, heap.world_from_objects, strict=True)):
        body = model.body(f"object_{number}")
        assert float(body.mass[0]) == pytest.approx(mesh.mass, rel=1e-6)
        # Raised by less than half a millimetre, out of the table.
        np.testing.assert_allclose(data.xpos[body.id], pose[:3, 3], atol=5e-4)
        np.testing.assert_allclose(data.xmat[body.id].reshape(3, 3), pose[:3, :3], atol=1e-6)
        assert not model.geom(f"object_{number}_visual").contype
    for number, (pose, half) in enumerate(zip(heap.world_from_walls, heap.wall_half_extents, strict=True)):
        wall = model.geom(f"wall_{number}")
        np.testing.assert_allclose(wall.size, half, atol=1e-12)
        np.testing.assert_allclose(wall.pos, pose[:3, 3], atol=1e-12)
    pad = model.geom("distal_1_pad").id
    pairs = [{int(one), int(two)} for one, two in zip(model.pair_geom1, model.pair_geom2, strict=True)]
    paired = {model.geom(index).name for pair in pairs if pad in pair for index in pair}
    assert {"table", "wall_0", "wall_1", "wall_2", "wall_3"} <= paired
    # A pad comes down on the heap, whose objects lie in the bin.
    seen: dict[frozenset[str], set[float]] = {}
    data.actuator("lift").ctrl = -0.45
    while data.time < 1.0:
        mujoco.mj_step(model, data)
        for one, friction in zip(data.contact.geom, data.contact.friction, strict=True):
            names = [model.geom(int(index)).name for index in one]
            kinds = frozenset(next((k for k in ("object", "table", "wall", "pad") if k in n), "bare") for n in names)
            seen.setdefault(kinds, set()).add(float(friction[0]))
    assert seen[frozenset({"object"})] == {0.25}
    assert seen[frozenset({"object", "table"})] == {0.2}
    assert seen[frozenset({"object", "wall"})] == {0.2}
    assert seen[frozenset({"object", "pad"})] == {0.5}


@pytest.mark.parametrize("layout", ["packed", "pile", "bin"])
def test_scenes_of_several_objects_stay_at_rest(layout: str) -> None:
    # With seed 2 the mug slips by 7 mm in MuJoCo: a layout is at rest below 1 cm/s.
    _, scene = make_heap(layout, 3)
    assert drift_at_rest(scene) < 0.003


def test_what_a_scene_without_a_hand_has(mug: graspbox.Scene, tmp_path: Path) -> None:
    done = scene_export.export_scene(mug, tmp_path / "out", "mjcf")
    model, data = load(tmp_path / "out")
    assert (model.nu, model.nbody) == (0, 2)
    rest = mug.world_from_object
    np.testing.assert_allclose(data.body("object").xpos, rest[:3, 3], atol=5e-4)
    record = json.loads((tmp_path / "out" / "scene.json").read_text())
    assert record["object"]["name"] == mug.name
    assert not {"hand", "joints", "world_from_hand", "actuators"} & set(record)
    assert not any(point for point in done.not_expressed if "tendon" in point or "hand" in point)
    assert {path.name for path in done.files if path.parent.name == "out"} == {"scene.xml", "scene.json"}
    with pytest.raises(ConfigError, match=r"preshape is 0\.5 .*without a pose"):
        scene_export.export_scene(mug, tmp_path / "wrong", "mjcf", None, 0.5)
    with pytest.raises(ConfigError, match="has no hand"):
        load_export(tmp_path / "out")


@pytest.mark.parametrize("target", [None, 1])
def test_the_record_has_every_object_and_wall(target: int | None, tmp_path: Path) -> None:
    heap, scene = make_heap(target=target)
    pose = above(scene, 0.5)
    scene_export.export_scene(scene, tmp_path / "out", "urdf", pose, 0.0)
    record = json.loads((tmp_path / "out" / "scene.json").read_text())
    assert record["target"] == target
    assert [row["name"] for row in record["objects"]] == [mesh.name for mesh in heap.meshes]
    np.testing.assert_allclose(record["world_from_hand"], scene.world_from_object @ pose, atol=1e-12)
    for row, mesh, rest in zip(record["objects"], heap.meshes, heap.world_from_objects, strict=True):
        np.testing.assert_allclose(row["world_from_object"], rest, atol=5e-4)
        robot = ET.parse(tmp_path / "out" / record["files"][row["label"]]).getroot()
        mass = robot.find("link/inertial/mass")
        assert mass is not None
        assert float(mass.attrib["value"]) == row["mass"] == pytest.approx(mesh.mass)
        files = [element.attrib["filename"] for element in robot.iter("mesh")]
        assert len(files) == row["parts"] + 1
        visual = graspbox.load_mesh(tmp_path / "out" / files[0], clean=None)
        np.testing.assert_allclose(visual.bounds, mesh.bounds, atol=1e-6)
    assert len(record["walls"]) == 4
    for row, rest, half in zip(record["walls"], heap.world_from_walls, heap.wall_half_extents, strict=True):
        np.testing.assert_allclose(row["world_from_wall"], rest)
        robot = ET.parse(tmp_path / "out" / record["files"][row["label"]]).getroot()
        assert robot.attrib["name"] == row["label"]
        for box in robot.iter("box"):
            np.testing.assert_allclose([float(x) for x in box.attrib["size"].split()], 2 * half)


def test_wrong_arguments_are_one_sentence(mug: graspbox.Scene, tmp_path: Path) -> None:
    pose = above(mug, 0.5)
    grasp = graspbox.Grasp(pose, 0.0, True, 0.0, 0, 0)
    calls: list[tuple[tuple[Any, Any, Any], str]] = [
        (("sdf", pose, 0.0), "the format is 'sdf'"),
        (("mjcf", np.ones((4, 4)), 0.0), "pose has shape"),
        (("mjcf", pose[:3], 0.0), "pose has shape"),
        (("mjcf", pose * np.nan, 0.0), "pose has shape"),
        (("mjcf", pose, None), "preshape is missing"),
        (("mjcf", pose, 9.0), "preshape is 9.0"),
        (("mjcf", grasp, 0.0), "preshape is given twice"),
    ]
    for arguments, message in calls:
        with pytest.raises(ConfigError, match=message):
            scene_export.export_scene(mug, tmp_path / "out", *arguments)
    urdf, toml = graspbox.load_hand("panda_gripper").files
    second = '[[grasp.preshapes]]\nname = "other"\nwidth = { value = [0.0, 0.05], unit = "m", source = "a test" }\n\n'
    hand = graspbox.Hand(urdf, toml.replace("[[grasp.preshapes]]", second + "[[grasp.preshapes]]"))
    with pytest.raises(ConfigError, match="pass the number of a named preshape"):
        scene_export.export_scene(graspbox.Scene(mug.mesh, hand=hand), tmp_path / "out", "mjcf", pose, 0.5)
    assert list(tmp_path.iterdir()) == []
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "kept").write_text("x")
    with pytest.raises(ConfigError, match="is not empty"):
        scene_export.export_scene(mug, tmp_path / "full", "mjcf", pose, 0.0)
    with pytest.raises(FileError, match="it is a file"):
        scene_export.export_object(mug, tmp_path / "full" / "kept", "mjcf")
    assert (tmp_path / "full" / "kept").read_text() == "x"


def test_names_that_clash_are_named(mug: graspbox.Scene, tmp_path: Path) -> None:
    urdf, toml = graspbox.load_hand("panda_gripper").files
    for old, new, message in (
        ('"leftfinger"', '"object"', "the link 'object', which the model needs"),
        ("hand_body", "object_1", "the collision 'object_1', which the model needs"),
    ):
        hand = graspbox.Hand(urdf.replace(old, new), toml)
        with pytest.raises(ConfigError, match=message):
            scene_export.export_scene(graspbox.Scene(mug.mesh, hand=hand), tmp_path / "out", "mjcf", np.eye(4), 0.0)


def test_a_missing_package_is_named(mug: graspbox.Scene, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    import sys

    for name in [name for name in sys.modules if name.split(".")[0] == "scipy"]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "scipy", None)
    with pytest.raises(MissingExtraError, match=r"pip install 'graspbox\[scenes\]'"):
        scene_export.export_object(mug, tmp_path / "out", "mjcf")


def run(*words: str) -> tuple[int, str]:
    """Run the command; returns the exit status and all that it printed, or its error."""
    result = invoke(["export-scene", *words])
    return result.exit_code, result.output if isinstance(result.exception, SystemExit | None) else str(result.exception)


def test_the_command_exports_grasps_poses_and_sets(mug: graspbox.Scene, tmp_path: Path) -> None:
    name, plan = "procedural:mug:2", graspbox.plan(mug.mesh, world_from_object=mug.world_from_object, seed=3)
    plan.save(tmp_path / "plan.json")
    call = [name, "--to", "urdf", "--json", "--out"]
    status, text = run(*call, str(tmp_path / "a"), "--plan", str(tmp_path / "plan.json"), "--grasp", "2")
    assert status == 0, text
    assert json.loads(text)["files"][0] == str(tmp_path / "a" / "object.urdf")
    status, text = run(*call, str(tmp_path / "b"), "--seed", "3", "--grasp", "2")
    assert status == 0, text
    records = [json.loads((tmp_path / folder / "scene.json").read_text()) for folder in "ab"]
    # The plan's object comes to rest again where it is.
    np.testing.assert_allclose(records[0]["object_from_hand"], records[1]["object_from_hand"], atol=1e-6)
    np.testing.assert_allclose(records[0]["object_from_hand"], plan.best()[1].pose, atol=1e-5)
    status, text = run(*call, str(tmp_path / "c"), "--pose", "0.01,-0.02,0.5,0,1,0,0", "--preshape", "0.3")
    assert status == 0, text
    record = json.loads((tmp_path / "c" / "scene.json").read_text())
    assert record["hand"] == {"name": "reflex", "preshape": 0.3, "base": "base"}
    np.testing.assert_allclose(np.array(record["object_from_hand"])[:3, :3], np.diag([1, -1, -1]), atol=1e-12)
    status, text = run("--objects", "procedural:can:0", "--to", "urdf", "--out", str(tmp_path / "d"), "--json")
    assert status == 0, text
    (file,) = json.loads(text)["files"].values()
    assert Path(file).name == "object.urdf"


def test_the_command_exports_layouts(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The scene is that of `graspbox scenes` with the same seed, and the grasp is planned among neighbours."""
    call = ["procedural:seen:0-19", "--layout", "bin", "--objects-per-scene", "3", "--seed", "3", "--to", "mjcf"]
    status, text = run(*call, "--out", str(tmp_path / "a"), "--json")
    assert status == 0, text
    words = ["scenes", "--objects", *call[:7], "--scenes", "1", "--json"]
    listed = invoke(words)
    (scene,) = json.loads(listed.stdout)
    facts, record = json.loads(text), json.loads((tmp_path / "a" / "scene.json").read_text())
    assert facts["objects"] == [row["name"] for row in scene["objects"]]
    for row, other in zip(record["objects"], scene["objects"], strict=True):
        np.testing.assert_allclose(row["world_from_object"], other["world_from_object"], atol=5e-4)
    assert facts["hand"] == record["hand"]["name"] == "reflex"
    assert facts["grasp_of"] in facts["objects"]
    assert replay_export(tmp_path / "a").failure != "infeasible"
    status, text = run(*call, "--out", str(tmp_path / "b"), "--without-hand", "--json")
    assert status == 0, text
    assert json.loads(text)["hand"] is None
    assert json.loads((tmp_path / "b" / "scene.json").read_text())["objects"] == record["objects"]
    plan = graspbox.plan
    monkeypatch.setattr(graspbox, "plan", lambda *words, **named: plan(*words, **named)[:0])
    status, text = run(*call, "--out", str(tmp_path / "c"))
    assert status == 0, text
    assert "finds no feasible grasp" in text
    assert "hand" not in json.loads((tmp_path / "c" / "scene.json").read_text())


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--to", "mjcf"], "name one OBJECT"),
        (["procedural:mug:2", "--objects", "procedural", "--to", "mjcf"], "name one OBJECT"),
        (["procedural:mug:2", "--to", "stl"], "--to is 'stl'"),
        (["procedural:mug", "--to", "mjcf"], "names 10 objects"),
        (["procedural:mug:2", "--to", "mjcf", "--pose", "1,2,3"], "give seven numbers"),
        (["procedural:mug:2", "--to", "mjcf", "--pose", "0,0,1,1,1,1,1", "--preshape", "0"], "length 1"),
        (["procedural:mug:2", "--to", "mjcf", "--pose", "0,0,1,1,0,0,0"], "--preshape is missing"),
        (["procedural:mug:2", "--to", "mjcf", "--preshape", "0.2"], "belongs to --pose"),
        (["procedural:mug:2", "--to", "mjcf", "--grasp", "100000"], "--grasp is 100000"),
        (["procedural:mug:2", "--to", "mjcf", "--plan", "none.json"], "none.json"),
        (["--objects", "procedural:can:0", "--to", "mjcf", "--hand", "reflex"], "no hand"),
        (["--objects", "procedural:can:0", "--to", "mjcf", "--layout", "pile"], "name the set as OBJECT"),
        (["procedural:mug", "--to", "mjcf", "--layout", "heap"], "layout is 'heap'; choose from packed, pile, bin"),
        (["procedural:mug", "--to", "mjcf", "--objects-per-scene", "3"], "belongs to --layout"),
        (["procedural:mug", "--to", "mjcf", "--layout", "pile", "--plan", "x.json"], "applies to a single object"),
        (["procedural:mug:0", "--to", "mjcf", "--layout", "packed", "--grasp", "100000"], "--grasp is 100000; the "),
        (["procedural:mug:2", "--to", "mjcf", "--without-hand", "--grasp", "2"], "applies to the hand"),
    ],
)
def test_wrong_calls_are_one_sentence(words: list[str], message: str, tmp_path: Path) -> None:
    status, text = run(*words, "--out", str(tmp_path / "out"))
    assert status != 0
    assert message in " ".join(text.replace("│", " ").split())
    assert not (tmp_path / "out").exists()


def test_the_reference_repeats_what_formats_cannot_say() -> None:
    page = Path(__file__).parents[2] / "docs/reference/python/scene_export.md"
    guide = page.read_text().partition("## Limits of the formats")[2]
    points = re.findall(r"^- (.+?)(?=\n- |\n\n|\Z)", guide, flags=re.DOTALL | re.MULTILINE)
    found = [" ".join(point.split()) for point in points]
    assert found == [point for form in scene_export.FORMATS for point in scene_export.NOT_EXPRESSED[form]]
