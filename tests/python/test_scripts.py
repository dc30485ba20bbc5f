"""The programs in ``scripts``: their results, and that they resume after an interruption."""

import json
import subprocess
import sys
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from graspbox.errors import ConfigError
from graspbox.resume_log import ResumeLog
from program_files import imported

typer = pytest.importorskip("typer", reason="the scripts need typer, from the extra 'cli'")
SCRIPTS = Path(__file__).parents[2] / "scripts"


def script(name: str) -> ModuleType:
    """Import a program without running it."""
    return imported(SCRIPTS / f"{name}.py")


def test_a_log_continues_after_a_line_that_was_cut_off(tmp_path: Path) -> None:
    path = tmp_path / "new" / "log.jsonl"
    log = ResumeLog(path, {"poses": 3})
    log.append({"name": "a"})
    log.append({"name": "b"})
    path.write_bytes(path.read_bytes()[:-4])
    again = ResumeLog(path, {"poses": 3})
    assert again.rows == [{"name": "a"}]
    again.append({"name": "c"})
    assert ResumeLog(path, {"poses": 3}).rows == [{"name": "a"}, {"name": "c"}]
    with pytest.raises(ConfigError, match=r"begun with other settings: poses was 3, is now 4; name another file"):
        ResumeLog(path, {"poses": 4})
    with pytest.raises(ConfigError, match=r"poses was 3, is now absent; env\.obs was absent, is now 'rgb'"):
        ResumeLog(path, {"env": {"obs": "rgb"}})


def test_two_processes_do_not_write_into_one_log(tmp_path: Path) -> None:
    path = tmp_path / "log.jsonl"
    log = ResumeLog(path, {})
    other = "import sys; from graspbox.resume_log import ResumeLog; ResumeLog(sys.argv[1], {}).append({'name': 'b'})"
    command = [sys.executable, "-c", other, str(path)]
    refused = subprocess.run(command, capture_output=True, text=True, check=False)
    assert refused.returncode == 1
    assert "another process is writing into" in refused.stderr
    log.append({"name": "a"})
    assert ResumeLog(path, {}).rows == [{"name": "a"}]


@pytest.mark.parametrize("content", ["hello\n", "[1]\n", '{"name": "a"}\n'])
def test_a_file_that_is_no_log_is_left_alone(tmp_path: Path, content: str) -> None:
    path = tmp_path / "precious.txt"
    path.write_text(content)
    with pytest.raises(ConfigError, match="not a log of this program"):
        ResumeLog(path, {})
    assert path.read_text() == content


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
    truth = fit.judge(features @ weights, success, objects)
    assert held_out["pairs"] == pytest.approx(truth["pairs"], abs=0.02)
    assert fit.judge(np.zeros(len(success)), success, objects)["pairs"] == 0.5


def test_the_fit_tries_no_object_twice(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    fit = script("fit_ranking")
    log = tmp_path / "ranking.jsonl"

    def run() -> list[str]:
        """Two objects are too few to fit, which is said when they have been tried: the log keeps them."""
        with pytest.raises(typer.Exit):
            fit.main(log=log, objects="procedural:box:0-2", top=2, others=3, ridge=8.0, seed=0, as_json=True)
        assert "objects have successes and failures; it takes 6 to fit" in capsys.readouterr().err
        return log.read_text().splitlines()

    lines = run()
    assert len(lines) > 1
    row = json.loads(lines[1])
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
    log, names = tmp_path / "log.jsonl", tmp_path / "list.txt"
    write_box(tmp_path / "block.off", 0.06, 0.06, 0.12)
    write_box(tmp_path / "board.off", 0.40, 0.40, 0.008)

    def run() -> int:
        with pytest.raises(typer.Exit) as ended:
            sweep.main(log=log, list_file=names, objects=f"dir:{tmp_path}", as_json=False)
        return int(ended.value.exit_code)

    assert run() == 0
    block, board = (json.loads(line) for line in log.read_text().splitlines()[1:])
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
