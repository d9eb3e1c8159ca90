"""Presentation of a result's origin, and of its files held against those of a dataset."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from calib.dataset.files.origin import SAME, Origin, Verified, command_text
from calib.present.results import document, presentation
from calib.rendering import numbers
from calib.rendering.blocks import Block, Facts, Presentation, Table, Verdict
from calib.rendering.colours import DOUBT, GOOD


def origin_blocks(origin: Origin) -> list[Block]:
    """Blocks on who made a result, by which command, of which files."""
    caption = "Files that it was made of; `inspector verify` holds them against a dataset's"
    files = [Table(("file", "SHA-256"), list(origin.files.items()), caption=caption, left=(0, 1))]
    return [Facts(_who(origin)), *(files if origin.files else [])]


def _who(origin: Origin) -> list[tuple[str, object]]:
    return [
        ("made by", origin.by or numbers.MISSING),
        ("command", command_text(origin.command) if origin.command else numbers.MISSING),
    ]


@presentation.register
def _verified(verified: Verified) -> Presentation:
    origin = verified.origin
    when = [("made", origin.made or numbers.MISSING), *_who(origin)]
    other = "" if verified.same_program else ", this is another"
    facts = [*when, ("program", f"{origin.program_version or numbers.MISSING}{other}")]
    rows = [(file.path, file.state) for file in verified.files if file.state != SAME]
    table = [Table(("file", "now"), rows, left=(0, 1))] if rows else []
    return Presentation(verified.path, [Verdict(_sentence(verified), DOUBT if rows else GOOD), Facts(facts), *table])


def _sentence(verified: Verified) -> str:
    others = [file.path for file in verified.files if file.state != SAME]
    if not others:
        return f"{verified.path}: made of exactly these {len(verified.files)} files."
    return f"{verified.path}: not of these files: {numbers.listing(others)}."


@document.register
def _verified_document(verified: Verified) -> dict[str, Any]:
    origin = verified.origin
    return {
        "path": verified.path,
        "same": verified.is_same,
        "files": verified.files,
        "made": origin.made,
        "by": origin.by,
        "command": origin.command,
        "program_version": origin.program_version,
        "same_program": verified.same_program,
    }


def verified_document(results: Sequence[Verified]) -> dict[str, Any]:
    """Document that `inspector verify --json` prints."""
    return {"same": all(verified.is_same for verified in results), "results": results}
