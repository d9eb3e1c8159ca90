"""Base class of results with a presentation: as plain data, as text, as HTML in a notebook.

A result holds facts and no sentences. What is told of it is made in `calib.present`, which stands above all results and
knows each of them, and is loaded by name when a result is first asked for its telling.
"""

from __future__ import annotations

from typing import Any, Protocol

from calib.brief import Brief
from calib.plugins import load


class Printer(Protocol):
    """Protocol of the printer object that IPython passes to `_repr_pretty_`."""

    def text(self, text: str) -> None:
        """Print a text."""


class Presented(Brief):
    """Base class of results that convert to plain data, text and HTML."""

    def to_dict(self) -> dict[str, Any]:
        """The result with the keys of the command's `--json`: strings, numbers, lists, dicts, None; no NaN.

        `json.dumps(result.to_dict(), allow_nan=False)` always works. Keys are only ever added.
        """
        document: dict[str, Any] = _present().to_dict(self)
        return document

    def summary(self) -> str:
        """The result in a few lines of plain text."""
        return str(_present().summary(self))

    @property
    def headline(self) -> str:
        """Most important statement on the result, in a sentence or two."""
        return str(_present().headline(self))

    def _repr_html_(self) -> str:
        """HTML of the result for a cell of Jupyter, VS Code and others: light or dark, no script, no network."""
        return str(_present().notebook_html(self))

    def _repr_pretty_(self, printer: Printer, cycle: bool) -> None:
        printer.text(self.summary())

    def __init_subclass__(cls) -> None:
        super().__init_subclass__()
        # IPython goes by the class's own attributes: else it would take the repr that dataclasses make beside the HTML.
        cls._repr_pretty_ = Presented._repr_pretty_  # type: ignore[method-assign]


def _present() -> Any:
    return load("calib.present")
