"""Errors at training poses that a fit did not see: K-fold cross-validation, and the learning curve over their number.

Poses of the role test take no part in folds. With noise alone the held-out mean square falls with the number n of
training poses as A + B / n towards A: a curve that still falls calls for more poses, a flat one above the noise for a
better model. Whether more than noise is left is the question of `calib.calibration.noise_level`.

Poses with the same joint vector form a group and stay together: repeats, several targets, the same joints under another
name. Otherwise a pose would be tested by a fit to its own repeats. Every setup keeps training poses, because its
scanner frame is fitted to them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

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
from calib.identifiability.structural import structural_rank
from calib.lazy_modules import pd
from calib.options import DEFAULT_FOLDS, FitOptions
from calib.presented import Presented
from calib.progress import OnProgress
from calib.statistics import rms

MIN_FRAME_POSES = 3  # fewer points do not determine a scanner frame


@dataclass(frozen=True)
class JointGroups:
    """Groups of a dataset's measured training poses; the poses of one group have the same joint vector."""

    poses: tuple[IndexArray, ...]  # of each group, indices into the dataset's poses
    setup: NDArray[np.str_]  # (K,) the setup of each group's first pose

    def __len__(self) -> int:
        return len(self.poses)

    def poses_of(self, groups: Sequence[int] | IndexArray) -> IndexArray:
        """Indices of the poses of some groups, in the dataset's order."""
        chosen = [self.poses[int(k)] for k in groups]
        return np.sort(np.concatenate(chosen)) if chosen else np.zeros(0, dtype=np.int64)


def training_groups(dataset: Dataset) -> JointGroups:
    """Groups of equal training and reference poses. Raises FitError where the dataset has no points."""
    if dataset.points is None:
        raise FitError(f"dataset {dataset.name}: no measured points yet; find the corners of its scans first")
    poses = dataset.poses
    measured = np.isin(np.arange(len(poses)), dataset.points.pose) & ~poses.is_test
    by_joints: dict[bytes, list[int]] = {}
    for i in np.flatnonzero(measured):
        by_joints.setdefault((np.round(poses.q[i], 9) + 0.0).tobytes(), []).append(int(i))
    groups = tuple(np.array(rows, dtype=np.int64) for rows in by_joints.values())
    return JointGroups(groups, np.array([str(poses.setup[rows[0]]) for rows in groups], dtype=str))


def deal_folds(groups: JointGroups, folds: int, rng: np.random.Generator) -> tuple[list[IndexArray], list[str]]:
    """Deal the groups into folds, setup by setup, so that each fold has its share of every setup.

    Returns:
        The groups of each fold, and the setups that are too small to lose any: fewer than three of their groups would
        be left for the scanner's frame, so all of them always train.
    """
    dealt: list[list[int]] = [[] for _ in range(folds)]
    small, turn = [], 0
    for setup in np.unique(groups.setup):
        members = rng.permutation(np.flatnonzero(groups.setup == setup))
        if len(members) - int(np.ceil(len(members) / folds)) < MIN_FRAME_POSES:
            small.append(str(setup))
            continue
        for group in members:
            dealt[turn % folds].append(int(group))
            turn += 1
    return [np.array(sorted(fold), dtype=np.int64) for fold in dealt], small


def growing_order(groups: JointGroups, among: IndexArray, rng: np.random.Generator) -> IndexArray:
    """Order of pose groups in which every beginning covers all setups: three of each, then in proportion."""
    rank, share = {}, {}
    for setup in np.unique(groups.setup[among]):
        members = rng.permutation(among[groups.setup[among] == setup])
        for k, group in enumerate(members):
            rank[int(group)] = 0 if k < MIN_FRAME_POSES else 1
            share[int(group)] = (k + rng.uniform()) / len(members)
    return np.array(sorted(rank, key=lambda group: (rank[group], share[group])), dtype=np.int64)


def split_dataset(dataset: Dataset, train: IndexArray, held_out: IndexArray) -> tuple[Dataset, IndexArray]:
    """Dataset with some poses for training and others held out as test poses, and the poses' indices (N,).

    The reference pose keeps its role where it is in `train`; else the first training pose becomes the reference.
    """
    assert dataset.points is not None
    rows = np.sort(np.concatenate([train, held_out]))
    poses = dataset.poses.select(rows)
    role = np.where(np.isin(rows, held_out), "test", np.where(poses.role == "reference", "reference", "train"))
    if not np.any(role == "reference"):
        role[np.flatnonzero(role == "train")[0]] = "reference"
    points = dataset.points.select(np.isin(dataset.points.pose, rows))
    kept = replace(points, pose=np.searchsorted(rows, points.pose))
    return replace(dataset, poses=replace(poses, role=role), points=kept, warnings=()), rows


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
