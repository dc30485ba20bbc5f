"""Measure the success of grasps that a policy finds in depth images with the noise of real cameras, in simulation.

    python scripts/measure_real_noise.py policies/panda_clutter --trials 300
    python scripts/measure_real_noise.py policies/panda_clutter --trials 300 --rendered

Objects at rest, alone and packed in turn, are seen by cameras at 0.35 to 1.5 m with noise that neighbouring pixels
share, and with holes (`graspbox.learn.models.scenes.SceneConfig.as_real`); with ``--rendered``, as policies are
otherwise evaluated. Each image goes the way of ``graspbox grasp-image``: nothing but depth and intrinsics is known. The
best grasp is simulated. An image that is refused counts as a failure.
"""

import argparse
from typing import NamedTuple

import numpy as np

from graspbox import object_sets
from graspbox._common.programs import run_program
from graspbox._common.progress import ProgressBar
from graspbox.errors import ConfigError, MeshError, SimulationError
from graspbox.evaluation.results import wilson
from graspbox.hands import Hand
from graspbox.learn.models.scenes import PlacedObjects, SceneConfig, SceneSampler
from graspbox.meshes.views import ViewPlan, views
from graspbox.perception import add_depth_noise
from graspbox.policies.grasp_image import ImageGrasper
from graspbox.simulation import Scene

#: Rows and columns of an image, and its vertical field of view, radians.
IMAGE_SIZE, FOV = (360, 480), 0.75


class Trial(NamedTuple):
    """Layout and distance of a scene, the stated probability of its best grasp (None if refused), and its success."""

    layout: str
    distance: float
    stated: float | None
    success: bool


def scene_of(sampler: SceneSampler, layout: str, rng: np.random.Generator, hand: Hand) -> tuple[Scene, PlacedObjects]:
    """Sample a scene; raises MeshError or SimulationError if it does not come to rest."""
    if layout == "single":
        _, mesh, start = sampler.sample_object(rng)
        scene = Scene(mesh, hand=hand, world_from_object=start)
        return scene, PlacedObjects((mesh,), scene.world_from_object[None])
    clutter = sampler.sample_clutter(rng, "packed", hand)
    return Scene.of(clutter.arrangement, hand=hand), PlacedObjects.of(clutter.arrangement)


def tried(
    grasper: ImageGrasper, scene: Scene, placed: PlacedObjects, layout: str, config: SceneConfig, seed: int
) -> Trial:
    """Take an image of a scene, and try the best grasp in it."""
    rng = np.random.default_rng(seed)
    distance = float(rng.uniform(*config.distance))
    cap = float(np.pi / 2 - config.elevation)
    several = len(placed.meshes) > 1
    seen = views(
        placed.meshes[0],
        plan=ViewPlan("random", axis=(0.0, 0.0, 1.0), cap=cap, distance=(distance, distance), shift=0.02),
        count=1,
        seed=int(rng.integers(2**62)),
        image_size=IMAGE_SIZE,
        images="depth",
        fov=FOV,
        levels=False,
        world_from_object=placed.world_from_objects[0],
        target=placed.middle,
        neighbours=placed.others() if several else None,
    )
    depth = 0.001 * add_depth_noise(seen.depth, seen.intrinsics, int(rng.integers(2**62)), config.noise)[0]
    try:
        found = grasper.find(depth, seen.intrinsics, count=1)
    except ConfigError:
        return Trial(layout, distance, None, False)
    if not len(found):
        return Trial(layout, distance, None, False)
    world_from_hand = seen.world_from_camera[0] @ found.camera_from_hand[0]
    object_from_hand = np.linalg.inv(scene.world_from_object) @ world_from_hand
    outcomes = scene.simulate(object_from_hand[None], found.preshape[:1])
    return Trial(layout, distance, float(found.success[0]), bool(outcomes.success[0]))


def row(name: str, trials: list[Trial]) -> str:
    """Return a row of the table."""
    succeeded, answered = sum(one.success for one in trials), [one for one in trials if one.stated is not None]
    low, high = wilson(succeeded, len(trials))
    stated = np.mean([one.stated for one in answered]) if answered else np.nan
    of = sum(one.success for one in answered) / max(len(answered), 1)
    rate = succeeded / max(len(trials), 1)
    return (
        f"| {name} | {len(trials)} | {len(answered)} | {rate:.1%} ({low:.1%} to {high:.1%}) | {of:.1%} | {stated:.1%} |"
    )


def main() -> None:
    """Run the trials and print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("policy", help="an installed policy of one depth image, or the folder of one")
    parser.add_argument("--objects", default="procedural:unseen:0-19")
    parser.add_argument("--trials", type=int, default=300)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--rendered", action="store_true", help="with the noise and the cameras of other evaluations")
    args = parser.parse_args()
    grasper = ImageGrasper(args.policy)
    sampler = SceneSampler(object_sets.load(args.objects), SceneConfig(), args.seed)
    trials: list[Trial] = []
    with ProgressBar(args.policy, args.trials, True) as bar:
        number = 0
        while len(trials) < args.trials:
            rng, layout = np.random.default_rng([args.seed, number]), ("single", "packed")[number % 2]
            number += 1
            try:
                scene, placed = scene_of(sampler, layout, rng, grasper.hand)
            except (MeshError, SimulationError):
                continue
            config = SceneConfig() if args.rendered else SceneConfig().as_real(rng)
            trials.append(tried(grasper, scene, placed, layout, config, int(rng.integers(2**62))))
            bar.update(len(trials))
    print("| scenes | images | answered | success of all | of the answered | stated |\n|---|--:|--:|--:|--:|--:|")
    print(row("all", trials))
    for layout in ("single", "packed"):
        print(row(layout, [one for one in trials if one.layout == layout]))
    for low, high in ((0.0, 0.6), (0.6, 0.9), (0.9, 1.2), (1.2, 2.0)):
        print(row(f"{low} to {high} m", [one for one in trials if low <= one.distance < high]))


if __name__ == "__main__":
    run_program(main)
