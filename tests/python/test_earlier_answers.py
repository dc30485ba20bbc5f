"""Earlier answers in requests to a policy server: the best grasp of a still scene stays, and wrong ones are told."""

import json
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from graspbox import _core
from graspbox.captures import Capture
from graspbox.errors import ConfigError
from graspbox.hands import load_hand
from graspbox.policies.grasp_image import EARLIER_ENTRIES
from graspbox.tools.remote import grasp_requests
from graspbox.tools.remote.earlier_answers import earlier_grasp, earlier_scene
from test_captured import CAPTURES, jittered

pytest.importorskip("onnxruntime", reason="networks run in onnxruntime, from the extra 'onnx'")
pytest.importorskip("PIL", reason="PNG files need Pillow, from the extra 'cli'")
from graspbox.tools.remote.policy_serving import PolicyServer, PolicyServerSettings

POLICY = Path(__file__).parents[2] / "policies/panda_clutter"
KEPT = ("hand", "camera_from_hand", "table_from_hand", "preshape")
assert EARLIER_ENTRIES == KEPT, "clients of earlier versions send these"


@pytest.fixture(scope="module")
def server() -> Iterator[PolicyServer]:
    with PolicyServer(POLICY, PolicyServerSettings(port=0)) as running:
        yield running


@pytest.fixture(scope="module")
def capture() -> Capture:
    from graspbox.evaluation.captures import Capture as Marked

    return Marked.read(CAPTURES / "pcl_milk_clorox")


def moved(answers: list[dict[str, Any]]) -> list[float]:
    places = [np.asarray(one["camera_from_hand"])[0, :3, 3] for one in answers]
    return [float(np.linalg.norm(b - a)) for a, b in pairwise(places)]


def test_the_best_grasp_of_a_still_scene_stays(server: PolicyServer, capture: Capture) -> None:
    client = _core.PolicyClient(server.url, token=None, ca=None)
    assert "previous" in client.metadata["requests"]
    assert capture.labels is not None
    fixed = {"intrinsics": capture.intrinsics, "mask": capture.labels == 1, "count": 2}

    def asked(number: int, previous: Any) -> dict[str, Any]:
        kept = {} if previous is None else {"previous": previous}
        client.send({**fixed, "depth": jittered(capture.depth, number).astype(np.float32), **kept})
        answer = client.receive()
        assert isinstance(answer, dict), answer
        return answer

    following = [asked(0, None)]
    for number in range(1, 6):
        # The whole answer may be sent back, or what is needed of it.
        earlier = following[-1] if number % 2 else {name: following[-1][name] for name in KEPT}
        following.append(asked(number, earlier))
    alone = [following[0], *(asked(number, None) for number in range(1, 6))]
    assert np.sort(moved(following))[:4].max() < 1e-6, moved(following)
    assert sum(moved(alone)) > sum(moved(following))


def test_things_keep_their_numbers_and_grasps(server: PolicyServer, capture: Capture) -> None:
    client = _core.PolicyClient(server.url, token=None, ca=None)
    request = {"intrinsics": capture.intrinsics, "all": True, "count": 1}

    def asked(depth: Any, **more: Any) -> Any:
        client.send({**request, "depth": depth, **more})
        return client.receive()

    first = asked(capture.depth)
    first["labels"] = np.where(first["labels"] > 0, first["labels"] + 6, 0)
    first["things"] = [{**row, "thing": row["thing"] + 6} for row in first["things"]]
    second = asked(jittered(capture.depth, 1), previous=first)
    for label in (7, 8):
        both = (second["labels"] == label) & (first["labels"] == label)
        assert both.sum() > 0.8 * (first["labels"] == label).sum()
    # As JSON, and for several images.
    again = json.loads(grasp_requests.to_json({"things": first["things"], "labels": first["labels"]}))
    third = asked(jittered(capture.depth, 1), previous=again)
    np.testing.assert_array_equal(third["labels"], second["labels"])
    both = asked(np.stack([jittered(capture.depth, 1)] * 2), previous={"images": [first, first]})
    np.testing.assert_array_equal(both["images"][1]["labels"], second["labels"])
    assert "give images, one for each of 2" in asked(np.stack([capture.depth] * 2), previous=first)


GOOD = {
    "hand": "panda_gripper",
    "camera_from_hand": np.eye(4)[None],
    "table_from_hand": np.eye(4)[None],
    "preshape": [0.0],
}


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        (None, r"previous is 5 \(int\); give an earlier answer, or its entries hand, camera_from_hand"),
        ({"hand": 3}, r"previous\.hand is 3"),
        ({"preshape": 0.0}, r"previous\.preshape has shape \(\); give \(n,\)"),
        ({"preshape": "wide"}, r"previous\.preshape is 'wide'"),
        ({"preshape": [1e9]}, r"previous\.preshape begins with 1e\+09; those of panda_gripper are"),
        ({"preshape": [float("nan")]}, r"previous\.preshape begins with nan"),
        ({"camera_from_hand": np.eye(4)}, r"previous\.camera_from_hand has shape \(4, 4\)"),
        ({"camera_from_hand": np.zeros((0, 4, 4))}, r"previous\.camera_from_hand has shape \(0, 4, 4\)"),
        ({"table_from_hand": 2.0 * np.eye(4)[None]}, r"previous\.table_from_hand begins with no rigid motion"),
        ({"table_from_hand": np.full((1, 4, 4), np.nan)}, r"previous\.table_from_hand begins with no rigid motion"),
        ({"table_from_hand": [[[1, 0, 0, 900], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]]}, "begins 900 m away"),
    ],
)
def test_wrong_earlier_answers_are_told(changed: Any, message: str) -> None:
    hand = load_hand("panda_gripper")
    with pytest.raises(ConfigError, match=message):
        earlier_grasp(5 if changed is None else {**GOOD, **changed}, hand)


def test_wrong_earlier_scenes_are_told() -> None:
    hand = load_hand("panda_gripper")
    good: dict[str, Any] = {"things": [{"thing": 1, **GOOD}], "labels": np.ones((2, 2), np.int64)}
    assert set(earlier_scene(good, hand).best_of) == {1}
    assert earlier_grasp({**GOOD, "preshape": []}, hand) is None
    refused = {"thing": 2, "pixels": 1, "refused": "too small"}
    assert set(earlier_scene({**good, "things": [refused, *good["things"]]}, hand).best_of) == {1}
    for changed, message in (
        ({"things": 3}, "give an earlier answer, or its entries things, at most 100, and labels"),
        ({"things": [4]}, r"previous\.things holds 4"),
        ({"labels": [[1, 2], [3]]}, r"previous\.labels has rows of different lengths"),
        ({"labels": [["a"]]}, r"previous\.labels holds 'a' \(str\); give an earlier answer"),
        ({"labels": None}, r"previous\.labels holds None"),
        ({"labels": [[0.5]]}, r"previous\.labels is float64"),
        ({"labels": [[2**62]]}, r"previous\.labels is"),
        ({"things": [{"thing": -1, **GOOD}]}, "give an integer that is not negative"),
    ):
        with pytest.raises(ConfigError, match=message):
            earlier_scene({**good, **changed}, hand)


def test_the_camera_command_sends_its_last_answer(tmp_path: Path, server: PolicyServer, capture: Capture) -> None:
    pytest.importorskip("typer", reason="the command line needs the extra 'cli'")
    from command_line import invoke

    for number in range(5):
        np.save(tmp_path / f"{number}.npy", jittered(capture.depth, number).astype(np.float32))
    info = CAPTURES / "pcl_milk_clorox/capture.json"
    words = ["camera", tmp_path, "--policy", server.url, "--camera-info", info, "--frames", "5", "--seconds", "60"]
    result = invoke([*words, "--json", "--depth-is", "z"])
    assert result.exit_code == 0, result.output
    lines = [json.loads(line) for line in result.stdout.splitlines()]
    answers = [{"camera_from_hand": [one["camera_from_hand"] for one in line["grasps"]]} for line in lines]
    assert np.sort(moved(answers))[:3].max() < 1e-6, moved(answers)
