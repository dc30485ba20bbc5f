"""Tools for agents: used by the protocol's own client, within one folder, with bounds on everything."""

import asyncio
import base64
import io
import json
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import tiny_policy
from command_line import invoke
from graspbox import errors, object_sets
from graspbox.captures import read_capture
from graspbox.captures.files import read_labels
from graspbox.meshes.views import ViewPlan, views
from graspbox.tools.mcp import ToolServer, ToolSettings, serving
from test_cli_files import write_box

mcp = pytest.importorskip("mcp", reason="tools for agents need the extra 'mcp'")

CAN = "procedural:can:0"
INTRINSICS = [230.0, 230.0, 80.0, 60.0]
CAPTURES = Path(__file__).parent.parent / "captures"
#: A real image of three things, in the folder.
THREE = {"depth": "three/depth.png", "camera_info": "three/capture.json"}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Make a folder with a mesh, a depth image, a part, and links that leave it."""
    root = tmp_path_factory.mktemp("agent")
    inside = root / "inside"
    (inside / "parts").mkdir(parents=True)
    (root / "inside-too").mkdir()
    for path in (root / "secret.off", root / "inside-too/box.off", inside / "box.off", inside / "parts/part.off"):
        write_box(path, 0.05, 0.06, 0.1)
    (inside / "link.off").symlink_to(root / "secret.off")
    (inside / "way").symlink_to(root)
    (inside / "loop.off").symlink_to("loop.off")
    (inside / "near.off").symlink_to("parts/part.off")
    (inside / "broken.off").write_text("OFF\n1 2\n")
    (inside / "odd.off").mkdir()
    plan = ViewPlan("random", axis=(-1.0, 0.0, 1.2), cap=0.0, distance=(0.6, 0.6), shift=0.0)
    fov = float(2 * np.arctan(60 / INTRINSICS[0]))
    mesh = object_sets.load(CAN)[0].load()
    seen = views(mesh, plan=plan, count=1, image_size=(120, 160), images="depth", fov=fov)
    np.save(inside / "depth.npy", seen.depth[0])
    np.save(inside / "zeros.npy", np.zeros((4, 4)))
    shutil.copytree(CAPTURES / "pcl_milk_clorox", inside / "three")
    (inside / "bag").mkdir()
    (inside / "bag/metadata.yaml").symlink_to(root / "secret.off")
    tiny_policy.make(root / "policy")
    return inside


@pytest.fixture(scope="module")
def settings(folder: Path) -> ToolSettings:
    objects = ("procedural:can", f"parts=dir:{folder / 'parts'}")
    return ToolSettings(folder, objects, hands=("reflex",), policy=str(folder.parent / "policy"))


def refusal(settings: ToolSettings, name: str, /, **arguments: Any) -> str:
    """Call a tool, and give the sentence of its error."""
    told, pictures = serving.call(settings, name, arguments)
    assert isinstance(told, str), told
    assert pictures == ()
    assert "\n" not in told
    assert str(settings.folder) not in told
    return told


def answer(settings: ToolSettings, name: str, /, **arguments: Any) -> dict[str, Any]:
    told, _ = serving.call(settings, name, arguments)
    assert isinstance(told, dict), told
    json.dumps(told, allow_nan=False)
    return told


def image_of(result: Any) -> Any:
    """Read the one picture of an answer."""
    from PIL import Image

    (content,) = [one for one in result.content if one.type == "image"]
    assert content.mime_type == "image/png"
    with Image.open(io.BytesIO(base64.b64decode(content.data))) as picture:
        assert picture.format == "PNG"
        return picture.copy()


def test_a_client_uses_every_tool(settings: ToolSettings, folder: Path) -> None:
    """Over standard input and output, as programs that run agents do."""
    arguments = ["--folder", str(folder), "--objects", "procedural:can", "--policy", str(settings.policy)]
    command = mcp.StdioServerParameters(
        command=sys.executable, args=["-m", "graspbox", "mcp", *arguments], env=dict(os.environ), cwd=folder
    )

    async def session() -> list[Any]:
        async with mcp.Client(command) as client:
            listed = await client.list_tools()
            planned = await client.call_tool("plan", {"object": CAN, "count": 2})
            (grasp, _) = planned.structured_content["grasps"]
            some = {key: grasp[key] for key in ("object_from_hand", "preshape")}
            return [
                listed,
                planned,
                await client.call_tool("simulate", {"object": CAN, "grasps": [some]}),
                await client.call_tool("look", {"object": CAN, "grasp": some, "width": 96, "height": 64}),
                await client.call_tool("grasp_image", {"depth": "depth.npy", "intrinsics": INTRINSICS, "count": 2}),
                await client.call_tool("look", {"object": "way/secret.off"}),
            ]

    listed, planned, tried, seen, found, refused = asyncio.run(session())
    assert [tool.name for tool in listed.tools] == ["plan", "simulate", "look", "grasp_image"]
    assert all(tool.annotations.read_only_hint for tool in listed.tools)
    assert all(tool.input_schema["additionalProperties"] is False for tool in listed.tools)
    for result in (planned, tried, seen, found):
        assert not result.is_error
        assert json.loads(result.content[0].text) == result.structured_content
        assert len(np.unique(np.asarray(image_of(result).convert("RGB")).reshape(-1, 3), axis=0)) > 50
    assert planned.structured_content["hand"] == "reflex"
    assert len(planned.structured_content["boxes"]) >= 1
    # The simulation tries the very pose of the plan.
    (row,) = tried.structured_content["grasps"]
    assert row["object_from_hand"] == planned.structured_content["grasps"][0]["object_from_hand"]
    assert row["success"] == (row["failure"] == "") == (tried.structured_content["succeeded"] == 1)
    assert image_of(seen).size == (96, 64)
    assert seen.structured_content["grasp_is_free"] is True
    assert len(found.structured_content["grasps"]) == 2
    assert refused.is_error
    assert "leads out of the folder" in refused.content[0].text


def test_planned_grasps_are_tried_and_shown(settings: ToolSettings) -> None:
    told, pictures = serving.call(settings, "simulate", {"object": CAN, "count": 3, "shake": True})
    assert isinstance(told, dict)
    assert told["tried"] == len(told["grasps"]) == 3
    assert told["succeeded"] == sum(row["success"] for row in told["grasps"])
    shaken = [row for row in told["grasps"] if row["shake_shift"] is not None]
    assert len(shaken) == told["succeeded"] > 0
    assert told["grasps"][told["shown"]]["success"]
    assert len(pictures) == 1
    # A hand inside of the object cannot start, so there is nothing to show.
    inside = {"object_from_hand": np.eye(4).tolist(), "preshape": 0}
    told, pictures = serving.call(settings, "simulate", {"object": CAN, "grasps": [inside]})
    assert isinstance(told, dict)
    assert (told["grasps"][0]["failure"], told["shown"], pictures) == ("infeasible", None, ())


def test_mesh_files_of_the_folder_are_objects(settings: ToolSettings) -> None:
    told = answer(settings, "look", object="box.off", mass=0.2, width=64, height=64)
    assert (told["name"], told["mass"], told["watertight"]) == ("box", 0.2, True)
    np.testing.assert_allclose(told["size"], [0.05, 0.06, 0.1], atol=1e-3)
    assert told["center_of_mass"][2] == pytest.approx(0.05, abs=1e-3)
    small = answer(settings, "look", object="near.off", scale=0.5, width=64, height=64)
    np.testing.assert_allclose(small["size"], [0.025, 0.03, 0.05], atol=1e-3)
    assert answer(settings, "look", object=str(settings.folder / "box.off"), width=64, height=64)["name"] == "box"
    assert answer(settings, "look", object="parts", name="part", width=64, height=64)["name"] == "part"


@pytest.mark.parametrize(
    "path",
    ["../secret.off", "link.off", "way/secret.off", "parts/../../secret.off", "../inside-too/box.off", "/etc/x.off"],
)
def test_paths_that_leave_the_folder_are_refused(settings: ToolSettings, path: str) -> None:
    assert "leads out of the folder of this server" in refusal(settings, "look", object=path)
    image = {"depth": path.replace(".off", ".npy"), "intrinsics": INTRINSICS}
    sentence = refusal(settings, "grasp_image", **image)
    # Whether a file exists outside is not told.
    assert "leads out" in sentence or "there is no such depth image" in sentence


@pytest.mark.parametrize(
    ("name", "arguments", "sentence"),
    [
        ("look", {"object": "none.off"}, "none.off: there is no such mesh file; the folder has box.off, broken.off"),
        ("look", {"object": "odd.off"}, "there is no such mesh file"),
        ("look", {"object": "loop.off"}, "is no path of a mesh file"),
        ("look", {"object": "a\0.off"}, "is no path of a mesh file"),
        ("look", {"object": "x" * 900 + ".off"}, "is no path of a mesh file"),
        ("look", {"object": "broken.off"}, "broken.off"),
        ("look", {"object": "procedural:mug:3"}, "does not offer the objects 'procedural:mug:3'; choose from proc"),
        ("look", {"object": "dir:."}, "does not offer the objects"),
        ("look", {"object": "procedural:can"}, "has 10 objects; give the name of one, such as can-000000"),
        ("look", {"object": "parts", "name": "wheel"}, "has no object 'wheel'; it has part"),
        ("look", {"object": CAN, "hand": "barrett"}, "does not offer the hand 'barrett' (str); choose from reflex"),
        ("look", {"object": CAN, "width": 5000}, "width is 5000 (int): input should be less than or equal to 1024"),
        ("look", {"object": CAN, "widht": 64}, "there is no argument 'widht'; did you mean 'width'?"),
        ("look", {"object": CAN, "elevation": "high"}, "elevation is 'high' (str): input should be a valid number"),
        ("look", {"object": CAN, "azimuth": float("nan")}, "azimuth is nan"),
        ("look", {}, "object is missing"),
        ("plan", {"object": CAN, "count": 101}, "count is 101 (int): input should be less than or equal to 100"),
        ("plan", {"object": CAN, "fit": "best"}, "fit is 'best' (str): input should be 'minimum' or 'pca'"),
        ("plan", {"object": CAN, "picture": "yes"}, "picture is 'yes'"),
        ("simulate", {"object": CAN, "grasps": []}, "grasps is [] (list): list should have at least 1 item"),
        (
            "simulate",
            {"object": CAN, "grasps": [{"object_from_hand": [[1, 0, 0, 0]] * 4, "preshape": 0}]},
            "is not a rigid motion",
        ),
        ("simulate", {"object": CAN, "grasps": [{"object_from_hand": [[1]] * 4, "preshape": 0}]}, "object_from_hand.0"),
        ("grasp_image", {"depth": "zeros.npy", "intrinsics": INTRINSICS}, "zeros.npy has no pixel with a depth"),
        ("grasp_image", {"depth": "box.off", "intrinsics": INTRINSICS}, "the file's name must end in .bag, .db3"),
        ("grasp_image", {"depth": "depth.npy", "intrinsics": [1, 2, 3]}, "intrinsics is [1, 2, 3]"),
        ("grasp_image", {"depth": "depth.npy", "intrinsics": [230, 230, 900, 60]}, "CX is 900"),
        ("grasp_image", {"depth": "depth.npy", "intrinsics": INTRINSICS, "region": [5, 0, 2, 9]}, "region is (5, 0"),
        ("grasp_image", {"depth": "depth.npy", "intrinsics": INTRINSICS, "depth_scale": 0}, "depth_scale is 0"),
        ("grasp_image", {"depth": "depth.npy"}, "depth.npy has no intrinsics; pass them"),
        ("grasp_image", {"depth": "bag"}, "'bag/metadata.yaml' leads out of the folder"),
        ("grasp_image", {"depth": "parts"}, "parts is a folder without metadata.yaml"),
        (
            "grasp_image",
            {"depth": "nothing.mcap"},
            "nothing.mcap: there is no such depth image; the folder has depth.npy",
        ),
        (
            "grasp_image",
            {"depth": "depth.npy", "intrinsics": INTRINSICS, "topic": "/depth"},
            "is no recording; topic, time",
        ),
        ("grasp_image", {"depth": "depth.npy", "camera_info": "way/camera.yaml"}, "leads out of the folder"),
        ("grasp_image", {"depth": "depth.npy", "camera_info": "box.off"}, "'box.off' is no file of intrinsics"),
        ("grasp_image", {**THREE, "intrinsics": INTRINSICS}, "intrinsics and camera_info both state the intrinsics"),
        ("grasp_image", {**THREE, "mask": "three/labels.png"}, "marks no single thing: it holds the labels 1, 2, 3"),
        (
            "grasp_image",
            {**THREE, "labels": "three/labels.png"},
            "the labels of three/depth.png are 1, 2, 3; choose one",
        ),
        ("grasp_image", {**THREE, "labels": "three/labels.png", "label": 7}, "has the label 7; choose from 1, 2, 3"),
        ("grasp_image", {**THREE, "label": 2}, "label chooses a thing of labels; pass both"),
        ("grasp_image", {**THREE, "all": True, "mask": "three/labels.png"}, "all asks for every thing, mask and label"),
    ],
    ids=lambda value: str(value)[:60],
)
def test_spoilt_arguments_have_a_sentence(
    settings: ToolSettings, name: str, arguments: dict[str, Any], sentence: str
) -> None:
    assert sentence in refusal(settings, name, **arguments)


def test_large_files_are_refused_unread(settings: ToolSettings, tmp_path: Path) -> None:
    own = replace(settings, folder=tmp_path)
    with (tmp_path / "big.stl").open("wb") as file:
        file.truncate(65 << 20)
    sentence = refusal(own, "look", object="big.stl")
    assert "big.stl: it has 68157440 bytes; this server reads at most 67108864" in sentence
    np.save(tmp_path / "wide.npy", np.full((3073, 4096), 700, dtype=np.uint16))
    sentence = refusal(own, "grasp_image", depth="wide.npy", intrinsics=[2300, 2300, 2048, 1536])
    assert "wide.npy has more than 12582912 pixels; pass a smaller image" in sentence
    (tmp_path / "bag").mkdir()
    for name in ("metadata.yaml", "bag_0.db3"):
        with (tmp_path / "bag" / name).open("wb") as file:
            file.truncate(33 << 20)
    assert "bag: it has 69206016 bytes" in refusal(own, "grasp_image", depth="bag")


def test_things_of_a_real_image_are_grasped(settings: ToolSettings, folder: Path) -> None:
    labels = {"labels": "three/labels.png", "count": 2}
    told, pictures = serving.call(settings, "grasp_image", {**THREE, **labels, "all": True})
    assert isinstance(told, dict)
    assert [row["thing"] for row in told["things"]] == [1, 2, 3]
    assert told["shown"] == told["order"][0]["thing"]
    assert len(pictures) == 1
    marked = answer(settings, "grasp_image", **THREE, **labels, label=2, picture=False)
    np.save(folder / "mask.npy", np.asarray(read_labels(folder / "three/labels.png") == 2))
    assert answer(settings, "grasp_image", **THREE, mask="mask.npy", count=2, picture=False) == marked
    found = answer(settings, "grasp_image", **THREE, all=True, count=1, picture=False)
    assert len(found["things"]) >= 3
    one = answer(settings, "grasp_image", **THREE, count=1, picture=False)
    assert len(one["grasps"]) == 1


def test_clouds_of_the_folder_are_depth_images(settings: ToolSettings, folder: Path) -> None:
    seen = read_capture(folder / "three/depth.png", intrinsics=folder / "three/capture.json")
    np.save(folder / "cloud.npy", seen.points())
    told = answer(settings, "grasp_image", depth="cloud.npy", count=1, picture=False)
    assert any("rendered" in warning for warning in told["warnings"])
    assert len(told["grasps"]) == 1


def test_recordings_of_the_folder_are_depth_images(settings: ToolSettings, folder: Path) -> None:
    """A folder of ROS 2, and the file in it."""
    pytest.importorskip("rosbags", reason="recordings need the extra 'recordings'")
    from test_capture_recordings import ROS2, Messages, write

    seen = read_capture(folder / "three/depth.png", intrinsics=folder / "three/capture.json")
    k = seen.intrinsics.copy()
    k[:2, 2] -= 0.5  # pixel centres of ROS are integers
    ros, millimetres = Messages(ROS2), (seen.depth * 1000).round().astype(np.uint16)
    size = (seen.depth.shape[1], seen.depth.shape[0])
    info = ros.info(size=size, k=k.ravel(), p=np.hstack([k, np.zeros((3, 1))]).ravel())
    topics = {"/front/image_rect": [ros.image(millimetres, "16UC1")], "/front/camera_info": [info]}
    topics["/side/image_rect"] = topics["/front/image_rect"] * 2
    write(folder / "scan", topics)
    (file,) = (folder / "scan").glob("*.mcap")
    for depth in ("scan", f"scan/{file.name}"):
        assert "several topics with depth" in refusal(settings, "grasp_image", depth=depth)
        told = answer(settings, "grasp_image", depth=depth, topic="/front/image_rect", count=1, picture=False)
        assert len(told["grasps"]) == 1
        late = refusal(settings, "grasp_image", depth=depth, topic="/front/image_rect", time=9.0)
        assert "has no message from 9.0 s on" in late


def asleep(_settings: ToolSettings, name: str, _arguments: dict[str, Any]) -> tuple[dict[str, Any], tuple[bytes, ...]]:
    """Stand for a tool that never ends, one that ends its process, and one with a bug."""
    if name == "plan":
        time.sleep(600)
    if name == "simulate":
        os._exit(1)
    raise KeyError(name)


def test_long_calls_and_crashes_end(settings: ToolSettings, monkeypatch: pytest.MonkeyPatch) -> None:
    """The process of the tools is ended, and the next call has another one."""
    server = ToolServer(replace(settings, time_limit=1.0))
    # A generous limit, but for the call that never ends.
    limits = {"plan": 1.0}

    async def session(names: Sequence[str]) -> list[Any]:
        results = []
        async with mcp.Client(server.server) as client:
            for name in names:
                server.settings = replace(settings, time_limit=limits.get(name, 100.0))
                results.append(await client.call_tool(name, {"object": CAN}))
            monkeypatch.undo()
            server.settings = settings
            results.append(await client.call_tool("look", {"object": CAN, "width": 64, "height": 64}))
            results.append(await client.call_tool("shell", {}))
        return results

    monkeypatch.setattr(serving, "call", asleep)
    *ended, after, unknown = asyncio.run(session(["plan", "simulate", "look"]))
    sentences = [
        "plan took more than 1 s and was ended; ask for less, or raise --time-limit",
        "the process that ran simulate has ended",
        "look failed through a bug in graspbox",
    ]
    for result, sentence in zip(ended, sentences, strict=True):
        assert result.is_error
        assert result.content[0].text.startswith(sentence)
    assert not after.is_error
    assert unknown.is_error
    assert "there is no tool 'shell'; choose from plan" in unknown.content[0].text


def test_no_policy_no_tool(settings: ToolSettings) -> None:
    assert ToolServer(replace(settings, policy=None)).names == ["plan", "simulate", "look"]


@pytest.mark.parametrize(
    ("option", "value", "complaint"),
    [
        ("--folder", "nowhere", "there is no such folder for the tools to read"),
        ("--objects", "dir:.", "clients name no path, so give it a name"),
        ("--hands", "claw", "hands has 'claw'; choose from"),
        ("--policy", "nowhere", "nowhere"),
        ("--time-limit", "0", "--time-limit"),
    ],
)
def test_the_command_checks_its_options(option: str, value: str, complaint: str) -> None:
    result = invoke(["mcp", option, value])
    assert result.exit_code != 0
    said = str(result.exception) if isinstance(result.exception, errors.GraspboxError) else result.output
    assert complaint in " ".join(said.split())


@pytest.mark.parametrize("stop", ["close", "interrupt"])
def test_the_command_ends(folder: Path, stop: str) -> None:
    """When its input is closed, and after Ctrl-C, in silence."""
    command = [sys.executable, "-m", "graspbox", "mcp", "--folder", str(folder)]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as process:
        assert process.stdin is not None
        assert process.stdout is not None
        hello = {"protocolVersion": "2025-06-18", "capabilities": {}, "clientInfo": {"name": "test", "version": "1"}}
        request = {"jsonrpc": "2.0", "id": 1, "method": "initialize", "params": hello}
        process.stdin.write(json.dumps(request).encode() + b"\n")
        process.stdin.flush()
        assert json.loads(process.stdout.readline())["result"]["serverInfo"]["name"] == "graspbox"
        if stop == "close":
            process.stdin.close()
        else:
            process.send_signal(signal.SIGINT)
        assert process.wait(timeout=60) == (0 if stop == "close" else 130)
        assert process.stdout.read() == b""
        assert process.stderr is not None
        assert b"Traceback" not in process.stderr.read()


def test_the_extra_is_named(settings: ToolSettings, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "mcp", None)
    with pytest.raises(errors.MissingExtraError, match=r"pip install 'graspbox\[mcp\]'"):
        ToolServer(settings)
