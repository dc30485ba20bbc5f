"""Export of a policy of Stable-Baselines3 that then runs without torch: one ONNX file with all steps of `predict`.

| step | source |
|---|---|
| scaling by means and variances, clipping | `VecNormalize`, in double precision as there |
| channels of colour images first, and in [0, 1] | Stable-Baselines3's preprocessing |
| features, hidden layers, mean action | features extractor and actor |
| deterministic action | clipped to the action space (PPO), or squashed and scaled to it (SAC, TQC, TD3) |

`graspbox.policies.NetworkPolicy` runs the folder; ``scripts/publish_sb3.py`` exports a run with a card.
"""

from collections.abc import Iterable, Iterator, Mapping
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

from graspbox._common.arguments import plain, shown
from graspbox.envs.settings import kind_of
from graspbox.errors import ConfigError
from graspbox.hands import load_hand
from graspbox.learn.export.exports import Traced, export
from graspbox.learn.export.onnx_files import PARITY
from graspbox.learn.export.weight_files import load_weights, restore_weights
from graspbox.learn.sb3.action_graphs import ActionGraph, Scales
from graspbox.learn.sb3.running import ALGORITHMS, model_arguments
from graspbox.policies import Task
from graspbox.policies.published.configs import ACTING, SETTINGS, Environment, NetworkInput, NetworkPolicyConfig
from graspbox.policies.published.folders import CONFIG, hand_of, load
from graspbox.policies.published.runtimes import Network, onnx_network
from graspbox.sb3.policy import ModelPolicy

__all__ = ["export_policy", "load_graph", "published_settings"]

_NETWORK = "policy.onnx"
#: Environments and steps of the observations on which the ONNX file must reproduce the model's actions, and their seed.
_ENVS, _STEPS, _SEED = 4, 16, 77_000


def _scales_of(statistics: VecNormalize | None, names: tuple[str, ...]) -> Scales:
    """Return the scaling of the observations."""
    if statistics is None or not statistics.norm_obs:
        return {}
    scaled = statistics.obs_rms if isinstance(statistics.obs_rms, dict) else {names[0]: statistics.obs_rms}
    return {
        name: (rms.mean, np.sqrt(rms.var + statistics.epsilon), float(statistics.clip_obs))
        for name, rms in scaled.items()
        if name in names
    }


def published_settings(env_id: str, env: Mapping[str, Any]) -> dict[str, Any]:
    """Select the keywords of a run's environments that its policy needs, besides the hand."""
    kind: type = kind_of(env_id, vector=True)
    found = {name: env.get(name, getattr(kind, name)) for name in ACTING if hasattr(kind, name)}
    return {**found, **{name: env[name] for name in SETTINGS if hasattr(kind, name) and env.get(name) is not None}}


def export_policy(
    folder: Path,
    name: str,
    policy: ModelPolicy,
    *,
    algorithm: str,
    env_id: str,
    env: Mapping[str, Any],
    policy_kwargs: Mapping[str, Any],
    learned_from: Iterable[str],
    licence: Path | None = None,
) -> NetworkPolicyConfig:
    """Write a policy's folder: the network, and ``config.json`` last.

    Parameters
    ----------
    folder, name, learned_from, licence
        As for `graspbox.learn.export.exports.export_depth_policy`.
    policy : ModelPolicy
        The policy to export, on the CPU.
    algorithm : str
        One of `graspbox.learn.sb3.running.ALGORITHMS`.
    env_id, env
        Id and keywords of the run's environments, objects included.
    policy_kwargs : mapping
        The parameters of the policy, in the format of ``graspbox/learn/sb3/parameters.yaml``.

    Raises
    ------
    ConfigError
        If the network is too large to be published or has operations that ONNX does not support, if the ONNX file does
        not reproduce the model's actions.
    HandError
        If the hand cannot be read.
    """
    keywords = kind_of(env_id, vector=True)
    hand, observed = (env.get(keyword, getattr(keywords, keyword)) for keyword in ("hand", "obs"))
    loaded = load_hand(hand)
    obs = observed if isinstance(observed, str) else tuple(observed)
    acts_in = Environment(env_id, obs, plain(published_settings(env_id, env), "env"))
    names = acts_in.names
    graph = ActionGraph(policy.model.policy, _scales_of(policy.statistics, names), names)
    settings = {**acts_in.settings, "obs": obs, "hand": hand}
    envs = _environments(env_id, _ENVS, settings, env.get("objects", "procedural"))
    try:
        seen = list(_observations(policy, envs))
        boxes = _boxes(envs.single_observation_space, names)
        inputs = tuple(NetworkInput(one, boxes[one].shape, str(boxes[one].dtype)) for one in names)
        actions = int(envs.single_action_space.shape[0])  # type: ignore[index]
    finally:
        envs.close()
    config = NetworkPolicyConfig(
        name=name,
        hand=loaded.name,
        environment=acts_in,
        learned_from=tuple(learned_from),
        inputs=inputs,
        actions=actions,
        algorithm=algorithm,
        policy_kwargs=plain(dict(policy_kwargs), "policy_kwargs"),
    )

    def compare(path: Path) -> None:
        check_parity(onnx_network(path, 1), policy, seen, names, path)

    example = [torch.from_numpy(_named(seen[0], names)[one]) for one in names]
    network = Traced(graph, example, compare=compare)
    try:
        return export(folder, config, {_NETWORK: network}, licence, loaded)
    except (OSError, ConfigError):
        raise
    except Exception as error:  # the exporter's errors share no base class
        kind, first = type(graph.extractor).__name__, next(iter(str(error).strip().splitlines()), "")
        raise ConfigError(
            f"the policy cannot be written as ONNX; its features extractor, {kind}, or a layer has an operation "
            f"that ONNX lacks, such as numpy's functions: {first}"
        ) from error


def check_parity(
    network: Network, policy: ModelPolicy, seen: list[Any], names: tuple[str, ...], called: Path | str
) -> None:
    """Compare a network with a model on observations of environments: all rows of a step together, and one alone.

    Raises
    ------
    ConfigError
        If their actions differ by more than `graspbox.learn.export.onnx_files.PARITY`.
    """
    differences = []
    for observation in seen:
        rows, expected = _named(observation, names), policy.act(observation)
        alone = {name: values[:1] for name, values in rows.items()}
        for found, wanted in ((network(rows), expected), (network(alone), expected[:1])):
            differences.append(np.abs(found["action"] - wanted).max())
    worst = float(np.max(differences))
    # Not `>`, which would accept numbers that are not finite.
    if not worst <= PARITY:
        raise ConfigError(f"{called} differs from the model by {worst:.2g} in 'action'; do not use it")


def _environments(env_id: str, count: int, settings: Mapping[str, Any], objects: Any) -> VectorEnv[Any, Any, Any]:
    keywords = {**settings, "objects": objects, "autoreset_mode": AutoresetMode.SAME_STEP}
    return gymnasium.make_vec(env_id, num_envs=count, **keywords)


def _observations(policy: ModelPolicy, envs: VectorEnv[Any, Any, Any]) -> Iterator[Any]:
    """Run a policy, with random actions in between, and yield the observations of the environments."""
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


def _boxes(space: gymnasium.Space[Any], names: tuple[str, ...]) -> dict[str, Any]:
    return dict(space.spaces) if isinstance(space, gymnasium.spaces.Dict) else {names[0]: space}


def load_graph(folder: Path) -> ActionGraph:
    """Load a published policy from its weights.

    Raises
    ------
    ConfigError
        As `graspbox.policies.published.load`, or if the weights belong to another network.
    """
    config = load(folder, NetworkPolicyConfig)
    acts_in = config.environment
    settings = {**config.settings, "hand": hand_of(folder, config), "obs": acts_in.obs}
    envs = _environments(acts_in.id, 1, settings, "procedural:can:0")
    spaces = envs.single_observation_space, envs.single_action_space
    envs.close()
    space = _model_space(spaces[0])
    if config.algorithm not in ALGORITHMS:
        raise ConfigError(f"algorithm is {config.algorithm!r}; choose from {', '.join(ALGORITHMS)}")
    algorithm = ALGORITHMS[config.algorithm]
    arguments = {"policy_kwargs": dict(config.policy_kwargs)}
    try:
        made = model_arguments(
            algorithm, arguments, SimpleNamespace(observation_space=space, action_space=spaces[1]), 0
        )
        policy = algorithm.policy_aliases[made["policy"]](space, spaces[1], lambda _: 0.0, **made["policy_kwargs"])
    except (AssertionError, AttributeError, KeyError, TypeError, ValueError, RuntimeError) as error:
        why = str(error).partition("\n")[0] or type(error).__name__
        raise ConfigError(
            f"{Path(folder) / CONFIG}: network.policy_kwargs is {shown(dict(config.policy_kwargs))}, which makes no "
            f"policy of {config.algorithm!r}: {why}"
        ) from None
    weights = load_weights(Path(folder) / _NETWORK)
    names = tuple(one.name for one in config.inputs)
    # The scales are in the file too; it determines which observations have one.
    scaled = [name for name in names if f"seen.of_{name}.mean" in weights]
    scales = {
        name: tuple(weights[f"seen.of_{name}.{part}"].numpy() for part in ("mean", "deviation", "clip"))
        for name in scaled
    }
    graph = ActionGraph(policy, scales, names)
    restore_weights(graph, Path(folder) / _NETWORK)
    return graph


def _model_space(space: gymnasium.Space[Any]) -> gymnasium.Space[Any]:
    """Return a model's space for an environment's: colour images have their channels first."""
    if isinstance(space, gymnasium.spaces.Dict):
        return gymnasium.spaces.Dict({name: _model_space(one) for name, one in space.spaces.items()})
    is_colour = is_image_space(space) and not is_image_space_channels_first(space)
    return VecTransposeImage.transpose_space(space) if is_colour else space
