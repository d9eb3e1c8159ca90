"""Results of every sample dataset equal the reviewed ones in tests/golden, one file each.

An intended change is written by `python benchmarks/golden.py --renew` and reviewed, a line per entry.
"""

from __future__ import annotations

import pytest

from calib import calibrate
from calib.dataset.files.folder import find_datasets, load_dataset
from tests.support import golden
from tests.support.sweeps import sweep

ANEW = "if this is meant: python benchmarks/golden.py --renew"
QUICK = ("hidden_effect_a", "hidden_effect_b", "hidden_effect_c")  # a second or two each
SCANNED = ("rb5_jang", "rb5_repeats")
REAL = ("ur10_ipa", "mukca_panda_2_clean")


def assert_golden(name: str, now: golden.Entries, *starts: str) -> None:
    """Compare a result, or the parts whose names have given starts, with its golden file."""
    stored = golden.below(golden.load(name), *starts) if starts else golden.load(name)
    assert stored, f"{name}: no such entries"
    found = golden.differences(name, stored, now)
    assert not found, "\n".join([f"{len(found)} entries differ; {ANEW}", *found])


def test_every_sample_dataset_has_its_golden_result() -> None:
    names = {path.name for path in find_datasets(golden.SAMPLES)}
    assert names == set(golden.NAMES) == {path.stem for path in golden.FOLDER.glob("*.json")}
    assert names == {*QUICK, *SCANNED, *REAL}
    for name in names:
        entries = golden.load(name)
        assert entries["check.passed"] is True
        for place, entry in entries.items():
            assert not isinstance(entry, float), f"{name}: {place} has no tolerance"
            assert not isinstance(entry, dict) or entry["tolerance"] > 0, f"{name}: {place}"
        assert golden.path_of(name).read_text() == golden.text_of(entries)


@pytest.mark.slow
@pytest.mark.parametrize("name", sweep(QUICK, every_run=QUICK[1:]))
def test_a_small_dataset_is_judged_as_before(name: str) -> None:
    assert_golden(name, golden.observed(name))


@pytest.mark.slow
@pytest.mark.parametrize("name", SCANNED)
def test_some_corners_are_where_they_were(name: str) -> None:
    kept = golden.few_scans(load_dataset(golden.SAMPLES / name))
    assert_golden(name, golden.few_corners(name), *(f"corners.{pose}." for pose in kept))


@pytest.mark.slow
@pytest.mark.parametrize("name", REAL)
def test_a_real_arm_is_calibrated_as_before(name: str) -> None:
    dataset = load_dataset(golden.SAMPLES / name)
    now = golden.calibration("calibrate", calibrate(dataset)) | golden.redundant(dataset)
    assert_golden(name, now, "calibrate.", "redundancy.")


@pytest.mark.thorough
@pytest.mark.parametrize("name", [*SCANNED, *REAL])
def test_every_dataset_is_judged_as_before(name: str) -> None:
    assert_golden(name, golden.observed(name))


# ---- the comparison itself ------------------------------------------------------------------------------------------


def test_a_difference_reads_as_what_changed() -> None:
    stored: golden.Entries = {
        "diagnose.missing": ["backlash"],
        "diagnose.steps.1.test_rmse_mm": golden.near(0.1, 0.001),
        "diagnose.steps.1.p": golden.p_value(1e-20),
        "diagnose.verdict": "named",
        "redundancy.rank": 20,
    }
    now = {
        "diagnose.missing": [],
        "diagnose.steps.1.test_rmse_mm": golden.near(0.1021, 0.001),
        "diagnose.steps.1.p": golden.p_value(3e-20),
        "diagnose.verdict": "unexplained",
        "check.passed": False,
    }
    assert golden.differences("b", stored, now) == [
        "b: diagnose.missing ['backlash'] -> []",
        "b: diagnose.verdict 'named' -> 'unexplained'",
        "b: redundancy.rank 20 -> no longer there",
        "b: check.passed was not there -> False",
        "b: diagnose.steps.1.test_rmse_mm 0.1 -> 0.1021 (tolerance 0.001)",
        "b: diagnose.steps.1.p 1.0e-20 -> 3.0e-20 (tolerance 0.3 decades)",
    ]
    assert golden.differences("b", stored, stored) == []
