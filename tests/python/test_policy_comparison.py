"""Comparison of policies: baselines with images, the robust oracle, conditions, object classes, tables, the script."""

import json
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest

import graspbox
import tiny_policy
from datasets_for_tests import run as make_dataset
from graspbox import evaluation, object_sets, policies
from graspbox.envs import SINGLE_OBJECT_IDS
from graspbox.errors import ConfigError
from graspbox.evaluation import evaluate
from graspbox.evaluation.conditions import CONDITIONS, settings_of
from graspbox.evaluation.object_classes import CLASSES, object_classes
from graspbox.evaluation.reports import COLUMNS, Measured, class_table, condition_table, labels, policy_table
from graspbox.perception import DepthView, PlannedFinder, PoseNoise
from graspbox.perception.configs import CropConfig
from graspbox.perception.crops import OCCUPIED, solid_occupancy
from graspbox.perception.shapes import surface_mesh

CROP = CropConfig()
CANS = "procedural:can:0-4"
_, LOOP = SINGLE_OBJECT_IDS


def ball(radius: float, height: float) -> np.ndarray[Any, np.dtype[np.uint8]]:
    """Fill a crop with a ball over its middle."""
    n = CROP.resolution
    centers = (np.stack(np.meshgrid(*[np.arange(n) + 0.5] * 3, indexing="ij"), -1)) * CROP.voxel_size + CROP.origin
    inside = radius - np.linalg.norm(centers - [0.0, 0.0, height], axis=-1)
    return np.asarray(np.clip(OCCUPIED + 100.0 * inside / CROP.voxel_size, 0, 255), dtype=np.uint8)


# --- surfaces ------------------------------------------------------------------------------------------------------


def test_the_surface_of_a_ball_is_that_of_the_closed_form() -> None:
    radius, height = 0.06, 0.08
    mesh = surface_mesh(ball(radius, height))
    assert mesh is not None
    assert mesh.watertight
    assert mesh.volume == pytest.approx(4.0 / 3.0 * np.pi * radius**3, rel=0.02)
    assert mesh.area == pytest.approx(4.0 * np.pi * radius**2, rel=0.02)
    assert mesh.center_of_mass == pytest.approx([0.0, 0.0, height], abs=1e-3)
    distances = np.linalg.norm(mesh.vertices - [0.0, 0.0, height], axis=1)
    assert np.abs(distances - radius).max() < 0.2 * CROP.voxel_size


def test_a_surface_closes_at_the_side_of_the_crop_and_nothing_has_none() -> None:
    n = CROP.resolution
    full = surface_mesh(np.full((n, n, n), 255, dtype=np.uint8))
    assert full is not None
    assert full.watertight
    # From full voxels to empty ones a quarter is a quarter of a voxel beyond the boundary.
    assert full.volume == pytest.approx((CROP.side + 0.5 * CROP.voxel_size) ** 3, rel=0.005)
    assert surface_mesh(np.full((n, n, n), OCCUPIED - 1, dtype=np.uint8)) is None
    one = np.zeros((n, n, n), dtype=np.uint8)
    one[3, 4, 5] = OCCUPIED
    voxel = surface_mesh(one)
    assert voxel is not None
    assert voxel.volume > 0.0
    wrong: Any
    for wrong in (np.zeros((n, n, n - 1), dtype=np.uint8), np.zeros((n, n, n))):
        with pytest.raises(ConfigError, match="occupancy is"):
            surface_mesh(wrong)


def test_the_surface_of_an_object_fits_the_object() -> None:
    mesh = object_sets.load("procedural:can:3")[0].load()
    pose = np.eye(4)
    pose[:3, 3] = [*-mesh.bounds.mean(axis=0)[:2], -mesh.bounds[0, 2]]
    found = surface_mesh(solid_occupancy([mesh], [0], pose[None], config=CROP)[0])
    assert found is not None
    np.testing.assert_allclose(found.bounds, mesh.bounds + pose[:3, 3], atol=0.6 * CROP.voxel_size)


# --- baselines -----------------------------------------------------------------------------------------------------


def test_the_planner_grasps_what_one_camera_sees() -> None:
    found = evaluate("partial_view_planner", objects=CANS, trials=6, num_envs=3)
    assert found.succeeded >= 3
    assert found == evaluate("partial_view_planner", objects=CANS, trials=6, num_envs=2)
    assert found.calibration_error is None


def test_what_is_too_small_to_plan_for_is_no_error() -> None:
    """A camera may see one voxel of an object, which no mesh may be."""
    hand = graspbox.load_hand("reflex")
    speck = np.zeros((1, *(CROP.resolution,) * 3), dtype=np.uint8)
    speck[0, 20, 20, 4] = OCCUPIED
    mesh = object_sets.load("procedural:can:1")[0].load()
    seen = graspbox.views(mesh, count=1, image_size=128, images="depth")
    view = DepthView(seen.depth[0], seen.intrinsics, seen.world_from_camera[0])
    assert PlannedFinder(hand).find(view) is not None
    assert PlannedFinder(hand, lambda _: speck).find(view) is None


def test_the_robust_oracle_grasps_and_is_the_same_beside_other_environments() -> None:
    found = evaluate("robust_oracle", objects=CANS, trials=2, num_envs=2)
    assert found.succeeded == 2
    assert found == evaluate("robust_oracle", objects=CANS, trials=2, num_envs=1)
    with pytest.raises(ConfigError, match="'robust_oracle' acts in graspbox/GraspPose-v0"):
        evaluate("robust_oracle", "graspbox/Grasp-v0", objects=CANS, trials=1)


def test_a_replay_score_tells_a_robust_grasp_from_one_that_only_just_holds() -> None:
    from graspbox.policies.baselines.oracles import robust_scores

    mesh = object_sets.load("procedural:can:1")[0].load()
    scene = graspbox.Scene(mesh)
    plan = graspbox.plan(mesh, world_from_object=scene.world_from_object).best(12)
    scores = robust_scores(scene, plan.poses, plan.preshape, np.random.default_rng(0), PoseNoise(0.004, 0.06))
    held = scene.simulate(plan.poses, plan.preshape).success
    assert (scores[held] >= 0.2).all()
    assert (scores[~held] == 0.0).all()
    shares = (scores[held] - 0.2) % 1.0
    assert scores.max() > 0.9
    assert np.allclose(np.round(shares * 8) / 8, shares, atol=0.011)


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Make a small data set."""
    pytest.importorskip("pyarrow", reason="data sets need pyarrow, from the extra 'data'")
    folder = tmp_path_factory.mktemp("data") / "set"
    done = make_dataset(folder)
    assert done.returncode == 0, done.stderr
    return folder


def test_the_nearest_known_scene_gives_its_grasp(data: Path) -> None:
    from graspbox.learn.models.nearest_finder import NearestGrasp, remember
    from graspbox.learn.models.trials import GraspTrials

    memory = remember(data, seed=1)
    trials = GraspTrials.from_dataset(data, "train")
    held = np.unique(trials.scene_of[trials.success])
    assert len(memory.preshapes) == len(held)
    again = remember(data, seed=1)
    np.testing.assert_array_equal(memory.poses, again.poses)
    distances = np.linalg.norm(memory.descriptions[:, None] - memory.descriptions[None], axis=2)
    assert (distances.argmin(axis=1) == np.arange(len(distances))).all()
    policy = NearestGrasp(memory)
    evaluate(policy, objects="procedural:can:0-1", trials=4, num_envs=4)
    for found in policy.found:
        assert found is not None
        assert found.score <= 0.0
        known = np.flatnonzero((memory.poses == found.poses[0]).all(axis=(1, 2)))
        np.testing.assert_array_equal(found.world_from_hand, found.world_from_crop @ memory.poses[known[0]])


# --- conditions and classes ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("env_id", SINGLE_OBJECT_IDS)
@pytest.mark.parametrize("name", CONDITIONS)
def test_every_condition_makes_environments(name: str, env_id: str) -> None:
    settings: dict[str, Any] = {"max_episode_steps": 3} if env_id == LOOP else {}
    if (name, env_id) == ("shake", LOOP):
        with pytest.raises(ConfigError, match=r"the condition 'shake' applies only to graspbox/GraspPose-v0"):
            evaluate("planner", env_id, CANS, trials=2, num_envs=2, condition=name, **settings)
        return
    found = evaluate("planner", env_id, CANS, trials=2, num_envs=2, condition=name, **settings)
    assert (len(found.trials), found.condition, found.to_json()["condition"]) == (2, name, name)
    assert found.shaken <= found.succeeded
    if name == "shake":
        assert found.shaken > 0


def test_conditions_change_the_closed_loop() -> None:
    """Conditions change the outcome of a grasp and the camera's image."""

    def trials_of(name: str) -> Any:
        return evaluate("planner", LOOP, "procedural:can:0", 1, 2, num_envs=1, condition=name, reward="dense").trials

    nominal = trials_of("nominal")
    for name in ("hand_5", "hand_10", "friction_0.5", "friction_0.3", "mass_2"):
        assert trials_of(name) != nominal, name

    def seen(name: str) -> np.ndarray[Any, np.dtype[np.float32]]:
        env = gymnasium.make(LOOP, objects=CANS, obs="depth", image_size=16, **settings_of(name, LOOP))
        image: np.ndarray[Any, np.dtype[np.float32]] = env.reset(seed=3)[0]
        env.close()
        return image

    for name in ("camera", "calibration"):
        assert np.abs(seen(name) - seen("nominal")).max() > 1e-3, name


def test_conditions_that_cannot_be_are_named() -> None:
    with pytest.raises(ConfigError, match="there is no condition 'dark'; choose from nominal, hand_5"):
        evaluate("zero", objects=CANS, trials=1, condition="dark")
    with pytest.raises(ConfigError, match="randomization is set, and the condition 'mass_2' sets it too"):
        evaluate("zero", objects=CANS, trials=1, condition="mass_2", randomization=None)


def test_conditions_change_what_they_say() -> None:
    def rate(name: str) -> float:
        return evaluate("planner", objects=CANS, trials=24, seed=2, condition=name).rate

    nominal = rate("nominal")
    assert nominal > 0.8
    assert rate("hand_10") < nominal
    assert rate("friction_0.3") < nominal


def test_classes_follow_from_shape_and_mass() -> None:
    def box(x: float, y: float, z: float, mass: float = 0.1) -> graspbox.Mesh:
        corners = np.array([(i, j, k) for i in (0, 1) for j in (0, 1) for k in (0, 1)]) * [x, y, z]
        faces = [[0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1]]
        faces += [[2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3]]
        return graspbox.mesh_from_arrays(corners, faces, mass=mass)

    assert object_classes(box(0.1, 0.08, 0.02)) == ("flat", "box")
    assert object_classes(box(0.1, 0.02, 0.02)) == ("thin", "box")
    assert object_classes(box(0.1, 0.08, 0.07, 0.5)) == ("heavy", "box")
    assert object_classes(object_sets.load("procedural:ball:0")[0].load()) == ("round",)


# --- tables --------------------------------------------------------------------------------------------------------


def measured(policy: str, success: list[bool], **changes: Any) -> Measured:
    """Make trials of two objects in turns."""
    trials = [[("plate", "can")[i % 2], s, s and i % 2 == 0, False, 0.5, True] for i, s in enumerate(success)]
    given = {"condition": "nominal", "policy": policy, "objects": "set", "seed": 0, "milliseconds": 3.0}
    row = {**given, "trials": trials, **changes}
    return Measured.of(row, row["policy"])


def test_tables_count_pool_and_compare() -> None:
    assert COLUMNS[0] == "object"
    rows = [measured("robust_oracle", [True] * 8), measured("depth", [True, True, False, True] * 2)]
    rows.append(measured("depth", [False] * 4, seed=1))
    text = policy_table(rows)
    assert "| depth | set | 12 | 50.0 % (25.4 to 74.6) | 16.7 %" in text
    assert text.count("| depth |") == 1
    classes = {"plate": ("flat", "round"), "can": ("round",)}
    # Seed 1 has no trials of the oracle, so nothing can be compared.
    assert "| depth | 33.3 % |  |  |  | 50.0 % |  |" in class_table(rows, classes)
    # Of four plates that the oracle lifted, the policy lifted two.
    assert "50.0 % (15.0 to 85.0)" in class_table(rows[:2], classes)
    assert rows[1].calibration_error == pytest.approx(0.25)
    # A third of the trials have an object that is too wide.
    with pytest.raises(ConfigError, match="a trial has 3 values"):
        measured("depth", [], trials=[["plate", True, True]])
    trials = [["plate", i < 2, False, False, 0.5, i != 2] for i in range(3)]
    some = measured("panda", [], trials=trials)
    assert (some.fitting_success, some.summary()["fitting"]) == (2, {"trials": 2, "success": 2})
    table = policy_table([some])
    assert "| success with objects that fit |" in table
    assert "| 100.0 % (34.2 to 100.0) of 2 |" in table
    assert "that fit" not in text
    shaken = measured("depth", [True] * 4, condition="shake")
    assert CONDITIONS["shake"].meaning in condition_table([rows[1], shaken])


def test_policies_say_how_sure_they_are(tmp_path: Path) -> None:
    pytest.importorskip("typer", reason="the command line needs the extra 'cli'")
    pytest.importorskip("onnxruntime", reason="policies with networks need onnxruntime")
    pytest.importorskip("onnx", reason="the tiny policy is written with onnx")
    from command_line import invoke
    from tiny_policy import make

    make(tmp_path / "tiny")
    found = evaluate(policies.load(str(tmp_path / "tiny")), objects=CANS, trials=6)
    stated = [trial.confidence for trial in found.trials]
    assert all(p is not None and 0.0 <= p <= 1.0 for p in stated)
    assert found.calibration_error is not None
    assert found.to_json()["calibration_error"] == found.calibration_error
    assert (
        found.mean_confidence
        == found.to_json()["mean_confidence"]
        == pytest.approx(sum(filter(None, stated)) / len(stated))
    )
    words = ["evaluate", str(tmp_path / "tiny"), "--objects", CANS, "--trials", "6"]
    done = invoke(words, catch_exceptions=False)
    sure = f"predicted probability of success: {found.mean_confidence:.1%} on average, expected calibration error"
    assert f"{sure} {found.calibration_error:.3f}" in done.output


def test_every_policy_has_a_label_of_its_own() -> None:
    policies = ["planner", "policies/depth", "geometric=policies/depth", "x/policy", "y/policy"]
    policies += ["filtered=out/set", "filtered=policies/head", "unfiltered=a/head", "unfiltered=b/head"]
    found = labels(policies)
    assert list(found) == policies
    assert list(found.values()) == [
        *("planner", "depth", "geometric", "x/policy", "y/policy"),
        *("filtered set", "filtered head", "unfiltered=a/head", "unfiltered=b/head"),
    ]


# --- the script ----------------------------------------------------------------------------------------------------


def test_parts_of_a_policy_can_be_added_and_left_out() -> None:
    """A policy scores fewer grasps without its head."""
    pytest.importorskip("onnxruntime")
    from graspbox.evaluation.variants import VARIANTS, load_variant

    folder = Path(__file__).parents[2] / "policies/depth"
    oracles = [kind for kind in VARIANTS if kind.startswith("true_")]
    counts = {}
    for spec in (str(folder), *(f"{kind}={folder}" for kind in ("tolerant", "geometric", *oracles))):
        policy: Any = load_variant(spec)
        evaluate(policy, "graspbox/GraspPose-v0", CANS, trials=1, num_envs=1)
        counts[spec.partition("=")[0]] = len(policy.found[0].scores)
    assert counts["geometric"] < counts[str(folder)]
    # Only those that were compared by their mean: the finalists, and the additions of the last refinement.
    assert 16 <= counts["tolerant"] <= 16 + 2 * 4 * 5
    # The ground truth of a part needs the state of the object.
    for kind in oracles:
        assert "state" in (load_variant(f"{kind}={folder}").obs or ())
        assert "state" not in (load_variant(str(folder)).obs or ())
    head = folder.with_name("head")
    for kind in ("filtered", "unfiltered"):
        evaluate(load_variant(f"{kind}={head}"), "graspbox/GraspPose-v0", CANS, trials=1, num_envs=1)
    with pytest.raises(ConfigError, match="choose the prefix before = from"):
        load_variant(f"blind={folder}")


def test_what_one_policy_learned_from_is_left_out_for_all(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("onnxruntime")
    pytest.importorskip("typer", reason="the script needs typer, from the extra 'cli'")
    pytest.importorskip("matplotlib")
    from test_scripts import script

    tiny_policy.make(tmp_path / "tiny", learned_from=("procedural:can:0-3",))
    words = ["--out", str(tmp_path / "out"), "--policies", "random", "--policies", str(tmp_path / "tiny")]
    words += ["--conditions", "nominal"]
    assert script("evaluate_policies").main([*words, "--objects", CANS, "--trials", "3"]) == 0
    assert "4 of 5 objects of procedural:can:0-4 are left out" in capsys.readouterr().err
    rows = [json.loads(line) for line in (tmp_path / "out/results.jsonl").read_text().splitlines()]
    assert {trial[COLUMNS.index("object")] for row in rows for trial in row["trials"]} == {"can-000004"}
    assert script("evaluate_policies").main([*words, "--objects", "procedural:can:0-3", "--trials", "3"]) == 2


def test_all_policies_take_the_hand_that_is_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("typer", reason="the script needs typer, from the extra 'cli'")
    pytest.importorskip("matplotlib")
    from test_scripts import script

    words = ["--out", str(tmp_path / "out"), "--policies", "planner", "--objects", "procedural:box:0-9"]
    words += ["--conditions", "nominal", "--trials", "8", "--json"]
    assert script("evaluate_policies").main([*words, "--hand", "panda_gripper"]) == 0
    (row,) = json.loads(capsys.readouterr().out)
    expected = evaluate("planner", objects="procedural:box:0-9", trials=8, hand="panda_gripper")
    assert row["success"] == expected.succeeded
    assert row["fitting"]["trials"] == len(expected.fitting.trials) < 8
    assert script("evaluate_policies").main(words) == 2
    assert "hand" in capsys.readouterr().err


def test_the_script_measures_resumes_and_writes_tables_and_pictures(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("typer", reason="the script needs typer, from the extra 'cli'")
    pytest.importorskip("matplotlib")
    from test_scripts import script

    module = script("evaluate_policies")
    words = ["--out", str(tmp_path), "--policies", "random", "--policies", "planner", "--stressed", "planner"]
    words += ["--conditions", "nominal", "--conditions", "hand_5", "--objects", CANS, "--trials", "3", "--json"]
    assert module.main(words) == 0
    first = capsys.readouterr().out
    text = (tmp_path / "evaluation.md").read_text()
    assert "| planner | procedural:can:0-4 | 3 |" in text
    assert CONDITIONS["hand_5"].meaning in text
    assert all(f"`{name}`" in text for name in CLASSES)
    for name in ("policies.png", "conditions.png"):
        assert (tmp_path / name).stat().st_size > 1000
    # Logged trials are not repeated.
    monkeypatch.setattr(evaluation, "evaluate", None)
    assert module.main(words) == 0
    assert capsys.readouterr().out == first
    assert module.main([*words, "--stressed", "zero"]) == 2
    # The expert acts in the closed loop, which cannot be shaken.
    shaken = ["--out", str(tmp_path / "x"), "--policies", "expert", "--conditions", "shake", "--trials", "1"]
    assert module.main([*shaken, "--objects", CANS]) == 2
    assert "the condition 'shake' applies only to graspbox/GraspPose-v0" in capsys.readouterr().err.replace("\n", " ")
    assert not (tmp_path / "x").exists()
    assert module.main(["--out", str(tmp_path / "x"), "--policies", "nearer=3", "--trials", "1"]) == 2
