"""Pictures of trials: relative speed of hand and object over time (kindness), stages of the grasp, and videos."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from graspbox._common.colors import FAILURE, OBJECT, OBJECTS, SUCCESS
from graspbox.configs import TrialConfig
from graspbox.errors import ConfigError
from graspbox.meshes.shapes import Floats
from graspbox.pictures.files import PathLike, check_path, pixels, write
from graspbox.pictures.hands import PosedHand
from graspbox.pictures.solids import Solid, solids_of
from graspbox.pictures.videos import check_video, save_video
from graspbox.pictures.view import Camera, View
from graspbox.planning import Plan
from graspbox.simulation import Hand, Outcomes, Scene, Trace
from graspbox.simulation.neighbours import Neighbours

#: Definition of kindness in the picture.
KINDNESS = (
    "kindness (reference study, figures 3.17 and 3.18): sum of |d distance/dt| between hand frame and object frame\n"
    "over the samples, one per 10 ms, of the first 2.5 s; in m/s. Low for a firm grasp, high if the object slips."
)
#: Greatest number of rows of stages.
_MOST_ROWS = 8
#: Elevation of the camera, degrees: at the hand's side, or from above where other objects or walls occlude it.
BESIDE, ABOVE = 18.0, 35.0
#: Seconds of a trial from one picture of a video to the next.
_PERIOD = 0.1


@dataclass(frozen=True, eq=False)
class Trial:
    """One recorded trial: index of its pose in the plan, preshape, outcome (of length 1) and samples."""

    index: int
    preshape: float
    outcome: Outcomes
    trace: Trace

    @classmethod
    def run(cls, scene: Scene, plan: Plan, index: int) -> "Trial":
        """Run and record the trial of pose `index` of a plan, with the reference study's measures."""
        preshape = float(plan.preshape[index])
        outcome, trace = scene.trace(plan.poses[index], preshape, config=TrialConfig(legacy=True))
        return cls(index, preshape, outcome, trace)

    def posed(self, hand: Hand, sample: int) -> PosedHand:
        """Return the hand at a sample of the trace."""
        return PosedHand(hand, self.trace.world_from_hand[sample], self.trace.joints[sample])


def speeds(trace: Trace) -> tuple[Floats, Floats]:
    """Return the mean times (t - 1,) of consecutive samples, and |d distance/dt| (t - 1,) between them, m/s."""
    steps = np.diff(trace.time)
    return trace.time[:-1] + steps / 2, np.abs(np.diff(trace.distance)) / steps


def firm_and_failed(scene: Scene, plan: Plan) -> tuple[Trial, Trial]:
    """Select a firm and a failed trial of a plan for comparison.

    The firm one is the success whose object moves least in the hand (least `kindness_rate`, then rank). The failed one
    is the best-ranked that lifts the object by at least 1 cm and ends with it below 5 cm; if there is none, the
    best-ranked that slips or drops.

    Raises
    ------
    ConfigError
        If no pose of the plan succeeds, or none slips or drops.
    """
    out = scene.simulate(plan.poses, plan.preshape, config=TrialConfig(legacy=True))
    low = out.lift < 0.05
    won = np.flatnonzero(out.success)
    lost = np.flatnonzero(np.isin(out.failure, ("slipped", "dropped")))
    if not len(won) or not len(lost):
        raise ConfigError(f"{len(won)} of {len(out)} poses hold and {len(lost)} slip or drop; both kinds are needed")
    firm = Trial.run(scene, plan, int(won[np.argmin(out.kindness_rate[won])]))
    for index in lost[low[lost]]:
        trial = Trial.run(scene, plan, int(index))
        height = trial.trace.world_from_object[:, 2, 3]
        if height.max() - height[0] > 0.01:
            return firm, trial
    return firm, Trial.run(scene, plan, int(lost[0]))


def save_kindness(path: PathLike, name: str, failed: Trial, firm: Trial) -> None:
    """Save a plot of |d distance/dt| between hand and object over time, for a failed and a firm grasp.

    The reference study's kindness (its figures 3.17 and 3.18) is the sum of these speeds over the samples of the first
    2.5 s: near zero for a firm grasp, a spike for each slip. Both panels have the same scale.

    Raises
    ------
    ConfigError, FileError
        As `check_path`; also for a trial of an infeasible pose, which has no samples.
    """
    target = check_path(path)
    for trial in (failed, firm):
        if len(trial.trace.time) < 2:
            raise ConfigError(f"pose {trial.index + 1} is infeasible: nothing moved, so there is no speed to plot")
    config = TrialConfig()
    top = max(1.0, *(100 * float(speeds(trial.trace)[1].max()) for trial in (failed, firm)))
    figure = Figure(figsize=(8, 6.0), dpi=110)
    panels = figure.subplots(2, 1, sharex=True, sharey=True)
    for axes, trial, color in ((panels[0], failed, FAILURE), (panels[1], firm, SUCCESS)):
        _plot_speed(axes, trial, color, config, top)
    total = config.close_time + config.lift_time + config.hold_time
    panels[1].set(ylim=(0, 1.2 * top), xlim=(0, total), xlabel="time since closing began (s)")
    figure.suptitle(f"{name}: relative speed of hand and object", fontsize=12, weight="bold", y=0.993)
    figure.text(0.5, 0.922, KINDNESS, ha="center", va="center", fontsize=9, color="#444444")
    figure.tight_layout(rect=(0, 0, 1, 0.945))
    write(figure, target)


def _plot_speed(axes: Any, trial: Trial, color: str, config: TrialConfig, top: float) -> None:
    """Plot the speed of one trial, cm/s, with the trial's phases and measures."""
    time, speed = speeds(trial.trace)
    total = config.close_time + config.lift_time + config.hold_time
    _mark_phases(axes, config)
    axes.fill_between(time, 0.0, 100 * speed, color=color, alpha=0.35, linewidth=0)
    axes.plot(time, 100 * speed, color=color, linewidth=1.2)
    axes.set_title(kindness_caption(trial), fontsize=10)
    if time[-1] < total - 0.05:
        axes.text(time[-1] + 0.03, 0.3 * top, "object lost:\ntrial ends", color="#666666", fontsize=8)
    axes.set_ylabel("|d distance/dt|  (cm/s)")
    axes.grid(axis="y", color="#dddddd", linewidth=0.6)
    axes.set_axisbelow(True)


def kindness_caption(trial: Trial) -> str:
    """Format a trial's rank, outcome, kindness and lift."""
    out = trial.outcome
    return (
        f"pose {trial.index + 1} of the ranking: {out.failure[0] or 'success'}, kindness {out.kindness[0]:.2g}, "
        f"lift {100 * out.lift[0]:.1f} cm"
    )


def _mark_phases(axes: Any, config: TrialConfig) -> None:
    ends = np.cumsum([0.0, config.close_time, config.lift_time, config.hold_time])
    for index, name in enumerate(("close", "lift", "hold")):
        axes.axvspan(ends[index], ends[index + 1], color=("#f1f3f5", "#ffffff", "#f1f3f5")[index], zorder=-2)
        middle, in_axes = (ends[index] + ends[index + 1]) / 2, axes.get_xaxis_transform()
        axes.text(middle, 0.92, name, transform=in_axes, ha="center", va="center", color="#666666", fontsize=9)


def stages(trace: Trace, config: TrialConfig = TrialConfig()) -> list[tuple[str, int]]:  # noqa: B008 (frozen)
    """Return names and indices of four samples of a trial: open, closed, lifting, held."""
    lifted = config.close_time + config.lift_time
    wanted = (
        ("open", 0.0),
        ("closed", config.close_time),
        ("lifting", config.close_time + config.lift_time / 2),
        ("held", lifted + config.hold_time),
    )
    return [(name, int(np.abs(trace.time - time).argmin())) for name, time in wanted]


def save_stages(path: PathLike, scene: Scene, trials: Sequence[Trial], *, camera: Camera | None = None) -> None:
    """Save each trial as a row of four stages: open, closed, lifting, held (or the kind of failure).

    In a scene of several objects, all of them are drawn where they are at each stage, and its walls.

    Parameters
    ----------
    trials : sequence of Trial
        1 to 8 trials of this scene, of feasible poses.
    camera : Camera, optional
        Viewing direction; by default across the first hand's approach.

    Raises
    ------
    ConfigError, FileError
        As `save_kindness`, and for another number of trials.
    """
    target = check_path(path)
    if not 1 <= len(trials) <= _MOST_ROWS:
        raise ConfigError(f"{len(trials)} trials; pass 1 to {_MOST_ROWS}")
    for trial in trials:
        _check_moved(trial, "there are no stages to show")
    height = 3.5 * len(trials) + 0.45
    figure = Figure(figsize=(10.5, height), dpi=115)
    panels = figure.subplots(len(trials), 4, squeeze=False)
    figure.subplots_adjust(left=0.03, right=0.997, bottom=0.06 / height, top=1 - 0.68 / height, wspace=0.02, hspace=0.1)
    for row, trial in zip(panels, trials, strict=True):
        _stages_row(row, scene, trial, camera)
    figure.suptitle(scene.name, fontsize=12, weight="bold", y=1 - 0.1 / height)
    write(figure, target, palette=False)


def save_trial(
    path: PathLike,
    scene: Scene,
    trial: Trial,
    *,
    camera: Camera | None = None,
    size: tuple[int, int] = (480, 400),
) -> None:
    """Save a trial of a scene as a video, 10 pictures per second: the hand, and every object and wall.

    Parameters
    ----------
    camera : Camera, optional
        Viewing direction; by default across the first hand's approach.
    size : (int, int)
        Columns and rows of the pictures, 16 to 4096.

    Raises
    ------
    ConfigError, FileError, MissingExtraError
        As `save_video`; also for a trial without samples, or a size out of range.
    """
    target = check_video(path)
    if len(size) != 2 or not all(16 <= side <= 4096 for side in size):
        raise ConfigError(f"size is {size!r}; pass columns and rows, 16 to 4096 pixels")
    _check_moved(trial, "there is no video to show")
    time = trial.trace.time
    samples = np.unique(np.searchsorted(time, np.arange(0.0, time[-1] + _PERIOD, _PERIOD)).clip(max=len(time) - 1))
    captions = [f"{scene.name}, {time[sample]:.1f} s" for sample in samples]
    captions[-1] += f": {trial.outcome.failure[0] or 'success'}"
    save_video(target, [view.image for view in views(scene, trial, samples, camera, size)], captions, seconds=_PERIOD)


def _check_moved(trial: Trial, so: str) -> None:
    """Refuse a trial without samples."""
    if not len(trial.trace.time):
        raise ConfigError(f"pose {trial.index + 1} is infeasible: nothing moved, so {so}")


def objects_at(scene: Scene, trace: Trace, sample: int) -> list[Solid]:
    """Return the objects of a scene where they are at a sample of a trace: its object, the others, and its walls."""
    around = Neighbours.of(scene)._replace(world_from_objects=trace.world_from_others[sample])
    return [Solid(scene.mesh, OBJECT, trace.world_from_object[sample]), *solids_of(around, OBJECTS[1:])]


def views(
    scene: Scene, trial: Trial, samples: Iterable[int], camera: Camera | None, size: tuple[int, int]
) -> Iterator[View]:
    """Draw samples of a trial one by one, all from the same place."""
    trace = trial.trace
    elevation = ABOVE if scene.others or len(scene.world_from_walls) else BESIDE
    eye = camera or Camera.across(trace.world_from_hand[0, :3, 2], elevation=elevation)
    drawn = [(objects_at(scene, trace, int(sample)), trial.posed(scene.hand, int(sample))) for sample in samples]
    points = [[hand.corners(), *(solid.points for solid in solids)] for solids, hand in drawn]
    shown = np.concatenate([part for parts in points for part in parts])
    for solids, hand in drawn:
        yield View(solids, eye, shown=shown, size=size, hand=hand, table=shown)


def _stages_row(row: Sequence[Any], scene: Scene, trial: Trial, camera: Camera | None) -> None:
    chosen = stages(trial.trace)
    drawn = views(scene, trial, [sample for _, sample in chosen], camera, pixels(row[0]))
    for axes, (name, sample), view in zip(row, chosen, drawn, strict=True):
        view.show(axes)
        stage = (name == "held" and str(trial.outcome.failure[0])) or name
        axes.set_title(f"{stage}, {trial.trace.time[sample]:.2f} s", fontsize=10)
    label = f"pose {trial.index + 1} of the ranking: {trial.outcome.failure[0] or 'success'}"
    row[0].annotate(label, (-0.06, 0.5), xycoords="axes fraction", rotation=90, va="center", ha="center", fontsize=10)
