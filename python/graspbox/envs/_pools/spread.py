"""Environments spread over several servers, stepped in parallel, with the methods of one pool.

Seeds, masks and options are split by environment, so that results are those of one pool. Arguments that a local pool
refuses are refused here, before any server steps an environment.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from graspbox import _core
from graspbox.envs._pools.local import Buffers, Cameras, Mask, Options, Seeds, Stepped
from graspbox.envs._pools.remote import now_of, reset_fields, stepped_of
from graspbox.envs._pools.shard import CHANGES, PoolShard
from graspbox.envs.remote_config import RemoteConfig
from graspbox.errors import ConfigError, ConnectionLostError, GraspboxError

__all__ = ["SpreadPool"]


class SpreadPool:
    """Environments on several servers, divided equally and in order; methods and `request` as of `RemotePool`."""

    def __init__(self, remote: RemoteConfig, request: dict[str, Any]) -> None:
        self.num_envs = int(request["num_envs"])
        count = max(1, min(len(remote.urls), self.num_envs))
        ends = [round(self.num_envs * i / count) for i in range(count + 1)]
        self._shards: list[PoolShard] = []
        try:
            for url, first, last in zip(remote.urls, ends, ends[1:], strict=False):
                own = {**request, "num_envs": last - first, "first_env": first}
                self._shards.append(PoolShard(url, remote, own))
        except BaseException:
            self.close()
            raise
        self.description = self._shards[0].description
        self._begun, self._over = (np.zeros(self.num_envs, dtype=np.bool_) for _ in range(2))
        self._autoreset = self.description["autoreset"]
        #: Environments sent and not received, and those of them whose step has ended.
        self._away: set[int] = set()
        self._arrived: list[tuple[PoolShard, Stepped]] = []

    def _each(self, commands: Sequence[tuple[PoolShard, str, dict[str, Any]]]) -> list[dict[str, Any]]:
        """Send a command to several shards, and wait for all answers; the first error is raised at the end.

        After an error or an interruption, which cancels the running commands, `_settle` synchronizes the environments.
        """
        running: list[tuple[PoolShard, int]] = []
        answers: list[dict[str, Any]] = []
        failed: GraspboxError | None = None
        try:
            for shard, command, fields in commands:
                running.append((shard, shard.begin(command, fields)))
            for _ in commands:
                shard, number = running.pop(0)
                try:
                    answers.append(shard.end(number))
                except GraspboxError as error:
                    failed = failed or error
        finally:
            for shard, number in running:
                shard.abandon(number)
            if len(answers) < len(commands):
                for shard, command, _ in commands:
                    shard.unsettled |= command in CHANGES
        if failed is not None:
            raise failed
        return answers

    def _settle(self) -> None:
        """Synchronize with the environments whose last command failed: some may have been stepped."""
        for shard in self._shards:
            if shard.unsettled:
                over = shard.settle()
                own = slice(shard.first, shard.last)
                self._begun[own] = [one is not None for one in over]
                self._over[own] = [bool(one) for one in over]
                self._away -= set(range(shard.first, shard.last))
                self._arrived = [(where, stepped) for where, stepped in self._arrived if where is not shard]

    def reset(self, seeds: Seeds, mask: Mask, options: Options, out: Buffers) -> "_core.EnvArrays":
        """Begin episodes, as `graspbox._core.EnvPool.reset`."""
        self._settle()
        self._check_here(range(self.num_envs))
        commands = []
        for shard in self._shards:
            own = slice(shard.first, shard.last)
            fields = reset_fields(
                None if seeds is None else seeds[own],
                None if mask is None else np.ascontiguousarray(mask[own]),
                options if len(options) == 1 else options[own],
            )
            commands.append((shard, "reset", fields))
        answers = self._each(commands)
        chosen = np.ones(self.num_envs, dtype=np.bool_) if mask is None else mask
        self._over &= ~chosen
        self._begun |= chosen
        return self._joined([now_of(answer, None) for answer in answers], self._shards, out)

    def step(self, actions: NDArray[np.float32], out: Buffers) -> Stepped:
        """Step all environments, as `graspbox._core.EnvPool.step`."""
        self._settle()
        self._check_actions(range(self.num_envs), actions)
        commands = [(shard, "step", {"actions": actions[shard.first : shard.last]}) for shard in self._shards]
        return self._stepped([stepped_of(answer, None) for answer in self._each(commands)], self._shards, out)

    def send(self, actions: NDArray[np.float32], envs: Sequence[int]) -> None:
        """Step environments in the background, as `graspbox._core.EnvPool.send`."""
        self._settle()
        self._check_actions(envs, actions)
        indices = np.asarray(envs)
        commands = []
        for shard in self._shards:
            rows = np.flatnonzero((indices >= shard.first) & (indices < shard.last))
            if len(rows):
                own = (indices[rows] - shard.first).tolist()
                commands.append((shard, "send", {"actions": np.ascontiguousarray(actions[rows]), "env_ids": own}))
        self._each(commands)
        for shard, _, fields in commands:
            shard.away |= set(fields["env_ids"])
        self._away |= {int(env) for env in envs}

    def recv(self, count: int) -> Stepped:
        """Receive environments that were sent, as `graspbox._core.EnvPool.recv`."""
        self._settle()
        if count == 0 or count > len(self._away):
            raise ConfigError(f"count is {count}; {len(self._away)} steps are pending")
        while len(self._arrived) < count:
            for shard in self._shards:
                if shard.away and (stepped := shard.next_arrival()) is not None:
                    self._arrived.append((shard, stepped))
        taken, self._arrived = self._arrived[:count], self._arrived[count:]
        found = self._stepped([stepped for _, stepped in taken], [shard for shard, _ in taken], None)
        self._away -= {int(env) for env in found[0]["env"]}
        return found

    def get_state(self, env: int) -> bytes:
        """Return the complete state of an environment."""
        shard = self._shard_of(env)
        found: bytes = shard.call("get_state", {"env_id": env - shard.first})["state"]
        return found

    def set_state(self, env: int, state: bytes) -> "_core.EnvArrays":
        """Restore a state and return the arrays of only that environment."""
        shard = self._shard_of(env)
        found = now_of(shard.call("set_state", {"env_id": env - shard.first, "state": state}), None)
        self._over[env] = bool(found["terminated"][0] or found["truncated"][0])
        self._begun[env] = True
        return found

    def pictures(self, envs: Sequence[int]) -> NDArray[np.uint8]:
        """Take pictures of some environments, (n, H, W, 3)."""
        frames = []
        for env in envs:
            shard = self._shard_of(env)
            frames.append(shard.call("render", {"env_ids": [env - shard.first]})["frames"])
        return np.concatenate(frames)

    def cameras(self) -> Cameras:
        """Intrinsics (3, 3) and world_from_camera (num_envs, 4, 4) of every camera at present, by name."""
        self._settle()
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
        return self._shards[0].names()

    def close(self) -> None:
        """End all sessions."""
        for shard in self._shards:
            shard.close()

    def _shard_of(self, env: int) -> PoolShard:
        self._settle()
        for shard in self._shards:
            if shard.first <= env < shard.last:
                self._check_here([env])
                return shard
        raise ConfigError(f"there is no environment {env}: there are {self.num_envs}, counted from 0")

    def _check_here(self, envs: Sequence[int]) -> None:
        if not self._away and isinstance(envs, range):
            return
        seen: set[int] = set()
        for env in envs:
            if env in self._away or env in seen:
                raise ConfigError(f"environment {env} is still stepping; receive its result first")
            seen.add(env)

    def _check_actions(self, envs: Sequence[int], actions: NDArray[np.float32]) -> None:
        """Refuse actions that one server would refuse after others had stepped."""
        self._check_here(envs)
        blocked = self._autoreset == "disabled" and self._over.any()
        if self._begun.all() and not blocked and np.isfinite(actions).all():
            return
        for env, action in zip(envs, actions, strict=True):
            if not self._begun[env]:
                raise ConfigError(f"environment {env} has no episode yet; reset it before the first step")
            if self._over[env] and self._autoreset == "disabled":
                raise ConfigError(
                    f"the episode of environment {env} is over; reset the environment before the next step"
                )
            bad = np.flatnonzero(~np.isfinite(action))
            # The action of a step that begins the next episode is ignored.
            if len(bad) and not (self._over[env] and self._autoreset == "next_step"):
                value = str(action[bad[0]]).replace("nan", "NaN")
                raise ConfigError(f"the action of environment {env} holds {value} at index {bad[0]}; nothing was moved")

    def _stepped(self, found: Sequence[Stepped], shards: Sequence[PoolShard], out: Buffers) -> Stepped:
        """Join the steps of several shards."""
        now = self._joined([one for one, _ in found], shards, out)
        ended = [(last, shard) for (_, last), shard in zip(found, shards, strict=True) if last is not None]
        # In the mode `same_step` the next episode has begun already.
        if self._autoreset != "same_step":
            self._over[now["env"]] = now["terminated"] | now["truncated"]
        if not ended:
            return now, None
        return now, self._joined([last for last, _ in ended], [shard for _, shard in ended], None)

    def _joined(
        self, found: Sequence["_core.EnvArrays"], shards: Sequence[PoolShard], out: Buffers
    ) -> "_core.EnvArrays":
        """Join rows of several shards and renumber their environments."""
        for arrays, shard in zip(found, shards, strict=True):
            arrays["env"] = arrays["env"] + shard.first
        joined: _core.EnvArrays = _concatenated(found, out or {})
        return joined


def _concatenated(found: Sequence[Any], out: dict[str, Any]) -> Any:
    """Join arrays, entry by entry."""
    joined: dict[str, Any] = {}
    for name, values in found[0].items():
        parts = [one[name] for one in found]
        joined[name] = (
            _concatenated(parts, {}) if isinstance(values, dict) else np.concatenate(parts, out=out.get(name))
        )
    return joined
