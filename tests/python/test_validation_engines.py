"""Labels of the engines `newton` and `rapier` compared."""

import numpy as np
import pytest

pytest.importorskip("mujoco", reason="the poses come from the comparison with MuJoCo, from the extra 'dev'")

import graspbox
from graspbox.configs import PhysicsConfig
from graspbox.validation.agreement import kappa
from graspbox.validation.mujoco import sample_trials

OBJECTS = ("can", "box", "mug", "bottle", "ball", "hammer")


def test_both_engines_give_most_grasps_the_same_label() -> None:
    """60 poses, chosen at random among the planner's of six objects: at least 85 % equal, kappa at least 0.6."""
    labels: dict[str, list[bool]] = {"newton": [], "rapier": []}
    for number, family in enumerate(OBJECTS):
        rest = graspbox.Scene(graspbox.object_sets.load(f"procedural:{family}:1")[0].load())
        sampled = sample_trials(rest, 10, np.random.default_rng([0, number]), "planner-any")
        assert sampled is not None
        for engine, found in labels.items():
            physics = PhysicsConfig(engine=engine)  # type: ignore[arg-type]
            scene = graspbox.Scene(rest.mesh, world_from_object=rest.world_from_object, physics=physics)
            found += scene.simulate(*sampled).success.tolist()
    ours, rapier = (np.array(found) for found in labels.values())
    assert 0 < ours.sum() < len(ours)
    equal = float(np.mean(ours == rapier))
    assert equal >= 0.85
    assert kappa(ours, rapier) >= 0.6
