"""The baseline that chooses among proposals by geometry."""

from typing import Any

import numpy as np

import graspbox
from graspbox import policies
from graspbox.evaluation import evaluate
from graspbox.evaluation.rounds import clear_rounds
from graspbox.perception.configs import CropConfig
from graspbox.perception.hand_grids import HandGrid
from graspbox.policies.baselines.partial_view import _filled

HAND = "panda_gripper"


def test_it_clears_what_stands_apart() -> None:
    """A crop of one object would miss that there are three; all are lifted, one by one."""
    settings: dict[str, Any] = {"objects": "procedural:can:0-9", "layout": "packed", "hand": HAND}
    found = clear_rounds("best_proposal", objects_per_scene=3, object_scale=(0.5, 0.6), rounds=2, **settings)
    assert found.success_rate > 0.6
    assert found.cleared.sum() >= 4
    again = clear_rounds("best_proposal", objects_per_scene=3, object_scale=(0.5, 0.6), rounds=2, **settings)
    assert again.to_json() == found.to_json()


def test_it_acts_with_single_objects_too() -> None:
    found = evaluate("best_proposal", objects="procedural:can:0-9", trials=6, seed=0, hand=HAND, scale=0.6)
    assert found.policy == "best_proposal"
    assert found.rate > 0.6


def test_a_grasp_around_more_scores_higher() -> None:
    """A block between the fingers counts for a grasp, one that no image shows at the open fingers against it."""
    crop = CropConfig(gap=0.5)
    grid = HandGrid(graspbox.load_hand(HAND), crop=crop)
    n = crop.resolution
    places = (np.indices((n, n, n)).transpose(1, 2, 3, 0) + 0.5) * crop.voxel_size + np.array(crop.origin)
    block = np.where((np.abs(places - (0.0, 0.0, 0.06)) < (0.02, 0.02, 0.06)).all(axis=3), 255, 0).astype(np.uint8)
    none = np.zeros_like(block)
    down = np.diag([1.0, -1.0, -1.0, 1.0])
    deep, shallow, beside = (down.copy() for _ in range(3))
    deep[:3, 3], shallow[:3, 3], beside[:3, 3] = (0.0, 0.0, 0.13), (0.0, 0.0, 0.16), (0.12, 0.0, 0.13)
    poses, preshapes = np.stack([deep, shallow, beside]), np.zeros(3)
    seen = _filled(grid, np.stack([block, block, none]), poses, preshapes)
    assert seen[0] > seen[1] > seen[2]
    side = np.where(np.abs(places[..., 0] - 0.045) < 0.02, 255, 0).astype(np.uint8)
    hidden = _filled(grid, np.stack([block, block, side]), poses, preshapes)
    assert hidden[0] < seen[0] - 0.02, "an unseen wall where a finger goes"
    turned = deep.copy()
    turned[:3, :3] = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    nothing = np.stack([none, none, none])
    above, level = _filled(grid, nothing, np.stack([deep, turned]), np.zeros(2))
    assert above > level


def test_its_name_is_that_of_a_baseline() -> None:
    assert isinstance(policies.load("best_proposal"), policies.BestProposal)
    assert "best_proposal" in policies.names()
