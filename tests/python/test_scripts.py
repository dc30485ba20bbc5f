"""The programs in ``scripts``: their results, and that they resume after an interruption."""

import json
import os
import re
import subprocess
import sys
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from graspbox.errors import ConfigError
from program_files import imported

typer = pytest.importorskip("typer", reason="the scripts need typer, from the extra 'cli'")
SCRIPTS = Path(__file__).parents[2] / "scripts"


def script(name: str) -> ModuleType:
    """Import a program without running it."""
    return imported(SCRIPTS / f"{name}.py")


def test_the_fit_finds_the_weights_that_made_the_labels() -> None:
    """Labels drawn from known weights, and an intercept of each object's own; a feature that says nothing gets 0."""
    fit = script("fit_ranking")
    random = np.random.default_rng(0)
    objects = np.repeat(np.arange(80), 60)
    features = random.normal(size=(len(objects), 4)) * [1.0, 3.0, 0.2, 0.0]
    weights = np.array([1.0, -0.5, 2.0, 0.0])
    odds = features @ weights + random.normal(size=80)[objects]
    success = (random.random(len(objects)) < 1.0 / (1.0 + np.exp(-odds))).astype(float)
    found = fit.fit(features, success, objects, 1.0)
    np.testing.assert_allclose(found, weights, atol=0.2)
    assert found[3] == 0.0
    held_out = fit.judge(fit.held_out(features, success, objects, 1.0, 0), success, objects)
    exact = fit.judge(features @ weights, success, objects)
    assert held_out["pairs"] == pytest.approx(exact["pairs"], abs=0.02)
    assert fit.judge(np.zeros(len(success)), success, objects)["pairs"] == 0.5


def test_the_fit_tries_no_object_twice(tmp_path: Path) -> None:
    fit = script("fit_ranking")
    log = tmp_path / "ranking" / "objects.jsonl"

    def run() -> list[str]:
        """Two objects are too few to fit, which is said when they have been tried: the log keeps them."""
        with pytest.raises(ConfigError, match="objects have successes and failures; it takes 6 to fit"):
            fit.main(out=log.parent, objects="procedural:box:0-2", top=2, others=3, ridge=8.0, seed=0)
        return log.read_text().splitlines()

    lines = run()
    assert len(lines) > 1
    row = json.loads(lines[0])
    assert len(row["features"]) == len(row["success"]) == len(row["rank"]) == 5
    assert row["rank"][:2] == [0, 1]
    assert run() == lines
    # One that is missing is tried, and comes out as before.
    log.write_text("\n".join(lines[:-1]) + "\n")
    assert run() == lines


def write_box(path: Path, x: float, y: float, z: float) -> None:
    """Write a box that stands on the table as an OFF file."""
    corners = [f"{i * x} {j * y} {k * z}" for i in (0, 1) for j in (0, 1) for k in (0, 1)]
    sides = ["0 1 3 2", "4 6 7 5", "0 4 5 1", "2 3 7 6", "0 2 6 4", "1 5 7 3"]
    path.write_text("\n".join(["OFF", "8 6 0", *corners, *(f"4 {side}" for side in sides)]) + "\n")


def test_the_sweep_stops_at_a_success_and_says_why_others_leave(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    sweep = script("sweep_graspable")
    monkeypatch.setattr(sweep, "ENOUGH", 12)
    log, names = tmp_path / "run" / "objects.jsonl", tmp_path / "list.txt"
    write_box(tmp_path / "block.off", 0.06, 0.06, 0.12)
    write_box(tmp_path / "board.off", 0.40, 0.40, 0.008)

    def run() -> int:
        with pytest.raises(typer.Exit) as ended:
            sweep.main(out=log.parent, list_file=names, objects=f"dir:{tmp_path}")
        return int(ended.value.exit_code)

    assert run() == 0
    block, board = (json.loads(line) for line in log.read_text().splitlines())
    assert block["graspable"] is True
    assert block["failed"] == sum(block["failures"].values()) < 12
    assert board["graspable"] is False
    assert board["failed"] == sum(board["failures"].values()) == 12
    text = names.read_text()
    assert "\n# board: too flat (8 mm); of 12 poses " in text
    assert [line for line in text.splitlines() if not line.startswith("#")] == ["block"]
    written = log.read_text()
    assert run() == 0
    assert log.read_text() == written


# --- how programs end ------------------------------------------------------------------------------------------------


def with_closed_output(words: list[str]) -> "subprocess.CompletedProcess[str]":
    """Run a program whose output is not read, as by ``head`` after its last line."""
    reader, writer = os.pipe()
    os.close(reader)
    try:
        return subprocess.run([sys.executable, *words], stdout=writer, stderr=subprocess.PIPE, text=True, check=False)
    finally:
        os.close(writer)


@pytest.mark.parametrize("name", ["bench_server.py --help", "plot_sb3.py --help"])
def test_closed_outputs_end_a_program_without_a_word(name: str) -> None:
    program, *words = name.split()
    done = with_closed_output([str(SCRIPTS / program), *words])
    assert done.stderr == ""
    assert done.returncode in (0, 141)


def test_every_program_ends_in_the_same_way() -> None:
    """`run_program` turns errors and closed outputs into an exit status; nothing else is in the last lines.

    A program that does not use the package works without it.
    """
    ends = []
    for path in sorted(SCRIPTS.glob("*.py")):
        text, block, last = path.read_text().partition('if __name__ == "__main__":\n')
        if block and re.search(r"^(from|import) graspbox", text, re.MULTILINE):
            assert re.fullmatch(r"    run_program\(.+\)\n", last), path.name
            ends.append(path.name)
    assert len(ends) > 10


@pytest.mark.parametrize(
    ("body", "status", "stderr"),
    [
        ("return None", 0, ""),
        ("return 3", 3, ""),
        ("raise SystemExit('no such run')", 1, "no such run\n"),
        ("raise KeyboardInterrupt", 130, ""),
        ("raise MemoryError", 1, "graspbox: there is not enough memory\n"),
        ("raise errors.ConfigError('poses is -1')", 2, "graspbox: poses is -1\n"),
        ("raise errors.MeshError('it is flat')", 1, "graspbox: it is flat\n"),
        ("open('/none/x')", 1, "graspbox: No such file or directory: /none/x\n"),
        ("print('\\udcff')", 0, ""),
    ],
)
def test_errors_become_a_line_and_a_status(body: str, status: int, stderr: str) -> None:
    code = f"from graspbox import errors\nfrom graspbox._common.programs import run_program\ndef main():\n    {body}\n"
    command = [sys.executable, "-c", f"{code}run_program(main)"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (status, stderr)
