"""Export of a policy of Stable-Baselines3, so that it acts without torch: one ONNX file with all that `predict` does.

| step | where it comes from |
|---|---|
| scaling by means and variances, clipping | `VecNormalize`, in double precision as there |
| channels of colour images first, and in [0, 1] | Stable-Baselines3's preprocessing |
| features, hidden layers, mean action | features extractor and actor |
| deterministic action | clipped to the action space (PPO), or squashed and scaled to it (SAC, TD3) |

`graspbox.policies.NetworkPolicy` runs the folder; ``scripts/publish_sb3.py`` makes one of a run's folder, with a card.
"""

import json
import os
import shutil
from collections.abc import Iterator, Mapping
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import gymnasium
import numpy as np
import torch
from gymnasium.vector import AutoresetMode, VectorEnv
from numpy.typing import NDArray
from stable_baselines3.common.preprocessing import is_image_space, is_image_space_channels_first
from stable_baselines3.common.vec_env import VecNormalize, VecTransposeImage

import graspbox
from graspbox.envs.settings import GraspPoseVectorSettings, GraspVectorSettings, keywords
from graspbox.errors import ConfigError
from graspbox.perception.onnx_files import PARITY, write_onnx
from graspbox.perception.policy_folders import CONFIG, file_hash, policy_hash
from graspbox.perception.runtimes import Network, onnx_network
from graspbox.perception.weight_files import check_size, restore_weights, save_weights
from graspbox.policies import Task
from graspbox.policies.network_folders import (
    ACTING,
    NetworkInput,
    NetworkPolicyConfig,
    read_network_policy,
    write_network_policy,
)
from graspbox.sb3.action_graphs import ActionGraph, Scales
from graspbox.sb3.goal_env import make_vec
from graspbox.sb3.policy import ModelPolicy
from graspbox.sb3.running import ALGORITHMS
from graspbox.sb3.training import model_arguments

__all__ = ["export_policy", "load_graph", "published_settings"]

_NETWORK, _WEIGHTS = "policy.onnx", "policy.safetensors"
#: Keywords of an environment that decide what a policy sees and what its actions do, kept where a run gives them.
_KEPT = (*ACTING, "max_episode_steps", "image_size", "cameras", "trial")
#: Environments and steps of the observations on which the ONNX file must act as the model does, and their seed.
_ENVS, _STEPS, _SEED = 4, 16, 77_000


def _scales_of(statistics: VecNormalize | None, names: tuple[str, ...], named: bool) -> Scales:
    """Read what scales the observations."""
    if statistics is None or not statistics.norm_obs:
        return {}
    keys = statistics.norm_obs_keys if named else names
    found = {name: statistics.obs_rms[name] if named else statistics.obs_rms for name in keys}
    return {
        name: (rms.mean, np.sqrt(rms.var + statistics.epsilon), float(statistics.clip_obs))
        for name, rms in found.items()
    }


def published_settings(env_id: str, env: Mapping[str, Any]) -> dict[str, Any]:
    """Pick the keywords of a run's environments that a policy of it needs.

    Raises
    ------
    ConfigError
        If the hand is not given by its name: its files are elsewhere.
    """
    decision = env_id.startswith("graspbox/GraspPose-")
    rows = keywords(GraspPoseVectorSettings if decision else GraspVectorSettings)
    found = {name: env.get(name, rows[name].default) for name in ACTING if name in rows}
    if not isinstance(found["hand"], str):
        raise ConfigError(f"env.hand is {found['hand']!r}; a policy of a hand that has a name can be published")
    given = {name: env[name] for name in _KEPT if name in rows and env.get(name) is not None}
    return {**found, **given}


def export_policy(
    folder: Path,
    name: str,
    policy: ModelPolicy,
    *,
    algorithm: str,
    env_id: str,
    env: Mapping[str, Any],
    policy_kwargs: Mapping[str, Any],
    licence: Path | None = None,
) -> NetworkPolicyConfig:
    """Write a policy's folder: network, weights, ``config.json`` last.

    Parameters
    ----------
    folder : Path
        The folder; it is made.
    name : str
        Name of the policy in results.
    policy : ModelPolicy
        What to export, on the CPU.
    algorithm : str
        One of `graspbox.sb3.running.ALGORITHMS`.
    env_id, env
        Id and keywords of the environments of the run, objects included.
    policy_kwargs : mapping
        What the policy is made of, as ``scripts/sb3.yaml`` has it.
    licence : Path, optional
        A file that is copied as ``LICENSE``.

    Raises
    ------
    ConfigError
        If the network is too large to be published, computes what ONNX cannot hold, or the ONNX file does not act as
        the model does.
    """
    settings = published_settings(env_id, env)
    goal = env.get("goal_from")
    looked_by = _goal_of(Path(folder), goal)
    given = env.get("obs", keywords(GraspVectorSettings)["obs"].default)
    obs = given if isinstance(given, str) else tuple(given)
    names = (obs,) if isinstance(obs, str) else obs
    graph = ActionGraph(policy.model.policy, _scales_of(policy.statistics, names, not isinstance(obs, str)), names)
    check_size(graph, f"the policy {name!r}")
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    looked = {} if goal is None else {"goal_from": goal}
    envs = _environments(env_id, _ENVS, {**settings, "obs": obs, **looked}, env.get("objects", "procedural"))
    try:
        seen = list(_observations(policy, envs))
        boxes = _boxes(envs.single_observation_space, obs)
        inputs = tuple(NetworkInput(one, boxes[one].shape, str(boxes[one].dtype)) for one in names)
        actions = int(envs.single_action_space.shape[0])  # type: ignore[index]
    finally:
        envs.close()
    example = [torch.from_numpy(_named(seen[0], names)[one]) for one in names]
    _write(graph, example, folder / _NETWORK)
    check_parity(onnx_network(folder / _NETWORK, 1), policy, seen, names, folder / _NETWORK)
    save_weights(graph, folder / _WEIGHTS)
    config = NetworkPolicyConfig(
        name=name,
        graspbox=graspbox.__version__,
        env_id=env_id,
        obs=obs,
        settings=settings,
        inputs=inputs,
        actions=actions,
        algorithm=algorithm,
        policy_kwargs=json.loads(json.dumps(dict(policy_kwargs))),
        files={file: file_hash(folder / file) for file in (_NETWORK, _WEIGHTS)},
        **looked_by,
    )
    if licence is not None:
        shutil.copyfile(licence, folder / "LICENSE")
    write_network_policy(folder, config)
    return config


def _goal_of(folder: Path, goal: str | None) -> dict[str, str]:
    """Name what the observation ``goal`` comes from; it must lie where the published policy will find it."""
    if goal is None:
        return {}
    if not (Path(goal) / CONFIG).is_file():
        raise ConfigError(
            f"goal_from is {goal!r}, which is no folder of a published policy; train with one, such as policies/depth"
        )
    return {
        "goal_from": os.path.relpath(Path(goal).resolve(), folder.resolve()),
        "goal_hash": policy_hash(Path(goal)),
    }


def _write(graph: ActionGraph, example: list[torch.Tensor], path: Path) -> None:
    try:
        write_onnx(graph, example, True, path, [])
    except OSError:
        raise
    except Exception as error:  # the exporter's errors share no base class
        kind, first = type(graph.extractor).__name__, next(iter(str(error).strip().splitlines()), "")
        raise ConfigError(
            f"the policy cannot be written as ONNX; its features extractor, {kind}, or a layer does what ONNX cannot "
            f"hold, such as numpy's functions: {first}"
        ) from error


def check_parity(
    network: Network, policy: ModelPolicy, seen: list[Any], names: tuple[str, ...], called: Path | str
) -> None:
    """Compare a network with a model on observations of environments: all rows of a step together, and one alone.

    Raises
    ------
    ConfigError
        If their actions differ by more than `graspbox.perception.onnx_files.PARITY`.
    """
    differences = []
    for observation in seen:
        rows, expected = _named(observation, names), policy.act(observation)
        alone = {name: values[:1] for name, values in rows.items()}
        for found, wanted in ((network(rows), expected), (network(alone), expected[:1])):
            differences.append(np.abs(found["action"] - wanted).max())
    worst = float(np.max(differences))
    # Not `>`: it would take numbers that are not finite.
    if not worst <= PARITY:
        raise ConfigError(f"{called} differs from the model by {worst:.2g} in 'action'; do not use it")


def _environments(env_id: str, count: int, settings: Mapping[str, Any], objects: Any) -> VectorEnv[Any, Any, Any]:
    return make_vec(env_id, count, objects=objects, autoreset_mode=AutoresetMode.SAME_STEP, **settings)


def _observations(policy: ModelPolicy, envs: VectorEnv[Any, Any, Any]) -> Iterator[Any]:
    """Let a policy act, with random actions in between, and give what the environments show."""
    policy.bind(Task.of(envs))
    envs.action_space.seed(_SEED)
    observation, _ = envs.reset(seed=_SEED)
    for step in range(_STEPS):
        yield observation
        action = policy.act(observation) if step % 3 else envs.action_space.sample()
        observation, *_ = envs.step(action)


def _named(observation: Any, names: tuple[str, ...]) -> dict[str, NDArray[Any]]:
    if isinstance(observation, Mapping):
        return {name: observation[name] for name in names}
    return {names[0]: observation}


def _boxes(space: gymnasium.Space[Any], obs: str | tuple[str, ...]) -> dict[str, Any]:
    return {obs: space} if isinstance(obs, str) else {name: space[name] for name in obs}  # type: ignore[index]


def load_graph(folder: Path) -> ActionGraph:
    """Load a published policy from its weights.

    Raises
    ------
    ConfigError, FileError
        As `graspbox.policies.network_folders.read_network_policy`, or if the weights are another network's.
    """
    from safetensors.torch import load_file

    config = read_network_policy(Path(folder))
    looked = {"goal_from": Path(folder) / config.goal_from} if config.goal_from else {}
    envs = _environments(config.env_id, 1, {**config.settings, "obs": config.obs, **looked}, "procedural:can:0")
    spaces = envs.single_observation_space, envs.single_action_space
    envs.close()
    space = _model_space(spaces[0])
    algorithm = ALGORITHMS[config.algorithm]
    given = {"policy_kwargs": dict(config.policy_kwargs)}
    made = model_arguments(algorithm, given, SimpleNamespace(observation_space=space, action_space=spaces[1]), 0)
    policy = algorithm.policy_aliases[made["policy"]](space, spaces[1], lambda _: 0.0, **made["policy_kwargs"])
    weights = load_file(str(Path(folder) / _WEIGHTS))
    names = tuple(one.name for one in config.inputs)
    # The scales are read from the file too; it says which observations have some.
    scaled = [name for name in names if f"seen.of_{name}.mean" in weights]
    scales = {
        name: tuple(weights[f"seen.of_{name}.{part}"].numpy() for part in ("mean", "deviation", "clip"))
        for name in scaled
    }
    graph = ActionGraph(policy, scales, names)
    restore_weights(graph, Path(folder) / _WEIGHTS)
    return graph


def _model_space(space: gymnasium.Space[Any]) -> gymnasium.Space[Any]:
    """Give the space that a model sees of an environment's: colour images have their channels first."""
    if isinstance(space, gymnasium.spaces.Dict):
        return gymnasium.spaces.Dict({name: _model_space(one) for name, one in space.spaces.items()})
    is_colour = is_image_space(space) and not is_image_space_channels_first(space)
    return VecTransposeImage.transpose_space(space) if is_colour else space
