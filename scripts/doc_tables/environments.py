"""Tables of environments, from the core's tables."""

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import partial

import graspbox
from graspbox.configs import CamerasConfig
from graspbox.envs import spaces

FOUND = spaces.tables(graspbox.load_hand())


def markdown(titles: str, rows: Iterable[Sequence[str]]) -> str:
    """Write a table as Markdown; its titles are words."""
    names = titles.split()
    lines = [f"| {' | '.join(cells)} |" for cells in (names, *rows)]
    return "\n".join([lines[0], "|" + "---|" * len(names), *lines[1:]])


def number(value: float) -> str:
    """Write a bound."""
    known = {round(math.pi, 6): "pi", round(math.pi / 2, 6): "pi/2"}
    return known.get(round(value, 6), f"{value:g}")


def placed(columns: Sequence[spaces.Column]) -> Iterator[tuple[str, spaces.Column]]:
    """Give the columns of a vector with their indices."""
    first = 0
    for column in columns:
        last = first + column["size"] - 1
        yield str(first) if last == first else f"{first}-{last}", column
        first = last + 1


def described(row: spaces.Column) -> tuple[str, ...]:
    """Give the bounds, the unit and the meaning of a column."""
    return number(row["low"]), number(row["high"]), row["unit"], row["meaning"]


def action_table(control: str) -> str:
    """Actions of a control mode."""
    columns = spaces.columns_of(control, FOUND)[0]
    return markdown("index name -1 1 unit meaning", [(i, row["name"], *described(row)) for i, row in placed(columns)])


def vector_table(control: str) -> str:
    """Vectors of a control mode as wholes; `column_table` lists their columns."""
    rows = [
        (name, str(spaces.size(columns)), "float32", "yes" if name in FOUND["privileged"] else "no")
        for name, columns in spaces.columns_of(control, FOUND)[1].items()
    ]
    return markdown("vector shape dtype privileged", rows)


def column_table(control: str) -> str:
    """Columns of all vectors of a control mode: the indices of each column in each vector."""
    vectors = spaces.columns_of(control, FOUND)[1]
    found: dict[str, dict[str, tuple[str, spaces.Column]]] = {}
    for vector, columns in vectors.items():
        for index, column in placed(columns):
            found.setdefault(column["name"], {})[vector] = (index, column)
    rows = [
        (
            name,
            *(places[vector][0] if vector in places else "" for vector in vectors),
            *described([*places.values()][-1][1]),
        )
        for name, places in found.items()
    ]
    return markdown(f"column {' '.join(vectors)} min max unit meaning", rows)


def image_table() -> str:
    """Images of the default cameras; a single bound applies to all channels."""
    rows = []
    for row in spaces.images(graspbox.load_hand(), CamerasConfig(images=spaces.IMAGES)):
        low, high = (", ".join(f"{bound:.3g}" for bound in row[key]) for key in ("low", "high"))
        shape, cameras = " x ".join(map(str, row["shape"])), ", ".join(row["cameras"])
        privileged = "yes" if row["privileged"] else "no"
        bounds = (row["name"], shape, row["dtype"], low, high, cameras)
        rows.append((*bounds, row["frame"], row["unit"], row["missing"], privileged, row["meaning"]))
    return markdown("image shape dtype min max camera frame unit missing privileged meaning", rows)


def term_table(control: str) -> str:
    """Reward terms of a control mode."""
    rows = [(t["name"], number(t["low"]), number(t["high"]), t["meaning"]) for t in spaces.terms(control, FOUND)]
    return markdown("term min max meaning", rows)


def entry_row(row: spaces.Entry) -> tuple[str, str, str, str]:
    """Write an entry of the info."""
    types = {"float64": "float", "int64": "int"}
    return row["name"], types.get(row["dtype"], row["dtype"]), row["unit"], row["meaning"]


def target_table() -> str:
    """Further info with one target among several objects."""
    return markdown("entry type unit meaning", [entry_row(row) for row in FOUND["target_info"]])


def info_table(control: str, beside: str | None = None) -> str:
    """Info of a control mode, without the entries of `beside`; the entry added by Python comes last."""
    known = [] if beside is None else [row["name"] for row in spaces.entries(beside, FOUND)]
    rows = [entry_row(row) for row in spaces.entries(control, FOUND) if row["name"] not in known]
    added = ("reward_terms", "dict", "", "reward terms of the last step (float) by name; zeros after a reset")
    return markdown("entry type unit meaning", rows if beside else [*rows, added])


def tables() -> dict[str, Callable[[], str]]:
    """Return the functions that write the tables, by name."""
    found: dict[str, Callable[[], str]] = {
        "images": image_table,
        "info of Grasp-v0": partial(info_table, "twist"),
        "further info with a target": target_table,
        "further info of GraspPose-v0": partial(info_table, "grasp_pose", "twist"),
        "further info of Clear-v0": partial(info_table, "clear", "twist"),
        # Its columns and rewards are those of GraspPose-v0.
        "vectors of Clear-v0": partial(vector_table, "clear"),
    }
    for env, control in (("Grasp-v0", "twist"), ("GraspPose-v0", "grasp_pose")):
        found[f"vectors of {env}"] = partial(vector_table, control)
        found[f"columns of {env}"] = partial(column_table, control)
        found[f"reward of {env}"] = partial(term_table, control)
    return found | {
        f"action of {one}": partial(action_table, one) for one in (*FOUND["actions"], "grasp_pose", "clear")
    }
