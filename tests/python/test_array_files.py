"""Tables of arrays in files: saving, joining, resuming."""

import threading
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import numpy as np
import pytest
from numpy.typing import NDArray

from graspbox.errors import ConfigError
from graspbox.learn.training.array_files import ArrayTable, load_or_make_parts


@dataclass(frozen=True, eq=False)
class Marks(ArrayTable):
    """Two columns."""

    mark: NDArray[np.float64]
    right: NDArray[np.bool_]

    stored_names: ClassVar = {"right": "correct"}
    nothing = "there are no marks"


def marks(*numbers: float) -> Marks:
    return Marks(np.array(numbers), np.array(numbers) > 1.0)


def test_a_table_is_read_as_it_was_written(tmp_path: Path) -> None:
    marks(0.5, 2.0).save(tmp_path / "marks.npz")
    read = Marks.load(tmp_path / "marks.npz")
    assert len(read) == 2
    np.testing.assert_array_equal(read.mark, [0.5, 2.0])
    np.testing.assert_array_equal(read.right, [False, True])
    assert [path.name for path in tmp_path.iterdir()] == ["marks.npz"]
    with np.load(tmp_path / "marks.npz") as stored:
        assert stored.files == ["mark", "correct"]


def test_tables_are_put_together_and_none_is_refused() -> None:
    np.testing.assert_array_equal(Marks.joined([marks(1.0), marks(), marks(3.0, 2.0)]).mark, [1.0, 3.0, 2.0])
    with pytest.raises(ConfigError, match="there are no marks"):
        Marks.joined([marks(), marks()])


def test_parts_are_made_once_and_a_stop_leaves_the_rest(tmp_path: Path) -> None:
    made: list[int] = []

    def make(number: int) -> Marks:
        made.append(number)
        return marks(float(number))

    first = load_or_make_parts(Marks, tmp_path / "parts", range(5), make, stop=lambda: len(made) == 2)
    np.testing.assert_array_equal(first.mark, [0.0, 1.0])
    seen: list[int] = []
    whole = load_or_make_parts(Marks, tmp_path / "parts", range(5), make, progress=seen.append)
    np.testing.assert_array_equal(whole.mark, [0.0, 1.0, 2.0, 3.0, 4.0])
    assert made == [0, 1, 2, 3, 4]
    assert seen == [1, 2, 3, 4, 5]


def test_a_part_that_fails_leaves_no_file(tmp_path: Path) -> None:
    def make(number: int) -> Marks:
        if number == 1:
            raise KeyboardInterrupt
        return marks(float(number))

    with pytest.raises(KeyboardInterrupt):
        load_or_make_parts(Marks, tmp_path, range(3), make)
    assert [path.name for path in tmp_path.iterdir()] == ["0000000.npz"]


def test_parts_are_made_at_once_and_joined_in_order(tmp_path: Path) -> None:
    together = threading.Barrier(3, timeout=60)

    def make(number: int) -> Marks:
        together.wait()
        return marks(float(number))

    seen: list[int] = []
    whole = load_or_make_parts(Marks, tmp_path, range(6), make, workers=3, progress=seen.append)
    np.testing.assert_array_equal(whole.mark, [0.0, 1.0, 2.0, 3.0, 4.0, 5.0])
    assert seen == [1, 2, 3, 4, 5, 6]


def test_parts_that_were_begun_are_finished_when_one_fails(tmp_path: Path) -> None:
    together = threading.Barrier(2, timeout=60)

    def make(number: int) -> Marks:
        together.wait()
        if number == 0:
            raise ConfigError("no scene")
        return marks(float(number))

    with pytest.raises(ConfigError, match="no scene"):
        load_or_make_parts(Marks, tmp_path, range(2), make, workers=2)
    assert [path.name for path in tmp_path.iterdir()] == ["0000001.npz"]
