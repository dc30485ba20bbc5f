"""Collision meshes of a hand: primitives fitted to them, in the hand's URDF."""

import json
import logging
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from graspbox import object_sets
from graspbox.errors import HandError
from graspbox.hands import Hand, Primitive, corners_of, fit_mesh, fitted_urdf, load_hand, urdf_meshes
from graspbox.hands.description import describe
from graspbox.meshes import mesh_from_arrays

ROOT = Path(__file__).parents[2]
ASSETS = ROOT / "env/hand/assets/panda_gripper"
PAD = '<box size="{}"/>'


@pytest.fixture(autouse=True)
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("GRASPBOX_CACHE", str(tmp_path / "cache"))
    return tmp_path / "cache" / "hand_meshes"


def box_faces() -> NDArray[np.int64]:
    """Triangles of a box whose corner i has the signs of the bits of i."""
    sides = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    return np.array([t for a, b, c, d in sides for t in ((a, b, c), (a, c, d))])


def box_corners(size: tuple[float, float, float], shift: Any = (0.0, 0.0, 0.0)) -> NDArray[np.float64]:
    signs = np.array([[(i >> 2) & 1, (i >> 1) & 1, i & 1] for i in range(8)]) - 0.5
    return np.asarray(signs * np.array(size) + np.array(shift), dtype=np.float64)


def write_obj(path: Path, *boxes: NDArray[np.float64]) -> Path:
    lines = [f"v {x} {y} {z}" for box in boxes for x, y, z in box.tolist()]
    for number in range(len(boxes)):
        lines += [f"f {a} {b} {c}" for a, b, c in (box_faces() + 1 + 8 * number).tolist()]
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text("\n".join(lines) + "\n")
    return path


def test_a_box_a_cylinder_and_a_ball_are_found() -> None:
    size = (0.06, 0.02, 0.01)
    box = fit_mesh(mesh_from_arrays(box_corners(size, (0.1, 0.0, 0.0)), box_faces()))
    (found,) = box.primitives
    assert found.kind == "box"
    np.testing.assert_allclose(sorted(found.size), sorted(size), atol=1e-6)
    np.testing.assert_allclose(found.pose[:3, 3], (0.1, 0.0, 0.0), atol=1e-6)
    assert box.mean < 1e-3
    for name, kind in (("can:2", "cylinder"), ("ball:1", "sphere")):
        fit = fit_mesh(object_sets.load(f"procedural:{name}")[0].load())
        assert [one.kind for one in fit.primitives] == [kind]
        assert fit.mean < 1.5e-3


def test_a_bent_part_is_two_boxes() -> None:
    long, short = box_corners((0.08, 0.02, 0.02)), box_corners((0.02, 0.02, 0.06), (0.03, 0.0, 0.04))
    faces = np.concatenate([box_faces(), box_faces() + 8])
    fit = fit_mesh(mesh_from_arrays(np.concatenate([long, short]), faces, clean=None))
    assert [one.kind for one in fit.primitives] == ["box", "box"]
    volumes = sorted(float(np.prod(one.size)) for one in fit.primitives)
    assert volumes == pytest.approx([24e-6, 32e-6], rel=0.02)


@pytest.mark.parametrize(
    ("shape", "depth", "half_height"),
    [
        (Primitive("box", np.eye(4), (0.2, 0.4, 0.6)), 0.1, 0.3),
        (Primitive("cylinder", np.eye(4), (0.3, 0.8)), 0.3, 0.4),
        (Primitive("sphere", np.eye(4), (0.5,)), 0.5, 0.5),
    ],
)
def test_distances_are_those_of_closed_forms(shape: Primitive, depth: float, half_height: float) -> None:
    on_surface = shape.surface(2000, np.random.default_rng(0))
    np.testing.assert_allclose(shape.outside(on_surface), 0.0, atol=1e-12)
    middle, above = np.zeros((1, 3)), np.array([[0.0, 0.0, half_height + 0.1]])
    assert shape.outside(np.concatenate([middle, above])).tolist() == pytest.approx([-depth, 0.1])


def with_meshes(folder: Path, filename: str, scale: str = "") -> Path:
    """Copy the gripper's files; the box of each pad becomes a mesh."""
    text = (ASSETS / "panda_gripper.urdf").read_text()
    pads = re.findall(r'<collision name="(\w+_pad)">.*?<box size="([^"]+)"/>', text, flags=re.DOTALL)
    assert [name for name, _ in pads] == ["leftfinger_pad", "rightfinger_pad"]
    size = pads[0][1]
    text = text.replace(f'<box size="{size}"/>', f'<mesh filename="{filename}"{scale}/>')
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "hand.urdf").write_text(text)
    (folder / "hand.toml").write_text((ASSETS / "hand.toml").read_text())
    return folder


def pad_size() -> tuple[float, float, float]:
    text = (ASSETS / "panda_gripper.urdf").read_text()
    found = re.search(r'<collision name="leftfinger_pad">.*?<box size="([^"]+)"/>', text, flags=re.DOTALL)
    assert found is not None
    x, y, z = map(float, found[1].split())
    return x, y, z


def boxes_of(hand: Hand) -> NDArray[np.float64]:
    corners = corners_of(hand, hand.open(0.0))
    return corners[np.lexsort(np.round(corners, 5).T)]


@pytest.mark.parametrize("where", ["beside", "scaled", "package", "file"])
def test_meshes_stand_for_the_boxes_they_show(tmp_path: Path, where: str, caplog: pytest.LogCaptureFixture) -> None:
    folder, scale, factor = tmp_path / "robot" / "urdf", "", 1.0
    name = {
        "beside": "../meshes/pad.obj",
        "scaled": "../meshes/pad.obj",
        "package": "package://robot/meshes/pad.obj",
    }.get(where)
    if where == "scaled":
        scale, factor = ' scale="0.001 0.001 0.001"', 1000.0
    file = write_obj(tmp_path / "robot" / "meshes" / "pad.obj", factor * box_corners(pad_size()))
    with_meshes(folder, name or f"file://{file}", scale)
    with caplog.at_level(logging.INFO, logger="graspbox"):
        hand = load_hand((folder / "hand.urdf", folder / "hand.toml"))
    assert "leftfinger_pad is 1 primitives" in caplog.text
    np.testing.assert_allclose(boxes_of(hand), boxes_of(load_hand("panda_gripper")), atol=1e-5)
    assert hand.shapes(hand.open(0.0))[2].sum() == 2
    assert "<mesh" not in hand.files[0]


def test_a_pad_of_several_shapes_is_a_pad_as_a_whole(tmp_path: Path) -> None:
    x, y, z = pad_size()
    write_obj(tmp_path / "pad.obj", box_corners((x, y, z)), box_corners((x, y, z / 3), (0.0, 1.5 * y, z / 3)))
    folder = with_meshes(tmp_path, "pad.obj")
    fits = fitted_urdf(folder / "hand.urdf").fits
    assert [len(fit.primitives) for fit in fits.values()] == [2, 2]
    hand = load_hand((folder / "hand.urdf", folder / "hand.toml"))
    assert hand.shapes(hand.open(0.0))[2].sum() == 4
    assert 'name="leftfinger_pad.1"' in hand.files[0]


def test_a_shape_of_a_mesh_may_pass_through_others(tmp_path: Path) -> None:
    """Its name is known only once the mesh is fitted."""
    x, y, z = pad_size()
    write_obj(tmp_path / "pad.obj", box_corners((x, y, z)), box_corners((x, y, z / 3), (0.0, 1.5 * y, z / 3)))
    folder = with_meshes(tmp_path, "pad.obj")
    toml = folder / "hand.toml"
    text = toml.read_text()
    head = text.index("\n[")
    for name, message in (("leftfinger_pad.1", ""), ("leftfinger_pad.7", "there is no link or collider")):
        toml.write_text(f'{text[:head]}\nno_contact = [["{name}", "rightfinger_pad"]]\n{text[head:]}')
        if message:
            with pytest.raises(HandError, match=message):
                load_hand((folder / "hand.urdf", toml))
        else:
            pairs = describe(load_hand((folder / "hand.urdf", toml))).no_contact
            assert frozenset(("leftfinger_pad.1", "rightfinger_pad.0")) in pairs


def write_gltf(folder: Path, corners: NDArray[np.float64]) -> None:
    """Write a mesh whose vertices and triangles are in a file beside it."""
    points, faces = corners.astype("<f4").tobytes(), box_faces().astype("<u4").tobytes()
    (folder / "pad.bin").write_bytes(points + faces)
    views = [{"buffer": 0, "byteOffset": 0, "byteLength": len(points)}]
    views.append({"buffer": 0, "byteOffset": len(points), "byteLength": len(faces)})
    accessors = [
        {"bufferView": 0, "componentType": 5126, "count": 8, "type": "VEC3", "min": [-1, -1, -1], "max": [1, 1, 1]},
        {"bufferView": 1, "componentType": 5125, "count": 36, "type": "SCALAR"},
    ]
    scene = {
        "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}], "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}],
        "buffers": [{"uri": "pad.bin", "byteLength": len(points + faces)}],
        "bufferViews": views, "accessors": accessors,
    }  # fmt: skip
    (folder / "pad.gltf").write_text(json.dumps(scene))


def test_fits_of_a_gltf_follow_the_files_beside_it(tmp_path: Path) -> None:
    folder = with_meshes(tmp_path, "pad.gltf")
    for factor in (1.0, 0.5):
        size = tuple(factor * side for side in pad_size())
        write_gltf(folder, box_corners((size[0], size[1], size[2])))
        (found,) = fitted_urdf(folder / "hand.urdf").fits["leftfinger_pad"].primitives
        np.testing.assert_allclose(sorted(found.size), sorted(size), atol=1e-5)


def test_fits_of_another_version_are_not_used(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Its readers may have read the same file in another way."""
    folder = with_meshes(tmp_path, "pad.obj")
    write_obj(tmp_path / "pad.obj", box_corners(pad_size()))
    keys: list[str] = []

    def seen(key: str, make: Any) -> Any:
        keys.append(key)
        return make()

    monkeypatch.setattr(urdf_meshes, "cached_fits", seen)
    fitted_urdf(folder / "hand.urdf")
    monkeypatch.setattr("graspbox._core.__version__", "another")
    fitted_urdf(folder / "hand.urdf")
    assert len(set(keys)) == 2


def test_errors_name_the_given_files(tmp_path: Path) -> None:
    write_obj(tmp_path / "pad.obj", box_corners(pad_size()))
    folder = with_meshes(tmp_path, "pad.obj")
    (folder / "mine.toml").write_text((folder / "hand.toml").read_text().replace('unit = "N"', 'unit = "kN"', 1))
    with pytest.raises(HandError, match=f"(?m)^{re.escape(str(folder / 'mine.toml'))}:\\d+: .*kN"):
        load_hand((folder / "hand.urdf", folder / "mine.toml"))


def test_fits_are_cached_and_a_damaged_cache_is_made_again(tmp_path: Path, cache: Path) -> None:
    write_obj(tmp_path / "pad.obj", box_corners(pad_size()))
    folder = with_meshes(tmp_path, "pad.obj")
    first = fitted_urdf(folder / "hand.urdf").text
    (stored,) = cache.glob("*.json")
    shapes = json.loads(stored.read_text())
    shapes["fits"][0]["primitives"][0]["size"] = [0.5, 0.5, 0.5]
    stored.write_text(json.dumps(shapes))
    assert 'size="0.5 0.5 0.5"' in fitted_urdf(folder / "hand.urdf").text
    stored.write_text("{")
    assert fitted_urdf(folder / "hand.urdf").text == first


def test_a_cache_that_cannot_be_written_is_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    (tmp_path / "occupied").write_text("")
    monkeypatch.setenv("GRASPBOX_CACHE", str(tmp_path / "occupied"))
    write_obj(tmp_path / "pad.obj", box_corners(pad_size()))
    folder = with_meshes(tmp_path, "pad.obj")
    with caplog.at_level(logging.WARNING, logger="graspbox"):
        assert len(fitted_urdf(folder / "hand.urdf").fits) == 2
    assert "is not cached" in caplog.text


def test_a_urdf_without_meshes_stays_as_it_is() -> None:
    fitted = fitted_urdf(ASSETS / "panda_gripper.urdf")
    assert fitted.text == (ASSETS / "panda_gripper.urdf").read_text()
    assert fitted.fits == {}


@pytest.mark.parametrize(("variable", "inside"), [("AMENT_PREFIX_PATH", "share"), ("ROS_PACKAGE_PATH", ".")])
def test_packages_of_a_sourced_workspace_are_found(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, variable: str, inside: str
) -> None:
    package = tmp_path / "workspace" / inside / "claw_meshes"
    package.mkdir(parents=True)
    write_obj(package / "pad.obj", box_corners(pad_size()))
    (tmp_path / "hand").mkdir()
    folder = with_meshes(tmp_path / "hand", "package://claw_meshes/pad.obj")
    with pytest.raises(HandError, match=r"is missing; name it .* or source the ROS workspace of"):
        fitted_urdf(folder / "hand.urdf")
    monkeypatch.setenv(variable, f"{tmp_path / 'none'}:{tmp_path / 'workspace'}")
    assert len(fitted_urdf(folder / "hand.urdf").fits) == 2


def test_a_path_of_another_machine_is_found_by_its_end(tmp_path: Path) -> None:
    (tmp_path / "meshes" / "right").mkdir(parents=True)
    pad = tmp_path / "meshes" / "right" / "pad.obj"
    write_obj(pad, box_corners(pad_size()))
    folder = with_meshes(tmp_path, "file:///home/someone/install/share/claw/meshes/right/pad.obj")
    fitted = fitted_urdf(folder / "hand.urdf")
    assert len(fitted.fits) == len(fitted.assumptions) == 2
    assert fitted.assumptions[0].endswith(f"claw/meshes/right/pad.obj' is missing; it is taken to be {pad}")
    # The name of a file alone could be any.
    pad.rename(tmp_path / "pad.obj")
    with pytest.raises(HandError, match="is missing; name it"):
        fitted_urdf(folder / "hand.urdf")


@pytest.mark.parametrize(
    ("filename", "scale", "message"),
    [
        ("none.obj", "", r"collider 'leftfinger_pad': mesh 'none.obj' is missing; name it"),
        ("a" * 400 + ".obj", "", r"hand.urdf:\d+: collider 'leftfinger_pad': mesh 'a+.obj' is missing; name it"),
        ("pad.obj", ' scale="1 1"', r'hand.urdf:\d+: attribute scale is "1 1"; give 3 finite'),
        ("pad.obj", ' scale="0 1 1"', r"hand.urdf:\d+: .*scale is 0; it must be other than 0"),
        ("pad.obj", ' scale="a b c"', r'hand.urdf:\d+: attribute scale is "a b c"; give 3 finite'),
        ("empty.obj", "", r"mesh 'empty.obj': "),
        ("flat.obj", "", r"mesh 'flat.obj': "),
    ],
)
def test_meshes_that_cannot_be_used_are_named(tmp_path: Path, filename: str, scale: str, message: str) -> None:
    write_obj(tmp_path / "pad.obj", box_corners(pad_size()))
    write_obj(tmp_path / "flat.obj", box_corners((0.01, 0.01, 0.0)))
    (tmp_path / "empty.obj").write_text("")
    folder = with_meshes(tmp_path, filename, scale)
    with pytest.raises(HandError, match=message):
        load_hand((folder / "hand.urdf", folder / "hand.toml"))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (("<robot", "<!DOCTYPE a [<!ENTITY b 'c'>]><robot"), r"hand.urdf:\d+: a document type declaration"),
        (("</robot>", ""), r"hand.urdf:\d+: the element <robot> is not closed"),
    ],
)
def test_files_that_are_no_urdf_are_refused(tmp_path: Path, change: tuple[str, str], message: str) -> None:
    write_obj(tmp_path / "pad.obj", box_corners(pad_size()))
    folder = with_meshes(tmp_path, "pad.obj")
    text = (folder / "hand.urdf").read_text()
    (folder / "hand.urdf").write_text(text.replace(*change))
    with pytest.raises(HandError, match=message):
        load_hand((folder / "hand.urdf", folder / "hand.toml"))
