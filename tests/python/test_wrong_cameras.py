"""Images with wrong intrinsics, units and kinds of depth: what is told, and distances along rays are converted."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from graspbox.captures import open_camera, read_capture
from graspbox.errors import ConfigError
from graspbox.evaluation.captures import Capture, captures_in
from graspbox.evaluation.disturbances import DISTURBANCES, disturb_captures, silence
from graspbox.perception.captured import look, survey
from graspbox.perception.depth_images import check_intrinsics
from graspbox.perception.depth_views import DepthView
from graspbox.perception.real import RealImage, z_of_distances
from test_captured import CAPTURES, CROP, LENS, POSE, REPOSITORY, grasper, scene

__all__ = ["grasper"]  # a fixture

DEPTH = np.asarray(scene((0.0, 0.0, 0.04, 0.09)).depth)


def distances(depth: NDArray[np.float64], lens: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return distances along the rays, computed pixel by pixel."""
    rows, columns = np.indices(depth.shape) + 0.5
    x, y = (columns - lens[0, 2]) / lens[0, 0], (rows - lens[1, 2]) / lens[1, 1]
    return np.asarray(depth * np.sqrt(x**2 + y**2 + 1.0))


def warnings_of(
    depth: NDArray[np.float64], lens: NDArray[np.float64], pose: Any = None, **options: Any
) -> tuple[str, ...]:
    return look(RealImage.of(depth, lens, pose, **options).survey(CROP), CROP).warnings


def test_distances_become_depths(tmp_path: Path) -> None:
    lens = np.array([[300.0, 0.0, 150.0], [0.0, 280.0, 130.0], [0.0, 0.0, 1.0]])
    along = distances(DEPTH, lens)
    np.testing.assert_allclose(z_of_distances(along, lens), DEPTH, atol=1e-12)
    np.save(tmp_path / "ray.npy", along)
    np.testing.assert_allclose(
        read_capture(tmp_path / "ray.npy", intrinsics=lens, depth_is="distance").depth, DEPTH, atol=1e-9
    )
    with open_camera(tmp_path, intrinsics=lens, depth_is="distance", seconds=20.0) as source:
        np.testing.assert_allclose(next(iter(source)).capture.depth, DEPTH, atol=1e-9)
    wrong: Any = "ray"
    for call in (read_capture, open_camera):
        with pytest.raises(ConfigError, match="depth_is is 'ray'; choose from z, distance"):
            call(tmp_path / "ray.npy" if call is read_capture else tmp_path, intrinsics=lens, depth_is=wrong)
    np.save(tmp_path / "cloud.npy", np.random.default_rng(0).normal((0, 0, 0.6), 0.05, (500, 3)))
    with pytest.raises(ConfigError, match="is a cloud, which has no depths along rays"):
        read_capture(tmp_path / "cloud.npy", depth_is="distance")


@pytest.mark.parametrize("given", [None, POSE])
def test_a_curved_table_is_told(given: Any) -> None:
    assert warnings_of(DEPTH, LENS, given) == ()
    along = distances(DEPTH, LENS)
    try:
        told = warnings_of(along, LENS, given)
    except ConfigError as error:
        told = (str(error),)
    assert any(
        "the table is curved, as in an image of distances" in one and "--depth-is distance" in one for one in told
    )
    # A thing alone may be curved like that.
    own = look(survey(DepthView(DEPTH, LENS, POSE), CROP), CROP).object
    alone = warnings_of(np.where(own, along, 0.0), LENS, POSE)
    assert not any("curved" in one for one in alone)


def test_real_captures_are_flat_and_their_distances_are_not() -> None:
    pytest.importorskip("PIL", reason="PNG files need Pillow, from the extra 'cli'")
    told = []
    for folder in captures_in(CAPTURES):
        capture = Capture.read(folder)
        assert not any("curved" in one for one in RealImage.of(capture.depth, capture.intrinsics, None).warnings)
        try:
            along = RealImage.of(distances(capture.depth, capture.intrinsics), capture.intrinsics, None).warnings
        except ConfigError as error:
            along = (str(error),)
        told.append(any("curved" in one for one in along))
    # The bin that is seen through a narrow lens does not tell.
    assert sum(told) >= 7, told


@pytest.mark.parametrize("scale", [0.5, 0.9, 1.1, 1.5])
def test_intrinsics_of_another_size_are_told(scale: float) -> None:
    lens = check_intrinsics(np.diag([scale, scale, 1.0]) @ LENS, (240, 320))
    assert any("belong to one of another size" in one for one in warnings_of(DEPTH, lens))
    # Real principal points are off too, but along one axis, or to other sides.
    for x, y in ((0.034, 0.0), (-0.014, 0.017), (0.013, 0.013)):
        moved = LENS + np.array([[0, 0, 320 * x], [0, 0, 240 * y], [0, 0, 0]])
        assert warnings_of(DEPTH, moved) == ()


def test_a_wrong_focal_length_is_told_by_gravity_and_by_the_pose() -> None:
    lens = LENS * np.array([[0.8, 1, 1], [1, 0.8, 1], [1, 1, 1]])
    down = -POSE[2, :3]
    assert warnings_of(DEPTH, LENS, gravity=down) == ()
    assert any(
        "degrees against gravity; check the focal length" in one for one in warnings_of(DEPTH, lens, gravity=down)
    )
    close = LENS * np.array([[0.93, 1, 1], [1, 0.93, 1], [1, 1, 1]])
    told = warnings_of(DEPTH, close, POSE)
    assert any("the table in the image corrects the camera's pose by" in one for one in told), told
    raised = POSE.copy()
    raised[2, 3] += 0.03
    assert any("its height by 30 mm; check the pose" in one for one in warnings_of(DEPTH, LENS, raised))


def test_disturbances_are_counted(grasper: Any, tmp_path: Path) -> None:
    pytest.importorskip("PIL", reason="PNG files need Pillow, from the extra 'cli'")
    folders = tuple(CAPTURES / name for name in ("sixdof_mustard", "pcl_milk_clorox"))
    rows = list(disturb_captures(grasper, folders))
    counts = silence(rows)
    assert len(rows) == len(DISTURBANCES) * len(folders)
    for scale in (0.5, 0.75, 0.9, 1.1, 1.25, 1.5):
        assert counts[f"K x {scale:g}"] | {"refused": 0} == {"of": 2, "refused": 0, "told": 2, "silent": 0}
    assert counts["distance x 1"]["told"] == 2
    assert counts["unit x 10"] == {"of": 2, "refused": 2, "told": 2, "silent": 0}
    # Nothing tells a longer focal length without a pose.
    assert counts["focal x 1.5"] == {"of": 2, "refused": 0, "told": 0, "silent": 2}
    posed = silence(list(disturb_captures(grasper, folders, given="pose")))
    assert posed["focal x 0.5"] == {"of": 2, "refused": 2, "told": 2, "silent": 0}
    assert posed["focal x 1.5"] == {"of": 2, "refused": 0, "told": 2, "silent": 0}
    with pytest.raises(ConfigError, match="given is 'mask'; whole images are disturbed"):
        list(disturb_captures(grasper, folders, given="mask"))


def test_the_command_counts_disturbances(grasper: Any, tmp_path: Path) -> None:
    pytest.importorskip("typer", reason="the command line needs the extra 'cli'")
    from command_line import invoke

    (tmp_path / "set").mkdir()
    (tmp_path / "set" / "one").symlink_to(CAPTURES / "sixdof_mustard")
    words = ["benchmark", "captures", tmp_path / "set", "--policy", REPOSITORY / "policies" / "panda_clutter"]
    result = invoke([*words, "--disturb", "--json", "--out", tmp_path / "out.json"])
    assert result.exit_code == 0, result.output
    told, kept = json.loads(result.stdout), json.loads((tmp_path / "out.json").read_text())
    assert told["disturbances"]["K, all"]["silent"] == 0
    assert len(kept["rows"]) == len(DISTURBANCES)
    assert "disturbance" in invoke([*words, "--disturb"]).stdout
    for option in (["--seed", "3"], ["--pictures", tmp_path / "pictures"]):
        refused = invoke([*words, "--disturb", *option]).exception
        assert isinstance(refused, ConfigError)
        assert "--disturb finds no grasps, so it takes no --seed and no --pictures" in str(refused)
    # The policy has one name in both documents.
    judged = json.loads(invoke([*words, "--json", "--out", tmp_path / "judged.json"]).stdout)
    assert judged["policy"] == told["policy"] == grasper.config.name
    assert json.loads((tmp_path / "judged.json").read_text())["policy"] == grasper.config.name
