"""A bare Debian, in which the wheels are installed and used."""

import json
import os
import platform
import re
import shutil
import sys
import time
from collections.abc import Sequence
from pathlib import Path

from wheels.files import ROOT, CheckError, debian_architecture, run, version, wheels

#: Seconds that the evaluation of one trial may take, and how often that with an emulated processor.
LONGEST, EMULATED = 20.0, 30
#: What the kernel starts for programs that this machine cannot run.
BINFMT = Path("/proc/sys/fs/binfmt_misc")
_EVALUATE = ("graspbox", "evaluate", "depth", "--trials", "1", "--json")


class BareDebian:
    """A Debian with only Python and pip, in a folder; kept for the next check.

    The programs of another machine's architecture run in qemu, which the kernel starts for them.
    """

    def __init__(self, folder: Path, suite: str, mirror: str, machine: str) -> None:
        self.folder, self.emulated = folder, machine != platform.machine()
        if os.geteuid() != 0:
            raise CheckError("only root can make and enter a Debian root; run it as root, or in a container")
        if self.emulated and not (BINFMT / f"qemu-{machine}").exists():
            settings, register = f"/usr/lib/binfmt.d/qemu-{machine}.conf", BINFMT / "register"
            raise CheckError(
                f"the kernel does not run programs of {machine}; install qemu-user-static, and where systemd "
                f"does not run, write the line of {settings} to {register}"
            )
        if not (folder / "usr/bin/pip3").exists():
            packages = "python3,python3-pip,ca-certificates"
            options = ["--variant=minbase", f"--arch={debian_architecture(machine)}", f"--include={packages}"]
            run(["debootstrap", *options, suite, str(folder), mirror])

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
    block = re.search(r"^```python\n(.*?)^```", (ROOT / "README.md").read_text(), flags=re.MULTILINE | re.DOTALL)
    assert block is not None
    return block[1]


def check_install(dist: Path, debian: BareDebian) -> None:
    """Install both wheels in a bare Debian, and use them."""
    own, data = wheels(dist)
    download(own, data, debian, debian.folder / "wheels")
    pip = ("python3", "-m", "pip")
    # Debian wants a virtual environment; in a root that nobody else uses there is nothing to protect.
    debian.run(*pip, "uninstall", "--quiet", "--yes", "--break-system-packages", "graspbox", "graspbox-policies")
    options = ("install", "--quiet", "--break-system-packages", "--no-index", "--find-links", "/wheels")
    debian.run(*pip, *options, "graspbox", "graspbox-policies")
    installed = debian.run("python3", "-c", "import graspbox; print(graspbox.__version__)").strip()
    if installed != version():
        raise CheckError(f"graspbox.__version__ is {installed}; the wheel is of {version()}")
    print(f"installed graspbox {installed} in {debian.run('cat', '/etc/debian_version').strip()}")
    print(f"the first example of README.md printed {debian.run('python3', '-c', first_example()).strip()}")
    begun = time.perf_counter()
    result = json.loads(debian.run(*_EVALUATE))
    seconds = time.perf_counter() - begun
    print(f"{' '.join(_EVALUATE)}: {result['succeeded']} of {result['trials']} in {seconds:.1f} s")
    longest = LONGEST * (EMULATED if debian.emulated else 1)
    if result["trials"] != 1 or seconds > longest:
        raise CheckError(f"one trial is to take at most {longest:.0f} s")
