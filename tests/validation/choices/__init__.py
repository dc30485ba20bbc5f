"""MuJoCo as a second judge of policies: the grasps that they choose, in both engines (extra ``dev``).

| module | content |
|---|---|
| `comparison` | grasps of a policy in seeded trials, replayed in MuJoCo; the report |
| `command`    | the command |

``python tests/validate.py choices POLICY... [--objects SET...] [--trials N] [--patch MM] [--json]``
"""

from validation.choices.comparison import ChoicesReport, compare_choices

__all__ = ["ChoicesReport", "compare_choices"]
