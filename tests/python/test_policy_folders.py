"""Folders of published policies: they run without torch, and errors name the faulty part."""

import json
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import tiny_policy
from graspbox import errors, evaluation, object_sets, policies
from graspbox.learn.models.scenes import SceneConfig
from graspbox.learn.recipes.cards.depth import write_depth_card
from graspbox.policies import DepthGrasp
from graspbox.policies.published.calibration import Calibration, calibration_error, fit_logits
from graspbox.policies.published.configs import DepthPolicyConfig, FeelPolicyConfig
from graspbox.policies.published.folders import load
from graspbox.policies.published.registry import kinds, policy_class

pytest.importorskip("onnx", reason="small networks are made with onnx, from the extra 'dev'")
pytest.importorskip("onnxruntime", reason="networks run in onnxruntime, from the extra 'onnx'")


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Make a policy of each kind, in a folder of its name."""
    folder = tmp_path_factory.mktemp("policies")
    for kind, make in tiny_policy.MAKERS.items():
        make(folder / kind)
    return folder


@pytest.fixture
def folder(made: Path, tmp_path: Path, kind: str) -> Path:
    """Copy the policy of a kind, for a test to spoil it."""
    return shutil.copytree(made / kind, tmp_path / "policy")


@pytest.fixture(scope="module")
def tiny(made: Path) -> Path:
    return made / "depth"


@pytest.mark.parametrize("kind", tiny_policy.MAKERS)
def test_a_folder_is_read_as_it_was_written(kind: str, tmp_path: Path) -> None:
    config = tiny_policy.MAKERS[kind](tmp_path / "tiny")
    assert (config.kind, config.hand) == (kind, "reflex")
    assert load(tmp_path / "tiny", type(config)) == load(tmp_path / "tiny") == config
    assert type(policies.load(str(tmp_path / "tiny"))) is policy_class(kind)
    wrong = FeelPolicyConfig if kind == "depth" else DepthPolicyConfig
    with pytest.raises(errors.ConfigError, match=f"config.json: kind is '{kind}'; expected '{wrong.kind}'"):
        load(tmp_path / "tiny", wrong)


def test_every_kind_has_a_maker() -> None:
    assert kinds() == tuple(sorted(tiny_policy.MAKERS))


def test_it_grasps_without_torch(tiny: Path) -> None:
    code = (
        "import sys; from graspbox import evaluation\n"
        f"result = evaluation.evaluate({str(tiny)!r}, objects='procedural:can:0-1', trials=2, seed=0, num_envs=2)\n"
        "assert len(result.trials) == 2 and result.policy == 'tiny'\n"
        "assert 'torch' not in sys.modules and 'onnxruntime' in sys.modules\n"
    )
    subprocess.run([sys.executable, "-c", code], check=True)


def test_it_chooses_what_its_networks_prefer(tiny: Path) -> None:
    policy = DepthGrasp(tiny)
    first = evaluation.evaluate(policy, objects="procedural:can:0-1", trials=2, seed=0, num_envs=2)
    found = policy.found[0]
    assert found is not None
    # The visible surface counts as the object, and the lowest grasp is chosen.
    np.testing.assert_array_equal(found.occupancy, found.volume[1])
    assert np.argmax(found.scores) == np.argmin(found.poses[:, 2, 3])
    expected = 1 / (1 + np.exp(-tiny_policy.SLOPE * found.poses[:, 2, 3]))
    np.testing.assert_allclose(found.scores, expected, atol=1e-6)
    scorer: Any = policy.finder.score
    few = scorer.judge(found.volume, found.poses[:2], found.preshapes[:2])
    np.testing.assert_allclose(few.success, expected[:2], atol=1e-6)
    np.testing.assert_allclose(few.secure, 0.5 * expected[:2], atol=1e-6)
    assert few.logits.shape == (2, 2)
    again = evaluation.evaluate(policy, objects="procedural:can:0-1", trials=2, seed=0, num_envs=1)
    assert again.trials == first.trials


Content = dict[str, Any]
Spoil = Callable[[Path], Any]


def changed(change: Callable[[Content], Any]) -> Spoil:
    """Change the content of ``config.json``."""

    def apply(folder: Path) -> None:
        content = json.loads((folder / "config.json").read_text())
        change(content)
        (folder / "config.json").write_text(json.dumps(content))

    return apply


def put(place: str, value: Any) -> Spoil:
    """Change the entry at a place, such as ``depth.crop.side``."""
    *outer, last = place.split(".")

    def apply(content: Content) -> None:
        for name in outer:
            content = content[int(name) if isinstance(content, list) else name]
        content[last] = value

    return changed(apply)


def without(place: str) -> Spoil:
    """Leave the entry at a place out."""
    *outer, last = place.split(".")

    def apply(content: Content) -> None:
        for name in outer:
            content = content[int(name) if isinstance(content, list) else name]
        del content[last]

    return changed(apply)


def rewritten(text: str) -> Spoil:
    return lambda folder: (folder / "config.json").write_text(text)


def linked(name: str, target: str) -> Spoil:
    """Put a link in the place of a file, to a copy of it elsewhere: its hash is right."""

    def apply(folder: Path) -> None:
        elsewhere = folder / target
        (folder / name).rename(elsewhere)
        (folder / name).symlink_to(elsewhere)

    return apply


#: Values other than JSON objects.
_NO_OBJECTS: tuple[Any, ...] = (None, 3, [])
#: Defects: the kind of the policy, the change, and the error message without the name of the file.
SPOILT: list[tuple[str, Spoil, str]] = [
    # Formats and JSON.
    ("depth", put("format", 1), r"format is 1 \(int\), this version of graspbox reads 2; .* export it again"),
    ("depth", without("format"), "format is missing, .* export it again"),
    (
        "depth",
        put("kind", "walker"),
        "there is no policy kind 'walker'; the installed packages have depth, feel, head, network, study: install",
    ),
    ("depth", put("kind", ["depth"]), r"there is no policy kind \['depth'\]"),
    ("depth", put("kind", "head"), "(head is missing|no field depth)"),
    ("depth", without("kind"), "there is no policy kind None"),
    ("depth", rewritten("{"), "is not valid JSON"),
    ("depth", rewritten("[" * 100_000), "is not valid JSON: recursion limit"),
    ("depth", rewritten("[]"), "format is missing"),
    ("depth", rewritten('{"format": 2, "kind": "\\ud800"}'), "is not valid JSON"),
    ("depth", lambda folder: (folder / "config.json").write_bytes(b"\xff\xfe"), "is not valid JSON"),
    ("depth", lambda folder: (folder / "config.json").write_bytes(b" " * (1 << 21)), "cannot be read: it is larger"),
    ("depth", lambda folder: (folder / "config.json").unlink(), "there is no config.json in"),
    # Fields of every policy.
    *(
        (kind, without(name), f"{name} is missing")
        for kind in tiny_policy.MAKERS
        for name in ("learned_from", "uses", "environment")
    ),
    *((kind, without(kind), f"{kind} is missing") for kind in tiny_policy.MAKERS),
    *(
        (kind, put(kind, wrong), f"{kind} is .*it must be an object")
        for kind in tiny_policy.MAKERS
        for wrong in _NO_OBJECTS
    ),
    ("depth", without("hand"), "hand is missing"),
    ("depth", put("hand", ""), "hand is '' .*it must have at least 1 character"),
    ("depth", put("hand", "claw"), "hand is 'claw', which is none of"),
    ("depth", put("name", 3), r"name is 3 \(int\); it must be a valid string"),
    ("depth", put("nane", "x"), "there is no field nane; did you mean 'name'"),
    ("depth", put("learned_from", [3]), r"learned_from\.0 is 3 \(int\); it must be a valid string"),
    (
        "depth",
        put("environment", {"id": "graspbox/Grasp-v0", "obs": "state", "settings": {}}),
        "environment is .*it must be null",
    ),
    (
        "depth",
        put("uses", {"depth": {"policy": "..", "sha256": "0" * 64}}),
        "uses has depth; a policy like this uses no policy",
    ),
    ("feel", put("uses", {}), "uses has no policy; a policy like this uses depth"),
    ("feel", put("uses.depth.policy", "nowhere"), "uses.depth.policy is 'nowhere', but .* is missing, or differs from"),
    ("feel", put("uses.depth.sha256", "0" * 64), "uses.depth.policy is 'chooser', but .* differs from the policy"),
    ("feel", put("hand", "panda_gripper"), "hand is 'panda_gripper', but the policy of uses.depth, .* hand 'reflex'"),
    ("feel", put("uses.depth.sha256", "0"), "uses.depth.sha256 is '0'; pass a SHA-256"),
    ("feel", put("uses.depth.policy", "hf://nobody"), "the policy is 'hf://nobody'; pass hf://owner/name"),
    # Files.
    (
        "depth",
        put("files", {}),
        "files lacks 'completion.onnx'; .*'depth' has completion.onnx, scorer.onnx",
    ),
    ("depth", changed(lambda c: c["files"].update({"../x": "0" * 64})), r"files has '\.\./x'"),
    ("depth", changed(lambda c: c["files"].update({"a\0b": "0" * 64})), r"files has 'a\\x00b'"),
    ("depth", put("files", "all"), "files is 'all' .*it must be an object"),
    ("depth", changed(lambda c: c["files"].update({"scorer.onnx": "0"})), "files.scorer.onnx is '0'; pass a SHA-256"),
    ("depth", lambda folder: (folder / "scorer.onnx").write_bytes(b"x"), "scorer.onnx is not the file"),
    ("depth", lambda folder: (folder / "scorer.onnx").unlink(), "there is no scorer.onnx in"),
    ("depth", linked("scorer.onnx", "../elsewhere.onnx"), "scorer.onnx is a link to a file outside its folder"),
    ("depth", linked("config.json", "../elsewhere.json"), "config.json is a link to a file outside its folder"),
    # Sections.
    ("depth", put("depth.calibration", None), "depth.calibration is None .*it must be an object"),
    ("depth", put("depth.calibration", 1e308), r"depth.calibration is 1e\+308 .*it must be an object"),
    ("depth", put("depth.calibration.success", [0.0, 1.0]), "depth.calibration.success is .*positive slope"),
    ("depth", put("depth.calibration.success", [1.0]), "depth.calibration.success"),
    (
        "depth",
        put("depth.calibration.secure_weight", 1e308),
        r"secure_weight is 1e\+308 .*give a number from 0 to 1000",
    ),
    *(("depth", without(f"depth.{n}"), f"depth.{n} is missing") for n in ("crop", "grid", "finder", "head", "members")),
    ("depth", without("depth.crop.side"), "depth.crop.side is missing"),
    ("depth", without("depth.finder.proposals.seeds"), "depth.finder.proposals.seeds is missing"),
    *(("depth", put("depth.finder", value), "depth.finder is .*it must be an object") for value in (None, 3)),
    ("depth", put("depth.head", 1e308), r"depth.head is 1e\+308 .*it must be an object"),
    ("depth", put("depth.finder.finaliste", 3), "there is no field depth.finder.finaliste; did you mean 'finalists'"),
    ("depth", put("depth.crop.sides", 3), "there is no field depth.crop.sides; did you mean 'side'"),
    ("depth", put("depth.finalists", 0), "finalists is 0 .*give a number from 1 to"),
    ("depth", put("depth.members", True), "depth.members is True .*it must be a valid integer"),
    ("depth", put("depth.members", 10**30), "config.json: depth.members is an integer of 100 bits"),
    ("depth", put("depth.width", 1.0), "depth.width is 1.0 .*it must be a valid integer"),
    (
        "depth",
        put("depth.finder.refinements", 100_000),
        "depth.finder.refinements is 100000 .*give a number from 0 to 64",
    ),
    ("depth", put("depth.finder.finalists", 2**31), "depth.finder.finalists is 2147483648"),
    ("depth", put("depth.finder.proposals.seeds", 10**6), "`seeds` is 1000000, but it must be between"),
    ("depth", put("depth.finder.proposals.standoffs", [0.01] * 101), r"`len\(standoffs\)` is 101"),
    ("depth", put("depth.finder.proposals.standoffs", ["a"]), "standoffs.0 is 'a' .*it must be a valid number"),
    ("depth", put("depth.crop.side", 1e308), "`side` is 1e308, but it must be between"),
    ("depth", put("depth.crop.side", float("inf")), "(is not valid JSON|finite)"),
    ("depth", put("depth.crop.resolution", 10_000), "`resolution` is 10000"),
    ("depth", put("depth.grid.cell", 0.0), "`cell` is 0, but it must be between"),
    ("head", put("head.head.kind", "set"), "no field head.head.kind"),
    ("head", put("head.head.width", 0), "head.head.width is 0 .*give a number from 1"),
    ("head", put("head.head.anchors.cells", 7), "head.head.anchors.cells is 7; pass an even number"),
    ("head", put("head.head.anchors.heights", 2**40), "head.head.anchors.heights is 1099511627776"),
    ("head", put("head.head.anchors.spacing", 0.02), "12 anchors 0.02 m apart do not fit a crop of 48 voxels"),
    ("head", put("head.preshapes", 0), "preshapes is 0 .*give a number from 1"),
    ("head", without("head.filtered"), "head.filtered is missing"),
    ("feel", put("feel.threshold", 1.5), "threshold is 1.5; pass a probability"),
    ("feel", put("feel.times", []), r"times is \(\) .*pass 1 to 16 ascending numbers"),
    ("feel", put("feel.times", [1.0, 0.5]), "times is .*ascending"),
    ("feel", put("feel.times", [1e300]), "times is .*less than 60"),
    ("feel", put("feel.calibration", [0.0, 0.0]), "calibration is .*positive slope"),
    ("network", put("environment", None), "environment is None .*it must be an object"),
    ("network", put("environment.id", "CartPole-v1"), "environment.id is 'CartPole-v1'; choose from"),
    (
        "network",
        put("environment.settings.objects", "dir:/"),
        "environment.settings has 'objects'; a policy names only control",
    ),
    *(
        ("network", put(f"environment.settings.{name}", value), f"environment, with the hand 'reflex': .*{message}")
        for name, value, message in (
            ("control", "x", "control is 'x'; choose from"),
            ("fingers", "x", "fingers is 'x'; choose from each, synergy"),
            ("control_freq", -1, "`control_freq` is -1, but it must be between 5 and 100 Hz"),
            ("control_freq", 10**6, "`control_freq` is 1000000, but it must be between 5 and 100 Hz"),
            ("image_size", 2**63, "image_size is 9223372036854775808"),
            ("max_episode_steps", 0, "`max_episode_steps` is 0"),
            ("cameras", {"cameras": [{"fov": 4.0}]}, "`vertical_fov` is 4"),
        )
    ),
    ("network", put("environment.obs", "sound"), r"inputs has \['proprio', 'tactile'\]"),
    ("network", put("hand", "panda_gripper"), "with the hand 'panda_gripper': this hand has no tactile"),
    ("network", without("environment.settings"), "environment.settings is missing"),
    ("network", put("network.actions", 0), "actions is 0 .*give a number from 1"),
    ("network", put("network.actions", 9), r"network.actions is 9, but the actions .* have the shape \(10,\)"),
    ("network", changed(lambda c: c["network"]["inputs"].pop()), r"inputs has \['proprio'\]; pass one for each name"),
    (
        "network",
        put("network.inputs.0.dtype", "float33"),
        "network.inputs.0.dtype is 'float33'; pass the name of a type",
    ),
    ("network", put("network.inputs.0.shape", [0]), r"network.inputs.0.shape is \(0,\); pass integers from 1"),
    ("study", put("study.model", 3), "study.model is 3 .*it must be an object"),
    ("study", put("study.model.widht", 3), "there is no field study.model.widht"),
    ("study", without("study.model.units"), "study.model.units is missing"),
    (
        "study",
        put("study.model.network", "x"),
        "study.model.network is 'x' .*it must be 'cnn2d', 'cnn2d_dropout' or 'cnn3d'",
    ),
    ("study", put("study.model.loss", "x"), "study.model.loss is 'x' .*it must be 'posenet'"),
    ("study", put("study.model.preshape", 1e308), r"study.model.preshape is 1e\+308; the hand 'reflex' has 0 to"),
    ("study", put("study.model.size", -1), "study.model.size is -1 .*give an integer that is not negative"),
    ("study", put("study.model.size", 0), "study.model.size is 0 .*give a number from 1 to 1024"),
    ("study", put("study.model.fully_connected", []), r"study.model.fully_connected is \(\) .*must be integers"),
    ("study", put("study.model.fully_connected", [0]), r"study.model.fully_connected is \(0,\) .*must be integers"),
]


@pytest.mark.parametrize(("kind", "spoil", "message"), SPOILT, ids=[f"{k}-{m}" for k, _, m in SPOILT])
def test_a_spoilt_folder_is_refused(
    folder: Path,
    spoil: Spoil,
    message: str,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """By the function, and by the command in one sentence with exit status 2."""
    spoil(folder)
    with pytest.raises(errors.ConfigError, match=message) as raised:
        policies.load(str(folder))
    # The file is named, unless it is the name of a policy on the hub.
    assert str(folder) in str(raised.value) or "hf://" in message
    assert evaluated(folder, monkeypatch) == 2
    # A progress bar that was shown leaves an empty line.
    assert capsys.readouterr().err.strip() == f"graspbox: {raised.value}"
    assert "\n" not in str(raised.value)


def evaluated(folder: Path, monkeypatch: pytest.MonkeyPatch) -> object:
    """Run ``graspbox evaluate``; its exit status."""
    cli = pytest.importorskip("graspbox.cli")
    words = ["graspbox", "evaluate", str(folder), "--objects", "procedural:can:0", "--trials", "1"]
    monkeypatch.setattr(sys, "argv", words)
    with pytest.raises(SystemExit) as ended:
        cli.app()
    return ended.value.code


VOLUMES = {"volumes": np.zeros((1, 2, 48, 48, 48), dtype=np.uint8)}
CHANNELS = {"channels": np.zeros((1, 3, 48, 48, 48), dtype=np.uint8)}
FULL = np.full((1, 48, 48, 48), 255, dtype=np.uint8)
ANCHOR = {
    "anchors": np.zeros(1, dtype=np.int64),
    "residuals": np.zeros((1, 6), dtype=np.float32),
    "scores": np.ones(1, dtype=np.float32),
}
SEEN = {name: np.zeros((1, size), dtype=np.float32) for name, size in tiny_policy.SEEN.items()}
ACTION = np.zeros((1, 10), dtype=np.float32)
NAN = np.full(1, np.nan, dtype=np.float32)


@pytest.mark.parametrize(
    ("kind", "name", "inputs", "outputs", "message"),
    [
        ("depth", "completion.onnx", CHANNELS, {"filled": FULL}, "returns filled, but no 'occupancy'"),
        ("depth", "completion.onnx", CHANNELS, {"occupancy": FULL[0]}, r"returns 'occupancy' of shape \(48, 48, 48\)"),
        ("depth", "completion.onnx", {"voxels": FULL}, {"occupancy": FULL}, "completion.onnx does not take channels"),
        ("depth", "scorer.onnx", {"cells": FULL}, {"choice": NAN}, "scorer.onnx does not take cells"),
        (
            "head",
            "head.onnx",
            VOLUMES,
            {**ANCHOR, "anchors": np.array([10**6])},
            "anchors that are not among the 124416",
        ),
        ("head", "head.onnx", VOLUMES, {**ANCHOR, "anchors": np.array([-1])}, "anchors that are not among the 124416"),
        ("head", "head.onnx", VOLUMES, {**ANCHOR, "scores": NAN}, "head.onnx: output 'scores' is not finite"),
        ("head", "head.onnx", VOLUMES, {"anchors": np.zeros(0, dtype=np.int64)}, "returns anchors, but no 'residuals'"),
        ("network", "policy.onnx", SEEN, {"action": ACTION * np.nan}, "policy.onnx: output 'action' is not finite"),
        (
            "network",
            "policy.onnx",
            SEEN,
            {"action": ACTION[:, :3]},
            r"returns 'action' of shape \(1, 3\), expected \(1, 10\)",
        ),
        ("network", "policy.onnx", {"state": NAN}, {"action": ACTION}, "policy.onnx does not take proprio"),
    ],
)
def test_a_network_that_does_not_fit_is_refused(
    folder: Path,
    name: str,
    inputs: dict[str, Any],
    outputs: dict[str, Any],
    message: str,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Other inputs, outputs, shapes, indices, or numbers that are not finite."""
    tiny_policy.constant(folder / name, inputs, outputs)
    tiny_policy.save_again(folder)
    with pytest.raises(errors.ConfigError, match=message):
        evaluation.evaluate(str(folder), objects="procedural:can:0", trials=1)
    assert evaluated(folder, monkeypatch) == 2
    said = capsys.readouterr().err.strip()
    assert said.startswith("graspbox: ")
    assert "\n" not in said


@pytest.mark.parametrize(
    ("kind", "name", "output"),
    [("depth", "scorer", "choice"), ("feel", "feel", "probability")],
)
def test_nan_is_not_used_in_silence(folder: Path, name: str, output: str) -> None:
    """It would be the best of all scores, and less than no threshold."""
    tiny_policy.give_nan(folder, name, output)
    with pytest.raises(errors.ConfigError, match=rf"{name}\.onnx: output '{output}' is not finite; train or"):
        evaluation.evaluate(str(folder), objects="procedural:can:0", trials=1)


def test_objects_from_which_a_policy_learned_are_left_out(tmp_path: Path) -> None:
    config = tiny_policy.make(
        tmp_path, learned_from=("procedural:can:0-3/train", "procedural:can:4", "procedural:can:4-4")
    )
    assert load(tmp_path).learned_from == config.learned_from == ("procedural:can:0-3/train", "procedural:can:4-4")
    objects = object_sets.load("procedural:can:0-5")
    learned = [spec.name for spec in objects if spec.seed == 4 or (spec.seed < 4 and spec.split == "train")]  # type: ignore[operator]
    policy = policies.load(str(tmp_path))
    found = evaluation.evaluate(policy, objects=objects, trials=8)
    assert (found.objects_given, found.objects_left_out) == (6, len(learned))
    assert not {row.name for row in found.objects} & set(learned)
    assert found.to_json()["objects_left_out"] == len(learned)
    with pytest.raises(errors.ConfigError, match="'tiny' learned from all 1 objects of 'procedural:can:4'"):
        evaluation.evaluate(policy, objects="procedural:can:4", trials=1)
    found = evaluation.evaluate(policy, objects="procedural:can:4", trials=1, include_learned=True)
    assert found.objects_left_out == 0


def test_a_file_that_is_no_network_is_refused(tmp_path: Path) -> None:
    tiny_policy.make(tmp_path)
    (tmp_path / "scorer.onnx").write_bytes(b"no network")
    tiny_policy.save_again(tmp_path)
    with pytest.raises(errors.ConfigError, match="cannot be read by onnxruntime"):
        evaluation.evaluate(str(tmp_path), objects="procedural:can:0", trials=1)


@pytest.mark.parametrize("package", ["onnxruntime", "pydantic"])
def test_without_a_package_the_extra_is_named(tiny: Path, package: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, package, None)
    with pytest.raises(errors.MissingExtraError, match=rf"the package {package}: pip install 'graspbox\[onnx\]'"):
        evaluation.evaluate(str(tiny), objects="procedural:can:0", trials=1)


def test_another_hand_and_another_backend_are_refused(tiny: Path, tmp_path: Path) -> None:
    with pytest.raises(errors.ConfigError, match="was trained for the hand 'reflex', not 'panda_gripper'"):
        evaluation.evaluate(str(tiny), objects="procedural:can:0", trials=1, hand="panda_gripper")
    with pytest.raises(errors.ConfigError, match="no backend 'jax'"):
        DepthGrasp(tiny, backend="jax")  # type: ignore[arg-type]
    with pytest.raises(errors.ConfigError, match="no policy 'nothing'"):
        policies.load("nothing")


def test_logits_are_made_to_say_how_often() -> None:
    rng = np.random.default_rng(0)
    true = rng.normal(0.5, 1.5, 20_000)
    held = rng.random(20_000) < 1 / (1 + np.exp(-true))
    slope, offset = fit_logits((true - 0.7) * 2.5, held)
    assert slope == pytest.approx(1 / 2.5, rel=0.05)
    assert offset == pytest.approx(0.7, abs=0.05)
    said = 1 / (1 + np.exp(-slope * (true - 0.7) * 2.5 - offset))
    assert calibration_error(said, held) < 0.015
    assert calibration_error(np.full(1000, 0.9), np.arange(1000) < 600) == pytest.approx(0.3)
    assert calibration_error(np.array([0.05, 0.95, 1.0]), np.array([False, True, True])) == pytest.approx(0.1 / 3)
    # All alike: the probability stays below one.
    slope, offset = fit_logits(np.full(30, 2.0), np.ones(30, dtype=np.bool_))
    assert 2.0 < 2.0 * slope + offset < 6.0
    with pytest.raises(errors.ConfigError, match="calibrate"):
        fit_logits(np.zeros(0), np.zeros(0, dtype=np.bool_))
    with pytest.raises(errors.ConfigError, match="secure_weight"):
        Calibration(secure_weight=-1.0)


def test_a_card_states_what_was_measured(tmp_path: Path) -> None:
    """For people, and for the hub in its metadata."""
    huggingface_hub = pytest.importorskip("huggingface_hub", reason="cards need the extra 'train'")

    class Settings:
        """Settings of a training that the card reads."""

        seed, data, objects, fresh = 3, (), ("procedural:seen:0-9", "ycb"), ("procedural:seen:10-19",)
        layout, start = ("single",), None

    stages: dict[str, dict[str, Any]] = {
        "scorer": {"seconds": 60.0, "trials": 500, "on_policy": 0, "reason": "steps", "steps": 9, "best": 0.9},
        "round-1": {"seconds": 30.0, "trials": 500, "on_policy": 64, "reason": "time", "steps": 5, "best": 0.95},
        "calibrate": {"seconds": 5.0, "choices": 40, "rates": {"0.0": [0.9, 0.5], "0.3": [0.875, 0.625]}},
        "evaluate": {
            "seconds": 9.0,
            "ycb": {"trials": 100, "succeeded": 90, "secure": 60, "ece": 0.021, "fitting": {"trials": 100}},
        },
    }
    config = tiny_policy.make(tmp_path)
    given: dict[str, Any] = {
        "command": "python train.py",
        "settings": Settings(),
        "scenes": SceneConfig(),
        "stages": stages,
    }
    write_depth_card(tmp_path, config, **given)
    card = huggingface_hub.ModelCard.load(tmp_path / "README.md")
    assert "| `ycb/test` | 100 | 90.0% (82.6% to 94.5%) | 60.0% (50.2% to 69.1%) | 0.021 |" in card.text
    assert "| 0.3 | 40 | 87.5% | 62.5% |" in card.text
    assert "500 trials of `procedural:seen:0-9` and `ycb`" in card.text
    assert "then 64 trials" in card.text
    assert "| all | 0:01:44 |" in card.text
    rates = {result.metric_type: result for result in card.data.eval_results}
    assert {name: result.metric_value for name, result in rates.items()} == {"success_rate": 0.9, "secure_rate": 0.6}
    assert rates["success_rate"].metric_args == {"trials": 100, "ci95": [0.8256, 0.9448]}
    assert (rates["success_rate"].dataset_name, rates["success_rate"].task_name) == (
        "ycb/test",
        "graspbox/GraspPose-v0",
    )
    assert card.data.to_dict()["tags"] == ["robotics", "grasping", "policy-depth", "hand-reflex"]
