"""Sampled and perturbed poses, and the comparison of robust success."""

import json
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("mujoco", reason="the comparison needs mujoco, from the extra 'dev'")

import graspbox
from graspbox.errors import ConfigError, FileError
from graspbox.hands import reach_of
from validate import main
from validation import mujoco as judge
from validation.mujoco import robust


def test_copies_stay_within_their_bounds() -> None:
    pose = np.eye(4)
    pose[:3, 3] = [0.1, 0.2, 0.3]
    copies = judge.perturbed(pose, 200, 0.005, 0.1, np.random.default_rng(0))
    shifts = np.linalg.norm(copies[:, :3, 3] - pose[:3, 3], axis=1)
    turns = np.arccos(np.clip((np.trace(copies[:, :3, :3], axis1=1, axis2=2) - 1.0) / 2.0, -1.0, 1.0))
    for values, bound in ((shifts, 0.005), (turns, 0.1)):
        assert values.max() <= bound * (1 + 1e-9)
        assert values.max() > 0.9 * bound
        assert values.mean() == pytest.approx(0.5 * bound, rel=0.15)
    products = copies[:, :3, :3] @ copies[:, :3, :3].transpose(0, 2, 1)
    np.testing.assert_allclose(products, np.eye(3)[None].repeat(200, 0), atol=1e-12)


def test_reach_is_the_hand_s_own() -> None:
    """The ReFlex's fingers are 105 mm long and bend while they close; the jaw's do not turn, and end where they are."""
    assert reach_of(graspbox.load_hand("reflex"), 0.0) == pytest.approx(0.09, abs=0.005)
    assert reach_of(graspbox.load_hand("panda_gripper"), 0.0) == pytest.approx(0.0463, abs=0.001)


@pytest.mark.parametrize("hand", graspbox.Hand.names())
def test_sampled_poses_are_feasible_and_reproducible(hand: str) -> None:
    scene = graspbox.Scene(graspbox.object_sets.load("procedural:box:1")[0].load(), hand=hand)
    for source in ("random", "planner", "planner-any"):
        first, again = (judge.sample_trials(scene, 6, np.random.default_rng(3), source) for _ in range(2))
        assert first is not None
        assert again is not None
        np.testing.assert_array_equal(first[0], again[0])
        assert "infeasible" not in scene.simulate(*first).failure


def row(core: list[int], mujoco: list[int]) -> judge.RobustRow:
    return judge.RobustRow("box", [bool(x) for x in core], [bool(x) for x in core], [bool(x) for x in mujoco])


def test_facts_of_known_copies() -> None:
    rows = [row([1, 1], [1, 1]), row([1, 0], [0, 1]), row([0, 0], [0, 0]), row([1, 1], [1, 0])]
    facts = judge.RobustReport(rows, []).facts()
    assert facts["mean_share"] == {"core": 5 / 8, "core_half": 5 / 8, "mujoco": 4 / 8}
    pair = facts["core / mujoco"]
    assert pair["equal"] == 5 / 8
    assert pair["bias"] == 1 / 8
    assert pair["mean_difference"] == 1 / 8
    # Ranks 3.5, 2, 1, 3.5 and 4, 2.5, 1, 2.5.
    assert pair["spearman"] == pytest.approx(5 / 6)
    assert facts["core / core_half"]["spearman"] == pytest.approx(1.0)
    assert judge.RobustReport(rows[:1], []).facts()["core / mujoco"]["spearman"] is None


def test_a_finished_object_is_not_tried_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "kept.json"
    how = judge.Perturbation(replays=2)
    asked = {"objects": ["procedural:can:0"], "grasps": 1, "how": how, "resume": path}
    first = judge.compare_robust(**asked)  # type: ignore[arg-type]
    assert first.facts()["replays"] == 2
    monkeypatch.setattr(robust, "_try", None)
    assert judge.compare_robust(**asked).rows == first.rows  # type: ignore[arg-type]
    with pytest.raises(ConfigError, match="other settings"):
        judge.compare_robust(**{**asked, "seed": 1})  # type: ignore[arg-type]
    path.write_text("[]")
    with pytest.raises(FileError, match="not the results of a robust comparison"):
        judge.compare_robust(**asked)  # type: ignore[arg-type]


def test_the_command_prints_the_report(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    import validation.mujoco.robust_command as command

    report = judge.RobustReport([row([1, 1], [1, 1]), row([1, 0], [0, 0])], ["ball"])
    monkeypatch.setattr(command, "compare_robust", lambda *_, **__: report)
    assert main(["robust", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["core / mujoco"]["bias"] == 0.25
    assert main(["robust"]) == 0
    assert "left out: ['ball']" in capsys.readouterr().out
    assert main(["robust", "--grasps", "1"]) == 0
    monkeypatch.undo()
    assert main(["robust", "--replays", "0"]) == 2
    assert "give at least 1 replay" in capsys.readouterr().err
