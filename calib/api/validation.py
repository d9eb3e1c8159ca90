"""How good a fit is, and what two or more say: `cross_validate`, `learning_curve`, `check`, `compare`, `repeat`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Unpack

import numpy as np

from calib.api.fits import as_calibration
from calib.api.loading import load_with_options, options_with
from calib.calibration.result import FittedResult
from calib.corners.search import CornerSearch
from calib.dataset.dataset import Dataset
from calib.effects.catalogue import EffectChoice, effects_named
from calib.effects.effect import Family
from calib.measurement.measured_points import with_corners
from calib.options import DEFAULT_FOLDS, FitFields, FitOptions
from calib.progress import OnProgress, OnStep, counted
from calib.targets.search import find_targets
from calib.validation.acceptance import Check, check_of
from calib.validation.comparison import Comparison, comparison_of
from calib.validation.cross_validation import CrossValidation, LearningCurve, cross_validation_of, learning_curve_of
from calib.validation.repeat import Recurrence, recurrence_of


def cross_validate(
    dataset: Dataset | str | Path,
    options: FitOptions | None = None,
    *,
    folds: int = DEFAULT_FOLDS,
    effects: EffectChoice | Sequence[EffectChoice] = (),
    rng: np.random.Generator | None = None,
    progress: bool = False,
    on_progress: OnProgress | None = None,
    **keywords: Unpack[FitFields],
) -> CrossValidation:
    """K-fold cross-validation: the error at each training pose by a fit without that pose's fold.

    Args:
        dataset: a dataset or its folder; its test poses are not touched.
        folds: number of folds; each has its share of every setup.
        options: options of every fit.
        effects: effects in the model of every fit: names of the catalogue, families, or single members.
        rng: deals the poses into folds; always the same where None.
        progress: show a bar, in a notebook's cell or at the terminal.
        on_progress: called with the number of fits done, of all fits, and the name of the fold.
        **keywords: fields of `FitOptions`, in place of those of `options`.

    Raises:
        FitError: no points, fewer than two folds, more folds than poses, or too few poses in a fold's training part.

    >>> import calib
    >>> calib.cross_validate("sample_data/hidden_effect_a", effects="transmission_error")
    CrossValidation(hidden_effect_a: 5 folds, held-out RMSE 0.1... mm)
    """
    dataset, options = load_with_options(dataset, options, keywords)
    members = effects_named(dataset, effects)
    with counted("fits", "fit", asked=progress, then=on_progress) as tell:
        return cross_validation_of(dataset, options, folds=folds, effects=members, rng=rng, on_progress=tell)


def learning_curve(
    dataset: Dataset | str | Path,
    options: FitOptions | None = None,
    *,
    counts: Sequence[int] | None = None,
    repeats: int = 5,
    effects: EffectChoice | Sequence[EffectChoice] = (),
    rng: np.random.Generator | None = None,
    progress: bool = False,
    on_progress: OnProgress | None = None,
    **keywords: Unpack[FitFields],
) -> LearningCurve:
    """Held-out error against the number of training poses, by fits to growing subsets of them.

    Held out are the test poses where there are any, else one of five folds, another one each repeat. Within a repeat
    each subset contains the smaller ones, so that steps of the curve are due to the added poses alone.

    Args:
        dataset: a dataset or its folder.
        counts: numbers of different training poses; None: six, from the fewest that a fit takes to all.
        repeats: number of draws of the poses.
        options: options of every fit.
        effects: effects in the model of every fit: names of the catalogue, families, or single members.
        rng: draws the poses; always the same where None.
        progress: show a bar, in a notebook's cell or at the terminal.
        on_progress: called with the number of fits done, of all fits, and the count just fitted.
        **keywords: fields of `FitOptions`, in place of those of `options`.

    Raises:
        FitError: no points, too few poses, or impossible counts.

    >>> import calib
    >>> calib.learning_curve("sample_data/hidden_effect_a", repeats=2)
    LearningCurve(hidden_effect_a: 11 to 51 poses, held-out RMSE ... -> 0.415 mm)
    """
    dataset, options = load_with_options(dataset, options, keywords)
    members = effects_named(dataset, effects)
    with counted("fits", "fit", asked=progress, then=on_progress) as tell:
        return learning_curve_of(
            dataset, options, counts=counts, repeats=repeats, effects=members, rng=rng, on_progress=tell
        )


def check(
    dataset: Dataset | str | Path,
    searches: Mapping[str, CornerSearch] | None = None,
    options: FitOptions | None = None,
    *,
    effects: EffectChoice | Sequence[EffectChoice] = (),
    user_effects: Sequence[Family] = (),
    max_test_rmse_mm: float | None = None,
    on_step: OnStep | None = None,
    **keywords: Unpack[FitFields],
) -> Check:
    """Acceptance check of a dataset: every step from its corners to its held-out error, and a diagnosis.

    Args:
        dataset: a dataset or its folder.
        searches: searches of its scans by pose id, where it has no points; None: the scans are searched first.
        options: options of the fit; the diagnosis is of the residual that is usual for the data.
        effects: effects that are in the model: names of the catalogue, families, or single members.
        user_effects: families beyond the catalogue.
        max_test_rmse_mm: largest 3D RMSE of the test poses that passes; None: any below that of the nominal robot.
        on_step: called with a line of text before each stage of the diagnosis.
        **keywords: fields of `FitOptions`, in place of those of `options`.

    >>> import calib
    >>> calib.check("sample_data/hidden_effect_a")
    Check(hidden_effect_a: passed, 1 warnings)
    """
    dataset, options = options_with(dataset, options, keywords)
    if searches is None and dataset.points is None and dataset.scan_folder is not None:
        searches = find_targets(dataset, intermediate=False)
    if searches:
        dataset = with_corners(dataset, searches, orientation=options.residual == "pose")
    return check_of(
        dataset,
        searches or {},
        options,
        effects=effects_named(dataset, effects, user_effects),
        user_effects=user_effects,
        max_test_rmse_mm=max_test_rmse_mm,
        on_step=on_step,
    )


def compare(
    one: FittedResult | Dataset | str | Path,
    other: FittedResult | Dataset | str | Path,
    names: tuple[str, str] | None = None,
) -> Comparison:
    """Differences between two calibrations of different measurements of the same kind of robot.

    Args:
        one: a calibration or diagnosis, or a dataset or its folder, which is then calibrated.
        other: the second, whose parameters minus those of the first are the differences.
        names: names of both in the text; those of their datasets where None.

    Raises:
        FitError: robots with other joints.

    >>> import calib
    >>> one, other = (calib.simulate_dataset("rb5", rng=seed).dataset for seed in (0, 1))
    >>> calib.compare(one, other, names=("before", "after")).differs
    True
    """
    return comparison_of(as_calibration(one), as_calibration(other), names)


def repeat(recordings: Sequence[Dataset | str | Path], *, on_step: OnStep | None = None) -> Recurrence:
    """Which causes come back in several recordings of one arm, with the values of each.

    Args:
        recordings: datasets or their folders, two or more; instrument and tool may be others each time.
        on_step: called with a line of text before each stage.

    Raises:
        CalibError: fewer than two recordings.
        FitError: arms with other joints, or too few poses.

    >>> import calib
    >>> calib.repeat([calib.simulate_dataset("rb5", rng=seed, poses=20).dataset for seed in (0, 1)])
    Recurrence(simulated (1) and simulated (2): too little data, no cause comes back)
    """
    return recurrence_of([as_calibration(one) for one in recordings], on_step=on_step)
