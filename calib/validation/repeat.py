"""Several recordings of one arm: which causes come back, and whether their sizes agree.

The causes are those that all recordings together call for: each recording keeps links, tool and instrument of its own,
whose directions are projected out, and the evidence of an effect is that of one set of parameters in all of them.
Causes that a recording's own diagnosis names are looked for beside them.

Each cause is then fitted to each recording by itself, values v_r with covariance C_r. A recording r confirms a cause
where its values lie in the direction v of all others' mean: t = v' C_r^-1 v_r / sqrt(v' C_r^-1 v) is normal with unit
variance where r has nothing of it, however the others came by v. A cause comes back where two recordings or more
confirm it, and all values agree; and where all recordings together call for it, each by itself leaves its class open,
and all values agree and lie on one side. A class is what the data do not tell apart: effects with nearly as much
evidence, and those confounded where masses are not known. Where values do not agree, the recordings contradict each
other; one that agrees and confirms nothing merely says less.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from calib.array_types import Array
from calib.calibration.calibrate import fit_measured
from calib.calibration.promise import misfit_inflation
from calib.calibration.result import Calibration
from calib.dataset.dataset import Dataset
from calib.diagnosis.diagnose import whole_diagnosis
from calib.diagnosis.search_space import SearchSpace
from calib.effects.catalogue import effects_for
from calib.effects.effect import Effect, Family, full_name, part_of
from calib.errors import CalibError, FitError
from calib.presented import Presented
from calib.screening.candidates import MIN_LOG_BAYES_FACTOR
from calib.screening.curves.smooth_joint_error import LEARNED
from calib.screening.evidence import Evidence, FamilyColumns, evaluate_family
from calib.screening.member_columns import visible_columns
from calib.screening.projected_residual import project_residual
from calib.statistics import chi2_sf
from calib.validation.comparison import CameraShift, camera_shifts

CONFIRMED = 0.01
"""p-value of a cause in one recording, given the others, up to which it confirms them."""
ONE_SIDED = 1.0
"""Sigmas by which the values of each recording lie on the side of the others' where all leave a class open."""
AGREE = 0.01  # p-value of all values being one and the same, over all causes told, below which some disagree
SHOWN = 0.01  # p-value of there being nothing of a cause in all recordings, up to which it is told
MIN_EVIDENCE = 7.0
"""Log evidence from which all recordings together call for an effect."""
MOST_EFFECTS = 4
_WIDE = 5.0  # times the prior sigma by all recordings: the values of one recording are its own

Verdict = Literal["repeats", "differs", "too little data"]
Answer = Literal["confirms", "contradicts", "says less"]


@dataclass(frozen=True)
class RepeatedCause:
    """An effect of one joint or of the whole arm, fitted to each recording by itself."""

    cause: str  # effect
    joint: int | None  # counted from 1
    parameter: str  # that is known best, whose values these are
    unit: str
    values: tuple[float | None, ...]  # of each recording; None where it cannot test the effect
    sigmas: tuple[float | None, ...]
    found_in: tuple[str, ...] = field(metadata={"key": "in"})  # recordings that confirm it
    agree: bool  # whether all its values are one and the same within their sigmas
    says: tuple[Answer, ...]  # each recording of it, beside the others
    one_sided: bool = field(metadata={"key": None})  # whether each recording's values lie on the side of the others'
    common: tuple[float, float]  # weighted mean of the values, and its sigma
    called_for: bool  # by all recordings together; else by the diagnosis of one alone
    alike: tuple[str, ...]  # effects of the same class, which the recordings do not tell from it
    is_of_arm: bool  # False: of the instrument or the target, and may be another one each time
    named_alone: tuple[str, ...]  # recordings whose own diagnosis has an effect of its class, open or not

    @property
    def comes_back(self) -> bool:
        """Whether two recordings confirm it, or all leave it open on one side, and none contradicts."""
        left_open = self.called_for and self.one_sided and len(self.named_alone) == len(self.says)
        return self.agree and (len(self.found_in) > 1 or left_open)


@dataclass(frozen=True)
class Recurrence(Presented):
    """Which causes come back in several recordings of one arm."""

    names: tuple[str, ...] = field(metadata={"key": "recordings"})
    causes: tuple[RepeatedCause, ...]
    alone: tuple[tuple[str, ...], ...]  # effects that each recording's own diagnosis names
    cameras: tuple[tuple[str, CameraShift], ...] = ()  # recordings after the first, by how far a camera moved since it

    @property
    def verdict(self) -> Verdict:
        """Whether causes of the arm come back, or contradict each other, or the recordings say too little."""
        of_arm = [cause for cause in self.causes if cause.is_of_arm and cause.called_for]
        if any(not cause.agree for cause in of_arm):
            return "differs"
        return "repeats" if any(cause.comes_back for cause in of_arm) else "too little data"

    def _brief(self) -> str:
        again = ", ".join(dict.fromkeys(cause.cause for cause in self.causes if cause.comes_back)) or "no cause"
        return f"{' and '.join(self.names)}: {self.verdict}, {again} comes back"


def recurrence_of(fits: Sequence[Calibration], *, on_step: Callable[[str], None] | None = None) -> Recurrence:
    """Which causes come back in several recordings of one arm, by the fits of their links: see `calib.repeat`."""
    if len(fits) < 2:
        raise CalibError(f"found {len(fits)} recording; what comes back shows in two or more")
    kinds = [fit.dataset.robot.is_revolute.tolist() for fit in fits]
    for fit, kind in zip(fits, kinds, strict=True):
        if kind != kinds[0]:
            first = fits[0].dataset
            raise FitError(f"{fit.dataset.name}: its joints are not those of {first.name}, so it is another arm")
    names = _distinct([fit.dataset.name for fit in fits])
    tell = on_step or (lambda _: None)
    tell("all recordings together")
    common = _common_effects(fits)
    alone: list[tuple[str, ...]] = []
    for name, fit in zip(names, fits, strict=True):
        tell(name)
        found = whole_diagnosis(SearchSpace.of(fit.dataset, fit.options))
        alone.append(tuple(one.name for one in found.steps[-1].selected if one.name != LEARNED))
    rows = _rows(fits, names, common, alone, set())
    further = {name for own in alone for name in own} - {one.name for one in common}
    for family in (one for one in _shared_families(fits) if one.name in further):
        rows += _rows(fits, names, [*common, _CommonEffect.whole(family)], alone, {one.name for one in common})
    later = zip(names[1:], fits[1:], strict=True)
    cameras = [(name, shift) for name, fit in later for shift in camera_shifts(fits[0], fit)]
    return Recurrence(tuple(names), tuple(rows), tuple(alone), tuple(cameras))


def _distinct(names: Sequence[str]) -> list[str]:
    """Names of the recordings, numbered where two are alike."""
    return [name if list(names).count(name) == 1 else f"{name} ({k})" for k, name in enumerate(names, 1)]


# ---- what all recordings call for -----------------------------------------------------------------------------------


@dataclass(frozen=True)
class _CommonEffect:
    """An effect with the members and prior sigmas that fit all recordings best."""

    name: str
    members: tuple[Effect, ...]
    prior_sigmas: dict[str, float]  # by full parameter name
    alike: tuple[str, ...] = ()

    @classmethod
    def whole(cls, family: Family) -> _CommonEffect:
        """All members of an effect, of their usual sizes."""
        prior = {full_name(m, p): p.scale for m in family.members for p in m.parameters}
        return cls(family.name, family.members, prior, family.confounded_with)

    @classmethod
    def of(cls, family: Family, evidence: Evidence, alike: tuple[str, ...]) -> _CommonEffect:
        """The members of an effect that its evidence chose."""
        chosen = np.flatnonzero(evidence.scales).tolist()
        prior = {
            full_name(family.members[k], p): float(evidence.scales[k]) * p.scale
            for k in chosen
            for p in family.members[k].parameters
        }
        return cls(family.name, tuple(family.members[k] for k in chosen), prior, alike)


def _shared_families(fits: Sequence[Calibration]) -> list[Family]:
    """Effects that every recording can test, and none that is of single poses, places or times."""
    found: dict[str, list[Family]] = {}
    for fit in fits:
        for family in effects_for(fit.dataset):
            if not family.why_not and not family.sparse and family.members:
                found.setdefault(family.name, []).append(family)
    return [
        of_name[0]
        for of_name in found.values()
        if len(of_name) == len(fits) and all(one.members == of_name[0].members for one in of_name)
    ]


def _common_effects(fits: Sequence[Calibration]) -> list[_CommonEffect]:
    """Effects that all recordings together call for, one after the other, the clearest first."""
    families, chosen = _shared_families(fits), list[_CommonEffect]()
    while len(chosen) < MOST_EFFECTS:
        taken = {one.name for one in chosen}
        try:
            evidence = _evidence([_fitted(fit.dataset, chosen) if chosen else fit for fit in fits], families)
        except FitError:  # too few poses in one of them for another effect
            break
        each = [(e, f) for f, e in zip(families, evidence, strict=True) if e is not None and f.name not in taken]
        each.sort(key=lambda one: -one[0].log_evidence)
        if not each or each[0][0].log_evidence < MIN_EVIDENCE:
            break
        best, family = each[0]
        near = [other.name for e, other in each[1:] if e.log_evidence > best.log_evidence - MIN_LOG_BAYES_FACTOR]
        chosen.append(_CommonEffect.of(family, best, tuple(dict.fromkeys([*near, *family.confounded_with]))))
    return chosen


def _evidence(fits: Sequence[Calibration], families: Sequence[Family]) -> list[Evidence | None]:
    """Evidence of each effect with the same parameters in all recordings; None where none of it shows."""
    projected = [project_residual(fit) for fit in fits]
    residual = np.concatenate([-one.residual / one.sigma for one in projected])
    dof = sum(one.dof for one in projected)
    out: list[Evidence | None] = []
    for family in families:
        each = [visible_columns(one, family).groups for one in projected]
        groups = tuple(
            np.concatenate([columns[k] / one.sigma for columns, one in zip(each, projected, strict=True)])
            for k in range(len(family.members))
        )
        if not any(group.any() for group in groups):
            out.append(None)
            continue
        positive = tuple(all(p.positive for p in member.parameters) for member in family.members)
        out.append(evaluate_family(FamilyColumns(residual, groups, dof, positive)))
    return out


# ---- what each recording says of it ---------------------------------------------------------------------------------


def _fitted(dataset: Dataset, effects: Sequence[_CommonEffect], widened: float = 1.0) -> Calibration:
    """A recording fitted with some effects."""
    members = [member for one in effects for member in one.members]
    prior = {name: widened * sigma for one in effects for name, sigma in one.prior_sigmas.items()}
    return fit_measured(dataset, effects=members, prior_sigmas=prior)


@dataclass(frozen=True)
class _Estimate:
    """Values (K,) of a member's parameters by one recording, with their covariance (K, K)."""

    values: Array
    covariance: Array

    @property
    def information(self) -> Array:
        """Inverse (K, K) of the covariance."""
        return _inverse(self.covariance)


def _inverse(matrix: Array) -> Array:
    """Inverse of a positive matrix whose rows have different units."""
    size = np.sqrt(np.maximum(np.diag(matrix), 1e-300))
    return np.linalg.pinv(matrix / np.outer(size, size), hermitian=True) / np.outer(size, size)


def _rows(
    fits: Sequence[Calibration],
    names: Sequence[str],
    effects: Sequence[_CommonEffect],
    alone: Sequence[Sequence[str]],
    told: set[str],
) -> list[RepeatedCause]:
    """Causes among some effects, but those told already, by fits of all these effects to each recording."""
    models = [_or_none(fit, effects) for fit in fits]
    rows = []
    for effect in (one for one in effects if one.name not in told):
        for member in effect.members:
            estimates = [None if model is None else _estimate(model, member) for model in models]
            known = [one for one in estimates if one is not None]
            if known and _is_shown(mean := _mean(known)):
                rows.append(_row(names, effect, member, estimates, mean, alone, called_for=not told))
    return rows


def _row(
    names: Sequence[str],
    effect: _CommonEffect,
    member: Effect,
    estimates: Sequence[_Estimate | None],
    mean: _Estimate,
    alone: Sequence[Sequence[str]],
    *,
    called_for: bool,
) -> RepeatedCause:
    known = [one for one in estimates if one is not None]
    weight = np.sum([1.0 / np.diag(one.covariance) for one in known], axis=0)
    value = np.sum([one.values / np.diag(one.covariance) for one in known], axis=0) / weight
    k = int(np.argmax(np.abs(value) * np.sqrt(weight)))
    joint = getattr(member, "joint", None)
    beside = [_sigmas_beside_others(estimates, number) for number in range(len(names))]
    confirms = [0.5 * math.erfc(sigmas / math.sqrt(2.0)) <= CONFIRMED for sigmas in beside]
    agree = _agree(known, mean, len(effect.members))
    return RepeatedCause(
        cause=effect.name,
        joint=None if joint is None else int(joint) + 1,
        parameter=member.parameters[k].name,
        unit=member.parameters[k].unit,
        values=tuple(None if one is None else float(one.values[k]) for one in estimates),
        sigmas=tuple(None if one is None else float(np.sqrt(one.covariance[k, k])) for one in estimates),
        found_in=tuple(name for name, confirmed in zip(names, confirms, strict=True) if confirmed),
        agree=agree,
        says=tuple("contradicts" if not agree else "confirms" if one else "says less" for one in confirms),
        one_sided=min(beside) > ONE_SIDED,
        common=(float(value[k]), float(weight[k] ** -0.5)),
        called_for=called_for,
        alike=effect.alike,
        is_of_arm=part_of(member) == "arm",
        named_alone=tuple(
            name for name, own in zip(names, alone, strict=True) if {effect.name, *effect.alike} & set(own)
        ),
    )


def _or_none(fit: Calibration, effects: Sequence[_CommonEffect]) -> Calibration | None:
    try:
        return _fitted(fit.dataset, effects, _WIDE)
    except FitError:  # too few poses for so many effects
        return None


def _estimate(model: Calibration, member: Effect) -> _Estimate | None:
    """Values of a member's parameters in a fit; None where the fit has not all of them."""
    place = {parameter.name: k for k, parameter in enumerate(model.fit.parameters)}
    rows = [place.get(full_name(member, parameter), -1) for parameter in member.parameters]
    if min(rows) < 0:
        return None
    return _Estimate(model.fit.x[rows], model.fit.covariance[np.ix_(rows, rows)] * misfit_inflation(model))


def _mean(estimates: Sequence[_Estimate]) -> _Estimate:
    """Weighted mean of several estimates of the same values."""
    information = np.sum([one.information for one in estimates], axis=0)
    covariance = _inverse(information)
    along = np.sum([one.information @ one.values for one in estimates], axis=0)
    return _Estimate(covariance @ along, covariance)


def _sigmas_beside_others(estimates: Sequence[_Estimate | None], number: int) -> float:
    """Sigmas by which one recording's values lie in the direction of the others' mean; 0 where there are no others."""
    own = estimates[number]
    others = [one for k, one in enumerate(estimates) if k != number and one is not None]
    if own is None or not others:
        return 0.0
    direction = _mean(others).values
    along = own.information @ direction
    size = math.sqrt(max(float(direction @ along), 0.0))
    return float(along @ own.values) / size if size > 0.0 else 0.0


def _is_shown(mean: _Estimate) -> bool:
    """Whether all recordings together show more of a member than noise."""
    return chi2_sf(float(mean.values @ mean.information @ mean.values), len(mean.values)) <= SHOWN


def _agree(estimates: Sequence[_Estimate], mean: _Estimate, members: int) -> bool:
    """Whether all estimates of one of several members are of one and the same values."""
    if len(estimates) < 2:
        return True
    off = sum(float((one.values - mean.values) @ one.information @ (one.values - mean.values)) for one in estimates)
    return chi2_sf(off, (len(estimates) - 1) * len(mean.values)) > AGREE / members
