"""Golden values: 200 labels and 20 episodes of each environment, remade and compared bit by bit.

``python tests/python/golden.py`` compares, ``--write`` remakes ``tests/fixtures/golden.json``. A change that keeps
physics, observations and rewards leaves the file as it is. A change that moves them on purpose remakes it in a commit
of its own, which says how many values moved and why.

Labels are simulated from the poses in the file, so a changed planner does not hide a changed simulation; the planner's
own poses are compared beside them. Floating-point numbers are kept as hexadecimal text, images and long vectors as
hashes.
"""

import argparse
import hashlib
import json
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
from numpy.typing import NDArray

import graspbox
from acting import CAMERAS, best_grasp, expert_actions, pressing
from graspbox import object_sets

FILE = Path(__file__).parents[1] / "fixtures" / "golden.json"

#: Ten of each kind; every family of shapes that the convex parts, the planner and the contacts treat differently.
PROCEDURAL = (
    "procedural:ball:3", "procedural:box:3", "procedural:can:3", "procedural:mug:3", "procedural:bottle:3",
    "procedural:bowl:3", "procedural:kettle:3", "procedural:fork:3", "procedural:hammer:3", "procedural:banana:3",
)  # fmt: skip
YCB = (
    "ycb:002_master_chef_can", "ycb:006_mustard_bottle", "ycb:011_banana", "ycb:013_apple", "ycb:025_mug",
    "ycb:035_power_drill", "ycb:029_plate", "ycb:030_fork", "ycb:043_phillips_screwdriver", "ycb:077_rubiks_cube",
)  # fmt: skip
POSES = 10
EPISODES = 20
#: Steps of an episode of Grasp-v0 that no expert drives.
STEPS = 40


def digest(array: NDArray[Any]) -> str:
    """Shorten an array to a hash of its type, shape and bytes."""
    text = f"{array.dtype.str}{array.shape}".encode()
    return hashlib.blake2b(text + np.ascontiguousarray(array).tobytes(), digest_size=8).hexdigest()


def hexed(values: NDArray[np.float64]) -> list[str]:
    """Write every bit of some numbers."""
    return [float(value).hex() for value in np.ravel(values)]


def scene_and_plan(name: str) -> tuple[graspbox.Scene, graspbox.Plan]:
    """Let an object settle, and plan for it."""
    scene = graspbox.Scene(object_sets.load(name)[0].load())
    plan = graspbox.plan(scene.mesh, world_from_object=scene.world_from_object, seed=0)
    return scene, plan.best(POSES)


def planned(plan: graspbox.Plan, scene: graspbox.Scene) -> dict[str, Any]:
    """Poses as they are kept: full precision, and what they depend on."""
    return {
        "world_from_object": hexed(scene.world_from_object),
        "poses": [hexed(pose[:3]) for pose in plan.poses],
        "preshape": hexed(plan.preshape),
    }


def labels(scene: graspbox.Scene, kept: dict[str, Any]) -> list[list[Any]]:
    """Simulate the poses that were kept."""
    poses = np.array([[float.fromhex(x) for x in [*pose, *["0x0p+0"] * 3, "0x1p+0"]] for pose in kept["poses"]])
    preshape = np.array([float.fromhex(x) for x in kept["preshape"]])
    out = scene.simulate(poses.reshape(-1, 4, 4), preshape, config=graspbox.TrialConfig(legacy=True))
    numbers = [hexed(values) for values in (out.lift, out.kindness_rate, out.kindness, out.time)]
    rows = zip(out.success, out.secure, out.legacy_success, out.failure, *numbers, strict=True)
    return [[bool(a), bool(b), bool(c), str(f), *rest] for a, b, c, f, *rest in rows]


class Recorder:
    """Hashes everything that an episode shows, name by name."""

    def __init__(self, observation: dict[str, NDArray[Any]], info: dict[str, Any]) -> None:
        self._hashes = {name: hashlib.blake2b(digest_size=8) for name in observation}
        self._rewards: list[float] = []
        self._terms: list[dict[str, float]] = []
        self._infos = [_plain(info)]
        self._show(observation)

    def _show(self, observation: dict[str, NDArray[Any]]) -> None:
        for name, values in observation.items():
            self._hashes[name].update(digest(values).encode())

    def step(self, observation: dict[str, NDArray[Any]], reward: float, info: dict[str, Any]) -> None:
        """Add what a step returned."""
        self._show(observation)
        self._rewards.append(reward)
        self._terms.append({name: float(value) for name, value in info["reward_terms"].items()})
        self._infos.append(_plain(info))

    def result(self) -> dict[str, Any]:
        """Summarize the episode."""
        terms = {name: hexed(np.array([sum(row[name] for row in self._terms)]))[0] for name in self._terms[0]}
        infos = json.dumps(self._infos, sort_keys=True).encode()
        return {
            "steps": len(self._rewards),
            "return": float(sum(self._rewards)).hex(),
            "terms": terms,
            "last": self._infos[-1],
            "infos": hashlib.blake2b(infos, digest_size=8).hexdigest(),
            "observations": {name: found.hexdigest() for name, found in self._hashes.items()},
        }


#: Entries of an info that the file pins; an entry that comes later changes nothing here.
INFO = ("is_success", "is_secure", "failure", "lift", "object", "resting", "touches", "protective_stop")


def _plain(info: dict[str, Any]) -> dict[str, Any]:
    return {name: value.hex() if isinstance(value, float) else value for name, value in info.items() if name in INFO}


OBJECTS = ("procedural:ball:0-1", "procedural:can:0-1", "procedural:box:0-1", "procedural:mug:0")
IMAGES = ("rgb", "depth", "rgbd_palm", "segmentation", "points", "voxels")
VECTORS = ("state", "proprio", "tactile")


def episode(env: Any, seed: int, actions: Any) -> dict[str, Any]:
    """Run one episode of a single environment with actions that are known beforehand."""
    observation, info = env.reset(seed=seed)
    recorder = Recorder(observation, info)
    for action in actions:
        observation, reward, done, _, info = env.step(action)
        recorder.step(observation, reward, info)
        if done:
            break
    return recorder.result()


def made(env_id: str, index: int, **settings: Any) -> Any:
    """Make the environment of an episode: the odd ones vary what can vary."""
    kwargs = {"randomization": "standard" if index % 2 else None, "reward": "dense", "objects": OBJECTS, **settings}
    return gymnasium.make(env_id, **kwargs, cameras=CAMERAS).unwrapped


def grasp_episodes() -> list[dict[str, Any]]:
    """Twenty episodes of Grasp-v0: the expert's, and shaken and pressed ones in each control mode."""
    rows = []
    for index in range(EPISODES):
        seed = 100 + index
        if index < 8:
            env_id, control = "graspbox/Grasp-v0", "twist"
            actions: Any = expert_actions(made(env_id, index, obs="state"), seed)
        else:
            env_id, control = "graspbox/Grasp-v0", ("twist", "delta_pose", "target_pose")[index % 3]
            size = made(env_id, index, control=control).action_space.shape[0]
            actions = np.zeros((STEPS, size), dtype=np.float32)
            pressed = pressing(STEPS, 1, seed=seed)[:, 0]
            actions[:, -4:] = pressed[:, -4:]
            actions[:, : size - 4] = np.resize(pressed[:, :6], (STEPS, size - 4))
        obs = (*VECTORS, *IMAGES) if index % 4 == 0 else VECTORS
        rows.append(episode(made(env_id, index, obs=obs, control=control), seed, actions))
    return rows


def decision_episodes() -> list[dict[str, Any]]:
    """Twenty episodes of GraspPose-v0: the planner's first pose, and random ones."""
    rows = []
    for index in range(EPISODES):
        seed = 200 + index
        env = made("graspbox/GraspPose-v0", index, obs=(*VECTORS, *IMAGES))
        observation, info = env.reset(seed=seed)
        action = best_grasp(env.objects, info["object"], observation["state"])
        if index % 4 == 3:
            action = np.random.default_rng(seed).uniform(-1, 1, len(action)).astype(np.float32)
        rows.append(episode(env, seed, [action]))
    return rows


def remake(kept: dict[str, Any] | None = None) -> dict[str, Any]:
    """Everything anew; labels from the poses of `kept`, where it is given."""
    plans, found = {}, {}
    for name in (*PROCEDURAL, *YCB):
        scene, plan = scene_and_plan(name)
        plans[name] = planned(plan, scene)
        found[name] = labels(scene, plans[name] if kept is None else kept["plans"][name])
    return {"plans": plans, "labels": found, "Grasp-v0": grasp_episodes(), "GraspPose-v0": decision_episodes()}


def write(value: dict[str, Any]) -> None:
    """Write the file, a row a line where rows are short."""
    FILE.write_text(json.dumps(value, indent=1) + "\n")


def differences(old: Any, new: Any, path: str = "") -> list[str]:
    """Name every leaf that differs."""
    if isinstance(old, dict) and isinstance(new, dict) and old.keys() == new.keys():
        return [d for key in old for d in differences(old[key], new[key], f"{path}/{key}")]
    if isinstance(old, list) and isinstance(new, list) and len(old) == len(new):
        return [d for i, (a, b) in enumerate(zip(old, new, strict=True)) for d in differences(a, b, f"{path}/{i}")]
    return [] if old == new else [f"{path}: {old} -> {new}"]


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--write", action="store_true", help="replace the file")
    chosen = parser.parse_args()
    before = json.loads(FILE.read_text()) if FILE.is_file() else None
    after = remake(None if chosen.write else before)
    changed = ["no file before"] if before is None else differences(before, after)
    print(*changed, f"{len(changed)} values differ", sep="\n")
    if chosen.write:
        write(after)
    raise SystemExit(bool(changed) and not chosen.write)
