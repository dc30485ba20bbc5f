"""Timed paths of an arm, sampled at any time, and their files."""

import csv
import io
import json
import os
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from graspbox._common.arguments import floats
from graspbox._common.by_value import ByValue
from graspbox._common.files import dumps, replacing, write_text
from graspbox.arms.timing import TimedPiece
from graspbox.errors import ConfigError

__all__ = ["Sample", "Trajectory"]

#: Most samples of a trajectory.
MOST_SAMPLES = 1_000_000
#: Phases in which the hand moves and the arm rests, with its command at their beginning and their end.
HAND_PHASES = {"close": (0.0, 1.0), "open": (1.0, 0.0)}
#: Formats of `Trajectory.save`, by the suffix of the file.
FORMATS = {".npz": "npz", ".csv": "csv", ".json": "json", ".yaml": "ros", ".yml": "ros"}


class Sample(NamedTuple):
    """A trajectory at m times.

    Attributes
    ----------
    positions, velocities, accelerations, jerks : (m, k) float64
        Of the joints, rad or m and s.
    hand : (m,) float64
        Command of the hand: 0 open with the preshape, 1 closed.
    phases : (m,) str
        Part of the path.
    """

    positions: NDArray[np.float64]
    velocities: NDArray[np.float64]
    accelerations: NDArray[np.float64]
    jerks: NDArray[np.float64]
    hand: NDArray[np.float64]
    phases: NDArray[np.str_]


@dataclass(frozen=True, eq=False, repr=False)
class Trajectory(ByValue):
    """A timed path of an arm with its hand: m samples of k joints.

    The arm comes to rest between phases, and at the corners of ``reach`` and ``carry``.

    Attributes
    ----------
    times : (m,) float64
        Seconds, from 0 to the duration.
    positions, velocities, accelerations : (m, k) float64
        Of the joints, rad or m and s.
    hand : (m,) float64
        Command of the hand: 0 open with the preshape, 1 closed; it changes while the arm rests.
    phases : (m,) str
        ``reach`` (from the start to the approach), ``approach``, ``close``, ``lift``; with a place also ``carry``,
        ``lower``, ``open``, ``retreat``.
    joints : tuple of str
        Names of the joints.
    arm : str
        Name of the arm.
    hand_name : str
        Name of the hand.
    preshape : float
        Of the open hand, see `graspbox.Hand.preshape_limits`.
    grasp : int
        Index of the grasp among those that were given.
    assumptions : tuple of str
        Limits that the arm does not state, and what was assumed, a sentence each.
    """

    times: NDArray[np.float64]
    positions: NDArray[np.float64]
    velocities: NDArray[np.float64]
    accelerations: NDArray[np.float64]
    hand: NDArray[np.float64]
    phases: NDArray[np.str_]
    joints: tuple[str, ...]
    arm: str
    hand_name: str
    preshape: float
    grasp: int
    assumptions: tuple[str, ...]
    _pieces: tuple[TimedPiece, ...]

    @classmethod
    def of(cls, pieces: list[TimedPiece], hz: float, **facts: Any) -> Self:
        """Sample pieces that follow each other."""
        none: Any = np.zeros((0, 0))
        row: Any = np.zeros(0)
        empty = cls(row, none, none, none, row, np.zeros(0, "U8"), **facts, _pieces=tuple(pieces))
        return empty.resampled(hz)

    @property
    def duration(self) -> float:
        """Return the duration, seconds."""
        return sum(piece.duration for piece in self._pieces)

    def __len__(self) -> int:
        return len(self.times)

    def __repr__(self) -> str:
        return f"Trajectory({self.arm!r}, {self.hand_name!r}, {self.duration:.2f} s, samples={len(self)})"

    def __eq__(self, other: object) -> bool:
        """Compare what is sampled, and when."""
        if not isinstance(other, Trajectory):
            return NotImplemented
        facts = ("joints", "arm", "hand_name", "preshape", "grasp", "assumptions")
        arrays = ("times", "positions", "velocities", "accelerations", "hand", "phases")
        return all(getattr(self, name) == getattr(other, name) for name in facts) and all(
            np.array_equal(getattr(self, name), getattr(other, name)) for name in arrays
        )

    __hash__ = None

    def sample(self, times: ArrayLike) -> Sample:
        """Return the trajectory at times (m,), seconds, exactly; before its beginning and after its end the arm rests.

        Raises
        ------
        ConfigError
            For times that are not finite, or of another shape.
        """
        wanted = floats(times, "times")
        if wanted.ndim != 1:
            raise ConfigError(f"times have the shape {wanted.shape}; give (m,)")
        wanted = wanted.clip(0.0, self.duration)
        ends = np.cumsum([piece.duration for piece in self._pieces])
        index = np.searchsorted(ends, wanted, side="left").clip(max=len(ends) - 1)
        states = np.zeros((4, len(wanted), len(self.joints)))
        hand, phases = np.zeros(len(wanted)), np.zeros(len(wanted), "U8")
        command = 0.0
        for number, piece in enumerate(self._pieces):
            mine = index == number
            since = wanted[mine] - (ends[number] - piece.duration)
            states[:, mine] = piece.at(since)
            begin, end = HAND_PHASES.get(piece.phase, (command, command))
            hand[mine] = begin + (end - begin) * since / max(piece.duration, 1e-9)
            phases[mine] = piece.phase
            command = end
        return Sample(states[0], states[1], states[2], states[3], hand, phases)

    def resampled(self, hz: float) -> Self:
        """Return the same trajectory with `hz` samples per second, and one at its end.

        Raises
        ------
        ConfigError
            For a rate that is not positive, or more than a million samples.
        """
        if not 0 < hz < np.inf:
            raise ConfigError(f"hz is {hz}; it must be positive")
        count = int(self.duration * hz) + 1
        if count > MOST_SAMPLES:
            raise ConfigError(
                f"{self.duration:.1f} s at {hz:g} Hz are {count} samples; at most {MOST_SAMPLES} are made"
            )
        times = np.append(np.arange(count) / hz, self.duration)
        times = times[:-1] if count > 1 and times[-2] >= self.duration else times
        sample = self.sample(times)
        arrays = {
            name: getattr(sample, name) for name in ("positions", "velocities", "accelerations", "hand", "phases")
        }
        return replace(self, times=times, **arrays)

    def prefixed(self, prefix: str) -> Self:
        """Return the same trajectory with a prefix before the names of its joints, such as ``fr3_``."""
        return replace(self, joints=tuple(f"{prefix}{joint}" for joint in self.joints))

    def to_json(self) -> dict[str, Any]:
        """Return all samples and facts as plain values."""
        arrays = {
            name: getattr(self, name).tolist()
            for name in ("times", "positions", "velocities", "accelerations", "hand", "phases")
        }
        return self._facts() | {"duration": self.duration} | arrays

    def _facts(self) -> dict[str, Any]:
        facts = {name: getattr(self, name) for name in ("arm", "hand_name", "preshape", "grasp")}
        return facts | {"joints": list(self.joints), "assumptions": list(self.assumptions)}

    def to_ros(self) -> dict[str, Any]:
        """Return a message `trajectory_msgs/JointTrajectory` of the arm's joints as plain values.

        The hand is not in it: its commands belong to another controller, at the times of ``close`` and ``open``.
        """
        seconds = np.floor(self.times + 5e-10)
        nanoseconds = ((self.times - seconds) * 1e9).round().clip(0, 999_999_999)
        rows = zip(
            self.positions.tolist(),
            self.velocities.tolist(),
            self.accelerations.tolist(),
            seconds,
            nanoseconds,
            strict=True,
        )
        points = [
            {
                "positions": q,
                "velocities": v,
                "accelerations": a,
                "effort": [],
                "time_from_start": {"sec": int(s), "nanosec": int(n)},
            }
            for q, v, a, s, n in rows
        ]
        stamp = {"sec": 0, "nanosec": 0}
        header = {"stamp": stamp, "frame_id": ""}
        return {"header": header, "joint_names": list(self.joints), "points": points}

    def save(self, path: str | os.PathLike[str], format: str | None = None) -> None:
        """Write the samples to a file, which is replaced atomically.

        Parameters
        ----------
        path : path
            File to write.
        format : {"npz", "csv", "json", "ros"}, optional
            By default that of the suffix: .npz, .csv, .json, and .yaml or .yml for ``ros``. ``ros`` is a message
            `trajectory_msgs/JointTrajectory` as YAML, or as JSON in a file .json.

        Raises
        ------
        ConfigError
            For another suffix or format.
        FileError
            If the file cannot be written.
        """
        suffix = Path(path).suffix.lower()
        kind = FORMATS.get(suffix) if format is None else format
        if kind not in FORMATS.values():
            what = f"the suffix {suffix!r}" if format is None else f"the format {format!r}"
            raise ConfigError(f"a trajectory has no file with {what}; choose from {', '.join(FORMATS)}, or pass format")
        if kind == "npz":
            arrays = {
                name: getattr(self, name) for name in ("times", "positions", "velocities", "accelerations", "hand")
            }
            with replacing(path) as temporary, temporary.open("wb") as file:
                np.savez_compressed(file, **arrays, phases=self.phases, facts=np.array(json.dumps(self._facts())))
        elif kind == "csv":
            write_text(path, self._csv())
        elif kind == "json":
            write_text(path, dumps(self.to_json()) + "\n")
        else:
            write_text(path, dumps(self.to_ros()) + "\n" if suffix == ".json" else _yaml(self.to_ros()))

    def _csv(self) -> str:
        text = io.StringIO()
        writer = csv.writer(text, lineterminator="\n")
        kinds = ("position", "velocity", "acceleration")
        states = (f"{joint}.{kind}" for kind in kinds for joint in self.joints)
        writer.writerow(["time", *states, "hand", "preshape", "phase"])
        hand = np.stack([self.hand, np.full(len(self), self.preshape)], axis=1)
        numbers = np.hstack([self.times[:, None], self.positions, self.velocities, self.accelerations, hand])
        writer.writerows([*row, phase] for row, phase in zip(numbers.tolist(), self.phases.tolist(), strict=True))
        return text.getvalue()


def _yaml(message: dict[str, Any]) -> str:
    """Return a message as YAML: its layout is fixed, and JSON's numbers and lists are YAML's."""
    lines = ["header:", "  stamp: {sec: 0, nanosec: 0}", "  frame_id: ''"]
    lines += [f"joint_names: {json.dumps(message['joint_names'])}", "points:"]
    for point in message["points"]:
        time = point["time_from_start"]
        names = ("positions", "velocities", "accelerations", "effort")
        rows = [f"{name}: {json.dumps(point[name])}" for name in names]
        rows.append(f"time_from_start: {{sec: {time['sec']}, nanosec: {time['nanosec']}}}")
        lines += [f"{'- ' if index == 0 else '  '}{row}" for index, row in enumerate(rows)]
    return "\n".join(lines) + "\n"
