"""A page for each effect of the catalogue, and their index, written while the documentation is built.

All that a page says is read from the effect's class and computed by the project's screening on a standard arm
(`effect_signatures`), so that an effect has its page as soon as it is in the catalogue. The pages and the content of
their index go to `docs/generated/effects`.
"""

from __future__ import annotations

import inspect
import math
import re
import sys
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from effect_arm import arm_picture
from effect_curves import curve_picture, small_picture
from effect_signatures import CONFUSED, POSES, Signature, Standard
from sphinx.application import Sphinx

from calib.effects.catalogue import CATALOGUE
from calib.effects.effect import CatalogueEffect, full_name

ROOM = "/generated/effects"
INDEX = "index.inc"
ANY_INPUT = (
    (r"joint \d+", "a joint"),
    (r"^\d+ times q\d+", "many times a joint's angle"),
    (r"^q\d+ [+-] q\d+", "the sum or difference of two joints' angles"),
    (r"tool's [xyz]", "tool's x, y or z"),
    (r"^(x|y|depth) in", "place in"),
    (r"^turn that .*", "the effect's own size"),
)
"""From the input of a picture to the inputs that are like it."""


def write_pages(folder: Path) -> tuple[str, ...]:
    """Write the pages and the content of their index into a folder; the names of the effects, in order.

    A page that is unchanged is not written again, so that Sphinx does not read it again.
    """
    standard = Standard.made()
    signatures = {kind.name: standard.signature(kind.name) for kind in CATALOGUE}
    folder.mkdir(parents=True, exist_ok=True)
    for kind in CATALOGUE:
        _write(folder / f"{kind.name}.md", page(kind, signatures[kind.name], standard))
    _write(folder / INDEX, index(signatures, standard))
    return tuple(signatures)


def page(kind: type[CatalogueEffect], signature: Signature, standard: Standard) -> str:
    """The page of one effect, in MyST."""
    parts = [
        f"# {kind.name}",
        inspect.getdoc(kind) or "",
        _figure(arm_picture(signature, standard), _arm_words(signature)),
        "## Law",
        f"```text\n{kind.equation}\n```",
        inspect.cleandoc(kind.notes),
        "## Parameters",
        _parameters(signature),
        _bounds(kind),
        "## What its residual looks like",
        _figure(curve_picture(signature, standard), _left_words(signature)),
        "## What it needs, and how to confirm it",
        f"- Needs: {kind.needs}.\n- To confirm it: {kind.confirm or 'nothing is known that shows it alone'}."
        + ("" if kind.testable else "\n- It cannot be tested by poses alone; the output says so."),
        "## What it is confused with",
        _alike(signature),
        "## Try it",
        f"Simulate an arm that has this effect, of a random size, and diagnose it:\n\n```sh\n"
        f"inspector simulate try --robot rb5 --effect {kind.name} --seed 1\ninspector diagnose try\n```",
        "## In the code",
        _code(kind),
    ]
    return "\n\n".join(part for part in parts if part) + "\n"


def index(signatures: Mapping[str, Signature], standard: Standard) -> str:
    """What the index shows: the small pictures with their links, and the table."""
    groups: dict[str, list[type[CatalogueEffect]]] = {}
    for kind in CATALOGUE:
        heading = (sys.modules[kind.__module__].__doc__ or kind.__module__).partition(":")[0]
        groups.setdefault(heading, []).append(kind)
    out = []
    for heading, kinds in groups.items():
        cards = [
            f"::::{{grid-item-card}} {kind.name}\n:link: {ROOM}/{kind.name}\n:link-type: doc\n\n"
            f"{_raw(small_picture(signatures[kind.name], standard))}\n\nover {signatures[kind.name].input.label}\n::::"
            for kind in kinds
        ]
        out += [
            f"## {heading}",
            ":::::{grid} 2 3 3 3\n:gutter: 2\n\n" + "\n\n".join(cards) + "\n:::::",
        ]
    by_input: dict[tuple[str, str], list[str]] = {}
    for kind in CATALOGUE:
        words = signatures[kind.name].input.words
        for pattern, instead in ANY_INPUT:
            words = re.sub(pattern, instead, words)
        if not np.any(signatures[kind.name].after_mm):
            continue
        link = f"{{doc}}`{kind.name} <{ROOM}/{kind.name}>`"
        tested = "yes" if signatures[kind.name].input.is_tested else "no"
        by_input.setdefault((words, tested), []).append(link)
    out += [
        "## By the input that the residual depends on",
        "`inspector diagnose` names it: *It depends systematically on gravity's torque on joint 3*. These are the "
        "inputs of the pictures. Where an input is not among those tested, the effect is still found, by its own "
        "columns.",
        "\n".join(
            ["| input | is tested | effects |", "|---|---|---|"]
            + [f"| {words} | {tested} | {', '.join(links)} |" for (words, tested), links in by_input.items()]
        ),
    ]
    rows = [
        f"| {{doc}}`{kind.name} <{ROOM}/{kind.name}>` | {_cell(kind.equation)} | {_cell(kind.needs)} | "
        f"{100 * signatures[kind.name].left:.0f}\N{NO-BREAK SPACE}% |"
        for kind in CATALOGUE
    ]
    out += [
        "## All of them",
        "*Left* is the share of the effect's size that remains, on that arm, after a fit of link errors and scanner "
        "frame.",
        "\n".join(["| effect | law | needs | left |", "|---|---|---|---|", *rows]),
        "```{toctree}\n:hidden:\n\n" + "\n".join(f"{ROOM}/{kind.name}" for kind in CATALOGUE) + "\n```",
    ]
    return "\n\n".join(out) + "\n"


def _figure(svg: str, words: str) -> str:
    return _raw(f'<figure style="margin:0;overflow-x:auto">{svg}</figure>') + f"\n\n*{words}*"


def _raw(html: str) -> str:
    return f"```{{raw}} html\n{html}\n```"


def _arm_words(signature: Signature) -> str:
    before, after = signature.rms_mm
    joint = getattr(signature.member, "joint", None)
    where = "" if joint is None else f" of joint {joint + 1}"
    return (
        f"The built-in RB5 with this effect{where}, its parameters at their usual sizes: the target moves by "
        f"{before:.2g} mm RMS over {POSES} poses; {after:.2g} mm of that remain after a fit of link errors and scanner "
        "frame."
    )


def _left_words(signature: Signature) -> str:
    shown = f"{signature.channel.label.split(',')[0]} over {signature.input.words}"
    if not np.any(signature.after_mm):
        return f"{shown[0].upper() + shown[1:]}. Nothing is left: link errors and the scanner frame do the same."
    return (
        f"{shown[0].upper() + shown[1:]}: the effect alone, and the part that remains after a fit of the link "
        f"errors, {100 * signature.left:.0f} % of its size. Without noise."
    )


def _parameters(signature: Signature) -> str:
    rows = [
        f"| `{full_name(signature.member, p)}` | {_size(p.scale, p.unit)} | {_cell(p.doc)}"
        f"{'; not below 0' if p.positive else ''} |"
        for p in signature.member.parameters
    ]
    return "\n".join(
        [
            "The parameters of the member in the pictures. The usual size is the one that the evidence expects; ten "
            "times that size costs half a nat of log evidence, a hundred times two nats.",
            "",
            "| parameter | usual size | is |",
            "|---|---|---|",
            *rows,
        ]
    )


def _bounds(kind: type[CatalogueEffect]) -> str:
    if not kind.bounds:
        return ""
    rows = [f"| {_size(b.size, b.unit)} | {_cell(b.source)} |" for b in kind.bounds]
    return "\n".join(
        [
            "A value beyond these bounds by more than two sigmas is reported with a warning:",
            "",
            "| largest plausible value | source |",
            "|---|---|",
            *rows,
        ]
    )


def _size(value: float, unit: str) -> str:
    return f"{value:.3g} {unit}" + (f" ({math.degrees(value):.2g}°)" if unit == "rad" else "")


def _alike(signature: Signature) -> str:
    if not np.any(signature.after_mm):
        return "Link errors and the scanner frame: nothing is left after they are fitted."
    if not signature.alike:
        return (
            f"At these {POSES} poses no other effect of the catalogue explains {100 * CONFUSED:.0f} % of what is left "
            "of it after that fit."
        )
    rows = [f"| {{doc}}`{name}` | {100 * share:.0f} % |" for name, share in signature.alike]
    return "\n".join(
        [
            "The share of what is left (sum of squares, at the arm and poses of the pictures) that another effect "
            "explains with free sizes. From 50 % on the two are confounded: an effect is named only if its log Bayes "
            "factor over the other exceeds 3.",
            "",
            "| effect | explains |",
            "|---|---|",
            *rows,
        ]
    )


def _code(kind: type[CatalogueEffect]) -> str:
    module = kind.__module__.replace(".", "/") + ".py"
    return f"`{kind.__name__}` in `{module}`. Its simulated truth, in `calib/simulation/truth`, shares no code with it."


def _cell(words: str) -> str:
    return words.replace("|", "\\|").replace("*", "\\*").replace("_", "\\_").replace("<", "&lt;")


def _write(path: Path, text: str) -> None:
    if not path.is_file() or path.read_text(encoding="utf-8") != text:
        path.write_text(text, encoding="utf-8")


def _on_start(app: Sphinx) -> None:
    source = Path(app.srcdir)
    write_pages(source / ROOM.strip("/"))


def setup(app: Sphinx) -> dict[str, bool]:
    """Write the pages before Sphinx looks for them."""
    app.connect("builder-inited", _on_start)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
