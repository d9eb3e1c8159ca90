"""K-fold cross-validation over the training poses: each pose's error under a fit without that pose.

Poses of the role test take no part. Whether more poses would help is the question of
`calib.validation.learning_curve`, whether more than noise is left that of `calib.calibration.noise_level`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from calib.array_types import IndexArray
from calib.blas_threads import one_blas_thread
from calib.brief import Brief
from calib.calibration.calibrate import fit_measured
from calib.calibration.evaluation import Evaluation, Figures
from calib.calibration.noise_level import SigmaCheck, check_sigma
from calib.calibration.result import Calibration
from calib.dataset.dataset import Dataset
from calib.effects.effect import Effect
from calib.errors import FitError
from calib.fitting.fit import Fit
from calib.lazy_modules import pd
from calib.options import DEFAULT_FOLDS, FitOptions
from calib.presented import Presented
from calib.progress import OnProgress
from calib.statistics import rms
from calib.validation.splits import deal_folds, split_dataset, training_groups

SUSPICIOUS = 1.5  # held-out over training error, in multiples of its value by noise alone, for a warning


@dataclass(frozen=True)
class Fold(Brief):
    """Errors at one fold of poses, by a fit to all other poses."""

    poses: tuple[str, ...]  # held out
    train: Figures
    held_out: Figures
    converged: bool


@dataclass(frozen=True)
class CrossValidation(Presented):
    """Errors at every training pose, each by a fit without the fold that contains the pose."""

    dataset: Dataset
    residual: str
    folds: tuple[Fold, ...]
    before: Evaluation  # the nominal robot at the held-out points, in frames fitted without them
    after: Evaluation  # the fits at the held-out points
    whole: Calibration  # the fit to all training poses
    notes: tuple[str, ...]

    @property
    def held_out(self) -> Figures:
        """Errors at all held-out points."""
        assert self.after.test is not None
        return self.after.test

    @property
    def spread_mm(self) -> float:
        """Standard deviation of the folds' held-out RMSE."""
        return float(np.std([fold.held_out.rmse_mm for fold in self.folds], ddof=1))

    @property
    def ratio(self) -> float:
        """Held-out RMSE over the training RMSE of the fit to all poses."""
        assert self.whole.after.train is not None
        train = self.whole.after.train.rmse_mm
        return self.held_out.rmse_mm / train if train > 0.0 else float("inf")

    @property
    def expected_ratio(self) -> float:
        """Ratio of held-out to training RMSE that noise alone would give."""
        return noise_ratio(self.whole.fit)

    @property
    def sigma(self) -> SigmaCheck:
        """Residual sigma of the fit to all poses, compared with the declared one."""
        return check_sigma(self.whole)

    def to_frame(self) -> pd.DataFrame:
        """Table with one row per held-out pose: setup, fold, points, RMS before and after, distance error."""
        fold_of = {pose: k + 1 for k, fold in enumerate(self.folds) for pose in fold.poses}
        points = self.after.to_frame(self.dataset)
        points["nominal_mm"] = self.before.to_frame(self.dataset)["error_mm"]
        rows = [
            {
                "pose": pose,
                "setup": of_pose["setup"].iloc[0],
                "fold": fold_of[str(pose)],
                "points": len(of_pose),
                "nominal_mm": rms(of_pose["nominal_mm"]),
                "error_mm": rms(of_pose["error_mm"]),
                "distance_error_mm": float(of_pose["distance_error_mm"].iloc[0]),
            }
            for pose, of_pose in points.groupby("pose", sort=False)
        ]
        return pd.DataFrame(rows)

    def _brief(self) -> str:
        return f"{self.dataset.name}: {len(self.folds)} folds, held-out RMSE {self.held_out.rmse_mm:.3g} mm"


def noise_ratio(fit: Fit) -> float:
    """Ratio of the error at new poses to that at fitted poses under noise alone: sqrt((R + P) / (R - P)).

    R rows with P parameters fitted; inf where no degree of freedom is left.
    """
    spent = fit.rows - fit.degrees_of_freedom
    return float(np.sqrt((fit.rows + spent) / (fit.rows - spent))) if spent < fit.rows else float("inf")


@one_blas_thread()
def cross_validation_of(
    dataset: Dataset,
    options: FitOptions,
    *,
    folds: int = DEFAULT_FOLDS,
    effects: Sequence[Effect] = (),
    rng: np.random.Generator | None = None,
    on_progress: OnProgress | None = None,
) -> CrossValidation:
    """K-fold cross-validation of a dataset with points: see `calib.cross_validate`."""
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
    whole = fit_measured(split_dataset(dataset, everything, everything[:0])[0], options, effects=effects)
    done: list[Fold] = []
    before, after = [], []
    for fold in dealt:
        held_out = groups.poses_of(fold)
        split, rows = split_dataset(dataset, np.setdiff1d(everything, held_out), held_out)
        fitted = fit_measured(split, options, effects=effects)
        before.append(_held_out(fitted.before, rows, len(dataset.poses)))
        after.append(_held_out(fitted.after, rows, len(dataset.poses)))
        train, test = fitted.after.train, fitted.after.test
        assert train is not None
        assert test is not None
        done.append(Fold(tuple(dataset.poses.ids[i] for i in held_out), train, test, fitted.fit.converged))
        if on_progress is not None:
            on_progress(len(done), folds, f"fold {len(done)}")
    notes = tuple(f"setup {name!r} has too few poses to hold any out: all of them train" for name in small)
    notes += whole.fitted_dataset.notes[len(dataset.notes) :]
    return CrossValidation(dataset, options.residual, tuple(done), _pooled(before), _pooled(after), whole, notes)


def _held_out(evaluation: Evaluation, rows: IndexArray, poses: int) -> Evaluation:
    """Errors at the test poses of one split, with pose numbers of the whole dataset."""
    points = evaluation.is_tested[evaluation.pose]
    distances = evaluation.is_tested[evaluation.distance_pose]
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
    """Errors of all folds joined into one evaluation, in which each held-out point appears once."""
    return Evaluation(
        pose=np.concatenate([part.pose for part in parts]),
        error_mm=np.concatenate([part.error_mm for part in parts]),
        distance_pose=np.concatenate([part.distance_pose for part in parts]),
        distance_error_mm=np.concatenate([part.distance_error_mm for part in parts]),
        is_test=parts[0].is_test,
        scanner_T_base={},
        notes=tuple(dict.fromkeys(note for part in parts for note in part.notes)),
    )
