"""Comparison of the physics engines: labels and speed on the same planner poses.

For each object in turn, the best poses are tried with each engine and with each at half its time step, so that changes
of the machine's speed affect all runs. Rates are trials per second of CPU time. With a layout, each object of a scene
of several is the target in turn; the scene comes to rest once, with the default physics, and is the same for all runs.
"""

import argparse
import json
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from typing import Any, get_args

import numpy as np
from numpy.typing import NDArray

import graspbox
from graspbox import object_sets
from graspbox.configs import PhysicsConfig
from graspbox.errors import ConfigError
from graspbox.hands import HandLike
from graspbox.simulation.layouts import Arrangement, Layout, SceneLayout, draw_objects
from validation.agreement import kappa

#: A mix of shapes without mesh files.
DEFAULT_OBJECTS = (
    "procedural:ball:2",
    "procedural:box:2",
    "procedural:can:2",
    "procedural:mug:2",
    "procedural:bottle:2",
    "procedural:bowl:2",
)

#: Objects of which scenes of several are made.
HEAPED = "procedural:seen:0-19"

_HALF = PhysicsConfig().dt / 2

#: Settings of the runs to compare, by name.
RUNS = {
    "implicit": PhysicsConfig(engine="implicit"),
    "implicit, half dt": PhysicsConfig(engine="implicit", dt=_HALF),
    "rapier": PhysicsConfig(engine="rapier"),
    "rapier, half dt": PhysicsConfig(engine="rapier", dt=_HALF),
}

#: Names of the engines.
ENGINES = ("implicit", "rapier")

#: Pairs of runs whose labels are compared.
PAIRS = (("implicit", "rapier"), ("implicit", "implicit, half dt"), ("rapier", "rapier, half dt"))


@dataclass(frozen=True)
class EngineRow:
    """Results of one run of trials.

    Attributes
    ----------
    name : str
        Engine and time step.
    trials, succeeded, secure : int
        Numbers of trials, successes and secure holds.
    trials_per_second, simulated_per_second : float
        Trials, and simulated seconds, per second of CPU time.
    unconverged_per_million : float
        Steps in which the solver did not converge, per million steps; 0 for rapier, which does not measure it.
    """

    name: str
    trials: int
    succeeded: int
    secure: int
    trials_per_second: float
    simulated_per_second: float
    unconverged_per_million: float


@dataclass(frozen=True)
class Agreement:
    """Agreement of the labels of two runs: the share of equal labels, and Cohen's kappa."""

    first: str
    second: str
    share: float
    kappa: float


@dataclass(frozen=True)
class Case:
    """Poses to try in one scene.

    Attributes
    ----------
    scene : callable
        Makes the scene with a physics.
    plan : Plan
        Poses of the hand for the object or target.
    """

    scene: Callable[[PhysicsConfig], graspbox.Scene]
    plan: graspbox.Plan


def targets(
    objects: Sequence[str], layout: Layout, sizes: tuple[int, int], hand: HandLike, poses: int, seed: int
) -> Iterator[tuple[Arrangement, int, graspbox.Plan]]:
    """Make scenes of several objects, and plan for each object as the target.

    Parameters
    ----------
    objects : sequence of str
        Object sets from which each scene draws its objects.
    layout : str
        How the objects lie.
    sizes : (int, int)
        Number of scenes, and of objects wanted in each.
    hand : str, Hand or pair of paths
        The hand.
    poses : int
        Most poses for each target.
    seed : int
        Seed of the first scene and of the planner.

    Yields
    ------
    tuple of Arrangement, int, Plan
        The scene, the target's index in it, and its best poses; targets without a pose are left out.

    Raises
    ------
    ConfigError
        For an unknown object set, or one that is empty.
    """
    specs, (scenes, count) = object_sets.load(tuple(objects)), sizes
    for number in range(seed, seed + scenes):
        meshes = [spec.load() for spec in draw_objects(specs, count, layout, number)]
        heap = graspbox.arrange(meshes, layout, most=count, seed=number, hand=hand)
        for target, mesh in enumerate(heap.meshes):
            pose, others = heap.world_from_objects[target], heap.without(target)
            plan = graspbox.plan(mesh, hand=hand, world_from_object=pose, seed=seed, neighbours=others).best(poses)
            if len(plan):
                yield heap, target, plan


def single_objects(objects: Sequence[str], hand: HandLike, poses: int, seed: int) -> Iterator[Case]:
    """Yield the planner's best `poses` for every object, which rests by itself on the table."""
    for item in (item for name in objects for item in object_sets.load(name)):
        rest = graspbox.Scene(item.load(), hand=hand)
        start = rest.world_from_object
        plan = graspbox.plan(rest.mesh, hand=hand, world_from_object=start, seed=seed).best(poses)
        yield Case(partial(_alone, rest.mesh, start, hand), plan)


def _alone(mesh: graspbox.Mesh, start: NDArray[np.float64], hand: HandLike, physics: PhysicsConfig) -> graspbox.Scene:
    return graspbox.Scene(mesh, hand=hand, world_from_object=start, physics=physics)


def _among(heap: Arrangement, target: int, hand: HandLike, physics: PhysicsConfig) -> graspbox.Scene:
    return graspbox.Scene.of(heap, target=target, hand=hand, physics=physics)


def compare(cases: Iterable[Case], engines: Sequence[str]) -> tuple[list[EngineRow], list[Agreement]]:
    """Try the poses of all cases in every run of the engines.

    Returns
    -------
    rows : list of EngineRow
        One per entry of `RUNS` with one of the engines.
    agreements : list of Agreement
        One per entry of `PAIRS` whose runs have such an engine.

    Raises
    ------
    SimulationError
        If an engine cannot simulate the hand.
    """
    runs = {name: physics for name, physics in RUNS.items() if physics.engine in engines}
    outcomes: dict[str, list[graspbox.Outcomes]] = {name: [] for name in runs}
    seconds = dict.fromkeys(runs, 0.0)
    for case in cases:
        for name, physics in runs.items():
            scene = case.scene(physics)
            start = time.process_time()
            outcomes[name].append(scene.simulate(case.plan.poses, case.plan.preshape))
            seconds[name] += time.process_time() - start
    if not any(outcomes.values()):
        raise ConfigError("no object has a feasible pose; give other objects, or more scenes")
    rows = [_row(name, outcomes[name], seconds[name]) for name in runs]
    labels = {name: np.concatenate([o.success for o in outcomes[name]]) for name in runs}
    agreements = [
        Agreement(a, b, float(np.mean(labels[a] == labels[b])), kappa(labels[a], labels[b]))
        for a, b in PAIRS
        if a in runs and b in runs
    ]
    return rows, agreements


def _row(name: str, outcomes: Sequence[graspbox.Outcomes], seconds: float) -> EngineRow:
    def total(field: str) -> float:
        return float(sum(getattr(o, field).sum() for o in outcomes))

    trials, simulated = sum(len(o) for o in outcomes), total("time")
    return EngineRow(
        name=name,
        trials=trials,
        succeeded=int(total("success")),
        secure=int(total("secure")),
        trials_per_second=trials / seconds,
        simulated_per_second=simulated / seconds,
        unconverged_per_million=1e6 * total("unconverged_steps") / (simulated / RUNS[name].dt),
    )


def markdown(rows: Sequence[EngineRow], agreements: Sequence[Agreement]) -> str:
    """Write both tables."""
    lines = ["| engine | succeeded | secure | trials/s | simulated s/s | unconverged steps per million |"]
    lines.append("|---|---|---|---|---|---|")
    for r in rows:
        counts = f"{r.succeeded} of {r.trials} | {r.secure}"
        rates = f"{r.trials_per_second:.1f} | {r.simulated_per_second:.0f} | {r.unconverged_per_million:.0f}"
        lines.append(f"| {r.name} | {counts} | {rates} |")
    lines += ["", "| labels | equal | kappa |", "|---|---|---|"]
    lines += [f"| {a.first} and {a.second} | {100 * a.share:.1f} % | {a.kappa:.2f} |" for a in agreements]
    return "\n".join(lines)


def main(arguments: list[str] | None = None) -> int:
    """Compare the engines on some objects; returns the exit status."""
    parser = argparse.ArgumentParser(prog="python tests/validate.py engines", description=__doc__)
    parser.add_argument("--objects", nargs="+", metavar="SPEC", help=f"object sets; of a layout by default {HEAPED}")
    parser.add_argument("--layout", default="single", choices=get_args(SceneLayout), help="how several objects lie")
    parser.add_argument("--scenes", type=int, default=10, help="scenes of a layout")
    parser.add_argument("--count", type=int, default=5, help="objects per scene of a layout")
    parser.add_argument("--hand", default="reflex", help="a hand by its name, or hand.urdf,hand.toml")
    parser.add_argument("--engines", nargs="+", default=list(ENGINES), choices=ENGINES, help="engines to compare")
    parser.add_argument("--poses", type=int, default=20, help="poses per object")
    parser.add_argument("--seed", type=int, default=0, help="seed of the planner and of the scenes")
    parser.add_argument("--json", action="store_true", help="print the tables as JSON")
    args = parser.parse_args(arguments)
    for name in ("poses", "scenes", "count"):
        if getattr(args, name) < 1:
            parser.error(f"--{name} is {getattr(args, name)}; give 1 or more")
    if args.layout == "single":
        cases = single_objects(args.objects or DEFAULT_OBJECTS, args.hand, args.poses, args.seed)
    else:
        sizes = (args.scenes, args.count)
        heaps = targets(args.objects or (HEAPED,), args.layout, sizes, args.hand, args.poses, args.seed)
        cases = (Case(partial(_among, heap, target, args.hand), plan) for heap, target, plan in heaps)
    rows, agreements = compare(cases, args.engines)
    tables: dict[str, Any] = {"engines": [asdict(r) for r in rows], "agreements": [asdict(a) for a in agreements]}
    print(json.dumps(tables) if args.json else markdown(rows, agreements))
    return 0
