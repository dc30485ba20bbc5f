"""Commands are entry points: those of other packages too; none is imported before it is called."""

import os
import subprocess
import sys
from importlib.metadata import EntryPoint
from pathlib import Path

import pytest

import graspbox
from graspbox._common.entry_points import entry_points_of, summary
from graspbox.cli import COMMANDS, typer_app
from graspbox.cli.recorders import RECORDERS, rerun_recorder
from graspbox.errors import ConfigError, MissingExtraError
from installing import install

WEIGH = '''
import graspbox
import typer

tools = typer.Typer()


@tools.command()
def lift(mass: float) -> None:
    """Lift something."""
    typer.echo(f"lifts {mass:g} kg")


@tools.callback()
def _tools() -> None:
    pass


def weigh(name: str, grams: bool = False) -> None:
    """Weigh an object:
    its mass.

    More.
    """
    mass = graspbox.object_sets.load(name)[0].load().mass
    typer.echo(f"{1e3 * mass:.0f} g" if grams else f"{mass:.3f} kg")


def silent() -> None:
    raise graspbox.errors.ConfigError("the scale is 0; give more")
'''


@pytest.fixture
def site(tmp_path: Path) -> Path:
    """Install a package that adds commands into a folder."""
    (tmp_path / "weighing.py").write_text(WEIGH)
    points = {name: f"weighing:{name}" for name in ("weigh", "silent", "tools", "gone")}
    install(tmp_path, "weighing", COMMANDS, {**points, "broken": "no_such_module:main"})
    return tmp_path


def run(site: Path, *words: str) -> subprocess.CompletedProcess[str]:
    paths = os.pathsep.join([str(site), os.environ.get("PYTHONPATH", "")])
    command = [sys.executable, "-m", "graspbox", *words]
    environment = {**os.environ, "PYTHONPATH": paths, "COLUMNS": "100"}
    return subprocess.run(command, capture_output=True, text=True, timeout=300, env=environment)


def test_commands_of_another_package_are_listed_and_run(site: Path) -> None:
    listed = run(site, "--help")
    assert listed.returncode == 0
    lines = [" ".join(line.split()) for line in listed.stdout.splitlines()]
    assert {"weigh Weigh an object: its mass.", "silent from weighing", "tools from weighing"} <= set(lines)
    assert "broken from weighing" in lines
    assert "view Open an interactive view in a browser; Ctrl-C ends it." in lines
    weighed = run(site, "weigh", "procedural:can:0", "--grams")
    assert (weighed.returncode, weighed.stderr) == (0, "")
    mass = graspbox.object_sets.load("procedural:can:0")[0].load().mass
    assert weighed.stdout == f"{1e3 * mass:.0f} g\n"
    assert run(site, "tools", "lift", "2").stdout == "lifts 2 kg\n"
    assert "Lift something." in run(site, "tools", "--help").stdout


@pytest.mark.parametrize(
    ("command", "sentence"),
    [
        ("silent", "the scale is 0; give more"),
        ("broken", "the command 'broken' of weighing cannot be imported: No module named 'no_such_module'"),
        ("gone", "the command 'gone' of weighing cannot be imported: module 'weighing' has no attribute 'gone'"),
        ("weihg", "there is no command 'weihg' (did you mean weigh?); graspbox --help lists all"),
        ("view", "the command 'view' is declared by graspbox and viewing; uninstall one of them"),
    ],
)
def test_a_command_that_cannot_run_is_refused_in_a_line(site: Path, command: str, sentence: str) -> None:
    install(site, "viewing", COMMANDS, {"view": "weighing:weigh"})
    done = run(site, command)
    assert (done.returncode, done.stdout, done.stderr) == (2, "", f"graspbox: {sentence}\n")


def test_a_call_without_a_command_shows_the_help(site: Path) -> None:
    done, asked = run(site), run(site, "--help")
    assert (done.returncode, done.stdout) == (2, asked.stdout)


def test_the_help_imports_no_command(site: Path) -> None:
    heavy = ("numpy", "gymnasium", "typer", "rich", "graspbox._core", "graspbox.tools", "graspbox.learn")
    code = (
        "import sys; sys.argv = ['graspbox', '--help']\n"
        "from graspbox.__main__ import main\n"
        "try: main()\n"
        f"finally: print([name for name in {heavy} if name in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines()[-1] == "[]"


@pytest.mark.parametrize("name", sorted(entry_points_of(COMMANDS)))
def test_every_command_is_found_and_summed_up(name: str) -> None:
    point = entry_points_of(COMMANDS)[name]
    assert point.dist is not None
    if point.dist.name == "graspbox":
        assert not summary(point).startswith("from ")
        assert summary(point).endswith((".", ")"))
        assert typer_app(name).registered_callback is not None


def test_only_the_docstring_of_the_named_function_counts(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(tmp_path)
    (tmp_path / "own.py").write_text('"""Module."""\n\ndef one():\n    pass\n\n\ndef two():\n    """Two."""\n')
    found = [summary(EntryPoint(name, f"own:{name}", COMMANDS)) for name in ("one", "two", "three")]
    assert found == ["from an unknown package", "Two.", "Module."]


def test_a_recording_needs_a_recorder(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    assert "rerun" in entry_points_of(RECORDERS)
    assert rerun_recorder(None) is None
    with pytest.raises((ConfigError, MissingExtraError)):
        rerun_recorder(tmp_path / "x.txt")
    monkeypatch.setattr("graspbox.cli.recorders.entry_points_of", lambda _: {})
    with pytest.raises(MissingExtraError, match=r"graspbox\[rerun\]"):
        rerun_recorder(tmp_path / "x.rrd")


@pytest.mark.parametrize("imports", ["graspbox, gymnasium", "gymnasium, graspbox", "graspbox.envs, gymnasium"])
def test_the_environments_are_registered(imports: str) -> None:
    code = f"import {imports}\nprint(gymnasium.make('graspbox/Grasp-v0', objects='procedural:can:0').spec.id)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert (done.stdout, done.stderr) == ("graspbox/Grasp-v0\n", "")


def test_every_name_is_imported_on_access() -> None:
    code = (
        "import graspbox, sys\n"
        "assert not {'numpy', 'gymnasium'} & set(sys.modules)\n"
        "for name in graspbox.__all__: getattr(graspbox, name)\n"
        "for name in graspbox._PACKAGES: assert getattr(graspbox, name).__name__ == f'graspbox.{name}'\n"
        "assert {*graspbox._MODULE_OF} <= {*graspbox.__all__} <= {*dir(graspbox)}\n"
    )
    subprocess.run([sys.executable, "-c", code], check=True)
    with pytest.raises(AttributeError, match="has no attribute 'nothing'"):
        graspbox.nothing  # noqa: B018
