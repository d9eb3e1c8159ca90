"""Equations become MathML while the pages are built, so that a page needs no script and no network to show them.

A command that the converter does not know is a warning, which `./run docs` takes for a failure: without it a reader
would see the name of the command in the equation.
"""

from __future__ import annotations

import html
import re
from typing import Any

from docutils import nodes
from latex2mathml.converter import convert
from latex2mathml.exceptions import NoAvailableTokensError
from sphinx.application import Sphinx
from sphinx.util import logging
from sphinx.util.math import get_node_equation_number

logger = logging.getLogger(__name__)

REWRITTEN = (  # what the converter lacks, by what it has
    (re.compile(r"\\(begin|end)\{aligned\}"), r"\\\1{split}"),
    (re.compile(r"\\operatorname\*"), r"\\operatorname"),
    (re.compile(r"\\mathrm\{([A-Za-z0-9]+)\}"), r"\\text{\1}"),  # else a single letter would be slanted
    (re.compile(r"\\arg(?![a-zA-Z])"), r"\\operatorname{arg}"),
    (re.compile(r"\\sim(?![a-zA-Z])"), "∼"),
    (re.compile(r"\\([lr])vert(?![a-zA-Z])"), r"|"),
)
UNKNOWN = re.compile(r"\\[A-Za-z]+")
# Browsers know one mathvariant, "normal"; of the others the letters themselves exist in Unicode.
VARIANT = re.compile(r'<mi mathvariant="bold-italic">&#x0*([0-9A-Fa-f]+);</mi>')
GREEK_SMALL, GREEK_CAPITAL = 0x1D736, 0x1D71C  # bold italic alpha, bold italic Alpha


def _bold_italic(match: re.Match[str]) -> str:
    code = int(match[1], 16)
    if 0x3B1 <= code <= 0x3C9:
        code += GREEK_SMALL - 0x3B1
    elif 0x391 <= code <= 0x3A9:
        code += GREEK_CAPITAL - 0x391
    return f"<mi>&#x{code:X};</mi>"


def mathml(latex: str, *, display: bool) -> tuple[str, str]:
    """An equation as `<math>`, with its source as alternative text, and what of it is not understood, else ""."""
    source = latex.strip()
    for pattern, instead in REWRITTEN:
        source = pattern.sub(instead, source)
    if display and re.search(r"\\\\", source) and r"\begin" not in source:
        source = rf"\begin{{split}}{source}\end{{split}}"
    try:
        made = convert(source, display="block" if display else "inline")
    except (NoAvailableTokensError, ValueError, IndexError, KeyError, TypeError, AttributeError) as error:
        return f"<code>{html.escape(latex)}</code>", f"{type(error).__name__}: {error}"
    except Exception as error:  # the converter's own, one class for each mistake
        return f"<code>{html.escape(latex)}</code>", f"{type(error).__name__}"
    unknown = UNKNOWN.findall(re.sub(r"<[^>]*>", " ", made))
    made = VARIANT.sub(_bold_italic, made)
    words = html.escape(" ".join(latex.split()), quote=True)
    return made.replace("<math ", f'<math alttext="{words}" ', 1), ", ".join(unknown)


def _checked(node: nodes.Node, latex: str, *, display: bool) -> str:
    made, fault = mathml(latex, display=display)
    if fault:
        logger.warning("not understood in an equation: %s", fault, location=node, type="mathml")
    return made


def visit_math(self: Any, node: nodes.math) -> None:
    """An equation in a line."""
    self.body.append(self.starttag(node, "span", "", CLASS="math notranslate nohighlight"))
    self.body.append(_checked(node, node.astext(), display=False) + "</span>")
    raise nodes.SkipNode


def visit_displaymath(self: Any, node: nodes.math_block) -> None:
    """An equation of its own, with its number and a link to it where it has a label."""
    self.body.append(self.starttag(node, "div", CLASS="math notranslate nohighlight"))
    self.body.append(_checked(node, node.astext(), display=True))
    if node.get("number"):
        self.body.append(f'<span class="eqno">({get_node_equation_number(self, node)})')
        self.add_permalink_ref(node, "Link to this equation")
        self.body.append("</span>")
    self.body.append("</div>\n")
    raise nodes.SkipNode


def setup(app: Sphinx) -> dict[str, bool]:
    """Name the renderer; conf.py chooses it."""
    app.add_html_math_renderer("mathml", (visit_math, None), (visit_displaymath, None))
    return {"parallel_read_safe": True, "parallel_write_safe": True}
