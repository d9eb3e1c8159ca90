"""Presentation of a corrected robot program: each target with its move, and what was left with the reason."""

from __future__ import annotations

from typing import Any

from calib.extras.robot_programs.program_correction import ProgramCorrection, TargetMove
from calib.present.plans.correction import correction_document, gain_blocks
from calib.present.results import keys_of
from calib.rendering import numbers
from calib.rendering.blocks import Block, Paragraph, Table


def program_correction_blocks(result: ProgramCorrection) -> list[Block]:
    """Blocks on a corrected program: the correction as a whole, then its targets, then what was left."""
    moved = [
        (
            str(move.target.line),
            move.target.name,
            move.target.kind,
            numbers.column_mm(move.moved_mm),
            f"{move.moved_deg:.4f}",
            numbers.column_mm(move.uncorrected_mm),
        )
        for move in result.targets
        if move.reached
    ]
    missed = [(move.target.line, move.target.name, move.reason) for move in result.targets if not move.reached]
    left = [(each.line, each.what, each.reason) for each in result.program.left]
    unmoved = [(str(line), what, why) for line, what, why in sorted([*missed, *left])]
    reached = f"{len(moved)} of {numbers.count(len(result.targets), 'target')}"
    return [
        Paragraph(
            f"{result.program.path.name} ({result.program.language}): {reached} corrected ({result.correction.kind})."
        ),
        *(gain_blocks(result.correction) if result.ids else []),
        *([Table(_COLUMNS, moved, left=(1, 2))] if moved else []),
        *([Table(("line", "left as it is", "why"), unmoved, left=(1, 2))] if unmoved else []),
        *[Paragraph(f"{numbers.capitalised(note)}.") for note in result.notes],
    ]


_COLUMNS = ("line", "target", "kind", "moved mm", "moved °", "error without mm")


def program_correction_document(result: ProgramCorrection) -> dict[str, Any]:
    """Document that `correct --program --json` prints: that of a correction, and the program's targets."""
    document = correction_document(result.correction, result.ids)
    unknown = [move for move in result.targets if move.row is None]
    document["not_reached"] += [{"pose": move.target.name, "why": move.reason} for move in unknown]
    return document | {
        "program": {
            "language": result.program.language,
            "targets": [_target(move) for move in result.targets],
            "left": [vars(each) for each in result.program.left],
            "notes": list(result.notes),
        }
    }


def _target(move: TargetMove) -> dict[str, Any]:
    """One target as plain data; what is unknown is nan, which `--json` prints as null."""
    target = move.target
    return {
        **keys_of(target, "name", "line", "kind"),
        **keys_of(move, "reached", "moved_mm", "moved_deg", "uncorrected_mm", "reason"),
        **{key: frame and frame.name for key, frame in (("tool", target.tool), ("work", target.work))},
        "posture": move.posture or None,
    }
