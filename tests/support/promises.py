"""A command of the inspector in this process, held to what every command promises, whatever its inputs are."""

from __future__ import annotations

import contextlib
import io
import os
import traceback
import warnings
from dataclasses import dataclass
from pathlib import Path

from calib.errors import MOST_CHARACTERS
from inspector.cli.parser import main

LONGEST_LINE = MOST_CHARACTERS + len("inspector: ")
MOST_FAULTS = 25  # lines of a list of faults
NOTES = ("inspector: warning", "inspector: note")  # lines beside an answer
PRODUCT = ("/calib/", "/inspector/")


@dataclass(frozen=True)
class Ran:
    """Exit code, output and side effects of a command."""

    code: int | None  # None: by an exception
    out: str
    err: str
    trouble: str  # "" where every promise was kept
    said: str  # the error line, or what is wrong


def files_below(folder: Path) -> dict[str, tuple[int, int]]:
    """Size and time of change of every file."""
    return {
        str(path.relative_to(folder)): (path.stat().st_size, path.stat().st_mtime_ns)
        for path in folder.rglob("*")
        if path.is_file()
    }


def ran(folder: Path, *arguments: object, outputs: tuple[Path, ...] = (), lists_faults: bool = False) -> Ran:
    """Run a command whose inputs lie in `folder`, and which may write `outputs` (files or folders) there.

    Trouble is an exception, another code than 0, 1 and 2, an error of several or of long lines, a warning of Python's
    that our code causes, an input that is changed, and a file that is left behind after an error or beside the outputs.
    `lists_faults`: an error may go on with a bounded list, a fault a line.
    """
    os.environ["INSPECTOR_DEBUG"] = "1"  # exceptions come here, with their traceback
    before = files_below(folder)
    out, err = io.StringIO(), io.StringIO()
    code: int | None = None
    with warnings.catch_warnings(record=True) as caught, contextlib.ExitStack() as stack:
        warnings.simplefilter("always")
        stack.enter_context(contextlib.redirect_stdout(out))
        stack.enter_context(contextlib.redirect_stderr(err))
        try:
            code = main([*map(str, arguments)])
        except SystemExit as ended:
            code = ended.code if isinstance(ended.code, int) else None
        except MemoryError:
            return Ran(None, out.getvalue(), err.getvalue(), "memory", traceback.format_exc()[-4000:])
        except Exception:
            return Ran(None, out.getvalue(), err.getvalue(), "traceback", traceback.format_exc()[-4000:])
    lines = [line for line in err.getvalue().splitlines() if not line.startswith(NOTES)]
    said = lines[0] if lines else ""

    def trouble(kind: str, words: str) -> Ran:
        return Ran(code, out.getvalue(), err.getvalue(), kind, words[:4000])

    if code not in (0, 1, 2):
        return trouble("code", f"exit code {code}: {said}")
    if "Traceback" in err.getvalue() or "internal error" in err.getvalue():
        return trouble("traceback", err.getvalue())
    listed = lists_faults and len(lines) <= MOST_FAULTS and all(line.startswith("  ") for line in lines[1:])
    if code == 2 and len(lines) != 1 and not listed:
        return trouble("lines", f"{len(lines)} lines: {err.getvalue()}")
    longest = max((len(line) for line in err.getvalue().splitlines()), default=0)
    if longest > LONGEST_LINE:
        return trouble("lines", f"a line of {longest} characters: {err.getvalue()[:300]}")
    ours = [w for w in caught if any(part in w.filename for part in PRODUCT)]
    if ours:
        told = ours[0]
        return trouble("python warning", f"{told.category.__name__} {told.filename}:{told.lineno}: {told.message}")
    after = files_below(folder)
    kept = {name: state for name, state in before.items() if not _is_of(folder / name, outputs)}
    if any(after.get(name) != state for name, state in kept.items()):
        return trouble("inputs", f"changed: {[n for n, s in kept.items() if after.get(n) != s]}")
    new = [name for name in after if name not in before and "__pycache__" not in name]
    stray = [name for name in new if code == 2 or not _is_of(folder / name, outputs)]
    if stray:
        return trouble("half-written", f"exit code {code}, left behind: {stray[:5]}; {said}")
    return Ran(code, out.getvalue(), err.getvalue(), "", said)


def _is_of(path: Path, outputs: tuple[Path, ...]) -> bool:
    return any(path == output or output in path.parents for output in outputs)
