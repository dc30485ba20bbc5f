"""Write the tables of the environments' docstrings: keywords, actions, observations, images, rewards, infos.

    python scripts/generate_docs.py            # rewrite what is out of date
    python scripts/generate_docs.py --check    # name what is out of date, and exit with 1

A table is between ``<!-- generated: NAME -->`` and ``<!-- end -->`` in the docstring of a module, where NAME is a key of
`TABLES`. The section Parameters of the constructors is written as a whole. Everything comes from the core's tables
(`graspbox.envs.spaces.tables`) and from `graspbox.envs.settings`: a new observation, reward term, info entry or keyword
is a row there. ``make fmt`` runs this program, ``make lint`` its check.
"""

import argparse
import re
import textwrap
from collections.abc import Callable, Iterable, Sequence
from dataclasses import is_dataclass
from enum import Enum
from pathlib import Path
from typing import Any

import graspbox
from graspbox.configs import CamerasConfig
from graspbox.envs import settings, spaces

ROOT = Path(__file__).parents[1]
FOLDER = ROOT / "python/graspbox/envs"
WIDTH = 120

FOUND = spaces.tables(graspbox.load_hand())

#: Constructors: the file, the class, the keywords, and those that can be given by position.
CONSTRUCTORS = (
    ("grasp.py", "GraspEnv", settings.GraspSettings, ("objects",)),
    ("vector.py", "GraspVectorEnv", settings.GraspVectorSettings, ("num_envs", "objects")),
    ("grasp_pose.py", "GraspPoseEnv", settings.GraspPoseSettings, ("objects",)),
    ("grasp_pose.py", "GraspPoseVectorEnv", settings.GraspPoseVectorSettings, ("num_envs", "objects")),
)
POSITIONAL = {"num_envs": settings.NUM_ENVS, "objects": settings.OBJECTS}


def markdown(titles: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Write a table as Markdown."""
    lines = [titles, ["---"] * len(titles), *rows]
    return "\n".join("|" + "|".join(row) + "|" if row is lines[1] else f"| {' | '.join(row)} |" for row in lines)


def shown(value: Any) -> str:
    """Write a default."""
    if is_dataclass(value):
        return f"{type(value).__name__}()"
    return str(value) if isinstance(value, Enum) else repr(value)


def keyword_table(single: type, vector: type) -> str:
    """Keywords of an environment: their defaults, and where they are available."""
    alone, beside = settings.keywords(single), settings.keywords(vector)
    rows = [("num_envs", settings.NUM_ENVS, "vector"), ("objects", settings.OBJECTS, "both")]
    rows += [(name, row, "both" if name in alone else "vector") for name, row in beside.items()]
    return markdown(("keyword", "default", "environment"), [(name, shown(r.default), where) for name, r, where in rows])


def number(value: float) -> str:
    """Write a bound."""
    return f"{value:g}"


def term_table(terms: Sequence[spaces.Term]) -> str:
    """Reward terms."""
    rows = [(t["name"], number(t["low"]), number(t["high"]), t["meaning"]) for t in terms]
    return markdown(("term", "min", "max", "meaning"), rows)


def info_table(entries: Sequence[Any]) -> str:
    """Entries of the info; what Python adds comes last."""
    rows = [(row["name"], row["dtype"], row["unit"] or "1", row["meaning"]) for row in entries]
    added = ("reward_terms", "dict of float64", "1", "reward terms of the last step by name; zeros after a reset")
    return markdown(("entry", "type", "unit", "meaning"), [*rows, added])


def image_table() -> str:
    """Images of the default cameras."""
    return spaces.image_table(spaces.images(graspbox.load_hand(), CamerasConfig(images=spaces.IMAGES)))


TABLES: dict[str, Callable[[], str]] = {
    "keywords of Grasp-v0": lambda: keyword_table(settings.GraspSettings, settings.GraspVectorSettings),
    "keywords of GraspPose-v0": lambda: keyword_table(settings.GraspPoseSettings, settings.GraspPoseVectorSettings),
    **{f"action of {mode}": lambda mode=mode: spaces.action_table(mode, FOUND) for mode in (*FOUND["actions"], "grasp_pose")},
    "vectors of Grasp-v0": lambda: spaces.vector_table("twist", FOUND),
    "vectors of GraspPose-v0": lambda: spaces.vector_table("grasp_pose", FOUND),
    "fields of Grasp-v0": lambda: spaces.observation_table("twist", FOUND),
    "fields of GraspPose-v0": lambda: spaces.observation_table("grasp_pose", FOUND),
    "images": image_table,
    "reward of Grasp-v0": lambda: term_table(FOUND["terms"]),
    "reward of GraspPose-v0": lambda: term_table(FOUND["decision"]["terms"]),
    "info of Grasp-v0": lambda: info_table(FOUND["info"]),
    "info of GraspPose-v0": lambda: info_table(FOUND["decision"]["info"]),
}


def with_tables(text: str) -> str:
    """Replace what is between the markers."""

    def replaced(match: re.Match[str]) -> str:
        name = match.group(1)
        if name not in TABLES:
            raise SystemExit(f"there is no table {name!r}; choose from {', '.join(TABLES)}")
        return f"<!-- generated: {name} -->\n\n{TABLES[name]()}\n\n<!-- end -->"

    return re.sub(r"<!-- generated: (.*?) -->\n.*?<!-- end -->", replaced, text, flags=re.DOTALL)


def parameters(kind: type, positional: Sequence[str]) -> str:
    """Write the section Parameters of a constructor."""
    rows = {name: POSITIONAL[name] for name in positional} | dict(settings.keywords(kind))
    lines = ["    Parameters", "    ----------"]
    for name, row in rows.items():
        lines.append(f"    {name} : {row.type}")
        indent = " " * 8
        lines += textwrap.wrap(row.meaning, WIDTH, initial_indent=indent, subsequent_indent=indent)
    return "\n".join(lines) + "\n"


def with_parameters(text: str, owner: str, kind: type, positional: Sequence[str]) -> str:
    """Replace the section Parameters of a class."""
    pattern = rf"(class {owner}\(.*?\n)    Parameters\n    -+\n.*?(\n    \w+\n    ---)"
    found, count = re.subn(
        pattern, lambda m: m.group(1) + parameters(kind, positional) + m.group(2), text, count=1, flags=re.DOTALL
    )
    if not count:
        raise SystemExit(f"the docstring of {owner} has no section Parameters before another section")
    return found


def generated(path: Path) -> str:
    """Return a file as it should be."""
    text = with_tables(path.read_text())
    for name, owner, kind, positional in CONSTRUCTORS:
        if name == path.name:
            text = with_parameters(text, owner, kind, positional)
    return text


def outdated(write: bool = False) -> list[Path]:
    """Find the files whose tables are not those of the core, and rewrite them if asked to."""
    found = []
    for path in sorted(FOLDER.glob("*.py")):
        new = generated(path)
        if new != path.read_text():
            found.append(path)
            if write:
                path.write_text(new)
    return found


def main() -> None:
    """Run the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--check", action="store_true", help="change nothing; exit with 1 if a file is out of date")
    check = parser.parse_args().check
    found = outdated(write=not check)
    for path in found:
        print(f"{path.relative_to(ROOT)} {'is out of date: run make fmt' if check else 'rewritten'}")
    raise SystemExit(1 if check and found else 0)


if __name__ == "__main__":
    main()
