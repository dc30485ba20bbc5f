"""Networks of the study as folders that predict without torch."""

import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest

import graspbox
from graspbox import errors, evaluation, object_sets, policies
from graspbox.policies import Task
from graspbox.policies.published.folders import load
from graspbox.study import grasps
from graspbox.study.execution import Score
from graspbox.study.pose_folders import PosePolicyConfig
from graspbox.study.regressor import PoseRegressor
from graspbox.study.reproduction.results import NetworkResult
from graspbox.study.samples import observe

pytestmark = pytest.mark.train

torch = pytest.importorskip("torch")
pytest.importorskip("onnxruntime")
export = pytest.importorskip("graspbox.study.export")
from graspbox.learn.export.weight_files import LARGEST_NETWORK  # noqa: E402
from graspbox.study.model import ModelConfig, PoseModel  # noqa: E402
from graspbox.study.reproduction.stages import best_small  # noqa: E402

OBJECTS = object_sets.load("procedural:can:0-1")


def seen(kind: Any, count: int) -> Any:
    """See an object as the study's camera does."""
    inputs = observe(graspbox.Scene(OBJECTS[0].load()), kind, count, 0)
    return np.broadcast_to(inputs, (count, *inputs.shape[1:])).copy() if len(inputs) == 1 else inputs


def model_of(network: Any, loss: Any, kind: Any) -> PoseModel:
    """Make a network whose output depends on its input."""
    made = PoseModel(ModelConfig(network, loss, kind, preshape=grasps.PRESHAPE, fully_connected=(8,)), seed=1)
    inputs = seen(kind, 4)
    made.fit_scaling(inputs, np.random.default_rng(0).normal(0, 0.1, (4, 3 + made.loss.size)).astype(np.float32))
    return made


@pytest.mark.parametrize(
    ("network", "loss", "kind"),
    [("cnn3d", "psi4", "ternary"), ("cnn3d", "euler", "binary"), ("cnn2d_dropout", "psi3", "image")],
)
def test_a_published_network_acts_as_the_trained_one(tmp_path: Path, network: str, loss: str, kind: Any) -> None:
    """So does one that is made of its weights; only in the environment that it knows."""
    model = model_of(network, loss, kind)
    config = export.export_pose_model(tmp_path, "tiny", model, seen(kind, 4), learned_from=["ycb/train"])
    assert set(config.files) == {"pose.onnx"}
    assert load(tmp_path, PosePolicyConfig) == config
    policy = policies.load(str(tmp_path))
    assert isinstance(policy, PoseRegressor)
    assert (policy.name, policy.env_id) == ("tiny", "graspbox/GraspPose-v0")
    envs = gymnasium.make_vec(policy.env_id, num_envs=3, objects=OBJECTS, obs=policy.obs, **policy.settings)
    observation, info = envs.reset(seed=0)
    acted = []
    for one in (policy, PoseRegressor(model), PoseRegressor(export.load_pose_model(tmp_path))):
        one.bind(Task.of(envs))
        one.reset(seed=0, info=info)
        acted.append(one.act(observation))
    np.testing.assert_allclose(acted[0], acted[1], atol=1e-4)
    np.testing.assert_allclose(acted[2], acted[1], atol=1e-4)
    assert np.abs(acted[0]).max() > 0.1
    envs.close()
    with pytest.raises(errors.ConfigError, match="was trained for the hand 'reflex', not 'panda_gripper'"):
        evaluation.evaluate(policy, objects=OBJECTS, trials=1, hand="panda_gripper")
    with pytest.raises(errors.ConfigError, match="acts in graspbox/GraspPose-v0, not in 'graspbox/Grasp-v0'"):
        evaluation.evaluate(policy, "graspbox/Grasp-v0", objects=OBJECTS, trials=1)


def test_it_runs_without_torch(tmp_path: Path) -> None:
    export.export_pose_model(
        tmp_path, "tiny", model_of("cnn3d", "psi4", "ternary"), seen("ternary", 2), learned_from=[]
    )
    code = (
        "import sys; from graspbox import evaluation\n"
        f"result = evaluation.evaluate({str(tmp_path)!r}, objects='procedural:can:0-1', trials=2, num_envs=2)\n"
        "assert len(result.trials) == 2 and result.policy == 'tiny'\n"
        "assert 'torch' not in sys.modules and 'onnxruntime' in sys.modules\n"
    )
    subprocess.run([sys.executable, "-c", code], check=True)


def test_what_cannot_be_published_is_refused(tmp_path: Path) -> None:
    large = PoseModel(ModelConfig("cnn2d_dropout", "psi4", "image"))
    with pytest.raises(
        errors.ConfigError,
        match=r"'study' has 8\.2 million weights, a file of 33 MB; publ.* 8 MB",
    ):
        export.export_pose_model(tmp_path / "x", "study", large, seen("image", 2), learned_from=[])
    small = model_of("cnn3d", "psi4", "ternary")
    with pytest.raises(errors.ConfigError, match="there are 1 examples; pass two or more"):
        export.export_pose_model(tmp_path / "x", "study", small, seen("ternary", 1), learned_from=[])
    assert not (tmp_path / "x").exists()
    with torch.no_grad():
        small.network.layers[-1].weight.fill_(float("nan"))
    with pytest.raises(
        errors.ConfigError, match=r"pose\.onnx: the weights 'model\.network\..*' are not finite; train again"
    ):
        export.export_pose_model(tmp_path / "y", "study", small, seen("ternary", 2), learned_from=[])


def test_the_best_small_network_is_published(tmp_path: Path) -> None:
    errors_of = {part: {"position": 0.1, "rotation": 0.5, "angle": 0.5} for part in ("train", "test", "validation")}
    base = NetworkResult("sane", "cnn3d", "psi4", "patience", 9, 1.0, errors_of, Score(10, 3, 1, 3, 2),
                         Score(60, 2, 1, 2, 9), {}, (1.0,), 0.1)  # fmt: skip
    turned = {**errors_of, "validation": {**errors_of["validation"], "angle": 0.2}}
    results = [
        base,
        replace(base, loss="psi3", errors=turned),
        replace(base, loss="psi2", test=replace(base.test, success=2)),
        replace(base, network="cnn2d", test=replace(base.test, success=9)),
    ]
    for result in results:
        path = tmp_path / result.settings / result.network / result.loss / "weights.pt"
        path.parent.mkdir(parents=True)
        with path.open("wb") as file:
            file.truncate(190_000_000 if result.network == "cnn2d" else LARGEST_NETWORK)
    best, small = best_small(tmp_path, results)
    assert (best.network, best.loss) == ("cnn3d", "psi3")
    assert small == results[:3]
    with pytest.raises(errors.ConfigError, match="at most 8 MB: cnn2d has 190 MB; train cnn3d too"):
        best_small(tmp_path, results[3:])
