"""Outputs of networks, checked before they are used."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from graspbox.errors import ConfigError

__all__ = ["NONE_JUDGED", "Judged", "check_finite"]


class Judged(NamedTuple):
    """A scorer's outputs for m grasps.

    Attributes
    ----------
    choice : (m,) float64
        Score by which grasps are chosen: a mean of the next two.
    success, secure : (m,) float64
        Probability that the grasp succeeds, and that it also holds the object without a shift.
    logits : (m, 2) float64
        Logits of success and secure, before calibration.
    """

    choice: NDArray[np.float64]
    success: NDArray[np.float64]
    secure: NDArray[np.float64]
    logits: NDArray[np.float64]

    @classmethod
    def joined(cls, parts: "Sequence[Judged]") -> "Judged":
        """Join the outputs for groups of grasps."""
        return cls(*(np.concatenate(columns) for columns in zip(*parts, strict=True)))

    def rows(self, chosen: NDArray[np.int64] | NDArray[np.bool_]) -> "Judged":
        """Select grasps."""
        return Judged(*(column[chosen] for column in self))


#: The outputs for no grasp.
NONE_JUDGED = Judged(np.zeros(0), np.zeros(0), np.zeros(0), np.zeros((0, 2)))


def check_finite(values: NDArray[np.floating], network: str) -> None:
    """Raise ConfigError, which names the network, such as ``"scorer"``, for outputs that are not finite."""
    if wrong := int((~np.isfinite(values)).sum()):
        raise ConfigError(
            f"{wrong} of {np.size(values)} outputs of the {network} are not finite; its network is damaged, so export "
            "the policy again"
        )
