"""Tables in the panel."""

import html
from collections.abc import Sequence
from typing import Any

__all__ = ["html_table", "shown"]

_STYLE = "width:100%;border-collapse:collapse;font-size:0.72em"
_CELL = "padding:1px 4px;text-align:left;white-space:nowrap"


def shown(value: Any) -> str:
    """Format a value for a cell."""
    if value is None:
        return "-"
    if isinstance(value, bool):
        return "yes" if value else "no"
    return f"{value:.4g}" if isinstance(value, float) else str(value)


def html_table(columns: Sequence[str], rows: Sequence[Sequence[Any]], marked: int | None = None) -> str:
    """Write a table as HTML; the row `marked` is bold. All text is escaped."""
    head = "".join(f'<th style="{_CELL}">{html.escape(name)}</th>' for name in columns)
    lines = []
    for index, row in enumerate(rows):
        bold = ' style="font-weight:bold"' if index == marked else ""
        cells = "".join(f'<td style="{_CELL}">{html.escape(shown(value))}</td>' for value in row)
        lines.append(f"<tr{bold}>{cells}</tr>")
    body = "".join(lines)
    return f'<div style="overflow-x:auto"><table style="{_STYLE}"><tr>{head}</tr>{body}</table></div>'
