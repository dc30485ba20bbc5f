"""``python tests/validate.py CHECK``: compare graspbox with MuJoCo and the reference study, and its two engines.

| check       | result |
|---|---|
| ``mujoco``  | the share of random grasps with equal labels in MuJoCo and in the core |
| ``planner`` | the same for the planner's best grasps, and each engine's agreement with itself at half its time step |
| ``choices`` | the success rate of grasps that policies choose, in the core and in MuJoCo |
| ``export``  | the share of trials with equal labels in exported MJCF scenes and in the MuJoCo replay of ``mujoco`` |
| ``robust``  | the success rate of perturbed copies of grasps, in MuJoCo and in the core |
| ``clutter`` | attempts of policies that clear scenes of several objects, in the core and in MuJoCo |
| ``arms``    | the flange along paths of arms, and the verdict on grasps by whole arms, in the core and in MuJoCo |
| ``forces``  | six forces, a lift and force closure, as DexGraspBench judges grasps, in the core and in MuJoCo |
| ``engines`` | labels and speed of the engines `implicit` and `rapier` |
| ``speed``   | trials and simulated seconds per second of CPU time: ours, rapier, MuJoCo |
| ``study``   | table 3.1 of the reference study, compared with graspbox |

``CHECK --help`` lists the options of a check. Exit status: 0 if the check passed, 1 if it failed, 2 for a wrong call.
"""

import argparse
import sys
from importlib import import_module

from graspbox._common.programs import run_program
from graspbox.errors import GraspboxError

#: For each check, its module and the name of its function; a module is imported when its check runs.
CHECKS = {
    "mujoco": ("validation.mujoco.command", "main"),
    "planner": ("validation.mujoco.command", "compare_planner"),
    "choices": ("validation.choices.command", "main"),
    "export": ("validation.mujoco.export_command", "main"),
    "robust": ("validation.mujoco.robust_command", "main"),
    "clutter": ("validation.mujoco.clutter_command", "main"),
    "arms": ("validation.mujoco.arms_command", "main"),
    "forces": ("validation.forces.command", "main"),
    "engines": ("validation.engines", "main"),
    "speed": ("validation.speed", "main"),
    "study": ("graspbox.study.comparison", "main"),
}


def main(arguments: list[str] | None = None) -> int:
    """Run one check with its options; returns the exit status."""
    parser = argparse.ArgumentParser(
        prog="python tests/validate.py", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("check", choices=CHECKS)
    words = sys.argv[1:] if arguments is None else arguments
    module, function = CHECKS[parser.parse_args(words[:1]).check]
    try:
        return int(getattr(import_module(module), function)(words[1:]))
    except GraspboxError as error:
        print(f"graspbox: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        return 130


if __name__ == "__main__":
    run_program(main)
