"""Which physical effect is missing from the five-parameter model of a dataset.

The stepwise search names effects, each with its evidence, its doubt and its held-out gain. Then what the last fit
leaves over is tested, whatever was named: a cause outside the catalogue shows there. Where a few poses stand out from a
fit that is otherwise clean, the search is done once more without them.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

from calib.blas_threads import one_blas_thread
from calib.dataset.dataset import Dataset
from calib.diagnosis.conclusion import whole_diagnosis
from calib.diagnosis.result import Diagnosis
from calib.diagnosis.search_space import MAX_EFFECTS, SearchSpace
from calib.effects.catalogue import Family, effects_named
from calib.options import FitOptions


@one_blas_thread()
def diagnose(
    dataset: Dataset,
    options: FitOptions = FitOptions(),
    *,
    effects: Sequence[str] = (),
    user_effects: Sequence[Family] = (),
    max_steps: int = MAX_EFFECTS,
    on_step: Callable[[str], None] | None = None,
) -> Diagnosis:
    """Find what is missing from the five-parameter model.

    Args:
        dataset: with measured points; test poses are used to confirm only.
        options: what is asked of every fit.
        effects: families that are taken as present from the start, all joints.
        user_effects: families beyond the catalogue.
        max_steps: effects to add at the most.
        on_step: called with a line of words before each stage.

    Raises:
        FitError, CalibError: too few poses, an unknown name.
    """
    space = SearchSpace.of(
        dataset,
        options,
        given=effects_named(dataset, effects, user_effects),
        user_effects=user_effects,
        max_effects=max_steps,
    )
    return whole_diagnosis(space, on_step or (lambda words: None))
