"""Trials with factors on the object's friction and mass, and the planner's collision filter for any poses."""

from functools import cache
from typing import Any

import numpy as np
import pytest

import graspbox
from graspbox import errors, object_sets


@cache
def planned() -> tuple[graspbox.Scene, graspbox.Plan]:
    scene = graspbox.Scene(object_sets.load("procedural:can:1")[0].load())
    return scene, graspbox.plan(scene.mesh, world_from_object=scene.world_from_object)


def test_factors_of_one_change_no_bit() -> None:
    scene, plan = planned()
    best = plan.best(8)
    assert scene.simulate(best, friction=np.ones(8), mass=1.0) == scene.simulate(best)


def test_each_trial_has_its_own_factors() -> None:
    """A trial does not depend on its neighbours, and its outcome is that of an object with this mass or friction."""
    scene, plan = planned()
    best = plan.best(6)
    friction, mass = np.array([1.0, 0.05, 1.0, 1.3, 0.05, 0.7]), np.array([1.0, 1.0, 8.0, 0.5, 1.0, 1.2])
    together = scene.simulate(best, friction=friction, mass=mass)
    for i in range(6):
        alone = scene.simulate(best[i : i + 1], friction=friction[i], mass=mass[i], num_threads=1)
        assert alone == together[i : i + 1]
    plain = scene.simulate(best)
    assert plain.success.all()
    assert not together.success[friction < 0.1].any()


def test_friction_is_that_of_the_config() -> None:
    scene, plan = planned()
    physics = graspbox.PhysicsConfig(friction=graspbox.FrictionConfig(object=0.3))
    slippery = graspbox.Scene(scene.mesh, world_from_object=scene.world_from_object, physics=physics)
    best = plan.best(6)
    ours, theirs = scene.simulate(best, friction=0.3), slippery.simulate(best)
    assert (ours.success == theirs.success).all()


@pytest.mark.parametrize(
    ("factors", "words"),
    [
        ({"friction": 0.0}, "`friction factor` is 0,"),
        ({"mass": -1.0}, "`mass factor` is -1,"),
        ({"mass": 1000.0}, "`mass factor` is 1000,"),
        ({"friction": float("nan")}, "`friction factor` is NaN"),
        ({"friction": [1.0, 1.0]}, r"friction has shape \[2\]"),
        ({"mass": "heavy"}, "mass is 'heavy'"),
    ],
)
def test_bad_factors_are_named(factors: dict[str, Any], words: str) -> None:
    scene, plan = planned()
    with pytest.raises(errors.ConfigError, match=words):
        scene.simulate(plan.best(3), **factors)


def test_the_filter_is_the_planners() -> None:
    scene, plan = planned()
    assert (scene.check(plan.poses, plan.preshape) == plan.feasible).all()
    shuffled = np.random.default_rng(0).permutation(len(plan))
    assert (scene.check(plan.poses[shuffled], plan.preshape[shuffled], num_threads=1) == plan.feasible[shuffled]).all()
    bare = scene.check(plan.poses, plan.preshape, clearance=0.0)
    wide = scene.check(plan.poses, plan.preshape, clearance=0.01)
    assert wide.sum() < plan.feasible.sum() < bare.sum()
    refused = scene.simulate(plan.poses[~bare][:20], plan.preshape[~bare][:20])
    assert (refused.failure == "infeasible").all()
    with pytest.raises(errors.ConfigError, match="`clearance` is 1,"):
        scene.check(plan.poses, plan.preshape, clearance=1.0)
    with pytest.raises(errors.ConfigError, match="poses but 3 preshapes"):
        scene.check(plan.poses, plan.preshape[:3])
