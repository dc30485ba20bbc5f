"""Environments spread over several servers, stepped at once, with the methods of one pool.

Seeds, masks and options are split by environment, so that results are those of one pool. A server that is lost for good
is replaced where the config says so: `Shard` saves states and remembers what was asked since.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from graspbox import _core
from graspbox.envs.remote_config import RemoteConfig
from graspbox.envs.remote_pool import Cameras, RemotePool, Stepped, now_of, reset_fields, stepped_of
from graspbox.errors import ConfigError, ConnectionLostError, GraspboxError

__all__ = ["SpreadPool"]


@dataclass
class Shard:
    """The environments of one server: `first` to `last`, the last one excluded."""

    remote: RemoteConfig
    request: dict[str, Any]
    first: int
    last: int
    pool: RemotePool
    #: Saved states, and the commands since then.
    states: list[bytes | None] = field(default_factory=list)
    log: list[tuple[str, dict[str, Any]]] = field(default_factory=list)

    @property
    def envs(self) -> range:
        """Its environments."""
        return range(self.first, self.last)

    @property
    def restores(self) -> bool:
        """Whether another server takes its place."""
        return self.remote.reconnect == "restore"

    def named(self, error: ConnectionLostError) -> ConnectionLostError:
        """Name its environments in an error."""
        return ConnectionLostError(f"{error}; environments {self.first} to {self.last - 1} are on it")

    def begin(self, command: str, fields: dict[str, Any]) -> int | None:
        """Send a command; None if the server is gone, which `end` finds out too."""
        try:
            return self.pool.begin(command, fields)
        except ConnectionLostError as error:
            if not self.restores:
                raise self.named(error) from None
            return None

    def end(self, number: int | None, command: str, fields: dict[str, Any]) -> dict[str, Any]:
        """Wait for the answer to a command."""
        try:
            if number is None:
                raise ConnectionLostError(f"the server {self.pool.url} cannot be reached")
            answer = self.pool.end(number)
        except ConnectionLostError as error:
            if not self.restores:
                raise self.named(error) from None
            answer = self._restore(error, command, fields)
        if self.restores and command in ("reset", "step", "set_state"):
            self.log.append((command, fields))
            if len(self.log) >= self.remote.checkpoint or not self.states:
                self._checkpoint()
        return answer

    def call(self, command: str, fields: dict[str, Any]) -> dict[str, Any]:
        """Send a command and wait for its answer."""
        return self.end(self.begin(command, fields), command, fields)

    def _checkpoint(self) -> None:
        """Save the states of all environments; where that fails, the log goes on."""
        try:
            numbers = [self.pool.begin("get_state", {"env_id": env}) for env in range(self.last - self.first)]
            self.states = [self.pool.end(number)["state"] for number in numbers]
        except ConnectionLostError:
            return
        except ConfigError:  # not all of them have begun
            return
        self.log.clear()

    def _restore(self, error: ConnectionLostError, command: str, fields: dict[str, Any]) -> dict[str, Any]:
        """Make the environments on another server, repeat what was asked since the saved states, and the command."""
        lost = self.pool.url
        for url in [other for other in self.remote.urls if other != lost] + [lost]:
            try:
                self.pool = RemotePool(url, self.remote, self.request)
                for env, state in enumerate(self.states):
                    self.pool.call("set_state", {"env_id": env, "state": state})
                for name, asked in self.log:
                    self.pool.call(name, asked)
                return self.pool.call(command, fields)
            except ConnectionLostError:
                continue
        raise self.named(error) from None


class SpreadPool:
    """Environments on several servers; methods as `graspbox._core.EnvPool`.

    Parameters
    ----------
    remote : RemoteConfig
        The servers. Environments are dealt out in equal parts, in order.
    request : dict
        Environment id, number, objects and keywords.

    Raises
    ------
    ConnectionLostError
        If a server cannot be reached; the message names the environments.
    """

    def __init__(self, remote: RemoteConfig, request: dict[str, Any]) -> None:
        self.num_envs = int(request["num_envs"])
        count = min(len(remote.urls), self.num_envs)
        ends = [round(self.num_envs * i / count) for i in range(count + 1)]
        self._shards: list[Shard] = []
        for url, first, last in zip(remote.urls, ends, ends[1:], strict=False):
            own = {**request, "num_envs": last - first, "first_env": first}
            shard_config = replace(remote, urls=remote.urls)
            try:
                pool = RemotePool(url, remote, own)
            except ConnectionLostError as error:
                raise ConnectionLostError(f"{error}; environments {first} to {last - 1} are to be on it") from None
            self._shards.append(Shard(shard_config, own, first, last, pool))
        self.description = self._shards[0].pool.description
        self._over = np.zeros(self.num_envs, dtype=np.bool_)
        self._disabled = self.description["autoreset"] == "disabled"
        #: Environments that were sent, with the command that waits for the next of each shard.
        self._away: set[int] = set()
        self._waiting: dict[int, int] = {}
        self._arrived: list[tuple[int, Stepped]] = []

    def _each(self, asked: Sequence[tuple[Shard, str, dict[str, Any]]]) -> list[dict[str, Any]]:
        """Send a command to several shards, and wait for all answers; the first error is raised at the end."""
        numbers = [shard.begin(command, fields) for shard, command, fields in asked]
        answers: list[dict[str, Any]] = []
        failed: GraspboxError | None = None
        for number, (shard, command, fields) in zip(numbers, asked, strict=True):
            try:
                answers.append(shard.end(number, command, fields))
            except GraspboxError as error:
                failed = failed or error
        if failed is not None:
            raise failed
        return answers

    def reset(
        self,
        seeds: Sequence[int | None] | None,
        mask: NDArray[np.bool_] | None,
        options: Sequence[str],
        out: dict[str, Any] | None,
    ) -> "_core.EnvArrays":
        """Begin episodes, as `graspbox._core.EnvPool.reset`; options are JSON."""
        self._check_here(range(self.num_envs))
        asked = []
        for shard in self._shards:
            own = slice(shard.first, shard.last)
            fields = reset_fields(
                None if seeds is None else seeds[own],
                None if mask is None else np.ascontiguousarray(mask[own]),
                options if len(options) == 1 else options[own],
            )
            asked.append((shard, "reset", fields))
        answers = self._each(asked)
        self._over &= False if mask is None else ~mask
        return self._joined([now_of(answer, None) for answer in answers], self._shards, out)

    def step(self, actions: NDArray[np.float32], out: dict[str, Any] | None) -> Stepped:
        """Step all environments, as `graspbox._core.EnvPool.step`."""
        self._check_here(range(self.num_envs))
        if self._disabled and self._over.any():
            env = int(np.flatnonzero(self._over)[0])
            raise ConfigError(f"the episode of environment {env} is over; reset the environment before the next step")
        asked = [(shard, "step", {"actions": actions[shard.first : shard.last]}) for shard in self._shards]
        # A server that refuses its actions must do so before others have moved anything.
        doubtful = [bool(~np.isfinite(fields["actions"]).all()) for _, _, fields in asked]
        answers: dict[int, dict[str, Any]] = {}
        for wanted in (True, False):
            chosen = [i for i, doubt in enumerate(doubtful) if doubt == wanted]
            answers |= dict(zip(chosen, self._each([asked[i] for i in chosen]), strict=True))
        found = [stepped_of(answers[i], None) for i in range(len(asked))]
        return self._stepped(found, self._shards, out)

    def send(self, actions: NDArray[np.float32], envs: Sequence[int]) -> None:
        """Step environments in the background, as `graspbox._core.EnvPool.send`."""
        self._check_here(envs)
        given = np.asarray(envs)
        asked = []
        for shard in self._shards:
            rows = np.flatnonzero((given >= shard.first) & (given < shard.last))
            if len(rows):
                fields = {
                    "actions": np.ascontiguousarray(actions[rows]),
                    "env_ids": (given[rows] - shard.first).tolist(),
                }
                asked.append((shard, "send", fields))
        self._each(asked)
        self._away |= {int(env) for env in envs}

    def recv(self, count: int) -> Stepped:
        """Receive environments that were sent, as `graspbox._core.EnvPool.recv`."""
        if count == 0 or count > len(self._away):
            raise ConfigError(f"count is {count}; {len(self._away)} environments are on their way")
        while len(self._arrived) < count:
            self._gather()
        taken, self._arrived = self._arrived[:count], self._arrived[count:]
        shards = [self._shards[index] for index, _ in taken]
        found = self._stepped([stepped for _, stepped in taken], shards, None)
        self._away -= {int(env) for env in found[0]["env"]}
        return found

    def _gather(self) -> None:
        """Wait a moment for the next environment of any server."""
        here = {int(stepped[0]["env"][0]) + self._shards[index].first for index, stepped in self._arrived}
        for index, shard in enumerate(self._shards):
            away = sum(env in self._away and env not in here for env in shard.envs)
            if away and index not in self._waiting:
                self._waiting[index] = shard.pool.begin("recv", {"count": 1})
        for index in list(self._waiting):
            answer = self._shards[index].pool.poll(self._waiting[index])
            if answer is not None:
                del self._waiting[index]
                self._arrived.append((index, stepped_of(answer, None)))

    def get_state(self, env: int) -> bytes:
        """Return all that the future of an environment depends on."""
        shard = self._shard_of(env)
        found: bytes = shard.call("get_state", {"env_id": env - shard.first})["state"]
        return found

    def set_state(self, env: int, state: bytes) -> "_core.EnvArrays":
        """Restore a state; arrays of that environment alone."""
        shard = self._shard_of(env)
        found = now_of(shard.call("set_state", {"env_id": env - shard.first, "state": state}), None)
        self._over[env] = bool(found["terminated"][0] or found["truncated"][0])
        return found

    def pictures(self, envs: Sequence[int]) -> NDArray[np.uint8]:
        """Take pictures of some environments, (n, H, W, 3)."""
        frames = []
        for env in envs:
            shard = self._shard_of(env)
            frames.append(shard.call("render", {"env_ids": [env - shard.first]})["frames"])
        return np.concatenate(frames)

    def cameras(self) -> Cameras:
        """Intrinsics (3, 3) and world_from_camera (num_envs, 4, 4) of every camera as it stands, by name."""
        found = [shard.call("cameras", {})["cameras"] for shard in self._shards]
        return {
            name: (one["intrinsics"], np.concatenate([other[name]["world_from_camera"] for other in found]))
            for name, one in found[0].items()
        }

    def prepare(self, progress: bool, delay: float, skip_errors: bool) -> None:
        """Prepare all objects on every server."""
        try:
            self._each([(shard, "prepare", {}) for shard in self._shards])
        except ConnectionLostError:
            raise
        except GraspboxError:
            if not skip_errors:
                raise

    def names(self) -> list[str]:
        """Names of the objects, in order."""
        return self._shards[0].pool.names()

    def close(self) -> None:
        """End all sessions."""
        for shard in self._shards:
            shard.pool.close()

    def _shard_of(self, env: int) -> Shard:
        for shard in self._shards:
            if env in shard.envs:
                self._check_here([env])
                return shard
        raise ConfigError(f"there is no environment {env}: there are {self.num_envs}, counted from 0")

    def _check_here(self, envs: Sequence[int]) -> None:
        seen: set[int] = set()
        for env in envs:
            if env in self._away or env in seen:
                raise ConfigError(f"environment {env} is still stepping; receive its result first")
            seen.add(env)

    def _stepped(self, found: Sequence[Stepped], shards: Sequence[Shard], out: dict[str, Any] | None) -> Stepped:
        """Put together the steps of several shards."""
        now = self._joined([one for one, _ in found], shards, out)
        ended = [(last, shard) for (_, last), shard in zip(found, shards, strict=True) if last is not None]
        self._over[now["env"]] = now["terminated"] | now["truncated"]
        if not ended:
            return now, None
        return now, self._joined([last for last, _ in ended], [shard for _, shard in ended], None)

    def _joined(
        self, found: Sequence["_core.EnvArrays"], shards: Sequence[Shard], out: dict[str, Any] | None
    ) -> "_core.EnvArrays":
        """Put rows of several shards together; their environments get their numbers here."""
        for arrays, shard in zip(found, shards, strict=True):
            arrays["env"] = arrays["env"] + shard.first
        joined: _core.EnvArrays = _concatenated(found, out or {})
        return joined


def _concatenated(found: Sequence[Any], out: dict[str, Any]) -> Any:
    join: Callable[[str], Any] = lambda name: [one[name] for one in found]  # noqa: E731
    return {
        name: _concatenated(join(name), {})
        if isinstance(values, dict)
        else np.concatenate(join(name), out=out.get(name))
        for name, values in found[0].items()
    }
