"""Causes of an arm's error: `calib.screen` and `calib.diagnose`."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Unpack

from calib.api.fits import as_calibration
from calib.api.loading import load_with_options
from calib.calibration.result import FittedResult
from calib.dataset.dataset import Dataset
from calib.diagnosis.diagnose import whole_diagnosis
from calib.diagnosis.result import Diagnosis
from calib.diagnosis.search_space import MAX_EFFECTS, SearchSpace
from calib.effects.catalogue import EffectChoice, effects_named
from calib.effects.effect import Family
from calib.options import FitFields, FitOptions
from calib.progress import OnStep, staged
from calib.screening.candidates import Screening, screening_of


def screen(fitted: FittedResult | Dataset | str | Path, families: Sequence[Family] | None = None) -> Screening:
    """Evidence of every effect that is not yet in a model, from the residual of the model's fit.

    Args:
        fitted: a calibration, or a dataset or its folder, to which the link errors are fitted first.
        families: candidates; those of the catalogue where None.

    >>> import calib
    >>> calib.screen("sample_data/hidden_effect_a").candidates[0]
    Candidate(transmission_error: log evidence 145, p ...)
    """
    return screening_of(as_calibration(fitted), families)


def diagnose(
    dataset: Dataset | str | Path,
    options: FitOptions | None = None,
    *,
    effects: EffectChoice | Sequence[EffectChoice] = (),
    user_effects: Sequence[Family] = (),
    max_steps: int = MAX_EFFECTS,
    progress: bool = False,
    on_step: OnStep | None = None,
    **keywords: Unpack[FitFields],
) -> Diagnosis:
    """Verdict on which physical effects are missing from the five-parameter model, with the evidence for each.

    Where effects are left that these data cannot tell apart, `calib.planning.discrimination.next_poses` has the poses
    to measure next; the diagnosis' own `summary()` and `to_dict()` include them.

    Args:
        dataset: a dataset or its folder; test poses only confirm. Where it holds scans only, corners are found first.
        options: options of every fit.
        effects: effects that are in the model from the start: names of the catalogue, families, or single members.
        user_effects: families beyond the catalogue.
        max_steps: largest number of effects to add.
        progress: show the stage under way, in a notebook's cell or at the terminal.
        on_step: called with a line of text before each stage.
        **keywords: fields of `FitOptions`, in place of those of `options`.

    Raises:
        FitError, CalibError: too few poses, an unknown name, an impossible option.

    >>> import calib
    >>> found = calib.diagnose("sample_data/hidden_effect_a")
    >>> found
    Diagnosis(hidden_effect_a: named, effects: transmission_error; test RMSE 2.32 -> 0.1 mm)
    >>> found.predict(found.calibration.dataset.poses.q[:2]).shape
    (2, 3)
    """
    dataset, options = load_with_options(dataset, options, keywords)
    space = SearchSpace.of(
        dataset,
        options,
        given=effects_named(dataset, effects, user_effects),
        user_effects=user_effects,
        max_effects=max_steps,
    )
    with staged(asked=progress, then=on_step) as tell:
        return whole_diagnosis(space, tell)
