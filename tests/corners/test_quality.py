"""Quality figures of a corner: they and their warnings agree with what is wrong in the scene."""

from __future__ import annotations

import json

import numpy as np
import pytest

from calib.corners.correlated_noise.declared import DeclaredNoise
from calib.corners.intersection import Corner
from calib.corners.quality import angle_errors
from calib.corners.search import CornerOptions, find_corner
from calib.jig import Jig
from calib.present import to_dict
from calib.simulation.scanner import ScanModel, simulate_scan
from tests.support.scan_cases import CASES
from tests.support.scan_scene import grazing, make_scene


def found(scene_name: str = "", sigma_mm: float | None = 0.02, **scene: object) -> tuple[Corner, object]:
    rng = np.random.default_rng(3)
    made = CASES[scene_name].scene(scene_name, 3, 12_000) if scene_name else make_scene(rng, 12_000, **scene)  # type: ignore[arg-type]
    search = find_corner(made.scan, Jig(), scan_sigma_mm=sigma_mm)
    assert search.corner is not None, search.failure
    return search.corner, made


def test_a_good_corner_has_no_doubts_and_true_figures() -> None:
    corner, made = found(rotation=grazing(np.random.default_rng(1), 55.0))
    quality = corner.quality
    assert quality.doubts() == ()
    sight = made.apex_mm / np.linalg.norm(made.apex_mm)  # type: ignore[attr-defined]
    for face, figures in zip(corner.faces, quality.faces, strict=True):
        assert figures.points == face.points
        assert figures.incidence_deg == pytest.approx(np.degrees(np.arccos(-face.normal @ sight)), abs=3.0)
        assert figures.coverage > 0.9
    assert np.abs(quality.angle_errors_deg).max() < 5 * max(quality.angle_sigmas_deg)
    assert quality.condition == pytest.approx(1.0, abs=0.01)
    assert json.loads(json.dumps(to_dict(quality)))["doubts"] == []


@pytest.mark.parametrize(
    ("name", "sigma_mm", "said"),
    [
        ("face at 78 deg", 0.02, "° off its normal; turn the jig"),
        ("face cut to 10 %", 0.02, "is seen; clear the view"),
        ("noise x3 untold", 0.005, "times scan_sigma_mm"),
    ],
)
def test_what_is_poor_is_said(name: str, sigma_mm: float, said: str) -> None:
    corner, _ = found(name, sigma_mm)
    assert said in " ".join(corner.quality.doubts())


@pytest.mark.slow
def test_a_smooth_error_is_a_doubt_where_it_is_clearly_more_than_is_told() -> None:
    made = make_scene(np.random.default_rng(2), 12_000, waves_mm=0.02)
    for told_mm, doubted in ((0.0, True), (0.005, True), (0.02, False)):
        options = CornerOptions(declared=DeclaredNoise(told_mm, 15.0))
        corner = find_corner(made.scan, Jig(), scan_sigma_mm=0.02, options=options).corner
        assert any("error is smooth over" in doubt for doubt in corner.quality.doubts()) == doubted


def test_a_rounded_edge_is_kept_away_from_and_a_sharp_one_is_used() -> None:
    sharp, _ = found(rotation=grazing(np.random.default_rng(1), 55.0))
    rounded, made = found(rotation=grazing(np.random.default_rng(1), 55.0), fillet_mm=3.0)
    assert sharp.quality.margin_mm < 0.7
    assert rounded.quality.margin_mm >= 2.0
    assert np.linalg.norm(rounded.xyz_mm - made.apex_mm) < 4 * made.bound_mm  # type: ignore[attr-defined]


def test_angle_errors_do_not_depend_on_the_numbering() -> None:
    jig = (90.5, 90.0, 88.0)
    assert angle_errors((88.01, 90.5, 89.98), jig) == pytest.approx([0.01, 0.0, -0.02])
    assert angle_errors((90.5, 88.01, 89.98), jig) == pytest.approx([0.0, 0.01, -0.02])


@pytest.mark.slow
@pytest.mark.parametrize("certified", [False, True])
def test_a_jig_out_of_square_is_found_by_its_angles(certified: bool) -> None:
    jig = Jig(face_angles_deg=(90.5, 90.0, 88.0), certified=certified)
    scanner_T_jig = np.eye(4)
    scanner_T_jig[:3, 3] = (30.0, -20.0, 680.0)
    made = simulate_scan(scanner_T_jig, jig, rng=np.random.default_rng(2), model=ScanModel(points=30_000))
    search = find_corner(made.scan, jig, scan_sigma_mm=0.02)
    assert search.corner is not None, search.failure
    error = search.corner.xyz_mm - made.apex_mm
    assert error @ np.linalg.solve(search.corner.covariance_mm2, error) < 25
    assert search.corner.quality.rigid
    assert not any("off the jig's angle" in doubt for doubt in search.corner.quality.doubts())
