"""What differences of paired poses prove: causes without which no explanation of them is nearly as good.

All members of all effects of the catalogue compete for the differences under one condition at once. The best set of
them is found, and each of its members is then forbidden in turn: it is proven where the best explanation without it,
by whatever other members, has less log evidence by `MIN_LEAD`, and where F test, held-out pairs, sign and natural
bounds agree. The noise is estimated with each explanation, so a wrongly declared sigma proves nothing.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from calib.array_types import Array
from calib.brief import Brief
from calib.calibration.result import Calibration
from calib.dataset.dataset import Dataset
from calib.distributions import f_sf
from calib.effects.catalogue import effects_for
from calib.effects.effect import Effect, Family, Parameter, describe, exceeded_bound, family_name, full_name
from calib.effects.gravity import has_masses
from calib.errors import FitError
from calib.intervention.differences import Differences, differences_of
from calib.intervention.loaded_tool import ToolSagUnderPayload
from calib.intervention.pairs import APPROACH, PAYLOAD, SETUP, TARGET, TIME, PairedPoses, find_pairs
from calib.kinematics.robot import Robot
from calib.screening.evidence import FamilyColumns, evaluate_family

MIN_LEAD = 3.0
"""Log evidence by which the best explanation without a cause has to be worse."""
MAX_P = 0.01  # of the F test of a member beside the others, times the number of members
_FEWEST_PAIRS = 4
_NONLINEAR = ("nonlinear_stiffness", "gravity_backlash", "bearing_clearance")
"""Effects for which the whole load counts, not its change alone."""
_NEXT_TERM = {"nonlinear_stiffness": "joint_compliance"}
"""Effects that are the next term of another's law: no rival of it, and looked for beside it."""


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
    levels: tuple[float, ...]  # of the condition, where it is a number for the whole arm
    lead: float  # log evidence over the best explanation without it
    held_out: int  # pairs of test poses, which confirm it
    full_name: str  # of the parameter in a model

    def _brief(self) -> str:
        return f"{self.full_name} = {self.value:.3g} +- {self.sigma:.2g} {self.unit}, {self.pairs} pairs"


@dataclass(frozen=True)
class _Candidate:
    """A member of an effect with its columns in the differences."""

    member: Effect
    parameters: tuple[Parameter, ...]  # those that the differences show
    columns: Array  # (R, K) of all pairs
    visible: Array  # (R_train, K)

    @property
    def positive(self) -> bool:
        return all(p.positive for p in self.parameters)


def proofs_of(calibration: Calibration, user_effects: Sequence[Family] = ()) -> tuple[Proof, ...]:
    """Causes that the paired poses of a calibration's dataset prove, condition by condition."""
    out: list[Proof] = []
    for paired in find_pairs(calibration.dataset):
        if paired.conditions[0] in (SETUP, TARGET, TIME):  # these move the instrument or the tool, and no effect
            continue
        out += _proofs_of_condition(calibration, paired, user_effects)
    return tuple(out)


def _proofs_of_condition(
    calibration: Calibration, paired: PairedPoses, user_effects: Sequence[Family]
) -> tuple[Proof, ...]:
    if len(paired.pairs) < _FEWEST_PAIRS:
        return ()
    robot = calibration.model.calibrated_robot(calibration.fit.x)
    try:
        differences = differences_of(calibration, paired, _with_masses(robot))
    except FitError:
        return ()
    if differences is None:
        return ()
    candidates = _candidates(differences, _members(calibration.dataset, paired, user_effects))
    found = _Explanation.of(differences, [c for c in candidates if family_name(c.member) not in _NEXT_TERM])
    beside = {(_joint(c.member), family_name(c.member)) for c in found.chosen}
    further = [c for c in candidates if (_joint(c.member), _NEXT_TERM.get(family_name(c.member), "")) in beside]
    if further:
        with_next = _Explanation.of(differences, [*found.candidates, *further])
        if with_next.log_evidence > found.log_evidence + MIN_LEAD:
            found = with_next
    return tuple(
        proof
        for one in found.chosen
        if _can_be_moved(one.member, paired.conditions)
        for proof in _proof(differences, found, one)
    )


def _members(dataset: Dataset, paired: PairedPoses, user_effects: Sequence[Family]) -> list[Effect]:
    """Members of all effects that compete: those of single places or poses apart, which have hundreds."""
    known = has_masses(dataset.robot)
    families = effects_for(replace(dataset, robot=_with_masses(dataset.robot)))
    members = [
        member
        for family in (*families, *user_effects)
        if not family.sparse and not family.why_not and (known or family.name not in _NONLINEAR)
        for member in family.members
    ]
    if PAYLOAD in paired.conditions:
        members.append(ToolSagUnderPayload())
    return members


def _with_masses(robot: Robot) -> Robot:
    """The robot with weightless links where their masses are not known: what does not change cancels in differences."""
    if has_masses(robot):
        return robot
    joints = tuple(replace(joint, mass_kg=0.0, com_mm=(0.0, 0.0, 0.0)) for joint in robot.joints)
    return replace(robot, joints=joints)


def _candidates(differences: Differences, members: Sequence[Effect]) -> list[_Candidate]:
    """Members that move with the condition otherwise than the instrument and the tool may have moved."""
    out = []
    for member in members:
        columns = differences.columns(member)
        if not columns.any():
            continue
        visible = differences.visible(columns)
        shown = np.any(visible, axis=0)
        if shown.any():
            parameters = tuple(p for p, is_shown in zip(member.parameters, shown, strict=True) if is_shown)
            out.append(_Candidate(member, parameters, columns[:, shown], visible[:, shown]))
    return out


@dataclass(frozen=True)
class _Explanation:
    """The members that explain the differences best, chosen among all candidates."""

    candidates: tuple[_Candidate, ...]
    chosen: tuple[_Candidate, ...]
    log_evidence: float  # over noise alone

    @classmethod
    def of(cls, differences: Differences, candidates: Sequence[_Candidate]) -> _Explanation:
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


def _proof(differences: Differences, found: _Explanation, one: _Candidate) -> list[Proof]:
    """The parameters of a chosen member as proofs; [] where it is not proven."""
    others = [c for c in found.chosen if c is not one]
    rivals = [c for c in found.candidates if c is not one and not _is_next_term_of(c, one)]
    lead = found.log_evidence - _Explanation.of(differences, rivals).log_evidence
    if lead < MIN_LEAD or _p_value(differences, others, one) * len(found.candidates) > MAX_P:
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
            levels=paired.levels,
            lead=lead,
            held_out=len(paired.pairs) - differences.pairs,
            full_name=full_name(one.member, parameter),
        )
        for parameter, value, sigma in zip(one.parameters, values, sigmas, strict=True)
        if len(values) == 1 or abs(value) > 2.0 * sigma
    ]


def _fitted(differences: Differences, candidates: Sequence[_Candidate]) -> tuple[list[float], list[float]]:
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


def _p_value(differences: Differences, others: Sequence[_Candidate], one: _Candidate) -> float:
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


def _held_out_is_worse(differences: Differences, others: Sequence[_Candidate], one: _Candidate) -> bool:
    """Whether the pairs of test poses are predicted worse with a member than by the others alone."""
    errors = []
    for candidates in ([*others], [*others, one]):
        nothing = np.zeros((len(differences.residual), 0))
        columns = np.concatenate([nothing, *(c.columns for c in candidates)], axis=1)
        visible = np.concatenate([nothing[differences.train], *(c.visible for c in candidates)], axis=1)
        errors.append(differences.held_out_square(columns, _least_squares(differences, visible)[0]))
    before, after = errors
    return before is not None and after is not None and after > before


def _can_be_moved(member: Effect, conditions: Sequence[str]) -> bool:
    """Whether an effect follows one of the conditions by what is said of it; others may move with it by chance."""
    told = describe(member)
    named: set[str] = {*told.needed_conditions, *told.helpful_conditions}
    if getattr(member, "under_load", False):
        named.add(PAYLOAD)
    return any(condition in named for condition in conditions)


def _is_next_term_of(candidate: _Candidate, one: _Candidate) -> bool:
    """Whether a candidate is the next term of another's law, on the same joint."""
    own = (_joint(one.member), family_name(one.member))
    return (_joint(candidate.member), _NEXT_TERM.get(family_name(candidate.member), "")) == own


def _joint(member: Effect) -> int | None:
    joint = getattr(member, "joint", None)
    return None if joint is None else int(joint)
