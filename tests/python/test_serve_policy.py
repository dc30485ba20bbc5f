"""A served policy: grasps over both protocols, actions for observations, evaluation of a policy on a server."""

import base64
import json
import re
import signal
import time
import tracemalloc
import urllib.error
import urllib.request
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest

import graspbox
import tiny_policy
from graspbox import _core
from graspbox._common.rotations import rotation_from_quaternion
from graspbox.captures import read_capture
from graspbox.errors import ConfigError, ConnectionLostError
from graspbox.hands import load_hand
from graspbox.learn.random_hands import random_hand
from graspbox.policies.grasp_image import ImageGrasper, grasp_image
from graspbox.policies.published import runtimes
from graspbox.policies.published.folders import load, save
from graspbox.policies.remote_policy import RemotePolicy
from graspbox.tools.remote import grasp_requests
from graspbox.tools.remote.policy_serving import PolicyServer, PolicyServerSettings
from graspbox.tools.remote.sent_arrays import sent_array
from hostile_wire import Peer, msgpack
from test_serve import served

POLICIES = Path(__file__).parents[2] / "policies"
CAPTURES = Path(__file__).parent.parent / "captures"
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


@pytest.fixture(scope="module")
def request_of_three() -> dict[str, Any]:
    """Take a real image of three things, with their labels."""
    pytest.importorskip("PIL", reason="PNG files need Pillow, from the extra 'cli'")
    folder = CAPTURES / "pcl_milk_clorox"
    seen = read_capture(folder / "depth.png", intrinsics=folder / "capture.json", labels=folder / "labels.png")
    return {"depth": seen.depth, "intrinsics": seen.intrinsics, "labels": seen.labels, "count": 2}


def test_one_of_several_things_is_named(folder: Path, server: PolicyServer, request_of_three: dict[str, Any]) -> None:
    labels = request_of_three["labels"]
    plain = {name: value for name, value in request_of_three.items() if name != "labels"}
    local = grasp_image(plain["depth"], plain["intrinsics"], None, folder, mask=labels == 2, count=2)
    for marked in ({"mask": labels == 2}, {"mask": 255 * (labels == 2).astype(np.uint8)}):
        np.testing.assert_array_equal(asked(server, {**plain, **marked})["table_from_hand"], local.table_from_hand)
    named = asked(server, {**request_of_three, "label": 2})
    np.testing.assert_array_equal(named["table_from_hand"], local.table_from_hand)
    several = {name: np.stack([value] * 2) for name, value in request_of_three.items() if name in ("depth", "labels")}
    both = asked(server, {**request_of_three, **several, "label": 2})["images"]
    np.testing.assert_array_equal(both[1]["table_from_hand"], local.table_from_hand)
    only = asked(server, {**plain, "labels": 7 * (labels == 2).astype(np.uint16)})
    np.testing.assert_array_equal(only["table_from_hand"], local.table_from_hand)


def test_all_things_are_answered(folder: Path, server: PolicyServer, request_of_three: dict[str, Any]) -> None:
    """The server tells why a thing has no grasp, without paths, and an image without a grasp is no error."""
    labels = request_of_three["labels"].copy()
    labels[0, 0] = 9  # too few pixels
    answer = asked(server, {**request_of_three, "labels": labels, "all": True})
    local = ImageGrasper(folder).find_all(
        request_of_three["depth"], request_of_three["intrinsics"], labels=labels, count=2
    )
    assert [row["thing"] for row in answer["things"]] == [1, 2, 3, 9]
    assert answer["things"][3] == {"thing": 9, "pixels": 1, "refused": local.refused[9]}
    for row in answer["things"][:3]:
        found = local.grasps[row["thing"]]
        np.testing.assert_array_equal(row["camera_from_hand"], found.camera_from_hand)
        assert row["pixels"] == int((local.labels == row["thing"]).sum())
        assert set(row) - {"thing", "pixels"} == set(grasp_requests.answer_of(found, found.hand))
    assert [(row["thing"], row["rank"] - 1) for row in answer["order"]] == local.best()
    np.testing.assert_array_equal(answer["labels"], local.labels)
    sent = {name: np.asarray(request_of_three[name]).tolist() for name in ("depth", "intrinsics")}
    status, told = posted(server.url, json.dumps({**sent, "labels": labels.tolist(), "all": True, "count": 2}).encode())
    assert status == 200
    assert {name: told[name] for name in ("things", "order", "labels")} == json.loads(
        grasp_requests.to_json({name: answer[name] for name in ("things", "order", "labels")})
    )
    found = asked(server, {"depth": request_of_three["depth"], "intrinsics": sent["intrinsics"], "all": True})
    assert len(found["things"]) >= 3


def test_refusals_of_things_tell_no_path(tmp_path: Path, request_of_three: dict[str, Any]) -> None:
    tiny_policy.make(tmp_path)
    tiny_policy.give_nan(tmp_path, "scorer", "logits")
    with PolicyServer(tmp_path, SETTINGS) as running:
        for row in asked(running, {**request_of_three, "all": True})["things"]:
            assert "is not finite" in row["refused"]
            assert str(tmp_path) not in row["refused"]


def test_grasps_keep_off_the_points_of_a_request(
    folder: Path, server: PolicyServer, request_of_can: dict[str, Any]
) -> None:
    points = np.array([[0.0, 0.0, 0.3], [0.008, 0.0, 0.3]])
    answer = asked(server, {**request_of_can, "keep_off": points, "seed": 4})
    depth, lens, pose = request_of_can["depth"] * 1e-3, request_of_can["intrinsics"], request_of_can["camera_pose"]
    local = grasp_image(depth, lens, pose, folder, keep_off=points, seed=4)
    np.testing.assert_array_equal(answer["camera_from_hand"], local.camera_from_hand)
    np.testing.assert_array_equal(answer["lift_free"], local.lift_free)
    unposed = {name: value for name, value in request_of_can.items() if name != "camera_pose"}
    assert "give it too" in asked(server, {**unposed, "keep_off": points})


MARKS = np.zeros((120, 160), dtype=np.int64)
MARKS[50:70, 70:90] = 1
TWO = MARKS + (np.arange(160) > 80)


@pytest.mark.parametrize(
    ("changed", "field", "sentence"),
    [
        ({"mask": MARKS[:-1]}, "mask", "mask is int64 of shape (119, 160); give bool or integers of shape (120, 160)"),
        ({"mask": MARKS.astype(float)}, "mask", "mask is float64 of shape (120, 160)"),
        ({"mask": [[1], [1, 2]]}, "mask", "mask has rows of different lengths"),
        ({"mask": MARKS * 0}, "mask", "mask is 0 everywhere"),
        ({"mask": TWO}, "mask", "mask holds the numbers 1, 2; give one, or the numbers of several as labels"),
        ({"mask": -MARKS}, "mask", "mask holds -1"),
        ({"labels": MARKS.astype(np.uint64) * (2**64 - 1), "all": True}, "labels", "labels holds 18446744073709551615"),
        ({"labels": np.arange(19200).reshape(120, 160), "all": True}, "labels", "has 19199 things; give at most 100"),
        ({"mask": MARKS, "labels": MARKS}, "mask", "mask and labels both mark pixels; give one of them"),
        ({"label": 1}, "label", "label is 1 (int), the number of a thing in labels; give labels too"),
        ({"labels": MARKS, "label": 2}, "label", "label is 2; the things of labels are 1"),
        ({"labels": TWO}, "label", "label is missing; give one of the things of labels, 1, 2, or all"),
        ({"labels": MARKS, "label": "cup"}, "label", "label is 'cup' (str); give an integer"),
        ({"all": True, "mask": MARKS}, "all", "all asks for every thing, mask and label for one"),
        ({"all": True, "labels": MARKS, "label": 1}, "all", "all asks for every thing"),
        ({"all": 1}, "all", "all is 1 (int); give True or False"),
        ({"keep_off": np.zeros((4, 2))}, "keep_off", "keep_off has shape (4, 2); pass points (k, 3)"),
        ({"keep_off": "wall"}, "keep_off", "keep_off is 'wall' (str); give an array of numbers"),
        ({"keep_off": np.full((1, 3), np.nan)}, "keep_off", "keep_off has a coordinate of nan"),
    ],
    ids=lambda value: str(value)[:40] if isinstance(value, str) else "",
)
def test_wrong_marks_are_told(
    server: PolicyServer, request_of_can: dict[str, Any], changed: dict[str, Any], field: str, sentence: str
) -> None:
    answer = asked(server, {**request_of_can, **changed})
    assert isinstance(answer, str)
    assert sentence in answer
    body = {name: np.asarray(value).tolist() for name, value in request_of_can.items()}
    listed = {name: value.tolist() if isinstance(value, np.ndarray) else value for name, value in changed.items()}
    if field != "keep_off" or "nan" not in sentence:
        status, told = posted(server.url, json.dumps({**body, **listed}).encode())
        assert (status, told["error"]["type"], told["error"]["field"]) == (400, "ConfigError", field)


def test_marks_of_several_images_have_their_shape(server: PolicyServer, request_of_can: dict[str, Any]) -> None:
    several = {**request_of_can, "depth": np.stack([request_of_can["depth"]] * 2)}
    wrong = asked(server, {**several, "mask": MARKS})
    assert "mask has shape (120, 160); give (2, 120, 160), one for each image" in wrong


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
        ({"depth": np.zeros((0, 4))}, "depth has shape (0, 4), without a pixel"),
        ({"depth": np.full((40, 40), np.nan)}, "no pixel with a depth"),
        ({"depth": np.full((40, 40), 700.0)}, "millimetres"),
        ({"intrinsics": np.eye(4)}, "intrinsics has shape"),
        ({"intrinsics": np.full((3, 3), np.nan)}, "intrinsics holds nan; give finite numbers of shape (3, 3)"),
        ({"camera_pose": np.diag([2.0, 1.0, 1.0, 1.0])}, "camera_pose is not a rigid motion"),
        ({"camera_pose": np.diag([1.0, 1.0, 1.0, 1.0])}, "camera_pose places the camera at the height"),
        ({"region": [1e300, 0, 5, 5]}, "region is [1e+300, 0, 5, 5] (list); give the pixels left, top"),
        ({"region": [0.5, 0, 5, 5]}, "region is [0.5, 0, 5, 5] (list); give the pixels left, top"),
        ({"depth_scale": -1.0}, "depth_scale is -1.0 (float); give metres per unit of depth"),
        ({"depth_scale": float("nan")}, "depth_scale is nan (float)"),
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


WRONG_JSON: list[tuple[str, str, str]] = [
    ("depth_scale", "1" + 400 * "0", "depth_scale is 1000"),
    ("depth_scale", "true", "depth_scale is True (bool)"),
    ("intrinsics", "[[1" + 400 * "0" + ",0,1],[0,1,1],[0,0,1]]", "intrinsics is [[1000"),
    ("intrinsics", "[[1],[1,2]]", "intrinsics is [[1], [1, 2]]"),
    ("camera_pose", "[[NaN,0,0,0],[0,1,0,0],[0,0,1,0],[0,0,0,1]]", "camera_pose holds nan"),
    ("region", "[0,0,1" + 400 * "0" + ",1]", "region is [0, 0, 1000"),
    ("depth", "[[1" + 400 * "0" + "]]", "depth is object"),
    ("depth", "[]", "depth is float64 of shape (0,)"),
    ("count", "1" + 400 * "0", "count is 1000"),
    ("seed", "[1]", "seed is [1] (list)"),
    ("hand_error", "[1" + 400 * "0" + ",0]", "hand_error is [1000"),
    ("moon", "1", "no entry 'moon'"),
]


@pytest.mark.parametrize(("name", "value", "sentence"), WRONG_JSON, ids=lambda value: value[:30])
def test_wrong_json_names_entry_and_value(
    server: PolicyServer, request_of_can: dict[str, Any], name: str, value: str, sentence: str
) -> None:
    """A scale of 400 digits was an error of the server."""
    body = {key: request_of_can[key].tolist() for key in ("depth", "intrinsics", "camera_pose")}
    text = json.dumps({**body, name: "HERE"}).replace('"HERE"', value)
    status, answer = posted(server.url, text.encode())
    assert (status, answer["error"]["type"]) == (400, "ConfigError")
    assert sentence in answer["error"]["message"]
    assert len(answer["error"]["message"]) < 300
    assert "table_from_camera" not in answer["error"]["message"]
    with pytest.raises(ConfigError) as found:
        grasp_requests.decide(ImageGrasper(server._policy), grasp_requests.from_json(text.encode()))
    assert found.value.field == name


#: Texts of which numpy would make an array as wide as the longest: 200 MB.
LONG: list[Any] = [["a" * 100_000] + [""] * 500]


@pytest.mark.parametrize("name", ["depth", "mask", "labels", "intrinsics", "camera_pose", "region", "previous.labels"])
@pytest.mark.parametrize("images", [1, 2])
def test_rows_of_texts_are_refused_in_little_memory(
    server: PolicyServer, request_of_can: dict[str, Any], name: str, images: int
) -> None:
    request = {**request_of_can, "depth": np.stack([request_of_can["depth"]] * images)}
    if images == 1:
        request["depth"] = request_of_can["depth"]
    request[name] = LONG
    if name == "previous.labels":
        earlier = {"things": [], "labels": LONG}
        request["previous"] = earlier if images == 1 else {"images": [earlier] * images}
        request["all"] = True
        del request[name]
    grasper = ImageGrasper(server._policy)
    tracemalloc.start()
    try:
        with pytest.raises(ConfigError, match=name) as found:
            grasp_requests.decide(grasper, request)
        used = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert found.value.field == name.partition(".")[0]
    assert len(str(found.value)) < 300
    assert used < 1 << 24


@pytest.mark.parametrize(
    ("value", "message"),
    [
        ("x", "mask holds 'x' (str); give numbers"),
        ([[None]], "mask holds None"),
        ([[1], {"data": 1}], "mask holds {'data': 1} (dict)"),
        ([[1], 2], "mask has rows of different lengths"),
        ([[1, 2], [3]], "mask has rows of different lengths"),
        ([[[[1]]]], "mask has lists more than 3 deep"),
        ([b"1"], "mask holds b'1' (bytes)"),
        ([np.zeros(2), np.zeros(3)], "mask has rows of different lengths"),
    ],
)
def test_lists_of_other_things_than_numbers_are_told(value: Any, message: str) -> None:
    with pytest.raises(ConfigError, match=re.escape(message)):
        sent_array(value, "mask", "give numbers")


@pytest.mark.parametrize(
    "value", [3, 1.5, [], [[]], [[1, True], [2.5, np.float32(1)]], [np.eye(2)] * 3, ((1, 2), [3, 4])]
)
def test_lists_of_numbers_are_those_of_numpy(value: Any) -> None:
    found, wanted = sent_array(value, "mask", ""), np.asarray(value)
    assert found.dtype == wanted.dtype
    np.testing.assert_array_equal(found, wanted)


def test_an_optional_entry_may_be_null(server: PolicyServer, request_of_can: dict[str, Any]) -> None:
    needed = {name: np.asarray(request_of_can[name]).tolist() for name in ("depth", "intrinsics", "camera_pose")}
    known = [name for name in grasp_requests.ENTRIES if name not in needed]
    status, answer = posted(server.url, json.dumps({**needed, **dict.fromkeys(known)}).encode())
    assert status == 200, answer
    assert {**answer, "server_timing": 0} == {**posted(server.url, json.dumps(needed).encode())[1], "server_timing": 0}


def test_matrices_of_several_images_that_are_none(server: PolicyServer, request_of_can: dict[str, Any]) -> None:
    several = {**request_of_can, "depth": np.stack([request_of_can["depth"]] * 2)}
    assert "intrinsics has rows of different lengths" in asked(server, {**several, "intrinsics": [[1], [1, 2]]})
    assert "rows of different lengths" in asked(server, {**several, "camera_pose": [[[1]], [[1, 2]], []]})
    assert "give one for each of 2 images" in asked(server, {**several, "camera_pose": np.zeros((3, 4, 4))})


def test_bodies_that_are_no_request_are_refused(server: PolicyServer) -> None:
    assert posted(server.url, b"{", "text/plain")[0] == 415
    for body, sentence in (
        (b"[" * 100_000, "not JSON"),
        (b"[]", "not an object"),
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


def seen(server: PolicyServer) -> dict[str, Any]:
    """Observations as the policy of `server` takes them."""
    return {"depth": np.full((128, 128, 1), 0.5, np.float32), "proprio": np.zeros(28, np.float32)}


@pytest.mark.parametrize(
    ("wrong", "sentence"),
    [
        ({"reset": True, "seed": "x"}, "seed is 'x' (str); give an integer"),
        ({"reset": True, "seed": -1}, "seed is -1 (int); give an integer that is not negative"),
        ({"reset": True, "seed": float("nan")}, "seed is nan (float); give an integer"),
        ({"reset": True, "seed": 1e300}, "seed is 1e+300 (float); give an integer"),
        ({"reset": True, "seed": [1]}, "seed is [1] (list); give an integer"),
        ({"seed": "x"}, "seed is 'x' (str); give an integer"),
        ({"reset": "x"}, "reset is 'x' (str); give True or False"),
        ({"reset": 1}, "reset is 1 (int); give True or False"),
        ({"depth": np.full((128, 128, 1), np.nan, np.float32)}, "'depth' holds numbers that are not finite"),
        ({"proprio": np.full(28, 1e300)}, "'proprio' holds numbers that are not finite"),
        ({"proprio": [[1.0], [1.0, 2.0]]}, "the observation 'proprio' has rows of different lengths; give float32"),
        ({"proprio": [["a"] * 28]}, "the observation 'proprio' holds 'a' (str); give float32 of shape (28,)"),
        ({"proprio": [[[0.0]]]}, "the observation 'proprio' has lists more than 2 deep; give float32"),
    ],
    ids=lambda value: str(value)[:40],
)
def test_wrong_frames_to_a_policy_that_acts(server: PolicyServer, wrong: dict[str, Any], sentence: str) -> None:
    """Most of them were said to be errors of the server, a NaN one of the policy."""
    answer = asked(server, {**seen(server), **wrong})
    assert isinstance(answer, str)
    assert sentence in answer
    assert isinstance(asked(server, {**seen(server), "reset": True, "seed": 7}), dict)


def test_no_error_tells_a_path_of_the_server(tmp_path: Path) -> None:
    tiny_policy.make_network(tmp_path)
    tiny_policy.give_nan(tmp_path, "policy", "action")
    with PolicyServer(tmp_path, SETTINGS) as running:
        answer = asked(running, {name: np.zeros(size, np.float32) for name, size in tiny_policy.SEEN.items()})
    assert answer.startswith("tiny/policy.onnx: output 'action' is not finite")
    assert str(tmp_path) not in answer


@pytest.mark.parametrize("kind", ["depth", "network", "feel"])
def test_a_served_policy_has_the_trials_of_the_policy(tmp_path: Path, kind: str) -> None:
    """Objects from which it learned were left in, and its probabilities were not told."""
    tiny_policy.MAKERS[kind](tmp_path)
    config = load(tmp_path)
    save(tmp_path, replace(config, learned_from=("procedural:can:0-1", "procedural:mug:2")))
    keywords: dict[str, Any] = {"objects": ["procedural:can:0-3", "procedural:mug:0-3"], "trials": 4, "num_envs": 2}
    with PolicyServer(tmp_path, SETTINGS) as running:
        served = graspbox.evaluation.evaluate(RemotePolicy(running.url), **keywords)
    local = graspbox.evaluation.evaluate(str(tmp_path), **keywords)
    assert served == local
    assert (served.objects_given, served.objects_left_out) == (local.objects_given, local.objects_left_out) == (8, 3)
    assert [trial.confidence for trial in served.trials] == [trial.confidence for trial in local.trials]
    assert (local.calibration_error is None) == (kind == "network")
    assert {**served.to_json(), "ms_per_decision": 0} == {**local.to_json(), "ms_per_decision": 0}


def test_connections_share_networks_and_nothing_else(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Each loaded the networks again, and made an environment for its spaces."""
    loaded: list[str] = []
    real = runtimes.onnx_network

    def counted(path: Path, num_threads: int | None = None) -> runtimes.Network:
        loaded.append(path.name)
        return real(path, num_threads)

    monkeypatch.setattr(runtimes, "onnx_network", counted)
    with PolicyServer(folder, SETTINGS) as running:
        before = list(loaded)
        answers = [asked(running, {**seen(running), "reset": True, "seed": 7}) for _ in range(3)]
        actors: Any = running._actors
        one, other = (actors.of(number)._policy for number in (101, 102))
    assert loaded == before
    assert len({answer["actions"].tobytes() for answer in answers}) == 1
    assert one.finder is other.finder
    assert one.executor is not other.executor
    assert one._streams[0].random() != other._streams[0].random()


@pytest.mark.parametrize("requests", [1, 3])
def test_pings_are_answered_while_a_decision_takes_long(
    server: PolicyServer, monkeypatch: pytest.MonkeyPatch, requests: int
) -> None:
    """A client of openpi leaves after 40 s without an answer to its pings; this one after 1 s."""

    def slow(_grasper: Any, _request: Any) -> dict[str, Any]:
        time.sleep(2.0)
        return {"count": 0}

    monkeypatch.setattr(grasp_requests, "decide", slow)
    with Peer(server.url) as peer:
        peer.socket.settimeout(1.0)
        for _ in range(requests):
            peer.send(msgpack({"intrinsics": 0}))
        answers, pings = 0, 0
        while answers < requests:
            peer.send(b"here?", opcode=9)
            pings += 1
            while (received := peer.frame()) != (10, b"here?"):
                answers += received[0] == 2
            time.sleep(0.25)
    assert pings > 5 * requests


def test_a_hand_that_the_policy_on_a_server_does_not_know(server: PolicyServer) -> None:
    policy = RemotePolicy(server.url)
    with pytest.raises(ConfigError, match=r"grasps with the hand 'reflex', and .* 'panda_gripper'; .*--hand"):
        graspbox.evaluation.evaluate(policy, objects="procedural:can:0", trials=1, hand="panda_gripper")


def test_a_policy_for_any_hand_is_served_with_one(request_of_can: dict[str, Any]) -> None:
    """Grasps and evaluations are those of the policy on this machine, which needs no word about a shipped hand."""
    policy = str(POLICIES / "any_hand")
    with PolicyServer(policy, SETTINGS, hand="panda_gripper") as running:
        found = asked(running, {**request_of_can, "count": 1})
        result = graspbox.evaluation.evaluate(RemotePolicy(running.url), objects="procedural:can:2000-2001", trials=2)
    assert found["hand"] == "panda_gripper"
    local = graspbox.evaluation.evaluate(policy, objects="procedural:can:2000-2001", trials=2, hand="panda_gripper")
    assert [trial.confidence for trial in result.trials] == [trial.confidence for trial in local.trials]


def test_a_policy_is_served_with_a_hand_from_files(tmp_path: Path) -> None:
    """Clients see none of the server's files, and give those of their own."""
    files = tmp_path / "own.urdf", tmp_path / "own.toml"
    for path, text in zip(files, random_hand("fingers", 3).files, strict=True):
        path.write_text(text)
    arguments = ["--hand", ",".join(map(str, files))]
    with served("partial_view_planner", *arguments, command="serve-policy") as (_, url):
        policy = RemotePolicy(url)
        assert str(tmp_path) not in json.dumps(policy.metadata)
        with pytest.raises(ConfigError, match=f"grasps with the hand {load_hand(files).name!r}"):
            graspbox.evaluation.evaluate(policy, objects="procedural:can:0", trials=1)
        result = graspbox.evaluation.evaluate(policy, objects="procedural:can:0", trials=1, hand=files)
    assert len(result.trials) == 1


def test_a_policy_of_one_hand_is_not_served_with_another(folder: Path) -> None:
    with pytest.raises(ConfigError, match="was trained for the hand 'reflex', not 'leap'"):
        PolicyServer(folder, SETTINGS, hand="leap")


def test_post_is_named_where_there_are_grasps(folder: Path) -> None:
    """Policies that find none in images were said to answer POST."""
    for policy, named in (("random", False), (str(folder), True)):
        printed: list[str] = []
        with served(policy, command="serve-policy", printed=printed):
            assert ("/grasps" in printed[0]) == named


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
