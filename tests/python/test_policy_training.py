"""``graspbox train depth``: all stages, also after SIGKILL; ONNX and torch agree."""

import json
import re
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from graspbox import errors, object_sets, policies
from graspbox._common.runs import Rows
from graspbox.data.trials.learned import of_splits
from graspbox.learn.recipes.settings.depth import QUICK, QUICK_OBJECTS, DepthSettings
from graspbox.object_sets import learned_sets
from graspbox.perception import HandGrid
from graspbox.perception.configs import RehearsalConfig
from graspbox.policies.published.calibration import Calibration
from graspbox.policies.published.folders import read_depth_policy, save
from interrupting import train_despite_kills

pytestmark = pytest.mark.train
ROOT = Path(__file__).parents[2]
#: Stages of ``--quick``, in order.
STAGES = ["data", "completion", "scorer", "head"]
STAGES += ["collect-1", "round-1", "collect-2", "round-2", "collect-3", "round-3", "head-rounds"]
STAGES += ["calibrate", "export", "ablations", "evaluate"]


def improved(stage: Path, measure: str = "auc") -> bool:
    """Whether a network that began with trained weights, which are validated at step 0, became better."""
    first, *others = ((row["step"], row[measure]) for row in Rows(stage / "losses.jsonl") if measure in row)
    assert first[0] == 0
    return bool(max(value for _, value in others) > first[1])


def command(out: Path) -> list[str]:
    """Train without time for the evaluation, which runs to its end all the same."""
    words = ["train", "depth", "--out", str(out), "--quick", "--hours.evaluate", "0"]
    return [sys.executable, "-m", "graspbox", *words]


@pytest.fixture(scope="module")
def trained(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Train quickly; the command is killed in two stages, and each time continues."""
    for module in ("torch", "typer", "pyarrow", "onnx", "onnxruntime", "onnxscript"):
        pytest.importorskip(module, reason="the training needs the extras 'data' and 'train'")
    out = tmp_path_factory.mktemp("training") / "run"
    train_despite_kills(command(out), out, ("scorer/checkpoint.pt", "collect-2/train/0000000.npz"))
    return out


def test_a_time_too_short_for_trials_of_both_splits_is_told(tmp_path: Path) -> None:
    words = [*command(tmp_path / "run"), "--hours.data", "1e-6"]
    found = subprocess.run(words, capture_output=True, text=True, timeout=300, check=False)
    assert found.returncode == 2
    last = found.stderr.strip().splitlines()[-1]
    assert re.search(r"has no trials of the split '\w+' after --hours.data 1e-06; run the same command with more", last)


def test_all_stages_leave_their_results(trained: Path) -> None:
    results = {name: json.loads((trained / f"{name}.json").read_text()) for name in STAGES}
    assert results["data"]["train"] > 0
    assert results["scorer"]["steps"] == 12
    assert results["collect-1"]["train"]["trials"] > 0
    assert results["round-3"]["on_policy"] > results["round-1"]["on_policy"] > 0
    assert results["head-rounds"]["trials"] == results["head"]["trials"] + results["round-3"]["on_policy"]
    assert read_depth_policy(trained / "policy").finder.refinements == 0
    assert results["evaluate"]["procedural:bottle:2000-2003"]["trials"] == 6
    ablation = read_depth_policy(trained / "ablations" / "scorer")
    assert (ablation.name, ablation.members, ablation.head is not None) == ("scorer", 1, True)
    geometry, whole = (read_depth_policy(trained / folder) for folder in ("ablations/geometry", "policy"))
    assert (geometry.members, geometry.head, geometry.finder.predicted) == (1, None, 0)
    assert (whole.members, whole.finder.predicted) == (1, 32)
    assert set(whole.files) == {"completion.onnx", "scorer.onnx", "head.onnx"}
    log = (trained / "log.txt").read_text()
    # The first stages were over when the command ran for the third time.
    assert log.count("completion: begins") == 1
    assert "completion: done by an earlier run" in log
    assert all(f"{name}: begins" in log for name in STAGES)
    learned = read_depth_policy(trained / "policy").learned_from
    assert set(of_splits(QUICK_OBJECTS["fresh"])) < set(learned)
    made = object_sets.load(QUICK_OBJECTS["objects"], split="train")
    assert not learned_sets.without(made, learned)
    card = (trained / "policy" / "README.md").read_text()
    assert "| `procedural:bottle:2000-2003` | 6 |" in card
    assert all(re.search(rf"\\| {name} \\| .* first choices that held", card) for name in ("head", "head-rounds"))
    assert "--quick" in card
    assert (trained / "policy" / "LICENSE").read_text() == (ROOT / "LICENSE").read_text()
    again = subprocess.run([*command(trained), "--json"], capture_output=True, text=True, check=True)
    assert again.stderr.count("done by an earlier run") == len(STAGES)
    assert json.loads(again.stdout) == {"folder": str(trained / "policy"), **results}
    other = subprocess.run([*command(trained), "--seed", "1"], capture_output=True, text=True, check=False)
    assert other.returncode == 2
    assert "was begun with other settings: seed was 0, is now 1" in " ".join(other.stderr.split())


def test_objects_that_are_learned_from_are_not_evaluated(tmp_path: Path) -> None:
    words = ["--out", str(tmp_path / "run"), "--evaluated", "procedural:prism:300"]
    command = [sys.executable, "-m", "graspbox", "train", "depth", *words]
    found = subprocess.run(command, capture_output=True, text=True, check=False)
    assert found.returncode == 2
    assert "--evaluated is 'procedural:prism:300'; name objects from which nothing is learned" in found.stderr
    assert not (tmp_path / "run").exists()


def test_data_without_held_out_objects_is_refused_before_anything_is_learned(tmp_path: Path) -> None:
    from graspbox.data import trials as dataset
    from graspbox.learn.recipes import depth

    pytest.importorskip("pyarrow")
    one = object_sets.load("procedural:can:0-9", split="train")[0]
    small = dataset.DatasetConfig(poses=4, rests=1, views=0)
    dataset.generate([f"procedural:can:{one.seed}"], tmp_path / "data", config=small)
    with pytest.raises(
        errors.ConfigError, match="no trials of the split 'validation'; run graspbox dataset of more objects"
    ):
        depth.train(DepthSettings(out=tmp_path / "run", data=(tmp_path / "data",), quick=True), "", print)
    assert not (tmp_path / "run" / "completion").exists()


def test_the_policy_decides_the_same_with_onnxruntime_and_torch(trained: Path) -> None:
    from graspbox import evaluation
    from graspbox.learn.export.onnx_files import PARITY
    from graspbox.policies import DepthGrasp

    folder = trained / "policy"
    assert policies.load(str(folder)).name == "depth"
    runs = {}
    for backend in ("onnx", "torch"):
        policy = DepthGrasp(folder, backend=backend)
        result = evaluation.evaluate(policy, objects="procedural:bottle:2000-2003", trials=3, seed=1, num_envs=3)
        runs[backend] = (policy.found, result.trials)
    assert runs["onnx"][1] == runs["torch"][1]
    for one, other in zip(runs["onnx"][0], runs["torch"][0], strict=True):
        assert one is not None
        assert other is not None
        assert np.abs(one.volume.astype(int) - other.volume).max() <= 1
        if np.array_equal(one.volume, other.volume):
            np.testing.assert_allclose(one.scores, other.scores, atol=PARITY)


def test_a_network_does_not_tell_where_its_code_was(trained: Path) -> None:
    for path in (trained / "policy").glob("*.onnx"):
        assert b".py" not in path.read_bytes(), path.name


def test_weights_are_stored_in_half_precision_without_a_loss(trained: Path) -> None:
    onnx = pytest.importorskip("onnx")
    graph = onnx.load(str(trained / "policy/completion.onnx")).graph
    stored = [onnx.numpy_helper.to_array(constant) for constant in graph.initializer]
    assert {values.dtype.name for values in stored if values.size >= 1024} == {"float16"}
    small = [values for values in stored if 1 < values.size < 1024 and values.dtype.kind == "f"]
    assert {values.dtype.name for values in small} == {"float32"}


def test_an_exported_network_that_differs_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    torch = pytest.importorskip("torch")
    from graspbox.learn.export import exports, onnx_files
    from graspbox.learn.export.graphs import ScorerGraph
    from graspbox.learn.models.scorer.network import ScorerNet
    from graspbox.policies.published.runtimes import onnx_network, torch_network

    grid = HandGrid()
    torch.manual_seed(0)
    members = [ScorerNet(grid, width=8) for _ in range(2)]
    exports.write_scorer(members, Calibration((1.5, -0.2), (0.8, 0.1)), grid, tmp_path / "scorer.onnx")
    # It takes any number of grasps from the finalists on.
    network = onnx_network(tmp_path / "scorer.onnx")
    graph = torch_network(ScorerGraph(members, Calibration((1.5, -0.2), (0.8, 0.1)), exports.FINALISTS))
    rng = np.random.default_rng(1)
    for count in (exports.FINALISTS, 61):
        inputs: dict[str, Any] = {
            "cells": rng.integers(0, 256, (count, 4, *grid.shape), dtype=np.uint8),
            "poses": rng.normal(size=(count, 4, 4)).astype(np.float32),
            "preshape": rng.integers(0, 3, count),
        }
        found, expected = network(inputs), graph(inputs)
        for name, values in expected.items():
            np.testing.assert_allclose(found[name], values, atol=onnx_files.PARITY)
    # Members that are sure of everything give many grasps the same probability; which are finalists does not matter.
    sure = [ScorerNet(grid, width=8) for _ in range(2)]
    with torch.no_grad():
        for member in sure:
            member.head[-1].bias.fill_(40.0)
    exports.write_scorer(sure, Calibration(), grid, tmp_path / "sure.onnx")
    monkeypatch.setattr(
        onnx_files,
        "torch_network",
        lambda graph: lambda inputs: {k: v + 1 for k, v in torch_network(graph)(inputs).items()},
    )
    with pytest.raises(errors.ConfigError, match="differs from the network by 1"):
        exports.write_scorer(members, Calibration(), grid, tmp_path / "other.onnx")


def test_weights_of_another_network_are_refused(trained: Path, tmp_path: Path) -> None:
    import shutil

    from graspbox.learn.export.graphs import load_graphs

    folder = tmp_path / "policy"
    shutil.copytree(trained / "policy", folder)
    save(folder, replace(read_depth_policy(folder), completion_width=6))
    with pytest.raises(errors.ConfigError, match="weights of another network"):
        load_graphs(folder)


def test_a_policy_learns_from_scenes_of_several_objects(trained: Path, tmp_path: Path) -> None:
    """It begins with the scorer of an earlier run, and ends with rounds of clearing."""
    import torch

    from graspbox.learn.export.weight_files import load_weights

    out = tmp_path / "run"
    words = ["--layout", "pile", "--layout", "single", "--start", str(trained), "--completion", str(trained / "policy")]
    subprocess.run([*command(out), *words, "--data", str(trained / "data" / "set")], check=True, capture_output=True)
    policy = read_depth_policy(out / "policy")
    assert policy.crop.gap > 0.3, "everything on the table counts as one object"
    assert not policy.uses, "its completion learned more"
    assert [row["step"] for row in Rows(out / "completion" / "losses.jsonl")] == [0, 6]
    folders = (out / "policy", trained / "policy")
    tuned, before = (load_weights(folder / "completion.onnx", "net.") for folder in folders)
    assert tuned.keys() == before.keys()
    assert any(not torch.equal(tuned[name], before[name]) for name in tuned) == improved(out / "completion", "iou")
    cleared = json.loads((out / "clear.json").read_text())["pile procedural:bottle:2000-2003"]
    assert cleared["rounds"] == 2
    assert cleared["attempts"] >= 2
    sources = {str(np.load(path)["source"][0])[:1] for path in (out / "collect-1" / "train").glob("*.npz")}
    assert sources == {"[", "p"}, "scenes of several objects in turn with single ones"
    assert "| pile | `procedural:bottle:2000-2003` | 2 |" in (out / "policy" / "README.md").read_text()
    for layout, why in (
        (("heap",), "--layout has 'heap'; choose from single, packed, pile, bin"),
        ((), "--layout is empty"),
    ):
        with pytest.raises(errors.ConfigError, match=why):
            DepthSettings(out=tmp_path, layout=layout)


def test_a_training_begins_with_a_published_policy(trained: Path, tmp_path: Path) -> None:
    """The scorer learns more, and so does the head, after the rounds; each stays where that makes it no better."""
    import torch

    from graspbox.learn.export.weight_files import load_weights
    from graspbox.learn.recipes import depth

    out, published = tmp_path / "run", trained / "policy"
    words = ["--start", str(published), "--completion", str(published), "--data", str(trained / "data" / "set")]
    subprocess.run([*command(out), *words], check=True, capture_output=True)
    card = (out / "policy" / "README.md").read_text()
    assert f"graspbox evaluate {out / 'policy'} --objects" in card
    assert json.loads((out / "settings.json").read_text())["sizes"]["width"] == read_depth_policy(published).width
    begun, scorer = torch.load(out / "scorer" / "start.pt"), load_weights(published / "scorer.onnx", "members.0.")
    for name, values in begun.items():
        if name.endswith("num_batches_tracked"):
            continue
        torch.testing.assert_close(values, scorer[name].to(values.dtype), atol=0, rtol=0)
    final = load_weights(out / "policy" / "scorer.onnx", "members.0.")
    assert final.keys() == scorer.keys()
    assert [row["step"] for row in Rows(out / "scorer" / "losses.jsonl")] == [0, 6, 12]
    stages = ("scorer", "round-1", "round-2", "round-3")
    assert any(not torch.equal(final[n], scorer[n]) for n in final) == any(improved(out / name) for name in stages)
    heads = [load_weights(folder / "head.onnx", "net.") for folder in (out / "policy", published)]
    changed = any(not torch.equal(heads[0][name], heads[1][name]) for name in heads[0])
    assert changed == improved(out / "head-rounds", "held")
    with pytest.raises(errors.ConfigError, match="was trained for the hand 'reflex', not 'panda_gripper'"):
        depth.train(DepthSettings(out=tmp_path / "other", hand="panda_gripper", start=published), "", print)


def test_a_published_policy_is_calibrated_again(trained: Path, tmp_path: Path) -> None:
    """Its networks stay, and its head may be asked less often."""
    import torch

    from graspbox.learn.export.weight_files import load_weights
    from graspbox.learn.recipes import depth

    out, published = tmp_path / "run", trained / "ablations" / "scorer"
    nothing = {"rounds": 0, "scorer_steps": 0, "completion_steps": 0}
    kept = replace(QUICK, **nothing, proposed=40, predicted=20, enough=8, lever_penalty=4.0, rehearsed=5)
    names: dict[str, Any] = {"start": published, "completion": str(published), "layout": ("single", "pile")}
    depth.train(DepthSettings(out=out, sizes=kept, **names, **QUICK_OBJECTS), "graspbox train depth", print)
    assert not (out / "data").exists()
    policy = read_depth_policy(out / "policy")
    for name, part in (("completion.onnx", "net."), ("scorer.onnx", "members.0."), ("head.onnx", "net.")):
        stored, before = (load_weights(f / name, part) for f in (out / "policy", published))
        assert all(torch.equal(stored[key], values) for key, values in before.items() if key[:4] != "val_"), name
    finder = policy.finder
    assert (finder.proposals.most, finder.predicted, finder.enough, finder.lever_penalty) == (40, 20, 8, 4.0)
    assert finder.rehearsal == RehearsalConfig(grasps=5)
    assert not policy.uses
    card = (out / "policy" / "README.md").read_text()
    text = " ".join(card.split())
    assert f"The networks are those of `{published}`, calibrated on `procedural:can:10-29`" in text
    assert "The score loses 4 for each metre from the fingertips" in text
    assert "A single object's 5 best grasps are first tried in simulation" in text
    assert "### How its networks were trained" not in card
    again = tmp_path / "again"
    depth.train(DepthSettings(out=again, sizes=kept, **{**names, "start": out / "policy"}, **QUICK_OBJECTS), "", print)
    earlier = (again / "policy" / "README.md").read_text().partition("### How its networks were trained\n\n")[2]
    assert earlier.startswith("```\ngraspbox train depth\n```\n\nSeed 0. The networks are those of")
    assert "\n## Limits" in earlier
    for sizes, said in (
        (replace(QUICK, scorer_steps=0), "scorer-steps is 0; pass more, or name the policy to keep by --start"),
        (replace(QUICK, completion_steps=0), "completion-steps is 0; pass more, or .* by --completion"),
    ):
        with pytest.raises(errors.ConfigError, match=said):
            DepthSettings(out=tmp_path, sizes=sizes)
    for step in (0.0, 2.0, float("nan")):
        with pytest.raises(errors.ConfigError, match=f"--time-step is {step}; it must be"):
            DepthSettings(out=tmp_path, time_step=step)
