"""Elements of XML files (MJCF and URDF), with numbers that are read back bit for bit."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Iterable

import numpy as np
from numpy.typing import ArrayLike

__all__ = ["add", "number_text"]


def number_text(values: Iterable[float]) -> str:
    """Write numbers for an XML attribute; they are read back bit for bit."""
    return " ".join(repr(float(value)).removesuffix(".0") for value in values)


def add(parent: ET.Element, tag: str, **attributes: str | ArrayLike | None) -> ET.Element:
    """Add an element with attributes: texts, numbers and arrays of numbers; None is left out."""
    texts = {
        name: value if isinstance(value, str) else number_text(np.ravel(value))
        for name, value in attributes.items()
        if value is not None
    }
    return ET.SubElement(parent, tag, texts)
