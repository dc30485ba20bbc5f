"""The environments of one of several servers."""

from typing import Any

from graspbox.envs._pools.local import Stepped
from graspbox.envs._pools.remote import RemotePool, checked, stepped_of
from graspbox.envs.remote_config import RemoteConfig
from graspbox.errors import ConfigError, GraspboxError

__all__ = ["CHANGES", "PoolShard"]

#: Commands that change environments.
CHANGES = ("reset", "step", "set_state", "send")


class PoolShard(RemotePool):
    """Environments `first` to `last` of a pool, the last one excluded; parameters as of `RemotePool`.

    Commands and answers count its environments from 0.
    """

    def __init__(self, url: str, config: RemoteConfig, request: dict[str, Any]) -> None:
        super().__init__(url, config, request)
        #: Environments with pending steps, and the command that waits for the next one.
        self.away: set[int] = set()
        self._waiting: int | None = None
        #: A command was interrupted, or failed: its progress is unknown until `settle`.
        self.unsettled = False

    def end(self, number: int) -> dict[str, Any]:
        """Wait for the answer to a command; an interruption cancels it."""
        try:
            return super().end(number)
        except KeyboardInterrupt:
            self.unsettled = True
            raise

    def settle(self) -> list[bool | None]:
        """Synchronize with the environments after a command that was interrupted or failed, and end pending steps.

        Returns whether the episode of each environment is over; None where none has begun.
        """
        if self._waiting is not None:
            self.abandon(self._waiting)
        # An environment comes back once; its error, or one of the cancelled, is one more.
        for _ in range(2 * self.num_envs + 2):
            if self.answer("recv", {"count": 1}).get("error", {}).get("field") == "count":
                break  # no step is pending
        numbers = [self.begin("get_state", {"env_id": env}) for env in range(self.num_envs)]
        over = [self._is_over(env, number) for env, number in enumerate(numbers)]
        self.away, self._waiting, self.unsettled = set(), None, False
        return over

    def _is_over(self, env: int, number: int) -> bool | None:
        """Find out whether an episode is over from the answer to ``get_state``; None if none has begun."""
        try:
            state = self.end(number)["state"]
        except ConfigError:
            return None
        now = checked(self.answer("set_state", {"env_id": env, "state": state}))["now"]
        return bool(now["terminated"][0] or now["truncated"][0])

    def next_arrival(self) -> Stepped | None:
        """Return the next step that ends within a tenth of a second."""
        try:
            if self._waiting is None:
                self._waiting = self.begin("recv", {"count": 1})
            answer = self.poll(self._waiting)
        except GraspboxError:
            self._waiting = None
            raise
        if answer is None:
            return None
        self._waiting = None
        stepped = stepped_of(answer, None)
        self.away -= {int(env) for env in stepped[0]["env"]}
        return stepped
