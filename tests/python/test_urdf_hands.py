"""URDFs as people have them: what other programs take is taken, what is assumed is told, with the file's own lines."""

import json
import pickle
import re
import warnings
from importlib.util import find_spec
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import graspbox
from command_line import invoke
from graspbox import errors
from graspbox.cli.common import find_hand
from graspbox.errors import HandError
from graspbox.hand_tools import guess_hand
from graspbox.hands import MeshFit, Primitive, fitted_urdf, load_hand, mesh_fits, urdf_meshes
from graspbox.hands.description import Link, describe_urdf
from graspbox.hands.reading import read_hand
from graspbox.tools import scene_export

ASSETS = Path(__file__).parents[2] / "env/hand/assets/panda_gripper"
#: The text of a cube's mesh with sides of 2 cm, as OBJ.
CUBE = "".join(f"v {0.02 * (i >> 2 & 1)} {0.02 * (i >> 1 & 1)} {0.02 * (i & 1)}\n" for i in range(8)) + "".join(
    f"f {a} {b} {c} {d}\n"
    for a, b, c, d in ((1, 2, 4, 3), (5, 7, 8, 6), (1, 5, 6, 2), (3, 4, 8, 7), (1, 3, 7, 5), (2, 6, 8, 4))
)
INERTIAL = '<inertial><mass value="{}"/><inertia ixx="1e-4" iyy="1e-4" izz="1e-4" ixy="0" ixz="0" iyz="0"/></inertial>'
#: A palm with two fingers, a link per line; the fingers have no masses.
GRIPPER = f"""<robot name="gripper">
  <link name="palm">{INERTIAL.format(0.4)}<collision><geometry><box size="0.1 0.05 0.03"/></geometry></collision></link>
  <link name="left">
    <collision name="left_pad"><origin xyz="0 0 0.05" rpy="0.2 0.1 0"/>
      <geometry><box size="0.01 0.03 0.08"/></geometry>
    </collision>
    <collision><origin xyz="0 0.01 0.02"/><geometry><cylinder radius="0.01" length="0.03"/></geometry></collision>
  </link>
  <link name="right">
    <collision name="right_pad"><origin xyz="0 0 0.05"/><geometry><box size="0.01 0.03 0.08"/></geometry></collision>
  </link>
  <joint name="l" type="prismatic"><parent link="palm"/><child link="left"/><origin xyz="-0.04 0 0.015"/>
    <axis xyz="1 0 0"/><limit lower="0" upper="0.034" effort="40" velocity="0.2"/></joint>
  <joint name="r" type="prismatic"><parent link="palm"/><child link="right"/><origin xyz="0.04 0 0.015"/>
    <axis xyz="-1 0 0"/><limit lower="0" upper="0.034" effort="40" velocity="0.2"/><mimic joint="l"/></joint>
</robot>
"""


@pytest.fixture(autouse=True)
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("GRASPBOX_CACHE", str(tmp_path / "cache"))


def written(folder: Path, text: str, name: str = "hand.urdf") -> Path:
    (folder / name).write_text(text)
    return folder / name


def with_toml(urdf: Path) -> tuple[Path, Path]:
    """Return a URDF and the guessed file beside it."""
    toml = urdf.with_name("hand.toml")
    toml.write_text(guess_hand(urdf).text)
    return urdf, toml


def quiet(files: tuple[Path, Path]) -> graspbox.Hand:
    with warnings.catch_warnings(action="ignore"):
        return load_hand(files)


def as_mesh(text: str, filename: str = "cube.obj") -> str:
    """Put a mesh in place of the left pad's box."""
    return text.replace('<box size="0.01 0.03 0.08"/>', f'<mesh\n filename="{filename}"/>', 1)


def links_of(text: str) -> dict[str, Link]:
    return {link.name: link for link in describe_urdf(text, "hand.urdf")}


def test_masses_of_shapes_are_those_of_mujoco() -> None:
    mujoco = pytest.importorskip("mujoco")
    # Without flattening, MuJoCo keeps names; its own density is 1000 kg/m3 too.
    model = mujoco.MjModel.from_xml_string(GRIPPER)
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    own = links_of(GRIPPER)
    for name in ("left", "right"):
        body = model.body(name)
        assert own[name].mass == pytest.approx(float(body.mass[0]), rel=1e-9)
        np.testing.assert_allclose(own[name].center, body.ipos, atol=1e-9)
        turn = np.zeros(9)
        mujoco.mju_quat2Mat(turn, body.iquat)
        inertia = turn.reshape(3, 3) @ np.diag(body.inertia) @ turn.reshape(3, 3).T
        np.testing.assert_allclose(own[name].inertia, inertia, atol=1e-12)


def test_links_are_where_yourdfpy_has_them(tmp_path: Path) -> None:
    yourdfpy = pytest.importorskip("yourdfpy")
    frame = '<link name="tool"/><joint name="t" type="fixed"><parent link="left"/><child link="tool"/>'
    text = GRIPPER.replace("</robot>", f'{frame}<origin xyz="0 0.1 0" rpy="1 0 0"/></joint></robot>')
    urdf = written(tmp_path, text)
    other = yourdfpy.URDF.load(str(urdf), load_meshes=False, build_scene_graph=True)
    other.update_cfg({"l": 0.01})
    hand = quiet(with_toml(urdf))
    names = [link.name for link in describe_urdf(text, "hand.urdf")]
    frames = dict(zip(names, hand.link_frames(np.array([0.01])), strict=True))
    for name in ("left", "right", "tool"):
        found = np.linalg.inv(frames["palm"]) @ frames[name]
        np.testing.assert_allclose(found, other.get_transform(name, "palm"), atol=1e-9)


def test_a_frame_changes_nothing(tmp_path: Path) -> None:
    frame = '<link name="tool"/><joint name="t" type="fixed"><parent link="leftfinger"/><child link="tool"/></joint>'
    text = (ASSETS / "panda_gripper.urdf").read_text().replace("</robot>", f"{frame}</robot>")
    framed, plain = quiet((written(tmp_path, text), ASSETS / "hand.toml")), load_hand("panda_gripper")
    assert [frame for frame in framed.assumptions if 'link "tool": has no <inertial>' in frame]
    mesh = graspbox.object_sets.load("procedural:box:1")[0].load()
    plan = graspbox.plan(mesh, hand=plain, world_from_object=graspbox.Scene(mesh, hand=plain).world_from_object).best(8)
    scene = graspbox.Scene(mesh, hand=framed)
    for file in scene_export.export_scene(scene, tmp_path / "out", "mjcf", plan[0]).files:
        if file.suffix == ".xml" and find_spec("mujoco") is not None:
            model = pytest.importorskip("mujoco").MjModel.from_xml_path(str(file))
            assert float(model.body("tool").mass[0]) == 0.0
    outcomes = graspbox.simulate(mesh, plan, hand=framed)
    assert outcomes.success.any()
    assert outcomes == graspbox.simulate(mesh, plan, hand=plain)


def test_assumptions_are_told_once_and_kept(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    files = with_toml(written(tmp_path, GRIPPER))
    with pytest.warns(UserWarning, match=r'hand.urdf:3: link "left": has no <inertial>.*; 1 more in Hand.assumptions'):
        hand = load_hand(files)
    assert [sentence.split(": ")[0] for sentence in hand.assumptions] == [f"{files[0]}:3", f"{files[0]}:9"]
    assert load_hand(files) == hand  # without another warning
    other = written(tmp_path, GRIPPER, "other.urdf")
    assert find_hand(f"{other},{files[1]}") == hand
    err = capsys.readouterr().err
    assert f"warning: {other}:3: " in err
    assert "; 1 more are listed by `graspbox hand check`" in err
    assert "Hand.assumptions" not in err
    assert pickle.loads(pickle.dumps(hand)).assumptions == hand.assumptions
    made = graspbox.Hand(*hand.files, None, ["made from a drawing"])
    assert pickle.loads(pickle.dumps(made)).assumptions[0] == "made from a drawing"
    assert graspbox.load_hand("reflex").assumptions == ()


def test_deprecations_of_other_packages_are_not_about_the_hand(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def load(_: Any) -> graspbox.Hand:
        warnings.warn("old function", DeprecationWarning, stacklevel=1)
        return load_hand("reflex")

    monkeypatch.setattr("graspbox.cli.common.load_hand", load)
    with pytest.warns(DeprecationWarning, match="old function"):
        find_hand("reflex")
    assert capsys.readouterr().err == ""


def test_check_reads_a_hand_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "cube.obj").write_text(CUBE)
    urdf, toml = with_toml(written(tmp_path, as_mesh(GRIPPER)))
    read: list[Path] = []

    def counted(path: Path, *rest: Any) -> Any:
        read.append(path)
        return read_hand(path, *rest)

    for module in ("loading", "reading"):
        monkeypatch.setattr(f"graspbox.hands.{module}.read_hand", counted)
    result = invoke(["hand", "check", urdf, toml, "--no-trials", "--json"])
    assert json.loads(result.stdout)["meshes"]["left_pad"]["shapes"] == ["box"]
    assert read == [urdf]


def test_the_commands_tell_assumptions(tmp_path: Path) -> None:
    urdf, toml = written(tmp_path, GRIPPER), tmp_path / "hand.toml"
    made = invoke(["hand", "new", urdf, "--out", toml])
    assert "assumed: " in made.stdout
    assert re.search(r'hand.urdf:3: link "left": has no <inertial>', made.stdout)
    made = invoke(["hand", "new", urdf, "--out", toml, "--force", "--json"])
    assert len(json.loads(made.stdout)["assumptions"]) == 2
    assert "assumed: " in invoke(["hand", "check", urdf, toml, "--no-trials"]).stdout
    checked = invoke(["hand", "check", urdf, toml, "--no-trials", "--json"])
    assert len(json.loads(checked.stdout)["assumptions"]) == 2


# Meshes.


def test_a_fitted_urdf_has_the_lines_of_the_file(tmp_path: Path) -> None:
    (tmp_path / "cube.obj").write_text(CUBE)
    text = as_mesh(GRIPPER).replace('<link name="right">', '<link name="right"> <!-- ü -->')
    fitted = fitted_urdf(written(tmp_path, text))
    assert [one.count("\n") for one in (fitted.text, text)] == [text.count("\n")] * 2
    at = text.splitlines().index('  <link name="right"> <!-- ü -->')
    assert fitted.text.splitlines()[at:] == text.splitlines()[at:]
    # Shapes beside the mesh keep the names that their numbers gave them.
    assert [shape.name for shape in links_of(fitted.text)["left"].shapes] == ["left_pad", "left_1"]
    wrong = written(tmp_path, text.replace('<mimic joint="l"/>', '<mimic joint="k"/>'))
    line = 1 + next(i for i, one in enumerate(text.splitlines()) if "<mimic" in one)
    with pytest.raises(HandError, match=f'{re.escape(str(wrong))}:{line}: there is no joint "k"'):
        fitted_urdf(wrong)


def test_visual_meshes_collide_where_nothing_else_does(tmp_path: Path) -> None:
    (tmp_path / "cube.obj").write_text(CUBE)
    hand = quiet(with_toml(written(tmp_path, as_mesh(GRIPPER).replace("collision", "visual"))))
    assert "no link has a <collision>; the <visual> shapes are the collision shapes" in hand.assumptions[0]
    shapes = hand.shapes(hand.open(0.0))[1]
    assert np.isclose(shapes, 0.01, atol=1e-5).all(axis=1).sum() == 1


def test_everything_is_checked_before_meshes_are_fitted(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: Any) -> None:
        raise AssertionError("fitted too early")

    (tmp_path / "cube.obj").write_text(CUBE)
    good = written(tmp_path, as_mesh(GRIPPER))
    toml = with_toml(good)[1]
    monkeypatch.setattr(urdf_meshes, "fits_of", refuse)
    monkeypatch.setattr(urdf_meshes, "cached_fits", refuse)
    for text, message in (
        (as_mesh(GRIPPER).replace('child link="right"', 'child link="none"'), 'there is no link "none"'),
        (as_mesh(GRIPPER, "none.obj"), "hand.urdf:5: collider 'left_pad': mesh 'none.obj' is missing"),
    ):
        with pytest.raises(HandError, match=message):
            quiet((written(tmp_path, text), toml))
    toml.write_text(toml.read_text().replace('unit = "N"', 'unit = "kN"', 1))
    with pytest.raises(HandError, match=r"hand.toml:\d+: .*kN"):
        quiet((written(tmp_path, as_mesh(GRIPPER)), toml))


def test_more_shapes_must_be_worth_their_time() -> None:
    def fits(*means: float) -> mesh_fits.MeshFits:
        one = Primitive("box", np.eye(4), (0.01, 0.01, 0.01))
        rows = (MeshFit((one,) * (2**number), mean, mean) for number, mean in enumerate(means))
        return mesh_fits.MeshFits(tuple(rows), 0.1)

    def counts(*meshes: mesh_fits.MeshFits) -> list[int]:
        return [len(fit.primitives) for fit in mesh_fits.chosen(meshes)]

    # Of a mesh of 10 cm a further shape must bring 0.5 mm.
    assert counts(fits(4e-3, 3.6e-3)) == [1]
    assert counts(fits(4e-3, 3.4e-3)) == [2]
    assert counts(fits(9e-3, 4e-3, 2e-3)) == [4]
    # Many meshes share a budget.
    several = [fits(4e-3, 3.4e-3) for _ in range(30)]
    assert counts(*several) == [2] * 30
    assert counts(*several, *several[:5]) == [1] * 35
    assert counts(*several, *several, *several) == [1] * 90


def collada_cube(collada: Any) -> bytes:
    """Write the cube in millimetres, 10 cm up."""
    document = collada.Collada()
    document.assetInfo.unitname, document.assetInfo.unitmeter = "millimeter", 0.001
    corners = 20.0 * np.array([[i >> 2 & 1, i >> 1 & 1, i & 1] for i in range(8)], dtype=float)
    source = collada.source.FloatSource("points", corners.ravel(), ("X", "Y", "Z"))
    geometry = collada.geometry.Geometry(document, "cube", "cube", [source])
    inputs = collada.source.InputList()
    inputs.addInput(0, "VERTEX", "#points")
    squares = [[int(corner) - 1 for corner in line.split()[1:]] for line in CUBE.splitlines() if line[0] == "f"]
    faces = np.array([corner for a, b, c, d in squares for corner in (a, b, c, a, c, d)])
    geometry.primitives.append(geometry.createTriangleSet(faces, inputs, "none"))
    document.geometries.append(geometry)
    shift = collada.scene.TranslateTransform(0.0, 0.0, 100.0)
    node = collada.scene.Node("n", children=[collada.scene.GeometryNode(geometry)], transforms=[shift])
    document.scene = collada.scene.Scene("s", [node])
    document.scenes.append(document.scene)
    buffer = BytesIO()
    document.write(buffer)
    return buffer.getvalue()


def test_collada_meshes(tmp_path: Path) -> None:
    collada = pytest.importorskip("collada")
    with warnings.catch_warnings(action="ignore"):  # pycollada uses parts of numpy that are old
        (tmp_path / "cube.dae").write_bytes(collada_cube(collada))
    fit = fitted_urdf(written(tmp_path, as_mesh(GRIPPER, "cube.dae"))).fits["left_pad"]
    assert [one.kind for one in fit.primitives] == ["box"]
    np.testing.assert_allclose(fit.primitives[0].pose[:3, 3], (0.01, 0.01, 0.11), atol=1e-6)
    np.testing.assert_allclose(fit.primitives[0].size, (0.02, 0.02, 0.02), atol=1e-6)
    for content in ("<COLLADA/>", "no xml", (tmp_path / "cube.dae").read_text()[:700]):
        (tmp_path / "cube.dae").write_text(content)
        with pytest.raises(HandError, match=r"hand.urdf:5: collider 'left_pad': mesh 'cube.dae': "):
            fitted_urdf(tmp_path / "hand.urdf")


# Other formats.


def test_a_missing_package_is_named(tmp_path: Path) -> None:
    if find_spec("collada") is not None:
        pytest.skip("pycollada is installed")
    (tmp_path / "cube.dae").write_text("<COLLADA/>")
    with pytest.raises(errors.MissingExtraError, match=r"hand.urdf:5: collider 'left_pad'.*graspbox\[urdf\]"):
        fitted_urdf(written(tmp_path, as_mesh(GRIPPER, "cube.dae")))


def xacro_of(folder: Path, part: str) -> Path:
    """Write a xacro of the gripper in a package of its own, whose fingers are in another file."""
    (folder / "package.xml").write_text("<package><name>claw</name></package>")
    head = '<robot name="claw" xmlns:xacro="http://www.ros.org/wiki/xacro">'
    body = GRIPPER.partition("\n")[2].rpartition("</robot>")[0]
    (folder / "urdf").mkdir()
    written(folder / "urdf", f'{head}<xacro:macro name="gripper" params="w">{body}</xacro:macro></robot>', "part.xacro")
    text = f'{head}\n<xacro:include filename="{part}"/>\n<xacro:gripper w="${{2 * 3}}"/></robot>'
    return written(folder / "urdf", text, "claw.urdf.xacro")


@pytest.mark.parametrize("part", ["part.xacro", "$(find claw)/urdf/part.xacro"])
def test_xacros_are_expanded(tmp_path: Path, part: str) -> None:
    pytest.importorskip("xacrodoc")
    hand = quiet(with_toml(xacro_of(tmp_path, part)))
    assert hand.joints == ["l"]
    assert "claw.urdf.xacro (expanded):" in hand.assumptions[0]
    bad = written(tmp_path, '<robot xmlns:xacro="http://www.ros.org/wiki/xacro"><xacro:none/></robot>', "bad.xacro")
    with pytest.raises(HandError, match=r"bad.xacro: xacro cannot expand it: unknown macro name: xacro:none"):
        fitted_urdf(bad)
    with pytest.raises(HandError, match=r"part.xacro: it defines macros and makes no link; pass the xacro that calls"):
        fitted_urdf(tmp_path / "urdf" / "part.xacro")


def test_files_of_other_formats_are_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("graspbox.hands.reading.find_spec", lambda _: None)
    xacro = xacro_of(tmp_path, "part.xacro")
    for file, message in (
        (xacro, r"xacro:2: the file is a xacro; expand it: `xacro hand.urdf.xacro > hand.urdf`"),
        (
            written(tmp_path, "<!-- x -->\n<sdf version='1.7'/>", "a.sdf"),
            "a.sdf:2: the file is an SDF file; give the URDF",
        ),
        (written(tmp_path, "<!-- a -->\n" * 5000, "a.urdf"), r"a.urdf:\d+: there is no element"),
        (written(tmp_path, "<svg/>", "a.svg"), r"a.svg:1: the file is no URDF: its root element is <svg>"),
    ):
        result = invoke(["hand", "new", file, "--out", tmp_path / "new.toml"])
        assert result.exit_code == 2
        assert re.search(message, result.stderr), result.stderr
        with pytest.raises(HandError, match=message):
            load_hand((file, ASSETS / "hand.toml"))


def test_an_mjcf_file_is_converted(tmp_path: Path) -> None:
    pytest.importorskip("mujoco")
    box = '<geom type="box" size="{}" mass="0.1"/>'
    mjcf = f"""<?xml version="1.0"?>
    <!-- a gripper -->
    <mujoco><worldbody><body name="palm">{box.format("0.05 0.03 0.02")}
    <body name="a" pos="0.04 0 0.02"><joint name="a" type="slide" axis="-1 0 0" range="0 0.03"/>
    <geom name="a_pad" type="box" size="0.005 0.01 0.03" pos="0 0 0.03" mass="0.02"/></body>
    <body name="b" pos="-0.04 0 0.02"><joint name="b" type="slide" axis="1 0 0" range="0 0.03"/>
    <geom name="b_pad" type="box" size="0.005 0.01 0.03" pos="0 0 0.03" mass="0.02"/></body>
    </body></worldbody></mujoco>"""
    files = written(tmp_path, mjcf, "hand.xml"), tmp_path / "hand.toml"
    assert invoke(["hand", "new", files[0], "--out", files[1]]).exit_code == 0
    assert quiet(files).joints == ["a", "b"]
