"""Links and shapes of an MJCF hand that do not touch each other, by excluded pairs of bodies and by masks."""

from collections.abc import Iterable
from itertools import combinations
from typing import Any

__all__ = ["apart", "collides", "named_pairs"]


def named_pairs(model: Any) -> set[frozenset[int]]:
    """Return the pairs of geoms that collide whatever their masks say."""
    return {frozenset(pair) for pair in zip(model.pair_geom1.tolist(), model.pair_geom2.tolist(), strict=True)}


def collides(model: Any, geom: int, named: set[frozenset[int]]) -> bool:
    """Return whether a geom collides with anything."""
    mask = model.geom_contype[geom] or model.geom_conaffinity[geom]
    return bool(mask) or any(geom in pair for pair in named)


def apart(
    model: Any, pairs: Iterable[tuple[str, str]], geoms: dict[str, list[tuple[int, str]]]
) -> tuple[tuple[str, ...], ...]:
    """List links and shapes that do not touch each other, in lists of names none of which touches another.

    `pairs` are the links that could touch; `geoms` has the geoms of each link, with their names.
    """
    named = named_pairs(model)
    excluded = {frozenset((signature >> 16, signature & 0xFFFF)) for signature in model.exclude_signature.tolist()}

    def touch(one: int, two: int) -> bool:
        if frozenset((one, two)) in named:
            return True
        if frozenset((int(model.geom_bodyid[one]), int(model.geom_bodyid[two]))) in excluded:
            return False
        contype, affinity = model.geom_contype, model.geom_conaffinity
        return bool(contype[one] & affinity[two] or contype[two] & affinity[one])

    links, shapes = list[tuple[str, str]](), list[tuple[str, str]]()
    for first, second in pairs:
        both = [(one, two) for one in geoms[first] for two in geoms[second]]
        separate = [(one[1], two[1]) for one, two in both if not touch(one[0], two[0])]
        if separate and len(separate) == len(both):
            links.append((first, second))
        else:
            shapes += separate
    return (*_cliques(links), *_cliques(shapes))


def _cliques(pairs: list[tuple[str, str]]) -> list[tuple[str, ...]]:
    """Cover pairs by lists in which every two names are a pair, the longest that a greedy search finds."""
    edges = {frozenset(pair) for pair in pairs}
    names = list(dict.fromkeys(name for pair in pairs for name in pair))
    left, lists = dict.fromkeys(frozenset(pair) for pair in pairs), list[tuple[str, ...]]()
    for pair in pairs:
        if frozenset(pair) not in left:
            continue
        clique = list(pair)
        for name in names:
            if name not in clique and all(frozenset((name, other)) in edges for other in clique):
                clique.append(name)
        lists.append(tuple(clique))
        for covered in combinations(clique, 2):
            left.pop(frozenset(covered), None)
    return lists
