"""``graspbox train head``: it trains, measures, resumes and publishes heads, also with the choices of a policy."""

import json
from pathlib import Path

import pytest

import tiny_policy
from graspbox import policies
from graspbox.data import trials as dataset
from graspbox.learn.models.trials import GraspTrials
from graspbox.policies.published.folders import load

pytest.importorskip("torch")
pytest.importorskip("typer", reason="the command needs typer, from the extra 'cli'")

from graspbox.errors import ConfigError
from graspbox.learn.commands import train

pytestmark = pytest.mark.train


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two objects of the split validation, one of the split train."""
    folder = tmp_path_factory.mktemp("data")
    config = dataset.DatasetConfig(poses=10, shard_trials=16)
    dataset.generate(["procedural:can:0-2"], folder, config=config, runner=dataset.local(1))
    return folder


def arguments(data: Path, out: Path, published: Path) -> list[str]:
    given = ["--data", str(data), "--out", str(out), "--steps", "2", "--width", "8"]
    return [*given, "--objects", "procedural:can:7", "--trials", "2", "--publish", str(published)]


def test_it_trains_measures_and_resumes(data: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    given = ["--untried", "procedural:cup:0", "--untried-scenes", "2"]
    given += arguments(data, tmp_path / "out", tmp_path / "head")
    assert train("head", [*given, "--json"]) == 0
    rows = json.loads(capsys.readouterr().out)
    assert [(row["filtered"], row["trials"]) for row in rows] == [(False, 2), (True, 2)]
    saved = {p: p.stat().st_mtime_ns for p in (tmp_path / "out" / "trained").iterdir()}
    assert train("head", [*given, "--json"]) == 0
    assert json.loads(capsys.readouterr().out) == rows
    assert {p: p.stat().st_mtime_ns for p in (tmp_path / "out" / "trained").iterdir()} == saved
    assert "| filtered | procedural:can:7 | 2 |" in (tmp_path / "out" / "head.md").read_text()
    assert "| `procedural:can:7`, collisions filtered | 2 |" in (tmp_path / "head" / "README.md").read_text()
    assert policies.load(str(tmp_path / "head")).name == "head"
    with pytest.raises(SystemExit):
        train("head", [*given, "--heads", "leg"])
    with pytest.raises(ConfigError, match="seed was 0, is now 1"):
        train("head", [*given, "--seed", "1"])
    with pytest.raises(ConfigError, match="was generated with the hand 'reflex'; pass --hand reflex"):
        train("head", [*given, "--hand", "soft_hand"])


def test_it_learns_from_what_a_policy_chose(data: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    run = tmp_path / "run"
    given = ["--on-policy", str(run), *arguments(data, tmp_path / "out", tmp_path / "head")]
    trials = GraspTrials.from_dataset(data, "train")
    trials.save(run / "collect-1" / "train" / "0000000.npz")
    with pytest.raises(ConfigError, match="no finished run"):
        train("head", given)
    tiny_policy.make(run / "policy", learned_from=("procedural:cup:3-5/train",))
    assert train("head", given) == 0
    assert "procedural:cup:3-5/train" in load(tmp_path / "head").learned_from
    assert f"{2 * len(trials)} trials in {2 * len(trials.source)} scenes" in " ".join(
        (tmp_path / "head/README.md").read_text().split()
    )
