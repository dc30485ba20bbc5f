"""``graspbox camera``: lines of JSON for the frames of folders and recordings, refused frames, the end, a server."""

import json
import re
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from graspbox import errors
from graspbox.captures import read_capture

pytest.importorskip("typer", reason="the command line needs the extra 'cli'")
pytest.importorskip("onnxruntime", reason="networks run in onnxruntime, from the extra 'onnx'")
pytest.importorskip("PIL.Image", reason="pictures need the extra 'cli'")
from command_line import invoke
from graspbox.policies.grasp_image import ImageGrasper
from interrupting import interrupted

ROOT = Path(__file__).parents[2]
CAPTURES = ROOT / "tests/captures"
POLICY = ROOT / "policies/panda_clutter"
#: Seconds after which a command ends whose frames do not come.
PATIENCE = "60"


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Two captures in a folder, one of them with labels, and their camera."""
    made = tmp_path / "camera"
    made.mkdir()
    shutil.copy(CAPTURES / "sixdof_blue_mug/capture.json", made / "camera.json")
    for name, source in (("a", "sixdof_blue_mug"), ("b", "sixdof_mustard")):
        shutil.copy(CAPTURES / source / "depth.png", made / f"{name}.png")
    return made


def lines(text: str) -> list[dict[str, Any]]:
    return [json.loads(line) for line in text.splitlines()]


def test_each_frame_is_a_line_as_of_grasp_image(folder: Path, tmp_path: Path) -> None:
    out = tmp_path / "frames.jsonl"
    out.write_text('{"before": true}\n')
    words = ["camera", folder, "--policy", POLICY, "--frames", "2", "--count", "2", "--seconds", PATIENCE]
    result = invoke([*words, "--json", "--out", out])
    assert result.exit_code == 0, result.output
    told = lines(result.stdout)
    assert lines(out.read_text()) == [{"before": True}, *told]
    assert [(line["frame"], Path(line["source"]).name, line["skipped"]) for line in told] == [
        (0, "a.png", 0),
        (1, "b.png", 0),
    ]
    grasper = ImageGrasper(POLICY)
    for line in told:
        seen = read_capture(line["source"], intrinsics=folder / "camera.json")
        alone = grasper.find(seen.depth, seen.intrinsics, count=2).to_json()
        assert {name: line[name] for name in alone} == alone
        assert line["time"] == pytest.approx(Path(line["source"]).stat().st_mtime)
        assert line["seconds"] > 0
    first, second, last = result.stderr.splitlines()
    assert re.fullmatch(r"frame 0: 2 grasps, the best at \S+ \S+ \S+ m, success \d+%, \d+ ms", first)
    assert second.startswith("frame 1: ")
    assert re.fullmatch(r"2 frames: 2 answered \(2 with a grasp\), 0 refused; 0 images skipped, median \d+ ms", last)


def test_refused_frames_and_broken_files_do_not_end_the_stream(folder: Path) -> None:
    depth = read_capture(folder / "a.png", intrinsics=folder / "camera.json").depth
    np.save(folder / "0.npy", np.where(depth > 0, 0.5, 0.0))  # a wall: nothing rises above it
    (folder / "00.png").write_bytes(b"nothing")
    words = ["camera", folder, "--policy", POLICY, "--frames", "3", "--seconds", PATIENCE, "--json"]
    result = invoke(words)
    assert result.exit_code == 0, result.output
    told = sorted(lines(result.stdout), key=lambda line: str(line["source"]))
    assert [sorted({"refused", "grasps"} & line.keys()) for line in told] == [["refused"], ["grasps"], ["grasps"]]
    assert f"refused: {told[0]['refused']}" in result.stderr
    assert sum(line["skipped"] for line in told) <= 1
    assert "3 frames: 2 answered (2 with a grasp), 1 refused" in result.stderr
    for name in ("a.png", "b.png"):
        (folder / name).unlink()
    nothing = invoke(["camera", folder, "--policy", POLICY, "--frames", "1", "--seconds", PATIENCE, "--json"])
    assert nothing.exit_code == 1
    assert [sorted({"refused", "grasps"} & line.keys()) for line in lines(nothing.stdout)] == [["refused"]]


def test_labels_of_the_folder_choose_the_objects(folder: Path) -> None:
    shutil.copy(CAPTURES / "pcl_milk_clorox/labels.png", folder / "c_labels.png")
    shutil.copy(CAPTURES / "pcl_milk_clorox/depth.png", folder / "c.png")
    for name in ("a.png", "b.png"):
        (folder / name).unlink()
    info = CAPTURES / "pcl_milk_clorox/capture.json"
    words = ["camera", folder, "--policy", POLICY, "--camera-info", info, "--frames", "1", "--count", "1", "--json"]
    (everything,) = lines(invoke([*words, "--all"]).stdout)
    assert [row["thing"] for row in everything["things"]] == [1, 2, 3]
    (one,) = lines(invoke([*words, "--label", "2"]).stdout)
    seen = read_capture(folder / "c.png", intrinsics=info, labels=folder / "c_labels.png")
    alone = ImageGrasper(POLICY).find(seen.depth, seen.intrinsics, mask=seen.mask(2), count=1)
    assert one["grasps"] == alone.to_json()["grasps"]
    (several,) = lines(invoke(words).stdout)
    assert "choose one of them: --label" in several["refused"]


def test_a_recording_is_played_to_its_end(folder: Path, tmp_path: Path) -> None:
    pytest.importorskip("rosbags", reason="recordings need the extra 'recordings'")
    from test_capture_recordings import ROS2, Messages, write

    seen = read_capture(folder / "a.png", intrinsics=folder / "camera.json")
    lens, ros = seen.intrinsics - [[0, 0, 0.5], [0, 0, 0.5], [0, 0, 0]], Messages(ROS2)
    image = ros.image((seen.depth * 1000).round().astype(np.uint16), "16UC1")
    info = ros.info(size=(seen.depth.shape[1], seen.depth.shape[0]), k=lens.ravel().tolist())
    path = write(tmp_path / "bag", {"/d/image": [image, image], "/d/camera_info": [info]})
    result = invoke(["camera", path, "--policy", POLICY, "--count", "1", "--json"])
    assert result.exit_code == 0, result.output
    first, second = lines(result.stdout)
    assert [(line["frame"], line["time"]) for line in (first, second)] == [(0, 100.0), (1, 101.0)]
    # The best grasp of a still scene stays.
    poses = [np.array(line["grasps"][0]["camera_from_hand"]) for line in (first, second)]
    np.testing.assert_allclose(poses[0], poses[1], atol=1e-9)


def test_wrong_calls_are_refused(folder: Path, tmp_path: Path) -> None:
    np.save(tmp_path / "points.npy", np.zeros((1, 3)))
    words = ["camera", folder, "--policy", POLICY]
    for added, message in (
        (["--keep-off", tmp_path / "points.npy"], "pass --camera-pose, or --camera-height and --tilt"),
        (["--tilt", "30"], "needs both --camera-height and --tilt"),
        (["--topic", "/depth"], "is no recording"),
        (["--all", "--rerun", tmp_path / "a.rrd"], "leave out --rerun or --all"),
        (["--seconds", "-1"], "seconds is -1"),
        (["--all", "--label", "2"], "leave either out"),
        (["--out", tmp_path], "it is a folder"),
    ):
        assert message in str(invoke([*words, *added]).exception)
    served = ["camera", folder, "--policy", "ws://127.0.0.1:1", "--all"]
    assert "a policy on a server takes no --hand, --all" in str(invoke(served).exception)
    (tmp_path / "empty").mkdir()
    empty = invoke(["camera", tmp_path / "empty", "--policy", POLICY, "--seconds", "0.3"])
    assert isinstance(empty.exception, errors.ConfigError)
    assert "gave no frame within 0.3 s" in str(empty.exception)


def test_ctrl_c_ends_with_a_summary(folder: Path, tmp_path: Path) -> None:
    out = tmp_path / "frames.jsonl"
    words = ["graspbox", "camera", str(folder), "--policy", str(POLICY), "--out", str(out)]
    ended = interrupted(f"""
import threading, time
from pathlib import Path
from graspbox.cli import app

def watch(out=Path({str(out)!r})):
    while not out.exists() or out.read_text().count("\\n") < 2:
        time.sleep(0.05)
    ready()

threading.Thread(target=watch, daemon=True).start()
sys.argv = {words!r}
app()
""")
    assert ended.status == 0, ended.stderr
    assert "2 frames: 2 answered" in ended.stderr
    assert "Traceback" not in ended.stderr
    assert [line["frame"] for line in lines(out.read_text())] == [0, 1]


def test_a_served_policy_answers_as_here(folder: Path) -> None:
    from graspbox.tools.remote.policy_serving import PolicyServer
    from graspbox.tools.remote.settings import PolicyServerSettings

    words = ["camera", folder, "--frames", "1", "--count", "2", "--json", "--policy"]
    (here,) = lines(invoke([*words, POLICY]).stdout)
    with PolicyServer(POLICY, PolicyServerSettings(port=0)) as server:
        (there,) = lines(invoke([*words, server.url]).stdout)
        (refused,) = lines(invoke([*words, server.url, "--region", "5", "0", "2", "9"]).stdout)
    assert there.keys() == here.keys()
    assert [grasp.keys() for grasp in there["grasps"]] == [grasp.keys() for grasp in here["grasps"]]
    # Depth is sent as float32.
    np.testing.assert_allclose(there["table_from_camera"], here["table_from_camera"], atol=1e-3)
    assert "left < right" in refused["refused"]


def test_a_served_policy_grasps_what_the_labels_mark(tmp_path: Path) -> None:
    from graspbox.tools.remote.policy_serving import PolicyServer
    from graspbox.tools.remote.settings import PolicyServerSettings

    for source, name in (("depth.png", "c.png"), ("labels.png", "c_labels.png"), ("capture.json", "camera.json")):
        shutil.copy(CAPTURES / "pcl_milk_clorox" / source, tmp_path / name)
    seen = read_capture(tmp_path / "c.png", intrinsics=tmp_path / "camera.json", labels=tmp_path / "c_labels.png")
    words = ["camera", tmp_path, "--frames", "1", "--count", "1", "--json", "--policy"]
    with PolicyServer(POLICY, PolicyServerSettings(port=0)) as server:
        for label in (1, 2):
            (there,) = lines(invoke([*words, server.url, "--label", label]).stdout)
            place = np.array(there["grasps"][0]["camera_from_hand"])[:3, 3]
            away = [np.linalg.norm(seen.points(seen.mask(one)) - place, axis=1).min() for one in (1, 2)]
            assert np.argmin(away) == label - 1, away
        (refused,) = lines(invoke([*words, server.url]).stdout)
    assert "choose one of them" in refused["refused"]


def test_frames_are_recorded_for_rerun(folder: Path, tmp_path: Path) -> None:
    pytest.importorskip("rerun", reason="recordings need rerun-sdk, from the extra 'rerun'")
    from test_rerun import entities, rows_with

    file = tmp_path / "frames.rrd"
    words = ["camera", folder, "--policy", POLICY, "--frames", "2", "--count", "2", "--rerun", file]
    result = invoke(words)
    assert result.exit_code == 0, result.output
    assert rows_with(entities(file), "/world/camera/image", "DepthImage:buffer") == 2
