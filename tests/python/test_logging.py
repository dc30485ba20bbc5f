"""Log events of the core reach Python's logging, from the thread that made the call."""

import logging
import os
import subprocess
import sys
from pathlib import Path

import pytest

import graspbox
from graspbox import object_sets
from graspbox._common.programs import run_program


def scanned() -> graspbox.Mesh:
    """Load a mesh whose convex parts are cached; a fresh one each time, since a mesh keeps its parts."""
    mesh = object_sets.load("procedural:mug:0")[0].load()
    return graspbox.mesh_from_arrays(mesh.vertices, mesh.faces, name="mug")


def test_damaged_cache_files_are_logged(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setenv("GRASPBOX_CACHE", str(tmp_path))
    with caplog.at_level(logging.INFO, logger="graspbox"):
        graspbox.Scene(scanned())
        assert caplog.records == []
        (parts,) = (path for path in tmp_path.rglob("*") if path.is_file())
        parts.write_bytes(b"damaged")
        graspbox.Scene(scanned())
    (record,) = caplog.records
    assert (record.name, record.levelno) == ("graspbox", logging.WARNING)
    assert str(parts) in record.getMessage()


def test_a_broken_handler_does_not_stop_the_call(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    class Broken(logging.Filter):
        def filter(self, record: logging.LogRecord) -> bool:
            raise RuntimeError("broken filter")

    monkeypatch.setenv("GRASPBOX_CACHE", str(tmp_path))
    graspbox.Scene(scanned())
    (parts,) = (path for path in tmp_path.rglob("*") if path.is_file())
    parts.write_bytes(b"damaged")
    logger, broken = logging.getLogger("graspbox"), Broken()
    logger.addFilter(broken)
    seen: list[object] = []
    monkeypatch.setattr("sys.unraisablehook", seen.append)
    try:
        assert graspbox.Scene(scanned()).name == "mug"
    finally:
        logger.removeFilter(broken)
    assert len(seen) == 1


@pytest.mark.parametrize("handled", [False, True])
def test_a_program_prints_a_warning_once(handled: bool, capsys: pytest.CaptureFixture[str]) -> None:
    """Unless it sets logging up itself."""
    seen: list[logging.LogRecord] = []
    handler = logging.Handler()
    handler.emit = seen.append  # type: ignore[assignment, method-assign]

    def main() -> None:
        for _ in range(2):
            logging.getLogger("graspbox.part").warning("the mesh\nis open")
        logging.getLogger("graspbox.part").info("it is grey")

    # pytest has handlers of its own.
    root = logging.getLogger()
    before, root.handlers = root.handlers, [handler] if handled else []
    try:
        with pytest.raises(SystemExit):
            run_program(main)
    finally:
        root.handlers = before
    assert capsys.readouterr().err == ("" if handled else "graspbox: the mesh is open\n")
    assert len(seen) == 2 * handled


@pytest.mark.parametrize("handled", [False, True])
def test_nothing_is_printed_without_a_handler(tmp_path: Path, handled: bool) -> None:
    """A program that sets no logging up is not disturbed by a warning; one that does sees it."""
    code = (
        "import logging, sys, pathlib; sys.path.insert(0, sys.argv[1])\n"
        "import graspbox; from test_logging import scanned\n"
        f"if {handled}: logging.basicConfig(level=logging.WARNING)\n"
        "graspbox.Scene(scanned())\n"
        "(parts,) = (path for path in pathlib.Path(sys.argv[2]).rglob('*') if path.is_file())\n"
        "parts.write_bytes(b'damaged')\n"
        "graspbox.Scene(scanned())\n"
    )
    command = [sys.executable, "-c", code, str(Path(__file__).parent), str(tmp_path)]
    env = {**os.environ, "GRASPBOX_CACHE": str(tmp_path)}
    done = subprocess.run(command, capture_output=True, text=True, check=True, env=env)
    assert done.stdout == ""
    assert ("WARNING:graspbox:" in done.stderr) == handled
    assert handled or done.stderr == ""
