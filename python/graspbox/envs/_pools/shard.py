"""The environments of one of several servers, and how they go on elsewhere when it is lost.

With ``reconnect="restore"`` a shard saves the states of its environments every ``checkpoint`` commands, and remembers
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
    #: Environments that were sent and have not come back, and the command that waits for the next one.
    away: set[int] = field(default_factory=set)
    arrived: list[Stepped] = field(default_factory=list)
    waiting: int | None = None
    #: A command was interrupted, or failed: nobody knows how far it came, until `settle`.
    unsettled: bool = False

    @property
    def envs(self) -> range:
        """Its environments."""
        return range(self.first, self.last)

    @property
    def restores(self) -> bool:
        """Whether another server takes the place of one that is lost."""
        return self.remote.reconnect == "restore"

    def named(self, error: Exception) -> ConnectionLostError:
        """Name its environments in an error."""
        return lost(error, self.envs)

    def begin(self, command: str, fields: dict[str, Any]) -> int | None:
        """Send a command; None if the server is gone, which `end` finds out too."""
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
        """Cancel a command for whose answer nobody waits."""
        self.unsettled = True
        if number is not None:
            self.pool.abandon(number)

    def settle(self) -> list[bool | None]:
        """Find out where the environments are after a command that was interrupted or failed.

        Those that were on their way have come back afterwards, or were called back. States are saved anew.

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
                # There they are as they were before that command.
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
                break  # none is on its way any more
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
        """Return the next environment that comes back, within a tenth of a second."""
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
        """Save the states of all environments; where that fails, the log goes on."""
        try:
            self.states = self._states()
        except ConnectionLostError:
            return
        self.log.clear()

    def _restore(self, error: ConnectionLostError) -> None:
        """Make the environments on another server, as they were after the last command that was answered."""
        lost, reasons = self.pool.url, [str(error)]
        for url in [*(other for other in self.remote.urls if other != lost), lost]:
            try:
                pool = RemotePool(url, self.remote, self.request)
            except (ConnectionLostError, ConfigError) as reason:  # it is gone too, or has no room
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
                # What was on its way has still to be received; of an environment that can only be the last step.
                if env in self.away and last[env] == index:
                    arrived.append(stepped)
        self.arrived, self.waiting = arrived, None
