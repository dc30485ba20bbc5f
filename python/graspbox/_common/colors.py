"""Colours of all pictures, recordings and views, which readers with any colour vision can distinguish."""

#: Of the object that a picture is about, and of each object in pictures of several.
OBJECT = "#d8b78c"
OBJECTS = ("#e2b77d", "#8fb3d9", "#a9c08f", "#d9a3a0", "#b9a9d4", "#c9c4b8")
#: Of objects beside the one that a picture is about, of walls, and of the table.
NEIGHBOUR, WALL, TABLE = "#c6c9ce", "#b9bcc2", "#e2dacb"
SUCCESS, FAILURE, NOT_SIMULATED = "#009e73", "#d55e00", "#444444"
#: Okabe and Ito's colours; the first ones contrast most with `OBJECT`.
COLORS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#56b4e9", "#e69f00", "#000000", "#8c6d1f")


def rgb(color: str) -> tuple[int, int, int]:
    """Return a colour ``#rrggbb`` as three numbers from 0 to 255."""
    red, green, blue = bytes.fromhex(color.removeprefix("#"))
    return red, green, blue
