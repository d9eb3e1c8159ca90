"""Links in the HTML of the page's own widgets: names in a sentence, and rows that select a joint."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from calib.present.blocks import Reference
from calib.present.html import words_html
from calib.present.references import Names, recognised
from inspector.markup.parts.elements import Html, asking


def joint_asks(joints: Iterable[int | None]) -> list[Html]:
    """Requests by a click on each row of a table: the row's joint, from 1; none for rows without a joint."""
    return [Html("") if joint is None else asking("joint", joint) for joint in joints]


def linked(sentence: object, names: Names, known: Mapping[str, Reference] | None = None) -> Html:
    """HTML of a sentence in which the names of poses and joints can be clicked."""
    return Html(words_html(recognised(str(sentence), names, known), links=True))
