"""Maps of what an arm reaches around its base, and the place of a base for a workspace."""

import json
from pathlib import Path

import numpy as np
import pytest

from graspbox import arms, errors, planning
from graspbox.arms import ReachMap
from graspbox.planning import TypicalGrasps


@pytest.fixture(scope="module")
def grasps() -> TypicalGrasps:
    return planning.typical_grasps("panda_gripper", each=1)


@pytest.fixture(scope="module")
def mapped(grasps: TypicalGrasps) -> ReachMap:
    return arms.reach_map("fr3", "panda_gripper", grasps.poses, grasps.preshape, spacing=0.1)


def test_typical_grasps_come_from_above_and_from_the_side(grasps: TypicalGrasps) -> None:
    down = -grasps.poses[:, 2, 2]
    assert 2 <= grasps.above.sum() < len(grasps.poses) <= 8
    assert (down[grasps.above] > 0.8).all()
    assert (np.abs(down[~grasps.above]) < 0.5).all()
    # The things stand on the origin: the hands are above the table and near them.
    assert (grasps.poses[:, 2, 3] > 0).all()
    assert (np.linalg.norm(grasps.poses[:, :2, 3], axis=1) < 0.25).all()
    with pytest.raises(errors.ConfigError, match="each is 0; pass 1 or more"):
        planning.typical_grasps("panda_gripper", each=0)


def test_the_map_is_what_reachable_says(grasps: TypicalGrasps, mapped: ReachMap) -> None:
    assert mapped.share.shape == (len(mapped.y), len(mapped.x))
    assert mapped.grasps == 4 * len(grasps.poses)
    # At the base and beyond the arm nothing is reached, before it all from above.
    assert mapped.at([0.0, 0.0]) < 0.3
    assert mapped.at([[5.0, 0.0], [0.0, -1.5]]).tolist() == [0.0, 0.0]
    row, column = np.argmin(np.abs(mapped.y)), np.argmin(np.abs(mapped.x - 0.5))
    assert mapped.above[row, column] == 1.0
    assert mapped.at([mapped.x[column], 0.0]) == pytest.approx(mapped.share[row, column])
    between = 0.5 * (mapped.share[row, column] + mapped.share[row, column + 1])
    assert mapped.at([mapped.x[column] + 0.05, 0.0]) == pytest.approx(between)
    mixed = mapped.above * grasps.above.mean() + mapped.side * (1 - grasps.above.mean())
    np.testing.assert_allclose(mixed, mapped.share, atol=1e-12)
    again = arms.reach_map("fr3", "panda_gripper", grasps.poses, grasps.preshape, spacing=0.1, num_threads=1)
    assert again == mapped
    other = arms.reach_map("fr3", "panda_gripper", grasps.poses, grasps.preshape, spacing=0.1, seed=1)
    assert not np.array_equal(other.share, mapped.share)


def test_the_best_base_reaches_what_the_map_promises(grasps: TypicalGrasps, mapped: ReachMap) -> None:
    low, high = np.array([-0.2, -0.1]), np.array([0.2, 0.2])
    place = mapped.best_base(low, high)
    away = np.maximum(np.maximum(low - [place.x, place.y], [place.x, place.y] - high), 0.0)
    assert 0.15 <= np.linalg.norm(away) < 0.8
    assert 0 < place.least <= place.share <= 1

    def share(base: np.ndarray) -> float:
        random, reached = np.random.default_rng(3), []
        for _ in range(40):
            turn, angle = np.eye(4), random.uniform(0, 2 * np.pi)
            turn[:2, :2] = [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
            turn[:2, 3] = random.uniform(low, high)
            reached.append(arms.reachable("fr3", "panda_gripper", turn @ grasps.poses, grasps.preshape, base).reached)
        return float(np.mean(reached))

    assert share(place.pose) == pytest.approx(place.share, abs=0.1)
    # Better than twice as far away.
    far = place.pose
    far[:2, 3] *= 2
    assert share(far) < place.share - 0.1
    for wrong, message in [
        (((0.0, 0.0), (0.0, 1.0)), "pass x and y of the lower, then the upper corner"),
        (((0.0, 0.0), (100.0, 100.0)), "pass at most 10000 cells of 0.1 m"),
    ]:
        with pytest.raises(errors.ConfigError, match=message):
            mapped.best_base(*wrong)


def test_wrong_arguments_are_named(grasps: TypicalGrasps) -> None:
    given = ("fr3", "panda_gripper", grasps.poses, grasps.preshape)
    for wrong, message in [
        ({"spacing": 0.0}, "spacing is 0.0, turns is 4; pass 0 to 0.5 m"),
        ({"turns": 0}, "turns is 0; pass .* 1 to 360 turns"),
        ({"spacing": 0.002}, r"a map of \d+ poses is too large"),
        ({"height": -0.5}, "the base of the arm is at z = -0.500 m, under the table"),
    ]:
        with pytest.raises(errors.ConfigError, match=message):
            arms.reach_map(*given, **wrong)  # type: ignore[arg-type]
    with pytest.raises(errors.ConfigError, match=r"pass \(n, 4, 4\) and \(n,\), n > 0"):
        arms.reach_map("fr3", "panda_gripper", np.zeros((0, 4, 4)), [])


def test_the_command_maps_and_places(tmp_path: Path) -> None:
    pytest.importorskip("matplotlib", reason="pictures need the extra 'cli'")
    from command_line import invoke

    words = ["arm", "map", "ur5e", "--hand", "robotiq_2f_85", "--spacing", "0.15", "--turns", "2"]
    result = invoke([*words, "--workspace", "-0.2", "-0.2", "0.2", "0.2", "--out", tmp_path / "map.png", "--json"])
    assert result.exit_code == 0, result.output
    told = json.loads(result.stdout)
    assert (told["arm"], told["hand"]) == ("ur5e", "robotiq_2f_85")
    assert np.shape(told["share"]) == np.shape(told["above"]) == (len(told["y"]), len(told["x"]))
    assert told["best_base"]["share"] > 0.3
    assert (tmp_path / "map.png").stat().st_size > 5000
    plain = invoke([*words, "--objects", "procedural:can:0-1"])
    assert "share of 16 grasps that is reached" in plain.stdout.replace("\n", " ")
