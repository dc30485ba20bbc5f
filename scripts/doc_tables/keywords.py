"""The keywords of the environments, as a table and as the sections Parameters of their constructors."""

import re
import textwrap
from dataclasses import dataclass, is_dataclass
from enum import Enum
from typing import Any

from doc_tables.environments import markdown
from graspbox.envs import settings

WIDTH = 120


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


WIDE = ("num_envs", "objects")
GRASP = Constructor("grasp.py", "GraspEnv", settings.GraspSettings)
VECTOR = Constructor("vector.py", "GraspVectorEnv", settings.GraspVectorSettings, WIDE, GRASP)
POSE = Constructor("grasp_pose.py", "GraspPoseEnv", settings.GraspPoseSettings, base=GRASP)
POSES = Constructor("grasp_pose.py", "GraspPoseVectorEnv", settings.GraspPoseVectorSettings, WIDE, VECTOR)
CLEAR = Constructor("clear.py", "ClearEnv", settings.ClearSettings, base=POSE)
CLEARS = Constructor("clear.py", "ClearVectorEnv", settings.ClearVectorSettings, WIDE, POSES)
CONSTRUCTORS = (GRASP, VECTOR, POSE, POSES, CLEAR, CLEARS)
POSITIONAL = {"num_envs": settings.NUM_ENVS, "objects": settings.OBJECTS}


def shown(value: Any) -> str:
    """Write a default."""
    if is_dataclass(value):
        return f"{type(value).__name__}()"
    return str(value) if isinstance(value, Enum) else repr(value)


def keyword_table() -> str:
    """Keywords of ``Grasp-v0``: their defaults, and where they are available."""
    alone, every = (settings.keywords(one.keywords) for one in (GRASP, VECTOR))
    rows = [("num_envs", settings.NUM_ENVS, "vector"), ("objects", settings.OBJECTS, "both")]
    rows += [(name, row, "both" if name in alone else "vector") for name, row in every.items()]
    return markdown("keyword default environment", [(name, shown(row.default), where) for name, row, where in rows])


def parameters(constructor: Constructor) -> str:
    """Write the section Parameters of a constructor."""
    own, base = dict(settings.keywords(constructor.keywords)), constructor.base
    shared = [name for name in constructor.positional if base is not None and name in base.positional]
    positional = {name: POSITIONAL[name] for name in constructor.positional if name not in shared}
    entries = [(f"{name} : {row.type}", row.meaning) for name, row in positional.items()]
    if base is None:
        entries += [(f"{name} : {row.type}", row.meaning) for name, row in own.items()]
    else:
        known = settings.keywords(base.keywords)
        entries.append((", ".join(shared), f"As of `{base.path}`."))
        entries += [(f"{name} : {row.type}", row.meaning) for name, row in own.items() if known.get(name) != row]
        missing = [f"``{name}``" for name in known if name not in own]
        exceptions = f", except {' and '.join(missing)}" if missing else ""
        entries.append(("**settings", f"Other keywords of `{base.path}`{exceptions}."))
    lines = ["    Parameters", "    ----------"]
    for head, meaning in entries:
        indent = " " * 8
        lines += [f"    {head}", *textwrap.wrap(meaning, WIDTH, initial_indent=indent, subsequent_indent=indent)]
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
