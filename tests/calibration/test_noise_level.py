"""Source of the noise: declared, else repeats, else the fit's residual; named alike wherever it is shown."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from calib import calibrate, check, diagnose
from calib.calibration.noise_level import noise_level
from calib.calibration.pose_errors import pose_errors_of
from calib.dataset.dataset import Dataset, Points, Scanner
from calib.present.fit.residuals import LENGTH, band_note, noise_and_size, shown
from calib.present.over_time.checks import item_sentence
from inspector.figures import error_history
from tests.support.hidden_dataset import arm

NOISE_MM = 0.05


def undeclared(dataset: Dataset) -> Dataset:
    """The dataset without declared noise."""
    points = dataset.points
    assert points is not None
    return replace(dataset, scanner=Scanner(), points=replace(points, covariance_mm2=None))


def repeated(dataset: Dataset, times: int = 3) -> Dataset:
    """The dataset with each pose measured `times` times, with independent noise of `NOISE_MM`."""
    points = dataset.points
    rng = np.random.default_rng(2)
    rows = np.repeat(np.arange(len(points)), times)
    noise = NOISE_MM * rng.normal(size=(len(rows), 3))
    return dataset.with_points(Points(points.pose[rows], points.xyz_mm[rows] + noise, points.target[rows]))


def test_what_is_declared_stands() -> None:
    level = noise_level(calibrate(arm(3)))
    assert (level.source, level.ratio) == ("dataset", 1.0)
    assert level.sigma_mm == pytest.approx(NOISE_MM)
    assert noise_and_size(level, 0.05) == "noise alone (50 µm per coordinate)"


def test_repeats_tell_it_where_none_is_declared() -> None:
    level = noise_level(calibrate(repeated(undeclared(arm(3)))))
    assert level.source == "repeats"
    assert level.sigma_mm == pytest.approx(NOISE_MM, rel=0.1)


def test_else_it_is_what_the_fit_left_and_bands_and_counts_are_those_of_a_declared_noise() -> None:
    declared, bare = calibrate(arm(3)), calibrate(undeclared(arm(3)))
    level = noise_level(bare)
    assert level.source == "fit"
    assert level.sigma_mm == pytest.approx(bare.sigma_mm)
    assert level.sigma_mm == pytest.approx(NOISE_MM, rel=0.3)
    expected, found = pose_errors_of(declared), pose_errors_of(bare)
    assert found.noise_mm == pytest.approx(expected.noise_mm, rel=0.3)
    np.testing.assert_allclose(found.apparent_joint_noise, expected.apparent_joint_noise, rtol=0.4)
    assert 0 < np.count_nonzero(found.error_length_mm > found.length_noise_mm) < 0.2 * len(found.pose_ids)


@pytest.mark.slow
def test_page_figures_and_check_say_where_it_comes_from() -> None:
    dataset = undeclared(arm(3))
    fit = calibrate(dataset)
    errors = pose_errors_of(fit)
    band = shown(errors, LENGTH, None, dataset.robot)[2]
    assert band[1] == pytest.approx(2.8 * NOISE_MM, rel=0.3)
    note = band_note(errors, band)
    assert note.startswith("Grey: where noise as the fit left it (")
    assert "19 of 20" in note
    assert "1.000 mm" not in note
    names = [trace.name for trace in error_history(diagnose(dataset, max_steps=0)).data]
    assert "noise as the fit left it, 95 %" in names
    checked = {item.name: item_sentence(item) for item in check(dataset).items}
    assert "noise as the fit left it; no sigma is declared" in checked["residual"]
