"""A published head: its folder, and agreement with the trained network."""

import json
from dataclasses import asdict
from pathlib import Path

import numpy as np
import pytest

from graspbox import errors, evaluation, policies
from graspbox.artifacts.configs import HeadPolicyConfig
from graspbox.artifacts.folders import load
from graspbox.models.head.configs import HeadConfig
from graspbox.perception.anchors import AnchorConfig
from graspbox.policies import HeadGrasp

torch = pytest.importorskip("torch")

from graspbox.artifacts.exports import export_head  # noqa: E402
from graspbox.models.head.heads import ConstantNet, head_of  # noqa: E402

pytestmark = pytest.mark.train

SMALL = HeadConfig(width=8, features=8, hidden=16, anchors=AnchorConfig(cells=12, heights=14))


def test_a_published_head_acts_as_the_trained_one(tmp_path: Path) -> None:
    pytest.importorskip("onnxruntime", reason="published policies need onnxruntime, from the extra 'onnx'")
    torch.manual_seed(0)
    net = head_of(3, SMALL).eval()
    trained, published = tmp_path / "trained", tmp_path / "published"
    trained.mkdir()
    (trained / "head.json").write_text(json.dumps(asdict(SMALL)))
    torch.save(net.state_dict(), trained / "weights.pt")
    config = export_head(published, "tiny", net, learned_from=["procedural:can:7"])
    assert set(config.files) == {"head.onnx", "head.safetensors"}
    assert load(published, HeadPolicyConfig) == config
    policy = policies.load(str(published))
    assert policy.name == "tiny"
    assert policy.learned_from == ("procedural:can:7-7",)
    results = []
    for one in (policy, HeadGrasp(trained, filtered=True)):
        evaluation.evaluate(one, objects="procedural:can:0-3", trials=4, num_envs=4)
        assert isinstance(one, HeadGrasp)
        results.append([found.world_from_hand for found in one.found if found is not None])
    np.testing.assert_allclose(results[0], results[1], atol=1e-4)
    assert len(results[0]) == 4
    with pytest.raises(errors.ConfigError, match="was trained for the hand 'reflex', not 'panda_gripper'"):
        evaluation.evaluate(policy, objects="procedural:can:0", trials=1, hand="panda_gripper")
    with pytest.raises(errors.ConfigError, match="kind 'anchor'"):
        export_head(tmp_path / "x", "x", ConstantNet(), learned_from=[])
