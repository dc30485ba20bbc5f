"""Round trips of other projects' calls to a remote environment without physics, for `bench_server.py`.

    python scripts/server_peers.py remote-gym --calls 1000      # microseconds per call, as JSON

Peers need conflicting packages, so each runs in an interpreter of its own (`bench_server.py
--peer-python`); the observation is that of ``Grasp-v0``: 88 float32. Exit status 3: the peer is not installed.
"""

import argparse
import json
import os
import signal
import socket
import subprocess
import sys
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

    #: Read by remote-gym.
    reward_range = (-float("inf"), float("inf"))

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
    """Find a free port."""
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
def _served(name: str) -> Iterator[int]:
    """Context manager: run a peer's server and its child processes; yields its port."""
    port = free_port()
    call = [sys.executable, __file__, name, "--serve", str(port)]
    with subprocess.Popen(call, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, start_new_session=True) as server:
        try:
            _wait_for(port, server)
            yield port
        finally:
            os.killpg(server.pid, signal.SIGKILL)


def _wait_for(port: int, server: "subprocess.Popen[bytes]") -> None:
    until = time.monotonic() + 30
    while time.monotonic() < until and server.poll() is None:
        try:
            socket.create_connection(("127.0.0.1", port), timeout=1).close()
            return
        except OSError:
            time.sleep(0.05)
    raise RuntimeError(f"the server did not start: {' '.join(map(str, server.args))}")


@contextmanager
def openpi() -> Iterator[Peer]:
    """Openpi's client, with a server of its protocol in Python."""
    from openpi_client.websocket_client_policy import WebsocketClientPolicy

    with _served("openpi-client") as port:
        client = WebsocketClientPolicy("127.0.0.1", port)
        action = {"action": np.zeros(10, np.float32)}
        yield lambda: client.infer(action)


def create_environment(**_: Any) -> Echo:
    """Make the environment; remote-gym looks for a function of this name in the file."""
    return Echo()


def _serve_remote_gym(port: int) -> None:
    from remote_gym import create_remote_environment_server

    os.chdir(os.path.dirname(os.path.abspath(__file__)))
    entry = {"entrypoint": os.path.basename(__file__)}
    create_remote_environment_server(default_args=entry, url="127.0.0.1", port=port).wait_for_termination()


@contextmanager
def remote_gym() -> Iterator[Peer]:
    """remote-gym: dm_env_rpc over gRPC, the environment in a process of its own."""
    from remote_gym import RemoteEnvironment

    with _served("remote-gym") as port:
        env = RemoteEnvironment(url="127.0.0.1", port=port)
        env.reset()
        action = np.zeros(10, np.float32)
        yield lambda: env.step(action)
        env.close()


def _serve_openenv(port: int) -> None:
    """Serve an echo as OpenEnv's own example does: pydantic models, JSON over a WebSocket."""
    import uvicorn
    from openenv.core.env_server.http_server import create_fastapi_app
    from openenv.core.env_server.interfaces import Environment
    from openenv.core.env_server.types import Action, Observation, State

    class EchoAction(Action):
        values: list[float]

    class EchoObservation(Observation):
        values: list[float]

    class EchoServer(Environment):  # type: ignore[type-arg]
        SUPPORTS_CONCURRENT_SESSIONS = True

        def reset(self, seed: int | None = None, episode_id: str | None = None, **_: Any) -> EchoObservation:
            return EchoObservation(values=[0.0] * OBSERVATION, done=False, reward=0.0)

        def step(self, action: EchoAction, timeout_s: float | None = None, **_: Any) -> EchoObservation:
            return EchoObservation(values=[0.0] * OBSERVATION, done=False, reward=0.0)

        @property
        def state(self) -> State:
            return State()

    app = create_fastapi_app(EchoServer, EchoAction, EchoObservation)
    uvicorn.run(app, host="127.0.0.1", port=port, log_level="error")


@contextmanager
def openenv() -> Iterator[Peer]:
    """OpenEnv's generic client, with its own server."""
    from openenv.core.generic_client import GenericEnvClient

    with _served("OpenEnv") as port, GenericEnvClient(base_url=f"http://127.0.0.1:{port}").sync() as client:
        client.reset()
        action = {"values": [0.0] * 10}
        yield lambda: client.step(action)


PEERS: dict[str, Any] = {
    "AsyncVectorEnv": async_vector_env,
    "openpi-client": openpi,
    "remote-gym": remote_gym,
    "OpenEnv": openenv,
}
SERVERS = {"openpi-client": _serve_openpi, "remote-gym": _serve_remote_gym, "OpenEnv": _serve_openenv}


def round_trips(call: Peer, count: int) -> list[float]:
    """Measure calls, microseconds, after a tenth of them to warm up."""
    for _ in range(count // 10):
        call()
    times = []
    for _ in range(count):
        started = time.perf_counter()
        call()
        times.append(1e6 * (time.perf_counter() - started))
    return times


def main() -> int:
    """Measure a peer, and print its times."""
    parser = argparse.ArgumentParser(description="round trips of a peer, microseconds, as JSON")
    parser.add_argument("peer", choices=PEERS)
    parser.add_argument("--calls", type=int, default=1000)
    parser.add_argument("--serve", type=int, metavar="PORT", help="run the peer's server alone")
    arguments = parser.parse_args()
    if arguments.serve is not None:
        SERVERS[arguments.peer](arguments.serve)
        return 0
    try:
        with PEERS[arguments.peer]() as call:
            print(json.dumps(round_trips(call, arguments.calls)))
    except ImportError as error:
        print(f"{arguments.peer}: {error}", file=sys.stderr)
        return 3
    return 0


if __name__ == "__main__":
    sys.exit(main())
