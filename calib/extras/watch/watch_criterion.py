"""Criterion for check poses that detect the usual changes of a cell, a joint's zero or the tool (`--for watch`).

Each change is a question whose targets act at the new poses only, in addition to the unknowns of the earlier fit. The
scanner's frame is free, as no change is attributed to the arm that a moved scanner explains. A change that looks like a
motion of the scanner (of the first joint, mostly) has the frame as the fit knows it. The questions are combined by the
logarithms of their sigmas: the change that shows least would else cost the others what it cannot gain.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from calib.array_types import Array, IndexArray
from calib.dataset.dataset import Poses
from calib.errors import CalibError
from calib.extras.watch.change_models import JOINT_ZERO, SCANNER, TOOL, ChangeModel, change_models_of_arm
from calib.extras.watch.change_tests import DETECTABLE_Z
from calib.extras.watch.check_outcome import ChangeKey, ChangeReason, CheckOutcome, DetectableChange
from calib.extras.watch.plugin import WATCH
from calib.extras.watch.promised_sizes import promised_sizes
from calib.fitting.scanner_frame import whitener
from calib.frames import frames_by_name
from calib.planning.criterion import BaseCriterion, DesignProblem
from calib.planning.exchange import best_poses
from calib.planning.question import Question, inverse
from calib.planning.start import FromFit
from calib.planning.unknowns import Unknowns

_FREE = 1e-8  # information on a free unknown: a sigma of 1e4 mm, or 1e4 units of a change
_SHOWS = 0.1  # in units of the noise, least effect of a milliradian or a millimetre at any candidate
_SAME_AS_SCANNER = 0.02  # share of a change's information, with the scanner's frame free, below which it is fixed
_NAMED = 2  # most changes in a pose's reason
_NO_SIZE = {"rad": np.radians(10.0), "mm": 50.0}  # of a zero or a tool, above which nothing is promised
_MIN_GAIN = 0.03  # share by which a pose lowers a change's sigma, below which the change is no reason for it


@dataclass(frozen=True)
class CheckedChange:
    """Usual change of a cell, with the optimality question by which candidate poses are judged to detect it."""

    model: ChangeModel
    question: Question
    scanner_free: bool  # whether the scanner's frame is free in the question

    def size(self, chosen: IndexArray) -> float:
        """Least size, in the change's unit, that shows 19 times of 20 with given candidates, beside no rival.

        For the tool, its shift in the direction that shows least. Poses are chosen by it; what is promised of them
        counts the rivals (`calib.extras.watch.promised_sizes`).
        """
        return DETECTABLE_Z * float(np.sqrt(np.linalg.eigvalsh(_covariance(self.question, chosen))[-1]))


@dataclass(frozen=True)
class ForWatch(BaseCriterion):
    """Criterion: least detectable sizes of usual changes since an earlier calibration."""

    name = WATCH
    is_own_dataset = True
    effects: tuple[str, ...] = ()

    def choose(self, problem: DesignProblem, count: int) -> IndexArray:
        """Indices (count,) of the candidates that detect the usual changes best, the most informative first."""
        return check_poses(_checked_changes(problem), count)

    def reasons(self, problem: DesignProblem, chosen: IndexArray) -> tuple[ChangeReason, ...]:
        """Changes that would be detected less well without each chosen candidate."""
        changes = _checked_changes(problem)
        return tuple(ChangeReason(_detected_by(changes, chosen, k)) for k in range(len(chosen)))

    def outcome(self, problem: DesignProblem, chosen: IndexArray) -> CheckOutcome:
        """Sizes of each usual change of the cell that the chosen candidates find, and name beside all rivals."""
        changes = {change.model.key: change for change in _checked_changes(problem)}
        start = problem.start
        assert isinstance(start, FromFit)
        poses = problem.candidates.select(chosen)
        check = replace(start.dataset, poses=poses, points=problem.unknowns.points(poses))
        promises = {p.model.key: p for p in promised_sizes(start.calibration, check, tuple(changes))}
        detectable = []
        for model in _all_usual(problem):
            change, promise = changes.get(model.key), promises.get(model.key)
            if change is None or promise is None or promise.found is None or promise.found > _NO_SIZE[model.unit]:
                detectable.append(DetectableChange(model.key, model.unit, None, False, None, None, None))
                continue
            named, alone = (s if s and s <= _NO_SIZE[model.unit] else None for s in (promise.named, promise.alone))
            free = change.scanner_free
            rival = promise.rival if free else (SCANNER, None, "")
            detectable.append(DetectableChange(model.key, model.unit, promise.found, free, named, alone, rival))
        return CheckOutcome(tuple(detectable))


def check_poses(changes: Sequence[CheckedChange], count: int) -> IndexArray:
    """Indices (count,) of the candidates that detect changes at the smallest sizes, the most informative first."""
    return best_poses([change.question for change in changes], count).rows


def _checked_changes(problem: DesignProblem) -> tuple[CheckedChange, ...]:
    """Usual changes of the cell that some candidate shows. Raises CalibError where there are none."""
    if problem.start.measured is None:
        raise CalibError(
            f"{problem.start.dataset.name}: --for watch plans check poses against a calibration; give its dataset"
        )
    changes = usual_changes(problem.unknowns, problem.candidates, problem.rows)
    if not changes:
        raise CalibError(
            f"{problem.start.dataset.name}: no pose shows a change of any joint's zero or of the tool beyond the "
            "noise; measure with less noise, or a target farther from the axes"
        )
    return changes


def usual_changes(unknowns: Unknowns, candidates: Poses, rows: Array) -> tuple[CheckedChange, ...]:
    """Changes of each joint's zero and of the tool that some candidate pose shows, with their questions.

    `rows` (N, r, U) are `Unknowns.rows`.
    """
    p = len(unknowns.scales)
    observed = unknowns.as_observed(candidates)
    scanner_R_base = frames_by_name(unknowns.scanner_T_base, observed.setup)[:, :3, :3]
    to_residual = whitener(observed.covariance_mm2) @ scanner_R_base
    prior = unknowns.prior_information
    of_arm = np.asarray(np.linalg.inv(inverse(prior)[:p, :p]), dtype=float)  # wherever the scanner stood
    scanner_free = _with_free(of_arm, rows.shape[2] - p)
    changes = []
    for model in change_models_of_arm(unknowns.model, unknowns.x, observed):
        columns = (to_residual @ model.columns).reshape(len(rows), -1, model.count)
        unit = 1e-3 if model.unit == "rad" else 1.0
        if model.what not in (JOINT_ZERO, TOOL) or np.abs(unit * columns).max() < _SHOWS:
            continue
        fixed = CheckedChange(model, _question(rows, prior, columns, unit), scanner_free=False)
        free = CheckedChange(model, _question(rows, scanner_free, columns, unit), scanner_free=True)
        everywhere = np.arange(len(rows))
        shares = fixed.size(everywhere) / free.size(everywhere)
        changes.append(free if shares**2 > _SAME_AS_SCANNER else fixed)
    return tuple(changes)


def _all_usual(problem: DesignProblem) -> list[ChangeModel]:
    """Change models of each joint's zero and of the tool, whether candidate poses show them or not."""
    unknowns = problem.unknowns
    one = unknowns.as_observed(problem.candidates.select(np.arange(1)))
    models = change_models_of_arm(unknowns.model, unknowns.x, one)
    return [model for model in models if model.what in (JOINT_ZERO, TOOL)]


def _question(rows: Array, prior_information: Array, change: Array, unit: float) -> Question:
    """Optimality question for the size of a change, beside the other unknowns of the fit.

    The change has columns (N, r, K), the other unknowns rows (N, r, U).
    """
    count = change.shape[2]
    targets = np.concatenate([np.zeros((len(prior_information), count)), unit * np.eye(count)])
    return Question(np.concatenate([rows, unit * change], axis=2), _with_free(prior_information, count), targets)


def _with_free(information: Array, count: int) -> Array:
    """Information matrix (K, K) extended by `count` unknowns without prior knowledge."""
    n = len(information)
    extended = _FREE * np.eye(n + count)
    extended[:n, :n] = information
    return extended


def _covariance(question: Question, chosen: IndexArray) -> Array:
    """Covariance (K, K) of the parameter combinations asked about, once the chosen candidate poses are measured."""
    rows = question.rows[chosen].reshape(-1, question.rows.shape[2])
    return np.asarray(
        question.target_combinations.T
        @ inverse(question.prior_information + rows.T @ rows)
        @ question.target_combinations
    )


def _detected_by(changes: Sequence[CheckedChange], chosen: IndexArray, k: int) -> tuple[ChangeKey, ...]:
    """Changes that the chosen candidates would detect less well without the k-th candidate."""
    gains = []
    for change in changes:
        with_all, without = (change.size(rows) for rows in (chosen, np.delete(chosen, k)))
        gains.append(1.0 - with_all / without)
    best = [i for i in np.argsort(gains)[::-1][:_NAMED] if gains[i] > _MIN_GAIN]
    return tuple(changes[i].model.key for i in best)
