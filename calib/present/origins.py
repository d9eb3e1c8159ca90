"""What is told of a result's origin."""

from __future__ import annotations

from calib.dataset.files.origin import Origin, command_text
from calib.rendering import numbers
from calib.rendering.blocks import Block, Facts, Table


def origin_blocks(origin: Origin) -> list[Block]:
    """Blocks on who made a result, by which command, of which files."""
    command = command_text(origin.command) if origin.command else numbers.MISSING
    facts = Facts([("made by", origin.by or numbers.MISSING), ("command", command)])
    return [facts, Table(("file", "SHA-256"), list(origin.files.items()), caption="Made of these files", left=(0, 1))]
