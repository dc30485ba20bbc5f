"""``graspbox prepare``: fill the cache before it is needed."""

from typing import Annotated

import typer

from graspbox._common.refusals import reason
from graspbox.cli.common import Json, Mass, Scale, Split, Threads, end_with, find, print_json, progress
from graspbox.configs import PhysicsConfig
from graspbox.envs._pools.preparation import load_objects, prepare_objects


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
