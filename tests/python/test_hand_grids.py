"""The hand as perception sees it: its grid, voxels around it, collisions and proposals."""

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import graspbox
from graspbox import errors, object_sets
from graspbox.perception import CropConfig, HandGrid, HandGridConfig, ProposalConfig, solid_occupancy
from graspbox.perception.perturbations import perturbed

N = CropConfig().resolution
H = CropConfig().voxel_size


@pytest.fixture(scope="module")
def grid() -> HandGrid:
    return HandGrid()


def box(sides: tuple[float, float, float]) -> NDArray[np.uint8]:
    """Occupancy of a box on the table, in the middle of the crop."""
    centers = np.array(CropConfig().origin) + (np.stack(np.meshgrid(*[np.arange(N)] * 3, indexing="ij"), -1) + 0.5) * H
    low, high = np.array([-sides[0] / 2, -sides[1] / 2, 0.0]), np.array([sides[0] / 2, sides[1] / 2, sides[2]])
    inside = ((centers > low) & (centers < high)).all(axis=-1)
    return np.asarray(inside * 255, dtype=np.uint8)


def pose_at(position: tuple[float, float, float], downward: bool = True) -> NDArray[np.float64]:
    pose = np.eye(4)
    if downward:
        pose[:3, :3] = np.diag([1.0, -1.0, -1.0])
    pose[:3, 3] = position
    return pose


@pytest.mark.parametrize("hand", graspbox.Hand.names())
def test_a_grid_holds_what_the_fingers_sweep(hand: str) -> None:
    grid = HandGrid(hand)
    loaded = graspbox.load_hand(hand)
    assert all(n % 8 == 0 for n in grid.shape)
    assert sorted(grid.preshapes) == sorted(loaded.preshapes.values())
    assert grid.swept.shape == (len(grid.preshapes), *grid.shape)
    for preshape, swept in zip(grid.preshapes, grid.swept, strict=True):
        # Every part of a chain that closes is in a cell that it sweeps, no later than it comes there.
        for share in (0.0, 0.3, 0.6, 1.0):
            frames, _, _, joints = loaded.shapes(loaded.closed(preshape, share))
            for frame in frames[joints >= 0]:
                cell = np.floor((frame[:3, 3] - grid.origin) / grid.cell).astype(int)
                if ((cell >= 0) & (cell < grid.shape)).all() and share > 0.25:
                    near = swept[tuple(slice(max(0, i - 1), i + 2) for i in cell)]
                    assert near.max() >= 255 - round(share * 191) - 3
        assert set(np.unique(swept).tolist()) <= {0, *range(64, 256)}


def test_voxels_around_a_hand_are_interpolated_exactly_where_the_crop_is_linear(grid: HandGrid) -> None:
    # A linear function of the place is its own interpolation.
    ramp = np.arange(N) * 5
    volume = np.zeros((1, 3, N, N, N), dtype=np.uint8)
    volume[0, 0] = ramp[:, None, None]
    volume[0, 1] = ramp[None, :, None]
    volume[0, 2] = ramp[None, None, :]
    rng = np.random.default_rng(0)
    poses = perturbed(np.stack([pose_at((0.02, -0.01, 0.16))] * 20), rng, 0.02, 0.4)
    found = grid.crops(volume, np.zeros(20, dtype=int), poses)
    assert found.shape == (20, 4, *grid.shape)
    index = np.stack(np.meshgrid(*[np.arange(n) for n in grid.shape], indexing="ij"), -1)
    cells = grid.origin + (index + 0.5) * grid.cell
    for pose, channels in zip(poses, found, strict=True):
        points = cells @ pose[:3, :3].T + pose[:3, 3]
        voxels = (points - np.array(CropConfig().origin)) / H - 0.5
        inside = ((voxels > 1e-3) & (voxels < N - 1 - 1e-3)).all(axis=-1)
        assert inside.sum() > 2000
        for axis in range(3):
            expected = np.clip(voxels[..., axis], 0, N - 1) * 5
            np.testing.assert_allclose(channels[axis][inside], expected[inside], atol=2.0)
        outside = ((voxels < -1e-3) | (voxels > N - 1 + 1e-3)).any(axis=-1)
        assert not channels[:3, outside].any()
        table = np.clip(0.5 - points[..., 2] / grid.cell, 0, 1) * 255
        np.testing.assert_allclose(channels[3], table, atol=1.0)


def test_each_pose_is_sampled_in_its_own_crop(grid: HandGrid) -> None:
    volumes = np.zeros((2, 3, N, N, N), dtype=np.uint8)
    volumes[1, 0] = 200
    poses = np.stack([pose_at((0.0, 0.0, 0.14))] * 3)
    found = grid.crops(volumes, [1, 0, 1], poses)
    np.testing.assert_array_equal(found[0], found[2])
    assert not found[1, 0].any()
    assert found[0, 0].max() == 200
    with pytest.raises(errors.ConfigError, match="crop_of holds 2"):
        grid.crops(volumes, [2], poses[:1])
    with pytest.raises(errors.ConfigError, match="float64"):
        grid.crops(volumes / 255.0, [0], poses[:1])


def test_collisions_are_those_of_the_simulation(grid: HandGrid) -> None:
    """The look-up and the exact filter of the simulation disagree only where the hand almost touches."""
    mesh = object_sets.load("procedural:box:1")[0].load()
    scene = graspbox.Scene(mesh)
    rng = np.random.default_rng(0)
    occupancy = solid_occupancy([mesh], [0], scene.world_from_object[None])[0]
    proposals = grid.propose(occupancy)
    poses = perturbed(np.repeat(proposals.poses, 3, axis=0), rng, 0.02, 0.3)
    preshape = np.repeat(proposals.preshape, 3)
    free, fingers = grid.meets(occupancy, poses, preshape)
    outcomes = scene.simulate(np.linalg.inv(scene.world_from_object) @ poses, preshape)
    exact = outcomes.failure != "infeasible"
    assert 0.2 < exact.mean() < 0.9
    assert (free == exact).mean() > 0.93
    assert (fingers[~free] == 0).all()
    # A hand that fingers do not meet touches nothing when it closes.
    missed = free & exact & (fingers == 0)
    assert not outcomes.success[missed].any()


def test_a_hand_keeps_off_obstacles(grid: HandGrid) -> None:
    """Points beside the object: at a finger, on the way of the palm, and where the hand never is."""
    occupancy = box((0.05, 0.05, 0.05))
    pose = np.stack([pose_at((0.0, 0.0, 0.15))] * 2)

    def free(*points: tuple[float, float, float]) -> list[bool]:
        return list(grid.meets(occupancy, pose, np.zeros(2), obstacles=np.array(points))[0])

    assert free((0.3, 0.3, 0.1)) == [True, True]
    assert free((0.3, 0.3, 0.1), (0.0, 0.0, 0.155)) == [False, False]
    assert free((0.0, 0.0, 0.23)) == [False, False], "the approach passes it"
    with pytest.raises(errors.ConfigError, match="obstacles"):
        grid.meets(occupancy, pose, np.zeros(2), obstacles=np.zeros((2, 2)))


def test_a_hand_below_the_table_is_refused(grid: HandGrid) -> None:
    occupancy = box((0.05, 0.05, 0.05))
    poses = np.stack([pose_at((0.0, 0.0, 0.15)), pose_at((0.0, 0.0, 0.01)), pose_at((0.0, 0.0, 0.2), downward=False)])
    free, fingers = grid.meets(occupancy, poses, np.zeros(3))
    # The second reaches into the object and the table; the third would come from below the table.
    assert free.tolist() == [True, False, False]
    assert fingers[0] == 3


def test_proposals_of_a_box_close_along_its_short_side(grid: HandGrid) -> None:
    occupancy = box((0.12, 0.05, 0.08))
    found = grid.propose(occupancy, ProposalConfig(boxes=0, most=1000))
    vertical = found.poses[found.source == "vertical"]
    assert len(vertical) > 4
    np.testing.assert_allclose(vertical[:, :3, 2], np.tile([0.0, 0.0, -1.0], (len(vertical), 1)), atol=1e-9)
    # The power preshape closes along x, between the fingers in the middle of the hand.
    middle = vertical[(found.preshape[found.source == "vertical"] == 0) & (np.abs(vertical[:, 0, 3]) < 0.012)]
    assert len(middle)
    assert (np.abs(middle[:, 1, 0]) > 0.9).all()
    # None from below, none into the object, every one with two fingers on it.
    assert (found.poses[:, 2, 2] < 0.5).all()
    free, fingers = grid.meets(occupancy, found.poses, found.preshape)
    assert free.all()
    assert (fingers >= 2).all()
    assert set(found.source.tolist()) <= {"normal", "vertical", "low"}


def test_flat_things_are_approached_with_the_fingertips_over_the_table(grid: HandGrid) -> None:
    found = grid.propose(box((0.10, 0.03, 0.0125)), ProposalConfig(most=1000))
    low = found.poses[found.source == "low"]
    assert len(low) > 0
    # The fingertips of a hand that closes freely pass between 0 and 5 mm over the table.
    hand = graspbox.load_hand("reflex")
    preshapes = found.preshape[found.source == "low"]
    for pose, preshape in list(zip(low, preshapes, strict=True))[:8]:
        reach = 0.0
        for share in np.linspace(0, 1, 97):
            start, end = hand.open(preshape), hand.closed(preshape, 1.0)
            root = np.array(["proximal" in name for name in hand.joints])
            # The root joints close first.
            joints = start + np.where(root, np.clip(2 * share, 0, 1), np.clip(2 * share - 1, 0, 1)) * (end - start)
            frames, halves, _, _ = hand.shapes(joints)
            reach = max(reach, (frames[:, 2, 3] + (np.abs(frames[:, 2, :3]) * halves).sum(axis=1)).max())
        if pose[2, 2] < -0.999:
            assert -0.002 < pose[2, 3] - reach < 0.005


def test_different_proposals_come_first(grid: HandGrid) -> None:
    occupancy = box((0.06, 0.06, 0.1))
    many = grid.propose(occupancy, ProposalConfig(most=1000))
    few = grid.propose(occupancy, ProposalConfig(most=16))
    assert len(few) == 16
    np.testing.assert_array_equal(few.poses, many.poses[:16])

    def nearest(poses: NDArray[np.float64]) -> float:
        distances = np.linalg.norm(poses[:, None, :3, 3] - poses[None, :, :3, 3], axis=-1)
        turns = np.einsum("nij,mij->nm", poses[:, :3, :3], poses[:, :3, :3])
        angles = np.arccos(np.clip((turns - 1) / 2, -1, 1))
        apart = np.hypot(distances / 0.03, angles / 0.5) + 9.0 * np.eye(len(poses))
        return float(apart.min(axis=1).mean())

    chosen = np.random.default_rng(0).permutation(len(many))[:16]
    assert nearest(few.poses) > 1.5 * nearest(many.poses[chosen])


def test_proposals_keep_off_obstacles_and_what_stands_around(grid: HandGrid) -> None:
    """They are those of the object alone that do not touch the rest, as long as all are kept."""
    occupancy, every = box((0.05, 0.05, 0.08)), ProposalConfig(most=100_000)
    beside = np.roll(occupancy, 14, axis=0)
    whole, wall = np.maximum(occupancy, beside), np.array([[0.0, -0.06, 0.01 * i] for i in range(20)])
    alone = grid.propose(occupancy, every)
    found = grid.propose(occupancy, every, whole=whole, obstacles=wall)
    free, _ = grid.meets(whole, alone.poses, alone.preshape, obstacles=wall)
    assert 0.05 < free.mean() < 0.9
    np.testing.assert_array_equal(np.sort(found.poses, axis=0), np.sort(alone.poses[free], axis=0))
    few = grid.propose(occupancy, ProposalConfig(most=16), whole=whole, obstacles=wall)
    assert len(few) == 16
    assert grid.meets(whole, few.poses, few.preshape, obstacles=wall)[0].all()
    with pytest.raises(errors.ConfigError, match="whole"):
        grid.propose(occupancy, whole=np.zeros((8, 8, 8), dtype=np.uint8))
    with pytest.raises(errors.ConfigError, match="obstacles"):
        grid.propose(occupancy, obstacles=np.zeros((2, 2)))


@pytest.mark.parametrize("hand", ["panda_gripper", "leap"])
def test_a_lever_is_the_distance_to_the_middle_of_what_is_near(hand: str) -> None:
    """As another implementation of its definition finds it; a rod longer than the hand is held at many places."""
    grid, rod = HandGrid(hand), box((0.24, 0.03, 0.03))
    found = grid.propose(rod)
    levers = grid.levers(rod, found.poses, found.preshape)
    centers = np.argwhere(rod > 0) * H + np.array(CropConfig().origin) + H / 2
    palms = found.poses[:, :2, 3]
    assert np.ptp(palms[:, 0]) > 0.05, "the rod is held at one place only"
    along = np.abs(palms[:, 0])
    assert levers[along.argmax()] > levers[along.argmin()] + 0.005
    if hand == "panda_gripper":
        reach = graspbox.hands.reach_of(grid.hand, found.preshape[0])
        tips = (found.poses[:, :3, 3] + reach * found.poses[:, :3, 2])[:, :2]
        weights = np.exp(-0.5 * (np.linalg.norm(centers[None, :, :2] - tips[:, None], axis=2) / 0.05) ** 2)
        middles = (weights[..., None] * centers[None, :, :2]).sum(axis=1) / weights.sum(axis=1)[:, None]
        np.testing.assert_allclose(levers, np.linalg.norm(middles - tips, axis=1), atol=5e-4)


def test_where_nothing_is_there_is_no_lever(grid: HandGrid) -> None:
    nothing = np.zeros((N, N, N), dtype=np.uint8)
    assert grid.levers(nothing, pose_at((0.0, 0.0, 0.1))[None], [0.0]).tolist() == [0.0]
    far = box((0.01, 0.01, 0.01))
    away = pose_at((100.0, 0.0, 0.1))[None]
    assert grid.levers(far, away, [0.0]) == pytest.approx(100.0, abs=0.1)


def test_nothing_is_proposed_where_nothing_is(grid: HandGrid) -> None:
    found = grid.propose(np.zeros((N, N, N), dtype=np.uint8))
    assert len(found) == 0
    assert found.poses.shape == (0, 4, 4)
    with pytest.raises(errors.ConfigError, match="occupancy"):
        grid.propose(np.zeros((8, 8, 8), dtype=np.uint8))


def test_hand_grids_do_not_depend_on_threads() -> None:
    occupancy = box((0.05, 0.08, 0.07))
    results: list[list[NDArray[Any]]] = []
    for threads in (1, 3):
        grid = HandGrid(num_threads=threads)
        found = grid.propose(occupancy)
        volume = np.stack([occupancy] * 3)[None]
        crops = grid.crops(volume, np.zeros(len(found), dtype=int), found.poses)
        free, fingers = grid.meets(occupancy, found.poses, found.preshape)
        results.append([grid.swept, found.poses, found.preshape, crops, free, fingers])
    for one, three in zip(*results, strict=True):
        np.testing.assert_array_equal(one, three)


@pytest.mark.parametrize("hand", ["panda_gripper", "soft_hand", "robotiq_2f_85", "leap", "inspire"])
def test_other_hands_propose_too(hand: str) -> None:
    grid = HandGrid(hand)
    found = grid.propose(box((0.05, 0.05, 0.08)))
    assert len(found) > 8
    free, fingers = grid.meets(box((0.05, 0.05, 0.08)), found.poses, found.preshape)
    assert free.all()
    assert (fingers >= min(2, len(graspbox.load_hand(hand).chains))).all()


def test_grid_settings_out_of_range_are_refused() -> None:
    with pytest.raises(errors.ConfigError, match="cell"):
        HandGrid(config=HandGridConfig(cell=0.0))
    with pytest.raises(errors.ConfigError, match="seeds"):
        HandGrid().propose(box((0.05, 0.05, 0.05)), ProposalConfig(seeds=100000))


def test_perturbed_poses_have_the_deviation_asked_for() -> None:
    poses = np.stack([pose_at((0.1, 0.2, 0.3))] * 4000)
    moved = perturbed(poses, np.random.default_rng(0), 0.003, 0.05)
    relative = np.linalg.inv(poses) @ moved
    assert relative[:, :3, 3].std(axis=0) == pytest.approx([0.003] * 3, rel=0.05)
    angles = np.arccos(np.clip((np.trace(relative[:, :3, :3], axis1=1, axis2=2) - 1) / 2, -1, 1))
    # The length of a vector of three normal numbers.
    assert np.sqrt((angles**2).mean()) == pytest.approx(0.05 * np.sqrt(3), rel=0.05)
    np.testing.assert_allclose(
        relative[:, :3, :3] @ relative[:, :3, :3].transpose(0, 2, 1), np.tile(np.eye(3), (4000, 1, 1)), atol=1e-12
    )
