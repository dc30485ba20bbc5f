"""Links, anchors and pictures of the pages resolve: in a checkout, on the site and on a package index."""

import re
import subprocess
import tomllib
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

import graspbox
from graspbox.errors import MissingExtraError
from program_files import imported

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
#: A link or picture of Markdown: whether it is a picture, and where it leads.
LINK = re.compile(r"(!?)\[[^\]]*\]\(([^)\s]+)\)")
#: Code blocks and code spans, in which nothing is a link.
CODE = re.compile(r"^( *)```.*?^\1```$|`[^`\n]+`", re.DOTALL | re.MULTILINE)


def pages(folder: str = ".") -> list[Path]:
    """Every Markdown file that git knows or would add."""
    command = ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard", f"{folder}/*.md"]
    listed = subprocess.run(command, cwd=ROOT, check=True, capture_output=True, text=True).stdout
    found = sorted({ROOT / name for name in listed.split("\0") if name})
    return [page for page in found if page.exists()]


def links(page: Path) -> Iterator[tuple[bool, str]]:
    """Links and pictures of a page that lead to no other host."""
    for picture, target in LINK.findall(CODE.sub("", page.read_text())):
        if not re.match(r"[a-z]+:", target):
            yield bool(picture), target


def anchors(page: Path) -> tuple[set[str], set[str]]:
    """Anchors of the headings of a page, on the site and where a forge renders it."""
    text = re.sub(r"^( *)```.*?^\1```$", "", page.read_text(), flags=re.DOTALL | re.MULTILINE)
    titles = re.findall(r"^#+ +(.+?)(?: +\{.*\})?$", text, flags=re.MULTILINE)
    words = [re.sub(r"[^\w\s-]", "", title).strip().lower() for title in titles]
    return {re.sub(r"[-\s]+", "-", one) for one in words}, {one.replace(" ", "-") for one in words}


def dead(page: Path, target: str) -> str:
    """Return the error of a link; empty if it resolves."""
    path, _, anchor = target.partition("#")
    found = page.parent / path if path else page
    if not found.exists():
        return "there is no such file"
    if anchor and found.suffix == ".md" and not all(anchor in known for known in anchors(found)):
        return "there is no such heading"
    if page.is_relative_to(DOCS) and not found.resolve().is_relative_to(DOCS):
        return "the site does not have this file"
    return ""


def test_links_lead_somewhere() -> None:
    found = [(page, target) for page in pages() for _, target in links(page)]
    assert len(found) > 100
    wrong = [f"{page.relative_to(ROOT)}: {target}: {why}" for page, target in found if (why := dead(page, target))]
    assert wrong == []


@pytest.mark.parametrize("target", ["nowhere.md", "start.md#nowhere", "#nowhere", "../README.md", "pictures/none.png"])
def test_a_dead_link_is_found(target: str) -> None:
    assert dead(DOCS / "index.md", target)
    assert not dead(DOCS / "index.md", "start.md#object-sets")


def test_links_in_code_are_none() -> None:
    assert list(links(DOCS / "results" / "training.md"))
    assert LINK.search(CODE.sub("", "see `[a](b.md)`\n```\n[a](b.md)\n```\n")) is None


def test_every_page_has_a_place_in_the_navigation() -> None:
    named = re.findall(r"[\w/]+[\w-]*\.md", (ROOT / "mkdocs.yml").read_text())
    # `exclude_docs` names the notebook.
    found = {page for page in pages("docs") if not page.is_relative_to(DOCS / "notebook")}
    assert sorted(named) == sorted(str(page.relative_to(DOCS)) for page in found)


def test_every_picture_is_shown() -> None:
    """Each picture of the site is on a page of it."""
    shown = {(page.parent / target).resolve() for page in pages("docs") for picture, target in links(page) if picture}
    assert {path.resolve() for path in (DOCS / "pictures").iterdir()} == shown


@pytest.mark.parametrize("page", [page.stem for page in pages("docs/results") if page.stem != "index"])
def test_results_say_when_they_were_measured(page: str) -> None:
    """A date and a commit, and a command, in the sections that have a table."""
    sections = re.split(r"^## ", (DOCS / "results" / f"{page}.md").read_text(), flags=re.MULTILINE)
    measured = re.compile(r"20\d\d-\d\d-\d\d.*?`[0-9a-f]{7}`", re.DOTALL)
    if measured.search(sections[0]):  # of the whole page
        return
    for section in sections[1:]:
        if re.search(r"^\|.*\d %", section, flags=re.MULTILINE):
            assert measured.search(section), section.partition("\n")[0]


def listed() -> set[str]:
    """Names that the reference documents, those of modules with all that they export."""
    text = "".join(page.read_text() for page in pages("docs/reference"))
    return set(re.findall(r"^::: (\S+)$", text, flags=re.MULTILINE))


def is_listed(name: str, known: set[str]) -> bool:
    """Tell whether a dotted name is in the reference: itself, or the object that exports it."""
    if name in known:
        return True
    holder, _, last = name.rpartition(".")
    found = find(holder) if holder else None
    exported = getattr(found, "__all__", None)
    return found is not None and (exported is None or last in exported) and is_listed(holder, known)


def find(name: str) -> Any:
    """Resolve a dotted name: a module, or an attribute of one; None if there is nothing.

    Names that need a missing extra exist too: their error counts.
    """
    try:
        return import_module(name)
    except ImportError:
        holder, _, last = name.rpartition(".")
    try:
        return getattr(find(holder), last, None) if holder else None
    except MissingExtraError as error:
        return error


def test_the_reference_lists_what_its_packages_export() -> None:
    """Its index names the packages; every name of the reference exists."""
    known = listed()
    packages = re.findall(r"^\| \[`(graspbox\.\w+)`\]", (DOCS / "reference/python/index.md").read_text(), re.MULTILINE)
    assert len(packages) > 10
    names = [f"{one}.{name}" for one in packages for name in getattr(find(one), "__all__", ())]
    # This function tells which extra is missing.
    missing = [name for name in names if not is_listed(name, known) and not name.endswith(".require")]
    assert missing == []
    assert [name for name in known if find(name) is None] == []


def test_the_reference_lists_what_guides_use() -> None:
    known = listed()
    used = set()
    for page in [*pages("docs/guides"), DOCS / "start.md", ROOT / "README.md"]:
        for block in re.findall(r"```python\n(.*?)```", page.read_text(), flags=re.DOTALL):
            for module, names in re.findall(r"^from (graspbox[.\w]*) import (.+)$", block, flags=re.MULTILINE):
                used |= {f"{module}.{name}" for name in re.split(r", *", names)}
            used |= set(re.findall(r"\bgraspbox(?:\.\w+)+", block))
    assert len(used) > 20
    modules = {name for name in used if isinstance(find(name), ModuleType)}
    assert sorted(name for name in used - modules if not is_listed(name, known)) == []


def test_the_reference_lists_the_public_names() -> None:
    """Exports of the package are documented, by name or with their module."""
    known = listed()
    assert len(known) > 50
    public = {f"graspbox.{name}" for name in graspbox.__all__} - {"graspbox.__version__", "graspbox.GraspboxError"}
    assert public <= known
    # No name of the package's own pages has gone.
    own = {name for name in known if re.fullmatch(r"graspbox\.[A-Za-z_]\w*", name)}
    modules = {name for name in own if (ROOT / "python" / name.replace(".", "/")).with_suffix(".py").exists()}
    modules |= {name for name in own if (ROOT / "python" / name.replace(".", "/") / "__init__.py").exists()}
    assert own - modules <= public


def test_a_release_has_absolute_links(tmp_path: Path) -> None:
    """A package index renders the README alone; the address of the repository is given when a release is built."""
    program = imported(ROOT / "scripts/release_tree.py")
    url = "https://example.org/owner/name"
    program.copy_tree(url, "v1", tmp_path / "tree")
    readme = (tmp_path / "tree/README.md").read_text()
    assert list(links(tmp_path / "tree/README.md")) == []
    count = 0
    for picture, target in LINK.findall(CODE.sub("", readme)):
        if target.startswith(url):
            kind, ref, path = target.removeprefix(f"{url}/").split("/", 2)
            assert (kind, ref) == ("raw" if picture else "blob", "v1")
            assert (ROOT / path).exists(), path
            count += 1
    assert count == len(list(links(ROOT / "README.md"))) > 10
    for project in ("pyproject.toml", "packages/policies/pyproject.toml"):
        urls = tomllib.loads((tmp_path / "tree" / project).read_text())["project"]["urls"]
        assert urls == {"Repository": url, "Changelog": f"{url}/blob/v1/CHANGELOG.md"}
    # Without an address the copy is that of the files.
    program.copy_tree(None, "v1", tmp_path / "tree")
    assert (tmp_path / "tree/README.md").read_bytes() == (ROOT / "README.md").read_bytes()


def test_no_file_names_an_address_of_the_repository() -> None:
    """The repository has no fixed address: links are relative, and recipes are told one as REPOSITORY."""
    command = [
        "git",
        "grep",
        "-nIE",
        r"(github\.com|githubusercontent\.com)/graspbox",
        "--",
        ":!tests/python/test_links.py",
    ]
    assert subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False).stdout == ""


def words(page: Path) -> list[str]:
    return page.read_text().split()


def test_documents_are_short_and_plain() -> None:
    assert len(words(ROOT / "README.md")) <= 600
    assert len(words(ROOT / "CHANGELOG.md")) <= 300
    counted = [page for folder in ("", "guides/", "results/", "decisions/") for page in DOCS.glob(f"{folder}*.md")]
    assert sum(len(words(page)) for page in counted) <= 25_000
    assert len(words(ROOT / "ARCHITECTURE.md")) <= 1500
    written = [page for page in pages("docs") if page != DOCS / "reference/cli.md"]
    text = "\n".join(CODE.sub("", page.read_text()) for page in written)
    assert len(re.findall(r"\bwhat\b", text, flags=re.IGNORECASE)) * 1000 <= len(text.split())
