"""Tab Where it fails: the residual against any input, and the worst poses."""

from __future__ import annotations

import viser

from calib.calibration.evaluation import Evaluation
from calib.calibration.pose_errors import PoseErrors, pose_errors_at, running_median
from calib.present.fit.residuals import AXES, LENGTH, band_note, joint_title, shown, turned, worst_poses
from calib.present.names import input_title
from calib.rendering import html
from calib.rendering.blocks import Section
from calib.screening.scan_statistic import Channel
from inspector.figures.residual_plots import residual_against, select
from inspector.markup.parts import elements
from inspector.panels.base import Actions, FollowsModel, hidden_plot, offer, on_page, put
from inspector.panels.learn.measurements import OutlyingPoses
from inspector.session.view import View

NOTE = (
    "The residual of each pose, against anything it may depend on. Noise shows no pattern: points that follow a line "
    "or a wave, or that leave the grey band together, show what is missing. Test poses were not fitted. "
    "The plot opens on the input with the clearest pattern."
)
RINGED = "Ringed: the selected pose."
NONE = "–"
NOT_YET = "Nothing to show yet: the model is fitted when the search has ended. The tab Fit says what it lacks."
WORST = 8


class ResidualsPanel(FollowsModel):
    """Plot of the residual against one input, and the poses with the largest errors."""

    def __init__(self, gui: viser.GuiApi, actions: Actions) -> None:
        self._actions = actions
        gui.add_html(elements.note(NOTE))
        self.against = gui.add_dropdown("Against", (NONE,), hint="joint angles, torques, conditions, place, order")
        self.what = gui.add_dropdown("Show", (NONE,), hint="apparent motion: what joint k alone would have to do")
        self._plot = hidden_plot(gui, 0.75, "where it fails")
        self._state = gui.add_html(elements.note(NOT_YET))
        self.outliers = OutlyingPoses(gui, actions)
        self._table = gui.add_html("")
        self._drawn: tuple[object, ...] = ()  # what the figure on show is of
        self._dataset: object = None
        self._of: tuple[Evaluation, PoseErrors] | None = None  # of an earlier version on show
        self._chose = False  # whether a user has chosen what to see of this dataset
        on_page(self.against, lambda _: self._choose())
        on_page(self.what, lambda _: self._choose())

    def _choose(self) -> None:
        self._chose = True
        self._actions.failure()

    def choose_joint(self, view: View) -> None:
        """Plot the selected joint's apparent motion against its own angle, where there is a residual."""
        joint, robot = view.joint, view.session.dataset.robot
        titles = (
            (self.against, input_title(f"q{(joint or 0) + 1}", robot)),
            (self.what, joint_title(joint or 0, robot)),
        )
        if joint is None or view.session.pose_errors is None:
            return
        for handle, title in titles:
            if title in handle.options:
                put(handle, title)
        self._chose = True
        self.update(view)

    def update(self, view: View) -> None:
        """Show the session's residual."""
        pose_errors = self._pose_errors(view)
        self.outliers.update(view.session)
        if pose_errors is None:
            self._plot.visible = False
            self._table.content = ""
            if view.session.calibration is None:  # what could be chosen was another dataset's
                self._state.content = elements.note(NOT_YET)
                for handle in (self.against, self.what):
                    offer(handle, (NONE,))
            else:
                self._state.content = elements.note("Being worked out, or too few poses to judge by.")
            return
        robot = view.session.dataset.robot
        if view.session.dataset is not self._dataset:  # what was chosen was for another one
            self._dataset, self._chose = view.session.dataset, False
            for handle in (self.against, self.what):
                offer(handle, (NONE,))
        inputs = {input_title(name, robot): name for name in pose_errors.inputs}
        joints = {joint_title(j, robot): j for j in range(robot.n_joints)}
        offer(self.against, tuple(inputs))
        offer(self.what, (LENGTH, *AXES, *joints))
        self._suggest(view, inputs, joints)
        title, what = str(self.against.value), str(self.what.value)
        drawing = (pose_errors, title, what)
        if self._drawn and pose_errors is self._drawn[0] and drawing[1:] == self._drawn[1:]:
            self._plot.figure = select(self._plot.figure, view.pose_id)  # only another pose
        else:
            values, y_title, band = shown(pose_errors, what, joints.get(what), robot)
            x = turned(inputs[title], pose_errors.inputs[inputs[title]], robot)
            train = ~pose_errors.is_test
            self._plot.figure = residual_against(
                x, values, pose_errors.pose_ids, pose_errors.is_test, x_title=title, y_title=y_title, band=band,
                smooth=running_median(x[train], values[train]), selected=view.pose_id,
            )  # fmt: skip
            whose = "" if view.shows_last or view.version is None else f"Of {view.version.name}. "
            self._state.content = elements.note(f"{whose}{band_note(pose_errors, band)} {RINGED}")
            self._drawn = drawing
        self._plot.visible = True
        table = worst_poses(pose_errors, WORST, view.pose_id)
        self._table.content = html.panel([Section("Worst poses, mm in the instrument's frame", [table])])

    def _pose_errors(self, view: View) -> PoseErrors | None:
        """Errors of the version on show; None until the model's errors are known."""
        version = view.version
        if version is None or view.shows_last or view.session.pose_errors is None:
            return view.session.pose_errors
        if self._of is None or self._of[0] is not version.evaluation:
            self._of = (
                version.evaluation,
                pose_errors_at(version.calibration, version.model, version.x, version.evaluation),
            )
        return self._of[1]

    def _suggest(self, view: View, inputs: dict[str, str], joints: dict[str, int]) -> None:
        """Choose the input with the clearest pattern, unless the user has chosen one."""
        residual_tests = view.session.residual_tests
        if self._chose or residual_tests is None or not residual_tests.structured:
            return
        first = residual_tests.inputs[0]
        put(self.against, next((t for t, name in inputs.items() if name == first.input), self.against.value))
        shown_by = {Channel(joint=j): title for title, j in joints.items()}
        shown_by |= {Channel(axis="xyz"[k]): title for title, k in AXES.items()}
        put(self.what, shown_by.get(first.channel, self.what.value))
