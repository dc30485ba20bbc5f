"""A first ``arm.toml`` for a URDF: base, flange and what else it does not state are guessed, and listed for review."""

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from graspbox import _core
from graspbox._core import Arm
from graspbox.errors import ArmError, HandError
from graspbox.hands.reading import read_hand

__all__ = ["ArmDraft", "draft_arm"]

#: Names of links that are frames of a flange, in the order in which they are taken.
_FLANGES = ("flange", "tool0", "link_eef", "eef", "ee_link", "tool")
#: Names of joints and links of grippers.
_GRIPPER = re.compile("grip|jaw|finger|thumb|claw", re.IGNORECASE)
#: Guessed payload, kg, and speed of joints for which the URDF states none, rad/s and m/s.
_PAYLOAD, _SPEEDS = 1.0, {"revolute": 1.0, "prismatic": 0.1}
_UNITS = {"revolute": "rad", "prismatic": "m"}
_GUESS = "guess: review it"


@dataclass(frozen=True)
class ArmDraft:
    """A first ``arm.toml``.

    Attributes
    ----------
    text : str
        The file.
    arm : Arm
        The arm of both files.
    guesses : tuple of str
        What was guessed, a sentence each.
    """

    text: str
    arm: Arm
    guesses: tuple[str, ...]


def draft_arm(urdf: Path, *, name: str | None = None, base: str | None = None, flange: str | None = None) -> ArmDraft:
    """Begin an ``arm.toml``: home is the middle of each range, the payload a guess.

    By default the base is the root of the file. The flange ends the longest chain of moving joints without a branch;
    of the links that are fixed there, one with the usual name of a flange is taken.

    Raises
    ------
    ArmError
        If the file describes no arm, or has no such link.
    """
    try:
        fitted = read_hand(urdf)
        links = _core.describe_urdf(fitted.text, fitted.name)
    except HandError as error:
        raise ArmError(str(error)) from None
    assert links is not None
    named = {link["name"]: index for index, link in enumerate(links)}
    for what, link in (("base", base), ("flange", flange)):
        if link is not None and link not in named:
            raise ArmError(f"{urdf}: there is no link {link!r} for the {what}; choose from {', '.join(named)}")
    guesses = []
    start = 0 if base is None else named[base]
    if base is None:
        guesses.append(f"base: {links[0]['name']!r}, the root of the file")
    end = _flange(links, start) if flange is None else named[flange]
    if flange is None:
        guesses.append(f"flange: {links[end]['name']!r}; its z axis must leave the face that a hand is screwed to")
    chain, at = [], end
    while at not in (start, -1):
        chain.append(links[at])
        at = links[at]["parent"]
    moving = [link for link in reversed(chain) if link["kind"] != "fixed"]
    if at == -1 or not moving:
        ends = f"{links[start]['name']!r} and {links[end]['name']!r}"
        raise ArmError(f"{urdf}: no joint moves between {ends}; name base and flange of the arm")
    guesses.append(f"payload: {_PAYLOAD:g} kg, which a URDF does not state")
    guesses.append("home: the middle of each range")
    slow = [link for link in moving if link["velocity"] <= 0]
    if slow:
        guesses.append(f"speeds of {', '.join(link['joint'] for link in slow)}, which the URDF does not state")
    own = re.sub(r"\W+", "_", name or urdf.name.split(".")[0])
    text = _text(own, links[start]["name"], links[end]["name"], moving, slow, guesses)
    return ArmDraft(text, Arm(fitted.text, text, (fitted.name, "arm.toml"), fitted.assumptions), tuple(guesses))


def _flange(links: list[dict[str, Any]], start: int) -> int:
    """Return the link that ends the chain from a link."""
    body, moving = start, True
    while moving:
        rigid = _rigid(links, body)
        next_ones = [i for i, link in enumerate(links) if link["parent"] in rigid and link["kind"] != "fixed"]
        # Behind the last joint of an arm, a gripper branches into fingers, or its one jaw moves alone.
        moving = len(next_ones) == 1 and not _is_jaw(links, next_ones[0])
        body = next_ones[0] if moving else body
    rigid = _rigid(links, body)
    for wanted in _FLANGES:
        for index in sorted(rigid):
            if wanted in links[index]["name"].lower():
                return index
    return body


def _is_jaw(links: list[dict[str, Any]], joint: int) -> bool:
    """Whether a joint is that of a gripper: no joint follows it, and it slides or has such a name."""
    rigid = _rigid(links, joint)
    if any(link["parent"] in rigid and link["kind"] != "fixed" for link in links):
        return False
    own = links[joint]
    return own["kind"] == "prismatic" or bool(_GRIPPER.search(own["joint"]))


def _rigid(links: list[dict[str, Any]], body: int) -> set[int]:
    """Return the links that are fixed to a link, and it."""
    rigid = {body}
    for index, link in enumerate(links):
        if link["parent"] in rigid and link["kind"] == "fixed":
            rigid.add(index)
    return rigid


def _text(
    name: str, base: str, flange: str, moving: list[dict[str, Any]], slow: list[dict[str, Any]], guesses: list[str]
) -> str:
    quantity = '{{ value = {:.6g}, unit = "{}", source = "{}" }}'.format
    lines = ["# What the URDF beside does not state. Guesses to review:", *(f"# - {guess}" for guess in guesses)]
    lines += [f'name = "{name}"', f'base = "{base}"', f'flange = "{flange}"']
    lines += [f"payload = {quantity(_PAYLOAD, 'kg', _GUESS)}", "", "[home]"]
    for link in moving:
        middle = 0.5 * (link["limits"][0] + link["limits"][1])
        lines.append(f'"{link["joint"]}" = {quantity(middle, _UNITS[link["kind"]], _GUESS)}')
    for link in slow:
        speed = quantity(_SPEEDS[link["kind"]], f"{_UNITS[link['kind']]}/s", _GUESS)
        lines += ["", f'[limits."{link["joint"]}"]', f"speed = {speed}"]
    return "\n".join(lines) + "\n"
