"""``graspbox prepare``: fill the cache before it is needed."""

from typing import Annotated

import typer

from graspbox.cli.common import Json, Scale, Split, Threads, find, print_json, progress
from graspbox.configs import PhysicsConfig
from graspbox.envs.preparation import load_objects, prepare_objects


def prepare(
    sets: Annotated[list[str] | None, typer.Argument(help="Object sets; 'procedural' by default.")] = None,
    split: Split = None,
    scale: Scale = 1.0,
    threads: Threads = None,
    as_json: Json = False,
) -> None:
    """Prepare the objects of a set: other processes then find their convex parts in the cache (GRASPBOX_CACHE).

    Nothing is random here, so there is no --seed.
    """
    found = find(sets or ["procedural"], split, scale)
    handle, _ = load_objects(found, "reflex", PhysicsConfig())
    with progress() as bar:
        task = bar.add_task(found.name, total=len(found))
        prepare_objects(handle, False, threads, lambda done: bar.update(task, completed=done))
    if as_json:
        print_json({"set": found.name, "prepared": list(found.names)})
    else:
        typer.echo(f"{len(found)} objects of {found.name} are prepared")
