"""The page of a report: one HTML file that loads nothing, with data, style and programs in it.

A content security policy in the page allows only the page's own programs, by their hashes, and no connection.
"""

import base64
import hashlib
import html
import json
from collections.abc import Mapping
from importlib import resources
from string import Template
from typing import Any

from graspbox.tools.reports.charts import bundle

#: Draws the charts, after the program of Vega.
_START = "start();"


def page(title: str, data: Mapping[str, Any]) -> str:
    """Assemble the page; `data` is the content for ``page.js``."""
    scripts = {"program": _file("page.js"), "bundle": bundle().replace("</script", "<\\/script"), "start": _START}
    hashes = " ".join(f"'{_hash(script)}'" for script in scripts.values())
    # In a script, text ends at the next tag of a script or a comment, even within a string of JSON.
    text = json.dumps(data, allow_nan=False, separators=(",", ":")).replace("<", "\\u003c")
    fields = {"title": html.escape(title), "style": _file("page.css"), "data": text, "hashes": hashes, **scripts}
    return Template(_file("page.html")).substitute(fields)


def _file(name: str) -> str:
    return resources.files("graspbox.tools.reports").joinpath(name).read_text(encoding="utf-8")


def _hash(script: str) -> str:
    return "sha256-" + base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
