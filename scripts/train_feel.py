"""Teach a policy of one depth image to feel before it lifts: from its folder to one that feels, then lifts.

    python scripts/train_feel.py --policy policies/depth --out out/feel
    python scripts/train_feel.py --policy policies/depth --out out/feel --publish policies/feel
    python scripts/train_feel.py --policy policies/depth --out out/closed --times 1.3
    python scripts/train_feel.py --policy out/quick/policy --out out/feel-quick --quick

Stages, each with a time limit (``--hours``), a log (``log.txt``) and results (``NAME.json``):

1. ``record-train``, ``record-held-out``: grasps of the policy, its own choice and others that it scored, are closed and
   lifted in ``Grasp-v0``; kept is what the hand felt as it closed, and whether the object was held.
2. ``member-N``: small networks that tell the one from the other; their mean counts.
3. ``calibrate``: slope and offset of the logit, on the policy's own choices of held-out objects.
4. ``export``: the policy's folder with what feels beside it.
5. ``threshold``: trials of held-out objects, each with and without a second attempt, say below which probability the
   hand opens.
6. ``evaluate``: the first attempt alone and with a second one, on objects from which nothing was learned; the card and a
   picture are made from it.

By default the hand feels when it has closed and 10 cm into the lift; with ``--times 1.3`` it feels before it lifts.
``--evaluated`` names other objects to measure on; ``--sizes.scenes``, ``--sizes.held-out-scenes``,
``--sizes.rule-trials`` and ``--sizes.trials`` say how much is recorded and tried.

The same command continues after an interruption, also after SIGKILL. ``--quick`` goes through all stages in a minute, to
show that they work. Needs the extras ``cli`` and ``train``.
"""  # noqa: E501

import shlex
import sys
from pathlib import Path

import tyro

from graspbox.errors import GraspboxError
from graspbox.policy_training.feel import FeelSettings, FeelTraining


def main() -> int:
    """Run as a script."""
    settings = tyro.cli(FeelSettings, description=__doc__)
    command = shlex.join(["python", f"scripts/{Path(__file__).name}", *sys.argv[1:]])
    try:
        FeelTraining(settings, command, lambda line: print(line, flush=True)).go()
    except GraspboxError as error:
        print(f"train_feel: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        return 130
    return 0


if __name__ == "__main__":
    sys.exit(main())
