"""Check the files of your hand, or make them from a URDF or MJCF file."""

import sys
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Any, NoReturn

import typer
from rich.console import Console
from rich.table import Table

from graspbox._common.files import check_output, write_text
from graspbox.cli.common import Json, Seed, check_files, console, hand_like, print_json
from graspbox.errors import ConfigError, FileError, GraspboxError, HandError
from graspbox.hand_tools import Finding, GuessedHand, HandReport, check_hand, guess_hand
from graspbox.hand_tools.checking import unit_findings
from graspbox.hands import FittedUrdf, Hand, MeshFit, fitted_urdf, load_hand, urdf_of_mjcf

__all__ = ["hand_app"]

hand_app = typer.Typer(no_args_is_help=True, help=__doc__)

_STYLES = {"error": "bold red", "warning": "yellow", "note": "dim"}


def _refuse(error: GraspboxError, hints: Sequence[Finding] = ()) -> NoReturn:
    """Print why files describe no hand, and end with the status of a wrong call."""
    console.print(f"graspbox: {error}", soft_wrap=True)
    for hint in (hint for hint in hints if hint.severity != "note"):
        console.print(f"{hint.subject}: {hint.value}: {hint.message}; {hint.remedy}", soft_wrap=True)
    raise typer.Exit(2)


def _load(words: list[str]) -> Hand:
    """Load the hand that the arguments name: a name, one word with both files, or both files."""
    if len(words) > 2:
        raise ConfigError(f"{len(words)} arguments; give the name of a hand, or its URDF and its hand.toml")
    urdf = words[0].partition(",")[0]
    try:
        with warnings.catch_warnings(action="ignore"):  # all assumptions are printed
            return load_hand((words[0], words[1]) if len(words) == 2 else hand_like(words[0]))
    except HandError as error:
        _refuse(error, unit_findings(urdf))
    except FileError as error:
        _refuse(error)


def _print_assumptions(assumed: Sequence[str]) -> None:
    """Print what the URDF does not state."""
    for sentence in assumed:
        typer.echo(f"assumed: {sentence}")


def _print_fits(fits: Mapping[str, MeshFit]) -> None:
    """Print which shapes replace each collision mesh, and their distance from it."""
    for name, fit in fits.items():
        kinds = [shape.kind for shape in fit.primitives]
        counts = (f"{kinds.count(kind)} x {kind}" for kind in dict.fromkeys(kinds))
        typer.echo(
            f"{name}: its mesh became {', '.join(counts)}; {1e3 * fit.mean:.1f} mm from it on average, "
            f"{1e3 * fit.most:.1f} mm at most"
        )


def _fits_of(words: list[str]) -> Mapping[str, MeshFit]:
    """Return the fits of the collision meshes of the URDF that the arguments name, if they name one."""
    urdf = Path(words[0].partition(",")[0])
    return fitted_urdf(urdf).fits if urdf.is_file() else {}


def _print_report(report: HandReport) -> None:
    table = Table(title=f"{report.name}: findings", title_justify="left")
    for column in ("", "thing", "value", "finding"):
        table.add_column(column, overflow="fold")
    for finding in report.findings:
        text = f"{finding.message}; {finding.remedy}" if finding.remedy else finding.message
        table.add_row(finding.severity, finding.subject, finding.value, text, style=_STYLES[finding.severity])
    Console(file=sys.stdout, markup=False, highlight=False, emoji=False).print(table)
    counts: dict[str, int] = report.table()["counts"]  # type: ignore[assignment]
    typer.echo(", ".join(f"{count} {severity}{'' if count == 1 else 's'}" for severity, count in counts.items()))


def _fit_table(fit: MeshFit) -> dict[str, Any]:
    return {"shapes": [shape.kind for shape in fit.primitives], "mean": fit.mean, "most": fit.most}


@hand_app.command("check")
def check(
    hand: Annotated[
        list[str], typer.Argument(metavar="HAND", help="The URDF and the hand.toml of a hand, or the name of one.")
    ],
    trials: Annotated[
        bool, typer.Option("--trials/--no-trials", help="Plan and simulate a few grasps too, which takes seconds.")
    ] = True,
    picture: Annotated[
        Path | None, typer.Option(help="Write a picture of the hand open, half closed and closed into this file.")
    ] = None,
    seed: Seed = 0,
    as_json: Json = False,
) -> None:
    """Check a hand: units, limits, inertias, actuators, its closing motion, reach, sensors, and trials.

    An error makes the hand unusable, a warning is probably a mistake, a note is informative. The exit status is 1 if
    there are errors, and 2 if the files are no hand: then every wrong line is listed.
    """
    check_files(None, picture)
    loaded = _load(hand)
    with console.status("checking"):
        report = check_hand(loaded, trials=trials, seed=seed)
    fits = _fits_of(hand)
    if as_json:
        meshes = {name: _fit_table(fit) for name, fit in fits.items()}
        print_json({**report.table(), "assumptions": list(loaded.assumptions), "meshes": meshes})
    else:
        _print_assumptions(loaded.assumptions)
        _print_fits(fits)
        _print_report(report)
    if picture is not None:
        from graspbox import pictures

        pictures.save_hand_motion(picture, loaded)
        console.print(f"wrote {picture}")
    if report.has_errors:
        raise typer.Exit(1)


@hand_app.command("new")
def new(
    urdf: Annotated[Path, typer.Argument(help="The URDF, xacro or MJCF file.")],
    out: Annotated[Path, typer.Option(help="Write this file.")] = Path("hand.toml"),
    name: Annotated[str | None, typer.Option(help="Name of the hand; that of the URDF's file by default.")] = None,
    force: Annotated[bool, typer.Option("--force", help="Replace an existing file.")] = False,
    as_json: Json = False,
) -> None:
    """Begin a hand.toml for a URDF: a servo for each joint, pads and grasp frame are guessed, and the file loads.

    A xacro is expanded (extra urdf), an MJCF file converted (extra mjcf) each time that the hand is loaded.
    The file begins with a list of guesses to review. Nothing is random here, so there is no --seed.
    """
    _check_new(out, force)
    try:
        fitted = fitted_urdf(urdf)  # shows its own progress
        with console.status("guessing"):
            guessed = guess_hand(urdf, name)
    except (HandError, FileError) as error:
        _refuse(error, unit_findings(urdf))
    write_text(out, guessed.text)
    _print_guessed(guessed, fitted, [out], as_json)


@hand_app.command("convert")
def convert(
    mjcf: Annotated[Path, typer.Argument(help="The MJCF file, with one tree of bodies.")],
    out: Annotated[Path, typer.Option(help="Folder of the new hand.urdf and hand.toml.")] = Path("hand"),
    name: Annotated[str | None, typer.Option(help="Name of the hand; that of the file by default.")] = None,
    force: Annotated[bool, typer.Option("--force", help="Replace existing files.")] = False,
    as_json: Json = False,
) -> None:
    """Make the two files of a hand from an MJCF file, which MuJoCo's compiler reads (extra mjcf).

    Collision meshes become boxes, cylinders and spheres. The hand.toml is that of ``graspbox hand new``, with a list of
    guesses to review. Nothing is random here, so there is no --seed.
    """
    urdf, toml = out / "hand.urdf", out / "hand.toml"
    for path in (urdf, toml):
        _check_new(path, force)
    try:
        with console.status("converting"):
            converted = urdf_of_mjcf(mjcf)
            out.mkdir(parents=True, exist_ok=True)
            write_text(urdf, converted.text)
            guessed = guess_hand(urdf, name or mjcf.stem)
    except (HandError, FileError) as error:
        _refuse(error)
    write_text(toml, guessed.text)
    _print_guessed(guessed, converted, [urdf, toml], as_json)


def _check_new(path: Path, force: bool) -> None:
    """Refuse to replace a file, and a place where none can be written."""
    if path.exists() and not force:
        raise ConfigError(f"{str(path)!r} exists; give --force to replace it, or another --out")
    check_output(path)


def _print_guessed(guessed: GuessedHand, urdf: FittedUrdf, files: Sequence[Path], as_json: bool) -> None:
    """Print the new files, what was assumed, the fits of meshes and loops, and the guesses to review."""
    assumed = Hand(urdf.text, guessed.text, (urdf.name, "hand.toml"), urdf.assumptions).assumptions
    if as_json:
        meshes = {name: _fit_table(fit) for name, fit in urdf.fits.items()}
        loops = {name: asdict(fit) for name, fit in urdf.loops.items()}
        review = list(guessed.review)
        done = {"hand": guessed.name, "out": str(files[-1]), "assumptions": list(assumed), "review": review}
        print_json({**done, "meshes": meshes, "loops": loops})
        return
    console.print(f"wrote {' and '.join(map(str, files))}")
    _print_assumptions(assumed)
    _print_fits(urdf.fits)
    for name, fit in urdf.loops.items():
        typer.echo(
            f"{name}: follows {fit.leader} with ratio {fit.ratio:.3f} in place of a closed loop, which opens by at "
            f"most {1e3 * fit.gap:.1f} mm"
        )
    typer.echo("Review these guesses:")
    for item in guessed.review:
        typer.echo(f"- {item}")
