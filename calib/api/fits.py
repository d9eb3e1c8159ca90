"""Fits and what they can find: `calib.calibrate` and `calib.redundancy`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Unpack

from calib.api.loading import load_with_options
from calib.calibration.calibrate import fit_measured
from calib.calibration.result import Calibration, FittedResult
from calib.dataset.dataset import Dataset
from calib.dataset.files.folder import as_dataset
from calib.effects.catalogue import EffectChoice, effects_named
from calib.identifiability.redundancy import Redundancy
from calib.identifiability.structural import redundancy_of
from calib.options import FitFields, FitOptions


def calibrate(
    dataset: Dataset | str | Path,
    options: FitOptions | None = None,
    *,
    effects: EffectChoice | Sequence[EffectChoice] = (),
    prior_sigmas: Mapping[str, float] | None = None,
    start: Calibration | None = None,
    **keywords: Unpack[FitFields],
) -> Calibration:
    """Fit the link errors, and further effects, to the training poses of a dataset.

    Repeats of one pose count once, by their mean; errors are evaluated at every measurement.
    With effects, an earlier fit or one of the link errors alone comes first, and gravity's loads are computed with its
    links. Effects then change the links by some 1e-3 rad, and loads by some 1e-3 of themselves, which is neglected.

    Args:
        dataset: a dataset or its folder; where it holds scans only, their corners are found first.
        options: options of the fit; the result keeps them.
        effects: effects beyond the link errors: names of the catalogue, families, or single members.
        prior_sigmas: prior standard deviations of the effects' parameters, by full name, in place of their scales.
        start: an earlier fit of the same arm, from whose parameters the iterations start.
        **keywords: fields of `FitOptions`, in place of those of `options`.

    Raises:
        FitError: no points, an unknown name, an impossible option, or fewer equations than unknowns.

    >>> import calib
    >>> calib.calibrate("sample_data/hidden_effect_a")
    Calibration(hidden_effect_a: 64 poses, test RMSE 2.32 -> 0.415 mm, effects: none)
    >>> fit = calib.calibrate("sample_data/hidden_effect_a", effects=["transmission_error"], robust=True)
    >>> fit.model.family_names
    ('transmission_error',)
    """
    dataset, options = load_with_options(dataset, options, keywords)
    return fit_measured(
        dataset, options, effects=effects_named(dataset, effects), prior_sigmas=prior_sigmas, start=start
    )


def as_calibration(fitted: FittedResult | Dataset | str | Path, **keywords: Unpack[FitFields]) -> Calibration:
    """Calibration that a result holds or, for a dataset, a fit of the link errors. Raises as `calibrate`."""
    return fitted.calibration if isinstance(fitted, FittedResult) else calibrate(fitted, **keywords)


def redundancy(dataset: Dataset | str | Path, *, residual: str = "position") -> Redundancy:
    """Redundancy of parameters at the dataset's training poses, for the nominal robot (Park 2022, section 3).

    Args:
        dataset: a dataset or its folder; measured points are not needed.
        residual: "position" or "pose", with the scanner's frame known; "distance" or "pairs", which need no frame.

    >>> import calib
    >>> calib.redundancy("sample_data/hidden_effect_a")
    Redundancy(35 parameters, rank ..., ... dropped)
    """
    return redundancy_of(as_dataset(dataset), residual=residual)
