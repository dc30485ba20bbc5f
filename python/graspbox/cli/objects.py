"""``graspbox objects``: what a set holds."""

from typing import Annotated

import typer

from graspbox.cli.common import Json, Scale, Split, find, print_json, print_table


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
