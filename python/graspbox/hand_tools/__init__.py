"""Your hand: checks of its two files, and a first ``hand.toml`` for a URDF.

| function | result |
|---|---|
| `check_hand` | findings about units, limits, inertias, actuators, the closing motion, reach, sensors and trials |
| `guess_hand` | a ``hand.toml`` whose numbers are guessed from the URDF, with a list of what to review |

``graspbox hand new --search`` also searches, in simulation, for the posture with which the hand holds most.
"""

from graspbox.hand_tools.checking import HandReport, check_hand
from graspbox.hand_tools.findings import Finding
from graspbox.hand_tools.guessing import GuessedHand, guess_hand

__all__ = ["Finding", "GuessedHand", "HandReport", "check_hand", "guess_hand"]
