"""Check the files of your hand, or make them from a URDF or MJCF file."""

import sys
from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Annotated, Any, NoReturn

import typer
from rich.console import Console
from rich.table import Table

from graspbox._common.entry_points import load_entry_point
from graspbox._common.files import check_output, write_text
from graspbox.cli.common import Json, Seed, check_files, console, print_json, print_table
from graspbox.errors import ConfigError, FileError, GraspboxError, HandError
from graspbox.hand_tools import Finding, GuessedHand, HandReport, check_hand
from graspbox.hand_tools.checking import unit_findings
from graspbox.hand_tools.guessing import Guess, begin_guess, guess_converted
from graspbox.hand_tools.searching import Budget, SearchedHand, search_hand, was_interrupted
from graspbox.hands import FittedUrdf, Hand, MeshFit, load_hand, urdf_of_mjcf
from graspbox.hands.loading import hand_like, load_fitted

__all__ = ["hand_app"]

hand_app = typer.Typer(no_args_is_help=True, help=__doc__)

_STYLES = {"error": "bold red", "warning": "yellow", "note": "dim"}


def _refuse(error: GraspboxError, hints: Sequence[Finding] = ()) -> NoReturn:
    """Print why files describe no hand, and end with the status of a wrong call."""
    console.print(f"graspbox: {error}", soft_wrap=True)
    for hint in (hint for hint in hints if hint.severity != "note"):
        console.print(f"{hint.subject}: {hint.value}: {hint.message}; {hint.remedy}", soft_wrap=True)
    raise typer.Exit(2)


def _load(words: list[str]) -> tuple[Hand, Mapping[str, MeshFit]]:
    """Load the hand that the arguments name: a name, one word with both files, or both files, with its fits."""
    if len(words) > 2:
        raise ConfigError(f"{len(words)} arguments; give the name of a hand, or its URDF and its hand.toml")
    named = (words[0], words[1]) if len(words) == 2 else hand_like(words[0])
    try:
        if isinstance(named, str) or not all(Path(file).is_file() for file in named):
            return load_hand(named), {}
        hand, fitted = load_fitted(Path(named[0]), Path(named[1]))
        return hand, fitted.fits
    except HandError as error:
        _refuse(error, unit_findings(words[0].partition(",")[0]))
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
    loaded, fits = _load(hand)
    with console.status("checking"):
        report = check_hand(loaded, trials=trials, seed=seed)
    if as_json:
        meshes = {name: _fit_table(fit) for name, fit in fits.items()}
        print_json({**report.table(), "assumptions": list(loaded.assumptions), "meshes": meshes})
    else:
        _print_assumptions(loaded.assumptions)
        _print_fits(fits)
        _print_report(report)
    if picture is not None:
        _save_picture(picture, loaded)
    if report.has_errors:
        raise typer.Exit(1)


@hand_app.command("new")
def new(
    urdf: Annotated[Path, typer.Argument(help="The URDF, xacro or MJCF file.")],
    out: Annotated[Path, typer.Option(help="Write this file.")] = Path("hand.toml"),
    name: Annotated[str | None, typer.Option(help="Name of the hand; that of the URDF's file by default.")] = None,
    base: Annotated[
        str | None, typer.Option(metavar="LINK", help="Palm of the hand; by default where chains of joints branch.")
    ] = None,
    search: Annotated[
        str | None,
        typer.Option(
            metavar="BUDGET",
            help="Search by simulated grasps how the hand opens, what closes and where it grasps: a time (10min, by "
            "the clock), or a number of grasps (5000: the same file again). Ctrl-C keeps the best so far; the same "
            "command resumes (extra search).",
        ),
    ] = None,
    picture: Annotated[
        Path | None, typer.Option(help="Write a picture of the hand open, half closed and closed into this file.")
    ] = None,
    seed: Seed = 0,
    force: Annotated[bool, typer.Option("--force", help="Replace an existing file.")] = False,
    as_json: Json = False,
) -> None:
    """Begin a hand.toml for a URDF: a servo for each joint, pads and grasp frame are guessed, and the file loads.

    A xacro is expanded (extra urdf), an MJCF file converted (extra mjcf) each time that the hand is loaded. The file
    begins with a list of guesses to review. An arm or a wrist above the palm is left out: the URDF of the hand alone is
    then written beside, and loads with the file. Only a search has random numbers.
    """
    check_files(None, picture)
    budget = None if search is None else Budget.of(search)
    journal = out.with_suffix(".search.jsonl")
    # A search that was interrupted goes on, and replaces its own files.
    replaces = force or (budget is not None and was_interrupted(journal))
    _check_new(out, replaces)
    alone = _urdf_beside(urdf, out)
    try:
        guess = begin_guess(urdf, name, base=base, leaves_out=lambda: _check_new(alone, replaces))
    except (HandError, FileError) as error:
        _refuse(error, unit_findings(urdf))
    searched = None if budget is None else _search(guess, budget, journal, seed)
    guessed = guess.write() if searched is None else searched.guessed
    if guessed.urdf is not None:
        write_text(alone, guessed.urdf)
    write_text(out, guessed.text)
    fitted = guessed.fitted
    if guessed.urdf is not None and fitted.name != str(urdf):  # no lines of the user's own
        fitted = replace(fitted, text=guessed.urdf, name=str(alone))
    _print_guessed(guessed, fitted, out, None if guessed.urdf is None else alone, as_json, searched)
    if picture is not None:
        _save_picture(picture, Hand(guessed.fitted.text, guessed.text))


def _search(guess: Guess, budget: Budget, journal: Path, seed: int) -> SearchedHand:
    """Search with a line of progress on standard error."""
    with console.status("searching; Ctrl-C keeps the best so far") as status:
        shown = 0.0

        def told(trials: int, best: float) -> None:
            nonlocal shown
            status.update(f"{trials} grasps, best value {best:.2f}; Ctrl-C keeps the best so far")
            if best > shown and not console.is_terminal:
                console.print(f"{trials} grasps, best value {best:.2f}")
            shown = max(shown, best)

        return search_hand(guess, budget, journal, seed=seed, told=told)


def _print_searched(searched: SearchedHand) -> None:
    """Print what held-out objects say about a search."""
    if not searched.finished:
        console.print("interrupted: this is the best so far, not tried on held-out objects; the same command resumes")
    elif not searched.rows:
        console.print("no posture holds anything, so this is the guess; look at the picture (--picture)")
    elif not searched.better:
        console.print("the search found nothing that holds more of held-out objects, so this is the guess")
    rows = [
        (family, str(before.asked), *(f"{each.held} ({each.firm} secure)" for each in (before, after)))
        for family, before, after in searched.rows
    ]
    if rows:
        title = f"grasps of held-out objects that hold; {searched.trials} grasps in the search"
        print_table(title, ("objects", "grasps", "guess", "search"), rows)


def _save_picture(path: Path, hand: Hand) -> None:
    from graspbox import pictures

    pictures.save_hand_motion(path, hand)
    console.print(f"wrote {path}")


def _urdf_beside(urdf: Path, out: Path) -> Path:
    """Return the place of the URDF of the hand alone, beside its ``hand.toml``: none of the other two files."""
    alone = out.with_suffix(".urdf")
    taken = alone == out or (alone.exists() and urdf.exists() and alone.samefile(urdf))
    return out.with_name(f"{out.stem}_hand.urdf") if taken else alone


@hand_app.command("convert")
def convert(
    mjcf: Annotated[Path, typer.Argument(help="The MJCF file.")],
    out: Annotated[Path, typer.Option(help="Folder of the new hand.urdf and hand.toml.")] = Path("hand"),
    name: Annotated[str | None, typer.Option(help="Name of the hand; that of the file by default.")] = None,
    base: Annotated[
        str | None,
        typer.Option(
            help="The body that becomes the root link, such as the palm of a hand on an arm; all that is not "
            "below it is left out."
        ),
    ] = None,
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
            converted = urdf_of_mjcf(mjcf, base)
            guessed = guess_converted(mjcf, converted, urdf.name, name or mjcf.stem, base)
    except (HandError, FileError) as error:
        _refuse(error)
    write_text(urdf, guessed.fitted.text)
    write_text(toml, guessed.text)
    _print_guessed(guessed, replace(guessed.fitted, name=str(urdf)), toml, urdf, as_json)


@hand_app.command(
    "train", context_settings={"allow_extra_args": True, "ignore_unknown_options": True}, add_help_option=False
)
def train(context: typer.Context) -> None:
    """Make a policy for a hand from its file: search, check, trials and training, in one folder (extra train)."""
    trainings: typer.Typer = load_entry_point("graspbox.commands", "train", "command", "graspbox --help lists all")
    words = ["hand", *context.args]
    raise typer.Exit(typer.main.get_command(trainings).main(words, "graspbox train", standalone_mode=False) or 0)


def _check_new(path: Path, force: bool) -> None:
    """Refuse to replace a file, and a place where none can be written."""
    if path.exists() and not force:
        raise ConfigError(f"{str(path)!r} exists; give --force to replace it, or another --out")
    check_output(path)


def _print_guessed(
    guessed: GuessedHand,
    urdf: FittedUrdf,
    out: Path,
    beside: Path | None,
    as_json: bool,
    searched: SearchedHand | None = None,
) -> None:
    """Print the new files, what was assumed, fits, the result of a search, and the guesses to review."""
    assumed = Hand(urdf.text, guessed.text, (urdf.name, "hand.toml"), urdf.assumptions).assumptions
    if as_json:
        meshes = {name: _fit_table(fit) for name, fit in urdf.fits.items()}
        loops = {name: asdict(fit) for name, fit in urdf.loops.items()}
        review = list(guessed.review)
        done: dict[str, Any] = {
            "hand": guessed.name,
            "out": str(out),
            "urdf": None if beside is None else str(beside),
            "assumptions": list(assumed),
            "review": review,
        }
        done |= {"meshes": meshes, "loops": loops}
        print_json(done if searched is None else {**done, "search": searched.table()})
        return
    console.print(f"wrote {out}" if beside is None else f"wrote {beside} and {out}")
    _print_assumptions(assumed)
    _print_fits(urdf.fits)
    for name, fit in urdf.loops.items():
        typer.echo(
            f"{name}: follows {fit.leader} with ratio {fit.ratio:.3f} in place of a closed loop, which opens by at "
            f"most {1e3 * fit.gap:.1f} mm"
        )
    if searched is not None:
        _print_searched(searched)
    typer.echo("Review these guesses:")
    for item in guessed.review:
        typer.echo(f"- {item}")
