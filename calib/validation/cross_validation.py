"""K-fold cross-validation over the training poses: each pose's error under a fit without that pose.

Poses of the role test take no part. Whether more poses would help is the question of
`calib.validation.learning_curve`, whether more than noise is left that of `calib.calibration.noise_level`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Unpack

import numpy as np

from calib.array_types import IndexArray
from calib.blas_threads import one_blas_thread
from calib.brief import Brief
from calib.calibration.calibrate import calibrate
from calib.calibration.evaluation import Evaluation, Figures
from calib.calibration.noise_level import SigmaCheck, check_sigma
from calib.calibration.result import Calibration
from calib.dataset.dataset import Dataset
from calib.effects.catalogue import EffectChoice, effects_named
from calib.errors import FitError
from calib.fitting.fit import Fit
from calib.lazy_modules import pd
from calib.measurement.measured_dataset import measured_as_asked
from calib.options import DEFAULT_FOLDS, FitFields, FitOptions
from calib.presented import Presented
from calib.progress import OnProgress, counted
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
def cross_validate(
    dataset: Dataset | str | Path,
    options: FitOptions | None = None,
    *,
    folds: int = DEFAULT_FOLDS,
    effects: EffectChoice | Sequence[EffectChoice] = (),
    rng: np.random.Generator | None = None,
    progress: bool = False,
    on_progress: OnProgress | None = None,
    **keywords: Unpack[FitFields],
) -> CrossValidation:
    """K-fold cross-validation: the error at each training pose by a fit without that pose's fold.

    Args:
        dataset: a dataset or its folder; its test poses are not touched.
        folds: number of folds; each has its share of every setup.
        options: options of every fit.
        effects: effects in the model of every fit: names of the catalogue, families, or single members.
        rng: deals the poses into folds; always the same where None.
        progress: show a bar, in a notebook's cell or at the terminal.
        on_progress: called with the number of fits done, of all fits, and the name of the fold.
        **keywords: fields of `FitOptions`, in place of those of `options`.

    Raises:
        FitError: no points, fewer than two folds, more folds than poses, or too few poses in a fold's training part.

    >>> import calib
    >>> calib.cross_validate("sample_data/hidden_effect_a", effects="transmission_error")
    CrossValidation(hidden_effect_a: 5 folds, held-out RMSE 0.1... mm)
    """
    dataset, options = measured_as_asked(dataset, options, keywords)
    members = effects_named(dataset, effects)
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
    whole = calibrate(split_dataset(dataset, everything, everything[:0])[0], options, effects=members)
    done: list[Fold] = []
    before, after = [], []
    with counted("fits", "fit", asked=progress, then=on_progress) as tell:
        for fold in dealt:
            held_out = groups.poses_of(fold)
            split, rows = split_dataset(dataset, np.setdiff1d(everything, held_out), held_out)
            fitted = calibrate(split, options, effects=members)
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
    """Errors at the test poses of one split, with pose numbers of the whole dataset."""
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
