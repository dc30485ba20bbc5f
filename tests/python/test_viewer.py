"""The viewer: each kind of page against a real server without a browser; filters, traces, changed and broken files."""

import shutil
import socket
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import graspbox
import tiny_policy
from command_line import invoke
from graspbox import errors, object_sets
from graspbox._common.entry_points import entry_points_of
from graspbox.captures import read_capture
from graspbox.policies.grasp_image import SceneGrasps
from graspbox.simulation.path_motion import PathMotion
from graspbox.tools.commands.view import open_view
from graspbox.tools.hand_links import HandLinks
from graspbox.tools.viewer import Viewer, ViewerOptions, show
from graspbox.tools.viewer.grasp_points import GraspPoints
from graspbox.tools.viewer.playback import Playback
from graspbox.tools.viewer.sources import PAGES, page_of

ROOT = Path(__file__).parents[2]
CAN = "procedural:can:0"


@contextmanager
def shown(what: Any, **options: Any) -> Iterator[Any]:
    """Show something on a free port; gives the viewer, typed loosely since pages differ."""
    with show(what, port=0, **options) as viewer:
        yield viewer


def wait_for(true: Callable[[], bool]) -> None:
    """Wait for work in the background."""
    end = time.monotonic() + 60.0
    while not true():
        assert time.monotonic() < end
        time.sleep(0.02)


@pytest.fixture(scope="module")
def can() -> Iterator[Any]:
    """Show a can, with its best 8 poses tried."""
    with shown(CAN, poses=8) as viewer:
        wait_for(lambda: int((viewer.page.failure[viewer.page.plan.feasible] != "?").sum()) == 8)
        yield viewer


def test_an_object_is_shown_with_its_poses_by_outcome(can: Viewer) -> None:
    page: Any = can.page
    scene = can.canvas.scene
    assert len(scene.get_handle_by_name("/object/boxes").points) == 12 * len(page.plan.tree)
    assert page.poses.shown == 8
    tried = page.plan.poses[:8]
    wanted = page.scene.simulate(tried, page.plan.preshape[:8])
    assert (page.failure[:8] == np.where(wanted.success, "", wanted.failure)).all()
    colors = {tuple(color) for color in page.poses.node.batched_colors.tolist()}
    assert ((0, 158, 115) in colors) == bool(wanted.success.any())
    assert f"{int(wanted.success.sum())} succeed" in can.canvas.status.content
    assert f"{int(page.plan.feasible.sum()) - 8} not tried" in page.legend.content


def test_the_page_opens_on_the_best_grasp_and_returns_to_it(can: Viewer) -> None:
    page: Any = can.page
    best = page.best_grasp()
    assert best == int(np.flatnonzero(page.failure == "")[0])
    at_best = (page.rest @ page.plan.poses[best])[:3, 3]
    assert page.hand.visible
    assert page.back.disabled
    np.testing.assert_allclose(page.hand.root.position, at_best)
    other = int(np.flatnonzero(page.plan.feasible)[-1])
    page.select(other)
    assert page.poses.shown == 0
    assert not page.back.disabled
    page.player.playback.seek(len(page.player.trace.time) - 1)
    page.show_all()
    assert page.player.trace is None
    assert page.poses.shown == 8
    np.testing.assert_allclose(page.hand.root.position, at_best)
    np.testing.assert_allclose(page.node.position, page.rest[:3, 3])
    assert "the best grasp" in page.verdict.content


def test_filters_change_what_is_shown(can: Viewer) -> None:
    page: Any = can.page
    page.best.value = len(page.plan)
    every = page.poses.shown
    assert every == int(page.plan.feasible.sum())
    page.box.value = "whole"
    assert page.poses.shown == int((page.plan.feasible & (page.plan.box == len(page.plan.tree))).sum())
    page.box.value = "all"
    page.outcome.value = "success"
    assert page.poses.shown == int((page.failure == "").sum())
    page.outcome.value = "not tried"
    assert page.poses.shown == int((page.failure == "?").sum())
    page.outcome.value = "all"
    low, high = page.score.value
    page.score.value = ((low + high) / 2, high)
    assert 0 < page.poses.shown < every
    page.score.value = (low, high)
    page.show_infeasible.value = True
    assert page.poses.shown == len(page.plan)
    page.show_infeasible.value = False
    page.best.value = 8


def test_the_trace_of_a_trial_moves_hand_and_object(can: Viewer) -> None:
    page: Any = can.page
    won = int(np.flatnonzero(page.failure == "")[0])
    page.select(won)
    player, trace = page.player, page.player.trace
    assert len(trace.time) > 100
    assert page.verdict.content.startswith(f"pose {won + 1}: **success")
    finger = next(iter(page.hand.links.values()))
    before, height = finger.wxyz.copy(), page.node.position[2]
    player.playback.seek(len(trace.time) - 1)
    assert page.node.position[2] > height + 0.1
    assert np.abs(finger.wxyz - before).max() > 0.01
    np.testing.assert_allclose(page.hand.root.position, trace.world_from_hand[-1, :3, 3])
    assert can.canvas.scene.get_handle_by_name("/contacts").visible
    assert "tactile" in player.readings.content
    player.with_contacts.value = False
    assert not can.canvas.scene.get_handle_by_name("/contacts").visible
    player.with_contacts.value = True
    player.playback.toggle()  # at the end: from the beginning
    wait_for(lambda: 0 < player.playback.slider.value < len(trace.time) - 1 or player.playback.play.label == "play")
    player.playback.stop()
    page.show_poses.value = True


def test_a_path_moves_arm_hand_and_object_on_a_time_slider(monkeypatch: pytest.MonkeyPatch) -> None:
    mesh = object_sets.load("procedural:can:3")[0].load()
    planned = graspbox.plan(mesh, hand="panda_gripper", seed=0)
    rest, base = planned.world_from_object, np.eye(4)
    base[0, 3] = -0.5
    other = rest.copy()
    other[:2, 3] += (0.1, 0.3)
    around = graspbox.Arrangement("packed", (0,), (mesh,), other[None], np.zeros((0, 4, 4)), np.zeros((0, 3)))
    path = planned.path("fr3", base, mesh=mesh, neighbours=around)
    with pytest.raises(errors.ConfigError, match="arm is 'ur5e', but the trajectory is that of 'fr3'"):
        PathMotion.of(path, "ur5e", "panda_gripper", base, target=(mesh, rest))
    motion = PathMotion.of(path, "fr3", "panda_gripper", base, target=(mesh, rest), neighbours=around)
    with shown(motion) as viewer:
        page: Any = viewer.page
        assert page.title == "path"
        last, (link, node) = len(motion.times) - 1, list(page.links.items())[-1]
        np.testing.assert_allclose(node.position, motion.link_frames(0)[link, :3, 3], atol=1e-6)
        page.playback.seek(last)
        np.testing.assert_allclose(node.position, motion.link_frames(last)[link, :3, 3], atol=1e-6)
        np.testing.assert_allclose(page.node.position, rest[:3, 3] + (0.0, 0.0, 0.1), atol=1e-3)
        np.testing.assert_allclose(viewer.canvas.scene.get_handle_by_name("/others/0").position, other[:3, 3])
        assert page.reading.content.startswith(f"lift, {path.duration:.2f} s")
        page.playback.toggle()
        wait_for(lambda: 0 < page.playback.slider.value < last or page.playback.play.label == "play")
    # The option --view finds the same viewer.
    assert entry_points_of("graspbox.viewers")["browser"].load() is open_view
    viewed: list[PathMotion] = []
    monkeypatch.setattr("graspbox.cli.arm.path.load_entry_point", lambda *_: viewed.append)
    assert invoke(["arm", "path", "procedural:can:3", "--base", "-0.5", "0", "0", "0", "--view"]).exit_code == 0
    assert viewed[0].arm.name == "fr3"


def test_a_playback_draws_nothing_of_samples_that_were_replaced(can: Viewer) -> None:
    drawn: list[int] = []
    begun, go_on = threading.Event(), threading.Event()

    def draw(sample: int) -> None:
        drawn.append(sample)
        if len(drawn) == 3:
            begun.set()
            go_on.wait(10.0)

    playback = Playback(can.canvas, draw, 0.001)
    playback.load(5000)
    playback.toggle()
    assert begun.wait(10.0)
    threading.Timer(0.1, go_on.set).start()
    with can.canvas.lock:
        time.sleep(0.1)  # the player waits with its next sample
        drawn.clear()
        playback.load(5)
    time.sleep(0.3)
    assert drawn == [0]
    assert not playback.plays
    assert playback.play.label == "play"


def test_a_pose_that_does_not_exist_is_an_error_in_the_page(can: Viewer) -> None:
    page: Any = can.page
    page.outcome.value = "secure"
    page.score.value = (page.score.value[1], page.score.value[1])
    can.canvas.under_lock(page._next)(None)
    assert "the filters keep no pose; widen them" in can.canvas.problem.content
    page.outcome.value = "all"  # a change removes the message
    assert not can.canvas.problem.visible
    page.score.value = (float(page.plan.score.min()), page.score.max)


def test_ten_thousand_poses_are_one_node(can: Viewer) -> None:
    page: Any = can.page
    rows = np.arange(10_000) % len(page.plan)
    poses = GraspPoints(can.canvas, "/many", page.rest @ page.plan.poses[rows], page.select)
    colors = np.zeros((10_000, 3), dtype=np.uint8)
    poses.show(np.ones(10_000, dtype=np.bool_), colors)
    assert (len(poses), poses.shown) == (10_000, 10_000)
    poses.show(rows < 10, colors)
    assert poses.shown == int((rows < 10).sum()) == len(poses.node.batched_positions)
    poses.remove()
    assert can.canvas.scene.get_handle_by_name("/many") is None


@pytest.mark.parametrize("name", graspbox.Hand.names())
def test_links_agree_with_the_core(name: str) -> None:
    hand = graspbox.load_hand(name)
    links = HandLinks(hand)
    positions = hand.closed(hand.preshape_limits[1], 0.4)
    origins = links.frames(positions)[:, :3, 3]
    for joint in hand.joint_frames(positions)[0]:
        assert np.abs(origins - joint[:3, 3]).max(axis=1).min() < 1e-12
    for tendon in links.tendons:
        assert links.route(tendon, links.frames(positions)).shape[1:] == (2, 3)


def test_a_hand_moves_with_its_sliders() -> None:
    with shown("reflex") as viewer:
        page = viewer.page
        before = {row: node.wxyz.copy() for row, node in page.drawn.links.items()}
        page.closed.value = 0.5
        np.testing.assert_allclose(page.joints, page.hand.closed(0.0, 0.5), atol=1e-6)
        moved = [row for row, node in page.drawn.links.items() if np.abs(node.wxyz - before[row]).max() > 1e-3]
        assert len(moved) >= 6
        assert len(page.sensors.batched_positions) == 27
        assert len(page.tendons) == 3
        page.show_tendons.value = False
        assert not any(node.visible for node in page.tendons)
        page.show_swept.value = True
        assert len(page._swept[0].points) > 50


def test_changed_files_of_a_hand_are_read_again(tmp_path: Path) -> None:
    for name in ("reflex.urdf", "hand.toml"):
        shutil.copy(ROOT / "env/hand/assets/reflex" / name, tmp_path)
    urdf, toml = tmp_path / "reflex.urdf", tmp_path / "hand.toml"
    good = toml.read_text()
    with shown(f"{urdf},{toml}") as viewer:
        page = viewer.page
        assert "**reflex**" in viewer.canvas.status.content
        toml.write_text(good.replace('name = "reflex"', 'name = "mine"', 1))
        wait_for(lambda: "**mine**" in viewer.canvas.status.content)
        toml.write_text(good.replace("max_tension", "max_tensoin", 1))
        wait_for(lambda: "max_tensoin" in viewer.canvas.problem.content)
        assert viewer.canvas.problem.visible
        assert "The last valid version is kept." in viewer.canvas.problem.content
        assert page.hand.name == "mine"
        toml.write_text(good)
        wait_for(lambda: not viewer.canvas.problem.visible and page.hand.name == "reflex")


def test_a_hand_that_is_broken_from_the_beginning_waits_for_its_correction(tmp_path: Path) -> None:
    for name in ("reflex.urdf", "hand.toml"):
        shutil.copy(ROOT / "env/hand/assets/reflex" / name, tmp_path)
    toml = tmp_path / "hand.toml"
    good = toml.read_text()
    toml.write_text("name =")
    with shown((tmp_path / "reflex.urdf", toml)) as viewer:
        assert viewer.canvas.problem.visible
        toml.write_text(good)
        wait_for(lambda: viewer.page.hand is not None and not viewer.canvas.problem.visible)


def test_an_environment_is_stepped_by_a_policy_and_by_keys() -> None:
    with shown("graspbox/Grasp-v0", policy="planner", objects=CAN) as viewer:
        page = viewer.page
        start = page.drawn.root.position.copy()
        for _ in range(5):
            page.step()
        assert page.steps == 5
        assert np.abs(page.drawn.root.position - start).max() > 1e-3
        assert page.images["rgb"].image.std() > 5
        assert page.images["depth"].image.shape == (128, 128, 3)
        page.mode.value = "keys"
        page.press("C")
        assert page.steps == 9
        joints = page.drawn.joints.copy()
        page.press("C")
        assert np.abs(page.drawn.joints - joints).max() > 0.05
        page.toggle()
        wait_for(lambda: page.steps > 13)
        page.toggle()
        page.reset()
        assert page.steps == 0


def test_a_decision_is_shown_with_its_outcome() -> None:
    with shown("graspbox/GraspPose-v0", policy="planner", objects=CAN) as viewer:
        assert not viewer.page.drawn.visible
        viewer.page.step()
        assert viewer.page.drawn.visible
        assert "**success**" in viewer.canvas.status.content


def test_objects_that_are_lifted_out_disappear() -> None:
    settings = {"policy": "scene_planner", "hand": "panda_gripper", "objects": "procedural:box:0-3", "seed": 0}
    with shown("graspbox/Clear-v0", layout="bin", objects_per_scene=3, **settings) as viewer:
        page, scene = viewer.page, viewer.canvas.scene
        assert len(page.objects.nodes) == page.info["remaining"] == 3
        assert scene.get_handle_by_name("/walls") is not None
        assert not page.drawn.visible
        left = []
        while not page.done:
            page.step()
            left.append(page.info["remaining"])
            found = page.native.arrangement()
            for node, pose in zip(page.objects.nodes, found.world_from_objects, strict=True):
                np.testing.assert_allclose(node.position, pose[:3, 3], atol=1e-6)
            assert scene.get_handle_by_name(f"/objects/{len(found)}") is None
            assert f"{page.info['cleared']} cleared, {left[-1]} left" in viewer.canvas.status.content
            assert page.drawn.visible
        assert left[-1] < 3
        page.step()
        assert page.steps == 1
        page.reset()
        assert len(page.objects.nodes) == 3


@pytest.mark.parametrize("env_id", ["graspbox/Grasp-v0", "graspbox/GraspPose-v0"])
def test_a_target_is_shown_among_others(env_id: str) -> None:
    """The target has another colour; where an episode goes on, all objects are where the environment has them."""
    settings = {"policy": "planner", "objects": "procedural:can:0-3", "seed": 1}
    with shown(env_id, layout="pile", objects_per_scene=3, **settings) as viewer:
        page = viewer.page
        found = page.native.arrangement()
        colors = [tuple(node.color) for node in page.objects.nodes]
        assert len(colors) == len(found) > 1
        assert colors.count(colors[found.target]) == 1
        for _ in range(12):
            page.step()
            if env_id == "graspbox/Grasp-v0":
                now = page.native.arrangement().world_from_objects
                np.testing.assert_allclose([node.position for node in page.objects.nodes], now[:, :3, 3], atol=1e-6)


@pytest.fixture(scope="module")
def depth_image(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, tuple[float, float, float, float]]:
    """Render a depth image of a mug; gives it with its intrinsics."""
    mesh = object_sets.load("procedural:mug:3")[0].load()
    seen = graspbox.views(
        mesh, count=1, image_size=(240, 320), world_from_object=graspbox.Scene(mesh).world_from_object
    )
    path = tmp_path_factory.mktemp("image") / "depth.npy"
    np.save(path, seen.depth[0])
    lens = seen.intrinsics
    return path, (lens[0, 0], lens[1, 1], lens[0, 2], lens[1, 2])


def test_a_depth_image_is_shown_with_the_grasps_of_a_policy(
    depth_image: tuple[Path, tuple[float, float, float, float]],
) -> None:
    path, lens = depth_image
    with pytest.raises(errors.ConfigError, match=r"has no intrinsics; pass them: FX FY CX CY .*--intrinsics"):
        show(path, port=0)
    with pytest.raises(errors.ConfigError, match="an array needs intrinsics"):
        show(np.load(path), port=0)
    with pytest.raises(errors.ConfigError, match="both state the intrinsics"):
        show(path, port=0, intrinsics=lens, camera_info="camera.json")
    with shown(path, intrinsics=lens, policy=str(ROOT / "policies/depth")) as viewer:
        page = viewer.page
        wait_for(lambda: "tilted down" in viewer.canvas.status.content or viewer.canvas.problem.visible)
        assert not viewer.canvas.problem.visible
        assert page.poses.shown == len(page.grasps) > 3
        np.testing.assert_allclose(page.hand.root.position, page.grasps.table_from_hand[0, :3, 3])
        assert len(viewer.canvas.scene.get_handle_by_name("/crop/object").vertices) > 100
        page.least.value = round(float(np.median(page.grasps.success)), 2)
        assert page.poses.shown == int((page.grasps.success >= page.least.value).sum())
    with shown(page.grasps) as viewer:
        assert viewer.page.poses.shown == len(page.grasps)


@pytest.fixture(scope="module")
def tiny(tmp_path_factory: pytest.TempPathFactory) -> str:
    pytest.importorskip("onnxruntime", reason="networks run in onnxruntime, from the extra 'onnx'")
    folder = tmp_path_factory.mktemp("tiny")
    tiny_policy.make(folder)
    return str(folder)


def test_all_things_of_a_real_image_are_shown(tiny: str) -> None:
    """The choice of a thing filters the points, and its crop, pixels and best grasp are shown."""
    folder = ROOT / "tests/captures/pcl_milk_clorox"
    options = {"camera_info": folder / "capture.json", "policy": tiny}
    with shown(folder / "depth.png", mask=folder / "labels.png", **options) as viewer:
        page = viewer.page
        wait_for(lambda: "of 3 things" in viewer.canvas.status.content or viewer.canvas.problem.visible)
        assert not viewer.canvas.problem.visible
        scene = page.scene
        assert page.thing.options == ("all", "1", "2", "3")
        assert page.thing.visible
        assert not page.everything.visible
        assert page.poses.shown == len(page.rows) == sum(len(one) for one in scene.grasps.values())
        best, rank = scene.best()[0]
        np.testing.assert_allclose(page.hand.root.position, scene.grasps[best].table_from_hand[rank, :3, 3])
        for thing, grasps in scene.grasps.items():
            page.thing.value = str(thing)
            assert page.poses.shown == page.rank.max == len(grasps)
            assert page.grasps is grasps
            np.testing.assert_allclose(page.hand.root.position, grasps.table_from_hand[0, :3, 3])
            np.testing.assert_allclose(page.crop.position, grasps.table_from_crop[:3, 3])
            page.rank.value = 2
            np.testing.assert_allclose(page.hand.root.position, grasps.table_from_hand[1, :3, 3])
            assert f"thing {thing}, " in page.reading.content
        page.thing.value = "all"
        assert page.poses.shown == len(page.rows)
    with shown(scene) as viewer:
        assert viewer.page.poses.shown == len(page.rows)
    with shown(folder / "depth.png", **options) as viewer:
        page = viewer.page
        wait_for(lambda: "tilted down" in viewer.canvas.status.content or viewer.canvas.problem.visible)
        assert page.everything.visible
        assert not page.thing.visible
        before = len(page.rows)
        page._find_all()
        wait_for(lambda: " things" in viewer.canvas.status.content or viewer.canvas.problem.visible)
        assert not viewer.canvas.problem.visible
        assert page.thing.visible
        assert len(page.rows) > before


def test_distances_and_limits_are_those_of_other_commands(
    depth_image: tuple[Path, tuple[float, float, float, float]], monkeypatch: pytest.MonkeyPatch
) -> None:
    """A warning advises to read an image with --depth-is distance."""
    path, lens = depth_image
    matrix, options = (
        np.array([[lens[0], 0, lens[2]], [0, lens[1], lens[3]], [0, 0, 1]]),
        ViewerOptions(intrinsics=lens),
    )
    depths = read_capture(path, intrinsics=matrix).depth
    near = float(np.quantile(depths[depths > 0], 0.2))
    chosen = replace(options, depth_is="distance", limits=(near, 5.0))
    wanted = read_capture(path, intrinsics=matrix, depth_is="distance", limits=(near, 5.0))
    assert (wanted.depth != depths).any()
    for source in (path, np.load(path)):
        np.testing.assert_array_equal(page_of(source, chosen)[1].depth, wanted.depth)
        np.testing.assert_array_equal(page_of(source, options)[1].depth, depths)
        with pytest.raises(errors.ConfigError, match="depth_is is 'ray'; choose from z, distance"):
            page_of(source, replace(options, depth_is="ray"))  # type: ignore[arg-type]
    given: dict[str, Any] = {}

    def keep(source: str, **all_options: Any) -> Viewer:
        given.update(all_options)
        raise errors.ConfigError("enough")

    monkeypatch.setattr("graspbox.tools.viewer.show", keep)
    words = [
        "view",
        path,
        "--intrinsics",
        *lens,
        "--depth-is",
        "distance",
        "--limits",
        near,
        "5",
        "--camera-pose",
        "t.npy",
    ]
    assert str(invoke(words).exception) == "enough"
    assert (given["depth_is"], given["limits"], given["intrinsics"]) == ("distance", (near, 5.0), lens)
    assert given["camera_pose"] == Path("t.npy")


def test_clouds_and_meshes_are_told_apart(tmp_path: Path) -> None:
    folder = ROOT / "tests/captures/pcl_milk_clorox"
    seen = read_capture(folder / "depth.png", intrinsics=folder / "capture.json")
    points = seen.points()
    header = f"ply\nformat ascii 1.0\nelement vertex {len(points)}\n"
    header += "".join(f"property float {axis}\n" for axis in "xyz")
    with (tmp_path / "cloud.ply").open("w") as file:
        file.write(f"{header}end_header\n")
        np.savetxt(file, points, fmt="%.4f")
    with shown(tmp_path / "cloud.ply") as viewer:
        assert viewer.page.title == "depth image"
        assert "warning: " in viewer.canvas.status.content
    with shown(seen) as viewer:
        assert "name a policy" in viewer.canvas.status.content
    cube = "0 0 0\n0.1 0 0\n0 0.1 0\n0 0 0.1\n3 0 2 1\n3 0 1 3\n3 1 2 3\n3 0 3 2\n"
    mesh = (
        header.replace(str(len(points)), "4") + "element face 4\nproperty list uchar int vertex_indices\nend_header\n"
    )
    (tmp_path / "mesh.ply").write_text(mesh + cube)
    with shown(tmp_path / "mesh.ply", poses=0) as viewer:
        assert viewer.page.title == "object"


def test_things_without_grasps_are_no_page() -> None:
    with pytest.raises(errors.ConfigError, match=r"no thing of the image has grasps \(thing 3: too far\)"):
        show(SceneGrasps(np.zeros((2, 2), dtype=np.int64), {}, {3: "too far"}), port=0)


def test_a_gallery_shows_names_and_opens_objects() -> None:
    with shown("procedural:mug:0-3") as viewer:
        page = viewer.page
        wait_for(lambda: len(page.nodes) == 4)
        assert viewer.canvas.scene.get_handle_by_name("/names/mug-000002").text == "mug-000002"
        page.choose("mug-000002")
        assert "**mug-000002**" in page.reading.content
        assert page.nodes["mug-000002"].color != page.nodes["mug-000001"].color
        page._plan()
        wait_for(lambda: viewer.page.title == "object" and "mug-000002" in viewer.canvas.status.content)
        viewer._go_back()
        wait_for(lambda: viewer.page.title == "object set" and len(viewer.page.nodes) == 4)


def test_a_saved_plan_is_shown(tmp_path: Path) -> None:
    mesh = object_sets.load(CAN)[0].load()
    plan = graspbox.plan(mesh).best(30)
    plan.save(tmp_path / "plan.json")
    with shown(tmp_path / "plan.json", poses=0) as viewer:
        assert viewer.page.plan == plan
    with shown((mesh, plan), poses=0) as viewer:
        assert viewer.page.plan == plan
    with pytest.raises(errors.ObjectSetError, match="the mesh of 'procedural:can:1' differs"):
        show(tmp_path / "plan.json", port=0, objects="procedural:can:1")


def test_what_cannot_be_viewed_is_refused(tmp_path: Path) -> None:
    with pytest.raises(errors.ObjectSetError, match="names nothing that can be viewed; pass one of: "):
        show("no-such-thing", port=0)
    (tmp_path / "grasps.json").write_text("{}")
    for path in (tmp_path, tmp_path / "grasps.json"):
        with pytest.raises(errors.ConfigError, match=f"`graspbox report {path}`"):
            show(path, port=0)
    with pytest.raises(errors.ConfigError, match="source is of the type int; pass one of"):
        show(3, port=0)
    with pytest.raises(errors.ConfigError, match="there is no environment 'graspbox/Nothing-v0'"):
        show("graspbox/Nothing-v0", port=0)
    with pytest.raises(errors.ConfigError, match="is one file, but a hand has two"):
        show("mine.urdf", port=0)
    assert len({kind.name for kind in PAGES}) == len(PAGES)


def test_only_this_machine_is_listened_to_unless_insecure() -> None:
    with pytest.raises(errors.ConfigError, match=r"host is '0\.0\.0\.0', which other machines reach; .*--insecure"):
        show("reflex", port=0, host="0.0.0.0")
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        with pytest.raises(errors.ConfigError, match=f"port {port} of 127.0.0.1 cannot be used"):
            show("reflex", port=port)
    with shown("reflex") as viewer:
        assert viewer.url.startswith("http://127.0.0.1:")
        assert viewer.url in viewer._repr_html_()
        viewer._server.request_share_url()  # no tunnel to the internet
        assert viewer._server._share_tunnel is None


def test_the_command_refuses_in_one_sentence() -> None:
    result = invoke(["view", "no-such-thing", "--no-browser", "--port", "0"])
    assert isinstance(result.exception, errors.ObjectSetError)
    result = invoke(["view", "reflex", "--no-browser", "--host", "0.0.0.0"])
    assert isinstance(result.exception, errors.ConfigError)


def test_the_folder_of_a_policy_is_its_environment(tmp_path: Path) -> None:
    """Its hand is the policy's, unless another one is named; in an environment that is named too."""
    pytest.importorskip("onnxruntime")
    pytest.importorskip("onnx")
    tiny_policy.make(tmp_path / "tiny", hand="panda_gripper")
    with shown(tmp_path / "tiny", objects=CAN) as viewer:
        page = viewer.page
        assert (page.env_id, page.policy.name, page.hand.name) == ("graspbox/GraspPose-v0", "tiny", "panda_gripper")
    with shown("graspbox/Grasp-v0", policy=tmp_path / "tiny", objects=CAN) as viewer:
        assert (viewer.page.env_id, viewer.page.hand.name) == ("graspbox/Grasp-v0", "panda_gripper")
    (tmp_path / "tiny/config.json").unlink()
    with pytest.raises(errors.ConfigError, match="has no view in 3D"):
        show(tmp_path / "tiny", port=0)
