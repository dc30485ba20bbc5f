"""``python -m graspbox.validation CHECK``: compare graspbox with MuJoCo and the reference study, and its two engines.

| check       | result |
|---|---|
| ``mujoco``  | the share of random grasps with equal labels in MuJoCo and in the core |
| ``planner`` | the same for the planner's best grasps, and each engine's agreement with itself at half its time step |
| ``export``  | the share of trials with equal labels in exported MJCF scenes and in the MuJoCo replay of ``mujoco`` |
| ``robust``  | the success rate of perturbed copies of grasps, in MuJoCo and in the core |
| ``forces``  | six forces, a lift and force closure, as DexGraspBench judges grasps, in the core and in MuJoCo |
| ``engines`` | labels and speed of the engines `newton` and `rapier` |
| ``speed``   | trials and simulated seconds per second of CPU time: ours, rapier, MuJoCo |
| ``study``   | table 3.1 of the reference study, compared with graspbox |

``CHECK --help`` lists the options of a check. Exit status: 0 if the check passed, 1 if it failed, 2 for a wrong call.
"""

import argparse
import sys

from graspbox.errors import GraspboxError
from graspbox.programs import run_program

CHECKS = ("mujoco", "planner", "export", "robust", "forces", "engines", "speed", "study")


def main(arguments: list[str] | None = None) -> int:
    """Run one check with its options; returns the exit status."""
    parser = argparse.ArgumentParser(
        prog="python -m graspbox.validation", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("check", choices=CHECKS)
    given = sys.argv[1:] if arguments is None else arguments
    check = parser.parse_args(given[:1]).check
    try:
        if check == "mujoco":
            from graspbox.validation.mujoco.command import main as compare_with_mujoco

            return compare_with_mujoco(given[1:])
        if check == "planner":
            from graspbox.validation.mujoco.command import PLANNER
            from graspbox.validation.mujoco.command import main as compare_with_mujoco

            return compare_with_mujoco(given[1:], PLANNER)
        if check == "export":
            from graspbox.validation.mujoco.export_command import main as compare_exports

            return compare_exports(given[1:])
        if check == "robust":
            from graspbox.validation.mujoco.robust_command import main as compare_robust

            return compare_robust(given[1:])
        if check == "forces":
            from graspbox.validation.forces.command import main as judge_by_forces

            return judge_by_forces(given[1:])
        if check == "engines":
            from graspbox.validation.engines import main as compare_engines

            return compare_engines(given[1:])
        if check == "speed":
            from graspbox.validation.speed import main as compare_speed

            return compare_speed(given[1:])
        from graspbox.study.comparison import main as compare_study

        return compare_study(given[1:])
    except GraspboxError as error:
        print(f"graspbox: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        return 130


if __name__ == "__main__":
    run_program(main)
