"""Which bodies of an MJCF model are the hand.

Its base is a body in the world, or the world where fingers stand beside each other in it. Joints above the palm, of a
base that moves, are held where the model begins. Whatever else stands in the world belongs to the base if it touches
it, and is left out if not, such as a table or a camera.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field
from difflib import get_close_matches
from typing import Any

import numpy as np
from numpy.typing import NDArray

from graspbox.errors import HandError
from graspbox.hands.mjcf.lines import Lines
from graspbox.hands.mjcf.loops import name_of

__all__ = ["Selection", "select"]

#: Parts of the world nearer than this to the hand belong to it, metres: a palm may end before its fingers begin.
_NEAR = 0.02
#: Slides in a row from which joints are those of a base that moves, and most joints that a base has.
_SLIDES, _MOST_BASE = 3, 6


@dataclass(frozen=True)
class Selection:
    """The bodies of a hand.

    ``root`` is the body whose frame and name the base has, 0 for the world. ``fixed`` are the bodies of the base, with
    joints that are held; ``bodies`` are all, parents first. ``geoms`` are the geoms of the world that belong to it.
    """

    root: int
    fixed: frozenset[int]
    bodies: tuple[int, ...]
    geoms: tuple[int, ...] = ()
    assumptions: list[str] = field(default_factory=list)


def select(mujoco: Any, model: Any, data: Any, lines: Lines, base: str | None) -> Selection:
    """Choose the bodies of the hand; `data` has the poses of the model's beginning, `base` names the base's body.

    Raises
    ------
    HandError
        If there is no body `base`, or nothing moves.
    """
    tree = _Tree(mujoco, model, data, lines)
    return tree.automatic() if base is None else tree.below(base)


class _Tree:
    def __init__(self, mujoco: Any, model: Any, data: Any, lines: Lines) -> None:
        self._mujoco, self._model, self._data, self._lines = mujoco, model, data, lines
        self._children: list[list[int]] = [[] for _ in range(model.nbody)]
        for body in range(1, model.nbody):
            self._children[int(model.body_parentid[body])].append(body)
        self._notes: list[str] = []

    def _subtree(self, body: int) -> Iterator[int]:
        yield body
        for child in self._children[body]:
            yield from self._subtree(child)

    def _joints(self, body: int) -> list[int]:
        first = int(self._model.body_jntadr[body])
        return list(range(first, first + int(self._model.body_jntnum[body])))

    def _kind(self, joint: int) -> int:
        return int(self._model.jnt_type[joint])

    def _is_free(self, body: int) -> bool:
        return any(self._kind(joint) == self._mujoco.mjtJoint.mjJNT_FREE for joint in self._joints(body))

    def _moves(self, body: int) -> bool:
        """Return whether a joint other than a free one moves a part of a body's subtree."""
        free = self._mujoco.mjtJoint.mjJNT_FREE
        return any(self._kind(joint) != free for each in self._subtree(body) for joint in self._joints(each))

    def _body_name(self, body: int) -> str:
        return name_of(self._model, "body", body)

    def _names(self, kind: str, indices: list[int]) -> str:
        return ", ".join(repr(name_of(self._model, kind, index)) for index in indices)

    def _note(self, body: int, text: str) -> None:
        name = self._body_name(body)
        self._notes.append(f"{self._lines.of('body', name)}: body {name!r}: {text}")

    def below(self, name: str) -> Selection:
        """Choose a body as the base, with all below it."""
        names = [self._body_name(body) for body in range(1, self._model.nbody)]
        if name not in names:
            near = get_close_matches(name, names, n=3) or names[:12]
            raise HandError(f"has no body {name!r}; choose from {', '.join(map(repr, near))}")
        root = names.index(name) + 1
        bodies = tuple(self._subtree(root))
        if not any(self._moves(child) for child in self._children[root]):
            raise HandError(f"body {name!r}: no joint moves a body below it; choose a body above the fingers")
        others = self._model.nbody - 1 - len(bodies)
        held = self._joints(root)
        joints = f", and its own joints {self._names('joint', held)}" if held else ""
        self._note(root, f"is the base; the {others} bodies that are not below it are left out{joints}")
        return Selection(root, frozenset([root]), bodies, (), self._notes)

    def automatic(self) -> Selection:
        """Choose the base from the bodies in the world."""
        tops = self._children[0]
        moving = [body for body in tops if self._moves(body)]
        # Things that lie about are free, unless the hand itself floats.
        if not moving:
            raise HandError("has no hinge or slide; a hand needs joints that move")
        moving = self._hand_among(moving)
        if len(moving) == 1 and any(self._moves(child) for child in self._children[moving[0]]):
            held = self._held(moving[0])
            root, bodies = held[-1], list(self._subtree(moving[0]))
        else:
            held, root, bodies = [0], 0, [body for top in moving for body in self._subtree(top)]
            self._note_beside(moving)
        statics = [body for body in tops if not self._moves(body) and not self._is_free(body)]
        for body in tops:
            if body not in moving and body not in statics:
                self._note(body, "moves beside the hand; it is left out")
        welded, geoms = self._beside(bodies, statics)
        shaped = [body for body in welded if self._model.body_geomnum[body]]
        if root == 0 and len(shaped) == 1:
            root = shaped[0]
        for body in welded:
            held += list(self._subtree(body))
        chosen = sorted({*bodies, *held} - {0})
        return Selection(root, frozenset(held), tuple(chosen), geoms, self._notes)

    def _hand_among(self, moving: list[int]) -> list[int]:
        """Choose the bodies in the world that are the hand: the one whose joints branch, or fingers side by side."""

        def lies_about(body: int) -> bool:
            """Return whether a body can be a thing: it is free, or has several joints and no part that moves."""
            parts = any(map(self._moves, self._children[body]))
            return self._is_free(body) or (not parts and len(self._joints(body)) > 1)

        attached = [body for body in moving if not lies_about(body)] or moving
        branched = [body for body in attached if any(map(self._branches, self._subtree(body)))]
        if len(branched) > 1:
            names = self._names("body", branched)
            raise HandError(f"has several hands or arms, {names}; choose the palm of one of them (`--base`)")
        return branched or attached

    def _branches(self, body: int) -> bool:
        return sum(map(self._moves, self._children[body])) > 1

    def _note_beside(self, moving: list[int]) -> None:
        if len(moving) > 1:
            others = f"with {self._names('body', moving[1:])}"
            self._note(
                moving[0], f"stands in the world {others}; all are taken as parts of one hand (`--base` takes one)"
            )

    def _held(self, top: int) -> list[int]:
        """Return the bodies from the top to the palm; joints of theirs are held, such as the six of a free base."""
        run, at = [top], top
        while True:
            children = [child for child in self._children[at] if self._moves(child)]
            if len(children) != 1:
                break
            at = children[0]
            run.append(at)
        slide, count, slides, base = self._mujoco.mjtJoint.mjJNT_SLIDE, 0, 0, 1
        for length, body in enumerate(run, 1):
            joints = self._joints(body)
            count += len(joints)
            slides += sum(self._kind(joint) == slide for joint in joints)
            below = any(self._moves(child) for child in self._children[body])
            if below and slides >= _SLIDES and count <= _MOST_BASE and joints:
                base = length
        held = run[:base]
        for body in held:
            if joints := self._joints(body):
                many = (
                    f"its joints {self._names('joint', joints)} are"
                    if len(joints) > 1
                    else (f"its joint {self._names('joint', joints)} is")
                )
                self._note(body, f"is a part of the base; {many} held where the model begins")
        return held

    def _collides(self, geom: int) -> bool:
        return bool(self._model.geom_contype[geom] or self._model.geom_conaffinity[geom])

    def _geoms(self, bodies: Iterator[int] | list[int]) -> list[int]:
        """Return the geoms of bodies that have an extent."""
        kinds = self._mujoco.mjtGeom
        flat = (kinds.mjGEOM_PLANE, kinds.mjGEOM_HFIELD)
        ids = np.flatnonzero(np.isin(self._model.geom_bodyid, list(bodies))).tolist()
        return [geom for geom in ids if int(self._model.geom_type[geom]) not in flat]

    def _beside(self, bodies: list[int], statics: list[int]) -> tuple[list[int], tuple[int, ...]]:
        """Divide bodies and geoms that stand in the world: those near the hand belong to it, others are left out."""
        near = self._geoms(bodies)
        anchors = [self._data.xanchor[joint] for body in bodies for joint in self._joints(body)]
        #: Geoms of each part: a body of the world, or a geom of the world itself by its negative number.
        parts = {body: self._geoms(list(self._subtree(body))) for body in statics}
        parts |= {-geom - 1: [geom] for geom in self._geoms([0])}
        solid = {part: geoms for part, geoms in parts.items() if any(map(self._collides, geoms))}
        taken: list[int] = []
        while found := [
            part for part, geoms in solid.items() if part not in taken and self._near(geoms, near, anchors)
        ]:
            taken += found
            near += [geom for part in found for geom in solid[part]]
        for part in parts:
            if part >= 0:
                self._note(part, self._fate(part in taken))
            elif self._collides(-part - 1):
                name = name_of(self._model, "geom", -part - 1)
                self._notes.append(f"{self._lines.of('geom', name)}: geom {name!r}: {self._fate(part in taken)}")
        return [part for part in taken if part >= 0], tuple(-part - 1 for part in taken if part < 0)

    @staticmethod
    def _fate(taken: bool) -> str:
        if taken:
            return f"is fixed in the world within {1e3 * _NEAR:.0f} mm of the hand; it becomes a part of its base"
        return "is fixed in the world away from the hand; it is left out"

    def _near(self, geoms: list[int], others: list[int], anchors: list[NDArray[np.float64]]) -> bool:
        """Return whether geoms come near others, or near the place of a joint."""
        for geom in geoms:
            reach = float(self._model.geom_rbound[geom]) + _NEAR
            center = self._data.geom_xpos[geom]
            if any(self._reaches(geom, anchor) for anchor in anchors if np.linalg.norm(anchor - center) < reach):
                return True
            for other in others:
                apart = float(np.linalg.norm(self._data.geom_xpos[other] - center))
                beyond = apart > reach + float(self._model.geom_rbound[other])
                if not beyond and self._distance(geom, other) < _NEAR:
                    return True
        return False

    def _distance(self, geom: int, other: int) -> float:
        return float(self._mujoco.mj_geomDistance(self._model, self._data, geom, other, 2 * _NEAR, None))

    def _reaches(self, geom: int, point: NDArray[np.float64]) -> bool:
        """Return whether a point is within the bounding box of a geom, or near it."""
        box = self._model.geom_aabb[geom]
        local = (point - self._data.geom_xpos[geom]) @ self._data.geom_xmat[geom].reshape(3, 3) - box[:3]
        return bool(np.linalg.norm(np.maximum(np.abs(local) - box[3:], 0.0)) < _NEAR)
