"""Settings of perception that follow from a hand; symmetries of hands, in geometry, cells and simulation."""

from dataclasses import replace

import numpy as np
import pytest

import graspbox
from graspbox import object_sets
from graspbox.hands import asymmetries_of, corners_of, load_hand, reach_of, symmetries_of
from graspbox.perception import CropConfig, HandGrid, HandGridConfig, ProposalConfig
from graspbox.perception.anchors import AnchorConfig
from graspbox.perception.hand_settings import seeing_both_sides, settings_of
from graspbox.perception.inputs.scorer import ScorerInputs
from graspbox.simulation import Scene

MIRROR_Y, MIRROR_X, HALF_TURN = (1.0, -1.0, 1.0), (-1.0, 1.0, 1.0), (-1.0, -1.0, 1.0)
SYMMETRIES = {
    "reflex": (MIRROR_Y,),
    "panda_gripper": (MIRROR_Y, MIRROR_X, HALF_TURN),
    "robotiq_2f_85": (MIRROR_Y, MIRROR_X, HALF_TURN),
    "soft_hand": (),
    "leap": (),
    "inspire": (),
}


def test_the_defaults_are_those_of_the_reflex() -> None:
    found = settings_of("reflex")
    assert found.proposals == ProposalConfig()
    assert found.anchors == AnchorConfig()
    assert found.grid == HandGridConfig()


@pytest.mark.parametrize("hand", graspbox.Hand.names())
def test_lengths_follow_the_reach(hand: str) -> None:
    """The grasp point lies within the fingers' reach, and every distance of the palm leaves something in reach."""
    found, loaded = settings_of(hand), load_hand(hand)
    reach = max(reach_of(loaded, preshape) for preshape in loaded.preshapes.values())
    assert 0.8 * reach < found.anchors.reach < reach
    assert max(found.proposals.standoffs) < reach
    # The hand at the lowest anchor: above the table, and nearer to it than the fingers are long.
    assert 0.0 < found.anchors.lowest + found.anchors.reach <= reach + 1e-3


@pytest.mark.parametrize(("hand", "clearance"), [("panda_gripper", 0.0), ("robotiq_2f_85", 0.0), ("soft_hand", 0.002)])
def test_fingers_that_point_forward_need_all_their_room(hand: str, clearance: float) -> None:
    assert settings_of(hand).grid.clearance == clearance


def test_a_box_nearly_as_wide_as_the_opening_is_grasped() -> None:
    """The clearance of the ReFlex would leave no grasp from above: 75 mm between fingers 80 mm apart."""
    occupancy = np.zeros((48, 48, 48), dtype=np.uint8)
    occupancy[18:30, 17:31, 2:7] = 255
    fitted = settings_of("panda_gripper")

    def from_above(grid: HandGrid) -> int:
        return int((grid.propose(occupancy, fitted.proposals).poses[:, 2, 2] < -0.99).sum())

    assert from_above(HandGrid("panda_gripper", fitted.grid)) > 0
    assert from_above(HandGrid("panda_gripper")) == 0


def test_proposals_close_across_the_shorter_side_of_a_wide_box() -> None:
    """68 mm across and 85 mm long, at any yaw: a narrow look sees no side of it, and closes anywhere."""
    fitted, crop = settings_of("panda_gripper"), CropConfig()
    wide = seeing_both_sides(fitted.proposals, load_hand("panda_gripper"))
    grid, n = HandGrid("panda_gripper", fitted.grid), crop.resolution
    cells = np.stack(np.meshgrid(*[np.arange(n)] * 3, indexing="ij"), axis=-1)
    at = np.array(crop.origin) + (cells + 0.5) * crop.voxel_size

    def aligned(yaw: float, proposals: ProposalConfig) -> int:
        long, short = np.array([np.cos(yaw), np.sin(yaw), 0.0]), np.array([-np.sin(yaw), np.cos(yaw), 0.0])
        inside = (np.abs(at @ long) < 0.0425) & (np.abs(at @ short) < 0.034) & (at[..., 2] > 0) & (at[..., 2] < 0.03)
        poses = grid.propose((255 * inside).astype(np.uint8), replace(proposals, boxes=0)).poses
        across = np.abs(poses[poses[:, 2, 2] < -0.99][:, :3, 0] @ short)
        return int((across > np.cos(np.radians(15))).sum())

    yaws = np.radians(np.arange(0.0, 90.0, 11.25))
    found, others = (sum(aligned(yaw, proposals) for yaw in yaws) for proposals in (wide, fitted.proposals))
    assert found > 2 * others
    # The ReFlex states no opening.
    assert seeing_both_sides(ProposalConfig(), load_hand("reflex")) == ProposalConfig()


@pytest.mark.parametrize("hand", graspbox.Hand.names())
def test_symmetries_of_hands(hand: str) -> None:
    assert symmetries_of(load_hand(hand)) == HandGrid(hand).symmetries == SYMMETRIES[hand]


def test_cylinders_may_be_turned_about_their_axes() -> None:
    """A round palm leaves the gripper its symmetries, whichever way it is turned; a square one does not."""
    urdf, toml = load_hand("panda_gripper").files
    box, place = '<box size="0.063 0.204 0.066"/>', '<origin xyz="0 0 0.033"/>'
    assert box in urdf
    assert place in urdf
    turned = '<origin xyz="0 0 0.033" rpy="0 0 0.0982"/>'
    for shape, start, symmetric in (
        ('<cylinder radius="0.05" length="0.066"/>', place, True),
        ('<cylinder radius="0.05" length="0.066"/>', turned, True),
        ('<box size="0.1 0.1 0.066"/>', place, True),
        ('<box size="0.1 0.1 0.066"/>', turned, False),
    ):
        hand = graspbox.Hand(urdf.replace(box, shape).replace(place, start), toml)
        moved = asymmetries_of(hand)
        assert (MIRROR_Y in symmetries_of(hand)) == (MIRROR_X in symmetries_of(hand)) == symmetric, (shape, start)
        assert moved[HALF_TURN] < 1e-6
        assert (moved[MIRROR_Y] < 1e-6) == symmetric
    # A corner of the square is 70.7 mm from the axis, and the mirror turns it by twice 0.0982 rad.
    assert moved[MIRROR_Y] == pytest.approx(2 * 0.0707 * np.sin(0.0982), rel=1e-3)


def test_corners_of_palm_and_fingers_are_all_corners() -> None:
    hand = load_hand("reflex")
    parts = {part: corners_of(hand, hand.open(0.0), part) for part in ("all", "palm", "fingers")}
    assert len(parts["all"]) == len(parts["palm"]) + len(parts["fingers"])
    assert len(parts["palm"]) % 8 == 0 < len(parts["palm"]) < len(parts["all"])


@pytest.mark.parametrize("hand", ["reflex", "panda_gripper"])
def test_reflected_inputs_are_those_of_the_reflected_scene(hand: str) -> None:
    """Cells of a mirrored crop, at the mirrored pose, are the mirrored cells; a half turn leaves the crop as it is."""
    rng = np.random.default_rng(0)
    volume = rng.integers(0, 256, (1, 3, 48, 48, 48), dtype=np.uint8)
    inputs = ScorerInputs(HandGrid(hand))
    mirror = np.diag([1.0, -1.0, 1.0, 1.0])
    pose = np.eye(4)
    pose[:3, :3] = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    pose[:3, 0] *= np.linalg.det(pose[:3, :3])
    pose[:3, 3] = (0.01, -0.02, 0.12)
    here = np.zeros(1, dtype=np.int64)
    own = inputs.make(volume, here, pose[None], np.zeros(1))
    expected = [own]
    for signs in SYMMETRIES[hand]:
        turned = pose @ np.diag([*signs, 1.0])
        if np.prod(signs) < 0.0:
            turned = mirror @ turned
        seen = volume[:, :, :, ::-1] if np.prod(signs) < 0.0 else volume
        expected.append(inputs.make(np.ascontiguousarray(seen), here, turned[None], np.zeros(1)))
    found = set()
    for seed in range(40):
        some = inputs.reflected(own, np.random.default_rng(seed))
        apart = [np.abs(some.cells.astype(int) - one.cells.astype(int)).max() for one in expected]
        match = int(np.argmin(apart))
        assert apart[match] <= 1
        np.testing.assert_allclose(some.poses[0, 2], expected[match].poses[0, 2], atol=1e-6)
        found.add(match)
    assert found == set(range(len(expected)))


def test_a_half_turn_does_not_change_a_grasp_of_a_gripper() -> None:
    mesh = object_sets.load("procedural:box:3")[0].load()
    scene = Scene(mesh, hand="panda_gripper")
    plan = graspbox.plan(mesh, hand="panda_gripper", world_from_object=scene.world_from_object).best(24)
    turned = plan.poses @ np.diag([*HALF_TURN, 1.0])
    own, other = (scene.simulate(poses, plan.preshape) for poses in (plan.poses, turned))
    assert own.success.sum() > 0
    assert (own.success == other.success).mean() >= 0.95
