"""The observation `amodal`: masks of objects as if nothing hid them."""

from typing import Any

import gymnasium
import numpy as np

from acting import CAMERAS

HAND = "panda_gripper"
OBJECTS = ("procedural:box:0-3", "procedural:can:0-3")
OBS = ("segmentation", "amodal", "depth")


def among(env_id: str, **settings: Any) -> Any:
    chosen = {"layout": "pile", "objects_per_scene": (3, 5), "hand": HAND, "obs": OBS, "image_size": 96}
    return gymnasium.make(f"graspbox/{env_id}", objects=OBJECTS, **{**chosen, **settings})


def labels(env: Any) -> list[int]:
    """Labels of the objects, in their order."""
    links = int(env.observation_space["segmentation"].high.max()) - 3 - 4 + 1
    return [2, *(3 + links + index for index in range(4))]


def test_a_mask_covers_what_is_visible() -> None:
    """And what hides the rest of an object is nearer to the camera."""
    env = among("GraspPose-v0")
    assert env.observation_space["amodal"].shape == (96, 96, 5)
    hidden = 0
    for seed in range(4):
        seen, info = env.reset(seed=seed)
        visible, masks = seen["segmentation"][..., 0], seen["amodal"].astype(bool)
        assert masks.any(axis=(0, 1)).sum() >= info["neighbours"]
        for index, label in enumerate(labels(env)):
            assert masks[visible == label, index].all()
            covered = masks[..., index] & (visible != label)
            hidden += covered.sum()
            assert (visible[covered] != 0).all()
        assert not masks[..., info["neighbours"] + 1 :].any()
    assert hidden > 50
    env.close()


def test_taken_objects_have_no_mask() -> None:
    env = among("Clear-v0", layout="packed", max_failures=4)
    from graspbox.policies import Task, load

    policy = load("scene_planner")
    policy.bind(Task.of(env))
    seen, info = env.reset(seed=2)
    policy.reset(2, info={name: np.array([value]) for name, value in info.items()})
    begun = int(seen["amodal"].any(axis=(0, 1)).sum())
    assert begun == info["remaining"]
    for _ in range(8):
        rows = {name: value[None] for name, value in seen.items()}
        seen, _, over, _, info = env.step(policy.act(rows)[0])
        if over:
            break
        assert seen["amodal"].any(axis=(0, 1)).sum() == info["remaining"]
    assert info["cleared"] > 0
    env.close()


def test_a_single_object_has_one_mask() -> None:
    """The hand does not hide it."""
    env: Any = gymnasium.make(
        "graspbox/Grasp-v0", objects=OBJECTS, obs=("amodal_palm", "segmentation_palm"), cameras=CAMERAS
    )
    assert env.observation_space["amodal_palm"].shape == (36, 40, 1)
    seen, _ = env.reset(seed=0)
    assert (seen["amodal_palm"][seen["segmentation_palm"] == 2] == 1).all()
    env.close()
