"""The core's description of a hand, against MuJoCo's reader of URDFs and Python's of TOML."""

import tomllib
import xml.etree.ElementTree as ET
from typing import Any

import mujoco
import numpy as np
import pytest

import graspbox
from graspbox.errors import HandError
from graspbox.hands.conventions import mechanism_of
from graspbox.hands.description import HandDescription, describe, describe_urdf, describe_wrong_urdf, joint_motion

NAMES = graspbox.Hand.names()
GEOMS = {
    "box": mujoco.mjtGeom.mjGEOM_BOX,
    "cylinder": mujoco.mjtGeom.mjGEOM_CYLINDER,
    "sphere": mujoco.mjtGeom.mjGEOM_SPHERE,
}


def read_by_mujoco(urdf: str) -> mujoco.MjModel:
    """Load a URDF as it is: all links, their own inertias, collision shapes alone."""
    robot = ET.fromstring(urdf)
    options = {"fusestatic": "false", "discardvisual": "true", "balanceinertia": "false", "inertiafromgeom": "false"}
    ET.SubElement(ET.SubElement(robot, "mujoco"), "compiler", options)
    return mujoco.MjModel.from_xml_string(ET.tostring(robot, encoding="unicode"))


@pytest.mark.parametrize("name", NAMES)
def test_links_and_joints_are_those_of_mujoco(name: str) -> None:
    hand = graspbox.load_hand(name)
    described, model = describe(hand), read_by_mujoco(hand.files[0])
    assert model.njnt == len(described.moving)
    for link in described.links:
        body = model.body(link.name)
        assert float(body.mass[0]) == pytest.approx(link.mass, rel=1e-12)
        np.testing.assert_allclose(body.ipos, link.center, atol=1e-12)
        turn = np.empty(9)
        mujoco.mju_quat2Mat(turn, body.iquat)
        inertia = turn.reshape(3, 3) @ np.diag(body.inertia) @ turn.reshape(3, 3).T
        np.testing.assert_allclose(inertia, link.inertia, atol=1e-9 * np.abs(link.inertia).max())
        above = model.body(described.links[link.parent].name).id if link.joint else 0
        assert body.parentid[0] == above
        if link.moves:
            joint = model.joint(link.joint)
            assert joint.type[0] == (mujoco.mjtJoint.mjJNT_SLIDE if link.unit == "m" else mujoco.mjtJoint.mjJNT_HINGE)
            np.testing.assert_allclose(joint.axis, link.axis, atol=1e-12)
            np.testing.assert_allclose(joint.range, link.limits, atol=1e-12)


@pytest.mark.parametrize("name", NAMES)
def test_links_and_shapes_move_as_in_mujoco(name: str) -> None:
    hand = graspbox.load_hand(name)
    described, model = describe(hand), read_by_mujoco(hand.files[0])
    data = mujoco.MjData(model)
    positions = hand.closed(hand.preshape_limits[1], 0.4)
    for joint, position in zip(described.moving, mechanism_of(hand).all_positions(positions[None])[0], strict=True):
        data.joint(joint.joint).qpos = position
    mujoco.mj_forward(model, data)
    frames = described.base_from_hand @ hand.link_frames(positions)
    for link, frame in zip(described.links, frames, strict=True):
        body = model.body(link.name).id
        np.testing.assert_allclose(data.xpos[body], frame[:3, 3], atol=1e-9)
        np.testing.assert_allclose(data.xmat[body].reshape(3, 3), frame[:3, :3], atol=1e-9)
        geoms = [i for i in range(model.ngeom) if model.geom_bodyid[i] == body]
        assert len(geoms) == len(link.shapes)
        for geom, shape in zip(geoms, link.shapes, strict=True):
            assert model.geom_type[geom] == GEOMS[shape.kind]
            np.testing.assert_allclose(model.geom_size[geom][: len(shape.size)], shape.size, atol=1e-12)
            np.testing.assert_allclose(data.geom_xpos[geom], (frame @ shape.link_from_shape)[:3, 3], atol=1e-9)


def test_one_joint_moves_as_the_core_moves_it() -> None:
    hand = graspbox.load_hand("inspire")
    positions = hand.closed(0.0, 0.7)
    frames = hand.link_frames(positions)
    moved = dict(zip(mechanism_of(hand).joints, mechanism_of(hand).all_positions(positions[None])[0], strict=True))
    for link in describe(hand).moving:
        motion = joint_motion(link, moved[link.joint])
        np.testing.assert_allclose(frames[link.parent] @ link.parent_from_link @ motion, frames[link.index], atol=1e-12)


def joints_of(described: HandDescription, pairs: Any) -> dict[str, tuple[float, ...]]:
    return {described.links[link].joint: tuple(numbers) for link, *numbers in pairs}


@pytest.mark.parametrize("name", NAMES)
def test_the_rest_is_that_of_the_hand_toml(name: str) -> None:
    hand = graspbox.load_hand(name)
    described, table = describe(hand), tomllib.loads(hand.files[1])
    assert described.name == table["name"] == name
    np.testing.assert_allclose(described.base_from_hand[:3, 3], table["grasp"]["xyz"]["value"])
    for tendon in described.tendons:
        written = table["tendons"][tendon.name]
        assert joints_of(described, tendon.arms) == {k: (arm["value"],) for k, arm in written["arms"].items()}
        for key in ("stiffness", "damping", "max_tension"):
            assert getattr(tendon, key) == written[key]["value"]
    for actuator, written in zip(described.actuators, table["actuators"], strict=True):
        assert actuator.name == written["name"]
        assert actuator.closes == (actuator.name in table["grasp"]["closing"])
        driven = (written.get("servo") or written.get("rigid") or {"joints": {}})["joints"]
        rows = {k: (row["ratio"]["value"], row.get("offset", {"value": 0.0})["value"]) for k, row in driven.items()}
        assert joints_of(described, actuator.joints) == rows
        assert (actuator.servo is not None) == ("servo" in written)
        assert (actuator.spool is not None) == ("spool" in written)
    groups = {joint: group for key, group in table.get("joints", {}).items() for joint in group.get("names", [key])}
    for link in described.moving:
        group = groups.get(link.joint, {})
        assert link.encoder == group.get("encoder", False)
        assert link.spring.damping == group.get("damping", {"value": 0.0})["value"]
        assert link.spring.stop_stiffness == group.get("stop_stiffness", {"value": 0.0})["value"]
    sensors = sum(len(row["links"]) for row in table.get("sensors", []))
    assert len(described.sensors) == sensors
    assert [sensor.link for sensor in described.sensors] == sorted(sensor.link for sensor in described.sensors)
    pads = {shape.name for link in described.links for shape in link.shapes if shape.pad}
    assert pads == set(table["pads"])


def test_descriptions_do_not_change() -> None:
    hand = graspbox.load_hand("reflex")
    assert describe(hand) is describe(graspbox.load_hand("reflex"))
    with pytest.raises(ValueError, match="read-only"):
        describe(hand).links[1].parent_from_link[0, 0] = 2.0


def test_a_urdf_alone() -> None:
    text = graspbox.load_hand("panda_gripper").files[0]
    links = describe_urdf(text, "hand.urdf")
    assert [link.name for link in links] == [link.name for link in describe(graspbox.load_hand("panda_gripper")).links]
    millimetres = text.replace('xyz="0 0 0.0584"', 'xyz="0 0 58.4"')
    assert millimetres != text
    with pytest.raises(HandError, match=r"hand\.urdf:\d+"):
        describe_urdf(millimetres, "hand.urdf")
    found = describe_wrong_urdf(millimetres)
    assert found is not None
    assert found[1].parent_from_link[2, 3] == 58.4
    assert describe_wrong_urdf("<robot>") is None
