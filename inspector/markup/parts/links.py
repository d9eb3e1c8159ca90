"""Names of poses and joints in a sentence as links, in the HTML of the page's own widgets."""

from __future__ import annotations

from collections.abc import Mapping

from calib.present.references import Names, recognised
from calib.rendering.blocks import Reference
from calib.rendering.html import words_html
from inspector.markup.parts.elements import Html


def linked(sentence: object, names: Names, known: Mapping[str, Reference] | None = None) -> Html:
    """HTML of a sentence in which the names of poses and joints can be clicked."""
    return Html(words_html(recognised(str(sentence), names, known), links=True))
