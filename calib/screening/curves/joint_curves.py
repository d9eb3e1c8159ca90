"""Error curves of joints learned from a fit's residual: candidates, evidence, and the modes or formulas to fit."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from calib.array_types import Array, IndexArray
from calib.blas_threads import one_blas_thread
from calib.calibration.result import Calibration
from calib.dataset.further_columns import is_number
from calib.dataset.input_names import further_inputs, quantity_of
from calib.effects.gravity import loaded_joints
from calib.screening.curves.curve_evidence import CurveColumns, CurveEvidence, CurvePosterior, Spectrum
from calib.screening.curves.law_search import (
    MIN_STANDARD_ERRORS,
    FoundLaws,
    law_columns,
    law_member,
    left_out_with,
    standard_errors_of_fall,
    summed_laws,
)
from calib.screening.curves.laws import OF_ONE_INPUT, LawForm
from calib.screening.curves.smooth_joint_error import (
    CurveModes,
    FormulaModes,
    FormulaTerm,
    SmoothJointError,
    input_values,
    inputs_named,
    inputs_of,
    joints_of,
)
from calib.screening.left_out import cross_validated_rmse_mm
from calib.screening.projected_residual import ProjectedResidual, joint_directions, project_residual
from calib.statistics import rms

MIN_LOG_EVIDENCE = 8.0  # over no curve at all: noise alone reached 2.5 in 12 clean arms
_BANDS = (48, 120, 240)  # waves a turn over a joint's angle, up to which curves are learned one after another
MOST_WORK = 1.5e9  # rows^2 times columns, up to which a wider band is tried
_MAY_GO_ON = 0.05  # of the prior sigma of the lowest order, that the highest has where a wider band is tried
_OTHER_ORDERS: IndexArray = np.arange(1, 9)
_MOST_OTHERS = 3  # curves over other inputs than a joint's own angle
_MIN_GAIN = 5.0  # in log evidence, of one of them, beyond what choosing it costs
_MIN_MEMBER_GAIN = 2.0  # a joint whose curve is worth less is left out
_MOST_FORMULAS = 3  # joints: where more carry a curve no short formula is the cause
_MOST_TERMS = 3
_HIGHEST_ORDER = 45
_PLACES = 24
_WIDTHS = (0.05, 0.1, 0.2, 0.35, 0.6)  # rad, of a bump
_MAY_LOSE = 2.0  # log evidence that a formula may lack against the curve
SHARE_OF_PARAMETERS = 3  # times as many as a law has, that curves need for it to take their place
MIN_VISIBLE = 0.3  # sigmas: a mode whose usual size moves the whole residual by less is left out


@dataclass(frozen=True)
class LearnedCurves:
    """Curves that the data support, as effects, with their joint evidence."""

    members: tuple[SmoothJointError, ...]
    log_evidence: float  # over no curve, less the cost of choosing their inputs
    left_out_mm: float = float("nan")  # RMS per coordinate when each pose is predicted from the others
    laws: FoundLaws | None = None  # where laws of few parameters take the curves' place
    alone: LearnedCurves | None = None  # the same curves without the laws beside them, where there are any

    @property
    def parameters(self) -> int:
        """Number of parameters."""
        return sum(len(member.parameters) for member in self.members)

    @property
    def joints(self) -> tuple[int, ...]:
        """Joints that carry a curve, counted from 1."""
        return joints_of(self.members)

    @property
    def inputs(self) -> tuple[str, ...]:
        """Inputs that the curves run over."""
        return inputs_of(self.members)


@dataclass(frozen=True)
class _Candidate:
    """Possible curve of one joint over one input."""

    joint: int
    modes: CurveModes | FormulaModes  # a curve's: one for each harmonic yet
    columns: CurveColumns


@one_blas_thread()
def learn_joint_curves(calibration: Calibration) -> LearnedCurves | None:
    """Error curves of joints over their angles and other inputs that the data support; None where only noise is left.

    Raises FitError where no degree of freedom is left.
    """
    projected = project_residual(calibration)
    found = _learned(projected, _BANDS[0])
    rows, joints = len(projected.residual), projected.residuals.model.robot.n_joints
    for highest in _BANDS[1:]:
        if rows**2 * joints * 2 * highest > MOST_WORK or (found is not None and found.at_end < _MAY_GO_ON):
            break
        wider = _learned(projected, highest)
        if wider is not None and found is not None and not _is_better(wider, found):
            break
        found = wider or found
    return None if found is None else _with_laws_beside(projected, found).curves


def laws_or_curves(curves: LearnedCurves | None, laws: FoundLaws | None) -> LearnedCurves | None:
    """Laws of a residual where they say as much as its curves with a third of their parameters; else the curves."""
    if laws is None:
        return curves
    found = LearnedCurves(laws.members, laws.log_evidence, laws.left_out_mm, laws)
    return found if curves is None or explains_as_much(found, found.log_evidence, curves) else curves


def explains_as_much(laws: LearnedCurves, log_evidence: float, curves: LearnedCurves) -> bool:
    """Whether laws, with so much log evidence, say as much as curves with a third of the parameters.

    Or more, with no more parameters: laws that were found beside curves may have made all of these superfluous.
    """
    few = SHARE_OF_PARAMETERS * laws.parameters <= curves.parameters and log_evidence >= curves.log_evidence - _MAY_LOSE
    return few or (laws.parameters <= curves.parameters and log_evidence >= curves.log_evidence)


@dataclass(frozen=True)
class _Found:
    """Curves learned with harmonics up to some order, with the evidence that they came from."""

    curves: LearnedCurves
    chosen: list[_Candidate]
    evidence: CurveEvidence
    spectrum: Spectrum
    left_out_mm: Array  # (R,) error of each coordinate when its pose is predicted from the others
    at_end: float  # prior sigma of the highest order, over that of the lowest: large where higher ones may count


def _is_better(wider: _Found, found: _Found) -> bool:
    """Whether evidence and left-out poses both speak for curves of a wider band."""
    gain = wider.curves.log_evidence - found.curves.log_evidence
    return gain > _MIN_GAIN and wider.curves.left_out_mm < found.curves.left_out_mm


def _learned(projected: ProjectedResidual, highest: int) -> _Found | None:
    """Curves that the data support, with up to `highest` waves a turn over joint angles; None where there are none."""
    chosen = list(_over_angles(projected, highest))
    others = list(_over_other_inputs(projected))
    evidence = _evidence_of(chosen, projected)
    value, spectrum, paid = 0.0, None, 0.0
    if chosen:
        value, spectrum = evidence.best()
    for _ in range(_MOST_OTHERS):
        gains = evidence.gains(spectrum, [c.columns for c in others])
        best = max(range(len(gains)), key=lambda k: gains[k][0], default=-1)
        if best < 0 or gains[best][0] < _MIN_GAIN + np.log(len(gains)):
            break
        paid += float(np.log(len(gains)))
        chosen.append(others.pop(best))
        evidence = evidence.joined(chosen[-1].columns)
        value, spectrum = evidence.best((Spectrum.with_size(spectrum, gains[best][1]),))
    if spectrum is None or value - paid < MIN_LOG_EVIDENCE:
        return None
    members = _members(projected, chosen, evidence, spectrum)
    noise = float(np.sqrt(evidence.at(spectrum).quadratic / evidence.dof))
    if not members:
        return None
    left_out_mm = left_out_with(projected, members, noise)
    if rms(left_out_mm) >= cross_validated_rmse_mm(projected):
        return None
    bandwidth, slope = np.exp(spectrum.logs[-2:])
    at_end = float(1.0 / np.sqrt(1.0 + (highest / bandwidth) ** (2.0 * slope)))
    curves = LearnedCurves(tuple(members), value - paid, rms(left_out_mm))
    return _Found(curves, chosen, evidence, spectrum, left_out_mm, at_end)


def _with_laws_beside(projected: ProjectedResidual, found: _Found) -> _Found:
    """Curves with laws of two inputs or of the way that a joint came beside them, where these earn their place.

    Each is charged for all that were tried; together they have to predict left-out poses better than without.
    """
    tried = law_columns(projected, besides=OF_ONE_INPUT)
    if not tried.forms:
        return found
    blocks = tried.blocks
    evidence, spectrum, chosen = found.evidence, found.spectrum, list(found.chosen)
    price, value, further = float(np.log(len(blocks))), found.curves.log_evidence, evidence.further(blocks)
    for _ in range(_MOST_OTHERS):
        gains = evidence.gains_of(spectrum, further)
        best = max(range(len(gains)), key=lambda k: gains[k][0])
        if gains[best][0] < _MIN_GAIN + price:
            break
        value += gains[best][0] - price
        chosen.append(_Candidate(tried.forms[best].joint, tried.forms[best].modes, blocks[best]))
        evidence, further = evidence.joined(blocks[best]), further.beside(blocks[best])
        logs = spectrum.logs
        spectrum = Spectrum(np.concatenate([logs[:-2], [gains[best][1]], logs[-2:]]))
    if len(chosen) == len(found.chosen):
        return found
    spectrum = evidence.best((spectrum,))[1]
    members = _members(projected, chosen, evidence, spectrum)
    noise = float(np.sqrt(evidence.at(spectrum).quadratic / evidence.dof))
    if not members:
        return found
    left_out_mm = left_out_with(projected, members, noise)
    if standard_errors_of_fall(projected, found.left_out_mm, left_out_mm) < MIN_STANDARD_ERRORS:
        return found
    curves = LearnedCurves(tuple(members), value, rms(left_out_mm), alone=found.curves)
    return replace(found, curves=curves, chosen=chosen, evidence=evidence, spectrum=spectrum, left_out_mm=left_out_mm)


def _members(
    projected: ProjectedResidual, chosen: list[_Candidate], evidence: CurveEvidence, spectrum: Spectrum
) -> list[SmoothJointError]:
    """Effects for the chosen curves that the residual supports, as a short formula where that explains as much."""
    whole = evidence.at(spectrum).log_evidence
    worth = [whole - _without(evidence, spectrum, k) for k in range(len(chosen))]
    order = [k for k in np.argsort(worth)[::-1].tolist() if worth[k] > _MIN_MEMBER_GAIN]
    curves: list[int] = []
    out: list[SmoothJointError] = []
    for k in order:
        now = evidence.at(spectrum).log_evidence - _without(evidence, spectrum, k)
        if now <= _MIN_MEMBER_GAIN:  # a formula that came in explains what this curve did
            spectrum = _flat(spectrum, k)
            continue
        modes = chosen[k].modes
        if isinstance(modes, FormulaModes):  # a law
            noise = float(np.sqrt(evidence.at(spectrum).quadratic / evidence.dof))
            law = law_member(LawForm(chosen[k].joint, modes), float(np.exp(spectrum.logs[k])) * noise)
            same = [m for m in out if m.joint == law.joint and inputs_named(m.modes) == inputs_named(modes)]
            out = [m for m in out if m not in same]
            out.append(summed_laws(same[0], law) if same else law)
            continue
        found = _formula(projected, chosen[k], evidence, spectrum, k, now) if len(order) <= _MOST_FORMULAS else None
        if found is None:
            curves.append(k)
            continue
        for columns, log_size in found.blocks:
            evidence = evidence.joined(columns)
            logs = _flat(spectrum, k).logs
            spectrum = Spectrum(np.concatenate([logs[:-2], [log_size], logs[-2:]]))
        noise = float(np.sqrt(evidence.at(spectrum).quadratic / evidence.dof))
        sigma = np.repeat(np.exp(found.log_sizes) * noise, [len(term.names) for term in found.modes.terms])
        out.append(SmoothJointError(chosen[k].joint, found.modes, tuple(sigma.tolist())))
    posterior = evidence.at(spectrum)
    found_curves = [_curve_member(projected, chosen[k], evidence, posterior, k) for k in curves]
    return sorted(
        [*out, *(member for member in found_curves if member is not None)],
        key=lambda member: (member.joint, member.modes.input),
    )


def _evidence_of(chosen: list[_Candidate], projected: ProjectedResidual) -> CurveEvidence:
    empty = np.zeros(0, dtype=np.int64)
    curve = CurveColumns(np.zeros((len(projected.in_free(projected.residual)), 0)), empty, empty, empty.astype(bool))
    for candidate in chosen:
        curve = curve.joined(candidate.columns)
    return CurveEvidence(curve, -projected.in_free(projected.residual), projected.dof)


def _over_angles(projected: ProjectedResidual, highest: int) -> Iterator[_Candidate]:
    """Candidate curve of every revolute joint over its own angle, unless geometry could have the same effect."""
    directions = joint_directions(projected)
    orders: IndexArray = np.arange(1, highest + 1)
    for j, joint in enumerate(projected.residuals.model.robot.joints):
        if joint.is_revolute:
            modes = CurveModes(f"q{j + 1}", orders, np.eye(2 * highest))
            yield from _candidate(projected, directions[j], j, modes, True)


def _over_other_inputs(projected: ProjectedResidual) -> Iterator[_Candidate]:
    """Candidate curves of every joint over its torque, sums of two angles, temperature, time and further columns."""
    robot, poses, directions = projected.residuals.model.robot, projected.state.poses, joint_directions(projected)
    shared = [name for name in ("temperature_c", "time_s", "payload_kg") if getattr(poses, name) is not None]
    shared += [name for name, of in further_inputs(poses).items() if is_number(poses.extra.by_name[of])]
    for j, joint in enumerate(robot.joints):
        names = [] if joint.is_revolute else [f"q{j + 1}"]
        names += [f"torque{j + 1}"] if j in loaded_joints(robot) else []
        for k in (j - 1, j + 1):
            if 0 <= k < robot.n_joints and joint.is_revolute and robot.joints[k].is_revolute:
                low, high = min(j, k) + 1, max(j, k) + 1
                names += [f"q{low}+q{high}", f"q{low}-q{high}"]
        for name in [*names, *shared]:
            u = input_values(projected.state, name)
            low_u, high_u = (float(limit) for limit in (np.min(u), np.max(u)))
            if not np.all(np.isfinite(u)) or high_u - low_u <= 1e-9 * max(1.0, abs(low_u), abs(high_u)):
                continue
            # Half a period over the range: the two ends need not meet.
            rate = np.pi / (high_u - low_u)
            weights = np.eye(2 * len(_OTHER_ORDERS))
            modes = CurveModes(name, _OTHER_ORDERS, weights, low_u, rate, low_u, high_u)
            yield from _candidate(projected, directions[j], j, modes, False)


def _candidate(
    projected: ProjectedResidual, direction: Array, joint: int, modes: CurveModes, shares: bool
) -> Iterator[_Candidate]:
    """Candidate curve; None where geometry could produce the same displacements."""
    motions = modes.at(input_values(projected.state, modes.input))
    columns = projected.in_free(projected.motion_columns(direction, motions))
    if float(np.linalg.norm(columns)) <= 1e-6 * float(np.linalg.norm(direction)):
        return
    order: IndexArray = np.repeat(modes.orders, 2)
    member = np.zeros(len(order), dtype=np.int64)
    yield _Candidate(joint, modes, CurveColumns(columns, member, order, np.full(len(order), shares)))


def _without(evidence: CurveEvidence, spectrum: Spectrum, member: int) -> float:
    """Log evidence of the curves with one curve removed."""
    return evidence.at(_flat(spectrum, member)).log_evidence


def _flat(spectrum: Spectrum, member: int) -> Spectrum:
    logs = spectrum.logs.copy()
    logs[member] -= 30.0
    return Spectrum(logs)


def _formula(
    projected: ProjectedResidual,
    candidate: _Candidate,
    evidence: CurveEvidence,
    spectrum: Spectrum,
    k: int,
    worth: float,
) -> FoundFormula | None:
    """Short formula that can replace a learned curve; None where the formula explains less."""
    name = candidate.modes.input
    direction = joint_directions(projected)[candidate.joint]
    return find_formula(
        evidence,
        _flat(spectrum, k),
        worth,
        name,
        input_values(projected.state, name),
        lambda motions: projected.in_free(projected.motion_columns(direction, motions)),
    )


def _curve_member(
    projected: ProjectedResidual, candidate: _Candidate, evidence: CurveEvidence, found: CurvePosterior, k: int
) -> SmoothJointError | None:
    """Effect of one learned curve, as a sum of its visible Karhunen-Loeve modes; None without visible modes."""
    assert isinstance(candidate.modes, CurveModes)
    of_member = evidence.curve.member == k
    noise = float(np.sqrt(found.quadratic / evidence.dof))
    spread = found.prior_sigma[of_member] * noise
    at_poses = candidate.modes.at(input_values(projected.state, candidate.modes.input)) * spread
    weights, sizes = visible_modes(at_poses, spread, candidate.columns.columns, noise)
    if not sizes:
        return None
    m = candidate.modes
    whole = float(np.sqrt(0.5 * np.sum(spread**2)))  # a sine and a cosine of each order have one size
    modes = CurveModes(m.input, m.orders, weights, m.start, m.rate, m.low, m.high, whole)
    return SmoothJointError(candidate.joint, modes, sizes)


def visible_modes(at_poses: Array, spread: Array, columns: Array, noise: float) -> tuple[Array, tuple[float, ...]]:
    """Karhunen-Loeve modes of a curve that show, as weights (K, L) of its coefficients, and their usual sizes.

    Args:
        at_poses: (N, K) motions of the joint by the coefficients, each of its prior size.
        spread: (K,) these sizes.
        columns: (R, K) changes of the residual by a unit of each coefficient.
        noise: sigma of the residual.
    """
    _, size, turn = np.linalg.svd(at_poses, full_matrices=False)
    usual = size / np.sqrt(len(at_poses))
    weights = spread[:, None] * turn.T / np.maximum(usual, 1e-300)
    shows = np.linalg.norm(columns @ weights, axis=0) * usual > MIN_VISIBLE * noise
    return weights[:, shows], tuple(usual[shows].tolist())


# ---- short formulas -------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class FoundFormula:
    """Short formula for a joint's error curve, with the prior sigma of each term."""

    modes: FormulaModes
    log_sizes: tuple[float, ...]  # one a term
    blocks: tuple[tuple[CurveColumns, float], ...]  # columns and log of the prior sigma of each term
    gain: float  # in log evidence over a flat curve, less the cost of choosing the terms


def candidate_terms(input_name: str, u: Array) -> list[FormulaTerm]:
    """Candidate terms of a short formula over an input (N,)."""
    low, high = float(np.min(u)), float(np.max(u))
    places = np.linspace(low, high, _PLACES + 2)[1:-1].tolist()
    terms = [FormulaTerm("kink", place=p) for p in places] + [FormulaTerm("step", place=p) for p in places]
    if quantity_of(input_name) == "torque":
        return [*terms, FormulaTerm("square")]
    terms += [FormulaTerm("harmonic", order=n) for n in range(1, _HIGHEST_ORDER + 1)]
    return terms + [FormulaTerm("bump", place=p, width=w) for p in places for w in _WIDTHS if w < 0.5 * (high - low)]


def find_formula(
    evidence: CurveEvidence,
    flat: Spectrum,
    worth: float,
    input_name: str,
    u: Array,
    columns_of: Callable[[Array], Array],
) -> FoundFormula | None:
    """Short formula built term by term, by the gain in log evidence; None where it explains less than the curve.

    Args:
        evidence: of all curves.
        flat: the spectrum with this curve flat and the others as they are.
        worth: gain in log evidence by the curve given the others.
        input_name, u: its input, and the values at the used poses (N,).
        columns_of: (N, K) motions of the joint to whitened, projected columns (R, K).
    """
    terms = candidate_terms(input_name, u)
    blocks = [CurveColumns.of_one_size(columns_of(term.at(u))) for term in terms]
    price = float(np.log(len(terms)))
    chosen: list[int] = []
    sizes: list[float] = []
    gain = 0.0
    given, at, further = evidence, flat, evidence.further(blocks)
    for _ in range(_MOST_TERMS):
        gains = given.gains_of(at, further)
        best = max(range(len(gains)), key=lambda k: gains[k][0])
        if gains[best][0] < price + 1.0:
            break
        chosen.append(best)
        sizes.append(gains[best][1])
        gain += gains[best][0] - price
        if gain >= worth - _MAY_LOSE:
            modes = FormulaModes(input_name, tuple(terms[k] for k in chosen))
            found = tuple((blocks[k], size) for k, size in zip(chosen, sizes, strict=True))
            return FoundFormula(modes, tuple(sizes), found, gain)
        given, further = given.joined(blocks[best]), further.beside(blocks[best])
        at = Spectrum.with_size(at, gains[best][1])
    return None
