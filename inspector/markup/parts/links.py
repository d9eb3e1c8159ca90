"""Names of poses and joints in a sentence as links, in the HTML of the page's own widgets."""

from __future__ import annotations

from calib.present.references import Names
from calib.rendering.html import words_html
from inspector.markup.parts.elements import Html


def linked(sentence: object, names: Names) -> Html:
    """HTML of a sentence in which the names of poses and joints can be clicked."""
    return Html(words_html(names(str(sentence)), links=True))
