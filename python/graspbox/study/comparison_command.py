"""``python -m graspbox.validation study``: compare table 3.1 of the reference study with graspbox."""

import argparse
import json
import sys
from pathlib import Path

from graspbox import object_sets
from graspbox.configs import TrialConfig
from graspbox.files import check_output, write_text
from graspbox.planner_trials import try_set
from graspbox.study.comparison import Comparison, study_objects


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="python -m graspbox.validation study", description=__doc__)
    parser.add_argument("--poses", type=int, default=20, help="poses to try per object, best first (20)")
    parser.add_argument("--seed", type=int, default=0, help="seed of the plans (0)")
    parser.add_argument("--threads", type=int, default=None, help="threads to use; all by default")
    parser.add_argument("--out", type=Path, default=None, help="folder for table_3_1.md and table_3_1.png")
    parser.add_argument("--json", action="store_true", help="print our counts as JSON")
    return parser


def main(arguments: list[str] | None = None) -> int:
    """Try the study's objects and print both tables; the exit status is 1 if an object could not be tried."""
    parser = _parser()
    args = parser.parse_args(arguments)
    if args.poses < 1:
        parser.error(f"--poses is {args.poses}; give 1 or more")
    if args.out is not None:
        check_output(args.out / "table_3_1.md")
    result = try_set(
        object_sets.load(study_objects()),
        poses=args.poses,
        seed=args.seed,
        trial=TrialConfig(legacy=True),
        num_threads=args.threads,
    )
    comparison = Comparison.of(result)
    if args.out is not None:
        from graspbox.study.comparison_chart import save_comparison

        write_text(args.out / "table_3_1.md", comparison.markdown())
        save_comparison(args.out / "table_3_1.png", comparison)
    print(json.dumps(dict(comparison.ours)) if args.json else comparison.markdown())
    errors = [f"{found.name}: {found.error}" for found in result.objects if found.error]
    for error in errors:
        print(error, file=sys.stderr)
    return 1 if errors else 0
