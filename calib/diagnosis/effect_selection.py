"""Effects selected for a model one by one: the joints that carry each, and prior sigmas set by the evidence.

`calibrate(effects=...)` takes whole families with their usual scales. The diagnosis and the page select less: the
members that carry an effect in these data, each parameter with a prior sigma chosen by the evidence.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import accumulate, chain
from typing import TypeVar

import numpy as np

from calib.brief import Brief
from calib.calibration.calibrate import fit_measured
from calib.calibration.model_versions import model_name
from calib.calibration.plausibility import implausibility_reason
from calib.calibration.result import Calibration
from calib.dataset.dataset import Dataset
from calib.effects.catalogue import available_family
from calib.effects.effect import Effect, Family, full_name
from calib.errors import CalibError, FitError
from calib.options import FitOptions
from calib.screening.candidates import Candidate, Screening
from calib.screening.curves.couplings import learn_couplings
from calib.screening.curves.joint_curves import LearnedCurves, laws_or_curves, learn_joint_curves
from calib.screening.curves.law_search import FoundLaws, search_laws
from calib.screening.curves.smooth_joint_error import ALL_JOINTS, LEARNED
from calib.screening.projected_residual import project_residual

_Learned = TypeVar("_Learned")


@dataclass(frozen=True)
class SelectedEffect(Brief):
    """An effect in the model: its active members (such as joints), and the prior sigmas of their parameters."""

    name: str
    members: tuple[Effect, ...]
    prior_sigmas: Mapping[str, float]  # by full parameter name, in the parameter's unit

    @classmethod
    def of(cls, candidate: Candidate) -> SelectedEffect:
        """Selected effect made from a candidate of a screening."""
        return cls(candidate.name, candidate.members, candidate.prior_sigmas)

    @property
    def joints(self) -> frozenset[int]:
        """Joints that carry the effect, from 0; empty where it is of no joint."""
        found = (getattr(member, "joint", None) for member in self.members)
        return frozenset(joint for joint in found if joint is not None)

    @property
    def grows_with_angle(self) -> bool:
        """Whether it follows the size of joints' angles, which is a part of what many other causes do."""
        return bool(self.members) and all(getattr(member, "grows_with_angle", False) for member in self.members)

    def without(self, members: Sequence[Effect]) -> SelectedEffect:
        """The effect without some of its members."""
        kept = tuple(member for member in self.members if member not in members)
        names = {full_name(member, parameter) for member in kept for parameter in member.parameters}
        return SelectedEffect(self.name, kept, {name: s for name, s in self.prior_sigmas.items() if name in names})


@dataclass(frozen=True)
class FitStep(Brief):
    """One fit in the course of a search, from the link errors alone to the model with all added effects."""

    label: str  # the change of the model: "calibrated links", "+ backlash", "− backlash"
    selected: tuple[SelectedEffect, ...]  # in the model, beyond the link errors and whole families
    calibration: Calibration
    effect: str | None = None  # that this step added
    candidate: Candidate | None = None  # that effect as it was ranked before it was added
    log_bayes_factor: float | None = None  # of the effect over the next candidate; of learned curves over none
    left_out: tuple[str, ...] = ()  # ids of measured poses that this fit did without
    screening: Screening | None = None  # of every effect that is not in its model, once asked for
    runner_up: str = ""  # the next candidate
    on_behalf_of: tuple[str, ...] = ()  # effects that may be the cause as well: the added one does not lead them

    def candidate_named(self, name: str) -> Candidate | None:
        """Candidate effect of the fit's screening, by name; None where it is none, or nothing was screened."""
        candidates = () if self.screening is None else self.screening.candidates
        return next((candidate for candidate in candidates if candidate.name == name), None)

    @cached_property
    def curves(self) -> LearnedCurves | None:
        """Error curves of joints that explain the fit's residual, learned on first access; None if there are none."""
        return curves_given(self.calibration)

    @cached_property
    def laws(self) -> FoundLaws | None:
        """Laws of joints that explain the fit's residual, searched on first access; None if there are none."""
        return laws_given(self.calibration)


def evidence_on_the_way(steps: Sequence[FitStep]) -> list[float]:
    """Log evidence of all effects up to each step of a search."""
    return list(accumulate(0.0 if step.candidate is None else step.candidate.log_evidence for step in steps))


def first_step(calibration: Calibration) -> FitStep:
    """First fit step of a search: link errors, and the effects that a user declared present."""
    return FitStep(model_name(calibration.model), (), calibration)


def candidate_of(screening: Screening | None, name: str) -> Candidate:
    """Candidate effect of a screening, by name. Raises CalibError where it is missing or no part is detectable."""
    ranked = {} if screening is None else {c.name: c for c in screening.candidates}
    if name not in ranked:
        raise CalibError(f"effect {name} is not among the candidates: {', '.join(ranked) or 'none is ranked yet'}")
    if not ranked[name].members:
        raise CalibError(f"effect {name}: no part of it shows in what is left over, so there is nothing to add")
    return ranked[name]


def learned_curves(calibration: Calibration) -> LearnedCurves | None:
    """Error curves of joints, learned from the residual of a fit, or laws that say as much; None for only noise.

    Raises FitError where no degree of freedom is left.
    """
    if not calibration.options.prior:
        return None
    return laws_or_curves(learn_joint_curves(calibration), search_laws(project_residual(calibration)))


def curves_given(calibration: Calibration) -> LearnedCurves | None:
    """Error curves of joints that explain the residual of a fit; None where learning them makes no sense.

    None where they explain no more than noise would, where the fit has curves already, where points and poses do not
    belong together, and where no degree of freedom is left.
    """
    return _learned_from(calibration, learn_joint_curves)


def laws_given(calibration: Calibration) -> FoundLaws | None:
    """Laws of joints that explain the residual of a fit; None in the cases in which `curves_given` is."""
    return _learned_from(calibration, lambda fitted: search_laws(project_residual(fitted)))


def couplings_given(calibration: Calibration) -> LearnedCurves | None:
    """Couplings of all joints that explain the residual of a fit; None in the cases in which `curves_given` is."""
    return _learned_from(calibration, lambda fitted: learn_couplings(project_residual(fitted)))


def _learned_from(calibration: Calibration, learn: Callable[[Calibration], _Learned | None]) -> _Learned | None:
    known = LEARNED in calibration.model.family_names or not calibration.options.prior
    if known or implausibility_reason(calibration):
        return None
    try:
        return learn(calibration)
    except FitError:
        return None


def selected_curves(curves: LearnedCurves) -> SelectedEffect:
    """Learned curves in the form of a selected effect of a model."""
    sigmas = {full_name(member, p): p.scale for member in curves.members for p in member.parameters}
    return SelectedEffect(LEARNED, curves.members, sigmas)


def curves_to_add(calibration: Calibration) -> LearnedCurves:
    """Error curves of joints, learned from a fit's residual. Raises CalibError where there are none to learn."""
    if not calibration.options.prior:
        raise CalibError(f"effect {LEARNED}: its curves are nothing without their prior; leave out --no-prior")
    curves = learned_curves(calibration)
    if curves is None:
        raise CalibError(
            f"effect {LEARNED}: curves of the joints explain no more of what is left over than noise would, so "
            "there is nothing to add"
        )
    return curves


def calibrate_with(
    dataset: Dataset,
    selected: Sequence[SelectedEffect],
    options: FitOptions = FitOptions(),
    *,
    effects: Sequence[Effect] = (),
    start: Calibration | None = None,
) -> Calibration:
    """Calibration with the selected effects in the model, after any whole families given as `effects`."""
    prior_sigmas: dict[str, float] = {}
    for effect in selected:
        prior_sigmas |= effect.prior_sigmas
    members = [member for effect in selected for member in effect.members]
    return fit_measured(dataset, options, effects=[*effects, *members], prior_sigmas=prior_sigmas, start=start)


def recalled(
    dataset: Dataset, name: str, prior_sigmas: Mapping[str, float], user_effects: Sequence[Family] = ()
) -> SelectedEffect:
    """Selected effect of an earlier session, restored from its name and its parameters' prior sigmas.

    Learned curves have no members yet: they are learned again from the fit before them (`relearned`).

    Raises CalibError where the dataset has no such effect, no such parameter, or a member is named in part.
    """
    if name == LEARNED:
        return SelectedEffect(name, (), dict(prior_sigmas))
    family = available_family(dataset, name, user_effects)
    members = family.members
    if family.finer is not None:
        members = tuple(dict.fromkeys([*members, *chain.from_iterable(map(family.finer, members))]))
    named = [(member, {full_name(member, p) for p in member.parameters}) for member in members]
    unknown = sorted(set(prior_sigmas).difference(*(names for _, names in named)))
    if unknown:
        raise CalibError(f"effect {name} has no parameter {unknown[0]!r} for this arm")
    wrong = [key for key, sigma in prior_sigmas.items() if not (np.isfinite(sigma) and sigma > 0.0)]
    if wrong:
        raise CalibError(f"effect {name}: the size of {wrong[0]} is {prior_sigmas[wrong[0]]}; a size is above 0")
    inside = [(member, names) for member, names in named if names & set(prior_sigmas)]
    missing = sorted(set().union(*(names for _, names in inside)) - set(prior_sigmas))
    if missing or not inside:
        raise CalibError(f"effect {name}: no size for {missing[0] if missing else 'any of its parameters'}")
    return SelectedEffect(name, tuple(member for member, _ in inside), dict(prior_sigmas))


def relearned(selected: Sequence[SelectedEffect], steps: Sequence[FitStep]) -> tuple[SelectedEffect, ...]:
    """Selected effects with the learned curves filled in, from an earlier step or learned anew from the last fit.

    Raises CalibError where the curves explain no more than noise would now.
    """
    if all(effect.name != LEARNED for effect in selected):
        return tuple(selected)
    before = {effect.name: effect for step in steps for effect in step.selected}
    saved = next(effect for effect in selected if effect.name == LEARNED)
    curves = before.get(LEARNED) or _learned_anew(steps[-1], saved.prior_sigmas.keys())
    return tuple(curves if effect.name == LEARNED else effect for effect in selected)


def _learned_anew(step: FitStep, names: Collection[str]) -> SelectedEffect:
    """Curves or laws learned from a step's fit: laws where the parameters that were saved are theirs."""
    if step.laws is not None:
        laws = selected_curves(LearnedCurves(step.laws.members, step.laws.log_evidence, laws=step.laws))
        if set(names) == set(laws.prior_sigmas):
            return laws
    couplings = couplings_given(step.calibration) if any(_of_all_joints(name) for name in names) else None
    if couplings is not None:
        return selected_curves(couplings)
    return selected_curves(curves_to_add(step.calibration))


def _of_all_joints(name: str) -> bool:
    return f".{ALL_JOINTS.replace(' ', '_')}_" in name
