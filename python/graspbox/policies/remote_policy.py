"""Policies on servers that speak openpi's protocol, for `graspbox evaluate ws://HOST:PORT`."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from graspbox import _core
from graspbox._common.arguments import shown
from graspbox.envs.remote_config import client_token
from graspbox.errors import ConfigError, ConnectionLostError
from graspbox.hands import load_hand
from graspbox.policies import Actions, Policy, Task
from graspbox.policies.base import cameras_of

__all__ = ["RemotePolicy"]

#: Most object sets from which a policy on a server learned, and longest name of one.
_MOST_SETS, _LONGEST = 1000, 1000


class RemotePolicy(Policy):
    """Queries a server for the actions of each environment, one connection per environment.

    A graspbox server also reports the policy's hand, the object sets from which it learned, whether it states a
    probability of success, and where it finds no grasp. Its policy knows the camera of its own environment, and no bin.

    Parameters
    ----------
    url : str
        ``ws://HOST:PORT`` or ``wss://HOST:PORT``.
    obs : str or sequence of str, optional
        Observations to send; by default ``observations`` of the server's metadata.
    keys : mapping of str to str, optional
        Names under which the server expects observations, by our names.
    chunk : int
        Actions executed per answer before the next query; an answer must have at least as many.
    actions : str
        Name of the actions in an answer.
    token : str, optional
        The server's token; by default the environment variable ``GRASPBOX_TOKEN``, else none.
    ca : path, optional
        Certificates to trust besides those of the public authorities, in PEM.
    extra : mapping, optional
        Entries sent with every observation, such as a prompt.

    Raises
    ------
    ConnectionLostError
        If the server cannot be reached.
    ConfigError
        If it refuses this client, is not a policy server, or the observations that it needs are unknown.
    """

    def __init__(
        self,
        url: str,
        *,
        obs: str | tuple[str, ...] | None = None,
        keys: Mapping[str, str] | None = None,
        chunk: int = 1,
        actions: str = "actions",
        token: str | None = None,
        ca: str | Path | None = None,
        extra: Mapping[str, Any] | None = None,
    ) -> None:
        self._url, self._token = url, client_token(None) if token is None else token
        self._ca = None if ca is None else str(ca)
        self._keys, self._chunk, self._name, self._extra = dict(keys or {}), chunk, actions, dict(extra or {})
        first = self._connect()
        self.metadata: Mapping[str, Any] = self._checked(first.metadata)
        self._ours = self.metadata.get("server") == "graspbox"
        named = self.metadata.get("observations")
        self.obs = obs or (tuple(named) if named else None)
        if self.obs is None:
            raise ConfigError(f"the server {url} does not name its observations; name them with obs (--obs)")
        self.name = str(self.metadata.get("policy") or url)
        self.env_id = self.metadata.get("environment")
        self.settings = dict(self.metadata.get("settings") or {}) if self._ours else {}
        self.learned_from = tuple(self.metadata.get("learned_from") or ()) if self._ours else ()
        self._hand = self.metadata.get("hand") if self._ours else None
        self._confident = self._ours and bool(self.metadata.get("confidence"))
        self._stated: list[float | None] = []
        self._nothing: list[bool] = []
        self._clients = [first]
        self._pending: list[list[NDArray[np.float32]]] = []
        self._starts: list[dict[str, Any]] = []
        self._active: NDArray[np.bool_] = np.zeros(0, dtype=np.bool_)

    def _connect(self) -> "_core.PolicyClient":
        return _core.PolicyClient(self._url, token=self._token, ca=self._ca)

    def _checked(self, metadata: Any) -> Mapping[str, Any]:
        """Refuse the first frame of any other server than a policy server."""
        if not isinstance(metadata, Mapping):
            raise ConfigError(f"the server {self._url} begins with {shown(metadata)}; a server of a policy sends a map")
        if metadata.get("protocol") == "graspbox":
            raise ConfigError(
                f"{self._url} is a server of environments; start one of a policy with 'graspbox serve-policy', or step "
                "the environments there with remote (--remote)"
            )
        named, settings = metadata.get("observations") or [], metadata.get("settings") or {}
        texts = isinstance(named, list) and all(isinstance(name, str) for name in named)
        env_id = metadata.get("environment")
        if not texts or not isinstance(env_id, str | None) or not isinstance(settings, Mapping):
            raise ConfigError(
                f"the server {self._url} names observations {shown(named)}, environment {shown(env_id)} and settings "
                f"{shown(settings)}; these are names, a name and a map"
            )
        if metadata.get("server") == "graspbox":
            self._check_ours(metadata)
        return metadata

    def _check_ours(self, metadata: Mapping[str, Any]) -> None:
        """Refuse entries of another kind that servers of graspbox send, and more of them than a policy has."""
        learned, hand, confident = (metadata.get(name) for name in ("learned_from", "hand", "confidence"))
        several = isinstance(learned, list | None) and all(isinstance(name, str) for name in learned or ())
        if not several or len(learned or ()) > _MOST_SETS or max(map(len, learned or ()), default=0) > _LONGEST:
            raise ConfigError(
                f"the server {self._url} names learned_from {shown(learned)}; this is a list of at most {_MOST_SETS} "
                f"names of object sets, of {_LONGEST} characters"
            )
        if not isinstance(hand, str | None) or len(hand or "") > _LONGEST:
            raise ConfigError(f"the server {self._url} names the hand {shown(hand)}; this is a name")
        if not isinstance(confident, bool | None):
            raise ConfigError(f"the server {self._url} has confidence {shown(confident)}; this is true or false")

    def _bind(self, task: Task) -> None:
        if self._ours:
            self._check_environments(task)
        if self._hand is not None and (hand := load_hand(task.hand).name) != self._hand:
            raise ConfigError(
                f"the policy {self.name!r} at {self._url} grasps with the hand {self._hand!r}, and these environments "
                f"have {hand!r}; set their hand: hand (--hand), by its name or its two files"
            )
        self._stated, self._nothing = [None] * task.num_envs, [False] * task.num_envs
        while len(self._clients) < task.num_envs:
            self._clients.append(self._connect())
        self._pending = [[] for _ in range(task.num_envs)]
        self._starts = [{} for _ in range(task.num_envs)]
        self._active = np.zeros(task.num_envs, dtype=np.bool_)

    def _check_environments(self, task: Task) -> None:
        """Refuse environments other than those to which the policy is bound on its server."""
        if self.env_id is not None and task.env_id != self.env_id:
            raise ConfigError(
                f"the server {self._url} takes observations of {self.env_id!r}, not of {task.env_id!r}; start it with "
                f"'graspbox serve-policy ... --env {task.env_id}'"
            )
        seen = "depth" in ((self.obs,) if isinstance(self.obs, str) else self.obs or ())
        if seen and task.cameras.cameras != cameras_of(self.settings).cameras:
            raise ConfigError(
                f"cameras is not that of the policy {self.name!r}, which on its server knows no other; leave out "
                "cameras (--camera, or the condition 'camera'), or load the policy on this machine"
            )

    def _begin(self, env: int, seed: int | None, info: dict[str, Any]) -> None:
        self._pending[env].clear()
        self._active[env], self._nothing[env] = True, False
        # Only graspbox servers have episodes.
        self._starts[env] = {"reset": True, "seed": seed} if self._ours else {}

    def act(self, observation: Any) -> Actions:
        """Execute the remaining actions; query the server where none are left."""
        actions = self._zeros()
        asked = [env for env in range(self.task.num_envs) if self._active[env] and not self._pending[env]]
        for env in asked:
            self._clients[env].send({**self._extra, **self._starts[env], **self._row(observation, env)})
            self._starts[env] = {}
        for env in asked:
            answer = self._clients[env].receive()
            self._pending[env] = self._chunk_of(answer)
            self._stated[env] = self._confidence_in(answer)
            self._nothing[env] = self._nothing_in(answer)
        for env in range(self.task.num_envs):
            if self._pending[env]:
                actions[env] = self._pending[env].pop(0)
        return actions

    def confidence(self, env: int) -> float | None:
        """Return the probability that the server states; None if it states none."""
        return self._stated[env]

    def found_nothing(self, env: int) -> bool:
        """Whether the server found no grasp when it was last asked; False if it does not state it."""
        return self._nothing[env]

    def _nothing_in(self, answer: Mapping[str, Any]) -> bool:
        nothing = answer.get("found_nothing", False) if self._ours else False
        if not isinstance(nothing, bool):
            raise ConfigError(f"the server {self._url} has found_nothing {shown(nothing)}; this is true or false")
        return nothing

    def _confidence_in(self, answer: Mapping[str, Any]) -> float | None:
        if not self._confident:
            return None
        stated = answer.get("confidence")
        number = isinstance(stated, int | float | np.integer | np.floating) and not isinstance(stated, bool)
        if not number or not 0.0 <= stated <= 1.0:  # type: ignore[operator]
            raise ConfigError(
                f"the server {self._url} states the confidence {shown(stated)}; a probability is needed, from 0 to 1"
            )
        return float(stated)  # type: ignore[arg-type]

    def _row(self, observation: Any, env: int) -> dict[str, Any]:
        if isinstance(observation, Mapping):
            row = {name: observation[name][env] for name in self.task.observation_space.spaces}  # type: ignore[attr-defined]
        else:
            name = self.task.obs if isinstance(self.task.obs, str) else self.task.obs[0]
            row = {name: observation[env]}
        return {self._keys.get(name, name): np.ascontiguousarray(value) for name, value in row.items()}

    def _chunk_of(self, answer: Any) -> list[NDArray[np.float32]]:
        """Take the actions to execute from an answer."""
        if isinstance(answer, str):
            # An openpi server sends a traceback, which ends with the error.
            last = (answer.strip() or "it does not name one").splitlines()[-1]
            raise ConfigError(f"the server {self._url} reports an error: {last}")
        if not isinstance(answer, Mapping) or self._name not in answer:
            raise ConnectionLostError(f"the server {self._url} answers {shown(answer)}; it must contain {self._name!r}")
        try:
            actions = np.asarray(answer[self._name], dtype=np.float32)
        except (TypeError, ValueError):
            received = shown(answer[self._name])
            raise ConfigError(
                f"the server {self._url} returns {self._name} as {received}; numbers are needed"
            ) from None
        size = self.task.action_space.shape
        if actions.shape == size:
            actions = actions[None]
        if actions.shape[1:] != size or len(actions) < self._chunk:
            raise ConfigError(
                f"the server {self._url} returns actions of shape {actions.shape}; {self._chunk} of shape {size} are "
                "needed"
            )
        return list(actions[: self._chunk])
