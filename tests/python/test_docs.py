"""The documentation is true: its code runs, its commands parse, its links exist."""

import doctest
import os
import re
import shlex
import shutil
import subprocess
import tarfile
from collections.abc import Iterator
from importlib.util import find_spec
from pathlib import Path

import pytest

import graspbox
from graspbox import object_sets

ROOT = Path(__file__).parents[2]
#: Prefixes of absolute links to files of the repository: README.md is rendered elsewhere, too.
REPOSITORY = (
    "https://github.com/graspbox/graspbox/blob/main/",
    "https://raw.githubusercontent.com/graspbox/graspbox/main/",
)


def documents() -> list[Path]:
    """Every page that is written by hand."""
    pages = [*ROOT.glob("*.md"), *ROOT.glob("docs/*.md"), *ROOT.glob("python/**/*.md"), *ROOT.glob("env/**/*.md")]
    assert len(pages) > 8
    return sorted(pages)


def put_mug(folder: Path) -> None:
    """Copy the mug of the YCB set to where the README expects it."""
    path = object_sets.load("ycb:025_mug")[0].path
    assert path is not None
    shutil.copy(path, folder / "mug.stl")


def run_blocks(page: Path) -> int:
    """Run the Python blocks of a page in order, in one namespace; count them."""
    blocks = re.findall(r"```python\n(.*?)```", page.read_text(), flags=re.DOTALL)
    names: dict[str, object] = {}
    for block in blocks:
        exec(compile(block, page.name, "exec"), names)
    return len(blocks)


def test_readme_code_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    put_mug(tmp_path)
    monkeypatch.chdir(tmp_path)
    assert run_blocks(ROOT / "README.md") == 3
    rates = capsys.readouterr().out.replace("(", " ").replace(")", " ").replace(",", " ").split()
    assert len(rates) == 4
    assert all(0.0 <= float(rate) <= 1.0 for rate in rates)


@pytest.mark.parametrize(("name", "count"), [("hands", 1), ("environments", 7), ("dataset", 3), ("policies", 2)])
def test_code_of_pages_runs(name: str, count: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(ROOT)
    assert run_blocks(ROOT / "docs" / f"{name}.md") == count


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


def command_lines() -> Iterator[list[str]]:
    """Words of every command in the code blocks without a language, and in the code spans, of all pages."""
    for page in documents():
        # Language, text and what follows each block: ``` opens and closes in turn.
        parts = re.split(r"^```(\w*)\n", page.read_text(), flags=re.DOTALL | re.MULTILINE)
        prose, blocks = parts[0::4], zip(parts[1::4], parts[2::4], strict=True)
        lines = [line for language, text in blocks if not language for line in text.replace("\\\n", " ").splitlines()]
        lines += [span for text in prose for span in re.findall(r"`((?:graspbox|python|make)\s[^`]+)`", text)]
        for line in lines:
            try:
                words = shlex.split(line, comments=True)
            except ValueError:
                continue
            if words and words[0] in {"graspbox", "python", "make"}:
                yield words


def check_graspbox(words: list[str]) -> None:
    """Parse a call of the command line as the program would."""
    from typer.main import get_command

    from graspbox import cli

    commands = get_command(cli.typer_app).commands  # type: ignore[attr-defined]
    assert words[1] in commands, words
    if len(words) == 2:  # named in a sentence
        return
    with commands[words[1]].make_context(words[1], list(words[2:])):
        pass


def check_python(words: list[str]) -> None:
    """Find a script or module, and its options in its source."""
    rest = words[2:]
    if words[1] == "-m":
        rest = words[3:]
        spec = find_spec(words[2])
        assert spec is not None, words
        assert spec.origin is not None, words
        files = list(Path(spec.origin).parent.rglob("*.py"))
    elif (ROOT / words[1]).is_file():
        files = [ROOT / words[1]]
    else:
        files = list((ROOT / "tests/python").glob(words[1]))
        assert files, words
    # Groups of options, such as ``--sizes.rounds``, are classes of this package.
    grouped = sorted((ROOT / "python/graspbox/policy_training").glob("*.py"))
    own = "".join(file.read_text() for file in files)
    shared = "".join(file.read_text() for file in grouped)
    for option in (word for word in rest if word.startswith("--")):
        group, _, name = option[2:].partition("=")[0].rpartition(".")
        source = shared if group else own
        assert not group or re.search(rf"^    {group}: ", own + shared, re.MULTILINE), (words, option)
        assert f"--{name}" in source or re.search(rf"\b{name.replace('-', '_')}\b", source), (words, option)


def test_commands_parse(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Commands, options and recipes that the pages name exist."""
    put_mug(tmp_path)
    monkeypatch.chdir(tmp_path)
    makefile = (ROOT / "Makefile").read_text()
    seen = set()
    for words in command_lines():
        seen.add(" ".join(words[:2]))
        if words[0] == "make":
            assert re.search(rf"^{words[1]}:", makefile, flags=re.MULTILINE), words
        elif words[0] == "python":
            check_python(words)
        elif not any(word in {"|", "SPEC", "POLICY", "CHECK"} for word in words):
            check_graspbox(words)
    wanted = {
        "graspbox plan",
        "graspbox grasp",
        "graspbox evaluate",
        "graspbox dataset",
        "make demo",
        "python scripts/train_sb3.py",
        "python -m",
    }
    assert wanted <= seen


def test_links_lead_somewhere() -> None:
    """Links to files of the repository exist, and the README, which an index renders alone, has no relative ones."""
    count = 0
    for page in documents():
        for link in re.findall(r"\]\(([^)\s]+)\)", page.read_text()):
            target = link.partition("#")[0]
            prefix = next((p for p in REPOSITORY if target.startswith(p)), None)
            if prefix is not None:
                assert (ROOT / target.removeprefix(prefix)).exists(), f"{page.name}: {link}"
                count += 1
            elif not target.startswith("http"):
                assert page != ROOT / "README.md", f"a relative link in the README: {link}"
                assert os.path.exists(page.parent / target), f"{page.name}: {link}"
    assert count > 10


def test_pages_use_plain_words() -> None:
    """Phrases that a native reader would stumble over."""
    phrases = r"stands? in `|\bso many\b|\bmend(s|ed|ing)?\b|said beside|is gone with|goes? on where|what one runs"
    for page in documents():
        found = re.search(phrases, page.read_text())
        assert found is None, f"{page.relative_to(ROOT)}: {found and found[0]!r}"


def test_source_distribution_has_what_the_readme_runs(tmp_path: Path) -> None:
    command = ["maturin", "sdist", "--out", str(tmp_path)]
    subprocess.run(command, cwd=ROOT, check=True, capture_output=True)
    (archive,) = tmp_path.glob("*.tar.gz")
    with tarfile.open(archive) as packed:
        names = {name.partition("/")[2] for name in packed.getnames()}
    scripts = {words[1] for words in command_lines() if words[0] == "python" and words[1].startswith("scripts/")}
    assert len(scripts) >= 3
    assert scripts | {"README.md", "CHANGELOG.md", "LICENSE", "docs/hands.md"} <= names
