"""Policies of one network: they act as their folder specifies, in their own environment, without torch."""

import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest

import tiny_policy
from graspbox import errors, evaluation, policies
from graspbox.policies import NetworkPolicy, Task
from graspbox.policies.published.folders import save

pytest.importorskip("onnx", reason="small networks are made with onnx, from the extra 'dev'")
pytest.importorskip("onnxruntime", reason="networks run in onnxruntime, from the extra 'onnx'")

ENV = "graspbox/Grasp-v0"
OBS = tuple(tiny_policy.SEEN)


@pytest.fixture(scope="module")
def tiny(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("policies") / "tiny"
    tiny_policy.make_network(folder)
    return folder


def test_the_folder_names_its_environment(tiny: Path) -> None:
    policy = policies.load(str(tiny))
    assert isinstance(policy, NetworkPolicy)
    assert (policy.name, policy.obs, policy.env_id) == ("tiny", OBS, ENV)
    assert policy.settings == {
        "control": "twist",
        "fingers": "each",
        "control_freq": 5,
        "hand": "reflex",
        "max_episode_steps": 6,
    }


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
    envs = gymnasium.make_vec(ENV, num_envs=3, objects="procedural:can:0", obs=obs, fingers="each")
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
        ({"hand": "soft_hand", "obs": "proprio"}, "was trained for the hand 'reflex', not 'soft_hand'"),
        ({"control_freq": 20}, "needs control_freq=5; the environments have control_freq=20"),
        ({"fingers": "synergy"}, "needs fingers='each'; the environments have fingers='synergy'"),
        ({"control": "delta_pose"}, "needs control='twist'; the environments have control='delta_pose'"),
        ({"obs": "state"}, r"needs obs=\('proprio', 'tactile'\)"),
    ],
)
def test_another_environment_is_refused(tiny: Path, given: dict[str, Any], message: str) -> None:
    policy = policies.load(str(tiny))
    keywords: dict[str, Any] = {"env_id": ENV, **given}
    env_id = keywords.pop("env_id")
    if env_id == ENV:
        keywords = {"obs": OBS, "fingers": "each", **keywords}
    if env_id != ENV or "hand" in given:
        # There is nothing to feel.
        policy.obs = None
    envs = gymnasium.make_vec(env_id, num_envs=1, objects="procedural:can:0", **keywords)
    with pytest.raises(errors.ConfigError, match=message):
        policy.bind(Task.of(envs))
    envs.close()


def test_a_network_of_other_shapes_is_refused(tmp_path: Path) -> None:
    """Observations and actions of other shapes than the environment's; actions already by their folder."""
    config = tiny_policy.make_network(tmp_path)
    first, second = config.inputs
    with pytest.raises(errors.ConfigError, match=r"network.actions is 3, but the actions .* have the shape \(10,\)"):
        save(tmp_path, replace(config, actions=3))
    for wrong, message in (
        (
            replace(config, inputs=(replace(first, shape=(7,)), second)),
            r"'proprio' has shape .* needs \(7,\) and float32",
        ),
        (replace(config, inputs=(replace(first, dtype="uint8"), second)), "type float32; the policy 'tiny' needs"),
    ):
        save(tmp_path, wrong)
        with pytest.raises(errors.ConfigError, match=message):
            evaluation.evaluate(str(tmp_path), objects="procedural:can:0", trials=1)
