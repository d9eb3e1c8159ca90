"""Random arms, calibrated and diagnosed: what is claimed is held against what was simulated, errors against a bound."""

from __future__ import annotations

import traceback
import warnings
from pathlib import Path

import numpy as np

from calib.calibration.result import Calibration
from calib.diagnosis.diagnose import diagnose
from calib.diagnosis.result import Diagnosis
from calib.errors import CalibError
from calib.present.fit.calibration import calibration_warnings
from soaking.cells.drawn_arms import DrawnArm, draw
from soaking.record import Result

NEAR = 1.5  # times the bound: 20 test poses have an RMS within 35 % of it in 999 of 1,000 arms
TOLD = "the test poses are off by"  # as where the one before a step, of which no training pose tells, is a test pose
SATISFIED = ("adequate", "named")


def attempt(number: int, seed: int, material: Path, scratch: Path) -> Result:
    """Simulate and diagnose one arm."""
    arm = draw(number, seed)
    hidden = " + ".join(arm.effects) or "nothing hidden"
    what = f"{len(arm.simulation.dataset.poses)} poses, noise {arm.noise_mm:.3f} mm, {hidden}"
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        try:
            found = diagnose(arm.simulation.dataset)
        except CalibError as error:
            return Result(number, arm.kind, what, "refused", "refused", str(error))
        except Exception:
            return Result(number, arm.kind, what, "", "traceback", traceback.format_exc()[-4000:])
    ours = [w for w in caught if "/calib/" in w.filename]
    trouble, said = ("python warning", f"{ours[0].filename}: {ours[0].message}") if ours else judged(arm, found)
    figures = {}
    if set(found.missing) == set(arm.effects) and found.verdict in SATISFIED:
        figures["over_bound"] = _test_mm(found.calibration) / arm.bound_mm
    return Result(number, arm.kind, what, found.verdict, trouble, said, figures=figures)


def judged(arm: DrawnArm, found: Diagnosis) -> tuple[str, str]:
    """The worst that is wrong with a diagnosis, and what it says; ("", "") where nothing is."""
    told = (
        f"{found.verdict}, missing {', '.join(found.missing) or 'nothing'}, test RMSE "
        f"{' -> '.join(f'{_test_mm(step.calibration):.4g}' for step in found.steps)} mm, bound {arm.bound_mm:.4g} mm"
    )
    for step in found.steps:
        result = step.calibration
        assert result.before.test is not None
        numbers = [_test_mm(result), result.before.test.rmse_mm, *result.fit.x]
        if not np.all(np.isfinite(numbers)):
            return "not finite", told
        if not result.fit.converged and not calibration_warnings(result):
            return "no convergence told", told
        if _test_mm(result) > result.before.test.rmse_mm and result.worsening is None:
            return "worse than nominal, not told", told
    wrong = set(found.missing) - set(arm.effects)
    if wrong:
        return "wrong name", told
    far = _test_mm(found.calibration) > NEAR * arm.bound_mm
    if (
        found.verdict in SATISFIED
        and far
        and not calibration_warnings(found.calibration)
        and TOLD not in found.summary()
    ):
        if set(found.missing) < set(arm.effects):
            return "falsely satisfied", told
        return "far from the bound, nothing told", told
    return "", told


def _test_mm(result: Calibration) -> float:
    assert result.after.test is not None
    return result.after.test.rmse_mm
