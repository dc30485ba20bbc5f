"""docs/guides/hand.md is correct: its files, code and commands, as a reader would use them."""

import json
import re
import shlex
from pathlib import Path

import gymnasium
import pytest

import graspbox
from command_line import invoke
from graspbox import errors

POLICIES = Path(__file__).parents[2] / "policies"
PAGE = (Path(__file__).parents[2] / "docs/guides/hand.md").read_text()


def blocks(language: str) -> list[str]:
    """Find the code blocks of a language, in order; those of commands have none."""
    return re.findall(rf"^```{language}\n(.*?)^```$", PAGE, flags=re.DOTALL | re.MULTILINE)


@pytest.fixture
def hand(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> tuple[str, str]:
    """Save the two files of the page where its code expects them."""
    names = ("pincher.urdf", "pincher.toml")
    for name, language in zip(names, ("xml", "toml"), strict=True):
        assert f"`{name}`:" in PAGE
        (text,) = blocks(language)
        (tmp_path / name).write_text(text)
    monkeypatch.chdir(tmp_path)
    return names


def test_code_and_commands_run(hand: tuple[str, str], capsys: pytest.CaptureFixture[str]) -> None:
    code = blocks("python")
    assert len(code) == 4
    for block in code:
        exec(compile(block, "hand.md", "exec"), {})
    output = capsys.readouterr().out
    assert "pincher ['left_knuckle', 'right_knuckle'] ['motor']" in output
    assert Path("pincher.png").read_bytes()[:4] == b"\x89PNG"
    for check in re.findall(r"^```\n(graspbox hand (?!train).*pincher\.urdf.*)\n```$", PAGE, flags=re.MULTILINE):
        result = invoke(shlex.split(check)[1:])
        assert result.exit_code == 0, result.output
    assert Path("pincher_motion.png").read_bytes()[:4] == b"\x89PNG"
    assert graspbox.load_hand(("pincher.urdf", "first.toml")).widest > 0.08
    # Commands alone stand in blocks without a language: one line here, tried on one object of the set.
    (command,) = re.findall(r"^```\n(graspbox grasp .*)\n```$", PAGE, flags=re.MULTILINE)
    words = [word.replace("procedural:box", "procedural:box:0") for word in shlex.split(command)[1:]]
    result = invoke(words)
    assert result.exit_code == 0, result.output
    (row,) = json.loads(Path("grasps.json").read_text())["objects"]
    assert row["hand"] == "pincher"
    assert row["tried"] == 5
    assert row["succeeded"] > 0
    assert row["survived_shake"] > 0


@pytest.mark.train
def test_a_policy_of_the_hand_is_trained(hand: tuple[str, str]) -> None:
    """The commands of the section about policies, in order, with few trials and small networks."""
    section = PAGE.partition("## 7. A policy")[2].partition("\n## ")[0]
    commands = re.findall(r"^```\n(graspbox .*?)\n```$", section, flags=re.DOTALL | re.MULTILINE)
    assert [shlex.split(command)[1] for command in commands] == ["evaluate", "hand", "evaluate"]
    for command in commands:
        # The published policies are installed for users; here they are folders.
        command = command.replace("\\\n", "").replace(" any_hand", f" {POLICIES}/any_hand")
        words = shlex.split(command)[1:]
        folders = ["--start", str(POLICIES / "any_hand"), "--completion", str(POLICIES / "depth")]
        words += ["--trials", "2"] if words[0] == "evaluate" else ["--quick", *folders]
        result = invoke(words)
        assert result.exit_code == 0, result.output
    folder = Path("out/pincher/tuned/policy")
    assert {"hand.urdf", "hand.toml", "scorer.onnx", "README.md"} <= {file.name for file in folder.iterdir()}


def write_finger(path: Path) -> None:
    """Write a finger of two bars that make a bend."""
    lines: list[str] = []
    for x, low, high in ((0.0, 0.0, 0.05), (0.004, 0.05, 0.09)):
        base = 8 * len(lines) // 14
        lines += [f"v {x + dx} {y} {z}" for dx in (0.0, 0.008) for y in (0.0, 0.024) for z in (low, high)]
        quads = ((1, 2, 4, 3), (5, 7, 8, 6), (1, 5, 6, 2), (3, 4, 8, 7), (1, 3, 7, 5), (2, 6, 8, 4))
        lines += ["f " + " ".join(str(base + corner) for corner in quad) for quad in quads]
    path.write_text("\n".join(lines))


def test_collision_meshes_become_shapes(hand: tuple[str, str], capsys: pytest.CaptureFixture[str]) -> None:
    """The page's code says how well they fit."""
    write_finger(Path("finger.obj"))
    text = Path("pincher.urdf").read_text()
    text = text.replace('<box size="0.008 0.024 0.09"/>', '<mesh filename="finger.obj"/>', 1)
    Path("pincher.urdf").write_text(text)
    assert "left_bone.0" in graspbox.load_hand(hand).files[0]
    (code,) = (block for block in blocks("python") if "fitted_urdf" in block)
    exec(compile(code, "hand.md", "exec"), {})
    assert re.fullmatch(r"left_bone: \['box', 'box'\], \d\.\d mm off on average\n", capsys.readouterr().out)


def test_the_error_that_the_page_quotes_is_what_is_said(hand: tuple[str, str]) -> None:
    (quoted,) = re.findall(r"`(pincher\.toml:\d+: [^`]*)`", PAGE)
    text = Path("pincher.toml").read_text()
    Path("pincher.toml").write_text(re.sub(r'(load_limit.*)unit = "N m"', r'\1unit = "Nm"', text))
    with pytest.raises(errors.HandError, match=re.escape(quoted)):
        graspbox.load_hand(hand)


def test_one_file_is_no_hand(hand: tuple[str, str]) -> None:
    with pytest.raises(errors.ConfigError, match=r"is one file, but a hand has two"):
        graspbox.load_hand(hand[0])


def test_it_has_no_tactile_observation(hand: tuple[str, str]) -> None:
    with pytest.raises(errors.ConfigError, match="this hand has no tactile sensors"):
        gymnasium.make("graspbox/Grasp-v0", objects="procedural:box:0", hand=hand, obs=("proprio", "tactile"))
