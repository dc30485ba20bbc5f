"""Exported scenes in the programs that people open them with; each is skipped where its program is missing.

Ordinary tests have MuJoCo alone. ``pip install newton[sim,importers] yourdfpy pybullet drake pin`` runs all of them.
"""

import os
import subprocess
import xml.etree.ElementTree as ET
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("scipy", reason="exported scenes need scipy, from the extra 'scenes'")

try:
    # Its schemas must be there before the first stage of USD.
    import newton
except ImportError:
    newton = None

import graspbox
from graspbox.hands.description import describe
from graspbox.tools import scene_export
from graspbox.tools.scene_export.contents import objects_of
from graspbox.tools.scene_export.mjcf import scene_model
from graspbox.tools.scene_export.urdf_hand import hand_urdf
from test_urdf_hands import CUBE, GRIPPER, as_mesh, quiet, with_toml, written

HANDS = graspbox.Hand.names()
Folders = dict[str, Path]


@pytest.fixture(scope="module", params=HANDS)
def hand(request: pytest.FixtureRequest) -> graspbox.Hand:
    return graspbox.load_hand(request.param)


@pytest.fixture(scope="module")
def folders(hand: graspbox.Hand, tmp_path_factory: pytest.TempPathFactory) -> Folders:
    """Folders of a scene in every format, with a hand high above a box."""
    scene = graspbox.Scene(graspbox.object_sets.load("procedural:box:2")[0].load(), hand=hand)
    pose = np.diag([1.0, -1.0, -1.0, 1.0])
    pose[:3, 3] = [0.01, -0.02, 0.5]
    pose = np.linalg.inv(scene.world_from_object) @ pose
    root = tmp_path_factory.mktemp(hand.name)
    made: Folders = {}
    for to in scene_export.FORMATS:
        if to != "usd" or _has("pxr"):
            made[to] = scene_export.export_scene(scene, root / to, to, pose, hand.preshape_limits[1]).files[0].parent
    return made


def _has(module: str) -> bool:
    try:
        __import__(module)
    except ImportError:
        return False
    return True


def start_of(hand: graspbox.Hand) -> dict[str, float]:
    """Positions of the free joints of the open hand, rad or m, by name."""
    described = describe(hand)
    positions = described.open_positions(hand.preshape_limits[1])
    return {described.links[i].joint: described.start_position(i, positions) for i in described.free()}


def test_mujoco_starts_open_without_the_keyframe(hand: graspbox.Hand, folders: Folders) -> None:
    mujoco = pytest.importorskip("mujoco")
    model = mujoco.MjModel.from_xml_path(str(folders["mjcf"] / "scene.xml"))
    found, keyed = mujoco.MjData(model), mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, keyed, model.key("start").id)
    np.testing.assert_allclose(found.qpos, keyed.qpos, atol=1e-15)
    for name, position in start_of(hand).items():
        assert found.joint(name).qpos[0] == position
        # The limit is known, and acts only where the soft stop has yielded.
        link = next(link for link in describe(hand).links if link.joint == name)
        joint = model.joint(name)
        assert model.jnt_limited[joint.id] == 1
        assert joint.range.tolist() == list(link.limits)
        assert joint.margin[0] == pytest.approx(-0.5 * (np.ptp(link.limits) if link.kind == "prismatic" else 1.0))


def test_references_move_no_link(hand: graspbox.Hand, folders: Folders) -> None:
    """At the same joint positions every link is where it is in the model without ``ref``."""
    mujoco = pytest.importorskip("mujoco")
    exported = mujoco.MjModel.from_xml_path(str(folders["mjcf"] / "scene.xml"))
    scene = graspbox.Scene(graspbox.object_sets.load("procedural:box:2")[0].load(), hand=hand)
    described = describe(hand)
    plain = mujoco.MjModel.from_xml_string(scene_model(objects_of(scene), (), described, scene.physics))
    assert not np.any([plain.joint(described.links[i].joint).qpos0[0] for i in described.free()])
    random = np.random.default_rng(0)
    rigid = [link.index for link in described.moving if link.index not in described.free()]
    for _ in range(5):
        places = []
        positions = {i: random.uniform(*described.links[i].limits) for i in described.free()}
        for model in (exported, plain):
            data = mujoco.MjData(model)
            for index, position in positions.items():
                data.joint(described.links[index].joint).qpos = position
            mujoco.mj_forward(model, data)
            base = np.linalg.inv(_pose(data.body(described.links[0].name)))
            places.append([base @ _pose(data.body(link.name)) for link in described.links])
            # Couplings and tendons are at rest at the same positions.
            places[-1].append(np.asarray(data.ten_length.tolist()))
        for link, one, two in zip(described.links, *places, strict=False):
            if not _carried(described, link.index, rigid):
                np.testing.assert_allclose(one, two, atol=1e-12)
        np.testing.assert_allclose(places[0][-1], places[1][-1], atol=1e-15)


def _pose(body: Any) -> np.ndarray:
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = body.xmat.reshape(3, 3), body.xpos
    return pose


def _carried(described: Any, index: int, rigid: list[int]) -> bool:
    """Whether a joint of `rigid`, which a replay places by itself, carries a link."""
    while index > 0:
        if index in rigid:
            return True
        index = described.links[index].parent
    return False


def test_couplings_hold_in_mujoco(hand: graspbox.Hand, folders: Folders) -> None:
    mujoco = pytest.importorskip("mujoco")
    model = mujoco.MjModel.from_xml_path(str(folders["mjcf"] / "scene.xml"))
    data, described = mujoco.MjData(model), describe(hand)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    data.ctrl[:] *= 0.5
    while data.time < 0.3:
        mujoco.mj_step(model, data)
    for index in described.free():
        link = described.links[index]
        if link.mimic is not None:
            leader, ratio, offset = link.mimic
            led = ratio * data.joint(described.links[leader].joint).qpos[0] + offset
            assert data.joint(link.joint).qpos[0] == pytest.approx(led, abs=2e-3)


def test_a_coupling_with_an_offset_holds_in_mujoco(tmp_path: Path) -> None:
    """MuJoCo's polynomial is one of differences from ``ref``, which are not those from zero."""
    mujoco = pytest.importorskip("mujoco")
    urdf, toml = graspbox.load_hand("panda_gripper").files
    mimic = '<mimic joint="finger_joint1"/>'
    assert mimic in urdf
    hand = graspbox.Hand(urdf.replace(mimic, '<mimic joint="finger_joint1" multiplier="0.5" offset="0.01"/>'), toml)
    scene = graspbox.Scene(graspbox.object_sets.load("procedural:box:2")[0].load(), hand=hand)
    pose = np.diag([1.0, -1.0, -1.0, 1.0])
    pose[2, 3] = 0.5
    scene_export.export_scene(scene, tmp_path / "out", "mjcf", np.linalg.inv(scene.world_from_object) @ pose, 0.0)
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "out/scene.xml"))
    data = mujoco.MjData(model)
    for command in (0.04, 0.01):
        data.ctrl[0] = command
        for _ in range(600):
            mujoco.mj_step(model, data)
        one, two = (data.joint(f"finger_joint{number}").qpos[0] for number in (1, 2))
        assert one == pytest.approx(command, abs=1e-3)
        assert two == pytest.approx(0.5 * one + 0.01, abs=1e-3)


def test_stops_act_as_before_in_mujoco(folders: Folders, hand: graspbox.Hand) -> None:
    """Joints whose limits are written step with the same bits as joints without limits."""
    mujoco = pytest.importorskip("mujoco")
    path = folders["mjcf"] / "scene.xml"
    spec = mujoco.MjSpec.from_file(str(path))
    for joint in spec.joints:
        joint.limited = mujoco.mjtLimited.mjLIMITED_FALSE
    states = []
    for model in (mujoco.MjModel.from_xml_path(str(path)), spec.compile()):
        data = mujoco.MjData(model)
        mujoco.mj_resetDataKeyframe(model, data, 0)
        random = np.random.default_rng(1)
        while data.time < 0.2:
            # Up to the stops and into them.
            data.qfrc_applied[6:] = random.uniform(-0.5, 0.5, model.nv - 6)
            mujoco.mj_step(model, data)
        states.append(data.qpos.copy())
    np.testing.assert_array_equal(*states)


def test_newton_reads_limits_starts_and_couplings(hand: graspbox.Hand, folders: Folders) -> None:
    if newton is None:
        pytest.skip("Newton is not installed")
    described, starts = describe(hand), start_of(hand)
    for to in ("mjcf", "usd"):
        builder = newton.ModelBuilder()
        newton.solvers.SolverMuJoCo.register_custom_attributes(builder)
        if to == "mjcf":
            builder.add_mjcf(str(folders["mjcf"] / "scene.xml"))
        else:
            builder.add_usd(str(folders["usd"] / "scene.usda"))
        model = builder.finalize(device="cpu")
        leaders = [] if to == "mjcf" else model.joint_mimic_joint.numpy()
        names = [label.rpartition("/")[2] for label in builder.joint_label]
        for index in described.free():
            link = described.links[index]
            dof = builder.joint_qd_start[names.index(link.joint)]
            # Newton counts positions from the reference of MJCF.
            shift = starts[link.joint] if to == "mjcf" else 0.0
            limits = [builder.joint_limit_lower[dof] + shift, builder.joint_limit_upper[dof] + shift]
            np.testing.assert_allclose(limits, link.limits, atol=1e-5)
            if to == "usd" and link.mimic is not None:
                joint = names.index(link.joint)
                assert leaders[joint] == names.index(described.links[link.mimic[0]].joint)
                found = model.joint_mimic_coeffs.numpy()[joint]
                np.testing.assert_allclose(found, [link.mimic[2], link.mimic[1]], atol=1e-6)
            if to == "usd" and link.spring.stiffness > 0.0 and link.mimic is None:
                low, high = link.limits
                expected = min(max(link.spring.reference, low), high)
                assert builder.joint_target_q[builder.joint_q_start[names.index(link.joint)]] == pytest.approx(
                    expected, abs=1e-5
                )


def test_yourdfpy_shows_the_hand(hand: graspbox.Hand, folders: Folders) -> None:
    yourdfpy = pytest.importorskip("yourdfpy")
    shapes = sum(len(link.shapes) for link in describe(hand).links)
    for name, count in (("hand", shapes), ("table", 1), ("object", 1)):
        robot = yourdfpy.URDF.load(str(folders["urdf"] / f"{name}.urdf"))
        assert robot.validate()
        assert len(robot.scene.geometry) == count


def test_the_table_carries_the_object_in_bullet(folders: Folders) -> None:
    bullet = pytest.importorskip("pybullet")
    client = bullet.connect(bullet.DIRECT)
    try:
        bullet.setGravity(0, 0, -9.81)
        table = bullet.loadURDF(str(folders["urdf"] / "table.urdf"))
        item = bullet.loadURDF(str(folders["urdf"] / "object.urdf"), flags=bullet.URDF_USE_INERTIA_FROM_FILE)
        before = bullet.getBasePositionAndOrientation(item)[0]
        for _ in range(240):
            bullet.stepSimulation()
        assert bullet.getBasePositionAndOrientation(table)[0] == (0.0, 0.0, 0.0)
        np.testing.assert_allclose(bullet.getBasePositionAndOrientation(item)[0], before, atol=2e-3)
    finally:
        bullet.disconnect(client)


def test_drake_has_actuators(hand: graspbox.Hand, folders: Folders) -> None:
    pydrake = pytest.importorskip("pydrake.all")
    plant = pydrake.MultibodyPlant(0.001)
    parser = pydrake.Parser(plant)
    for name in ("hand", "table", "object"):
        parser.AddModels(str(folders["urdf"] / f"{name}.urdf"))
    plant.WeldFrames(plant.world_frame(), plant.GetFrameByName("table"))
    plant.Finalize()
    joints = [plant.get_joint_actuator(index).joint().name() for index in plant.GetJointActuatorIndices()]
    assert sorted(joints) == sorted(hand.joints)


def test_pinocchio_shows_the_hand(hand: graspbox.Hand, folders: Folders) -> None:
    pinocchio = pytest.importorskip("pinocchio")
    path = str(folders["urdf"] / "hand.urdf")
    model = pinocchio.buildModelFromUrdf(path)
    visuals = pinocchio.buildGeomFromUrdf(model, path, pinocchio.GeometryType.VISUAL)
    assert visuals.ngeoms == sum(len(link.shapes) for link in describe(hand).links)


def test_the_own_file_of_a_hand_is_completed() -> None:
    """Visual shapes, comments and namespaces of the file stay; meshes beside it are not in the export."""
    urdf, _ = graspbox.load_hand("panda_gripper").files
    described = describe(graspbox.load_hand("panda_gripper"))
    own = '<visual><geometry><sphere radius="0.1"/></geometry></visual>'
    mesh = '<visual><geometry><mesh filename="meshes/finger.stl"/></geometry></visual>'
    far = '<visual><geometry><mesh filename="package://franka/finger.stl"/></geometry></visual>'
    changed = urdf.replace('<link name="hand">', f'<link name="hand">{own}')
    changed = changed.replace('<link name="leftfinger">', f'<link name="leftfinger">{mesh}')
    changed = changed.replace('<link name="rightfinger">', f'<link name="rightfinger">{far}<!-- ü -->')
    changed = changed.replace('<robot name="panda_gripper">', '<robot xmlns:drake="http://drake" name="panda_gripper">')
    changed = changed.replace("</robot>", "<drake:ignored/></robot>")
    text = hand_urdf(changed, described)
    for kept in ("<!-- ü -->", "xmlns:drake", "<drake:ignored/>", own, far):
        assert kept in text
    assert mesh not in text
    links = {link.attrib["name"]: link for link in ET.fromstring(text).findall("link")}
    counts = {name: len(link.findall("visual")) for name, link in links.items()}
    assert counts == {"hand": 1, "leftfinger": 2, "rightfinger": 1}
    assert [joint.attrib["name"] for joint in ET.fromstring(text).findall("transmission/joint")] == ["finger_joint1"]
    assert hand_urdf(text, described).count("<transmission ") == 1


def test_visual_shapes_collide_where_nothing_else_does(hand: graspbox.Hand) -> None:
    """The core has used them as collision shapes; so do programs that read hand.urdf."""
    urdf, toml = hand.files
    grey = '<material name="grey"><color rgba="0.5 0.5 0.5 1"/></material></visual>'
    seen = urdf.replace("collision", "visual").replace("</visual>", grey, 1)
    visual = graspbox.Hand(seen, toml)
    text = hand_urdf(visual.files[0], describe(visual))
    links = ET.fromstring(text).findall("link")
    for link, own in zip(links, ET.fromstring(urdf).findall("link"), strict=True):
        shapes = [[ET.tostring(each) for part in one for each in part] for one in own.findall("collision")]
        for kind in ("visual", "collision"):
            found = link.findall(kind)
            assert [one.attrib for one in found] == [one.attrib for one in own.findall("collision")]
            plain = [[ET.tostring(each) for part in one if part.tag != "material" for each in part] for one in found]
            assert plain == shapes
    assert sum(len(link.findall("visual/material")) for link in links) == 1
    assert not [link for link in links if link.find("collision/material") is not None]
    assert repr(graspbox.Hand(text, toml).description) == repr(hand.description)


def test_visual_meshes_are_exported_as_their_fitted_shapes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("GRASPBOX_CACHE", str(tmp_path / "cache"))
    (tmp_path / "cube.obj").write_text(CUBE)
    made = quiet(with_toml(written(tmp_path, as_mesh(GRIPPER).replace("collision", "visual"))))
    scene = graspbox.Scene(graspbox.object_sets.load("procedural:box:2")[0].load(), hand=made)
    pose = np.diag([1.0, -1.0, -1.0, 1.0])
    pose[2, 3] = 0.5
    scene_export.export_scene(scene, tmp_path / "out", "urdf", pose, made.preshape_limits[0])
    text = (tmp_path / "out" / "hand.urdf").read_text()
    assert "<mesh" not in text
    for kind in ("visual", "collision"):
        assert text.count(f"<{kind}") == sum(len(link.shapes) for link in describe(made).links)
    again = quiet((tmp_path / "out" / "hand.urdf", tmp_path / "out" / "hand.toml"))
    assert repr(again.description) == repr(made.description)


#: In place of Python 3.11: its environments have the programs pip and python, which do what the variables of these
#: names say.
_STUB = """#!/usr/bin/env bash
mkdir -p "$3/bin"
printf '#!/usr/bin/env bash\\neval "$PIP"\\n' >"$3/bin/pip"
printf '#!/usr/bin/env bash\\neval "$PYTHON"\\n' >"$3/bin/python"
chmod +x "$3/bin/pip" "$3/bin/python"
eval "$VENV"
"""
#: What the findings have seen, as programs that print it.
_SEEN = {
    "newton_drive_target": """printf 'Warp\\nnewton 1.8.0\\ntarget -100 degrees: 45.0\\ntarget 20 degrees: 20.0\\n'""",
    "newton_import_order": """
case "$2 $3" in "newton NewtonMimicAPI" | "stage PhysxMimicJointAPI") echo 1 ;; *) echo 0 ;; esac""",
}


@pytest.mark.parametrize("finding", _SEEN)
def test_findings_tell_failures_from_changes(finding: str, tmp_path: Path) -> None:
    """Status 1 says that it has changed, which a failed installation or a crash does not show; their log is printed."""
    python = tmp_path / "python3.11"
    python.write_text(_STUB)
    python.chmod(0o755)
    good = {"VENV": "true", "PIP": "echo 'Name: newton'", "PYTHON": _SEEN[finding], "TMPDIR": str(tmp_path)}
    for change, status, log in (
        ({}, 0, ""),
        ({"PYTHON": "echo 5"}, 1, ""),
        ({"VENV": "echo no ensurepip; false"}, 2, "no ensurepip"),
        ({"PIP": "echo no index >&2; exit 1"}, 2, "no index"),
        ({"PYTHON": "echo Traceback >&2; exit 1"}, 2, "Traceback"),
    ):
        done = subprocess.run(
            ["bash", str(Path(__file__).parents[2] / "findings" / f"{finding}.sh")],
            env={**os.environ, **good, **change, "PATH": f"{tmp_path}:{os.environ['PATH']}"},
            capture_output=True,
            text=True,
            check=False,
        )
        assert done.returncode == status, (change, done.stderr)
        assert log in done.stderr
        assert [path for path in tmp_path.iterdir() if path != python] == []
