"""Results that carry their objects, and grasp files that other programs take: mass, mesh, limits, frames by name."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import graspbox
from command_line import invoke
from graspbox import errors, object_sets
from graspbox.evaluation.planner_trials import try_set
from graspbox.hands.conventions import mechanism_of
from graspbox.tools import exchange
from graspbox.tools.commands import export_grasps
from graspbox.tools.exchange.dexgraspbench import grasps_of
from graspbox.tools.exchange.sources import ObjectSource, read_with_sources

pytest.importorskip("h5py", reason="ACRONYM's files need h5py, from the extra 'exchange'")
pytest.importorskip("yaml", reason="Isaac Grasp files need PyYAML, from the extra 'exchange'")

#: Format and suffix of each row of the table.
FILES = [(row.name, row.suffix) for row in exchange.FORMATS]


def _fields(path: Path) -> dict[str, Any]:
    """Read a file of DexGraspBench as the benchmark does."""
    found: dict[str, Any] = np.load(path, allow_pickle=True).item()
    return found


def _run(*words: str) -> Any:
    return invoke(["export-grasps", *words])


@pytest.fixture
def table(tmp_path: Path) -> str:
    result = try_set(object_sets.load("procedural:box:0-1"), poses=2, hand="panda_gripper")
    (tmp_path / "grasps.json").write_text(json.dumps(result.table(details=True)))
    return str(tmp_path / "grasps.json")


def test_a_result_carries_its_object(tmp_path: Path) -> None:
    """A table, a plan and all formats that graspbox reads have the mesh and its mass; nothing else is asked for."""
    mesh = object_sets.load("procedural:box:0", scale=0.9)[0].load()
    (tmp_path / "it.obj").write_text(_obj(mesh))
    objects = object_sets.load([str(tmp_path / "it.obj")], scale=0.5, mass=0.321)
    result = try_set(objects, poses=2, hand="panda_gripper")
    (tmp_path / "table.json").write_text(json.dumps(result.table(details=True)))
    plan = ["plan", str(tmp_path / "it.obj"), "--hand", "panda_gripper", "--scale", "0.5", "--out"]
    assert invoke([*plan, str(tmp_path / "plan.json")]).exit_code == 0
    by_density = object_sets.load([str(tmp_path / "it.obj")], scale=0.5)[0].load().mass
    for source, mass in (("table", 0.321), ("plan", by_density)):
        for to, suffix in FILES:
            out = tmp_path / source / f"{to}{suffix}"
            done = _run(str(tmp_path / f"{source}.json"), "--to", to, "--out", str(out), "--count", "1")
            assert done.exit_code == 0, done.output
            if suffix == ".npy":
                assert _fields(out)["obj_path"] == "meshes/it.obj"
                continue
            found = exchange.load(out)
            assert found.mass == pytest.approx(mass)
            read = found.load_mesh(out.parent)
            assert read.mass == pytest.approx(mass)
            np.testing.assert_allclose(read.bounds, objects[0].load().bounds, atol=1e-7)
    (tmp_path / "it.obj").unlink()
    words = [str(tmp_path / "table.json"), "--to", "acronym", "--out"]
    gone = _run(*words, str(tmp_path / "gone.h5"))
    assert gone.exit_code == 0
    assert "written without its mesh, which --objects can name" in " ".join(gone.stderr.split())
    assert exchange.load(tmp_path / "gone.h5").mass == 0.321
    assert _run(*words, str(tmp_path / "given.json"), "--mass", "0.5").exit_code == 0
    assert exchange.load(tmp_path / "given.json").mass == 0.5


def _obj(mesh: graspbox.Mesh) -> str:
    lines = [f"v {x!r} {y!r} {z!r}" for x, y, z in mesh.vertices.tolist()]
    return "\n".join(lines + [f"f {a} {b} {c}" for a, b, c in (mesh.faces.astype(int) + 1).tolist()])


def test_a_mass_of_several_objects_is_refused(table: str, tmp_path: Path) -> None:
    done = _run(table, "--to", "acronym", "--out", str(tmp_path / "all"), "--mass", "0.5")
    assert "--mass is the mass of one object" in str(done.exception)


def test_a_scale_without_objects_is_refused(table: str, tmp_path: Path) -> None:
    done = _run(table, "--to", "acronym", "--out", str(tmp_path / "all"), "--scale", "0.5")
    assert done.exit_code == 2
    assert "results carry the scale of their own" in " ".join(done.stderr.replace("│", " ").split())


def test_a_changed_mesh_is_refused(table: str, tmp_path: Path) -> None:
    document = json.loads(Path(table).read_text())
    document["objects"][0]["sha256"] = "0" * 64
    Path(table).write_text(json.dumps(document))
    done = _run(table, "--to", "acronym", "--out", str(tmp_path / "it.h5"), "--only", "box-000000")
    assert "the grasps are for another mesh" in str(done.exception)


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """Make data sets of a mesh with ``--mass``, and of a folder with a table of masses."""
    pytest.importorskip("pyarrow", reason="data sets need pyarrow, from the extra 'data'")
    pytest.importorskip("pydantic", reason="data sets need pydantic, from the extra 'data'")
    root = tmp_path_factory.mktemp("masses")
    (root / "meshes").mkdir()
    (root / "meshes/it.obj").write_text(_obj(object_sets.load("procedural:box:0")[0].load()))
    (root / "meshes/masses.csv").write_text("name,mass\nit,0.222\n")
    small = ["--hand", "panda_gripper", "--poses", "6", "--views", "1", "--rests", "1"]
    for name, words in (
        ("given", ["--objects", root / "meshes/it.obj", "--mass", "0.111"]),
        ("table", ["--objects", f"dir:{root / 'meshes'}"]),
    ):
        done = invoke(["dataset", *words, *small, "--out", root / name])
        assert done.exit_code == 0, done.output
    return {name: root / name for name in ("given", "table")}


@pytest.mark.parametrize(("name", "mass"), [("given", 0.111), ("table", 0.222)])
def test_a_data_set_carries_its_masses(
    name: str, mass: float, data: dict[str, Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """They are written, and joint positions are simulated with them, not with the mass of a density."""
    used, simulated = [], exchange.simulated

    def recorded(grasps: exchange.ExchangeGrasps, mesh: graspbox.Mesh, **settings: Any) -> exchange.ExchangeGrasps:
        used.append(mesh.mass)
        return simulated(grasps, mesh, **settings)

    monkeypatch.setattr(exchange, "simulated", recorded)
    ((found, source),) = read_with_sources(data[name])[1].items()
    assert found == "it"
    assert source.mass == pytest.approx(mass)
    assert source == ObjectSource(str(data[name].parent / "meshes/it.obj"), 1.0, source.mass)
    for to, suffix in FILES:
        out = tmp_path / f"{to}{suffix}"
        done = _run(str(data[name]), "--to", to, "--out", str(out), "--count", "1", "--successful")
        assert done.exit_code == 0, done.output
        if suffix != ".npy":
            read = exchange.load(out)
            assert read.mass == read.load_mesh(tmp_path).mass == pytest.approx(mass)
    assert used == [pytest.approx(mass)] * 2
    heavier = tmp_path / "heavier.h5"
    assert _run(str(data[name]), "--to", "acronym", "--out", str(heavier), "--mass", "0.5").exit_code == 0
    assert exchange.load(heavier).mass == 0.5


def test_grasps_are_read_without_the_sources_of_a_data_set(
    data: dict[str, Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    from graspbox.data.trials import tables

    read, load = set(), tables.load

    def recorded(folder: Path, split: Any, columns: list[str]) -> Any:
        read.update(columns)
        return load(folder, split, columns)

    monkeypatch.setattr(tables, "load", recorded)
    (grasps,) = exchange.read(data["given"])
    assert not {"source", "scale"} & read
    (again,) = read_with_sources(data["given"])[0]
    assert {"source", "scale"} <= read
    assert again == grasps


def test_grasps_without_a_mesh_say_so() -> None:
    grasps = exchange.ExchangeGrasps.of(np.eye(4)[None], hand="panda_gripper", object_name="it")
    with pytest.raises(errors.ConfigError, match="the grasps of 'it' name no mesh file"):
        grasps.load_mesh()


def _plain(**about: Any) -> exchange.ExchangeGrasps:
    """Give one grasp of the Franka Hand that needs no simulation."""
    made = exchange.ExchangeGrasps.of(
        np.eye(4)[None], hand="panda_gripper", success=1.0, world_from_object=np.eye(4), **about
    )
    made.grasp[:], made.squeeze[:] = 0.02, 0.01
    return made


@pytest.mark.parametrize(("to", "suffix"), FILES)
def test_a_name_is_no_mesh_file(to: str, suffix: str, tmp_path: Path) -> None:
    """Formats with one entry for both have the name of an object whose mesh is not known."""
    path = tmp_path / f"file{suffix}"

    def back() -> exchange.ExchangeGrasps:
        return (
            grasps_of(_fields(path), graspbox.load_hand("panda_gripper")) if suffix == ".npy" else exchange.load(path)
        )

    exchange.save(_plain(object_name="mug.2"), path, to)
    assert (back().mesh_file, back().object_name) == ("", "mug.2")
    with pytest.raises(errors.ConfigError, match=r"the grasps of 'mug\.2' name no mesh file"):
        back().load_mesh(tmp_path)
    exchange.save(_plain(object_name="mug", mesh_file="meshes/mug.STL"), path, to)
    assert back().mesh_file == "meshes/mug.STL"


def test_isaac_has_the_mass_without_a_mesh(tmp_path: Path) -> None:
    import yaml

    path = tmp_path / "it.yaml"
    for about, wanted in (
        ({}, None),
        ({"mass": 0.123}, {"mass": 0.123}),
        ({"mesh_file": "it.obj", "scale": 0.5}, {"mesh_file": "it.obj", "scale": 0.5}),
    ):
        exchange.save(_plain(object_name="it", **about), path, "isaac")
        document = yaml.safe_load(path.read_text())
        assert document.get("graspbox") == wanted
        back = exchange.load(path)
        assert (back.mesh_file, back.scale) == (about.get("mesh_file", ""), about.get("scale", 1.0))
        np.testing.assert_equal(back.mass, about.get("mass", np.nan))
    document["graspbox"] = {"scale": 0.25}
    path.write_text(yaml.safe_dump(document))
    assert exchange.load(path).scale == 0.25


def test_joint_positions_are_written_within_their_limits(tmp_path: Path) -> None:
    """Soft stops yield in simulation; the joints of other programs do not."""
    grasps = exchange.ExchangeGrasps.of(np.eye(4)[None], hand="soft_hand", success=1.0, world_from_object=np.eye(4))
    low, high = mechanism_of(grasps.hand).limits.T
    assert grasps.beyond_limits == 0.0
    grasps.grasp[0], grasps.squeeze[0] = high + 0.07, low - 0.02
    assert grasps.beyond_limits == pytest.approx(0.07)
    exchange.save(grasps, tmp_path / "it.yaml", "isaac")
    np.testing.assert_array_equal(exchange.load(tmp_path / "it.yaml", hand="soft_hand").grasp[0], high)
    exchange.save(grasps, tmp_path / "it.npy", "dexgraspbench")
    back = grasps_of(_fields(tmp_path / "it.npy"), grasps.hand)
    np.testing.assert_allclose(back.grasp[0], high, atol=1e-12)
    np.testing.assert_allclose(back.squeeze[0], low, atol=1e-12)
    np.testing.assert_array_equal(grasps.grasp[0], high + 0.07)


def test_what_is_beyond_limits_has_a_unit(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    slides, turns = _plain(), exchange.ExchangeGrasps.of(np.eye(4)[None], hand="soft_hand", success=1.0)
    slides.grasp[:] = mechanism_of(slides.hand).limits[:, 1] + 0.002
    turns.grasp[:] = mechanism_of(turns.hand).limits[:, 1] + 0.07
    options = export_grasps._Options(
        exchange.FORMATS[3], tmp_path, False, None, None, joints=True, meshes=True, threads=None, named=False, mass=None
    )
    for ready, wanted in (([slides], "0.002 m"), ([turns], "0.07 rad"), ([slides, turns], "0.002 m and 0.07 rad")):
        export_grasps._print_limited(ready, options)
        assert f"joint positions are up to {wanted} beyond their limits" in " ".join(capsys.readouterr().err.split())
    export_grasps._print_limited([_plain()], options)
    assert capsys.readouterr().err == ""


def test_frames_take_names_of_hands() -> None:
    hand = graspbox.load_hand("panda_gripper")
    found = exchange.frame_from_hand("panda_gripper", "gripper")
    np.testing.assert_array_equal(found, exchange.frame_from_hand(hand, "gripper"))
    with pytest.raises(errors.ConfigError, match="there is no hand 'panda'"):
        exchange.frame_from_hand("panda", "gripper")
    with pytest.raises(errors.ConfigError, match="there is no frame 'tool'; choose from base, gripper, vgn"):
        exchange.frame_from_hand(hand, "tool")  # type: ignore[arg-type]
