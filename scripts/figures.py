"""Write the pictures of ``docs/pictures``: ``python scripts/figures.py`` (about two minutes on two cores).

Boxes and poses, the study's sweep, kindness over time, a grasp in stages, an episode of ``graspbox/Grasp-v0``, and the
study's table 3.1 beside ours.
"""

import argparse
from pathlib import Path

from graspbox import Scene, object_sets, pictures, plan
from graspbox.configs import TrialConfig
from graspbox.planner_trials import try_set
from graspbox.validation import study, study_chart

#: One with parts to tell apart, whose plan holds firm and failed grasps alike.
PLANNED = "ycb:035_power_drill"
TRACED = "ycb:006_mustard_bottle"
SWEPT = {"kettle": "procedural:kettle:3", "pitcher": "ycb:019_pitcher_base"}

#: Object and seed of the episode.
PLAYED, START = "ycb:025_mug", 1

parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
parser.add_argument("--out", type=Path, default=Path("docs/pictures"), help="folder of the pictures")
parser.add_argument("--poses", type=int, default=20, help="poses to try for each object")
parser.add_argument("--seed", type=int, default=0, help="seed of the plans")
args = parser.parse_args()
args.out.mkdir(parents=True, exist_ok=True)


def prepared(name: str) -> Scene:
    """Let an object settle."""
    return Scene(object_sets.load(name)[0].load())


scene = prepared(PLANNED)
best = plan(scene.mesh, seed=args.seed, world_from_object=scene.world_from_object).best(args.poses)
pictures.save_plan(args.out / "plan.png", scene.mesh, best, scene.simulate(best.poses, best.preshape))

for name, spec in SWEPT.items():
    for fit in ("minimum", "pca"):
        pictures.save_sweep(args.out / f"sweep_{name}_{fit}.png", object_sets.load(spec)[0].load(), fit=fit)

scene = prepared(TRACED)
best = plan(scene.mesh, seed=args.seed, world_from_object=scene.world_from_object).best(args.poses)
firm, failed = pictures.firm_and_failed(scene, best)
pictures.save_kindness(args.out / "kindness.png", scene.name, failed, firm)
pictures.save_stages(args.out / "stages.png", scene, [firm, failed])

pictures.save_episode(args.out / "episode.png", PLAYED, seed=START)

result = try_set(
    object_sets.load(study.study_objects()), poses=args.poses, seed=args.seed, trial=TrialConfig(legacy=True)
)
comparison = study.Comparison.of(result)
(args.out / "table_3_1.md").write_text(comparison.markdown())
study_chart.save_comparison(args.out / "table_3_1.png", comparison)
print(comparison.markdown())
