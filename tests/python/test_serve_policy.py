"""A served policy: grasps over both protocols, actions for observations, evaluation of a policy on a server."""

import base64
import json
import signal
import time
import urllib.error
import urllib.request
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest

import graspbox
import tiny_policy
from graspbox import _core
from graspbox._common.rotations import rotation_from_quaternion
from graspbox.errors import ConfigError, ConnectionLostError
from graspbox.policies.grasp_image import grasp_image
from graspbox.remote.policy_serving import PolicyServer, PolicyServerSettings
from graspbox.remote.remote_policy import RemotePolicy
from test_serve import served

SETTINGS = PolicyServerSettings(port=0, threads=2)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("policy")
    tiny_policy.make(path)
    return path


@pytest.fixture(scope="module")
def server(folder: Path) -> Iterator[PolicyServer]:
    with PolicyServer(folder, SETTINGS) as running:
        yield running


@pytest.fixture(scope="module")
def request_of_can() -> dict[str, Any]:
    """Render an image of a can, as a camera would give it."""
    env = gymnasium.make("graspbox/GraspPose-v0", objects="procedural:can:0", obs="depth", image_size=(120, 160))
    image, _ = env.reset(seed=3)
    intrinsics, pose = next(iter(env.unwrapped.cameras().values()))  # type: ignore[attr-defined]
    return {"depth": (image[..., 0] * 1000).astype(np.uint16), "intrinsics": intrinsics, "camera_pose": pose}


def asked(server: PolicyServer, request: dict[str, Any]) -> Any:
    client = _core.PolicyClient(server.url, token=None, ca=None)
    client.send(request)
    return client.receive()


def posted(url: str, body: bytes, kind: str = "application/json") -> tuple[int, Any]:
    url = url.replace("ws", "http", 1) + "/grasps"
    try:
        with urllib.request.urlopen(urllib.request.Request(url, body, {"Content-Type": kind})) as response:
            return response.status, json.loads(response.read())
    except urllib.error.HTTPError as error:
        text = error.read().decode()
        return error.code, json.loads(text) if text.startswith("{") else text


def test_grasps_are_those_of_grasp_image(folder: Path, server: PolicyServer, request_of_can: dict[str, Any]) -> None:
    answer = asked(server, {**request_of_can, "count": 3, "seed": 4})
    depth, lens, pose = request_of_can["depth"] * 1e-3, request_of_can["intrinsics"], request_of_can["camera_pose"]
    local = grasp_image(depth, lens, pose, folder, count=3, seed=4)
    np.testing.assert_array_equal(answer["camera_from_hand"], local.camera_from_hand)
    np.testing.assert_array_equal(answer["success"], local.success)
    np.testing.assert_array_equal(answer["position"], local.camera_from_hand[:, :3, 3])
    rotations = rotation_from_quaternion(answer["quaternion_wxyz"])
    np.testing.assert_allclose(rotations, local.camera_from_hand[:, :3, :3], atol=1e-9)
    assert answer["actions"].shape == (1, 8)
    hand = graspbox.load_hand(answer["hand"])
    assert answer["joint_names"] == hand.joints
    np.testing.assert_array_equal(answer["joint_positions"][0], hand.open(float(local.preshape[0])))
    assert answer["server_timing"]["infer_ms"] > 0


def test_several_images_have_several_answers(server: PolicyServer, request_of_can: dict[str, Any]) -> None:
    one = asked(server, request_of_can)
    both = asked(server, {**request_of_can, "depth": np.stack([request_of_can["depth"]] * 2)})
    assert len(both["images"]) == 2
    np.testing.assert_array_equal(both["images"][1]["camera_from_hand"], one["camera_from_hand"])


def test_json_says_the_same(server: PolicyServer, request_of_can: dict[str, Any]) -> None:
    depth = request_of_can["depth"]
    packed = {"data": base64.b64encode(depth.tobytes()).decode(), "dtype": "<u2", "shape": list(depth.shape)}
    body = {name: request_of_can[name].tolist() for name in ("intrinsics", "camera_pose")}
    status, answer = posted(server.url, json.dumps({**body, "depth": packed}).encode())
    assert status == 200
    np.testing.assert_array_equal(answer["camera_from_hand"], asked(server, request_of_can)["camera_from_hand"])
    status, listed = posted(server.url, json.dumps({**body, "depth": depth.tolist()}).encode())
    assert status == 200
    assert listed["camera_from_hand"] == answer["camera_from_hand"]


@pytest.mark.parametrize(
    ("changed", "sentence"),
    [
        ({"depth": None}, "numbers"),
        ({"depth": [[1.0, 2.0], [3.0]]}, "depth"),
        ({"depth": np.zeros((0, 4))}, "depth has shape"),
        ({"depth": np.full((40, 40), np.nan)}, "no depth at all"),
        ({"depth": np.full((40, 40), 700.0)}, "millimetres"),
        ({"intrinsics": np.eye(4)}, "intrinsics has shape"),
        ({"camera_pose": "above"}, "camera_pose"),
        ({"region": [5, 5, 1, 1]}, "region"),
        ({"count": 0}, "count is 0"),
        ({"hand_error": [1e6, 0]}, "hand's error"),
        ({"depth_scale": "mm"}, "depth_scale"),
        ({"colour": 1}, "no entry 'colour'"),
    ],
)
def test_wrong_requests_are_told_what_is_wrong(
    server: PolicyServer, request_of_can: dict[str, Any], changed: dict[str, Any], sentence: str
) -> None:
    answer = asked(server, {**request_of_can, **changed})
    assert isinstance(answer, str)
    assert sentence in answer


def test_bodies_that_are_no_request_are_refused(server: PolicyServer) -> None:
    assert posted(server.url, b"{", "text/plain")[0] == 415
    for body, sentence in (
        (b"[" * 100_000, "not JSON"),
        (b"[]", "no object"),
        (b'{"depth": {"data": "AAAA", "dtype": "<u2", "shape": [9, 9]}}', "bytes"),
        (b'{"depth": {"data": "AAAA", "dtype": "O", "shape": [3]}}', "do not fit"),
        (b"{}", "needs the entries"),
    ):
        status, answer = posted(server.url, body)
        assert status == 400, body[:40]
        assert answer["error"]["type"] == "ConfigError"
        assert sentence in answer["error"]["message"]


def test_decisions_under_way_end_before_the_server_does(folder: Path, request_of_can: dict[str, Any]) -> None:
    """The one that is being made, those behind it on the connection, and that of a POST; SIGTERM lost all of them."""
    several = {**request_of_can, "depth": np.stack([request_of_can["depth"]] * 8)}
    body = {name: request_of_can[name].tolist() for name in ("depth", "intrinsics", "camera_pose")}
    with served(str(folder), "--threads", "1", command="serve-policy") as (process, url), ThreadPoolExecutor(1) as pool:
        client = _core.PolicyClient(url, token=None, ca=None)
        for _ in range(3):
            client.send(several)
        posting = pool.submit(posted, url, json.dumps(body).encode())
        time.sleep(0.3)
        process.send_signal(signal.SIGTERM)
        assert [len(client.receive()["images"]) for _ in range(3)] == [8, 8, 8]
        assert posting.result()[0] == 200
        assert process.wait(timeout=15) == 0


def test_a_server_that_stops_takes_nothing_new(folder: Path, request_of_can: dict[str, Any]) -> None:
    with PolicyServer(folder, SETTINGS) as server:
        server.drain()
        status, answer = posted(server.url, b"{}")
        assert (status, answer["error"]["type"]) == (503, "ConfigError")
        with pytest.raises(ConfigError, match="takes no more clients"):
            asked(server, request_of_can)


def test_evaluation_of_a_served_policy_equals_the_policy(folder: Path, server: PolicyServer) -> None:
    keywords: dict[str, Any] = {"objects": "procedural:can:0-3", "trials": 6, "num_envs": 3, "include_learned": True}
    served = graspbox.evaluation.evaluate(RemotePolicy(server.url), **keywords)
    local = graspbox.evaluation.evaluate(str(folder), **keywords)
    assert [(t.success, t.reward, t.failure) for t in served.trials] == [
        (t.success, t.reward, t.failure) for t in local.trials
    ]


def test_observations_are_checked_by_name_and_shape(server: PolicyServer) -> None:
    assert "no observation 'rgb'" in asked(server, {"rgb": np.zeros((4, 4, 3), np.uint8)})
    assert "is missing" in asked(server, {"depth": np.zeros((128, 128, 1), np.float32)})
    assert "of shape (4, 4, 1)" in asked(server, {"depth": np.zeros((4, 4, 1), np.float32)})


def test_a_policy_that_reads_the_state_is_not_served() -> None:
    with pytest.raises(ConfigError, match="reads the state"):
        PolicyServer("planner", SETTINGS)


def test_a_server_that_is_not_there() -> None:
    with pytest.raises(ConnectionLostError, match="cannot be reached"):
        RemotePolicy("ws://127.0.0.1:9")


def test_a_policy_that_observes_nothing_is_asked_with_the_default(server: PolicyServer) -> None:
    """It named no observation, and then wanted those of the default environment."""
    with PolicyServer("random", SETTINGS) as running:
        policy = RemotePolicy(running.url)
        assert policy.obs == ("state",)
        result = graspbox.evaluation.evaluate(policy, objects="procedural:can:0", trials=3)
    assert result == graspbox.evaluation.evaluate("random", objects="procedural:can:0", trials=3)
