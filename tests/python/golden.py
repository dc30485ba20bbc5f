"""Golden values: 200 labels and 20 episodes of each environment, remade and compared bit by bit.

``python tests/python/golden.py`` compares, ``--write`` remakes ``tests/fixtures/golden.json``. A change that keeps
physics, observations and rewards leaves the file unchanged. A deliberate change of them remakes it in a commit of its
own, which states how many values changed and why.

Labels are simulated from the poses in the file and episodes act by the actions in it, so that neither a changed planner
nor a changed expert hides a changed simulation; the planner's own poses are compared beside them. Floating-point
numbers are kept as hexadecimal text, actions as base64 of float32, images and long vectors as hashes.
"""

import argparse
import base64
import hashlib
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
from numpy.typing import NDArray

import graspbox
from acting import CAMERAS, EACH, best_grasp, expert_actions, pressing
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
    """Return the stored poses: full precision, with their settings."""
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
        """Add the results of a step."""
        self._show(observation)
        self._rewards.append(reward)
        self._terms.append({name: float(value) for name, value in info["reward_terms"].items() if name in TERMS})
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


#: Entries of an info, and reward terms, that the file pins; those that come later change nothing here.
TERMS = ("reach", "contact", "closure", "lift", "hold", "success", "failure", "effort", "push", "table", "stop")
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


#: Weights of costs, which the dense reward of Grasp-v0 had when the file was made.
COSTS = {"failure": 1.0, "effort": 0.01, "push": 0.2, "table": 0.02, "stop": 0.02}


def made(env_id: str, index: int, **settings: Any) -> Any:
    """Make the environment of an episode: odd ones randomise all factors."""
    kwargs = {"randomization": "standard" if index % 2 else None, "reward": "dense", "objects": OBJECTS, **settings}
    kwargs |= {"reward_weights": COSTS} if env_id == "graspbox/Grasp-v0" else {}
    return gymnasium.make(env_id, **kwargs, cameras=CAMERAS).unwrapped


def grasp_settings(index: int) -> dict[str, Any]:
    """Choose the settings of an episode of Grasp-v0: every fourth one shows images."""
    control = "twist" if index < 8 else ("twist", "delta_pose", "target_pose")[index % 3]
    return {"obs": (*VECTORS, *IMAGES) if index % 4 == 0 else VECTORS, "control": control, **EACH}


def grasp_actions(index: int, seed: int) -> NDArray[np.float32]:
    """Choose the actions of an episode: the expert's for the first eight, shaken and pressed ones for the others."""
    if index < 8:
        return np.stack(expert_actions(made("graspbox/Grasp-v0", index, obs="state", **EACH), seed))
    size = made("graspbox/Grasp-v0", index, **grasp_settings(index)).action_space.shape[0]
    actions = np.zeros((STEPS, size), dtype=np.float32)
    pressed = pressing(STEPS, 1, seed=seed)[:, 0]
    actions[:, -4:] = pressed[:, -4:]
    actions[:, : size - 4] = np.resize(pressed[:, :6], (STEPS, size - 4))
    return actions


def decision_settings(index: int) -> dict[str, Any]:
    """Choose the settings of an episode of GraspPose-v0."""
    return {"obs": (*VECTORS, *IMAGES)}


def decision_actions(index: int, seed: int) -> NDArray[np.float32]:
    """Choose the action of an episode: the planner's first pose, or in every fourth one a random one."""
    env = made("graspbox/GraspPose-v0", index, **decision_settings(index))
    observation, info = env.reset(seed=seed)
    action = best_grasp(env.objects, info["object"], observation["state"])
    if index % 4 == 3:
        action = np.random.default_rng(seed).uniform(-1, 1, len(action)).astype(np.float32)
    return action[None]


#: By environment: the first seed, the settings of an episode, and its actions.
KINDS: dict[str, tuple[int, Callable[..., dict[str, Any]], Callable[..., NDArray[np.float32]]]] = {
    "Grasp-v0": (100, grasp_settings, grasp_actions),
    "GraspPose-v0": (200, decision_settings, decision_actions),
}


def packed(actions: NDArray[np.float32]) -> dict[str, Any]:
    """Write actions (steps, n) as text."""
    return {"size": actions.shape[1], "data": base64.b64encode(actions.astype("<f4").tobytes()).decode()}


def unpacked(kept: dict[str, Any]) -> NDArray[np.float32]:
    """Read actions (steps, n) from text."""
    return np.frombuffer(base64.b64decode(kept["data"]), dtype="<f4").reshape(-1, kept["size"])


def episodes(kind: str, kept: list[Any] | None) -> tuple[list[Any], list[Any]]:
    """Run twenty episodes of an environment; their results, and the actions, which are those of `kept` where given."""
    first, settings, choose = KINDS[kind]
    rows, actions = [], []
    for index in range(EPISODES):
        chosen = choose(index, first + index) if kept is None else unpacked(kept[index])
        env = made(f"graspbox/{kind}", index, **settings(index))
        rows.append(episode(env, first + index, chosen))
        actions.append(packed(chosen))
    return rows, actions


def remake(kept: dict[str, Any] | None = None) -> dict[str, Any]:
    """Everything anew; labels from the poses and episodes from the actions of `kept`, where it is given."""
    plans, found, shown, acted = {}, {}, {}, {}
    for name in (*PROCEDURAL, *YCB):
        scene, plan = scene_and_plan(name)
        plans[name] = planned(plan, scene)
        found[name] = labels(scene, plans[name] if kept is None else kept["plans"][name])
    for kind in KINDS:
        shown[kind], acted[kind] = episodes(kind, None if kept is None else kept["actions"][kind])
    return {"plans": plans, "labels": found, **shown, "actions": acted}


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
