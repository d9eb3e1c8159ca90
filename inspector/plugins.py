"""Kinds of what a plug-in brings to the commands and the page; `calib.plugins` tells how a plug-in is found."""

from __future__ import annotations

from calib import plugins
from calib.plugins import Kind

EXTRAS = "inspector.extras"


def contributions(kind: type[Kind]) -> tuple[Kind, ...]:
    """All contributions of one kind to the commands and the page."""
    return plugins.contributions(kind, EXTRAS)


def left_out() -> tuple[str, ...]:
    """A line for each plug-in of the method, the commands or the page that could not be imported."""
    return tuple(dict.fromkeys((*plugins.left_out(), *plugins.left_out(EXTRAS))))
