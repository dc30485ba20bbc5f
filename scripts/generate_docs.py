"""Write the generated parts of docstrings and pages: tables of environments, data sets and cards, the command line.

    python scripts/generate_docs.py            # rewrite outdated files
    python scripts/generate_docs.py --check    # list outdated files, and exit with 1

A table is between ``<!-- generated: NAME -->`` and ``<!-- end -->`` in the docstring of a module or in a page, where
NAME is one of `TABLES`. Everything comes from the core's tables (`graspbox.envs.spaces.tables`), from the signatures
of the environments, from `graspbox.data.trials.schema`, from the cards of the published policies and from the
commands of the package: a new observation, reward term,
info entry, keyword or column is a row there. ``make fmt`` runs this program, ``make lint`` its check.
"""

import argparse
import re
from collections.abc import Iterable
from pathlib import Path

from doc_tables import arms, cards, commands, environments
from graspbox._common.programs import run_program
from graspbox.data.trials import schema

ROOT = Path(__file__).parents[1]
FOLDER = ROOT / "python/graspbox/envs"
#: Pages with tables.
PAGES = tuple(
    ROOT / "docs" / name
    for name in ("reference/data.md", "reference/arms.md", "reference/cli.md", "results/policies.md")
)
#: Every table that a marker can name.
TABLES = {
    **environments.tables(),
    "trials of a data set": lambda: data_table(schema.TRIALS),
    "images of a data set": lambda: data_table(schema.IMAGES),
    "commands": commands.command_sections,
    **cards.tables(),
    **arms.tables(),
}


def data_table(columns: Iterable[schema.Column]) -> str:
    """Columns of the files of a data set."""
    return environments.markdown("column type meaning", [(f"`{c.name}`", c.type, c.meaning) for c in columns])


def with_tables(text: str) -> str:
    """Replace the text between the markers."""

    def replaced(match: re.Match[str]) -> str:
        name = match.group(1)
        if name not in TABLES:
            raise SystemExit(f"there is no table {name!r}; choose from {', '.join(TABLES)}")
        return f"<!-- generated: {name} -->\n\n{TABLES[name]()}\n\n<!-- end -->"

    return re.sub(r"<!-- generated: (.*?) -->\n.*?<!-- end -->", replaced, text, flags=re.DOTALL)


def generated(path: Path) -> str:
    """Return the up-to-date text of a file."""
    return with_tables(path.read_text())


def outdated(write: bool = False) -> list[Path]:
    """Find the files with outdated tables; with `write`, rewrite them."""
    texts = {path: generated(path) for path in (*sorted(FOLDER.rglob("*.py")), *PAGES)}
    changed = [path for path, text in texts.items() if text != path.read_text()]
    for path in changed if write else ():
        path.write_text(texts[path])
    return changed


def main() -> None:
    """Run the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--check", action="store_true", help="change nothing; exit with 1 if a file is out of date")
    check = parser.parse_args().check
    texts = outdated(write=not check)
    for path in texts:
        print(f"{path.relative_to(ROOT)} {'is out of date: run make fmt' if check else 'rewritten'}")
    raise SystemExit(1 if check and texts else 0)


if __name__ == "__main__":
    run_program(main)
