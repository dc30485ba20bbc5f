"""Policies whose folder holds their own hand, and policies that use the completion of another one."""

import re
import shutil
from dataclasses import replace
from pathlib import Path

import pytest

import tiny_policy
from graspbox import evaluation
from graspbox.errors import ConfigError
from graspbox.hands import Hand, load_hand
from graspbox.perception.configs import CropConfig
from graspbox.policies import DepthGrasp
from graspbox.policies.published.configs import HAND_FILES, DepthPolicyConfig
from graspbox.policies.published.folders import (
    CONFIG,
    completion_folder,
    file_hash,
    hand_of,
    load,
    read_depth_policy,
    save,
    use_of,
)

pytest.importorskip("onnx", reason="small networks are made with onnx, from the extra 'dev'")
pytest.importorskip("onnxruntime", reason="networks run in onnxruntime, from the extra 'onnx'")

CANS = "procedural:can:0-1"


def own_hand(name: str = "own_hand") -> Hand:
    """Rename the ReFlex."""
    urdf, toml = load_hand("reflex").files
    return Hand(urdf, re.sub(r'^name = "reflex"', f'name = "{name}"', toml, flags=re.MULTILINE))


def with_hand(folder: Path, hand: Hand) -> DepthPolicyConfig:
    """Make a tiny policy whose folder holds its hand."""
    config = tiny_policy.make(folder)
    for name, text in zip(HAND_FILES, hand.files, strict=True):
        (folder / name).write_text(text)
    files = {**config.files, **{name: file_hash(folder / name) for name in HAND_FILES}}
    return save(folder, replace(config, hand=hand.name, files=files))


@pytest.fixture(scope="module")
def own(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("own") / "policy"
    with_hand(folder, own_hand())
    return folder


def test_a_policy_brings_its_hand(own: Path, tmp_path: Path) -> None:
    """It acts with that hand where nobody names one, as the same policy of the shipped hand does."""
    config = read_depth_policy(own)
    hand = hand_of(own, config)
    assert hand == (str(own / "hand.urdf"), str(own / "hand.toml"))
    assert load_hand(hand).name == config.hand == "own_hand"
    tiny_policy.make(tmp_path / "shipped")
    found, shipped = (evaluation.evaluate(str(p), objects=CANS, trials=3) for p in (own, tmp_path / "shipped"))
    assert found.trials == shipped.trials
    assert found.settings is not None
    assert found.settings["hand"] == list(hand)
    assert DepthGrasp(tmp_path / "shipped").settings["hand"] == "reflex"


def test_another_hand_is_refused(own: Path) -> None:
    with pytest.raises(ConfigError, match=r"'tiny' was trained for the hand 'own_hand', not 'reflex'"):
        evaluation.evaluate(str(own), objects=CANS, trials=1, hand="reflex")


def test_files_of_the_hand_are_checked(own: Path, tmp_path: Path) -> None:
    changed = shutil.copytree(own, tmp_path / "changed")
    (changed / "hand.toml").write_text((changed / "hand.toml").read_text() + "\n")
    with pytest.raises(ConfigError, match=r"hand\.toml is not the file that .*config\.json names"):
        load(changed)
    (changed / "hand.urdf").unlink()
    with pytest.raises(ConfigError, match=r"there is no hand\.urdf"):
        load(changed)
    with pytest.raises(ConfigError, match=r"hand is 'another', but its files describe 'own_hand'"):
        save(own, replace(read_depth_policy(own), hand="another"))
    with pytest.raises(ConfigError, match=r"hand is 'another', which is none of reflex, .* lacks its files hand\.urdf"):
        save(own, replace(read_depth_policy(own), hand="another", files=tiny_policy.make(tmp_path / "bare").files))
    with pytest.raises(ConfigError, match=r"files has 'hand\.toml'"):
        save(own, replace(read_depth_policy(own), hand="reflex"))


def test_a_policy_that_uses_another_has_its_hand(own: Path, tmp_path: Path) -> None:
    feel = tiny_policy.make_feel(tmp_path / "feel")
    using = replace(feel, hand="own_hand", uses={"depth": use_of(tmp_path / "feel", own)})
    save(tmp_path / "feel", using)
    assert hand_of(tmp_path / "feel", using) == hand_of(own, read_depth_policy(own))


def sharing(folder: Path, other: Path, **changes: object) -> DepthPolicyConfig:
    """Make a tiny policy with the completion of another one."""
    config = tiny_policy.make(folder)
    (folder / "completion.onnx").unlink()
    changed = replace(config, uses={"completion": use_of(folder, other)}, **changes)  # type: ignore[arg-type]
    return save(folder, replace(changed, files={name: file_hash(folder / name) for name in changed.holds}))


def test_a_completion_is_shared(tmp_path: Path, own: Path) -> None:
    """Between policies of different hands; the decisions are those with a copy of it."""
    config = sharing(tmp_path / "sharing", own)
    assert config.holds == ("scorer.onnx",)
    assert load(tmp_path / "sharing") == config
    assert completion_folder(tmp_path / "sharing", config).resolve() == own.resolve()
    tiny_policy.make(tmp_path / "whole")
    found = [evaluation.evaluate(str(tmp_path / name), objects=CANS, trials=3).trials for name in ("sharing", "whole")]
    assert found[0] == found[1]


def test_a_training_adopts_a_completion_that_is_shared_already(tmp_path: Path, own: Path) -> None:
    """It copies the file of the policy that has it."""
    pytest.importorskip("torch")
    from graspbox.learn.models.scenes import SceneConfig
    from graspbox.learn.recipes.networks import TrainedNetworks
    from graspbox.learn.recipes.settings.depth import QUICK
    from graspbox.perception import HandGrid

    sharing(tmp_path / "sharing", own)
    networks = TrainedNetworks(tmp_path / "run", QUICK, HandGrid("reflex"), SceneConfig())
    (tmp_path / "run/completion").mkdir(parents=True)
    assert networks.adopt_completion(tmp_path / "sharing") == read_depth_policy(own)
    assert (tmp_path / "run/completion/completion.onnx").read_bytes() == (own / "completion.onnx").read_bytes()


def test_a_completion_that_does_not_suit_is_refused(tmp_path: Path, own: Path) -> None:
    sharing(tmp_path / "sharing", own)
    for name, other, changes in (
        ("chained", tmp_path / "sharing", {}),
        ("cropped", own, {"crop": CropConfig(below=0.02)}),
        ("wide", own, {"completion_width": 5}),
    ):
        config = sharing(tmp_path / name, other, **changes)
        with pytest.raises(
            ConfigError, match=r"uses\.completion names .*, whose completion takes other crops, or is of"
        ):
            completion_folder(tmp_path / name, config)
    moved = shutil.copytree(own, tmp_path / "moved")
    config = sharing(tmp_path / "orphan", moved)
    (moved / CONFIG).unlink()
    with pytest.raises(ConfigError, match=r"uses\.completion\.policy is '\.\./moved', but .* is missing, or differs"):
        completion_folder(tmp_path / "orphan", config)
