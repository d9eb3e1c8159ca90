"""What is on show, and every change of it. Runs on the worker's thread only.

Each method reads the session, calls one function, and redraws what depends on it. Scans are searched one by one
(`open`, `process` are long work), so that what is ready can be looked at meanwhile.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path

import viser

from calib.errors import CalibError, DatasetError, ScanError
from calib.scans.scan import Scan
from inspector.app.camera import Looking
from inspector.app.comparison_controller import Comparing
from inspector.app.model_controller import Modelling
from inspector.app.scan_cache import ScanLoading
from inspector.markup.legend import legend_html
from inspector.markup.palette import BRAND_ON_DARK, BRAND_ON_LIGHT, rgb, role_colour
from inspector.panels.base import put
from inspector.panels.compare import ComparePanel
from inspector.panels.corner import CornerPanel
from inspector.panels.fit import FitPanel
from inspector.panels.missing_effects import LearnPanel
from inspector.panels.planes import PlanesPanel
from inspector.panels.redundancy import RedundancyPanel
from inspector.panels.residuals import FailurePanel
from inspector.panels.review import ReviewPanel
from inspector.panels.scans import ScansPanel
from inspector.scene.draw_scan import (
    PLANE_LAYERS,
    draw_corners,
    draw_overview,
    draw_planes,
    draw_pose,
    fitting_arrows,
    fitting_ellipsoids,
)
from inspector.scene.scene_view import SceneView
from inspector.server.worker import LongWork
from inspector.session import transitions as sessions
from inspector.session.session import Session
from inspector.session.session_file import Shown
from inspector.session.view import FACTORS, View

WAITING = "The fit starts when all scans have been searched. Calibrate takes the corners found so far."
POINTS_LOOK = "Arm"  # where there are no scans to look at


class Stage:
    """Panels, scene and the view that they show."""

    def __init__(
        self,
        server: viser.ViserServer,
        folders: Mapping[str, Path],
        *,
        review: ReviewPanel,
        scans: ScansPanel,
        planes: PlanesPanel,
        corner: CornerPanel,
        redundancy: RedundancyPanel,
        fit: FitPanel,
        learn: LearnPanel,
        failure: FailurePanel,
        compare: ComparePanel,
        on_click: Callable[[int], None],
        on_open: Callable[[], None],
    ) -> None:
        self._server = server
        self._folders = folders
        self.review, self.scans, self.planes, self.corner = review, scans, planes, corner
        self.redundancy, self.fit, self.learn, self.failure = redundancy, fit, learn, failure
        self.model = Modelling(self, learn)
        self.on_click, self._on_open = on_click, on_open
        self.scene = SceneView(server)
        self.comparing = Comparing(self, compare)
        self._looking = Looking(self.scene, review)
        self.view: View | None = None
        self.name = ""  # of the dataset on show
        self._sessions: dict[str, Session] = {}  # those opened before, so that returning to one is immediate
        self._scans: ScanLoading | None = None  # of the dataset on show
        self._search_s = 0.0
        self.theme(dark=False)

    def theme(self, *, dark: bool) -> None:
        """The page itself, light or dark."""
        brand = rgb(BRAND_ON_DARK if dark else BRAND_ON_LIGHT)
        self._server.gui.configure_theme(
            dark_mode=dark, show_logo=False, show_share_button=False, brand_color=brand
        )

    @property
    def now(self) -> View:
        """The view, where there is one."""
        if self.view is None:
            raise DatasetError("no dataset is open; choose one in the list at the top left")
        return self.view

    # ---- datasets ---------------------------------------------------------------------------------------------------

    def open(self, name: str) -> LongWork:
        """Show a dataset and work through it."""
        self.review.show_problem("")
        try:
            session = self._sessions.get(name) or sessions.open_session(self._folders[name])
        except CalibError:
            if self.view is None:
                self.review.show_nothing()
            elif self.name:
                put(self.review.dataset, self.name)
            raise
        old = self.view
        self.name, self._search_s = name, 0.0
        self._scans = ScanLoading(session.dataset)
        view = View(Session(session.dataset)) if old is None else replace(old, pose=0, failures={})
        self.view = view.with_session(session)
        self._on_open()
        put(self.review.dataset, name)
        self.scene.clear_overview()
        self.review.set_poses(self.now)
        self._choose_factor()
        if session.calibration is not None:
            self.change_arrows(fitting_arrows(self.now))
        self.redraw()
        self.look(self._looking.name if session.dataset.scan_folder is not None else POINTS_LOOK)
        yield
        yield from self.process()

    def process(self) -> LongWork:
        """What this dataset still lacks: redundancy, all scans' overview and corners, the fit."""
        if self.now.session.redundancy is None:
            self.analyse(str(self.redundancy.residual.value))
            yield
        tried: set[int] = set()
        while (pose := self._scanning.next(self.now.pose, tried)) is not None:
            tried.add(pose)
            searched, started = pose in self.now.session.needed, time.perf_counter()
            self._work_on(pose)
            self._search_s += time.perf_counter() - started if searched else 0.0
            self._show_progress(running=True)
            yield
        self._show_progress(running=False)
        self.look(self._looking.name)
        if self.now.session.calibration is None:
            self.fit.update(self.now, waiting="Calibrating …")
            yield
            yield from self.model.start(str(self.fit.residual.value))
        else:
            yield from self.model.rank()

    def stopped(self) -> None:
        """The user has stopped the search."""
        self._show_progress(running=False)

    def keep(self, session: Session) -> None:
        """What is known of the dataset on show from now on."""
        self.view = self.now.with_session(session)
        self._sessions[self.name] = session

    # ---- scans ------------------------------------------------------------------------------------------------------

    @property
    def _scanning(self) -> ScanLoading:
        """The scans, where there is a dataset."""
        if self._scans is None:
            raise DatasetError("no dataset is open; choose one in the list at the top left")
        return self._scans

    def _work_on(self, pose: int) -> None:
        """Load one scan, search it where its corner is not measured, and draw it in the overview."""
        scan = self._load(pose)
        if pose in self.now.session.needed:
            self.keep(sessions.with_search(self.now.session, pose))
        first = not self._scanning.medians
        self._scanning.worked_on(pose, scan)
        if scan is not None and len(scan.points_mm):
            colour = role_colour(str(self.now.session.dataset.poses.role[pose]))
            draw_overview(self.scene, self.now, pose, scan, colour, self.now.session.scans)
        if first:
            self._choose_factor()
            self.look(self._looking.name)
        self.scans.update_list(self.now)
        if pose == self.now.pose:
            self.draw_pose()
        else:
            draw_corners(self.scene, self.now, self.on_click)

    def _load(self, pose: int) -> Scan | None:
        """A pose's scan; None where there is none, or none that can be read (`View.failures` says why)."""
        try:
            return self._scanning.load(pose, keep=pose == self.now.pose)
        except ScanError as error:
            pose_id = self.now.session.dataset.poses.ids[pose]
            self.view = replace(self.now, failures={**self.now.failures, pose_id: str(error)})
            return None

    def _choose_factor(self) -> None:
        """Enlarge the ellipsoids so that the first corner's is about a centimetre large."""
        factor = fitting_ellipsoids(self.now)
        put(self.review.factor, f"{factor:g}")
        self.view = replace(self.now, factor=factor)

    def _show_progress(self, *, running: bool) -> None:
        searches = self.now.session.searches
        known = [(i, searches[i]) for i in self.now.session.dataset.poses.ids if i in searches]
        measured = self.now.session.dataset.points is not None
        self.review.show_progress(
            len(searches),
            0 if measured else self.now.session.scans,
            [i for i, search in known if search.failure],
            [i for i, search in known if search.corner is not None and search.corner.quality.doubts()],
            running=running,
            seconds=self._search_s or None,
        )

    # ---- poses ------------------------------------------------------------------------------------------------------

    def select(self, pose: int) -> None:
        """Show another pose, everywhere."""
        if not 0 <= pose < len(self.now.session.dataset.poses):
            return
        self.view = replace(self.now, pose=pose)
        session = self.now.session
        if session.dataset.points is not None and pose in session.waiting:
            self.keep(sessions.with_search(session, pose))  # not needed for the fit, only to be looked at
        self.draw_pose()
        self.fit.update_residuals(self.now)
        self.failure.update(self.now)

    def draw_pose(self) -> None:
        """Everything that belongs to the selected pose."""
        scan = self._load(self.now.pose)
        view = self.now
        with self._server.atomic():
            drawn = draw_pose(self.scene, view, scan, self._looking.visible)
            self._looking.focus(view, self._scanning.medians)
            setups = view.session.dataset.poses.setup
            self.scene.hide_in_overview(view.pose, lambda i: bool(setups[i] != setups[view.pose]))
            self.comparing.draw_scan(scan, self._looking.visible)
            self.comparing.draw()
        self.review.update(view)
        self.scans.update(view, scan, drawn)
        self.planes.update(view)
        self.corner.update(view)

    def redraw(self) -> None:
        """Everything."""
        self._show_progress(running=True)
        self.draw_pose()
        self.redundancy.update(self.now)
        self.fit.update(self.now, waiting=WAITING)
        self.model.show()

    # ---- the view ---------------------------------------------------------------------------------------------------

    def change(self, **what: float | bool) -> None:
        """Change how the selected pose is drawn (`View.factor`, `View.grey_rejected`)."""
        self.view = replace(self.now, **what)  # type: ignore[arg-type]
        self.draw_pose()

    def change_arrows(self, factor: float) -> None:
        """Draw residuals so many times too long."""
        self.comparing.change(arrows=factor)

    def dark(self, dark: bool) -> None:
        """Dark or light, with new figures: they do not follow the page by themselves."""
        self.theme(dark=dark)
        self.scene.dark(dark)
        put(self.review.dark, dark)
        if self.view is not None:
            self.view = replace(self.view, dark=dark)
            self.redundancy.update(self.view)
            self.fit.update(self.view)
            self.learn.update_figure(self.view)
            self.learn.update_choice(self.view)
            self.failure.update(self.view)

    def layer(self, name: str, visible: bool) -> None:
        """Show or hide one layer."""
        self._looking.layer(name, visible)
        if name in PLANE_LAYERS and visible and self.view is not None:
            draw_planes(self.scene, self.view, self._looking.visible)
        self.comparing.draw_distance(self._looking.visible)
        self.show_legend()

    def look(self, what: str) -> None:
        """Show the layers of a view and put the camera where they are seen well."""
        self._looking.choose(what)
        if self.view is not None:
            draw_planes(self.scene, self.view, self._looking.visible)
            self.comparing.draw_distance(self._looking.visible)
            self._looking.at(self.view, self._scanning.medians)
            self.show_legend()

    def show_legend(self) -> None:
        """What the colours on show mean."""
        if self.view is not None:
            self.review.show_legend(
                legend_html(self.view, self._looking.visible, self.comparing.distances_mm)
            )

    @property
    def look_name(self) -> str:
        """The view on show."""
        return self._looking.name

    def show_saved(self, shown: Shown) -> None:
        """Draw residuals and uncertainties as long as a saved session had them."""
        if shown.arrows in FACTORS:
            self.change_arrows(shown.arrows)
        if shown.factor in FACTORS:
            put(self.review.factor, f"{shown.factor:g}")
            self.change(factor=shown.factor)

    # ---- the model --------------------------------------------------------------------------------------------------

    def analyse(self, residual: str) -> None:
        """Redundancy of the parameters for this kind of residual."""
        self.keep(sessions.with_redundancy(self.now.session, residual))
        self.redundancy.update(self.now)

    def show_correlation(self) -> None:
        """The part of the matrix that is chosen now."""
        self.redundancy.update(self.now)

    def show_model(self, session: Session) -> None:
        """Another model of the same dataset, everywhere."""
        first = self.now.session.calibration is None
        self.keep(session)
        if first:  # and then no more, so that arrows shrink as the error falls
            self.view = replace(self.now, arrows=fitting_arrows(self.now))
        self.comparing.draw()
        if first and self._looking.name == "Arm":
            self._looking.at(self.now, self._scanning.medians)
        self.fit.update(self.now)
        self.model.show()
