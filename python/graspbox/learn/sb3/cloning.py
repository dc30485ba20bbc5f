"""Behaviour cloning of demonstrations by a model of Stable-Baselines3.

| name | purpose |
|---|---|
| `train` | ``graspbox train clone`` |
| `imitate` | the training, with `graspbox.learn.training.trainer` |
| `ClonedSteps`, `observe`, `cloning_loss` | recorded steps, the statistics that scale them, and the loss |
| `begin_as` | initialize a model from a clone |
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.off_policy_algorithm import OffPolicyAlgorithm
from stable_baselines3.common.vec_env import VecNormalize
from torch import Tensor, nn

from graspbox import evaluation
from graspbox._common.runs import Rows, Run, read_settings
from graspbox.data.episodes import KEEP, Demonstrations
from graspbox.errors import ConfigError
from graspbox.learn.sb3.checks import check_arguments
from graspbox.learn.sb3.running import (
    ALGORITHMS,
    load_policy,
    make_env,
    model_arguments,
    normalized,
    save,
)
from graspbox.learn.sb3.runs import next_commands
from graspbox.learn.sb3.settings import EVALUATION_SEED, CloneSettings, Parameters, read_parameters, settings_of_clone
from graspbox.learn.training.configs import TrainConfig
from graspbox.learn.training.options import TrainingOutcome
from graspbox.learn.training.trainer import Trainer, TrainProgress, moved
from graspbox.sb3.policy import ModelPolicy, summary

__all__ = [
    "ClonedSteps",
    "begin_as",
    "cloning_loss",
    "held_out",
    "imitate",
    "mean_actions",
    "observe",
    "train",
]

#: Logarithm of the standard deviation of the exploring actions of a cloned stochastic actor, and the weight of the
#: squared distance from it. SAC's usual entropy target is -1 per entry of an action: the entropy of a normal
#: distribution whose log standard deviation is -2.4.
_LOG_STD, _STD_WEIGHT = -2.4, 1e-3


class ClonedSteps(torch.utils.data.Dataset[tuple[Any, Tensor]]):  # type: ignore[misc]
    """Steps of demonstrations in memory: observations of the environment, and actions.

    An index may be a list, which reads a whole batch. Pass a ``BatchSampler`` as ``sampler`` of a ``DataLoader``.

    Parameters
    ----------
    demonstrations : sequence of Demonstrations
        Sources of the steps.
    obs : str or sequence of str
        Observations, as in the environment's keyword: one name yields tensors, several yield mappings.
    keep : {"secure", "success", "all"}
        Episodes to use.
    episodes : int, optional
        Use only the first ones of each.

    Attributes
    ----------
    episode : (steps,) int64 array
        Episode of each step, from 0.

    Raises
    ------
    ConfigError
        If the recording lacks these observations or has too few such episodes.
    """

    def __init__(
        self, demonstrations: Sequence[Demonstrations], obs: Any, keep: str = "secure", episodes: int | None = None
    ) -> None:
        if keep not in KEEP:
            raise ConfigError(f"keep is {keep!r}; choose from {', '.join(KEEP)}")
        self._single = isinstance(obs, str)
        names = (obs,) if isinstance(obs, str) else tuple(obs)
        worth: Any = KEEP[keep]
        parts = [one.steps(names, chosen=worth, limit=episodes) for one in demonstrations]
        self.observations = {
            name: torch.from_numpy(np.concatenate([part[0][name] for part in parts])) for name in names
        }
        self.actions = torch.from_numpy(np.concatenate([part[1] for part in parts]))
        counts = np.cumsum([0, *(part[3][-1] + 1 for part in parts[:-1])])
        self.episode = np.concatenate([part[3] + before for part, before in zip(parts, counts, strict=True)])

    def __len__(self) -> int:
        return len(self.actions)

    def __getitem__(self, index: Any) -> tuple[Any, Tensor]:
        rows = {name: values[index] for name, values in self.observations.items()}
        return next(iter(rows.values())) if self._single else rows, self.actions[index]

    def arrays(self) -> Any:
        """All observations in the environment's format: an array, or a dictionary of arrays."""
        rows = {name: values.numpy() for name, values in self.observations.items()}
        return next(iter(rows.values())) if self._single else rows


def observe(statistics: VecNormalize, steps: ClonedSteps) -> None:
    """Set the statistics that scale observations from demonstrations, and freeze them.

    Later changes of the statistics would change the actions of a cloned policy.
    """
    if statistics.norm_obs:
        seen = steps.arrays()
        if isinstance(statistics.obs_rms, dict):
            for name, found in statistics.obs_rms.items():
                found.update(seen[name])
        else:
            statistics.obs_rms.update(seen)
    statistics.training = False


def _scaled(model: BaseAlgorithm, observations: Any) -> Any:
    """Tensors in the format of the policy."""
    numbers: Any = (
        {name: values.cpu().numpy() for name, values in observations.items()}
        if isinstance(observations, dict)
        else observations.cpu().numpy()
    )
    statistics = model.get_vec_normalize_env()
    if statistics is not None:
        numbers = statistics.normalize_obs(numbers)
    tensors, _ = model.policy.obs_to_tensor(numbers)
    return tensors


def actor_parameters(model: BaseAlgorithm) -> list[torch.nn.Parameter]:
    """List the parameters that determine the actions: in on-policy models all but those of the value function alone."""
    policy: Any = model.policy
    if isinstance(model, OffPolicyAlgorithm):
        return list(policy.actor.parameters())
    parts = [policy.mlp_extractor.value_net, policy.value_net]
    if not policy.share_features_extractor:
        parts.append(policy.vf_features_extractor)
    of_value = {id(parameter) for part in parts for parameter in part.parameters()}
    return [parameter for parameter in policy.parameters() if id(parameter) not in of_value]


def mean_actions(model: BaseAlgorithm, observations: Any) -> tuple[Tensor, Tensor | None]:
    """Mean actions, in [-1, 1] unless the policy is unsquashed, and the log of their standard deviation if learned.

    Parameters
    ----------
    model : BaseAlgorithm
        PPO, SAC or TD3.
    observations : tensor, or mapping of tensors
        In the environment's format.

    Returns
    -------
    means : (rows, k) tensor
        The actions of the deterministic policy.
    log_std : (rows, k) tensor, optional
        For an actor that predicts it.
    """
    policy: Any = model.policy
    scaled = _scaled(model, observations)
    if not isinstance(model, OffPolicyAlgorithm):
        return policy.get_distribution(scaled).distribution.mean, None
    if not hasattr(policy.actor, "log_std"):
        return policy.actor(scaled), None
    means, log_std, _ = policy.actor.get_action_dist_params(scaled)
    return torch.tanh(means), log_std


def cloning_loss(model: BaseAlgorithm, observations: Any, actions: Tensor) -> tuple[Tensor, Tensor]:
    """Loss to minimize, and the mean squared error of the actions in it."""
    means, log_std = mean_actions(model, observations)
    error = ((means - actions.to(means.device)) ** 2).mean()
    if log_std is None:
        return error, error
    return error + _STD_WEIGHT * ((log_std - _LOG_STD) ** 2).mean(), error


def held_out(episode: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Return which steps are held out of cloning: those of every tenth episode."""
    aside: NDArray[np.bool_] = episode % 10 == 9
    return aside


def imitate(
    folder: Path,
    net: nn.Module,
    steps: Any,
    aside: NDArray[np.bool_],
    order: Callable[[int, Tensor], Tensor],
    losses: Callable[[Any, Any], Mapping[str, Tensor]],
    config: TrainConfig,
    epochs: int,
    *,
    parameters: list[nn.Parameter] | None = None,
    progress: Callable[[TrainProgress], None] = lambda _: None,
) -> dict[str, Any]:
    """Train a policy on demonstrated steps, shuffled in each epoch; keeps the last weights.

    Parameters
    ----------
    folder : Path
        Folder of the training, which resumes there.
    net : Module
        The policy.
    steps : dataset
        Maps a tensor of indices to the batch of these steps.
    aside : (n,) bool
        Steps that are held out.
    order : callable
        Maps an epoch's number to the order of the indices of the other steps.
    losses : callable
        As `Trainer` takes them; ``error`` is the mean squared error of the actions.
    config : TrainConfig
        Learning rate, batch size, seed and device; the learning rate falls along half a cosine, epoch by epoch.
    epochs : int
        Passes over the steps.
    parameters, progress
        As `Trainer` takes them.

    Returns
    -------
    dict
        Metrics of the last epoch: ``step``, ``train_error``, and ``error`` on the steps held out.

    Raises
    ------
    ConfigError
        As `Trainer`.
    """
    rows, kept_out = torch.from_numpy(np.flatnonzero(~aside)), torch.from_numpy(np.flatnonzero(aside))
    size = config.batch_size
    epoch = -(-len(rows) // size)
    made = replace(
        config,
        optimizer="adam",
        schedule="epoch_cosine",
        clip_norm=None,
        max_steps=epochs * epoch,
        validate_every=epoch,
        patience=epochs + 1,
        keep="last",
        max_seconds=float("inf"),
    )

    def batch(step: int) -> Any:
        number, place = divmod(step, epoch)
        return steps[order(number, rows)[place * size : (place + 1) * size]]

    def validate(net: Any) -> dict[str, float]:
        total = 0.0
        for part in torch.split(kept_out, size):
            total += float(losses(net, moved(steps[part], made.device))["error"]) * len(part)
        return {"minus_error": -total / len(kept_out), "error": total / len(kept_out)}

    trainer = Trainer(net, folder, made, batch=batch, losses=losses, validate=validate, parameters=parameters)
    trainer.run(progress)
    return Rows(folder / "losses.jsonl")[-1]


def train(settings: CloneSettings, command: str, echo: Callable[[str], None]) -> TrainingOutcome:
    """Run ``graspbox train clone``.

    Raises
    ------
    ConfigError
        If the folder holds another run, or there are too few demonstrations of this kind.
    """
    shown = [Demonstrations(folder) for folder in settings.demonstrations]
    env_id, keywords = _environment(shown, settings.obs)
    parameters = read_parameters(settings.parameters, settings.algorithm, env_id, settings.set, demonstrated=True)
    check_arguments(ALGORITHMS[settings.algorithm], parameters.model)
    with settings.run(echo, settings.kept_of(env_id, keywords, shown[0].settings)) as run:
        run.log(command)
        steps = ClonedSteps(shown, keywords["obs"], settings.keep, settings.shown)
        aside = held_out(steps.episode)
        if not aside.any():
            raise ConfigError(f"{steps.episode[-1] + 1} episodes are too few; ten or more leave one to hold out")
        model = _model(settings, parameters, env_id, keywords, steps)
        if settings.clone is not None:
            begin_as(model, settings.clone)
        every = max(1, settings.epochs // settings.evaluations)
        length = -(-int((~aside).sum()) // settings.batch)

        def progress(done: TrainProgress) -> None:
            epoch, place = divmod(done.step, length)
            run.report(f"epoch {epoch} of {settings.epochs}, action error {done.losses['error']:.4f}", done.share)
            if not place and not epoch % every and epoch < settings.epochs:
                _evaluate(settings, run, model, done.step)

        def order(epoch: int, rows: Tensor) -> Tensor:
            random = torch.Generator().manual_seed(settings.seed + 1000 * epoch)
            return rows[torch.randperm(len(rows), generator=random)]

        def losses(net: Any, batch: tuple[Any, Tensor]) -> dict[str, Tensor]:
            del net
            loss, error = cloning_loss(model, *batch)
            return {"minimized": loss, "error": error.detach()}

        config = TrainConfig(
            learning_rate=settings.rate, batch_size=settings.batch, seed=settings.seed, device=settings.device
        )
        last = imitate(
            run.folder / "cloning",
            model.policy,
            steps,
            aside,
            order,
            losses,
            config,
            settings.epochs,
            parameters=actor_parameters(model),
            progress=progress,
        )
        row = _evaluate(settings, run, model, last["step"])
        found = {"folder": str(settings.out), "epoch": settings.epochs, "updates": last["step"]}
        found |= {"trained": last["train_error"], "held_out": last["error"]}
        found |= {name: row[name] for name in ("success", "ci95", "secure", "episodes")}
        told = [f"{name}: {value}" for name, value in found.items()]
        return TrainingOutcome(found, "\n".join([*told, next_commands(settings.out)]))


def _environment(shown: Sequence[Demonstrations], obs: tuple[str, ...]) -> tuple[str, dict[str, Any]]:
    """Return id and keywords of the environment of all demonstrations."""
    found = [one.environment(obs) for one in shown]
    for one, other in zip(shown, found, strict=True):
        if other != found[0]:
            raise ConfigError(f"{str(one.folder)!r} has another environment than {str(shown[0].folder)!r}: {other[1]}")
    return found[0]


def _model(
    settings: CloneSettings, parameters: Parameters, env_id: str, keywords: dict[str, Any], steps: ClonedSteps
) -> Any:
    """Create the model, with statistics that scale its observations."""
    env = make_env(env_id, parameters.num_envs, **{**keywords, "split": "train"})
    env = normalized(env, parameters.model.get("gamma", 0.99), **{**parameters.normalize, "reward": False})
    algorithm = ALGORITHMS[settings.algorithm]
    arguments = model_arguments(algorithm, parameters.model, env, 0)
    # Cloning needs no replay buffer; a reinforcement learning run creates one of the configured size.
    arguments |= {"buffer_size": 1} if "buffer_size" in arguments else {}
    model = algorithm(env=env, seed=settings.seed, device=settings.device, **arguments)
    if model.get_vec_normalize_env() is not None:
        observe(model.get_vec_normalize_env(), steps)
    return model


def _evaluate(settings: CloneSettings, run: Run, model: Any, updates: int) -> dict[str, Any]:
    """Save the policy and evaluate it on held-out objects, unless done before."""
    rows = run.rows("evaluations")
    known = next((row for row in rows if row["timesteps"] == updates), None)
    if known is not None:
        return known
    model.num_timesteps = updates
    save(model, run.folder / "checkpoint", run.seconds, buffer=False)
    kept = read_settings(run.folder)
    policy = ModelPolicy(model, model.get_vec_normalize_env(), "clone")
    keywords = {**kept["env"], "split": settings.evaluate, "trials": settings.episodes}
    keywords |= {"seed": EVALUATION_SEED, "num_envs": min(kept["num_envs"], settings.episodes)}
    row = summary(evaluation.evaluate(policy, kept["id"], **keywords))
    rows.append({"timesteps": updates, "seconds": round(run.seconds, 1), **row})
    run.log(f"{updates} updates: {row['success']:.1%} of {row['episodes']} held-out trials succeed")
    return rows[-1]


def begin_as(model: BaseAlgorithm, folder: Path) -> None:
    """Initialize a new model with the policy of a clone, and freeze the statistics that scale its observations.

    Parameters
    ----------
    model : BaseAlgorithm
        A model with the clone's algorithm.
    folder : Path
        Folder of the clone's run.

    Raises
    ------
    ConfigError
        If there is no clone, or its algorithm, spaces, networks or statistics differ.
    """
    settings = settings_of_clone(folder)
    clone = load_policy(settings["algorithm"], folder / "checkpoint", str(model.device))
    if type(clone.model) is not type(model):
        raise ConfigError(f"the clone in {str(folder)!r} is a policy of {settings['algorithm']}; train it with that")
    for name in ("observation_space", "action_space"):
        mine, its = getattr(model, name), getattr(clone.model, name)
        if mine != its:
            raise ConfigError(f"the clone in {str(folder)!r} has the {name} {its}, the run has {mine}; set env.obs")
    statistics = model.get_vec_normalize_env()
    if (statistics is None) != (clone.statistics is None):
        raise ConfigError(f"normalize.observations differs from that of the clone in {str(folder)!r}")
    if statistics is not None and clone.statistics is not None:
        statistics.obs_rms, statistics.training = clone.statistics.obs_rms, False
    policy: Any = model.policy
    try:
        policy.load_state_dict(clone.model.policy.state_dict())
    except RuntimeError as error:
        first = str(error).splitlines()[-1].strip()
        raise ConfigError(
            f"the clone in {str(folder)!r} has other networks ({first}); give model.policy_kwargs as for the clone"
        ) from None
