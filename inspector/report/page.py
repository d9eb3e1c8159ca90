"""One HTML page that stands alone: style, figures that can be hovered, and plotly.js itself are in it.

Opened from a file it asks no network (its own content policy forbids it), is light or dark as the reader's system is,
and prints light. Everything that comes from outside is escaped here, once: cells and sentences by `text`, figures by
`_json`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from itertools import count

import plotly.graph_objects as go
from plotly.offline import get_plotlyjs

from inspector.markup.elements import LONG_NAME, Html, text

MARK = '<meta name="generator" content="robot-calibration-inspector">'
"""What tells a page of ours from any other file."""

_POLICY = "default-src 'none'; style-src 'unsafe-inline'; script-src 'unsafe-inline'; img-src data: blob:"

_STYLE = """
:root { color-scheme: light dark; --page: #ffffff; --ink: #1f2328; --soft: #59636e; --line: #d1d9e0; --band: #f6f8fa;
  --link: #0969da; }
@media (prefers-color-scheme: dark) { :root { --page: #15191f; --ink: #e6e9ec; --soft: #9aa4af; --line: #39424d;
  --band: #1d232b; --link: #6cb2ff; } }
* { box-sizing: border-box; }
body { margin: 0; background: var(--page); color: var(--ink); font: 15px/1.5 system-ui, "DejaVu Sans", sans-serif; }
main { max-width: 1000px; margin: 0 auto; padding: 28px 24px 60px; }
h1 { font-size: 26px; line-height: 1.25; margin: 0 0 4px; overflow-wrap: anywhere; }
h2 { font-size: 19px; margin: 34px 0 8px; padding-bottom: 4px; border-bottom: 1px solid var(--line); }
p { margin: 6px 0 10px; overflow-wrap: anywhere; }
a { color: var(--link); }
.soft, figcaption, caption { color: var(--soft); font-size: 13px; }
.key { display: flex; flex-wrap: wrap; gap: 10px; margin: 16px 0 4px; padding: 0; }
.key div { flex: 1 1 180px; padding: 8px 12px; background: var(--band); border: 1px solid var(--line);
  border-radius: 6px; }
.key dt { color: var(--soft); font-size: 12.5px; } .key dd { margin: 0; font-size: 16px; font-weight: 600;
  overflow-wrap: break-word; }
.verdict { border-left: 6px solid var(--mark); background: var(--band); padding: 10px 14px; margin: 12px 0;
  font-weight: 600; border-radius: 0 6px 6px 0; }
.scroll { overflow-x: auto; margin: 8px 0 14px; }
table { border-collapse: collapse; font-size: 13.5px; font-variant-numeric: tabular-nums; min-width: 62%; }
caption { text-align: left; padding: 2px 0 4px; }
th, td { padding: 3px 12px 3px 4px; border-bottom: 1px solid var(--line); text-align: left; vertical-align: top; }
th { font-weight: 600; } .num { text-align: right; white-space: nowrap; } td.wide { overflow-wrap: break-word; }
td.long { overflow-wrap: anywhere; min-width: 11em; }
tr.mark td { background: rgba(86, 180, 233, 0.22); }
figure { margin: 10px 0 18px; break-inside: avoid; } .plot { width: 100%; } figcaption { margin-top: 6px; }
ul { margin: 4px 0 10px; padding-left: 22px; } li { margin: 2px 0; overflow-wrap: anywhere; }
code { font-family: ui-monospace, "DejaVu Sans Mono", monospace; font-size: 0.92em; }
@media print {
  :root { color-scheme: light; --page: #ffffff; --ink: #000000; --soft: #444444; --line: #bbbbbb; --band: #f4f4f4; }
  @page { size: A4; margin: 14mm 13mm; }
  main { max-width: none; padding: 0; } body { font-size: 10.5pt; } table { font-size: 9pt; }
  h2 { break-after: avoid; } tr { break-inside: avoid; } .scroll { overflow: visible; }
  .key div, .verdict, tr.mark td { print-color-adjust: exact; -webkit-print-color-adjust: exact; }
}
"""

# Figures are kept in both versions; plotly does not follow the page. On paper they are light and as wide as the text.
_SCRIPT = """
"use strict";
const figures = JSON.parse(document.getElementById("figures").textContent);
const night = window.matchMedia("(prefers-color-scheme: dark)");
const PAPER_PX = 680;
function draw(dark, paper) {
  for (const figure of figures) {
    const drawn = dark ? figure.dark : figure.light;
    const layout = Object.assign({}, drawn.layout, { height: figure.height });
    if (paper) layout.width = Math.min(PAPER_PX, figure.width); else layout.autosize = true;
    Plotly.react(figure.id, drawn.data, layout, { displayModeBar: false, responsive: !paper });
  }
}
draw(night.matches, false);
night.addEventListener("change", () => draw(night.matches, false));
window.addEventListener("beforeprint", () => draw(false, true));
window.addEventListener("afterprint", () => draw(night.matches, false));
"""


@dataclass(frozen=True)
class Figure:
    """A figure in both versions, with what is to be seen in it. `draw(dark)` makes it."""

    draw: Callable[[bool], go.Figure]
    caption: str
    height_px: int = 360
    width_px: int = 1000  # at the most


def paragraph(sentence: object, *, soft: bool = False) -> str:
    """A sentence or several."""
    return f"<p{' class=soft' if soft else ''}>{_markup(sentence)}</p>"


def bullets(sentences: Iterable[object]) -> str:
    """A plain list."""
    return "<ul>" + "".join(f"<li>{_markup(s)}</li>" for s in sentences) + "</ul>"


def table(
    headers: Sequence[object],
    rows: Iterable[Sequence[object]],
    *,
    caption: str = "",
    left: Sequence[int] = (0,),
    mark: int | None = None,
) -> str:
    """A table: the columns in `left` hold words, the others numbers; row `mark` is emphasised."""

    def cell(tag: str, column: int, value: object, more: str = "") -> str:
        kind = "num"
        if column in left:
            kind = "wide long" if max(map(len, str(value).split()), default=0) > LONG_NAME else "wide"
        return f'<{tag} class="{kind}"{more}>{_markup(value)}</{tag}>'

    head = "".join(cell("th", i, h, ' scope="col"') for i, h in enumerate(headers))
    body = "".join(
        f"<tr{' class=mark' if number == mark else ''}>"
        + "".join(cell("td", i, v) for i, v in enumerate(row))
        + "</tr>"
        for number, row in enumerate(rows)
    )
    named = f"<caption>{text(caption)}</caption>" if caption else ""
    return (
        f'<div class="scroll"><table>{named}<thead><tr>{head}</tr></thead><tbody>{body}</tbody></table></div>'
    )


def facts(pairs: Iterable[tuple[str, object]]) -> str:
    """Name and value, a row each."""
    rows = "".join(
        f'<tr><th scope="row">{text(name)}</th><td class="wide">{_markup(value)}</td></tr>'
        for name, value in pairs
    )
    return f'<div class="scroll"><table><tbody>{rows}</tbody></table></div>'


def key_figures(pairs: Iterable[tuple[str, object]]) -> str:
    """A few numbers to be seen first."""
    return (
        '<dl class="key">'
        + "".join(f"<div><dt>{text(n)}</dt><dd>{_markup(v)}</dd></div>" for n, v in pairs)
        + "</dl>"
    )


def verdict(sentence: object, colour: str) -> str:
    """The answer, marked with a colour of the palette (never one from outside)."""
    return f'<div class="verdict" style="--mark:{colour}">{_markup(sentence)}</div>'


def page(title: str, head: str, sections: Sequence[tuple[str, Sequence[str | Figure]]]) -> str:
    """The whole page: a head, then sections of markup and figures."""
    number = count(1)
    described: list[tuple[str, Figure]] = []
    parts = [f"<h1>{text(title)}</h1>", head]
    for heading, contents in sections:
        parts.append(f"<section><h2>{text(heading)}</h2>")
        for part in contents:
            if isinstance(part, Figure):
                name = f"figure{next(number)}"
                described.append((name, part))
                parts.append(
                    f'<figure><div class="plot" id="{name}" role="img" aria-label="{text(part.caption)}" '
                    f'style="height:{part.height_px}px;max-width:{part.width_px}px"></div><figcaption>{text(part.caption)}</figcaption></figure>'
                )
            else:
                parts.append(part)
        parts.append("</section>")
    data = ",".join(
        f'{{"id":"{name}","height":{figure.height_px},"width":{figure.width_px},"light":{_json(figure.draw(False))},'
        f'"dark":{_json(figure.draw(True))}}}'
        for name, figure in described
    )
    return (
        f'<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8">{MARK}\n'
        f'<meta http-equiv="Content-Security-Policy" content="{_POLICY}">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f"<title>{text(title)}</title><style>{_STYLE}</style></head>\n<body><main>\n"
        + "\n".join(parts)
        + "\n<noscript><p>The figures need JavaScript; all numbers are in the tables.</p></noscript></main>\n"
        f'<script type="application/json" id="figures">[{data}]</script>\n'
        f"<script>{get_plotlyjs()}</script>\n<script>{_SCRIPT}</script></body></html>\n"
    )


def _markup(value: object) -> str:
    return value if isinstance(value, Html) else text(value)


def _json(figure: go.Figure) -> str:
    """A figure as JSON that cannot end the script that it stands in."""
    dumped = str(figure.to_json())
    for character in "<>&\u2028\u2029":
        dumped = dumped.replace(character, f"\\u{ord(character):04x}")
    return dumped
