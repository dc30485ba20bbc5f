"""Candidate poses: each source is true to its name, for every hand, and gives no colliding pose."""

from functools import cache

import numpy as np
import pytest
from numpy.typing import NDArray

import graspbox
from graspbox import object_sets
from graspbox.data.trials import candidates, scenes
from graspbox.data.trials.candidates import HandGeometry, Poses, Surface
from graspbox.data.trials.settings import CandidateShares, DatasetConfig
from graspbox.object_sets import ObjectSpec

HANDS = graspbox.Hand.names()


@cache
def geometry(name: str) -> HandGeometry:
    return HandGeometry.of(graspbox.load_hand(name))


@cache
def scene(source: str, hand: str) -> graspbox.Scene:
    return graspbox.Scene(object_sets.load(source)[0].load(), hand=hand)


def heights(poses: Poses, hand: HandGeometry) -> NDArray[np.float64]:
    """Height of the lowest corner of the hand at each step of closing, (n, steps)."""
    which = [int(np.abs(hand.preshapes - preshape).argmin()) for preshape in poses.preshape]
    corners = hand.corners[which]
    up = poses.world_from_hand[:, 2, :3]
    lowest: NDArray[np.float64] = np.einsum("nj,nskj->nsk", up, corners).min(axis=2)
    return lowest + poses.world_from_hand[:, 2, 3][:, None]


@pytest.mark.parametrize("hand", HANDS)
@pytest.mark.parametrize("source", list(candidates.SOURCES))
def test_poses_are_rigid_and_near_the_object(hand: str, source: str) -> None:
    box = scene("procedural:box:1", hand)
    surface = Surface.of(box, 0)
    poses = candidates.SOURCES[source](surface, geometry(hand), 50, np.random.default_rng(0))
    assert graspbox._core.is_rigid(poses.world_from_hand).all()
    assert set(poses.preshape) <= set(graspbox.load_hand(hand).preshapes.values())
    middle = surface.points.mean(axis=0)
    assert (np.linalg.norm(poses.world_from_hand[:, :3, 3] - middle, axis=1) < 0.45).all()
    again = candidates.SOURCES[source](surface, geometry(hand), 50, np.random.default_rng(0))
    assert (again.world_from_hand == poses.world_from_hand).all()


@pytest.mark.parametrize("hand", HANDS)
def test_low_poses_are_just_above_the_table(hand: str) -> None:
    fork = (
        scene("procedural:fork:0", hand)
        if "fork" in graspbox._core.procedural_families()
        else scene("ycb:030_fork", hand)
    )
    poses = candidates.low(Surface.of(fork, 0), geometry(hand), 200, np.random.default_rng(0))
    steps = heights(poses, geometry(hand))
    at = ((steps > 0.001 - 1e-9) & (steps < 0.002 + 1e-9)).any(axis=1)
    assert at.all()
    assert (poses.world_from_hand[:, 2, 2] < -0.97).all()


def test_normal_poses_close_along_the_least_extent() -> None:
    """A long bar is grasped across, from above or from the side, with its middle between the fingers."""
    vertices = np.array([[x, y, z] for x in (-0.12, 0.12) for y in (-0.015, 0.015) for z in (0.0, 0.03)])
    sides = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    faces = [triangle for a, b, c, d in sides for triangle in ((a, b, c), (a, c, d))]
    bar = graspbox.Scene(graspbox.mesh_from_arrays(vertices, faces, name="bar"))
    hand = geometry("reflex")
    poses = candidates.on_normals(Surface.of(bar, 0), hand, 300, np.random.default_rng(0))
    down = poses.world_from_hand[:, 2, 2] < -0.99
    assert 0.4 < down.mean() < 0.95
    # Closing directions are across the bar up to the error of the roll and of the search.
    assert (np.abs(poses.world_from_hand[down, 0, 0]) < np.sin(0.2 + np.pi / 18)).mean() > 0.9
    which = [int(np.abs(hand.preshapes - preshape).argmin()) for preshape in poses.preshape]
    centers = hand.centers[which] * [1.0, 1.0, 0.0]
    closing = np.einsum("nij,nj->ni", poses.world_from_hand[:, :3, :3], centers) + poses.world_from_hand[:, :3, 3]
    assert np.median(np.abs(closing[down, 1])) < 0.004
    signs = np.sign(poses.world_from_hand[down, 1, 0])
    assert 0.3 < (signs > 0).mean() < 0.7


@pytest.mark.parametrize("position", [0.0, 0.02])
@pytest.mark.parametrize("rotation", [0.0, 0.3])
def test_errors_of_the_hand_keep_their_bounds(position: float, rotation: float) -> None:
    rng = np.random.default_rng(1)
    nominal = candidates.randomly(Surface.of(scene("procedural:can:0", "reflex"), 0), geometry("reflex"), 500, rng)
    executed = candidates.deviated(nominal.world_from_hand, position, rotation, rng)
    moved = np.linalg.inv(nominal.world_from_hand) @ executed
    assert np.abs(moved[:, :3, 3]).max() <= position + 1e-12
    angle = np.arccos(np.clip((np.trace(moved[:, :3, :3], axis1=1, axis2=2) - 1) / 2, -1, 1))
    assert angle.max() <= np.sqrt(3) * rotation + 1e-6
    if position:
        assert np.abs(moved[:, :3, 3]).max(axis=0).min() > 0.9 * position
    if rotation:
        assert angle.max() > rotation


def rows(source: str, hand: str = "reflex", **settings: object) -> dict[str, object]:
    spec = object_sets.load(source)[0]
    task = scenes.SceneTask(scenes.GroupedObject(spec, spec.group, spec.split), 0)
    config = DatasetConfig(**{"poses": 40, "views": 0, **settings})  # type: ignore[arg-type]
    return scenes.label(task, ObjectSpec.load, graspbox.load_hand(hand), geometry(hand), config)[0]


def test_scene_has_its_shares_and_no_collision() -> None:
    found = rows("procedural:mug:0")
    source = np.array(found["candidate"])
    assert {name: int((source == name).sum()) for name in sorted(set(source))} == {
        "planner": 16, "normal": 8, "low": 6, "jitter": 6, "random": 4,
    }  # fmt: skip
    rest = np.asarray(found["world_from_object"])[0]
    mug = graspbox.Scene(object_sets.load("procedural:mug:0")[0].load(), world_from_object=rest)
    free = mug.check(np.asarray(found["object_from_hand"]), np.asarray(found["preshape"]), clearance=0.0)
    assert free.mean() > 0.97
    ranks = [rank for rank, name in zip(found["rank"], source, strict=True) if name == "planner"]  # type: ignore[call-overload]
    assert set(range(8)) <= set(ranks)
    assert max(ranks) > 15


def test_jitter_stays_near_a_success() -> None:
    found = rows("procedural:can:0", poses=60)
    source, success = np.array(found["candidate"]), np.asarray(found["success"])
    poses = np.asarray(found["world_from_hand"])[:, :3, 3]
    good = poses[success & (source != "jitter")]
    for pose in poses[source == "jitter"]:
        assert np.linalg.norm(good - pose, axis=1).min() < 5 * np.sqrt(3) * 0.008


def test_stand_ins_fill_what_a_source_lacks() -> None:
    """No pose that touches the table is free beside a ball of a hand's size: others take the place of low poses."""
    found = rows("ycb:054_softball", "panda_gripper", poses=20, candidates=CandidateShares(0.0, 0.0, 1.0, 0.0, 0.0))
    assert set(found["candidate"]) <= {"low", "planner", "normal", "random"}  # type: ignore[call-overload]
    assert len(np.asarray(found["trial"])) <= 20


def test_resting_poses_follow_their_probabilities() -> None:
    """Scenes of one object take its resting poses in turn, as often as they are probable."""
    spec = object_sets.load("ycb:003_cracker_box")[0]
    mesh, hand = spec.load(), graspbox.load_hand()
    config = DatasetConfig(poses=1, views=0, rests=20, candidates=CandidateShares(0.0, 1.0, 0.0, 0.0, 0.0))
    subject = scenes.GroupedObject(spec, spec.group, spec.split)
    poses, probabilities = mesh.resting_poses()
    likely = probabilities >= 0.05
    counts = np.zeros(likely.sum())
    for rest in range(config.rests):
        task = scenes.SceneTask(subject, rest)
        found, _ = scenes.label(task, lambda _: mesh, hand, geometry("reflex"), config)
        up = np.asarray(found["world_from_object"])[0, 2, :3]
        counts[(poses[likely][:, 2, :3] @ up).argmax()] += 1
    assert (np.abs(counts - config.rests * probabilities[likely] / probabilities[likely].sum()) <= 1).all()
