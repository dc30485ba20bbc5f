"""Train a policy with Stable-Baselines3 on graspbox's environments, and evaluate it on objects it has not seen.

    python scripts/train_sb3.py ppo out/train/ppo
    python scripts/train_sb3.py sac out/train/sac --env graspbox/GraspPose-v0 --evaluate test --baselines
    python scripts/plot_sb3.py out/train/ppo
    python scripts/evaluate_sb3.py out/train/ppo

This is ``graspbox train sb3 ALGORITHM --out FOLDER``, with the same options: ``graspbox train sb3 --help``. The code is
``train`` of `graspbox.sb3.training`; your own programs can use its parts:

| part | purpose |
|---|---|
| `graspbox.sb3.running.make_env`, ``normalized`` | environments for Stable-Baselines3 |
| `graspbox.sb3.Extractor` | a features extractor for images, voxels and points |
| `graspbox.sb3.running.RunCallback` | evaluations on held-out objects, checkpoints, the end of a run |

Needs the extras ``cli`` and ``train``.
"""

import sys

from graspbox.cli.train import train
from graspbox.programs import run_program


def main(arguments: list[str] | None = None) -> int:
    """Train; returns the exit status."""
    words = sys.argv[1:] if arguments is None else arguments
    if len(words) > 1 and not words[1].startswith("-"):
        words = [words[0], "--out", *words[1:]]
    return train("sb3", words)


if __name__ == "__main__":
    run_program(main)
