"""Published policies: each folder is whole, and grasps about as often as its card says."""

from pathlib import Path

import pytest

from graspbox import evaluation, policies
from graspbox.perception.policy_folders import read_kind, read_learned_from

pytest.importorskip("onnxruntime", reason="published policies need onnxruntime, from the extra 'onnx'")

FOLDER = Path(__file__).parents[2] / "policies"
#: Successes of 24 trials below which something is wrong, by policy; the environment that it acts in; and what it
#: is called in tables. Cards state rates of more trials; networks differ in their last digits between processors, so
#: that a few trials may turn.
LEAST = {
    "clone": (20, "graspbox/Grasp-v0", "clone"),
    "depth": (20, "graspbox/GraspPose-v0", "depth"),
    "feel": (22, "graspbox/Grasp-v0", "depth-feel"),
    "head": (15, "graspbox/GraspPose-v0", "head"),
    "study": (5, "graspbox/GraspPose-v0", "study"),
    "tuned": (17, "graspbox/Grasp-v0", "tuned"),
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
    assert read_kind(folder)
    card = (folder / "README.md").read_text()
    assert all(title in card for title in ("## Scores", "## Data and training", "## Limits", "## Licence"))
    assert "procedural:unseen:0-19" in card
    assert read_learned_from(folder)
    assert (folder / "LICENSE").read_text() == (FOLDER.parent / "LICENSE").read_text()
    assert sum(path.stat().st_size for path in folder.iterdir()) < 16e6
