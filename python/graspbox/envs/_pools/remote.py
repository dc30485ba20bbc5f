"""Environments on a server, with the methods of a pool of this process.

Every call is one command and its answer over a WebSocket; ``docs/reference/protocol.md`` specifies both. Arrays are
those of the server, bit for bit, and errors have its messages.
"""

import time
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any

import numpy as np
from numpy.typing import NDArray

from graspbox import _core, errors
from graspbox._common.arguments import shown
from graspbox.envs._pools.local import Buffers, Cameras, Mask, Options, Seeds, Stepped
from graspbox.envs.remote_config import RemoteConfig
from graspbox.errors import ConfigError, ConnectionLostError, GraspboxError, InternalError

__all__ = ["PROTOCOL", "RemotePool"]

#: Version of the protocol; the first frame has the server's.
PROTOCOL = 1
#: Commands whose answers have observations; one of them runs at a time.
_ROWS = ("reset", "step", "observe", "set_state")
#: Entries of the description of environments used here.
_DESCRIBED = ("autoreset", "has_files", "images", "objects", "tables")
#: Seconds for which a cancelled call may still bring its answer.
_GRACE = 0.5
#: A connection that is back within this time was as good as not lost, seconds.
_SOON = 0.25


class RemotePool:
    """A session on one server; errors of a lost server name its environments.

    `request` has the environment's id, number, objects and keywords, and ``first_env`` if several servers share the
    environments. Its errors are those of the same environments in this process; also for objects and hands that the
    server does not offer, and ConnectionLostError for a server that cannot be reached.
    """

    def __init__(self, url: str, config: RemoteConfig, request: dict[str, Any]) -> None:
        self.url, self.num_envs = url, int(request["num_envs"])
        self.first = int(request.get("first_env", 0))
        self.last = self.first + self.num_envs
        self._made = self._warned = False
        #: Extra fields of every command whose answer has observations.
        self._shared: dict[str, bool] = {}
        ca = None if config.ca_file is None else str(config.ca_file)
        with self._named():
            self._client = _core.Client(url, token=config.token(), ca=ca, grace=float(config.grace))
        self.hello: dict[str, Any] = self._client.hello
        self._check_server()
        self._grace = float(config.grace)
        more = {"grace": min(config.grace, self.hello["limits"]["max_grace"]), "depth": config.depth}
        made = self.call("make", {**request, **more, "share": config.shm})
        self.description: dict[str, Any] = self._description_in(made)
        if config.shm:
            self._client.open_segment(made["segment"])
            self._shared = {"shm": True}
        self._made = True

    @contextmanager
    def _named(self) -> Iterator[None]:
        """Add the environments on a lost server, or to be made on it, to its error."""
        try:
            yield
        except ConnectionLostError as error:
            several = f"environments {self.first} to {self.last - 1} are"
            which = several if self.num_envs > 1 else f"environment {self.first} is"
            raise ConnectionLostError(f"{error}; {which} {'' if self._made else 'to be '}on it") from None

    def _check_server(self) -> None:
        """Refuse a server other than graspbox, or of another version."""
        hello = self.hello
        if not isinstance(hello, dict) or hello.get("protocol") != "graspbox":
            raise ConfigError(f"{self.url} is not an environment server; start one with 'graspbox serve'")
        theirs, ours = hello.get("protocol_version"), PROTOCOL
        if theirs != ours:
            version = hello.get("version")
            raise ConfigError(
                f"{self.url} speaks version {theirs} of the protocol (graspbox {version}), this client version {ours} "
                f"(graspbox {_core.__version__}); install the same version on both sides"
            )
        limits = hello.get("limits")
        if not isinstance(limits, dict) or not isinstance(limits.get("max_grace"), int | float):
            raise ConfigError(f"the first frame of {self.url} has no limits; this is not a graspbox server")

    def _description_in(self, made: dict[str, Any]) -> dict[str, Any]:
        """Take the description of the environments; all entries used here are required."""
        found = made.get("description")
        missing = [name for name in _DESCRIBED if not isinstance(found, dict) or name not in found]
        if not isinstance(found, dict) or missing:
            raise ConfigError(
                f"{self.url} describes its environments without {missing[0]}; this is not a graspbox server"
            )
        return found

    def begin(self, command: str, fields: dict[str, Any]) -> int:
        """Send a command; `end` waits for its answer."""
        shared = self._shared if command in _ROWS else {}
        with self._named():
            return self._client.submit(command, {**fields, **shared})

    def end(self, number: int) -> dict[str, Any]:
        """Wait for the answer to a command, and raise its error, if any."""
        with self._named():
            try:
                answer = self._wait(number)
            except KeyboardInterrupt:
                self._cancel(number)
                raise
        return checked(answer)

    def abandon(self, number: int) -> None:
        """Cancel a command and ignore its answer; it ends before any later command begins."""
        try:
            for late in (number, self._client.submit("cancel", {})):
                self._client.forget(late)
        except ConnectionLostError:
            return

    def answer(self, command: str, fields: dict[str, Any]) -> dict[str, Any]:
        """Send a command and return its answer, even if that is an error."""
        number = self.begin(command, fields)
        with self._named():
            return self._wait(number)

    def poll(self, number: int) -> dict[str, Any] | None:
        """Return the answer to a command; None if it has not come within a tenth of a second."""
        with self._named():
            answer = self._poll(number)
        return None if answer is None else checked(answer)

    def call(self, command: str, fields: dict[str, Any]) -> dict[str, Any]:
        """Send a command and wait for its answer."""
        return self.end(self.begin(command, fields))

    def _wait(self, number: int) -> dict[str, Any]:
        """Wait for the answer to a command."""
        while (answer := self._poll(number)) is None:
            pass
        return answer

    def _poll(self, number: int) -> dict[str, Any] | None:
        """Return the answer to a command, if it comes within a tenth of a second; warn once of each lost connection."""
        answer: dict[str, Any] | None = self._client.poll(number)
        if answer is not None:
            self._warned = False
        elif not self._warned and (self._client.lost() or 0.0) > _SOON:
            self._warned = True
            warnings.warn(
                f"the connection to {self.url} was lost at {time.strftime('%H:%M:%S')}; trying again for "
                f"{self._grace:g} s, then its environments are lost",
                RuntimeWarning,
                stacklevel=2,
            )
        return answer

    def _cancel(self, number: int) -> None:
        """Cancel a command on the server: environments that it has not reached stay unchanged."""
        numbers = [number, self._client.submit("cancel", {})]
        until = time.monotonic() + _GRACE
        while numbers and time.monotonic() < until:
            if self._client.poll(numbers[0]) is not None:
                numbers.pop(0)
        for late in numbers:
            self._client.forget(late)

    def reset(self, seeds: Seeds, mask: Mask, options: Options, out: Buffers) -> "_core.EnvArrays":
        """Begin episodes, as `graspbox._core.EnvPool.reset`."""
        return now_of(self.call("reset", reset_fields(seeds, mask, options)), out)

    def step(self, actions: NDArray[np.float32], out: Buffers) -> Stepped:
        """Step all environments, as `graspbox._core.EnvPool.step`."""
        return stepped_of(self.call("step", {"actions": actions}), out)

    def send(self, actions: NDArray[np.float32], envs: Sequence[int]) -> None:
        """Step environments in the background, as `graspbox._core.EnvPool.send`."""
        self.call("send", {"actions": actions, "env_ids": list(envs)})

    def recv(self, count: int) -> Stepped:
        """Receive environments that were sent, as `graspbox._core.EnvPool.recv`."""
        return stepped_of(self.call("recv", {"count": count}), None)

    def get_state(self, env: int) -> bytes:
        """Return the complete state of an environment."""
        found: bytes = self.call("get_state", {"env_id": env})["state"]
        return found

    def set_state(self, env: int, state: bytes) -> "_core.EnvArrays":
        """Restore a state and return the arrays of only that environment."""
        return now_of(self.call("set_state", {"env_id": env, "state": state}), None)

    def pictures(self, envs: Sequence[int]) -> NDArray[np.uint8]:
        """Take pictures of some environments, (n, H, W, 3)."""
        frames: NDArray[np.uint8] = self.call("render", {"env_ids": list(envs)})["frames"]
        return frames

    def cameras(self) -> Cameras:
        """Intrinsics (3, 3) and world_from_camera (num_envs, 4, 4) of every camera at present, by name."""
        found = self.call("cameras", {})["cameras"]
        return {name: (one["intrinsics"], one["world_from_camera"]) for name, one in found.items()}

    def prepare(self, progress: bool, delay: float, skip_errors: bool) -> None:
        """Prepare all objects on the server; the progress bar is not shown here."""
        try:
            self.call("prepare", {})
        except GraspboxError:
            if not skip_errors:
                raise

    def names(self) -> list[str]:
        """Names of the objects, in order."""
        found: list[str] = self.call("names", {})["names"]
        return found

    def close(self) -> None:
        """End the session; does nothing if the server is lost."""
        try:
            self._client.submit("close", {})
        except GraspboxError:
            return


def reset_fields(seeds: Seeds, mask: Mask, options: Options) -> dict[str, Any]:
    """Fields of the command ``reset``."""
    return {"seed": None if seeds is None else list(seeds), "mask": mask, "options": list(options)}


def checked(answer: dict[str, Any]) -> dict[str, Any]:
    """Raise the error of an answer: a GraspboxError of the named class, with the server's message."""
    error = answer.get("error")
    if error is None:
        return answer
    if not isinstance(error, dict) or not isinstance(name := error.get("type"), str):
        raise InternalError(f"the server reports an invalid error: {shown(error)}")
    if name == "KeyboardInterrupt":
        raise KeyboardInterrupt
    kind, message = getattr(errors, name, None), str(error.get("message"))
    if not (isinstance(kind, type) and issubclass(kind, GraspboxError)):
        raise InternalError(f"the server reports an error of the kind {name!r}: {message}")
    raised = kind(message)
    raised.object, raised.field = error.get("object") or None, str(error.get("field") or "")
    raise raised


def now_of(answer: dict[str, Any], out: Buffers) -> "_core.EnvArrays":
    """Arrays of the rows of an answer, as the core returns them."""
    return _arrays(answer["now"], out)


def stepped_of(answer: dict[str, Any], out: Buffers) -> Stepped:
    """Arrays of a step, and of the episodes that ended in it."""
    last = answer.get("last")
    return _arrays(answer["now"], out), None if last is None else _arrays(last, None)


def _arrays(rows: dict[str, Any], out: Buffers) -> "_core.EnvArrays":
    found = rows.pop("observations")
    for name, values in found.items():
        if values.dtype == np.uint16:  # depth in millimetres
            found[name] = np.multiply(values, np.float32(1e-3), dtype=np.float32)
    if out is not None:
        for name, buffer in out.items():
            np.copyto(buffer, found[name])
            found[name] = buffer
    rows["env"] = rows.pop("env_ids")
    return {**found, **rows}  # type: ignore[typeddict-item]
