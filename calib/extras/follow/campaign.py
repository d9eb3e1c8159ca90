"""A measuring campaign as a value: what has arrived, how each pose is judged, the fit, and the outlook."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from calib.array_types import Array
from calib.blas_threads import one_blas_thread
from calib.brief import Brief
from calib.calibration.calibrate import fit_measured
from calib.calibration.result import Calibration
from calib.corners.search import CornerSearch
from calib.dataset.dataset import Dataset, Poses
from calib.dataset.files.folder import ArrivingDataset
from calib.errors import CalibError
from calib.extras.follow.judgement import PoseJudgement, judge_found, judge_missing
from calib.extras.follow.outlook import DrawnPoses, Outlook, drawn_poses, needs_drawn_poses, outlook_of
from calib.extras.follow.shift import Shift, find_shift, placed_anew
from calib.identifiability.structural import fewest_poses
from calib.measurement.measured_points import with_corners
from calib.options import FitOptions
from calib.planning.prediction import Prediction
from calib.planning.start import FromFit
from calib.presented import Presented
from calib.workcell.workcell import Workcell

_DRAWN_EVERY = 5  # poses that were found: drawing poses in a cell takes a second, and may find none at first


@dataclass(frozen=True)
class UnknownName(Brief):
    """Name of something that was measured, of which poses.csv has no pose (yet)."""

    name: str  # of a pose in points.csv, or of a file in the scan folder
    file: str  # "points.csv"; "" for the file of a scan
    near: str = ""  # pose of poses.csv whose name is much like it; "" where there is none


@dataclass(frozen=True, eq=False)
class Campaign(Presented):
    """A campaign so far; `judged` is in the order in which the poses arrived."""

    dataset: Dataset  # with the points of all poses that were found
    judged: Mapping[str, PoseJudgement] = field(default_factory=dict)
    calibration: Calibration | None = None  # robust fit of them; None while there are too few
    why_no_fit: str = ""
    outlook: Outlook | None = None
    shifts: tuple[Shift, ...] = ()  # of the instrument or the target, which the files do not tell
    unknown: tuple[UnknownName, ...] = ()  # measured, but of no pose that poses.csv has
    drawn: DrawnPoses | None = None
    history: tuple[tuple[int, Prediction], ...] = ()  # number of good poses and the error predicted then

    @property
    def good(self) -> tuple[str, ...]:
        """Ids of the poses that are good."""
        return tuple(pose_id for pose_id, judged in self.judged.items() if judged.state == "good")

    @property
    def found(self) -> tuple[str, ...]:
        """Ids of the poses with a point, in the order in which they arrived."""
        return tuple(pose_id for pose_id, judged in self.judged.items() if judged.state != "repeat")

    @property
    def open_poses(self) -> tuple[str, ...]:
        """Ids of the planned poses that are not measured yet, or to be measured again."""
        return tuple(pose_id for pose_id in self.dataset.poses.ids if pose_id not in self.good)

    @property
    def has_enough(self) -> bool:
        """Whether more poses no longer pay; False while no error can be predicted."""
        return self.outlook is not None and not self.outlook.pays

    def is_within(self, tolerance_mm: float | None) -> bool:
        """Whether the predicted error is below a tolerance, for 95 % of arms (the upper end of the band)."""
        return tolerance_mm is not None and self.outlook is not None and self.outlook.now.high_mm <= tolerance_mm

    def _brief(self) -> str:
        return f"{self.dataset.name}: {len(self.good)} good of {len(self.judged)} poses measured"


@one_blas_thread()
def with_arrivals(
    campaign: Campaign,
    arriving: ArrivingDataset,
    searches: Mapping[str, CornerSearch],
    options: FitOptions = FitOptions(),
) -> tuple[Campaign, tuple[PoseJudgement, ...]]:
    """Campaign with all that has arrived by now, and the judgements that are new or differ from those before.

    Args:
        campaign: before.
        arriving: the folder as it is now.
        searches: of all scans that have arrived, by pose id; {} where the dataset has points.
        options: of the fit, which is robust in any case.
    """
    dataset = arriving.dataset
    if dataset.points is None:
        dataset = with_corners(dataset, searches)
    assert dataset.points is not None
    has_point = {dataset.poses.ids[i] for i in np.unique(dataset.points.pose)}
    failed = {pose_id: search for pose_id, search in searches.items() if pose_id not in has_point}
    arrived = [*campaign.judged, *(i for i in dataset.poses.ids if i not in campaign.judged)]
    arrived = [i for i in arrived if i in has_point or i in failed or i in arriving.unseen]
    found = [pose_id for pose_id in arrived if pose_id in has_point]
    shifts = tuple(shift for shift in campaign.shifts if shift.first in found and not _is_told(dataset, shift))
    placed = placed_anew(dataset, found, shifts)
    further = find_shift(placed, found, options) if len(found) > len(campaign.found) else None
    if further is not None:
        shifts = (*shifts, further)
        placed = placed_anew(dataset, found, shifts)
    calibration, why_no_fit = _fitted(placed, options)
    judged_found = judge_found(placed, found, calibration)
    cell = _cell(calibration)
    judged: dict[str, PoseJudgement] = {}
    for pose_id in arrived:
        if pose_id in judged_found:
            judged[pose_id] = judged_found[pose_id]
        elif pose_id in failed:
            q = dataset.poses.q[dataset.poses.index(pose_id)]
            judged[pose_id] = replace(_missing(campaign, pose_id, failed[pose_id], cell, q), pose=pose_id)
        else:
            judged[pose_id] = PoseJudgement(pose_id, "repeat", "not seen")
    now = replace(
        campaign,
        dataset=dataset,
        judged=judged,
        calibration=calibration,
        why_no_fit=why_no_fit,
        shifts=shifts,
        outlook=None,
    )
    if calibration is not None and cell is not None:
        if now.drawn is None and len(found) % _DRAWN_EVERY == 0 and needs_drawn_poses(placed.poses, now.open_poses):
            now = replace(now, drawn=drawn_poses(calibration))
        now = replace(now, outlook=outlook_of(calibration, _to_come(placed, now), now.open_poses, now.drawn))
    if now.outlook is not None:
        now = replace(now, history=(*campaign.history, (len(now.good), now.outlook.now)))
    before = campaign.judged
    news = tuple(j for i, j in judged.items() if i not in before or before[i].told != j.told)
    return now, news


def _missing(campaign: Campaign, pose_id: str, search: CornerSearch, cell: Workcell | None, q: Array) -> PoseJudgement:
    """Judgement of a scan without a target, kept as it was told unless the search is another one."""
    before = campaign.judged.get(pose_id)
    if before is not None and before.failure == search.failure and (before.turn is not None or cell is None):
        return before
    return judge_missing(search, cell, q)


def _is_told(dataset: Dataset, shift: Shift) -> bool:
    """Whether the user has given the poses since a move a placement of their own in poses.csv."""
    setup = dataset.poses.setup
    return bool(setup[dataset.poses.index(shift.first)] != setup[dataset.poses.index(shift.before)])


def _to_come(placed: Dataset, campaign: Campaign) -> Poses:
    """Planned poses, those to come measured from where the instrument was moved to."""
    poses = placed.poses
    moved = [shift for shift in campaign.shifts if shift.what == "instrument"]
    if not moved:
        return poses
    last = moved[-1].first
    at = campaign.dataset.poses.setup == campaign.dataset.poses.setup[poses.index(last)]
    rows = at & np.isin(poses.ids, list(campaign.open_poses))
    return replace(poses, setup=np.where(rows, poses.setup[poses.index(last)], poses.setup))


def _fitted(dataset: Dataset, options: FitOptions) -> tuple[Calibration | None, str]:
    """Robust fit of what has arrived, or why there is none yet."""
    points = dataset.points
    assert points is not None
    trained = np.unique(points.pose[~dataset.poses.is_test[points.pose]])
    setups = max(len(set(dataset.poses.setup[trained])), 1)
    fewest = fewest_poses(dataset.robot, residual=options.residual, setups=setups)
    if len(trained) < fewest:
        return None, f"{len(trained)} of at least {fewest} poses that a fit takes"
    try:
        return fit_measured(dataset, replace(options, robust=True)), ""
    except CalibError as error:
        return None, str(error)


def _cell(calibration: Calibration | None) -> Workcell | None:
    """Cell as a fit knows it; None without a fit."""
    if calibration is None:
        return None
    try:
        return FromFit(calibration).cell
    except CalibError:
        return None
