"""The fit that a plan for a dataset goes on from: the link errors, and what the diagnosis names where more is left."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from calib.array_types import Array
from calib.calibration.calibrate import calibrate
from calib.calibration.noise_level import check_sigma
from calib.dataset.dataset import Dataset
from calib.diagnosis.diagnose import diagnose
from calib.effects.catalogue import EffectChoice, effects_named
from calib.effects.effect import Family
from calib.options import FitOptions
from calib.planning.start import DiagnosedModel, FromFit
from calib.planning.unknowns import require_scanner_in_world


def start_of_dataset(
    dataset: Dataset,
    options: FitOptions,
    *,
    effects: EffectChoice | Sequence[EffectChoice] = (),
    user_effects: Sequence[Family] = (),
    scanner_place: Array | None = None,
    on_step: Callable[[str], None] | None = None,
) -> FromFit:
    """Fit the dataset; where no effects are asked for and the residual is above the declared noise, diagnose it.

    Args:
        effects: effects that the model has; the diagnosis is then left out.
        scanner_place: (4, 4) base_T_scanner for the new poses, where the scanner is put up anew.
    """
    require_scanner_in_world(dataset)
    members = effects_named(dataset, effects, user_effects)
    calibration = calibrate(dataset, options, effects=members)
    check = check_sigma(calibration)
    if members or check.verdict != "excess" or not check.declared_mm:
        return FromFit(calibration, scanner_place)
    found = diagnose(dataset, options, user_effects=user_effects, on_step=on_step)
    chosen = DiagnosedModel(check.sigma_mm / check.declared_mm, found.verdict == "ambiguous")
    return FromFit(found.calibration, scanner_place, chosen)
