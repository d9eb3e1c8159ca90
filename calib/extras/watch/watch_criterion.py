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
from calib.extras.watch.cell import CellTests
from calib.extras.watch.change_models import JOINT_ZERO, TOOL, ChangeModel, change_models_of_arm
from calib.extras.watch.change_tests import DETECTABLE_Z, Detectable
from calib.extras.watch.plugin import WATCH
from calib.fitting.scanner_frame import whitener
from calib.frames import frames_by_name
from calib.planning.criterion import BaseCriterion, DesignProblem, Outcome
from calib.planning.exchange import OptimalityCriterion, best_poses, inverse
from calib.planning.start import FromFit
from calib.planning.unknowns import Unknowns

_FREE = 1e-8  # information on a free unknown: a sigma of 1e4 mm, or 1e4 units of a change
_SHOWS = 0.1  # in units of the noise, least effect of a milliradian or a millimetre at any candidate
_SAME_AS_SCANNER = 0.02  # share of a change's information, with the scanner's frame free, below which it is fixed


@dataclass(frozen=True)
class CheckOutcome(Outcome):
    """Usual changes of the cell with the least size that planned check poses find 19 times of 20; None: never."""

    changes: tuple[Detectable, ...]


@dataclass(frozen=True)
class CheckedChange:
    """Usual change of a cell, with the optimality question by which candidate poses are judged to detect it."""

    model: ChangeModel
    question: OptimalityCriterion

    def size(self, chosen: IndexArray) -> float:
        """Least size, in the change's unit, that shows 19 times of 20 with given candidates.

        For the tool, its shift in the direction that shows least. Poses are chosen by it.
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

    def outcome(self, problem: DesignProblem, chosen: IndexArray) -> CheckOutcome:
        """Least size of each usual change of the cell that the chosen candidates find, as `watch` will judge them."""
        start = problem.start
        assert isinstance(start, FromFit)
        poses = problem.candidates.select(chosen)
        check = replace(start.dataset, poses=poses, points=problem.unknowns.points(poses))
        cell = CellTests.of(start.calibration, [check])
        return CheckOutcome(tuple(cell.free.detectable(m) for m in cell.models if m.what in (JOINT_ZERO, TOOL)))


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
        fixed = CheckedChange(model, _question(rows, prior, columns, unit))
        free = CheckedChange(model, _question(rows, scanner_free, columns, unit))
        everywhere = np.arange(len(rows))
        shares = fixed.size(everywhere) / free.size(everywhere)
        changes.append(free if shares**2 > _SAME_AS_SCANNER else fixed)
    return tuple(changes)


def _question(rows: Array, prior_information: Array, change: Array, unit: float) -> OptimalityCriterion:
    """Optimality question for the size of a change, beside the other unknowns of the fit.

    The change has columns (N, r, K), the other unknowns rows (N, r, U).
    """
    count = change.shape[2]
    targets = np.concatenate([np.zeros((len(prior_information), count)), unit * np.eye(count)])
    return OptimalityCriterion(
        np.concatenate([rows, unit * change], axis=2), _with_free(prior_information, count), targets
    )


def _with_free(information: Array, count: int) -> Array:
    """Information matrix (K, K) extended by `count` unknowns without prior knowledge."""
    n = len(information)
    extended = _FREE * np.eye(n + count)
    extended[:n, :n] = information
    return extended


def _covariance(question: OptimalityCriterion, chosen: IndexArray) -> Array:
    """Covariance (K, K) of the parameter combinations asked about, once the chosen candidate poses are measured."""
    rows = question.rows[chosen].reshape(-1, question.rows.shape[2])
    return np.asarray(
        question.target_combinations.T
        @ inverse(question.prior_information + rows.T @ rows)
        @ question.target_combinations
    )
