"""Voxels and their files: shapes, frames, errors, the command line, and an independent library on scanned objects."""

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

import graspbox
from graspbox import errors, object_sets
from graspbox.meshes.voxels import Voxels


def corner_box() -> graspbox.Mesh:
    """Make a box of 8 x 4 x 2 cm whose least corner is at (1, 2, 3)."""
    corners = [[x, y, z] for x in (1, 1.08) for y in (2, 2.04) for z in (3, 3.02)]
    faces = [[0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1]]
    faces += [[2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3]]
    return graspbox.mesh_from_arrays(corners, faces)


def test_voxels_of_a_box_are_where_it_is() -> None:
    voxels = graspbox.voxelize(corner_box(), 8)
    assert voxels.occupancy.shape == (8, 8, 8)
    assert voxels.occupancy.dtype == np.bool_
    assert voxels.occupancy[:, :4, :2].all()
    assert voxels.occupancy.sum() == 8 * 4 * 2
    assert voxels.fill == "winding"
    assert voxels.voxel_size == pytest.approx(0.01)
    assert voxels.volume == pytest.approx(corner_box().volume)
    np.testing.assert_allclose(voxels.origin, [1, 2, 3])
    centers = voxels.centers()
    np.testing.assert_allclose(centers.min(axis=0), [1.005, 2.005, 3.005])
    np.testing.assert_allclose(centers.max(axis=0), [1.075, 2.035, 3.015])
    assert voxels.occupancy[tuple(voxels.indices(centers).T)].all()
    assert (voxels.indices([[0.995, 2.001, 3.081]]) == [[-1, 0, 8]]).all()


def test_options_mean_what_binvox_means() -> None:
    mesh = object_sets.load("procedural:mug:3")[0].load()
    solid = graspbox.voxelize(mesh, 64).occupancy
    shell = graspbox.voxelize(mesh, 64, "surface").occupancy
    exact = graspbox.voxelize(mesh, 64, exact=True).occupancy
    assert (exact == solid | shell).all()
    half = graspbox.voxelize(mesh, 64, exact=True, down=1)
    assert half.resolution == 32
    assert (half.occupancy == (exact.reshape(32, 2, 32, 2, 32, 2).sum(axis=(1, 3, 5)) >= 4)).all()
    around = np.pad(exact, 1)
    neighbours = [np.roll(around, d, axis)[1:-1, 1:-1, 1:-1] for axis in range(3) for d in (-1, 1)]
    hollow = graspbox.voxelize(mesh, 64, exact=True, remove_internal=True)
    assert (hollow.occupancy == exact & ~np.all(neighbours, axis=0)).all()
    points, _ = mesh.sample(20_000, 0)
    voxels = graspbox.voxelize(mesh, 64, "surface")
    inside = np.clip(voxels.indices(points), 0, 63)
    assert voxels.occupancy[tuple(inside.T)].all()
    assert voxels.fill is None


def test_files_read_back(tmp_path: Path) -> None:
    voxels = graspbox.voxelize(object_sets.load("procedural:bottle:1")[0].load(), 24)
    path = tmp_path / "bottle.binvox"
    voxels.save(path)
    assert list(tmp_path.iterdir()) == [path]
    again = Voxels.load(path)
    assert (again.occupancy == voxels.occupancy).all()
    assert (again.origin == voxels.origin).all()
    assert again.voxel_size == pytest.approx(voxels.voxel_size, rel=1e-15)
    # The file's own order, read without the core: y fastest, then z, then x.
    header, _, runs = path.read_bytes().partition(b"\ndata\n")
    assert header.startswith(b"#binvox 1\ndim 24 24 24\ntranslate ")
    values, counts = np.frombuffer(runs, dtype=np.uint8).reshape(-1, 2).T
    assert (np.repeat(values, counts).reshape(24, 24, 24).transpose(0, 2, 1) == voxels.occupancy).all()


def test_what_is_wrong_is_named(tmp_path: Path) -> None:
    mesh = corner_box()
    for wrong, complaint in (({"resolution": 0}, "between 1 and 1024"), ({"resolution": 1025}, "between 1 and 1024"),
                             ({"mode": "hollow"}, "solid or surface"), ({"down": 6}, "halved"),
                             ({"down": 32}, "halved"), ({"down": -1}, r"down is -1 \(int\); .* not negative"),
                             ({"down": 10**30}, r"down is 10.* below 2\^32"), ({"resolution": 8.5}, "an integer"),
                             ({"resolution": -1}, "resolution is -1 .* not negative"),
                             ({"resolution": 10**30}, r"resolution is 10.* below 2\^32")):  # fmt: skip
        with pytest.raises(errors.ConfigError, match=complaint):
            graspbox.voxelize(mesh, **wrong)
    flags = np.ones((2, 2, 2), dtype=bool)
    for occupancy, origin, size in ((flags[:1], np.zeros(3), 1.0), (flags.astype(int), np.zeros(3), 1.0),
                                    (flags, np.zeros(2), 1.0), (flags, np.zeros(3), 0.0)):  # fmt: skip
        with pytest.raises(errors.ConfigError, match="give"):
            Voxels(occupancy, origin, size)
    with pytest.raises(errors.ConfigError, match="finite"):
        Voxels(flags, np.full(3, np.nan), 1.0).save(tmp_path / "a.binvox")
    with pytest.raises(OSError, match="No such file"):
        graspbox.load_binvox(tmp_path / "none.binvox")
    with pytest.raises(OSError, match="No such file"):
        graspbox.voxelize(mesh, 4).save(tmp_path / "none" / "a.binvox")
    (tmp_path / "cut.binvox").write_bytes(b"#binvox 1\ndim 64 64 64\ndata\n\0\xff")
    with pytest.raises(errors.MeshError, match="truncated"):
        graspbox.load_binvox(tmp_path / "cut.binvox")
    # Arrays are made contiguous before they are written.
    Voxels(np.arange(27).reshape(3, 3, 3).T % 2 == 0, [0, 0, 0], 1.0).save(tmp_path / "t.binvox")  # type: ignore[arg-type]
    read = graspbox.load_binvox(tmp_path / "t.binvox").occupancy
    assert (read == (np.arange(27).reshape(3, 3, 3).T % 2 == 0)).all()


def test_a_grid_beyond_memory_is_an_error() -> None:
    """An allocation that failed aborted the process."""
    code = """
import resource
import numpy as np
import graspbox
mesh = graspbox.mesh_from_arrays(np.eye(4, 3), [[0, 1, 2], [0, 2, 3], [0, 3, 1], [1, 3, 2]])
graspbox.voxelize(mesh, 8)
used = int(open("/proc/self/statm").read().split()[0]) * resource.getpagesize()
for room, options in ((2**29, {}), (2**30 + 2**29, {"remove_internal": True})):
    resource.setrlimit(resource.RLIMIT_AS, (used + room, resource.RLIM_INFINITY))
    try:
        graspbox.voxelize(mesh, 1024, **options)
    except graspbox.GraspboxError as error:
        print(error)
"""
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=300)
    assert result.returncode == 0, result.stderr
    lines = result.stdout.splitlines()
    assert len(lines) == 2
    assert all("could not be allocated" in line and str(2**30) in line for line in lines), lines


def test_saving_keeps_links_and_respects_the_umask(tmp_path: Path) -> None:
    """Files had mode 0600, and links and devices were replaced."""
    voxels = graspbox.voxelize(corner_box(), 8)
    target, link = tmp_path / "target.binvox", tmp_path / "link.binvox"
    link.symlink_to(target.name)
    plain = tmp_path / "plain"
    plain.touch()
    voxels.save(link)
    assert link.is_symlink()
    assert target.stat().st_mode == plain.stat().st_mode
    assert (graspbox.load_binvox(target).occupancy == voxels.occupancy).all()
    os.mkfifo(tmp_path / "pipe")
    for special in (Path("/dev/null"), tmp_path / "pipe"):
        with pytest.raises(errors.FileError, match="regular file"):
            voxels.save(special)
        with pytest.raises(errors.FileError, match="regular file"):
            graspbox.load_binvox(special)


def test_command(tmp_path: Path) -> None:
    def run(*arguments: str) -> subprocess.CompletedProcess[str]:
        command = [sys.executable, "-m", "graspbox", "voxelize", *arguments]
        return subprocess.run(command, capture_output=True, text=True, timeout=300)

    assert "Usage" in run("--help").stdout
    path = tmp_path / "can.binvox"
    options = ["-d", "64", "--down", "1", "--ri", "--exact", "-o", str(path)]
    result = run("procedural:can:0", *options, "--json")
    assert result.returncode == 0, result.stderr
    facts = json.loads(result.stdout)
    assert set(facts) == {"resolution", "set", "volume", "voxel_size", "origin", "fill", "seconds"}
    voxels = graspbox.load_binvox(path)
    assert (facts["resolution"], facts["set"]) == (32, voxels.occupancy.sum())
    mesh = object_sets.load("procedural:can:0")[0].load()
    expected = graspbox.voxelize(mesh, 64, down=1, remove_internal=True, exact=True)
    assert (voxels.occupancy == expected.occupancy).all()
    assert "voxels set" in run("procedural:can:0").stdout
    assert run("procedural:can:0", "--mode", "hollow").returncode == 2
    assert run("procedural:can:0", "-d", "30", "--down", "2").returncode == 2


def every_center(voxels: Voxels) -> NDArray[np.float64]:
    """Give the centres of all voxels, in the order of their flat indices."""
    n = voxels.resolution
    return voxels.origin + (np.indices((n, n, n)).reshape(3, -1).T + 0.5) * voxels.voxel_size


@pytest.mark.slow
def test_scanned_objects_against_libigl() -> None:
    """20 YCB objects at 64 per side: whole (closed meshes), and with a hole that the vote of six rays must bridge.

    libigl's generalized winding number is defined for open meshes too, so half a turn is the reference there as well.
    Every voxel of the closed meshes was equal when this was written, 99.99 % of those with a hole: beside the hole,
    "inside" is a matter of definition.
    """
    igl = pytest.importorskip("igl", reason="needs libigl, from the extra 'dev'")
    total, differ, differ_open = 0, 0, 0
    for spec in object_sets.load("ycb")[::4]:
        mesh = spec.load()
        vertices, faces = mesh.vertices, mesh.faces.astype(np.int64)
        voxels = graspbox.voxelize(mesh, 64)
        centers = every_center(voxels)
        wrong = voxels.occupancy.ravel() != (igl.fast_winding_number(vertices, faces, centers) > 0.5)
        shell = graspbox.voxelize(mesh, 64, "surface").occupancy.ravel()
        distance = np.sqrt(igl.point_mesh_squared_distance(centers, vertices, faces)[0]) / voxels.voxel_size
        assert shell[distance < 0.5 - 1e-6].all()
        assert not shell[distance > np.sqrt(0.75) + 1e-6].any()
        middles = vertices[faces].mean(axis=1)
        gap = np.linalg.norm(middles - middles[100], axis=1) < 0.06 * np.ptp(vertices, axis=0).max()
        torn = graspbox.mesh_from_arrays(vertices, faces[~gap])
        open_voxels = graspbox.voxelize(torn, 64)
        assert (voxels.fill, open_voxels.fill) == ("winding", "vote")
        turns = igl.fast_winding_number(torn.vertices, torn.faces.astype(np.int64), every_center(open_voxels))
        wrong_open = open_voxels.occupancy.ravel() != (turns > 0.5)
        print(f"{spec.name}: {voxels.occupancy.sum()} set; {wrong.sum()} differ, {wrong_open.sum()} with a hole")
        total += len(centers)
        differ += int(wrong.sum())
        differ_open += int(wrong_open.sum())
    assert total == 20 * 64**3
    print(f"equal: {1 - differ / total:.6%}, with a hole {1 - differ_open / total:.6%}")
    assert differ <= 1e-5 * total
    assert differ_open <= 5e-4 * total
