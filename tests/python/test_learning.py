"""Data, execution and reports of the study's reproduction: the parts without torch."""

import importlib.util
import json
from pathlib import Path

import numpy as np
import pytest

import graspbox
from graspbox import learn, object_sets
from graspbox._common import rotations
from graspbox.errors import ConfigError, FileError, MissingExtraError
from graspbox.study import execution, grasps, samples
from graspbox.study.execution import BASELINES, ObjectScenes, Score, average_pose, execute
from graspbox.study.reproduction.protocol import BATCH_SIZES, SETTINGS, TABLES, training_settings
from graspbox.study.samples import OPAQUE, TRANSPARENT, UNSEEN, Samples, make_samples, split_at_random

OBJECTS = object_sets.load(["procedural:can:0", "procedural:mug:3"])


def some_rotations(count: int, seed: int = 0) -> np.ndarray:
    """Random rotations (n, 3, 3), and with them half turns, whose quaternions have w = 0."""
    q = np.random.default_rng(seed).normal(size=(count, 4))
    q[: min(count, 4)] = np.eye(4)[: min(count, 4)]
    return rotations.rotation_from_quaternion(q)


@pytest.fixture(scope="module")
def found() -> grasps.Grasps:
    return grasps.collect(OBJECTS, 24)


def test_rotations_come_back() -> None:
    r = some_rotations(300)
    q = rotations.quaternion_from_rotation(r)
    assert (q[:, 0] >= 0).all()
    np.testing.assert_allclose(np.linalg.norm(q, axis=1), 1)
    np.testing.assert_allclose(rotations.rotation_from_quaternion(-3 * q), r, atol=1e-12)
    np.testing.assert_allclose(rotations.rotation_from_euler(rotations.euler_from_rotation(r)), r, atol=1e-12)


def test_euler_angles_are_about_fixed_axes() -> None:
    """A quarter turn about x, then one about z, takes y to z and leaves it there; x goes to y."""
    r = rotations.rotation_from_euler([[np.pi / 2, 0.0, np.pi / 2]])[0]
    np.testing.assert_allclose(r @ [0, 1, 0], [0, 0, 1], atol=1e-15)
    np.testing.assert_allclose(r @ [1, 0, 0], [0, 1, 0], atol=1e-15)


@pytest.mark.parametrize("pitch", [np.pi / 2, -np.pi / 2])
def test_euler_angles_survive_gimbal_lock(pitch: float) -> None:
    r = rotations.rotation_from_euler([[0.4, pitch, -0.9]])
    angles = rotations.euler_from_rotation(r)
    assert angles[0, 1] == pytest.approx(pitch)
    np.testing.assert_allclose(rotations.rotation_from_euler(angles), r, atol=1e-7)


def test_angles_between_rotations() -> None:
    first = some_rotations(50)
    turn = rotations.rotation_from_euler([[0.0, 0.0, 1.2]])
    np.testing.assert_allclose(rotations.angle_between(first, first @ turn), 1.2)
    np.testing.assert_allclose(rotations.angle_between(first, first), 0.0, atol=1e-7)


def test_bad_rotations_are_refused() -> None:
    with pytest.raises(ConfigError, match=r"quaternions has shape \(4,\); give \(n, 4\)"):
        rotations.rotation_from_quaternion([1.0, 0.0, 0.0, 0.0])
    with pytest.raises(ConfigError, match="zero or not finite"):
        rotations.rotation_from_quaternion([[0.0, 0.0, 0.0, 0.0]])
    with pytest.raises(ConfigError, match="2 positions and 1 rotations"):
        rotations.poses_from(np.zeros((2, 3)), np.eye(3)[None])


def test_grasps_succeed_where_they_were_found(found: grasps.Grasps) -> None:
    """They are shared equally, have one preshape, and hold again when executed from the base frame."""
    assert found.names == OBJECTS.names
    assert np.bincount(found.object).tolist() == [12, 12]
    np.testing.assert_allclose(found.preshape, grasps.PRESHAPE, atol=1e-6)
    for i, spec in enumerate(OBJECTS):
        scene, rows = graspbox.Scene(spec.load()), found.object == i
        out = scene.simulate(grasps.executed(scene, found.base_from_hand[rows]), found.preshape[rows])
        assert out.success.all()
        np.testing.assert_array_equal(out.secure, found.secure[rows])


def test_grasps_do_not_depend_on_threads(found: grasps.Grasps) -> None:
    assert grasps.collect(OBJECTS, 24, num_threads=1) == found


def test_too_few_grasps_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(grasps, "_MOST_PLANS", 1)
    with pytest.raises(ConfigError, match=r"count is 100000, but .* give \d+ successful grasps; ask for fewer"):
        grasps.collect(OBJECTS[:1], 100_000, preshape=0.0)


def test_best_grasp_is_the_first_secure_one() -> None:
    poses = np.broadcast_to(np.eye(4), (5, 4, 4))
    secure = np.array([False, True, True, False, False])
    given = grasps.Grasps(("a", "b", "c"), np.array([0, 0, 0, 2, 2]), poses, np.zeros(5), secure)
    assert given.best().tolist() == [1, -1, 3]


def test_base_frame_is_under_the_object() -> None:
    scene = graspbox.Scene(OBJECTS[1].load())
    low, high = samples.base_mesh(scene).bounds
    np.testing.assert_allclose((low + high)[:2], 0.0, atol=1e-12)
    assert low[2] == pytest.approx(0.0, abs=1e-3)


@pytest.mark.parametrize("mapping", ["one_to_many", "one_to_one", "many_to_one"])
def test_mappings_pair_views_with_poses(found: grasps.Grasps, mapping: samples.Mapping) -> None:
    """One to many repeats the input, many to one the pose, and one to one neither."""
    made = make_samples(OBJECTS, found, kind="image", mapping=mapping, count=8)
    assert made.inputs.shape == (8, 256, 256)
    assert np.bincount(made.object).tolist() == [4, 4]
    for i in range(2):
        rows = np.flatnonzero(made.object == i)
        inputs = {made.inputs[k].tobytes() for k in rows}
        poses = {made.base_from_hand[k].tobytes() for k in rows}
        assert (len(inputs) == 1) == (mapping == "one_to_many")
        assert (len(poses) == 1) == (mapping == "many_to_one")
        if mapping == "many_to_one":
            assert poses == {found.base_from_hand[found.best()[i]].tobytes()}


def test_samples_are_the_same_on_any_number_of_threads(found: grasps.Grasps) -> None:
    options = {"kind": "image", "mapping": "one_to_one", "count": 4, "seed": 3}
    assert make_samples(OBJECTS, found, **options, num_threads=1) == make_samples(OBJECTS, found, **options)  # type: ignore[arg-type]


def test_more_samples_show_further_views(found: grasps.Grasps) -> None:
    """Beyond its grasps an object repeats their poses, with views of their own."""
    made = make_samples(OBJECTS[:1], _of_first(found), kind="image", mapping="one_to_one", count=20)
    assert len({row.tobytes() for row in made.inputs}) == 20
    np.testing.assert_array_equal(made.base_from_hand[0], made.base_from_hand[12])


def _of_first(found: grasps.Grasps) -> grasps.Grasps:
    kept = found.object == 0
    return grasps.Grasps(
        found.names[:1], found.object[kept], found.base_from_hand[kept], found.preshape[kept], found.secure[kept]
    )


def test_binary_grids_are_those_of_binvox(found: grasps.Grasps) -> None:
    made = make_samples(OBJECTS[:1], _of_first(found), kind="binary", mapping="one_to_many", count=2)
    grid = made.inputs[0]
    mesh = samples.base_mesh(graspbox.Scene(OBJECTS[0].load()))
    expected = graspbox.voxelize(mesh, 128, down=1, remove_internal=True, exact=True).occupancy
    np.testing.assert_array_equal(grid == OPAQUE, expected)
    assert set(np.unique(grid)) == {TRANSPARENT, OPAQUE}


def test_ternary_grids_hide_what_is_behind(found: grasps.Grasps) -> None:
    """The camera is on the side of -x: visible voxels are nearer to it than unseen ones."""
    made = make_samples(OBJECTS[:1], _of_first(found), kind="ternary", mapping="one_to_one", count=2)
    grid = made.inputs[0]
    assert set(np.unique(grid)) == {TRANSPARENT, UNSEEN, OPAQUE}
    opaque, unseen = np.argwhere(grid == OPAQUE), np.argwhere(grid == UNSEEN)
    assert opaque[:, 0].mean() < unseen[:, 0].mean()
    assert opaque[:, 2].mean() > unseen[:, 2].mean()
    assert not np.array_equal(grid, made.inputs[1])


def test_labels_come_back_as_poses(found: grasps.Grasps) -> None:
    for size in (4, 3):
        labels = samples.labels_of(found.base_from_hand, size)
        assert labels.shape == (24, 3 + size)
        np.testing.assert_allclose(samples.poses_of_labels(labels), found.base_from_hand, atol=1e-6)
    with pytest.raises(ConfigError, match="diverged"):
        samples.poses_of_labels(np.full((1, 7), np.nan))
    with pytest.raises(ConfigError, match=r"shape \(1, 5\)"):
        samples.poses_of_labels(np.zeros((1, 5)))


def test_samples_are_saved(found: grasps.Grasps, tmp_path: Path) -> None:
    made = make_samples(OBJECTS, found, kind="binary", mapping="one_to_many", count=4)
    path = tmp_path / "samples.npz"
    made.save(path)
    assert Samples.load(path) == made
    with pytest.raises(FileError):
        Samples.load(tmp_path / "none.npz")
    path.write_bytes(path.read_bytes()[:100])
    with pytest.raises(ConfigError, match="remove it"):
        Samples.load(path)


def test_wrong_samples_are_refused(found: grasps.Grasps) -> None:
    with pytest.raises(ConfigError, match="kind is 'colour'; choose from image, binary, ternary"):
        make_samples(OBJECTS, found, kind="colour", mapping="one_to_one")  # type: ignore[arg-type]
    with pytest.raises(ConfigError, match="mapping is 'all'"):
        make_samples(OBJECTS, found, kind="image", mapping="all")  # type: ignore[arg-type]
    with pytest.raises(ConfigError, match="belong to other objects"):
        make_samples(OBJECTS[:1], found, kind="image", mapping="one_to_one")
    with pytest.raises(ConfigError, match="count is 0"):
        make_samples(OBJECTS, found, kind="image", mapping="one_to_one", count=0)


@pytest.mark.parametrize(("count", "sizes"), [(1230, (1046, 122, 62)), (189, (161, 19, 9)), (20, (17, 2, 1))])
def test_split_is_the_studys(count: int, sizes: tuple[int, int, int]) -> None:
    split = split_at_random(count, seed=1)
    parts = (split.train, split.validation, split.test)
    assert tuple(map(len, parts)) == sizes
    assert sorted(np.concatenate(parts).tolist()) == list(range(count))
    assert split == split_at_random(count, seed=1)
    assert split != split_at_random(count, seed=2)


def test_average_pose_is_in_the_middle() -> None:
    """Between two turns about z, for any signs of their quaternions."""
    r = rotations.rotation_from_euler([[0.0, 0.0, 0.3], [0.0, 0.0, 0.7]])
    middle = average_pose(rotations.poses_from([[1.0, 0, 0], [2.0, 0, 0]], r))
    np.testing.assert_allclose(middle[:3, 3], [1.5, 0, 0])
    np.testing.assert_allclose(middle[:3, :3], rotations.rotation_from_euler([[0.0, 0.0, 0.5]])[0], atol=1e-12)


def test_baselines_and_their_scores(found: grasps.Grasps) -> None:
    """Labels hold, poses far away are infeasible or touch nothing, and each baseline is true to its name."""
    made = make_samples(OBJECTS, found, kind="image", mapping="one_to_one")
    train, test = made[np.arange(0, 24, 2)], made[np.arange(1, 24, 2)]
    scenes = ObjectScenes(OBJECTS)
    score = execute(scenes, test, BASELINES["label"](train, test))
    assert (score.tried, score.success, score.infeasible) == (12, 12, 0)
    far = test.base_from_hand + np.eye(4)[2][:, None] * np.eye(4)[3] * 0.5
    score = execute(scenes, test, far)
    assert (score.success, score.legacy, score.infeasible) == (0, 0, 0)
    below = test.base_from_hand - np.eye(4)[2][:, None] * np.eye(4)[3] * 0.5
    assert execute(scenes, test, below) == Score(12, 0, 0, 0, 12)
    np.testing.assert_array_equal(BASELINES["nearest"](test, test), test.base_from_hand)
    constant = BASELINES["constant"](train, test)
    assert (constant == constant[0]).all()
    assert any((constant[0] == pose).all() for pose in train.base_from_hand)
    average = BASELINES["average"](train, test)
    first = average_pose(train.base_from_hand[train.object == 0])
    np.testing.assert_array_equal(average[test.object == 0], np.broadcast_to(first, (6, 4, 4)))
    with pytest.raises(ConfigError, match="base_from_hand has shape"):
        execute(scenes, test, far[:2])
    with pytest.raises(ConfigError, match="there is no object 'nothing'"):
        scenes["nothing"]


def test_settings_of_the_study() -> None:
    legacy = training_settings("legacy", "cnn2d")
    assert (legacy["learning_rate"], legacy["momentum"], legacy["batch_size"]) == (1e-9, 0.5, 10)
    assert training_settings("legacy", "cnn3d")["batch_size"] == 6
    assert {name for name in SETTINGS for network in BATCH_SIZES if training_settings(name, network)} == set(SETTINGS)
    assert [row.success for _, rows in TABLES.values() for row in rows] == [6, 5, 4, 1, 0, 0, 0, 0]


def test_missing_torch_names_the_extra(monkeypatch: pytest.MonkeyPatch) -> None:
    real = importlib.util.find_spec
    monkeypatch.setattr(learn, "find_spec", lambda name: None if name == "torch" else real("json"))
    with pytest.raises(MissingExtraError, match=r"needs torch: pip install 'graspbox\[train\]'"):
        learn.require()
    from graspbox.study.regressor import PoseRegressor

    with pytest.raises(MissingExtraError, match=r"graspbox\[train\]"):
        PoseRegressor("anywhere")


def test_importing_what_needs_no_torch_imports_none() -> None:
    import subprocess
    import sys

    code = (
        "import sys; from graspbox.study import grasps, samples, execution, regressor; "
        "from graspbox.study.reproduction import protocol, results, settings; print('torch' in sys.modules)"
    )
    result = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True)
    assert result.stdout.strip() == "False"


def test_policy_finds_the_object_in_voxels() -> None:
    """A block in the observation fills its cube; its base is below its middle; the table is not part of it."""
    from graspbox.study.regressor import cropped_voxels

    seen = np.ones((64, 64, 64), dtype=np.uint8)
    assert cropped_voxels(seen, "binary") is None
    seen[:, :, 0] = 2
    seen[40:48, 20:24, 1:5] = 2
    seen[48:60, 20:24, 1:5] = 0
    found = cropped_voxels(seen, "ternary")
    assert found is not None
    grid, base = found
    assert (grid[:, :32, :32] == OPAQUE).all()
    assert (grid[:, 32:] == TRANSPARENT).all()
    assert (grid[:, :, 32:] == TRANSPARENT).all()
    np.testing.assert_allclose(base[:3, 3], [44 / 64 * 0.4 - 0.2, 22 / 64 * 0.4 - 0.2, 0.0])
    # A cube twice as high includes the unseen space behind the block.
    seen[40:48, 20:24, 1:17] = 2
    found = cropped_voxels(seen, "ternary")
    assert found is not None
    grid, _ = found
    assert (grid[32:, :16, :16] == UNSEEN).all()
    found = cropped_voxels(seen, "binary")
    assert found is not None
    assert UNSEEN not in found[0]


def test_reports_put_the_study_beside_ours(tmp_path: Path) -> None:
    from graspbox.study.reproduction.results import NetworkResult, baseline_table, network_table, page

    errors = {part: {"loss": 1.0, "position": 0.02, "rotation": 0.5, "angle": 0.3} for part in ("train", "test")}
    errors["validation"] = {"loss": 1.0, "position": 0.2, "rotation": 1.0, "angle": 0.3}
    result = NetworkResult(
        "sane", "cnn2d", "psi3", "patience", 100, 60.0, errors, Score(61, 50, 40, 51, 2), Score(60, 12, 6, 13, 20),
        {"predicted": 0.01, "labels": 0.02}, (0.1, 0.2, 0.3), 0.5,
    )  # fmt: skip
    assert NetworkResult.from_row(json.loads(json.dumps(result.row()))) == result
    lines = network_table("cnn2d", [result]).splitlines()
    (study,) = (line for line in lines if line.startswith("| psi4 "))
    assert study == "| psi4 | the study |  |  | 6 of about 61 |  |  | 0.12/0.11/0.16 |  |"
    study, ours = (line for line in lines if line.startswith("| psi3 "))
    assert study.startswith("| psi3 | the study |")
    # 10 x (0.005 x 0.02 + 0.031 x 0.5) = 0.156, and 10 x (0.005 x 0.2 + 0.031) = 0.32. Intervals: Wilson's.
    assert ours == (
        "| psi3 | sane | 50/61, 82% (71 to 90) | 40 | 51 | 2 | 12/60, 20% (12 to 32) | 0.16/0.16/0.32 "
        "| 2.0 cm, 17 deg |"
    )
    table = baseline_table({"image": {"label": vars(Score(2, 2, 1, 2, 0))}})
    assert "| image: label | 2/2, 100% (34 to 100) | 1 | 2 | 0 |" in table
    text = page("python x", {"samples": "61"}, [result], {}, {"Figure": "a.png"})
    assert "![Figure](a.png)" in text
    assert "`python x`" in text
    assert "## 2DCNN, beside table 3.2 of the study" in text


def test_figures_are_written(tmp_path: Path) -> None:
    pytest.importorskip("matplotlib", reason="figures need the extra 'cli'")
    from PIL import Image

    from graspbox.study.figures import normalized_figure, read_curve, training_figure

    with pytest.raises(ConfigError, match="has no row of a validation"):
        read_curve(tmp_path)
    rows: list[dict[str, float]] = []
    for i in range(1, 50):
        measures = {"loss": 1 / i, "position_error": 0.1 / i, "rotation_error": 0.5 / i, "orientation_norm": 1.0}
        validation = {**measures, "angle": 0.5} if i in (1, 49) else {}
        rows.append({"step": i, "seconds": 1.0, **{f"train_{k}": v for k, v in measures.items()}, **validation})
    (tmp_path / "losses.jsonl").write_text("".join(json.dumps(row) + "\n" for row in rows))
    curve = read_curve(tmp_path)
    np.testing.assert_allclose(curve.train["loss"], 1 / np.arange(1, 50))
    training_figure(tmp_path / "one.png", "cnn2d", {"legacy": curve, "sane": curve})
    normalized_figure(tmp_path / "all.png", {"cnn2d": [("psi1", 2**0.5, curve)]})
    for name in ("one", "all"):
        with Image.open(tmp_path / f"{name}.png") as image:
            assert np.asarray(image.convert("L")).std() > 5
    (tmp_path / "losses.jsonl").write_text(json.dumps({"step": 1, "seconds": 1.0, "train_loss": 1.0}) + "\n")
    with pytest.raises(ConfigError, match="train the network first"):
        read_curve(tmp_path)


def test_scenes_are_prepared_once() -> None:
    scenes = execution.ObjectScenes(OBJECTS)
    assert scenes[OBJECTS[0].name] is scenes[OBJECTS[0].name]
