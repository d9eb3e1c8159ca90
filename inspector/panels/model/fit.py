"""Tab Fit: convergence, errors before and after, and the parameters."""

from __future__ import annotations

from collections.abc import Mapping

import viser

from calib.calibration.result import Calibration
from calib.corners.search import CornerSearch
from calib.models.exported_table import exported_table
from calib.present.fit.calibration import calibration_warnings, fit_facts, parameter_tables
from calib.present.fit.corners import face_labelling
from calib.present.fit.errors import error_tables, table_alone
from calib.rendering.blocks import Block, Facts, Verdict
from calib.rendering.colours import DOUBT
from calib.rendering.html import panel
from inspector.figures.plots import convergence, outline, pose_residuals
from inspector.markup.parts import elements
from inspector.markup.parts.palette import ROLE_COLOURS
from inspector.panels.base import Actions, FollowsModel, hidden_plot, offer, on_page, put
from inspector.panels.input_checks import one_of
from inspector.session.measuring import measured_kinds, no_full_poses
from inspector.session.session import Session
from inspector.session.view import RESIDUALS, View

NOTE = (
    "Training poses are fitted, test poses only predicted. A test error that stays far above the training error means "
    "too many parameters or physics that is not in the model. Look for single poses that stand out."
)
NO_POSES = "pose cannot be fitted: "


class FitPanel(FollowsModel):
    """Figures and tables of the calibration."""

    def __init__(self, gui: viser.GuiApi, actions: Actions) -> None:
        gui.add_html(elements.note(NOTE))
        self.residual = gui.add_dropdown(
            "Fit",
            RESIDUALS,
            hint="position: points, the instrument's frame free; distance: from the reference pose (Jang); pairs: all "
            "distances; pose: points and how the jig stands there",
        )
        self.calibrate = gui.add_button("Calibrate", icon=viser.Icon.TARGET_ARROW)
        self._faces = gui.add_html("")
        self._state = gui.add_html("")
        self._convergence = hidden_plot(gui, 0.62, "error by iteration")
        self._figures = gui.add_html("")
        self._residuals = hidden_plot(gui, 0.62, "error by pose")
        self._parameters = gui.add_html("")
        self._unlabelled: tuple[Mapping[str, CornerSearch], str] | None = None  # faces not labelled: of what, why
        self._drawn: tuple[Calibration, bool] | None = None  # what the bars on show are of
        self._fitted: Calibration | None = None  # what the figures are of
        self._busy = False  # whether a fit runs
        self._fresh = ""  # the residual by which another fit would change nothing
        on_page(self.residual, lambda _: self._enable())
        self.calibrate.on_click(lambda _: actions.calibrate(one_of(self.residual.value, RESIDUALS, RESIDUALS[0])))

    def busy(self, busy: bool) -> None:
        """Disable the button while the fit runs."""
        self._busy = busy
        self._enable()
        self.calibrate.label = "Calibrating …" if busy else "Calibrate"

    def open(self, dataset: str, view: View) -> None:
        """Forget the choice made for the previous dataset."""
        result = view.session.calibration
        self._unlabelled = None
        offer(self.residual, measured_kinds(view.session))
        put(self.residual, view.session.dataset.usual_residual if result is None else result.residual)

    def offer(self, view: View) -> None:
        """Update the residuals that the data allow, and enable the button where a press would change something."""
        session, kinds = view.session, measured_kinds(view.session)
        if self._unlabelled is not None or not (session.unlabelled or not no_full_poses(session)):
            kinds = tuple(kind for kind in kinds if kind != "pose")
        offer(self.residual, kinds)
        result = session.calibration
        # With effects in the model the noise's shape stays as it was found; without, the fit begins anew.
        fresh = result is not None and (bool(session.effects) or result.options.noise is None)
        self._fresh = result.residual if fresh and result is not None else ""
        self._enable()

    def _enable(self) -> None:
        """Enable the button where a press would change something."""
        self.calibrate.disabled = self._busy or str(self.residual.value) == self._fresh

    def update(self, view: View, *, waiting: str = "") -> None:
        """Show the session's calibration; `waiting` is the reason where there is none yet."""
        result = view.session.calibration
        self._convergence.visible = self._residuals.visible = result is not None
        if result is None:
            self.update_faces(view)
            self._state.content = elements.note(waiting or "Not calibrated yet.")
            self._figures.content = self._parameters.content = ""
            return
        if result is not self._fitted and result.residual in RESIDUALS:  # a choice not yet pressed for stays
            put(self.residual, result.residual)
        self._fitted = result
        self.update_faces(view)
        result = view.calibration or result  # of the version on show
        self._state.content = fit_html(result)
        distances = result.residual == "distance"
        train = [s.train_distance_rmse_mm if distances else s.train_rmse_mm for s in result.iteration_errors]
        test = [s.test_distance_rmse_mm if distances else s.test_rmse_mm for s in result.iteration_errors]
        self._convergence.figure = convergence(train, test, what=what_is_fitted(result))
        self._figures.content = errors_html(view.session, result)
        self._parameters.content = panel(parameter_tables(result, height="420px"))
        self.update_residuals(view)

    def update_faces(self, view: View, problem: str = "") -> None:
        """Show whether full poses can be fitted and how faces were labelled; `problem`: why labelling failed."""
        searches = view.session.searches
        if problem or self._unlabelled is None or self._unlabelled[0] is not searches:
            self._unlabelled = (searches, problem) if problem else None
        words = NO_POSES + self._unlabelled[1] if self._unlabelled else faces_words(view.session)
        self._faces.content = elements.note(words)
        self.offer(view)

    def update_residuals(self, view: View) -> None:
        """Draw the error of each pose after the fit, the selected one outlined."""
        result, before = view.calibration, view.is_nominal
        if result is None:
            return
        if self._drawn and result is self._drawn[0] and before == self._drawn[1]:
            self._residuals.figure = outline(self._residuals.figure, view.pose_id)  # only another pose
            return
        self._drawn = (result, before)
        errors = (result.before if before else result.after).to_frame(result.dataset)
        column = "distance_error_mm" if result.residual == "distance" else "error_mm"
        errors = errors.dropna(subset=[column])
        self._residuals.figure = pose_residuals(
            errors["pose"].tolist(),
            errors["role"].tolist(),
            errors[column].abs().to_numpy(),
            selected=view.pose_id,
            what=f"{what_is_fitted(result)} error {'before' if before else 'after'}",
        )


def faces_words(session: Session) -> str:
    """Sentence on the orientations available for a fit of full poses, or on what such a fit lacks."""
    if session.unlabelled:
        return "pose needs the jig's faces named in the scans, which is done once their corners are found."
    if "pose" not in measured_kinds(session):
        if session.dataset.points is None:
            return "Full poses are not offered: what is scanned is no jig with three faces."
        return "Full poses are not offered: points.csv has no orientations (qw, qx, qy, qz)."
    problem = no_full_poses(session)
    if problem:
        return NO_POSES + problem.removeprefix(f"dataset {session.dataset.name}: ")
    if session.face_labels is not None:
        return f"pose can be fitted: {face_labelling(session.face_labels.labelling)}."
    return "pose can be fitted: points.csv has orientations."


def what_is_fitted(result: Calibration) -> str:
    """Name of the error that the figures show."""
    return "distance" if result.residual == "distance" else "3D"


def fit_html(result: Calibration) -> str:
    """HTML on the kind of fit, on how it ended, and on its warnings."""
    alerts = [Verdict(words, DOUBT) for words in calibration_warnings(result)]
    return panel([Facts(fit_facts(result)), *alerts])


def errors_html(session: Session, result: Calibration) -> str:
    """HTML of the errors before and after calibration, and of the errors with robot.toml's table alone."""
    alone: list[Block] = []
    if session.calibration is not None and session.links_alone is not None:
        alone = table_alone(exported_table(session.calibration, session.links_alone))
    return panel([*error_tables(result, ROLE_COLOURS), *alone])
