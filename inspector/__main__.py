"""Entry point of `python -m inspector`, the same as the command `inspector`."""

from __future__ import annotations

import os
import sys
import warnings

from inspector.cli.parser import main


def command() -> int:
    """Run `inspector` as a user does: Python's warnings are shown only with -W or INSPECTOR_DEBUG."""
    if not sys.warnoptions and not os.environ.get("INSPECTOR_DEBUG"):
        warnings.simplefilter("ignore")
        os.environ["PYTHONWARNINGS"] = "ignore"  # of the processes that search scans
    return main()


if __name__ == "__main__":
    sys.exit(command())
