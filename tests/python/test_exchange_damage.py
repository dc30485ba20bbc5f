"""Grasp files that are damaged, hostile, or of another kind: each is an error of one sentence."""

import json
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from graspbox import errors, load_hand
from graspbox.tools import exchange
from graspbox.tools.exchange.dexgraspbench import grasps_of

h5py = pytest.importorskip("h5py", reason="ACRONYM's files need h5py, from the extra 'exchange'")
yaml = pytest.importorskip("yaml", reason="Isaac Grasp files need PyYAML, from the extra 'exchange'")

ROOT = Path(__file__).parents[2]

Change = Callable[[Any], None]


def grasps(count: int = 3) -> exchange.ExchangeGrasps:
    """Give grasps of the Franka Hand that need no simulation."""
    poses = np.tile(np.eye(4), (count, 1, 1))
    poses[:, 2, 3] = np.linspace(0.0, 0.1, count)
    made = exchange.ExchangeGrasps.of(
        poses, hand="panda_gripper", success=np.ones(count), world_from_object=np.eye(4), object_name="it"
    )
    made.grasp[:], made.squeeze[:] = 0.02, 0.01
    return made


def refused(path: Path, why: str, **settings: Any) -> None:
    """Check that a file is refused in one sentence that names it and the reason."""
    with pytest.raises(errors.ConfigError, match=why) as caught:
        exchange.load(path, **settings)
    sentence = str(caught.value)
    assert sentence.startswith(repr(str(path)))
    assert "\n" not in sentence
    assert len(sentence) < 500 + len(str(path))


def _replace(name: str, values: Any) -> Change:
    def change(file: Any) -> None:
        del file[name]
        file[name] = values

    return change


def _delete(name: str) -> Change:
    def change(file: Any) -> None:
        del file[name]

    return change


def _huge(file: Any) -> None:
    """Declare a thousand million rows, of which none is stored: a file of a few kilobytes."""
    del file["grasps/transforms"]
    file.create_dataset("grasps/transforms", shape=(10**9, 4, 4), dtype="f8", chunks=(1024, 4, 4))


def _linked(file: Any) -> None:
    del file["grasps/transforms"]
    file["grasps/transforms"] = h5py.ExternalLink("/etc/passwd", "/grasps/transforms")


def _outside(file: Any) -> None:
    del file["grasps/transforms"]
    file.create_dataset("grasps/transforms", shape=(3, 4, 4), dtype="f8", external=[("/etc/passwd", 0, 384)])


def _poses(change: Callable[[Any], None]) -> np.ndarray[Any, Any]:
    poses = np.tile(np.eye(4), (3, 1, 1))
    change(poses)
    return poses


def _set(index: Any, value: float) -> Callable[[Any], None]:
    def change(poses: Any) -> None:
        poses[index] = value

    return change


@pytest.mark.parametrize(
    ("change", "why"),
    [
        (_delete("grasps/transforms"), "it lacks 'grasps/transforms'"),
        (_delete("object"), "it lacks 'object/file'"),
        (_replace("grasps/transforms", np.zeros((3, 4))), r"has shape \(3, 4\); it must be \(n, 4, 4\)"),
        (_replace("grasps/transforms", np.array(["a", "b"], dtype="S1")), "is not an array of numbers"),
        (_replace("grasps/transforms", _poses(_set((1, 0, 3), np.nan))), "poses of grasp 1 is not finite"),
        (_replace("grasps/transforms", _poses(_set((2, 0, 0), 1.1))), "grasp 2 is not a rigid motion"),
        (_replace("grasps/transforms", _poses(_set((0, 0, 0), -1.0))), "grasp 0 is not a rigid motion"),
        (_replace("grasps/transforms", _poses(_set((1, 2, 3), 120.0))), "grasp 1 is 120 m from the origin"),
        (_replace("grasps/qualities/flex/object_in_gripper", np.ones(2)), "3 transforms and 2 outcomes"),
        (_replace("grasps/qualities/flex/object_in_gripper", [0, 1, 7]), "the outcome of grasp 2 is 7.0"),
        (_replace("object/scale", -1.0), "scale is -1.0"),
        (_replace("object/scale", [1.0, 2.0]), r"has shape \(2,\); it must be one number"),
        (_replace("object/mass", np.inf), "'object/mass' is inf"),
        (_replace("object/file", 7), "'object/file' is not text"),
        (_replace("gripper/type", "robotiq"), "of the gripper 'robotiq', not 'panda'"),
        (_replace("grasps/graspbox_preshape", [0.0, 1.0, 0.0]), "preshape of grasp 1 is 1.0"),
        (_huge, "'grasps/transforms' has 1000000000 rows; at most 1000000"),
        (_linked, "is a link to another file"),
        (_outside, "is stored in another file"),
    ],
)
def test_spoilt_acronym(change: Change, why: str, tmp_path: Path) -> None:
    path = tmp_path / "it.h5"
    given = grasps()
    exchange.save(
        exchange.ExchangeGrasps.of(given.poses, hand=given.hand, success=given.success, mass=0.1), path, "acronym"
    )
    assert len(exchange.load(path)) == 3
    with h5py.File(path, "r+") as file:
        change(file)
    refused(path, why)


@pytest.mark.parametrize("share", [0.0, 0.01, 0.3, 0.9, 0.99])
def test_truncated_acronym(share: float, tmp_path: Path) -> None:
    path = tmp_path / "it.h5"
    exchange.save(grasps(200), path, "acronym")
    content = path.read_bytes()
    path.write_bytes(content[: int(share * len(content))])
    refused(path, "it is not an HDF5 file, or is damaged")


def test_files_that_are_not_there(tmp_path: Path) -> None:
    for name in ("it.h5", "it.json", "it.yaml"):
        with pytest.raises(errors.FileError, match="No such file"):
            exchange.load(tmp_path / name)
        (tmp_path / name).mkdir()
        with pytest.raises(errors.FileError, match="not a regular file"):
            exchange.load(tmp_path / name)
    refused_suffix = "has the suffix '.txt'; files with .h5, .json, .yaml are read"
    with pytest.raises(errors.ConfigError, match=refused_suffix):
        exchange.load(tmp_path / "it.txt")


def _document() -> dict[str, Any]:
    return {
        "object": {"file": "it.obj", "scale": 1.0},
        "grasps": {"transforms": [np.eye(4).tolist()] * 2, "object_in_gripper": [True, False]},
    }


@pytest.mark.parametrize(
    ("place", "value", "why"),
    [
        (("grasps", "transforms"), None, "transforms is not a list"),
        (("grasps", "transforms"), [[[1.0] * 4] * 3], r"transforms\[0\] is not a 4x4 matrix"),
        (("grasps", "transforms"), [np.eye(4).tolist(), [["a"] * 4] * 4], r"transforms\[1\] is not a 4x4 matrix"),
        (("grasps", "transforms"), [[[10**400] * 4] * 4] * 2, r"transforms\[0\] is not a 4x4 matrix"),
        (("grasps", "transforms"), (2 * np.eye(4)[None]).tolist() * 2, "not a rigid motion"),
        (("grasps", "transforms"), [[]] * 1_000_001, "has 1000001 entries; use at most 1000000"),
        (("grasps", "object_in_gripper"), [True], "has 1 entries, but there are 2 grasps"),
        (("grasps", "object_in_gripper"), [True, "yes"], "object_in_gripper is not a list of numbers"),
        (("grasps", "object_in_gripper"), [True, None], "the outcome of grasp 1 is nan"),
        (("object",), "it.obj", "object is missing or is not an object"),
        (("object", "scale"), "1", "the object's scale is '1'"),
        (("object", "scale"), 0, "scale is 0.0"),
        (("object", "file"), 3, "the object's file is 3"),
        (("gripper",), ["panda"], "gripper is"),
    ],
)
def test_spoilt_graspgen(place: tuple[str, ...], value: Any, why: str, tmp_path: Path) -> None:
    document = _document()
    inner = document
    for key in place[:-1]:
        inner = inner[key]
    inner[place[-1]] = value
    (tmp_path / "it.json").write_text(json.dumps(document))
    refused(tmp_path / "it.json", why)


@pytest.mark.parametrize(
    ("content", "why"),
    [
        ("", "it is not JSON"),
        ('{"grasps": ', "it is not JSON"),
        ("[" * 100_000, "it is not JSON"),
        ("[1, 2]", "it is JSON, but no object with grasps"),
        ("{}", "transforms is not a list"),
        ('{"transforms": [], "quality_flex_object_in_gripper": []}', "the object's file is None"),
        ('{"transforms": NaN}', "transforms is not a list"),
    ],
)
def test_other_json(content: str, why: str, tmp_path: Path) -> None:
    (tmp_path / "it.json").write_text(content)
    refused(tmp_path / "it.json", why)


def _yaml(**changes: Any) -> str:
    entry = {"confidence": 1.0, "position": [0.0, 0.0, 0.1], "orientation": {"w": 1.0, "xyz": [0.0, 0.0, 0.0]}}
    entry |= changes.pop("entry", {})
    return str(
        yaml.safe_dump({"format": "isaac_grasp", "format_version": 1.0, "grasps": {"grasp_0": entry}, **changes})
    )


@pytest.mark.parametrize(
    ("content", "why"),
    [
        ("", "it is YAML, but no mapping"),
        ("a: [b", "it is not YAML"),
        ("a: " + "[" * 50_000, "nested more than 8 levels deep|exceeded maximum nesting depth"),
        ("a: " + "[" * 20 + "]" * 20, "nested more than 8 levels deep"),
        ("a: &a [1, 1]\nb: &b [*a, *a]\nc: [*b, *b]", "it has aliases"),
        ("a: !!python/object/apply:os.system ['true']", "it is not YAML"),
        (_yaml(format="grasps"), "its format is 'grasps'"),
        (_yaml(format_version=2.0), "version 2.0"),
        (_yaml(grasps=[1]), "grasps is missing or is not a mapping"),
        (_yaml(entry={"position": [0.0, 0.0]}), "position of 'grasp_0' is not a list of 3 numbers"),
        (_yaml(entry={"position": [0.0, 0.0, "x"]}), "position of 'grasp_0' is 'x'"),
        (_yaml(entry={"position": [0.0, 0.0, 250.0]}), "grasp 0 is 250.1 m from the origin"),
        (_yaml(entry={"position": [0.0, 0.0, float("nan")]}), "position of 'grasp_0' is nan"),
        (_yaml(entry={"orientation": {"w": 2.0, "xyz": [0.0, 0.0, 0.0]}}), "orientation of 'grasp_0' has length 2"),
        (_yaml(entry={"orientation": [1, 0, 0, 0]}), "orientation of 'grasp_0' is missing or is not a mapping"),
        (_yaml(entry={"confidence": 3}), "confidence of grasp 0 is 3.0"),
        (_yaml(entry={"cspace_position": 1}), "is not a mapping of joints"),
        (_yaml(entry={"cspace_position": {"panda_finger_joint1": "a"}}), "finger_joint1 in cspace_position"),
    ],
)
def test_spoilt_isaac(content: str, why: str, tmp_path: Path) -> None:
    (tmp_path / "it.yaml").write_text(content)
    refused(tmp_path / "it.yaml", why)


def _fields() -> dict[str, Any]:
    qpos = np.array([0.0, 0.0, 0.3, 1.0, 0.0, 0.0, 0.0, 0.04, 0.04])
    stages = {f"{stage}_qpos": qpos for stage in ("pregrasp", "grasp", "squeeze")}
    return {"obj_pose": np.array([0.0, 0, 0, 1, 0, 0, 0]), "obj_scale": np.float64(0.1), "obj_path": "it", **stages}


@pytest.mark.parametrize(
    ("content", "why"),
    [
        ({**_fields(), "grasp_qpos": np.zeros(5)}, r"grasp_qpos has shape \(5,\); this hand needs \(9,\)"),
        ({**_fields(), "grasp_qpos": [0.0] * 9}, "grasp_qpos has shape None"),
        ({**_fields(), "grasp_qpos": np.full(9, np.nan)}, "entries that are not finite"),
        ({**_fields(), "obj_pose": np.zeros(7)}, "the quaternion of obj_pose has length 0"),
        ({**_fields(), "obj_scale": "big"}, "obj_scale is 'big'"),
        (
            {**_fields(), "grasp_qpos": _fields()["grasp_qpos"] * [1, 1, 1000, 1, 1, 1, 1, 1, 1]},
            "300.1 m from the origin",
        ),
    ],
)
def test_spoilt_dexgraspbench(content: Any, why: str) -> None:
    with pytest.raises(errors.ConfigError, match=why):
        grasps_of(content, load_hand("panda_gripper"))


class _Runs:
    """Writes a file when it is unpickled."""

    def __init__(self, path: Path) -> None:
        self.path = path

    def __reduce__(self) -> tuple[Any, ...]:
        return Path.touch, (self.path,)


def test_pickles_are_not_read(tmp_path: Path) -> None:
    np.save(tmp_path / "it.npy", np.array(_Runs(tmp_path / "ran")), allow_pickle=True)
    refused(tmp_path / "it.npy", "is a pickle, .* convert a file that you trust with scripts/convert_dexgraspbench")
    script = [sys.executable, str(ROOT / "scripts/convert_dexgraspbench.py"), str(tmp_path / "it.npy"), "--out"]
    done = subprocess.run([*script, str(tmp_path / "it.yaml")], capture_output=True, text=True, check=False)
    assert done.returncode == 1
    assert "add --trust if you know where it comes from" in done.stderr
    assert not (tmp_path / "ran").exists()


def test_a_trusted_file_is_converted(tmp_path: Path) -> None:
    np.save(tmp_path / "it.npy", np.array(_fields(), dtype=object), allow_pickle=True)
    script = [sys.executable, str(ROOT / "scripts/convert_dexgraspbench.py"), str(tmp_path / "it.npy"), "--trust"]
    subprocess.run([*script, "--out", str(tmp_path / "it.yaml")], check=True)
    back, direct = exchange.load(tmp_path / "it.yaml"), grasps_of(_fields(), load_hand("panda_gripper"))
    np.testing.assert_allclose(back.poses, direct.poses, atol=1e-12)
    np.testing.assert_allclose(back.grasp, direct.grasp, atol=1e-12)


def test_damaged_bytes_are_refused_or_read(tmp_path: Path) -> None:
    """A file with any single byte changed raises only errors of graspbox."""
    random = np.random.default_rng(0)
    for name, to in (("it.h5", "acronym"), ("it.yaml", "isaac")):
        exchange.save(grasps(1), tmp_path / name, to)
        content = (tmp_path / name).read_bytes()
        for _ in range(150):
            spoilt = bytearray(content)
            spoilt[random.integers(len(content))] = random.integers(256)
            (tmp_path / name).write_bytes(bytes(spoilt))
            try:
                assert len(exchange.load(tmp_path / name)) == 1
            except errors.GraspboxError:
                continue


@pytest.mark.parametrize(
    ("settings", "why"),
    [
        ({"poses": np.eye(4)}, r"poses has shape \(4, 4\); pass \(n, 4, 4\)"),
        ({"poses": np.zeros((2, 3, 4))}, "poses has shape"),
        ({"preshape": [0.0]}, r"preshape has shape \(1,\); pass one number, or one for each of 3"),
        ({"preshape": 0.5}, "preshape of grasp 0 is 0.5; pass a number from 0 to 0"),
        ({"success": [1.0, 2.0, 0.0]}, "success of grasp 1 is 2.0"),
        ({"confidence": [0.5, 0.5, -1.0]}, "confidence of grasp 2 is -1.0"),
        ({"score": [0.5]}, r"score has shape \(1,\)"),
        ({"scale": 0.0}, "scale is 0.0"),
        ({"mass": -1.0}, "mass is -1.0"),
        ({"world_from_object": np.eye(3)}, r"world_from_object has shape \(3, 3\)"),
        ({"world_from_object": 2 * np.eye(4)}, "world_from_object of grasp 0 is not a rigid motion"),
        ({"hand": "hook"}, "no hand 'hook'"),
    ],
)
def test_grasps_are_checked(settings: dict[str, Any], why: str) -> None:
    with pytest.raises(errors.ConfigError, match=why):
        exchange.ExchangeGrasps.of(**{"poses": np.tile(np.eye(4), (3, 1, 1)), "hand": "panda_gripper", **settings})


def test_selections() -> None:
    made = grasps()
    assert made[1:] == made[[1, 2]] == made[np.array([False, True, True])]
    assert "3 of 3 succeeded" in repr(made)
    with pytest.raises(errors.ConfigError, match="1 selects one row"):
        made[1]  # type: ignore[index]
    with pytest.raises(errors.ConfigError, match="has 1 grasp, not 3"):
        exchange.save(made, "it.npy", "dexgraspbench")
    with pytest.raises(errors.ConfigError, match=r"has no suffix; end it in \.h5"):
        exchange.save(made, "it", "acronym")
    with pytest.raises(errors.ConfigError, match="'it' names two objects"):
        exchange.save_each([made, made], "it", "acronym")
    with pytest.raises(errors.ConfigError, match="threshold is 2"):
        made.labeled(2)
    assert len(made[:0]) == 0


@pytest.mark.parametrize(("package", "name", "to"), [("h5py", "it.h5", "acronym"), ("yaml", "it.yaml", "isaac")])
def test_missing_packages(package: str, name: str, to: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    exchange.save(grasps(), tmp_path / name, to)
    monkeypatch.setitem(sys.modules, package, None)
    for call in (lambda: exchange.save(grasps(), tmp_path / name, to), lambda: exchange.load(tmp_path / name)):
        with pytest.raises(errors.MissingExtraError, match=r"pip install 'graspbox\[exchange\]'"):
            call()


def test_other_results_are_refused(tmp_path: Path) -> None:
    for content, why in (
        ("{", "is not JSON"),
        ("{}", "is JSON, but not of graspbox's grasps"),
        ("[]", "is JSON, but not of graspbox's grasps"),
        ('{"objects": 3}', "objects is missing or is not a list"),
        ('{"objects": [{"name": "a", "grasps": [1]}]}', "grasps of 'a' is missing or is not a list of objects"),
        ('{"objects": [{"name": "a", "hand": "reflex", "grasps": [{}]}]}', r"object_from_hand\[0\] is not a 4x4"),
        ('{"table_from_camera": 1, "grasps": []}', "table_from_camera"),
    ):
        (tmp_path / "it.json").write_text(content)
        with pytest.raises(errors.ConfigError, match=why):
            exchange.read(tmp_path / "it.json")
    with pytest.raises(errors.FileError):
        exchange.read(tmp_path / "nothing.json")
