"""Tab What is missing: ranking, addition and removal of effects, and the history of the error."""

from __future__ import annotations

import viser

from calib.calibration.result import Calibration
from calib.diagnosis.advice import Advice
from calib.diagnosis.effect_selection import SelectedEffect
from calib.diagnosis.moves import AddCurves, AddEffect, DropEffect, LeaveOutPoses, ShapeNoise
from calib.diagnosis.result import Diagnosis
from calib.planning.discrimination import NextPoses
from calib.present.diagnosis.candidates import (
    CANNOT_BE_TESTED,
    candidate_blocks,
    evidence_sentence,
    fitted_effect,
    held_out_sentence,
    nothing_shows,
    ranking_to_choose_from,
)
from calib.present.diagnosis.diagnosis import HOW, reasons
from calib.present.diagnosis.interventions import intervention_sections
from calib.present.diagnosis.verdict import advice as advice_sentence
from calib.present.diagnosis.verdict import residual_of, verdict
from calib.present.effects import not_testable, with_joints
from calib.present.fit.errors import last_change
from calib.present.fit.learned import BAND_NOTE, curve_blocks, offered_curves
from calib.rendering.blocks import Block, Bullets, Folded, Paragraph, Section, Verdict, Words, plain, spans
from calib.rendering.colours import VERDICT_COLOURS
from calib.rendering.html import panel
from calib.screening.candidates import Candidate, Screening
from calib.screening.curves.fitted_curves import fitted_curves, learned_members
from calib.screening.curves.smooth_joint_error import LEARNED
from inspector.figures.curve_plots import height_px, joint_curves
from inspector.figures.residual_plots import added_variable
from inspector.figures.results.of_results import history_of_model
from inspector.markup.parts import elements
from inspector.markup.parts.palette import BAD, PROPOSAL
from inspector.panels.base import SECONDARY, Actions, ChosenByDataset, hidden_plot, on_page, put, relist
from inspector.panels.input_checks import clamped
from inspector.panels.learn.measurements import MovedInstrument, OutlyingPoses, leave_out_label
from inspector.session.session import Session
from inspector.session.undo import UNDO_STEPS
from inspector.session.view import View

FIND, STOP = "Find what is missing", "Stop looking"
REMOVE, UNDO, REDO = "Remove", "Undo", "Redo"
UNDO_MODEL, REDO_MODEL = "Undo the last change of the model", "Redo a change of the model"
NONE = "–"
PANEL_PX = 390  # about as wide is the figure on the page
NOT_YET = "Not calibrated yet: the model is fitted when the search has ended. The tab Fit says what it lacks."
LOOK_CLOSER = " Look at it in the tab Where it fails; an effect of your own can be tested with --effects-file."
BELOW = (
    "Below: the residual of each training point, per coordinate, over what the effect would make of it. Points along "
    "the line speak for it."
)
SETTLE = "Plan the poses that settle it"
MORE = "Plan poses that determine the links better"


class MissingEffectsPanel:
    """Ranking of effects, buttons that add or remove one, and the history of the error."""

    def __init__(self, gui: viser.GuiApi, actions: Actions) -> None:
        self._actions = actions
        self._own = gui.add_html("")
        self.find = gui.add_button(
            FIND, icon=viser.Icon.SEARCH, hint="starts from calibrated links alone; Undo brings your model back"
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
        on_page(self.between, lambda value: actions.between(clamped(value, 0.0, 1.0, 1.0)))
        self.find.on_click(lambda _: actions.find(self.find.label == FIND))
        on_page(self.choice, lambda _: self._chosen_by_hand())
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
        self._doing.content = elements.alert(words_now, colour="#56B4E9")

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
        self._own.content = elements.alert(own, colour=BAD)
        change = last_change(session.history)
        self._state.content = panel([change]) if change else elements.note("" if session.history else NOT_YET)
        self.judge(session)
        self.update_figure(view)
        self.update_choice(view)
        screening = session.screening
        untestable = not_testable(screening.untestable if screening else ())
        self._untestable.content = panel([Section(CANNOT_BE_TESTED, [Bullets(untestable)])])

    def judge(self, session: Session) -> None:
        """Show the advised change of the model with its button, or the verdict with its reasons."""
        self._offer(session)
        done = session.searched and session.diagnosis is not None
        self.find.color = SECONDARY if session.diagnosis is not None else None
        self.find.disabled = self.find.label == FIND and (session.calibration is None or done)
        self._reasons.content = reasons_html(session.diagnosis, session.next_poses)
        self._advice.content = verdict_html(session.diagnosis, session.next_poses)
        advice = session.advice if session.diagnosis is None and session.screening is not None else None
        self.follow.visible = advice is not None
        self.outliers.update(session, beside_advice=True)
        self.moved.update(session)
        if advice is not None:
            self._advice.content = panel([Verdict(advice_sentence(advice), PROPOSAL)])
            self.follow.label = follow_label(advice)

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
        self._curves.figure = joint_curves(drawn, robot)

    def update_choice(self, view: View) -> None:
        """Mark the chosen effect in the ranking, and describe it."""
        session, name = view.session, self.chosen
        inside = [added.name for added in session.effects]
        screening = session.screening
        candidate = None if screening is None else named(screening, name)
        self._variable.visible = candidate is not None and bool(candidate.members)
        self.add.disabled = name == NONE or name in inside or (candidate is not None and not candidate.members)
        undo, redo = self._moves
        offered = ((REMOVE, name in inside), (UNDO, undo), (REDO, redo))
        buttons = tuple(button for button, does_something in offered if does_something)
        self.change.visible = bool(buttons)
        if buttons:
            relist(self.change, buttons)
        if screening is None:
            self._ranking.content = self._chosen.content = ""
            return
        own = {family.name for family in session.user_effects}
        self._ranking.content = ranking_html(session, name)
        self._chosen.content = ""
        if name != NONE and session.calibration is not None:
            self._chosen.content = chosen_html(name, session, session.calibration, screening, own=name in own)
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
        relist(self.choice, options)
        advised = session.advice.effect if session.advice is not None else ""
        free = before not in (*inside, self._before, self._by_hand)
        if advised in options and free:
            put(self.choice, advised)
        else:
            put(self.choice, before if before in options and before != NONE else options[0])


def named(screening: Screening, name: str) -> Candidate | None:
    """Candidate by its name; None where no candidate has it (the effect may be in the model already)."""
    return next((c for c in screening.candidates if c.name == name), None)


def verdict_html(diagnosis: Diagnosis | None, next_poses: NextPoses | None) -> str:
    """HTML of a diagnosis' verdict in a line or two, and of the next plan."""
    if diagnosis is None:
        return ""
    more = LOOK_CLOSER if diagnosis.verdict == "unexplained" and diagnosis.learned is None else ""
    words = spans(residual_of(diagnosis), " Verdict: ", verdict(diagnosis), more)
    plan: Words = ""
    if next_poses is not None:
        plan = elements.tab_link("Learn/Plan", f"{SETTLE}.", ask="settle")
    elif diagnosis.verdict in ("adequate", "named") and diagnosis.held_out_beyond_noise is not None:
        plan = elements.tab_link("Learn/Plan", f"{MORE}.")
    return panel([Verdict(words, VERDICT_COLOURS[diagnosis.verdict]), Paragraph(plan, soft=True)])


def reasons_html(diagnosis: Diagnosis | None, next_poses: NextPoses | None) -> str:
    """HTML of the reasons for the verdict, a paragraph each."""
    if diagnosis is None:
        return ""
    return panel([Section(HOW, reasons(diagnosis, next_poses)), *intervention_sections(diagnosis)])


def follow_label(advice: Advice) -> str:
    """Label of the button that makes the advised change of the model."""
    match advice.move:
        case AddEffect():
            name = plain(with_joints(SelectedEffect.of(advice.move.candidate)))
            return f"Put {name} in place of {advice.move.instead_of}" if advice.move.instead_of else f"Add {name}"
        case AddCurves():
            return f"Add {plain(with_joints(advice.move.diagnosis.steps[-1].selected[-1]))}"
        case DropEffect():
            return f"Remove {advice.effect}"
        case LeaveOutPoses():
            return leave_out_label(advice.move.poses)
        case ShapeNoise():
            return "Weigh the points by their noise"


def ranking_html(session: Session, chosen: str) -> str:
    """HTML of the candidate effects that explain part of the residual, as rows to click, and of the others' names."""
    screening = session.screening
    if screening is None:
        return ""
    own = {family.name for family in session.user_effects}
    likely = None if session.diagnosis is None else session.diagnosis.told_probabilities
    blocks = ranking_to_choose_from(
        screening, passed_over=session.left_to_curves, chosen=(chosen,), own=own, likely=likely
    )
    notes = f"{evidence_sentence()} {held_out_sentence(screening)} {nothing_shows(screening)}"
    return panel(
        [
            Section("What could be missing: click an effect to choose it", blocks),
            Folded("What the columns mean", [Paragraph(notes)]),
        ]
    )


def chosen_html(name: str, session: Session, calibration: Calibration, screening: Screening, *, own: bool) -> str:
    """HTML on the chosen effect: description, estimated values, and fitted ones where it is in the model."""
    if name == LEARNED and session.curves is not None:
        return panel(offered_curves(session.curves, calibration))
    candidate = named(screening, name)
    blocks: list[Block] = candidate_blocks(name, candidate, calibration, screening.cv_rmse_mm, own=own)
    if candidate is not None and candidate.members:
        blocks.append(Paragraph(BELOW, soft=True))
    if name != LEARNED and any(added.name == name for added in session.effects):
        blocks += fitted_effect(name, calibration)
    return panel(blocks)
