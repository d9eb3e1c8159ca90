"""What results have for whoever works with them in a notebook or a script: `to_dict()` and how a cell shows them.

A result stands far below what tells of it. `calib.documents` and `calib.views` know every result, and `inspector` knows
both, so a result must import none of them. It finds the one that tells of it by name, when it is asked for, as `calib`
itself finds its public face: `DOCUMENTS`, `VIEWS` and `WITH_FIGURES` are the only places where a name points
upwards, and tests/display checks every one of them. Where the extra `page` is installed the report's own sections, with
figures, take the place of the plain views.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import cache
from importlib import import_module
from importlib.util import find_spec
from typing import Any, Protocol

from calib.strict_json import plain

DOCUMENTS: Mapping[str, str] = {  # class -> function that makes its document
    "calib.calibration.result.Calibration": "calib.documents.calibration_documents:calibration_document",
    "calib.corners.batch.CornerBatch": "calib.documents.corner_documents:batch_document",
    "calib.identifiability.redundancy.Redundancy": "calib.documents.corner_documents:pearson_document",
}
VIEWS: Mapping[str, str] = {  # class -> function that makes its HTML, tables only
    "calib.calibration.result.Calibration": "calib.views.fit_views:calibration_html",
    "calib.corners.batch.CornerBatch": "calib.views.measured_views:corners_html",
    "calib.dataset.dataset.Dataset": "calib.views.measured_views:dataset_html",
    "calib.identifiability.redundancy.Redundancy": "calib.views.fit_views:redundancy_html",
}

WITH_FIGURES = "inspector.notebook:html_with_figures"  # of the same classes; None where it has nothing to add
NEEDS = ("plotly", "inspector")  # what that takes: the extra `page`, and the package that ships with this one


class Documented:
    """A result that can be had as plain data."""

    def to_dict(self) -> dict[str, Any]:
        """The result with the keys of the command's `--json`: strings, numbers, lists, dicts, None; no NaN.

        `json.dumps(result.to_dict(), allow_nan=False)` always works. Keys are only ever added.
        """
        document = plain(_maker(DOCUMENTS[_name_of(type(self))])(self))
        assert isinstance(document, dict)
        return document


class Printer(Protocol):
    """What IPython hands to `_repr_pretty_`."""

    def text(self, text: str) -> None: ...


class Viewed:
    """A result that a notebook shows as HTML, and IPython's terminal as its summary."""

    def _repr_html_(self) -> str:
        """For Jupyter, VS Code and others: light or dark as they are, every name escaped, no script, no network."""
        if all(find_spec(name) is not None for name in NEEDS):
            html = _maker(WITH_FIGURES)(self)
            if html is not None:
                return str(html)
        return str(_maker(VIEWS[_name_of(type(self))])(self))

    def _repr_pretty_(self, printer: Printer, cycle: bool) -> None:
        printer.text(self.summary())

    def __init_subclass__(cls) -> None:
        # IPython goes by the class's own attributes: else it would take the long text that dataclasses make, a
        # megabyte of a diagnosis, which a notebook keeps beside the HTML.
        cls._repr_pretty_ = Viewed._repr_pretty_  # type: ignore[method-assign]

    def summary(self) -> str:
        """The result in a few lines of plain text."""
        raise NotImplementedError


def _name_of(kind: type) -> str:
    return f"{kind.__module__}.{kind.__qualname__}"


@cache
def _maker(place: str) -> Callable[[object], Any]:
    module, _, name = place.partition(":")
    maker: Callable[[object], Any] = getattr(import_module(module), name)
    return maker
