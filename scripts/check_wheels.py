"""Check the files of ``make wheels`` and ``make sdist``, install them in a bare Debian, and build them elsewhere.

    python scripts/check_wheels.py files out/dist
    python scripts/check_wheels.py policies out/dist
    python scripts/check_wheels.py install out/dist
    python scripts/check_wheels.py source out/dist

``files`` reads sizes, versions and tags, and runs ``auditwheel`` and ``abi3audit`` (``make wheels`` installs both).

``policies`` installs both wheels in an empty virtual environment, and evaluates every published policy by its name. It
needs a package index.

``install`` makes a bare Debian with only Python and pip, installs both wheels there, runs the first example of
README.md and evaluates a published policy by its name. It needs root, Debian's package ``debootstrap``, a Debian mirror
and a package index: packages are downloaded outside the bare Debian, and installed there from a folder. With
``--machine`` the Debian is of another architecture, and Debian's package ``qemu-user-static`` runs its programs.

``source`` builds a wheel from the source distribution, in another folder. It needs Rust and a package index.

Each check prints its findings, and ends with status 1 at the first error.
"""

import argparse
import json
import platform
import sys
import tarfile
import tempfile
from pathlib import Path

from wheels import bare_debian, files


def check_source(dist: Path) -> None:
    """Build a wheel from the source distribution, outside the repository."""
    archives = sorted(dist.glob("graspbox-*.tar.gz"))
    if len(archives) != 1:
        raise files.CheckError(f"{dist} has {len(archives)} source distributions; run make sdist")
    with tempfile.TemporaryDirectory(prefix="graspbox-source-") as name:
        folder = Path(name)
        with tarfile.open(archives[0]) as archive:
            archive.extractall(folder, filter="data")
        (tree,) = folder.iterdir()
        pip = [sys.executable, "-m", "pip", "wheel", "--quiet", "--no-deps", "--wheel-dir", str(folder), str(tree)]
        files.run(pip, cwd=folder)
        (wheel,) = folder.glob("*.whl")
        files.check_wheel(wheel, published=False)


def check_policies(dist: Path) -> None:
    """Evaluate every published policy by its name, from the two wheels in an empty virtual environment."""
    own, data = files.wheels(dist)
    (wheel,) = (path for path in own if path.name.endswith(f"_{platform.machine()}.whl"))
    with tempfile.TemporaryDirectory(prefix="graspbox-policies-") as name:
        folder = Path(name)
        files.run([sys.executable, "-m", "venv", str(folder / "venv")])
        python = str(folder / "venv/bin/python")
        # The wheel of the policies names the extras of graspbox that it needs.
        files.run([python, "-m", "pip", "install", "--quiet", f"graspbox @ {wheel.as_uri()}", str(data)])
        listed = "from graspbox.policies.published import installed; print(*installed.names())"
        names = files.run([python, "-c", listed], cwd=folder).split()
        if not names:
            raise files.CheckError(f"{data.name} offers no policies")
        for policy in names:
            command = [python, "-m", "graspbox", "evaluate", policy, "--trials", "1", "--json"]
            result = json.loads(files.run(command, cwd=folder))
            if result["trials"] != 1:
                raise files.CheckError(f"the policy {policy!r} ran {result['trials']} trials instead of 1")
            print(f"{policy}: {result['succeeded']} of 1")


def main() -> None:
    """Run the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("check", choices=("files", "policies", "install", "source"))
    parser.add_argument("dist", type=Path, help="folder of the wheels and of the source distribution")
    parser.add_argument("--machine", default=platform.machine(), help="architecture of the bare Debian (%(default)s)")
    parser.add_argument("--root", type=Path, help="its folder (out/debian or, for another machine, out/debian-MACHINE)")
    parser.add_argument("--suite", default="bookworm", help="its release (%(default)s)")
    parser.add_argument("--mirror", default=files.DEBIAN_MIRROR, help="mirror (%(default)s)")
    args = parser.parse_args()
    dist, own = args.dist.resolve(), args.machine == platform.machine()
    root = args.root or files.ROOT / ("out/debian" if own else f"out/debian-{args.machine}")
    try:
        if args.check == "files":
            files.check_files(dist)
        elif args.check == "policies":
            check_policies(dist)
        elif args.check == "install":
            debian = bare_debian.BareDebian(root.resolve(), args.suite, args.mirror, args.machine)
            bare_debian.check_install(dist, debian)
        else:
            check_source(dist)
    except files.CheckError as error:
        sys.exit(f"{Path(__file__).name}: {error}")


if __name__ == "__main__":
    main()
