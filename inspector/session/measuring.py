"""Changes of a session during measurement: search a scan, label the jig's faces, analyse redundancy."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from calib.corners.batch import declared_noise, of_one_jig
from calib.corners.search import CornerSearch, failed_search
from calib.dataset.dataset import Dataset
from calib.dataset.files.folder import load_arriving_dataset, load_dataset
from calib.errors import CalibError, DatasetError, printable
from calib.fitting.observations import Observations
from calib.fitting.pose_residuals import require_orientations
from calib.identifiability.structural import redundancy_of
from calib.measurement.face_labels import FaceLabels
from calib.measurement.measured_points import label_faces
from calib.options import RESIDUAL_KINDS
from calib.scans.scan import Scan, load_scan
from calib.served_process import within_limits
from calib.targets.search import finder_of, search_targets_file
from inspector.session.session import Session, untested


def open_session(folder: Path) -> Session:
    """New session on a dataset folder, which may still be being filled. Raises DatasetError.

    What a complete dataset would have and this one has not (yet) is a warning in it.
    """
    return Session(within_limits(printable(folder.name), _readable, folder))


def _readable(folder: Path) -> Dataset:
    """Dataset of a folder as far as it is there."""
    try:
        return load_dataset(folder)
    except DatasetError as error:
        tables = [path.name for path in folder.glob("*.csv")]
        arrived = load_arriving_dataset(folder, tables).dataset  # raises for any other fault
        return replace(arrived, warnings=(*arrived.warnings, f"still being measured? {error}"))


def read_scan(dataset: Dataset, pose: int, *, search: bool) -> tuple[Scan | None, CornerSearch | None]:
    """Scan of a pose, None where it cannot be read, and, if asked for, the search for its corner.

    Both are worked out in a bounded process.
    """
    path = dataset.scan_path(pose)
    if path is None:
        raise DatasetError(f"dataset {dataset.name}: it has no scans to search")
    try:
        return within_limits(path.name, _read_and_searched, path, dataset, search)
    except CalibError as error:
        return None, failed_search(path.stem, str(error), unreadable=True)


def _read_and_searched(path: Path, dataset: Dataset, search: bool) -> tuple[Scan, CornerSearch | None]:
    scan = load_scan(path)
    if not search:
        return scan, None
    declared = declared_noise(dataset.scanner)
    sigma_mm = dataset.scanner.scan_sigma_mm
    return scan, search_targets_file(path, dataset.all_targets, sigma_mm, finder_of(dataset), declared=declared)


def with_search(session: Session, pose: int) -> Session:
    """Session after searching one pose's scan for its corner."""
    search = read_scan(session.dataset, pose, search=True)[1]
    assert search is not None
    return with_result(session, pose, search)


def with_result(session: Session, pose: int, search: CornerSearch) -> Session:
    """Session with what a search of one pose's scan has found."""
    dataset = session.dataset
    searches = of_one_jig({**session.searches, dataset.poses.ids[pose]: search}, dataset.jig).searches
    if dataset.points is not None:
        return replace(session, searches=searches)
    return untested(replace(session, searches=searches, face_labels=None, calibration=None, effects=(), steps=()))


def with_face_labels(session: Session) -> Session:
    """Session with the jig's faces labelled in the corners found so far; unchanged where points.csv gives the points.

    Raises CornerError for face angles that no jig can have.
    """
    return replace(session, face_labels=find_face_labels(session)) if session.unlabelled else session


def find_face_labels(session: Session) -> FaceLabels:
    """Labels of the jig's faces in the corners found so far. Raises as `with_face_labels`."""
    return label_faces(session.dataset, session.searches)


def no_full_poses(session: Session) -> str:
    """Sentence on why full poses cannot be fitted to the session's data, with a remedy; "" where they can."""
    measured = session.measured_for("pose")
    try:
        require_orientations(measured, Observations.of(measured))
    except CalibError as error:
        return str(error)
    return ""


def measured_kinds(session: Session) -> tuple[str, ...]:
    """Residuals that the session's data allow; full poses need a scanned jig, or orientations in points.csv."""
    points = session.dataset.points
    scanned = points is None and session.dataset.shows_faces
    full = scanned or (points is not None and points.orientations is not None and bool(points.orientations.known.any()))
    return RESIDUAL_KINDS if full else tuple(kind for kind in RESIDUAL_KINDS if kind != "pose")


def with_redundancy(session: Session, residual: str = "position") -> Session:
    """Session with the redundancy analysis of the parameters at the dataset's poses."""
    return replace(session, redundancy=redundancy_of(session.counted, residual=residual))
