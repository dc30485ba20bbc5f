"""Checks of a stranger's hand and guessed files: shipped hands broken in one way each, and mutated URDFs."""

import json
import random
import re
import tomllib
from pathlib import Path

import numpy as np
import pytest
from typer.testing import Result

import graspbox
from command_line import invoke
from graspbox import errors
from graspbox._common.rotations import rotation_from_euler
from graspbox.hand_tools import Finding, check_hand, guess_hand
from graspbox.hand_tools.bodies import inertia_of
from graspbox.hand_tools.boxes import gaps
from graspbox.hand_tools.closing import Fingers, guess_closing
from graspbox.hand_tools.findings import CheckedHand
from graspbox.hand_tools.motion import overlaps
from graspbox.hand_tools.tables import minimal, quoted
from graspbox.hand_tools.trials import trials
from graspbox.hands.description import describe_urdf

NAMES = graspbox.Hand.names()
ASSETS = Path(__file__).parents[2] / "env/hand/assets"
#: A ball of 0.2 kg, 0.1 m above its link's origin.
INERTIAL = (
    '<inertial><origin xyz="0 0 0.1"/><mass value="0.2"/>'
    '<inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial>'
)


def broken(name: str, *changes: tuple[str, str]) -> graspbox.Hand:
    """Make a shipped hand with changes, each a regular expression in one of its files and its replacement."""
    texts = list(graspbox.load_hand(name).files)
    for pattern, replacement in changes:
        counts = []
        for index, text in enumerate(texts):
            texts[index], count = re.subn(pattern, replacement, text, flags=re.DOTALL)
            counts.append(count)
        assert sum(counts) > 0, pattern
    urdf, toml = texts
    return graspbox.Hand(urdf, toml)


def findings(hand: graspbox.Hand, check: str) -> list[Finding]:
    return [finding for finding in check_hand(hand, trials=False).findings if finding.check == check]


def one(hand: graspbox.Hand, check: str, severity: str, message: str) -> Finding:
    """Find the one finding of this kind."""
    found = [f for f in findings(hand, check) if f.severity == severity and re.search(message, f.message)]
    assert len(found) == 1, findings(hand, check)
    assert found[0].subject
    return found[0]


def run(*arguments: str | Path) -> Result:
    return invoke(["hand", *map(str, arguments)], catch_exceptions=True)


@pytest.mark.parametrize("name", NAMES)
def test_shipped_hands_have_no_errors_and_no_warnings(name: str) -> None:
    report = check_hand(name)
    assert report.name == name
    assert {finding.severity for finding in report.findings} == {"note"}, report
    held = [finding for finding in report.findings if finding.check == "trials"]
    assert len(held) == 3
    assert all(int(finding.value.split()[0]) > 0 for finding in held)


# Units, limits, inertias.


def test_millimetres() -> None:
    hand = broken("panda_gripper", (r'(<joint name="finger_joint1".*?<origin xyz=")0 0 0.0584', r"\g<1>0 0 5.84"))
    found = one(hand, "units", "error", "millimetres")
    assert (found.subject, found.value) == ("joint finger_joint1", "5.84 m")
    hand = broken("panda_gripper", (r'size="0.020 0.016 0.045"', 'size="0.020 0.016 4.5"'))
    shapes = [f.subject for f in findings(hand, "units") if "a side of it" in f.message]
    assert shapes == ["shape leftfinger_body", "shape rightfinger_body"]


def test_degrees() -> None:
    hand = broken("robotiq_2f_85", (r'(<joint name="left_knuckle_joint".*?upper=")0.8', r"\g<1>8"),
                  (r'lower="-0.8"', 'lower="-8"'), (r'upper="0.8"', 'upper="8"'))  # fmt: skip
    found = [f for f in findings(hand, "units") if "degrees" in f.message]
    assert len(found) == 6
    assert found[0].value == "8 rad"


@pytest.mark.parametrize(("mass", "severity"), [("730", "error"), ("0.0000001", "warning")])
def test_grams(mass: str, severity: str) -> None:
    small = (r'<mass value="0.015"/>', '<mass value="0.00001"/>')
    hand = broken("panda_gripper", (r'<mass value="0.73"/>', f'<mass value="{mass}"/>'), small)
    assert one(hand, "units", severity, "mass|light").subject == "mass of all links"


def test_a_joint_without_a_range() -> None:
    hand = broken("panda_gripper", (r'upper="0.04"', 'upper="0.00005"'), (r"\[0.0, 0.04\]", "[0.0, 0.00005]"))
    assert {f.subject for f in findings(hand, "limits")} == {"joint finger_joint1", "joint finger_joint2"}


@pytest.mark.parametrize(("mass", "words"), [("0.0001", "too small"), ("5", "too large")])
def test_densities(mass: str, words: str) -> None:
    hand = broken("panda_gripper", (r'(<link name="leftfinger">.*?<mass value=")0.015', rf"\g<1>{mass}"))
    assert one(hand, "inertia", "warning", words).subject == "link leftfinger"


def test_a_centre_of_mass_far_away() -> None:
    hand = broken("panda_gripper", (r'<origin xyz="0 0.0145 0.0262"/>', '<origin xyz="0 0.0145 0.262"/>'))
    assert one(hand, "inertia", "warning", "outside its collision boxes").subject == "link leftfinger"


@pytest.mark.parametrize(
    ("moments", "words"), [(("2e-3", "2e-3", "2e-3"), "accelerate"), (("2e-9",) * 3, "tiny steps")]
)
def test_inertias_of_another_size(moments: tuple[str, str, str], words: str) -> None:
    inertia = r'(<link name="leftfinger">.*?)<inertia [^>]*>'
    ixx, iyy, izz = moments
    new = rf'\g<1><inertia ixx="{ixx}" iyy="{iyy}" izz="{izz}" ixy="0" ixz="0" iyz="0"/>'
    assert one(broken("panda_gripper", (inertia, new)), "inertia", "warning", words).subject == "link leftfinger"


# Actuators.


def test_travel_that_misses_limits() -> None:
    hand = broken("panda_gripper", (r"travel = \{ value = \[0.0, 0.04\]", "travel = { value = [0.0, 0.02]"))
    found = one(hand, "travel", "warning", "does not cover")
    assert found.value == "[0.02, 0.04] m"
    hand = broken("panda_gripper", (r"travel = \{ value = \[0.0, 0.04\]", "travel = { value = [0.0, 0.06]"))
    assert one(hand, "travel", "note", "beyond").value == "[-0.02, 0.04] m"
    hand = broken("soft_hand", (r"value = \[0.0, 13.78\]", "value = [0.0, 6.0]"))
    assert "never closes completely" in one(hand, "travel", "warning", "winds less").message


@pytest.mark.parametrize(
    ("name", "gain", "severity"),
    [("panda_gripper", "0.015", "warning"), ("panda_gripper", "0.03", "error"), ("soft_hand", "9.0", "error")],
)
def test_force_control_that_is_too_fast(name: str, gain: str, severity: str) -> None:
    hand = broken(name, (r"force_gain = \{ value = [\d.]+", f"force_gain = {{ value = {gain}"))
    found = one(hand, "stability", severity, "times the force's error")
    # The remedy settles.
    (wanted,) = re.findall(r"at most ([\d.e-]+)", found.remedy)
    hand = broken(name, (r"force_gain = \{ value = [\d.]+", f"force_gain = {{ value = {wanted}"))
    assert findings(hand, "stability") == []


@pytest.mark.parametrize(("damping", "words"), [("1.0", "rings"), ("50000.0", "creeps")])
def test_servos_that_ring_or_creep(damping: str, words: str) -> None:
    hand = broken("panda_gripper", (r"servo.damping = \{ value = 150.0", f"servo.damping = {{ value = {damping}"))
    found = one(hand, "stability", "warning", words)
    (wanted,) = re.findall(r"about ([\d.]+):", found.remedy)
    assert float(wanted) == pytest.approx(2 * np.sqrt(5e4 * 0.13), rel=0.1)


def test_inertia_that_a_joint_moves() -> None:
    """Two fingers of 15 g slide; a knuckle turns its finger."""
    assert inertia_of(graspbox.load_hand("panda_gripper"), 0, [0.02]) == pytest.approx(0.03)
    text = (
        f'<robot name="r"><link name="a">{INERTIAL}</link>'
        f'<link name="b">{INERTIAL}</link>'
        '<joint name="j" type="revolute"><parent link="a"/><child link="b"/><axis xyz="0 1 0"/>'
        '<limit lower="0" upper="1" effort="1" velocity="1"/></joint></robot>'
    )
    hand = graspbox.Hand(text, minimal(describe_urdf(text, "r.urdf")))
    assert inertia_of(hand, 0, [0.4]) == pytest.approx(0.01 + 0.2 * 0.1**2)


def test_sensors() -> None:
    assert one(graspbox.load_hand("panda_gripper"), "sensors", "note", "tactile").value == "none"
    assert one(graspbox.load_hand("soft_hand"), "sensors", "note", "privileged").subject == "joint encoders"
    assert findings(graspbox.load_hand("reflex"), "sensors") == []


# The closing motion.


def test_chains_without_pads() -> None:
    hand = broken("panda_gripper", (r'pads = \["leftfinger_pad", "rightfinger_pad"\]', 'pads = ["leftfinger_pad"]'))
    assert one(hand, "pads", "warning", "is a pad").subject == "chain rightfinger"
    hand = broken("panda_gripper", (r'pads = .*?\]', 'pads = ["leftfinger_pad"]'),
                  (r'<collision name="rightfinger.*?</collision>', ""))  # fmt: skip
    assert one(hand, "pads", "warning", "passes through").subject == "chain rightfinger"


def test_fingers_that_do_not_meet() -> None:
    hand = broken("panda_gripper", (r'<origin xyz="0 0.005 0.0449"/>', '<origin xyz="0 0.025 0.0449"/>'))
    found = one(hand, "closing", "warning", "no closer")
    assert found.value == "20.0 mm"


def test_fingers_that_move_apart() -> None:
    hand = broken("panda_gripper", (r"ratio = \{ value = -1.0", "ratio = { value = 1.0"),
                  (r"offset = \{ value = 0.04", "offset = { value = 0.0"))  # fmt: skip
    assert "sign of `ratio`" in one(hand, "closing", "error", "apart").remedy


def test_a_hand_without_fingers() -> None:
    hand = broken("panda_gripper", (r"pads = .*?\]", "pads = []"),
                  (r'<collision name="(left|right)finger.*?</collision>', ""))  # fmt: skip
    one(hand, "closing", "error", "nothing to hold")


def test_overlaps() -> None:
    """In the open hand; before the pads meet; onto pads or palm, which is no mistake."""
    wide = (
        r'(<collision name="(left|right)finger_body">\s*<origin [^>]*>\s*<geometry><box size="0.020 )0.016',
        r"\g<1>0.12",
    )
    hand = broken("panda_gripper", wide)
    found = one(hand, "self-collision", "note", "they overlap in the open hand, so the simulation lets them pass")
    assert found.subject == "leftfinger and rightfinger"
    assert [f.severity for f in findings(hand, "self-collision")] == ["note"]
    wide = (wide[0], r"\g<1>0.07")
    found = one(
        broken("panda_gripper", wide),
        "self-collision",
        "warning",
        r"60% closed: bare shapes meet with the pads 32 mm apart",
    )
    assert found.value == "20.0 mm at most"
    assert not [
        f for name in NAMES for f in findings(graspbox.load_hand(name), "self-collision") if f.severity != "note"
    ]
    notes = [f.message for f in findings(graspbox.load_hand("soft_hand"), "self-collision")]
    assert any("pads touch" in message for message in notes)
    assert any("links of one chain" in message for message in notes)
    assert any("onto the palm" in f.message for f in findings(graspbox.load_hand("reflex"), "self-collision"))


def test_round_shapes_that_miss_each_other_are_open() -> None:
    """Boxes around two upright cylinders side by side overlap; the cylinders do not."""
    shape = '<collision name="{}"><geometry><cylinder radius="0.01" length="0.04"/></geometry></collision>'
    links = "".join(f'<link name="{name}">{INERTIAL}{shape.format(f"{name}_shape")}</link>' for name in ("a", "b"))
    slide = (
        '<joint name="{0}" type="prismatic"><parent link="palm"/><child link="{0}"/><origin xyz="{1} {1} 0.1"/>'
        '<axis xyz="0 0 {2}"/><limit lower="0" upper="0.01" effort="10" velocity="1"/></joint>'
    )
    joints = slide.format("a", 0.0085, 1) + slide.format("b", -0.0085, 1)
    text = f'<robot name="r"><link name="palm">{INERTIAL}</link>{links}{joints}</robot>'
    hand = graspbox.Hand(text, minimal(describe_urdf(text, "r")))
    assert list(overlaps(CheckedHand(hand))) == []


def test_gaps_between_boxes() -> None:
    turned = np.eye(4)
    turned[:2, :2] = np.array([[1.0, -1.0], [1.0, 1.0]]) / np.sqrt(2)
    moved = np.tile(np.eye(4), (4, 1, 1))
    moved[:, 0, 3] = (3.0, 2.0, 1.5, 1.0 + np.sqrt(2) + 0.1)
    moved[3, :3, :3] = turned[:3, :3]
    first, ones = np.tile(np.eye(4), (4, 1, 1)), np.ones((4, 3))
    np.testing.assert_allclose(gaps(first, ones, moved, ones), (1.0, 0.0, -0.5, 0.1), atol=1e-12)


def test_reach_width_and_symmetries() -> None:
    panda = graspbox.load_hand("panda_gripper")
    assert one(panda, "reach", "note", "how far").value == "46.3 mm"
    assert one(panda, "width", "note", "widest").value == "78.0 mm"
    assert "mirror x = 0" in one(panda, "symmetry", "note", "trainings").value
    assert one(graspbox.load_hand("soft_hand"), "symmetry", "note", "human").value == "none"
    assert one(panda, "mass", "note", "compare").value == "0.76 kg"
    assert one(graspbox.load_hand("reflex"), "width", "note", "no `width`").value == "not stated"
    wide = broken("panda_gripper", (r"width = \{ value = \[0.0, 0.078\]", "width = { value = [0.0, 0.09]"))
    assert "80.0 mm" in one(wide, "width", "warning", "exceeds").message
    back = broken("panda_gripper", (r"rpy = \{ value = \[0.0, 0.0, 1.57\d*\]", "rpy = { value = [3.1416, 0.0, 0.0]"),
                  (r"xyz = \{ value = \[0.0, 0.0, 0.066\]", "xyz = { value = [0.0, 0.0, -0.001]"))  # fmt: skip
    assert "z points out of the palm" in one(back, "reach", "error", "faces away").remedy


# Trials.


def test_trials_of_hands_that_cannot_grasp() -> None:
    weak = broken("panda_gripper", (r"load_limit = \{ value = 140.0", "load_limit = { value = 0.001"))
    found = [f for f in check_hand(weak).findings if f.check == "trials"]
    assert found[0].severity == "error"
    assert "holds any object" in found[0].message
    unknown = broken("panda_gripper", (r"\[grasp.ranking\]\nfingers", "[grasp.ranking]\nnonsense"))
    found = [f for f in check_hand(unknown).findings if f.check == "trials"]
    assert [f.severity for f in found] == ["error", "warning", "warning", "warning"]
    assert "not a term of the ranking" in found[1].message
    buried = broken("panda_gripper", (r"(\[grasp\]\nxyz = \{ value = \[0.0, 0.0, )0.066", r"\g<1>0.4"))
    found = [f for f in check_hand(buried).findings if f.check == "trials"]
    assert found[0].severity == "error"


# The command line.


def test_trials_of_a_hand_that_does_not_open() -> None:
    jaw = broken("panda_gripper", (r"width = \{ value = \[[^\]]*\]", "width = { value = [0.0, 1e-5]"))
    rows = [finding for finding in trials(CheckedHand(jaw)) if finding.subject != "planner"]
    assert len(rows) == 3
    assert all("the hand opens by 0.0 mm, too little for an object (10 mm); check" in row.message for row in rows)


def test_check_prints_findings_and_a_picture(tmp_path: Path) -> None:
    picture = tmp_path / "hand.png"
    result = run("check", "panda_gripper", "--no-trials", "--json", "--picture", picture)
    assert result.exit_code == 0, result.output
    table = json.loads(result.stdout)
    assert table["hand"] == "panda_gripper"
    assert table["counts"] == {"error": 0, "warning": 0, "note": len(table["findings"])}
    assert set(table["findings"][0]) == {"severity", "check", "subject", "value", "message", "remedy"}
    assert picture.read_bytes()[:4] == b"\x89PNG"
    text = run("check", "panda_gripper", "--no-trials").stdout
    assert "0 errors, 0 warnings" in text
    folder = ASSETS / "panda_gripper"
    assert run("check", folder / "panda_gripper.urdf", folder / "hand.toml", "--no-trials").exit_code == 0


def test_status_of_check(tmp_path: Path) -> None:
    hand = broken("panda_gripper", (r"force_gain = \{ value = [\d.]+", "force_gain = { value = 0.03"))
    paths = [tmp_path / "hand.urdf", tmp_path / "hand.toml"]
    for path, text in zip(paths, hand.files, strict=True):
        path.write_text(text)
    assert run("check", *paths, "--no-trials").exit_code == 1
    assert run("check", tmp_path / "none.urdf", paths[1]).exit_code == 2
    assert isinstance(run("check", "claw").exception, errors.ConfigError)
    assert isinstance(run("check", *paths, "more").exception, errors.ConfigError)


@pytest.mark.parametrize(
    ("pattern", "replacement", "line"),
    [
        (r'xyz="0 0 0.0584"', 'xyz="0 0 58.4"', "58.4 m: its origin is farther"),
        (r'<mass value="0.73"/>', '<mass value="-1"/>', "it must be greater than 0 kg"),
        (r'lower="0" upper="0.04"', 'lower="0.05" upper="0.04"', "the upper end must be greater"),
    ],
)
def test_files_that_are_no_hand(tmp_path: Path, pattern: str, replacement: str, line: str) -> None:
    """The core lists every wrong line; units that explain them follow."""
    urdf, toml = graspbox.load_hand("panda_gripper").files
    paths = [tmp_path / "hand.urdf", tmp_path / "hand.toml"]
    paths[0].write_text(re.sub(pattern, replacement, urdf))
    paths[1].write_text(toml)
    result = run("check", *paths)
    assert result.exit_code == 2
    assert result.stdout == ""
    assert f"{paths[0]}:" in result.stderr
    assert line in result.stderr


# Guessed files.


@pytest.mark.parametrize("name", NAMES)
def test_a_guessed_file_loads(name: str, tmp_path: Path) -> None:
    urdf = ASSETS / name / f"{name}.urdf"
    out = tmp_path / "hand.toml"
    result = run("new", urdf, "--out", out, "--name", "mine")
    assert result.exit_code == 0, result.output
    hand, shipped = graspbox.load_hand((urdf, out)), graspbox.load_hand(name)
    assert (hand.name, hand.joints) == ("mine", shipped.joints)
    text = out.read_text()
    assert text.startswith("# A first description")
    assert "Review these guesses" in result.stdout
    sources = re.findall(r'source = "([^"]*)"', text)
    assert len(sources) > 15
    assert all(source.startswith(("guess: ", "URDF: ")) for source in sources)
    words = " ".join(text.replace("#", " ").split())
    assert ("no tendon can be guessed" in words) == (name in ("reflex", "soft_hand", "leap"))
    assert not check_hand((urdf, out), trials=False).has_errors


@pytest.mark.parametrize("name", ["panda_gripper", "robotiq_2f_85"])
def test_a_guessed_gripper_is_the_shipped_one_and_grasps_boxes(name: str, tmp_path: Path) -> None:
    urdf, out = ASSETS / name / f"{name}.urdf", tmp_path / "hand.toml"
    out.write_text(guess_hand(urdf).text)
    hand, shipped = graspbox.load_hand((urdf, out)), graspbox.load_hand(name)
    np.testing.assert_allclose(hand.open(0), shipped.open(0), atol=1e-6)
    np.testing.assert_allclose(hand.closed(0, 1), shipped.closed(0, 1), atol=1e-6)
    poses, expected = hand.shapes(hand.open(0)), shipped.shapes(shipped.open(0))
    np.testing.assert_allclose(poses[0], expected[0], atol=1e-6)
    np.testing.assert_array_equal(poses[2], expected[2])
    np.testing.assert_allclose(hand.closing_center(0), shipped.closing_center(0), atol=5e-3)
    assert hand.widest == pytest.approx(shipped.widest, abs=2e-3)
    for seed in (0, 1):
        mesh = graspbox.object_sets.load(f"procedural:box:{seed}")[0].load()
        scene = graspbox.Scene(mesh, hand=hand)
        plan = graspbox.plan(mesh, hand=hand, world_from_object=scene.world_from_object)
        assert scene.simulate(plan.best(3)).success.any()


def test_directions_of_closing() -> None:
    """A jaw closes towards 0, fingers away from it; knuckles that spread fingers or turn a thumb do not close."""
    opened = {}
    for name in NAMES:
        urdf = graspbox.load_hand(name).files[0]
        hand = graspbox.Hand(urdf, minimal(describe_urdf(urdf, name)))
        closing, joints = guess_closing(Fingers(hand)), hand.joints
        opened[name] = dict(zip(joints, closing.opened.tolist(), strict=True))
        side = [joint for joint, closes in zip(joints, closing.closes, strict=True) if not closes]
        spread = {
            "soft_hand": [f"{finger}_abd" for finger in ("index", "middle", "ring", "little")],
            "reflex": ["preshape_1"],
            "leap": ["if_rot", "mf_rot", "rf_rot", "th_cmc", "th_axl"],
            "inspire": ["thumb_proximal_yaw_joint"],
        }
        assert side == spread.get(name, [])
    assert opened["panda_gripper"] == {"finger_joint1": 0.04}
    assert opened["robotiq_2f_85"] == {"left_knuckle_joint": 0.0}
    # The thumb comes round before the palm, as in the shipped preshapes.
    assert opened["inspire"]["thumb_proximal_yaw_joint"] == pytest.approx(1.3)
    assert set(opened["reflex"].values()) == set(opened["soft_hand"].values()) == {0.0}


def test_grasp_frames_that_are_guessed() -> None:
    """The approach is the shipped one for every hand, also if open fingers lie beside the palm or curl over it.

    The palm of the LEAP Hand is stepped; the guess takes the lower part. For the Inspire hand it takes the palm's
    normal; the shipped frame is turned to where the thumb meets the fingers once it is before the palm.
    """
    for name in NAMES:
        table = tomllib.loads(guess_hand(ASSETS / name / f"{name}.urdf").text)["grasp"]
        shipped = tomllib.loads(graspbox.load_hand(name).files[1])["grasp"]
        found, expected = (rotation_from_euler(np.array([grasp["rpy"]["value"]]))[0] for grasp in (table, shipped))
        if name == "inspire":
            # The shipped frame leans 0.93 rad from the fingers' direction to the palm's normal.
            assert found[:, 2] @ expected[:, 2] == pytest.approx(np.sin(0.93), abs=1e-5)
            continue
        np.testing.assert_allclose(np.abs(found.T @ expected), np.eye(3), atol=1e-5)
        assert found[:, 2] @ expected[:, 2] > 0.99
        assert found[:, 2] @ (np.array(table["xyz"]["value"]) - shipped["xyz"]["value"]) == pytest.approx(
            0, abs=12e-3 if name == "leap" else 1e-6
        )
        assert ("width" in table["preshapes"][0]) == (name != "soft_hand")


def test_new_keeps_files(tmp_path: Path) -> None:
    urdf, out = ASSETS / "panda_gripper/panda_gripper.urdf", tmp_path / "hand.toml"
    out.write_text("mine")
    assert isinstance(run("new", urdf, "--out", out).exception, errors.ConfigError)
    assert out.read_text() == "mine"
    result = run("new", urdf, "--out", out, "--force", "--json")
    assert result.exit_code == 0
    assert set(json.loads(result.stdout)) == {"hand", "out", "urdf", "assumptions", "review", "meshes", "loops"}
    assert tomllib.loads(out.read_text())["name"] == "panda_gripper"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "there is no element"),
        ("<robot/>", "there are no links"),
        ("<!DOCTYPE a [<!ENTITY b 'c'>]><robot/>", "document type"),
        (f'<robot name="r"><link name="a">{INERTIAL}</link></robot>', "no joint that moves"),
        ('<robot><link name="a"/><link name="b"/><joint name="j" type="revolute"><parent link="a"/><child link="b"/><limit lower="0" upper="1" effort="1" velocity="1"/></joint></robot>', "no link that a joint moves has a collision shape"),  # noqa: E501
    ],
)  # fmt: skip
def test_urdfs_that_are_no_hand(text: str, message: str, tmp_path: Path) -> None:
    path = tmp_path / "hand.urdf"
    path.write_text(text)
    with pytest.raises(errors.HandError, match=message):
        guess_hand(path)
    result = run("new", path, "--out", tmp_path / "hand.toml")
    assert result.exit_code == 2
    assert not (tmp_path / "hand.toml").exists()


def test_files_that_cannot_be_read(tmp_path: Path) -> None:
    with pytest.raises(errors.FileError):
        guess_hand(tmp_path / "none.urdf")
    path = tmp_path / "hand.urdf"
    path.write_bytes(b"\xff\xfe<robot/>")
    with pytest.raises(errors.HandError, match="UTF-8"):
        guess_hand(path)
    path.write_bytes(b"<robot>" + b" " * (1 << 20))
    with pytest.raises(errors.FileError, match="larger"):
        guess_hand(path)


def test_names_are_quoted(tmp_path: Path) -> None:
    for text in ('a "b" \\', "line\nbreak\x7f", "Ä 手", ""):
        assert tomllib.loads(f"name = {quoted(text)}")["name"] == text
    urdf = (ASSETS / "panda_gripper/panda_gripper.urdf").read_text().replace("finger_joint1", "a.b ['x']")
    path, out = tmp_path / "hand.urdf", tmp_path / "hand.toml"
    path.write_text(urdf)
    out.write_text(guess_hand(path, 'my "hand"').text)
    hand = graspbox.load_hand((path, out))
    assert (hand.name, hand.joints) == ('my "hand"', ["a.b ['x']"])


MUTANTS = ("0", "-1", "1e-9", "1e9", "nan", "", "0 0 0", "1 1", "x", "finger_joint1", "leftfinger", "hand", "fixed",
           "prismatic", "revolute", "continuous", "mesh", "0.5 0 0.5")  # fmt: skip


def mutated(text: str, numbers: random.Random) -> str:
    """Change a number, replace an attribute, or remove, double or break an element."""
    kind = numbers.choice(("number", "number", "attribute", "element"))
    if kind == "number":
        found = numbers.choice(list(re.finditer(r"-?\d+\.?\d*(?=[ \"])", text)))
        new = repr(float(found[0]) * numbers.choice((-1.0, 0.0, 0.2, 0.9, 1.1, 3.0, 30.0)))
    elif kind == "attribute":
        found = numbers.choice(list(re.finditer(r'(?<=")[^"]*(?=")', text)))
        new = numbers.choice(MUTANTS)
    else:
        elements = re.finditer(r"<(\w+)[^>]*/>|<collision.*?</collision>|<joint.*?</joint>", text, flags=re.DOTALL)
        found = numbers.choice(list(elements))
        new = numbers.choice(("", found[0] * 2, "<"))
    return text[: found.start()] + new + text[found.end() :]


@pytest.mark.filterwarnings("ignore")  # many say less than they must
@pytest.mark.parametrize("seed", range(60))
def test_mutated_urdfs_never_break_it(seed: int, tmp_path: Path) -> None:
    """A file that loads, or an error of graspbox; a loaded hand can be checked."""
    numbers = random.Random(seed)
    name = numbers.choice(("panda_gripper", "robotiq_2f_85"))
    text = (ASSETS / name / f"{name}.urdf").read_text()
    for _ in range(numbers.randint(1, 2)):
        text = mutated(text, numbers)
    path, out = tmp_path / "hand.urdf", tmp_path / "hand.toml"
    path.write_text(text)
    try:
        out.write_text(guess_hand(path).text)
    except (errors.HandError, errors.FileError):
        return
    check_hand((path, out), trials=False)
