"""What happens in a trial: kindness over time, and the grasp in stages."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from graspbox.configs import TrialConfig
from graspbox.errors import ConfigError
from graspbox.pictures.solids import FAILURE, OBJECT, SUCCESS, place
from graspbox.pictures.view import Camera, Floats, PosedHand, Solid, View, pixels, write
from graspbox.planning import Plan
from graspbox.simulation import Outcomes, Scene, Trace


@dataclass(frozen=True, eq=False)
class Trial:
    """One traced trial of a plan.

    Attributes
    ----------
    index : int
        Its pose's place in the plan.
    preshape : float
        Radians.
    outcome : Outcomes
        Of length one.
    trace : Trace
        Its samples.
    """

    index: int
    preshape: float
    outcome: Outcomes
    trace: Trace

    @classmethod
    def run(cls, scene: Scene, plan: Plan, index: int) -> "Trial":
        """Trace the trial of pose `index`, to its end."""
        preshape = float(plan.preshape[index])
        outcome, trace = scene.trace(plan.poses[index], preshape, config=TrialConfig(legacy=True))
        return cls(index, preshape, outcome, trace)


def speeds(trace: Trace) -> tuple[Floats, Floats]:
    """Derive |d distance/dt| in m/s at the middle of each sample step: times (t - 1,), speeds (t - 1,)."""
    steps = np.diff(trace.time)
    return trace.time[:-1] + steps / 2, np.abs(np.diff(trace.distance)) / steps


def firm_and_failed(scene: Scene, plan: Plan) -> tuple[Trial, Trial]:
    """Choose two trials of a plan to set side by side.

    The firm one is the success that moves least in the hand (least `kindness_rate`, then rank). The failed one is the
    first in the ranking that the hand has lifted by at least a centimetre and that lies lower than 5 cm in the end;
    else the first that slipped or dropped.

    Raises
    ------
    ConfigError
        If the plan's poses all succeed, or none does.
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


def save_kindness(path: Path, name: str, failed: Trial, firm: Trial) -> None:
    """Write |d distance/dt| between hand and object over time, of a failed and a firm grasp.

    Its sum is the study's kindness (figures 3.17 and 3.18): near zero for a firm grasp, a spike for each slip. Both
    panels have the same scale.

    Parameters
    ----------
    path : Path
        The picture's file.
    name : str
        The object's name.
    failed, firm : Trial
        The trials.
    """
    config, top = TrialConfig(), 1.0
    total = config.close_time + config.lift_time + config.hold_time
    figure = Figure(figsize=(8, 5.4), dpi=110)
    panels = figure.subplots(2, 1, sharex=True, sharey=True)
    for axes, trial, color, what in ((panels[0], failed, FAILURE, "failed"), (panels[1], firm, SUCCESS, "firm")):
        time, speed = speeds(trial.trace)
        _mark_phases(axes, config)
        axes.fill_between(time, 0.0, 100 * speed, color=color, alpha=0.35, linewidth=0)
        axes.plot(time, 100 * speed, color=color, linewidth=1.2)
        top = max(top, 100 * float(speed.max()))
        told = trial.outcome.failure[0] or "success"
        axes.set_title(
            f"{what} grasp (pose {trial.index + 1} of the ranking): {told}, kindness {trial.outcome.kindness[0]:.2g}, "
            f"object lifted by {100 * trial.outcome.lift[0]:.1f} cm",
            fontsize=10,
        )
        if time[-1] < total - 0.05:
            axes.text(time[-1] + 0.03, 0.3 * top, "the trial\nends: lost", color="#666666", fontsize=8)
        axes.set_ylabel("|d distance/dt|  (cm/s)")
        axes.grid(axis="y", color="#dddddd", linewidth=0.6)
        axes.set_axisbelow(True)
    axes.set_ylim(0, 1.2 * top)
    axes.set_xlim(0, total)
    axes.set_xlabel("time since closing began (s)")
    figure.suptitle(f"{name}: speed at which the object moves towards or away from the hand", fontsize=11)
    figure.tight_layout()
    write(figure, path)


def _mark_phases(axes: Any, config: TrialConfig) -> None:
    ends = np.cumsum([0.0, config.close_time, config.lift_time, config.hold_time])
    for index, name in enumerate(("close", "lift", "hold")):
        axes.axvspan(ends[index], ends[index + 1], color=("#f1f3f5", "#ffffff", "#f1f3f5")[index], zorder=-2)
        middle, in_axes = (ends[index] + ends[index + 1]) / 2, axes.get_xaxis_transform()
        axes.text(middle, 0.92, name, transform=in_axes, ha="center", va="center", color="#666666", fontsize=9)


def stages(trace: Trace, config: TrialConfig = TrialConfig()) -> list[tuple[str, int]]:  # noqa: B008 (frozen)
    """Name four samples of a trial: open, closed, lifting, held."""
    lifted = config.close_time + config.lift_time
    wanted = (
        ("open", 0.0),
        ("closed", config.close_time),
        ("lifting", config.close_time + config.lift_time / 2),
        ("held", lifted + config.hold_time),
    )
    return [(name, int(np.abs(trace.time - time).argmin())) for name, time in wanted]


def save_stages(path: Path, scene: Scene, trials: Sequence[Trial], *, camera: Camera | None = None) -> None:
    """Write each trial as a row of four stages: open, closed, lifting, held (or lost).

    Parameters
    ----------
    path : Path
        The picture's file.
    scene : Scene
        The object and the hand.
    trials : sequence of Trial
        The trials of this scene.
    camera : Camera, optional
        From where to look; by default across the first hand's approach.
    """
    figure = Figure(figsize=(10, 3.7 * len(trials)), dpi=120)
    panels = figure.subplots(len(trials), 4, squeeze=False)
    figure.subplots_adjust(
        left=0.005, right=0.995, bottom=0.01, top=1 - 0.27 / (3.7 * len(trials)), wspace=0.02, hspace=0.1
    )
    for row, trial in zip(panels, trials, strict=True):
        trace = trial.trace
        chosen = stages(trace)
        eye = camera or Camera.across(trace.world_from_hand[0, :3, 2], elevation=14.0)
        hands = [_hand(scene, trial, sample) for _, sample in chosen]
        objects = [trace.world_from_object[sample] for _, sample in chosen]
        vertices = scene.mesh.vertices
        shown = np.concatenate([*(h.corners() for h in hands), *(place(vertices, pose) for pose in objects)])
        for axes, (name, sample), hand, pose in zip(row, chosen, hands, objects, strict=True):
            surface = Solid(scene.mesh, OBJECT, pose)
            View([surface], eye, shown=shown, size=pixels(axes), hand=hand, ground=True).show(axes)
            lost = name == "held" and not trial.outcome.success[0]
            told = f"{trial.outcome.failure[0]}" if lost else name
            axes.set_title(f"{told}, {trace.time[sample]:.2f} s", fontsize=10)
    write(figure, path, palette=False)


def _hand(scene: Scene, trial: Trial, sample: int) -> PosedHand:
    trace = trial.trace
    return PosedHand(scene.hand, trace.world_from_hand[sample], trial.preshape, trace.fingers[sample])
