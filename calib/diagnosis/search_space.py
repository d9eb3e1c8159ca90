"""Settings that all fits of a search share (data, options, candidate effects), and steps that add an effect."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from calib.calibration.calibrate import with_repeats_averaged
from calib.calibration.result import Calibration
from calib.dataset.dataset import Dataset
from calib.dataset.repeats import without_poses
from calib.diagnosis.effect_selection import (
    FitStep,
    SelectedEffect,
    calibrate_with,
    candidate_of,
    curves_to_add,
    first_step,
    selected_curves,
)
from calib.effects.catalogue import available_family, effects_for
from calib.effects.effect import Effect, Family
from calib.noise_shape import NoiseShape
from calib.options import FitOptions
from calib.screening.candidates import Candidate, Screening, screening_of
from calib.screening.curves.smooth_joint_error import LEARNED

MAX_EFFECTS = 3  # that a search adds unless asked otherwise


@dataclass(frozen=True)
class SearchSpace:
    """Settings that all fits and screenings of a search share: dataset, options and candidate effects."""

    dataset: Dataset
    options: FitOptions  # asked of every fit
    given: tuple[Effect, ...]  # whole families that are in the model from the start
    families: tuple[Family, ...]  # that may be missing from it
    max_effects: int = MAX_EFFECTS  # to add
    start: Calibration | None = None  # where a first fit starts

    @classmethod
    def of(
        cls,
        dataset: Dataset,
        options: FitOptions = FitOptions(),
        *,
        given: Sequence[Effect] = (),
        user_effects: Sequence[Family] = (),
        max_effects: int = MAX_EFFECTS,
    ) -> SearchSpace:
        """Settings for a search over the user's effects and all effects of the catalogue."""
        fitted = with_repeats_averaged(dataset, options.residual)
        return cls(dataset, options, tuple(given), (*effects_for(fitted), *user_effects), max_effects)

    def without(self, pose_ids: Sequence[str]) -> SearchSpace:
        """Search settings with some poses left out."""
        return replace(self, dataset=without_poses(self.dataset, tuple(pose_ids))) if pose_ids else self

    def with_noise(self, shape: NoiseShape, start: Calibration) -> SearchSpace:
        """Search settings with another noise shape, in which first fits start from an earlier fit."""
        return replace(self, options=replace(self.options, noise=shape), start=start)

    def fit(self, selected: Sequence[SelectedEffect], start: Calibration | None) -> Calibration:
        """Calibration with the effects present from the start and the selected ones, starting at an earlier fit."""
        return calibrate_with(self.dataset, selected, self.options, effects=self.given, start=start or self.start)

    def screen(self, calibration: Calibration) -> Screening:
        """Screening of every effect that is not in a fit's model, against the residual of that fit."""
        return screening_of(calibration, self.families)

    def ranked(self, step: FitStep) -> FitStep:
        """A fit step completed by its screening of candidate effects."""
        return step if step.screening is not None else replace(step, screening=self.screen(step.calibration))

    def family(self, name: str) -> Family | None:
        """Effect family that the search may add, by name; None for learned curves and unknown names."""
        return next((family for family in self.families if family.name == name), None)


def first_fit(space: SearchSpace) -> FitStep:
    """First fit step of a search: without selected effects."""
    return first_step(space.fit((), None))


def without_one(space: SearchSpace, step: FitStep, k: int, *, everything: bool) -> FitStep:
    """Step without the effect number k, fitted again and screened for every effect or for that effect's family alone.

    What an effect says given all others may differ from what it said when it was added.
    """
    selected = (*step.selected[:k], *step.selected[k + 1 :])
    fitted = space.fit(selected, step.calibration)
    family = space.family(step.selected[k].name)
    own = [] if family is None else [family]
    screening = space.screen(fitted) if everything else screening_of(fitted, own)
    return FitStep("", selected, fitted, left_out=step.left_out, screening=screening)


def reselect_members(
    space: SearchSpace, selected: Sequence[SelectedEffect], start: Calibration, count: int
) -> tuple[SelectedEffect, ...]:
    """Selected effects, of the first `count` of which the members are selected anew beside all others."""
    out = list(selected)
    for k, effect in enumerate(out[:count]):
        family = space.family(effect.name)
        if family is None:
            continue
        others = (*out[:k], *out[k + 1 :])
        found = screening_of(space.fit(others, start), [family]).candidates
        if found and found[0].members and found[0].members != effect.members:
            out[k] = SelectedEffect.of(found[0])
    return tuple(out)


def with_candidate(
    space: SearchSpace, step: FitStep, candidate: Candidate, trial: Calibration | None = None
) -> tuple[tuple[SelectedEffect, ...], Calibration]:
    """Selected effects with one more effect, and their fit; the earlier effects' members are selected anew.

    An effect that was selected while another cause was not yet in the model had to stand in for that one, or did not
    show in all its members.

    Args:
        space: settings of all fits.
        step: the model without the effect.
        candidate: to be added.
        trial: the fit of both, where it was made already.
    """
    selected = (*step.selected, SelectedEffect.of(candidate))
    fitted = space.fit(selected, step.calibration) if trial is None else trial
    out = reselect_members(space, selected, step.calibration, len(step.selected))
    if all(now is before for now, before in zip(out, selected, strict=True)):
        return selected, fitted
    return out, space.fit(out, step.calibration)


def with_curves(space: SearchSpace, step: FitStep) -> FitStep:
    """Fit step that adds learned curves of joints. Raises CalibError where there are none to learn."""
    curves = curves_to_add(step.calibration)
    selected = (*step.selected, selected_curves(curves))
    return step_after(
        step, LEARNED, selected, space.fit(selected, step.calibration), log_bayes_factor=curves.log_evidence
    )


def step_after(
    step: FitStep,
    name: str,
    selected: tuple[SelectedEffect, ...],
    calibration: Calibration,
    candidate: Candidate | None = None,
    log_bayes_factor: float | None = None,
) -> FitStep:
    """Fit step that adds an effect to the model of an earlier step."""
    return FitStep(f"+ {name}", selected, calibration, name, candidate, log_bayes_factor, step.left_out)


def add_in_turn(
    dataset: Dataset,
    names: Sequence[str],
    options: FitOptions = FitOptions(),
    *,
    effects: Sequence[Effect] = (),
    user_effects: Sequence[Family] = (),
) -> tuple[FitStep, ...]:
    """Fit steps that add named effects one by one, each screened against the residual of the fit before.

    Args:
        dataset: with measured points.
        names: families to add, in this order; each as the search and the page add it (`with_candidate`).
        options: what is asked of every fit.
        effects: in the model from the start, whole.
        user_effects: families beyond the catalogue.

    Returns the fit without these effects first.

    Raises:
        CalibError: an unknown name, one that these data cannot test, or one of which nothing shows.
    """
    space = SearchSpace.of(dataset, options, given=effects, user_effects=user_effects)
    for name in names:
        if name != LEARNED:
            available_family(dataset, name, user_effects)
    steps = [first_fit(space)]
    for name in dict.fromkeys(names):
        last = steps[-1]
        if name == LEARNED:
            steps.append(with_curves(space, last))
            continue
        candidate = candidate_of(space.screen(last.calibration), name)
        steps.append(step_after(last, name, *with_candidate(space, last, candidate), candidate))
    return tuple(steps)
