"""A search for the posture with which a guessed hand holds most: random first postures, then CMA-ES from the best.

Every candidate is tried with the same objects, poses and random numbers. The search keeps a journal of its values, and
resumes from it: the same seed asks for the same postures. Other objects choose among the best ones, and others again
decide whether the result replaces the guess.
"""

import hashlib
import json
import re
import time
from collections.abc import Callable, Generator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from graspbox import _core
from graspbox._common.files import read_bounded, write_text
from graspbox._common.imports import imported
from graspbox.configs import PlanConfig
from graspbox.errors import ConfigError, HandError
from graspbox.hand_tools.guessing import Guess, GuessedHand
from graspbox.hand_tools.postures import Posture, Postures
from graspbox.hand_tools.trials import LEAST_OPENING, Judged, judge, resting
from graspbox.hands import Hand

__all__ = ["Budget", "SearchedHand", "search_hand", "was_interrupted"]

#: Numbers of the objects that candidates are tried with, that choose among the best, and that decide in the end.
_OBJECTS, _CHOOSING, _HELD_OUT = (0, 1, 2, 3), (4, 5, 6), (10, 11, 12, 13)
#: Grasps of each object that a candidate is tried with, and in the end.
_POSES, _FINAL_POSES = 2, 10
#: A candidate is dropped halfway if it is worth less than this share of the best.
_BEHIND = 0.6
#: First postures, and candidates that are judged at once.
_FIRST, _BATCH = 36, 4
#: Postures among which other objects choose: the best ones this far apart, since one that is tuned to the few objects
#: of the search may hold no others.
_FINALISTS, _APART = 4, 0.5
#: Standard deviation with which CMA-ES begins; first postures from which it begins again once it has converged.
_SIGMA, _STARTS = 0.2, 4
#: Changes with the method, so that a journal of another one is not continued. Largest journal, bytes.
_METHOD, _LARGEST = 5, 64 << 20
#: Last line of the journal of a search whose budget was used.
_FINISHED = json.dumps({"finished": True})
_UNITS = {"s": 1.0, "min": 60.0, "h": 3600.0}


@dataclass(frozen=True)
class Budget:
    """How long a search goes on: until a number of simulated grasps, or for a time in seconds."""

    trials: int | None = None
    seconds: float | None = None

    @classmethod
    def of(cls, text: str) -> "Budget":
        """Read ``10min``, ``90s``, ``1h`` or a number of simulated grasps, such as ``5000``."""
        match = re.fullmatch(r"(\d+(?:\.\d+)?)\s*(s|min|h|)", text.strip())
        if match is None or float(match[1]) <= 0 or (not match[2] and "." in match[1]):
            raise ConfigError(
                f"--search is {text!r}; give a time such as 10min or 1h, or a number of simulated grasps, such as 5000"
            )
        if not match[2]:
            return cls(trials=int(match[1]))
        return cls(seconds=float(match[1]) * _UNITS[match[2]])

    def leaves(self, trials: int, began: float) -> bool:
        """Whether the search goes on after a number of trials, and since a time of the clock."""
        if self.trials is not None:
            return trials < self.trials
        return self.seconds is None or time.monotonic() - began < self.seconds


@dataclass(frozen=True, eq=False)
class SearchedHand:
    """What a search found.

    Attributes
    ----------
    guessed : GuessedHand
        The file: of the search if it holds more of the held-out grasps than the guess, else that of the guess.
    better : bool
        Whether it is that of the search.
    trials : int
        Simulated grasps of the search, those of an interrupted one before included.
    finished : bool
        Whether the budget was used; False after an interruption, which leaves no time for held-out objects.
    rows : tuple of (str, Judged, Judged)
        For each family of held-out objects and ``all``: the guess, and the search.
    """

    guessed: GuessedHand
    better: bool
    trials: int
    finished: bool
    rows: tuple[tuple[str, Judged, Judged], ...]

    def table(self) -> dict[str, Any]:
        """Return the result, as ``graspbox hand new --search --json`` prints it."""
        rows = {name: {"guess": vars(before), "search": vars(after)} for name, before, after in self.rows}
        return {"better": self.better, "trials": self.trials, "finished": self.finished, "held_out": rows}


def search_hand(
    guess: Guess, budget: Budget, journal: Path, *, seed: int = 0, told: Callable[[int, float], None] = lambda *_: None
) -> SearchedHand:
    """Search for the posture with which a guessed hand holds most; an interruption (Ctrl-C) keeps the best so far.

    With a budget in trials the same seed gives the same file; one in seconds depends on the machine.

    Parameters
    ----------
    guess : Guess
        The guessed hand.
    budget : Budget
        How long to search.
    journal : Path
        File of the values so far; a search that it belongs to resumes.
    seed : int
        Seed of the postures.
    told : callable
        Called with the number of trials and the best value so far.

    Raises
    ------
    ConfigError
        If the journal is that of another hand, seed or version.
    MissingExtraError
        Without the package ``cmaes``.
    """
    run = _Run(guess, journal, seed)
    began, finished = time.monotonic(), True
    try:
        # With a time, all that is known counts, also if none is left. Nothing is worth more than 1.
        while run.best_value < 1.0 and (budget.leaves(run.trials, began) or (budget.trials is None and run.replays)):
            run.step()
            told(run.trials, run.best_value)
    except KeyboardInterrupt:
        finished = False
    found = run.verdict(finished)
    if finished:
        run.close()
    return found


def was_interrupted(journal: Path) -> bool:
    """Whether a journal is that of a search that did not use up its budget, so that it may replace its own files."""
    if not journal.exists():
        return False
    lines = read_bounded(journal, _LARGEST).decode(errors="replace").splitlines()
    return not lines or lines[-1] != _FINISHED


@dataclass(frozen=True)
class _Row:
    """A line of the journal: which way the palm faces and the numbers, their value, and the trials that it took."""

    point: list[float]
    value: float
    trials: int


def _written(posture: Posture) -> list[float]:
    return [float(posture.facing), *posture.point.tolist()]


class _Run:
    """A search under way."""

    def __init__(self, guess: Guess, journal: Path, seed: int) -> None:
        self._cmaes = imported("cmaes", "the search for a hand's posture needs cmaes", "search")
        self._guess, self._postures, self._journal, self._seed = guess, Postures(guess), journal, seed
        text = guess.write().text
        self._first_hand = Hand(guess.fitted.text, text)
        self._opening = self._postures.opening()
        if self._opening < LEAST_OPENING:
            raise HandError(
                f"{guess.urdf}: the hand opens by {1e3 * self._opening:.1f} mm between its fingers, and a search needs "
                f"{1e3 * LEAST_OPENING:g} mm for an object; check the limits and axes of its joints, or leave out "
                "--search"
            )
        self._tasks = resting(self._first_hand, self._opening, _OBJECTS)
        mark = hashlib.sha256(f"{_METHOD}\n{_core.__version__}\n{guess.fitted.text}\n{text}".encode()).hexdigest()
        self._head = {"search": mark, "seed": seed}
        self._known, self._lines = self._read(), [json.dumps(self._head)]
        self.trials, self.best_value, self._best = 0, -1.0, self._postures.guessed()
        self._steps = self._candidates()
        self._asked = next(self._steps)

    def _read(self) -> list["_Row"]:
        """Read the values of an interrupted search of the same hand and seed."""
        if not self._journal.exists():
            return []
        lines = read_bounded(self._journal, _LARGEST).decode(errors="replace").splitlines()
        try:
            head = json.loads(lines[0])
        except (ValueError, IndexError):
            head = None
        if head != self._head:
            raise ConfigError(
                f"{str(self._journal)!r} is the journal of another search (hand, seed or version); delete it, or give "
                "another --out"
            )
        known = []
        for line in lines[1:]:
            try:
                row = json.loads(line)
                known.append(_Row([float(x) for x in row["point"]], float(row["value"]), int(row["trials"])))
            except (ValueError, KeyError, TypeError):
                break  # cut off by an interruption
        return known

    @property
    def replays(self) -> bool:
        """Whether the journal has values of the next candidates."""
        return len(self._lines) - 1 + len(self._asked) <= len(self._known)

    def step(self) -> None:
        """Judge the next candidates, or take their values from the journal."""
        count = len(self._lines) - 1
        known = self._known[count : count + len(self._asked)]
        same = len(known) == len(self._asked) and all(
            _written(each) == row.point for each, row in zip(self._asked, known, strict=True)
        )
        rows = known if same else self._judge(self._asked)
        for posture, row in zip(self._asked, rows, strict=True):
            self._lines.append(json.dumps(vars(row)))
            self.trials += row.trials
            if row.value > self.best_value:
                self.best_value, self._best = row.value, posture
        if not same:
            write_text(self._journal, "\n".join(self._lines) + "\n")
        self._asked = self._steps.send([row.value for row in rows])

    def _judge(self, postures: list[Posture]) -> list["_Row"]:
        """Try postures with one object of each family, and those that do not fall far behind with the others too."""
        hands = [self._hand(posture) for posture in postures]
        first, others = self._tasks[:: len(_OBJECTS)], [t for i, t in enumerate(self._tasks) if i % len(_OBJECTS)]
        values = [[row.value for row in rows] for rows in judge(hands, first, _POSES)]
        good = [i for i, own in enumerate(values) if float(np.mean(own)) > _BEHIND * self.best_value]
        for number, rows in zip(good, judge([hands[i] for i in good], others, _POSES), strict=True):
            values[number] += [row.value for row in rows]
        return [
            _Row(_written(posture), float(np.mean(own)), len(own) * _POSES)
            for posture, own in zip(postures, values, strict=True)
        ]

    def _hand(self, posture: Posture) -> Hand | None:
        try:
            return self._postures.hand(posture)
        except HandError:
            return None

    def _candidates(self) -> Generator[list[Posture], list[float], None]:
        """Ask for postures, and take their values: first ones, then generations of CMA-ES from the best of them."""
        rng = np.random.default_rng(self._seed)
        first = self._postures.first(rng)
        tried: list[tuple[float, Posture]] = []
        while len(tried) < _FIRST:
            asked = [next(first) for _ in range(_BATCH)]
            values: list[float] = yield asked
            tried += list(zip(values, asked, strict=True))
        tried.sort(key=lambda pair: -pair[0])
        for number in range(2**20):
            start = tried[number % _STARTS][1]
            # Its seeds have 32 bits.
            seed = int(np.random.SeedSequence([self._seed, number]).generate_state(1)[0])
            optimizer = self._cmaes.CMA(mean=start.point, sigma=_SIGMA, seed=seed)
            while not optimizer.should_stop():
                points = [optimizer.ask() for _ in range(optimizer.population_size)]
                values = yield [Posture(start.facing, point) for point in points]
                optimizer.tell([(point, -value) for point, value in zip(points, values, strict=True)])

    def close(self) -> None:
        """Mark the journal as that of a finished search."""
        write_text(self._journal, "\n".join([*self._lines, _FINISHED]) + "\n")

    def verdict(self, finished: bool) -> SearchedHand:
        """Compare the best posture with the guess on objects that were not searched with."""
        guessed = self._guess.write()
        if self.best_value <= 0.0:
            return SearchedHand(guessed, False, self.trials, finished, ())
        found = f"search by `graspbox hand new`: {self.trials} simulated grasps, seed {self._seed}"
        if not finished:
            text, review = self._postures.text(self._best, f"{found}; interrupted, not tried on other objects")
            return SearchedHand(self._guess.written(text, review), True, self.trials, False, ())
        best = self._chosen()
        tasks = resting(self._first_hand, self._opening, _HELD_OUT)
        before, after = judge([self._first_hand, self._hand(best)], tasks, _FINAL_POSES, planning=PlanConfig(), seed=1)
        rows = []
        for family in (*dict.fromkeys(task.family for task in tasks), "all"):
            own = [number for number, task in enumerate(tasks) if family in (task.family, "all")]
            rows.append((family, _sum([before[i] for i in own]), _sum([after[i] for i in own])))
        _, total, new = rows[-1]
        if new.held <= total.held:
            return SearchedHand(guessed, False, self.trials, True, tuple(rows))
        found += f"; on held-out objects {new.held} of {new.asked} grasps hold, {total.held} with the guess"
        text, review = self._postures.text(best, found)
        return SearchedHand(self._guess.written(text, review), True, self.trials, True, tuple(rows))

    def _chosen(self) -> Posture:
        """Choose among the best postures by objects that were not searched with."""
        rows = sorted((json.loads(line) for line in self._lines[1:]), key=lambda row: -float(row["value"]))
        points: list[NDArray[np.float64]] = []
        for row in rows:
            point = np.array(row["point"])
            if row["value"] > 0.0 and all(np.linalg.norm(point - other) > _APART for other in points):
                points.append(point)
        finalists = [Posture(int(point[0]), point[1:]) for point in points[:_FINALISTS]]
        tasks = resting(self._first_hand, self._opening, _CHOOSING)
        hands = [self._hand(posture) for posture in finalists]
        values = [_sum(rows).value for rows in judge(hands, tasks, _FINAL_POSES, planning=PlanConfig(), seed=2)]
        return finalists[int(np.argmax(values))]


def _sum(rows: list[Judged]) -> Judged:
    """Add the grasps of objects; their value is the mean."""
    asked, tried, held, firm = (sum(getattr(row, name) for row in rows) for name in ("asked", "tried", "held", "firm"))
    return Judged(asked, tried, held, firm, float(np.mean([row.value for row in rows])))
