"""Pictures: what they show is right, not only that a file appears."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import graspbox
from graspbox import _core, errors, object_sets
from graspbox.configs import PictureConfig
from graspbox.planning import Box

pytest.importorskip("matplotlib")
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from PIL import Image

from graspbox import pictures
from graspbox.pictures import Camera, PosedHand, Solid, View, episodes, trials
from graspbox.pictures.view import Lens


def check_picture(path: Path, *, most: int = 300_000) -> None:
    """Check that a picture is no larger than `most`, and that something is drawn on it."""
    with Image.open(path) as image:
        pixels = np.asarray(image.convert("L"))
    assert path.stat().st_size < most
    assert 0.02 < np.mean(pixels < 200) < 0.9


def cube(center: tuple[float, float, float], half: float, color: str) -> Solid:
    """Make a cube of half side `half` metres."""
    sides = ((0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3))
    faces = [triangle for a, b, c, d in sides for triangle in ((a, b, c), (a, c, d))]
    corners = Box(np.zeros(3), np.eye(3), np.full(3, half)).corners()
    pose = np.eye(4)
    pose[:3, 3] = center
    return Solid(graspbox.mesh_from_arrays(corners, faces), color, pose)


CUBE = cube((0.0, 0.0, 0.0), 0.05, "#0000ff")
FRONT = Camera(azimuth=-90.0, elevation=0.0)
CORNERS = 0.05 * np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])


def test_camera_looks_where_it_says() -> None:
    np.testing.assert_allclose(FRONT.axes.T, [[1, 0, 0], [0, 0, -1], [0, 1, 0]], atol=1e-12)
    top = Camera(azimuth=-90.0, elevation=90.0)
    np.testing.assert_allclose(top.axes.T, [[1, 0, 0], [0, -1, 0], [0, 0, -1]], atol=1e-12)
    for camera in (FRONT, top, Camera(37.0, 12.0)):
        np.testing.assert_allclose(np.cross(camera.axes[:, 0], camera.axes[:, 1]), camera.axes[:, 2], atol=1e-12)
    for way in ([1.0, 0.2, 0.0], [-0.5, 0.8, -0.3], [0.0, -1.0, 0.0]):
        along = Camera.across(way).axes[:, 2] @ way
        assert abs(along) < 0.5 * np.linalg.norm(way), "the way lies across the view, not along it"


def test_a_lens_shows_all_points_and_fills_the_picture() -> None:
    rng = np.random.default_rng(0)
    for size in ((200, 100), (90, 240)):
        points = rng.normal(size=(50, 3)) * [0.3, 0.1, 0.2] + [1.0, -2.0, 0.5]
        seen = Lens.showing(points, Camera(20.0, 30.0), size).project(points)
        low, high = seen[:, :2].min(axis=0) / size, seen[:, :2].max(axis=0) / size
        np.testing.assert_allclose(low + high, 1.0, atol=1e-9)
        assert np.max(high - low) == pytest.approx(0.94)
        assert np.all(seen[:, 2] > 0)


def test_the_picture_is_where_the_lens_projects() -> None:
    # What the renderer draws is what lines meet: the columns and rows that the cube covers, and its least depth.
    view = View([CUBE], Camera(-70.0, 35.0), shown=CORNERS, size=(160, 120))
    projected = view.lens.project(CORNERS)
    rows, columns = np.nonzero(view.depth)
    for covered, at in ((columns, projected[:, 0]), (rows, projected[:, 1])):
        assert abs(covered.min() + 0.5 - at.min()) < 1.0
        assert abs(covered.max() + 0.5 - at.max()) < 1.0
    assert abs(view.depth[view.depth > 0].min() - projected[:, 2].min()) < 2e-3
    drawn = np.any(view.image < 250, axis=2)
    assert np.mean(drawn != (view.depth > 0)) < 0.03, "pictures and depths differ along smooth edges alone"


def test_the_nearer_surface_hides_the_farther() -> None:
    near = cube((0.0, -0.2, 0.0), 0.02, "#ff0000")
    views = [View(s, FRONT, shown=CORNERS, size=(101, 101)) for s in ([near, CUBE], [CUBE, near])]
    middle, edge = views[0].image[50, 50].astype(int), views[0].image[50, 12].astype(int)
    assert middle[0] > middle[2]
    assert edge[2] > edge[0]
    # The other order of drawing makes the same picture.
    np.testing.assert_array_equal(views[0].image, views[1].image)


def test_lines_know_what_hides_them() -> None:
    view = View([CUBE], FRONT, shown=CORNERS, size=(200, 200))
    points = np.array([[0.0, -0.1, 0.0], [0.0, -0.05, 0.0], [0.0, 0.1, 0.0], [0.0, 0.0, 0.0], [0.5, 0.0, 0.0]])
    np.testing.assert_array_equal(view.visible(points), [True, True, False, False, True])
    axes = Figure().subplots()
    view.lines(axes, [[[-0.1, 0.06, 0.01], [0.1, 0.06, 0.01]]], "black", hidden=0.2)
    drawn = [collection for collection in axes.collections if isinstance(collection, LineCollection)]
    hidden, seen = (collection.get_segments() for collection in drawn)
    assert [len(hidden), len(seen)] == [1, 2], "one stretch behind the cube, one on each side of it"


def test_the_ground_is_white_takes_shadows_and_hides_no_lines() -> None:
    box = cube((0.0, 0.0, 0.05), 0.05, "#c08040")
    corners = CORNERS + np.array([0.0, 0.0, 0.05])
    view = View([box], Camera(-60.0, 30.0), shown=corners, size=(200, 160), ground=True)
    free = view.depth == 0
    values = view.image[free].min(axis=1)
    assert np.median(values) >= 250
    assert np.mean(values < 200) > 0.02, "a shadow lies on it"
    border = np.concatenate([view.image[[0, -1]].ravel(), view.image[:, [0, -1]].ravel()])
    assert border.min() >= 250, "no shadow is cut off"
    assert view.visible(np.array([[-0.05, -0.05, -1e-3], [0.05, -0.05, -1e-3]])).all(), (
        "an edge that lies in it is seen"
    )


def test_a_hand_is_drawn_whole_where_it_stands() -> None:
    hand = graspbox.load_hand()
    frame = np.eye(4)
    frame[:3, 3] = [1.0, 2.0, 3.0]
    here, there = (PosedHand(hand, pose, 0.0) for pose in (np.eye(4), frame))
    assert len(here.corners()) == 8 * len(hand.shapes(0.0, np.zeros(3), np.zeros(3))[0])
    np.testing.assert_allclose(here.corners() + frame[:3, 3], there.corners(), atol=1e-12)
    closed = PosedHand(hand, np.eye(4), 0.0, np.full((3, 2), 0.7))
    assert not np.allclose(closed.corners(), here.corners())
    small = cube((0.0, 0.0, 0.0), 1e-3, "#000000")
    for posed in (here, there, closed):
        view = View([small], Camera(), shown=posed.corners(), size=(160, 120), hand=posed)
        rows, columns = np.nonzero(view.depth)
        ends = [columns.min() / 160, rows.min() / 120, 1 - columns.max() / 160, 1 - rows.max() / 120]
        assert 0.02 < min(ends) < 0.05, "it fills the picture that was made for its corners"
        # Shining through, it hides nothing.
        ghost = View([small], Camera(), shown=posed.corners(), size=(160, 120), hand=posed, opacity=0.5)
        assert np.count_nonzero(ghost.depth) < 30
        assert np.all(ghost.image >= view.image.astype(int) - 1)


def test_wrong_scenes_are_refused() -> None:
    lens = Lens.showing(CORNERS, FRONT, (32, 32))
    config = json.dumps({"image_size": (32, 32), "samples": 1, "near": 0.01, "far": 10.0, "light": {}})

    def draw(poses: Any, colors: Any, config: str = config) -> Any:
        return _core.render(
            [CUBE.mesh], poses, colors, [True], None, lens.intrinsics, lens.world_from_camera, config, None
        )

    color = np.full((1, 3), 0.5)
    image, depth = draw(np.eye(4)[None], color)
    assert (image.shape, image.dtype, depth.shape, depth.dtype) == ((32, 32, 3), np.uint8, (32, 32), np.float32)
    for poses, colors, reason in (
        (np.zeros((0, 4, 4)), color, "world_from_mesh has length 0; give one for each of 1 meshes"),
        (np.eye(4)[None], np.full((2, 3), 0.5), "colors has length 2"),
        (np.eye(4)[None], 2 * np.ones((1, 3)), "color"),
        (2 * np.eye(4)[None], color, "not a rigid motion"),
    ):
        with pytest.raises(errors.ConfigError, match=reason):
            draw(poses, colors)
    with pytest.raises(errors.ConfigError, match="samples"):
        draw(np.eye(4)[None], color, config.replace('"samples": 1', '"samples": 9'))


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


def test_no_box_of_a_sweep_is_cut_off(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Boxes along principal axes stick out of the one around the whole; two of the kettle's once were clipped."""
    drawn: list[tuple[tuple[int, int], Any]] = []
    lines = View.lines

    def noted(self: View, axes: Any, segments: Any, *rest: Any, **settings: Any) -> None:
        drawn.append((self.lens.size, self.lens.project(segments)[..., :2]))
        lines(self, axes, segments, *rest, **settings)

    monkeypatch.setattr(View, "lines", noted)
    mesh = object_sets.load("procedural:kettle:3")[0].load()
    pictures.save_sweep(tmp_path / "sweep.png", mesh, fit="pca", area_gains=(0.9,), min_volumes=(1.25e-1, 1.25e-5))
    assert len(drawn) > 2
    for size, ends in drawn:
        assert np.all((ends > 0) & (ends < size))


def test_an_episode_shows_what_happens(tmp_path: Path) -> None:
    small = PictureConfig((48, 36), 1)
    episode = episodes.play("procedural:mug:3", seed=3, image_size=32, picture=small, observed="approach")
    assert [name for name, _, _ in episode.moments] == ["start", "approach", "closed", "lift", "held"]
    times = [seconds for _, seconds, _ in episode.moments]
    assert times == sorted(times)
    assert times[0] == 0.0
    assert len({picture.tobytes() for _, _, picture in episode.moments}) == 5
    assert set(episode.images) == set(episodes.IMAGES)
    assert all(np.ptp(image) > 0 and episodes.shown(image).shape[2] == 3 for image in episode.images.values())
    pictures.save_episode(tmp_path / "episode.png", "procedural:mug:3", seed=3)
    check_picture(tmp_path / "episode.png")
    with pytest.raises(errors.ConfigError, match="choose another seed"):
        episodes.play("procedural:plate:0", seed=0, image_size=32, picture=small, observed="held")


@pytest.fixture(scope="module")
def bottle() -> tuple[graspbox.Scene, graspbox.Plan]:
    scene = graspbox.Scene(object_sets.load("procedural:bottle:0")[0].load())
    return scene, graspbox.plan(scene.mesh, seed=0, world_from_object=scene.world_from_object)


def test_plan_trials_and_stages(bottle: tuple[graspbox.Scene, graspbox.Plan], tmp_path: Path) -> None:
    scene, plan = bottle
    # Ranked last, poses fail: some of both kinds.
    ranked = plan.best()
    rows = [*range(3), *range(len(ranked) - 40, len(ranked))]
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


def test_committed_pictures_are_small_and_drawn() -> None:
    folder = Path(__file__).parents[2] / "docs" / "pictures"
    found: list[Any] = sorted(folder.glob("*.png"))
    assert len(found) >= 8
    for path in found:
        check_picture(path)
