"""Folders of published policies: what is wrong in them is named, and what they hold runs without torch."""

import json
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import tiny_policy
from graspbox import errors, evaluation, object_sets, policies
from graspbox.perception.calibration import Calibration, calibration_error, fit_logits
from graspbox.perception.policy_folders import (
    file_hash,
    policy_hash,
    read_depth_policy,
    read_learned_from,
    write_depth_policy,
    write_learned_from,
)
from graspbox.perception.scenes import SceneConfig
from graspbox.policies import DepthGrasp
from graspbox.policy_training.cards import write_card

pytest.importorskip("onnx", reason="small networks are made with onnx, from the extra 'dev'")
pytest.importorskip("onnxruntime", reason="networks run in onnxruntime, from the extra 'onnx'")


@pytest.fixture(scope="module")
def tiny(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("policies") / "tiny"
    tiny_policy.make(folder)
    return folder


def test_a_folder_is_read_as_it_was_written(tiny: Path, tmp_path: Path) -> None:
    config = read_depth_policy(tiny)
    assert (config.name, config.hand, config.finder.proposals.most) == ("tiny", "reflex", 24)
    assert config.files["scorer.onnx"] == file_hash(tiny / "scorer.onnx")
    again = tiny_policy.make(tmp_path / "again")
    assert again == config
    assert policies.load(str(tiny)).name == "tiny"


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
    # What is seen of the surface is taken for the object, and the lowest grasp is chosen.
    np.testing.assert_array_equal(found.occupancy, found.volume[1])
    assert np.argmax(found.scores) == np.argmin(found.poses[:, 2, 3])
    expected = 1 / (1 + np.exp(-tiny_policy.SLOPE * found.poses[:, 2, 3]))
    np.testing.assert_allclose(found.scores, expected, atol=1e-6)
    assert policy.scorer is not None
    few = policy.scorer.judge(found.volume, found.poses[:2], found.preshapes[:2])
    np.testing.assert_allclose(few.success, expected[:2], atol=1e-6)
    np.testing.assert_allclose(few.secure, 0.5 * expected[:2], atol=1e-6)
    assert few.logits.shape == (2, 2)
    again = evaluation.evaluate(policy, objects="procedural:can:0-1", trials=2, seed=0, num_envs=1)
    assert again.trials == first.trials


def changed(change: Callable[[dict[str, Any]], Any]) -> Callable[[Path], None]:
    """Change the content of ``config.json``."""

    def apply(folder: Path) -> None:
        content = json.loads((folder / "config.json").read_text())
        change(content)
        (folder / "config.json").write_text(json.dumps(content))

    return apply


@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (changed(lambda c: c.update(format=2)), "has the format 2; this version of graspbox reads 1"),
        (changed(lambda c: c.update(kind="walker")), "a policy of the kind 'walker'"),
        (changed(lambda c: c.pop("kind")), "names no kind of policy"),
        (changed(lambda c: c.pop("hand")), "config.json is incomplete: .*'hand'"),
        (changed(lambda c: c.update(finaliste=3)), "no field 'finaliste'; did you mean 'finalists'"),
        (changed(lambda c: c.update(finalists=0)), "config.json: finalists is 0; give a positive integer"),
        (changed(lambda c: c["calibration"].update(success=[0.0, 1.0])), "success is .*positive slope"),
        (changed(lambda c: c["crop"].update(sides=3)), "no field 'sides'; did you mean 'side'"),
        (changed(lambda c: c.update(learned_from=[3])), r"config.json: learned_from is \[3\]; give a list of names"),
        (changed(lambda c: c["files"].update({"../x": "0"})), "in its own folder"),
        (lambda folder: (folder / "config.json").write_text("{"), "is no JSON"),
        (lambda folder: (folder / "scorer.onnx").write_bytes(b"x"), "scorer.onnx is not the file"),
        (lambda folder: (folder / "scorer.onnx").unlink(), "scorer.onnx"),
        (lambda folder: (folder / "config.json").unlink(), "there is no policy in this folder"),
    ],
)
def test_a_spoilt_folder_is_refused(tmp_path: Path, spoil: Callable[[Path], Any], message: str) -> None:
    tiny_policy.make(tmp_path)
    spoil(tmp_path)
    with pytest.raises((errors.ConfigError, errors.FileError), match=message):
        policies.load(str(tmp_path))


def test_objects_from_which_a_policy_learned_are_left_out(tmp_path: Path) -> None:
    tiny_policy.make(tmp_path)
    assert read_learned_from(tmp_path) == ()
    known = policy_hash(tmp_path)
    write_learned_from(tmp_path, ["procedural:can:0-3/train"])
    write_learned_from(tmp_path, ["procedural:can:0-3/train", "procedural:can:4"])
    assert read_learned_from(tmp_path) == ("procedural:can:0-3/train", "procedural:can:4-4")
    # It acts as before.
    assert policy_hash(tmp_path) == known
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
    config = tiny_policy.make(tmp_path)
    (tmp_path / "scorer.onnx").write_bytes(b"no network")
    files = {**config.files, "scorer.onnx": file_hash(tmp_path / "scorer.onnx")}
    write_depth_policy(tmp_path, replace(config, files=files))
    with pytest.raises(errors.ConfigError, match="no network that onnxruntime reads"):
        evaluation.evaluate(str(tmp_path), objects="procedural:can:0", trials=1)


def test_without_onnxruntime_the_extra_is_named(tiny: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "onnxruntime", None)
    with pytest.raises(errors.MissingExtraError, match=r"pip install 'graspbox\[onnx\]'"):
        evaluation.evaluate(str(tiny), objects="procedural:can:0", trials=1)


def test_another_hand_and_another_backend_are_refused(tiny: Path, tmp_path: Path) -> None:
    with pytest.raises(errors.ConfigError, match="knows the hand 'reflex', not 'panda_gripper'"):
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


def test_a_card_tells_what_was_measured(tiny: Path, tmp_path: Path) -> None:
    class Settings:
        """What the card reads of a training's settings."""

        seed, data, objects, fresh = 3, (), ("procedural:seen:0-9", "ycb"), ("procedural:seen:10-19",)

    stages: dict[str, dict[str, Any]] = {
        "scorer": {"seconds": 60.0, "trials": 500, "on_policy": 0, "reason": "steps", "steps": 9, "best": 0.9},
        "round-1": {"seconds": 30.0, "trials": 500, "on_policy": 64, "reason": "time", "steps": 5, "best": 0.95},
        "calibrate-0": {"seconds": 5.0, "choices": 40, "rates": {"0.0": [0.9, 0.5], "0.3": [0.875, 0.625]}},
        "evaluate": {"seconds": 9.0, "ycb": {"trials": 100, "succeeded": 90, "secure": 60, "ece": 0.021}},
    }
    write_card(
        tmp_path,
        config=read_depth_policy(tiny),
        command="python train.py",
        settings=Settings(),
        scenes=SceneConfig(),
        stages=stages,
    )
    text = (tmp_path / "README.md").read_text()
    assert "| `ycb`, split `test` | 100 | 90.0% (82.6% to 94.5%) | 60.0% (50.2% to 69.1%) | 0.021 |" in text
    assert "| 0 | 0.3 | 40 | 87.5% | 62.5% |" in text
    assert "500 trials of `procedural:seen:0-9` and `ycb`" in text
    assert "then 64 trials" in text
    assert "| all | 0:01:44 |" in text
