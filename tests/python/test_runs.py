"""Run directories: one process at a time, resumed only with the same settings, stages with their time and results."""

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from graspbox._common.runs import Rows, Run, read_settings, refuse_changes
from graspbox.errors import ConfigError


def test_a_refusal_names_the_first_three_differences_and_what_to_do() -> None:
    before = {"seed": 0, "sizes": {"rounds": 6, "width": 48}, "objects": ("ycb",), "hand": "reflex"}
    refuse_changes("out/run", before, {**before, "objects": ["ycb"]})
    now = {**before, "seed": 1, "sizes": {"rounds": 5, "width": 48, "depth": 2}, "objects": []}
    with pytest.raises(ConfigError) as refused:
        refuse_changes("out/run", before, now, "give another file")
    assert str(refused.value) == (
        "'out/run' was begun with other settings: seed was 0, is now 1; sizes.rounds was 6, is now 5; "
        "sizes.depth was absent, is now 2; and 1 more; give another file"
    )
    with pytest.raises(ConfigError, match=r"hand was 'reflex', is now absent; name another folder"):
        refuse_changes("out/run", before, {key: value for key, value in before.items() if key != "hand"})


def test_a_run_is_continued_with_the_same_settings_alone(tmp_path: Path) -> None:
    with Run(tmp_path, {"seed": 0, "objects": ("ycb",)}) as run:
        run.log("nothing was made yet")
    # A run in which nothing was made may still change its settings.
    with Run(tmp_path, {"seed": 1}, resume=False) as run:
        run.rows("results").append({"a": 1})
    assert read_settings(tmp_path) == {"seed": 1}
    with pytest.raises(ConfigError, match="seed was 1, is now 2; name another folder"), Run(tmp_path, {"seed": 2}):
        pass
    with (
        pytest.raises(ConfigError, match="holds a run; resume it, or name another folder"),
        Run(tmp_path, {"seed": 1}, resume=False),
    ):
        pass
    with Run(tmp_path, {"seed": 1}) as run:
        assert run.rows("results") == [{"a": 1}]
    with pytest.raises(ConfigError, match="there is no run in"):
        read_settings(tmp_path / "none")


def test_a_run_grows(tmp_path: Path) -> None:
    """With more rounds, what follows them is done again; its earlier results move aside. Fewer rounds are refused."""
    growing = {"sizes.rounds": ("evaluate*", "export*")}

    def go(rounds: int, seed: int = 0) -> list[str]:
        made: list[str] = []

        def work(stage: Run) -> dict[str, Any]:
            made.append(stage.folder.name)
            (stage.folder / "file").write_text(stage.folder.name)
            return {"rounds": rounds}

        with Run(tmp_path, {"seed": seed, "sizes": {"rounds": rounds}}, growing=growing) as run:
            for name in (*(f"round-{n}" for n in range(rounds)), "export", "evaluate-all"):
                run.stage(name, 60.0, work)
        return made

    assert go(2) == ["round-0", "round-1", "export", "evaluate-all"]
    with pytest.raises(ConfigError, match="seed was 0, is now 1; name another folder"):
        go(3, seed=1)
    assert go(2) == []
    assert go(4) == ["round-2", "round-3", "export", "evaluate-all"]
    aside = tmp_path / "with-2-rounds"
    assert {path.name for path in aside.iterdir()} == {"export", "export.json", "evaluate-all", "evaluate-all.json"}
    assert json.loads((aside / "export.json").read_text())["rounds"] == 2
    assert json.loads((tmp_path / "export.json").read_text())["rounds"] == 4
    with pytest.raises(ConfigError, match=r"sizes.rounds was 4, is now 3"):
        go(3)
    assert go(4) == []


def test_other_settings_start_another_clock(tmp_path: Path) -> None:
    """As long as nothing was made, a run may change its settings; the time taken was that of the old ones."""
    for seed, before in ((0, 0.0), (0, 500.0), (1, 0.0)):
        with Run(tmp_path, {"seed": seed}) as run:
            assert before <= run.seconds < before + 400.0
        (tmp_path / "clock.json").write_text("500.0\n")


def test_two_processes_do_not_work_in_one_directory(tmp_path: Path) -> None:
    other = "import sys; from graspbox._common.runs import Run\nwith Run(sys.argv[1], {}): print('in')"
    command = [sys.executable, "-c", other, str(tmp_path)]
    with Run(tmp_path, {}), pytest.raises(ConfigError, match="another process is writing"), Run(tmp_path, {}):
        pass
    with Run(tmp_path, {}):
        refused = subprocess.run(command, capture_output=True, text=True, check=False)
        assert refused.returncode == 1
        assert "another process is writing into" in refused.stderr
    assert subprocess.run(command, capture_output=True, text=True, check=True).stdout == "in\n"


def test_rows_continue_after_a_line_that_was_cut_off(tmp_path: Path) -> None:
    path = tmp_path / "rows.jsonl"
    rows = Rows(path)
    for name in "abc":
        rows.append({"name": name})
    path.write_bytes(path.read_bytes()[:-4])
    again = Rows(path)
    assert again == [{"name": "a"}, {"name": "b"}]
    again.append({"name": "d"})
    again.keep(lambda row: row["name"] != "b")
    assert Rows(path) == again == [{"name": "a"}, {"name": "d"}]


@pytest.mark.parametrize("content", ["hello\n", "[1]\n", "3\n"])
def test_a_file_that_holds_no_rows_is_left_alone(tmp_path: Path, content: str) -> None:
    path = tmp_path / "precious.txt"
    path.write_text(content)
    with pytest.raises(ConfigError, match="has no rows of a run"):
        Rows(path)
    assert path.read_text() == content


def test_no_time_left_is_told_before_it_is_known(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """What came before the first steps of a training made hundreds of hours of the first time left."""
    clock, lines = [0.0], []
    monkeypatch.setattr("graspbox._common.runs.time.monotonic", lambda: clock[0])
    with Run(tmp_path, {"seed": 0}, echo=lambda line: lines.append(line.partition("; ")[2])) as run:

        def after(seconds: float, share: float) -> str:
            clock[0] += seconds
            run.report("so far", share)
            return lines[-1]

        # Four minutes of other work, at the same pace all the time.
        assert after(0.0, 0.0) == "0:00:00 taken"
        assert after(20.0, 0.05) == "0:00:20 taken"
        assert after(20.0, 0.1) == "0:00:40 taken, 0:06:00 left"
        assert after(200.0, 0.6).endswith("0:02:40 left")
        # Then 1,000 seconds of steps.
        assert after(10.0, 0.0001) == "0:04:10 taken"
        assert after(10.0, 0.01) == "0:04:20 taken"
        assert after(10.0, 0.02) == "0:04:30 taken, 0:16:20 left"
        # What has become slower: the last lines count.
        for share in (0.03, 0.031, 0.032, 0.033, 0.034, 0.035):
            after(10.0, share)
        assert lines[-1] == "0:05:30 taken, 2:40:50 left"


def test_stages_keep_their_time_and_results(tmp_path: Path) -> None:
    lines: list[str] = []

    def late(stage: Run) -> dict[str, Any]:
        assert stage.late()
        return {"found": (1, 2)}

    with Run(tmp_path, {"seed": 0}, echo=lines.append) as run:
        assert run.stage("late", 0.0, late)["found"] == [1, 2]
    with Run(tmp_path, {"seed": 0}, echo=lines.append) as run:
        assert run.stage("late", 9.0, late)["found"] == [1, 2]
        assert any("late: done by an earlier run" in line for line in lines)
        (tmp_path / "long").mkdir()
        (tmp_path / "long" / "clock.json").write_text("100.0\n")

        def long(stage: Run) -> dict[str, Any]:
            assert stage.seconds >= 100.0
            stage.report("half of it", 0.5)
            assert float((stage.folder / "clock.json").read_text()) >= 100.0
            return {}

        assert run.stage("long", 150.0, long)["seconds"] >= 100.0
    assert any("long: half of it; 0:01:40 taken, 0:00:50 left" in line for line in lines)
    assert (tmp_path / "log.txt").read_text().splitlines() == lines
    assert set(json.loads((tmp_path / "late.json").read_text())) == {"seconds", "found"}
