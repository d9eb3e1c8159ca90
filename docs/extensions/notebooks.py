"""Sphinx: every notebook of docs/notebooks is run, and becomes a page with what its cells show.

Notebooks are stored without outputs, so none can be out of date. A page holds no script: plotly's figures become the
SVG that the report draws. A cell that fails, or writes to stderr (a warning), fails the build.
"""

from __future__ import annotations

import os
import tempfile
import zlib
from pathlib import Path
from typing import Any

import nbformat
import plotly.graph_objects as go
from markupsafe import Markup
from nbclient import NotebookClient
from nbclient.exceptions import CellExecutionError
from sphinx.application import Sphinx
from sphinx.errors import ExtensionError

from calib.rendering.blocks import Drawing, Presentation
from calib.rendering.html import IDS, view
from inspector.figures.svg.figure import svg_of
from inspector.figures.svg.text import plain

HERE = Path(__file__).parents[1] / "notebooks"
ROOT = HERE.parents[1]
PLOTLY, HTML, TEXT = "application/vnd.plotly.v1+json", "text/html", "text/plain"
_FENCE = "``````"
_WIDTH_PX, _HEIGHT_PX, _SECONDS = 850, 420, 300


def run(notebook: nbformat.NotebookNode, name: str) -> nbformat.NotebookNode:
    """The notebook with its outputs, run by a kernel in an empty folder that has `sample_data`.

    Raises ExtensionError where a cell fails or writes to stderr.
    """
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / "sample_data").symlink_to(ROOT / "sample_data")
        environment = {**os.environ, "PYTHONPATH": str(ROOT), "PLOTLY_RENDERER": "plotly_mimetype"}
        quiet = ["--log-level=ERROR"]  # of the kernel itself, not of what cells say
        where = {"metadata": {"path": folder}}
        client = NotebookClient(notebook, timeout=_SECONDS, resources=where, extra_arguments=quiet)
        try:
            client.execute(env=environment)
        except CellExecutionError as error:
            raise ExtensionError(f"{name}: a cell fails: {error}") from None
    for cell in notebook.cells:
        for output in cell.get("outputs", ()):
            if output.get("name") == "stderr":
                raise ExtensionError(f"{name}: cell {cell.id!r} writes to stderr: {output.text}")
    return notebook


def page_of(notebook: nbformat.NotebookNode) -> str:
    """The notebook as a page of MyST Markdown: its words, its code, and what its cells show."""
    parts = []
    for cell in notebook.cells:
        if cell.cell_type == "markdown":
            parts.append(cell.source)
            continue
        parts.append(f"```{{code-block}} python\n{cell.source}\n```")
        parts += filter(None, map(shown, cell.outputs))
    return "\n\n".join(parts) + "\n"


def shown(output: nbformat.NotebookNode) -> str:
    """What a cell shows, as Markdown; "" of an output that is empty, as a bar is at its end."""
    if output.output_type == "stream":
        return f"```text\n{output.text.rstrip()}\n```"
    data = output.data
    if PLOTLY in data:
        return _raw(_still(data[PLOTLY]))
    if HTML in data:
        html = str(data[HTML]).strip()
        framed = html if html.startswith('<div class="calib-view"') or not html else _framed(html)
        return _raw(framed) if framed else ""
    return f"```text\n{str(data.get(TEXT, '')).rstrip()}\n```"


def _still(document: dict[str, Any]) -> str:
    """A plotly figure as SVG under its title, in the page's own colours."""
    drawn = go.Figure({"data": document["data"], "layout": document["layout"]})
    title = plain(drawn.layout.title.text or "")
    height = int(drawn.layout.height or _HEIGHT_PX)
    return view(Presentation(title, [Drawing(svg_of(drawn, _WIDTH_PX, height, name=IDS, title=title), "")]))


def _framed(html: str) -> str:
    """Another table, such as pandas makes, looks as ours do."""
    return view(Presentation("", [Drawing(Markup(html.replace(' border="1"', "")), "")]))


def _raw(html: str) -> str:
    return f"{_FENCE}{{raw}} html\n{html}\n{_FENCE}"


def sources() -> int:
    """Changes with the program's text and this file: a page is made anew then."""
    files = [Path(__file__), *(f for package in ("calib", "inspector") for f in (ROOT / package).rglob("*"))]
    code = 0
    for file in sorted(file for file in files if file.suffix in (".py", ".html", ".css", ".toml")):
        code = zlib.crc32(file.read_bytes(), code)
    return code


def write_pages(app: Sphinx) -> None:
    """Make the page of each notebook in generated/notebooks, where it or the program changed."""
    folder = Path(app.srcdir) / "generated" / "notebooks"
    folder.mkdir(parents=True, exist_ok=True)
    program = sources()
    for path in sorted(HERE.glob("*.ipynb")):
        text = path.read_text(encoding="utf-8")
        made = f"% made of {path.name}, {zlib.crc32(text.encode(), program):08x}\n\n"
        page = folder / f"{path.stem}.md"
        if page.is_file() and page.read_text(encoding="utf-8").startswith(made):
            continue
        notebook = run(nbformat.reads(text, as_version=4), path.name)
        page.write_text(made + page_of(notebook), encoding="utf-8")


def setup(app: Sphinx) -> dict[str, Any]:
    """Called by Sphinx."""
    app.connect("builder-inited", write_pages)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
