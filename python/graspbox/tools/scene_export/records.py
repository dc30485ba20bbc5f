"""``scene.json`` and ``object.json``: files of an export, poses, and limits of the format.

Version 1; lengths in metres, angles in radians, matrices as lists of rows.

| key | value |
|---|---|
| ``format``, ``version``, ``graspbox`` | ``"graspbox.scene"`` or ``"graspbox.object"``, 1, version of the package |
| ``to``, ``files`` | format of the export, and its files by their parts in it |
| ``object`` | name, mass, ``center_of_mass``, ``inertia`` about it, number of convex parts, friction factor |
| ``world_from_object`` | 4x4: pose of the object at rest; the table is the plane z = 0 |
| ``not_expressed`` | properties that the format cannot express, as sentences |

A scene has these as well, those in the first four rows only with a hand:

| key | value |
|---|---|
| ``hand`` | name, preshape, base link |
| ``world_from_hand``, ``world_from_base``, ``object_from_hand`` | 4x4: poses of the grasp frame and of the base |
| ``joints`` | position of every joint at the start, by name |
| ``actuators`` | each with ``kind`` (tendon, servo, rigid), ``speed`` while closing, ``travel``, ``load_limit``, law |
| ``table`` | side, thickness, friction factor |
| ``gravity`` | m/s2 |
| ``trial`` | ``close_time``, ``lift_height``, ``lift_time``, ``hold_time`` of a trial |

A scene of several objects, or with walls, has these instead of ``object``, ``world_from_object`` and
``object_from_hand``:

| key | value |
|---|---|
| ``objects`` | as ``object``, each with its ``label``, its name in the files, and its ``world_from_object`` |
| ``target`` | index of the object that is to be grasped; null if any of them may be |
| ``walls`` | each with its ``label``, ``world_from_wall`` (4x4), ``half_extents`` and friction factor |
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from graspbox import _core
from graspbox.configs import PhysicsConfig, TrialConfig
from graspbox.hands.description import BASE, HandDescription
from graspbox.tools.scene_export.contents import (
    TABLE_SIDE,
    TABLE_THICKNESS,
    ObjectData,
    SceneData,
    Start,
    object_names,
    wall_names,
)
from graspbox.tools.scene_export.losses import Format, not_expressed
from graspbox.tools.scene_export.mjcf import mujoco_actuators

__all__ = ["OBJECT_FORMAT", "SCENE_FORMAT", "object_record", "scene_record"]

SCENE_FORMAT, OBJECT_FORMAT, _VERSION = "graspbox.scene", "graspbox.object", 1


def object_record(item: ObjectData, physics: PhysicsConfig, to: Format, files: Mapping[str, str]) -> dict[str, Any]:
    """Describe an export of a single object."""
    return {**_head(OBJECT_FORMAT, to, files), **_one(item, physics), "not_expressed": list(not_expressed(to))}


def scene_record(data: SceneData, to: Format, files: Mapping[str, str], points: Sequence[str]) -> dict[str, Any]:
    """Describe an export of a scene; `points` are the limits of the format that concern it."""
    physics, trial = data.physics, TrialConfig()
    single = len(data.objects) == 1 and not data.walls
    return {
        **_head(SCENE_FORMAT, to, files),
        **(_one(data.objects[0], physics) if single else _several(data)),
        **({} if data.start is None else _hand(data.start, data.objects[0] if single else None)),
        "table": {"side": TABLE_SIDE, "thickness": TABLE_THICKNESS, "friction": physics.friction.table},
        "gravity": physics.gravity,
        "trial": {name: getattr(trial, name) for name in ("close_time", "lift_height", "lift_time", "hold_time")},
        "not_expressed": list(points),
    }


def _head(kind: str, to: Format, files: Mapping[str, str]) -> dict[str, Any]:
    return {
        "format": kind,
        "version": _VERSION,
        "graspbox": _core.__version__,
        "units": {"length": "m", "angle": "rad", "mass": "kg", "time": "s"},
        "to": to,
        "files": dict(files),
    }


def _one(item: ObjectData, physics: PhysicsConfig) -> dict[str, Any]:
    return {"object": _object(item, physics), "world_from_object": item.start.tolist()}


def _several(data: SceneData) -> dict[str, Any]:
    objects = zip(object_names(len(data.objects)), data.objects, strict=True)
    walls = zip(wall_names(len(data.walls)), data.walls, strict=True)
    return {
        "objects": [
            {"label": name, **_object(item, data.physics), "world_from_object": item.start.tolist()}
            for name, item in objects
        ],
        "target": data.target,
        "walls": [
            {
                "label": name,
                "world_from_wall": wall.world_from_wall.tolist(),
                "half_extents": wall.half_extents.tolist(),
                "friction": data.physics.friction.table,
            }
            for name, wall in walls
        ],
    }


def _object(item: ObjectData, physics: PhysicsConfig) -> dict[str, Any]:
    return {
        "name": item.name,
        "mass": float(item.mass),
        "center_of_mass": item.center.tolist(),
        "inertia": item.inertia.tolist(),
        "parts": len(item.parts),
        "friction": physics.friction.object,
    }


def _hand(start: Start, item: ObjectData | None) -> dict[str, Any]:
    """Describe the hand at a start; with an `item`, its pose in the frame of that object, too."""
    hand = start.hand
    record: dict[str, Any] = {
        "hand": {"name": hand.name, "preshape": start.preshape, "base": hand.links[BASE].name},
        "world_from_hand": start.world_from_hand.tolist(),
        "world_from_base": start.world_from_base.tolist(),
    }
    if item is not None:
        record["object_from_hand"] = (np.linalg.inv(item.start) @ start.world_from_hand).tolist()
    return {
        **record,
        "joints": {hand.links[index].joint: float(value) for index, value in start.joints.items()},
        "actuators": [_actuator(hand, index, start.preshape) for index in range(len(hand.actuators))],
    }


def _actuator(hand: HandDescription, index: int, preshape: float) -> dict[str, Any]:
    actuator = hand.actuators[index]
    record: dict[str, Any] = {
        "name": actuator.name,
        "kind": "tendon" if actuator.spool is not None else "servo" if actuator.servo is not None else "rigid",
        "mujoco": mujoco_actuators(hand, index),
        "start": float(hand.open_positions(preshape)[index]),
        "speed": actuator.speed if actuator.closes else 0.0,
        "travel": list(actuator.travel),
        "load_limit": actuator.load_limit,
    }
    if actuator.spool is not None:
        tendon = hand.tendons[actuator.spool[0]]
        record |= {"tendon": tendon.name, "spool_radius": actuator.spool[1]}
        record |= {"stiffness": tendon.stiffness, "damping": tendon.damping, "max_tension": tendon.max_tension}
    elif actuator.servo is not None:
        record |= {"stiffness": actuator.servo[0], "damping": actuator.servo[1]}
    if actuator.joints:
        record["joints"] = [
            {"name": hand.links[link].joint, "ratio": ratio, "offset": offset}
            for link, ratio, offset in actuator.joints
        ]
    return record
