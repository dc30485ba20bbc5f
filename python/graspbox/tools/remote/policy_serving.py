"""Policy server, for clients of openpi's protocol and for plain HTTP.

The request determines the answer. ``depth`` with ``intrinsics`` is a request for grasps
(`graspbox.tools.remote.grasp_requests`). Observations of an environment are answered with ``actions``; each
connection then has its own policy, bound to one environment, and ``{"reset": True}`` with the observations begins an
episode. These policies share their networks.
"""

import threading
import time
from copy import deepcopy
from dataclasses import replace
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np

from graspbox import _core, policies
from graspbox._common.arguments import about, natural, plain, shown
from graspbox.envs import GOAL_IDS, IDS
from graspbox.envs.settings import EnvironmentConfig
from graspbox.errors import ConfigError, GraspboxError
from graspbox.hands import Hand, HandLike, load_hand
from graspbox.policies import DepthGrasp, Policy, Task
from graspbox.policies.grasp_image import ImageGrasper
from graspbox.policies.published.downloads import folder_of
from graspbox.tools.remote import grasp_requests
from graspbox.tools.remote.running import PAUSE, RunningServer
from graspbox.tools.remote.sent_arrays import sent_array
from graspbox.tools.remote.settings import PolicyServerSettings

__all__ = ["PolicyServer", "PolicyServerSettings"]

#: Entries other than observations.
_CONTROL = ("reset", "seed")
#: Longest error message sent to a client, characters.
_MAX_SENTENCE = 4096


class PolicyServer(RunningServer):
    """A running server: clients get decisions of a policy until it is stopped.

    Parameters
    ----------
    policy : str or Path
        As of `graspbox.policies.load`, except for baselines that need a mesh.
    hand : str, Hand or pair of paths, optional
        As of `graspbox.load_hand`, for a policy that grasps with any hand; by default the policy's own.

    Raises
    ------
    ConfigError, FileError, MissingExtraError
        If the policy cannot be loaded or is of another hand, or a setting is wrong.
    """

    def __init__(
        self, policy: str | Path, settings: PolicyServerSettings | None = None, *, hand: HandLike | None = None
    ) -> None:
        settings = settings or PolicyServerSettings()
        settings.check()
        self._policy = str(policy)
        prototype = policies.load(self._policy)
        if prototype.obs is not None and "state" in _names(prototype):
            raise ConfigError(f"the policy {prototype.name!r} reads the state, which no camera measures")
        self._env_id = settings.env_id or prototype.env_id or IDS[0]
        if self._env_id in GOAL_IDS:
            raise ConfigError(f"the policy {prototype.name!r} acts in the goal task {self._env_id!r}; none is served")
        if self._env_id not in IDS:
            raise ConfigError(f"there is no environment {self._env_id!r}; choose from {', '.join(IDS)}")
        # Subclasses do not decide on one image, or have no scorer.
        decides = type(prototype) is DepthGrasp
        self._grasper = ImageGrasper(self._policy, hand=hand) if decides else None
        self._name, self._folders = prototype.name, _folders(self._policy)
        own = prototype.settings_in(self._env_id) | ({} if hand is None else {"hand": hand})
        self._actors: _Actors | GraspboxError = self._made_of(prototype, own)
        metadata = self._described(prototype, own)
        self._core = _core.PolicyListener(settings.core_fields(), metadata)
        super().__init__(self._core, settings.tls_cert is not None, settings.num_threads)

    @property
    def finds_grasps(self) -> bool:
        """Whether it answers requests for grasps, and POST."""
        return self._grasper is not None

    def _made_of(self, prototype: Policy, own: dict[str, Any]) -> "_Actors | GraspboxError":
        """Make the actors; return the error if the policy does not act but finds grasps in images."""
        try:
            return _Actors(prototype, self._env_id, own)
        except GraspboxError as error:
            if self._grasper is None:
                raise
            return error

    def _described(self, prototype: Policy, own: dict[str, Any]) -> dict[str, Any]:
        """Describe the policy to a client, which has the shipped hands, but no file of this machine."""
        known = {name: value for name, value in own.items() if name != "hand" or value in Hand.names()}
        hand, confident = None if self._grasper is None else self._grasper.hand.name, False
        if isinstance(self._actors, _Actors):
            hand, confident = self._actors.hand, self._actors.confident
        return {
            "server": "graspbox",
            "version": _core.__version__,
            "policy": prototype.name,
            "environment": self._env_id,
            "observations": _names(prototype) or [EnvironmentConfig.obs],
            "settings": plain(known, "settings"),
            "hand": hand,
            "learned_from": list(prototype.learned_from),
            "confidence": confident,
            "grasps": self.finds_grasps,
            "requests": list(grasp_requests.ENTRIES) if self.finds_grasps else [],
        }

    def _answer_next(self) -> None:
        for job in self._core.next_jobs(1, PAUSE):
            started = time.perf_counter()
            self._answer(job)
            self._core.decided(time.perf_counter() - started)
        for number in self._core.gone():
            if isinstance(self._actors, _Actors):
                self._actors.forget(number)

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
            job.refuse(type(error).__name__, error.field, self._sanitized(error))
        except BaseException as error:  # a panic of the core is not an Exception, and would end this thread
            text = f"the decision failed, please report it: {type(error).__name__}: {self._sanitized(error)}"
            job.refuse("InternalError", "", text)

    def _sanitized(self, error: BaseException | str) -> str:
        """Replace the policy's folder by its name, since clients should not learn local paths."""
        text = str(error)
        for folder in self._folders:
            text = text.replace(f"{folder}/", f"{self._name}/")
        return text[:_MAX_SENTENCE]

    def _decided(self, request: Any, job: "_core.PolicyJob") -> dict[str, Any]:
        if not isinstance(request, dict):
            raise ConfigError(f"the request is {shown(request)}; send a map of observations")
        if "intrinsics" in request or job.json:
            if self._grasper is None:
                raise ConfigError("this policy finds no grasps in your own images; send observations")
            answer = grasp_requests.decide(self._grasper, request)
            for one in answer.get("images", [answer]):
                for thing in one.get("things", ()):
                    if "refused" in thing:
                        thing["refused"] = self._sanitized(thing["refused"])
            return answer
        if isinstance(self._actors, GraspboxError):
            raise ConfigError(f"this policy finds grasps in images, but does not act: {self._actors}")
        return self._actors.of(job.connection).act(request)


def _folders(policy: str) -> list[str]:
    """Spellings of a policy's folder that may occur in errors."""
    if policy in policies.names():
        return []
    folder = folder_of(policy)
    return [str(path) for path in dict.fromkeys((folder.resolve(), folder, Path(policy)))]


def _names(policy: Policy) -> list[str]:
    return [policy.obs] if isinstance(policy.obs, str) else list(policy.obs or ())


class _Actors:
    """The policies that act, one for each connection; they share networks, which are loaded now."""

    def __init__(self, policy: Policy, env_id: str, settings: dict[str, Any]) -> None:
        settings = {**settings, **({} if policy.obs is None else {"obs": policy.obs})}
        # Made only for its spaces.
        env = gymnasium.make_vec(env_id, 1, objects="procedural:can:0", **settings)
        # Its observations come from clients.
        self._task = replace(Task.of(env), scenes=None)
        env.close()
        self._policy, self._lock = policy, threading.Lock()
        self._actors: dict[int, _Actor] = {}
        first = self._new()
        self.hand = load_hand(self._task.hand).name
        self.confident = first.confidence(0) is not None

    def _new(self) -> Policy:
        # The original is never bound, so copies share no state.
        policy = deepcopy(self._policy)
        policy.bind(self._task)
        return policy

    def of(self, connection: int) -> "_Actor":
        """Return the policy of a connection, which requests one action at a time."""
        with self._lock:
            actor = self._actors.get(connection)
        if actor is None:
            actor = _Actor(self._new(), self._task.observation_space)
            with self._lock:
                self._actors[connection] = actor
        return actor

    def forget(self, connection: int) -> None:
        """Drop the policy of an ended connection."""
        with self._lock:
            self._actors.pop(connection, None)


class _Actor:
    """A policy that acts for one connection."""

    def __init__(self, policy: Policy, space: Any) -> None:
        self._policy, self._space = policy, space
        self._begun = False

    def act(self, request: dict[str, Any]) -> dict[str, Any]:
        """Choose the next action."""
        control = {name: request.pop(name) for name in _CONTROL if name in request}
        begins, seed = control.get("reset"), control.get("seed")
        with about("reset"):
            if not isinstance(begins, bool | np.bool_ | None):
                raise ConfigError(f"reset is {shown(begins)}; give True or False")
        with about("seed"):
            seed = None if seed is None else natural(seed, "seed", bits=64)
        rows = self._rows(request)
        if begins or not self._begun:
            self._policy.reset([seed])
            self._begun = True
        actions = self._policy.act(rows)
        confidence, nothing = self._policy.confidence(0), self._policy.found_nothing(0)
        stated = {} if confidence is None else {"confidence": confidence}
        return {"actions": actions, **stated, **({"found_nothing": True} if nothing else {})}

    def _rows(self, request: dict[str, Any]) -> Any:
        """Observations of one environment as rows, checked against their space."""
        spaces = getattr(self._space, "spaces", None)
        if spaces is None:
            name = next(iter(request)) if len(request) == 1 else "observation"
            return _row(str(name), request.get(name), self._space)
        for name in request:
            if name not in spaces:
                known = ", ".join(spaces)
                with about(str(name)):
                    raise ConfigError(f"there is no observation {name!r} here; this policy observes {known}")
        return {name: _row(name, request.get(name), space) for name, space in spaces.items()}


def _row(name: str, value: Any, space: Any) -> Any:
    """Convert an observation of one environment to a row."""
    with about(name):
        wanted = f"give {space.dtype} of shape {space.shape}"
        said, deepest = f"the observation {name!r}", len(space.shape) + 1
        array = None if value is None else sent_array(value, said, wanted, deepest=deepest)
        if array is not None and array.shape == (1, *space.shape):
            array = array[0]
        if array is None or array.shape != space.shape or array.dtype.kind not in "biuf":
            received = "missing" if array is None else f"{array.dtype} of shape {array.shape}"
            raise ConfigError(f"{said} is {received}; {wanted}")
        with np.errstate(all="ignore"):
            row = np.ascontiguousarray(array, dtype=space.dtype)[None]
        # Overflow of the space's type, and values that an integer type cannot represent.
        if not (np.isfinite(row).all() and (array.dtype == row.dtype or np.isfinite(array).all())):
            raise ConfigError(f"{said} holds numbers that are not finite; give finite {space.dtype}")
        return row
