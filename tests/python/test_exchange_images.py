"""Export of the grasps of `graspbox grasp-image`: of one thing, and of all."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from command_line import invoke
from graspbox import errors, object_sets
from graspbox.tools import exchange

yaml = pytest.importorskip("yaml", reason="files of Isaac Grasp need PyYAML, from the extra 'exchange'")
pytest.importorskip("h5py", reason="files of ACRONYM need h5py, from the extra 'exchange'")


def image_result() -> dict[str, Any]:
    """Give a result in the form of `ImageGrasps.to_json`."""
    camera = np.diag([1.0, -1.0, -1.0, 1.0])
    camera[:3, 3] = (0.1, 0.0, 0.6)
    table = np.diag([1.0, -1.0, -1.0, 1.0])
    table[:3, 3] = (0.0, 0.02, 0.1)
    grasp = {"preshape": 0.3, "success": 0.8, "secure": 0.7, "choice": 0.75, "rank": 1, "free": True, "lift_free": True}
    poses = {"table_from_hand": table.tolist(), "camera_from_hand": (np.linalg.inv(camera) @ table).tolist()}
    weak = {**grasp, **poses, "success": 0.2, "rank": 2}
    return {
        "policy": "depth",
        "hand": "reflex",
        "table_from_camera": camera.tolist(),
        "warnings": [],
        "grasps": [{**grasp, **poses}, weak],
    }


def test_grasps_of_an_image_have_a_confidence(tmp_path: Path) -> None:
    (tmp_path / "image.json").write_text(json.dumps(image_result()))
    (on_table,) = exchange.read(tmp_path / "image.json")
    (at_camera,) = exchange.read(tmp_path / "image.json", frame="camera")
    np.testing.assert_array_equal(on_table.confidence, [0.8, 0.2])
    assert np.isnan(on_table.success).all()
    world = at_camera.world_from_object @ at_camera.poses
    np.testing.assert_allclose(world, on_table.world_from_object @ on_table.poses, atol=1e-12)
    exchange.save(at_camera, tmp_path / "it.yaml", "isaac")
    document = yaml.safe_load((tmp_path / "it.yaml").read_text())
    assert document["object_frame_link"] == "camera"
    assert document["grasps"]["grasp_0"]["confidence"] == 0.8
    assert "cspace_position" not in document["grasps"]["grasp_0"]
    with pytest.raises(errors.ConfigError, match="2 of 2 grasps of 'camera' have no outcome"):
        exchange.save(at_camera, tmp_path / "it.h5", "acronym")
    np.testing.assert_array_equal(at_camera.labeled(0.5).success, [1.0, 0.0])


def test_grasps_of_every_thing_are_exported(tmp_path: Path) -> None:
    """The result of ``grasp-image --all``: an entry for each thing that has grasps."""
    rows: list[dict[str, Any]] = [
        {"thing": 1, "pixels": 40, **image_result()},
        {"thing": 2, "pixels": 3, "refused": "the mask has 3 pixels with a depth"},
        {"thing": 4, "pixels": 50, **image_result(), "grasps": []},
        {"thing": 7, "pixels": 60, **image_result(), "grasps": image_result()["grasps"][:1]},
    ]
    path = tmp_path / "scene.json"
    path.write_text(json.dumps({"things": rows, "order": [], "warnings": []}))
    found = exchange.read(path, frame="camera")
    assert [(one.object_name, len(one)) for one in found] == [("camera_1", 2), ("camera_7", 1)]
    np.testing.assert_array_equal(found[0].poses, exchange.from_image(image_result(), frame="camera").poses)
    result = invoke(["export-grasps", str(path), "--to", "isaac", "--out", str(tmp_path / "out"), "--json"])
    assert result.exit_code == 0, result.output
    assert [row["name"] for row in json.loads(result.stdout)["objects"]] == ["table_1", "table_7"]
    assert (tmp_path / "out/table_7.yaml").is_file()
    for things, why in (
        (rows[1:3], r"no thing of the image has a grasp: 2 \(the mask has 3 .*\), 4 \(no grasp is feasible\)"),
        ([], "no thing of the image has a grasp: there are none"),
        (3, "things is missing or is not a list of objects"),
        ([{"thing": "x"}], "thing is 'x'"),
        ([{"thing": 1, "grasps": 3}], "thing 1: grasps is missing or is not a list"),
    ):
        path.write_text(json.dumps({"things": things}))
        with pytest.raises(errors.ConfigError, match=why):
            exchange.read(path)


def test_results_of_grasp_image_are_read(tmp_path: Path) -> None:
    """`image_result` has the keys of the real thing."""
    pytest.importorskip("onnx", reason="small networks are made with onnx, from the extra 'dev'")
    pytest.importorskip("onnxruntime", reason="networks run in onnxruntime, from the extra 'onnx'")
    import tiny_policy
    from graspbox.meshes.views import ViewPlan, views
    from graspbox.perception import add_depth_noise
    from graspbox.policies.grasp_image import SceneGrasps, grasp_image

    tiny_policy.make(tmp_path / "tiny")
    mesh = object_sets.load("procedural:mug:3")[0].load()
    plan = ViewPlan("random", axis=(-1.0, 0.0, 1.2), cap=0.2, distance=(0.6, 0.6))
    seen = views(mesh, plan=plan, count=1, seed=2, image_size=(120, 160), images="depth", fov=0.5)
    depth = add_depth_noise(seen.depth, seen.intrinsics, 1)[0] / 1000.0
    found = grasp_image(depth, seen.intrinsics, seen.world_from_camera[0], tmp_path / "tiny", count=3)
    result = found.to_json()
    assert set(result) == set(image_result())
    assert set(result["grasps"][0]) == set(image_result()["grasps"][0])
    grasps = exchange.from_image(result)
    np.testing.assert_array_equal(grasps.poses, found.table_from_hand)
    np.testing.assert_array_equal(grasps.confidence, found.success)
    scene = SceneGrasps(found.object.astype(np.int64), {5: found}, {})
    (same,) = exchange.from_scene(scene.to_json())
    assert same.object_name == "table_5"
    np.testing.assert_array_equal(same.poses, found.table_from_hand)
