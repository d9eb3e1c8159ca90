"""Links in HTML that the page's own widgets make: names in a sentence, and rows that pick a joint."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from calib.present.blocks import Reference
from calib.present.html import words_html
from calib.present.references import Names, recognised
from inspector.markup.parts.elements import Html, asking


def joint_asks(joints: Iterable[int | None]) -> list[Html]:
    """What a click on each row of a table asks for: its joint, from 1; nothing where it has none."""
    return [Html("") if joint is None else asking("joint", joint) for joint in joints]


def linked(sentence: object, names: Names, known: Mapping[str, Reference] | None = None) -> Html:
    """A sentence, escaped, in which the poses and joints that it names can be clicked."""
    return Html(words_html(recognised(str(sentence), names, known), links=True))
