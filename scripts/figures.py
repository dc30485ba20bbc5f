"""Write the pictures of ``docs/pictures``: ``python scripts/figures.py`` (about two minutes on two cores).

    python scripts/figures.py                  all of them
    python scripts/figures.py plan trials      some of them

| name | files |
|---|---|
| plan    | ``plan.png``: boxes, best poses and a held grasp of four objects |
| sweep   | ``sweep_kettle_FIT.png``: boxes for each pair of the planner's thresholds |
| trials  | ``kindness.png``, ``stages.png``: a firm and a failed grasp; ``trial.webp``: the firm one, moving |
| episode | ``episode.png``, ``episode.webp``: an episode of ``graspbox/Grasp-v0`` that the scripted expert solves |
| frames  | ``hand_frames.png``: frames of hands in formats of other programs |
| grasp_image | ``grasp_image.png``: grasps that ``policies/depth`` finds in a noisy depth image of a kettle |
| clearing | ``clearing.png``: a pile that ``policies/panda_clutter`` clears |
| export  | ``exported_scene.png``: a grasp held by graspbox, and by MuJoCo in the exported scene (needs OpenGL) |
| study   | ``table_3_1.png``: table 3.1 of the reference study, compared with graspbox |

``scripts/plot_sb3.py`` plots ``learning_*.png`` from runs of ``graspbox train sb3``. Needs ``[cli,onnx,ycb]``, and
``[dev]`` for ``export``.
"""

import argparse
from collections.abc import Callable
from pathlib import Path
from typing import Any

import gymnasium

from graspbox import Plan, Scene, object_sets, pictures, plan
from graspbox._common.programs import run_program
from graspbox.configs import CameraConfig, PictureConfig, TrialConfig
from graspbox.envs.expert import ExpertGrasp
from graspbox.envs.expert import planned as planned_poses
from graspbox.evaluation.planner_trials import try_set
from graspbox.meshes.views import ViewPlan, views
from graspbox.perception.crops import add_depth_noise
from graspbox.policies.grasp_image import grasp_image
from graspbox.study import comparison

#: From easy to hard: nearly all of the best 20 poses succeed for the first, and few for the last.
PLANNED = ("procedural:kettle:0", "ycb:006_mustard_bottle", "ycb:072-a_toy_airplane", "ycb:035_power_drill")
#: Poses to try for each, and to show; more would occlude each other.
POSES, SHOWN = 20, 12
#: Has both firm and failed grasps among its best poses.
TRACED = "ycb:006_mustard_bottle"
SWEPT = "procedural:kettle:3"
#: Object of the depth image, and the policy.
SEEN, POLICY = "procedural:kettle:0", Path("policies/depth")
#: The policy that clears a pile.
CLEARS = Path("policies/panda_clutter")
#: Object of the exported scene.
EXPORTED = "procedural:mug:3"
#: Object and seed of the episode.
PLAYED, START = "ycb:025_mug", 1


def planned(name: str) -> tuple[Scene, Plan]:
    """Settle an object and plan for its resting pose; keeps the best poses."""
    scene = Scene(object_sets.load(name)[0].load())
    planned = plan(scene.mesh, seed=0, world_from_object=scene.world_from_object)
    return scene, planned.best(POSES)


def write_plan(out: Path) -> None:
    """Show plans of several objects, and a grasp of each."""
    examples = [pictures.GraspExample.run(*planned(name)) for name in PLANNED]
    pictures.save_gallery(out / "plan.png", examples, count=SHOWN)


def write_sweep(out: Path) -> None:
    """Show how boxes depend on thresholds."""
    mesh = object_sets.load(SWEPT)[0].load()
    for fit in ("minimum", "pca"):
        pictures.save_sweep(out / f"sweep_kettle_{fit}.png", mesh, fit=fit)


def write_trials(out: Path) -> None:
    """Show a firm and a failed grasp."""
    scene, best = planned(TRACED)
    firm, failed = pictures.firm_and_failed(scene, best)
    pictures.save_kindness(out / "kindness.png", scene.name, failed, firm)
    pictures.save_stages(out / "stages.png", scene, [firm, failed])
    pictures.save_trial(out / "trial.webp", scene, firm)


def write_episode(out: Path) -> None:
    """Show an episode, with the images of its cameras, and moving."""
    pictures.save_episode(out / "episode.png", PLAYED, seed=START)
    near = CameraConfig("viewer", eye=(-0.45, -0.75, 0.5), target=(0.015, -0.015, 0.19), fov=0.56, far=30.0)
    picture = PictureConfig((300, 400), camera=near)
    shown: dict[str, Any] = {"objects": PLAYED, "render_mode": "rgb_array", "picture": picture}
    env: Any = gymnasium.make("graspbox/Grasp-v0", control_freq=20, max_episode_steps=200, **shown).unwrapped
    observation, _ = env.reset(seed=START)
    best = planned_poses(object_sets.load(PLAYED)[0].load(), observation, seed=START)
    expert = ExpertGrasp(observation, best.poses[0], best.preshape[0], control_freq=20)
    frames, done = [env.render()], False
    while not done and not expert.finished:
        observation, _, done, _, _ = env.step(expert.act(observation))
        frames.append(env.render())
    step = 1 / env.metadata["render_fps"]
    captions = [f"{index * step:.1f} s" for index in range(len(frames))]
    # Every third picture: the file stays small.
    pictures.save_video(out / "episode.webp", frames[::3], captions[::3], seconds=3 * step)


def write_grasp_image(out: Path) -> None:
    """Show the grasps that a policy finds in one depth image."""
    scene = Scene(object_sets.load(SEEN)[0].load())
    camera = ViewPlan("random", axis=(0.0, 0.0, 1.0), cap=1.0, distance=(0.6, 0.6))
    settings: dict[str, Any] = {"plan": camera, "count": 1, "image_size": (360, 480), "images": "depth"}
    seen = views(scene.mesh, seed=0, world_from_object=scene.world_from_object, **settings)
    depth = 1e-3 * add_depth_noise(seen.depth, seen.intrinsics, 0)[0]
    image = grasp_image(depth, seen.intrinsics, seen.world_from_camera[0], POLICY, seed=0)
    pictures.save_grasp_image(out / "grasp_image.png", image)


def write_clearing(out: Path) -> None:
    """Show a pile that a policy clears."""
    from clearing import save_clearing

    save_clearing(out / "clearing.png", CLEARS, "procedural:unseen:0-19", count=7, seed=2)


def write_export(out: Path) -> None:
    """Show a grasp held by graspbox and by MuJoCo, which steps the exported scene."""
    from exported_scene import save_exported_scene

    save_exported_scene(out / "exported_scene.png", *planned(EXPORTED))


def write_study(out: Path) -> None:
    """Compare the study's table with graspbox."""
    objects = object_sets.load(comparison.study_objects())
    result = try_set(objects, poses=POSES, seed=0, trial=TrialConfig(legacy=True))
    compared = comparison.Comparison.of(result)
    comparison.save_comparison(out / "table_3_1.png", compared)


PICTURES: dict[str, Callable[[Path], None]] = {
    "plan": write_plan,
    "sweep": write_sweep,
    "trials": write_trials,
    "episode": write_episode,
    "frames": lambda out: pictures.save_hand_frames(out / "hand_frames.png"),
    "grasp_image": write_grasp_image,
    "clearing": write_clearing,
    "export": write_export,
    "study": write_study,
}


def main() -> None:
    """Write the requested pictures."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("names", nargs="*", metavar="NAME", help=f"{', '.join(PICTURES)}; all by default")
    parser.add_argument("--out", type=Path, default=Path("docs/pictures"), help="folder of the pictures")
    args = parser.parse_args()
    unknown = sorted(set(args.names) - set(PICTURES))
    if unknown:
        parser.error(f"there is no picture {', '.join(unknown)}; choose from {', '.join(PICTURES)}")
    args.out.mkdir(parents=True, exist_ok=True)
    for name in args.names or PICTURES:
        PICTURES[name](args.out)
        print(f"wrote {name} to {args.out}", flush=True)


if __name__ == "__main__":
    run_program(main)
