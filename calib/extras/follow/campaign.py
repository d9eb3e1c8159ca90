"""A measuring campaign as a value: what has arrived, how each pose is judged, the fit, and the outlook."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from itertools import takewhile

import numpy as np

from calib.blas_threads import one_blas_thread
from calib.calibration.calibrate import fit_measured
from calib.calibration.result import Calibration
from calib.corners.search import CornerSearch
from calib.dataset.dataset import Dataset
from calib.dataset.files.folder import ArrivingDataset
from calib.errors import CalibError
from calib.extras.follow.judgement import PoseJudgement, Reason, judge_found
from calib.extras.follow.outlook import DrawnPoses, Outlook, drawn_poses, needs_drawn_poses, outlook_of
from calib.identifiability.structural import fewest_poses
from calib.measurement.measured_points import with_corners
from calib.options import FitOptions
from calib.presented import Presented

_RUN = 3  # successive training poses that are off, from which something was moved rather than measured badly
_DRAWN_EVERY = 5  # poses that were found: drawing poses in a cell takes a second, and may find none at first


@dataclass(frozen=True, eq=False)
class Campaign(Presented):
    """A campaign so far; `judged` is in the order in which the poses arrived."""

    dataset: Dataset  # with the points of all poses that were found
    judged: Mapping[str, PoseJudgement] = field(default_factory=dict)
    calibration: Calibration | None = None  # robust fit of them; None while there are too few
    why_no_fit: str = ""
    outlook: Outlook | None = None
    unknown: tuple[str, ...] = ()  # names in points.csv, or files of scans, of no pose that poses.csv has (yet)
    drawn: DrawnPoses | None = None

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

    @property
    def off_since(self) -> str | None:
        """First of the latest poses where these are all off, as where instrument or target were moved; None: not so."""
        trained = [i for i in self.found if not self.dataset.poses.is_test[self.dataset.poses.index(i)]]
        run = list(takewhile(lambda pose_id: self.judged[pose_id].reason == "off", reversed(trained)))
        return run[-1] if len(run) >= _RUN else None

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
    calibration, why_no_fit = _fitted(dataset, options)
    judged_found = judge_found(dataset, found, calibration)
    judged: dict[str, PoseJudgement] = {}
    for pose_id in arrived:
        if pose_id in judged_found:
            judged[pose_id] = judged_found[pose_id]
        elif pose_id in failed:
            search = failed[pose_id]
            reason: Reason = "unreadable" if search.unreadable else "no target"
            judged[pose_id] = PoseJudgement(pose_id, "repeat", reason, search.failure)
        else:
            judged[pose_id] = PoseJudgement(pose_id, "repeat", "not seen")
    now = replace(
        campaign,
        dataset=dataset,
        judged=judged,
        calibration=calibration,
        why_no_fit=why_no_fit,
        outlook=None,
    )
    if calibration is not None:
        if now.drawn is None and len(found) % _DRAWN_EVERY == 0 and needs_drawn_poses(dataset.poses, now.open_poses):
            now = replace(now, drawn=drawn_poses(calibration))
        now = replace(now, outlook=outlook_of(calibration, dataset.poses, now.open_poses, now.drawn))
    before = campaign.judged
    news = tuple(j for i, j in judged.items() if i not in before or before[i].told != j.told)
    return now, news


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
