"""Search for laws of joints in a residual: each by its gain in log evidence, less what trying all of them costs."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace

import numpy as np

from calib.array_types import Array
from calib.blas_threads import one_blas_thread
from calib.screening.curves.curve_evidence import CurveColumns, CurveEvidence, Spectrum
from calib.screening.curves.laws import LawForm, law_motions, laws_tried
from calib.screening.curves.smooth_joint_error import FormulaModes, SmoothJointError, inputs_named
from calib.screening.left_out import left_out_errors_mm
from calib.screening.projected_residual import ProjectedResidual, joint_directions
from calib.statistics import rms

MIN_FIRST_GAIN = 8.0  # in log evidence, beyond what choosing the first law costs
MIN_FURTHER_GAIN = 5.0  # of one beside others
MOST_LAWS = 3
MIN_STANDARD_ERRORS = 2.0  # of the mean, by which laws lower the squared error of poses that no fit used
AS_LIKELY = 3.0  # nats, within which another law may be the one as well
_UNSEEN = 1e-6  # of a joint's displacement, below which geometry makes what a law does


@dataclass(frozen=True)
class FoundLaw:
    """A law that the residual supports, with the others that explain as much of it."""

    member: SmoothJointError
    gain: float  # log evidence over the model before it, less the log of the number of laws tried
    rivals: tuple[LawForm, ...]  # of other kinds or joints, within `AS_LIKELY`, the nearest first


@dataclass(frozen=True)
class FoundLaws:
    """Laws of joints that a residual supports."""

    laws: tuple[FoundLaw, ...]
    tried: int
    left_out_mm: float  # RMS per coordinate when each pose is predicted from all others

    @property
    def members(self) -> tuple[SmoothJointError, ...]:
        """The laws as effects."""
        return tuple(law.member for law in self.laws)

    @property
    def log_evidence(self) -> float:
        """Log evidence of all laws over none, each charged for all that were tried."""
        return sum(law.gain for law in self.laws)


@dataclass(frozen=True)
class LawColumns:
    """All laws that can be tried against a residual, each with its columns."""

    forms: tuple[LawForm, ...]
    columns: tuple[Array, ...]  # (R, K) whitened, projected, in the free directions

    @property
    def blocks(self) -> list[CurveColumns]:
        """The laws' columns in the form that the evidence takes, each a member of its own."""
        return [CurveColumns.of_one_size(columns) for columns in self.columns]


def law_columns(projected: ProjectedResidual, besides: Collection[str] = ()) -> LawColumns:
    """Columns of every law that geometry cannot imitate, besides those of some kinds."""
    directions = joint_directions(projected)
    forms: list[LawForm] = []
    columns: list[Array] = []
    tried = laws_tried(projected.state)
    for j, direction in enumerate(directions):
        of_joint = [form for form in tried if form.joint == j and form.kind not in besides]
        if not of_joint:
            continue
        motions = law_motions(projected.state, of_joint)
        ends = np.cumsum([one.shape[1] for one in motions])[:-1]
        together = projected.in_free(projected.motion_columns(direction, np.concatenate(motions, axis=1)))
        least = _UNSEEN * float(np.linalg.norm(direction))
        for form, own in zip(of_joint, np.split(together, ends, axis=1), strict=True):
            if np.all(np.isfinite(own)) and float(np.linalg.norm(own)) > least:
                forms.append(form)
                columns.append(own)
    return LawColumns(tuple(forms), tuple(columns))


@one_blas_thread()
def search_laws(projected: ProjectedResidual) -> FoundLaws | None:
    """Laws that the residual supports, found one after the other; None where there are none."""
    tried = law_columns(projected)
    if not tried.forms:
        return None
    residual = -projected.in_free(projected.residual)
    empty = np.zeros(0, dtype=np.int64)
    none = CurveColumns(np.zeros((len(residual), 0)), empty, empty, empty.astype(bool))
    evidence, spectrum = CurveEvidence(none, residual, projected.dof), None
    blocks = tried.blocks
    further = evidence.further(blocks)
    price = float(np.log(len(blocks)))
    chosen: list[int] = []
    picked: list[tuple[float, tuple[LawForm, ...]]] = []
    for _ in range(MOST_LAWS):
        gains = evidence.gains_of(spectrum, further)
        order = sorted(range(len(gains)), key=lambda k: -gains[k][0])
        best = order[0]
        if gains[best][0] - price < (MIN_FURTHER_GAIN if chosen else MIN_FIRST_GAIN):
            break
        near = [k for k in order[1:] if gains[best][0] - gains[k][0] < AS_LIKELY]
        picked.append((gains[best][0] - price, _unlike(tried.forms[best], [tried.forms[k] for k in near])))
        chosen.append(best)
        evidence, further = evidence.joined(blocks[best]), further.beside(blocks[best])
        spectrum = evidence.best((Spectrum.with_size(spectrum, gains[best][1]),))[1]
    if spectrum is None:
        return None
    noise = float(np.sqrt(evidence.at(spectrum).quadratic / evidence.dof))
    laws = _in_one_formula(
        [
            FoundLaw(law_member(tried.forms[k], float(np.exp(log_size)) * noise), gain, rivals)
            for k, log_size, (gain, rivals) in zip(chosen, spectrum.logs[:-2].tolist(), picked, strict=True)
        ]
    )
    left_out_mm = left_out_with(projected, [law.member for law in laws], noise)
    if standard_errors_of_fall(projected, left_out_errors_mm(projected), left_out_mm) < MIN_STANDARD_ERRORS:
        return None
    return FoundLaws(laws, len(blocks), rms(left_out_mm))


def law_member(form: LawForm, size: float) -> SmoothJointError:
    """Effect of a law, the prior sigma of each of its parameters being `size`, rad."""
    count = sum(len(term.names) for term in form.modes.terms)
    return SmoothJointError(form.joint, form.modes, (size,) * count)


def _in_one_formula(laws: Sequence[FoundLaw]) -> tuple[FoundLaw, ...]:
    """Laws of which those of one joint over the same inputs are one, with all their terms."""
    out: dict[tuple[int, str], FoundLaw] = {}
    for law in laws:
        key = (law.member.joint, inputs_named(law.member.modes))
        before = out.get(key)
        if before is None:
            out[key] = law
        else:
            out[key] = FoundLaw(summed_laws(before.member, law.member), before.gain + law.gain, before.rivals)
    return tuple(out.values())


def summed_laws(first: SmoothJointError, second: SmoothJointError) -> SmoothJointError:
    """One law with the terms of two over the same inputs of a joint."""
    assert isinstance(first.modes, FormulaModes)
    assert isinstance(second.modes, FormulaModes)
    modes = replace(first.modes, terms=(*first.modes.terms, *second.modes.terms))
    return SmoothJointError(first.joint, modes, (*first.prior_sigma_rad, *second.prior_sigma_rad))


def left_out_with(projected: ProjectedResidual, members: Sequence[SmoothJointError], noise: float) -> Array:
    """Error (R,), mm, of each coordinate when its pose is predicted from all others, with curves or laws."""
    directions = joint_directions(projected)
    columns = [projected.motion_columns(directions[m.joint], m.joint_motions(projected.state)) for m in members]
    spread = np.concatenate([np.array(m.prior_sigma_rad) for m in members]) / noise
    return left_out_errors_mm(projected, np.concatenate(columns, axis=1), spread)


def standard_errors_of_fall(projected: ProjectedResidual, before_mm: Array, after_mm: Array) -> float:
    """Mean fall of the squared error of poses left out, in standard errors of it, from errors (R,) before and after."""
    pose = np.repeat(projected.residuals.observed.points.pose, projected.coordinates)
    poses, row = np.unique(pose, return_inverse=True)
    fall = np.bincount(row, before_mm**2 - after_mm**2, minlength=len(poses))
    return float(fall.mean() / max(float(fall.std(ddof=1)) / np.sqrt(len(fall)), 1e-300))


def _unlike(best: LawForm, others: Sequence[LawForm]) -> tuple[LawForm, ...]:
    """First law of each kind and joint, of those that differ in kind or joint from the best."""
    out: dict[tuple[str, int], LawForm] = {}
    for other in others:
        if (other.kind, other.joint) != (best.kind, best.joint):
            out.setdefault((other.kind, other.joint), other)
    return tuple(out.values())
