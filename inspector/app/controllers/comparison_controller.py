"""Drawing of the model's versions: arm, predictions, and the tab Compare. Runs on the worker's thread only."""

from __future__ import annotations

from collections.abc import Callable

from calib.array_types import Array
from calib.calibration.model_versions import VERSIONS
from calib.scans.scan import Scan
from inspector.app.page.page_state import PageState
from inspector.panels.model.compare import ComparePanel
from inspector.scene.draw_model import ArmDrawing, draw_distance, draw_jig, jig_distances
from inspector.scene.draw_scan import draw_corners, place_overview
from inspector.scene.residual_arrows import ResidualArrows, fitting_arrows
from inspector.scene.scene_view import SceneView
from inspector.session.view import ALL_POSES, COLOURINGS


class ComparisonController:
    """Controller that draws the arm, the predicted points and the tab Compare for the view on show."""

    def __init__(
        self,
        state: PageState,
        scene: SceneView,
        panel: ComparePanel,
        *,
        on_click: Callable[[int], None],
        on_joint: Callable[[int], None],
        show_legend: Callable[[], None],
    ) -> None:
        self._state, self._scene, self._panel = state, scene, panel
        self._on_click, self._show_legend = on_click, show_legend
        self._arm = ArmDrawing(scene, on_joint)
        self.residuals = ResidualArrows(scene, on_click)
        self._scan: Scan | None = None  # the selected pose's
        self._distances_mm: Array | None = None  # of its points to the jig
        self._drawn = False  # whether they are in the scene

    def draw(self) -> None:
        """Draw what each chosen version predicts, and the errors at the selected pose."""
        view = self._state.now
        factor = view.arrows if view.arrows_chosen else fitting_arrows(view)
        if factor != view.arrows:
            self._state.change(arrows=factor)
            view = self._state.now
        with self._scene.atomic():
            draw_corners(self._scene, view, self._on_click)
            place_overview(self._scene, view)
            self.residuals.draw(view)
            self._arm.draw(view)
        self._panel.update(view, self._arm.problems)
        self._show_legend()

    def draw_scan(self, scan: Scan | None, visible: set[str]) -> None:
        """Draw the jig's model over the selected pose's scan."""
        view = self._state.now
        self._scan, self._distances_mm, self._drawn = scan, jig_distances(view, scan), False
        draw_jig(self._scene, view)
        self.draw_distance(visible)
        self._panel.update_distance(view, self._distances_mm)

    def draw_distance(self, visible: set[str]) -> None:
        """Colour the scan's points by their distance to the jig; sent only once the layer is visible."""
        if "distance" in visible and not self._drawn:
            draw_distance(self._scene, self._scan, self._distances_mm)
            self._drawn = True
        elif not self._drawn:
            draw_distance(self._scene, None, None)

    @property
    def distances_mm(self) -> Array | None:
        """Distances (N,), mm, of the selected scan's points to the jig, NaN off the jig; None without a corner."""
        return self._distances_mm

    def change(self, **what: float | str | frozenset[str] | None) -> None:
        """Change how the model is drawn: `View.arrows`, `arrows_chosen`, `chosen`, `compared`, `pairs`, `colouring`."""
        self._state.change(**what)
        self.draw()

    def choose(self, name: str) -> None:
        """Show the arm, errors and arrows of a version by its name, if there is one.

        Of the arrows only those to others that the user has ticked stay.
        """
        view = self._state.now
        if view.version is not None and name in [version.name for version in view.versions]:
            self.change(chosen=name, compared=view.compared - {view.version.name} | {name}, step=None)

    def show(self, name: str, shown: bool) -> None:
        """Show or hide the points that a version predicts."""
        if name in VERSIONS:
            compared = self._state.now.compared
            self.change(compared=compared | {name} if shown else compared - {name})

    def show_pairs(self, name: str) -> None:
        """Show all poses' arrows, or of paired poses those before or after the change, or what it moved."""
        if name == ALL_POSES or name in self._state.now.pair_choices:
            self.change(pairs=name)

    def colour_by(self, by: str) -> None:
        """Colour the measured points by their pose's role or by their error."""
        if by in COLOURINGS:
            self.change(colouring=by)
