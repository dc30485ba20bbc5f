"""The search for a hand's posture: which text of its files it changes, and what it counts."""

import numpy as np
import pytest

import graspbox
from graspbox.errors import ConfigError
from test_scripts import script

search_posture = script("search_posture")
Text = search_posture.Text

FINGERS = "index+middle+ring+pinky"


def test_the_numbers_of_one_preshape_and_of_the_frame_change() -> None:
    hand = graspbox.load_hand("inspire")
    text = Text.of(hand, "pinch", [FINGERS, "thumb"], turn=True)
    start, deviations = text.start()
    assert len(start) == len(deviations) == 6
    np.testing.assert_allclose(start, [0.23, 0.0, -0.011, -0.007, 0.066, 0.0])
    same = text.hand(start)
    assert same.preshapes == {"pinch": 0.0}
    np.testing.assert_allclose(same.open(0.0), hand.open(hand.preshapes["pinch"]), atol=1e-9)
    other = text.hand(start + np.array([0.1, 0.2, 0.0, 0.0, 0.01, np.pi / 2]))
    moved = dict(zip(other.joints, other.open(0.0) - same.open(0.0), strict=True))
    assert [moved[f"{finger}_proximal_joint"] for finger in FINGERS.split("+")] == pytest.approx([0.1] * 4)
    assert moved["thumb_proximal_pitch_joint"] == pytest.approx(0.2)
    assert moved["thumb_proximal_yaw_joint"] == pytest.approx(0.0)
    assert other.closing_center(0.0)[2] == pytest.approx(0.076)
    (before, *_), (after, *_) = same.shapes(same.open(0.0)), other.shapes(same.open(0.0))
    # The palm, seen from a frame turned by a quarter about y: its z axis is the former x axis.
    np.testing.assert_allclose(after[0, 2, :3], before[0, 0, :3], atol=1e-5)


def test_positions_beyond_a_joint_are_worth_nothing() -> None:
    text = Text.of(graspbox.load_hand("inspire"), "pinch", ["thumb"], turn=False)
    start, _ = text.start()
    assert search_posture._judge(text, start + np.array([9.0, 0.0, 0.0, 0.0])) == (-1.0, {})


def test_what_a_file_does_not_have_is_named() -> None:
    hand = graspbox.load_hand("leap")
    with pytest.raises(ConfigError, match="--preshape is 'hook'; choose from pinch"):
        Text.of(hand, "hook", [], turn=False)
    with pytest.raises(ConfigError, match=r"no row 'positions.thumb = { value"):
        Text.of(hand, "pinch", ["thumb"], turn=False)


def test_shares_of_proposals_that_hold() -> None:
    """A gripper holds many of a wooden block's proposals; the value is the mean of roots over families."""
    hand = graspbox.load_hand("panda_gripper")
    found = search_posture.shares(hand, search_posture.resting_objects("procedural:wood_block:2", hand))
    held, firm = found["wood_block"]
    assert 0.3 < held <= 1.0
    assert 0.0 < firm <= held
    assert search_posture.value({"a": (0.25, 0.0), "b": (1.0, 1.0)}) == pytest.approx((0.5 + 1.5) / 2)
