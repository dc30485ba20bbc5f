"""Random hands of families, grids of a set shape, and numbers that describe a hand."""

import math
from dataclasses import replace

import numpy as np
import pytest

from graspbox import object_sets
from graspbox.errors import ConfigError
from graspbox.hand_tools import check_hand
from graspbox.hands import Hand, load_hand
from graspbox.learn.random_hands import FAMILIES, random_hand
from graspbox.perception import HandGrid, HandGridConfig
from graspbox.perception.hand_settings import settings_of
from graspbox.perception.inputs.hand_numbers import HAND_NUMBERS, hand_numbers
from graspbox.planning import plan
from graspbox.simulation import Scene

SHAPE = (24, 24, 16)


@pytest.mark.parametrize("family", FAMILIES)
def test_a_number_determines_a_hand(family: str) -> None:
    hands = [random_hand(family, number) for number in range(12)]
    assert hands == [random_hand(family, number) for number in range(12)]
    assert len({hand.files for hand in hands}) == 12
    assert [hand.name for hand in hands] == [f"{family}-{number}" for number in range(12)]


@pytest.mark.parametrize("family", FAMILIES)
def test_random_hands_pass_the_checks(family: str) -> None:
    for number in range(12):
        report = check_hand(random_hand(family, number), trials=False)
        assert {finding.severity for finding in report.findings} <= {"note"}, report


def test_families_differ_in_fingers_and_size() -> None:
    jaws, fingers = ([random_hand(family, number) for number in range(30)] for family in ("jaws", "fingers"))
    assert {(len(hand.chains), len(hand.joints)) for hand in jaws} == {(2, 1)}
    widths = [hand.widest for hand in jaws]
    assert 0.038 < min(widths) < 0.055 < 0.095 < max(widths) < 0.11
    assert {len(hand.chains) for hand in fingers} == {2, 3, 4, 5, 6}
    assert max(len(hand.joints) for hand in fingers) >= 8


@pytest.mark.parametrize("family", FAMILIES)
def test_random_hands_grasp(family: str) -> None:
    """Most of them lift a small box at one of the planner's poses."""
    mesh = object_sets.load("procedural:box:3")[0].load()
    lifted = 0
    for number in range(6):
        hand = random_hand(family, number)
        scene = Scene(mesh, hand=hand)
        found = plan(mesh, hand=hand, world_from_object=scene.world_from_object)
        if len(found):
            lifted += bool(scene.simulate(found.poses[:40], found.preshape[:40]).success.any())
    assert lifted >= 3


def test_hands_out_of_range_are_named() -> None:
    with pytest.raises(ConfigError, match="no family of hands 'claws'; choose from jaws, fingers"):
        random_hand("claws", 0)
    with pytest.raises(ConfigError, match="number of a hand is -1"):
        random_hand("jaws", -1)


@pytest.mark.parametrize("hand", Hand.names())
def test_a_grid_of_a_set_shape_holds_what_the_fingers_sweep(hand: str) -> None:
    """As much of the hand as in the grid that it needs, in cells that are larger where it is."""
    settings = settings_of(hand, shape=SHAPE)
    grid, own = HandGrid(hand, settings.grid), HandGrid(hand, replace(settings.grid, shape=None))
    assert grid.shape == SHAPE
    assert grid.cell >= own.cell
    volume, expected = ((g.swept > 0).sum() * g.cell**3 for g in (grid, own))
    assert volume == pytest.approx(expected, rel=0.25)
    # It is no larger than it must be: along one axis the volume leaves a cell free on either side.
    extent = np.array(own.shape) * own.cell
    assert (grid.cell == own.cell) or (extent > (np.array(SHAPE) - 2 - 8) * grid.cell).any()


@pytest.mark.parametrize(
    ("shape", "message"),
    [((24, 20, 16), r"shape\[1\] is 20; give a multiple of 8"), ((0, 8, 8), "0"), ((72, 8, 8), "72")],
)
def test_shapes_out_of_range_are_refused(shape: tuple[int, int, int], message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        HandGrid("reflex", HandGridConfig(shape=shape))


def test_numbers_of_the_franka_hand() -> None:
    """Opening 80 mm less 2 mm, 140 N over 40 mm."""
    grid = HandGrid("panda_gripper", settings_of("panda_gripper", shape=SHAPE).grid)
    (row,) = hand_numbers(grid).tolist()
    found = dict(zip(HAND_NUMBERS, row, strict=True))
    assert found["width, dm"] == pytest.approx(0.78)
    assert found["chains / 4"] == 0.5
    assert found["closing motors / 4"] == 0.25
    assert found["log10 of the closing work, J"] == pytest.approx(math.log10(140 * 0.04))
    assert found["log10 of the path, m"] == pytest.approx(math.log10(0.04))
    assert found["friction of pads"] == 1.0


def test_numbers_of_a_hand_with_tendons() -> None:
    """Three spools of 12.5 mm pull with 50 N over 3.6 rad; there is a row for each preshape."""
    rows = hand_numbers(HandGrid("reflex", settings_of("reflex", shape=SHAPE).grid))
    assert rows.shape == (3, len(HAND_NUMBERS))
    work = list(HAND_NUMBERS).index("log10 of the closing work, J")
    np.testing.assert_allclose(rows[:, work], math.log10(3 * 50 * 0.0125 * 3.6), rtol=1e-6)


def test_numbers_of_hands_are_of_order_one() -> None:
    hands = [*map(load_hand, Hand.names()), *(random_hand(family, 3) for family in FAMILIES)]
    rows = np.concatenate([hand_numbers(HandGrid(hand, settings_of(hand, shape=SHAPE).grid)) for hand in hands])
    assert np.isfinite(rows).all()
    assert np.abs(rows).max() <= 2.5
