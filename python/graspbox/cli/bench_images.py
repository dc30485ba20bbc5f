"""Images in ``graspbox bench``: frames and steps per second, with the shares that make them meaningful."""

import time
from typing import Any

import numpy as np
from numpy.typing import NDArray

from graspbox import _core
from graspbox.arguments import to_json
from graspbox.configs import CamerasConfig
from graspbox.envs.expert import Expert, planned
from graspbox.envs.vector import GraspVectorEnv

#: Scanned objects of about 16,000 faces each.
_OBJECTS = ("ycb:003_cracker_box", "ycb:005_tomato_soup_can", "ycb:006_mustard_bottle", "ycb:025_mug")
_SEEN = "ycb:006_mustard_bottle"
_SIZES = (64, 128, 224)
_FRAMES = 300
_ENVS, _STEPS = 16, 120
_OBJECT = 2
#: Shares of steps with the hand on the object, and of pixels with the object, below which a speed is not meaningful.
LEAST = {"steps in contact": 30.0, "pixels of the object": 10.0}

Row = tuple[str, float, str]


def frames(threads: int | None) -> list[Row]:
    """Measure frames per second on one thread: hand, table and object at the start of a grasp, from ``front``."""
    env = GraspVectorEnv(1, _SEEN, obs=("segmentation", "state"), num_threads=threads)
    world_from_hand = [[1.0, 0, 0, 0.0], [0, -1.0, 0, 0.0], [0, 0, -1.0, 0.21], [0, 0, 0, 1.0]]
    seen, _ = env.reset(seed=0, options={"world_from_hand": world_from_hand, "resting": 0, "place": [0.0, 0.0, 0.9]})
    labels = seen["segmentation"]
    shares = f"object on {100 * (labels == _OBJECT).mean():.0f} %, hand on {100 * (labels > _OBJECT).mean():.0f} %"
    rows: list[Row] = []
    for image in ("depth", "rgb"):
        for size in _SIZES:
            cameras = to_json(CamerasConfig(images=(image,), image_size=(size, size)))
            seconds = _core._time_images(env._core.local_pool, 0, cameras, _FRAMES)
            rows.append(
                (f"{image} frames, {size} x {size}, one thread ({shares})", 1 / float(np.median(seconds)), "1/s")
            )
    return rows


def _expert(env: GraspVectorEnv, name: str, state: NDArray[np.float32], seed: int) -> Expert:
    """Plan for an object as it lies, and take the best pose."""
    plan = planned(env.objects[env.objects.names.index(name)].load(), state, seed=seed)
    return Expert(state, plan.poses[0], plan.preshape[0])


def steps(threads: int | None, seed: int = 0) -> list[Row]:
    """Measure steps per second of environments side by side, under the actions of the scripted expert.

    The seed is that of the initial states and of the plans.
    """

    def make(obs: Any) -> GraspVectorEnv:
        return GraspVectorEnv(_ENVS, _OBJECTS, obs=obs, max_episode_steps=200, num_threads=threads)

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
    what = f"{_ENVS} envs, expert"
    shares = dict(zip(LEAST, (100 * float(np.mean(touches)), 100 * float(np.mean(share))), strict=True))
    rows: list[Row] = [(f"{name}, {what}", value, "%") for name, value in shares.items()]
    envs, seconds = {obs: make(obs) for obs in ("state", "depth")}, {"state": 0.0, "depth": 0.0}
    for one in envs.values():
        one.reset(seed=seed)
    # By turns, so that whatever else the machine does slows both alike.
    for action in actions:
        for obs, one in envs.items():
            started = time.perf_counter()
            one.step(action)
            seconds[obs] += time.perf_counter() - started
    for obs, image in (("state", ""), ("depth", " 64 x 64")):
        rows.append((f"env-steps, {obs}{image}, {what}", _ENVS * _STEPS / seconds[obs], "1/s"))
    return rows


def idle(rows: list[dict[str, Any]]) -> list[str]:
    """Find the shares that are too small for the speeds to be meaningful: a sentence for each."""
    return [
        f"{row['work']}: {row['value']:.1f} %; below {least:g} % the speeds are not meaningful"
        for row in rows
        for name, least in LEAST.items()
        if row["work"].startswith(name) and row["value"] < least
    ]
