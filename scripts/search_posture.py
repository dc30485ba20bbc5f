r"""Search for the posture from which a hand closes, so that most of the grasps that geometry proposes hold.

Every candidate is a copy of the hand with other positions of one preshape and another grasp centre, tried with the
proposals on the true shapes of training objects: what a scorer could choose from. CMA-ES (the package ``cmaes``)
proposes the candidates. Joints that should move alike are joined with ``+``::

    python scripts/search_posture.py --hand leap --preshape pinch --minutes 20 \
        --vary if_mcp+mf_mcp+rf_mcp --vary if_pip+mf_pip+rf_pip --vary if_dip+mf_dip+rf_dip \
        --vary th_mcp --vary th_ipl --vary th_cmc
    python scripts/search_posture.py --hand inspire --preshape pinch --minutes 20 \
        --vary index+middle+ring+pinky --vary thumb --vary rotation --turn

Put what it prints into ``hand.toml``, then fit the planner's ranking again (``scripts/fit_ranking.py``). Without
``--vary`` it measures the hand as it is. The hand has only that preshape during the search. Needs the extra
dev.
"""

import json
import re
import time
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from functools import partial
from multiprocessing import get_context
from typing import Annotated

import numpy as np
import typer
from cmaes import CMA
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

import graspbox
from graspbox import Hand, Mesh
from graspbox._common.programs import run_program
from graspbox.cli.common import console, find_hand, print_table
from graspbox.errors import ConfigError, HandError
from graspbox.perception import CropConfig, HandGrid, ProposalConfig
from graspbox.perception.crops import solid_occupancy
from graspbox.perception.hand_settings import seeing_both_sides, settings_of

#: Standard deviations with which the search begins: positions of actuators (rad), the grasp centre (m), and the turn of
#: the grasp frame about its y axis (rad).
_POSITION, _CENTER, _TURN = 0.1, 0.006, 0.15
#: Proposals tried on each object. Fewer than half as many feasible ones count less.
_TRIED = 32
#: Shares of proposals that hold, and that hold firmly.
Shares = tuple[float, float]
_NUMBER = r"(\[[^\]]*\]|[-+.\d]+)"


@dataclass(frozen=True)
class Text:
    """A hand's files, with the places that the search changes.

    Attributes
    ----------
    urdf, toml : str
        The text; ``toml`` has one preshape.
    vary : tuple of tuple of str
        Actuators that move alike.
    turn : bool
        Whether the grasp frame turns about its y axis.
    """

    urdf: str
    toml: str
    vary: tuple[tuple[str, ...], ...]
    turn: bool

    @classmethod
    def of(cls, hand: Hand, preshape: str, vary: Sequence[str], turn: bool) -> "Text":
        """Take the text of a hand, and keep one of its preshapes."""
        urdf, toml = hand.files
        head, *blocks = re.split(r"(?m)^\[\[grasp\.preshapes\]\]$", toml)
        last, *tail = re.split(r"(?m)^(?=\[)", blocks[-1], maxsplit=1) if blocks else ("",)
        chosen = [block for block in (*blocks[:-1], last) if re.search(rf'(?m)^name = "{re.escape(preshape)}"$', block)]
        if not chosen:
            raise ConfigError(f"--preshape is {preshape!r}; choose from {', '.join(hand.preshapes)}")
        groups = tuple(tuple(group.split("+")) for group in vary)
        text = cls(urdf, head + "[[grasp.preshapes]]" + chosen[0] + "".join(tail), groups, turn)
        for name in (name for group in groups for name in group):
            text.number(f"positions.{name}")
        return text

    def number(self, key: str) -> NDArray[np.float64]:
        """Read the value of a key of ``[grasp]``."""
        match = re.search(rf"(?m)^{re.escape(key)} = {{ value = {_NUMBER}", self.toml)
        if match is None:
            raise ConfigError(
                f"hand.toml has no row '{key} = {{ value = ..., unit = ..., source = ... }}' here; add it"
            )
        return np.atleast_1d(np.array(json.loads(match[1]), dtype=np.float64))

    def start(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the numbers as they are, and the standard deviations with which to begin."""
        values = [float(self.number(f"positions.{group[0]}")[0]) for group in self.vary]
        deviations = [_POSITION] * len(values)
        if self.vary:
            values += self.number("center").tolist()
            deviations += [_CENTER] * 3
        if self.turn:
            values.append(0.0)
            deviations.append(_TURN)
        return np.array(values), np.array(deviations)

    def hand(self, values: NDArray[np.float64]) -> Hand:
        """Make the hand with other numbers."""
        toml = self.toml
        for group, value in zip(self.vary, values[: len(self.vary)], strict=True):
            for name in group:
                toml = _put(toml, f"positions.{name}", [float(value)])
        if self.vary:
            toml = _put(toml, "center", values[len(self.vary) : len(self.vary) + 3].tolist())
        if self.turn:
            toml = _put(toml, "rpy", _turned(self.number("rpy"), float(values[-1])).tolist())
        return Hand(self.urdf, toml)


def _put(toml: str, key: str, values: list[float]) -> str:
    """Replace the value of a key."""
    text = f"{values[0]:.4f}" if len(values) == 1 else "[" + ", ".join(f"{value:.5f}" for value in values) + "]"
    return re.sub(rf"(?m)^({re.escape(key)} = {{ value = ){_NUMBER}", rf"\g<1>{text}", toml, count=1)


def _turned(rpy: NDArray[np.float64], angle: float) -> NDArray[np.float64]:
    """Turn a frame about its own y axis."""
    return np.asarray((Rotation.from_euler("xyz", rpy) * Rotation.from_euler("y", angle)).as_euler("xyz"))


@dataclass(frozen=True)
class RestingObject:
    """An object at rest and its voxels."""

    family: str
    mesh: Mesh
    world_from_object: NDArray[np.float64]
    world_from_crop: NDArray[np.float64]
    occupancy: NDArray[np.uint8]


def resting_objects(objects: str, hand: Hand) -> list[RestingObject]:
    """Let the objects of a set come to rest."""
    resting = []
    for spec in graspbox.object_sets.load(objects, split="train"):
        mesh = spec.load()
        rest = graspbox.Scene(mesh, hand=hand).world_from_object
        points = mesh.vertices @ rest[:3, :3].T + rest[:3, 3]
        frame = np.eye(4)
        frame[:2, 3] = (points.min(axis=0)[:2] + points.max(axis=0)[:2]) / 2
        inside = (np.linalg.inv(frame) @ rest)[None]
        solid = solid_occupancy([mesh], [0], inside, config=CropConfig(), num_threads=1)[0]
        resting.append(RestingObject(spec.name.rsplit("-", 1)[0], mesh, rest, frame, solid))
    return resting


def shares(hand: Hand, tried: Sequence[RestingObject]) -> dict[str, Shares]:
    """Return the shares of proposals that hold, and that hold firmly, by family."""
    fitted = settings_of(hand, ProposalConfig(seeds=24, points=600))
    grid = HandGrid(hand, fitted.grid, num_threads=1)
    config = replace(seeing_both_sides(fitted.proposals, hand), most=_TRIED)
    rows: dict[str, list[tuple[float, float]]] = {}
    for item in tried:
        proposed = grid.propose(item.occupancy, config)
        row = (0.0, 0.0)
        if len(proposed):
            scene = graspbox.Scene(item.mesh, hand=hand, world_from_object=item.world_from_object)
            poses = np.linalg.inv(scene.world_from_object) @ item.world_from_crop @ proposed.poses
            out = scene.simulate(poses, proposed.preshape, num_threads=1)
            enough = min(1.0, 2.0 * len(proposed) / _TRIED)
            row = (float(out.success.mean()) * enough, float(out.secure.mean()) * enough)
        rows.setdefault(item.family, []).append(row)
    means = {family: np.mean(own, axis=0) for family, own in rows.items()}
    return {family: (float(held), float(firm)) for family, (held, firm) in means.items()}


def value(table: dict[str, Shares]) -> float:
    """Return the mean over families of the root of the share of holds and half the root of that of firm ones."""
    return float(np.mean([np.sqrt(held) + 0.5 * np.sqrt(firm) for held, firm in table.values()]))


_worker: list[RestingObject] = []


def _prepare(objects: str, hand: Hand) -> None:
    _worker.extend(resting_objects(objects, hand))


def _judge(text: Text, values: NDArray[np.float64]) -> tuple[float, dict[str, Shares]]:
    try:
        hand = text.hand(values)
    except HandError:  # positions beyond limits
        return -1.0, {}
    table = shares(hand, _worker)
    return value(table), table


def search(
    pool: ProcessPoolExecutor, text: Text, minutes: float, seed: int
) -> tuple[NDArray[np.float64], dict[str, Shares]]:
    """Search until the time limit; returns the best numbers and their shares by family."""
    start, deviations = text.start()
    ((highest, table),) = pool.map(partial(_judge, text), [start])
    best, tried, end = start, 1, time.monotonic() + 60 * minutes
    console.print(f"as it is: {highest:.3f}")
    if not len(start):
        return best, table
    optimizer = CMA(mean=np.zeros(len(start)), sigma=1.0, seed=seed)
    while time.monotonic() < end:
        asked = [optimizer.ask() for _ in range(optimizer.population_size)]
        candidates = [start + deviations * point for point in asked]
        results = list(pool.map(partial(_judge, text), candidates))
        optimizer.tell([(point, -score) for point, (score, _) in zip(asked, results, strict=True)])
        tried += len(asked)
        first = int(np.argmax([score for score, _ in results]))
        if results[first][0] > highest:
            best, (highest, table) = candidates[first], results[first]
        console.print(f"{tried} postures, best {highest:.3f}, this generation {results[first][0]:.3f}")
    return best, table


def main(
    hand: Annotated[str, typer.Option(help="Hand: a name, or its two files with a comma between.")],
    preshape: Annotated[str, typer.Option(help="Name of the preshape.")],
    vary: Annotated[list[str], typer.Option(help="Actuators whose positions vary, alike where joined with +.")] = [],  # noqa: B006 (typer copies it)
    turn: Annotated[bool, typer.Option(help="Also turn the grasp frame about its y axis.")] = False,
    objects: Annotated[str, typer.Option(help="Object set; its training split is used.")] = "procedural:seen:200-201",
    minutes: Annotated[float, typer.Option(min=0.0, help="Time of the search.")] = 20.0,
    workers: Annotated[int, typer.Option(min=1, help="Processes.")] = 2,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the search.")] = 0,
) -> None:
    """Search, and print the rows of hand.toml and what holds by family."""
    known = find_hand(hand)
    text = Text.of(known, preshape, vary, turn)
    context = get_context("spawn")
    with ProcessPoolExecutor(workers, context, initializer=_prepare, initargs=(objects, known)) as pool:
        best, table = search(pool, text, minutes, seed)
    rows: list[tuple[str, ...]] = [
        (name, f"{number:.2f}") for group, number in zip(text.vary, best, strict=False) for name in group
    ]
    if text.vary:
        rows.append(("center", ", ".join(f"{number:.3f}" for number in best[len(text.vary) :][:3])))
    if turn:
        rows.append(("rpy", ", ".join(f"{number:.2f}" for number in _turned(text.number("rpy"), float(best[-1])))))
    print_table(f"{preshape} of {known.name}", ("row", "value"), rows)
    cells: list[tuple[str, ...]] = [(family, f"{held:.1%}", f"{firm:.1%}") for family, (held, firm) in table.items()]
    print_table(f"proposals, value {value(table):.3f}", ("family", "hold", "firmly"), cells)


if __name__ == "__main__":
    run_program(partial(typer.run, main))
