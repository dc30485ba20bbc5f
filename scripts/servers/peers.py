"""Round trips of other projects' calls to a remote environment without physics.

Peers may need packages that conflict, so each runs in its own interpreter: this file is also a program, which
prints microseconds per call as JSON. The observation is that of ``Grasp-v0`` with ``fingers="each"``: 88 float32.
"""

import json
import subprocess
import sys
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np

OBSERVATION = np.zeros(88, np.float32)
#: Exit status of a peer that is not installed.
_NOT_INSTALLED = 3


class Echo(gymnasium.Env[Any, Any]):
    """An environment without physics."""

    observation_space = gymnasium.spaces.Box(-1.0, 1.0, OBSERVATION.shape, np.float32)
    action_space = gymnasium.spaces.Box(-1.0, 1.0, (10,), np.float32)

    def reset(self, *, seed: int | None = None, options: Any = None) -> tuple[Any, dict[str, Any]]:
        """Begin an episode that never ends."""
        super().reset(seed=seed)
        return OBSERVATION, {}

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """Return the observation."""
        return OBSERVATION, 0.0, False, False, {"is_success": False}


@contextmanager
def async_vector_env() -> Iterator[Callable[[], Any]]:
    """Gymnasium's own way to another process."""
    env = gymnasium.vector.AsyncVectorEnv([Echo])
    env.reset(seed=0)
    action = np.zeros((1, 10), np.float32)
    yield lambda: env.step(action)
    env.close()


def answer(connection: Any) -> None:
    """Serve as openpi does: one frame in, one frame out, packed by its own module."""
    from openpi_client import msgpack_numpy

    packer = msgpack_numpy.Packer()
    connection.send(packer.pack({}))
    for frame in connection:
        msgpack_numpy.unpackb(frame)
        connection.send(packer.pack({"actions": OBSERVATION}))


@contextmanager
def openpi() -> Iterator[Callable[[], Any]]:
    """Openpi's client, with a server of its protocol in Python, in its own process."""
    from openpi_client.websocket_client_policy import WebsocketClientPolicy

    with subprocess.Popen([sys.executable, __file__, "serve"], stdout=subprocess.PIPE, text=True) as server:
        assert server.stdout is not None
        client = WebsocketClientPolicy("127.0.0.1", int(server.stdout.readline()))
        action = {"action": np.zeros(10, np.float32)}
        yield lambda: client.infer(action)
        server.kill()


def round_trips(call: Callable[[], Any], count: int) -> list[float]:
    """Measure calls, microseconds, after a tenth of them to warm up."""
    for _ in range(count // 10):
        call()
    times = []
    for _ in range(count):
        started = time.perf_counter()
        call()
        times.append(1e6 * (time.perf_counter() - started))
    return times


PEERS: dict[str, Any] = {"AsyncVectorEnv": async_vector_env, "openpi-client": openpi}


def measure(name: str, pythons: Iterable[str], count: int) -> list[float] | None:
    """Measure a peer's calls, microseconds, in the first interpreter that has it; None if none has."""
    for python in pythons:
        run = subprocess.run([python, str(Path(__file__)), name, str(count)], capture_output=True, text=True)
        if run.returncode == 0:
            return list(json.loads(run.stdout))
        if run.returncode != _NOT_INSTALLED:
            raise SystemExit(f"{name} failed: {run.stderr}")
    return None


def main(name: str, count: str = "0") -> int:
    """Measure a peer and print its times, or serve openpi's protocol; status 3: the peer is not installed."""
    if name == "serve":
        from websockets.sync.server import serve

        with serve(answer, "127.0.0.1", 0, compression=None, max_size=None) as server:
            print(server.socket.getsockname()[1], flush=True)
            server.serve_forever()
    try:
        with PEERS[name]() as call:
            print(json.dumps(round_trips(call, int(count))))
    except ImportError as error:
        print(f"{name}: {error}", file=sys.stderr)
        return _NOT_INSTALLED
    return 0


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
