"""Senseless inputs are refused, with a message that names them and the remedy."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import graspbox
from graspbox import errors
from graspbox._common.runs import Run
from test_core import cuboid, from_above


@pytest.fixture(scope="module")
def scene() -> graspbox.Scene:
    return graspbox.Scene(cuboid(0.06, 0.06, 0.1))


@pytest.mark.parametrize("preshape", [-1.0, 2.0, 3.0, 10.0, 30.0, 180.0])
def test_preshapes_beyond_the_hand_are_refused(scene: graspbox.Scene, preshape: float) -> None:
    poses = np.stack([from_above(0.12)] * 3)
    with pytest.raises(errors.ConfigError, match=r"preshape\[1\] is .* but the hand's range is 0 to 1.57"):
        scene.simulate(poses, [0.0, preshape, 0.0])
    with pytest.raises(errors.ConfigError, match=r"preshape\[0\]"):
        scene.trace(poses[0], preshape)


def test_degrees_are_recognized(scene: graspbox.Scene) -> None:
    with pytest.raises(errors.ConfigError, match=r"30 looks like degrees: give 0\.5236 rad"):
        scene.simulate(from_above(0.12)[None], 30.0)


def test_poses_in_millimetres_are_refused(scene: graspbox.Scene) -> None:
    with pytest.raises(errors.ConfigError, match=r"poses\[0\] is 120 m from the object"):
        scene.simulate(from_above(120.0)[None], 0.0)


@pytest.mark.parametrize(("scale", "factor"), [(1000.0, "0.001"), (100.0, "0.01"), (0.001, "1000")])
def test_a_file_in_another_unit_is_refused_with_its_likely_scale(scale: float, factor: str) -> None:
    mesh = cuboid(0.08 * scale, 0.08 * scale, 0.1 * scale)
    with pytest.raises(errors.MeshError, match=rf"multiply `scale=` by {factor} "):
        graspbox.Scene(mesh)
    with pytest.raises(errors.MeshError, match=r"open hand|cannot be simulated"):
        graspbox.plan(mesh)


def test_a_mass_in_grams_is_refused() -> None:
    with pytest.raises(errors.MeshError, match=r"weighs 118 kg"):
        graspbox.Scene(cuboid(0.08, 0.08, 0.1, mass=118.0))


@pytest.mark.parametrize(
    "poses",
    [
        graspbox.PoseConfig(variations=10**6),
        graspbox.PoseConfig(variations=10**9),
        graspbox.PoseConfig(standoffs=(0.01,) * 10**5),
        graspbox.PoseConfig(variations=10_000, standoffs=(0.01,) * 1000),
    ],
)
def test_counts_of_candidates_are_bounded(poses: graspbox.PoseConfig) -> None:
    with pytest.raises(errors.ConfigError, match=r"variations|standoffs"):
        graspbox.plan(cuboid(0.06, 0.06, 0.1), config=graspbox.PlanConfig(poses=poses))


def test_the_criterion_of_success_is_a_setting(scene: graspbox.Scene) -> None:
    pose = from_above(0.12)[None]
    strict = graspbox.TrialConfig(success=graspbox.SuccessCriterion(rest_speed=1e-4, hold_time=1.0))
    assert scene.simulate(pose, 0.0).success[0]
    outcome = scene.simulate(pose, 0.0, config=strict)
    assert not outcome.success[0]
    assert outcome.failure[0] == "unstable"
    low = graspbox.TrialConfig(lift_height=0.15, success=graspbox.SuccessCriterion(lift_height=0.19))
    with pytest.raises(errors.ConfigError, match=r"`lift_height` is 0\.15, but it must be between 0\.19 and 1 m"):
        scene.simulate(pose, 0.0, config=low)
    nothing = graspbox.TrialConfig(success=graspbox.SuccessCriterion(rest_speed=0.0))
    with pytest.raises(errors.ConfigError, match=r"`success\.rest_speed` is 0"):
        scene.simulate(pose, 0.0, config=nothing)


def test_objects_that_are_not_at_rest_are_announced(caplog: pytest.LogCaptureFixture) -> None:
    mesh = cuboid(0.06, 0.06, 0.1)
    tipped = np.eye(4)
    tipped[:3, :3] = [[1, 0, 0], [0, 0.5, -(0.75**0.5)], [0, 0.75**0.5, 0.5]]
    tipped[2, 3] = -(mesh.vertices @ tipped[:3, :3].T)[:, 2].min()
    graspbox.plan(mesh)
    assert not caplog.records
    graspbox.plan(mesh, world_from_object=tipped)
    graspbox.Scene(mesh, world_from_object=tipped)
    told = [record.getMessage() for record in caplog.records]
    assert len(told) == 2
    assert "does not rest at this world_from_object" in told[0]
    assert "before it came to rest" in told[1]


def test_a_recipe_does_not_tell_which_objects_toppled(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    """It samples poses from which many do; other warnings pass, and afterwards all do."""
    stages = pytest.importorskip("graspbox.learn.recipes.stages")
    mesh = cuboid(0.06, 0.06, 0.1)
    tipped = np.eye(4)
    tipped[:3, :3] = [[1, 0, 0], [0, 0.5, -(0.75**0.5)], [0, 0.75**0.5, 0.5]]
    tipped[2, 3] = -(mesh.vertices @ tipped[:3, :3].T)[:, 2].min()

    def work(context: None, stage: Run) -> dict[str, Any]:
        del context, stage
        graspbox.plan(mesh, world_from_object=tipped)
        graspbox.Scene(mesh, world_from_object=tipped)
        return {}

    with Run(tmp_path / "run") as run:
        stages.run_stages(run, None, [stages.Stage("one", 1.0, work)])
    told = [record.getMessage() for record in caplog.records if record.name == "graspbox"]
    assert ["does not rest" in text for text in told] == [True]
    graspbox.Scene(mesh, world_from_object=tipped)
    assert "before it came to rest" in caplog.records[-1].getMessage()
