"""Inputs of grasp stability: joints, loads and tactile forces while the hand closes, and facts of the plan.

A network predicts from them whether the grasp will hold (`graspbox.learn.models.stability.network`). The policy
`graspbox.policies.FeelThenLift` queries it before it continues.

References
----------
Y. Bekiroglu, J. Laaksonen, J. A. Jorgensen, V. Kyrki, D. Kragic, "Assessing grasp stability based on learning and
haptic data", IEEE Transactions on Robotics 27(3), 2011.
"""

from collections.abc import Mapping
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from graspbox._common.arguments import shown
from graspbox._core import Hand
from graspbox.envs import spaces
from graspbox.envs.coding import Codec
from graspbox.errors import ConfigError
from graspbox.perception.configs import CropConfig
from graspbox.perception.finder import FoundGrasp

__all__ = ["FEEL_TIMES", "STORED_NAME", "StabilityInputs", "StabilityReading", "check_times"]

#: Sensing times, seconds after closing began: once the hand has closed, and half a second, 10 cm, into the lift.
FEEL_TIMES = (1.3, 1.8)
#: Name of the readings in files: the input of published networks, and the column in tables of trials.
STORED_NAME = "felt"
#: Columns of ``proprio`` that hold the arm's position, not sensor readings of the hand.
_ARM = ("hand_position", "hand_rotation", "hand_velocity", "hand_spin", "preshape")
#: Number of best grasps whose mean score shows whether there are alternatives.
_OTHERS = 10
#: Filled share from which a voxel belongs to the object, of 255.
_FILLED = 64
#: Greatest number of sensing times, and their upper bound, seconds.
_MOST_TIMES, _LATEST = 16, 60.0


def check_times(times: tuple[float, ...]) -> None:
    """Raise ConfigError unless there are 1 to 16 ascending sensing times, 0 to 60 s."""
    if not 0 < len(times) <= _MOST_TIMES or any(b <= a for a, b in pairwise((-1e-9, *times, _LATEST))):
        raise ConfigError(
            f"times is {shown(times)}; pass 1 to {_MOST_TIMES} ascending numbers of seconds, 0 to less than {_LATEST:g}"
        )


class StabilityInputs:
    """Builds the input vector from the hand's sensors and the facts known of the grasp.

    `times` are sensing times, seconds after closing began, ascending; `control` is the control mode of the environment.
    """

    def __init__(
        self,
        hand: Hand,
        times: tuple[float, ...] = FEEL_TIMES,
        crop: CropConfig = CropConfig(),  # noqa: B008 (frozen)
        control: str = "twist",
    ) -> None:
        check_times(times)
        self.times = times
        self._crop = crop
        self._codec = Codec(control, hand, "proprio")
        self._columns = [name for name in dict.fromkeys(self._codec.names) if name not in _ARM]
        #: Observations that it uses.
        self.obs: tuple[str, ...] = ("proprio",)
        if "tactile" not in spaces.tables(hand)["absent"]:
            self.obs = ("proprio", "tactile")
        #: Columns of ``proprio`` and further observations that it reads.
        self.sensors: tuple[str, ...] = (*self._columns, *self.obs[1:])

    def sensed(self, observation: Mapping[str, Any]) -> NDArray[np.float32]:
        """Read the hand's sensors, (m,): joints, actuators, loads, and tactile forces."""
        parts = [self._codec.column(observation["proprio"], name) for name in self._columns]
        parts += [np.asarray(observation[name], dtype=np.float64) for name in self.obs[1:]]
        return np.concatenate(parts).astype(np.float32)

    def known(self, grasp: FoundGrasp) -> NDArray[np.float32]:
        """Return the facts known of a grasp before it was tried, (20,).

        They are its score, the best score, the mean of the ten best and the number of grasps that were scored;
        preshape;
        height of the hand and its axes' upward components; volume (litres) of the completed object, and mean, least and
        greatest of its points in the hand's frame, metres.
        """
        scores = np.sort(grasp.scores)
        hand = grasp.world_from_hand
        own = [grasp.score, scores[-1], scores[-_OTHERS:].mean(), len(scores) / 100.0, grasp.preshape]
        filled = np.argwhere(grasp.occupancy >= _FILLED)
        shape = np.zeros(10)
        if len(filled):
            points = (filled + 0.5) * self._crop.voxel_size + np.array(self._crop.origin)
            hand_from_crop = np.linalg.inv(hand) @ grasp.world_from_crop
            inside = points @ hand_from_crop[:3, :3].T + hand_from_crop[:3, 3]
            litres = 1e3 * self._crop.voxel_size**3 * grasp.occupancy.sum() / 255.0
            shape = np.concatenate([[litres], inside.mean(0), inside.min(0), inside.max(0)])
        return np.concatenate([own, hand[2, [3, 0, 1, 2]], shape]).astype(np.float32)


class StabilityReading:
    """Collects the sensor readings of one grasp."""

    def __init__(self, inputs: StabilityInputs, grasp: FoundGrasp) -> None:
        self.grasp = grasp
        self._inputs, self._known = inputs, inputs.known(grasp)
        self._readings: list[NDArray[np.float32]] = []

    @property
    def complete(self) -> bool:
        """Whether all sensing times have been read."""
        return len(self._readings) == len(self._inputs.times)

    def add(self, time: float, observation: Mapping[str, Any]) -> bool:
        """Read the sensors `time` seconds after closing began; returns whether all times are read."""
        if self.complete or time < self._inputs.times[len(self._readings)] - 1e-9:
            return False
        self._readings.append(self._inputs.sensed(observation))
        return self.complete

    def vector(self) -> NDArray[np.float32]:
        """Return the facts known and the readings at each time, (k,)."""
        return np.concatenate([self._known, *self._readings])
