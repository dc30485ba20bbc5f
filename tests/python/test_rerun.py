"""Recordings for rerun: their contents as read by the program ``rerun``, and their motions.

Tests of files need rerun-sdk (``make test-rerun``), which is larger than 100 MB; motions need none of it.
"""

import json
import os
import re
import shutil
import subprocess
import sys
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import graspbox
import tiny_policy
from command_line import invoke
from graspbox import object_sets
from graspbox._core import Hand
from graspbox.data import episodes as demonstrations
from graspbox.errors import ConfigError, FileError, MissingExtraError
from graspbox.evaluation import evaluate
from graspbox.evaluation.replays import ActionLog, shown
from graspbox.hands.description import describe
from graspbox.meshes.shapes import boxes
from graspbox.policies import load
from graspbox.tools.hand_links import HandLinks, link_boxes, moving_frames
from graspbox.tools.rerun.episodes import of_demonstrations
from graspbox.tools.rerun.motions import RecordedMotion, of_replay, of_trial, sensor_forces

HAS_SDK = find_spec("rerun_bindings") is not None
REQUIRED = os.environ.get("GRASPBOX_REQUIRE_RERUN", "0") not in ("", "0")
needs_sdk = pytest.mark.skipif(not HAS_SDK and not REQUIRED, reason="needs rerun-sdk (make test-rerun)")
CAN = "procedural:can:0"


@pytest.fixture(scope="module")
def scene() -> graspbox.Scene:
    return graspbox.Scene(object_sets.load(CAN)[0].load())


@pytest.fixture(scope="module")
def grasp(scene: graspbox.Scene) -> graspbox.Grasp:
    return graspbox.plan(scene.mesh, world_from_object=scene.world_from_object).best(1)[0]


@pytest.fixture(scope="module")
def held(scene: graspbox.Scene, grasp: graspbox.Grasp) -> RecordedMotion:
    return of_trial(scene, grasp.pose, float(grasp.preshape), probability=0.75)


# --- hands -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", Hand.names())
def test_links_have_the_collision_shapes_at_every_position(name: str) -> None:
    hand = Hand.named(name)
    limits = hand.joint_limits
    joints = limits[:, 0] + 0.4 * (limits[:, 1] - limits[:, 0])
    shapes, halves, _, _ = hand.shapes(joints)
    placed = [
        (frame @ box, half)
        for frame, link in zip(moving_frames(hand, joints), link_boxes(hand), strict=True)
        for box, half in zip(link.frames, link.half_extents, strict=True)
    ]
    assert len(placed) == len(shapes)
    for shape, half in zip(shapes, halves, strict=True):
        assert any(np.allclose(shape, pose, atol=1e-12) and np.allclose(half, other) for pose, other in placed)


@pytest.mark.parametrize("name", Hand.names())
def test_frames_of_links_are_those_of_the_urdf(name: str) -> None:
    """A collision box of the URDF, in the frame of its link, lies where the core has it."""
    hand = Hand.named(name)
    element_tree = import_module("xml.etree.ElementTree")
    # A body that moves bears the name of its first link.
    moved = describe(hand).moving
    assert [link.name for link in link_boxes(hand)] == ["palm", *(link.name for link in moved)]
    zero, links = np.zeros(len(hand.joints)), HandLinks(hand)
    frames = dict(zip(links.names, links.frames(zero), strict=True))
    centers = hand.shapes(zero)[0][:, :3, 3]
    count = 0
    for link in element_tree.fromstring(hand.files[0]).findall("link"):
        for collision in link.findall("collision"):
            origin = collision.find("origin")
            place = [0.0] * 3 if origin is None else [float(v) for v in origin.get("xyz", "0 0 0").split()]
            found = frames[link.get("name")] @ [*place, 1.0]
            assert np.linalg.norm(centers - found[:3], axis=1).min() < 1e-9
            count += 1
    assert count == len(centers)


def test_meshes_of_boxes_are_closed_and_face_outwards() -> None:
    pose = np.eye(4)
    pose[:3, 3] = 1.0, 2.0, 3.0
    half = np.array([0.1, 0.2, 0.3])
    vertices, faces = boxes(pose[None], half[None])
    corners = vertices[faces]
    np.testing.assert_allclose(np.abs(vertices - pose[:3, 3]), np.tile(half, (8, 1)))
    ways = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    assert np.einsum("ij,ij->", corners[:, 0] - pose[:3, 3], ways) / 6 == pytest.approx(8 * half.prod())
    assert (np.einsum("ij,ij->i", ways, corners[:, 0] - pose[:3, 3]) > 0).all()


# --- motions ---------------------------------------------------------------------------------------------------------


def test_a_motion_is_the_trace_of_its_trial(held: RecordedMotion, scene: graspbox.Scene, grasp: graspbox.Grasp) -> None:
    outcomes, trace = scene.trace(grasp, config=graspbox.TrialConfig())
    assert outcomes.success[0]
    assert held.outcome == "success"
    np.testing.assert_array_equal(held.world_from_object, trace.world_from_object)
    np.testing.assert_array_equal(held.joints, trace.joints)
    assert {"hand_force", "lift", "tension/finger_1", "load/preshape"} <= held.scalars.keys()


def test_the_force_on_a_held_object_is_its_weight(held: RecordedMotion, scene: graspbox.Scene) -> None:
    points, forces = held.contact_force(scene.center_of_mass)
    still = slice(-30, None)
    np.testing.assert_allclose(forces[still].mean(axis=0), [0.0, 0.0, 9.81 * held.mass], atol=0.05 * 9.81 * held.mass)
    np.testing.assert_allclose(points[0], scene.world_from_object[:3, :3] @ scene.center_of_mass
                               + scene.world_from_object[:3, 3], atol=1e-3)  # fmt: skip
    lifted = forces[(held.scalars["lift"] > 0.01) & (held.scalars["lift"] < 0.03)]
    assert lifted[:, 2].max() > 9.81 * held.mass


def test_contacts_of_a_trial_carry_the_object(held: RecordedMotion) -> None:
    last = held.contact_samples == len(held.time) - 1
    weight = 9.81 * held.mass
    np.testing.assert_allclose(held.contact_forces[last].sum(axis=0), [0.0, 0.0, weight], atol=0.01 * weight)
    assert held.scalars["tactile_sum"].max() > 1.0


def test_sensors_press_on_the_object_where_the_hand_touches_it(scene: graspbox.Scene, grasp: graspbox.Grasp) -> None:
    """Each sensor that feels a force is within its reach of the surface, and pushes to the inside."""
    _, trace = scene.trace(grasp)
    samples, points, forces = sensor_forces(scene.hand, trace.world_from_hand, trace.joints, trace.tactile)
    assert len(set(samples)) > 100
    assert np.linalg.norm(forces, axis=1).sum() == pytest.approx(trace.tactile.sum())
    surface, normals = scene.mesh.sample(20_000, 0)
    for sample, point, force in list(zip(samples, points, forces, strict=True))[::20]:
        inverse = np.linalg.inv(trace.world_from_object[sample])
        place = inverse[:3, :3] @ point + inverse[:3, 3]
        distances = np.linalg.norm(surface - place, axis=1)
        nearest = int(distances.argmin())
        assert distances[nearest] < 0.015
        assert (inverse[:3, :3] @ force) @ normals[nearest] < 0


def test_an_infeasible_pose_shows_the_open_hand(scene: graspbox.Scene) -> None:
    motion = of_trial(scene, np.eye(4), 0.0)
    assert motion.outcome == "infeasible"
    np.testing.assert_array_equal(motion.joints, scene.hand.open(0.0)[None])
    points, forces = motion.contact_force(scene.center_of_mass)
    assert points.shape == forces.shape == (1, 3)


@pytest.mark.parametrize(("policy", "env_id"), [("planner", "graspbox/GraspPose-v0"), ("expert", "graspbox/Grasp-v0")])
def test_episodes_run_again_as_they_went(policy: str, env_id: str) -> None:
    found = object_sets.load("procedural:can:0-1")
    log = ActionLog(load(policy))
    result = evaluate(log, env_id, found, 2, 0)
    replays = shown(result, log, found, 1)
    assert [replay.seed for replay in replays] == [result.trials[0].seed]
    motion = of_replay(replays[0], ("rgb", "depth_palm"))
    assert motion.outcome == (result.trials[0].failure or "success")
    assert {shot.name for shot in motion.shots} == {"rgb", "depth_palm"}
    assert motion.shots[0].image.shape[2] == 3
    closed_loop = env_id.endswith("Grasp-v0")
    assert len(motion.shots) == (2 * (result.trials[0].steps + 1) if closed_loop else 2)
    assert motion.scalars["lift"].max() > 0.1
    assert len(set(motion.contact_samples)) > 20


def test_demonstrations_run_again_with_their_noise(tmp_path: Path) -> None:
    few = {"objects": "procedural:can:0-1", "episodes": 1, "num_envs": 1, "keep": "all"}
    made = demonstrations.record("expert", tmp_path, noise=0.1, obs="state", **few)  # type: ignore[arg-type]
    (replay,) = of_demonstrations(made, 5)
    (steps,) = made.read(("state",))
    env = replay.make(obs="state")
    states = [seen for seen, _ in replay.run(env)]
    env.close()
    # The last action is the recorded one, before the noise; the movement is the same to the bit.
    np.testing.assert_array_equal(np.stack(states)[:, :40], steps.observations["state"][:, :40])


# --- files -----------------------------------------------------------------------------------------------------------


def rerun(*words: str) -> str:
    """Run the program ``rerun``."""
    program = shutil.which("rerun") or str(Path(sys.executable).parent / "rerun")
    done = subprocess.run([program, *words], capture_output=True, text=True, env={**os.environ, "RERUN_ANALYTICS": "0"})
    assert done.returncode == 0, done.stderr
    return done.stdout


def entities(path: Path) -> dict[str, list[tuple[int, str]]]:
    """Read a recording with the program ``rerun``: rows and columns of each entity's chunks."""
    rerun("rrd", "verify", str(path))
    found: dict[str, list[tuple[int, str]]] = {}
    pattern = r"with (\d+) rows \(.*?\) - (/\S+) - data columns: \[(.*)\]"
    for rows, entity, columns in re.findall(pattern, rerun("rrd", "print", str(path))):
        found.setdefault(entity, []).append((int(rows), columns))
    return found


def rows_with(found: dict[str, list[tuple[int, str]]], entity: str, column: str) -> int:
    return sum(rows for rows, columns in found[entity] if column in columns)


@needs_sdk
def test_rerun_reads_a_trial(
    held: RecordedMotion, scene: graspbox.Scene, grasp: graspbox.Grasp, tmp_path: Path
) -> None:
    log = import_module("graspbox.tools.rerun").log
    path = log([held, (scene, grasp)], tmp_path / "trial.rrd", root="here")
    found = entities(path)
    count = len(held.time)
    assert rows_with(found, "/here/world/object", "Transform3D:translation") == 2 * count
    assert rows_with(found, "/here/world/object", "Mesh3D:vertex_positions") == 2
    for link in ("proximal_1", "distal_3"):
        assert rows_with(found, f"/here/world/hand/{link}", "Transform3D:mat3x3") == 2 * count
        assert rows_with(found, f"/here/world/hand/{link}", "Mesh3D:triangle_indices") == 1
    assert rows_with(found, "/here/world/contacts", "Arrows3D:vectors") == 2 * count
    assert rows_with(found, "/here/world/net_force", "Arrows3D:vectors") == 2 * count
    assert rows_with(found, "/here/plots/hand_force", "Scalars:scalars") == 2 * count
    assert rows_with(found, "/here/plots/probability", "Scalars:scalars") == 1
    assert rows_with(found, "/here/log", "TextLog:text") == 2


@needs_sdk
def test_rerun_reads_a_trial_among_other_objects(held: RecordedMotion, tmp_path: Path) -> None:
    meshes = [spec.load() for spec in object_sets.load("procedural:can:0-3")]
    found = graspbox.arrange(meshes, "bin", seed=0)
    scene = graspbox.Scene.of(found, target=0)
    motion = of_trial(scene, np.linalg.inv(scene.world_from_object) @ [[1, 0, 0, 0], [0, -1, 0, 0], [0, 0, -1, 0.4],
                                                                       [0, 0, 0, 1]], 0.0)  # fmt: skip
    path = import_module("graspbox.tools.rerun").log([motion, held], tmp_path / "bin.rrd")
    recorded = entities(path)
    for index in range(len(found) - 1):
        assert rows_with(recorded, f"/world/others/{index}", "Mesh3D:vertex_positions") == 1
        assert rows_with(recorded, f"/world/others/{index}", "Transform3D:translation") == len(motion.time)
        assert rows_with(recorded, f"/world/others/{index}", "Clear:is_recursive") == 1
        assert rows_with(recorded, f"/plots/lift_of_others/{index}", "Scalars:scalars") == len(motion.time)
    assert rows_with(recorded, "/world/walls", "Boxes3D:half_sizes") == 1


@needs_sdk
@pytest.mark.parametrize("name", ["grasp", "evaluate", "record"])
def test_commands_write_recordings(name: str, tmp_path: Path) -> None:
    path = tmp_path / "made.rrd"
    words = {
        "grasp": ("grasp", "--objects", "procedural:can:0-2", "--poses", "2"),
        "evaluate": ("evaluate", "planner", "--objects", "procedural:can:0-2", "--trials", "3"),
        "record": (
            "record",
            "expert",
            "--objects",
            "procedural:can:0-2",
            "--episodes",
            "3",
            "--out",
            str(tmp_path / "x"),
        ),
    }[name]
    more = ("--rerun", str(path), "--rerun-episodes", "2")
    result = invoke([*words, *more, "--json"], catch_exceptions=False)
    assert result.exit_code == 0, result.output
    json.loads(result.stdout)
    found = entities(path)
    assert rows_with(found, "/log", "TextLog:text") == 2
    assert rows_with(found, "/world/object", "Transform3D:translation") > 40
    if name != "grasp":
        assert rows_with(found, "/world/cameras/rgb/image", "EncodedImage:blob") >= 2
        assert rows_with(found, "/world/cameras/depth/image", "DepthImage:buffer") >= 2


@needs_sdk
def test_the_grasps_of_an_image_are_recorded(tmp_path: Path) -> None:
    pytest.importorskip("onnx", reason="small networks are made with onnx, from the extra 'dev'")
    pytest.importorskip("onnxruntime", reason="networks run in onnxruntime, from the extra 'onnx'")
    tiny_policy.make(tmp_path / "tiny")
    mesh = object_sets.load("procedural:mug:3")[0].load()
    plan = graspbox.ViewPlan("random", axis=(-1.0, 0.0, 1.2), cap=0.2, distance=(0.6, 0.6))
    seen = graspbox.views(mesh, plan=plan, count=1, seed=2, image_size=(120, 160), images="depth", fov=0.5)
    np.save(tmp_path / "depth.npy", seen.depth[0])
    np.save(tmp_path / "pose.npy", seen.world_from_camera[0])
    lens = [str(seen.intrinsics[row, column]) for row, column in ((0, 0), (1, 1), (0, 2), (1, 2))]
    words = ["grasp-image", str(tmp_path / "depth.npy"), "--policy", str(tmp_path / "tiny"), "--intrinsics", *lens]
    words += [
        "--camera-pose",
        str(tmp_path / "pose.npy"),
        "--count",
        "2",
        "--rerun",
        str(tmp_path / "seen.rrd"),
        "--json",
    ]
    result = invoke(words, catch_exceptions=False)
    assert result.exit_code == 0, result.output
    count = len(json.loads(result.stdout)["grasps"])
    found = entities(tmp_path / "seen.rrd")
    assert rows_with(found, "/world/camera/image", "DepthImage:buffer") == 1
    assert rows_with(found, "/world/completion", "Points3D:positions") == 1
    assert rows_with(found, "/plots/success", "Scalars:scalars") == count
    assert sum(entity.startswith("/world/grasps/") for entity in found) == count


@needs_sdk
def test_a_failed_recording_leaves_no_file(tmp_path: Path) -> None:
    module = import_module("graspbox.tools.rerun")
    with pytest.raises(ConfigError, match=r"name a file that ends in \.rrd"):
        module.log([], tmp_path / "x.txt")
    with pytest.raises(ConfigError, match="items has a int"):
        module.log([3], tmp_path / "x.rrd")
    with pytest.raises(FileError):
        module.log([], tmp_path / "no" / "\0.rrd")
    with pytest.raises(RuntimeError), module.recording(tmp_path / "y.rrd"):
        raise RuntimeError
    assert list(tmp_path.iterdir()) == []


def test_without_the_sdk_the_error_names_the_extra(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setitem(sys.modules, "rerun", None)
    with pytest.raises(MissingExtraError, match=re.escape("pip install 'graspbox[rerun]'")):
        import_module("graspbox.tools.rerun").log([], tmp_path / "x.rrd")
    words = ["grasp", "--objects", CAN, "--poses", "1", "--rerun", str(tmp_path / "x.rrd")]
    result = invoke(words)
    assert isinstance(result.exception, MissingExtraError)


def test_servers_cannot_be_recorded() -> None:
    words: list[Any] = ["evaluate", "zero", "--remote", "ws://127.0.0.1:1", "--rerun", "x.rrd"]
    result = invoke(words)
    assert isinstance(result.exception, ConfigError)
    assert "leave out --remote" in str(result.exception)
