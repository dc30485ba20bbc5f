"""A server of a policy, for clients of openpi's protocol and for plain HTTP.

What a client gets depends on what it sends. ``depth`` with ``intrinsics`` is a request for grasps
(`graspbox.remote.grasp_requests`). Observations of an environment are answered with ``actions``; each connection has a
policy of its own then, bound to one environment, and ``{"reset": True}`` beside the observations begins an episode.
"""

import json
import threading
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np

from graspbox import _core, policies
from graspbox.arguments import plain, shown
from graspbox.envs import IDS
from graspbox.errors import ConfigError, GraspboxError
from graspbox.perception.grasp_image import ImageGrasper
from graspbox.perception.policy_folders import CONFIG, KIND, read_kind
from graspbox.policies import Policy, Task
from graspbox.remote import grasp_requests
from graspbox.remote.serving import check_exposure

__all__ = ["PolicyServer", "PolicyServerSettings"]

#: Entries that say how an observation is meant.
_CONTROL = ("reset", "seed")
_PATIENCE = 0.5


@dataclass(frozen=True)
class PolicyServerSettings:
    """Settings of a server of a policy; fields as of `graspbox.remote.serving.ServerSettings`.

    Attributes
    ----------
    env_id : str, optional
        The environment whose observations clients send; by default the policy's own, else ``graspbox/GraspPose-v0``.
    threads : int
        Decisions that are made at once.
    """

    host: str = "127.0.0.1"
    port: int = 8000
    token: str | None = None
    tls_cert: str | None = None
    tls_key: str | None = None
    origins: tuple[str, ...] = ()
    insecure: bool = False
    max_sessions: int = 64
    max_message: int = 64 << 20
    env_id: str | None = None
    threads: int = 2


class PolicyServer:
    """A server that runs: clients get decisions of a policy until it is stopped.

    Parameters
    ----------
    policy : str or Path
        A name that `graspbox.policies.load` takes: a folder, or a baseline that needs no mesh.
    settings : PolicyServerSettings
        Address and bounds.

    Raises
    ------
    ConfigError, FileError, MissingExtraError
        If the policy cannot be loaded, or a setting is wrong.
    """

    def __init__(self, policy: str | Path, settings: PolicyServerSettings = PolicyServerSettings()) -> None:
        check_exposure(settings.host, settings.token, settings.tls_cert, settings.insecure)
        self._policy, self._settings = str(policy), settings
        prototype = policies.load(self._policy)
        if prototype.obs is not None and "state" in _names(prototype):
            raise ConfigError(f"the policy {prototype.name!r} reads the state, which no camera gives")
        self._env_id = settings.env_id or prototype.env_id or IDS[0]
        if self._env_id not in IDS:
            raise ConfigError(f"there is no environment {self._env_id!r}; choose from {', '.join(IDS)}")
        folder = Path(self._policy)
        decides = (folder / CONFIG).is_file() and read_kind(folder) == KIND and not (folder / "feel.json").is_file()
        self._grasper = ImageGrasper(folder) if decides else None
        own = ("host", "port", "token", "tls_cert", "tls_key", "max_sessions", "max_message")
        config = {name: getattr(settings, name) for name in own} | {"origins": list(settings.origins)}
        metadata = {
            "server": "graspbox",
            "version": _core.__version__,
            "policy": prototype.name,
            "environment": self._env_id,
            "observations": _names(prototype),
            "settings": plain(dict(prototype.settings), "settings"),
            "grasps": self._grasper is not None,
            "requests": list(grasp_requests.ENTRIES) if self._grasper else [],
        }
        self._core = _core.PolicyServer(json.dumps(plain(config, "settings")), json.dumps(metadata))
        self._actors: dict[int, _Actor] = {}
        self._lock = threading.Lock()
        self._ended = threading.Event()
        self._workers: list[threading.Thread] = []

    @property
    def url(self) -> str:
        """The address for clients."""
        host, port = self._core.address
        scheme = "ws" if self._settings.tls_cert is None else "wss"
        return f"{scheme}://{f'[{host}]' if ':' in host else host}:{port}"

    def metrics(self) -> str:
        """Return the counters, in the text format of OpenMetrics."""
        return self._core.metrics()

    def start(self) -> "PolicyServer":
        """Decide in threads of their own."""
        for index in range(self._settings.threads):
            worker = threading.Thread(target=self._work, name=f"graspbox-decide-{index}", daemon=True)
            worker.start()
            self._workers.append(worker)
        return self

    def wait(self) -> None:
        """Wait until `drain` or `stop` is called, from a signal handler or another thread."""
        while not self._ended.wait(_PATIENCE):
            pass

    def drain(self) -> None:
        """Let no client in any more, and end `wait`."""
        self._core.drain()
        self._ended.set()

    def stop(self, patient: bool = True) -> None:
        """End all connections; requests that came are answered first, within 10 s, unless `patient` is false."""
        self._core.drain()
        self._core.stop(patient)
        self._ended.set()
        for worker in self._workers:
            worker.join()

    def __enter__(self) -> "PolicyServer":
        return self.start()

    def __exit__(self, *_: object) -> None:
        self.stop()

    def _work(self) -> None:
        while not self._ended.is_set():
            for job in self._core.next_jobs(1, _PATIENCE):
                started = time.perf_counter()
                self._answer(job)
                self._core.decided(1, time.perf_counter() - started)
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
            job.refuse(type(error).__name__, str(error))
        except BaseException as error:  # a panic of the core is no Exception, and would end this thread
            job.refuse("InternalError", f"the decision failed, please report it: {type(error).__name__}: {error}")

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
