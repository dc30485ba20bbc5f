"""``graspbox export-grasps``: grasps in the formats of other programs."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer

from graspbox import object_sets
from graspbox._common.files import check_output
from graspbox._common.refusals import is_refusal, reason
from graspbox.cli.common import (
    Json,
    Mass,
    Scale,
    Threads,
    console,
    end_with,
    find,
    find_hand,
    print_json,
    print_table,
    progress,
)
from graspbox.errors import ConfigError, GraspboxError
from graspbox.object_sets import ObjectSpec
from graspbox.tools import exchange
from graspbox.tools.exchange.formats import row_of, rows_named
from graspbox.tools.exchange.grasps import beyond_by_unit
from graspbox.tools.exchange.sources import ObjectSource, read_with_sources

_FORMATS = ", ".join(dict.fromkeys(row.name for row in exchange.FORMATS))


def _specs(
    sources: dict[str, ObjectSource], objects: list[str] | None, scale: float, mass: float | None
) -> dict[str, ObjectSpec]:
    """Find the objects: those that the command line names, else those that a plan, a table or a data set names."""
    if objects:
        return {spec.name: spec for spec in find(objects, None, scale, mass)}
    specs = {}
    for name, source in sources.items():
        try:
            found = object_sets.load([source.objects], scale=source.scale, mass=source.mass)
        except GraspboxError as error:
            console.print(f"{name}: {error}; its grasps are written without its mesh, which --objects can name")
            continue
        specs[name] = found[0]
    return specs


def _chosen(grasps: Sequence[exchange.ExchangeGrasps], only: list[str] | None) -> list[exchange.ExchangeGrasps]:
    names = [one.object_name for one in grasps]
    if unknown := [name for name in only or () if name not in names]:
        raise ConfigError(f"there are no grasps of {unknown[0]!r}; choose from {', '.join(names[:20])}")
    return [one for one in grasps if not only or one.object_name in only]


@dataclass(frozen=True)
class _Options:
    """Options of the command line; the format, and the folder of the files."""

    row: exchange.Format
    folder: Path
    successful: bool
    count: int | None
    threshold: float | None
    joints: bool
    meshes: bool
    threads: int | None
    #: Whether the command line names the objects.
    named: bool
    #: Kilograms of the only object, if the command line names them.
    mass: float | None


def _prepare(grasps: exchange.ExchangeGrasps, spec: ObjectSpec | None, options: _Options) -> exchange.ExchangeGrasps:
    """Simulate unknown values that the format and the options need, and select rows."""
    if options.row.single and (spec is None or not options.joints):
        raise ConfigError(
            f"{options.row.name} stores joint positions, which are simulated; name the object {grasps.object_name!r} "
            "with --objects, and leave --no-joints out"
        )
    if not options.successful:
        grasps = grasps[: options.count]
    if options.threshold is not None:
        grasps = grasps.labeled(options.threshold)
    unknown = bool(np.isnan(grasps.success).any()) and (options.row.outcomes or options.successful)
    if spec is None and unknown and options.successful:
        raise ConfigError(
            f"the outcomes of the grasps of {grasps.object_name!r} are not known; name the object with --objects, so "
            "that they are simulated"
        )
    if spec is not None and options.mass is not None:
        spec = replace(spec, mass=options.mass, mass_known="given")
    mesh = None if spec is None else spec.load()
    known = options.mass if mesh is None else mesh.mass
    if known is not None:
        grasps = replace(grasps, mass=known)
    if mesh is not None and unknown:
        grasps = exchange.simulated(grasps, mesh, joints=False, num_threads=options.threads)
    if options.successful:
        grasps = grasps[grasps.success >= 0.5][: options.count]
    if mesh is None or not len(grasps):
        return grasps
    if options.row.joints and options.joints:
        grasps = exchange.simulated(grasps, mesh)
    if options.row.single:
        grasps = grasps[grasps.closed]
    return exchange.with_mesh(grasps, mesh, options.folder) if options.meshes else grasps


def _prepare_all(
    grasps: Sequence[exchange.ExchangeGrasps], specs: dict[str, ObjectSpec], options: _Options
) -> tuple[list[exchange.ExchangeGrasps], dict[str, str]]:
    """Prepare all objects; those that cannot be used, or have no grasp left, are named with the reason."""
    if lacking := [one.object_name for one in grasps if options.named and one.object_name not in specs]:
        known = ", ".join(list(specs)[:10])
        raise ConfigError(
            f"--objects has no object {lacking[0]!r}; it has {known}: name the set of the grasps' objects"
        )
    ready, refused = [], {}
    with progress() as bar:
        task = bar.add_task("objects", total=len(grasps))
        for one in grasps:
            spec = specs.get(one.object_name)
            try:
                made = _prepare(one, spec, options)
                if len(made):
                    ready.append(made)
                else:
                    refused[one.object_name] = "no grasp is left to write"
            except GraspboxError as error:
                if not is_refusal(error):
                    raise
                refused[one.object_name] = reason(error, None if spec is None else spec.path)
            bar.advance(task)
    return ready, refused


def _print_limited(ready: Sequence[exchange.ExchangeGrasps], options: _Options) -> None:
    """Say that joint positions are written within their limits, if that changes them."""
    beyond: dict[str, float] = {}
    for unit, most in (row for one in ready for row in beyond_by_unit(one).items()):
        beyond[unit] = max(beyond.get(unit, 0.0), most)
    written = " and ".join(f"{most:.2g} {unit}" for unit, most in sorted(beyond.items()) if most > 1e-6)
    if options.row.joints and written:
        console.print(
            f"joint positions are up to {written} beyond their limits, where the stops yield; {options.row.name} "
            "has them at the limits"
        )


def _table(
    ready: Sequence[exchange.ExchangeGrasps], to: str, files: list[Path], refused: dict[str, str]
) -> dict[str, Any]:
    rows = [
        {
            "name": one.object_name,
            "hand": one.hand.name,
            "grasps": len(one),
            "succeeded": None if np.isnan(one.success).any() else int(one.success.sum()),
            "with_joints": int(one.closed.sum()),
            "mesh_file": one.mesh_file,
        }
        for one in ready
    ]
    return {"format": to, "objects": rows, "files": [str(path) for path in files], "refused": refused}


Source = Annotated[
    Path,
    typer.Argument(metavar="FILE", help="A plan, the JSON of `grasp` or `grasp-image`, or the folder of a data set."),
]
Out = Annotated[Path, typer.Option(help="The file, with the suffix of the format; without one, a folder for all.")]
Objects = Annotated[
    list[str] | None,
    typer.Option(
        help="Object set with the objects of the grasps; may be repeated. Without it they are where the plan, the "
        "table or the data set found them."
    ),
]
Only = Annotated[list[str] | None, typer.Option(help="Only the object of this name; may be repeated.")]
Successful = Annotated[bool, typer.Option("--successful", help="Only grasps that succeed.")]
Count = Annotated[int | None, typer.Option(min=1, help="Most grasps per object, best first.")]
Threshold = Annotated[
    float | None,
    typer.Option(
        min=0.0,
        max=1.0,
        help="Count grasps of an image as successes from this predicted probability on, where outcomes are stored.",
    ),
]
Joints = Annotated[
    bool, typer.Option(help="Simulate joint positions, where the format has them and the object is known.")
]
Meshes = Annotated[
    bool, typer.Option(help="Write the meshes of known objects as .obj into the folder meshes next to the file.")
]
Frame = Annotated[str, typer.Option(help="Frame of the grasps of an image: table or camera.")]
OtherHand = Annotated[
    str | None, typer.Option(help="The hand's two files with a comma between, if it is not one of the package.")
]


def export_grasps(
    source: Source,
    to: Annotated[str, typer.Option(help=f"Format: {_FORMATS}.")],
    out: Out,
    objects: Objects = None,
    only: Only = None,
    successful: Successful = False,
    count: Count = None,
    threshold: Threshold = None,
    joints: Joints = True,
    meshes: Meshes = True,
    frame: Frame = "table",
    hand: OtherHand = None,
    scale: Scale = 1.0,
    mass: Mass = None,
    threads: Threads = None,
    as_json: Json = False,
) -> None:
    """Write grasps in a format of other programs: ACRONYM, GraspGen, Isaac Grasp or DexGraspBench.

    Poses are converted to the frame of the hand that the format expects. The exit status is 1 if some objects have no
    grasp to write.
    """
    if scale != 1.0 and not objects:
        raise typer.BadParameter("it is that of --objects; results carry the scale of their own", param_hint="--scale")
    row = row_of(out, to)
    if row is not None:
        check_output(out)
    found_hand = None if hand is None else find_hand(hand)
    found, sources = read_with_sources(source, hand=found_hand, frame=frame)  # type: ignore[arg-type]
    grasps = _chosen(found, only)
    if row is not None and len(grasps) > 1:
        raise ConfigError(
            f"{str(source)!r} has grasps of {len(grasps)} objects, and {str(out)!r} holds one; choose it with --only, "
            "or name a folder (a path without suffix)"
        )
    folder = out if row is None else out.parent
    form, named = row or rows_named(to)[0], bool(objects)
    options = _Options(form, folder, successful, count, threshold, joints, meshes, threads, named, mass)
    own = {one.object_name: sources[one.object_name] for one in grasps if one.object_name in sources}
    if mass is not None and len(grasps) != 1:
        raise ConfigError(
            f"--mass is the mass of one object, and there are grasps of {len(grasps)}; choose it with --only"
        )
    ready, refused = _prepare_all(grasps, _specs(own, objects, scale, mass), options)
    _print_limited(ready, options)
    files: list[Path] = []
    if row is None:
        files = exchange.save_each(ready, out, to) if ready else []
    elif ready:
        exchange.save(ready[0], out, to)
        files = [out]
    table = _table(ready, to, files, refused)
    if as_json:
        print_json(table)
    else:
        keys = ("name", "grasps", "succeeded", "with_joints")
        rows = [tuple("-" if line[key] is None else str(line[key]) for key in keys) for line in table["objects"]]
        print_table(f"{to}: {len(files)} files in {folder}", ("object", *keys[1:3], "with joints"), rows)
    end_with(refused)
