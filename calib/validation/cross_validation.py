"""K-fold cross-validation over the training poses: each pose's error by a fit that was made without it.

Poses of the role test take no part. Whether more poses would help is the question of
`calib.validation.learning_curve`, whether more than noise is left that of `calib.calibration.noise_check`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd

from calib.array_types import IndexArray
from calib.blas_threads import one_blas_thread
from calib.calibration.calibrate import calibrate
from calib.calibration.evaluation import Evaluation, Figures
from calib.calibration.noise_check import SigmaCheck, check_sigma
from calib.calibration.result import Calibration
from calib.dataset.dataset import Dataset
from calib.effects.effect import Effect
from calib.errors import FitError
from calib.fitting.fit import Fit
from calib.options import DEFAULT_FOLDS, FitOptions
from calib.presented import Presented
from calib.progress import OnProgress, counted
from calib.validation.splits import deal_folds, split_dataset, training_groups

SUSPICIOUS = 1.5  # held-out over training error, in multiples of what noise explains, that calls the model in question


@dataclass(frozen=True)
class Fold:
    """One fold: the fit without its poses, and its errors at them."""

    poses: tuple[str, ...]  # held out
    train: Figures
    held_out: Figures
    converged: bool


@dataclass(frozen=True)
class CrossValidation(Presented):
    """Errors at every training pose, by the fit without its fold."""

    dataset: Dataset
    residual: str
    folds: tuple[Fold, ...]
    before: Evaluation  # the nominal robot at the held-out points, in frames fitted without them
    after: Evaluation  # the fits at the held-out points
    whole: Calibration  # the fit to all training poses
    notes: tuple[str, ...]

    @property
    def held_out(self) -> Figures:
        assert self.after.test is not None
        return self.after.test

    @property
    def spread_mm(self) -> float:
        """Standard deviation of the folds' held-out RMSE."""
        return float(np.std([fold.held_out.rmse_mm for fold in self.folds], ddof=1))

    @property
    def ratio(self) -> float:
        """Held-out RMSE over the training RMSE of the whole fit."""
        assert self.whole.after.train is not None
        train = self.whole.after.train.rmse_mm
        return self.held_out.rmse_mm / train if train > 0.0 else float("inf")

    @property
    def expected_ratio(self) -> float:
        """`ratio` where only noise is left."""
        return noise_ratio(self.whole.fit)

    @property
    def sigma(self) -> SigmaCheck:
        return check_sigma(self.whole)

    def to_frame(self) -> pd.DataFrame:
        """One row a held-out pose: setup, fold, points, RMS over its points before and after, distance error."""
        fold_of = {pose: k + 1 for k, fold in enumerate(self.folds) for pose in fold.poses}
        points = self.after.to_frame(self.dataset)
        points["nominal_mm"] = self.before.to_frame(self.dataset)["error_mm"]
        rows = [
            {
                "pose": pose,
                "setup": of_pose["setup"].iloc[0],
                "fold": fold_of[str(pose)],
                "points": len(of_pose),
                "nominal_mm": float(np.sqrt(np.mean(of_pose["nominal_mm"] ** 2))),
                "error_mm": float(np.sqrt(np.mean(of_pose["error_mm"] ** 2))),
                "distance_error_mm": float(of_pose["distance_error_mm"].iloc[0]),
            }
            for pose, of_pose in points.groupby("pose", sort=False)
        ]
        return pd.DataFrame(rows)


def noise_ratio(fit: Fit) -> float:
    """Error at other poses over that at the fit's own, where only noise is left: sqrt((R + P) / (R - P)).

    R rows with P parameters fitted; inf where no degree of freedom is left.
    """
    spent = fit.rows - fit.degrees_of_freedom
    return float(np.sqrt((fit.rows + spent) / (fit.rows - spent))) if spent < fit.rows else float("inf")


@one_blas_thread()
def cross_validate(
    dataset: Dataset,
    options: FitOptions = FitOptions(),
    *,
    folds: int = DEFAULT_FOLDS,
    effects: Sequence[Effect] = (),
    rng: np.random.Generator | None = None,
    progress: bool = False,
    on_progress: OnProgress | None = None,
) -> CrossValidation:
    """Fit `folds` times, each time without one fold of the training poses, and evaluate the fold.

    Args:
        dataset: with measured points; its test poses are not touched.
        folds: how many; each has its share of every setup.
        options: what is asked of every fit.
        effects: in the model of every fit, beyond the link errors.
        rng: deals the poses into folds; always the same where None.
        progress: show a bar, in a notebook's cell or at the terminal.
        on_progress: called with fits done, fits in all, and what was fitted.

    Raises:
        FitError: no points, fewer than two folds, more folds than poses, or too few poses in a fold's training part.
    """
    groups = training_groups(dataset)
    if folds < 2:
        raise FitError(f"found {folds} folds; cross-validation needs 2 at least, 5 is usual")
    if folds > len(groups):
        raise FitError(
            f"dataset {dataset.name}: found {folds} folds for {len(groups)} different training poses; "
            "ask for fewer folds, 5 is usual"
        )
    dealt, small = deal_folds(groups, folds, rng or np.random.default_rng(0))
    if any(len(fold) == 0 for fold in dealt):
        raise FitError(
            f"dataset {dataset.name}: {len(groups)} different training poses cannot fill {folds} folds and leave "
            "each setup three poses for its frame; ask for fewer folds or measure more poses"
        )
    everything = groups.poses_of(range(len(groups)))
    whole = calibrate(split_dataset(dataset, everything, everything[:0])[0], options, effects=effects)
    done: list[Fold] = []
    before, after = [], []
    with counted("fits", "fit", asked=progress, then=on_progress) as tell:
        for fold in dealt:
            held_out = groups.poses_of(fold)
            split, rows = split_dataset(dataset, np.setdiff1d(everything, held_out), held_out)
            fitted = calibrate(split, options, effects=effects)
            before.append(_held_out(fitted.before, rows, len(dataset.poses)))
            after.append(_held_out(fitted.after, rows, len(dataset.poses)))
            train, test = fitted.after.train, fitted.after.test
            assert train is not None
            assert test is not None
            done.append(Fold(tuple(dataset.poses.ids[i] for i in held_out), train, test, fitted.fit.converged))
            if tell is not None:
                tell(len(done), folds, f"fold {len(done)}")
    notes = tuple(f"setup {name!r} has too few poses to hold any out: all of them train" for name in small)
    notes += whole.fitted_dataset.notes[len(dataset.notes) :]
    return CrossValidation(dataset, options.residual, tuple(done), _pooled(before), _pooled(after), whole, notes)


def _held_out(evaluation: Evaluation, rows: IndexArray, poses: int) -> Evaluation:
    """The test poses' part of a split's evaluation, with the pose numbers of the whole dataset; `rows` has them."""
    points = evaluation.is_test[evaluation.pose]
    distances = evaluation.is_test[evaluation.distance_pose]
    return Evaluation(
        pose=rows[evaluation.pose[points]],
        error_mm=evaluation.error_mm[points],
        distance_pose=rows[evaluation.distance_pose[distances]],
        distance_error_mm=evaluation.distance_error_mm[distances],
        is_test=np.ones(poses, dtype=bool),
        scanner_T_base={},
        notes=evaluation.notes,
    )


def _pooled(parts: list[Evaluation]) -> Evaluation:
    """The folds' evaluations as one: each held-out point is in it once."""
    return Evaluation(
        pose=np.concatenate([part.pose for part in parts]),
        error_mm=np.concatenate([part.error_mm for part in parts]),
        distance_pose=np.concatenate([part.distance_pose for part in parts]),
        distance_error_mm=np.concatenate([part.distance_error_mm for part in parts]),
        is_test=parts[0].is_test,
        scanner_T_base={},
        notes=tuple(dict.fromkeys(note for part in parts for note in part.notes)),
    )
