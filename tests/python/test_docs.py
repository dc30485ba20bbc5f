"""The documentation is true: its code runs, and its commands parse. `test_links` follows its links."""

import doctest
import json
import re
import shlex
import subprocess
import tarfile
import tomllib
from collections.abc import Iterator
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import pytest

import graspbox
from command_line import invoke
from graspbox._common.entry_points import entry_points_of
from graspbox.cli import COMMANDS, typer_app
from graspbox.learn.commands import TRAININGS, parse
from graspbox.policies.published.installed import PACKAGE, PUBLISHED
from installing import offer

ROOT = Path(__file__).parents[2]


def documents() -> list[Path]:
    """Every page that is written by hand."""
    pages = [*ROOT.glob("*.md"), *ROOT.glob("docs/**/*.md"), *ROOT.glob("python/**/*.md"), *ROOT.glob("env/**/*.md")]
    assert len(pages) > 8
    return sorted(pages)


def code_of(page: Path) -> list[str]:
    """Find the Python blocks of a page."""
    return re.findall(r"^```python\n(.*?)^```$", page.read_text(), flags=re.DOTALL | re.MULTILINE)


def runnable() -> Iterator[Any]:
    """Every Python block of the pages that a reader copies from, as a parameter.

    `test_your_hand` and `test_trunks` run those that need files.
    """
    guides = [page for page in ROOT.glob("docs/guides/*.md") if page.name != "hand.md"]
    reference = [ROOT / f"docs/reference/{name}.md" for name in ("environments", "hands", "python/exchange")]
    for page in (ROOT / "README.md", ROOT / "docs/index.md", ROOT / "docs/start.md", *sorted(guides), *reference):
        for index, block in enumerate(code_of(page)):
            yield pytest.param(block, id=f"{page.stem}-{index}")


@pytest.fixture
def checkout(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Work in a folder with the files of a checkout that pages name; it keeps the files written by their code.

    The published policies are installed, as pages say.
    """
    for name in ("env", "policies"):
        (tmp_path / name).symlink_to(ROOT / name)
    (tmp_path / "site").mkdir()
    (tmp_path / "site/graspbox_policies").symlink_to(ROOT / "policies")
    offer(tmp_path / "site", PACKAGE, **{name: f"graspbox_policies.{name}" for name in PUBLISHED})
    monkeypatch.syspath_prepend(tmp_path / "site")
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.parametrize("block", list(runnable()))
@pytest.mark.usefixtures("checkout")
def test_every_block_runs_alone(block: str) -> None:
    """A reader may copy any block first: it has its imports, and needs no name and no file of another block."""
    exec(compile(block, "block", "exec"), {})


def test_the_command_of_the_readme_fits_its_image(checkout: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The block that renders a depth image prints the intrinsics of the command below it, which finds grasps."""
    page = ROOT / "README.md"
    (block,) = (block for block in code_of(page) if "depth.npy" in block)
    exec(compile(block, "README.md", "exec"), {})
    intrinsics = [line.strip(" []").split() for line in capsys.readouterr().out.splitlines()[-3:]]
    (command,) = re.findall(r"^graspbox grasp-image .*$", page.read_text(), flags=re.MULTILINE)
    words = shlex.split(command)[1:]
    given = words[words.index("--intrinsics") + 1 :][:4]
    assert [float(one) for one in given] == [float(intrinsics[r][c]) for r, c in ((0, 0), (1, 1), (0, 2), (1, 2))]
    result = invoke([*words, "--json"])
    assert result.exit_code == 0, result.output
    assert json.loads(result.stdout)["grasps"][0]["success"] > 0.5
    assert (checkout / "grasps.png").read_bytes()[:4] == b"\x89PNG"


def test_the_table_of_extras_is_that_of_the_project() -> None:
    """`start.md` names every extra once; `all` consists of extras of the project, without those of developers."""
    extras = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["optional-dependencies"]
    table = (ROOT / "docs/start.md").read_text().partition("| extra |")[2].partition("\n\n")[0]
    cells = re.findall(r"^\| (`.*?) \|", table, flags=re.MULTILINE)
    assert sorted(re.findall(r"`([\w-]+)`", " ".join(cells))) == sorted(extras)
    (everything,) = extras["all"]
    parts = everything.removeprefix("graspbox[").removesuffix("]").split(",")
    assert parts == sorted(set(parts))
    assert set(extras) - set(parts) == {"all", "dev", "docs", "ray", "rerun", "rllib", "train", "usd"}


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
    """Words of every command in the code blocks without a language, and in the code spans, of all pages.

    Those of the notebook belong to the commits that it names.
    """
    for page in (page for page in documents() if page.parent.name != "notebook"):
        # Language, text and the text after each block: ``` opens and closes in turn.
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

    assert words[1] in {*entry_points_of(COMMANDS), "--help", "--version"}, words
    if len(words) == 2:  # named in a sentence
        return
    if words[1:3] == ["hand", "train"] and "--out" in words:
        parse("hand", words[3:])
        return
    if words[1] == "train":
        assert words[2] in entry_points_of(TRAININGS), words
        if "--out" in words:
            parse(words[2], words[3:])
        return
    command: Any = get_command(typer_app(words[1]))
    rest = words[1:]
    while inner := getattr(command, "commands", None):
        assert rest[0] in inner, words
        command, rest = inner[rest[0]], rest[1:]
    if rest:
        with command.make_context(words[1], list(rest)):
            pass


def defines_option(source: str, name: str) -> bool:
    """Whether a program has an option: of argparse or typer by its name, of a dataclass as a field with a type."""
    field = name.replace("-", "_").removeprefix("no_")
    return f'"--{name}"' in source or re.search(rf"^ +{field}: ", source, re.MULTILINE) is not None


def test_an_option_is_more_than_a_word() -> None:
    source = 'def main(out: Path) -> None:\n    """Steps of a run."""\n    parser.add_argument("--seed")\n'
    assert defines_option(source, "seed")
    assert defines_option("class Settings:\n    hand_error: float = 0.0\n", "hand-error")
    assert not defines_option(source, "steps")


def check_python(words: list[str]) -> None:
    """Find a script or module, and its options in its source."""
    rest = words[2:]
    if words[1] == "-m":
        rest = words[3:]
        spec = find_spec(words[2])
        assert spec is not None, words
        assert spec.origin is not None, words
        files = list(Path(spec.origin).parent.rglob("*.py"))
    elif words[1] == "tests/validate.py":
        files = [ROOT / words[1], *(ROOT / "tests/validation").rglob("*.py")]
    elif (ROOT / words[1]).is_file():
        files = [ROOT / words[1]]
    else:
        files = list((ROOT / "tests/python").glob(words[1]))
        assert files, words
    own = "".join(file.read_text() for file in files)
    # Options may be fields of classes that the program imports from its parts or from the package.
    parts = (
        ROOT / "scripts" / f"{name.replace('.', '/')}.py" for name in re.findall(r"^from ([\w.]+) import", own, re.M)
    )
    own += "".join(part.read_text() for part in parts if part.is_file())
    # Found as files: importing a module's parents may need an extra that is not installed.
    modules = set(re.findall(r"^from (graspbox[\w.]*) import", own, re.MULTILINE))
    places = (ROOT / "python" / module.replace(".", "/") for module in sorted(modules))
    paths = [path for place in places for path in (place.with_suffix(".py"), place / "__init__.py")]
    source = own + "".join(path.read_text() for path in paths if path.is_file())
    for option in (word for word in rest if word.startswith("--")):
        name = option[2:].partition("=")[0]
        assert name == "help" or defines_option(source, name), (words, option)


def test_commands_parse() -> None:
    """Commands, options and recipes that the pages name exist."""
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
        "graspbox train",
        "python scripts/plot_sb3.py",
        "python tests/validate.py",
    }
    assert wanted <= seen


def test_pages_use_plain_words() -> None:
    """Pages avoid unidiomatic phrases."""
    phrases = r"stands? in `|\bso many\b|\bmend(s|ed|ing)?\b|said beside|is gone with|goes? on where|what one runs"
    for page in documents():
        found = re.search(phrases, page.read_text())
        assert found is None, f"{page.relative_to(ROOT)}: {found and found[0]!r}"
    words = re.findall(r"[a-z]+", " ".join(page.read_text().lower() for page in documents()))
    assert words.count("what") <= len(words) / 1000


def test_source_distribution_has_what_the_readme_runs(tmp_path: Path) -> None:
    command = ["maturin", "sdist", "--out", str(tmp_path)]
    subprocess.run(command, cwd=ROOT, check=True, capture_output=True)
    (archive,) = tmp_path.glob("*.tar.gz")
    with tarfile.open(archive) as packed:
        names = {name.partition("/")[2] for name in packed.getnames()}
    # Everything that a build elsewhere needs: all of the crates but their fuzzing, and the package.
    command = ["git", "ls-files", "env", "python", ":!env/*/fuzz/*"]
    tracked = subprocess.run(command, cwd=ROOT, check=True, capture_output=True, text=True).stdout.split()
    assert set(tracked) <= names
    assert {"Cargo.toml", "Cargo.lock", "pyproject.toml"} <= names
    scripts = {words[1] for words in command_lines() if words[0] == "python" and words[1].startswith("scripts/")}
    assert len(scripts) >= 3
    assert scripts | {"README.md", "CHANGELOG.md", "LICENSE", "docs/reference/hands.md", "CITATION.cff"} <= names
