"""What differences of paired poses prove: causes without which no explanation of them is nearly as good.

All members of all effects of the catalogue compete for the differences under one condition at once. The best set of
them is found, and each of its members is then forbidden in turn: it is proven where the best explanation without it,
by whatever other members, has less log evidence by `MIN_LEAD`, and where F test, held-out pairs, sign and natural
bounds agree. The noise is estimated with each explanation, so a wrongly declared sigma proves nothing.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace

import numpy as np

from calib.array_types import Array
from calib.brief import Brief
from calib.calibration.result import Calibration
from calib.dataset.dataset import Dataset
from calib.effects.catalogue import effects_for
from calib.effects.effect import (
    CatalogueEffect,
    Effect,
    Family,
    Parameter,
    describe,
    exceeded_bound,
    family_name,
    full_name,
)
from calib.effects.gravity import has_masses
from calib.errors import FitError
from calib.intervention.differences import Differences, differences_of
from calib.intervention.displacements import PairDisplacements, displacements_of
from calib.intervention.pairs import APPROACH, PAYLOAD, SETUP, TARGET, TIME, PairedPoses, find_pairs
from calib.intervention.payload_sag import ToolSagUnderPayload
from calib.kinematics.robot import Robot
from calib.screening.evidence import FamilyColumns, evaluate_family
from calib.statistics import f_sf

MIN_LEAD = 3.5
"""Log evidence by which the best explanation without a cause has to be worse; with 3.5 one of 400 cases is wrong."""
MAX_P = 0.003  # of the F test of a member beside the others, times the number of candidates
FEWEST_PAIRS = 4
_NONLINEAR = ("nonlinear_stiffness", "gravity_backlash", "bearing_clearance")
"""Effects for which the whole load counts, not its change alone."""
_NEXT_TERM = {"nonlinear_stiffness": "joint_compliance"}
"""Effects that are the next term of another's law: no rival of it, and looked for beside it."""
_LEVELS_OF_NEXT_TERM = 3  # of the condition: two show a slope, three its change


@dataclass(frozen=True)
class Proof(Brief):
    """A parameter of an effect that differences of paired poses prove."""

    effect: str
    joint: int | None  # counted from 1
    parameter: str
    value: float
    sigma: float
    unit: str
    pairs: int  # that were fitted
    condition: str  # column of poses.csv that was changed; several joined by ", "
    lead: float  # log evidence over the best explanation without it
    full_name: str  # of the parameter in a model

    def _brief(self) -> str:
        return f"{self.full_name} = {self.value:.3g} +- {self.sigma:.2g} {self.unit}, {self.pairs} pairs"


@dataclass(frozen=True)
class Cause:
    """An effect, and the joint that carries it, counted from 1; None where it is of the whole arm."""

    effect: str
    joint: int | None


@dataclass(frozen=True)
class Intervention(Brief):
    """A condition that was changed at paired poses, and what the differences prove."""

    conditions: tuple[str, ...]
    levels: tuple[float, ...]  # of the condition, where it is one number for the whole arm
    pairs: int  # that were fitted
    held_out: int  # pairs of test poses
    proofs: tuple[Proof, ...]
    open_causes: tuple[Cause, ...]  # that the differences call for, but do not tell apart; the likeliest first
    proven_members: tuple[Effect, ...] = ()  # of effects, that the proofs are of
    displacements: PairDisplacements | None = None  # of real pairs; None where a simulated follow-up was judged

    def _brief(self) -> str:
        return f"{', '.join(self.conditions)}, {self.pairs} pairs: {len(self.proofs)} values proven"


@dataclass(frozen=True)
class PairCandidate:
    """A member of an effect with its columns in the differences."""

    member: Effect
    parameters: tuple[Parameter, ...]  # those that the differences show
    columns: Array  # (R, K) of all pairs
    visible: Array  # (R_train, K)

    @property
    def positive(self) -> bool:
        return all(p.positive for p in self.parameters)


def interventions_of(calibration: Calibration, user_effects: Sequence[Family] = ()) -> tuple[Intervention, ...]:
    """What the paired poses of a calibration's dataset prove, condition by condition.

    Poses that differ in setup, target or time alone say nothing of an effect: the instrument or the tool was moved.
    """
    acting = [p for p in find_pairs(calibration.dataset) if p.conditions[0] not in (SETUP, TARGET, TIME)]
    found = (_intervention(calibration, paired, user_effects) for paired in acting)
    return tuple(one for one in found if one is not None)


def _intervention(calibration: Calibration, paired: PairedPoses, user_effects: Sequence[Family]) -> Intervention | None:
    """What the pairs of one condition prove; None where they are too few to prove anything."""
    robot = with_masses(calibration.model.calibrated_robot(calibration.fit.x))
    try:
        differences = differences_of(calibration.dataset, paired, robot)
    except FitError:
        return None
    if differences is None or differences.pairs < FEWEST_PAIRS:
        return None
    candidates = candidates_of(differences, calibration.dataset, user_effects)
    found = decided(differences, candidates)
    return replace(
        found, displacements=displacements_of(differences, _explained(differences, candidates, found.proofs))
    )


def _explained(differences: Differences, candidates: Sequence[PairCandidate], proofs: Sequence[Proof]) -> Array:
    """What proven values add to the differences (R,), in sigmas."""
    values = {proof.full_name: proof.value for proof in proofs}
    explained = np.zeros(len(differences.residual))
    for candidate in candidates:
        amounts = [values.get(full_name(candidate.member, p), 0.0) / p.scale for p in candidate.parameters]
        explained += candidate.columns @ np.array(amounts)
    return explained


def decided(differences: Differences, candidates: Sequence[PairCandidate], *, name_open: bool = True) -> Intervention:
    """What differences prove, with all candidates competing for them; without the open causes where none asks."""
    paired = differences.paired
    found = _Explanation.of(differences, [c for c in candidates if family_name(c.member) not in _NEXT_TERM])
    beside = {(_joint(c.member), family_name(c.member)) for c in found.chosen}
    further = [c for c in candidates if (_joint(c.member), _NEXT_TERM.get(family_name(c.member), "")) in beside]
    if further and len(paired.levels) >= _LEVELS_OF_NEXT_TERM:
        with_next = _Explanation.of(differences, [*found.candidates, *further])
        if with_next.log_evidence > found.log_evidence + MIN_LEAD:
            found = with_next
    proofs: list[Proof] = []
    open_causes: list[Cause] = []
    members: list[Effect] = []
    for one in found.chosen:
        may_be_proven = follows(one.member, paired.conditions) and _is_significant(differences, found, one)
        if not may_be_proven and not name_open:
            continue
        rivals = _Explanation.of(differences, [c for c in found.candidates if _is_rival(c, one)])
        proven = _proof(differences, found, rivals, one) if may_be_proven else []
        proofs += proven
        members += [one.member] if proven else []
        if not proven:
            open_causes += [_cause(one), *(_cause(rival) for rival in rivals.chosen if rival not in found.chosen)]
    return Intervention(
        conditions=paired.conditions,
        levels=paired.levels,
        pairs=differences.pairs,
        held_out=len(paired.pairs) - differences.pairs,
        proofs=tuple(proofs),
        open_causes=tuple(dict.fromkeys(open_causes)) if name_open else (),
        proven_members=tuple(members),
    )


def candidates_of(
    differences: Differences, dataset: Dataset, user_effects: Sequence[Family] = ()
) -> list[PairCandidate]:
    """Members of all effects that move with the condition otherwise than the instrument and the tool may have moved."""
    out = []
    for member in _members(dataset, differences.paired, user_effects):
        columns = differences.columns(member)
        if not columns.any():
            continue
        visible = differences.visible(columns)
        shown = np.any(visible, axis=0)
        if shown.any():
            parameters = tuple(p for p, is_shown in zip(member.parameters, shown, strict=True) if is_shown)
            out.append(PairCandidate(member, parameters, columns[:, shown], visible[:, shown]))
    return out


def _members(dataset: Dataset, paired: PairedPoses, user_effects: Sequence[Family]) -> list[Effect]:
    """Members of all effects that compete: those of single places or poses apart, which have hundreds."""
    known = has_masses(dataset.robot)
    families = effects_for(replace(dataset, robot=with_masses(dataset.robot)))
    members = [
        member
        for family in (*families, *user_effects)
        if not family.sparse and not family.why_not and (known or family.name not in _NONLINEAR)
        for member in family.members
    ]
    if PAYLOAD in paired.conditions:
        members.append(ToolSagUnderPayload())
    return members


def with_masses(robot: Robot) -> Robot:
    """The robot with weightless links where their masses are not known: what does not change cancels in differences."""
    if has_masses(robot):
        return robot
    joints = tuple(replace(joint, mass_kg=0.0, com_mm=(0.0, 0.0, 0.0)) for joint in robot.joints)
    return replace(robot, joints=joints)


@dataclass(frozen=True)
class _Explanation:
    """The members that explain the differences best, chosen among all candidates."""

    candidates: tuple[PairCandidate, ...]
    chosen: tuple[PairCandidate, ...]
    log_evidence: float  # over noise alone

    @classmethod
    def of(cls, differences: Differences, candidates: Sequence[PairCandidate]) -> _Explanation:
        """The best explanation by some candidates; none chosen where noise alone is as good."""
        if not candidates:
            return cls((), (), 0.0)
        positive = tuple(c.positive for c in candidates)
        columns = tuple(c.visible for c in candidates)
        found = evaluate_family(FamilyColumns(differences.visible_residual, columns, differences.dof, positive))
        if found.log_evidence <= 0.0:
            return cls(tuple(candidates), (), 0.0)
        chosen = tuple(candidates[k] for k in np.flatnonzero(found.scales).tolist())
        return cls(tuple(candidates), chosen, found.log_evidence)


def _proof(differences: Differences, found: _Explanation, rivals: _Explanation, one: PairCandidate) -> list[Proof]:
    """The parameters of a chosen member as proofs; [] where it is not proven against the best rival explanation."""
    others = [c for c in found.chosen if c is not one]
    lead = found.log_evidence - rivals.log_evidence
    if not rivals.chosen:  # against nothing at all, the F test counts the choice
        lead += float(np.log(len(found.candidates)))
    if lead < MIN_LEAD:
        return []
    values, sigmas = _fitted(differences, [*others, one])
    for parameter, value, sigma in zip(one.parameters, values, sigmas, strict=True):
        beyond = exceeded_bound(one.member, parameter, value, sigma) is not None
        if (
            beyond
            or (parameter.positive and value < -2.0 * sigma)
            or (one.positive and value <= 0.0 and len(values) == 1)
        ):
            return []
    if _held_out_is_worse(differences, others, one):
        return []
    paired, name = differences.paired, family_name(one.member)
    joint = _joint(one.member)
    is_side = paired.conditions == (APPROACH,) and joint is not None
    return [
        Proof(
            effect=name,
            joint=None if joint is None else joint + 1,
            parameter=parameter.name,
            value=value,
            sigma=sigma,
            unit=parameter.unit,
            pairs=differences.pairs,
            condition=f"{APPROACH}{joint + 1}" if is_side and joint is not None else ", ".join(paired.conditions),
            lead=lead,
            full_name=full_name(one.member, parameter),
        )
        for parameter, value, sigma in zip(one.parameters, values, sigmas, strict=True)
        if len(values) == 1 or abs(value) > 2.0 * sigma
    ]


def _is_significant(differences: Differences, found: _Explanation, one: PairCandidate) -> bool:
    """Whether the F test says that a chosen member is needed beside the other chosen ones."""
    others = [c for c in found.chosen if c is not one]
    return _p_value(differences, others, one) * len(found.candidates) <= MAX_P


def _fitted(differences: Differences, candidates: Sequence[PairCandidate]) -> tuple[list[float], list[float]]:
    """Least-squares values and sigmas of the last candidate's parameters, beside all others."""
    columns = np.concatenate([c.visible for c in candidates], axis=1)
    scales = np.array([p.scale for c in candidates for p in c.parameters])
    x, square, inverse = _least_squares(differences, columns)
    noise2 = square / max(differences.dof - columns.shape[1], 1)
    sigma = np.sqrt(np.maximum(noise2 * np.diag(inverse), 0.0)) * scales
    width = len(candidates[-1].parameters)
    return (x * scales)[-width:].tolist(), sigma[-width:].tolist()


def _least_squares(differences: Differences, columns: Array) -> tuple[Array, float, Array]:
    """Coefficients (K,), squared rest and inverse normal matrix (K, K) of a fit of visible columns (R_train, K)."""
    residual = differences.visible_residual
    inverse = np.linalg.pinv(columns.T @ columns, rcond=1e-12)
    x = inverse @ (columns.T @ residual)
    rest = residual - columns @ x
    return x, float(rest @ rest), np.asarray(inverse)


def _p_value(differences: Differences, others: Sequence[PairCandidate], one: PairCandidate) -> float:
    """F test of a member beside other members."""
    nothing = np.zeros((len(one.visible), 0))
    before = np.concatenate([nothing, *(c.visible for c in others)], axis=1)
    after = np.concatenate([before, one.visible], axis=1)
    width, dof = one.visible.shape[1], differences.dof - after.shape[1]
    if dof < 1:
        return 1.0
    square = _least_squares(differences, after)[1]
    gain = max(_least_squares(differences, before)[1] - square, 0.0)
    return float(f_sf(gain / width / max(square / dof, 1e-300), width, dof))


def _held_out_is_worse(differences: Differences, others: Sequence[PairCandidate], one: PairCandidate) -> bool:
    """Whether the pairs of test poses are predicted worse with a member than by the others alone."""
    errors = []
    for candidates in ([*others], [*others, one]):
        nothing = np.zeros((len(differences.residual), 0))
        columns = np.concatenate([nothing, *(c.columns for c in candidates)], axis=1)
        visible = np.concatenate([nothing[differences.train], *(c.visible for c in candidates)], axis=1)
        errors.append(differences.held_out_square(columns, _least_squares(differences, visible)[0]))
    before, after = errors
    return before is not None and after is not None and after > before


def follows(effect: Effect | type[CatalogueEffect], conditions: Collection[str]) -> bool:
    """Whether an effect follows one of some conditions by what is said of it; others may move with it by chance."""
    told = describe(effect)
    named: set[str] = {*told.needed_conditions, *told.helpful_conditions}
    if getattr(effect, "under_load", False):
        named.add(PAYLOAD)
    if "temperature_c" in named:
        named.update(name for name in conditions if name.startswith("temperature_"))
    return not named.isdisjoint(conditions)


def _is_rival(candidate: PairCandidate, one: PairCandidate) -> bool:
    """Whether a candidate may explain what another does: any but itself and the next term of its own law."""
    next_term_of = (_joint(candidate.member), _NEXT_TERM.get(family_name(candidate.member), ""))
    return candidate is not one and next_term_of != (_joint(one.member), family_name(one.member))


def _cause(candidate: PairCandidate) -> Cause:
    joint = _joint(candidate.member)
    return Cause(family_name(candidate.member), None if joint is None else joint + 1)


def _joint(member: Effect) -> int | None:
    joint = getattr(member, "joint", None)
    return None if joint is None else int(joint)
