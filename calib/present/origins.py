"""Presentation of a result's origin, and of its files held against those of a dataset."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from calib.dataset.files.origin import SAME, Origin, Verified, command_text
from calib.present.results import document, keys_of, presentation
from calib.rendering import numbers
from calib.rendering.blocks import Block, Facts, Presentation, Table, Verdict
from calib.rendering.colours import DOUBT, GOOD


def origin_blocks(origin: Origin) -> list[Block]:
    """Blocks on who made a result, by which command, of which files."""
    caption = "Files that it was made of; `inspector verify` holds them against a dataset's"
    return [Facts(_who(origin)), Table(("file", "SHA-256"), list(origin.files.items()), caption=caption, left=(0, 1))]


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
    others = {file.path: file.state for file in verified.files if file.state != SAME}
    words = f"made of exactly these {len(verified.files)} files"
    if others:
        words = f"not of these files: {numbers.listing(list(others))}"
    verdict = Verdict(f"{verified.path}: {words}.", DOUBT if others else GOOD)
    table = Table(("file", "now"), list(others.items()), left=(0, 1))
    return Presentation(verified.path, [verdict, Facts(facts), table])


@document.register
def _verified_document(verified: Verified) -> dict[str, Any]:
    return {
        **keys_of(verified, "path", "files", "same_program"),
        "same": verified.is_same,
        **keys_of(verified.origin, "made", "by", "command", "program_version"),
    }


def verified_document(results: Sequence[Verified]) -> dict[str, Any]:
    """Document that `inspector verify --json` prints."""
    return {"same": all(verified.is_same for verified in results), "results": results}
