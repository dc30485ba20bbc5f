"""The command line and files: outputs are checked before the work, odd names work, and nothing is a traceback."""

import json
import os
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import graspbox
from graspbox import cli, errors, object_sets
from interrupting import interrupted
from test_cli import run

BOX = "procedural:box:0"


def refused(result: subprocess.CompletedProcess[str], status: int, complaint: str) -> None:
    """Check that a command ended with a sentence and an exit status."""
    assert result.returncode == status, result.stderr
    assert complaint in result.stderr.replace("\n", " ")
    assert "Traceback" not in result.stderr
    assert result.stdout == ""


def write_box(path: Path, x: float, y: float, z: float, turn: float = 0.0) -> Path:
    """Write a cuboid as an OFF file, turned about its x axis."""
    corners = np.array([(a * x, b * y, c * z) for a in (0, 1) for b in (0, 1) for c in (0, 1)])
    corners = corners @ np.array([[1, 0, 0], [0, np.cos(turn), -np.sin(turn)], [0, np.sin(turn), np.cos(turn)]]).T
    faces = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    lines = ["OFF", "8 6 0", *(" ".join(map(str, c)) for c in corners), *(f"4 {a} {b} {c} {d}" for a, b, c, d in faces)]
    path.write_text("\n".join(lines) + "\n")
    return path


@pytest.mark.parametrize("out", ["/proc/x.json", "/dev/null/x.json", "."])
@pytest.mark.parametrize(
    "arguments",
    [
        ("grasp", "--objects", "procedural:0-99", "--poses", "1"),
        ("plan", BOX),
        ("voxelize", BOX),
        ("evaluate", "planner", "--trials", "10000"),
    ],
    ids=lambda a: a[0],
)
def test_outputs_are_checked_before_the_work(arguments: tuple[str, ...], out: str, tmp_path: Path) -> None:
    """Work for 2,200 objects would take hours, for which `run` does not wait; the refusal comes at once."""
    refused(run(*arguments, "--out", tmp_path / out), 1, "graspbox: ")


def test_demo_checks_its_folder(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    refused(run("demo", "--out", tmp_path / "file"), 1, "file")


@pytest.mark.parametrize(
    ("picture", "status", "complaint"), [("a.xyz", 2, ".xyz"), (".", 2, "folder"), ("/proc/x/a.png", 1, "/proc/x")]
)
def test_pictures_are_checked_before_the_work(tmp_path: Path, picture: str, status: int, complaint: str) -> None:
    refused(run("plan", BOX, "--picture", tmp_path / picture), status, complaint)
    assert list(tmp_path.parent.glob("*.png")) == []


def test_a_picture_goes_into_a_new_folder(tmp_path: Path) -> None:
    picture = tmp_path / "deep" / "box.PNG"
    result = run("plan", BOX, "--max-boxes", "1", "--picture", picture)
    assert result.returncode == 0, result.stderr
    assert picture.read_bytes()[:4] == b"\x89PNG"
    assert [path.name for path in picture.parent.iterdir()] == ["box.PNG"]


def test_a_plan_that_is_saved_can_be_simulated(tmp_path: Path) -> None:
    out = tmp_path / "plan.json"
    result = run("plan", BOX, "--out", out, "--seed", "5", "--json")
    assert result.returncode == 0, result.stderr
    plan = graspbox.Plan.load(out)
    found = json.loads(result.stdout)
    assert [grasp["object_from_hand"] for grasp in found["grasps"]] == plan.poses.tolist()
    mesh = object_sets.load(BOX)[0].load()
    scene = graspbox.Scene(mesh)
    np.testing.assert_array_equal(scene.world_from_object, plan.world_from_object)
    same = graspbox.plan(mesh, seed=5, world_from_object=scene.world_from_object, decompose=_boxes())
    np.testing.assert_array_equal(same.poses, plan.poses)
    assert len(graspbox.simulate(mesh, plan[:2])) == 2


def _boxes() -> graspbox.DecomposeConfig:
    return graspbox.DecomposeConfig(max_boxes=8)


def test_plan_lets_the_object_settle(tmp_path: Path) -> None:
    """A plate whose file has it on edge is planned for as it lies."""
    plate = write_box(tmp_path / "plate.off", 0.12, 0.015, 0.12, turn=0.6)
    lying, standing = (json.loads(run("plan", plate, "--json", *flag).stdout) for flag in ((), ("--no-settle",)))
    up = [np.array(found["world_from_object"])[2, :3] for found in (lying, standing)]
    normal = np.array([0.0, np.cos(0.6), np.sin(0.6)])
    np.testing.assert_allclose(up[1], [0, 0, 1])
    assert abs(up[0] @ normal) > 0.99


def test_full_and_closed_outputs(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "graspbox", "objects", "procedural:0-999"]
    for extra in ([], ["--json"]):
        with open("/dev/full", "w") as full:
            result = subprocess.run([*command, *extra], stdout=full, stderr=subprocess.PIPE, text=True)
        assert result.returncode == 1
        assert result.stderr == "graspbox: the output cannot be written: No space left on device\n"
        with subprocess.Popen([*command, *extra], stdout=subprocess.PIPE, stderr=subprocess.PIPE) as closed:
            assert closed.stdout is not None
            assert closed.stderr is not None
            closed.stdout.close()
            assert closed.stderr.read() == b""
            assert closed.wait() == 141


def test_warnings_are_shown_once(tmp_path: Path) -> None:
    """A mesh whose surface is open, and a link to nothing; a mesh is loaded for more than one trial."""
    mesh = object_sets.load("procedural:can:0")[0].load()
    lines = [f"v {x:.6f} {y:.6f} {z:.6f}" for x, y, z in mesh.vertices]
    faces = [face for face in mesh.faces if mesh.vertices[face, 2].mean() < mesh.vertices[:, 2].max() - 1e-4]
    assert len(faces) < len(mesh.faces)
    lines += [f"f {a + 1} {b + 1} {c + 1}" for a, b, c in faces]
    (tmp_path / "open.obj").write_text("\n".join(lines))
    (tmp_path / "gone.obj").symlink_to("nowhere.obj")
    done = run("evaluate", "zero", "--objects", f"dir:{tmp_path}", "--trials", "3")
    assert done.returncode == 0
    warnings = [line for line in done.stderr.splitlines() if line.startswith("graspbox: ")]
    assert len(warnings) == 2
    assert "gone.obj is left out: it is a link to nowhere.obj, which does not exist" in warnings[0]
    assert "open.obj" in warnings[1]


def test_missing_files_are_named_in_sentences(tmp_path: Path) -> None:
    (tmp_path / "masses.csv").mkdir()
    write_box(tmp_path / "box.off", 0.1, 0.1, 0.1)
    image = ("--intrinsics", *"1111", "--policy", "x")
    for words, said in (
        (("grasp-image", tmp_path / "a.npy", *image), f"there is no such depth image: {tmp_path}/a.npy\n"),
        (("plan", tmp_path / "a.obj"), ""),
        (("objects", f"dir:{tmp_path}"), f"it is not a regular file: {tmp_path}/masses.csv\n"),
    ):
        done = run(*map(str, words))
        assert done.returncode in (1, 2)
        assert done.stderr.startswith(f"graspbox: {said}")
        assert not re.search(r"Errno|PosixPath", done.stderr)
    with pytest.raises(errors.FileError, match=r"^No such file or directory: .*/a\.obj$") as raised:
        graspbox.load_mesh(tmp_path / "a.obj")
    assert raised.value.errno == 2


def test_backends_that_do_not_exist_do_not_matter(tmp_path: Path) -> None:
    env = {**os.environ, "MPLBACKEND": "nope"}
    for arguments in (["objects", "procedural:1"], ["plan", BOX, "--picture", str(tmp_path / "a.png")]):
        command = [sys.executable, "-m", "graspbox", *arguments]
        result = subprocess.run(command, capture_output=True, text=True, env=env)
        assert result.returncode == 0, result.stderr


def test_a_bad_number_of_threads_is_reported_once() -> None:
    env = {**os.environ, "GRASPBOX_THREADS": "x"}
    command = [sys.executable, "-m", "graspbox", "grasp", "--objects", "procedural:0-1"]
    result = subprocess.run(command, capture_output=True, text=True, env=env)
    refused(result, 2, 'GRASPBOX_THREADS is "x"')
    assert result.stderr.count("GRASPBOX_THREADS") == 1
    refused(run("grasp", "--threads", "0"), 2, "--threads")


def test_ctrl_c_is_130() -> None:
    """In the middle of trials that would take hours."""
    ended = interrupted(
        "import graspbox.evaluation.planner_trials as trials\n"
        "real = trials.try_object\n"
        "trials.try_object = lambda *given, **settings: (ready(), real(*given, **settings))[1]\n"
        "sys.argv = ['graspbox', 'grasp', '--objects', 'procedural:0-99']\n"
        "from graspbox.__main__ import main; main()\n"
    )
    assert (ended.status, ended.stdout) == (130, "")
    assert set(ended.stderr.split()) <= {"ready"}


def test_names_that_are_no_text_or_look_like_markup(tmp_path: Path) -> None:
    odd = Path(os.fsdecode(os.fsencode(tmp_path) + b"/m\xff[red]g.off"))
    write_box(odd, 0.06, 0.06, 0.1)
    for arguments in (["plan", odd], ["plan", odd, "--json"], ["objects", odd], ["objects", f"dir:{tmp_path}"]):
        result = run(*arguments)
        assert result.returncode == 0, result.stderr
        assert "[red]g" in result.stdout
    out = tmp_path / "grasps.json"
    result = run("grasp", "--objects", odd, "--poses", "1", "--out", out)
    assert result.returncode == 0, result.stderr
    assert json.loads(out.read_text())["objects"][0]["name"] == "m�[red]g"


@pytest.mark.parametrize(
    ("arguments", "status", "complaint"),
    [
        (("objects", "dir:/proc"), 1, "folder"),
        (("objects", "x" * 5000 + ".stl"), 2, "names no object set"),
        (("objects", "~nobody-of-that-name/x.stl"), 2, ""),
        (("plan", "none.stl"), 2, "no mesh file"),
        (("plan", "procedural:0-1"), 2, "name one"),
        (("plan", BOX, "--fit", "best"), 2, "'best' is not one of"),
        (("plan", BOX, "--seed", "-1"), 2, "--seed"),
        (("plan", BOX, "--scale", "nan"), 2, "scale is nan"),
        (("grasp", "--details", "--objects", BOX), 2, "--json"),
        (("evaluate", "nobody"), 2, "nobody"),
        (("voxelize", BOX, "--mode", "foam"), 2, "foam"),
    ],
)
def test_refusals(
    arguments: tuple[str, ...],
    status: int,
    complaint: str,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setattr(sys, "argv", ["graspbox", *arguments])
    with pytest.raises(SystemExit) as ended:
        cli.app()
    out, err = capsys.readouterr()
    refused(subprocess.CompletedProcess(arguments, ended.value.code, out, err), status, complaint)  # type: ignore[arg-type]


def test_oversized_objects_are_their_own_error(tmp_path: Path) -> None:
    tower = write_box(tmp_path / "tower.off", 10.0, 10.0, 120.0)
    result = run("grasp", "--objects", tower, "--objects", BOX, "--poses", "1", "--json")
    assert result.returncode == 1
    assert "tower" in result.stderr
    assert [row["tried"] for row in json.loads(result.stdout)["objects"]] == [0, 1]


def test_meshes_that_vanish_are_their_own_error(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from graspbox.evaluation.planner_trials import try_set

    gone = write_box(tmp_path / "gone.off", 0.06, 0.06, 0.1)
    found = object_sets.load(str(gone))
    gone.unlink()
    (result,) = try_set(found, poses=1).objects
    assert "FileError" in result.error
    assert result.details()["grasps"] == []


def test_details_print_what_out_writes(tmp_path: Path) -> None:
    out = tmp_path / "grasps.json"
    result = run("grasp", "--objects", BOX, "--poses", "2", "--json", "--details", "--out", out)
    assert result.returncode == 0, result.stderr
    found: Any = json.loads(result.stdout)
    assert found == json.loads(out.read_text())
    keys = {"object_from_hand", "preshape", "feasible", "score", "box", "face", "touch", "press"}
    keys |= {"success", "secure", "failure", "lift", "kindness_rate", "legacy_success", "kindness", "time"}
    keys |= {"unconverged_steps", "survives_shake", "shake_shift"}
    assert all(set(grasp) == keys for grasp in found["objects"][0]["grasps"])
