"""The learning curve: held-out error against the number n of training poses, and whether more poses would help.

With noise alone the held-out mean square falls as A + B / n towards A. A curve that still falls calls for more poses, a
flat one above the noise for a better model.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from calib.array_types import IndexArray
from calib.blas_threads import one_blas_thread
from calib.calibration.calibrate import fit_measured
from calib.calibration.noise_level import SigmaCheck, check_sigma
from calib.calibration.result import Calibration
from calib.dataset.dataset import Dataset
from calib.effects.effect import Effect
from calib.errors import FitError
from calib.identifiability.structural import structural_rank
from calib.lazy_modules import pd
from calib.options import FitOptions
from calib.presented import Presented
from calib.progress import OnProgress
from calib.statistics import rms
from calib.validation.splits import (
    MIN_FRAME_POSES,
    JointGroups,
    deal_folds,
    growing_order,
    split_dataset,
    training_groups,
)

FLAT = 0.05  # least share by which twice the poses lower the error, for them to be worth measuring
FAR = 2.0  # held-out over training error from which the held-out poses are of another kind
_FOLDS = 5


@dataclass(frozen=True)
class LearningStep:
    """Errors of fits to the same number of training poses, over several draws of poses."""

    poses: int  # different ones; repeats of one count once
    fits: int
    train_rmse_mm: float  # 3D, RMS over the fits
    held_out_rmse_mm: float
    spread_mm: float  # standard deviation of the fits' held-out RMSE; 0 of one fit
    sigma_mm: float  # residual sigma per coordinate, by degrees of freedom; nan where none are left
    degrees_of_freedom: float  # mean


@dataclass(frozen=True)
class LearningCurve(Presented):
    """Errors at increasing numbers of training poses."""

    dataset: Dataset
    residual: str
    held_out: str  # "test poses" or "folds": which poses were held out
    steps: tuple[LearningStep, ...]
    sigma: SigmaCheck  # of a fit to the largest count
    notes: tuple[str, ...]

    @property
    def doubled_rmse_mm(self) -> float:
        """Held-out RMSE, mm, expected with twice the poses, by a fit of A + B / n to the curve's upper part.

        A and B are 0 or above.
        """
        floor, slope = self._floor_and_slope()
        return float(np.sqrt(floor + 0.5 * slope / self.steps[-1].poses))

    @property
    def gain(self) -> float:
        """Relative decrease of the held-out RMSE expected with twice the poses."""
        floor, slope = self._floor_and_slope()
        now = float(np.sqrt(floor + slope / self.steps[-1].poses))
        return 1.0 - self.doubled_rmse_mm / now if now > 0.0 else 0.0

    def _floor_and_slope(self) -> tuple[float, float]:
        from scipy.optimize import nnls  # slow to load, and only this needs it

        upper = [step for step in self.steps if 2.5 * step.poses >= self.steps[-1].poses]
        upper = upper if len(upper) >= 3 else list(self.steps[-3:])
        square = np.array([step.held_out_rmse_mm**2 for step in upper])
        weight = 1.0 / np.maximum(square, 1e-300)  # relative errors count, not absolute ones
        columns = np.array([[1.0, 1.0 / step.poses] for step in upper]) * weight[:, None]
        floor, slope = nnls(columns, square * weight)[0]
        return float(floor), float(slope)

    @property
    def flat_since(self) -> int | None:
        """Number of poses from which the held-out error stays within 5 % of its last value; None if still falling."""
        if self.gain > FLAT:
            return None
        limit = (1.0 + FLAT) * self.steps[-1].held_out_rmse_mm
        above = [k for k, step in enumerate(self.steps) if step.held_out_rmse_mm > limit]
        return self.steps[above[-1] + 1 if above else 0].poses

    def to_frame(self) -> pd.DataFrame:
        """Table with one row per count: poses, fits, training and held-out RMSE, spread, residual and noise sigma."""
        frame = pd.DataFrame([vars(step) for step in self.steps])
        declared = self.sigma.declared_mm
        return frame.assign(declared_sigma_mm=float("nan") if declared is None else declared)

    def _brief(self) -> str:
        first, last = self.steps[0], self.steps[-1]
        errors = f"held-out RMSE {first.held_out_rmse_mm:.3g} -> {last.held_out_rmse_mm:.3g} mm"
        return f"{self.dataset.name}: {first.poses} to {last.poses} poses, {errors}"


@one_blas_thread()
def learning_curve_of(
    dataset: Dataset,
    options: FitOptions,
    *,
    counts: Sequence[int] | None = None,
    repeats: int = 5,
    effects: Sequence[Effect] = (),
    rng: np.random.Generator | None = None,
    on_progress: OnProgress | None = None,
) -> LearningCurve:
    """Held-out error of a dataset with points against the number of training poses: see `calib.learning_curve`."""
    rng = rng or np.random.default_rng(0)
    groups = training_groups(dataset)
    if repeats < 1:
        raise FitError(f"found {repeats} repeats; a learning curve needs 1 at least, 5 is usual")
    held_out, draws = _draws(dataset, groups, repeats, rng)
    fewest = _fewest(dataset, groups, options.residual)
    most = min(len(order) for order, _ in draws)
    if counts is None:
        counts = np.unique(np.round(np.geomspace(fewest, max(most, fewest), 6)).astype(int)).tolist()
    counts = sorted({int(n) for n in counts})
    if most < fewest or len(counts) < 2 or counts[0] < fewest or counts[-1] > most:
        raise FitError(
            f"dataset {dataset.name}: a learning curve needs two counts or more between {fewest} poses, the fewest "
            f"that carry a fit, and the {most} there are; found {', '.join(map(str, counts))}"
        )
    tests = np.flatnonzero(dataset.poses.is_test)
    fits: dict[int, list[Calibration]] = {n: [] for n in counts}
    for repeat, (order, held) in enumerate(draws):
        for k, n in enumerate(counts):
            if n == len(groups) and fits[n]:
                continue  # all poses and the same test poses: the same fit again
            outside = tests if held is None else groups.poses_of(held)
            split, _ = split_dataset(dataset, groups.poses_of(order[:n]), outside)
            fits[n].append(fit_measured(split, options, effects=effects))
            if on_progress is not None:
                on_progress(repeat * len(counts) + k + 1, repeats * len(counts), f"{n} poses")
    last = fits[counts[-1]][0]
    steps = tuple(_step(n, fits[n]) for n in counts)
    return LearningCurve(dataset, options.residual, held_out, steps, check_sigma(last), last.after.notes)


def _draws(
    dataset: Dataset, groups: JointGroups, repeats: int, rng: np.random.Generator
) -> tuple[str, list[tuple[IndexArray, IndexArray | None]]]:
    """For each repeat, the order in which pose groups are added, and the held-out groups (None: the test poses)."""
    assert dataset.points is not None
    everything = np.arange(len(groups))
    if np.any(dataset.poses.is_test[dataset.points.pose]):
        return "test poses", [(growing_order(groups, everything, rng), None) for _ in range(repeats)]
    folds = [fold for fold in deal_folds(groups, _FOLDS, rng)[0] if len(fold)]
    if not folds:
        raise FitError(
            f"dataset {dataset.name}: no test poses, and {len(groups)} training poses are too few to hold some out"
        )
    held = [folds[repeat % len(folds)] for repeat in range(repeats)]
    return "folds", [(growing_order(groups, np.setdiff1d(everything, fold), rng), fold) for fold in held]


def _fewest(dataset: Dataset, groups: JointGroups, residual: str) -> int:
    """Fewest groups of poses that can be fitted, by the number of unknowns and of setups.

    They are two more than parameters and frames need, and three per setup.
    """
    assert dataset.points is not None
    setups = len(np.unique(groups.setup))
    knowable = structural_rank(dataset.robot)
    if residual == "distance":
        return max(knowable + setups + 2, MIN_FRAME_POSES * setups)
    rows = 3 * len(np.unique(dataset.points.target))
    return max(int(np.ceil((knowable + 6 * setups) / rows)) + 2, MIN_FRAME_POSES * setups)


def _step(poses: int, fits: list[Calibration]) -> LearningStep:
    train = [fit.after.train.rmse_mm for fit in fits if fit.after.train is not None]
    held_out = [fit.after.test.rmse_mm for fit in fits if fit.after.test is not None]
    return LearningStep(
        poses=poses,
        fits=len(fits),
        train_rmse_mm=rms(train),
        held_out_rmse_mm=rms(held_out),
        spread_mm=float(np.std(held_out, ddof=1)) if len(held_out) > 1 else 0.0,
        sigma_mm=rms([fit.sigma_mm for fit in fits]),
        degrees_of_freedom=float(np.mean([fit.fit.degrees_of_freedom for fit in fits])),
    )
