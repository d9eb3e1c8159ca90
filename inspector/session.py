"""A session: one dataset and what was made of it. Values are frozen, functions take a session and give a new one."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

from calib.calibration import Calibration, calibrate, redundancy
from calib.corners import CornerSearch, search_file
from calib.dataset import Dataset
from calib.dataset_file import load_dataset
from calib.errors import DatasetError
from calib.measurement import with_corners
from calib.redundancy import Redundancy


@dataclass(frozen=True)
class Session:
    """What is known so far. A new corner makes an old calibration stale, so it is dropped with it."""

    dataset: Dataset
    searches: Mapping[str, CornerSearch] = field(default_factory=dict)  # by pose id
    redundancy: Redundancy | None = None
    calibration: Calibration | None = None

    @property
    def measured(self) -> Dataset:
        """The dataset with its points: those of points.csv, else the corners found so far."""
        return self.dataset if self.dataset.points is not None else with_corners(self.dataset, self.searches)

    @property
    def waiting(self) -> tuple[int, ...]:
        """Poses whose scan was not searched yet."""
        if self.dataset.scan_folder is None:
            return ()
        return tuple(i for i, pose_id in enumerate(self.dataset.poses.ids) if pose_id not in self.searches)


def open_session(folder: Path) -> Session:
    """A session on a dataset folder. Raises DatasetError."""
    return Session(load_dataset(folder))


def with_search(session: Session, pose: int) -> Session:
    """Search the scan of one pose for its corner."""
    path = session.dataset.scan_path(pose)
    if path is None:
        raise DatasetError(f"dataset {session.dataset.name}: it has no scans to search")
    search = search_file(path, session.dataset.jig, session.dataset.scanner.scan_sigma_mm)
    searches = {**session.searches, session.dataset.poses.ids[pose]: search}
    calibration = session.calibration if session.dataset.points is not None else None
    return replace(session, searches=searches, calibration=calibration)


def with_redundancy(session: Session, residual: str = "position") -> Session:
    """Find which parameters say the same at the dataset's poses."""
    return replace(session, redundancy=redundancy(session.dataset, residual=residual))


def with_calibration(session: Session, residual: str = "position") -> Session:
    """Fit the five-parameter model to what is measured so far."""
    return replace(session, calibration=calibrate(session.measured, residual=residual))
