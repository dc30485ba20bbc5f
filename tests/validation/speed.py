"""Speed of `implicit`, of `rapier` and of MuJoCo's rollout on the same planner poses, with any hand.

Every object's best poses are tried with each engine, one pose after the other, so that a change of the machine's speed
meets all of them. Rates are per second of CPU time of one core. MuJoCo gets the actuators' commands recorded
beforehand and steps through each trial in one call (``mujoco.rollout``), for as many simulated seconds as `implicit`
took for it, without Python in between. It runs twice: with the settings of ``validation mujoco``, whose labels are
stable under smaller time steps, and with fast settings. Scenes of several objects are workloads too: every object in
them is a target in turn.
"""

import argparse
import json
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass
from functools import partial

import mujoco
import numpy as np
from mujoco import rollout
from numpy.typing import NDArray

import graspbox
from graspbox import object_sets
from graspbox.configs import PhysicsConfig
from graspbox.errors import SimulationError
from graspbox.hands import HandLike, load_hand
from graspbox.simulation.layouts import Layout
from graspbox.tools.scene_export.contents import object_data, objects_of
from validation import engines
from validation.mujoco.compare import DEFAULT_OBJECTS, describe
from validation.mujoco.replay import Replay
from validation.mujoco.scene import Numerics, Scene, build, build_heap
from validation.versions import MUJOCO_VERSION, judged_by

#: Object sets to time, by name.
WORK = {
    "can and apple": ("ycb:005_tomato_soup_can", "ycb:013_apple"),
    "ycb and procedural": (*DEFAULT_OBJECTS, *engines.DEFAULT_OBJECTS),
    "procedural mix": ("procedural:box:0-1", "procedural:can:0-1", "procedural:mug:0-1", "procedural:bottle:0-1"),
}

#: Scenes of several objects to time, by name: layout, and number of objects; `SCENES` of each.
HEAPS: dict[str, tuple[Layout, int]] = {
    "5 packed": ("packed", 5),
    **{f"piles of {count}": ("pile", count) for count in (1, 2, 5, 10, 15, 20, 40)},
}
SCENES = 2

#: MuJoCo's settings. The fast ones use the core's time step, without the iterations that stop held objects creeping.
MUJOCO = {
    "mujoco": Numerics(),
    "mujoco, fast": Numerics(timestep=PhysicsConfig.dt, noslip_iterations=0),
}

#: Names of the engines in the order of the table.
ENGINES = ("implicit", "rapier", *MUJOCO)


@dataclass
class SpeedRow:
    """Trials and times of one engine on one workload.

    Attributes
    ----------
    work, engine : str
        Names of the workload and of the engine.
    trials : int
        Number of trials.
    simulated : float
        Simulated seconds of the trials.
    seconds : float
        CPU time, s.
    """

    work: str
    engine: str
    trials: int = 0
    simulated: float = 0.0
    seconds: float = 0.0

    @property
    def trials_per_second(self) -> float:
        """Trials per second of CPU time."""
        return self.trials / self.seconds if self.seconds > 0 else 0.0

    @property
    def simulated_per_second(self) -> float:
        """Simulated seconds per second of CPU time."""
        return self.simulated / self.seconds if self.seconds > 0 else 0.0

    def add(self, run: Callable[[], tuple[int, float]]) -> float:
        """Time a function that returns its number of trials and their simulated seconds; returns the latter."""
        start = time.process_time()
        trials, simulated = run()
        self.seconds += time.process_time() - start
        self.trials += trials
        self.simulated += simulated
        return simulated


class Rollout:
    """One trial in MuJoCo with recorded commands."""

    def __init__(self, scene: Scene, world_from_hand: NDArray[np.float64], preshape: float, seconds: float) -> None:
        run = Replay(scene, world_from_hand, preshape)
        self.feasible = run.is_feasible()
        full, self._spec = mujoco.mjtState.mjSTATE_FULLPHYSICS, mujoco.mjtState.mjSTATE_CTRL
        self._spec |= mujoco.mjtState.mjSTATE_QFRC_APPLIED
        self._first = np.empty(mujoco.mj_stateSize(run.model, full))
        mujoco.mj_getState(run.model, run.data, self._first, full)
        commands = []
        for _ in range(round(seconds / run.dt) if self.feasible else 0):
            run.step()
            commands.append(np.concatenate([run.data.ctrl, run.data.qfrc_applied]))
        self._commands = np.array(commands)
        self._model, self._data, self._dt = run.model, mujoco.MjData(run.model), run.dt

    def __call__(self) -> tuple[int, float]:
        """Run the trial; returns the number of trials, 1, and its simulated seconds."""
        rollout.rollout(self._model, self._data, self._first[None], self._commands[None], control_spec=self._spec)
        return 1, len(self._commands) * self._dt


def _trial(scene: graspbox.Scene, one: graspbox.Plan) -> tuple[int, float]:
    """Simulate a pose; returns the number of trials, 1, and its simulated seconds."""
    outcomes = scene.simulate(one.poses, one.preshape, num_threads=1)
    return len(outcomes), float(outcomes.time.sum())


_RAPIER = PhysicsConfig(engine="rapier")


@dataclass(frozen=True)
class _Case:
    """Poses to time in one scene: `rapier` is None for a hand that it cannot simulate; MuJoCo's scenes by settings."""

    ours: graspbox.Scene
    rapier: graspbox.Scene | None
    theirs: dict[str, Scene]
    plan: graspbox.Plan


def _single(mesh: graspbox.Mesh, hand: graspbox.Hand, poses: int, seed: int) -> _Case:
    """Prepare a single object, with the planner's best poses."""
    ours = graspbox.Scene(mesh, hand=hand)
    start, data, described = ours.world_from_object, object_data(ours), describe(hand)
    plan = graspbox.plan(mesh, hand=hand, world_from_object=start, seed=seed).best(poses)
    try:
        rapier = graspbox.Scene(mesh, hand=hand, world_from_object=start, physics=_RAPIER)
    except SimulationError:
        rapier = None
    theirs = {name: build(described, data, numerics=numerics) for name, numerics in MUJOCO.items()}
    return _Case(ours, rapier, theirs, plan)


def _heaps(layout: Layout, count: int, hand: graspbox.Hand, poses: int, seed: int) -> Iterator[_Case]:
    """Prepare scenes of several objects, each of which is the target once."""
    described = describe(hand)
    for heap, target, plan in engines.targets((engines.HEAPED,), layout, (SCENES, count), hand, poses, seed):
        items = objects_of(graspbox.Scene.of(heap, hand=hand))
        first = [items[target], *items[:target], *items[target + 1 :]]
        theirs = {name: build_heap(described, first, (), numerics) for name, numerics in MUJOCO.items()}
        ours = graspbox.Scene.of(heap, target=target, hand=hand)
        try:
            rapier = graspbox.Scene.of(heap, target=target, hand=hand, physics=_RAPIER)
        except SimulationError:
            rapier = None
        yield _Case(ours, rapier, theirs, plan)


def measure(work: str, poses: int, seed: int, hand: HandLike = "reflex") -> list[SpeedRow]:
    """Time the planner's best `poses` for every object of a workload, or target in a pile; returns one row per engine.

    The row of an engine that cannot simulate the hand has no trials.
    """
    rows = {name: SpeedRow(work, name) for name in ENGINES}
    loaded = load_hand(hand)
    if work in HEAPS:
        cases = _heaps(*HEAPS[work], loaded, poses, seed)
    else:
        specs = (spec for name in WORK[work] for spec in object_sets.load(name))
        cases = (_single(spec.load(), loaded, poses, seed) for spec in specs)
    for case in cases:
        for i in range(len(case.plan)):
            one = case.plan[i : i + 1]
            simulated = rows["implicit"].add(partial(_trial, case.ours, one))
            if case.rapier is not None:
                rows["rapier"].add(partial(_trial, case.rapier, one))
            pose, preshape = case.ours.world_from_object @ one.poses[0], float(one.preshape[0])
            for name, built in case.theirs.items():
                run = Rollout(built, pose, preshape, simulated)
                if run.feasible and simulated > 0.0:
                    rows[name].add(run)
    return list(rows.values())


def markdown(rows: Sequence[SpeedRow]) -> str:
    """Format the table."""
    lines = [
        "| work | engine | trials | trials/s | simulated s/s | times the fast MuJoCo |",
        "|---|---|---|---|---|---|",
    ]
    theirs = {r.work: r.simulated_per_second for r in rows if r.engine == "mujoco, fast"}
    for r in rows:
        if not r.trials:
            lines.append(f"| {r.work} | {r.engine} | 0 | - | - | - |")
            continue
        ratio = f"{r.simulated_per_second / theirs[r.work]:.2f}" if theirs[r.work] > 0 else "-"
        rates = f"{r.trials_per_second:.1f} | {r.simulated_per_second:.0f} | {ratio}"
        lines.append(f"| {r.work} | {r.engine} | {r.trials} | {rates} |")
    return "\n".join(lines)


def main(arguments: list[str] | None = None) -> int:
    """Time the engines; returns the exit status."""
    parser = argparse.ArgumentParser(prog="python tests/validate.py speed", description=__doc__)
    parser.add_argument("--work", nargs="+", default=list(WORK), choices=[*WORK, *HEAPS], help="workloads to time")
    parser.add_argument("--hand", default="reflex", help="a hand by its name, or hand.urdf,hand.toml")
    parser.add_argument("--poses", type=int, default=10, help="poses per object")
    parser.add_argument("--seed", type=int, default=0, help="seed of the planner")
    parser.add_argument("--json", action="store_true", help="print the table as JSON")
    args = parser.parse_args(arguments)
    if args.poses < 1:
        parser.error(f"--poses is {args.poses}; give 1 or more")
    rows = [row for work in args.work for row in measure(work, args.poses, args.seed, args.hand)]
    rates = [
        {
            **asdict(r),
            "mujoco_version": MUJOCO_VERSION,
            "trials/s": r.trials_per_second,
            "simulated s/s": r.simulated_per_second,
        }
        for r in rows
    ]
    print(json.dumps(rates) if args.json else f"{markdown(rows)}\n{judged_by()}")
    return 0
