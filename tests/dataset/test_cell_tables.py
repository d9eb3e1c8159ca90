"""Reading and writing of [cell] and of the field in [scanner], and errors that name file, key and remedy."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from calib.dataset.dataset import Box, Surroundings
from calib.dataset.files.folder import load_dataset, write_dataset
from calib.errors import DatasetError
from tests.support.arms import dataset_of, jang_arm

CELL = """
[cell]
floor_z_mm = -12.5
least_manipulability = 0.05
wall = "painted"

[[cell.boxes]]
name = "table"
min_mm = [300.0, -400.0, -500.0]
max_mm = [900.0, 400.0, -10.0]

[[cell.boxes]]
min_mm = [0, 0, 1500]
max_mm = [1, 1, 1501]
"""
FIELD = "[scanner]\nfield_mm = [450, 360, 280]\ndistance_mm = 700\nmax_incidence_deg = 65\n"
SMOOTH = "correlated_sigma_mm = 0.06\ncorrelation_length_mm = 30\nregistration_sigma_mm = 0.03\n"


def folder_with(tmp_path: Path, text: str) -> Path:
    robot = jang_arm()
    write_dataset(dataset_of(robot, robot, np.random.default_rng(0), poses=6, test=1), tmp_path)
    file = tmp_path / "dataset.toml"
    kept = file.read_text("utf-8").partition("[scanner]")[0]
    file.write_text(kept + text, "utf-8")
    return tmp_path


def test_what_the_file_tells_is_read_and_written_again(tmp_path: Path) -> None:
    read = load_dataset(folder_with(tmp_path / "a", FIELD + SMOOTH + CELL))
    table = Box("table", (300.0, -400.0, -500.0), (900.0, 400.0, -10.0))
    nameless = Box("box 2", (0.0, 0.0, 1500.0), (1.0, 1.0, 1501.0))
    assert read.surroundings == Surroundings(-12.5, (table, nameless), 0.05, {"wall": "painted"})
    assert read.scanner.field_mm == (450.0, 360.0, 280.0)
    assert (read.scanner.distance_mm, read.scanner.max_incidence_deg) == (700.0, 65.0)
    assert (read.scanner.correlated_sigma_mm, read.scanner.correlation_length_mm) == (0.06, 30.0)
    assert read.scanner.registration_sigma_mm == 0.03
    write_dataset(read, tmp_path / "b")
    again = load_dataset(tmp_path / "b")
    assert (again.surroundings, again.scanner) == (read.surroundings, read.scanner)
    bare = load_dataset(folder_with(tmp_path / "c", ""))
    assert bare.surroundings == Surroundings()


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("[cell]\nfloor_z_mm = 'low'", r"\[cell\].floor_z_mm: found 'low'; a finite number"),
        ("[cell]\nfloor_z_mm = 1e9", r"floor_z_mm: found 1e\+09; a height within"),
        ("[[cell.boxes]]\nmin_mm = [0, 0, 0]", r"\[\[boxes\]\] 1.max_mm: the key is missing; add"),
        ("[[cell.boxes]]\nmin_mm = [0, 0, 5]\nmax_mm = [1, 1, 2]", r"max_mm: found z 2, and min_mm has 5"),
        ("[[cell.boxes]]\nmin_mm = [0, 0]\nmax_mm = [1, 1, 2]", r"min_mm: .* three finite numbers"),
        ("[[cell.boxes]]\nmin_mm = [0, 0, 0]\nmax_mm = [1, 1, 1e7]", r"max_mm: .* within 100000 mm"),
        (
            "[[cell.boxes]]\nsize_mm = 3\nmin_mm = [0, 0, 0]\nmax_mm = [1, 1, 1]",
            r"size_mm: is no key of a box",
        ),
        ("[[cell.boxes]]\nname = 'a'\nmin_mm = [0, 0, 0]\nmax_mm = [1, 1, 1]\n" * 2, r"'a' more than once"),
        ("[cell]\nboxes = 3", r"boxes: found no array of tables"),
        ("[cell]\nleast_manipulability = 1.5", r"least_manipulability: found 1.5; 0 \(off\) to below 1"),
        ("cell = 3", r"found 3; a table headed \[cell\]"),
        (
            "[scanner]\nfield_mm = [450, 360, 280]",
            r"\[scanner\].distance_mm: the key is missing; give field_mm",
        ),
        ("[scanner]\nfield_mm = [450, -1, 280]\ndistance_mm = 700", r"field_mm: .* above 0"),
        ("[scanner]\nfield_mm = [450, 360, 2800]\ndistance_mm = 700", r"half the depth is less"),
        (
            "[scanner]\ncorrelated_sigma_mm = 0.06",
            r"\[scanner\].correlation_length_mm: the key is missing; give",
        ),
        (
            "[scanner]\ncorrelation_length_mm = 30",
            r"\[scanner\].correlated_sigma_mm: the key is missing; give",
        ),
        (
            "[scanner]\ncorrelated_sigma_mm = 0.06\ncorrelation_length_mm = 1e6",
            r"correlation_length_mm: found 1e\+06; a length between 0.01 and 100000 mm",
        ),
        ("[scanner]\nmax_incidence_deg = 95", r"max_incidence_deg: found 95; an angle below 90"),
    ],
)
def test_what_cannot_be_is_refused_with_its_place(tmp_path: Path, text: str, said: str) -> None:
    with pytest.raises(DatasetError, match=said) as error:
        load_dataset(folder_with(tmp_path, text))
    assert "dataset.toml" in str(error.value)


def test_a_key_that_is_not_used_is_told_with_the_one_that_is(tmp_path: Path) -> None:
    notes = load_dataset(folder_with(tmp_path, "[scanner]\nnoise_mm = 0.02\n")).notes
    assert any("[scanner] noise_mm is no key" in note and note.endswith("point_sigma_mm") for note in notes)
