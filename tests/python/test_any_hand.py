"""One scorer for many hands: its network, its samples, and its training."""

import json
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

torch = pytest.importorskip("torch")

from graspbox import object_sets  # noqa: E402
from graspbox.errors import ConfigError  # noqa: E402
from graspbox.evaluation import evaluate  # noqa: E402
from graspbox.hands import HandLike, load_hand  # noqa: E402
from graspbox.learn.export.exports import export_depth_policy  # noqa: E402
from graspbox.learn.models.scene_views import SceneViews  # noqa: E402
from graspbox.learn.models.scenes import SceneConfig, SceneSampler  # noqa: E402
from graspbox.learn.models.scorer.network import ScorerBatch, scorer_losses  # noqa: E402
from graspbox.learn.models.scorer.shared import SHARED_SHAPE, SharedScorerNet  # noqa: E402
from graspbox.learn.models.scorer.training import JoinedSampler, TrialSampler  # noqa: E402
from graspbox.learn.models.trials import GraspTrials  # noqa: E402
from graspbox.learn.random_hands import random_hand  # noqa: E402
from graspbox.learn.recipes.any_hand.collection import turns  # noqa: E402
from graspbox.learn.recipes.any_hand.context import TrainedHand  # noqa: E402
from graspbox.learn.recipes.cards.depth import write_any_hand_card  # noqa: E402
from graspbox.learn.recipes.collection import CollectConfig, collect  # noqa: E402
from graspbox.learn.recipes.networks import TrainedNetworks, grid_shape, scorer_width  # noqa: E402
from graspbox.learn.recipes.settings.any_hand import AnyHandSettings, AnyHandSizes  # noqa: E402
from graspbox.learn.recipes.settings.depth import Sizes  # noqa: E402
from graspbox.perception import CropConfig, HandGrid, HandGridConfig, ProposalConfig  # noqa: E402
from graspbox.perception.configs import MANY_FINGERS, FinderConfig, RehearsalConfig  # noqa: E402
from graspbox.perception.hand_settings import settings_of  # noqa: E402
from graspbox.perception.inputs.scorer import GraspInputs, ScorerInputs  # noqa: E402
from graspbox.policies.finders import load_finder  # noqa: E402
from graspbox.policies.grasp_image import grasp_image  # noqa: E402
from graspbox.policies.published.calibration import Calibration  # noqa: E402
from graspbox.policies.published.folders import read_depth_policy  # noqa: E402

pytestmark = pytest.mark.train

N = CropConfig().resolution
POLICIES = Path(__file__).parents[2] / "policies"
HANDS = Path(__file__).parents[2] / "env" / "hand" / "assets"


def grid_of(hand: HandLike) -> HandGrid:
    return HandGrid(hand, settings_of(hand, shape=SHARED_SHAPE).grid)


@pytest.fixture(scope="module")
def grids() -> list[HandGrid]:
    """Hands with one and with three preshapes, and cells of different sizes."""
    return [grid_of("panda_gripper"), grid_of("reflex"), grid_of(random_hand("fingers", 1))]


def inputs_of(grid: HandGrid, first: int = 0) -> GraspInputs:
    """Give inputs of 12 grasps in random voxels."""
    rng = np.random.default_rng(0)
    volumes = (rng.random((3, 3, N, N, N)) * 255).astype(np.uint8)
    poses = np.tile(np.eye(4), (12, 1, 1))
    poses[:, :3, :3] = np.diag([1.0, -1.0, -1.0])
    poses[:, :3, 3] = rng.uniform([-0.05, -0.05, 0.1], [0.05, 0.05, 0.2], (12, 3))
    return ScorerInputs(grid, first).make(volumes, np.arange(12) % 3, poses, rng.choice(grid.preshapes, 12))


def test_the_scorer_of_a_hand_is_the_shared_one(grids: list[HandGrid]) -> None:
    """For hands that it knows, whatever the first hand is, and for one that it does not."""
    torch.manual_seed(0)
    net = SharedScorerNet(grids, width=8).eval()
    assert net.first == [0, 1, 4]
    stranger = SharedScorerNet([grid_of("leap")], width=8).eval()
    # Weights do not depend on the hands.
    stranger.load_state_dict(net.state_dict())
    with torch.no_grad():
        for grid, first in zip(grids, net.first, strict=True):
            shared, own = inputs_of(grid, first), inputs_of(grid)
            np.testing.assert_array_equal(shared.preshape, own.preshape + first)
            expected = net(*map(torch.from_numpy, shared))
            torch.testing.assert_close(net.of_hand(grid)(*map(torch.from_numpy, own)), expected, atol=1e-5, rtol=1e-4)
            assert expected.std(0).min() > 1e-4
        grid = grid_of("leap")
        expected = stranger(*map(torch.from_numpy, inputs_of(grid)))
        found = net.of_hand(grid)(*map(torch.from_numpy, inputs_of(grid)))
    torch.testing.assert_close(found, expected, atol=1e-5, rtol=1e-4)


def test_it_learns_what_a_hand_can_do(grids: list[HandGrid]) -> None:
    """The same cells with two hands and opposite outcomes: only what describes the hand tells them apart."""
    torch.manual_seed(0)
    net = SharedScorerNet(grids[:2], width=16)
    made = inputs_of(grids[0])
    twice = GraspInputs(*(np.concatenate([array, array]) for array in made))
    twice = twice._replace(preshape=np.repeat([0, 1], 12))
    targets = np.repeat([[1.0], [0.0]], 12, axis=0) * np.ones((1, 3))
    batch = ScorerBatch.of(twice, targets.astype(np.float32))
    optimizer = torch.optim.Adam(net.parameters(), 3e-3)
    for _ in range(30):
        optimizer.zero_grad()
        torch.stack(list(scorer_losses(net, batch).values())).sum().backward()
        optimizer.step()
    with torch.no_grad():
        logits = net(batch.cells, batch.poses, batch.preshape)
    np.testing.assert_array_equal(logits[:, 0].numpy() > 0, targets[:, 0] > 0.5)


def test_hands_share_batches(grids: list[HandGrid], tmp_path: Path) -> None:
    scenes = SceneConfig(image_size=96)
    sampler = SceneSampler(object_sets.load("procedural:can:0-3"), scenes, 0)
    views = SceneViews(scenes)
    net = SharedScorerNet(grids, width=8)
    parts, trials = [], []
    for number, (grid, first) in enumerate(zip(grids, net.first, strict=True)):
        config = CollectConfig(per_scene=4)
        trials.append(collect(tmp_path / str(number), sampler, range(number, number + 2), grid, config))
        parts.append(TrialSampler(trials[-1], ScorerInputs(grid, first), views, 0))
    joined = JoinedSampler(parts)
    counts = [len(part.scenes) for part in parts]
    np.testing.assert_array_equal(joined.scenes, np.arange(sum(counts)))
    found = joined.sample(0, joined.scenes, 16)
    assert len(found.batch.targets) == sum(map(len, trials))
    np.testing.assert_array_equal(np.unique(found.scene_of), joined.scenes)
    # Every preshape is one of the hand whose scene it is in.
    owner = np.searchsorted(np.cumsum(counts), found.scene_of, side="right")
    hand = np.searchsorted(net.first, found.batch.preshape.numpy(), side="right") - 1
    np.testing.assert_array_equal(hand, owner)
    rates = [found.batch.targets[owner == number, 0].mean().item() for number in range(3)]
    np.testing.assert_allclose(rates, [each.success.mean() for each in trials], atol=1e-6)
    assert joined.sample(1, joined.scenes[:1], 16).batch.cells.shape[1:] == (4, *SHARED_SHAPE)


def test_a_batch_without_a_visible_object_is_refused(grids: list[HandGrid]) -> None:
    trials = GraspTrials.joined([GraspTrials.empty("procedural:can:0", np.eye(4))])
    with pytest.raises(ConfigError, match="there are no trials"):
        TrialSampler(trials, ScorerInputs(grids[0]), SceneViews(SceneConfig(image_size=96)), 0)


@pytest.fixture(scope="module")
def published(grids: list[HandGrid], tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Export a policy for any hand, untrained."""
    torch.manual_seed(0)
    folder = tmp_path_factory.mktemp("policies") / "any"
    export_depth_policy(
        folder,
        "any",
        POLICIES / "depth",
        [SharedScorerNet(grids, width=8)],
        Calibration(success=(1.0, 0.5), secure=(2.0, 0.0), secure_weight=0.3),
        learned_from=["procedural:can:0-9/train"],
        grid=HandGridConfig(shape=SHARED_SHAPE),
        finder=FinderConfig(ProposalConfig(most=24), refinements=0, predicted=0),
    )
    return folder


@pytest.mark.parametrize("hand", ["panda_gripper", "reflex", "robotiq_2f_85"])
def test_a_published_scorer_takes_any_hand(hand: str, published: Path) -> None:
    """By onnxruntime and by torch, with one preshape and with several; lengths are those of the hand."""
    config = read_depth_policy(published)
    onnx, other = (load_finder(published, config, load_hand(hand), backend=backend) for backend in ("onnx", "torch"))
    assert onnx.grid.shape == SHARED_SHAPE
    assert onnx.config.proposals.radius == settings_of(hand, config.finder.proposals).proposals.radius
    volume = np.zeros((3, N, N, N), dtype=np.uint8)
    volume[0, 20:26, 20:26, 2:12] = 255
    found = onnx.grid.propose(volume[0])
    assert len(found) > 2
    judged = [finder.score.judge(volume, found.poses, found.preshape) for finder in (onnx, other)]  # type: ignore[attr-defined]
    np.testing.assert_allclose(judged[0].success, judged[1].success, atol=1e-4)
    np.testing.assert_allclose(judged[0].choice, (judged[0].success + 0.3 * judged[0].secure) / 1.3, atol=1e-5)


def test_it_acts_with_a_hand_from_files(published: Path, tmp_path: Path) -> None:
    files = tmp_path / "own.urdf", tmp_path / "own.toml"
    for path, text in zip(files, random_hand("fingers", 3).files, strict=True):
        path.write_text(text)
    found = evaluate(str(published), objects="procedural:bottle:2000-2003", trials=2, hand=files)
    assert len(found.trials) == 2


def test_hands_of_many_fingers_rehearse(published: Path) -> None:
    """Jaws do so where a user asks for it."""
    config = read_depth_policy(published)
    finder = replace(config.finder, rehearsal=RehearsalConfig(grasps=16, fingers=3))
    config = replace(config, finder=finder)
    kept = {name: config.settings_for(load_hand(name))[1].rehearsal for name in ("panda_gripper", "reflex", "leap")}
    assert kept == {"panda_gripper": None, "reflex": finder.rehearsal, "leap": finder.rehearsal}
    asked = config.settings_for(load_hand("panda_gripper"), finder.rehearsing(5))[1].rehearsal
    assert asked == RehearsalConfig(grasps=5)


def test_wrong_configurations_for_any_hand_are_refused(published: Path) -> None:
    config = read_depth_policy(published)
    with pytest.raises(ConfigError, match=r"hand_numbers is .*; this version of graspbox computes"):
        replace(config, hand_numbers=("width",))
    for wrong in ({"members": 2}, {"grid": HandGridConfig()}):
        with pytest.raises(ConfigError, match="one scorer, no head, and a grid of a set shape"):
            replace(config, **wrong)
    path = published / "config.json"
    text = path.read_text()
    path.write_text(text.replace('"cell, cm"', '"cell"'))
    try:
        with pytest.raises(ConfigError, match="hand_numbers"):
            read_depth_policy(published)
    finally:
        path.write_text(text)


def test_the_scorer_of_the_last_round_is_adopted(grids: list[HandGrid], tmp_path: Path) -> None:
    """With its features for the hand; a folder without one, and one of another hand, are refused."""
    run, out = tmp_path / "shared", tmp_path / "run"
    networks = TrainedNetworks(out, Sizes(width=8), grids[1], SceneConfig())
    with pytest.raises(ConfigError, match="there is no trained scorer in"):
        networks.adopt_scorer(run)
    nets = {}
    for number, name in enumerate(("scorer", "round-2", "round-10")):
        torch.manual_seed(number)
        nets[name] = SharedScorerNet(grids, width=8)
        (run / name).mkdir(parents=True)
        torch.save(nets[name].state_dict(), run / name / "weights.pt")
    (out / "scorer").mkdir(parents=True)
    found = torch.load(networks.adopt_scorer(run), weights_only=True)
    expected = nets["round-10"].of_hand(grids[1]).state_dict()
    assert all(torch.equal(found[name], value) for name, value in expected.items())
    assert scorer_width(run) == 8
    assert scorer_width(POLICIES / "any_hand") == 64
    assert grid_shape(run) == SHARED_SHAPE
    torch.save(expected, run / "round-10" / "weights.pt")
    own = torch.load(networks.adopt_scorer(run), weights_only=True)
    assert own.keys() == expected.keys()
    assert all(torch.equal(own[name], value) for name, value in expected.items())
    assert grid_shape(run) is None
    with pytest.raises(ConfigError, match="holds the weights of another network"):
        TrainedNetworks(out, Sizes(width=8), grids[0], SceneConfig()).adopt_scorer(run)
    (run / "round-10" / "weights.pt").write_bytes(b"nothing")
    with pytest.raises(ConfigError, match="is not a file of weights"):
        networks.adopt_scorer(run)
    torch.save({"other": torch.zeros(1)}, run / "round-10" / "weights.pt")
    with pytest.raises(ConfigError, match=r"round-10/weights\.pt holds the weights of another network"):
        networks.adopt_scorer(run)


def test_a_scorer_that_began_with_that_of_many_hands_keeps_its_grid(grids: list[HandGrid], tmp_path: Path) -> None:
    """A further training begins with it: of a published policy, and of a run, which names its own start."""
    assert grid_shape(POLICIES / "leap") == SHARED_SHAPE
    assert grid_shape(POLICIES / "panda") is None
    shared, run = tmp_path / "shared", tmp_path / "run"
    net = SharedScorerNet(grids, width=8)
    for folder, weights in ((shared, net.state_dict()), (run, net.of_hand(grids[1]).state_dict())):
        (folder / "scorer").mkdir(parents=True)
        torch.save(weights, folder / "scorer" / "weights.pt")
    (run / "settings.json").write_text(json.dumps({"start": str(shared)}))
    assert grid_shape(run) == SHARED_SHAPE
    (run / "settings.json").write_text(json.dumps({"start": str(tmp_path / "gone")}))
    assert grid_shape(run) is None


def test_it_is_trained_and_grasps_with_a_hand_that_it_never_saw(tmp_path: Path) -> None:
    """The quick training, killed once, and its policies."""
    out = tmp_path / "run"
    command = [sys.executable, "-m", "graspbox", "train", "any-hand", "--quick", "--out", str(out)]
    command += ["--completion", str(POLICIES / "depth")]
    first = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    deadline = time.monotonic() + 120
    while not (out / "trials.json").exists() and time.monotonic() < deadline:
        time.sleep(0.05)
    first.send_signal(signal.SIGKILL)
    first.wait()
    kept = json.loads((out / "trials.json").read_text())
    assert kept["train"]["hands"] == 3
    done = subprocess.run([*command, "--json"], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    results = json.loads(done.stdout)
    assert results["trials"] == kept
    assert [results[f"evaluate-{name}"]["trained"] for name in ("robotiq_2f_85", "panda_gripper")] == [False, True]
    assert results["collect-1"]["train"]["trials"] > 0
    folder = out / "policy"
    config = read_depth_policy(folder)
    assert (config.name, config.grid.shape, config.head) == ("any_hand", SHARED_SHAPE, None)
    assert config.finder.rehearsal == RehearsalConfig(grasps=32, fingers=MANY_FINGERS)
    objects = "procedural:bottle:2000-2003"
    again = evaluate(str(folder), objects=objects, trials=4, hand="robotiq_2f_85")
    assert again.succeeded == results["evaluate-robotiq_2f_85"][objects]["succeeded"]
    card = (folder / "README.md").read_text()
    assert "hand `robotiq_2f_85`, of which nothing was learned" in card
    assert "| objects | trials | success | secure | ECE |" in card
    assert "with 3 hands: `panda_gripper`, 1 random parallel jaws and 1 random hands with fingers" in " ".join(
        card.split()
    )


def test_a_time_limit_leaves_trials_of_all_hands_and_of_both_splits(grids: list[HandGrid]) -> None:
    """After half of the turns each part has about half of its scenes; all turns are all scenes, in order."""
    finder = FinderConfig()
    hands = [
        TrainedHand("many", grids[0], finder, range(600), named=True),
        TrainedHand("as many", grids[1], finder, range(600), named=True),
        TrainedHand("fingers-0", grids[2], finder, range(100, 140), named=False),
    ]
    order = list(turns(hands, AnyHandSizes(held_out_scenes=60), share=0.5))
    counts = {"many": (300, 60), "as many": (300, 60), "fingers-0": (20, 2)}
    for part in (len(order), len(order) // 2):
        for hand in hands:
            for split, count in zip(("train", "validation"), counts[hand.name], strict=True):
                scenes = [n for of, name, numbers in order[:part] if (of, name) == (hand, split) for n in numbers]
                assert scenes == list(hand.scenes if split == "train" else range(count))[: len(scenes)]
                assert abs(len(scenes) - count * part / len(order)) <= (0 if part == len(order) else 20)


def test_a_training_without_hands_is_refused(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "graspbox", "train", "any-hand", "--out", str(tmp_path / "run"), "--jaws", "0"]
    command += ["--fingers", "0", "--hands", "leap", "--without", "leap", "--completion", str(POLICIES / "depth")]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert "leave no hand to learn from" in done.stderr


def test_a_hand_that_does_not_exist_is_refused_before_the_work(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "graspbox", "train", "any-hand", "--out", str(tmp_path / "run"), "--jaws", "1"]
    command += ["--fingers", "0", "--hands", "", "--without", "panda", "--completion", str(POLICIES / "depth")]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert "there is no hand 'panda'" in done.stderr
    assert not list((tmp_path / "run").glob("trials*"))


def test_a_stage_without_time_for_a_trial_says_which_time_to_raise(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "graspbox", "train", "any-hand", "--quick", "--out", str(tmp_path / "run")]
    command += ["--completion", str(POLICIES / "depth"), "--hours.trials", "1e-9"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert "raise --hours.trials, and the same command goes on" in done.stderr


@pytest.mark.parametrize(
    ("name", "wrong"), [("leap", "as another has"), ("../leap", "cannot name a folder"), ("jaws-0", "beside those")]
)
def test_a_hand_of_two_files_has_a_name_of_its_own(tmp_path: Path, name: str, wrong: str) -> None:
    """It is trained, or only evaluated, as one that has a name; folders of the run have the name in its file."""
    urdf, toml = HANDS / "reflex" / "reflex.urdf", tmp_path / "hand.toml"

    def settings(called: str) -> AnyHandSettings:
        toml.write_text((HANDS / "reflex" / "hand.toml").read_text().replace('name = "reflex"', f'name = "{called}"'))
        return AnyHandSettings(out=tmp_path / "run", hands=("leap", f"{urdf},{toml}"), without=("inspire",))

    found = settings("claw_2").evaluated_hands()
    assert [(called, hand.trained) for called, hand in found.items()] == [
        ("inspire", False),
        ("leap", True),
        ("claw_2", True),
    ]
    assert load_hand(found["claw_2"].hand).name == "claw_2"
    held_back = replace(settings("claw_2"), without=(f"{urdf},{toml}",)).evaluated_hands()
    assert [hand.trained for hand in held_back.values()] == [False, True]
    with pytest.raises(ConfigError, match=wrong):
        settings(name).evaluated_hands()


def test_a_card_without_named_hands_and_without_objects_that_fit(published: Path, tmp_path: Path) -> None:
    found: dict[str, Any] = {
        "calibration_error": 0.1234,
        "trials": 2,
        "succeeded": 0,
        "secure": 0,
        "fitting": {"trials": 0, "succeeded": 0, "secure": 0},
    }
    stages: dict[str, dict[str, Any]] = {
        "trials": {"seconds": 1.0, "train": {"trials": 9, "hands": 1}},
        "calibrate": {"seconds": 1.0, "secure_weight": 0.3},
        "evaluate-leap": {"seconds": 1.0, "trained": False, "procedural:bottle:2000-2003": found},
    }
    settings = AnyHandSettings(out=published, hands=(), evaluated=("procedural:bottle:2000-2003",), jaws=1, fingers=0)
    config, scenes = read_depth_policy(published), SceneConfig()
    given: dict[str, Any] = {"command": "train", "settings": settings, "scenes": scenes, "stages": stages}
    write_any_hand_card(tmp_path, config, **given)
    card = (tmp_path / "README.md").read_text()
    assert "with 1 hands: 1 random parallel jaws" in " ".join(card.split())
    assert "| objects | trials | success | secure | ECE |\n" in card
    found["fitting"] = {"trials": 2, "succeeded": 1, "secure": 0}
    write_any_hand_card(tmp_path, config, **given)
    card = (tmp_path / "README.md").read_text()
    assert "| ECE | objects that fit: success |" in card
    assert "| 0.123 | 50.0%" in card


def test_grasps_in_an_image_are_those_of_the_hand(published: Path, tmp_path: Path) -> None:
    """From Python and from the command line; a policy of one hand refuses others."""
    lens = np.array([[200.0, 0.0, 63.5], [0.0, 200.0, 63.5], [0.0, 0.0, 1.0]])
    pose = np.diag([1.0, -1.0, -1.0, 1.0])
    pose[2, 3] = 0.6
    depth = np.full((128, 128), 0.6)
    depth[54:74, 54:74] = 0.54
    heights = {}
    for hand in ("reflex", "panda_gripper"):
        found = grasp_image(depth, lens, pose, published, hand=hand, count=3)
        assert found.hand.name == found.to_json()["hand"] == hand
        assert set(found.preshape) <= set(load_hand(hand).preshapes.values())
        heights[hand] = found.table_from_hand[:, 2, 3].tolist()
    assert heights["panda_gripper"] != heights["reflex"]
    np.save(tmp_path / "depth.npy", depth)
    command = ["grasp-image", str(tmp_path / "depth.npy"), "--intrinsics", "200", "200", "63.5", "63.5", "--json"]
    command += ["--camera-height", "0.6", "--tilt", "90", "--hand", "panda_gripper", "--policy"]
    done = [
        subprocess.run([sys.executable, "-m", "graspbox", *command, str(policy)], capture_output=True, text=True)
        for policy in (published, POLICIES / "depth")
    ]
    assert json.loads(done[0].stdout)["hand"] == "panda_gripper"
    assert done[1].returncode == 2
    assert "was trained for the hand 'reflex', not 'panda_gripper'" in done[1].stderr
