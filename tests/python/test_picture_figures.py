"""Pictures show the numbers, poses and outcomes of their data."""

from collections import Counter
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import graspbox
from graspbox import errors, object_sets
from graspbox.configs import PictureConfig

pytest.importorskip("matplotlib")
from matplotlib import colormaps
from matplotlib.figure import Figure

from graspbox import pictures
from graspbox._common.colors import FAILURE, NEIGHBOUR, NOT_SIMULATED, SUCCESS, WALL
from graspbox.pictures import (
    GraspExample,
    Trial,
    View,
    episodes,
    files,
    hand_frames,
    motions,
    plans,
    sweeps,
    trials,
)
from program_files import imported
from test_pictures import check_picture

SCRIPTS = Path(__file__).parents[2] / "scripts"


@pytest.fixture
def figures(monkeypatch: pytest.MonkeyPatch) -> list[Figure]:
    """Keep every figure that is written, open for a look."""
    kept: list[Figure] = []
    write = files.write

    def kept_and_written(figure: Figure, path: Path, **settings: Any) -> None:
        kept.append(figure)
        write(figure, path, **settings)

    for module in (episodes, hand_frames, motions, plans, sweeps, trials):
        monkeypatch.setattr(module, "write", kept_and_written)
    return kept


@pytest.fixture
def lines(monkeypatch: pytest.MonkeyPatch) -> list[dict[str, Any]]:
    """Keep the segments that views are asked for, where they land in the picture, and how they look."""
    kept: list[dict[str, Any]] = []
    plain = View.lines

    def kept_and_plotted(self: View, axes: Any, segments: Any, color: str, **settings: Any) -> None:
        ends = self.lens.project(segments)[..., :2]
        found = {"axes": axes, "segments": np.asarray(segments), "color": color, "ends": ends, "size": self.lens.size}
        kept.append({**found, **settings})
        plain(self, axes, segments, color, **settings)

    monkeypatch.setattr(View, "lines", kept_and_plotted)
    return kept


def texts(figure: Figure) -> list[str]:
    """All that is written on a figure, but for tick labels."""
    found = [text.get_text() for text in figure.texts]
    if figure.get_suptitle():
        found.append(figure.get_suptitle())
    for axes in figure.axes:
        found += [axes.get_title(), axes.get_xlabel(), axes.get_ylabel(), *(text.get_text() for text in axes.texts)]
    return [text for text in found if text]


def test_sweep_counts_what_it_shows(tmp_path: Path) -> None:
    mesh = object_sets.load("procedural:kettle:3")[0].load()
    gains, least = (0.8, 0.95), (1.25e-3, 1.25e-5)
    found = pictures.save_sweep(tmp_path / "sweep.png", mesh, area_gains=gains, min_volumes=least)
    assert list(found) == [(g, v) for g in gains for v in least]
    for (gain, volume), (count, together) in found.items():
        tree = graspbox.decompose(mesh, area_gain=gain, min_volume=volume, max_boxes=64)
        assert (count, together) == (len(tree), tree.volume)
    assert found[0.95, 1.25e-5][0] > found[0.95, 1.25e-3][0] == 1
    check_picture(tmp_path / "sweep.png")


def test_no_box_of_a_sweep_is_cut_off(tmp_path: Path, lines: list[dict[str, Any]]) -> None:
    """Boxes along principal axes stick out of the one around the whole; two of the kettle's once were clipped."""
    mesh = object_sets.load("procedural:kettle:3")[0].load()
    pictures.save_sweep(tmp_path / "sweep.png", mesh, fit="pca", area_gains=(0.9,), min_volumes=(1.25e-1, 1.25e-5))
    assert len(lines) > 2
    for line in lines:
        assert np.all((line["ends"] > 0) & (line["ends"] < line["size"]))


@pytest.mark.parametrize("fit", ["minimum", "pca"])
def test_default_thresholds_show_what_changes(fit: Any, tmp_path: Path, figures: list[Figure]) -> None:
    """Half of the panels once showed the same single box; volumes were in m3 above and in cm3 below."""
    mesh = object_sets.load("procedural:kettle:3")[0].load()
    found = pictures.save_sweep(tmp_path / "sweep.png", mesh, fit=fit)
    assert len(found) == 12
    assert len(set(found.values())) >= 8
    assert sum(count == 1 for count, _ in found.values()) <= 3
    (figure,) = figures
    assert [t for t in texts(figure) if "min_volume" in t] == [
        f"min_volume {v} cm³" for v in ("125", "40", "12.5", "4")
    ]
    titles = [axes.get_title() for axes in figure.axes]
    for title, (count, volume) in zip(titles, found.values(), strict=True):
        assert title.startswith(f"{count} box{'' if count == 1 else 'es'}")
        assert title.endswith(f", {volume * 1e6:.0f} cm³")
        assert ("maximum" in title) == (count == 64)


def test_an_episode_shows_what_happens(tmp_path: Path, figures: list[Figure]) -> None:
    small = PictureConfig((48, 36), 1)
    _, moments, images = episodes.play("procedural:mug:3", 3, small, "approach", image_size=32)
    assert [name for name, _, _ in moments] == list(episodes.MOMENTS)
    times = [seconds for _, seconds, _ in moments]
    assert times == sorted(times)
    assert times[0] == 0.0
    assert len({picture.tobytes() for _, _, picture in moments}) == 5
    assert set(images) == set(episodes.IMAGES)
    assert all(np.ptp(image) > 0 and episodes.colored(image).shape[2] == 3 for image in images.values())
    pictures.save_episode(str(tmp_path / "episode.png"), "procedural:mug:3", seed=3)
    check_picture(tmp_path / "episode.png")
    (figure,) = figures
    assert any("mug-000003" in text for text in texts(figure))
    bars = [axes for axes in figure.axes if axes.get_xlabel() == "depth (m)"]
    assert len(bars) == sum(name.startswith("depth") for name in episodes.IMAGES) == 2
    for bar in bars:
        low, high = bar.get_xlim()
        ticks = [float(label.get_text()) for label in bar.get_xticklabels()]
        assert len(ticks) >= 2
        assert all(low <= tick <= high for tick in ticks)
    with pytest.raises(errors.ConfigError, match="choose another seed"):
        episodes.play("procedural:fork:1", 0, small, "held", image_size=32)
    with pytest.raises(errors.ConfigError, match="observed is 'later'; use one of start, approach"):
        pictures.save_episode(tmp_path / "later.png", "procedural:mug:3", observed="later")


def test_depth_colours_belong_to_the_bar() -> None:
    depth = np.array([[0.0, 0.2], [0.4, 0.8]], dtype=np.float32)[..., None]
    assert episodes.depth_limits(depth) == pytest.approx((0.2, 0.8))
    assert episodes.depth_limits(np.zeros((2, 2, 1), dtype=np.float32)) == (0.1, 1.0)
    rgb = episodes.colored(depth)
    scale = colormaps["viridis_r"]
    np.testing.assert_allclose(rgb[0, 0], 1.0)
    for (row, column), share in (((0, 1), 0.0), ((1, 0), 0.5), ((1, 1), 1.0)):
        np.testing.assert_allclose(rgb[row, column], scale(share)[:3], atol=0.01)
    assert episodes.depth_ticks(0.2, 0.8) == [0.2, 0.3, 0.4, 0.5, 0.6, 0.8]
    assert episodes.depth_ticks(0.1, 3.0) == [0.1, 0.2, 0.4, 0.8, 1.5, 3.0]


@pytest.fixture(scope="module")
def bottle() -> tuple[graspbox.Scene, graspbox.Plan]:
    """Prepare a scene with poses of both kinds: those that are ranked last fail."""
    scene = graspbox.Scene(object_sets.load("procedural:bottle:18")[0].load())
    ranked = graspbox.plan(scene.mesh, seed=0, world_from_object=scene.world_from_object).best()
    return scene, _rows(ranked, [*range(3), *range(len(ranked) - 40, len(ranked))])


@pytest.fixture(scope="module")
def both(bottle: tuple[graspbox.Scene, graspbox.Plan]) -> tuple[Trial, Trial]:
    return pictures.firm_and_failed(*bottle)


def test_a_plan_shows_every_pose_and_its_outcome(
    bottle: tuple[graspbox.Scene, graspbox.Plan],
    tmp_path: Path,
    figures: list[Figure],
    lines: list[dict[str, Any]],
) -> None:
    scene, plan = bottle
    count = 8
    some = _rows(plan, [0, 1, 2, *range(len(plan) - 8, len(plan))])
    example = GraspExample.run(scene, some)
    assert example.outcomes is not None
    assert example.trial is not None
    won = example.outcomes.success[:count]
    assert 0 < won.sum() < count
    pictures.save_plan(tmp_path / "plan.png", scene.mesh, some, example.outcomes, trial=example.trial, count=count)
    check_picture(tmp_path / "plan.png")
    (figure,) = figures
    boxes, poses, grasp = figure.axes
    # One outline per box, one glyph per pose in the colour of its outcome, and the one that is simulated in bold.
    assert sum(line["axes"] is boxes for line in lines) == len(plan.tree)
    shown = [line for line in lines if line["axes"] is poses]
    assert all(line["segments"].shape == (1 + 3 * len(scene.hand.chains), 2, 3) for line in shown)
    assert Counter(line["color"] for line in shown) == {SUCCESS: won.sum(), FAILURE: count - won.sum()}
    assert sum(line["width"] > 2 for line in shown) == 1
    for line in shown:
        rank = np.linalg.norm(some.world_from_object @ some.poses[:count, :, 3, None] - _origin(line), axis=1).argmin()
        assert (line["color"] == SUCCESS) == won[rank]
    assert boxes.get_title() == f"{len(plan.tree)} boxes, {plan.tree.volume * 1e6:.0f} cm³"
    assert poses.get_title() == f"{won.sum()} of the best {count} poses succeed"
    assert grasp.get_title() == f"pose {int(won.argmax()) + 1} (bold) simulated: held"
    assert {scene.mesh.name, "grasp pose succeeds", "grasp pose fails"} <= set(texts(figure))
    with pytest.raises(errors.ConfigError, match="11 outcomes for 12 poses"):
        pictures.save_plan(tmp_path / "few.png", scene.mesh, plan, example.outcomes, count=12)
    assert not (tmp_path / "few.png").exists()


def _origin(line: dict[str, Any]) -> Any:
    """Where the palm of a glyph is: the end of its stem, homogeneous."""
    return np.append(line["segments"][0, 1], 1.0)[:, None]


def test_a_plan_that_was_not_simulated_says_so(
    bottle: tuple[graspbox.Scene, graspbox.Plan], tmp_path: Path, figures: list[Figure], lines: list[dict[str, Any]]
) -> None:
    scene, plan = bottle
    pictures.save_plan(tmp_path / "plan.png", scene.mesh, plan, count=4)
    titles = [axes.get_title() for axes in figures[0].axes]
    assert titles[1:] == ["the best 4 poses, not simulated", "open hand at pose 1, not simulated"]
    assert Counter(line["color"] for line in lines if line["axes"] is figures[0].axes[1]) == {NOT_SIMULATED: 4}
    none = replace(plan, feasible=np.zeros(len(plan), dtype=bool))
    pictures.save_plan(tmp_path / "none.png", scene.mesh, none)
    assert [axes.get_title() for axes in figures[1].axes][1:] == ["the best 0 poses, not simulated", "no feasible pose"]
    check_picture(tmp_path / "none.png")


def test_neighbours_and_walls_are_grey_and_where_the_trial_left_them(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    drawn: list[list[Any]] = []
    plain = View.__init__

    def kept(self: View, solids: Any, *rest: Any, **settings: Any) -> None:
        drawn.append(list(solids))
        plain(self, solids, *rest, **settings)

    monkeypatch.setattr(View, "__init__", kept)
    meshes = [object_sets.load(f"procedural:{name}:1")[0].load() for name in ("box", "mug", "can")]
    heap = graspbox.arrange(meshes, "bin", seed=3, hand="panda_gripper")
    scene, others = graspbox.Scene.of(heap, target=0, hand="panda_gripper"), heap.without(0)
    plan = graspbox.plan(
        scene.mesh, hand="panda_gripper", world_from_object=scene.world_from_object, neighbours=others
    ).best(2)
    example = GraspExample.run(scene, plan)
    assert example.trial is not None
    settings: dict[str, Any] = {"trial": example.trial, "hand": "panda_gripper"}
    pictures.save_plan(tmp_path / "plan.png", scene.mesh, plan, example.outcomes, neighbours=others, **settings)
    check_picture(tmp_path / "plan.png")
    rest, end = drawn
    assert [solid.mesh.name for solid in rest[:3]] == ["box-000001", *(mesh.name for mesh in others.meshes)]
    assert {solid.color for solid in rest[1:3]} == {NEIGHBOUR} != {rest[0].color}
    assert [solid.color for solid in rest[3:]] == [WALL] * 4
    trace = example.trial.trace
    for solids, poses in ((rest, others.world_from_objects), (end, trace.world_from_others[-1])):
        np.testing.assert_allclose([solid.world_from_mesh for solid in solids[1:3]], poses)
    # A gallery takes them from the scene.
    drawn.clear()
    pictures.save_gallery(tmp_path / "gallery.png", [example], hand="panda_gripper")
    assert [len(solids) for solids in drawn] == [len(rest), len(end)]
    with pytest.raises(errors.ConfigError, match="1 neighbours of a trial with 2; pass those of its scene"):
        pictures.save_plan(
            tmp_path / "few.png", scene.mesh, plan, example.outcomes, neighbours=others.without(0), **settings
        )


def test_captions_count_and_name_outcomes(bottle: tuple[graspbox.Scene, graspbox.Plan]) -> None:
    assert [sweeps.count_boxes(n) for n in (1, 2)] == ["1 box", "2 boxes"]
    scene, plan = bottle
    lost = _rows(plan, [len(plan) - 1])
    example = GraspExample.run(scene, lost)
    assert example.outcomes is not None
    assert example.captions(20)[1:] == (
        "the best pose fails",
        f"pose 1 (bold) simulated: {example.outcomes.failure[0]}",
    )
    assert replace(example, trial=None).captions(20)[2] == f"open hand at pose 1: {example.outcomes.failure[0]}"
    assert GraspExample.run(scene, _rows(plan, [])).captions(20)[2] == "no feasible pose"


def test_a_gallery_has_a_column_for_each_object(
    bottle: tuple[graspbox.Scene, graspbox.Plan], tmp_path: Path, figures: list[Figure]
) -> None:
    scene, plan = bottle
    example = GraspExample.run(scene, _rows(plan, [0, 1]))
    pictures.save_gallery(tmp_path / "gallery.png", [example, example, example])
    check_picture(tmp_path / "gallery.png")
    (figure,) = figures
    assert len(figure.axes) == 9
    assert [axes.get_title() for axes in figure.axes] == [t for t in example.captions(20) for _ in range(3)]
    assert texts(figure).count(scene.mesh.name) == 3
    with pytest.raises(errors.ConfigError, match="0 examples; pass 1 to 8"):
        pictures.save_gallery(tmp_path / "none.png", [])


def test_kindness_is_named_and_is_the_sum_that_is_plotted(
    bottle: tuple[graspbox.Scene, graspbox.Plan], both: tuple[Trial, Trial], tmp_path: Path, figures: list[Figure]
) -> None:
    firm, failed = both
    assert firm.outcome.success[0]
    assert failed.outcome.failure[0] in ("slipped", "dropped")
    pictures.save_kindness(tmp_path / "kindness.png", "a bottle", failed, firm)
    check_picture(tmp_path / "kindness.png")
    (figure,) = figures
    assert trials.KINDNESS in texts(figure)
    assert "sum of |d distance/dt|" in trials.KINDNESS
    assert any("a bottle" in text for text in texts(figure))
    for axes, trial in zip(figure.axes, (failed, firm), strict=True):
        title = axes.get_title()
        assert f"kindness {trial.outcome.kindness[0]:.2g}" in title
        assert f"pose {trial.index + 1} of the ranking" in title
        assert f"lift {100 * trial.outcome.lift[0]:.1f} cm" in title
        time, speed = np.asarray(axes.lines[0].get_data())
        total = speed[time < 2.5].sum() / 100
        assert total == pytest.approx(trial.outcome.kindness[0], rel=0.05, abs=0.01)


def test_stages_name_the_object_and_what_happens(
    bottle: tuple[graspbox.Scene, graspbox.Plan], both: tuple[Trial, Trial], tmp_path: Path, figures: list[Figure]
) -> None:
    scene, (firm, failed) = bottle[0], both
    chosen = trials.stages(firm.trace)
    assert [name for name, _ in chosen] == ["open", "closed", "lifting", "held"]
    np.testing.assert_allclose(firm.trace.time[[i for _, i in chosen]], [0.0, 1.3, 1.8, 3.3], atol=0.011)
    pictures.save_stages(tmp_path / "stages.png", scene, [firm, failed])
    check_picture(tmp_path / "stages.png")
    (figure,) = figures
    assert scene.name in texts(figure)
    titles = [axes.get_title().split(",")[0] for axes in figure.axes]
    assert titles == ["open", "closed", "lifting", "held", "open", "closed", "lifting", failed.outcome.failure[0]]
    labels = [text for text in texts(figure) if "of the ranking" in text]
    assert labels == [
        f"pose {firm.index + 1} of the ranking: success",
        f"pose {failed.index + 1} of the ranking: {failed.outcome.failure[0]}",
    ]


def test_trials_that_show_nothing_are_refused(
    bottle: tuple[graspbox.Scene, graspbox.Plan], both: tuple[Trial, Trial], tmp_path: Path
) -> None:
    scene, plan = bottle
    far = plan.poses[:1].copy()
    far[:, :3, 3] += [0.0, 0.0, 0.5]
    with pytest.raises(ValueError, match="both kinds are needed"):
        pictures.firm_and_failed(scene, replace(_rows(plan, [0]), poses=far))
    inside = plan.poses[:1].copy()
    inside[:, :3, 3] = scene.center_of_mass
    still = Trial.run(scene, replace(_rows(plan, [0]), poses=inside), 0)
    assert still.outcome.failure[0] == "infeasible"
    with pytest.raises(errors.ConfigError, match="pose 1 is infeasible"):
        pictures.save_stages(tmp_path / "stages.png", scene, [still])
    with pytest.raises(errors.ConfigError, match="pose 1 is infeasible"):
        pictures.save_kindness(tmp_path / "kindness.png", "bottle", still, both[0])
    with pytest.raises(errors.ConfigError, match="0 trials; pass 1 to 8"):
        pictures.save_stages(tmp_path / "stages.png", scene, [])
    assert not list(tmp_path.iterdir())


def _rows(plan: graspbox.Plan, rows: list[int]) -> graspbox.Plan:
    names = ("poses", "preshape", "feasible", "score", "box", "face", "touch", "press")
    return replace(plan, **{name: getattr(plan, name)[rows] for name in names})


def test_learning_curves_name_their_band() -> None:
    pytest.importorskip("typer", reason="the scripts need typer, from the extra 'cli'")
    plot = imported(SCRIPTS / "plot_sb3.py")
    settings = {"algorithm": "ppo", "seed": 1, "id": "graspbox/Grasp-v0", "evaluate": "validation", "episodes": 100}
    rows = [{"success": 0.2, "ci95": [0.16, 0.3], "timesteps": 0, "seconds": 0}]
    rows += [{"success": 0.6, "ci95": [0.5, 0.65], "timesteps": 50, "seconds": 90}]
    figure = plot.success_figure([(settings, rows, {"planner": {"success": 0.96}})])
    for axes in figure.axes:
        low, high = axes.collections[0].get_paths()[0].get_extents().intervaly
        assert (low, high) == pytest.approx((0.16, 0.65))
    labels = [text.get_text() for text in figure.axes[0].get_legend().get_texts()]
    assert labels == ["ppo, seed 1 (band: Wilson's 95 % interval)", "planner: 96%"]


def test_committed_pictures_are_small_and_show_something() -> None:
    folder = Path(__file__).parents[2] / "docs" / "pictures"
    found = sorted(folder.glob("*.png"))
    assert len(found) >= 8
    for path in found:
        check_picture(path)


def test_frames_of_hands_are_drawn_where_they_are(
    figures: list[Figure], lines: list[dict[str, Any]], tmp_path: Path
) -> None:
    """The Franka Hand has a panel per frame; the fingers lie along x of one and y of the other."""
    pictures.save_hand_frames(tmp_path / "frames.png", ["panda_gripper", "reflex"])
    check_picture(tmp_path / "frames.png")
    (figure,) = figures
    titles = [axes.get_title() for axes in figure.axes]
    assert titles == [
        "panda_gripper: ACRONYM, GraspGen",
        "panda_gripper: Isaac Grasp, DexGraspBench",
        "reflex: all formats",
    ]
    drawn = [np.array([line["segments"][0] for line in lines if line["axes"] is axes]) for axes in figure.axes]
    ways = [segments[:, 1] - segments[:, 0] for segments in drawn]
    # Three axes of the grasp frame, then three of the other frame.
    gripper, base, reflex = (way / np.linalg.norm(way, axis=1, keepdims=True) for way in ways)
    np.testing.assert_allclose(gripper[3:], gripper[:3], atol=1e-9)
    np.testing.assert_allclose(base[4], base[0], atol=1e-9)
    np.testing.assert_allclose(reflex[3:], reflex[:3], atol=1e-9)
    np.testing.assert_allclose(drawn[0][3, 0] - drawn[0][0, 0], [0.0, 0.0, 0.066], atol=1e-9)


def test_a_closing_hand_has_a_row_per_preshape(
    figures: list[Figure], lines: list[dict[str, Any]], tmp_path: Path
) -> None:
    """The edges of both pads, the grasp centre and the axes; the pads come together."""
    pictures.save_hand_motion(tmp_path / "motion.png", "robotiq_2f_85")
    check_picture(tmp_path / "motion.png")
    (figure,) = figures
    stages = ("open", "half closed", "closed")
    titles = [f"preshape {preshape}, {stage}" for preshape in ("open", "half") for stage in stages]
    assert [axes.get_title() for axes in figure.axes] == titles
    apart = []
    for axes in figure.axes:
        drawn = [np.asarray(line["segments"]) for line in lines if line["axes"] is axes]
        assert [len(segments) for segments in drawn] == [12, 12, 3, 1, 1, 1]
        apart.append(abs(float(drawn[0][..., 0].mean() - drawn[1][..., 0].mean())))
    assert apart[0] > apart[1] > apart[2]
    assert apart[0] > apart[3] > apart[5]
