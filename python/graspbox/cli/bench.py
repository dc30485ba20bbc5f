"""``graspbox bench``: speed of planning, simulation and rendering on this machine."""

import time
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
import typer
from numpy.typing import NDArray

import graspbox
from graspbox import _core, object_sets
from graspbox._common.arguments import config_dict
from graspbox.cli.common import Json, Seed, Threads, console, print_json, print_table
from graspbox.configs import CamerasConfig, DecomposeConfig
from graspbox.envs.expert import ExpertGrasp, planned
from graspbox.envs.grasp_pose import GraspPoseVectorEnv
from graspbox.envs.scripted import MotionOptions
from graspbox.envs.vector import GraspVectorEnv

#: Scanned objects of about 16,000 faces each.
_OBJECTS = ("ycb:003_cracker_box", "ycb:005_tomato_soup_can", "ycb:006_mustard_bottle", "ycb:025_mug")
_SEEN = "ycb:006_mustard_bottle"
_SIZES = (64, 128, 224)
#: Frames of a step, and steps whose median is taken.
_FRAMES, _FRAME_STEPS = 16, 31
_ENVS, _STEPS = 16, 120
#: A step is 0.05 s.
_MOTION = MotionOptions(fingers="each", control_freq=20.0)
_OBJECT = 2
#: Shares of steps with the hand on the object, and of pixels with the object, below which a speed is not meaningful.
LEAST = {"steps in contact": 30.0, "pixels of the object": 10.0}
#: Objects on which trials are timed.
_MIX = ("procedural:box:0-1", "procedural:can:0-1", "procedural:mug:0-1", "procedural:bottle:0-1")
_POSES = 10
#: Arms whose rates are compared with that of the hand alone.
_ARMS, _ARM_HAND, _ARM_STEPS = ("fr3", "ur5e", "xarm7"), "panda_gripper", 60
#: Environments and repeats of the call whose overhead is measured.
_WIDE, _CALLS = 64, 201
#: Goals on two cores, by the beginning of their rows: upper bounds for times, lower bounds for rates and shares.
_GOALS = {
    "decomposition into at most 8 PCA": 4.0,
    "decomposition into at most 8 minimum-volume": 150.0,
    "solid voxels, 32": 2.0,
    "solid voxels, 128": 30.0,
    "grasp trials": 15.0,
    "vector call": 3.0,
    "depth frames, 64": 4000.0,
    "depth frames, 128": 2000.0,
    "depth frames, 224": 800.0,
    "rgb frames, 64": 3000.0,
    "rgb frames, 128": 1500.0,
    "rgb frames, 224": 600.0,
    "env-steps, state": 1500.0,
    "env-steps, depth": 1200.0,
    "env-steps on an arm": 60.0,
    **LEAST,
}

Row = tuple[str, float, str]


def median_seconds(work: Callable[[], Any], repeats: int = 7) -> float:
    """Time a piece of work: the median of a few repeats, after one to warm up."""
    work()
    times = []
    for _ in range(repeats):
        started = time.perf_counter()
        work()
        times.append(time.perf_counter() - started)
    return float(np.median(times))


def seconds_of_steps(env: GraspPoseVectorEnv, options: dict[str, Any] | None, steps: int, seed: int) -> float:
    """Time whole vector steps without physics, since their actions name no pose: the median."""
    nothing, times = np.zeros((env.num_envs, env._core.action_size), np.float32), []
    for _ in range(steps):
        env.reset(seed=seed, options=options)
        started = time.perf_counter()
        env.step(nothing)
        times.append(time.perf_counter() - started)
    return float(np.median(times))


def call_overhead(threads: int | None, seed: int) -> float:
    """Time whole vector steps without physics: microseconds per environment."""
    obs = ("proprio", "state", "tactile")
    env = GraspPoseVectorEnv(_WIDE, "procedural:can:0", obs=obs, reward="dense", num_threads=threads)
    return 1e6 * seconds_of_steps(env, None, _CALLS, seed) / _WIDE


def measure(threads: int | None, seed: int = 0) -> list[dict[str, Any]]:
    """Measure everything: a list of ``{"work", "value", "unit", "goal", "ratio"}``.

    The seed is that of surface samples, plans and initial states.
    """
    mesh = object_sets.load("procedural:mug:0")[0].load()
    boxes = {fit: config_dict(DecomposeConfig(fit=fit, max_boxes=8, seed=seed)) for fit in ("pca", "minimum")}
    scene = graspbox.Scene(mesh)
    cut = {fit: 1e3 * median_seconds(partial(_core.decompose, mesh, config)) for fit, config in boxes.items()}
    planned = 1e3 * median_seconds(lambda: graspbox.plan(mesh, world_from_object=scene.world_from_object, seed=seed), 3)
    rows = [
        ("decomposition into at most 8 PCA boxes, 2,000 points", cut["pca"], "ms"),
        ("decomposition into at most 8 minimum-volume boxes, 2,000 points", cut["minimum"], "ms"),
        ("plan", planned, "ms"),
    ]
    scanned = object_sets.load("ycb:025_mug")[0].load()
    for n in (32, 128):
        solid = 1e3 * median_seconds(partial(graspbox.voxelize, scanned, n), 31)
        rows.append((f"solid voxels, {n} per side, mesh of {len(scanned.faces):,} faces", solid, "ms"))
    tried, seconds = 0, 0.0
    for spec in object_sets.load(list(_MIX)):
        scene = graspbox.Scene(spec.load())
        best = graspbox.plan(scene.mesh, world_from_object=scene.world_from_object, seed=seed).best(_POSES)
        started = time.perf_counter()
        scene.simulate(best.poses, best.preshape, num_threads=threads)
        seconds += time.perf_counter() - started
        tried += len(best)
    rows.append((f"grasp trials, {threads or _core.num_threads()} threads, procedural mix", tried / seconds, "1/s"))
    rows.append((f"vector call without physics, {_WIDE} envs, for each", call_overhead(threads, seed), "us"))
    rows += [*frame_rates(threads), *step_rates(threads, seed), *arm_shares(threads, seed)]
    return [{"work": work, "value": value, "unit": unit, **against(work, value, unit)} for work, value, unit in rows]


def against(work: str, value: float, unit: str) -> dict[str, float | None]:
    """Find the goal of a row, and the ratio of the row to it: above 1 the goal is met."""
    goal = next((goal for name, goal in _GOALS.items() if work.startswith(name)), None)
    if goal is None:
        return {"goal": None, "ratio": None}
    return {"goal": goal, "ratio": value / goal if unit in ("1/s", "%") else goal / value}


def bench(seed: Seed = 0, threads: Threads = None, as_json: Json = False) -> None:
    """Measure the speed of planning, simulation and rendering on this machine.

    The exit status is 1 if the speeds are not meaningful: the hand touched the object too rarely, or the object covered
    too few pixels.
    """
    with console.status("measuring"):
        rows = measure(threads, seed)
    if as_json:
        print_json(rows)
    else:
        keys = ("work", "value", "unit", "goal", "ratio")
        cells = [("" if r[k] is None else r[k] if k in ("work", "unit") else f"{r[k]:.3g}" for k in keys) for r in rows]
        print_table("benchmarks", (*keys[:4], "ratio to goal"), [tuple(row) for row in cells])
    doubts = idle(rows)
    for sentence in doubts:
        console.print(sentence)
    if doubts:
        raise typer.Exit(1)


def frame_rates(threads: int | None) -> list[Row]:
    """Measure frames per second on one thread: hand, table and object at the start of a grasp, from ``front``.

    Environments take them side by side in steps without physics, since their actions name no pose.
    """
    world_from_hand = [[1.0, 0, 0, 0.0], [0, -1.0, 0, 0.0], [0, 0, -1.0, 0.21], [0, 0, 0, 1.0]]
    start = {"world_from_hand": world_from_hand, "resting": 0, "place": [0.0, 0.0, 0.9]}
    seen, _ = GraspVectorEnv(1, _SEEN, obs=("segmentation", "state"), num_threads=threads).reset(seed=0, options=start)
    labels = seen["segmentation"]
    shares = f"object on {100 * (labels == _OBJECT).mean():.0f} %, hand on {100 * (labels > _OBJECT).mean():.0f} %"
    rows: list[Row] = []
    for image in ("depth", "rgb"):
        for size in _SIZES:
            cameras = CamerasConfig(image_size=(size, size))
            env = GraspPoseVectorEnv(_FRAMES, _SEEN, obs=(image,), cameras=cameras, num_threads=1)
            seconds = seconds_of_steps(env, start, _FRAME_STEPS, seed=0) / _FRAMES
            rows.append((f"{image} frames, {size} x {size}, one thread ({shares})", 1 / seconds, "1/s"))
    return rows


def _expert(env: GraspVectorEnv, name: str, state: NDArray[np.float32], seed: int) -> ExpertGrasp:
    """Plan for an object as it lies, and take the best pose."""
    plan = planned(env.objects[env.objects.names.index(name)].load(), state, seed=seed)
    return ExpertGrasp(state, plan.poses[0], plan.preshape[0], **_MOTION)


def step_rates(threads: int | None, seed: int = 0) -> list[Row]:
    """Measure steps per second of environments side by side, under the actions of the scripted expert.

    The seed is that of the initial states and of the plans.
    """

    def make(obs: Any) -> GraspVectorEnv:
        return GraspVectorEnv(_ENVS, _OBJECTS, obs=obs, max_episode_steps=200, num_threads=threads, **_MOTION)

    env = make(("state", "segmentation"))
    seen, info = env.reset(seed=seed)
    experts = [_expert(env, name, state, seed) for name, state in zip(info["object"], seen["state"], strict=True)]
    actions, touches, share, ended = [], [], [], np.zeros(_ENVS, dtype=np.bool_)
    for _ in range(_STEPS):
        acts = [expert.act(state) for expert, state in zip(experts, seen["state"], strict=True)]
        actions.append(np.stack(acts).astype(np.float32))
        seen, _, terminated, truncated, info = env.step(actions[-1])
        # The step after the last one began the next episode.
        for i in np.flatnonzero(ended):
            experts[i] = _expert(env, info["object"][i], seen["state"][i], seed)
        ended = terminated | truncated
        touches.append(info["touches"].mean())
        share.append((seen["segmentation"] == _OBJECT).mean())
    setting = f"{_ENVS} envs, expert"
    shares = dict(zip(LEAST, (100 * float(np.mean(touches)), 100 * float(np.mean(share))), strict=True))
    rows: list[Row] = [(f"{name}, {setting}", value, "%") for name, value in shares.items()]
    envs, seconds = {obs: make(obs) for obs in ("state", "depth")}, {"state": 0.0, "depth": 0.0}
    for one in envs.values():
        one.reset(seed=seed)
    # By turns, so that other load on the machine slows both alike.
    for action in actions:
        for obs, one in envs.items():
            started = time.perf_counter()
            one.step(action)
            seconds[obs] += time.perf_counter() - started
    for obs, image in (("state", ""), ("depth", " 64 x 64")):
        rows.append((f"env-steps, {obs}{image}, {setting}", _ENVS * _STEPS / seconds[obs], "1/s"))
    return rows


def arm_shares(threads: int | None, seed: int = 0) -> list[Row]:
    """Measure the rate of environments on arms, as shares of that without, under random actions and by turns."""
    arms = (None, *_ARMS)
    envs = {
        arm: GraspVectorEnv(_ENVS, "procedural:box:0-19", hand=_ARM_HAND, arm=arm, num_threads=threads) for arm in arms
    }
    seconds, random = dict.fromkeys(envs, 0.0), np.random.default_rng(seed)
    for env in envs.values():
        env.reset(seed=seed)
    for _ in range(_ARM_STEPS):
        actions = random.uniform(-1, 1, envs[None].action_space.shape).astype(np.float32)
        for arm, env in envs.items():
            started = time.perf_counter()
            env.step(actions)
            seconds[arm] += time.perf_counter() - started
    setting = f"{_ENVS} envs, {_ARM_HAND}, random actions"
    shares = {arm: 100 * seconds[None] / seconds[arm] for arm in _ARMS}
    return [(f"env-steps on an arm, {arm}, of those without, {setting}", share, "%") for arm, share in shares.items()]


def idle(rows: list[dict[str, Any]]) -> list[str]:
    """Find the shares that are too small for the speeds to be meaningful: a sentence for each."""
    return [
        f"{row['work']}: {row['value']:.1f} %; below {least:g} % the speeds are not meaningful"
        for row in rows
        for name, least in LEAST.items()
        if row["work"].startswith(name) and row["value"] < least
    ]
