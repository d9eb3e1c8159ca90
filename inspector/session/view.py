"""View on a session: the selected pose, joint and version, and the drawing settings."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from calib import frames
from calib.array_types import Array
from calib.calibration.model_versions import EFFECTS, LINKS, NOMINAL, Version, fitted_version
from calib.calibration.result import Calibration
from calib.corners.search import CornerSearch
from calib.options import RESIDUAL_KINDS
from calib.targets.search import ScanSearch
from inspector.session.session import Session

RESIDUALS = RESIDUAL_KINDS
VIEW_LAYERS = {
    view: set(layers.split())
    for view, layers in {
        "All scans": "overview scan faces corner corners scale",
        "Scan": "scan faces corner scale",
        "Planes": "faces sets rejected groups corner scale",
        "Corner": "faces corner scale",
        "All corners": "corner corners before residuals predicted scanner floor scale",
        "Distance": "distance jig scale",
        "Arm": "corners before residuals predicted arm scanner plan floor scale",
    }.items()
}
VIEWS = tuple(VIEW_LAYERS)
POINT_VIEWS = ("Arm", "All corners", "Corner")  # where there are no scans
WIDE_VIEWS = ("All scans", "All corners", "Arm")  # of the whole dataset, not of one pose
FRONT, SIDE, TOP, RESET = "Front", "Side", "Top", "Reset"
SIDES = (FRONT, SIDE, TOP, RESET)  # where the 3D view is looked at from
WORST = 10  # poses whose residuals have an arrow, beside those selected
FACTORS = (1, 3, 10, 30, 100, 300, 1000, 3000, 10000)  # enlargements of the uncertainty ellipsoids


@dataclass(frozen=True)
class View:
    """What the page displays: a session, the selected pose and joint, and drawing settings."""

    session: Session
    pose: int = 0
    factor: float = 1000.0
    arrows: float = 100.0  # how many times longer residuals are drawn
    arrows_chosen: bool = False  # whether the user has chosen that; else it suits what is drawn
    failures: dict[str, str] = field(default_factory=dict)  # scans that could not be read, by pose id
    chosen: str = ""  # the version whose arm and errors are shown; the last where there is none of this name
    boxed: tuple[int, ...] = ()  # poses in the box that was drawn over the 3D view
    joint: int | None = None  # the selected one, from 0
    step: int | None = None  # of `session.steps`, before the last, that the version with effects is shown after

    @property
    def pose_id(self) -> str:
        """Id of the selected pose."""
        return self.session.dataset.poses.ids[self.pose]

    @property
    def search(self) -> CornerSearch | None:
        """Corner search of the selected pose's scan; None where it has not been searched."""
        return self.session.searches.get(self.pose_id)

    @property
    def versions(self) -> tuple[Version, ...]:
        """Versions of the session's model up to the step on show; none before it is calibrated."""
        known = self.session.versions
        if self.step is None or not known or self.step >= len(self.session.steps):
            return known
        others = (version for version in known if version.name != EFFECTS)
        return (*others, fitted_version(EFFECTS, self.session.steps[self.step].calibration))

    @property
    def version(self) -> Version | None:
        """Version of the model whose arm and errors are shown."""
        return next((v for v in self.versions if v.name == self.chosen), self.versions[-1] if self.versions else None)

    def here_T_scanner(self, pose: int) -> Array:
        """Transform (4, 4) from the scanner's frame at a pose to that at the selected pose, by the version on show.

        The identity where the scanner stands still, where there is no model yet, and for a setup without a frame.
        """
        version = self.version
        if not self.session.dataset.robot.carries_scanner or version is None:
            return np.eye(4)
        here, there = version.scanner_T_base[self.pose], version.scanner_T_base[pose]
        if not (np.isfinite(here).all() and np.isfinite(there).all()):
            return np.eye(4)
        return here @ frames.invert(there)

    @property
    def version_before(self) -> Version | None:
        """Version of the model a step before the one on show; None where the nominal robot is shown."""
        step = self.shown_step
        return self.at_step(step - 1).version if step else None

    @property
    def calibration(self) -> Calibration | None:
        """Fit of the version on show; the model's fit where the nominal robot is shown."""
        version = self.version
        return self.session.calibration if version is None else version.calibration

    @property
    def shows_last(self) -> bool:
        """Whether the latest version of the model is shown."""
        return not self.is_nominal and self.calibration is self.session.calibration

    @property
    def is_nominal(self) -> bool:
        """Whether the nominal robot is shown."""
        return self.version is not None and self.version.name == NOMINAL

    @property
    def shown_step(self) -> int | None:
        """Index of the shown model: 0 for the nominal robot, k after `session.steps[k - 1]`; None before a fit."""
        version = self.version
        if version is None or version.name == NOMINAL:
            return None if version is None else 0
        fits = [step.calibration for step in self.session.steps]
        links = (k + 1 for k, step in enumerate(self.session.steps) if not step.selected)
        known = (k + 1 for k, fit in enumerate(fits) if fit is version.calibration)
        return next(known, next(links, None) if version.name == LINKS else None)

    def version_of_step(self, number: int) -> str:
        """Name of the version of the model after a step; steps counted as in `shown_step`."""
        steps = self.session.steps
        if number == 0:
            return NOMINAL
        return EFFECTS if steps[number - 1].selected else LINKS

    def at_step(self, number: int) -> View:
        """View of the model after a step, with its arrows: 0 is the nominal robot, k `session.steps[k - 1]`.

        Nothing changes where there is no such step.
        """
        steps = self.session.steps
        if not 0 <= number <= len(steps) or not self.session.versions:
            return self
        chosen = self.version_of_step(number)
        step = number - 1 if chosen == EFFECTS and number < len(steps) else None
        return replace(self, step=step, chosen=chosen)

    def with_session(self, session: Session) -> View:
        """View of another session; a view of the latest version shows the latest version there, too."""
        newest = session.versions[-1].name if session.versions else ""
        before = self.session.versions[-1].name if self.session.versions else ""
        chosen = newest if newest not in ("", before) and self.chosen in (before, "") else self.chosen
        step = self.step if _same_fits(session, self.session) else None
        return replace(self, session=session, chosen=chosen, step=step)


def _same_fits(one: Session, other: Session) -> bool:
    """Whether two sessions have the same steps of the model."""
    pairs = zip(one.steps, other.steps, strict=False)
    return len(one.steps) == len(other.steps) and all(a.calibration is b.calibration for a, b in pairs)


def corner_of(view: View, pose: int) -> tuple[Array, Array | None] | None:
    """Measured point of a pose, (3,) mm, and its covariance (3, 3), from points.csv or from its scan.

    Where points.csv has no covariance, the scanner's declared sigma stands for it.
    """
    points = view.session.dataset.points
    if points is not None:
        in_world = view.session.dataset.robot.carries_scanner  # where each jig has a name of its own
        rows = np.flatnonzero((points.pose == pose) & (in_world | (points.target == "jig")))
        if not len(rows):
            return None
        sigma_mm = view.session.dataset.scanner.point_sigma_mm
        covariance = None if sigma_mm is None else sigma_mm**2 * np.eye(3)
        if points.covariance_mm2 is not None:
            covariance = points.covariance_mm2[rows[0]]
        return points.xyz_mm[rows].mean(axis=0), covariance
    search = view.session.searches.get(view.session.dataset.poses.ids[pose])
    if isinstance(search, ScanSearch) and search.places:
        return search.places[0].xyz_mm, search.places[0].covariance_mm2
    if search is None or search.corner is None:
        return None
    return search.corner.xyz_mm, search.corner.covariance_mm2
