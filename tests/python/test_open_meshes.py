"""Meshes that bound no solid, or several: overlapping shells, holes, sheets. All functions agree on their mass."""

import logging
from pathlib import Path

import gymnasium
import numpy as np
import pytest
from numpy.typing import NDArray

import graspbox
from graspbox import errors

Faces = NDArray[np.int64]


def ball(radius: float, x: float, lid: float = np.inf) -> tuple[NDArray[np.float64], Faces]:
    """Vertices and faces of a ball around (x, 0, 0), without its faces higher than `lid` radii."""
    meridians, parallels = 48, 24
    polar, around = np.meshgrid(
        np.linspace(0.0, np.pi, parallels + 1), np.linspace(0.0, 2.0 * np.pi, meridians, endpoint=False), indexing="ij"
    )
    points = np.stack([np.sin(polar) * np.cos(around), np.sin(polar) * np.sin(around), np.cos(polar)], axis=-1)
    corner = np.arange(points.size // 3).reshape(polar.shape)
    low, high, right = corner[1:], corner[:-1], np.roll(corner, -1, axis=1)
    faces = np.concatenate(
        [np.stack(f, axis=-1).reshape(-1, 3) for f in ((high, low, right[1:]), (high, right[1:], right[:-1]))]
    )
    vertices = radius * points.reshape(-1, 3)
    kept = faces[vertices[faces, 2].mean(axis=1) < lid * radius]
    return vertices + np.array([x, 0.0, 0.0]), kept


def joined(*meshes: tuple[NDArray[np.float64], Faces]) -> tuple[NDArray[np.float64], Faces]:
    starts = np.cumsum([0, *(len(vertices) for vertices, _ in meshes[:-1])])
    faces = [faces + start for (_, faces), start in zip(meshes, starts, strict=True)]
    return np.concatenate([vertices for vertices, _ in meshes]), np.concatenate(faces)


def write_obj(path: Path, vertices: NDArray[np.float64], faces: Faces) -> Path:
    lines = [f"v {x:.9g} {y:.9g} {z:.9g}" for x, y, z in vertices] + [f"f {a} {b} {c}" for a, b, c in faces + 1]
    path.write_text("\n".join(lines) + "\n")
    return path


def assert_scene_agrees(mesh: graspbox.Mesh) -> None:
    body = graspbox.Scene(mesh).body
    assert body.mass == mesh.mass
    np.testing.assert_array_equal(body.center_of_mass, mesh.center_of_mass)
    np.testing.assert_array_equal(body.inertia, mesh.inertia)
    assert np.linalg.eigvalsh(mesh.inertia).min() > 0.0


def test_overlapping_shells_weigh_their_union(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    """Two balls of 30 and 27 mm, 30 mm apart: one counted as a cavity of the other, and left 30 cm3."""
    vertices, faces = joined(ball(0.03, 0.0), ball(0.027, 0.03))
    path = write_obj(tmp_path / "balls.obj", vertices, faces)
    with caplog.at_level(logging.WARNING, logger="graspbox"):
        mesh = graspbox.load_mesh(path)
    assert caplog.records == []
    assert mesh.volume == pytest.approx(168.2e-6, rel=0.01)
    assert mesh.center_of_mass[0] == pytest.approx(0.0120, abs=5e-4)
    assert_scene_agrees(mesh)
    unturned = graspbox.load_mesh(path, clean=graspbox.CleanConfig(orient=False))
    np.testing.assert_allclose(unturned.inertia, mesh.inertia)
    assert_scene_agrees(unturned)
    assert len(graspbox.plan(mesh).poses)


def test_surfaces_with_holes_are_used_with_a_warning(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    """Two overlapping balls without lids once had, in a scene, twice the mass of their enclosed volume."""
    path = write_obj(tmp_path / "lidless.obj", *joined(ball(0.03, 0.0, 0.9), ball(0.027, 0.03, 0.9)))
    with caplog.at_level(logging.WARNING, logger="graspbox"):
        mesh = graspbox.load_mesh(path)
    (record,) = caplog.records
    assert str(path) in record.getMessage()
    assert "holes" in record.getMessage()
    assert mesh.volume == pytest.approx(168.2e-6, rel=0.05)
    assert_scene_agrees(mesh)
    assert len(graspbox.plan(mesh).poses)
    result = graspbox.simulate(mesh, graspbox.plan(mesh).best(3))
    assert np.isfinite(result.lift).all()
    caplog.clear()
    with caplog.at_level(logging.WARNING, logger="graspbox"):
        env = gymnasium.make("graspbox/Grasp-v0", objects=str(path))
        env.reset(seed=0)
        assert np.isfinite(float(env.step(env.action_space.sample())[1]))
        env.close()
    assert any(str(path) in record.getMessage() for record in caplog.records)


def test_sheets_weigh_their_hull_and_flat_ones_are_refused_by_name(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    side = np.linspace(-0.05, 0.05, 12)
    x, y = (grid.ravel() for grid in np.meshgrid(side, side, indexing="ij"))
    corner = np.arange(144).reshape(12, 12)
    a, b, c, d = corner[:-1, :-1], corner[1:, :-1], corner[1:, 1:], corner[:-1, 1:]
    faces = np.concatenate([np.stack(f, axis=-1).reshape(-1, 3) for f in ((a, b, c), (a, c, d))])
    saddle = write_obj(tmp_path / "saddle.obj", np.stack([x, y, 4.0 * x * y], axis=-1), faces)
    with caplog.at_level(logging.WARNING, logger="graspbox"):
        mesh = graspbox.load_mesh(saddle)
    (record,) = caplog.records
    assert str(saddle) in record.getMessage()
    assert "convex hull" in record.getMessage()
    assert_scene_agrees(mesh)

    flat = write_obj(tmp_path / "flat.obj", np.stack([x, y, 0.0 * x], axis=-1), faces)
    with pytest.raises(errors.MeshError, match=r"flat\.obj.*no volume"):
        graspbox.load_mesh(flat)
    with pytest.raises(errors.MeshError, match=r"flat\.obj.*no volume"):
        gymnasium.make("graspbox/Grasp-v0", objects=str(flat)).reset(seed=0)
    # Thick enough to have a volume, too thin for collision geometry.
    sides = joined(
        (np.stack([x, y, 0.0 * x], axis=-1), faces[:, ::-1]), (np.stack([x, y, 0.0 * x + 4e-7], axis=-1), faces)
    )
    rim = np.concatenate([corner[:-1, 0], corner[-1, :-1], corner[:0:-1, -1], corner[0, :0:-1]])
    after = np.roll(rim, -1)
    walls = np.concatenate(
        [np.stack([rim, after, after + 144], axis=-1), np.stack([rim, after + 144, rim + 144], axis=-1)]
    )
    thin = write_obj(tmp_path / "thin.obj", sides[0], np.concatenate([sides[1], walls]))
    for use in (graspbox.Scene, graspbox.plan):
        with pytest.raises(errors.MeshError, match=r"thin\.obj.*no volume"):
            use(graspbox.load_mesh(thin, clean=graspbox.CleanConfig(weld=0.0)))
