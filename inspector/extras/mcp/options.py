"""Options of `mcp`. Nothing slow is imported."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from inspector.cli.options import values
from inspector.cli.options.declaration import flag, option, several


@dataclass(frozen=True, kw_only=True)
class McpOptions:
    """These commands as tools of the Model Context Protocol, on stdin and stdout."""

    root: Sequence[Path] = several(
        "what may be read and written, with all in it (default: the working folder); several times", metavar="FOLDER"
    )
    allow_code: bool = flag("offer options that run a Python file: effects and finders of one's own")
    timeout_s: float = option("end a call after this (default 600)", 600.0, metavar="S", parse=values.seconds)
