"""Many trials in both engines: equal and different labels, reasons for the differences, and speed.

Both engines get the same poses (`sampling`); poses in collision at the start in either engine are counted separately
and not compared.

Trials with different labels, or all trials, can be repeated in both engines at half their time step. If an engine then
changes its label, the label depends on numerics and the difference is no evidence about the model; otherwise the
engines disagree. If all trials are repeated, each engine's agreement with itself bounds the agreement to expect.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from typing import Literal

import numpy as np

import graspbox
from graspbox import _core
from graspbox.configs import PhysicsConfig, TrialConfig
from graspbox.errors import ConfigError
from graspbox.hands import HandLike, load_hand
from graspbox.hands.description import Array, HandDescription
from graspbox.hands.description import describe as of_hand
from graspbox.tools.scene_export.contents import object_data
from validation.mujoco.replay import Outcome, replay
from validation.mujoco.report import Report, Row
from validation.mujoco.sampling import Source, sample_trials
from validation.mujoco.scene import Numerics, ObjectData, build

#: Easy and hard, light and heavy, round and square: the objects of the hold suite, and one of each procedural family.
DEFAULT_OBJECTS = (
    "ycb:006_mustard_bottle",
    "ycb:005_tomato_soup_can",
    "ycb:011_banana",
    "ycb:025_mug",
    "ycb:013_apple",
    "ycb:043_phillips_screwdriver",
    "ycb:035_power_drill",
    "ycb:048_hammer",
    "ycb:061_foam_brick",
    "ycb:065-d_cups",
    "procedural:0",
)
#: Twenty of the YCB objects: cans, boxes, bottles, fruit, tools, cups, balls, light and heavy, for the planner's poses.
PLANNER_OBJECTS = tuple(
    f"ycb:{name}"
    for name in (
        "002_master_chef_can",
        "003_cracker_box",
        "004_sugar_box",
        "005_tomato_soup_can",
        "006_mustard_bottle",
        "007_tuna_fish_can",
        "010_potted_meat_can",
        "011_banana",
        "013_apple",
        "016_pear",
        "021_bleach_cleanser",
        "024_bowl",
        "025_mug",
        "035_power_drill",
        "037_scissors",
        "040_large_marker",
        "048_hammer",
        "056_tennis_ball",
        "061_foam_brick",
        "065-d_cups",
    )
)

#: Greatest mean distance of a contact area from its middle, metres.
_LARGEST_PATCH = 0.02
#: Trials to repeat at half the time step.
Repeat = Literal["none", "different", "all"]


def describe(hand: HandLike = "reflex") -> HandDescription:
    """Describe a hand."""
    return of_hand(load_hand(hand))


def replay_all(
    hand: HandDescription,
    item: ObjectData,
    poses: Array,
    preshapes: Array,
    numerics: Numerics,
    threads: int,
    *,
    early_stop: bool = False,
    patch: float = 0.0,
) -> Iterator[Outcome]:
    """Replay trials of one object in MuJoCo, in order; `poses` are ``world_from_hand``, `patch` as for `build`."""
    scene = build(hand, item, numerics=numerics, patch=patch)

    def run(pose: Array, preshape: float) -> Outcome:
        return replay(scene, pose, float(preshape), early_stop=early_stop)

    with ThreadPoolExecutor(threads) as pool:
        # MuJoCo releases the GIL while it steps.
        yield from pool.map(run, poses, preshapes)


def halve(scene: graspbox.Scene) -> graspbox.Scene:
    """Make a scene with the same object and pose at half the time step."""
    half = PhysicsConfig(dt=0.5 * PhysicsConfig.dt)
    return graspbox.Scene(scene.mesh, hand=scene.hand, physics=half, world_from_object=scene.world_from_object)


def _repeat(
    scene: graspbox.Scene, hand: HandDescription, rows: list[Row], numerics: Numerics, threads: int
) -> list[Row]:
    """Repeat rows of one object in both engines at half their time step."""
    if not rows:
        return rows
    poses, preshapes = np.stack([row.object_from_hand for row in rows]), np.array([row.preshape for row in rows])
    core = halve(scene).simulate(poses, preshapes, num_threads=threads).success
    fine = replace(numerics, timestep=0.5 * numerics.timestep)
    worlds = np.stack([row.world_from_hand for row in rows])
    theirs = replay_all(hand, object_data(scene), worlds, preshapes, fine, threads)
    return [
        replace(row, halved=(bool(ours), outcome.success))
        for row, ours, outcome in zip(rows, core, theirs, strict=True)
    ]


def check_patch(patch: float) -> None:
    """Refuse a mean distance of a contact area from its middle that is out of range; metres."""
    if not 0.0 <= patch <= _LARGEST_PATCH:
        raise ConfigError(f"patch is {patch}; give metres, 0 to {_LARGEST_PATCH}")


def check_settings(trials: int, numerics: Numerics) -> None:
    """Raise `ConfigError` if there are no trials, or MuJoCo's time step is not positive."""
    if trials < 1:
        raise ConfigError(f"trials is {trials}; give 1 or more")
    if not 0.0 < numerics.timestep <= 0.01:
        raise ConfigError(f"timestep is {numerics.timestep}; give at most 0.01 s")


def scenes(
    objects: Sequence[str], trials: int, seed: int, hand: graspbox.Hand
) -> Iterator[tuple[graspbox.Scene, int, np.random.Generator]]:
    """Distribute trials evenly over objects; yields each object's scene, number of trials and random generator."""
    specs = graspbox.object_sets.load(list(objects))
    share, rest = divmod(trials, len(specs))
    for number, spec in enumerate(specs):
        count = share + (number < rest)
        if count > 0:
            yield graspbox.Scene(spec.load(), hand=hand), count, np.random.default_rng([seed, number])


def compare(
    objects: Sequence[str] = DEFAULT_OBJECTS,
    trials: int = 200,
    seed: int = 0,
    *,
    source: Source = "random",
    hand: HandLike = "reflex",
    threads: int | None = None,
    numerics: Numerics | None = None,
    repeat: Repeat = "different",
    progress: Callable[[int], None] | None = None,
) -> Report:
    """Label `trials` feasible grasps, distributed evenly over the objects, in both engines.

    Parameters
    ----------
    objects : sequence of str
        Object sets.
    trials : int
        Number of trials, at least one.
    seed : int
        Seed of the poses.
    source : str
        Source of the poses; see `sampling.Source`.
    hand : str, Hand or pair of paths
        See `graspbox.load_hand`.
    threads : int, optional
        Number of threads for both engines; by default that of the core.
    numerics : Numerics, optional
        MuJoCo's settings.
    repeat : str
        Trials to repeat at half the time step: ``none``, those with ``different`` labels, or ``all``.
    progress : callable, optional
        Called after each object with the number of finished trials.

    Raises
    ------
    ConfigError
        If there are no trials, or MuJoCo's time step is not positive.
    """
    numerics = numerics or Numerics()
    check_settings(trials, numerics)
    loaded = load_hand(hand)
    described = describe(loaded)
    report = Report(threads=threads or _core.num_threads())
    done = 0
    for scene, count, random in scenes(objects, trials, seed, loaded):
        sampled = sample_trials(scene, count, random, source)
        done += count
        if sampled is None:
            report.left_out.append(scene.name)
        else:
            rows = judge(report, scene, described, sampled, numerics)
            chosen = [row for row in rows if repeat == "all" or (repeat == "different" and not row.equal)]
            repeated = iter(_repeat(scene, described, chosen, numerics, report.threads))
            picked = {id(row) for row in chosen}
            report.rows += [next(repeated) if id(row) in picked else row for row in rows]
        if progress is not None:
            progress(done)
    return report


def judge(
    report: Report,
    scene: graspbox.Scene,
    hand: HandDescription,
    sampled: tuple[Array, Array],
    numerics: Numerics,
    patch: float = 0.0,
) -> list[Row]:
    """Label poses (m, 4, 4), ``object_from_hand``, with preshapes (m,) in both engines; adds times to the report.

    A pose that is in collision at the start in MuJoCo has no row; the report counts it.
    """
    poses, preshapes = sampled
    item = object_data(scene)
    clock = time.perf_counter
    begin = clock()
    ours = scene.simulate(poses, preshapes, num_threads=report.threads)
    early = clock()
    full = scene.simulate(poses, preshapes, config=TrialConfig(early_stop=False), num_threads=report.threads)
    middle = clock()
    world_poses = item.world_from_object @ poses
    theirs = list(replay_all(hand, item, world_poses, preshapes, numerics, report.threads, patch=patch))
    report.mujoco_seconds += clock() - middle
    report.core_full_seconds += middle - early
    report.core_seconds += early - begin
    report.early_stop_changed += int(np.sum(full.success != ours.success))
    rows = []
    for i, outcome in enumerate(theirs):
        if outcome.failure == "infeasible":
            report.infeasible += 1
            continue
        rows.append(
            Row(
                object=scene.name,
                success=bool(ours.success[i]),
                failure=str(ours.failure[i]),
                lift=float(ours.lift[i]),
                mujoco=outcome,
                world_from_hand=world_poses[i],
                object_from_hand=poses[i],
                preshape=float(preshapes[i]),
            )
        )
    return rows
