"""CSV as people and spreadsheets write it: what is read, and one-line errors with the place."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from calib.dataset.files.csv_table import TableFile
from calib.errors import DatasetError


def table(folder: Path, content: str | bytes) -> TableFile:
    path = folder / "t.csv"
    path.write_bytes(content.encode() if isinstance(content, str) else content)
    return TableFile.load(path)


@pytest.mark.parametrize(
    "content",
    [
        "pose,a,b\np1,1,2\np2,3,4\n",
        "\ufeffpose,a,b\r\np1,1,2\r\np2,3,4\r\n",
        "pose, a, b\n\np1, 1, 2\n\n\np2, 3, 4",
        '"pose","a","b"\n"p1","1","2"\n"p2","3","4"\n',
        "pose,a,b,,\np1,1,2,,\np2,3,4,,\n",
        "pose,a,b\np1,1,2,\np2,3,4\n",
        'pose,"a\n",b\np1,1,2\np2,3,4\n',
    ],
)
def test_what_spreadsheets_write(tmp_path: Path, content: str) -> None:
    file = table(tmp_path, content)
    assert file.text("pose") == ["p1", "p2"]
    np.testing.assert_array_equal(file.numbers(["b", "a"]), [[2, 1], [4, 3]])


@pytest.mark.parametrize(
    ("content", "said"),
    [
        ("", "empty"),
        ("\n,,\n", "empty"),
        ("pose,a\np1,1\np2,1,5\n", "line 3: found 3 cells, the header names 2"),
        ("pose,a\np1,1\np2\n", "line 3, column a: the cell is empty"),
        ("pose,a\np1,1,5\n", "line 2: found 3 cells"),
        ("pose,a\np1,one\n", "line 2, column a: found 'one'; a number"),
        ("pose,a\np1,1\np2,inf\n", "line 3, column a: found 'inf'; a finite"),
        ("pose,b\np1,1\n", "missing column a; found pose, b"),
        ("pose;a\np1;1\n", "separated by semicolons; separate them by commas"),
        ("pose;a\np1;1,5\n", "separated by semicolons; separate them by commas"),
        ("pose\ta\np1\t1\n", "separated by tabs; separate them by commas"),
        ("pose,a\n\n\np1,1\n\np2,one\n", "line 6, column a: found 'one'"),
        ('pose,a,b\np1,1,"two\nlines"\np2,one,\n', "line 4, column a: found 'one'"),
        ("pose,a,a\np1,1,1\n", "column 'a' stands there twice"),
        ("," * 200_000 + "a\n", "line 1: found 200001 columns; a table has at most 2000"),
        ("," * 1000 + "a\n", "column '' stands there twice"),
        (b"pose,a\n\xff\xfe,1\n", "save it as UTF-8"),
        ("pose,a\np1," + "1" * 200_000, "cannot be read as CSV"),
    ],
)
def test_what_is_wrong_is_one_line(tmp_path: Path, content: str | bytes, said: str) -> None:
    def read() -> None:
        file = table(tmp_path, content)
        file.require(["pose", "a"])
        file.numbers(["a"])

    with pytest.raises(DatasetError) as caught:
        read()
    assert said in str(caught.value)
    assert str(tmp_path / "t.csv") in str(caught.value)
    assert "\n" not in str(caught.value)


@settings(deadline=None, max_examples=60, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(rows=st.lists(st.lists(st.floats(allow_nan=False, allow_infinity=False), min_size=3, max_size=3), max_size=5))
def test_numbers_are_read_back_to_the_bit(tmp_path: Path, rows: list[list[float]]) -> None:
    text = "x,y,z\n" + "".join(",".join(map(repr, row)) + "\n" for row in rows)
    np.testing.assert_array_equal(table(tmp_path, text).numbers(["x", "y", "z"]), np.array(rows).reshape(-1, 3))
