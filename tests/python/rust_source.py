"""Read the Rust sources as text: which module uses which, and how long functions are.

The reader knows `use` declarations, paths that begin with ``crate``, ``super``, ``self`` or a child module, and
re-exports: a name is followed to the module that defines it. Tests, comments and strings are left out.
"""

import re
from dataclasses import dataclass, field
from pathlib import Path

Module = tuple[str, ...]

DEFINITION = re.compile(r"\b(?:fn|struct|enum|union|trait|type|const|static|mod|macro_rules!)\s+(\w+)")


def blank(text: str) -> str:
    """Replace comments and the contents of literals by spaces; lines stay where they are."""
    token = re.compile(
        r"//[^\n]*|/\*.*?\*/|\bb?r(#*)\".*?\"\1|b?\"(?:\\.|[^\"\\])*\"|b?'(?:\\(?:u\{[^}]*\}|x..|.)|[^\\'\n])'",
        flags=re.DOTALL,
    )
    return token.sub(lambda match: re.sub(r"[^\n]", " ", match[0]), text)


def block_end(text: str, start: int) -> int:
    """Index after the brace that closes the first one at or after `start`."""
    depth = 0
    for match in re.compile(r"[{}]").finditer(text, start):
        depth += 1 if match[0] == "{" else -1
        if depth == 0:
            return match.end()
    return len(text)


def without_tests(text: str) -> str:
    """Blank every item that exists in tests alone; `text` is blanked already."""
    while match := re.search(r"#\[cfg\(test\)\]\s*(?:#\[[^\]]*\]\s*)*[^;{]*([;{])", text):
        end = match.end() if match[1] == ";" else block_end(text, match.start(1))
        text = text[: match.start()] + re.sub(r"[^\n]", " ", text[match.start() : end]) + text[end:]
    return text


def expand(tree: str) -> list[tuple[tuple[str, ...], str]]:
    """List the (path, name here) of a use tree: ``a::{b, c as d}`` gives ``a::b`` named b and ``a::c`` named d."""
    tree = tree.strip()
    brace = tree.find("{")
    if brace < 0:
        path, _, alias = tree.partition(" as ")
        parts = tuple(part.strip() for part in path.strip().removeprefix("::").split("::"))
        if parts[-1] == "self":
            parts = parts[:-1]
        return [(parts, alias.strip() or parts[-1])]
    head = tuple(part for part in tree[:brace].strip().split("::") if part)
    found, depth, first = [], 0, brace + 1
    for i, char in enumerate(tree[brace:], brace):
        depth += {"{": 1, "}": -1}.get(char, 0)
        if depth == 0 or (depth == 1 and char == ","):
            if tree[first:i].strip():
                found += [((*head, *path), name) for path, name in expand_member(tree[first:i])]
            first = i + 1
    return found


def expand_member(tree: str) -> list[tuple[tuple[str, ...], str]]:
    """As `expand`, for a member of braces, where ``self`` alone is the head."""
    return [((), "self")] if tree.strip() == "self" else expand(tree)


@dataclass
class Source:
    """One file: what it defines, re-exports and mentions."""

    path: Path
    children: set[str] = field(default_factory=set)
    defined: set[str] = field(default_factory=set)
    exported: dict[str, tuple[str, ...]] = field(default_factory=dict)
    globs: list[tuple[str, ...]] = field(default_factory=list)
    mentioned: set[tuple[str, ...]] = field(default_factory=set)

    @classmethod
    def read(cls, path: Path, submodules: set[str]) -> "Source":
        """Read a file; `submodules` names the files in the folder of its module."""
        text = without_tests(blank(path.read_text()))
        source = cls(path, {name for name in re.findall(r"\bmod\s+(\w+)\s*;", text) if name in submodules})
        pattern = re.compile(r"(\bpub(?:\([^)]*\))?\s+)?\buse\s+([^;]+);")
        body = pattern.sub(" ", text)
        source.defined = set(DEFINITION.findall(body)) - source.children
        for public, tree in pattern.findall(text):
            for parts, name in expand(tree):
                if not public:
                    source.mentioned.add(parts)
                elif name == "*":
                    source.globs.append(parts[:-1])
                else:
                    source.exported[name] = parts
                    # What is exported and also used here is a use.
                    if re.search(rf"\b{name}\b", body):
                        source.mentioned.add(parts)
        heads = "|".join(["crate", "super", "self", *source.children])
        paths = re.findall(rf"(?<![\w:])(?:{heads})(?:\s*::\s*\w+)+", body)
        source.mentioned |= {tuple(re.split(r"\s*::\s*", path)) for path in paths}
        return source


class Crate:
    """The modules of one crate, by path; the root is ``()``."""

    def __init__(self, folder: Path) -> None:
        files = {self._module(path.relative_to(folder)): path for path in sorted(folder.rglob("*.rs"))}
        below = {m: {f[-1] for f in files if f and f[:-1] == m} for m in files}
        tests = {m for m in files if m and self._only_tested(files, m)}
        self.sources = {m: Source.read(path, below[m]) for m, path in files.items() if m not in tests}

    @staticmethod
    def _module(path: Path) -> Module:
        parts = path.with_suffix("").parts
        return parts[:-1] if parts[-1] in ("lib", "mod", "main") else parts

    @staticmethod
    def _only_tested(files: dict[Module, Path], module: Module) -> bool:
        declared = rf"#\[cfg\(test\)\]\s*(?:#\[[^\]]*\]\s*)*mod\s+{module[-1]}\s*;"
        parents = [files[p] for p in (module[:-1], *(module[:i] for i in range(len(module) - 1))) if p in files]
        return bool(parents) and re.search(declared, parents[0].read_text()) is not None

    def resolve(self, module: Module, parts: tuple[str, ...], seen: frozenset[object] = frozenset()) -> Module | None:
        """Follow a path, as written in `module`, to the module that defines its item; ``None`` outside the crate."""
        at, rest = module, list(parts)
        if rest[0] == "crate":
            at, rest = (), rest[1:]
        elif rest[0] == "super":
            while rest and rest[0] == "super":
                at, rest = at[:-1], rest[1:]
        elif rest[0] == "self":
            rest = rest[1:]
        elif rest[0] not in self.sources[module].children:
            return None
        while rest:
            source, name = self.sources[at], rest[0]
            if name in source.children:
                at, rest = (*at, name), rest[1:]
                continue
            if name in source.exported and (at, name) not in seen:
                target = (*source.exported[name], *rest[1:])
                return self.resolve(at, target, seen | {(at, name)})
            for glob in source.globs:
                inside = self.resolve(at, (*glob, name), seen | {(at, name)}) if (at, name) not in seen else None
                if inside is not None and name in self.sources[inside].defined:
                    return inside
            return at
        return at

    def uses(self) -> dict[Module, set[Module]]:
        """Which modules each module uses, itself left out."""
        found = {}
        for module, source in self.sources.items():
            targets = {self.resolve(module, parts) for parts in source.mentioned if parts}
            found[module] = {t for t in targets if t is not None and t != module}
        return found

    def circles(self) -> set[frozenset[str]]:
        """Circles between modules, as `circles` finds them."""
        return {frozenset("::".join(m) or "the root" for m in circle) for circle in circles(self.uses())}


def circles(uses: dict[Module, set[Module]]) -> set[frozenset[Module]]:
    """Find the circles between modules, each as the set of their names.

    Modules are compared twice: file by file, and at each level of the tree with everything below a module counted as
    that module. A parent and its child form a circle where each uses what the other defines.
    """
    found = set(components(uses))
    for parent in uses:
        depth = len(parent)
        level: dict[Module, set[Module]] = {m: set() for m in uses if m[:-1] == parent and m}
        for module, targets in uses.items():
            for target in targets:
                a, b = module[: depth + 1], target[: depth + 1]
                if a != b and a in level and b in level:
                    level[a].add(b)
        found |= set(components(level))
    return {circle for circle in found if not any(other < circle for other in found)}


def components(graph: dict[Module, set[Module]]) -> list[frozenset[Module]]:
    """Strongly connected components of more than one node."""
    reach: dict[Module, set[Module]] = {}
    for node in graph:
        seen, front = set(), [node]
        while front:
            for target in graph[front.pop()]:
                if target not in seen:
                    seen.add(target)
                    front.append(target)
        reach[node] = seen
    return [
        group for node in graph if len(group := frozenset({o for o in reach[node] if node in reach[o]} | {node})) > 1
    ]


def functions(path: Path) -> list[tuple[str, int, int]]:
    """List name, first line and length of every function of a Rust file, from its signature to its closing brace."""
    text = blank(path.read_text())
    found = []
    for match in re.finditer(r"\bfn\s+(\w+)", text):
        # The body's brace, or the semicolon of a declaration; array types hold semicolons inside brackets.
        depth, i = 0, match.end()
        while i < len(text) and (depth or text[i] not in "{;"):
            depth += {"(": 1, "[": 1, ")": -1, "]": -1}.get(text[i], 0)
            i += 1
        if i < len(text) and text[i] == "{":
            end = block_end(text, i)
            first = text.count("\n", 0, match.start()) + 1
            found.append((match[1], first, text.count("\n", match.start(), end) + 1))
    return found
