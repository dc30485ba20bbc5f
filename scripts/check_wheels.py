"""Check the files of ``make wheels`` and ``make sdist``, install them in a bare Debian, and build them elsewhere.

    python scripts/check_wheels.py files out/dist
    python scripts/check_wheels.py install out/dist
    python scripts/check_wheels.py source out/dist

``files`` reads sizes, versions and tags, and runs ``auditwheel`` and ``abi3audit`` (``make wheels`` installs both).

``install`` makes a bare Debian with Python and pip alone, installs both wheels there, runs the first example of
README.md and evaluates a published policy by its name. It needs root, Debian's package ``debootstrap``, a Debian mirror
and a package index: packages are downloaded outside the bare Debian, and installed there from a folder.

``source`` builds a wheel from the source distribution, in another folder. It needs Rust and a package index.

Each check prints its findings, and ends with status 1 at the first error.
"""

import argparse
import json
import os
import re
import shutil
import subprocess
import sys
import tarfile
import tempfile
import time
import tomllib
import zipfile
from collections.abc import Sequence
from pathlib import Path

from packaging.utils import parse_wheel_filename

ROOT = Path(__file__).parents[1]
#: Largest wheel of graspbox, and largest installed policies, bytes.
LARGEST_WHEEL, LARGEST_POLICIES = 8_000_000, 30_000_000
#: The newest glibc that a wheel for Linux may need.
GLIBC = (2, 28)
#: Seconds that the evaluation of one trial may take.
LONGEST = 20.0
_EVALUATE = ("graspbox", "evaluate", "depth", "--trials", "1", "--json")


class CheckError(Exception):
    """Something is wrong with a wheel; the message says what."""


def version() -> str:
    """Return the version of the workspace."""
    found: str = tomllib.loads((ROOT / "Cargo.toml").read_text())["workspace"]["package"]["version"]
    return found


def wheels(dist: Path) -> tuple[list[Path], Path]:
    """Find the wheels of graspbox, at least one, and that of the policies.

    Raises
    ------
    CheckError
        If one is missing, or of another version.
    """
    own, data = sorted(dist.glob("graspbox-*.whl")), sorted(dist.glob("graspbox_policies-*.whl"))
    if not own or len(data) != 1:
        raise CheckError(f"{dist} has {len(own)} wheels of graspbox and {len(data)} of its policies; run make wheels")
    for path in (*own, *data):
        if str(parse_wheel_filename(path.name)[1]) != version():
            raise CheckError(f"{path.name} is not of the version {version()}; remove it")
    return own, data[0]


def unpacked_size(wheel: Path) -> int:
    """Return the size of a wheel's files, bytes."""
    with zipfile.ZipFile(wheel) as archive:
        return sum(info.file_size for info in archive.infolist())


def check_wheel(wheel: Path) -> None:
    """Check size, content and tag of a wheel of graspbox."""
    with zipfile.ZipFile(wheel) as archive:
        names = archive.namelist()
    size, tags = wheel.stat().st_size, parse_wheel_filename(wheel.name)[3]
    extensions = [name for name in names if name.endswith((".so", ".pyd"))]
    if size > LARGEST_WHEEL:
        raise CheckError(f"{wheel.name} has {size} bytes; at most {LARGEST_WHEEL}")
    if len(extensions) != 1 or not any(name.endswith("licenses/LICENSE") for name in names):
        raise CheckError(f"{wheel.name} holds {extensions or 'no extension'}; it needs one, and the licence")
    if any((tag.interpreter, tag.abi) != ("cp311", "abi3") for tag in tags):
        raise CheckError(f"{wheel.name} is not for the stable ABI of Python 3.11 and later")
    print(f"{wheel.name}: {size / 1e6:.1f} MB, {unpacked_size(wheel) / 1e6:.1f} MB installed")


def glibc_of(report: str) -> tuple[int, int]:
    """Read the glibc that a wheel needs off the report of ``auditwheel show``.

    Raises
    ------
    CheckError
        If the report names no manylinux tag.
    """
    found = re.search(r'following platform tag: "manylinux_(\d+)_(\d+)_\w+"', " ".join(report.split()))
    if found is None:
        raise CheckError(f"auditwheel finds no manylinux tag: {' '.join(report.split())[:300]}")
    return int(found[1]), int(found[2])


def check_libraries(wheel: Path) -> None:
    """Check the libraries and the glibc that a wheel for Linux needs, and the functions of Python that it calls."""
    if "linux" in wheel.name:
        needed = glibc_of(run(["auditwheel", "show", str(wheel)]))
        if needed > GLIBC:
            raise CheckError(f"{wheel.name} needs glibc {needed[0]}.{needed[1]}, newer than its tag says")
        print(f"{wheel.name}: needs glibc {needed[0]}.{needed[1]}")
    run(["abi3audit", "--strict", str(wheel)])
    print(f"{wheel.name}: calls the stable ABI alone")


def check_files(dist: Path) -> None:
    """Check the files of the wheels."""
    own, data = wheels(dist)
    for wheel in own:
        check_wheel(wheel)
        check_libraries(wheel)
    size = unpacked_size(data)
    if size > LARGEST_POLICIES:
        raise CheckError(f"{data.name} has {size} bytes installed; at most {LARGEST_POLICIES}")
    print(f"{data.name}: {data.stat().st_size / 1e6:.1f} MB, {size / 1e6:.1f} MB installed")


def run(command: Sequence[str], cwd: Path | None = None) -> str:
    """Run a program and return its output.

    Raises
    ------
    CheckError
        If it is missing or fails.
    """
    try:
        done = subprocess.run(command, cwd=cwd, capture_output=True, text=True, check=False)
    except FileNotFoundError:
        raise CheckError(f"there is no program {command[0]}; see {Path(__file__).name} --help") from None
    if done.returncode != 0:
        raise CheckError(f"{' '.join(command)} failed:\n{done.stdout[-4000:]}{done.stderr[-4000:]}")
    return done.stdout


class BareDebian:
    """A Debian with Python and pip alone, in a folder; kept for the next check."""

    def __init__(self, folder: Path, suite: str, mirror: str) -> None:
        self.folder = folder
        if os.geteuid() != 0:
            raise CheckError("only root can make and enter a Debian root; run it as root, or in a container")
        if not (folder / "usr/bin/pip3").exists():
            packages = "python3,python3-pip,ca-certificates"
            run(["debootstrap", "--variant=minbase", f"--include={packages}", suite, str(folder), mirror])

    def run(self, *command: str) -> str:
        """Run a program in it, with /proc but without the variables and the network of this machine."""
        enter = f"mount -t proc proc {self.folder}/proc && exec chroot {self.folder} env -i "
        enter += 'HOME=/root LANG=C.UTF-8 PATH=/usr/local/bin:/usr/bin:/bin "$@"'
        return run(["unshare", "--mount", "--net", "--propagation", "private", "sh", "-euc", enter, "sh", *command])

    def platforms(self) -> tuple[str, list[str]]:
        """Return its version of Python and the tags of wheels that it takes."""
        code = "import platform as p, sys; print(*sys.version_info[:2], p.machine(), p.libc_ver()[1])"
        major, minor, machine, glibc = self.run("python3", "-c", code).split()
        newest = int(glibc.partition(".")[2])
        named = [f"manylinux_2_{n}_{machine}" for n in range(5, newest + 1)]
        return f"{major}.{minor}", [*named, f"manylinux2014_{machine}"]


def download(own: Sequence[Path], data: Path, debian: BareDebian, folder: Path) -> None:
    """Download the packages that both wheels need, for the bare Debian, into a folder of it."""
    python, platforms = debian.platforms()
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    command = [sys.executable, "-m", "pip", "download", "--quiet", "--only-binary=:all:", "--python-version", python]
    command += [word for name in platforms for word in ("--platform", name)]
    run([*command, "--find-links", str(own[0].parent), "--dest", str(folder), str(data)])
    for path in own:
        if (folder / path.name).exists() and (folder / path.name).read_bytes() != path.read_bytes():
            raise CheckError(f"the package index has another {path.name}; the version is published already")


def first_example() -> str:
    """Return the first example of README.md."""
    found = re.search(r"^```python\n(.*?)^```", (ROOT / "README.md").read_text(), flags=re.MULTILINE | re.DOTALL)
    assert found is not None
    return found[1]


def check_install(dist: Path, debian: BareDebian) -> None:
    """Install both wheels in a bare Debian, and use them."""
    own, data = wheels(dist)
    download(own, data, debian, debian.folder / "wheels")
    pip = ("python3", "-m", "pip")
    # Debian wants a virtual environment; in a root that nobody else uses there is nothing to protect.
    debian.run(*pip, "uninstall", "--quiet", "--yes", "--break-system-packages", "graspbox", "graspbox-policies")
    given = ("install", "--quiet", "--break-system-packages", "--no-index", "--find-links", "/wheels")
    debian.run(*pip, *given, "graspbox", "graspbox-policies")
    installed = debian.run("python3", "-c", "import graspbox; print(graspbox.__version__)").strip()
    if installed != version():
        raise CheckError(f"graspbox.__version__ is {installed}; the wheel is of {version()}")
    print(f"installed graspbox {installed} in {debian.run('cat', '/etc/debian_version').strip()}")
    print(f"the first example of README.md printed {debian.run('python3', '-c', first_example()).strip()}")
    begun = time.perf_counter()
    result = json.loads(debian.run(*_EVALUATE))
    seconds = time.perf_counter() - begun
    print(f"{' '.join(_EVALUATE)}: {result['succeeded']} of {result['trials']} in {seconds:.1f} s")
    if result["trials"] != 1 or seconds > LONGEST:
        raise CheckError(f"one trial is to take at most {LONGEST:.0f} s")


def check_source(dist: Path) -> None:
    """Build a wheel from the source distribution, outside the repository."""
    archives = sorted(dist.glob("graspbox-*.tar.gz"))
    if len(archives) != 1:
        raise CheckError(f"{dist} has {len(archives)} source distributions; run make sdist")
    with tempfile.TemporaryDirectory(prefix="graspbox-source-") as name:
        folder = Path(name)
        with tarfile.open(archives[0]) as archive:
            archive.extractall(folder, filter="data")
        (tree,) = folder.iterdir()
        pip = [sys.executable, "-m", "pip", "wheel", "--quiet", "--no-deps", "--wheel-dir", str(folder), str(tree)]
        run(pip, cwd=folder)
        (wheel,) = folder.glob("*.whl")
        check_wheel(wheel)


def main() -> None:
    """Run the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("check", choices=("files", "install", "source"))
    parser.add_argument("dist", type=Path, help="folder of the wheels and of the source distribution")
    parser.add_argument(
        "--root", type=Path, default=ROOT / "out/debian", help="folder of the bare Debian (%(default)s)"
    )
    parser.add_argument("--suite", default="bookworm", help="its release (%(default)s)")
    parser.add_argument("--mirror", default="http://deb.debian.org/debian", help="mirror (%(default)s)")
    args = parser.parse_args()
    dist = args.dist.resolve()
    try:
        if args.check == "files":
            check_files(dist)
        elif args.check == "install":
            check_install(dist, BareDebian(args.root.resolve(), args.suite, args.mirror))
        else:
            check_source(dist)
    except CheckError as error:
        sys.exit(f"{Path(__file__).name}: {error}")


if __name__ == "__main__":
    main()
