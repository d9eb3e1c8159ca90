"""Tab What is missing: ranking, addition and removal of effects, and the history of the error."""

from __future__ import annotations

import viser

from calib.present.fit.learned import BAND_NOTE, curve_blocks
from calib.rendering.blocks import Paragraph
from calib.rendering.html import panel
from calib.screening.curves.fitted_curves import fitted_curves, learned_members
from calib.screening.curves.smooth_joint_error import LEARNED
from inspector.figures.curve_plots import height_px, joint_curves
from inspector.figures.residual_plots import added_variable
from inspector.figures.results.of_results import history_of_model
from inspector.markup.learn import effects as html
from inspector.markup.parts import elements
from inspector.markup.parts.palette import BAD
from inspector.panels.base import SECONDARY, Actions, ChosenByDataset, by_page, hidden_plot, put
from inspector.panels.input_checks import clamped
from inspector.panels.learn.measurements import MovedInstrument, OutlyingPoses
from inspector.session.session import Session
from inspector.session.undo import UNDO_STEPS
from inspector.session.view import View

FIND, STOP = "Find what is missing", "Stop looking"
REMOVE, UNDO, REDO = "Remove", "Undo", "Redo"
UNDO_MODEL, REDO_MODEL = "Undo the last change of the model", "Redo a change of the model"
NONE = "–"
PANEL_PX = 390  # about as wide is the figure on the page


class MissingEffectsPanel:
    """Ranking of effects, buttons that add or remove one, and the history of the error."""

    def __init__(self, gui: viser.GuiApi, actions: Actions) -> None:
        self._actions = actions
        self._own = gui.add_html("")
        self.find = gui.add_button(
            FIND, icon=viser.Icon.SEARCH, hint="starts from the link errors alone; Undo brings your model back"
        )
        self._doing = gui.add_html("")
        self._advice = gui.add_html("")
        self.follow = gui.add_button(
            "Follow",
            icon=viser.Icon.ARROW_RIGHT,
            visible=False,
            color=SECONDARY,
            hint="what the automatic search would do next",
        )
        self.outliers = OutlyingPoses(gui, actions)
        self.moved = MovedInstrument(gui, actions)
        self._history = hidden_plot(gui, 0.85, "error history")
        self.between = gui.add_slider(
            "Before – after", min=0.0, max=1.0, step=0.05, initial_value=1.0, visible=False,
            hint="the arrows in 3D between those of the model a step before and those of the model on show",
        )  # fmt: skip
        self.change = gui.add_button_group(
            "Model", (UNDO,), visible=False, hint=f"up to {UNDO_STEPS} changes back; keys: Ctrl+Z, Ctrl+Y"
        )
        self._ranking = gui.add_html("")
        self.choice = gui.add_dropdown("Effect", (NONE,), hint="chosen in the table above, described below")
        self.add = gui.add_button("Add to the model", icon=viser.Icon.PLUS, color=SECONDARY)
        self._chosen_for = ChosenByDataset(self.choice, NONE)
        self._before = NONE  # what was chosen when this dataset was on show last
        self._by_hand = NONE  # the effect that was chosen by hand: no advice replaces it
        self._moves = (0, 0)  # changes of the model to undo and to redo
        self._chosen = gui.add_html("")
        self._variable = hidden_plot(gui, 0.7, "effect against residual")
        self._learned = gui.add_html("")
        self._curves = hidden_plot(gui, 1.0, "joint curves")
        self._reasons = gui.add_html("")
        self._state = gui.add_html("")
        self._untestable = gui.add_html("")
        self.between.on_update(
            lambda e: actions.between(clamped(e.target.value, 0.0, 1.0, 1.0)) if by_page(e) else None
        )
        self.find.on_click(lambda _: actions.find(self.find.label == FIND))
        self.choice.on_update(lambda e: self._chosen_by_hand() if by_page(e) else None)
        self.follow.on_click(lambda _: actions.follow())
        self.add.on_click(lambda _: actions.add_effect(str(self.choice.value)))
        self.change.on_click(lambda e: self._pressed(str(e.target.value)))
        self._undo = gui.add_command(
            UNDO_MODEL, hotkey="Z", modifier="cmd/ctrl", icon=viser.Icon.ARROW_BACK_UP, disabled=True
        )
        self._redo = gui.add_command(
            REDO_MODEL, hotkey="Y", modifier="cmd/ctrl", icon=viser.Icon.ARROW_FORWARD_UP, disabled=True
        )
        self._undo.on_trigger(lambda _: actions.move(-1))
        self._redo.on_trigger(lambda _: actions.move(1))

    def _pressed(self, button: str) -> None:
        if button == REMOVE:
            self._actions.remove_effect(str(self.choice.value))
        else:
            self._actions.move(-1 if button == UNDO else 1)

    def _chosen_by_hand(self) -> None:
        self._by_hand = self.chosen
        self._actions.candidate()

    def open(self, dataset: str, _: View) -> None:
        """Restore the choice made earlier for a dataset."""
        self._before = str(self._chosen_for.open(dataset))
        self.choice.options = (NONE,)
        put(self.choice, NONE)

    def choose(self, name: str) -> None:
        """Choose an effect in the list, if it is listed."""
        if name in self.choice.options:
            self._by_hand = name
            put(self.choice, name)

    def finding(self, running: bool) -> None:
        """Label the button to stop the diagnosis while the diagnosis runs."""
        self.find.label = STOP if running else FIND
        self.find.disabled = False

    def say(self, words_now: str) -> None:
        """Show the current task, or why it is impossible."""
        self._doing.content = elements.alert(words_now, colour="#56B4E9") if words_now else ""

    @property
    def chosen(self) -> str:
        """Name of the effect that the tables describe."""
        return str(self.choice.value)

    def update(self, view: View, *, undo: int, redo: int, own: str = "") -> None:
        """Show the session's model and candidates for missing effects; `own`: fault of the user's effects file."""
        session = view.session
        self._moves = (undo, redo)
        self._undo.disabled, self._redo.disabled = not undo, not redo
        self.say("")
        self._own.content = elements.alert(own, colour=BAD) if own else ""
        self._state.content = html.state_html(session, undo, redo)
        self.judge(session)
        self.update_figure(view)
        self.update_choice(view)
        screening = session.screening
        self._untestable.content = html.untestable_html(screening.untestable) if screening else ""

    def judge(self, session: Session) -> None:
        """Show the advised change of the model with its button, or the verdict with its reasons."""
        self._offer(session)
        done = session.searched and session.diagnosis is not None
        self.find.color = SECONDARY if session.diagnosis is not None else None
        self.find.disabled = self.find.label == FIND and (session.calibration is None or done)
        self._reasons.content = html.reasons_html(session.diagnosis, session.next_poses)
        self._advice.content = html.verdict_html(session.diagnosis, session.next_poses)
        advice = session.advice if session.diagnosis is None and session.screening is not None else None
        self.follow.visible = advice is not None
        self.outliers.update(session, beside_advice=True)
        self.moved.update(session)
        if advice is not None:
            self._advice.content = html.advice_html(advice)
            self.follow.label = html.follow_label(advice)

    def update_figure(self, view: View) -> None:
        """Draw the history of the error, and the learned curves where the model has some."""
        self.update_curves(view)
        session = view.session
        self.between.visible = view.version_before is not None
        put(self.between, 1.0)
        self._history.visible = session.calibration is not None and bool(session.history)
        if session.calibration is None or not session.history:
            return
        self._history.figure = history_of_model(session.steps)

    def update_curves(self, view: View) -> None:
        """Draw the learned curves of the model on show, if any."""
        calibration = view.session.calibration
        drawn = () if calibration is None else fitted_curves(calibration)
        self._curves.visible = bool(drawn)
        if calibration is None or not learned_members(calibration):
            self._learned.content = ""
            return
        self._learned.content = panel(
            [
                Paragraph(f"Curves of {LEARNED}", heading=True),
                *curve_blocks(calibration),
                Paragraph(BAND_NOTE, soft=True),
            ]
        )
        if not drawn:  # couplings of all joints have no one input
            return
        self._curves.aspect = height_px(len(drawn)) / PANEL_PX
        robot = calibration.model.robot
        self._curves.figure = joint_curves(drawn, robot, selected=view.joint)

    def update_choice(self, view: View) -> None:
        """Mark the chosen effect in the ranking, and describe it."""
        session, name = view.session, self.chosen
        inside = [added.name for added in session.effects]
        screening = session.screening
        candidate = None if screening is None else html.named(screening, name)
        self._variable.visible = candidate is not None and bool(candidate.members)
        self.add.disabled = name == NONE or name in inside or (candidate is not None and not candidate.members)
        undo, redo = self._moves
        offered = ((REMOVE, name in inside), (UNDO, undo), (REDO, redo))
        buttons = tuple(button for button, does_something in offered if does_something)
        self.change.visible = bool(buttons)
        if buttons and buttons != tuple(self.change.options):
            self.change.options = buttons
        if screening is None:
            self._ranking.content = self._chosen.content = ""
            return
        own = {family.name for family in session.user_effects}
        self._ranking.content = html.ranking_html(session, name)
        self._chosen.content = ""
        if name != NONE and session.calibration is not None:
            self._chosen.content = html.chosen_html(name, session, session.calibration, screening, own=name in own)
        if candidate is not None and candidate.members:
            self._variable.figure = added_variable(
                candidate.explained, screening.projected.residual, name, screening.projected.row_poses
            )

    def _offer(self, session: Session) -> None:
        """Update the lists of effects that can be added or removed, without changing the choice."""
        inside = [added.name for added in session.effects]
        ranked = [c.name for c in session.screening.candidates] if session.screening else []
        waits = session.residual_tests is None and LEARNED in self.choice.options  # whether it is still offered
        if session.curves is not None or waits:
            ranked = [LEARNED, *ranked]
        if session.screening is None and session.calibration is not None:
            ranked = [o for o in self.choice.options if o != NONE]  # while the ranking is made
        options = tuple(dict.fromkeys([*ranked, *inside])) or (NONE,)
        before = str(self.choice.value)
        before = self._before if before == NONE else before
        if options != tuple(self.choice.options):
            self.choice.options = options
        advised = session.advice.effect if session.advice is not None else ""
        free = before not in (*inside, self._before, self._by_hand)
        if advised in options and free:
            put(self.choice, advised)
        else:
            put(self.choice, before if before in options and before != NONE else options[0])
