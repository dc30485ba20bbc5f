"""Unpack Debian's Rust compiler, with the standard library for another architecture, into a folder.

    python scripts/debian_rust.py aarch64-unknown-linux-gnu

``make wheels TARGETS_FROM=debian`` uses it where rustup cannot download a target. Debian compiles the standard library
for each of its architectures, and its compiler is a cross compiler, so two packages of one version are a toolchain:
``rustc`` of this machine's architecture and ``libstd-rust-dev`` of the other one. Nothing is installed and root is not
needed: apt resolves and verifies the packages with settings of its own, dpkg-deb unpacks them. A program ``rustc`` in
the folder starts the compiler with the C library that came with it, so that this machine's may be older; the output
ends with its path, for the variable ``RUSTC`` of cargo. Linker and cargo are this machine's.

It needs apt and the keys of Debian's archive (package ``debian-archive-keyring``), and downloads from a Debian mirror
the indices of two suites (20 MB) and 19 packages (141 MB): compiler, its libraries (LLVM) and both standard libraries.
"""

import argparse
import shlex
import shutil
import sys
from collections.abc import Sequence
from pathlib import Path

from wheels.files import DEBIAN_MIRROR, ROOT, CheckError, debian_architecture, run

KEYS = "/usr/share/keyrings/debian-archive-keyring.gpg"


def sources(mirror: str, suite: str, architectures: Sequence[str]) -> str:
    """Return apt's list of sources: the suite, and for backports the release that they extend."""
    suites = dict.fromkeys((suite.removesuffix("-backports"), suite))
    options = f"signed-by={KEYS} arch={','.join(architectures)}"
    return "".join(f"deb [{options}] {mirror} {name} main\n" for name in suites)


def settings(folder: Path, suite: str, architectures: Sequence[str]) -> str:
    """Return apt's configuration: everything that it reads and writes is in the folder."""
    values = {
        "Dir::State": folder,
        "Dir::State::status": folder / "status",
        "Dir::Cache": folder,
        "Dir::Etc": folder,
        "APT::Architecture": architectures[0],
        "APT::Architectures": ",".join(architectures),
        "APT::Default-Release": suite,
        "APT::Install-Recommends": "false",
        # A folder of root's is closed to the user that apt downloads as.
        "APT::Sandbox::User": "root",
        "Acquire::Languages": "none",
    }
    return "".join(f'{key} "{value}";\n' for key, value in values.items())


def check_versions(packages: Sequence[str]) -> str:
    """Return the version of Rust's packages. An error if they differ: a new one reaches some architectures first."""
    rust = [name for name in packages if name.startswith(("rustc_", "libstd-rust-dev_"))]
    versions = {name.split("_")[1] for name in rust}
    if len(versions) != 1:
        raise CheckError(f"the suite has packages of unlike versions, {', '.join(rust)}; choose another --suite")
    return versions.pop()


def starter(root: Path, loader: Path) -> str:
    """Return the program that starts the unpacked compiler, with the libraries that came with it."""
    command = [loader, "--library-path", loader.parent, root / "usr/bin/rustc", "--sysroot", root / "usr"]
    return f'#!/bin/sh\nexec {shlex.join(map(str, command))} "$@"\n'


def download(folder: Path, mirror: str, suite: str, architectures: Sequence[str]) -> list[Path]:
    """Download the packages of the compiler and of both standard libraries."""
    archives = folder / "archives"
    for name in ("lists/partial", "archives/partial", "apt.conf.d", "preferences.d", "sources.list.d"):
        (folder / name).mkdir(parents=True, exist_ok=True)
    (folder / "status").touch()
    (folder / "sources.list").write_text(sources(mirror, suite, architectures))
    (folder / "apt.conf").write_text(settings(folder, suite, architectures))
    apt = ["env", f"APT_CONFIG={folder / 'apt.conf'}", "apt-get", "--quiet", "--yes"]
    run([*apt, "update"])
    # Not rustc itself: it depends on a C compiler, and this machine's serves as well.
    run([*apt, "install", "--download-only", "libstd-rust-dev"])
    run([*apt, "download", "rustc", f"libstd-rust-dev:{architectures[1]}"], cwd=archives)
    return sorted(archives.glob("*.deb"))


def unpack(folder: Path, target: str, mirror: str, suite: str) -> Path:
    """Make the toolchain, unless it is there, and return the path of its compiler."""
    root, rustc = folder / "root", folder / "rustc"
    if rustc.exists() and (root / "usr/lib/rustlib" / target / "lib").is_dir():
        return rustc
    own = run(["dpkg", "--print-architecture"]).strip()
    packages = download(folder / "apt", mirror, suite, (own, debian_architecture(target.partition("-")[0])))
    print(f"Rust {check_versions([path.stem for path in packages])} of Debian {suite}, {len(packages)} packages")
    for package in packages:
        run(["dpkg-deb", "--extract", str(package), str(root)])
    shutil.rmtree(folder / "apt")
    (loader,) = root.glob("usr/lib/*/ld-linux*.so.*")
    rustc.write_text(starter(root, loader))
    rustc.chmod(0o755)
    return rustc


def main() -> None:
    """Run the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("target", help="target of Rust, such as aarch64-unknown-linux-gnu")
    parser.add_argument("--out", type=Path, default=ROOT / "out/debian-rust", help="folder (%(default)s)")
    parser.add_argument("--suite", default="trixie-backports", help="suite with Rust 1.89 or later (%(default)s)")
    parser.add_argument("--mirror", default=DEBIAN_MIRROR, help="mirror (%(default)s)")
    args = parser.parse_args()
    try:
        print(unpack(args.out.resolve(), args.target, args.mirror, args.suite))
    except CheckError as error:
        sys.exit(f"{Path(__file__).name}: {error}")


if __name__ == "__main__":
    main()
