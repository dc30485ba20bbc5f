"""Checks of the files of wheels and of the source distribution."""

import re
import subprocess
import sys
import tomllib
import zipfile
from collections.abc import Sequence
from pathlib import Path

from packaging.utils import parse_wheel_filename

ROOT = Path(__file__).parents[2]
#: Largest wheel of graspbox, and largest installed policies, bytes: weights in half precision, each network once.
LARGEST_WHEEL, LARGEST_POLICIES = 8_000_000, 37_000_000
#: The newest glibc that a wheel for Linux may need.
GLIBC = (2, 28)
#: The mirror that Debian itself names.
DEBIAN_MIRROR = "http://deb.debian.org/debian"
#: Debian's names of the architectures that wheels are built for.
_DEBIAN_ARCHITECTURES = {"x86_64": "amd64", "aarch64": "arm64"}


class CheckError(Exception):
    """A wheel is wrong; the message names the problem."""


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
        raise CheckError(f"there is no program {command[0]}; see {Path(sys.argv[0]).name} --help") from None
    if done.returncode != 0:
        raise CheckError(f"{' '.join(command)} failed:\n{done.stdout[-4000:]}{done.stderr[-4000:]}")
    return done.stdout


def debian_architecture(machine: str) -> str:
    """Return Debian's name of an architecture, such as arm64 for aarch64.

    Raises
    ------
    CheckError
        If wheels are not built for it.
    """
    if machine not in _DEBIAN_ARCHITECTURES:
        raise CheckError(f"{machine} is not one of the architectures {', '.join(_DEBIAN_ARCHITECTURES)}")
    return _DEBIAN_ARCHITECTURES[machine]


def version() -> str:
    """Return the version of the workspace."""
    version: str = tomllib.loads((ROOT / "Cargo.toml").read_text())["workspace"]["package"]["version"]
    return version


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


def check_wheel(wheel: Path, published: bool = True) -> None:
    """Check content and tag of a wheel of graspbox, and the size of a published one, which has no symbols."""
    with zipfile.ZipFile(wheel) as archive:
        names = archive.namelist()
    size, tags = wheel.stat().st_size, parse_wheel_filename(wheel.name)[3]
    extensions = [name for name in names if name.endswith((".so", ".pyd"))]
    if published and size > LARGEST_WHEEL:
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
    match = re.search(r'following platform tag: "manylinux_(\d+)_(\d+)_\w+"', " ".join(report.split()))
    if match is None:
        raise CheckError(f"auditwheel finds no manylinux tag: {' '.join(report.split())[:300]}")
    return int(match[1]), int(match[2])


def check_libraries(wheel: Path) -> None:
    """Check the libraries and the glibc that a wheel for Linux needs, and the functions of Python that it calls."""
    if "linux" in wheel.name:
        needed = glibc_of(run(["auditwheel", "show", str(wheel)]))
        if needed > GLIBC:
            raise CheckError(f"{wheel.name} needs glibc {needed[0]}.{needed[1]}, newer than in its tag")
        print(f"{wheel.name}: needs glibc {needed[0]}.{needed[1]}")
    run(["abi3audit", "--strict", str(wheel)])
    print(f"{wheel.name}: calls only the stable ABI")


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
