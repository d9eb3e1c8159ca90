"""Lengths of draw wires from anchors of unknown place: the arm in MuJoCo that they were measured on is found."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from calib import calibrate
from calib.calibration.promise import promise
from calib.dataset.dataset import Dataset
from calib.dataset.files.folder import load_dataset, write_dataset
from calib.effects.catalogue.loads import JointCompliance
from calib.errors import CalibError, DatasetError, FitError
from calib.options import FitOptions
from calib.planning.start import start_of_dataset
from tests.support.mujoco_arm import mujoco
from tests.support.signal_cell import COMPLIANCE, Measured, measured, write

NOISE_MM = 0.03
ANCHORS_MM = np.array([[1500.0, -700.0, 300.0], [-900.0, 1200.0, 100.0], [300.0, -300.0, 1900.0]])


def with_lengths(folder: Path, cell: Measured, anchors: int) -> Dataset:
    """The cell measured by draw wires, with the lines of points.csv in place of points."""
    write(folder, cell, {}, NOISE_MM, masses=True)
    rng = np.random.default_rng(5)
    lines = ["pose,anchor,length_mm"]
    for i, point_mm in enumerate(cell.point_mm):
        for k, anchor_mm in enumerate(ANCHORS_MM[:anchors]):
            length_mm = np.linalg.norm(point_mm - anchor_mm) + NOISE_MM * rng.normal()
            lines.append(f"P{i:03d},wire {k + 1},{length_mm:.6f}")
    (folder / "points.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")
    return load_dataset(folder)


@pytest.fixture(scope="module")
def one_wire(tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    mujoco()
    return with_lengths(tmp_path_factory.mktemp("wire") / "cell", measured(150), 1)


@pytest.mark.slow
@pytest.mark.parametrize(("poses", "anchors"), [pytest.param(150, 1, marks=pytest.mark.thorough), (70, 3)])
def test_compliance_and_anchors_are_found_from_lengths(tmp_path: Path, poses: int, anchors: int) -> None:
    mujoco()
    dataset = with_lengths(tmp_path / "cell", measured(poses), anchors)
    fit = calibrate(dataset, effects=[JointCompliance(1), JointCompliance(2)])
    found = fit.fit.by_name
    for joint, truth in COMPLIANCE.items():
        value, sigma = found[f"joint_compliance.J{joint + 1}.c_rad_per_nm"]
        assert abs(value - truth) < 3.5 * sigma
        assert sigma < 0.03 * truth
    assert fit.fit.rows == sum(not is_test for is_test in dataset.poses.is_test) * anchors
    assert 0.7 * NOISE_MM < fit.sigma_mm < 1.2 * NOISE_MM
    assert fit.after.test.rmse_mm < 1.5 * NOISE_MM
    assert 0.75 < (promise(fit).coverage_90 or 0.0) <= 1.0
    for k, anchor_mm in enumerate(ANCHORS_MM[:anchors]):  # but for a turn of the whole cell, which no length shows
        base_mm = -fit.after.scanner_T_base[f"wire {k + 1}"][:3, 3]
        assert np.linalg.norm(base_mm) == pytest.approx(np.linalg.norm(anchor_mm), abs=15.0)


@pytest.mark.slow
def test_the_error_as_delivered_does_not_depend_on_what_was_fitted(one_wire: Dataset) -> None:
    plain, soft = calibrate(one_wire), calibrate(one_wire, effects="joint_compliance")
    assert plain.before.test.rmse_mm == pytest.approx(soft.before.test.rmse_mm, rel=1e-6)


@pytest.mark.thorough
def test_an_anchor_of_known_place_stays_there_and_tells_where_the_base_is(one_wire: Dataset, tmp_path: Path) -> None:
    write_dataset(one_wire, tmp_path / "cell")
    path = tmp_path / "cell" / "dataset.toml"
    x, y, z = ANCHORS_MM[0].tolist()
    known = f'\n[[anchors]]\nname = "wire 1"\nxyz_mm = [{x}, {y}, {z}]\n'
    path.write_text(path.read_text(encoding="utf-8") + known, encoding="utf-8")
    dataset = load_dataset(tmp_path / "cell")
    soft = [JointCompliance(1), JointCompliance(2)]
    fixed, free = calibrate(dataset, effects=soft), calibrate(one_wire, effects=soft)
    np.testing.assert_array_equal(fixed.after.scanner_T_base["wire 1"][:3, 3], -ANCHORS_MM[0])
    assert fixed.fit.degrees_of_freedom > free.fit.degrees_of_freedom
    assert 0.7 * NOISE_MM < fixed.sigma_mm < 1.2 * NOISE_MM
    assert 0.75 < (promise(fixed).coverage_90 or 0.0) <= 1.0
    assert fixed.fit.known > free.fit.known  # where the base stands, which a free anchor takes
    write_dataset(dataset, tmp_path / "again")
    again = load_dataset(tmp_path / "again").points
    assert again.lengths.known_places == {"wire 1": (x, y, z)}
    path.write_text(path.read_text(encoding="utf-8").replace("wire 1", "wire 7"), encoding="utf-8")
    with pytest.raises(DatasetError, match=r"found 'wire 7'; points\.csv has lengths from 'wire 1'"):
        load_dataset(tmp_path / "cell")


def test_lengths_are_written_as_they_were_read(one_wire: Dataset, tmp_path: Path) -> None:
    write_dataset(one_wire, tmp_path / "again")
    again = load_dataset(tmp_path / "again").points
    np.testing.assert_array_equal(again.lengths.length_mm, one_wire.points.lengths.length_mm)
    np.testing.assert_array_equal(again.lengths.anchor, one_wire.points.lengths.anchor)


def test_what_lengths_cannot_do_is_said(one_wire: Dataset) -> None:
    with pytest.raises(FitError, match="measured lengths take residual position"):
        calibrate(one_wire, residual="distance")
    with pytest.raises(CalibError, match="its points are lengths"):
        start_of_dataset(one_wire, FitOptions())


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("P001,wire 1,-3.0", "line 3, column length_mm: found -3; a length above 0"),
        ("P001,wire 1,long", "line 3, column length_mm: found 'long'; a number is needed"),
        ("P900,wire 1,100.0", "line 3, column pose: 'P900' is not in poses.csv"),
        ("P001,wire 9,900.0", "anchor 'wire 9': 1 lengths; its place needs 4 or more"),
    ],
)
def test_a_wrong_length_is_an_error_with_its_place(one_wire: Dataset, tmp_path: Path, line: str, words: str) -> None:
    write_dataset(one_wire, tmp_path / "cell")
    path = tmp_path / "cell" / "points.csv"
    lines = path.read_text(encoding="utf-8").splitlines()
    path.write_text("\n".join([*lines[:2], line, *lines[3:]]) + "\n", encoding="utf-8")
    with pytest.raises(DatasetError) as caught:
        load_dataset(tmp_path / "cell")
    assert words in str(caught.value)
