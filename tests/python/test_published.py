"""Published policies: each folder is complete, and its success rate is close to that of its card."""

from itertools import pairwise
from pathlib import Path

import pytest

from graspbox import evaluation, object_sets, policies
from graspbox.policies.published.folders import load

pytest.importorskip("onnxruntime", reason="published policies need onnxruntime, from the extra 'onnx'")

FOLDER = Path(__file__).parents[2] / "policies"
#: Least expected successes of 24 trials, by policy; its environment; its name in tables. Cards state rates of more
#: trials; networks differ in their last digits between processors, so that a few outcomes may differ.
LEAST = {
    "any_hand": (15, "graspbox/GraspPose-v0", "any_hand"),
    "depth": (20, "graspbox/GraspPose-v0", "depth"),
    "feel": (22, "graspbox/Grasp-v0", "depth-feel"),
    "feel_inspire": (18, "graspbox/Grasp-v0", "inspire-feel"),
    "feel_leap": (17, "graspbox/Grasp-v0", "leap-feel"),
    "head": (15, "graspbox/GraspPose-v0", "head"),
    "inspire": (17, "graspbox/GraspPose-v0", "inspire"),
    "leap": (17, "graspbox/GraspPose-v0", "leap"),
    "panda": (18, "graspbox/GraspPose-v0", "panda"),
    "panda_clutter": (17, "graspbox/GraspPose-v0", "panda_clutter"),
    "reflex_clutter": (19, "graspbox/GraspPose-v0", "reflex_clutter"),
    "robotiq": (17, "graspbox/GraspPose-v0", "robotiq"),
    "soft_hand": (10, "graspbox/GraspPose-v0", "soft_hand"),
    "study": (5, "graspbox/GraspPose-v0", "study"),
}


def test_every_published_policy_is_measured() -> None:
    assert {path.name for path in FOLDER.iterdir() if path.is_dir()} == set(LEAST)


@pytest.mark.parametrize("name", LEAST)
def test_a_published_policy_grasps(name: str) -> None:
    least, env_id, called = LEAST[name]
    policy = policies.load(str(FOLDER / name))
    assert policy.name == called
    found = evaluation.evaluate(policy, env_id, "procedural:unseen:30-39", trials=24, seed=0, num_envs=8)
    assert found.objects_left_out == 0
    assert found.succeeded >= least, found.failures


@pytest.mark.parametrize("name", LEAST)
def test_a_published_policy_has_a_card_and_a_licence(name: str) -> None:
    folder = FOLDER / name
    assert load(folder).learned_from
    card = (folder / "README.md").read_text()
    assert all(title in card for title in ("## Scores", "## Data and training", "## Limits", "## Licence"))
    assert "procedural:unseen:0-19" in card
    lines = card.splitlines()
    tables = [(above, rule) for above, rule in pairwise(lines) if rule.startswith("| --")]
    assert all(above.count("|") == rule.count("|") for above, rule in tables)
    assert (folder / "LICENSE").read_text() == (FOLDER.parent / "LICENSE").read_text()
    data = pytest.importorskip("huggingface_hub").ModelCard.load(folder / "README.md").data
    assert (data.model_name, data.license, data.library_name) == (load(folder).name, "apache-2.0", "graspbox")
    # Its rates are those of the table, for sets of objects that exist.
    rates = {f"{100 * result.metric_value:.1f}%" for result in data.eval_results}
    assert all(f"| {rate} (" in card for rate in rates)
    for result in data.eval_results:
        name, split = object_sets.name_and_split(result.dataset_type)
        assert object_sets.load(name, split=split)
    assert sum(path.stat().st_size for path in folder.iterdir()) < 13e6
