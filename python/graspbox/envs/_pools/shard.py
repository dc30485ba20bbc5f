"""The environments of one of several servers, and their restoration on another one when it is lost.

With ``reconnect="restore"`` a shard saves the states of its environments every ``checkpoint`` commands, and logs
the commands since then. On another server it restores the states and repeats the commands: the results are the same.
"""

from dataclasses import dataclass, field
from typing import Any

from graspbox.envs._pools.local import Stepped
from graspbox.envs._pools.remote import RemotePool, checked, lost, stepped_of
from graspbox.envs.remote_config import RemoteConfig
from graspbox.errors import ConfigError, ConnectionLostError

__all__ = ["CHANGES", "Shard"]

#: Commands that change environments.
CHANGES = ("reset", "step", "set_state", "send")


@dataclass
class Shard:
    """The environments of one server: `first` to `last`, the last one excluded.

    Commands and answers count environments from 0.
    """

    remote: RemoteConfig
    request: dict[str, Any]
    first: int
    last: int
    pool: RemotePool
    #: Saved states (None where no episode has begun), and the commands since then.
    states: list[bytes | None] = field(default_factory=list)
    log: list[tuple[str, dict[str, Any]]] = field(default_factory=list)
    #: Environments with pending steps, and the command that waits for the next one.
    away: set[int] = field(default_factory=set)
    arrived: list[Stepped] = field(default_factory=list)
    waiting: int | None = None
    #: A command was interrupted, or failed: its progress is unknown until `settle`.
    unsettled: bool = False

    @property
    def envs(self) -> range:
        """Its environments."""
        return range(self.first, self.last)

    @property
    def restores(self) -> bool:
        """Whether another server replaces a lost one."""
        return self.remote.reconnect == "restore"

    def named(self, error: Exception) -> ConnectionLostError:
        """Add its environments to an error."""
        return lost(error, self.envs)

    def begin(self, command: str, fields: dict[str, Any]) -> int | None:
        """Send a command; None if the server is lost, which `end` then reports."""
        try:
            return self.pool.begin(command, fields)
        except ConnectionLostError as error:
            if not self.restores:
                raise self.named(error) from None
            return None

    def end(self, number: int | None, command: str, fields: dict[str, Any]) -> dict[str, Any]:
        """Wait for the answer to a command; an interruption cancels it."""
        try:
            return self._end(number, command, fields)
        except KeyboardInterrupt:
            self.unsettled = True
            raise

    def _end(self, number: int | None, command: str, fields: dict[str, Any]) -> dict[str, Any]:
        try:
            if number is None:
                raise ConnectionLostError(f"the server {self.pool.url} cannot be reached")
            answer = self.pool.end(number)
        except ConnectionLostError as error:
            if not self.restores:
                raise self.named(error) from None
            self._restore(error)
            answer = self.pool.call(command, fields)
        if command == "send":
            self.away |= set(fields["env_ids"])
        if self.restores and command in CHANGES:
            self.log.append((command, fields))
            if not self.away and (len(self.log) >= self.remote.checkpoint or not self.states):
                self._save()
        return answer

    def abandon(self, number: int | None) -> None:
        """Cancel a command and ignore its answer."""
        self.unsettled = True
        if number is not None:
            self.pool.abandon(number)

    def settle(self) -> list[bool | None]:
        """Synchronize with the environments after a command that was interrupted or failed.

        Pending steps have ended or been cancelled afterwards. States are saved anew.

        Returns
        -------
        list of bool or None
            Whether the episode of each environment is over; None where none has begun.
        """
        while True:
            try:
                return self._settled()
            except ConnectionLostError as error:
                if not self.restores:
                    raise self.named(error) from None
                # The other server has the states before that command.
                self.away.clear()
                self._restore(error)

    def _settled(self) -> list[bool | None]:
        pool, envs = self.pool, range(self.last - self.first)
        if self.waiting is not None:
            pool.abandon(self.waiting)
        for _ in range(
            2 * len(envs) + 2
        ):  # an environment comes back once; its error, or one of the cancelled, is one more
            if pool.answer("recv", {"count": 1}).get("error", {}).get("field") == "count":
                break  # no step is pending
        states = self._states()
        over: list[bool | None] = []
        for env, state in zip(envs, states, strict=True):
            if state is None:
                over.append(None)
                continue
            now = checked(pool.answer("set_state", {"env_id": env, "state": state}))["now"]
            over.append(bool(now["terminated"][0] or now["truncated"][0]))
        self.away, self.arrived, self.waiting, self.unsettled = set(), [], None, False
        if self.restores:
            self.states = states
            self.log.clear()
        return over

    def _states(self) -> list[bytes | None]:
        """States of all environments; None where no episode has begun."""
        numbers = [self.pool.begin("get_state", {"env_id": env}) for env in range(self.last - self.first)]
        states: list[bytes | None] = []
        for number in numbers:
            try:
                states.append(self.pool.end(number)["state"])
            except ConfigError:
                states.append(None)
        return states

    def call(self, command: str, fields: dict[str, Any]) -> dict[str, Any]:
        """Send a command and wait for its answer."""
        return self.end(self.begin(command, fields), command, fields)

    def next_arrival(self) -> Stepped | None:
        """Return the next step that ends within a tenth of a second."""
        if self.arrived:
            return self._taken(self.arrived.pop(0))
        try:
            if self.waiting is None:
                self.waiting = self.pool.begin("recv", {"count": 1})
            answer = self.pool.poll(self.waiting)
        except ConnectionLostError as error:
            self.waiting = None
            if not self.restores:
                raise self.named(error) from None
            self._restore(error)
            return None
        if answer is None:
            return None
        self.waiting = None
        return self._taken(stepped_of(answer, None))

    def _taken(self, stepped: Stepped) -> Stepped:
        self.away -= {int(env) for env in stepped[0]["env"]}
        return stepped

    def _save(self) -> None:
        """Save the states of all environments; if that fails, the log continues to grow."""
        try:
            self.states = self._states()
        except ConnectionLostError:
            return
        self.log.clear()

    def _restore(self, error: ConnectionLostError) -> None:
        """Make the environments on another server, in their state after the last answered command."""
        lost, reasons = self.pool.url, [str(error)]
        for url in [*(other for other in self.remote.urls if other != lost), lost]:
            try:
                pool = RemotePool(url, self.remote, self.request)
            except (ConnectionLostError, ConfigError) as reason:  # it is lost too, or full
                reasons.append(str(reason))
                continue
            try:
                self._repeat(pool)
            except ConnectionLostError as reason:
                reasons.append(str(reason))
                continue
            self.pool = pool
            return
        raise self.named(ConnectionLostError("; ".join(dict.fromkeys(reasons)))) from None

    def _repeat(self, pool: RemotePool) -> None:
        """Restore the states on another server, and repeat the commands since then."""
        for env, state in enumerate(self.states):
            if state is not None:
                pool.call("set_state", {"env_id": env, "state": state})
        arrived: list[Stepped] = []
        last = {
            env: index for index, (name, asked) in enumerate(self.log) if name == "send" for env in asked["env_ids"]
        }
        for index, (name, asked) in enumerate(self.log):
            pool.call(name, asked)
            for _ in asked["env_ids"] if name == "send" else ():
                stepped = stepped_of(pool.call("recv", {"count": 1}), None)
                env = int(stepped[0]["env"][0])
                # Pending steps are still to be received; each environment has at most one, its last.
                if env in self.away and last[env] == index:
                    arrived.append(stepped)
        self.arrived, self.waiting = arrived, None
