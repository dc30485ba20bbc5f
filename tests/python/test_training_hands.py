"""Training for another hand: its grasps are collected and validated in its own simulation."""

import numpy as np
import pytest

from graspbox import object_sets
from graspbox.models.scenes import SceneConfig, SceneSampler
from graspbox.models.trials import GraspTrials
from graspbox.perception import HandGrid, ProposalConfig
from graspbox.perception.finder_configs import FinderConfig
from graspbox.recipes.collection import CollectConfig, collect
from graspbox.simulation import Scene

HAND = "panda_gripper"
SCENES = SceneConfig(image_size=96)


@pytest.fixture(scope="module")
def trials(tmp_path_factory: pytest.TempPathFactory) -> GraspTrials:
    sampler = SceneSampler(object_sets.load("procedural:box:0-3"), SCENES, 0)
    config = CollectConfig(per_scene=16, finder=FinderConfig(ProposalConfig(most=64)))
    return collect(tmp_path_factory.mktemp("trials"), sampler, range(3), HandGrid(HAND), config)


def tried(trials: GraspTrials, scene: int, hand: str) -> np.ndarray:
    """Try the grasps of a scene again: which succeed."""
    rows = trials.scene_of == scene
    pose = trials.world_from_object[scene]
    simulated = Scene(object_sets.load(str(trials.source[scene]))[0].load(), hand=hand, world_from_object=pose)
    object_from_hand = np.linalg.inv(pose) @ trials.world_from_hand[rows]
    return simulated.simulate(object_from_hand, trials.preshape[rows]).success


def test_trials_are_collected_with_the_hand_of_the_grid(trials: GraspTrials) -> None:
    scenes = np.unique(trials.scene_of)
    assert 0.0 < trials.success.mean() < 1.0
    with_it, with_another = (np.concatenate([tried(trials, s, hand) for s in scenes]) for hand in (HAND, "reflex"))
    np.testing.assert_array_equal(trials.success, with_it)
    assert (with_it != with_another).any()


@pytest.mark.train
def test_heads_are_validated_with_the_hand_of_the_grid(trials: GraspTrials) -> None:
    """The outcome of a head that predicts a single pose is known."""
    pytest.importorskip("torch")
    from graspbox.models.head.heads import ConstantNet
    from graspbox.models.head.training import HeadData
    from graspbox.perception.anchors import AnchorConfig

    data = HeadData.of(trials, trials, HandGrid(HAND), AnchorConfig(cells=12, heights=14), SCENES)
    net = ConstantNet(height=0.11, preshape=0)
    expected: dict[str, list[bool]] = {HAND: [], "reflex": []}
    for scene in data.sampler.scenes.tolist():
        view, pose = data.sampler.view(scene, 0), trials.world_from_object[scene]
        assert view is not None
        given = np.linalg.inv(pose) @ view.world_from_crop @ net.candidates(view.volume).poses[:1]
        mesh = object_sets.load(str(trials.source[scene]))[0].load()
        for hand, found in expected.items():
            found.append(Scene(mesh, hand=hand, world_from_object=pose).simulate(given, np.zeros(1))[0].success)
    assert data.validation(net)["success"] == np.mean(expected[HAND])
    assert expected[HAND] != expected["reflex"]
