"""Anchors of grasps: poses are recovered from their nearest anchor; interpolation weights; mirroring."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from graspbox import errors
from graspbox.perception import CropConfig, HandGrid
from graspbox.perception.anchors import AnchorConfig, Anchors

ANCHORS = Anchors(3)
LAST = np.array([*(n - 1 for n in (ANCHORS.config.cells, ANCHORS.config.cells, ANCHORS.config.heights))])
MIRROR = np.diag([1.0, -1.0, 1.0, 1.0])


def random_places(seed: int, count: int = 64) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.int64]]:
    """Draw places, tilts and preshapes among the anchors."""
    rng = np.random.default_rng(seed)
    place = rng.uniform(-0.49, [*(LAST + 0.49), ANCHORS.config.rolls - 0.51], (count, 4))
    angle, radius = rng.uniform(0, 2 * np.pi, count), ANCHORS.config.max_tilt * rng.random(count) * 0.999
    tilt = np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=1)
    return place, tilt, rng.integers(3, size=count)


@settings(max_examples=40, deadline=None)
@given(seed=st.integers(0, 2**32))
def test_poses_come_back(seed: int) -> None:
    place, tilt, preshape = random_places(seed)
    poses = ANCHORS.poses(place, tilt)
    np.testing.assert_allclose(
        poses[:, :3, :3] @ poses[:, :3, :3].swapaxes(1, 2), np.tile(np.eye(3), (64, 1, 1)), atol=1e-12
    )
    np.testing.assert_allclose(np.linalg.det(poses[:, :3, :3]), 1.0, atol=1e-12)
    index, residual, inside = ANCHORS.encode(poses, preshape)
    assert inside.all()
    assert (np.abs(residual[:, :4]) <= 0.5).all()
    assert (np.linalg.norm(residual[:, 4:], axis=1) <= 1.0).all()
    decoded, found = ANCHORS.decode(index, residual)
    np.testing.assert_allclose(decoded, poses, atol=1e-9)
    np.testing.assert_array_equal(found, preshape)
    # Without residuals it is the anchor, half a step away at most.
    grid, _ = ANCHORS.decode(index)
    straight = ANCHORS.poses(place, np.zeros_like(tilt))
    apart = np.abs(grid[:, :3, 3] - straight[:, :3, 3])
    assert apart.max() <= 0.5 * ANCHORS.config.spacing + 1e-12
    np.testing.assert_allclose(grid[:, :3, 2], np.tile([0.0, 0.0, -1.0], (64, 1)), atol=1e-12)


def test_the_grasp_point_is_between_the_fingers_and_tilts_leave_it_there() -> None:
    place, tilt, _ = random_places(1)
    point = ANCHORS.poses(place, tilt) @ np.array([0.0, 0.0, ANCHORS.config.reach, 1.0])
    spacing = ANCHORS.config.spacing
    np.testing.assert_allclose(point[:, 0], (place[:, 0] - LAST[0] / 2) * spacing, atol=1e-12)
    np.testing.assert_allclose(point[:, 2], ANCHORS.config.lowest + place[:, 2] * spacing, atol=1e-12)
    angle = np.arccos(-ANCHORS.poses(place, tilt)[:, 2, 2])
    np.testing.assert_allclose(angle, np.linalg.norm(tilt, axis=1), atol=1e-7)


def test_what_is_outside_is_said_to_be() -> None:
    place, tilt = np.tile([[8.0, 8.0, 6.0, 3.0]], (5, 1)), np.zeros((5, 2))
    place[1, 0], place[2, 2], place[3, 2] = -0.6, -0.6, LAST[2] + 0.6
    tilt[4, 1] = ANCHORS.config.max_tilt + 0.01
    inside = ANCHORS.encode(ANCHORS.poses(place, tilt), np.zeros(5, dtype=np.int64))[2]
    assert inside.tolist() == [True, False, False, False, False]


def test_a_mirrored_grasp_has_the_mirrored_anchor() -> None:
    place, tilt, preshape = random_places(2)
    poses = ANCHORS.poses(place, tilt)
    index, residual, _ = ANCHORS.encode(poses, preshape)
    other, opposite, _ = ANCHORS.encode(MIRROR @ poses @ MIRROR, preshape)
    np.testing.assert_array_equal(other, ANCHORS.mirrored(index))
    # y, roll and the tilt about x change their signs.
    np.testing.assert_allclose(opposite, residual * [1, -1, 1, -1, -1, 1], atol=1e-9)
    np.testing.assert_array_equal(ANCHORS.mirrored(ANCHORS.mirrored(index)), index)


def test_mirrored_scenes_have_mirrored_reach() -> None:
    """Anchors reachable in a scene are, mirrored, reachable in the mirrored scene."""
    grid = HandGrid()
    assert (grid.swept == grid.swept[:, :, ::-1]).all()
    rng = np.random.default_rng(0)
    n = CropConfig().resolution
    solid = np.zeros((n, n, n), dtype=np.uint8)
    solid[20:26, 22:35, 2:9] = 255
    index = rng.integers(len(ANCHORS), size=4000)
    poses, preshape = ANCHORS.decode(index)
    other, same = ANCHORS.decode(ANCHORS.mirrored(index))
    np.testing.assert_array_equal(same, preshape)
    free, fingers = grid.meets(solid, poses, grid.preshapes[preshape])
    again, met = grid.meets(np.ascontiguousarray(solid[:, ::-1]), other, grid.preshapes[preshape])
    assert 100 < int((free & (fingers >= 2)).sum()) < 3900
    # The surface of the volume is sampled, and not in mirrored order: a touch by a hair may be missed.
    assert (free == again).mean() > 0.99
    assert ((fingers >= 2) == (met >= 2)).mean() > 0.99


def test_settings_out_of_range_are_refused() -> None:
    for given_, field in (
        ({"cells": 15}, "cells"),
        ({"rolls": 1}, "rolls"),
        ({"heights": 1}, "heights"),
        ({"spacing": 0.0}, "spacing"),
        ({"reach": float("nan")}, "reach"),
        ({"max_tilt": 1.6}, "max_tilt"),
    ):
        with pytest.raises(errors.ConfigError, match=field):
            AnchorConfig(**given_)
    with pytest.raises(errors.ConfigError, match="do not fit"):
        AnchorConfig(spacing=0.02).check(CropConfig())


def test_outputs_of_a_damaged_head_are_refused() -> None:
    index, residual, scores = np.arange(4), np.zeros((4, 6), dtype=np.float32), np.ones(4, dtype=np.float32)
    assert len(ANCHORS.candidates(index, residual, scores).scores) == 4
    for wrong in ((index, residual * np.float32(np.nan), scores), (index, residual, scores * np.float32(np.inf))):
        with pytest.raises(errors.ConfigError, match="outputs of the head are not finite; its network is damaged"):
            ANCHORS.candidates(*wrong)
    with pytest.raises(errors.ConfigError, match="the head returns anchors from -1 to 2, and there are"):
        ANCHORS.candidates(index - 1, residual, scores)
