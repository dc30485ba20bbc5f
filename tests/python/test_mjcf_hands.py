"""MJCF hands: converted to URDFs whose links move as MuJoCo's bodies do."""

import json
import subprocess
import sys
import zipfile
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from graspbox.errors import HandError
from graspbox.hand_tools import check_hand, guess_hand
from graspbox.hands import Hand, load_hand, urdf_of_mjcf
from graspbox.hands.mjcf import loops

mujoco = pytest.importorskip("mujoco", reason="MJCF is read by mujoco, from the extra 'mjcf'")

#: Two fingers on a palm: one slides and leads the other; a bent fingertip is a body without a joint, and an eyelet has
#: no mass. The second finger also has a hinge, whose anchor is not at the origin of its body.
GRIPPER = """
<mujoco model="gripper">
  <compiler angle="radian"/>
  <asset>
    <mesh name="tip" vertex="-.01 -.004 0 .01 -.004 0 -.01 .004 0 .01 .004 0
      -.01 -.004 .02 .01 -.004 .02 -.01 .004 .02 .01 .004 .02"/>
  </asset>
  <worldbody>
    <body name="palm" pos="0.3 0.1 0.2" euler="0.2 0.1 -0.4">
      <geom name="palm_box" type="box" size="0.05 0.03 0.02" mass="0.5"/>
      <geom name="decoration" type="sphere" size="0.1" contype="0" conaffinity="0" mass="0"/>
      <body name="eyelet" pos="0 0 0.1"><site name="grip"/></body>
      <body name="left" pos="0.04 0 0.02" euler="0 0 0.3">
        <joint name="left_slide" type="slide" axis="-1 0 0" range="0 0.035"/>
        <geom name="left_bar" type="capsule" size="0.005 0.02" pos="0 0 0.02" mass="0.05"/>
        <body name="left_tip" pos="0 0 0.04" euler="0.1 0 0">
          <geom name="left_pad" type="mesh" mesh="tip" mass="0.02"/>
        </body>
      </body>
      <body name="right" pos="-0.04 0 0.02" euler="0 0 3.3">
        <joint name="right_slide" type="slide" axis="-1 0 0" range="0 0.035"/>
        <geom name="right_bar" type="cylinder" size="0.005 0.02" pos="0 0 0.02" mass="0.05"/>
        <body name="right_tip" pos="0 0 0.04">
          <joint name="right_bend" type="hinge" axis="0 1 0" pos="0.002 0 -0.003" range="-0.5 0.5"/>
          <geom name="right_pad" type="box" size="0.01 0.004 0.01" pos="0 0 0.01" mass="0.02"/>
        </body>
      </body>
    </body>
  </worldbody>
  <equality><joint joint1="right_slide" joint2="left_slide" polycoef="0 1 0 0 0"/></equality>
  <actuator><position joint="left_slide" kp="1000" forcerange="-40 40"/></actuator>
</mujoco>
"""


#: Start of a finger with a closed loop: a palm, and a crank with an actuator.
CRANK = """
<mujoco model="linkage">
  <compiler angle="radian"/>
  <worldbody>
    <body name="palm">
      <geom type="box" size="0.03 0.03 0.01" mass="0.5"/>
      <body name="crank" pos="0.02 0 0.01">
        <joint name="crank" axis="0 1 0" range="0 0.8"/>"""

#: Finger of a parallel jaw: a rocker as long as the crank, and a tip that both carry.
FOUR_BAR = f"""{CRANK}
        <geom type="capsule" fromto="0 0 0 0 0 0.05" size="0.003" mass="0.02"/>
        <body name="tip" pos="0 0 0.05">
          <joint name="tip" axis="0 1 0" range="-1 1"/>
          <geom name="pad" type="box" size="0.003 0.01 0.02" pos="0 0 0.02" mass="0.02"/>
        </body>
      </body>
      <body name="rocker" pos="0 0 0.01">
        <joint name="rocker" axis="0 1 0" range="-1 1"/>
        <geom type="capsule" fromto="0 0 0 0 0 0.05" size="0.003" mass="0.02"/>
      </body>
    </body>
  </worldbody>
  <equality><connect name="pin" body1="rocker" body2="tip" anchor="0 0 0.05"/></equality>
  <actuator><position joint="crank" kp="10"/></actuator>
</mujoco>
"""
#: The same with one more joint, so that the tip can turn about the end of the rocker when an object stops the crank.
FIVE_BAR = f"""{CRANK}
        <geom type="capsule" fromto="0 0 0 0 0 0.04" size="0.003" mass="0.02"/>
        <body name="bend" pos="0 0 0.04">
          <joint name="bend" axis="0 1 0" range="-1.5 0"/>
          <geom type="capsule" fromto="0 0 0 0 0 0.01" size="0.003" mass="0.01"/>
        </body>
      </body>
      <body name="rocker" pos="0 0 0.01">
        <joint name="rocker" axis="0 1 0" range="-1 1" stiffness="0.05" springref="2"/>
        <geom type="capsule" fromto="0 0 0 0 0 0.05" size="0.003" mass="0.02"/>
        <body name="tip" pos="0 0 0.05">
          <joint name="tip" axis="0 1 0" range="-1 1"/>
          <geom name="pad" type="box" size="0.003 0.01 0.02" pos="0.02 0 0.02" mass="0.02"/>
        </body>
      </body>
    </body>
  </worldbody>
  <equality><connect name="pin" body1="bend" body2="tip" anchor="0 0 0.01"/></equality>
  <actuator><position joint="crank" kp="10"/></actuator>
</mujoco>
"""


@pytest.fixture
def linkage(tmp_path: Path) -> Path:
    path = tmp_path / "linkage.xml"
    path.write_text(FOUR_BAR)
    return path


@pytest.fixture
def gripper(tmp_path: Path) -> Path:
    path = tmp_path / "gripper.xml"
    path.write_text(GRIPPER)
    return path


def converted(mjcf: Path, folder: Path) -> Hand:
    """Convert a hand and guess its other file."""
    (folder / "hand.urdf").write_text(urdf_of_mjcf(mjcf).text)
    (folder / "hand.toml").write_text(guess_hand(folder / "hand.urdf", "converted").text)
    return load_hand((folder / "hand.urdf", folder / "hand.toml"))


def test_links_joints_and_masses_are_those_of_the_file(gripper: Path, tmp_path: Path) -> None:
    fitted = urdf_of_mjcf(gripper)
    assert list(fitted.fits) == ["left_pad"]
    assert fitted.fits["left_pad"].mean < 1e-3
    hand = converted(gripper, tmp_path)
    assert hand.joints == ["left_slide", "right_bend"]
    np.testing.assert_allclose(hand.joint_limits, [[0.0, 0.035], [-0.5, 0.5]])
    text = fitted.text
    assert '<mimic joint="left_slide" multiplier="1" offset="0" />' in text
    assert 'effort="40"' in text
    assert text.count("<link") == 4
    masses = [float(part.split('"')[0]) for part in text.split('<mass value="')[1:]]
    assert masses == pytest.approx([0.5, 0.07, 0.05, 0.02])
    assert "decoration" not in text
    assert [f'name="left_bar.{n}"' in text for n in range(4)] == [True, True, True, False]


def test_shapes_move_as_in_mujoco(gripper: Path, tmp_path: Path) -> None:
    """Distances between the middles of all shapes agree for random positions of the joints."""
    hand = converted(gripper, tmp_path)
    model = mujoco.MjModel.from_xml_path(str(gripper))
    data = mujoco.MjData(model)
    rng = np.random.default_rng(0)
    for _ in range(5):
        low, high = hand.joint_limits.T
        positions: NDArray[np.float64] = rng.uniform(low, high)
        # left_slide, right_slide and right_bend, in the order of MuJoCo's joints.
        data.qpos[:] = [positions[0], positions[0], positions[1]]
        mujoco.mj_kinematics(model, data)
        seen = np.flatnonzero(model.geom_contype)
        there = data.geom_xpos[seen]
        # A capsule is a cylinder and two spheres around its middle.
        poses = hand.shapes(positions)[0][:, :3, 3]
        ours = np.stack([poses[0], poses[1:4].mean(axis=0), *poses[4:]])
        own, other = (np.linalg.norm(p[:, None] - p[None], axis=2) for p in (ours, there))
        np.testing.assert_allclose(own, other, atol=2e-4)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (('type="hinge" axis="0 1 0" pos="0.002 0 -0.003" range="-0.5 0.5"', 'type="ball"'), "'right_bend' is a ball"),
        (("<equality>", '<equality><connect body1="left" body2="right" anchor="0 0 0"/>'), "closes a loop"),
        (('polycoef="0 1 0 0 0"', 'polycoef="0 1 1 0 0"'), "is not linear"),
        (('type="box" size="0.05 0.03 0.02"', 'type="ellipsoid" size="0.05 0.03 0.02"'), "geom 'palm_box' is none of"),
        (('<joint name="right_bend"', '<joint name="x" axis="1 0 0"/><joint name="right_bend"'), "has several joints"),
        (('joint1="right_slide" joint2="left_slide"', 'joint1="right_slide"'), "holds one joint, 'right_slide'"),
        (("</mujoco>", ""), "gripper.xml: "),
    ],
)
def test_files_that_are_no_hand_are_refused(gripper: Path, change: tuple[str, str], message: str) -> None:
    assert change[0] in GRIPPER
    gripper.write_text(GRIPPER.replace(change[0], change[1], 1))
    with pytest.raises(HandError, match=message):
        urdf_of_mjcf(gripper)


def test_followers_of_followers_and_tendons_follow_the_leader(gripper: Path) -> None:
    """A tendon of constant length couples the hinge; it follows the slide that follows the other one."""
    text = GRIPPER.replace(
        "<equality>",
        '<tendon><fixed name="cord"><joint joint="right_slide" coef="10"/><joint joint="right_bend" coef="-1"/></fixed>'
        '</tendon><equality><tendon tendon1="cord"/>',
    )
    gripper.write_text(text.replace('polycoef="0 1 0 0 0"', 'polycoef="0.001 0.5 0 0 0"'))
    found = urdf_of_mjcf(gripper).text
    assert '<mimic joint="left_slide" multiplier="0.5" offset="0.001" />' in found
    assert '<mimic joint="left_slide" multiplier="5" offset="0.01" />' in found


def test_a_loop_that_locks_is_refused(linkage: Path) -> None:
    """A rocker of 5 mm cannot follow a crank of 50 mm."""
    text = FOUR_BAR.replace('<body name="rocker" pos="0 0 0.01">', '<body name="rocker" pos="0 0 0.055">')
    linkage.write_text(text.replace('anchor="0 0 0.05"', 'anchor="0 0 0.005"'))
    with pytest.raises(HandError, match="'pin' closes a loop that mimic joints leave open by up to 32"):
        urdf_of_mjcf(linkage)


def test_a_loop_that_does_not_come_to_rest_is_refused(linkage: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(loops, "_MOST_STEPS", 10)
    with pytest.raises(HandError, match="the joints of its closed loops do not come to rest; see in MuJoCo's viewer"):
        urdf_of_mjcf(linkage)


def test_the_joints_of_a_parallelogram_follow_its_crank(linkage: Path, tmp_path: Path) -> None:
    """The rocker turns with the crank, and the tip turns back, so that it keeps its direction."""
    fitted = urdf_of_mjcf(linkage)
    assert set(fitted.loops) == {"tip", "rocker"}
    for name, ratio in (("rocker", 1.0), ("tip", -1.0)):
        found = fitted.loops[name]
        assert found.leader == "crank"
        assert (found.ratio, found.offset) == pytest.approx((ratio, 0.0), abs=1e-4)
        assert found.most < 1e-4
        assert found.gap < 1e-5
    hand = converted(linkage, tmp_path)
    assert hand.joints == ["crank"]
    # Shapes: palm, three of the crank, the pad.
    poses = np.array([hand.shapes(np.array([angle]))[0][4] for angle in (0.0, 0.4, 0.8)])
    np.testing.assert_allclose(poses[:, :3, :3], poses[:1, :3, :3].repeat(3, 0), atol=1e-4)


def test_the_command_says_how_well_mimic_joints_follow_a_loop(linkage: Path, tmp_path: Path) -> None:
    out = tmp_path / "hand"
    done = run("hand", "convert", str(linkage), "--out", str(out))
    assert done.returncode == 0, done.stderr
    line = "tip: follows crank with ratio -1.000 in place of a closed loop, which opens by at most 0.0 mm"
    assert line in done.stdout.splitlines()
    done = run("hand", "convert", str(linkage), "--out", str(out), "--force", "--json")
    found = json.loads(done.stdout)["loops"]["rocker"]
    assert found["leader"] == "crank"
    assert found["ratio"] == pytest.approx(1.0, abs=1e-4)
    assert set(found) == {"leader", "ratio", "offset", "most", "gap"}


def test_lines_fit_other_linkages_as_well_as_they_say(linkage: Path) -> None:
    """A rocker of 47 mm: the positions at which MuJoCo's own equality holds are as far from the line as is said."""
    text = FOUR_BAR.replace(
        'pos="0 0 0.01">\n        <joint name="rocker"', 'pos="0 0 0.013">\n        <joint name="rocker"'
    )
    linkage.write_text(text.replace('anchor="0 0 0.05"', 'anchor="0 0 0.047"'))
    loops = urdf_of_mjcf(linkage).loops
    # The four bars in closed form: crank 50 mm, coupler 20 mm, rocker 47 mm, pivots (20, 0) and (0, 3) mm.
    angles = np.linspace(0.0, 0.8, 41)
    ends = np.stack([20.0 + 50.0 * np.sin(angles), 50.0 * np.cos(angles) - 3.0])
    distance, direction = np.hypot(*ends), np.arctan2(ends[0], ends[1])
    rocker = direction - np.arccos((47.0**2 + distance**2 - 20.0**2) / (2 * 47.0 * distance))
    ratio, offset = np.polyfit(angles, rocker, 1)
    assert (loops["rocker"].ratio, loops["rocker"].offset) == pytest.approx((ratio, offset), abs=1e-4)
    most = np.abs(ratio * angles + offset - rocker).max()
    assert loops["rocker"].most == pytest.approx(most, abs=1e-4)
    assert most > 5e-3
    assert loops["rocker"].gap == loops["tip"].gap == pytest.approx(3.1e-4, abs=1e-5)


def test_springs_and_stops_fix_what_a_loop_leaves_free(linkage: Path) -> None:
    """A spring presses the bend into its stop, so that the five bars move as four."""
    linkage.write_text(FIVE_BAR)
    found = urdf_of_mjcf(linkage).loops
    ratios = {"rocker": 1.0, "tip": -1.0, "bend": 0.0}
    assert found.keys() == ratios.keys()
    for name, ratio in ratios.items():
        assert (found[name].ratio, found[name].offset) == pytest.approx((ratio, 0.0), abs=2e-3)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (('<actuator><position joint="crank" kp="10"/></actuator>', ""), "'pin' closes a loop without an actuator"),
        (('<position joint="crank" kp="10"/>', '<position joint="crank" kp="9"/><motor joint="rocker"/>'),
         "'pin' closes a loop that crank, rocker drive; let an actuator drive one of its joints: crank, tip, rocker"),
        ((' range="0 0.8"', ""), "joint 'crank' drives a closed loop and has no range"),
        (('range="0 0.8"', 'range="-3 3"'), "'pin' closes a loop that mimic joints leave open by up to"),
        (("<connect name", '<weld body1="rocker" body2="tip"/><connect name'), "fixes two bodies to each other"),
    ],
)  # fmt: skip
def test_loops_that_no_mimic_joints_follow_are_refused(linkage: Path, change: tuple[str, str], message: str) -> None:
    assert change[0] in FOUR_BAR
    linkage.write_text(FOUR_BAR.replace(change[0], change[1], 1))
    with pytest.raises(HandError, match=message):
        urdf_of_mjcf(linkage)


def run(*words: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run([sys.executable, "-m", "graspbox", *words], capture_output=True, text=True, check=False)


def test_the_command_writes_both_files(gripper: Path, tmp_path: Path) -> None:
    out = tmp_path / "new" / "hand"
    done = run("hand", "convert", str(gripper), "--out", str(out), "--json")
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    assert found["hand"] == "gripper"
    assert found["meshes"]["left_pad"]["shapes"] == ["box"]
    assert found["loops"] == {}
    assert load_hand((out / "hand.urdf", out / "hand.toml")).name == "gripper"
    again = run("hand", "convert", str(gripper), "--out", str(out))
    assert (again.returncode, "--force" in again.stderr) == (2, True)
    missing = run("hand", "convert", str(tmp_path / "none.xml"), "--out", str(tmp_path / "other"))
    assert missing.returncode == 2
    assert "none.xml" in missing.stderr
    assert "Traceback" not in missing.stderr


@pytest.mark.slow
def test_hands_of_another_project_are_converted(tmp_path: Path) -> None:
    """Hands in the wheel of robosuite, which is downloaded: they load, and their checks find no error in them."""
    words = [
        sys.executable,
        "-m",
        "pip",
        "download",
        "--no-deps",
        "--quiet",
        "--dest",
        str(tmp_path),
        "robosuite>=1.5,<1.6",
    ]
    if subprocess.run(words, check=False).returncode:
        pytest.skip("the wheel of robosuite cannot be downloaded")
    (wheel,) = tmp_path.glob("*.whl")
    with zipfile.ZipFile(wheel) as archive:
        archive.extractall(tmp_path, [name for name in archive.namelist() if "/assets/grippers/" in name])
    grippers = tmp_path / "robosuite/models/assets/grippers"
    # The tendons of the Robotiq 2F-140 couple the joints of its four-bar fingers; each finger has an actuator.
    expected = {"inspire_right_hand": 12, "fourier_right_hand": 11, "robotiq_gripper_140": 2, "panda_gripper": 2}
    for name, joints in expected.items():
        folder = tmp_path / name
        folder.mkdir()
        hand = converted(grippers / f"{name}.xml", folder)
        assert len(hand.joints) == joints
        report = check_hand(hand, trials=False)
        assert not report.has_errors, report.table()
    with pytest.raises(HandError, match="repeated name 'robotiq_arg2f_base_link' in mesh"):
        urdf_of_mjcf(grippers / "robotiq_gripper_85.xml")
