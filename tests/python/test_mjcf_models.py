"""MJCF files as people have them: a converted hand is the one that MuJoCo compiles, and says what it assumed."""

import json
import re
import subprocess
import sys
import tomllib
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from numpy.typing import NDArray

import mjcf_models as models
from command_line import invoke
from graspbox.errors import HandError
from graspbox.hand_tools import guess_hand
from graspbox.hands import FittedUrdf, Hand, load_hand, urdf_of_mjcf
from graspbox.hands.description import describe

mujoco = pytest.importorskip("mujoco", reason="MJCF is read by mujoco, from the extra 'mjcf'")

Floats = NDArray[np.float64]

#: Each file, the base that is asked for, the body whose frame the base link has (None: the world), and the bodies of
#: MuJoCo's model that belong to the hand (None: all).
FINGERS = {"left", "left_nail", "left_tip", "right"}
CASES = {
    "plain": (models.PLAIN, None, "palm", {"palm", *FINGERS}),
    "beside": (models.BESIDE, None, "palm", {"palm", "knob", *FINGERS}),
    "floating": (models.FLOATING, None, "palm", {"palm", *FINGERS}),
    "six": (models.SIX, None, "palm", {"palm", *FINGERS}),
    "six_bodies": (models.SIX_BODIES, None, "palm", {"rail", "bx", "by", "bz", "palm", *FINGERS}),
    "arm": (models.ARM, "palm", "palm", {"palm", *FINGERS}),
}


def written(tmp_path: Path, text: str) -> Path:
    path = tmp_path / "hand.xml"
    path.write_text(text)
    return path


def converted(tmp_path: Path, text: str, base: str | None = None) -> tuple[FittedUrdf, Hand]:
    """Convert a hand, and load it with a guessed `hand.toml`."""
    fitted = urdf_of_mjcf(written(tmp_path, text), base)
    (tmp_path / "hand.urdf").write_text(fitted.text)
    toml = guess_hand(tmp_path / "hand.urdf", "made_up", fitted.no_contact).text
    (tmp_path / "hand.toml").write_text(toml)
    return fitted, load_hand((tmp_path / "hand.urdf", tmp_path / "hand.toml"))


def efforts(fitted: FittedUrdf) -> dict[str, float]:
    joints = ElementTree.fromstring(fitted.text).iterfind("joint")
    return {str(joint.get("name")): float(joint.find("limit").get("effort")) for joint in joints}  # type: ignore[union-attr, arg-type]


def combined(masses: Floats, centers: Floats, inertias: Floats) -> tuple[float, Floats, Floats]:
    """Return mass, centre of mass and inertia about it of bodies; all in one frame."""
    mass = float(masses.sum())
    center = masses @ centers / mass
    away = centers - center
    parallel = np.einsum("ni,ni->n", away, away)[:, None, None] * np.eye(3) - np.einsum("ni,nj->nij", away, away)
    return mass, center, (inertias + masses[:, None, None] * parallel).sum(axis=0)


@pytest.mark.parametrize("case", CASES)
def test_links_are_where_mujoco_has_them(case: str, tmp_path: Path) -> None:
    """Joints, axes, frames, masses, centres and inertias agree at random positions of the joints."""
    text, base, root, names = CASES[case]
    _, hand = converted(tmp_path, text, base)
    described = describe(hand)
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "hand.xml"))
    data = mujoco.MjData(model)
    assert [link.joint for link in described.moving] == ["left", "left_slide", "right"]
    bodies = [body for body in range(1, model.nbody) if model.body(body).name in names]
    rng = np.random.default_rng(0)
    for _ in range(20):
        low, high = hand.joint_limits.T
        positions: Floats = rng.uniform(low, high)
        left, slide = positions.tolist()
        # The file's own law, from where it draws both fingers: 0.3 and -0.1 rad.
        expected = {"left": left, "left_slide": slide, "right": -0.1 + 0.05 + 0.8 * (left - 0.3)}
        for name, position in expected.items():
            data.qpos[model.joint(name).qposadr[0]] = position
        mujoco.mj_forward(model, data)
        frames = hand.link_frames(positions)
        ours = np.linalg.inv(frames[0]) @ frames
        turn, origin = data.xmat[model.body(root).id].reshape(3, 3), data.xpos[model.body(root).id]
        for link in described.moving:
            joint = model.joint(link.joint).id
            moved = model.jnt_bodyid[joint]
            anchor = data.xpos[moved] + data.xmat[moved].reshape(3, 3) @ model.jnt_pos[joint]
            np.testing.assert_allclose(ours[link.index, :3, 3], turn.T @ (anchor - origin), atol=1e-8)
            axis = ours[link.index, :3, :3] @ link.axis
            np.testing.assert_allclose(axis, turn.T @ data.xaxis[joint], atol=1e-7)
            np.testing.assert_allclose(ours[link.index, :3, :3], turn.T @ data.xmat[moved].reshape(3, 3), atol=1e-7)
        own = combined(
            np.array([link.mass for link in described.links]),
            np.array([ours[link.index, :3, :3] @ link.center + ours[link.index, :3, 3] for link in described.links]),
            np.array([(r := ours[link.index, :3, :3]) @ link.inertia @ r.T for link in described.links]),
        )
        turns = turn.T @ data.ximat[bodies].reshape(-1, 3, 3)
        principal = model.body_inertia[bodies][:, :, None] * np.eye(3)
        there = combined(
            model.body_mass[bodies],
            (data.xipos[bodies] - origin) @ turn,
            turns @ principal @ turns.transpose(0, 2, 1),
        )
        assert own[0] == pytest.approx(there[0], rel=1e-8)
        np.testing.assert_allclose(own[1], there[1], atol=1e-8)
        np.testing.assert_allclose(own[2], there[2], atol=1e-10)


def test_what_was_assumed_is_named_with_its_line(tmp_path: Path) -> None:
    """Every part of the world that is taken or left out, the joints of a base, and equalities of parts left out."""
    path, lines = tmp_path / "hand.xml", models.BESIDE.splitlines()

    def line(part: str) -> str:
        """Return the place of the first line with a part of a name's attribute."""
        return f"{path}:{1 + next(number for number, text in enumerate(lines) if f'name={chr(34)}{part}' in text)}"

    taken, left = "within 20 mm of the hand; it becomes a part of its base", "away from the hand; it is left out"
    assert set(converted(tmp_path, models.BESIDE)[0].assumptions) == {
        f"{line('cube')}: body 'cube': moves beside the hand; it is left out",
        f"{line('ball')}: body 'ball': moves beside the hand; it is left out",
        f"{line('hook')}: body 'hook': is fixed in the world {left}",
        f"{line('left')}: body 'left': stands in the world with 'right'; all are taken as parts of "
        "one hand (`--base` takes one)",
        f"{line('palm')}: body 'palm': is fixed in the world {taken}",
        f"{line('table')}: body 'table': is fixed in the world {left}",
        f"{line('camera')}: body 'camera': is fixed in the world {left}",
        f"{line('base_plate')}: geom 'base_plate': is fixed in the world {taken}",
    }
    held = converted(tmp_path, models.SIX)[0].assumptions
    assert [re.sub(r".*xml:\d+: ", "", text) for text in held] == [
        "body 'palm': is a part of the base; its joints 'x', 'y', 'z', 'roll', 'pitch', 'yaw' are held where the model "
        "begins"
    ]
    cut = converted(tmp_path, models.ARM, "palm")[0].assumptions
    assert (
        "body 'palm': is the base; the 4 bodies that are not below it are left out, and its own joints 'wrist'"
        in (cut[0])
    )
    assert sum("is not between moving parts of the hand; it is left out" in text for text in cut) == 2


def test_one_of_several_things_is_the_hand(tmp_path: Path) -> None:
    """Its joints branch; a second hand must be chosen, and a body that pulls the hand about is not part of it."""
    alone = models.ARM.replace('<connect body1="shoulder" body2="world" anchor="0 0 0"/>', "")
    fitted = urdf_of_mjcf(written(tmp_path, alone))
    assert list(efforts(fitted))[:2] == ["shoulder", "wrist"]
    assert any("body 'other': moves beside the hand; it is left out" in text for text in fitted.assumptions)
    finger = '<body name="more" pos="0 0 0.2"><joint axis="0 1 0" range="0 1"/><geom size="0.01"/></body></body>'
    two = models.ARM.replace('<geom type="sphere" size="0.01"/></body></body>', f'<geom size="0.01"/></body>{finger}')
    with pytest.raises(HandError, match=r"has several hands or arms, 'foot', 'other'; choose the palm of one of them"):
        urdf_of_mjcf(written(tmp_path, two))
    hook = '<body name="hook" mocap="true" pos="1 0 0"/>'
    text = models.FLOATING.replace("<worldbody>", f"<worldbody>{hook}")
    weld = text.replace("<equality>", '<equality><weld name="pull" body1="hook" body2="palm"/>')
    notes = converted(tmp_path, weld)[0].assumptions
    assert any("equality 'pull': is not between moving parts of the hand; it is left out" in note for note in notes)
    held = text.replace("<equality>", '<equality><weld name="pull" body1="left" body2="palm"/>')
    with pytest.raises(HandError, match="equality 'pull' fixes two bodies to each other"):
        urdf_of_mjcf(written(tmp_path, held))


def test_lines_of_included_files(tmp_path: Path) -> None:
    (tmp_path / "parts").mkdir()
    (tmp_path / "parts/fingers.xml").write_text(f"<mujoco>\n\n{models.LEFT}\n{models.RIGHT}\n</mujoco>")
    world = f'<body name="palm">{models.PALM}<include file="parts/fingers.xml"/></body>'
    text = models.model(world, actuators=models.MOTORS)
    (found,) = converted(tmp_path, text)[0].assumptions
    assert found.startswith(f"{tmp_path / 'parts/fingers.xml'}:9: joint 'left_slide': its greatest force is unknown")


@pytest.mark.parametrize(
    ("base", "message"),
    [
        ("pallm", "hand.xml: has no body 'pallm'; choose from 'palm'"),
        ("left_tip", "body 'left_tip': no joint moves a body below it"),
    ],
)
def test_wrong_bases_are_refused(base: str, message: str, tmp_path: Path) -> None:
    with pytest.raises(HandError, match=re.escape(message)):
        urdf_of_mjcf(written(tmp_path, models.ARM), base)


def test_a_file_without_joints_is_refused(tmp_path: Path) -> None:
    path = written(tmp_path, "<mujoco><worldbody><body><freejoint/><geom size='1'/></body></worldbody></mujoco>")
    with pytest.raises(HandError, match="has no hinge or slide"):
        urdf_of_mjcf(path)


FIXED = '<fixed name="{0}"><joint joint="{1}" coef="{2}"/></fixed>'


@pytest.mark.parametrize(
    ("tendons", "equalities", "expected"),
    [
        # Two tendons of equal length, drawn at 0.3 and -0.1 rad.
        (FIXED.format("a", "left", 2) + FIXED.format("b", "right", 1), '<tendon tendon1="a" tendon2="b"/>',
         ("left", 2.0, -0.1 - 0.6)),
        (FIXED.format("a", "left", 1) + FIXED.format("b", "right", 1),
         '<tendon tendon1="b" tendon2="a" polycoef="0.01 0.5 0 0 0"/>', ("left", 0.5, -0.1 + 0.01 - 0.15)),
        # One along both, of constant length.
        ('<fixed name="a"><joint joint="right" coef="1"/><joint joint="left" coef="-3"/></fixed>',
         '<tendon tendon1="a"/>', ("left", 3.0, -0.1 - 0.9)),
        # One along both joints and one along the leader: together they leave a pair.
        ('<fixed name="a"><joint joint="right" coef="1"/><joint joint="left" coef="1"/></fixed>'
         + FIXED.format("b", "left", 1), '<tendon tendon1="a" tendon2="b" polycoef="0 3 0 0 0"/>',
         ("left", 2.0, -0.1 - 0.6)),
    ],
)  # fmt: skip
def test_tendons_couple_joints(
    tendons: str, equalities: str, expected: tuple[str, float, float], tmp_path: Path
) -> None:
    text = models.PLAIN.replace("<equality>", f"<tendon>{tendons}</tendon><equality>")
    text = re.sub(r'<joint name="both"[^>]*/>', equalities, text)
    described = describe(converted(tmp_path, text)[1])
    right = next(link for link in described.links if link.joint == "right")
    assert right.mimic is not None
    assert (described.links[right.mimic[0]].joint, *right.mimic[1:]) == pytest.approx(expected)


@pytest.mark.parametrize(
    ("equality", "message"),
    [
        ('<joint name="both" joint1="right" joint2="left"/>'
         '<joint joint1="left" joint2="right" polycoef="0.1 1 0 0 0"/>', "equalities of joints contradict each other"),
        ('<tendon tendon1="three"/>', "let joint 'right' follow 'left', 'left_slide'; a joint follows one other"),
        ('<tendon name="held" tendon1="one"/>', "equality 'held' holds one joint, 'left'; leave out the joint instead"),
        ('<tendon name="bent" tendon1="one" tendon2="three" polycoef="0 1 2 0 0"/>', "equality 'bent' is not linear"),
    ],
)  # fmt: skip
def test_couplings_that_no_joint_can_follow_are_refused(equality: str, message: str, tmp_path: Path) -> None:
    tendons = FIXED.format("one", "left", 1) + (
        '<fixed name="three"><joint joint="left" coef="1"/><joint joint="left_slide" coef="1"/>'
        '<joint joint="right" coef="1"/></fixed>'
    )
    text = models.PLAIN.replace("<equality>", f"<tendon>{tendons}</tendon><equality>")
    with pytest.raises(HandError, match=re.escape(message)):
        urdf_of_mjcf(written(tmp_path, re.sub(r'<joint name="both"[^>]*/>', equality, text)))


@pytest.mark.parametrize(
    ("joint", "actuators", "effort"),
    [
        ("", '<motor joint="left" gear="5" ctrlrange="-1 2"/>', 10.0),
        ("", '<motor joint="left" gear="5" ctrlrange="-1 2" forcerange="-1 1"/>', 5.0),
        ('actuatorfrcrange="-3 3"', '<motor joint="left" gear="5" ctrlrange="-1 2"/>', 3.0),
        ('actuatorfrcrange="-3 3"', '<motor joint="left"/>', 3.0),
        # A servo at one end of its range that is commanded to the other: 20 N m/rad x 1.3 rad.
        ("", '<position joint="left" kp="20" ctrlrange="-0.4 0.9"/>', 26.0),
        ("", '<position joint="left" kp="20"/>', 26.0),
        ("", '<position joint="left" kp="20" gear="2" forcerange="-2 2"/>', 4.0),
        # 0 to 255 are commands, not radians.
        ("", '<general joint="left" ctrlrange="0 255" gainprm="0.05" biastype="affine" biasprm="0 -20 0"/>', 20.75),
        # A tendon along both fingers: 0.5 of its force at each, and the right one moves by 0.8.
        ("", '<position tendon="split" kp="100" forcerange="-10 10"/>', 9.0),
        # Two that pull against each other.
        ("", '<motor joint="left" ctrlrange="0 1" gear="2"/><motor joint="left" ctrlrange="0 1" gear="-3"/>', 3.0),
        # The follower has a motor too.
        ("", '<motor joint="left" ctrlrange="-1 1"/><motor joint="right" ctrlrange="-1 1"/>', 1.8),
        ("", '<muscle joint="left" force="12" lengthrange="-0.4 0.9" ctrlrange="0 1"/>', 12.0),
        ("", '<motor joint="left"/>', 0.0),
        ("", "", 0.0),
    ],
)  # fmt: skip
def test_efforts_are_those_of_the_actuators(joint: str, actuators: str, effort: float, tmp_path: Path) -> None:
    tendon = (
        '<tendon><fixed name="split"><joint joint="left" coef="0.5"/><joint joint="right" coef="0.5"/></fixed></tendon>'
    )
    left = models.LEFT.replace('ref="0.3"', f'ref="0.3" {joint}')
    world = f'<body name="palm">{models.PALM}{left}{models.RIGHT}</body>'
    fitted, _ = converted(tmp_path, models.model(world, tendon, models.SLIDE_MOTOR + actuators))
    assert efforts(fitted)["left"] == pytest.approx(effort)
    assert efforts(fitted)["left_slide"] == 10.0
    assert any("joint 'left': its greatest force is unknown" in text for text in fitted.assumptions) == (effort == 0.0)
    # What the file does not have is not said to be the file's.
    loads = {one["name"]: one["load_limit"] for one in tomllib.loads((tmp_path / "hand.toml").read_text())["actuators"]}
    if effort == 0.0:
        assert loads["left"]["source"] == "guess: the URDF states no effort; 30 N at the fingertip"
        assert "effort unknown: " in fitted.text
    else:
        assert loads["left"] == {"value": pytest.approx(effort), "unit": "N m", "source": "URDF: effort of the joint"}


def test_mujoco_cannot_push_harder(tmp_path: Path) -> None:
    """The torque that MuJoCo's actuators exert with extreme commands stays within the effort, and reaches it."""
    actuators = (
        '<position joint="left" kp="20" ctrlrange="-0.4 0.9" forcerange="-22 22"/>'
        '<general joint="left_slide" ctrlrange="-3 5" gainprm="4" biastype="affine" biasprm="1 -30 0"/>'
    )
    world = f'<body name="palm">{models.PALM}{models.LEFT}</body>'
    text = re.sub(r"<equality>.*</equality>", "", models.model(world, actuators=actuators))
    fitted, hand = converted(tmp_path, text)
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "hand.xml"))
    data, most = mujoco.MjData(model), np.zeros(2)
    for control in (model.actuator_ctrlrange.T[0], model.actuator_ctrlrange.T[1]):
        for positions in hand.joint_limits.T:
            data.qpos[:], data.ctrl[:] = positions, control
            mujoco.mj_forward(model, data)
            most = np.maximum(most, np.abs(data.qfrc_actuator))
    np.testing.assert_allclose([efforts(fitted)[name] for name in ("left", "left_slide")], most, rtol=1e-6)


@pytest.mark.parametrize(("compiler", "assumed"), [("", True), ('<compiler angle="degree"/>', False)])
def test_ranges_that_are_tiny_as_degrees_are_radians(compiler: str, assumed: bool, tmp_path: Path) -> None:
    """As in files that are made to be included in others, which state the unit."""
    meant, hand = converted(tmp_path, models.PLAIN)
    fitted, read = converted(tmp_path, models.PLAIN.replace('<compiler angle="radian"/>', compiler))
    message = f"{tmp_path / 'hand.xml'}: no <compiler angle=...>: angles are read as radians, since as degrees"
    assert [text.startswith(message) for text in fitted.assumptions][:1] == ([True] if assumed else [])
    assert (fitted.text == meant.text) == assumed
    assert np.allclose(read.joint_limits, hand.joint_limits) == assumed


def test_unlimited_joints_and_light_bodies_are_named(tmp_path: Path) -> None:
    text = models.PLAIN.replace('range="-0.01 0.02" ', "").replace('pos="0 0 0.02" mass="0.02"', 'mass="1e-5"')
    fitted, hand = converted(tmp_path, text)
    assert any("joint 'left_slide': has no range; it gets -3 to 3" in each for each in fitted.assumptions)
    assert any("body 'left_tip': has less than 0.001 kg; it gets this mass" in each for each in fitted.assumptions)
    np.testing.assert_allclose(hand.joint_limits[1], (-3.0, 3.0))


def test_excluded_pairs_and_masks_do_not_touch(tmp_path: Path) -> None:
    """By bodies, by masks of geoms, and named pairs that touch whatever their masks say."""
    contact = '<contact><exclude body1="left_tip" body2="palm"/><exclude body1="left_nail" body2="right"/></contact>'
    text = models.PLAIN.replace("<equality>", f"{contact}<equality>")
    fitted, hand = converted(tmp_path, text)
    # The left finger's nail is fixed to it, so only its shapes pass through the right finger.
    assert fitted.no_contact == (("palm", "left_tip"), ("left_mesh", "right_bar"), ("left_mesh", "right_pad"))
    expected = {("palm_box", "left_pad"), ("left_mesh", "right_bar.0"), ("left_mesh", "right_pad")}
    assert expected <= {
        tuple(pair) for each in describe(hand).no_contact for pair in (sorted(each), sorted(each)[::-1])
    }
    # A hand whose geoms touch only what is not of the hand; bodies of one finger never touch.
    masks = models.PLAIN.replace('<geom density="700"/>', '<geom density="700" contype="1" conaffinity="2"/>')
    assert converted(tmp_path, masks)[0].no_contact == (("palm", "left_tip"), ("left", "right"), ("left_tip", "right"))
    pair = '<contact><pair geom1="left_pad" geom2="right_pad"/></contact>'
    named = converted(tmp_path, masks.replace("<equality>", f"{pair}<equality>"))[0].no_contact
    assert ("left_pad", "right_pad") not in named
    assert ("left_pad", "right_bar") in named


def test_links_that_overlap_in_the_open_hand_are_named(tmp_path: Path) -> None:
    """Where bars are so wide that they meet in the middle; the file of the hand begins with the guesses to review."""
    wide = models.PLAIN.replace('<geom type="capsule" size="0.005 0.02"', '<geom type="box" size="0.05 0.01 0.02"')
    path = written(tmp_path, wide)
    (tmp_path / "hand.urdf").write_text(urdf_of_mjcf(path).text)
    guessed = guess_hand(tmp_path / "hand.urdf", "wide")
    message = "links that overlap in the open hand, and pass through each other: left and right"
    assert any(item.startswith(message) for item in guessed.review)
    assert f"# - {message}" in guessed.text
    stated = guess_hand(tmp_path / "hand.urdf", "wide", [("left", "right"), ("left_tip", "right")])
    assert not any("overlap" in item for item in stated.review)


@pytest.mark.parametrize(
    ("most", "effort", "source"),
    [
        ("500", 500.0, "guess: the URDF states an effort of 500 N m, which is not believable; 30 N at the fingertip"),
        ("1e4", 0.0, "guess: the URDF states no effort; 30 N at the fingertip"),
    ],
)
def test_placeholders_are_not_believed(most: str, effort: float, source: str, tmp_path: Path) -> None:
    world = f'<body name="palm">{models.PALM}{models.LEFT}{models.RIGHT}</body>'
    motor = f'<motor joint="left" ctrlrange="-{most} {most}"/>'
    fitted, _ = converted(tmp_path, models.model(world, actuators=models.SLIDE_MOTOR + motor))
    assert efforts(fitted)["left"] == effort
    assert any("its gain times ctrlrange: 1e+04, which no hand has" in text for text in fitted.assumptions) == (
        not effort
    )
    text = (tmp_path / "hand.toml").read_text()
    assert source in text
    assert "load_limit of left: the URDF states no believable effort" in text


def run(*words: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run([sys.executable, "-m", "graspbox", *words], capture_output=True, text=True, check=False)


def test_the_command_takes_a_base_and_prints_what_it_assumed(tmp_path: Path) -> None:
    path = written(tmp_path, models.ARM)
    done = run("hand", "convert", str(path), "--base", "palm", "--out", str(tmp_path / "hand"))
    assert done.returncode == 0, done.stderr
    head = f"assumed: {path}:"
    assert any(line.startswith(head) and "is the base; the 4 bodies" in line for line in done.stdout.splitlines())
    words = ("--base", "palm", "--out", str(tmp_path / "hand"), "--force", "--json")
    found = json.loads(run("hand", "convert", str(path), *words).stdout)
    assert any("body 'palm': is the base" in text for text in found["assumptions"])
    wrong = run("hand", "convert", str(path), "--base", "hip", "--out", str(tmp_path / "other"))
    assert (wrong.returncode, "has no body 'hip'" in wrong.stderr) == (2, True)


def test_a_new_hand_of_several_in_a_file(tmp_path: Path) -> None:
    """The base chooses one; its URDF is written beside, since the file alone would not say which one it is."""
    finger = '<body name="more" pos="0 0 0.2"><joint axis="0 1 0" range="0 1"/><geom size="0.01"/></body></body>'
    two = models.ARM.replace('<geom type="sphere" size="0.01"/></body></body>', f'<geom size="0.01"/></body>{finger}')
    path, out = written(tmp_path, two), tmp_path / "new.toml"
    result = invoke(["hand", "new", path, "--base", "palm", "--out", out, "--json"])
    assert result.exit_code == 0, result.output
    found = json.loads(result.stdout)
    assert found["urdf"] == str(tmp_path / "new.urdf")
    assert set(found["meshes"]) == {"left_mesh"}
    hand = load_hand((found["urdf"], out))
    assert hand.joints == ["left", "left_slide"]
    with pytest.raises(HandError, match="has no body 'hip'"):
        guess_hand(path, base="hip")


def test_a_given_base_is_not_cut_further(tmp_path: Path) -> None:
    alone = models.ARM.replace('<connect body1="shoulder" body2="world" anchor="0 0 0"/>', "")
    path, out = written(tmp_path, alone), tmp_path / "hand"
    for base, joints in (("foot", ["shoulder", "wrist"]), (None, ["left", "left_slide"])):
        words = ["hand", "convert", path, "--out", out, "--force", *(() if base is None else ("--base", base))]
        assert invoke(words).exit_code == 0
        assert load_hand((out / "hand.urdf", out / "hand.toml")).joints[:2] == joints


def test_a_conversion_writes_both_files_or_none(tmp_path: Path) -> None:
    """Where nothing can be guessed, older files stay."""
    bare = re.sub(r"<geom [^>]*/>", "", models.PLAIN).replace("<geom density", "<geom  density")
    bare = bare.replace('<joint name="left"', f'{models.INERTIAL}<joint name="left"').replace(
        '<joint name="right"', f'{models.INERTIAL}<joint name="right"'
    ).replace('<joint name="left_slide"', f'{models.INERTIAL}<joint name="left_slide"')  # fmt: skip
    path, out = written(tmp_path, bare), tmp_path / "hand"
    result = invoke(["hand", "convert", path, "--out", out])
    assert result.exit_code == 2, result.output
    assert "hand.xml: no link that a joint moves has a collision shape" in result.stderr
    assert list(out.glob("*")) == []
    (out / "hand.urdf").write_text("good")
    assert invoke(["hand", "convert", path, "--out", out, "--force"]).exit_code == 2
    assert (out / "hand.urdf").read_text() == "good"
