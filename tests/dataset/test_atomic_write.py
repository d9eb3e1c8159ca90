"""Files that are written together: all are new or none, and nothing is left over."""

from __future__ import annotations

import os
import tempfile
from pathlib import Path
from typing import Any

import pytest

from calib.dataset.files.atomic_write import new_folder, write_all_atomically
from calib.errors import DatasetError


def test_no_file_of_a_set_is_changed_where_one_cannot_be_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    first, second = tmp_path / "robot.toml", tmp_path / "model.json"
    first.write_text("old")
    made = tempfile.mkstemp
    asked: list[str] = []

    def full_at_the_second(**given: Any) -> tuple[int, str]:
        asked.append(given["prefix"])
        if len(asked) == 2:
            raise OSError(28, "No space left on device")
        return made(**given)

    monkeypatch.setattr(tempfile, "mkstemp", full_at_the_second)
    with pytest.raises(DatasetError, match=r"model\.json: cannot be written \(No space left on device\)"):
        write_all_atomically({first: "new", second: b"new"})
    assert first.read_text() == "old"
    assert list(tmp_path.iterdir()) == [first]

    write_all_atomically({first: "new", second: b"newer"})
    assert (first.read_text(), second.read_text()) == ("new", "newer")


def test_what_a_killed_writer_left_is_removed_by_the_next_one(tmp_path: Path) -> None:
    old, young, folder = (tmp_path / f".{name}.part" for name in ("points.csv.abc", "points.csv.def", "cell.abc"))
    for left in (old, young, folder / "half"):
        left.parent.mkdir(exist_ok=True)
        left.write_text("half")
    for left in (old, folder):
        os.utime(left, (1e9, 1e9))
    write_all_atomically({tmp_path / "points.csv": "whole"})
    with new_folder(tmp_path / "cell") as made:
        made.mkdir()
    assert sorted(path.name for path in tmp_path.iterdir()) == [young.name, "cell", "points.csv"]
