"""Text escaped for HTML, with hidden characters made visible."""

from __future__ import annotations

import html

from calib.errors import visible


def escape(text: object, quote: bool = True) -> str:
    """A text escaped for HTML as by `html.escape`, with hidden characters as visible escapes."""
    return html.escape(visible(str(text), kept="\n\r\t"), quote=quote)


def visible_value(value: object) -> object:
    """Text of a value that jinja2 puts into a page (its `finalize`), hidden characters escaped; own markup stays."""
    return value if hasattr(value, "__html__") else visible(str(value), kept="\n\r\t")
