"""Measure the decision time of a policy of one depth image, step by step, with onnxruntime and with torch.

    python scripts/measure_decision.py policies/depth --decisions 50

With ``--layout packed``, ``pile`` or ``bin`` the images are those of
``graspbox/GraspPose-v0`` with five objects, one of which is the target; ``--any-target`` takes whatever grasp is best.

The backends alternate on the same images. A table gives medians of wall time and of processor time (all threads), in
milliseconds; processor time changes little if other programs compete for the cores.
"""

import argparse
import time
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path

import gymnasium
import numpy as np
from numpy.typing import NDArray

from graspbox import load_hand, object_sets
from graspbox._common.programs import run_program
from graspbox.learn.models.scenes import SceneConfig, SceneSampler
from graspbox.meshes.views import ViewPlan, views
from graspbox.perception import DepthView, FoundGrasp, GraspFinder, PoseNoise, Query, add_depth_noise
from graspbox.policies import DepthGrasp
from graspbox.policies.base import Task
from graspbox.policies.finders import load_finder
from graspbox.policies.published.folders import read_depth_policy
from graspbox.policies.published.runtimes import Backend

#: Label of the target in segmentations.
TARGET = 2
#: An image, and the pixels of the object to grasp.
Image = tuple[DepthView, NDArray[np.bool_] | None]
STEPS = ("crop", "complete", "propose", "score", "refine", "average", "rehearse")


def finder_of(folder: Path, backend: Backend, num_threads: int | None) -> GraspFinder:
    """Load the policy's finder with one backend."""
    config = read_depth_policy(folder)
    return load_finder(folder, config, load_hand(config.hand), backend=backend, num_threads=num_threads)


def single_objects(args: argparse.Namespace) -> Iterator[Image]:
    """Render single objects from any side."""
    scenes = SceneConfig()
    sampler = SceneSampler(object_sets.load(args.objects), scenes, 0)
    plan = ViewPlan("random", axis=(0.0, 0.0, 1.0), cap=1.1, distance=scenes.distance)
    for number in range(args.decisions):
        _, mesh, pose = sampler.sample_object(np.random.default_rng(number))
        seen = views(mesh, plan=plan, seed=number, count=1, image_size=128, images="depth", world_from_object=pose)
        depth = add_depth_noise(seen.depth, seen.intrinsics, number)[0]
        yield DepthView(depth, seen.intrinsics, seen.world_from_camera[0]), None


def scenes(args: argparse.Namespace) -> Iterator[Image]:
    """Render scenes of five objects, with the pixels of the target."""
    policy = DepthGrasp(args.policy)
    env = gymnasium.make(
        "graspbox/GraspPose-v0",
        objects=args.objects,
        layout=args.layout,
        objects_per_scene=5,
        obs=(*policy.obs, *policy.target_obs),
        **policy.settings,
    )
    with env:
        policy.bind(Task.of(env))
        for number in range(args.decisions):
            observation, _ = env.reset(seed=number)
            target = None if args.any_target else observation["segmentation"][..., 0] == TARGET
            yield policy.observer.look(observation, number), target


def main() -> None:
    """Time decisions and print the medians."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("policy", type=Path, help="folder of the policy")
    parser.add_argument("--objects", default="procedural:unseen:0-9")
    parser.add_argument("--layout", choices=("packed", "pile", "bin"), help="scenes of five objects")
    parser.add_argument("--any-target", action="store_true", help="with --layout: any of the objects")
    parser.add_argument("--decisions", type=int, default=50)
    parser.add_argument("--threads", type=int, help="threads; by default one per core")
    parser.add_argument("--backends", nargs="+", default=["onnx", "torch"])
    parser.add_argument("--hand-error", nargs=2, type=float, help="standard deviations, millimetres and degrees")
    parser.add_argument("--rehearse", type=int, metavar="GRASPS", help="grasps that are tried on the completed shape")
    args = parser.parse_args()
    error = PoseNoise.in_millimetres(*args.hand_error) if args.hand_error else None
    if "torch" in args.backends and args.threads:
        import torch

        torch.set_num_threads(args.threads)
    finders = {backend: finder_of(args.policy, backend, args.threads) for backend in args.backends}
    wall: dict[str, dict[str, list[float]]] = {backend: defaultdict(list) for backend in finders}
    processor: dict[str, list[float]] = defaultdict(list)
    same = 0
    images = single_objects(args) if args.layout is None else scenes(args)
    for number, (view, target) in enumerate(images):
        found: dict[str, FoundGrasp | None] = {}
        for backend, finder in finders.items():
            began, cpu = time.perf_counter(), time.process_time()
            found[backend] = finder.find(view, Query(number, target, hand_error=error, rehearsed=args.rehearse))
            wall[backend]["all"].append(time.perf_counter() - began)
            processor[backend].append(time.process_time() - cpu)
            for step, seconds in (one.seconds if (one := found[backend]) else {}).items():
                wall[backend][step].append(seconds)
        grasps = [None if one is None else one.world_from_hand for one in found.values()]
        same += all((a is None) == (grasps[0] is None) for a in grasps) and (
            grasps[0] is None or all(np.allclose(grasps[0], a, atol=1e-6) for a in grasps if a is not None)
        )
    print("backend  " + "".join(f"{step:>10}" for step in (*STEPS, "wall", "processor")))
    for backend in finders:
        numbers = [np.median(wall[backend][step] or [0.0]) for step in (*STEPS, "all")]
        numbers.append(np.median(processor[backend]))
        print(f"{backend:<9}" + "".join(f"{1e3 * number:10.1f}" for number in numbers))
    print(f"{same} of {args.decisions} decisions are the same with all backends")


if __name__ == "__main__":
    run_program(main)
