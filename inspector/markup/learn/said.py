"""Typed sentences of a diagnosis as HTML, in which the poses and joints that they are about can be clicked."""

from __future__ import annotations

from collections.abc import Iterable

from calib.diagnosis.advice import Advice, move_text
from calib.diagnosis.moves import AddCurves, LeaveOutPoses, Move
from calib.diagnosis.words import conclusions, sentences
from calib.diagnosis.words.conclusion_text import residual_summary_text
from calib.diagnosis.words.text import reason_text
from calib.present.blocks import Reference
from calib.present.references import Names, references_to
from inspector.markup.parts.elements import Html
from inspector.markup.parts.links import linked

Sentence = sentences.Reason | conclusions.ResidualSummary | conclusions.VerdictSentence | Move


def known_links(sentence: Sentence) -> dict[str, Reference]:
    """The poses and inputs of a sentence, by the words that it names them with."""
    match sentence:
        case sentences.PosesStandOut(poses):
            return references_to(poses)
        case conclusions.Outliers() | LeaveOutPoses():
            return references_to(sentence.poses)
        case conclusions.ResidualSummary():
            return references_to(sentence.outlier_poses)
        case sentences.ResidualOrder() | sentences.CurvesLearned():
            return references_to((), sentence.inputs)
        case AddCurves():
            return references_to((), sentence.curves.inputs)
        case _:
            return {}


def reasons_said(reasons: Iterable[sentences.Reason], names: Names) -> Html:
    """What led to a verdict, one paragraph."""
    return Html(" ".join(linked(reason_text(r), names, known_links(r)) for r in reasons))


def residual_said(residual: conclusions.ResidualSummary, names: Names) -> Html:
    """What a fit leaves, in short."""
    return Html(linked(residual_summary_text(residual), names, known_links(residual)))


def advice_said(advice: Advice, names: Names) -> Html:
    """What is left and what to do next."""
    move = linked(move_text(advice.move), names, known_links(advice.move))
    return Html(f"{residual_said(advice.residual, names)} {move}")
