"""A measuring campaign as a value: what has arrived, how each pose is judged, the fit and the error it predicts."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import takewhile
from typing import Literal

import numpy as np

from calib.array_types import Array, IndexArray
from calib.blas_threads import one_blas_thread
from calib.brief import Brief
from calib.calibration.calibrate import fit_measured
from calib.calibration.promise import PointPromise, promise
from calib.calibration.result import Calibration
from calib.corners.search import CornerSearch
from calib.dataset.dataset import Dataset, Poses
from calib.dataset.files.folder import ArrivingDataset
from calib.errors import CalibError
from calib.identifiability.structural import fewest_poses
from calib.measurement.measured_points import with_corners
from calib.options import FitOptions
from calib.planning.criterion import DesignProblem
from calib.planning.exchange import best_poses
from calib.planning.prediction import PAYS, STEP, Prediction, Region, predicted
from calib.planning.start import FromFit
from calib.presented import Presented
from calib.statistics import chi2_ppf

State = Literal["good", "doubtful", "repeat", "unknown"]
Reason = Literal["", "not compared", "uncertain", "off", "no target", "unreadable", "not seen", "not in poses.csv"]
NAMED = 3
"""Number of next poses that are named, the best first."""
FALSE_DOUBTS = 1e-4
"""Probability that a test pose which agrees with the fit is called doubtful."""
UNCERTAIN = 3.0
"""Sigma of a target over the median of the other poses' sigmas, from which it is doubtful."""
_ENOUGH_TO_COMPARE = 5  # poses whose median sigma is one
_FEWEST_TEST = 5  # planned test poses at which the error is predicted
_RUN = 3  # successive training poses that are off, from which something was moved rather than measured badly


@dataclass(frozen=True)
class PoseJudgement(Brief):
    """State of a measured pose with the reason for it."""

    pose: str
    state: State
    reason: Reason
    failure: str = ""  # of the search in the scan
    sigma_mm: float | None = None  # of the measured point by its own measurement, the worst target's
    error_mm: float | None = None  # measured minus predicted, three dimensions, the worst target's
    promised_mm: float | None = None  # standard deviation of such an error, root of the sum over the coordinates

    @property
    def told(self) -> tuple[object, ...]:
        """What a change of makes the judgement worth telling again."""
        reason = "" if self.reason == "not compared" else self.reason
        return self.pose, self.state, reason, self.failure


@dataclass(frozen=True)
class Outlook(Brief):
    """Predicted error of a campaign, what the planned poses that are left would do to it, and the best of these."""

    region: str
    now: Prediction
    then_mm: float  # predicted error with `further` more of the best poses, without noise
    further: int
    next: tuple[str, ...]  # poses of the plan; () where none is left

    @property
    def pays(self) -> bool:
        """Whether the best further poses lower the predicted error by more than 5 % for five of them."""
        return self.further > 0 and self.then_mm < (1.0 - PAYS * self.further / STEP) * self.now.geometry_mm


@dataclass(frozen=True, eq=False)
class Campaign(Presented):
    """A campaign so far; `judged` is in the order in which the poses arrived."""

    dataset: Dataset  # with the points of all poses that were found
    judged: Mapping[str, PoseJudgement] = field(default_factory=dict)
    calibration: Calibration | None = None  # robust fit of them; None while there are too few
    why_no_fit: str = ""
    outlook: Outlook | None = None

    def in_state(self, *states: State) -> tuple[str, ...]:
        """Names of the poses in some states, in the order in which they arrived."""
        return tuple(pose_id for pose_id, judged in self.judged.items() if judged.state in states)

    @property
    def unknown(self) -> tuple[str, ...]:
        """Names in points.csv that poses.csv does not have (yet)."""
        return self.in_state("unknown")

    @property
    def off_since(self) -> str | None:
        """First of the latest poses where these are all off, as where instrument or target were moved; None: not so."""
        poses = self.dataset.poses
        trained = [i for i in self.in_state("good", "doubtful") if not poses.is_test[poses.index(i)]]
        run = list(takewhile(lambda pose_id: self.judged[pose_id].reason == "off", reversed(trained)))
        return run[-1] if len(run) >= _RUN else None

    def is_enough(self, tolerance_mm: float | None = None) -> bool:
        """Whether the planned poses that are left no longer pay; False while no error can be predicted.

        With a tolerance: whether the predicted error is below it for 95 % of arms (the upper end of the band).
        """
        if self.outlook is None:
            return False
        return not self.outlook.pays if tolerance_mm is None else self.outlook.now.high_mm <= tolerance_mm

    def _brief(self) -> str:
        return f"{self.dataset.name}: {len(self.in_state('good'))} good of {len(self.judged)} poses measured"


@one_blas_thread()
def with_arrivals(
    campaign: Campaign, arriving: ArrivingDataset, searches: Mapping[str, CornerSearch]
) -> tuple[Campaign, tuple[PoseJudgement, ...]]:
    """Campaign with all that has arrived by now, and the judgements that are new or differ from those before.

    Args:
        campaign: before.
        arriving: the folder as it is now.
        searches: of all scans that have arrived, by pose id; {} where the dataset has points.
    """
    dataset = arriving.dataset
    if dataset.points is None:
        dataset = with_corners(dataset, searches)
    assert dataset.points is not None
    has_point = {dataset.poses.ids[i] for i in np.unique(dataset.points.pose)}
    calibration, why_no_fit = _fitted(dataset)
    judged = {pose_id: PoseJudgement(pose_id, "repeat", "not seen") for pose_id in arriving.unseen}
    judged |= {
        pose_id: PoseJudgement(
            pose_id, "repeat", "unreadable" if search.unreadable else "no target", search.failure
        )
        for pose_id, search in searches.items()
    }  # fmt: skip
    judged |= {name: PoseJudgement(name, "unknown", "not in poses.csv") for name in arriving.unknown}
    judged |= _judged(dataset, [pose_id for pose_id in dataset.poses.ids if pose_id in has_point], calibration)
    before = campaign.judged
    order = [*before, *(i for i in (*dataset.poses.ids, *arriving.unknown) if i not in before)]
    judged = {pose_id: judged[pose_id] for pose_id in order if pose_id in judged}
    left = [i for i in dataset.poses.ids if i not in judged or judged[i].state != "good"]
    outlook = None if calibration is None else _outlook(calibration, dataset.poses, left)
    news = tuple(j for i, j in judged.items() if i not in before or before[i].told != j.told)
    return Campaign(dataset, judged, calibration, why_no_fit, outlook), news


def _fitted(dataset: Dataset) -> tuple[Calibration | None, str]:
    """Robust fit of what has arrived, or why there is none yet."""
    points = dataset.points
    assert points is not None
    trained = np.unique(points.pose[~dataset.poses.is_test[points.pose]])
    fewest = fewest_poses(dataset.robot, setups=max(len(set(dataset.poses.setup[trained])), 1))
    if len(trained) < fewest:
        return None, f"{len(trained)} of at least {fewest} poses that a fit takes"
    try:
        return fit_measured(dataset, FitOptions(robust=True)), ""
    except CalibError as error:
        return None, str(error)


# ---- judgements ------------------------------------------------------------------------------------------------------


def _judged(dataset: Dataset, found: Sequence[str], calibration: Calibration | None) -> dict[str, PoseJudgement]:
    """Judgements of the poses that have points.

    A training pose is doubtful where the robust fit leaves it out; a test pose where its error is improbable by what
    was promised for it.
    """
    sigma_mm = _own_sigma_mm(dataset)
    usual = float(np.median(list(sigma_mm.values()))) if len(sigma_mm) >= _ENOUGH_TO_COMPARE else np.inf
    compared = {} if calibration is None else _compared(dataset, promise(calibration))
    judged = {}
    for pose_id in found:
        own = sigma_mm.get(pose_id)
        if calibration is None or pose_id not in compared:
            judged[pose_id] = PoseJudgement(pose_id, "good", "not compared", sigma_mm=own)
            continue
        error_mm, promised_mm, agrees = compared[pose_id]
        is_off = not agrees if dataset.poses.is_test[dataset.poses.index(pose_id)] else pose_id in calibration.outliers
        reason: Reason = "off" if is_off else "uncertain" if own is not None and own > UNCERTAIN * usual else ""
        judged[pose_id] = PoseJudgement(
            pose_id, "doubtful" if reason else "good", reason, sigma_mm=own, error_mm=error_mm, promised_mm=promised_mm
        )
    return judged


def _own_sigma_mm(dataset: Dataset) -> dict[str, float]:
    """Sigma of the worst target of each pose by its own covariance; {} where points have none."""
    points = dataset.points
    if points is None or points.covariance_mm2 is None:
        return {}
    sigma_mm = np.sqrt(np.linalg.eigvalsh(points.covariance_mm2)[:, -1])
    return {dataset.poses.ids[points.pose[i]]: float(sigma_mm[i]) for i in _worst(points.pose, sigma_mm)}


def _compared(dataset: Dataset, promised: PointPromise) -> dict[str, tuple[float, float, bool]]:
    """Error and promised sigma, mm, of each pose's worst point, and whether it is as small as promised."""
    limit = chi2_ppf(1.0 - FALSE_DOUBTS, 3)
    ratio = np.sum((promised.error_mm / promised.sigma_mm) ** 2, axis=1)
    error, sigma = (np.linalg.norm(each, axis=1) for each in (promised.error_mm, promised.sigma_mm))
    worst = _worst(promised.pose, ratio)
    return {
        dataset.poses.ids[promised.pose[i]]: (float(error[i]), float(sigma[i]), bool(ratio[i] < limit)) for i in worst
    }


def _worst(pose: IndexArray, values: Array) -> IndexArray:
    """Row of each pose's point with the largest of the values (M,)."""
    order = np.lexsort((values, pose))
    return order[np.diff(pose[order], append=-1) != 0]


# ---- outlook ---------------------------------------------------------------------------------------------------------


def _outlook(calibration: Calibration, planned: Poses, left: Collection[str]) -> Outlook:
    """Error predicted at the test poses, or where these are few at all planned poses, and the best poses of the plan.

    left: ids of the poses that are still to be measured, or measured again.
    """
    start, rng = FromFit(calibration), np.random.default_rng(0)
    unknowns = start.unknowns()
    placed = np.isin(planned.setup, list(unknowns.scanner_T_base))
    test = np.flatnonzero(planned.is_test & placed)
    name, at = f"the {len(test)} test poses", test
    if len(test) < _FEWEST_TEST:
        name, at = "the planned poses", np.flatnonzero(placed)
    there = planned.select(at)
    region = Region.of(name, there, unknowns, start.missed_mm2(there))
    now = predicted(region, unknowns.prior_information, unknowns.noise_dof, rng)
    rows = np.flatnonzero(placed & ~planned.is_test & np.isin(planned.ids, list(left)))
    if not len(rows):
        return Outlook(name, now, now.geometry_mm, 0, ())
    offered = planned.select(rows)
    problem = DesignProblem(start, unknowns, offered, unknowns.rows(offered), region)
    chosen = best_poses([problem.region_question], min(STEP, len(offered)), exchange=False)
    then_mm = float(np.sqrt(np.exp(chosen.greedy_log_values[-1]) + region.missed_mm2))
    return Outlook(name, now, then_mm, len(chosen.rows), tuple(planned.ids[rows[i]] for i in chosen.rows[:NAMED]))
