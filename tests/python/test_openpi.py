"""The client of openpi, unmodified, asks our policy server; our client asks a server that behaves as openpi's.

``openpi-client`` pins numpy below 2, so it has a virtual environment of its own: ``make test-adapters``.
"""

import os
import threading
import traceback
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest

from graspbox import _core, policies
from graspbox.errors import ConfigError
from graspbox.policies import Task
from graspbox.policies.grasp_image import ImageGrasper
from graspbox.policies.remote_policy import RemotePolicy
from graspbox.tools.remote.grasp_requests import decide
from graspbox.tools.remote.policy_serving import PolicyServer, PolicyServerSettings

missing = find_spec("openpi_client") is None and not os.environ.get("GRASPBOX_REQUIRE_ADAPTERS")
pytestmark = [
    pytest.mark.skipif(missing, reason="openpi-client has a virtual environment of its own: make test-adapters"),
    # openpi-client connects without `with`, which newer versions of websockets advise against.
    pytest.mark.filterwarnings("ignore:connect:DeprecationWarning"),
]

FOLDER = Path(__file__).parents[2] / "policies/depth"
TOKEN = "a-token-of-some-length"
OBSERVATION = (28,)


@pytest.fixture(scope="module")
def server() -> Iterator[PolicyServer]:
    with PolicyServer(FOLDER, PolicyServerSettings(port=0, token=TOKEN)) as running:
        yield running


@pytest.fixture(scope="module")
def request_of_can() -> dict[str, Any]:
    """Render an image of a can, as a camera would give it."""
    env = gymnasium.make("graspbox/GraspPose-v0", objects="procedural:can:0", obs="depth", image_size=(120, 160))
    image, _ = env.reset(seed=3)
    intrinsics, _ = next(iter(env.unwrapped.cameras().values()))  # type: ignore[attr-defined]
    return {"depth": image[..., 0], "intrinsics": intrinsics}


def connected(server: PolicyServer, token: str = TOKEN) -> Any:
    """Connect as a program for openpi does."""
    from openpi_client.websocket_client_policy import WebsocketClientPolicy

    host, port = server.url.removeprefix("ws://").split(":")
    return WebsocketClientPolicy(host, int(port), api_key=token)


def test_grasps_for_an_image(server: PolicyServer, request_of_can: dict[str, Any]) -> None:
    """In metres and in millimetres; the same bits as without a server."""
    client = connected(server)
    assert client.get_server_metadata()["grasps"] is True
    grasper = ImageGrasper(FOLDER)
    millimetres = (1000 * request_of_can["depth"]).astype(np.uint16)
    for own in (request_of_can, {**request_of_can, "depth": millimetres, "count": 2}):
        answer, expected = client.infer(own), decide(grasper, own)
        assert len(expected["position"]) == own.get("count", 5)
        assert answer["actions"].shape == (1, 8)
        assert answer.pop("server_timing")["infer_ms"] > 0
        assert set(answer) == set(expected)
        for name, value in expected.items():
            np.testing.assert_array_equal(answer[name], value)


def test_scalars_of_numpy_are_numbers(server: PolicyServer, request_of_can: dict[str, Any]) -> None:
    """The client packs them as ``__npgeneric__``, with the number itself as data."""
    client = connected(server)
    millimetres = {**request_of_can, "depth": (1000 * request_of_can["depth"]).astype(np.uint16)}
    plain = client.infer({**millimetres, "depth_scale": 0.001, "count": 2, "seed": 9})
    scalars = {"depth_scale": np.float64(0.001), "count": np.int32(2), "seed": np.uint8(9)}
    np.testing.assert_array_equal(client.infer({**millimetres, **scalars})["position"], plain["position"])


def test_errors_are_raised_and_the_connection_goes_on(server: PolicyServer, request_of_can: dict[str, Any]) -> None:
    client = connected(server)
    wrong: list[tuple[dict[str, Any], str]] = [
        ({}, "is missing"),
        ({"depth": request_of_can["depth"], "intrinsics": np.eye(4)}, "intrinsics has shape"),
        ({**request_of_can, "colour": 1}, "no entry 'colour'"),
        ({**request_of_can, "depth": request_of_can["depth"].astype(">f4")}, "little-endian"),
    ]
    for request, sentence in wrong:
        with pytest.raises(RuntimeError, match=f"Error in inference server:\n.*{sentence}"):
            client.infer(request)
    assert len(client.infer(request_of_can)["position"]) == 5


def test_the_key_of_the_client_is_the_token(server: PolicyServer) -> None:
    exceptions = pytest.importorskip("websockets.exceptions")
    with pytest.raises(exceptions.InvalidStatus, match="401"):
        connected(server, token="another-token-of-some-length")


def test_actions_for_observations(server: PolicyServer) -> None:
    """Also through openpi's own broker of chunks, as its runtime asks for actions."""
    from openpi_client.action_chunk_broker import ActionChunkBroker

    policy = policies.load(str(FOLDER))
    envs = gymnasium.make_vec("graspbox/GraspPose-v0", 1, objects="procedural:can:0", obs=policy.obs, **policy.settings)
    policy.bind(Task.of(envs))
    observation, _ = envs.reset(seed=3)
    policy.reset([7])
    expected = policy.act(observation)
    names = (policy.obs,) if isinstance(policy.obs, str) else tuple(policy.obs or ())
    rows = {name: observation[name][0] if isinstance(observation, dict) else observation[0] for name in names}
    broker = ActionChunkBroker(connected(server), action_horizon=1)
    np.testing.assert_array_equal(broker.infer({**rows, "reset": True, "seed": 7})["actions"], expected[0])


@contextmanager
def openpi_server(infer: Callable[[Any], dict[str, Any]]) -> Iterator[str]:
    """Serve a policy as openpi does (``websocket_policy_server``): metadata, answers; of an error its traceback."""
    from openpi_client import msgpack_numpy
    from websockets.exceptions import ConnectionClosed
    from websockets.sync.server import ServerConnection, serve

    def handle(socket: ServerConnection) -> None:
        packer = msgpack_numpy.Packer()
        socket.send(packer.pack({"robot": "arm"}))
        while True:
            try:
                answer = infer(msgpack_numpy.unpackb(socket.recv()))
                socket.send(packer.pack({**answer, "server_timing": {"infer_ms": 1.0}}))
            except ConnectionClosed:
                return
            except Exception:
                socket.send(traceback.format_exc())
                socket.close(1011, "Internal server error. Traceback included in previous frame.")
                return

    with serve(handle, "127.0.0.1", 0, compression=None, max_size=None) as running:
        threading.Thread(target=running.serve_forever, daemon=True).start()
        yield f"ws://127.0.0.1:{running.socket.getsockname()[1]}"
        running.shutdown()


def test_our_client_asks_a_server_of_openpi() -> None:
    """Three actions of each chunk of five are executed; observations arrive under the server's names, bit for bit."""
    asked: list[dict[str, Any]] = []

    def infer(observation: dict[str, Any]) -> dict[str, Any]:
        asked.append(observation)
        assert observation["prompt"] == "lift the can"
        return {"actions": np.arange(5)[:, None] / 10 + np.zeros(8)}

    envs = gymnasium.make_vec("graspbox/Grasp-v0", 2, objects="procedural:can:0", obs="proprio")
    with openpi_server(infer) as url:
        policy = RemotePolicy(
            url, obs="proprio", keys={"proprio": "observation/state"}, chunk=3, extra={"prompt": "lift the can"}
        )
        assert policy.metadata["robot"] == "arm"
        policy.bind(Task.of(envs))
        policy.reset([1, 2])
        observation, _ = envs.reset(seed=0)
        for step in range(6):
            actions = policy.act(observation)
            np.testing.assert_array_equal(actions, np.full((2, 8), step % 3 / 10, dtype=np.float32))
            if step % 3 == 0:
                latest = sorted(found["observation/state"].tobytes() for found in asked[-2:])
                assert latest == sorted(row.tobytes() for row in observation)
            observation, *_ = envs.step(actions)
    assert len(asked) == 4
    assert asked[0]["observation/state"].shape == OBSERVATION


def test_scalars_in_an_answer_of_openpi_are_numbers() -> None:
    answer = {"actions": np.zeros((1, 10)), "value": np.float32(0.5), "steps": np.int64(-3), "done": np.bool_(True)}
    with openpi_server(lambda _: answer) as url:
        client = _core.PolicyClient(url, token=None, ca=None)
        client.send({})
        found = client.receive()
    assert (found["value"], found["steps"], found["done"]) == (0.5, -3, True)


def test_errors_of_a_server_of_openpi_are_told_in_its_words() -> None:
    def infer(observation: dict[str, Any]) -> dict[str, Any]:
        raise ValueError("this policy needs two cameras")

    with openpi_server(infer) as url:
        policy = RemotePolicy(url, obs="proprio")
        envs = gymnasium.make_vec("graspbox/Grasp-v0", 1, objects="procedural:can:0", obs="proprio")
        policy.bind(Task.of(envs))
        policy.reset([1])
        with pytest.raises(ConfigError, match="reports an error: ValueError: this policy needs two cameras"):
            policy.act(envs.reset(seed=0)[0])
