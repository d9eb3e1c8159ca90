"""The gallery: scripts of docs/gallery, each run while the documentation is built, with the figures that it shows.

A script begins with a docstring, its title first, and has cells that begin with `# %%`; comment lines there are text.
`figure.show()` puts the figure, as SVG without a script, behind its cell; the figure's layout.title is what is read
aloud and, with a first figure, what the index tells. What a cell prints stands behind it too. The pages go to
docs/generated/gallery and are made anew when a script, `calib` or `inspector` has changed.
"""

from __future__ import annotations

import ast
import contextlib
import hashlib
import io
import os
import re
import sys
import tempfile
import time
import traceback
import types
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import plotly.graph_objects as go
from sphinx.application import Sphinx
from sphinx.errors import ExtensionError
from sphinx.util import logging

from inspector.figures.svg.figure import svg_of

logger = logging.getLogger(__name__)

GENERATED = "generated/gallery"
WIDTH_PX, HEIGHT_PX = 720, 380  # of a figure that says nothing else
MAX_SECONDS = 6.0  # of this process; a script that takes longer is told of


FORMATTER = re.compile(r"  # fmt: skip$", re.MULTILINE)  # words for a tool, not for a reader


@dataclass(frozen=True)
class Cell:
    """A part of a script: text in Markdown, then code."""

    text: str
    code: str
    line: int  # of the code's first line, counted from 1


@dataclass(frozen=True)
class Script:
    """A script of the gallery as it is read."""

    path: Path
    title: str
    intro: str
    cells: tuple[Cell, ...]


@dataclass(frozen=True)
class Shown:
    """What a cell showed."""

    printed: str
    svgs: tuple[str, ...]


# ---- reading --------------------------------------------------------------------------------------------------------


def read_script(path: Path) -> Script:
    """Raises ExtensionError where the docstring or the cells are not as they should be."""
    source = path.read_text(encoding="utf-8")
    doc = ast.get_docstring(ast.parse(source)) or ""
    title, _, intro = doc.partition("\n")
    if not title or not intro.strip():
        raise ExtensionError(f"{path}: a docstring with a title, an empty line and a sentence is missing")
    end = ast.parse(source).body[0].end_lineno or 1
    cells: list[Cell] = []
    text: list[str] = []
    code: list[str] = []
    start, in_text = end + 1, False
    for number, line in enumerate([*source.splitlines()[end:], "# %%"], start=end + 1):
        if line.startswith("# %%"):
            if "\n".join(code).strip():
                cells.append(Cell("\n".join(text).strip(), "\n".join(code).strip("\n"), start))
            text, code, in_text, start = [line.removeprefix("# %%").strip()], [], True, number
        elif in_text and line.startswith("#"):
            text.append(line.removeprefix("#").removeprefix(" "))
        else:
            if not "\n".join(code).strip() and line.strip():
                start = number
            in_text = False
            if code or line.strip():
                code.append(line)
    return Script(path, title.strip().rstrip("."), intro.strip(), tuple(cells))


# ---- running --------------------------------------------------------------------------------------------------------


def run_script(script: Script, samples: Path) -> tuple[Shown, ...]:
    """Run the cells in a folder of their own, with `sample_data` in it; what each showed.

    Raises ExtensionError with the line where a cell fails, or shows a figure without a title.
    """
    module = types.ModuleType("gallery_script")
    shown: list[Shown] = []
    figures: list[go.Figure] = []
    before, show = Path.cwd(), go.Figure.show
    go.Figure.show = lambda figure, *args, **kwargs: figures.append(figure)
    sys.modules[module.__name__] = module  # dataclasses look their module up
    try:
        with tempfile.TemporaryDirectory() as folder:
            (Path(folder) / "sample_data").symlink_to(samples)
            os.chdir(folder)
            for cell in script.cells:
                out = io.StringIO()
                code = compile("\n" * (cell.line - 1) + cell.code, str(script.path), "exec")
                with contextlib.redirect_stdout(out):
                    exec(code, vars(module))
                drawn = len([one for had in shown for one in had.svgs])
                svgs = tuple(_svg(script, drawn + k, figure) for k, figure in enumerate(figures))
                shown.append(Shown(out.getvalue(), svgs))
                figures.clear()
            os.chdir(before)
    except Exception as error:
        frames = [f for f in traceback.extract_tb(error.__traceback__) if f.filename == str(script.path)]
        line = f":{frames[-1].lineno}" if frames else ""
        raise ExtensionError(f"{script.path}{line}: {type(error).__name__}: {error}") from error
    finally:
        os.chdir(before)
        go.Figure.show = show
        del sys.modules[module.__name__]
    if not any(had.svgs for had in shown):
        raise ExtensionError(f"{script.path}: it shows no figure")
    return tuple(shown)


def _svg(script: Script, number: int, figure: go.Figure) -> str:
    title = figure.layout.title.text
    if not title:
        raise ValueError("a figure needs layout.title, which is read aloud")
    figure.layout.title = None
    size = (int(figure.layout.width or WIDTH_PX), int(figure.layout.height or HEIGHT_PX))
    return svg_of(figure, *size, name=f"{script.path.stem}-{number}", title=title)


# ---- writing --------------------------------------------------------------------------------------------------------


def page_of(script: Script, shown: Sequence[Shown], download: str) -> str:
    """The script's page: text, code, output and figures, cell by cell."""
    out = [f"# {script.title}", "", script.intro, ""]
    for cell, had in zip(script.cells, shown, strict=True):
        out += [cell.text, "", "```{code-block} python", FORMATTER.sub("", cell.code), "```", ""]
        if had.printed.strip():
            out += [":::{code-block} text", ":class: output", "", had.printed.rstrip(), ":::", ""]
        for svg in had.svgs:
            title = re.search(r'aria-label="([^"]*)"', svg)
            caption = f"<figcaption>{title[1] if title else ''}</figcaption>"
            out += ["```{raw} html", f'<figure class="gallery">{svg}{caption}</figure>', "```", ""]
    return "\n".join([*out, f"{{download}}`Download the script <{download}>`", ""])


def index_of(scripts: Sequence[Script], shown: Sequence[Sequence[Shown]]) -> str:
    """A card for each script, with its first figure, and the pages' toctree."""
    out = ["::::::{grid} 1 2 2 3", ":gutter: 3", ""]
    for script, had in zip(scripts, shown, strict=True):
        first = next(svg for cell in had for svg in cell.svgs)
        out += [
            f":::::{{grid-item-card}} {script.title}",
            f":link: /{GENERATED}/{script.path.stem}",
            ":link-type: doc",
            "",
            "```{raw} html",
            f'<div class="gallery-small">{_small(first)}</div>',
            "```",
            ":::::",
            "",
        ]
    names = [f"/{GENERATED}/{script.path.stem}" for script in scripts]
    return "\n".join([*out, "::::::", "", "```{toctree}", ":hidden:", "", *names, "```", ""])


def _small(svg: str) -> str:
    """The figure without its hover texts, under other ids."""
    bare = re.sub(r"<title>.*?</title>", "", svg, flags=re.DOTALL)
    return re.sub(r'(id="|url\(#)', r"\1small-", bare)


def write_gallery(source: Path, target: Path, samples: Path, order: Sequence[str] = ()) -> None:
    """Run all scripts of a folder and write their pages and the index, where something has changed.

    order: names of those that come first.
    """
    named = [source / f"{name}.py" for name in order]
    paths = [path for path in (*named, *sorted(set(source.glob("*.py")) - set(named))) if _can_run(path)]
    stamp = target / ".made-of"
    made_of = _hash(paths, source.parents[1])
    if stamp.is_file() and stamp.read_text() == made_of:
        return
    target.mkdir(parents=True, exist_ok=True)
    for old in target.glob("*.md"):
        if old.stem not in {path.stem for path in paths}:
            old.unlink()
    scripts = [read_script(path) for path in paths]
    shown = []
    for script in scripts:
        began = time.process_time()
        shown.append(run_script(script, samples))
        seconds = time.process_time() - began
        logger.info("gallery: %s %.1f s", script.path.name, seconds)
        if seconds > MAX_SECONDS:
            sys.stderr.write(f"gallery: {script.path.name}: {seconds:.1f} s; {MAX_SECONDS:g} are meant\n")
        download = os.path.relpath(script.path, target)
        (target / f"{script.path.stem}.md").write_text(page_of(script, shown[-1], download), encoding="utf-8")
    (target / "index.inc").write_text(index_of(scripts, shown), encoding="utf-8")
    stamp.write_text(made_of)


def _can_run(path: Path) -> bool:
    """Whether the extras that a script imports are here."""
    asked = re.findall(r"^from calib\.extras\.(\w+)", path.read_text(encoding="utf-8"), re.MULTILINE)
    extras = Path(__file__).parents[2] / "calib" / "extras"
    return all((extras / name).is_dir() for name in asked)


def _hash(paths: Sequence[Path], project: Path) -> str:
    code = [file for package in ("calib", "inspector") for file in sorted((project / package).rglob("*.py"))]
    found = hashlib.sha256()
    for path in (*paths, *code, Path(__file__)):
        found.update(path.name.encode() + path.read_bytes())
    return found.hexdigest()


def _on_start(app: Sphinx) -> None:
    source = Path(app.srcdir)
    write_gallery(source / "gallery", source / GENERATED, source.parent / "sample_data", app.config.gallery_order)


def setup(app: Sphinx) -> dict[str, bool]:
    """Write the pages before Sphinx looks for them."""
    app.add_config_value("gallery_order", (), "env")
    app.connect("builder-inited", _on_start)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
