"""MJCF hands: read by MuJoCo's own compiler, and written as a URDF.

| module | task |
|---|---|
| `converting` | the URDF: links, joints, shapes |
| `tree` | which bodies are the hand: its base, what stands beside it, joints above the palm |
| `couplings`, `loops` | joints that follow others, by equalities and in closed loops |
| `forces` | the greatest force of each joint |
| `contacts` | links and shapes that do not touch each other |
| `lines` | files and lines of the elements that messages name |
"""

from graspbox.hands.mjcf.converting import urdf_of_mjcf

__all__ = ["urdf_of_mjcf"]
