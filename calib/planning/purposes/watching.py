"""Check poses that see as much as they can of what usually changes in a cell: a joint's zero, or the tool.

Each kind of change is a question: numbers that act at the new poses only, beside all that the earlier fit leaves open
and with the scanner's place free, as nothing is blamed on the arm that a moved scanner explains. What only a scanner
that did not move can show (the first joint, mostly) is asked with its place as the fit knows it. All kinds count by
the logarithm of their sigma: the one that shows least would else cost the others what it cannot gain.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from calib.array_types import Array, IndexArray
from calib.dataset.dataset import Poses
from calib.errors import CalibError
from calib.fitting.scanner_frame import whitener
from calib.monitoring.change_tests import SEEN_Z
from calib.monitoring.kinds import JOINT_ZERO, TOOL, ChangeModel, kinds_of_the_arm
from calib.planning.exchange import ALL, best_poses
from calib.planning.outcome import ChangeKey, ChangeReason, CheckOutcome, DetectableChange
from calib.planning.purpose import WATCH, PlainPurpose, Situation
from calib.planning.question import Question, inverse
from calib.planning.unknowns import Unknowns

CHECK_POSES = 8
_NOTHING = 1e-8  # information of what is free, per square of 1e4 mm or 1e4 units of a change
_SHOWS = 0.1  # of the noise, at any candidate, by a milliradian or a millimetre: less is no use
_SAME_AS_SCANNER = 0.02  # share of a change's information that is left beside a scanner whose place is free
_NAMED, _TELLS = 2, 0.03  # kinds of a pose's reason, and by which share it lowers their sigma


@dataclass(frozen=True)
class CheckedKind:
    """A usual change, its question about all candidates, and whether the scanner's place is free in it."""

    kind: ChangeModel
    question: Question
    free: bool

    def size(self, chosen: IndexArray) -> float:
        """The size that is found and named 19 times of 20 with these candidates, in the unit of the kind.

        Of the tool its shift, where that shows least.
        """
        return SEEN_Z * float(np.sqrt(np.linalg.eigvalsh(_covariance(self, chosen))[-1]))


@dataclass(frozen=True)
class ForWatch(PlainPurpose):
    """Check poses against an earlier calibration."""

    name = WATCH
    effects: tuple[str, ...] = ()

    def choose(self, situation: Situation, count: int) -> IndexArray:
        return check_poses(_kinds_of(situation), count)

    def reasons(self, situation: Situation, chosen: IndexArray) -> tuple[ChangeReason, ...]:
        kinds = _kinds_of(situation)
        return tuple(ChangeReason(_detected_by(kinds, chosen, k)) for k in range(len(chosen)))

    def outcome(self, situation: Situation, chosen: IndexArray) -> CheckOutcome:
        kinds = _kinds_of(situation)
        shown = {k.kind.key for k in kinds}
        return CheckOutcome((
            *(DetectableChange(k.kind.key, k.kind.unit, k.size(chosen), k.free) for k in kinds),
            *(DetectableChange(k.key, k.unit, None, False) for k in _all_usual(situation) if k.key not in shown),
        ))  # fmt: skip


def check_poses(kinds: Sequence[CheckedKind], count: int) -> IndexArray:
    """(count,) the candidates that show the usual changes at the smallest sizes, the most telling first."""
    return best_poses([kind.question for kind in kinds], count, together=ALL).rows


def _kinds_of(situation: Situation) -> tuple[CheckedKind, ...]:
    if situation.start.measured is None:
        raise CalibError(
            f"{situation.start.dataset.name}: --for watch plans check poses against a calibration; give its dataset"
        )
    kinds = usual_kinds(situation.unknowns, situation.candidates, situation.rows)
    if not kinds:
        raise CalibError(
            f"{situation.start.dataset.name}: no pose shows a change of any joint's zero or of the tool beyond the "
            "noise; measure with less noise, or a target farther from the axes"
        )
    return kinds


def usual_kinds(unknowns: Unknowns, candidates: Poses, rows: Array) -> tuple[CheckedKind, ...]:
    """Each joint's zero and the tool, as far as any candidate shows them; rows (N, r, U) are `Unknowns.rows`."""
    p = len(unknowns.scales)
    observed = unknowns.as_observed(candidates)
    turn = np.stack([unknowns.scanner_T_base[str(name)][:3, :3] for name in observed.setup])
    turn = whitener(observed.covariance_mm2) @ turn
    known = unknowns.known
    alone = np.asarray(np.linalg.inv(inverse(known)[:p, :p]), dtype=float)  # of the arm, wherever the scanner stood
    out = []
    for kind in kinds_of_the_arm(unknowns.model, unknowns.x, observed):
        change = (turn @ kind.columns).reshape(len(rows), -1, kind.count)
        unit = 1e-3 if kind.unit == "rad" else 1.0
        if kind.what not in (JOINT_ZERO, TOOL) or np.abs(unit * change).max() < _SHOWS:
            continue
        fixed = CheckedKind(kind, _question(rows, known, change, unit), free=False)
        free = CheckedKind(kind, _question(rows, _beside(alone, rows.shape[2] - p), change, unit), free=True)
        everywhere = np.arange(len(rows))
        shares = fixed.size(everywhere) / free.size(everywhere)
        out.append(free if shares**2 > _SAME_AS_SCANNER else fixed)
    return tuple(out)


def _all_usual(situation: Situation) -> list[ChangeModel]:
    unknowns = situation.unknowns
    few = unknowns.as_observed(situation.candidates.select(np.arange(1)))
    kinds = kinds_of_the_arm(unknowns.model, unknowns.x, few)
    return [kind for kind in kinds if kind.what in (JOINT_ZERO, TOOL)]


def _question(rows: Array, known: Array, change: Array, unit: float) -> Question:
    """The question after a change (N, r, K) beside unknowns (N, r, U)."""
    count = change.shape[2]
    wanted = np.concatenate([np.zeros((len(known), count)), unit * np.eye(count)])
    return Question(np.concatenate([rows, unit * change], axis=2), _beside(known, count), wanted)


def _beside(known: Array, count: int) -> Array:
    """The information with `count` further unknowns of which nothing is known."""
    n = len(known)
    out = _NOTHING * np.eye(n + count)
    out[:n, :n] = known
    return out


def _covariance(kind: CheckedKind, chosen: IndexArray) -> Array:
    """(K, K) of the change, in its own unit squared."""
    question = kind.question
    rows = question.rows[chosen].reshape(-1, question.rows.shape[2])
    return np.asarray(question.wanted.T @ inverse(question.known + rows.T @ rows) @ question.wanted)


def _detected_by(kinds: Sequence[CheckedKind], chosen: IndexArray, k: int) -> tuple[ChangeKey, ...]:
    """The changes that the others of the chosen would detect less well without the k-th."""
    gains = []
    for kind in kinds:
        with_all, without = (kind.size(rows) for rows in (chosen, np.delete(chosen, k)))
        gains.append(1.0 - with_all / without)
    best = [i for i in np.argsort(gains)[::-1][:_NAMED] if gains[i] > _TELLS]
    return tuple(kinds[i].kind.key for i in best)
