"""Tables of the page of published policies: the scores of each card."""

import re
from collections.abc import Callable
from functools import partial
from pathlib import Path

POLICIES = Path(__file__).parents[2] / "policies"


def scores(name: str) -> str:
    """Return the first table of a card's section Scores; only the success keeps its interval."""
    card = (POLICIES / name / "README.md").read_text()
    section = card.partition("\n## Scores\n")[2].partition("\n## ")[0]
    table = section.partition("\n| ")[2].partition("\n\n")[0]
    if not table:
        raise SystemExit(f"policies/{name}/README.md has no table of scores")
    head, rule, *rows = f"| {table.rstrip()}".splitlines()
    kept = [
        re.sub(r"(\d%) \([^)]*\)", r"\1", cell) if title.strip().startswith("secure") else cell
        for row in rows
        for title, cell in zip(head.split("|"), row.split("|"), strict=True)
    ]
    size = head.count("|") + 1
    lines = ["|".join(kept[first : first + size]) for first in range(0, len(kept), size)]
    return "\n".join([head, rule.replace(" ", ""), *lines])


def tables() -> dict[str, Callable[[], str]]:
    """Return the functions that write the table of every published policy, by the names of their markers."""
    names = sorted(card.parent.name for card in POLICIES.glob("*/README.md"))
    return {f"scores of {name}": partial(scores, name) for name in names}
