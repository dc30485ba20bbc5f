"""A server of a policy, for clients of openpi's protocol and for plain HTTP.

What a client gets depends on what it sends. ``depth`` with ``intrinsics`` is a request for grasps
(`graspbox.remote.grasp_requests`). Observations of an environment are answered with ``actions``; each connection has a
policy of its own then, bound to one environment, and ``{"reset": True}`` beside the observations begins an episode.
"""

import json
import threading
import time
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np

from graspbox import _core, policies
from graspbox._common.arguments import plain, shown
from graspbox.envs import IDS
from graspbox.envs.settings import Settings, keywords
from graspbox.errors import ConfigError, GraspboxError
from graspbox.policies import DepthGrasp, Policy, Task
from graspbox.policies.grasp_image import ImageGrasper
from graspbox.remote import grasp_requests
from graspbox.remote.running import PAUSE, RunningServer
from graspbox.remote.settings import PolicyServerSettings

__all__ = ["PolicyServer", "PolicyServerSettings"]

#: Entries that say how an observation is meant.
_CONTROL = ("reset", "seed")


class PolicyServer(RunningServer):
    """A server that runs: clients get decisions of a policy until it is stopped.

    Parameters
    ----------
    policy : str or Path
        A name that `graspbox.policies.load` takes: a folder, or a baseline that needs no mesh.
    settings : PolicyServerSettings, optional
        Address and bounds.

    Raises
    ------
    ConfigError, FileError, MissingExtraError
        If the policy cannot be loaded, or a setting is wrong.
    """

    def __init__(self, policy: str | Path, settings: PolicyServerSettings | None = None) -> None:
        settings = settings or PolicyServerSettings()
        settings.check()
        self._policy = str(policy)
        prototype = policies.load(self._policy)
        if prototype.obs is not None and "state" in _names(prototype):
            raise ConfigError(f"the policy {prototype.name!r} reads the state, which no camera gives")
        self._env_id = settings.env_id or prototype.env_id or IDS[0]
        if self._env_id not in IDS:
            raise ConfigError(f"there is no environment {self._env_id!r}; choose from {', '.join(IDS)}")
        # Policies that derive from it decide otherwise than in one image, or have no scorer.
        decides = type(prototype) is DepthGrasp
        self._grasper = ImageGrasper(self._policy) if decides else None
        metadata = {
            "server": "graspbox",
            "version": _core.__version__,
            "policy": prototype.name,
            "environment": self._env_id,
            "observations": _names(prototype) or [keywords(Settings)["obs"].default],
            "settings": plain(dict(prototype.settings), "settings"),
            "grasps": self._grasper is not None,
            "requests": list(grasp_requests.ENTRIES) if self._grasper else [],
        }
        self._core = _core.PolicyServer(settings.to_json(), json.dumps(metadata))
        super().__init__(self._core, settings.tls_cert is not None, settings.num_threads)
        self._actors: dict[int, _Actor] = {}
        self._lock = threading.Lock()

    def _answer_next(self) -> None:
        for job in self._core.next_jobs(1, PAUSE):
            started = time.perf_counter()
            self._answer(job)
            self._core.decided(time.perf_counter() - started)
        for number in self._core.gone():
            with self._lock:
                self._actors.pop(number, None)

    def _answer(self, job: "_core.PolicyJob") -> None:
        waited, started = job.age, time.perf_counter()
        try:
            request = grasp_requests.from_json(job.body()) if job.json else job.observation()
            answer = self._decided(request, job)
            timing = {"infer_ms": 1e3 * (time.perf_counter() - started), "wait_ms": 1e3 * waited}
            answer["server_timing"] = timing
            if job.json:
                job.answer_json(grasp_requests.to_json(answer))
            else:
                job.answer(answer)
        except GraspboxError as error:
            job.refuse(type(error).__name__, "", str(error))
        except BaseException as error:  # a panic of the core is no Exception, and would end this thread
            job.refuse("InternalError", "", f"the decision failed, please report it: {type(error).__name__}: {error}")

    def _decided(self, request: Any, job: "_core.PolicyJob") -> dict[str, Any]:
        if not isinstance(request, dict):
            raise ConfigError(f"the request is {shown(request)}; send a map of observations")
        if "intrinsics" in request or job.json:
            if self._grasper is None:
                raise ConfigError("this policy finds no grasps in images of your own; send observations")
            return grasp_requests.decide(self._grasper, request)
        return self._actor(job.connection).act(request)

    def _actor(self, connection: int) -> "_Actor":
        with self._lock:
            if connection not in self._actors:
                self._actors[connection] = _Actor(policies.load(self._policy), self._env_id)
            return self._actors[connection]


def _names(policy: Policy) -> list[str]:
    """Names of the observations that a policy needs."""
    return [policy.obs] if isinstance(policy.obs, str) else list(policy.obs or ())


class _Actor:
    """A policy that acts for one connection."""

    def __init__(self, policy: Policy, env_id: str) -> None:
        settings = {**policy.settings, **({} if policy.obs is None else {"obs": policy.obs})}
        # Made for its spaces alone.
        env = gymnasium.make_vec(env_id, 1, objects="procedural:can:0", **settings)
        policy.bind(Task.of(env))
        self._policy, self._space = policy, env.unwrapped.single_observation_space
        env.close()
        self._begun = False

    def act(self, request: dict[str, Any]) -> dict[str, Any]:
        """Choose the next action."""
        control = {name: request.pop(name) for name in _CONTROL if name in request}
        rows = self._rows(request)
        if control.get("reset") or not self._begun:
            seed = control.get("seed")
            self._policy.reset([seed if seed is None else int(seed)])
            self._begun = True
        actions = self._policy.act(rows)
        confidence = self._policy.confidence(0)
        return {"actions": actions, **({} if confidence is None else {"confidence": confidence})}

    def _rows(self, request: dict[str, Any]) -> Any:
        """Observations of one environment as rows, checked against their space."""
        spaces = getattr(self._space, "spaces", None)
        if spaces is None:
            name = next(iter(request)) if len(request) == 1 else "observation"
            return self._row(name, request.get(name), self._space)
        unknown = [name for name in request if name not in spaces]
        if unknown:
            raise ConfigError(f"there is no observation {unknown[0]!r} here; this policy observes {', '.join(spaces)}")
        return {name: self._row(name, request.get(name), space) for name, space in spaces.items()}

    def _row(self, name: str, value: Any, space: Any) -> Any:
        found = None if value is None else np.asarray(value)
        if found is not None and found.shape == (1, *space.shape):
            found = found[0]
        if found is None or found.shape != space.shape or found.dtype.kind not in "biuf":
            given = "missing" if found is None else f"{found.dtype} of shape {found.shape}"
            raise ConfigError(f"the observation {name!r} is {given}; give {space.dtype} of shape {space.shape}")
        return np.ascontiguousarray(found, dtype=space.dtype)[None]
