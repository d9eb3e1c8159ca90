"""One command of a tool's call: it opens nothing outside the roots, whatever a file names or a link leads to."""

from __future__ import annotations

import json
import os
import runpy
import sys
from collections.abc import Iterable
from pathlib import Path

import calib
from calib.bounded_process import bound_this_process
from calib.served_process import LIMITS
from inspector.extras.mcp.roots import RootError

_OPENING = frozenset({"open", "os.listdir", "os.scandir"})  # events of Python's audit, with the place first
_SYSTEM = ("/usr", "/lib", "/proc", "/sys", "/dev", "/opt", "/etc/localtime", "/etc/mime.types", "/etc/fonts")


def confine(roots: Iterable[str]) -> None:
    """Raise RootError from now on wherever this process opens a file or lists a folder outside the roots.

    Python, its packages, the system's libraries and the folder for temporary files are open.
    """
    own = (*sys.path, sys.prefix, sys.base_prefix, str(Path(calib.__file__).parents[1]), os.environ.get("TMPDIR", ""))
    allowed = [Path(place).resolve() for place in (*roots, *own, *_SYSTEM) if place]

    def refuse(event: str, arguments: tuple[object, ...]) -> None:
        if event not in _OPENING or not isinstance(arguments[0], str | bytes | os.PathLike):
            return
        place = Path(os.fsdecode(arguments[0]))
        if not any(map(place.resolve().is_relative_to, allowed)):
            raise RootError(f"{place}: is outside of what may be read and written here (mcp --root)")

    sys.addaudithook(refuse)


if __name__ == "__main__":
    _, given, *words = sys.argv
    sys.argv = ["inspector", *words]
    bound_this_process(LIMITS)
    confine(json.loads(given))
    runpy.run_module("inspector", run_name="__main__")
