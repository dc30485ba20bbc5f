"""docs/your_hand.md does what it says: its files, code and commands, as a reader would use them."""

import json
import re
import shlex
from pathlib import Path

import gymnasium
import pytest
from typer.testing import CliRunner

import graspbox
from graspbox import cli, errors

PAGE = (Path(__file__).parents[2] / "docs/your_hand.md").read_text()


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
    names: dict[str, object] = {}
    code = blocks("python")
    assert len(code) == 3
    for block in code:
        exec(compile(block, "your_hand.md", "exec"), names)
    assert "pincher ['left_knuckle', 'right_knuckle'] ['motor']" in capsys.readouterr().out
    assert Path("pincher.png").read_bytes()[:4] == b"\x89PNG"
    # Commands alone stand in blocks without a language: one line here, tried on one object of the set.
    (command,) = re.findall(r"^```\n(graspbox grasp .*)\n```$", PAGE, flags=re.MULTILINE)
    words = [word.replace("procedural:box", "procedural:box:0") for word in shlex.split(command)[1:]]
    result = CliRunner().invoke(cli.typer_app, words)
    assert result.exit_code == 0, result.output
    (row,) = json.loads(Path("grasps.json").read_text())["objects"]
    assert row["hand"] == "pincher"
    assert row["tried"] == 5
    assert row["succeeded"] > 0
    assert row["survived_shake"] > 0


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
