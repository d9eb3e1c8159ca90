"""Poses that stand out of all others, as a sentence with a button that leaves them out."""

from __future__ import annotations

import viser

from calib.diagnosis.moves import LeaveOutPoses
from calib.present.cause.diagnosis import outliers_sentence
from calib.rendering.blocks import Paragraph
from calib.rendering.html import panel
from inspector.markup.learn.effects import leave_out_label
from inspector.panels.base import SECONDARY, Actions
from inspector.session.session import Session


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
