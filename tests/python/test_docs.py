"""What the documentation shows works as it stands there."""

import doctest
import os
import re
import shutil
from pathlib import Path

import pytest

import graspbox
from graspbox import object_sets

ROOT = Path(__file__).parents[2]


def test_readme_code_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    """Every Python block of the README, in order, in a folder that holds a mug."""
    path = object_sets.load("ycb:025_mug")[0].path
    assert path is not None
    shutil.copy(path, tmp_path / "mug.stl")
    monkeypatch.chdir(tmp_path)
    blocks = re.findall(r"```python\n(.*?)```", (ROOT / "README.md").read_text(), flags=re.DOTALL)
    assert len(blocks) == 2
    for block in blocks:
        exec(compile(block, "README.md", "exec"), {})
    assert 0.0 <= float(capsys.readouterr().out) <= 1.0


def test_docstring_examples_run() -> None:
    result = doctest.testmod(graspbox)
    assert result.attempted > 0
    assert result.failed == 0


def test_tables_of_docstrings_are_markdown() -> None:
    """The API pages are Markdown: a table of reStructuredText would come out as one line."""
    files = list((ROOT / "python/graspbox").rglob("*.py"))
    assert len(files) > 20
    for path in files:
        assert not re.search(r"^ *={5,}", path.read_text(), flags=re.MULTILINE), path


def test_readme_names_recipes_and_commands_that_exist() -> None:
    text = (ROOT / "README.md").read_text()
    makefile = (ROOT / "Makefile").read_text()
    for recipe in re.findall(r"^make (\S+)", text, flags=re.MULTILINE):
        assert re.search(rf"^{recipe}:", makefile, flags=re.MULTILINE), recipe
    commands = set(re.findall(r"^graspbox (\w+)", text, flags=re.MULTILINE))
    from graspbox import cli

    assert commands <= {command.name for command in cli.typer_app.registered_commands}
    for link in re.findall(r"\]\((?!http)([^)]+)\)", text):
        assert os.path.exists(ROOT / link), link
