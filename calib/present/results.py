"""Presentation and document of each kind of result, looked up by the result's class."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from functools import cache, singledispatch
from importlib import import_module, metadata
from typing import TYPE_CHECKING, Any

import numpy as np

from calib.lazy_modules import is_frame
from calib.plugins import Presentations, contributions
from calib.presented import Presented
from calib.rendering import blocks
from calib.rendering import text as blocks_text
from calib.rendering.blocks import Presentation
from calib.strict_json import plain

if TYPE_CHECKING:
    from calib.rendering.html import Draw

FIGURES = "calib.figures"  # entry points of this group draw figures in notebooks: `Draw` of `rendering/html.py`


_MAKERS = tuple(
    f"calib.present.{name}"
    for name in (
        "fit.calibration", "fit.corners", "fit.dataset", "fit.redundancy", "fit.validation", "diagnosis.diagnosis",
        "over_time.checks", "over_time.comparison", "over_time.recurrence", "plans.correction", "plans.plans",
    )
)  # fmt: skip
"""Modules that register what they make of a result; whoever tells of one kind has loaded its module alone."""


def loads_makers() -> bool:
    """Load all modules that make presentations and documents, plug-ins' too; whether any was not loaded yet."""
    brought = [name for each in contributions(Presentations) for name in each.modules]
    missing = [name for name in (*_MAKERS, *brought) if name not in sys.modules]
    for name in missing:
        import_module(name)
    return bool(missing)


@singledispatch
def presentation(result: object) -> Presentation:
    """Presentation of a result as blocks."""
    if loads_makers():
        return presentation(result)
    raise TypeError(f"nothing is told of a {type(result).__name__}")


@singledispatch
def document(result: object) -> Mapping[str, Any]:
    """JSON document of a result, as a command's `--json` prints it; values are converted by `to_dict`.

    A dataclass is the document of its fields; a part of a result that has another is registered with the whole. A
    field's metadata may give its key (`key="name"`), or keep it out (`key=None`).
    """
    if (isinstance(result, Presented) or not is_dataclass(result)) and loads_makers():
        return document(result)
    if not is_dataclass(result):
        raise TypeError(f"a {type(result).__name__} has no document")
    return own_fields(result)


def own_fields(result: Any) -> dict[str, Any]:
    """A dataclass' own fields as keys of a document."""
    keys = {field.name: field.metadata.get("key", field.name) for field in fields(result)}
    return {key: getattr(result, name) for name, key in keys.items() if key is not None}


def keys_of(result: object, *names: str) -> dict[str, Any]:
    """Some keys of a document: attributes of a result by their own names."""
    return {name: getattr(result, name) for name in names}


@document.register(Mapping)
def _keys(made: Mapping[str, Any]) -> Mapping[str, Any]:
    return made


def to_dict(result: object) -> dict[str, Any]:
    """A result converted to strings, numbers, lists, dicts and None."""
    plain_document = plain(nested(document(result)))
    assert isinstance(plain_document, dict)
    return plain_document


def nested(value: object) -> object:
    """A document in which every dataclass and table is converted to dicts and lists."""
    if is_dataclass(value) and not isinstance(value, type):
        return nested(document(value))
    if is_frame(value):
        return value.to_dict(orient="records")  # type: ignore[attr-defined]
    if isinstance(value, Mapping):
        return {str(key): nested(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [nested(item) for item in value]
    if isinstance(value, np.ndarray):
        return value.tolist()
    return value


def statement(result: object) -> blocks.Words:
    """Most important statement on a result, in a sentence or two: the first verdict of its presentation."""
    told = blocks.shown(presentation(result).head)
    return next(block.words for block in told if isinstance(block, blocks.Verdict))


@singledispatch
def headline(result: object) -> str:
    """Most important statement on a result as plain text."""
    return blocks.plain(statement(result))


def summary(result: object) -> str:
    """Summary of a result in a few lines of plain text."""
    return blocks_text.text(presentation(result))


def notebook_html(result: object) -> str:
    """A result as HTML for a notebook's cell, with figures where a plotting library is installed."""
    from calib.rendering import html as blocks_html  # with its templates slow to load, and a terminal needs none

    return blocks_html.view(presentation(result), _installed_draw())


@cache
def _installed_draw() -> Draw | None:
    """Function that draws figures, provided by `inspector` if installed with plotly; else None."""
    for entry in metadata.entry_points(group=FIGURES):
        try:
            draw: Draw = entry.load()
        except ModuleNotFoundError:  # the package that draws comes without its plotting library
            continue
        return draw
    return None
