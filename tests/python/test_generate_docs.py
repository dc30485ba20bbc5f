"""The tables of the docstrings are those of the core and of the keywords; `make fmt` writes them."""

import re
from typing import Any

import gymnasium
import pytest

from graspbox import errors
from graspbox.envs import clear, goal_tasks, grasp, grasp_pose
from test_scripts import script

DOCS = {"graspbox/Grasp-v0": grasp.__doc__ or "", "graspbox/GraspPose-v0": grasp_pose.__doc__ or ""}


def section(text: str, title: str) -> str:
    """Cut a section out of a docstring."""
    found = re.search(rf"^{title}\n-+\n(.*?)(?=^\w[^\n]*\n---|\Z)", text, flags=re.DOTALL | re.MULTILINE)
    assert found, title
    return found.group(1)


def rows(table: str) -> list[str]:
    """Read the first cells of a table's rows."""
    return re.findall(r"^\| (\w+) \|", table, flags=re.MULTILINE)[1:]


def test_every_table_is_up_to_date() -> None:
    assert script("generate_docs").outdated() == []


def test_every_table_has_a_place() -> None:
    program = script("generate_docs")
    modules = [clear.__doc__ or "", goal_tasks.__doc__ or "", *DOCS.values()]
    texts = [*modules, *(page.read_text() for page in program.PAGES)]
    assert sorted(re.findall(r"<!-- generated: (.*?) -->", "".join(texts))) == sorted(program.TABLES)


def test_a_stale_table_is_found_and_written_anew() -> None:
    program = script("generate_docs")
    text = "Before.\n\n<!-- generated: reward of Grasp-v0 -->\n\n| term |\n\n<!-- end -->\n\nAfter.\n"
    new = program.with_tables(text)
    assert new != text
    assert "| reach | -1 | 1 |" in new
    assert new.startswith("Before.")
    assert new.endswith("After.\n")
    assert program.with_tables(new) == new
    with pytest.raises(SystemExit, match="no table 'moon'"):
        program.with_tables("<!-- generated: moon -->\n<!-- end -->")


@pytest.mark.parametrize("env_id", DOCS)
def test_the_table_of_infos_lists_what_comes(env_id: str) -> None:
    _, info = gymnasium.make(env_id, objects="procedural:can:0").reset(seed=0)
    every, targets = section(DOCS["graspbox/Grasp-v0"], "Info").split("With a layout of several objects")
    listed = rows(every)
    if env_id != "graspbox/Grasp-v0":
        # Its table has the entries that the other environment lacks; the dictionary of reward terms comes last.
        listed[-1:-1] = rows(section(DOCS[env_id], "Info"))
    assert listed == list(info)
    _, info = gymnasium.make(env_id, objects="procedural:can:0-3", layout="packed").reset(seed=0)
    assert [*listed[:-1], *rows(targets), listed[-1]] == list(info)


def test_the_options_are_those_that_a_reset_takes() -> None:
    """The core names them all where one is unknown."""
    env: Any = gymnasium.make("graspbox/Grasp-v0", objects="procedural:can:0").unwrapped
    with pytest.raises(errors.ConfigError, match="no field 'moon'") as caught:
        env.reset(seed=0, options={"moon": 1})
    names = re.findall(r"'(\w+)'", str(caught.value).split("its fields are")[1])
    assert rows(section(DOCS["graspbox/Grasp-v0"], "Options of a reset")) == names
