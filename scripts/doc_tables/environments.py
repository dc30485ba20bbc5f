"""Tables of environments, from the core's tables."""

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import partial

import graspbox
from graspbox.arms import load_arm
from graspbox.configs import CamerasConfig
from graspbox.envs import spaces
from graspbox.envs.settings import GraspConfig

TABLES = spaces.tables(graspbox.load_hand())
#: Those of a gripper on an arm.
ON_ARM = spaces.tables(graspbox.load_hand("panda_gripper"), load_arm("fr3"))
#: Those of the tables of vectors, in which the last action is as long as an action.
DEFAULT_FINGERS = GraspConfig.fingers


def markdown(titles: str, rows: Iterable[Sequence[str]]) -> str:
    """Write a table as Markdown; its titles are words."""
    names = titles.split()
    lines = [f"| {' | '.join(cells)} |" for cells in (names, *rows)]
    return "\n".join([lines[0], "|" + "---|" * len(names), *lines[1:]])


def number(value: float) -> str:
    """Write a bound."""
    parts = {"pi": 1, "pi/2": 2, "pi/4": 4}
    known = {round(math.pi / part, 6): name for name, part in parts.items()}
    known |= {-value: f"-{name}" for value, name in known.items()}
    return known.get(round(value, 6), f"{value:g}")


def placed(columns: Sequence[spaces.ArrayColumn]) -> Iterator[tuple[str, spaces.ArrayColumn]]:
    """Return the columns of a vector with their indices."""
    first = 0
    for column in columns:
        last = first + column["size"] - 1
        yield str(first) if last == first else f"{first}-{last}", column
        first = last + 1


def described(row: spaces.ArrayColumn) -> tuple[str, ...]:
    """Return the bounds, the unit and the meaning of a column."""
    return number(row["low"]), number(row["high"]), row["unit"], row["meaning"]


#: Names of the columns of an action that move the fingers.
FINGERS = ("actuator", "close", "preshape")


def action_table(control: str) -> str:
    """Actions of a control mode; in closed-loop control without the fingers."""
    columns = spaces.columns_of(control, DEFAULT_FINGERS, TABLES)[0]
    if control in TABLES["actions"]:
        columns = [row for row in columns if row["name"] not in FINGERS]
    return markdown("index name -1 1 unit meaning", [(i, row["name"], *described(row)) for i, row in placed(columns)])


def finger_table(fingers: str) -> str:
    """Entries of the fingers, which follow the n entries of the control mode."""
    columns = [row for row in TABLES["actions"]["twist"][fingers] if row["name"] in FINGERS]
    rows = [(f"n + {i}" if i != "0" else "n", row["name"], *described(row)) for i, row in placed(columns)]
    return markdown("index name -1 1 unit meaning", rows)


def vector_table(control: str) -> str:
    """Vectors of a control mode as wholes; `column_table` lists their columns."""
    rows = [
        (name, str(spaces.size(columns)), "float32", "yes" if name in TABLES["privileged"] else "no")
        for name, columns in spaces.columns_of(control, DEFAULT_FINGERS, TABLES)[1].items()
    ]
    return markdown("vector shape dtype privileged", rows)


def column_table(control: str) -> str:
    """Columns of all vectors of a control mode: the indices of each column in each vector."""
    vectors = spaces.columns_of(control, DEFAULT_FINGERS, TABLES)[1]
    columns_by_name: dict[str, dict[str, tuple[str, spaces.ArrayColumn]]] = {}
    for vector, columns in vectors.items():
        for index, column in placed(columns):
            columns_by_name.setdefault(column["name"], {})[vector] = (index, column)
    rows = [
        (
            name,
            *(places[vector][0] if vector in places else "" for vector in vectors),
            *described([*places.values()][-1][1]),
        )
        for name, places in columns_by_name.items()
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


def term_table(terms: Sequence[spaces.Term]) -> str:
    """Reward terms."""
    rows = [(t["name"], number(t["low"]), number(t["high"]), t["meaning"]) for t in terms]
    return markdown("term min max meaning", rows)


def entry_row(row: spaces.Entry) -> tuple[str, str, str, str]:
    """Write an entry of the info."""
    types = {"float64": "float", "int64": "int"}
    return row["name"], types.get(row["dtype"], row["dtype"]), row["unit"], row["meaning"]


def target_table() -> str:
    """Further info with one target among several objects."""
    return markdown("entry type unit meaning", [entry_row(row) for row in TABLES["target_info"]])


def info_table(entries: Sequence[spaces.Entry]) -> str:
    """Info; the entry added by Python comes last."""
    added = ("reward_terms", "dict", "", "reward terms of the last step (float) by name; zeros after a reset")
    return markdown("entry type unit meaning", [*map(entry_row, entries), added])


def further_table(control: str) -> str:
    """Info of a control mode, without the entries of closed-loop control."""
    known = [row["name"] for row in spaces.entries("twist", TABLES)]
    further = [row for row in spaces.entries(control, TABLES) if row["name"] not in known]
    return markdown("entry type unit meaning", [entry_row(row) for row in further])


def joint_table() -> str:
    """Actions of the joints of an arm."""
    columns = [row for row in ON_ARM["actions"]["joint_velocity"][DEFAULT_FINGERS] if row["name"] == "joint"]
    return markdown("index name -1 1 unit meaning", [(i, row["name"], *described(row)) for i, row in placed(columns)])


def arm_columns() -> str:
    """Columns that an arm adds, in vectors of the hand that it carries."""
    vectors = ON_ARM["observations"]["twist"][DEFAULT_FINGERS]
    rows = [(i, row["name"], *described(row)) for i, row in placed(vectors["state"]) if row["name"].startswith("arm_")]
    return markdown("index column min max unit meaning", rows)


def arm_info() -> str:
    """Info that an arm adds."""
    known = [row["name"] for row in TABLES["info"]]
    return markdown("entry type unit meaning", [entry_row(row) for row in ON_ARM["info"] if row["name"] not in known])


def tables() -> dict[str, Callable[[], str]]:
    """Return the functions that write the tables, by name."""
    writers: dict[str, Callable[[], str]] = {
        "images": image_table,
        "info of Grasp-v0": partial(info_table, spaces.entries("twist", TABLES)),
        "info of goal tasks": partial(info_table, TABLES["goal"]["info"]),
        "reward of goal tasks": partial(term_table, TABLES["goal"]["terms"]),
        "further info with a target": target_table,
        "action of joint_velocity": joint_table,
        "further columns on an arm": arm_columns,
        "further info on an arm": arm_info,
        "further info of GraspPose-v0": partial(further_table, "grasp_pose"),
        "further info of Clear-v0": partial(further_table, "clear"),
    }
    for env, control in (("Grasp-v0", "twist"), ("GraspPose-v0", "grasp_pose")):
        writers[f"vectors of {env}"] = partial(vector_table, control)
        writers[f"columns of {env}"] = partial(column_table, control)
        writers[f"reward of {env}"] = partial(term_table, spaces.terms(control, TABLES))
    writers |= {f"fingers of {one}": partial(finger_table, one) for one in TABLES["actions"]["twist"]}
    modes = (*TABLES["actions"], "grasp_pose", "grasp_point")
    return writers | {f"action of {one}": partial(action_table, one) for one in modes}
