"""A box in space within which things are grasped: corners, frames, and the same box of commands, servers and MCP."""

import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from graspbox.errors import ConfigError
from graspbox.evaluation.captures import Capture
from graspbox.perception.real import RealImage, Workspace
from test_captured import CAPTURES, CROP, LENS, MIDDLE, POSE, REPOSITORY, grasper, scene

__all__ = ["grasper"]  # a fixture

#: Two boxes on a table, the first one larger.
VIEW = scene((0.0, 0.0, 0.05, 0.08), (0.05, 0.3, 0.02, 0.05))
DEPTH = np.asarray(VIEW.depth)
#: Around the second one, in the table's frame.
SECOND = ((MIDDLE - 0.1, 0.2, 0.002), (MIDDLE + 0.2, 0.4, 0.2))


@pytest.mark.parametrize(
    ("low", "high", "message"),
    [
        ((0.3, 0.0, 0.0), (-0.2, 1.0, 1.0), "has its corners swapped along x, from 0.3 to -0.2 m"),
        ((0.0, 0.0, 0.1), (1.0, 1.0, 0.1), "has no extent along z, from 0.1 to 0.1 m"),
        ((0.0, 0.0), (1.0, 1.0), "has low = (0.0, 0.0); pass three finite numbers"),
        ((0.0, 0.0, 0.0), (1.0, float("nan"), 1.0), "has high = (1.0, nan, 1.0); pass three"),
        (("a", "b", "c"), (1, 1, 1), "the workspace's low is ('a', 'b', 'c') (tuple); give an array of numbers"),
        ((0, 0, 0), ((1, 2), 1, 1), "the workspace's high is ((1, 2), 1, 1) (tuple); give an array of numbers"),
        ((0, None, 0), (1, 1, 1), "has low = (0, None, 0); pass three finite numbers"),
        (None, (1, 1, 1), "the workspace's low is None"),
    ],
)
def test_wrong_corners_are_named(low: Any, high: Any, message: str) -> None:
    with pytest.raises(ConfigError, match=re.escape(message)):
        Workspace(low, high)


@pytest.mark.parametrize(
    ("corners", "message"),
    [
        ([1, 2, 3], "workspace has shape (3,); pass six numbers, X Y Z X Y Z, metres"),
        (5.0, "workspace has shape (); pass six numbers"),
        ([[0, 0, 0], [1, 1, 1]], "workspace has shape (2, 3); pass six numbers"),
        ("far", "workspace is 'far' (str); give an array of numbers"),
        ([[0], 0, 0, 1, 1, 1], "workspace is [[0], 0, 0, 1, 1, 1] (list); give an array of numbers"),
    ],
)
def test_wrong_boxes_are_told(corners: Any, message: str) -> None:
    with pytest.raises(ConfigError, match=re.escape(message)):
        Workspace.of(corners, None)


def test_arrays_are_corners() -> None:
    box: Any = Workspace(np.zeros(3), np.ones(3))  # type: ignore[arg-type]
    assert box == Workspace((0, 0, 0), (1, 1, 1))
    assert hash(box) == hash(Workspace.of(np.array([0, 0, 0, 1, 1, 1]), None))  # type: ignore[arg-type]


def test_frames_are_known() -> None:
    wrong: Any = "world"
    with pytest.raises(ConfigError, match="in the frame 'world'; choose from table, camera"):
        Workspace((0, 0, 0), (1, 1, 1), wrong)
    with pytest.raises(ConfigError, match="workspace_frame is 'table', the frame of a workspace"):
        Workspace.of(None, "table")
    assert Workspace.of(None, None) is None
    assert Workspace.of([0, 1, 2, 3, 4, 5], "camera") == Workspace((0, 1, 2), (3, 4, 5), "camera")


def test_only_what_is_in_the_box_is_grasped_and_all_else_is_an_obstacle() -> None:
    from graspbox.perception.captured import look

    every = RealImage.of(DEPTH, LENS, POSE).survey(CROP)
    first = look(every, CROP)
    image = RealImage.of(DEPTH, LENS, POSE, workspace=Workspace(*SECOND))
    seen = image.survey(CROP)
    found = look(seen, CROP)
    assert not (found.object & first.object).any()
    np.testing.assert_array_equal(found.object, every.things.labels == 2)
    # The other one is still in the way.
    assert (np.linalg.norm(found.keep_off[:, :2] - (MIDDLE, 0.0), axis=1) < 0.08).any()
    np.testing.assert_array_equal(seen.points, every.points)
    # So it is in the region that shows the same.
    rows, columns = np.nonzero(found.object)
    region = (int(columns.min()) - 3, int(rows.min()) - 3, int(columns.max()) + 3, int(rows.max()) + 3)
    same = look(RealImage.of(DEPTH, LENS, POSE, region=region).survey(CROP), CROP)
    np.testing.assert_array_equal(same.object, found.object)
    np.testing.assert_array_equal(same.keep_off, found.keep_off)


def test_the_frame_is_that_of_the_pose_or_is_named() -> None:
    box = Workspace(*SECOND)
    posed = RealImage.of(DEPTH, LENS, POSE, workspace=box).inside
    assert posed is not None
    # The same pixels in the camera's frame, by their points.
    points = np.linalg.inv(POSE) @ np.array([*np.mean(SECOND, axis=0), 1.0])
    near: Any = Workspace(tuple(points[:3] - 0.1), tuple(points[:3] + 0.1))
    alone = RealImage.of(DEPTH, LENS, None, workspace=near).inside
    named = RealImage.of(DEPTH, LENS, POSE, workspace=Workspace(near.low, near.high, "camera")).inside
    np.testing.assert_array_equal(alone, named)
    assert alone is not None
    assert (alone & posed).any()
    # A table that is found has its origin below the camera, as POSE has.
    found = RealImage.of(DEPTH, LENS, None, workspace=Workspace(*SECOND, "table")).inside
    assert found is not None
    assert (found != posed).mean() < 0.01


def test_a_box_in_which_nothing_is_seen_is_refused() -> None:
    for given, frame in ((POSE, "table"), (None, "camera")):
        with pytest.raises(ConfigError, match=f"from \\(0, 0, 5\\) to \\(1, 1, 6\\) m in the {frame}'s frame, where"):
            RealImage.of(DEPTH, LENS, given, workspace=Workspace((0, 0, 5), (1, 1, 6)))
    unmeasured = DEPTH.copy()
    unmeasured[:4] = 0.0
    with pytest.raises(ConfigError, match="shows nothing to nothing m"):
        RealImage.of(unmeasured, LENS, POSE, region=(0, 0, 320, 4), workspace=Workspace((0, 0, 0), (1, 1, 1)))


def test_masks_and_labels_are_cut_by_the_box(grasper: Any) -> None:
    capture = Capture.read(CAPTURES / "pcl_milk_clorox")
    assert capture.labels is not None
    place, mask = (capture.depth, capture.intrinsics), capture.labels == 2
    around = capture.points(mask)
    box: Any = Workspace(tuple(around.min(axis=0) - 0.01), tuple(around.max(axis=0) + 0.01))
    inside = grasper.find(*place, mask=mask, workspace=box, count=1)
    assert inside.object.sum() == grasper.find(*place, mask=mask, count=1).object.sum()
    labels = grasper.find_all(*place, labels=capture.labels, workspace=box, count=1).labels
    assert (labels == 2).any()
    assert (labels == 2).sum() > 5 * ((labels > 0) & (labels != 2)).sum()
    beside = Workspace((box.high[0], -3.0, 0.0), (3.0, 3.0, 3.0))
    with pytest.raises(ConfigError, match="no pixel of the thing is in the region and the workspace"):
        grasper.find(*place, mask=mask, workspace=beside)
    assert grasper.check(*place, mask=mask, workspace=box) == inside.warnings


def test_commands_servers_and_agents_take_the_same_box(grasper: Any, tmp_path: Path) -> None:
    pytest.importorskip("typer", reason="the command line needs the extra 'cli'")
    from command_line import invoke
    from graspbox.tools.remote import grasp_requests

    capture = Capture.read(CAPTURES / "pcl_milk_clorox")
    assert capture.labels is not None
    around = capture.points(capture.labels == 2)
    corners = [*(around.min(axis=0) - 0.02).round(4).tolist(), *(around.max(axis=0) + 0.02).round(4).tolist()]
    local = grasper.find(capture.depth, capture.intrinsics, workspace=Workspace.of(corners, None), count=1)
    folder, policy = CAPTURES / "pcl_milk_clorox", str(REPOSITORY / "policies" / "panda_clutter")
    words = ["grasp-image", folder / "depth.png", "--camera-info", folder / "capture.json", "--policy", policy]
    boxed = [*words, "--count", "1", "--json", "--workspace", *corners]
    told = json.loads(invoke(boxed).stdout)
    np.testing.assert_allclose(told["grasps"][0]["camera_from_hand"], local.camera_from_hand[0], atol=1e-9)
    request = {"depth": capture.depth, "intrinsics": capture.intrinsics, "count": 1}
    answer = grasp_requests.decide(grasper, {**request, "workspace": [corners[:3], corners[3:]]})
    np.testing.assert_array_equal(answer["camera_from_hand"], local.camera_from_hand)
    named = {"workspace": [corners[:3], corners[3:]], "workspace_frame": "camera"}
    again = grasp_requests.decide(grasper, {**request, **named})
    np.testing.assert_array_equal(again["camera_from_hand"], local.camera_from_hand)
    assert "pass the workspace too" in str(invoke([*words, "--workspace-frame", "table"]).exception)
    pytest.importorskip("pydantic", reason="MCP needs the extra 'mcp'")
    from graspbox.tools.mcp.arguments import GraspImageArguments, parsed

    given = {"depth": "depth.png", "camera_info": "capture.json", "workspace": corners, "workspace_frame": "camera"}
    assert parsed(GraspImageArguments, given).workspace == corners
    with pytest.raises(ConfigError, match="workspace_frame is 'world'"):
        parsed(GraspImageArguments, {**given, "workspace_frame": "world"})
