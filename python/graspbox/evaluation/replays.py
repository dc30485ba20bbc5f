"""Episodes that can be run again: their seeds, objects and actions, and the settings of their environment.

| name | purpose |
|---|---|
| `ActionLog` | a policy that keeps the actions of another one |
| `Replay`    | one episode, with all that is needed to step it again, as plain JSON |
| `failed`    | the first failures of each kind of an evaluation, as replays |
| `shown`     | the first episodes of an evaluation, as replays |

The same seed and the same actions give the same bits, so a replay needs neither the policy nor the other objects.
"""

import base64
import binascii
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields
from typing import Any, Self

import gymnasium
import numpy as np
from numpy.typing import NDArray

from graspbox import object_sets
from graspbox.envs import SINGLE_OBJECT_IDS
from graspbox.errors import ConfigError
from graspbox.evaluation.results import Evaluation, TrialResult
from graspbox.object_sets import ObjectSet, ObjectSpec
from graspbox.policies import Actions, Policy, Task

__all__ = ["PER_KIND", "ActionLog", "Replay", "failed", "shown"]

#: Failures of each kind that a file of an evaluation keeps for replays.
PER_KIND = 4
#: Episodes whose actions are kept, the first ones; 16 MB at 200 steps.
_KEPT = 2000
#: Greatest number of steps of an episode that is read from a file.
_MAX_STEPS = 100_000


class ActionLog(Policy):
    """Acts as another policy, and keeps the actions of the first 2,000 episodes by their seeds.

    Parameters
    ----------
    policy : Policy
        The policy that acts.
    """

    def __init__(self, policy: Policy) -> None:
        self._policy = policy
        self.name, self.obs, self.settings = policy.name, policy.obs, policy.settings
        self.env_id, self.learned_from, self.base = policy.env_id, policy.learned_from, None
        self._kept: dict[int, list[NDArray[np.float32]]] = {}
        self._open: list[list[NDArray[np.float32]] | None] = []

    def needed_obs(self, *, target: bool) -> str | tuple[str, ...] | None:
        """Return the observations that the policy needs."""
        return self._policy.needed_obs(target=target)

    def _bind(self, task: Task) -> None:
        self._policy.bind(task)
        self._open = [None] * task.num_envs

    def reset(self, seed: Any = None, *, mask: Any = None, info: Any = None) -> None:
        """Begin episodes of the policy, and keep their seeds."""
        self._policy.reset(seed, mask=mask, info=info)
        super().reset(seed, mask=mask, info=info)

    def _begin(self, env: int, seed: int | None, info: dict[str, Any]) -> None:
        del info
        self._open[env] = None
        if seed is not None and (seed in self._kept or len(self._kept) < _KEPT):
            self._kept[seed] = self._open[env] = []

    def act(self, observation: Any) -> Actions:
        """Choose the policy's actions."""
        actions = self._policy.act(observation)
        for steps, action in zip(self._open, actions, strict=True):
            if steps is not None:
                steps.append(np.array(action, dtype=np.float32))
        return actions

    def confidence(self, env: int) -> float | None:
        """Give the policy's probability."""
        return self._policy.confidence(env)

    def found_nothing(self, env: int) -> bool:
        """Whether the policy's last look found no grasp."""
        return self._policy.found_nothing(env)

    def actions(self, seed: int, steps: int) -> NDArray[np.float32] | None:
        """Return the actions (steps, k) of an episode; None if they were not kept."""
        found = self._kept.get(seed, [])
        # An environment whose trial has ended is still acted for, until its next one begins.
        return np.stack(found[:steps]) if len(found) >= steps > 0 else None


@dataclass(frozen=True, eq=False)
class Replay:
    """One episode that can be stepped again.

    Attributes
    ----------
    env_id : str
        One of `graspbox.envs.SINGLE_OBJECT_IDS`.
    settings : mapping
        Keywords of the environment as JSON holds them, without the objects and the observations.
    seed : int
        Seed of the reset.
    object, source : str
        Name of the object, and the set that holds it alone.
    scale : float
        Metres per unit of its mesh file; a factor on the size of a procedural object.
    mass : float or None
        Kilograms, where they are not those of the mesh.
    failure : str
        Kind of the failure, ``failure`` where it is unknown; empty for a success.
    actions : (t, k) float32
        The actions, one per step.
    probability : float or None
        Probability of success that the policy predicted.
    """

    env_id: str
    settings: Mapping[str, Any]
    seed: int
    object: str
    source: str
    scale: float
    mass: float | None
    failure: str
    actions: NDArray[np.float32]
    probability: float | None = None

    @classmethod
    def of(
        cls, env_id: str, settings: Mapping[str, Any], spec: ObjectSpec, trial: TrialResult, actions: Actions
    ) -> Self:
        """Describe a trial of an evaluation."""
        facts = (trial.seed, spec.name, spec.source, spec.scale, spec.mass, trial.failure)
        return cls(env_id, settings, *facts, actions, trial.confidence)

    def to_json(self) -> dict[str, Any]:
        """Plain values; actions are little-endian float32 in base64."""
        text = base64.b64encode(self.actions.astype("<f4").tobytes()).decode()
        own = {f.name: getattr(self, f.name) for f in fields(self) if f.name not in ("env_id", "settings", "actions")}
        return {**own, "steps": len(self.actions), "actions": text}

    @classmethod
    def from_json(cls, row: Mapping[str, Any], env_id: str, settings: Mapping[str, Any]) -> Self:
        """Read the output of `to_json`.

        Raises
        ------
        ConfigError
            If a field is missing or has another type.
        """
        try:
            steps = int(row["steps"])
            if env_id not in SINGLE_OBJECT_IDS or not 0 < steps <= _MAX_STEPS:
                raise ValueError(f"{env_id!r} with {steps} steps")
            raw = np.frombuffer(base64.b64decode(row["actions"], validate=True), dtype="<f4")
            actions = raw.reshape(steps, -1).astype(np.float32)
            mass = None if row["mass"] is None else float(row["mass"])
            stated = row.get("probability")
            name, source = str(row["object"]), str(row["source"])
            scale, seed, failure = float(row["scale"]), int(row["seed"]), str(row["failure"])
            probability = None if stated is None else float(stated)
            return cls(env_id, settings, seed, name, source, scale, mass, failure, actions, probability)
        except (KeyError, TypeError, ValueError, binascii.Error) as error:
            raise ConfigError(f"a replay cannot be read ({error}); evaluate the policy again") from None

    def spec(self) -> ObjectSpec:
        """Find the object.

        Raises
        ------
        ObjectSetError, MissingExtraError
            If it is not on this machine.
        """
        return object_sets.load(self.source, scale=self.scale, mass=self.mass)[0]

    def make(self, **keywords: Any) -> Any:
        """Make a single environment for this episode; `keywords` replace its settings.

        Raises
        ------
        ConfigError, ObjectSetError, MissingExtraError
            As for ``gymnasium.make``.
        """
        arguments = {**self.settings, "scale": self.scale, "mass": self.mass, **keywords}
        return gymnasium.make(self.env_id, objects=self.source, **arguments).unwrapped

    def run(self, env: Any) -> Iterator[tuple[Any, dict[str, Any]]]:
        """Step an environment of `make`; yields observation and info of the reset and of every step.

        Raises
        ------
        MeshError, FileError, SimulationError
            If the object cannot be read or simulated.
        """
        yield env.reset(seed=self.seed)
        for action in self.actions:
            observation, _, terminated, truncated, info = env.step(action)
            yield observation, info
            if terminated or truncated:
                return


@dataclass(frozen=True)
class _Chosen:
    """Trials of an evaluation with their objects and actions; those of a single object can be replayed."""

    result: Evaluation
    log: ActionLog
    specs: Mapping[str, ObjectSpec] = field(default_factory=dict)

    def replay(self, trial: TrialResult) -> Replay | None:
        actions = self.log.actions(trial.seed, trial.steps)
        spec = self.specs.get(trial.object)
        settings = self.result.settings
        if actions is None or spec is None or settings is None or settings.get("layout", "single") != "single":
            return None
        return Replay.of(self.result.env_id, settings, spec, trial, actions)


def shown(result: Evaluation, log: ActionLog, objects: ObjectSet, count: int) -> list[Replay]:
    """Return the first `count` trials of an evaluation as replays, in their order."""
    chosen = _Chosen(result, log, {spec.name: spec for spec in objects})
    return [one for trial in result.trials[:count] if (one := chosen.replay(trial)) is not None]


def failed(result: Evaluation, log: ActionLog, objects: ObjectSet, per_kind: int = PER_KIND) -> list[Replay]:
    """Return the first failures of each kind as replays, in the order of the trials.

    Objects are tried in turn: a second failure of an object comes after the first failures of the others.
    """
    chosen = _Chosen(result, log, {spec.name: spec for spec in objects})
    found: dict[str, list[Replay]] = {}
    for trial in _spread([trial for trial in result.trials if not trial.success]):
        kept = found.setdefault(trial.failure, [])
        if len(kept) < per_kind and (one := chosen.replay(trial)) is not None:
            kept.append(one)
    return [one for kept in found.values() for one in kept]


def _spread(trials: Sequence[TrialResult]) -> list[TrialResult]:
    """Order failures so that each kind shows different objects first."""
    times: dict[tuple[str, str], int] = {}
    turns = []
    for trial in trials:
        key = (trial.failure, trial.object)
        turns.append(times.setdefault(key, 0))
        times[key] += 1
    order = sorted(range(len(trials)), key=lambda i: (turns[i], i))
    return [trials[i] for i in order]
