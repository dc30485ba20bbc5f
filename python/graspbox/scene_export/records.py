"""``scene.json`` and ``object.json``: files of an export, poses, and limits of the format.

Version 1; lengths in metres, angles in radians, matrices as lists of rows.

| key | value |
|---|---|
| ``format``, ``version``, ``graspbox`` | ``"graspbox.scene"`` or ``"graspbox.object"``, 1, version of the package |
| ``to``, ``files`` | format of the export, and its files by their parts in it |
| ``object`` | name, mass, ``center_of_mass``, ``inertia`` about it, number of convex parts, friction factor |
| ``world_from_object`` | 4x4: pose of the object at rest; the table is the plane z = 0 |
| ``not_expressed`` | properties that the format cannot express, as sentences |

A scene has these as well:

| key | value |
|---|---|
| ``hand`` | name, preshape, base link |
| ``world_from_hand``, ``world_from_base``, ``object_from_hand`` | 4x4: poses of the grasp frame and of the base |
| ``joints`` | position of every joint at the start, by name |
| ``actuators`` | each with ``kind`` (tendon, servo, rigid), ``speed`` while closing, ``travel``, ``load_limit``, law |
| ``table`` | side, thickness, friction factor |
| ``gravity`` | m/s2 |
| ``trial`` | ``close_time``, ``lift_height``, ``lift_time``, ``hold_time`` of a trial |
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from graspbox import _core
from graspbox.configs import PhysicsConfig, TrialConfig
from graspbox.scene_export.contents import TABLE_SIDE, TABLE_THICKNESS, ObjectData, SceneData
from graspbox.scene_export.description import BASE, HandDescription
from graspbox.scene_export.losses import NOT_EXPRESSED, Format
from graspbox.scene_export.mjcf import mujoco_actuators

__all__ = ["OBJECT_FORMAT", "SCENE_FORMAT", "object_record", "scene_record"]

SCENE_FORMAT, OBJECT_FORMAT, _VERSION = "graspbox.scene", "graspbox.object", 1


def object_record(item: ObjectData, physics: PhysicsConfig, to: Format, files: Mapping[str, str]) -> dict[str, Any]:
    """Describe an export of an object alone."""
    return {
        "format": OBJECT_FORMAT,
        "version": _VERSION,
        "graspbox": _core.__version__,
        "units": {"length": "m", "angle": "rad", "mass": "kg", "time": "s"},
        "to": to,
        "files": dict(files),
        "object": {
            "name": item.name,
            "mass": float(item.mass),
            "center_of_mass": np.asarray(item.center).tolist(),
            "inertia": np.asarray(item.inertia).tolist(),
            "parts": len(item.parts),
            "friction": physics.friction.object,
        },
        "world_from_object": item.start.tolist(),
        "not_expressed": list(NOT_EXPRESSED[to]),
    }


def scene_record(data: SceneData, to: Format, files: Mapping[str, str]) -> dict[str, Any]:
    """Describe an export of a scene."""
    start, hand, physics, trial = data.start, data.hand, data.physics, TrialConfig()
    base = object_record(data.object, physics, to, files)
    losses = base.pop("not_expressed")
    return {
        **base,
        "format": SCENE_FORMAT,
        "hand": {"name": hand.name, "preshape": start.preshape, "base": hand.links[BASE].name},
        "world_from_hand": start.world_from_hand.tolist(),
        "world_from_base": start.world_from_base.tolist(),
        "object_from_hand": (np.linalg.inv(data.object.start) @ start.world_from_hand).tolist(),
        "joints": {hand.links[index].joint: float(value) for index, value in start.joints.items()},
        "actuators": [_actuator(hand, index, start.preshape) for index in range(len(hand.actuators))],
        "table": {"side": TABLE_SIDE, "thickness": TABLE_THICKNESS, "friction": physics.friction.table},
        "gravity": physics.gravity,
        "trial": {name: getattr(trial, name) for name in ("close_time", "lift_height", "lift_time", "hold_time")},
        "not_expressed": losses,
    }


def _actuator(hand: HandDescription, index: int, preshape: float) -> dict[str, Any]:
    actuator = hand.actuators[index]
    found: dict[str, Any] = {
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
        found |= {"tendon": tendon.name, "spool_radius": actuator.spool[1]}
        found |= {"stiffness": tendon.stiffness, "damping": tendon.damping, "max_tension": tendon.max_tension}
    elif actuator.servo is not None:
        found |= {"stiffness": actuator.servo[0], "damping": actuator.servo[1]}
    if actuator.joints:
        found["joints"] = [
            {"name": hand.links[link].joint, "ratio": ratio, "offset": offset}
            for link, ratio, offset in actuator.joints
        ]
    return found
