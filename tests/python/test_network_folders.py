"""Folders of networks that act: what is wrong in them is named, and they run without torch."""

import json
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest

from graspbox import errors, evaluation, policies
from graspbox.perception.policy_folders import file_hash
from graspbox.policies import NetworkPolicy, Task
from graspbox.policies.network_folders import (
    NetworkInput,
    NetworkPolicyConfig,
    read_network_policy,
    write_network_policy,
)

onnx = pytest.importorskip("onnx", reason="small networks are made with onnx, from the extra 'dev'")
pytest.importorskip("onnxruntime", reason="networks run in onnxruntime, from the extra 'onnx'")

ENV = "graspbox/Grasp-v0"
OBS = ("proprio", "tactile")


def make(folder: Path) -> NetworkPolicyConfig:
    """Make a policy whose actions are those of the first entries of ``proprio``, halved and clipped."""
    env = gymnasium.make(ENV, obs=OBS, objects="procedural:can:0")
    spaces: Any = env.observation_space
    shape = env.action_space.shape
    assert shape is not None
    env.close()
    size, width = spaces["proprio"].shape[0], shape[0]
    float32 = onnx.TensorProto.FLOAT
    given = [onnx.helper.make_tensor_value_info(name, float32, ["n", *spaces[name].shape]) for name in OBS]
    weight = onnx.numpy_helper.from_array(0.5 * np.eye(size, width, dtype=np.float32), "weight")
    bounds = [onnx.numpy_helper.from_array(np.array(x, dtype=np.float32), n) for n, x in (("low", -1), ("high", 1))]
    none = onnx.numpy_helper.from_array(np.zeros((spaces["tactile"].shape[0], width), dtype=np.float32), "none")
    nodes = [
        onnx.helper.make_node("MatMul", ["proprio", "weight"], ["moved"]),
        onnx.helper.make_node("MatMul", ["tactile", "none"], ["nothing"]),
        onnx.helper.make_node("Add", ["moved", "nothing"], ["sum"]),
        onnx.helper.make_node("Clip", ["sum", "low", "high"], ["action"]),
    ]
    action = onnx.helper.make_tensor_value_info("action", float32, ["n", width])
    graph = onnx.helper.make_graph(nodes, "tiny", given, [action], [weight, none, *bounds])
    model = onnx.helper.make_model(graph, opset_imports=[onnx.helper.make_opsetid("", 18)], ir_version=10)
    folder.mkdir(exist_ok=True)
    onnx.save(model, folder / "policy.onnx")
    config = NetworkPolicyConfig(
        name="tiny",
        graspbox="0.1.0",
        env_id=ENV,
        obs=OBS,
        settings={"control": "twist", "frame_skip": 4, "hand": "reflex", "max_episode_steps": 6},
        inputs=tuple(NetworkInput(name, spaces[name].shape, "float32") for name in OBS),
        actions=width,
        algorithm="ppo",
        files={"policy.onnx": file_hash(folder / "policy.onnx")},
    )
    write_network_policy(folder, config)
    return config


@pytest.fixture(scope="module")
def tiny(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("policies") / "tiny"
    make(folder)
    return folder


def test_a_folder_is_read_as_it_was_written(tiny: Path, tmp_path: Path) -> None:
    assert read_network_policy(tiny) == make(tmp_path)
    policy = policies.load(str(tiny))
    assert isinstance(policy, NetworkPolicy)
    assert (policy.name, policy.obs, policy.env_id) == ("tiny", OBS, ENV)
    assert policy.settings == {"control": "twist", "frame_skip": 4, "hand": "reflex", "max_episode_steps": 6}


def test_it_acts_in_its_own_environment_without_torch(tiny: Path) -> None:
    """The folder says which environment, and how long an episode is."""
    code = (
        "import sys; from graspbox import evaluation\n"
        f"result = evaluation.evaluate({str(tiny)!r}, objects='procedural:can:0-1', trials=2, num_envs=2)\n"
        f"assert result.env_id == {ENV!r} and [trial.steps for trial in result.trials] == [6, 6]\n"
        "assert 'torch' not in sys.modules and 'onnxruntime' in sys.modules\n"
    )
    subprocess.run([sys.executable, "-c", code], check=True)


@pytest.mark.parametrize("obs", [OBS, ("state", *OBS)])
def test_it_does_what_its_network_says(tiny: Path, obs: tuple[str, ...]) -> None:
    policy = policies.load(str(tiny))
    envs = gymnasium.make_vec(ENV, num_envs=3, objects="procedural:can:0", obs=obs, frame_skip=4)
    policy.bind(Task.of(envs))
    observation, info = envs.reset(seed=0)
    policy.reset(seed=0, info=info)
    action = policy.act(observation)
    expected = np.clip(0.5 * observation["proprio"][:, : action.shape[1]], -1, 1)
    np.testing.assert_allclose(action, expected, atol=1e-6)
    assert action.dtype == np.float32
    assert len(np.unique(action.round(6), axis=0)) == 3
    envs.close()


def test_results_do_not_depend_on_how_many_act_at_once(tiny: Path) -> None:
    found = [evaluation.evaluate(str(tiny), objects="procedural:can:0-3", trials=4, num_envs=n) for n in (1, 3)]
    assert found[0].trials == found[1].trials


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"env_id": "graspbox/GraspPose-v0"}, "acts in 'graspbox/Grasp-v0', not in 'graspbox/GraspPose-v0'"),
        ({"hand": "soft_hand", "obs": "proprio"}, "knows the hand 'reflex', not 'soft_hand'"),
        ({"frame_skip": 1}, "needs frame_skip=4; the environments have frame_skip=1"),
        ({"control": "delta_pose"}, "needs control='twist'; the environments have control='delta_pose'"),
        ({"obs": "state"}, r"needs obs=\('proprio', 'tactile'\)"),
    ],
)
def test_another_environment_is_refused(tiny: Path, given: dict[str, Any], message: str) -> None:
    policy = policies.load(str(tiny))
    keywords: dict[str, Any] = {"env_id": ENV, **given}
    env_id = keywords.pop("env_id")
    if env_id == ENV:
        keywords = {"obs": OBS, "frame_skip": 4, **keywords}
    if env_id != ENV or "hand" in given:
        # There is nothing to feel.
        policy.obs = None
    envs = gymnasium.make_vec(env_id, num_envs=1, objects="procedural:can:0", **keywords)
    with pytest.raises(errors.ConfigError, match=message):
        policy.bind(Task.of(envs))
    envs.close()


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
        (changed(lambda c: c.pop("settings")), "config.json is incomplete: .*'settings'"),
        (changed(lambda c: c["settings"].pop("hand")), r"settings\.hand is None; give the name of a hand"),
        (changed(lambda c: c.update(env="x")), "no field 'env'; did you mean 'env_id'"),
        (changed(lambda c: c.update(env_id="CartPole-v1")), "env_id is 'CartPole-v1'; choose from"),
        (changed(lambda c: c.update(actions=0)), "actions is 0; give a positive integer"),
        (changed(lambda c: c["inputs"].pop()), r"inputs are \['proprio'\]; give one for each name in obs"),
        (changed(lambda c: c["inputs"][0].update(dtype="float33")), "dtype is 'float33'; give the name of a type"),
        (changed(lambda c: c["inputs"][0].update(shape=[0])), r"shape is \(0,\); give positive integers"),
        (changed(lambda c: c["files"].update({"../x": "0"})), "in its own folder"),
        (lambda folder: (folder / "config.json").write_text("{"), "is no JSON"),
        (lambda folder: (folder / "policy.onnx").write_bytes(b"x"), "policy.onnx is not the file"),
        (lambda folder: (folder / "policy.onnx").unlink(), "policy.onnx"),
    ],
)
def test_a_spoilt_folder_is_refused(tmp_path: Path, spoil: Callable[[Path], Any], message: str) -> None:
    make(tmp_path)
    spoil(tmp_path)
    with pytest.raises((errors.ConfigError, errors.FileError), match=message):
        policies.load(str(tmp_path))


def test_a_network_that_does_not_fit_is_refused(tmp_path: Path) -> None:
    """A file that is no network; observations and actions of other shapes than the environment's."""
    config = make(tmp_path)
    first, second = config.inputs
    for wrong, message in (
        (replace(config, actions=3), r"have shape \(\d+,\); those of the policy 'tiny' have \(3,\)"),
        (
            replace(config, inputs=(replace(first, shape=(7,)), second)),
            r"'proprio' has shape .* needs \(7,\) and float32",
        ),
        (replace(config, inputs=(replace(first, dtype="uint8"), second)), "type float32; the policy 'tiny' needs"),
    ):
        write_network_policy(tmp_path, wrong)
        with pytest.raises(errors.ConfigError, match=message):
            evaluation.evaluate(str(tmp_path), objects="procedural:can:0", trials=1)
    (tmp_path / "policy.onnx").write_bytes(b"no network")
    write_network_policy(tmp_path, replace(config, files={"policy.onnx": file_hash(tmp_path / "policy.onnx")}))
    with pytest.raises(errors.ConfigError, match="no network that onnxruntime reads"):
        evaluation.evaluate(str(tmp_path), objects="procedural:can:0", trials=1)
