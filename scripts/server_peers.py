"""What others offer for a call to an environment elsewhere, for `bench_server.py`: echoes without physics.

Each peer is a context manager that gives a call; the observation is that of ``Grasp-v0``: 88 float32.
"""

import multiprocessing
import socket
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import gymnasium
import numpy as np

OBSERVATION = 88
Peer = Callable[[], Any]


class Echo(gymnasium.Env[Any, Any]):
    """An environment without physics."""

    def __init__(self) -> None:
        self.observation_space = gymnasium.spaces.Box(-1.0, 1.0, (OBSERVATION,), np.float32)
        self.action_space = gymnasium.spaces.Box(-1.0, 1.0, (10,), np.float32)
        self._observation = np.zeros(OBSERVATION, np.float32)

    def reset(self, *, seed: int | None = None, options: Any = None) -> tuple[Any, dict[str, Any]]:
        """Begin an episode that never ends."""
        super().reset(seed=seed)
        return self._observation, {}

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """Return the observation."""
        return self._observation, 0.0, False, False, {"is_success": False}


@contextmanager
def async_vector_env() -> Iterator[Peer]:
    """Gymnasium's own way to another process."""
    env = gymnasium.vector.AsyncVectorEnv([Echo])
    env.reset(seed=0)
    action = np.zeros((1, 10), np.float32)
    yield lambda: env.step(action)
    env.close()


def free_port() -> int:
    """Find a port that is free."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def _serve_openpi(port: int) -> None:
    """Serve as openpi does: one frame in, one frame out, packed by its own module."""
    from openpi_client import msgpack_numpy
    from websockets.sync.server import serve

    def handle(connection: Any) -> None:
        packer = msgpack_numpy.Packer()
        connection.send(packer.pack({}))
        observation = np.zeros(OBSERVATION, np.float32)
        for frame in connection:
            msgpack_numpy.unpackb(frame)
            connection.send(packer.pack({"actions": observation}))

    with serve(handle, "127.0.0.1", port, compression=None, max_size=None) as server:
        server.serve_forever()


@contextmanager
def openpi() -> Iterator[Peer]:
    """Openpi's client, with a server of its protocol in Python."""
    from openpi_client.websocket_client_policy import WebsocketClientPolicy

    port = free_port()
    process = multiprocessing.get_context("spawn").Process(target=_serve_openpi, args=(port,), daemon=True)
    process.start()
    time.sleep(2)
    client = WebsocketClientPolicy("127.0.0.1", port)
    action = {"action": np.zeros(10, np.float32)}
    yield lambda: client.infer(action)
    process.kill()


PEERS: dict[str, Any] = {"AsyncVectorEnv": async_vector_env, "openpi-client": openpi}
