"""A published head: its folder, and agreement with the trained network."""

import json
from dataclasses import asdict
from pathlib import Path

import numpy as np
import pytest

from graspbox import errors, evaluation, policies
from graspbox.perception.anchors import AnchorConfig
from graspbox.policies import HeadGrasp
from graspbox.policies.published.configs import HeadPolicyConfig
from graspbox.policies.published.folders import load
from graspbox.policies.published.head_configs import HeadConfig

torch = pytest.importorskip("torch")

from graspbox.learn.export.exports import export_head  # noqa: E402
from graspbox.learn.models.head.network import AnchorNet  # noqa: E402
from graspbox.learn.models.head.policy import TrainedHead  # noqa: E402

pytestmark = pytest.mark.train

SMALL = HeadConfig(width=8, features=8, hidden=16, anchors=AnchorConfig(cells=12, heights=14))


def test_a_published_head_acts_as_the_trained_one(tmp_path: Path) -> None:
    pytest.importorskip("onnxruntime", reason="published policies need onnxruntime, from the extra 'onnx'")
    torch.manual_seed(0)
    net = AnchorNet(3, SMALL).eval()
    trained, published = tmp_path / "trained", tmp_path / "published"
    trained.mkdir()
    (trained / "head.json").write_text(json.dumps(asdict(SMALL)))
    torch.save(net.state_dict(), trained / "weights.pt")
    config = export_head(published, "tiny", net, learned_from=["procedural:can:7"])
    assert set(config.files) == {"head.onnx"}
    assert load(published, HeadPolicyConfig) == config
    policy = policies.load(str(published))
    assert policy.name == "tiny"
    assert policy.learned_from == ("procedural:can:7-7",)
    results = []
    for one in (policy, TrainedHead(trained, filtered=True)):
        evaluation.evaluate(one, objects="procedural:can:0-3", trials=4, num_envs=4)
        assert isinstance(one, HeadGrasp | TrainedHead)
        results.append([found.world_from_hand for found in one.found if found is not None])
    np.testing.assert_allclose(results[0], results[1], atol=1e-4)
    assert len(results[0]) == 4
    with pytest.raises(errors.ConfigError, match="was trained for the hand 'reflex', not 'panda_gripper'"):
        evaluation.evaluate(policy, objects="procedural:can:0", trials=1, hand="panda_gripper")
