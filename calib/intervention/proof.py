"""What differences of paired poses prove: causes without which no explanation of them is nearly as good.

All members of all effects of the catalogue that the condition can move compete for the differences at once. The best
few of them are found, and each is then forbidden in turn: it is proven where the best explanation without it, by
whatever other members, has less log evidence by `MIN_LEAD`, whichever place is left out, and where F test, held-out
pairs, sign and natural bounds agree. One that only takes its place, with a similar size, is no rival: the poses cannot
tell both apart, and they are proven together, as a set. What would have to be larger than nature has it explains
nothing. The noise is estimated with each explanation, so a wrongly declared sigma proves nothing.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from calib.array_types import Array
from calib.brief import Brief
from calib.calibration.result import Calibration
from calib.dataset.dataset import Dataset
from calib.effects.catalogue import effects_for
from calib.effects.catalogue.loads import ToolSag
from calib.effects.effect import (
    CatalogueEffect,
    Effect,
    Family,
    NaturalBound,
    Parameter,
    describe,
    exceeded_bound,
    family_name,
    full_name,
)
from calib.effects.gravity import has_masses
from calib.effects.state import RobotState
from calib.errors import FitError
from calib.intervention.differences import Differences, PairDisplacements, differences_of, displacements_of
from calib.intervention.pairs import APPROACH, PAYLOAD, SETUP, TARGET, TIME, PairedPoses, find_pairs
from calib.kinematics.robot import Robot
from calib.screening.evidence import FamilyColumns, evaluate_family
from calib.screening.leverage import changes_without_each
from calib.statistics import f_sf, group_numbers


@dataclass(frozen=True)
class ToolSagUnderPayload(ToolSag):
    """A tool that gives way to what it carries: it moves by payload times R diag(c) R^T g."""

    equation = "target moves by payload R diag(c) R^T g"
    symbols = (("c", "mm/kg"),)
    needs = "payload_kg that varies"
    bounds = (NaturalBound(1.0, "mm/kg", "a tool that gives way so much is loose"),)
    under_load: ClassVar[bool] = True
    parameters = tuple(
        Parameter(f"{a}_mm_per_kg", "mm/kg", 0.02, f"sag under 1 kg with gravity along the tool's {a}") for a in "xyz"
    )

    def apply(self, state: RobotState, **values: float) -> RobotState:
        """Robot state with the target displaced, by as much as each pose's payload."""
        payload_kg = state.poses.payload_kg
        if payload_kg is None:
            return state
        per_kg = dict(zip(("x_mm", "y_mm", "z_mm"), values.values(), strict=True))
        unloaded = replace(state, displacement_mm=np.zeros((1, 3)))
        sag_mm = super().apply(unloaded, **per_kg).displacement_mm
        return state.displace(payload_kg[:, None] * sag_mm)


MIN_LEAD = 3.5
"""Log evidence by which the best explanation without a cause has to be worse; with 3.5 one of 400 cases is wrong."""
MAX_P = 0.003  # of the F test of a member beside the others, times the number of candidates
FEWEST_PAIRS = 4
_NONLINEAR = ("nonlinear_stiffness", "gravity_backlash", "bearing_clearance")
"""Effects for which the whole load counts, not its change alone."""
_NEXT_TERM = {"nonlinear_stiffness": "joint_compliance"}
"""Effects that are the next term of another's law: no rival of it, and looked for beside it."""
_LEVELS_OF_NEXT_TERM = 3  # of the condition: two show a slope, three its change
_MOVED = 0.01  # share of a column that a condition has to change, if the effect is not known to follow it
_SAME_SIZE = 3.0  # times the value of one member of a set that another one may have
_MOST_ALIKE = 4
_LEFT = 0.5  # share of `MIN_LEAD` that has to be left whichever place is left out


@dataclass(frozen=True)
class ProvenValue(Brief):
    """A parameter of one member of an effect, with its value."""

    effect: str
    joint: int | None  # counted from 1
    parameter: str
    value: float
    sigma: float
    unit: str
    full_name: str  # of the parameter in a model


@dataclass(frozen=True)
class Proof(ProvenValue):
    """A parameter of an effect that differences of paired poses prove, alone or as the first of a set."""

    pairs: int  # that were fitted
    condition: str  # column of poses.csv that was changed; several joined by ", "
    lead: float  # log evidence over the best explanation without it, or without any of the set
    alike: tuple[ProvenValue, ...] = ()  # what these pairs cannot tell apart, itself the first; () where it is alone

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
    proven_members: tuple[tuple[Effect, ...], ...] = ()  # of effects, that the proofs are of, each with those alike
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
    members: list[tuple[Effect, ...]] = []
    for one in found.chosen:
        may_be_proven = follows(one.member, paired.conditions) and _is_significant(differences, found, one)
        if not may_be_proven and not name_open:
            continue
        alike, rivals = _stand_ins(differences, found, one)
        proven, alike = _proof(differences, found, rivals, alike) if may_be_proven else ([], alike)
        proofs += proven
        if proven:
            members.append(tuple(c.member for c in alike))
        else:
            open_causes += map(_cause, [*alike, *(rival for rival in rivals.chosen if rival not in found.chosen)])
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
    """Members of all effects that move with the condition otherwise than the instrument and the tool may have moved.

    Effects that do not follow it have to move for another reason, such as the time that went by: what the joints alone
    decide differs between readings of the joints by noise.
    """
    out = []
    for member in _members(dataset, differences.paired, user_effects):
        least = 0.0 if follows(member, differences.paired.conditions) else _MOVED
        columns = differences.columns(member, least)
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
    """The few members that explain the differences best, chosen among all candidates."""

    candidates: tuple[PairCandidate, ...]
    chosen: tuple[PairCandidate, ...]
    log_evidence: float  # over noise alone
    shaped: Array  # (R_train, K) visible columns of the chosen ones, times their prior scales

    @classmethod
    def of(cls, differences: Differences, candidates: Sequence[PairCandidate]) -> _Explanation:
        """The best explanation by sizes that nature has; none chosen where noise alone is as good."""
        left = list(candidates)
        while left:
            data = FamilyColumns(
                differences.visible_residual,
                tuple(c.visible for c in left),
                differences.dof,
                tuple(c.positive for c in left),
                few=True,
            )
            found = evaluate_family(data)
            chosen = tuple(left[k] for k in np.flatnonzero(found.scales).tolist())
            fitted = _fitted(differences, chosen)
            natural = [_is_natural(one, *values) for one, values in zip(chosen, fitted, strict=True)]
            if found.log_evidence <= 0.0:
                break
            if all(natural):
                scales = found.scales[found.scales > 0.0]
                shaped = [c.visible * scale for c, scale in zip(chosen, scales, strict=True)]
                return cls(tuple(candidates), chosen, found.log_evidence, np.concatenate(shaped, axis=1))
            left = [c for c in left if c not in chosen or natural[chosen.index(c)]]
        return cls(tuple(candidates), (), 0.0, np.zeros((len(differences.visible_residual), 0)))

    def lead_over(self, other: _Explanation) -> float:
        """Log evidence over another explanation; over none at all, with what the choice costs, which F tests count."""
        return self.log_evidence - other.log_evidence + (0.0 if other.chosen else float(np.log(len(self.candidates))))

    def least_lead_over(self, other: _Explanation, differences: Differences) -> float:
        """The same with that place left out that takes most of it away."""
        place = np.repeat(group_numbers(differences.cell[differences.train[::3]]), 3)
        ours, theirs = (
            changes_without_each(differences.visible_residual, one.shaped, differences.basis, place, differences.dof)
            for one in (self, other)
        )
        return self.lead_over(other) + float((ours - theirs).min())

    def beside(self, one: PairCandidate) -> list[PairCandidate]:
        """The chosen members but one."""
        return [c for c in self.chosen if c is not one]


def _stand_ins(
    differences: Differences, found: _Explanation, one: PairCandidate
) -> tuple[list[PairCandidate], _Explanation]:
    """Members that take the place of a chosen one with the same size, itself the first, and the best without them."""
    alike, others = [one], found.beside(one)
    while True:
        candidates = [c for c in found.candidates if c not in alike and _is_rival(c, one)]
        rivals = _Explanation.of(differences, candidates)
        new = [c for c in rivals.chosen if c not in found.chosen]
        is_led = found.lead_over(rivals) >= MIN_LEAD or len(alike) == _MOST_ALIKE
        if is_led or len(new) != 1 or not _is_as_large(differences, others, one, new[0]):
            return alike, rivals
        alike += new


def _is_as_large(
    differences: Differences, others: Sequence[PairCandidate], one: PairCandidate, other: PairCandidate
) -> bool:
    """Whether a member follows the condition, too, and has about the size of one whose place it takes."""
    if len({p.unit for c in (one, other) for p in c.parameters}) > 1:
        return False
    sizes = np.abs([value for c in (one, other) for value in _fitted(differences, [*others, c])[-1][0]])
    return follows(other.member, differences.paired.conditions) and bool(sizes.max() < _SAME_SIZE * sizes.min())


def _proof(
    differences: Differences, found: _Explanation, rivals: _Explanation, alike: list[PairCandidate]
) -> tuple[list[Proof], list[PairCandidate]]:
    """The parameters of a chosen member as proofs, [] where it is not proven, and those that may take its place.

    Args:
        differences: of paired poses.
        found: the best explanation.
        rivals: the best one without any of these.
        alike: the chosen member, and those that may take its place.
    """
    one, others = alike[0], found.beside(alike[0])
    lead = found.lead_over(rivals)
    if lead < MIN_LEAD or found.least_lead_over(rivals, differences) < _LEFT * MIN_LEAD:
        return [], alike
    if _held_out_is_worse(differences, others, one):
        return [], alike
    kept = [c for c in alike if c is one or not _held_out_is_worse(differences, others, c)]
    of_set = tuple(value for c in kept for value in _proven_values(differences, others, c))
    paired, joint = differences.paired, _joint(one.member)
    is_side = paired.conditions == (APPROACH,) and joint is not None
    proofs = [
        Proof(
            **vars(value),
            pairs=differences.pairs,
            condition=f"{APPROACH}{joint + 1}" if is_side and joint is not None else ", ".join(paired.conditions),
            lead=lead,
            alike=of_set if len(kept) > 1 else (),
        )
        for value in _proven_values(differences, others, one)
    ]
    return proofs[:1] if len(kept) > 1 else proofs, kept


def _proven_values(differences: Differences, others: Sequence[PairCandidate], one: PairCandidate) -> list[ProvenValue]:
    """Values of a member beside others; of several parameters those that surely are not zero."""
    cause, (values, sigmas) = _cause(one), _fitted(differences, [*others, one])[-1]
    return [
        ProvenValue(
            cause.effect, cause.joint, parameter.name, value, sigma, parameter.unit, full_name(one.member, parameter)
        )
        for parameter, value, sigma in zip(one.parameters, values, sigmas, strict=True)
        if len(values) == 1 or abs(value) > 2.0 * sigma
    ]


def _is_natural(one: PairCandidate, values: Sequence[float], sigmas: Sequence[float]) -> bool:
    """Whether a member has sizes that nature has, and the sign that physics asks for."""
    if one.positive and len(values) == 1 and values[0] <= 0.0:
        return False
    return not any(
        exceeded_bound(one.member, parameter, value, sigma) is not None or (parameter.positive and value < -2.0 * sigma)
        for parameter, value, sigma in zip(one.parameters, values, sigmas, strict=True)
    )


def _is_significant(differences: Differences, found: _Explanation, one: PairCandidate) -> bool:
    """Whether the F test says that a chosen member is needed beside the other chosen ones."""
    return _p_value(differences, found.beside(one), one) * len(found.candidates) <= MAX_P


def _fitted(differences: Differences, candidates: Sequence[PairCandidate]) -> list[tuple[list[float], list[float]]]:
    """Least-squares values and sigmas of each candidate's parameters, all fitted together."""
    if not candidates:
        return []
    columns = np.concatenate([c.visible for c in candidates], axis=1)
    scales = np.array([p.scale for c in candidates for p in c.parameters])
    x, square, inverse = _least_squares(differences, columns)
    noise2 = square / max(differences.dof - columns.shape[1], 1)
    sigma = np.sqrt(np.maximum(noise2 * np.diag(inverse), 0.0)) * scales
    ends = np.cumsum([len(c.parameters) for c in candidates])[:-1]
    parts = zip(np.split(x * scales, ends), np.split(sigma, ends), strict=True)
    return [(values.tolist(), sigmas.tolist()) for values, sigmas in parts]


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
