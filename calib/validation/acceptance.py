"""Acceptance of a dataset (`check`): every step from the corners to the held-out error, and whether it passes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from calib.brief import Brief
from calib.calibration.calibrate import fit_measured
from calib.calibration.evaluation import Figures
from calib.calibration.held_out import HeldOutTest, held_out_test
from calib.calibration.mount import camera_places
from calib.calibration.noise_level import FIT, NoiseLevel, check_sigma, noise_level
from calib.calibration.plausibility import fit_without_outliers, implausibility_reason, too_good
from calib.calibration.promise import learned_discrepancy
from calib.calibration.result import Calibration, declared_sigma_mm
from calib.calibration.table_doubts import DoubtfulEntry, doubtful_entries
from calib.consistency.data_problem import DataProblem
from calib.corners.search import CornerSearch
from calib.dataset.dataset import Dataset
from calib.dataset.repeats import Repeats, find_repeats, pooled_sigma_mm, scatter_against_covariances
from calib.diagnosis.diagnose import whole_diagnosis
from calib.diagnosis.result import Diagnosis
from calib.diagnosis.search_space import SearchSpace
from calib.effects.effect import Effect, Family
from calib.errors import FitError
from calib.fitting.tool_point import ToolShift
from calib.identifiability.structural import fewest_poses
from calib.measurement.measured_points import failed_searches
from calib.options import FitOptions
from calib.presented import Presented
from calib.progress import OnStep
from calib.scans.scan import PointCount
from calib.targets.search import ScanSearch
from calib.validation.cross_validation import SUSPICIOUS, noise_ratio, training_groups
from calib.validation.remounting import Remounting, remounting

MAX_SIGMA_RATIO = 100.0
"""Residual sigma over the declared sigma, beyond which the arm is not calibrated, whatever the improvement."""
MIN_SIGMA_RATIO = 1.0 / 1.5  # ratio below which sigma was declared too large, unless by chance
MAX_LEFT_RATIO = 10.0
"""Largest ratio for the model at the end of the diagnosis; above it the residual has an unknown cause."""
UNSETTLED = ("unexplained", "ambiguous", "outliers")
"""Verdicts that are a warning: the residual has a cause without a name."""
_NO_NOISE_MM = 1e-6  # floor where no noise is declared
_MORE_SCATTER, _BY_CHANCE = 1.5, 0.001  # scatter of repeats over their covariances, and its p-value, for a warning
COARSE_CORNER_MM = 0.15
"""Sigma of a corner (3D) above which scans gain little: arms are 0.3 to 1 mm off as delivered (`docs/measured.md`)."""
MAX_SHARE_DROPPED = 0.5  # share of a scan's points without a value; more is a warning


@dataclass(frozen=True)
class ThinScans(Brief):
    """Scans in which more than half of the points have no value."""

    count: int
    scans: int  # of so many
    worst: str  # pose of the scan with the largest lost share
    dropped: int  # points of that scan without a value
    points: int  # all points of that scan


@dataclass(frozen=True)
class MissingCorners(Brief):
    """Scans in which no corner was found."""

    count: int
    scans: int  # of so many
    first: str  # pose of the first such scan
    reason: str


@dataclass(frozen=True)
class FoundCorners(Brief):
    """Corners found in all scans."""

    scans: int
    sigma_mm: float  # median

    @property
    def is_coarse(self) -> bool:
        """Whether the corners are known too coarsely for a calibration to gain much."""
        return self.sigma_mm > COARSE_CORNER_MM


@dataclass(frozen=True)
class RepeatScatter(Brief):
    """Scatter of repeated measurements at the same poses."""

    places: int
    sigma_mm: float  # one coordinate
    declared_ratio: float | None  # sigma over the declared one, where it is too large for points of one place
    covariance_ratio: float | None  # over what the points' covariances say, where they have any
    doubtful: bool  # whether that ratio is more than chance makes it


@dataclass(frozen=True)
class TooFewPoses(Brief):
    """Number of different training poses, which is too small for a fit."""

    poses: int
    needed: int


@dataclass(frozen=True)
class OutlyingPoses(Brief):
    """Poses that stand out from all others, by a plain fit and by a robust fit that leaves them out."""

    plain: Calibration
    robust: Calibration


@dataclass(frozen=True)
class ErrorsOfTestPoses(Brief):
    """Errors of the test poses before and after the fit, both None where no pose has the role test."""

    before: Figures | None
    after: Figures | None
    asked_mm: float | None  # largest RMSE that passes, where one was given


@dataclass(frozen=True)
class ErrorRatio(Brief):
    """RMSE of the test poses over that of the training poses."""

    ratio: float
    expected: float | None  # ratio that noise explains; None where the one found is no doubt
    moved: Remounting | None  # motion of all test points that explains their error
    worst_pose: str
    worst_mm: float


@dataclass(frozen=True)
class ResidualSigma(Brief):
    """Residual sigma per coordinate, compared with the noise."""

    sigma_mm: float
    level: NoiseLevel
    ratio: float  # over that noise
    meaning: Literal["", "implausible", "excess", "below"]
    doubt: str = ""  # what makes it implausible, where more than its size does


@dataclass(frozen=True)
class ResidualOfDiagnosis(Brief):
    """Residual sigma per coordinate under the diagnosed model, compared with the declared sigma."""

    sigma_mm: float
    ratio: float  # over the declared sigma
    effects: bool  # whether the model has any beside the link errors


Evidence = (
    str  # a sentence of the dataset, or why something was not tried or cannot be
    | ThinScans
    | MissingCorners
    | FoundCorners
    | RepeatScatter
    | TooFewPoses
    | Calibration
    | ToolShift
    | DoubtfulEntry
    | OutlyingPoses
    | ErrorsOfTestPoses
    | ErrorRatio
    | ResidualSigma
    | ResidualOfDiagnosis
    | DataProblem
    | Diagnosis
    | HeldOutTest
)


@dataclass(frozen=True)
class CheckItem(Presented):
    """Result of one step of an acceptance check, with the facts that decide it."""

    name: str
    passed: bool | None  # None: a note or a warning, which does not decide
    evidence: Evidence
    warning: bool = False

    @property
    def status(self) -> Literal["ok", "FAIL", "WARN", "note"]:
        """Status of the step: passed, failed, or a warning or note, which do not decide the check."""
        if self.passed is None:
            return "WARN" if self.warning else "note"
        return "ok" if self.passed else "FAIL"


@dataclass(frozen=True)
class Check(Presented):
    """Result of the acceptance check of a dataset, which passes where no step failed."""

    dataset: Dataset  # with the points that were judged
    items: tuple[CheckItem, ...]
    calibration: Calibration | None
    repeats: tuple[Repeats, ...]
    diagnosis: Diagnosis | None = None  # where the fit leaves degrees of freedom for one

    @property
    def passed(self) -> bool:
        """Whether no item failed."""
        return all(item.passed is not False for item in self.items)

    @property
    def failed(self) -> tuple[CheckItem, ...]:
        """Failed steps of the check."""
        return tuple(item for item in self.items if item.passed is False)

    @property
    def poses_missing(self) -> TooFewPoses | None:
        """What is missing where all that was scanned is good enough and there are only too few poses yet."""
        scanned = any(isinstance(item.evidence, FoundCorners) and not item.warning for item in self.items)
        few = [item.evidence for item in self.failed if isinstance(item.evidence, TooFewPoses)]
        return few[0] if scanned and few and len(self.failed) == 1 else None

    @property
    def warnings(self) -> tuple[CheckItem, ...]:
        """Steps of the check that gave a warning, which does not decide the check."""
        return tuple(item for item in self.items if item.warning)

    def _brief(self) -> str:
        failed = ", ".join(item.name for item in self.items if item.passed is False)
        verdict = "passed" if self.passed else f"failed: {failed}"
        return f"{self.dataset.name}: {verdict}, {len(self.warnings)} warnings"


def check_of(
    dataset: Dataset,
    searches: Mapping[str, CornerSearch],
    options: FitOptions,
    *,
    effects: Sequence[Effect] = (),
    user_effects: Sequence[Family] = (),
    max_test_rmse_mm: float | None = None,
    on_step: OnStep | None = None,
) -> Check:
    """Acceptance check of a dataset and the searches that its points come from, if any: see `calib.check`."""
    items = _told(dataset.warnings, dataset.notes)
    if searches:
        items += thin_scans({pose: s.count for pose, s in searches.items() if s.count is not None})
        items.append(_corners(searches))
    repeats = find_repeats(dataset)
    if repeats:
        items.append(_repeats(dataset, repeats))
    calibration = diagnosis = None
    groups = training_groups(dataset)
    needed = fewest_poses(dataset.robot, residual=options.residual, setups=len(np.unique(groups.setup)))
    if len(groups) < needed:
        items.append(CheckItem("fit", None if repeats else False, TooFewPoses(len(groups), needed)))
    else:
        calibration = fit_measured(dataset, options, effects=effects)
        fitted = calibration.fitted_dataset  # in which repeats at one pose are averaged
        items += _told(fitted.warnings[len(dataset.warnings) :], fitted.notes[len(dataset.notes) :])
        items += _fit(calibration, max_test_rmse_mm)
        try:
            usual = options.with_residual(dataset.usual_residual)
            space = SearchSpace.of(dataset, usual, given=effects, user_effects=user_effects)
            diagnosis = whole_diagnosis(space, on_step)
            if diagnosis.data_problem is not None:
                items.append(CheckItem("data", False, diagnosis.data_problem))
            else:
                items.append(CheckItem("diagnosis", None, diagnosis, warning=diagnosis.verdict in UNSETTLED))
                items += _left_by_diagnosis(diagnosis)
                items += _promise(diagnosis)
        except FitError as error:  # no degree of freedom is left: a note, no failure
            items.append(CheckItem("diagnosis", None, f"not tried: {error}"))
    return Check(dataset, tuple(items), calibration, repeats, diagnosis)


def _told(warnings: Sequence[str], notes: Sequence[str]) -> list[CheckItem]:
    """Check items on what is told of a dataset."""
    return [
        *(CheckItem("dataset", None, warning, warning=True) for warning in warnings),
        *(CheckItem("dataset", None, note) for note in notes),
    ]


def thin_scans(counts: Mapping[str, PointCount]) -> list[CheckItem]:
    """Warning where more than half of a scan's points have no value."""
    thin = {pose_id: count for pose_id, count in counts.items() if count.share_dropped > MAX_SHARE_DROPPED}
    if not thin:
        return []
    pose_id, worst = max(thin.items(), key=lambda item: item[1].share_dropped)
    lost = ThinScans(len(thin), len(counts), pose_id, worst.dropped, worst.points + worst.dropped)
    return [CheckItem("scans", None, lost, warning=True)]


def _corners(searches: Mapping[str, CornerSearch]) -> CheckItem:
    failed = failed_searches(searches)
    if failed:
        first, reason = next(iter(failed.items()))
        return CheckItem("corners", False, MissingCorners(len(failed), len(searches), first, reason))
    sigmas = [
        place.sigma_mm()
        for search in searches.values()
        for place in (search.places if isinstance(search, ScanSearch) else (search.corner,))
        if place is not None
    ]
    found = FoundCorners(len(searches), float(np.median(sigmas)))
    return CheckItem("corners", None if found.is_coarse else True, found, warning=found.is_coarse)


def _repeats(dataset: Dataset, repeats: tuple[Repeats, ...]) -> CheckItem:
    sigma_mm = pooled_sigma_mm(repeats)
    hopeless = dataset.declares_noise and sigma_mm > MAX_SIGMA_RATIO * declared_sigma_mm(dataset)
    scatter = scatter_against_covariances(dataset)
    doubtful = scatter is not None and scatter.ratio > _MORE_SCATTER and scatter.p_value < _BY_CHANCE
    found = RepeatScatter(
        len(repeats),
        sigma_mm,
        sigma_mm / declared_sigma_mm(dataset) if hopeless else None,
        None if scatter is None else scatter.ratio,
        doubtful,
    )
    return CheckItem("repeats", False if hopeless else None, found, warning=doubtful)


def _against_training(calibration: Calibration, train: Figures, test: Figures) -> CheckItem:
    """Check item on the ratio of test to training error, compared with the ratio that noise explains.

    It is a warning where the ratio is larger, unless the test error is no more than the noise, declared or by repeats:
    the training error is then not to be expected elsewhere.
    """
    ratio, expected = test.rmse_mm / train.rmse_mm, noise_ratio(calibration.fit)
    floor_mm = _floor_mm(noise_level(calibration))
    doubtful = ratio > SUSPICIOUS * expected and test.rmse_mm > SUSPICIOUS * floor_mm
    after = calibration.after
    error_mm = np.linalg.norm(after.error_mm, axis=1)
    worst = int(np.argmax(np.where(after.is_tested[after.pose], error_mm, -1.0)))
    found = ErrorRatio(
        ratio,
        expected if doubtful else None,
        remounting(calibration) if doubtful else None,
        calibration.dataset.poses.ids[after.pose[worst]],
        float(error_mm[worst]),
    )
    return CheckItem("test against training", None, found, warning=doubtful)


def _floor_mm(level: NoiseLevel) -> float:
    """3D error that noise alone causes, mm; nearly 0 where the noise is known only from the fit's own residual."""
    return level.floor_mm or _NO_NOISE_MM if level.source != FIT else _NO_NOISE_MM


def _fit(calibration: Calibration, max_test_rmse_mm: float | None) -> list[CheckItem]:
    fit, shift, robust = calibration.fit, calibration.tool_shift, fit_without_outliers(calibration)
    by_camera = calibration.dataset.is_by_camera  # whose board no file places on the arm
    return [
        CheckItem("fit", fit.converged, calibration),
        *([] if shift is None else [CheckItem("tool point", None, shift, warning=not by_camera)]),
        *(_camera(calibration) if by_camera else ()),
        *(CheckItem("robot table", None, entry, warning=True) for entry in doubtful_entries(calibration)),
        *([] if robust is None else [CheckItem("outliers", None, OutlyingPoses(calibration, robust), warning=True)]),
        *(CheckItem("fit", None, note) for note in calibration.after.notes),
        *_test_poses(calibration, max_test_rmse_mm),
        *_residual(calibration),
    ]


def _camera(calibration: Calibration) -> list[CheckItem]:
    """Check items on how well a camera's place is known, in each setup; failed where the poses do not determine it."""
    items = []
    for place in camera_places(calibration):
        place_mm, turn_rad = np.split(np.sqrt(np.diag(place.covariance)), 2)
        known = bool(np.isfinite(place.covariance).all())
        found = f"place in the {place.parent}'s frame known to {place_mm.max():.2g} mm"
        words = f"{found}, attitude to {np.degrees(turn_rad.max()):.2g}°" if known else "the poses do not determine it"
        items.append(CheckItem("camera", known, f"{words}, setup {place.setup}" if place.setup else words))
    return items


def _test_poses(calibration: Calibration, max_test_rmse_mm: float | None) -> list[CheckItem]:
    train, test, before = calibration.after.train, calibration.after.test, calibration.before.test
    errors = ErrorsOfTestPoses(before, test, max_test_rmse_mm)
    if test is None or before is None:
        asked = max_test_rmse_mm is not None
        return [CheckItem("test poses", False if asked else None, errors, warning=not asked)]
    good: bool | None = test.rmse_mm < before.rmse_mm
    if max_test_rmse_mm is not None:
        good = test.rmse_mm <= max_test_rmse_mm
    elif not calibration.fits_links or calibration.dataset.is_by_camera:  # it cannot fall, or need not
        good = None
    items = [CheckItem("test poses", good, errors)]
    if train is not None and train.rmse_mm > 0.0:
        items.append(_against_training(calibration, train, test))
    return items


def _promise(diagnosis: Diagnosis) -> list[CheckItem]:
    """Check item on whether the test poses' error exceeds what the diagnosed model promises for unseen poses.

    The promise is that of `calib.calibration.promise`: noise, parameters, and what the model is known to miss.
    """
    last, tests = diagnosis.calibration, diagnosis.residual_tests
    noise_mm, noise_from = tests.noise_mm, tests.noise_from
    if last.sigma_mm > noise_mm:  # an excess over the noise has an item of its own; the promise includes it
        noise_mm, noise_from = last.sigma_mm, "fit"
    test = held_out_test(last, noise_mm, noise_from, learned_discrepancy(last))
    if test is None:
        return []
    return [CheckItem("promise", not test.is_broken, test)]


def _too_good(name: str, calibration: Calibration) -> list[CheckItem]:
    """Check item on a residual far below the declared noise (failed) or with no declared noise (warning)."""
    words, declared = too_good(calibration), calibration.dataset.declares_noise
    return [CheckItem(name, False if declared else None, words, warning=not declared)] if words else []


def _left_by_diagnosis(diagnosis: Diagnosis) -> list[CheckItem]:
    """Check item, failed where the diagnosed model's residual is implausible: far above or below the noise."""
    last = diagnosis.calibration
    doubt = implausibility_reason(last) if last.model.added_effects else ""
    if doubt:
        return [CheckItem("model", False, doubt)]
    if surprise := _too_good("model", last):
        return surprise
    if not last.dataset.declares_noise or not last.fit.reduced_chi > MAX_LEFT_RATIO:
        return []
    left = ResidualOfDiagnosis(last.sigma_mm, last.fit.reduced_chi, bool(last.model.family_names))
    return [CheckItem("noise", False, left)]


def _residual(calibration: Calibration) -> list[CheckItem]:
    noise = calibration.fit.reduced_chi
    if not np.isfinite(noise):
        return []
    declared, doubt = calibration.dataset.declares_noise, implausibility_reason(calibration)
    if not doubt and (surprise := _too_good("residual", calibration)):
        return surprise
    meaning: Literal["", "implausible", "excess", "below"] = ""
    if doubt or (declared and noise > MAX_SIGMA_RATIO):
        meaning = "implausible"
    elif declared and noise > 1.5:
        meaning = "excess"
    elif declared and noise < MIN_SIGMA_RATIO and check_sigma(calibration).verdict == "below":
        meaning = "below"
    level = noise_level(calibration)
    ratio = noise if level.is_declared else calibration.sigma_mm / level.sigma_mm
    found = ResidualSigma(calibration.sigma_mm, level, ratio, meaning, doubt)
    failed = meaning == "implausible"
    return [CheckItem("residual", False if failed else None, found, warning=bool(meaning) and not failed)]
