"""Train a policy that grasps from one depth image, from nothing to a folder that ``graspbox evaluate`` runs.

    python scripts/train_depth_policy.py --out out/depth
    python scripts/train_depth_policy.py --out out/depth --data out/data --publish policies/depth
    python scripts/train_depth_policy.py --out out/quick --quick

Stages, each with a time limit (``--hours.NAME``; together at most 12 hours), a log (``log.txt``) and results
(``NAME.json``):

1. ``data``: a data set of trials (``graspbox dataset``), unless ``--data`` names some.
2. ``completion``: the object's occupancy from what a camera sees of it; labels are rendered.
3. ``scorer``: the first member, on the data set.
4. ``head``: one network that predicts grasps (``scripts/train_heads.py``), on the data set. Its best are scored beside
   those that geometry proposes.
5. ``collect-N``, ``round-N``: trials on what the proposals and the scorer choose on fresh objects; training goes on with
   half of each batch from them.
6. ``member-N``: further members of the ensemble, on all trials (``--sizes.members 3``; by default there is one scorer).
7. ``calibrate-N``: choices on held-out objects, refined N times (``--sizes.refinements 0 2`` compares two settings; the
   default is 0). They decide which weight a secure hold gets in the choice, and make the scorer's logits probabilities.
8. ``export``, ``rungs``: the policy's folder, and in ``rungs`` what the policy was before the rounds, before the
   ensemble, before the refinement, and without the head, so that ``scripts/evaluate_policies.py`` tells what each step is worth.
9. ``evaluate``: the exported policy in ``GraspPose-v0`` on objects from which nothing was learned, and its calibration there.

The same command continues after an interruption, also after SIGKILL. ``--quick`` goes through all stages in minutes, to
show that they work; what it makes grasps badly. Needs the extras ``cli``, ``data``, ``ycb`` and ``train``.
"""  # noqa: E501

import shlex
import sys
from pathlib import Path

import tyro

from graspbox.errors import GraspboxError
from graspbox.policy_training.depth import PolicyTraining
from graspbox.policy_training.settings import Settings


def main() -> int:
    """Run as a script."""
    settings = tyro.cli(Settings, description=__doc__)
    command = shlex.join(["python", f"scripts/{Path(__file__).name}", *sys.argv[1:]])
    try:
        licence = Path(__file__).parents[1] / "LICENSE"
        PolicyTraining(settings, command, lambda line: print(line, flush=True), licence).go()
    except GraspboxError as error:
        print(f"train_depth_policy: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        return 130
    return 0


if __name__ == "__main__":
    sys.exit(main())
