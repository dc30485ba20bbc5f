"""First files of hands that are harder to guess: arms before the palm, one jaw, linkages, limits below the palm."""

import json
import re
import tomllib
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest
from typer.testing import Result

import graspbox
from command_line import invoke
from graspbox.errors import ConfigError, HandError
from graspbox.hand_tools import GuessedHand, check_hand, guess_hand
from graspbox.hand_tools.guessing import begin_guess
from graspbox.hand_tools.palm import cut_above_palm
from graspbox.hand_tools.postures import Postures
from made_hands import Box, Joint, urdf

ASSETS = Path(__file__).parents[2] / "env/hand/assets"

PALM = Box((0.0, 0.0, 0.015), (0.1, 0.05, 0.03))
#: A pad in front of a finger that closes along x, or against it.
LEFT, RIGHT = (
    Box((sign * 0.003, 0.0, 0.05), (0.012, 0.024, 0.08), name) for sign, name in ((1, "l_pad"), (-1, "r_pad"))
)
JAWS = {"palm": [PALM], "left": [LEFT], "right": [RIGHT]}
SLIDES = {
    "slide": Joint("palm", "left", (-0.04, 0.0, 0.03), (1.0, 0.0, 0.0), (0.0, 0.035), "prismatic"),
    "follows": Joint("palm", "right", (0.04, 0.0, 0.03), (-1.0, 0.0, 0.0), (0.0, 0.035), "prismatic", "slide"),
}


def turning(low: float, high: float) -> dict[str, Joint]:
    """Make two fingers turn towards each other by themselves."""
    return {
        "turn_left": Joint("palm", "left", (-0.04, 0.0, 0.03), (0.0, 1.0, 0.0), (low, high)),
        "turn_right": Joint("palm", "right", (0.04, 0.0, 0.03), (0.0, -1.0, 0.0), (low, high)),
    }


def arm(count: int) -> tuple[dict[str, list[Box]], dict[str, Joint]]:
    """Make an arm of some links, whose joints turn about z and y by turns, up to the link `palm`."""
    names = [f"arm_{number}" for number in range(count)] + ["palm"]
    links = {name: [Box((0.0, 0.0, 0.05), (0.05, 0.05, 0.1))] for name in names[:-1]}
    axes = ((0.0, 0.0, 1.0), (0.0, 1.0, 0.0))
    joints = {
        f"arm_joint_{i}": Joint(names[i], names[i + 1], (0.0, 0.0, 0.1), axes[i % 2], (-1.0, 2.0)) for i in range(count)
    }
    return links, joints


def made(folder: Path, links: dict[str, list[Box]], joints: dict[str, Joint]) -> Path:
    path = folder / "made.urdf"
    path.write_text(urdf(links, joints))
    return path


def guess(folder: Path, links: dict[str, list[Box]], joints: dict[str, Joint], **options: Any) -> GuessedHand:
    return guess_hand(made(folder, links, joints), **options)


def loaded(guessed: GuessedHand) -> graspbox.Hand:
    return graspbox.Hand(guessed.fitted.text, guessed.text)


def grasp_of(guessed: GuessedHand) -> dict[str, Any]:
    table: dict[str, Any] = tomllib.loads(guessed.text)["grasp"]
    return table


def held(hand: graspbox.Hand, name: str, scale: float = 1.0) -> tuple[int, int]:
    """Count the first planned grasps of an object that hold it, and those that were tried."""
    mesh = graspbox.object_sets.load(name, scale=scale)[0].load()
    scene = graspbox.Scene(mesh, hand=hand)
    plan = graspbox.plan(mesh, hand=hand, world_from_object=scene.world_from_object).best(6)
    return int(scene.simulate(plan).success.sum()), len(plan)


def run(*arguments: str | Path) -> Result:
    return invoke(["hand", *map(str, arguments)], catch_exceptions=True)


# Where the hand begins.


@pytest.mark.parametrize("joints_above", [1, 6])
def test_what_is_above_the_palm_is_left_out(joints_above: int, tmp_path: Path) -> None:
    """A wrist or an arm makes no difference to the hand, and is named."""
    alone = guess(tmp_path, JAWS, SLIDES)
    links, joints = arm(joints_above)
    whole = guess(tmp_path, {**links, **JAWS}, {**joints, **SLIDES})
    assert alone.urdf is None
    assert whole.urdf is not None
    assert "above the palm" not in "".join(alone.review)
    assert grasp_of(whole) == grasp_of(alone)
    hand = loaded(whole)
    assert (hand.joints, hand.chains) == (["slide"], ["left", "right"])
    for number in range(joints_above):
        assert [f"joint arm_joint_{number} is above" in line for line in whole.review].count(True) == 1
    links_above = f"{joints_above} link{'s' if joints_above > 1 else ''} above the palm"
    assert links_above in whole.review[joints_above]


def test_an_arm_with_one_jaw_against_a_fixed_one(tmp_path: Path) -> None:
    """The palm is the body before the last joint of an arm; a chain of parallel joints is a finger."""
    links, joints = arm(5)
    jaw = {"palm": [PALM, Box((-0.03, 0.0, 0.07), (0.012, 0.024, 0.08), "fixed_jaw")], "right": [RIGHT]}
    slide = {"slide": Joint("palm", "right", (0.04, 0.0, 0.03), (-1.0, 0.0, 0.0), (0.0, 0.06), "prismatic")}
    assert loaded(guess(tmp_path, {**links, **jaw}, {**joints, **slide})).joints == ["slide"]
    bones = {"palm": [PALM], "near": [Box(LEFT.center, LEFT.size)], "far": [LEFT]}
    bends = {
        "near": Joint("palm", "near", (-0.04, 0.0, 0.03), (0.0, 1.0, 0.0), (0.0, 1.5)),
        "far": Joint("near", "far", (0.0, 0.0, 0.1), (0.0, 1.0, 0.0), (0.0, 1.5)),
    }
    assert loaded(guess(tmp_path, bones, bends)).joints == ["near", "far"]


def test_a_robot_with_two_hands_needs_a_base(tmp_path: Path) -> None:
    links: dict[str, list[Box]] = {"body": [PALM]}
    joints: dict[str, Joint] = {}
    for side, x in (("a", -0.3), ("b", 0.3)):
        links |= {f"{side}_{name}": boxes for name, boxes in JAWS.items()}
        joints[f"{side}_shoulder"] = Joint("body", f"{side}_palm", (x, 0.0, 0.0), (0.0, 0.0, 1.0), (-1.0, 1.0))
        for name, joint in SLIDES.items():
            follows = f"{side}_{joint.follows}" if joint.follows else ""
            parent, child = f"{side}_{joint.parent}", f"{side}_{joint.child}"
            joints[f"{side}_{name}"] = Joint(parent, child, joint.at, joint.axis, joint.limits, joint.kind, follows)
    unnamed = {name: [Box(box.center, box.size) for box in boxes] for name, boxes in links.items()}
    with pytest.raises(HandError, match="several hands, which begin with a_palm, b_palm; name the palm"):
        guess(tmp_path, unnamed, joints)
    assert loaded(guess(tmp_path, unnamed, joints, base="b_palm")).joints == ["b_slide"]
    with pytest.raises(HandError, match="no link 'c_palm'"):
        guess(tmp_path, unnamed, joints, base="c_palm")


def test_a_bone_of_the_palm_with_two_fingers_is_no_palm(tmp_path: Path) -> None:
    """Fingers on a bone that moves, and others on the palm itself: all belong to the hand."""
    links = {name: [Box((0.0, 0.0, 0.04), (0.01, 0.01, 0.08))] for name in ("thumb", "index", "ring", "little")}
    links |= {"palm": [PALM], "bone": [Box((0.0, 0.0, 0.01), (0.02, 0.04, 0.02))]}
    roots = {"thumb": ("palm", -0.04, 0.0), "index": ("palm", 0.04, -0.02)}
    roots |= {"ring": ("bone", 0.0, 0.0), "little": ("bone", 0.0, 0.02)}
    joints = {
        name: Joint(parent, name, (x, y, 0.03), (0.0, 1.0 if name == "thumb" else -1.0, 0.0), (0.0, 1.2))
        for name, (parent, x, y) in roots.items()
    }
    joints["bone"] = Joint("palm", "bone", (0.04, 0.02, 0.0), (0.0, 0.0, 1.0), (-0.2, 0.2))
    guessed = guess(tmp_path, links, joints)
    assert guessed.urdf is None
    assert set(loaded(guessed).joints) == set(joints)
    assert set(grasp_of(guessed)["closing"]) >= {"thumb", "index", "ring", "little"}


def test_the_command_writes_the_urdf_of_the_hand_alone(tmp_path: Path) -> None:
    links, joints = arm(2)
    robot, out = tmp_path / "robot.urdf", tmp_path / "robot.toml"
    robot.write_text(text := urdf({**links, **JAWS}, {**joints, **SLIDES}))
    result = run("new", robot, "--out", out)
    assert result.exit_code == 0, result.output
    assert result.stdout.count("arm_joint_0 is above the palm") == 1
    assert robot.read_text() == text
    # The URDF beside the file would be the robot's own.
    assert graspbox.load_hand((tmp_path / "robot_hand.urdf", out)).joints == ["slide"]
    out = tmp_path / "hand.toml"
    assert run("new", robot, "--out", out, "--base", "palm").exit_code == 0
    assert graspbox.load_hand((tmp_path / "hand.urdf", out)).joints == ["slide"]
    for toml, alone in (("robot.toml", "robot_hand.urdf"), ("hand.toml", "hand.urdf")):
        with pytest.raises(HandError, match=f"may belong to .*{alone}, the URDF beside it"):
            graspbox.load_hand((robot, tmp_path / toml))
    assert run("new", robot, "--out", tmp_path / "other.toml", "--base", "claw").exit_code == 2
    # The names of the files that are written differ from each other.
    found = json.loads(run("new", robot, "--out", tmp_path / "x.urdf", "--json").stdout)
    assert (found["urdf"], found["out"]) == (str(tmp_path / "x_hand.urdf"), str(tmp_path / "x.urdf"))


def test_another_urdf_is_not_replaced(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Neither after a search, nor after minutes of fitting."""

    def refuse(*_: Any) -> None:
        raise AssertionError("too late")

    links, joints = arm(2)
    robot, other = tmp_path / "robot.urdf", tmp_path / "hand.urdf"
    text = urdf({**links, **JAWS}, {**joints, **SLIDES})
    robot.write_text(text.replace('<box size="0.1 0.05 0.03"/>', '<mesh filename="none.stl"/>'))
    other.write_text("another robot")
    monkeypatch.setattr("graspbox.cli.hand._search", refuse)
    for options in ((), ("--search", "100")):
        result = run("new", robot, "--out", tmp_path / "hand.toml", *options)
        assert isinstance(result.exception, ConfigError)
        assert "hand.urdf' exists; give --force" in str(result.exception)
    assert other.read_text() == "another robot"


def test_lines_are_those_of_files_that_exist(tmp_path: Path) -> None:
    """Errors and assumptions name the robot's lines, but for those of what is left out, of which there are none."""
    links, joints = arm(2)
    robot, out = tmp_path / "robot.urdf", tmp_path / "hand.toml"
    text = urdf({**links, **JAWS}, {**joints, **SLIDES})
    lines = text.splitlines()
    palm, arm_link = (
        next(i for i, one in enumerate(lines) if f'link name="{name}"' in one) for name in ("palm", "arm_1")
    )

    def changed(at: int, old: str, new: str) -> None:
        assert old in lines[at]
        robot.write_text("\n".join([*lines[:at], lines[at].replace(old, new), *lines[at + 1 :]]))

    changed(palm, '<box size="0.1 0.05 0.03"/>', '<mesh filename="none.stl"/>')
    message = f"{robot}:{palm + 1}: collider 'palm_0': mesh 'none.stl' is missing"
    with pytest.raises(HandError, match=re.escape(message)):
        guess_hand(robot)
    changed(palm, '<mass value="0.1"/>', '<mass value="-1"/>')
    with pytest.raises(HandError, match=re.escape(f"{robot}:{palm + 1}: ")):
        guess_hand(robot)
    changed(arm_link, '<mass value="0.1"/>', '<mass value="-1"/>')
    assert loaded(guess_hand(robot)).joints == ["slide"]
    lines[palm] = re.sub("<inertial>.*</inertial>", "", lines[palm])
    robot.write_text("\n".join(lines))
    result = run("new", robot, "--out", out)
    (place,) = re.findall(r"assumed: (\S+):(\d+): link \"palm\"", result.stdout)
    assert place == (str(robot), str(palm + 1))
    written = (tmp_path / "hand.urdf").read_text()
    assert all(line.strip() for line in written.splitlines())
    assert "arm_1" not in written


def test_a_cut_keeps_lines_and_what_is_in_quotes(tmp_path: Path) -> None:
    """Comments, tags over several lines, and a > within a value are no trouble."""
    text = """<?xml version="1.0"?>
<robot name="a>b é">
  <!-- an arm: <link name="palm"/> -->
  <link name="arm"
        note="a > b"/>
  <material name="red"><color rgba="1 0 0 1"/></material>
  <joint name="elbow" type="revolute">
    <parent link="arm"/><child link="palm"/><limit lower="0" upper="1" effort="1" velocity="1"/>
  </joint>
  <link name="palm">
    <visual note='visual>'><geometry><box size="1 1 1"/></geometry></visual><collision><geometry>
      <box size="0.1 0.1 0.1"/></geometry></collision>
  </link>
  <link name="finger"/><joint name="knuckle" type="revolute"><parent link="palm"/><child link="finger"/></joint>
</robot>
"""
    cut = cut_above_palm(tmp_path / "robot.urdf", text, "palm")
    assert cut is not None
    assert cut.joints == ("elbow",)
    lines = cut.text.splitlines()
    assert len(lines) == len(text.splitlines())
    assert [number for number, line in enumerate(lines) if line.strip()] == [0, 1, 9, 10, 11, 12, 13, 14]
    robot = ElementTree.fromstring(cut.text)
    assert [element.get("name") for element in robot] == ["palm", "finger", "knuckle"]
    assert robot.find("link/visual") is None
    assert robot.find("link/collision") is not None


def test_a_large_robot_may_have_a_hand(tmp_path: Path) -> None:
    """More moving joints than a hand may have are no error of the hand alone."""
    links, joints = arm(70)
    assert loaded(guess(tmp_path, {**links, **JAWS}, {**joints, **SLIDES})).joints == ["slide"]
    with pytest.raises(HandError, match=r"made.urdf:1: there are \d+ moving joints; at most 64"):
        guess(tmp_path, {**links, **JAWS}, {**joints, **SLIDES}, base="arm_0")


def ring() -> dict[str, Joint]:
    return {"turn": Joint("left", "palm", (0, 0, 0), (0, 0, 1), (0, 1)), **SLIDES}


@pytest.mark.parametrize(
    ("joints", "change", "base"),
    [
        ({**SLIDES, "more": Joint("left", "right", (0, 0, 0), (0, 0, 1), (0, 1))}, ("", ""), None),
        (SLIDES, ('<parent link="palm"/><child link="right"/>', '<parent link="none"/><child link="right"/>'), None),
        (ring(), ("", ""), "palm"),
        (SLIDES, ('<link name="right">', '<link name="left">'), None),
        (SLIDES, ('xyz="1 0 0"', 'xyz="1 0"'), None),
        (SLIDES, ('xyz="1 0 0"', 'xyz="1 nan 0"'), None),
        (arm(1500)[1], ("", ""), None),
    ],
)
def test_what_is_no_tree_is_not_cut(
    joints: dict[str, Joint], change: tuple[str, str], base: str | None, tmp_path: Path
) -> None:
    links = arm(1500)[0] if len(joints) > 1000 else {"world": [PALM], "more": [PALM]}
    wrist = {} if len(joints) > 1000 else {"wrist": Joint("world", "palm", (0, 0, 0), (0, 0, 1), (0, 1))}
    if base is not None:  # nothing hangs on the world but another link
        wrist = {"wrist": Joint("world", "more", (0, 0, 0), (0, 0, 1), (0, 1))}
    text = urdf({**links, **JAWS}, {**wrist, **joints})
    assert change[0] in text
    path = tmp_path / "made.urdf"
    path.write_text(text.replace(*change) if change[0] else text)
    assert cut_above_palm(path, path.read_text(), base) is None
    with pytest.raises(HandError, match=r"made.urdf:\d+: "):
        guess_hand(path, base=base)


def test_a_comment_about_xacro_is_no_xacro(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(_: Path) -> str:
        raise AssertionError("expanded")

    monkeypatch.setattr("graspbox.hands.reading._expanded", refuse)
    monkeypatch.setattr("graspbox.hands.reading.find_spec", lambda _: object())
    path = tmp_path / "made.urdf"
    path.write_text(
        urdf(JAWS, SLIDES).replace("</robot>", '<!-- made from\n<xacro:include filename="a"/> -->\n</robot>')
    )
    assert loaded(guess_hand(path)).joints == ["slide"]


# How it opens and closes.


def test_fingers_do_not_open_below_the_palm(tmp_path: Path) -> None:
    wide, usual = guess(tmp_path, JAWS, turning(-2.4, 0.6)), guess(tmp_path, JAWS, turning(-0.4, 0.6))
    hand = loaded(wide)
    tips = hand.shapes(hand.open(0.0))[0][1:, 2, 3]
    assert (tips > 0.025).all()
    assert -1.0 < hand.open(0.0)[0] < -0.4
    # The hand may still go to the limits of its joints.
    assert hand.joint_limits.tolist() == [[-2.4, 0.6]] * 2
    np.testing.assert_allclose(loaded(usual).open(0.0), [-0.4, -0.4], atol=1e-6)
    assert "positions" not in grasp_of(usual)["preshapes"][0]
    assert min(held(hand, "procedural:can:0")) > 3


def test_rails_that_cross_the_middle_do_not_turn_the_closing(tmp_path: Path) -> None:
    """The middles of fingers with long rails pass each other, their pads do not."""
    rails = {
        "left": [LEFT, Box((0.03, 0.018, 0.005), (0.08, 0.01, 0.01))],
        "right": [RIGHT, Box((-0.03, -0.018, 0.005), (0.08, 0.01, 0.01))],
    }
    slides = {
        "left": Joint("palm", "left", (-0.025, 0.0, 0.03), (1.0, 0.0, 0.0), (-0.02, 0.0245), "prismatic"),
        "right": Joint("palm", "right", (0.025, 0.0, 0.03), (-1.0, 0.0, 0.0), (-0.02, 0.0245), "prismatic"),
    }
    guessed = guess(tmp_path, {"palm": [PALM], **rails}, slides)
    hand = loaded(guessed)
    np.testing.assert_allclose(hand.open(0.0), [-0.02, -0.02], atol=1e-6)
    assert hand.widest == pytest.approx(2 * 0.045 - 2 * 0.009 - 0.002, abs=1e-6)
    assert not check_hand(hand, trials=False).has_errors


def test_the_width_of_a_linkage_is_that_between_its_pads(tmp_path: Path) -> None:
    """Bars inside of the fingers come closer than the pads; they are no fingers."""
    links: dict[str, list[Box]] = {"palm": [PALM]}
    joints: dict[str, Joint] = {}
    for side, sign in (("l", 1.0), ("r", -1.0)):
        axis = (0.0, sign, 0.0)
        leader = "l_knuckle" if side == "r" else ""
        links[f"{side}_knuckle"] = [Box((0.0, 0.0, 0.03), (0.008, 0.012, 0.06))]
        links[f"{side}_finger"] = [Box((sign * 0.02, 0.0, 0.025), (0.008, 0.02, 0.05))]
        links[f"{side}_bar"] = [Box((0.0, 0.016, 0.03), (0.008, 0.008, 0.06))]
        joints[f"{side}_knuckle"] = Joint(
            "palm", f"{side}_knuckle", (-sign * 0.07, 0, 0.03), axis, (0, 0.7), follows=leader
        )
        joints[f"{side}_finger"] = Joint(
            f"{side}_knuckle", f"{side}_finger", (0, 0, 0.06), axis, (-0.7, 0), follows="l_knuckle", ratio=-1.0
        )
        joints[f"{side}_bar"] = Joint(
            "palm", f"{side}_bar", (-sign * 0.05, 0, 0.03), axis, (0, 0.7), follows="l_knuckle"
        )
    guessed = guess(tmp_path, links, joints)
    assert loaded(guessed).widest == pytest.approx(2 * (0.07 - 0.024) - 0.002, abs=1e-6)
    assert tomllib.loads(guessed.text)["pads"] == ["l_finger_0", "r_finger_0"]
    found = check_hand(loaded(guessed), trials=False).findings
    assert not [f for f in found if f.check in ("closing", "pads") and f.severity == "error"]
    assert not [f for f in found if f.check == "pads"]


def test_one_jaw_against_a_fixed_one(tmp_path: Path) -> None:
    fixed = Box((-0.03, 0.0, 0.07), (0.012, 0.024, 0.08), "fixed_jaw")
    slide = {"slide": Joint("palm", "right", (0.04, 0.0, 0.03), (-1.0, 0.0, 0.0), (0.0, 0.06), "prismatic")}
    guessed = guess(tmp_path, {"palm": [PALM, fixed], "right": [RIGHT]}, slide)
    assert tomllib.loads(guessed.text)["pads"] == ["r_pad", "fixed_jaw"]
    grasp = grasp_of(guessed)
    # z out of the palm, along the jaws; x across; the centre between the fixed jaw and the open one.
    assert grasp["rpy"]["value"] == [0.0, 0.0, 0.0]
    assert grasp["xyz"]["value"][0] == pytest.approx((-0.024 + 0.031) / 2, abs=2e-3)
    least, most = grasp["closing_range"]["value"]
    assert least == -most
    assert 0.015 < most < 0.0275
    succeeded, tried = held(loaded(guessed), "procedural:box:1")
    assert tried == 6
    assert succeeded >= 4


def test_a_jaw_that_swings_beside_its_plane(tmp_path: Path) -> None:
    """The hinge lies behind the plane in which the jaw moves, and the roots of both jaws are close together."""
    fixed = Box((-0.025, 0.0, 0.065), (0.012, 0.024, 0.09), "fixed_jaw")
    jaw = Box((0.0, 0.02, 0.04), (0.012, 0.024, 0.09), "moving_jaw")
    swing = {"swing": Joint("palm", "jaw", (0.0, -0.02, 0.025), (0.0, 1.0, 0.0), (-0.2, 1.2))}
    guess = begin_guess(made(tmp_path, {"palm": [PALM, fixed], "jaw": [jaw]}, swing))
    assert guess.axes[1] == pytest.approx([0.0, 1.0, 0.0], abs=1e-6)
    way = 2 * 0.04 * np.sin(1.4 / 2)
    assert Postures(guess).opening() == pytest.approx(way, rel=0.1)
    succeeded, tried = held(loaded(guess.write()), "procedural:can:1", 0.6)
    assert (succeeded >= 4, tried) == (True, 6)


def test_slow_motors_are_taken_to_be_faster(tmp_path: Path) -> None:
    path = tmp_path / "made.urdf"
    path.write_text(urdf(JAWS, turning(-0.4, 0.6)).replace('velocity="2"', 'velocity="0.1"'))
    guessed = guess_hand(path)
    assert any("would close in more than 1.2 s" in item for item in guessed.review)
    assert min(loaded(guessed).closing_speeds) == pytest.approx(1.0)


# What is said.


@pytest.mark.parametrize(("effort", "believed"), [(0.93, True), (5.0, True), (10.0, False)])
def test_efforts_that_no_finger_has_are_not_believed(effort: float, believed: bool, tmp_path: Path) -> None:
    """Equal motors are judged together, where they push least.

    5 N m are 52 N at the fingertip with the longest lever, and 217 N with the shortest.
    """
    path = tmp_path / "leap.urdf"
    path.write_text((ASSETS / "leap/leap.urdf").read_text().replace('effort="0.93"', f'effort="{effort}"'))
    limits = [actuator["load_limit"] for actuator in tomllib.loads(guess_hand(path).text)["actuators"]]
    assert len(limits) == 16
    source = "URDF: effort of the joint"
    if not believed:
        source = "guess: the URDF states an effort of 10 N m, which is not believable; 30 N at the fingertip"
    assert {limit["source"] for limit in limits} == {source}
    assert all((limit["value"] == effort) == believed for limit in limits)


def test_wrong_lines_come_before_meshes(tmp_path: Path) -> None:
    """Nothing is fitted, and the line is that of the file."""
    path = tmp_path / "made.urdf"
    text = urdf(JAWS, SLIDES).replace('<box size="0.1 0.05 0.03"/>', '<mesh\nfilename="none.stl"\n/>')
    path.write_text(text.replace('<mass value="0.1"/>', '<mass value="-1"/>'))
    with pytest.raises(HandError, match=r"made\.urdf:2: .*mass") as raised:
        guess_hand(path)
    assert "none.stl" not in str(raised.value)
    lines = [line for line in str(raised.value).splitlines() if "made.urdf:" in line]
    assert [line.split("made.urdf:")[1].split(":")[0] for line in lines] == ["2", "5", "6"]


def test_no_remark_follows_a_fatal_error(tmp_path: Path) -> None:
    path = tmp_path / "made.urdf"
    path.write_text(urdf(JAWS, SLIDES).replace('<child link="left"/>', '<child link="none"/>'))
    result = run("new", path, "--out", tmp_path / "hand.toml")
    assert result.exit_code == 2
    assert "compare it with the maker's" not in result.stderr


def test_pictures_of_shapes_on_the_next_joint(tmp_path: Path) -> None:
    links = {"palm": [PALM], "base": [Box((0.0, 0.0, 0.01), (0.02, 0.02, 0.02))], "left": [LEFT], "right": [RIGHT]}
    joints = turning(-0.4, 0.6)
    joints["spread"] = Joint("palm", "base", (-0.04, 0.0, 0.03), (0.0, 0.0, 1.0), (-0.3, 0.3))
    joints["turn_left"] = Joint("base", "left", (0.0, 0.0, 0.01), (0.0, 1.0, 0.0), (-0.4, 0.6))
    path, picture = tmp_path / "made.urdf", tmp_path / "hand.png"
    path.write_text(urdf(links, joints))
    result = run("new", path, "--out", tmp_path / "hand.toml", "--picture", picture)
    assert result.exit_code == 0, result.output
    assert picture.read_bytes()[:4] == b"\x89PNG"


def test_the_empty_closing_names_what_stops_it(tmp_path: Path) -> None:
    """Pads that meet, or a lump on a finger, which meets the other one sooner."""

    def stops(left: list[Box]) -> list[tuple[int, str]]:
        report = check_hand(loaded(guess(tmp_path, {**JAWS, "left": left}, turning(-0.4, 0.6))))
        first, *rows = [finding for finding in report.findings if finding.check == "empty closing"]
        assert first.value == "0 of 2"
        return [(int(row.value.split("%")[0]), row.message) for row in rows]

    free = stops([LEFT])
    assert [message for _, message in free] == ["l_pad and r_pad meet there"] * 2
    early = stops([LEFT, Box((0.03, 0.0, 0.06), (0.05, 0.01, 0.01), "lump")])
    assert any("lump and r_pad meet there" in message for _, message in early)
    assert sum(share for share, _ in early) < sum(share for share, _ in free) - 20


def test_json_of_a_new_hand_has_no_search_without_one(tmp_path: Path) -> None:
    path = tmp_path / "made.urdf"
    path.write_text(urdf(JAWS, SLIDES))
    table = json.loads(run("new", path, "--out", tmp_path / "hand.toml", "--json").stdout)
    assert "search" not in table
