"""Results for a sample dataset as a file to compare with: words to the letter, figures to a tolerance.

How the tolerances were chosen. A result depends on the order of sums, so on the BLAS, the processor and the compiler;
`python benchmarks/golden.py --kernels` measures by how much. What matters is what a reader would take for another
result, and that is set by the noise: an error figure may move by 1 % of the residual sigma, a parameter by 5 % of its
own sigma, a sigma or a share by 2 %, a corner by 2 % of its own sigma, a log evidence by 0.1 and 1 %, a p-value by a
factor of two, one that is counted in 999 draws by three of its own standard deviations. Words, counts, ranks and
orders stand to the letter.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from calib import check, find_corners, redundancy
from calib.calibration.result import Calibration
from calib.corners.batch import CornerBatch
from calib.dataset.dataset import Dataset
from calib.dataset.files.folder import load_dataset
from calib.diagnosis.result import Diagnosis
from calib.identifiability.structural import free_frame_rank
from calib.measurement.measured_points import with_corners
from calib.present.fit.calibration import calibration_warnings
from tests.support import ROOT

SAMPLES, FOLDER = ROOT / "sample_data", ROOT / "tests" / "golden"
NAMES = (
    "hidden_effect_a", "hidden_effect_b", "hidden_effect_c", "mukca_panda_2_clean", "rb5_jang", "rb5_repeats",
    "ur10_ipa",
)  # fmt: skip
FEW = 3  # scans of a dataset, spread over it, whose corners are compared with every change
OF_NOISE, OF_A_SIGMA, OF_A_CORNER, SHARE = 0.01, 0.05, 0.02, 0.02
NATS, NATS_SHARE, DECADES = 0.1, 0.01, math.log10(2.0)
DRAWS = 999
SMALLEST_P = 1e-300
LEARNED = "smooth_joint_error."  # of its parameters

Entry = Any  # a word, a number that stands as it is, or {"value": ..., "tolerance": ...}
Entries = dict[str, Entry]  # by place: "diagnose.steps.1.test_rmse_mm"


def near(value: float | None, tolerance: float) -> Entry:
    """A figure with what it may differ by; with three digits more."""
    if value is None or not math.isfinite(value):
        return None if value is None else str(value)
    digits = max(0, 2 - math.floor(math.log10(tolerance))) if tolerance > 0 else 12
    return {"value": round(float(value), digits), "tolerance": float(f"{tolerance:.2g}")}


def p_value(p: float | None, *, counted: bool = False) -> Entry:
    """A p-value by its decades; a counted one as it is, which has the spread of a count."""
    if p is None:
        return None
    if counted:
        return near(p, 3 * math.sqrt(max(p * (1 - p), 1 / DRAWS) / DRAWS))
    return {"log10": round(math.log10(max(p, SMALLEST_P)), 2), "tolerance": round(DECADES, 2)}


def _evidence(value: float | None) -> Entry:
    return None if value is None else near(value, NATS + NATS_SHARE * abs(value))


# ---- what is kept ---------------------------------------------------------------------------------------------------


def corners(found: CornerBatch) -> Entries:
    """Place, sigma and faces of each corner of free planes, which other scans do not change, or why there is none."""
    out: Entries = {}
    for pose, search in found.items():
        at = f"corners.{pose}"
        if search.corner is None:
            out[f"{at}.failure"] = search.failure
            continue
        corner = search.corner.free or search.corner
        sigma_mm = corner.sigma_mm()
        for axis, value in zip("xyz", corner.xyz_mm, strict=True):
            out[f"{at}.{axis}_mm"] = near(value, OF_A_CORNER * sigma_mm)
        out[f"{at}.sigma_mm"] = near(sigma_mm, SHARE * sigma_mm)
        out[f"{at}.points"] = near(sum(face.points for face in corner.faces), 5.0)
    return out


def calibration(at: str, result: Calibration) -> Entries:
    """Errors before and after, rank, and every parameter with its sigma."""
    noise_mm, out = result.sigma_mm, {f"{at}.rank": result.fit.rank, f"{at}.converged": result.fit.converged}
    out[f"{at}.effects"] = list(result.model.family_names)
    out[f"{at}.sigma_mm"] = near(noise_mm, OF_NOISE * noise_mm)
    for when, errors in (("before", result.before), ("after", result.after)):
        for role, figures in (("train", errors.train), ("test", errors.test)):
            if figures is not None:
                for name in ("rmse_mm", "max_mm", "mean_mm", "distance_max_mm", "distance_mean_mm"):
                    out[f"{at}.{when}.{role}.{name}"] = near(getattr(figures, name), OF_NOISE * noise_mm)
    for row in result.to_frame().to_dict(orient="records"):
        if str(row["name"]).startswith(LEARNED):  # of functions that have a meaning together only
            continue
        sigma = float(row["sigma"])
        out[f"{at}.parameters.{row['name']}"] = near(float(row["value"]), OF_A_SIGMA * sigma)
    out[f"{at}.warnings"] = len(calibration_warnings(result))
    return out


def redundant(dataset: Dataset) -> Entries:
    """Rank, and what Park's pairs drop."""
    found = redundancy(dataset)
    return {
        "redundancy.rank": found.rank,
        "redundancy.dropped": [name for name in found.parameters if name not in found.kept],
        "redundancy.no_influence": list(found.no_influence),
        "redundancy.groups": [list(group) for group in found.groups],
        "redundancy.rank_with_the_scanner_unknown": free_frame_rank(dataset).here,
    }


def diagnosis(found: Diagnosis) -> Entries:
    """Verdict, causes, steps, what is left and what it is held against."""
    left, noise_mm = found.residual_tests, found.calibration.sigma_mm
    out: Entries = {
        "diagnose.verdict": found.verdict,
        "diagnose.missing": list(found.missing),
        "diagnose.suspected": list(found.suspected),
        "diagnose.ambiguous_set": list(found.ambiguous_set),
        "diagnose.untestable": sorted(each.name for each in found.untestable),
        "diagnose.outlier_poses": list(left.outlier_poses),
        "diagnose.learned": None if found.learned is None else [*map(int, found.learned.joints), *found.learned.inputs],
        "diagnose.first_candidate": found.candidates[0].name if found.candidates else None,
        "diagnose.noise_mm": near(left.noise_mm, SHARE * left.noise_mm),
        "diagnose.noise_from": left.noise_from,
        "diagnose.lack_of_fit": p_value(left.lack_of_fit_p, counted=False),
    }
    for k, step in enumerate(found.steps):
        at, after = f"diagnose.steps.{k}", step.calibration.after
        out[f"{at}.effect"] = step.effect
        for role, figures in (("train", after.train), ("test", after.test)):
            if figures is not None:
                out[f"{at}.{role}_rmse_mm"] = near(figures.rmse_mm, OF_NOISE * noise_mm)
        out[f"{at}.p"] = p_value(step.candidate.p_value if step.candidate else None)
        out[f"{at}.margin"] = _evidence(step.log_bayes_factor)
    for test in left.inputs:
        out[f"diagnose.inputs.{test.input}"] = p_value(test.p_value, counted=True)
    return out | calibration("diagnose.model", found.calibration)


# ---- of a dataset ---------------------------------------------------------------------------------------------------


def few_scans(dataset: Dataset) -> tuple[str, ...]:
    """Poses whose corners are compared with every change."""
    ids = dataset.poses.ids
    return tuple(ids[int(k)] for k in np.linspace(0, len(ids) - 1, FEW))


def few_corners(name: str) -> Entries:
    """The corners of some scans."""
    dataset = load_dataset(SAMPLES / name)
    kept = few_scans(dataset)
    return corners(find_corners(dataset.leave_out([i for i in dataset.poses.ids if i not in kept])))


def observed(name: str) -> Entries:
    """All that is kept of a sample dataset, as the program has it now."""
    dataset, out, searches = load_dataset(SAMPLES / name), {}, None
    if dataset.points is None:
        searches = find_corners(dataset, intermediate=False)
        out |= corners(searches)
    checked = check(dataset, searches)
    measured = dataset if searches is None else with_corners(dataset, searches)
    out |= redundant(measured)
    if checked.calibration is not None:
        out |= calibration("calibrate", checked.calibration)
    if checked.diagnosis is not None:
        out |= diagnosis(checked.diagnosis)
    out["check.passed"] = checked.passed
    out["check.items"] = [f"{item.status} {item.name}" for item in checked.items]
    return out


# ---- files and what differs -----------------------------------------------------------------------------------------


def path_of(name: str) -> Path:
    """File of a dataset's golden result."""
    return FOLDER / f"{name}.json"


def load(name: str) -> Entries:
    """The golden result of a dataset."""
    entries: Entries = json.loads(path_of(name).read_text())
    return entries


def text_of(entries: Mapping[str, Entry]) -> str:
    """The file: an entry a line, so that a difference between two versions of it is a line too."""
    lines = ",\n".join(f" {json.dumps(place)}: {json.dumps(entry)}" for place, entry in entries.items())
    return f"{{\n{lines}\n}}\n"


def is_same(golden: Entry, now: Entry) -> bool:
    """Whether a result is what it was, to the golden one's tolerance."""
    for key in ("value", "log10"):
        if isinstance(golden, dict) and isinstance(now, dict) and key in golden and key in now:
            return bool(abs(golden[key] - now[key]) <= golden["tolerance"])
    return bool(golden == json.loads(json.dumps(now)))


def told(entry: Entry) -> str:
    """An entry as a person reads it."""
    if isinstance(entry, dict) and "value" in entry:
        return f"{entry['value']:g}"
    if isinstance(entry, dict):
        return f"{10.0 ** entry['log10']:.1e}"
    return repr(entry)


def differences(name: str, golden: Mapping[str, Entry], now: Mapping[str, Entry]) -> list[str]:
    """Lines that say what has changed: "hidden_effect_b: diagnose.verdict 'named' -> 'unexplained'"; words first."""
    out = []
    for place in dict.fromkeys([*golden, *now]):
        was, is_ = golden.get(place), now.get(place)
        figure = isinstance(was, dict) or isinstance(is_, dict)
        if place not in now:
            out.append((figure, f"{name}: {place} {told(was)} -> no longer there"))
        elif place not in golden:
            out.append((figure, f"{name}: {place} was not there -> {told(is_)}"))
        elif not is_same(was, is_):
            unit = " decades" if isinstance(was, dict) and "log10" in was else ""
            beyond = f" (tolerance {was['tolerance']:g}{unit})" if isinstance(was, dict) else ""
            out.append((figure, f"{name}: {place} {told(was)} -> {told(is_)}{beyond}"))
    return [words for _, words in sorted(out, key=lambda item: item[0])]


def renewed(golden: Mapping[str, Entry], now: Mapping[str, Entry]) -> Entries:
    """The result of now; what is the same to its tolerance stays as it stood, so that a review sees what changed."""
    return {
        place: golden[place] if place in golden and is_same(golden[place], entry) else entry
        for place, entry in now.items()
    }


def below(entries: Mapping[str, Entry], *starts: str) -> Entries:
    """Entries whose place begins with one of `starts`."""
    return {place: entry for place, entry in entries.items() if place.startswith(starts)}


def largest_share(golden: Mapping[str, Entry], others: Iterable[Mapping[str, Entry]]) -> tuple[float, str]:
    """The largest difference over its tolerance among several results, and where."""
    worst = (0.0, "")
    for other in others:
        for place, entry in golden.items():
            key = next((k for k in ("value", "log10") if isinstance(entry, dict) and k in entry), None)
            if key is not None and isinstance(other.get(place), dict):
                worst = max(worst, (abs(entry[key] - other[place][key]) / entry["tolerance"], place))
    return worst
