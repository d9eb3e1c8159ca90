"""Drawing of the 3D scene and of the panels that show a pose. Runs on the worker's thread only."""

from __future__ import annotations

from collections.abc import Callable, Collection

import viser

from calib.corners.search import CornerSearch
from calib.errors import ScanError
from calib.present.names import instrument
from calib.scans.scan import Scan
from inspector.app.controllers.comparison_controller import ComparisonController
from inspector.app.page.page_state import PageState
from inspector.app.page.tabs import Panels
from inspector.markup.legend import legend_html
from inspector.markup.parts.palette import BRAND, rgb
from inspector.panels.base import put
from inspector.scene.camera import Camera
from inspector.scene.draw_scan import (
    PLANE_LAYERS,
    draw_overview,
    draw_planes,
    draw_pose,
    field_of_scanner,
    fitting_ellipsoids,
)
from inspector.scene.scene_view import SceneView
from inspector.session.scan_cache import ScanCache
from inspector.session.session_file import Shown
from inspector.session.view import FACTORS, POINT_VIEWS, VIEWS

ALL_SCANS, ARM = "All scans", "Arm"


class SceneController:
    """Controller that draws the 3D view, moves the camera, and fills the panels of the selected pose."""

    def __init__(
        self,
        server: viser.ViserServer,
        state: PageState,
        scans: ScanCache,
        panels: Panels,
        *,
        on_click: Callable[[int], None],
        on_joint: Callable[[int], None],
    ) -> None:
        self._server, self._state, self._scans, self._panels = server, state, scans, panels
        self.on_click = on_click
        self.scene = SceneView(server)
        self.comparison = ComparisonController(
            state, self.scene, panels.compare,
            on_click=on_click, on_joint=on_joint, show_legend=self.show_legend,
        )  # fmt: skip
        self._camera = Camera(self.scene, panels.review.show_layers)
        # Whether a page is light or dark is its own matter: server/client/theme.js.
        server.gui.configure_theme(show_logo=False, show_share_button=False, brand_color=rgb(BRAND))

    # ---- what is drawn ----------------------------------------------------------------------------------------------

    def load(self, pose: int) -> Scan | None:
        """Scan of a pose; None where the pose has none or the scan cannot be read (`View.failures` has the reason)."""
        view = self._state.now
        pose_id = view.session.dataset.poses.ids[pose]
        try:
            scan = self._scans.load(pose, keep=pose == view.pose)
            _require_as_searched(scan, view.session.searches.get(pose_id))
            return scan
        except ScanError as error:
            self._state.change(failures={**view.failures, pose_id: str(error)})
            return None

    def draw_pose(self) -> None:
        """Draw everything that belongs to the selected pose."""
        scan = self.load(self._state.now.pose)
        view = self._state.now
        with self._server.atomic():
            drawn = draw_pose(self.scene, view, scan, self._camera.visible)
            self._camera.turn_to(view, self._scans.medians)
            setups = view.session.dataset.poses.setup
            self.scene.hide_in_overview(view.pose, lambda i: bool(setups[i] != setups[view.pose]))
            self.comparison.draw_scan(scan, self._camera.visible)
            self.comparison.draw()
        self._panels.review.update(view)
        self._panels.scans.update_scan(view, scan, drawn)
        self._panels.planes.update(view)
        self._panels.corner.update(view)

    def show_corner(self) -> None:
        """Refresh the tab Corner for the selected pose."""
        self._panels.corner.update(self._state.now)

    def draw_model(self, first: bool) -> None:
        """Draw what the model predicts, in 3D and in the tab Compare; `first` where the dataset had no model before."""
        self.comparison.draw()
        if first:
            view = self._state.now
            self.scene.draw_instrument(instrument(view.session.dataset), field_of_scanner(view))
        if first and self._camera.name == ARM and not self._camera.kept:
            self._camera.at(self._state.now, self._scans.medians)
        if first and not (self._camera.settled or self._camera.kept):
            self.show_view(ARM)
        self._camera.measure(self._state.now, self._scans.medians)

    def draw_left_out(self, changed: Collection[str]) -> None:
        """Redraw the marks of left-out poses in lists, legend and the overview of scans, where these changed."""
        view = self._state.now
        self._panels.review.list_poses(view)
        self._panels.review.update(view)
        self._panels.scans.update_list(view)
        for pose_id in changed:
            pose = view.session.dataset.poses.index(pose_id)
            scan = self.load(pose) if pose in self._scans.medians else None
            if scan is not None and len(scan.points_mm):
                draw_overview(self.scene, view, pose, scan)
        self.show_legend()

    def choose_factor(self) -> None:
        """Choose an enlargement that draws the first corner's ellipsoid about a centimetre large."""
        factor = fitting_ellipsoids(self._state.now)
        put(self._panels.review.factor, f"{factor:g}")
        self._state.change(factor=factor)

    def show_legend(self) -> None:
        """Show the meaning of the colours in the 3D view."""
        view = self._state.view
        if view is not None:
            self._panels.review.show_legend(legend_html(view, self._camera.visible, self.comparison.distances_mm))

    # ---- how it is drawn --------------------------------------------------------------------------------------------

    def change(self, **what: float | bool) -> None:
        """Change how the selected pose is drawn (`View.factor`, `View.grey_rejected`)."""
        self._state.change(**what)
        self.draw_pose()

    def draw_as(self, shown: Shown) -> None:
        """Restore the enlargement of residuals and uncertainties from a saved session."""
        if shown.arrows in FACTORS:
            self.change_arrows(shown.arrows)
        if shown.factor in FACTORS:
            put(self._panels.review.factor, f"{shown.factor:g}")
            self.change(factor=shown.factor)

    def change_arrows(self, factor: float | None) -> None:
        """Draw residuals enlarged by a factor; None chooses it by their size."""
        if factor is None:
            self.comparison.change(arrows_chosen=False)
        else:
            self.comparison.change(arrows=factor, arrows_chosen=True)

    def layer(self, name: str, visible: bool) -> None:
        """Show or hide one layer."""
        self._camera.layer(name, visible)
        if name in PLANE_LAYERS and visible and self._state.view is not None:
            draw_planes(self.scene, self._state.view, self._camera.visible)
        self.comparison.draw_distance(self._camera.visible)
        self.show_legend()

    def show_view(self, name: str) -> None:
        """Show the layers of a view and move the camera to a position suited to them."""
        self._camera.choose(name)
        view = self._state.view
        if view is not None:
            draw_planes(self.scene, view, self._camera.visible)
            self.comparison.draw_distance(self._camera.visible)
            self._camera.at(view, self._scans.medians)
            self.show_legend()

    def open_view(self) -> None:
        """Show the first view of a dataset that was just opened: the arm, or the scans until there is a model."""
        self._camera.settled = False
        view = self._state.now
        if not self._camera.kept or view.session.dataset.scan_folder is None:
            scans_first = view.session.dataset.scan_folder is not None and view.version is None
            self.show_view(ALL_SCANS if scans_first else ARM)

    def aim_again(self) -> None:
        """Move the camera again after more of the dataset has become known."""
        if not self._camera.kept:
            self.show_view(self._camera.name)

    def choose_view(self, name: str) -> None:
        """Show the view that the user has chosen."""
        self._camera.settled = True
        self.show_view(name)

    def follow(self, name: str) -> None:
        """Show the view of an opened tab, where it has something to show."""
        view = self._state.view
        if view is None or self._camera.kept or name == self._camera.name:
            return
        has_scans = view.session.dataset.scan_folder is not None
        if name not in (VIEWS if has_scans else POINT_VIEWS) or (name == ARM and view.version is None):
            return
        self._camera.settled = name != ARM
        self.show_view(name)

    def keep_view(self, keep: bool) -> None:
        """Choose whether the view stays as it is when another tab is opened."""
        self._camera.kept = keep
        put(self._panels.review.keep, keep)

    def look_from(self, side: str) -> None:
        """Move the camera to one of SIDES."""
        view = self._state.view
        if view is not None:
            self._camera.at(view, self._scans.medians, side)

    @property
    def view_name(self) -> str:
        """Name of the view on show."""
        return self._camera.name


def _require_as_searched(scan: Scan | None, search: CornerSearch | None) -> None:
    """Raise ScanError where a scan's file has changed since its search, whose point indices are then wrong."""
    if scan is None or search is None or search.count is None or search.count.points == len(scan.points_mm):
        return
    raise ScanError(
        f"{scan.name}: the file has changed since it was searched, from {search.count.points} to "
        f"{len(scan.points_mm)} points; open the dataset again in a new start of the program"
    )
