"""``graspbox objects`` and ``graspbox prepare``: the contents of a set, and its cache filled in advance."""

from typing import Annotated

import typer

from graspbox._common.refusals import reason
from graspbox.cli.common import (
    Json,
    Mass,
    Scale,
    Split,
    Threads,
    end_with,
    find,
    print_json,
    print_table,
    progress,
)
from graspbox.configs import PhysicsConfig
from graspbox.envs._pools.preparation import load_objects, prepare_objects


def objects(
    sets: Annotated[list[str] | None, typer.Argument(help="Object sets; 'procedural' by default.")] = None,
    split: Split = None,
    scale: Scale = 1.0,
    as_json: Json = False,
) -> None:
    """List the objects of a set, with their masses and splits.

    Nothing is random here, so there is no --seed.
    """
    found = find(sets, split, scale)
    if as_json:
        keys = ("name", "split", "mass", "mass_known")
        print_json([{key: getattr(spec, key) for key in keys} for spec in found])
        return
    rows: list[tuple[str, ...]] = [
        (s.name, s.split, "" if s.mass is None else f"{s.mass:.4f}", s.mass_known) for s in found
    ]
    print_table(f"{found.name}: {len(found)} objects", ("name", "split", "mass / kg", "mass known"), rows)


def prepare(
    sets: Annotated[list[str] | None, typer.Argument(help="Object sets; 'procedural' by default.")] = None,
    split: Split = None,
    scale: Scale = 1.0,
    mass: Mass = None,
    threads: Threads = None,
    as_json: Json = False,
) -> None:
    """Prepare the objects of a set: other processes then find their convex parts in the cache (GRASPBOX_CACHE).

    Nothing is random here, so there is no --seed. The exit status is 1 if some objects cannot be used.
    """
    found = find(sets, split, scale, mass)
    handle, _ = load_objects(found, "reflex", PhysicsConfig())
    with progress() as bar:
        task = bar.add_task(found.name, total=len(found))
        errors = prepare_objects(
            handle, False, threads, lambda done: bar.update(task, completed=done), skip_errors=True
        )
    refused = {found[index].name: reason(error, found[index].path) for index, error in errors.items()}
    prepared = [name for name in found.names if name not in refused]
    if as_json:
        print_json({"set": found.name, "prepared": prepared, "refused": refused})
    else:
        typer.echo(f"{len(prepared)} of {len(found)} objects of {found.name} are prepared")
    end_with(refused)
