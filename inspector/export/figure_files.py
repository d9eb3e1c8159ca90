"""Figures of a result as files: SVG, or PNG for who reads no SVG."""

from __future__ import annotations

import io
import re
import tempfile
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields, is_dataclass
from pathlib import Path

from calib.dataset.files.atomic_write import write_all_atomically
from calib.rendering.blocks import FigurePlace, Presentation
from inspector import figures
from inspector.figures.results.alone import to_svg

SVG, PNG = ".svg", ".png"
_COLOUR = re.compile(r"(--[a-z]+):(#[0-9a-f]+)")
_USE = re.compile(r"var\((--[a-z]+)\)")
_FONTS = "DejaVu Sans, Liberation Sans, Noto Sans, Arial, Helvetica, Aileron"  # the last one comes with Pillow
_PNG_SCALE = 1.5  # pixels a unit of the SVG


@dataclass(frozen=True)
class NamedFigure:
    """A figure of a result with the name of its file."""

    name: str  # "residuals_over_2": what draws it, counted where it draws several
    caption: str
    place: FigurePlace

    def svg(self) -> str:
        """The figure as the text of an SVG file."""
        drawn = getattr(figures, self.place.figure)(*self.place.of)
        return to_svg(drawn, self.place.width_px, self.place.height_px)


def figures_of(told: Presentation) -> tuple[NamedFigure, ...]:
    """All figures that the presentation of a result calls for, in its order."""
    places = list(_places(told))
    several = Counter(place.figure for place in places)
    seen: Counter[str] = Counter()
    named = []
    for place in places:
        seen[place.figure] += 1
        name = f"{place.figure}_{seen[place.figure]}" if several[place.figure] > 1 else place.figure
        named.append(NamedFigure(name, place.caption, place))
    return tuple(named)


def write_figures(chosen: Sequence[NamedFigure], folder: Path, *, png: bool) -> tuple[Path, ...]:
    """Write figures into a folder, which is made where it is missing; returns the files, one a figure.

    Raises ModuleNotFoundError for PNG where the package that draws it is not installed.
    """
    contents = [png_of(one.svg()) if png else one.svg().encode("utf-8") for one in chosen]
    folder.mkdir(parents=True, exist_ok=True)
    paths = tuple(folder / f"{one.name}{PNG if png else SVG}" for one in chosen)
    write_all_atomically(dict(zip(paths, contents, strict=True)))
    return paths


def png_of(svg: str) -> bytes:
    """PNG of an SVG file of a figure (`inspector.figures.to_svg`), on its own background."""
    from PIL import ImageFont  # brings a font for machines that have none
    from resvg_py import svg_to_bytes

    colours = dict(_COLOUR.findall(svg))
    fixed = _USE.sub(lambda use: colours[use[1]], svg)  # what draws it knows no variables of style sheets
    fixed = fixed.replace("<svg ", f'<svg font-family="{_FONTS}" ', 1)
    bare = ImageFont.load_default(10.0)
    assert isinstance(bare, ImageFont.FreeTypeFont)
    assert isinstance(bare.path, io.BytesIO)
    with tempfile.TemporaryDirectory(prefix="font-") as folder:
        font = Path(folder, "aileron.ttf")
        font.write_bytes(bare.path.getvalue())
        return bytes(svg_to_bytes(svg_string=fixed, zoom=_PNG_SCALE, font_files=[str(font)]))


def _places(told: object) -> Iterator[FigurePlace]:
    if isinstance(told, FigurePlace):
        yield told
    elif is_dataclass(told) and not isinstance(told, type):
        for field in fields(told):
            yield from _places(getattr(told, field.name))
    elif isinstance(told, list | tuple):
        for one in told:
            yield from _places(one)
