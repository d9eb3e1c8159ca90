"""Text as HTML shows it: its markup escaped, its hidden characters visible."""

from __future__ import annotations

import html

from calib.errors import visible


def escape(text: object, quote: bool = True) -> str:
    """A text for HTML, as the standard library's `html.escape` makes it, with escapes for what would not be seen."""
    return html.escape(visible(str(text), kept="\n\r\t"), quote=quote)


def visible_value(value: object) -> object:
    """What jinja2 puts into a page (its `finalize`): a value as a text with all that it hides; markup is our own."""
    return value if hasattr(value, "__html__") else visible(str(value), kept="\n\r\t")
