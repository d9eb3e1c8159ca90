"""What commands answer, for tests: text, the document of --json, the one line of a refusal."""

from __future__ import annotations

import contextlib
import io
import json
from typing import Any

import pytest

from inspector.cli.parser import main


def printed(*arguments: object, code: int = 0) -> str:
    """What `inspector` prints on stdout with these arguments, which ends with `code`."""
    out = io.StringIO()
    with contextlib.redirect_stdout(out):
        assert main([*map(str, arguments)]) == code
    return out.getvalue()


def answered(*arguments: object, code: int = 0) -> dict[str, Any]:
    """The one JSON object that `inspector` prints with these arguments and --json, which ends with `code`."""
    text = printed(*arguments, "--json", code=code)
    assert text.count("\n") == 1  # exactly one object, nothing else
    document: dict[str, Any] = json.loads(text, parse_constant=lambda name: pytest.fail(f"{name} is not JSON"))
    return document


def refused(*arguments: object) -> str:
    """The one line on stderr with which `inspector` refuses these arguments, with --json too; exit code 2."""
    for extra in ([],) if arguments[0] == "serve" else ([], ["--json"]):
        out, err = io.StringIO(), io.StringIO()
        with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
            assert main([*map(str, arguments), *extra]) == 2
        lines = [line for line in err.getvalue().splitlines() if "inspector: warning" not in line]
        assert (out.getvalue(), len(lines)) == ("", 1), err.getvalue()
        assert "internal error" not in lines[0]
    return lines[0]
