"""Training for another hand: its grasps are collected and validated in its own simulation."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from graspbox import object_sets
from graspbox.evaluation import evaluate
from graspbox.hands import load_hand
from graspbox.learn.models.scenes import SceneConfig, SceneSampler
from graspbox.learn.models.trials import GraspTrials
from graspbox.learn.random_hands import random_hand
from graspbox.learn.recipes.collection import CollectConfig, collect
from graspbox.perception import HandGrid, ProposalConfig
from graspbox.perception.configs import FinderConfig
from graspbox.perception.hand_settings import settings_of
from graspbox.policies.published.folders import read_depth_policy
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


def test_objects_that_are_too_large_for_the_hand_have_no_trials(tmp_path: Path) -> None:
    """Balls that its jaws cannot span, beside one that they can: the collection goes on."""
    sampler = SceneSampler(object_sets.load("procedural:ball:320-331"), SCENES, 0)
    grid = HandGrid(random_hand("jaws", 2))
    found = collect(tmp_path, sampler, range(24), grid, CollectConfig(per_scene=4, finder=FinderConfig()))
    tried = set(found.source[np.unique(found.scene_of)].tolist())
    assert tried
    assert "procedural:ball:327" in set(found.source.tolist()) - tried


@pytest.mark.train
def test_heads_are_validated_with_the_hand_of_the_grid(trials: GraspTrials) -> None:
    """The outcome of a head that predicts a single pose is known."""
    pytest.importorskip("torch")
    from graspbox.learn.models.head.network import AnchorNet
    from graspbox.learn.models.head.training import HeadData
    from graspbox.perception.anchors import AnchorConfig, Candidates
    from graspbox.policies.published.head_configs import HeadConfig

    class StraightDown(AnchorNet):
        """A head whose only grasp is straight down over the crop's origin."""

        def candidates(self, volume: NDArray[np.uint8], count: int = 1) -> Candidates:
            """Return the grasp."""
            pose = np.diag([1.0, -1.0, -1.0, 1.0])[None]
            pose[0, 2, 3] = 0.11
            return Candidates(pose, np.zeros(1, dtype=np.int64), np.ones(1))

    data = HeadData.of(trials, trials, HandGrid(HAND), AnchorConfig(cells=12, heights=14), SCENES)
    config = HeadConfig(width=8, features=8, hidden=16, anchors=AnchorConfig(cells=12, heights=14))
    net = StraightDown(len(HandGrid(HAND).preshapes), config, SCENES.crop).eval()
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


@pytest.mark.train
def test_a_policy_is_trained_for_a_hand_of_the_user_s(tmp_path: Path) -> None:
    """Its folder holds the hand, and takes the completion of another policy; it acts without more words.

    Its scorer begins as one of many hands.
    """
    torch = pytest.importorskip("torch")
    from graspbox.learn.models.scorer.shared import SHARED_SHAPE, SharedScorerNet

    urdf, toml = load_hand(HAND).files
    (tmp_path / "own.urdf").write_text(urdf)
    (tmp_path / "own.toml").write_text(toml.replace(f'name = "{HAND}"', 'name = "own"'))
    out, completion = tmp_path / "run", Path(__file__).parents[2] / "policies/depth"
    command = ["train", "depth", "--quick", "--out", str(out), "--completion", str(completion)]
    settings = settings_of(HAND, shape=SHARED_SHAPE)
    shared = SharedScorerNet([HandGrid("leap", settings_of("leap", shape=SHARED_SHAPE).grid)], width=8)
    (tmp_path / "shared" / "scorer").mkdir(parents=True)
    torch.save(shared.state_dict(), tmp_path / "shared" / "scorer" / "weights.pt")
    command += ["--start", str(tmp_path / "shared")]
    command += ["--hand", f"{tmp_path / 'own.urdf'},{tmp_path / 'own.toml'}", "--name", "own"]
    done = subprocess.run([sys.executable, "-m", "graspbox", *command], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    config = read_depth_policy(out / "policy")
    assert (config.hand, config.grid) == ("own", settings.grid)
    began = torch.load(out / "scorer" / "start.pt", weights_only=True)
    torch.testing.assert_close(began["head.0.weight"], shared.state_dict()["head.0.weight"])
    assert config.head is not None
    assert config.head.anchors == settings_of(HAND).anchors
    assert {"hand.urdf", "hand.toml"} <= set(config.files)
    assert "completion.onnx" not in config.files
    assert "procedural:box:0-199/train" in config.learned_from
    card = (out / "policy" / "README.md").read_text()
    assert "that of the policy `depth`" in card
    assert "An object fits if its least width in plan view, as it rests, is at most 78 mm." in card
    found = evaluate(str(out / "policy"), objects="procedural:box:900-903", trials=2)
    assert found.settings is not None
    assert found.settings["hand"] == [str(out / "policy" / name) for name in ("hand.urdf", "hand.toml")]
