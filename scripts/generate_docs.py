"""Write the generated parts of docstrings and pages: tables of environments and data sets, the command line.

    python scripts/generate_docs.py            # rewrite outdated files
    python scripts/generate_docs.py --check    # list outdated files, and exit with 1

A table is between ``<!-- generated: NAME -->`` and ``<!-- end -->`` in the docstring of a module or in a page, where
NAME is one of `tables`. The section Parameters of the constructors is generated completely. Everything comes from the
core's tables (`graspbox.envs.spaces.tables`), from `graspbox.envs.settings`, from `graspbox.dataset.schema` and from
the commands of `graspbox.cli`: a new observation, reward term, info entry, keyword or column is a row there. ``make
fmt`` runs this program, ``make lint`` its check.
"""

import argparse
import inspect
import math
import re
import textwrap
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, is_dataclass
from enum import Enum
from functools import partial
from pathlib import Path
from types import NoneType, UnionType
from typing import Any, get_args, get_origin, get_type_hints

import typer
from typer.models import ArgumentInfo

import graspbox
from graspbox import cli
from graspbox.configs import CamerasConfig
from graspbox.dataset import schema
from graspbox.envs import settings, spaces
from graspbox.programs import run_program

ROOT = Path(__file__).parents[1]
FOLDER = ROOT / "python/graspbox/envs"
#: Pages with tables.
PAGES = (ROOT / "docs/reference/data.md", ROOT / "docs/reference/cli.md")
WIDTH = 120

FOUND = spaces.tables(graspbox.load_hand())


@dataclass(frozen=True)
class Constructor:
    """A class whose section Parameters is generated; with `base`, it lists the difference from that class."""

    file: str
    owner: str
    keywords: type
    positional: tuple[str, ...] = ("objects",)
    base: "Constructor | None" = None

    @property
    def path(self) -> str:
        """Full name of the class."""
        return f"graspbox.envs.{self.file.removesuffix('.py')}.{self.owner}"


GRASP = Constructor("grasp.py", "GraspEnv", settings.GraspSettings)
POSE = Constructor("grasp_pose.py", "GraspPoseEnv", settings.GraspPoseSettings, base=GRASP)
WIDE = ("num_envs", "objects")
CONSTRUCTORS = (
    GRASP,
    Constructor("vector.py", "GraspVectorEnv", settings.GraspVectorSettings, WIDE, GRASP),
    POSE,
    Constructor("grasp_pose.py", "GraspPoseVectorEnv", settings.GraspPoseVectorSettings, WIDE, POSE),
)
POSITIONAL = {"num_envs": settings.NUM_ENVS, "objects": settings.OBJECTS}


def markdown(titles: str, rows: Iterable[Sequence[str]]) -> str:
    """Write a table as Markdown; its titles are words."""
    names = titles.split()
    lines = [f"| {' | '.join(cells)} |" for cells in (names, *rows)]
    return "\n".join([lines[0], "|" + "---|" * len(names), *lines[1:]])


def shown(value: Any) -> str:
    """Write a default."""
    if is_dataclass(value):
        return f"{type(value).__name__}()"
    return str(value) if isinstance(value, Enum) else repr(value)


def number(value: float) -> str:
    """Write a bound."""
    known = {round(math.pi, 6): "pi", round(math.pi / 2, 6): "pi/2"}
    return known.get(round(value, 6), f"{value:g}")


def placed(columns: Sequence[spaces.Column]) -> Iterator[tuple[str, spaces.Column]]:
    """Give the columns of a vector with their indices."""
    first = 0
    for column in columns:
        last = first + column["size"] - 1
        yield str(first) if last == first else f"{first}-{last}", column
        first = last + 1


def keyword_table(single: type, vector: type) -> str:
    """Keywords of an environment: their defaults, and where they are available."""
    alone = settings.keywords(single)
    rows = [("num_envs", settings.NUM_ENVS, "vector"), ("objects", settings.OBJECTS, "both")]
    rows += [(name, row, "both" if name in alone else "vector") for name, row in settings.keywords(vector).items()]
    return markdown("keyword default environment", [(name, shown(row.default), where) for name, row, where in rows])


def action_table(control: str) -> str:
    """Actions of a control mode."""
    rows = [
        (index, row["name"], number(row["low"]), number(row["high"]), row["unit"], row["meaning"])
        for index, row in placed(spaces.columns_of(control, FOUND)[0])
    ]
    return markdown("index name -1 1 unit meaning", rows)


def vector_table(control: str) -> str:
    """Vectors of a control mode as wholes; `column_table` lists their columns."""
    rows = [
        (name, str(spaces.size(columns)), "float32", "yes" if name in FOUND["privileged"] else "no")
        for name, columns in spaces.columns_of(control, FOUND)[1].items()
    ]
    return markdown("vector shape dtype privileged", rows)


def column_table(control: str) -> str:
    """Columns of all vectors of a control mode: the indices of each column in each vector."""
    vectors = spaces.columns_of(control, FOUND)[1]
    indices: dict[str, dict[str, str]] = {}
    columns: dict[str, spaces.Column] = {}
    for vector, rows in vectors.items():
        for index, column in placed(rows):
            indices.setdefault(column["name"], {})[vector] = index
            columns[column["name"]] = column
    cells = [
        (
            name,
            *(indices[name].get(vector, "") for vector in vectors),
            *(number(row["low"]), number(row["high"]), row["unit"], row["meaning"]),
        )
        for name, row in columns.items()
    ]
    return markdown(f"column {' '.join(vectors)} min max unit meaning", cells)


def image_table() -> str:
    """Images of the default cameras; a single bound applies to all channels."""
    rows = []
    for row in spaces.images(graspbox.load_hand(), CamerasConfig(images=spaces.IMAGES)):
        low, high = (", ".join(f"{bound:.3g}" for bound in row[key]) for key in ("low", "high"))
        shape, cameras = " x ".join(map(str, row["shape"])), ", ".join(row["cameras"])
        privileged = "yes" if row["privileged"] else "no"
        bounds = (row["name"], shape, row["dtype"], low, high, cameras)
        rows.append((*bounds, row["frame"], row["unit"], row["missing"], privileged, row["meaning"]))
    return markdown("image shape dtype min max camera frame unit missing privileged meaning", rows)


def term_table(control: str) -> str:
    """Reward terms of a control mode."""
    rows = [(t["name"], number(t["low"]), number(t["high"]), t["meaning"]) for t in spaces.terms(control, FOUND)]
    return markdown("term min max meaning", rows)


def info_table(control: str) -> str:
    """Info of a control mode; entries added by Python come last."""
    types = {"float64": "float", "int64": "int"}
    rows = [
        (row["name"], types.get(row["dtype"], row["dtype"]), row["unit"], row["meaning"])
        for row in spaces.entries(control, FOUND)
    ]
    added = ("reward_terms", "dict", "", "reward terms of the last step (float) by name; zeros after a reset")
    return markdown("entry type unit meaning", [*rows, added])


def data_table(columns: Iterable[schema.Column]) -> str:
    """Columns of the files of a data set."""
    return markdown("column type meaning", [(f"`{c.name}`", c.type, c.meaning) for c in columns])


def option_values(kind: Any, info: Any) -> str:
    """Describe the values of an argument or option: empty for a flag, else their type, bounds or meaning."""
    options = [part for part in get_args(kind) if part is not NoneType]
    if isinstance(kind, UnionType):  # an option without a default
        return option_values(options[0], info)
    if get_origin(kind) is list:
        return f"{option_values(options[0], info)}; repeatable"
    if kind is bool:
        return ""
    if info.metavar and not isinstance(info, ArgumentInfo):
        return str(info.metavar)
    if options:  # a literal
        return " or ".join(f"`{option}`" for option in options)
    text = {int: "integer", float: "number", str: "text", Path: "path"}[kind]
    if info.min is None:
        return text
    # The greatest seed of 64 bits is not informative.
    bounded = info.max is not None and info.max < 2**32
    return f"{text}, {info.min} to {info.max}" if bounded else f"{text}, at least {info.min}"


def option_row(option: Any, kind: Any, info: Any) -> tuple[str, ...]:
    """Write an argument or option of a command: its names, values, default and meaning."""
    names = [f"`{name}`" for name in (*option.opts, *option.secondary_opts)]
    if isinstance(info, ArgumentInfo):
        names = [f"`{option.metavar or option.name.upper()}`"]
    if option.required:
        default = "required"
    elif kind is bool:
        default = names[0] if option.default else ""
    else:
        default = "" if option.default is None else f"`{option.default}`"
    return ", ".join(names), option_values(kind, info), default, option.help or ""


def command_sections() -> str:
    """Write a section for each command, with its arguments and options, or with its own commands."""
    found = []
    for name, command in typer.main.get_command(cli.typer_app).commands.items():  # type: ignore[attr-defined]
        if inner := getattr(command, "commands", None):
            table = markdown("command meaning", [(f"`{one}`", inner[one].help or "") for one in inner])
        else:
            hints = get_type_hints(inspect.unwrap(command.callback), include_extras=True)
            options = [option for option in command.params if option.name in hints]
            rows = [option_row(option, *get_args(hints[option.name])[:2]) for option in options]
            table = markdown("name values default meaning", rows)
        found.append(f"## graspbox {name}\n\n{inspect.cleandoc(command.help or '')}\n\n{table}")
    return "\n\n".join(found)


def tables() -> dict[str, Callable[[], str]]:
    """Return every table that a marker can name."""
    found: dict[str, Callable[[], str]] = {
        "images": image_table,
        "trials of a data set": partial(data_table, schema.TRIALS),
        "images of a data set": partial(data_table, schema.IMAGES),
        "commands": command_sections,
    }
    kinds = {
        "Grasp-v0": ("twist", settings.GraspSettings, settings.GraspVectorSettings),
        "GraspPose-v0": ("grasp_pose", settings.GraspPoseSettings, settings.GraspPoseVectorSettings),
    }
    for env, (control, single, vector) in kinds.items():
        found[f"keywords of {env}"] = partial(keyword_table, single, vector)
        found[f"vectors of {env}"] = partial(vector_table, control)
        found[f"columns of {env}"] = partial(column_table, control)
        found[f"reward of {env}"] = partial(term_table, control)
        found[f"info of {env}"] = partial(info_table, control)
    for control in (*FOUND["actions"], "grasp_pose"):
        found[f"action of {control}"] = partial(action_table, control)
    return found


TABLES = tables()


def with_tables(text: str) -> str:
    """Replace the text between the markers."""

    def replaced(match: re.Match[str]) -> str:
        name = match.group(1)
        if name not in TABLES:
            raise SystemExit(f"there is no table {name!r}; choose from {', '.join(TABLES)}")
        return f"<!-- generated: {name} -->\n\n{TABLES[name]()}\n\n<!-- end -->"

    return re.sub(r"<!-- generated: (.*?) -->\n.*?<!-- end -->", replaced, text, flags=re.DOTALL)


def parameters(constructor: Constructor) -> str:
    """Write the section Parameters of a constructor."""
    own = {name: POSITIONAL[name] for name in constructor.positional} | dict(settings.keywords(constructor.keywords))
    base = constructor.base
    known = {} if base is None else dict(settings.keywords(base.keywords))
    entries = [(f"{name} : {row.type}", row.meaning) for name, row in own.items() if name not in known]
    if base is not None:
        missing = [f"``{name}``" for name in known if name not in own]
        exceptions = f", except {' and '.join(missing)}" if missing else ""
        entries.append(("**settings", f"Other keywords of `{base.path}`{exceptions}."))
    lines = ["    Parameters", "    ----------"]
    for head, meaning in entries:
        lines.append(f"    {head}")
        indent = " " * 8
        lines += textwrap.wrap(meaning, WIDTH, initial_indent=indent, subsequent_indent=indent)
    return "\n".join(lines) + "\n"


def with_parameters(text: str, constructor: Constructor) -> str:
    """Replace the section Parameters of a class."""
    pattern = rf"(class {constructor.owner}\(.*?\n)    Parameters\n    -+\n.*?(\n    \w+\n    ---)"
    found, count = re.subn(
        pattern, lambda m: m.group(1) + parameters(constructor) + m.group(2), text, count=1, flags=re.DOTALL
    )
    if not count:
        raise SystemExit(f"the docstring of {constructor.owner} has no section Parameters before another section")
    return found


def generated(path: Path) -> str:
    """Return the up-to-date text of a file."""
    text = with_tables(path.read_text())
    for constructor in CONSTRUCTORS:
        if constructor.file == path.name:
            text = with_parameters(text, constructor)
    return text


def outdated(write: bool = False) -> list[Path]:
    """Find the files with outdated tables, and rewrite them unless `check`."""
    found = []
    for path in (*sorted(FOLDER.glob("*.py")), *PAGES):
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
    run_program(main)
