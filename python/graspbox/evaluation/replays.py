"""Episodes that can be run again: their seeds, objects and actions, and the settings of their environment.

The same seed and actions determine every bit, so a replay needs neither the policy nor the other objects.
"""

import base64
import binascii
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, fields
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
    """Acts as another policy, and keeps the actions of the first 2,000 episodes by their seeds."""

    def __init__(self, policy: Policy) -> None:
        self._policy = policy
        self.name, self.obs, self.settings = policy.name, policy.obs, policy.settings
        self.closed_loop_settings = policy.closed_loop_settings
        self.env_id, self.learned_from, self.base = policy.env_id, policy.learned_from, None
        self.held_out = policy.held_out
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
        """Return the policy's probability."""
        return self._policy.confidence(env)

    def found_nothing(self, env: int) -> bool:
        """Whether the policy's last look showed no grasp."""
        return self._policy.found_nothing(env)

    def actions(self, seed: int, steps: int) -> NDArray[np.float32] | None:
        """Return the actions (steps, k) of an episode; None if they were not kept."""
        kept = self._kept.get(seed, [])
        # The policy acts on in an environment whose trial has ended, until its next one begins.
        return np.stack(kept[:steps]) if len(kept) >= steps > 0 else None


@dataclass(frozen=True, eq=False)
class Replay:
    """One episode that can be stepped again.

    Attributes
    ----------
    settings : mapping
        Keywords of the environment as JSON holds them, without the objects and the observations.
    source : str
        The set that holds only the object.
    scale, mass : float, float or None
        Metres per unit of the mesh file, or a factor on the size of a procedural object; kilograms, if not of the mesh.
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
        """Read the output of `to_json`; a `ConfigError` names a wrong field."""
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
        """Find the object on this machine; errors as of `graspbox.object_sets.load`."""
        return object_sets.load(self.source, scale=self.scale, mass=self.mass)[0]

    def make(self, **keywords: Any) -> Any:
        """Make a single environment for this episode; `keywords` replace its settings."""
        arguments = {**self.settings, "scale": self.scale, "mass": self.mass, **keywords}
        return gymnasium.make(self.env_id, objects=self.source, **arguments).unwrapped

    def run(self, env: Any) -> Iterator[tuple[Any, dict[str, Any]]]:
        """Step an environment of `make`; yields observation and info of the reset and of every step."""
        yield env.reset(seed=self.seed)
        for action in self.actions:
            observation, _, terminated, truncated, info = env.step(action)
            yield observation, info
            if terminated or truncated:
                return


def _replay(result: Evaluation, log: ActionLog, objects: ObjectSet, trial: TrialResult) -> Replay | None:
    """Describe a trial of an evaluation; None if it cannot be repeated."""
    actions, settings = log.actions(trial.seed, trial.steps), result.settings
    if actions is None or settings is None or settings.get("layout", "single") != "single":
        return None
    spec = next((spec for spec in objects if spec.name == trial.object), None)
    return None if spec is None else Replay.of(result.env_id, settings, spec, trial, actions)


def shown(result: Evaluation, log: ActionLog, objects: ObjectSet, count: int) -> list[Replay]:
    """Return the first `count` trials of an evaluation as replays, in their order."""
    replays = (_replay(result, log, objects, trial) for trial in result.trials[:count])
    return [replay for replay in replays if replay is not None]


def failed(result: Evaluation, log: ActionLog, objects: ObjectSet, per_kind: int = PER_KIND) -> list[Replay]:
    """Return the first failures of each kind as replays, in the order of the trials.

    Objects are tried in turn: a second failure of an object comes after the first failures of the others.
    """
    times: Counter[tuple[str, str]] = Counter()
    turns = []
    for trial in result.trials:
        if not trial.success:
            turns.append((times[trial.failure, trial.object], trial))
            times[trial.failure, trial.object] += 1
    kept: dict[str, list[Replay]] = {}
    for _, trial in sorted(turns, key=lambda each: each[0]):
        replays = kept.setdefault(trial.failure, [])
        if len(replays) < per_kind and (replay := _replay(result, log, objects, trial)) is not None:
            replays.append(replay)
    return [replay for replays in kept.values() for replay in replays]
