"""Drawing of the 3D scene and of the panels that show a pose, and what is selected. On the worker's thread only."""

from __future__ import annotations

from collections.abc import Callable, Collection

import numpy as np
import viser

from calib.array_types import Array, BoolArray
from calib.corners.search import CornerSearch
from calib.errors import CalibError, ScanError
from calib.present.names import instrument
from calib.scans.scan import Scan
from inspector.app.page.page_state import PageState
from inspector.app.page.tabs import Panels
from inspector.markup.legend import legend_html
from inspector.markup.parts.palette import BRAND, rgb
from inspector.panels.base import put
from inspector.scene.camera import Camera
from inspector.scene.draw_model import ArmDrawing, draw_distance, draw_jig, jig_distances
from inspector.scene.draw_scan import (
    PLANE_LAYERS,
    draw_corners,
    draw_overview,
    draw_planes,
    draw_pose,
    field_of_scanner,
    fitting_ellipsoids,
    place_overview,
)
from inspector.scene.residual_arrows import ResidualArrows, fitting_arrows
from inspector.scene.scene_view import SceneView
from inspector.session.scan_cache import ScanCache
from inspector.session.session_file import Shown
from inspector.session.view import FACTORS, POINT_VIEWS, VIEWS, corner_of

ALL_SCANS, ARM = "All scans", "Arm"
MODEL_VIEWS = (ARM, "All corners")  # where the model's errors are seen


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
        self._arm = ArmDrawing(self.scene, on_joint)
        self.residuals = ResidualArrows(self.scene, on_click)
        self._scan: Scan | None = None  # the selected pose's
        self.distances_mm: Array | None = None  # (N,) of its points to the jig, NaN off it; None without a corner
        self._drawn = False  # whether they are in the scene
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
        except CalibError as error:
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
            self._draw_scan(scan)
            self.draw_versions()
        self._panels.review.update(view)
        self._panels.scans.update_scan(view, scan, drawn)
        self._panels.planes.update(view)
        self._panels.corner.update(view)

    def show_corner(self) -> None:
        """Refresh the tab Corner for the selected pose."""
        self._panels.corner.update(self._state.now)

    def draw_model(self, first: bool) -> None:
        """Draw what the model predicts, in 3D and in the tab Compare; `first` where the dataset had no model before."""
        self.draw_versions()
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
            visible, arrows = self._camera.visible, self.residuals.words
            self._panels.review.show_legend(legend_html(view, visible, self.distances_mm, arrows))

    def between(self, share: float) -> None:
        """Draw residuals between those of the version before (share 0) and those on show (share 1)."""
        self.residuals.between(share)
        self.show_legend()

    # ---- how it is drawn --------------------------------------------------------------------------------------------

    def change(self, **what: float | bool) -> None:
        """Change how the selected pose is drawn (`View.factor`)."""
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
            self._change_versions(arrows_chosen=False)
        else:
            self._change_versions(arrows=factor, arrows_chosen=True)

    def layer(self, name: str, visible: bool) -> None:
        """Show or hide one layer."""
        self._camera.layer(name, visible)
        if name in PLANE_LAYERS and visible and self._state.view is not None:
            draw_planes(self.scene, self._state.view, self._camera.visible)
        self._draw_distance()
        self.show_legend()

    def show_view(self, name: str) -> None:
        """Show the layers of a view and move the camera to a position suited to them."""
        self._camera.choose(name)
        view = self._state.view
        if view is not None:
            draw_planes(self.scene, view, self._camera.visible)
            self._draw_distance()
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

    # ---- versions of the model --------------------------------------------------------------------------------------

    def draw_versions(self) -> None:
        """Draw what each chosen version predicts, and the errors at the selected pose."""
        view = self._state.now
        factor = view.arrows if view.arrows_chosen else fitting_arrows(view)
        if factor != view.arrows:
            self._state.change(arrows=factor)
            view = self._state.now
        with self.scene.atomic():
            draw_corners(self.scene, view, self.on_click)
            place_overview(self.scene, view)
            self.residuals.draw(view)
            self._arm.draw(view)
        self._panels.compare.update(view, self._arm.problems)
        self.show_legend()

    def _draw_scan(self, scan: Scan | None) -> None:
        """Draw the jig's model over the selected pose's scan."""
        view = self._state.now
        self._scan, self.distances_mm, self._drawn = scan, jig_distances(view, scan), False
        draw_jig(self.scene, view)
        self._draw_distance()
        self._panels.compare.update_distance(view, self.distances_mm)

    def _draw_distance(self) -> None:
        """Colour the scan's points by their distance to the jig; sent only once the layer is visible."""
        if "distance" in self._camera.visible and not self._drawn:
            draw_distance(self.scene, self._scan, self.distances_mm)
            self._drawn = True
        elif not self._drawn:
            draw_distance(self.scene, None, None)

    def _change_versions(self, **what: float | str | None) -> None:
        """Change how the model is drawn: `View.arrows`, `arrows_chosen`, `chosen`."""
        self._state.change(**what)
        self.draw_versions()

    def version(self, name: str) -> None:
        """Show the arm, errors and arrows of a version by its name, if there is one."""
        view = self._state.now
        if view.version is not None and name in [version.name for version in view.versions]:
            self._change_versions(chosen=name, step=None)
            self._panels.show_model(self._state.now)

    # ---- what is selected -------------------------------------------------------------------------------------------

    def joint(self, number: int | None) -> None:
        """Select a joint, counted from 1; the selected one again, or None, deselects."""
        view = self._state.now
        joint = None if number is None or number - 1 == view.joint else number - 1
        if joint == view.joint or (joint is not None and not 0 <= joint < view.session.dataset.robot.n_joints):
            return
        self._state.change(joint=joint)
        view = self._state.now
        self.draw_versions()
        self._panels.review.update(view)
        self._panels.residuals.choose_joint(view)

    def box(self, is_in_box: Callable[[Array], BoolArray] | None) -> None:
        """Select the poses whose measured points lie in a box on the screen; None clears the box."""
        view = self._state.now
        poses = view.session.dataset.poses
        boxed: tuple[int, ...] = ()
        if is_in_box is not None:
            here = [i for i in range(len(poses)) if poses.setup[i] == poses.setup[view.pose]]
            found = [(i, point[0]) for i in here if (point := corner_of(view, i)) is not None]
            inside = is_in_box(np.array([place for _, place in found]).reshape(-1, 3))
            boxed = tuple(i for (i, _), is_in in zip(found, inside, strict=True) if is_in)
        if boxed != view.boxed:
            self._state.change(boxed=boxed)
            self.draw_versions()
        self._panels.review.show_box(self._state.now)

    def step(self, number: int) -> None:
        """Show the arm and errors of the nominal robot (0), or of the model after a step, counted from 1.

        In 3D, too, where something else is looked at.
        """
        view = self._state.now.at_step(number)
        self._state.change(chosen=view.chosen, step=view.step)
        self.draw_versions()
        self._panels.show_model(self._state.now)
        if self._camera.name not in MODEL_VIEWS:
            self.follow(ARM)

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
