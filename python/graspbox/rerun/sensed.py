"""Observations of ``Grasp-v0`` as places in the world: positions of the joints, and forces of the tactile sensors."""

import re
import tomllib
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from graspbox._core import Hand
from graspbox.envs import spaces
from graspbox.envs.coding import Codec
from graspbox.rerun.links import link_frames

__all__ = ["hand_links", "joint_columns", "sensor_forces"]

Floats = NDArray[np.float64]


def hand_links(hand: Hand, joints: Floats) -> Floats:
    """Return the frames of the links in the hand's frame, (1 + j, 4, 4): the palm, then each joint that moves."""
    frames, _, _ = hand.joint_frames(np.ascontiguousarray(joints, dtype=np.float64))
    return np.concatenate([np.eye(4)[None], frames])


def joint_columns(codec: Codec, hand: Hand, control: str) -> Callable[[Any], Floats]:
    """Make a function that reads the positions (c,) of the independent joints from a state of ``Grasp-v0``.

    The table of observations names the joints of each column; other joints follow from the preshape.
    """
    _, observations = spaces.columns_of(control, spaces.tables(hand))
    places: dict[str, list[int]] = {}
    for row in observations["state"]:
        match = re.fullmatch(r"position of ([\w, ]+)", row["meaning"])
        names = match[1].split(", ") if match else []
        if names and len(names) == row["size"] and set(names) <= set(hand.joints):
            places[row["name"]] = [hand.joints.index(name) for name in names]
    shaped = "preshape" in codec.names

    def read(state: Any) -> Floats:
        low, high = hand.preshape_limits
        preshape = float(codec.column(state, "preshape")[0]) if shaped else low
        joints = np.array(hand.open(min(max(preshape, low), high)))
        for name, joint in places.items():
            joints[joint] = codec.column(state, name)
        return joints

    return read


def sensor_forces(
    hand: Hand, world_from_hand: Floats, joints: Floats, tactile: Floats
) -> tuple[NDArray[np.int64], Floats, Floats]:
    """Place the readings of tactile sensors.

    Parameters
    ----------
    hand : Hand
        The hand.
    world_from_hand : (t, 4, 4) float64
        Its poses, metres.
    joints : (t, c) float64
        Positions of its independent joints, rad or m.
    tactile : (t, s) float64
        Force on each sensor, N.

    Returns
    -------
    (k,) int64
        Sample of each force.
    (k, 3) float64
        Where the sensor is, world frame, metres.
    (k, 3) float64
        Force on the object, along the outward normal of the sensor, world frame, N.
    """
    rows, places, normals = _sensors(hand)
    samples, sensors = np.nonzero(tactile > 0.0)
    if not len(samples):
        return samples, np.zeros((0, 3)), np.zeros((0, 3))
    links = np.array([hand_links(hand, row) for row in joints])
    frames = world_from_hand[samples] @ links[samples, rows[sensors]]
    points = np.einsum("nij,nj->ni", frames[:, :3, :3], places[sensors]) + frames[:, :3, 3]
    ways = np.einsum("nij,nj->ni", frames[:, :3, :3], normals[sensors])
    return samples, points, ways * tactile[samples, sensors][:, None]


def _sensors(hand: Hand) -> tuple[NDArray[np.int64], Floats, Floats]:
    """Return the sensors of a hand: rows of `hand_links`, places and unit normals (s, 3) in these frames, metres.

    In the order of the observation ``tactile``: link by link, and for each the tables of ``hand.toml`` in turn.
    """
    carriers, offsets = link_frames(hand)
    order = list(carriers)
    tables = tomllib.loads(hand.files[1]).get("sensors", [])
    found = [(order.index(link), link, table) for table in tables for link in table["links"]]
    found.sort(key=lambda one: one[0])
    rows = np.array([carriers[link] for _, link, _ in found], dtype=np.int64)
    places = [offsets[link] @ np.append(table["position"]["value"], 1.0) for _, link, table in found]
    normals = [offsets[link][:3, :3] @ table["normal"]["value"] for _, link, table in found]
    units = [normal / np.linalg.norm(normal) for normal in normals]
    return rows, np.array(places).reshape(-1, 4)[:, :3], np.array(units).reshape(-1, 3)
