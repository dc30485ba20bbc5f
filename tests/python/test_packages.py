"""Published packages: the data wheel of the policies, versions, licences, the release workflow and the citation."""

import base64
import csv
import hashlib
import re
import shutil
import subprocess
import sys
import tomllib
import zipfile
from email.parser import Parser
from importlib.metadata import entry_points
from pathlib import Path
from typing import Any

import pytest
import yaml

import graspbox
from graspbox.policies.published import installed
from graspbox.policies.published.folders import load, used_folder
from program_files import imported

pytest.importorskip("hatchling", reason="the data wheel is built with hatchling, from the extra 'dev'")

ROOT = Path(__file__).parents[2]
WORKFLOW = ROOT / ".github/workflows/release.yml"
CHECKS = ROOT / ".github/workflows/ci.yml"
WORKSPACE = tomllib.loads((ROOT / "Cargo.toml").read_text())["workspace"]["package"]


def build(tree: Path, out: Path) -> subprocess.CompletedProcess[str]:
    """Build the data wheel of a tree, without a network."""
    command = [sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", str(out)]
    return subprocess.run(command, cwd=tree / "packages/policies", capture_output=True, text=True)


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("dist")
    done = build(ROOT, out)
    assert done.returncode == 0, done.stderr
    (found,) = out.iterdir()
    return found


def test_the_wheel_holds_the_policies(wheel: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert wheel.name == f"graspbox_policies-{graspbox.__version__}-py3-none-any.whl"
    with zipfile.ZipFile(wheel) as archive:
        archive.extractall(tmp_path)
    package = tmp_path / "graspbox_policies"
    check = imported(ROOT / "scripts/check_wheels.py").files
    assert check.unpacked_size(wheel) <= check.LARGEST_POLICIES
    assert tuple(sorted(path.name for path in package.iterdir() if path.is_dir())) == installed.PUBLISHED
    for name in installed.PUBLISHED:
        # `load` compares every file with its hash in config.json.
        config, source = load(package / name), ROOT / "policies" / name
        held = {"config.json", "README.md", "LICENSE", *config.files}
        assert held <= {path.name for path in (package / name).iterdir()}
        for path in (package / name).iterdir():
            assert path.read_bytes() == (source / path.name).read_bytes()
        # Pictures of the card come along.
        card = (package / name / "README.md").read_text()
        assert all((package / name / picture).is_file() for picture in re.findall(r"!\[[^\]]*\]\(([^)]+)\)", card))
    # Installed, each name leads to its folder, and the policies find the one that they use.
    monkeypatch.syspath_prepend(tmp_path)
    assert {entry.name for entry in entry_points(group=installed.GROUP)} >= set(installed.PUBLISHED)
    for name, used in (("feel", "depth"), ("feel_inspire", "inspire"), ("feel_leap", "leap")):
        folder = installed.find(name)
        assert used_folder(folder, load(folder), "depth").resolve() == (package / used).resolve()


def test_the_wheel_is_data_with_the_version_of_graspbox(wheel: Path) -> None:
    with zipfile.ZipFile(wheel) as archive:
        names = archive.namelist()
        (info,) = {name.partition("/")[0] for name in names if ".dist-info/" in name}
        texts = {name: archive.read(f"{info}/{name}").decode() for name in ("METADATA", "RECORD")}
        for name, digest, _ in csv.reader(texts["RECORD"].splitlines()):
            if digest:
                found = base64.urlsafe_b64encode(hashlib.sha256(archive.read(name)).digest()).rstrip(b"=").decode()
                assert digest == f"sha256={found}"
    assert [name for name in names if name.endswith((".py", ".pyc", ".so", ".pkl"))] == [
        "graspbox_policies/__init__.py"
    ]
    metadata = Parser().parsestr(texts["METADATA"])
    assert metadata["Version"] == graspbox.__version__
    assert metadata.get_all("Requires-Dist") == [f"graspbox[cli,onnx]=={graspbox.__version__}"]
    assert (metadata["License-Expression"], metadata["License-File"]) == ("Apache-2.0", "LICENSE")
    assert f"{info}/licenses/LICENSE" in names


def test_the_wheel_is_refused_with_a_changed_file(tmp_path: Path) -> None:
    shutil.copytree(ROOT / "packages", tmp_path / "packages")
    shutil.copy(ROOT / "Cargo.toml", tmp_path)
    assert "build the wheel in a checkout" in build(tmp_path, tmp_path / "dist").stderr
    shutil.copytree(ROOT / "policies/feel", tmp_path / "policies/feel")
    (tmp_path / "policies/feel/notes.txt").write_text("not a part of the policy")
    assert build(tmp_path, tmp_path / "dist").returncode == 0
    (made,) = (tmp_path / "dist").iterdir()
    assert "graspbox_policies/feel/notes.txt" not in zipfile.ZipFile(made).namelist()
    (tmp_path / "policies/feel/feel.onnx").write_bytes(b"another network")
    done = build(tmp_path, tmp_path / "dist")
    assert done.returncode != 0
    assert "feel.onnx is not the file that config.json names" in done.stderr


def test_licences_and_versions_are_one() -> None:
    assert (ROOT / "packages/policies/LICENSE").read_bytes() == (ROOT / "LICENSE").read_bytes()
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text())
    assert (citation["version"], citation["license"]) == (graspbox.__version__, WORKSPACE["license"])
    assert [author["name"] for author in citation["authors"]] == WORKSPACE["authors"]


def recipes() -> set[str]:
    """Names of the recipes of the Makefile."""
    return set(re.findall(r"^([a-z][\w-]*):", (ROOT / "Makefile").read_text(), flags=re.MULTILINE))


def commands(workflow: dict[str, Any]) -> list[str]:
    """Every line that a workflow runs."""
    steps = [step for job in workflow["jobs"].values() for step in job["steps"]]
    return [line.strip() for step in steps for line in step.get("run", "").splitlines()]


def test_the_workflow_runs_the_recipes_that_exist() -> None:
    lines = commands(yaml.safe_load(WORKFLOW.read_text()))
    made = {name for line in lines for name in re.findall(r"\bmake ([a-z-]+)", line)}
    assert made == {"wheels", "sdist", "check-wheels", "check-source"}
    assert made <= recipes()
    programs = {name for line in lines for name in re.findall(r"\bpython (scripts/\S+)", line)}
    assert programs == {"scripts/release_tree.py"}
    assert all((ROOT / name).is_file() for name in programs)
    assert "graspbox evaluate depth --trials 1" in lines


def test_every_push_is_checked() -> None:
    workflow = yaml.safe_load(CHECKS.read_text())
    assert "make lint test" in commands(workflow)
    # YAML 1.1 reads the key `on` as a truth value.
    assert workflow[True] == "push"


def test_the_workflow_publishes_without_a_secret() -> None:
    workflow = yaml.safe_load(WORKFLOW.read_text())
    assert "secrets." not in WORKFLOW.read_text()
    assert workflow["permissions"] == {"contents": "read"}
    publish = workflow["jobs"]["publish"]
    assert (publish["environment"], publish["permissions"]) == ("pypi", {"id-token": "write"})
    assert publish["if"] == "github.ref_type == 'tag'"
    # Everything else must have passed.
    assert set(publish["needs"]) == set(workflow["jobs"]) - {"publish"}
    assert all("permissions" not in job for name, job in workflow["jobs"].items() if name != "publish")


@pytest.mark.parametrize(
    ("schema", "name"),
    [("github-workflows", WORKFLOW), ("github-workflows", CHECKS), ("citation-file-format", ROOT / "CITATION.cff")],
)
def test_files_for_other_programs_follow_their_schema(schema: str, name: Path) -> None:
    pytest.importorskip("check_jsonschema", reason="schemas come with check-jsonschema, from the extra 'dev'")
    command = [sys.executable, "-m", "check_jsonschema", "--builtin-schema", f"vendor.{schema}", str(name)]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout


def test_a_release_needs_an_address(tmp_path: Path) -> None:
    """The recipe refuses before it builds anything; so does the program that writes addresses into the copy."""
    done = subprocess.run(["make", "-n", "release"], cwd=ROOT, capture_output=True, text=True)
    assert done.returncode != 0
    assert "make release REPOSITORY=https://HOST/OWNER/NAME" in done.stderr
    program = [sys.executable, "scripts/release_tree.py", str(tmp_path / "tree"), "--url", "example.org/name/"]
    done = subprocess.run(program, cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 2
    assert "give it as https://HOST/OWNER/NAME" in done.stderr
    assert not (tmp_path / "tree").exists()


def packed(path: Path, files: dict[str, int]) -> Path:
    """Write a wheel whose files have these sizes, not compressed."""
    with zipfile.ZipFile(path, "w") as archive:
        for name, size in files.items():
            archive.writestr(name, bytes(size))
    return path


def test_wheels_are_checked(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    check = imported(ROOT / "scripts/check_wheels.py").files
    tag = f"graspbox-{graspbox.__version__}-cp311-abi3-manylinux_2_28_x86_64.whl"
    whole = {"graspbox/_core.abi3.so": 1_000_000, "graspbox-0.1.0.dist-info/licenses/LICENSE": 10}
    check.check_wheel(packed(tmp_path / tag, whole))
    assert "1.0 MB" in capsys.readouterr().out
    wrong = {
        "has 8000": (tag, {**whole, "graspbox/_core.abi3.so": 8_000_000}),
        "no extension": (tag, {"graspbox-0.1.0.dist-info/licenses/LICENSE": 10}),
        "and the licence": (tag, {"graspbox/_core.abi3.so": 10}),
        "stable ABI": (tag.replace("abi3", "cp311"), whole),
    }
    for message, (name, files) in wrong.items():
        with pytest.raises(check.CheckError, match=message):
            check.check_wheel(packed(tmp_path / name, files))
    with pytest.raises(check.CheckError, match="0 of its policies; run make wheels"):
        check.wheels(tmp_path)
    packed(tmp_path / "graspbox_policies-9.9.9-py3-none-any.whl", {})
    with pytest.raises(check.CheckError, match=r"graspbox_policies-9\.9\.9.* is not of the version"):
        check.wheels(tmp_path)


def test_the_report_of_auditwheel_is_read() -> None:
    check = imported(ROOT / "scripts/check_wheels.py").files
    report = '\nx.whl is consistent with the following\nplatform tag: "manylinux_2_27_x86_64".\n'
    assert check.glibc_of(report) == (2, 27)
    with pytest.raises(check.CheckError, match="no manylinux tag"):
        check.glibc_of('consistent with the following platform tag: "linux_x86_64"')


def test_architectures_have_the_names_of_debian() -> None:
    check = imported(ROOT / "scripts/check_wheels.py").files
    assert [check.debian_architecture(machine) for machine in ("x86_64", "aarch64")] == ["amd64", "arm64"]
    with pytest.raises(check.CheckError, match="armv7l is not one of the architectures x86_64, aarch64"):
        check.debian_architecture("armv7l")


def test_packages_of_debian_come_with_settings_of_their_own(tmp_path: Path) -> None:
    rust = imported(ROOT / "scripts/debian_rust.py")
    lines = rust.sources("http://mirror.example/debian", "trixie-backports", ("amd64", "arm64")).splitlines()
    assert [line.split()[-2:] for line in lines] == [["trixie", "main"], ["trixie-backports", "main"]]
    assert all("signed-by=" in line and "arch=amd64,arm64] http://mirror.example/debian " in line for line in lines)
    assert len(rust.sources("http://mirror.example/debian", "sid", ("amd64", "arm64")).splitlines()) == 1
    settings = rust.settings(tmp_path, "trixie-backports", ("amd64", "arm64"))
    named = dict(re.findall(r'^(\S+) "(.*)";$', settings, flags=re.MULTILINE))
    # Neither the state nor the sources of this machine's apt.
    assert all(
        named[key].startswith(str(tmp_path)) for key in ("Dir::State", "Dir::State::status", "Dir::Cache", "Dir::Etc")
    )
    assert (named["APT::Architecture"], named["APT::Default-Release"]) == ("amd64", "trixie-backports")


def test_compiler_and_standard_libraries_have_one_version() -> None:
    rust = imported(ROOT / "scripts/debian_rust.py")
    names = [
        "libc6_2.41-12_amd64",
        "libstd-rust-dev_1.96.1-2_amd64",
        "libstd-rust-dev_1.96.1-2_arm64",
        "rustc_1.96.1-2_amd64",
    ]
    assert rust.check_versions(names) == "1.96.1-2"
    with pytest.raises(rust.CheckError, match=r"unlike versions, .*libstd-rust-dev_1\.95\.0-1_arm64"):
        rust.check_versions([name.replace("1.96.1-2_arm64", "1.95.0-1_arm64") for name in names])


def test_the_unpacked_compiler_starts_with_its_own_libraries(tmp_path: Path) -> None:
    """A folder with a space, and a loader that prints what it is told."""
    rust = imported(ROOT / "scripts/debian_rust.py")
    root = tmp_path / "a root"
    loader = root / "usr/lib/x86_64-linux-gnu/ld-linux-x86-64.so.2"
    loader.parent.mkdir(parents=True)
    loader.write_text('#!/bin/sh\nprintf "%s\\n" "$@"\n')
    loader.chmod(0o755)
    (tmp_path / "rustc").write_text(rust.starter(root, loader))
    done = subprocess.run(["sh", tmp_path / "rustc", "--print", "a b"], capture_output=True, text=True, check=True)
    libraries, program, sysroot = str(loader.parent), str(root / "usr/bin/rustc"), str(root / "usr")
    assert done.stdout.splitlines() == ["--library-path", libraries, program, "--sysroot", sysroot, "--print", "a b"]


def test_an_emulated_debian_needs_the_help_of_the_kernel(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    bare = imported(ROOT / "scripts/check_wheels.py").bare_debian
    monkeypatch.setattr(bare.os, "geteuid", lambda: 0)
    monkeypatch.setattr(bare.platform, "machine", lambda: "x86_64")
    monkeypatch.setattr(bare, "BINFMT", tmp_path)
    (tmp_path / "usr/bin").mkdir(parents=True)
    (tmp_path / "usr/bin/pip3").touch()
    assert not bare.BareDebian(tmp_path, "bookworm", "", "x86_64").emulated
    with pytest.raises(bare.CheckError, match="does not run programs of aarch64; install qemu-user-static"):
        bare.BareDebian(tmp_path, "bookworm", "", "aarch64")
    (tmp_path / "qemu-aarch64").touch()
    assert bare.BareDebian(tmp_path, "bookworm", "", "aarch64").emulated


def test_the_bare_debian_runs_the_first_example() -> None:
    example = imported(ROOT / "scripts/check_wheels.py").bare_debian.first_example()
    assert example in (ROOT / "README.md").read_text()
    assert len([line for line in example.splitlines() if line]) == 5
