"""Presentation of identifiability: redundant groups, the rank, and the tool row."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from calib.identifiability.redundancy import Redundancy
from calib.identifiability.structural import FreeFrameRank
from calib.identifiability.tool_rows import ToolRows
from calib.present import names
from calib.present.results import document, keys_of, presentation
from calib.rendering import numbers
from calib.rendering.blocks import (
    Block,
    Bullets,
    Facts,
    FigurePlace,
    Paragraph,
    Presentation,
    Section,
    Span,
    Words,
    joined,
)

HEADING = "Which parameters can be known"
_CAPTION = "Pearson's r between the columns of the nominal Jacobian; grey: no influence."
_WITHOUT_ATTITUDE = {"pose": "the jig may sit on the tool anyhow", "position": "a point has a place and no attitude"}


@presentation.register
def _redundancy(analysis: Redundancy) -> Presentation:
    return Presentation(HEADING, redundancy_section(analysis).blocks)


def redundancy_section(analysis: Redundancy) -> Section:
    """Section with the sentences and the figure on redundancy."""
    figure = FigurePlace("redundancy_heatmap", (analysis,), _CAPTION, height_px=620, width_px=660)
    return Section(HEADING, [*redundancy_blocks(analysis), figure])


def redundancy_blocks(analysis: Redundancy) -> list[Block]:
    """Blocks with the counts, and a sentence for each group of parameters that only act together."""
    facts: list[tuple[str, object]] = [
        ("parameters", len(analysis.parameters)),
        ("without influence", len(analysis.no_influence)),
        ("kept by pairs (Park)", len(analysis.kept)),
        ("can be known (rank)", analysis.rank),
        ("these carry all that can be known", names.parameters(analysis.independent)),
    ]
    seen_by = f"Seen by {analysis.measured_by}." if analysis.measured_by else ""
    return [Paragraph(seen_by, soft=True), Facts(facts), Bullets(redundancy_sentences(analysis))]


def redundancy_sentences(analysis: Redundancy) -> list[Words]:
    """Sentences on each redundant group, on parameters without influence, and on sums of three or more that cancel."""
    sentences: list[Words] = [_group(analysis, group) for group in (*analysis.groups, *analysis.mixed_groups)]
    if analysis.no_influence:
        sentences.append((f"No influence on {analysis.observed}: ", *names.parameters(analysis.no_influence), "."))
    return [*sentences, *map(_cancelling, analysis.combinations)]


def _group(analysis: Redundancy, group: Sequence[str]) -> Words:
    row = {name: k for k, name in enumerate(analysis.parameters)}
    if len({analysis.units[row[name]] for name in group}) == 1:
        total: list[Span] = [names.parameter(group[0])]
        for name in group[1:]:
            same = analysis.pearson[row[group[0]], row[name]] > 0
            total += [" + " if same else f" {numbers.MINUS} ", names.parameter(name)]
    else:
        total = ["one weighted sum of them"]
    listed = names.parameters(group, "and")
    kept = names.parameter(group[0])
    return (*listed, " are indistinguishable: only ", *total, " can be known; keep ", kept, ".")


def _cancelling(relation: Mapping[str, float]) -> Words:
    terms: list[Span] = []
    for name, value in relation.items():
        terms += [f" {value:+.6g} ".replace("-", numbers.MINUS), names.parameter(name)]
    return ("Corrections in the ratio", *terms, " cancel each other (mm and rad), although no two of them do.")


def free_frame_sentence(unknown: FreeFrameRank) -> str:
    """Sentence on the number of identifiable parameters with an unknown scanner frame, at these poses and at best."""
    best, residual = unknown.best[unknown.residual], unknown.residual
    kinds = "full poses" if residual == "pose" else "positions"
    here = f"determine {unknown.here} parameters at these poses, and {best} at best (this arm at generic poses)"
    if unknown.on_flange:
        return (
            f"With the scanner's place on the flange unknown, {kinds} {here}, the targets' places in the room among "
            "them. What moves the flange alone, or the base together with the targets, cannot be separated: errors of "
            "the last row of the arm and of the tool are taken up by the scanner's place, those at the base by the "
            "targets'."
        )
    if residual in ("position", "pose"):
        option = " --residual pose" if residual == "pose" else ""
        return f"With the scanner's place unknown, as `calibrate{option}` has it, {kinds} {here}."
    return (
        f"At best, this arm at generic poses, such distances determine {best} parameters; positions from an unknown "
        f"scanner's place {unknown.best['position']}, full poses {unknown.best['pose']}."
    )


def tool_sentence(tool: ToolRows) -> Words:
    """Sentence on the identifiability of the tool row ([tool] of robot.toml)."""
    if tool.point:
        place, stay = names.parameters(tool.point), names.parameters(tool.unseen)
        return (
            "Tool: the measured point is one of its own, ",
            *place,
            " in the last joint's frame; how the tip sits behind the last joint's axis is not known, as "
            f"{_WITHOUT_ATTITUDE['position']}: ",
            *stay,
            " stay as in robot.toml.",
        )
    parts: list[Words] = []
    if tool.known:
        parts.append(("known each alone: ", *names.parameters(tool.known)))
    if tool.sums:
        sums = [(names.parameter(one), " (with ", *names.parameters(of), ")") for one, of in tool.sums.items()]
        parts.append(("known in sums only: ", *joined(sums, ", ")))
    if tool.unseen:
        why = _WITHOUT_ATTITUDE.get(tool.residual, _WITHOUT_ATTITUDE["position"])
        why = "a scanner on the flange does not see the tool" if tool.on_flange else why
        parts.append((f"not known, as {why}: ", *names.parameters(tool.unseen), ", which stay as in robot.toml"))
    return ("Tool: ", *joined(parts), ".")


@document.register
def _redundancy_document(analysis: Redundancy) -> dict[str, Any]:
    return {
        "seen_by": analysis.measured_by,
        **keys_of(analysis, "parameters", "pearson", "no_influence", "groups", "mixed_groups"),
        **keys_of(analysis, "rank", "kept", "independent", "dropped"),
        "combinations": [{"parameters": relation} for relation in analysis.combinations],
    }


def redundancy_document(analysis: Redundancy, unknown: FreeFrameRank) -> dict[str, Any]:
    """Document that `redundancy --json` prints: redundant parameters and rank, also with an unknown scanner frame."""
    return {
        "residual": unknown.residual,
        **document(analysis),
        "rank_unknown_frame": unknown.best[unknown.residual],
        "rank_unknown_frame_here": unknown.here,
    }
