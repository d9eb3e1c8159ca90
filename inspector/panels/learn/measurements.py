"""What is wrong with the measurements, with a button that puts it right: poses that stand out, a moved instrument."""

from __future__ import annotations

from collections.abc import Sequence

import viser

from calib.diagnosis.moves import LeaveOutPoses
from calib.present.diagnosis.diagnosis import outliers_sentence
from calib.rendering import numbers
from calib.rendering.blocks import Paragraph
from calib.rendering.html import panel
from inspector.panels.base import SECONDARY, Actions
from inspector.session.session import Session

MOST_NAMED = 4  # poses on a button


class OutlyingPoses:
    """Sentence and button on the poses that stand out; hidden where none do, or all are left out already."""

    def __init__(self, gui: viser.GuiApi, actions: Actions) -> None:
        self._actions = actions
        self._sentence = gui.add_html("", visible=False)
        self.button = gui.add_button(
            "Leave out", visible=False, color=SECONDARY, hint="fits the model again; Undo takes it back"
        )
        self._poses: tuple[str, ...] = ()  # ids
        self._is_advised = False
        self.button.on_click(lambda _: self.press())

    def update(self, session: Session, *, beside_advice: bool = False) -> None:
        """Show the poses that a diagnosis, or the advice, says to stand out.

        Before either, an effect that the model lacks may make a good pose stand out.

        beside_advice: whether the advised move has its button there; where that leaves the poses out, this one hides.
        """
        tests, advice = session.residual_tests, session.advice
        self._is_advised = session.diagnosis is None and advice is not None and isinstance(advice.move, LeaveOutPoses)
        is_judged = session.diagnosis is not None or self._is_advised
        outlying = tests.outlier_poses if tests is not None and is_judged else ()
        self._poses = tuple(pose_id for pose_id in outlying if pose_id not in session.uncounted)
        shown = bool(self._poses) and not (beside_advice and self._is_advised)
        self._sentence.visible = self.button.visible = shown
        self._sentence.content = panel([Paragraph(outliers_sentence(self._poses))]) if shown else ""
        if shown:
            self.button.label = leave_out_label(self._poses)

    def press(self) -> None:
        """Leave the poses out, by the advised move where it does that."""
        if self._is_advised:
            self._actions.follow()
        elif self._poses:
            self._actions.leave_out_poses(self._poses)


class MovedInstrument:
    """Button for the first move of the instrument that the verdict claims; the verdict's sentence stands above it."""

    def __init__(self, gui: viser.GuiApi, actions: Actions) -> None:
        self.button = gui.add_button(
            "New setup", visible=False, color=SECONDARY, hint="finds the instrument's place anew, and fits again"
        )
        self._pose = ""  # id
        self.button.on_click(lambda _: actions.new_setup(self._pose))

    def update(self, session: Session) -> None:
        """Offer the move that a diagnosis claims; hide the button where there is none."""
        moves = () if session.diagnosis is None else session.diagnosis.instrument_moved
        self.button.visible = bool(moves)
        if moves:
            self._pose = moves[0].before
            self.button.label = f"New setup from {self._pose} on: the instrument was moved"


def leave_out_label(poses: Sequence[str]) -> str:
    """Label of a button that leaves poses out: "Leave out p33 and p46"."""
    return f"Leave out {numbers.listing(numbers.first_of(poses, MOST_NAMED))}"
