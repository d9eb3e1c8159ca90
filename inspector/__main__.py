"""Entry point of `python -m inspector`, the same as the command `inspector`."""

from __future__ import annotations

import io
import os
import sys
import warnings

from inspector.cli.parser import main


def command() -> int:
    """Run `inspector` as a user does: Python's warnings are shown only with -W or INSPECTOR_DEBUG."""
    for stream in (sys.stdout, sys.stderr):
        _can_write_all(stream)
    if not sys.warnoptions and not os.environ.get("INSPECTOR_DEBUG"):
        warnings.simplefilter("ignore")
        os.environ["PYTHONWARNINGS"] = "ignore"  # of the processes that search scans
    return main()


def _can_write_all(stream: object) -> None:
    """Let a stream write every character: UTF-8 into files and pipes of Windows, "?" where a terminal lacks one."""
    if isinstance(stream, io.TextIOWrapper) and stream.encoding.lower().replace("-", "") != "utf8":
        stream.reconfigure(encoding="utf-8" if os.name == "nt" else None, errors="replace")


if __name__ == "__main__":
    sys.exit(command())
