"""Size of the code as a reader meets it: tokens without comments, docstrings and layout.

    python -m tests.support.tokens [FOLDER]

prints what core, extras, tests and benchmarks have beside the budget of pyproject.toml, and each room of the packages.
"""

from __future__ import annotations

import ast
import sys
import tokenize
import tomllib
from collections import Counter
from pathlib import Path

ROOT = Path(__file__).parents[2]
_LAYOUT = frozenset(
    {
        tokenize.COMMENT,
        tokenize.NL,
        tokenize.NEWLINE,
        tokenize.INDENT,
        tokenize.DEDENT,
        tokenize.ENCODING,
        tokenize.ENDMARKER,
    }
)
_DOCUMENTED = (ast.Module, ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef)


def tokens_of(path: Path) -> int:
    """Number of tokens of a Python file without comments, docstrings, line ends and indentation."""
    docstrings: set[int] = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, _DOCUMENTED) and ast.get_docstring(node, clean=False) is not None:
            docstrings |= set(range(node.body[0].lineno, (node.body[0].end_lineno or 0) + 1))
    with tokenize.open(path) as file:
        return sum(
            token.type not in _LAYOUT and not (token.type == tokenize.STRING and token.start[0] in docstrings)
            for token in tokenize.generate_tokens(file.readline)
        )


def part_of(name: Path) -> str:
    """The part of the budget that a file of the project counts in; "" for others."""
    if name.parts[0] in ("calib", "inspector"):
        return "extras" if name.parts[1:2] == ("extras",) else "core"
    return name.parts[0] if name.parts[0] in ("tests", "benchmarks") else ""


def counted(root: Path = ROOT) -> dict[str, int]:
    """Tokens of each part: core, extras, tests, benchmarks."""
    parts: Counter[str] = Counter(core=0, extras=0, tests=0, benchmarks=0)
    for top in ("calib", "inspector", "tests", "benchmarks"):
        for path in (root / top).rglob("*.py"):
            parts[part_of(path.relative_to(root))] += tokens_of(path)
    return dict(parts)


def budget() -> dict[str, int]:
    """Tokens that each part may have at most, from pyproject.toml."""
    found: dict[str, int] = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["tool"]["budget"]
    return found


def _rooms(root: Path) -> Counter[str]:
    rooms: Counter[str] = Counter()
    for top in ("calib", "inspector"):
        for path in (root / top).rglob("*.py"):
            parts = path.relative_to(root).parts[:-1]
            rooms["/".join(parts[: 3 if parts[1:2] == ("extras",) else 2])] += tokens_of(path)
    return rooms


if __name__ == "__main__":
    folder = Path(sys.argv[1]) if len(sys.argv) > 1 else ROOT
    allowed = budget()
    for part, count in counted(folder).items():
        print(f"{part:28} {count:9,} of {allowed[part]:,}")
    for room, count in _rooms(folder).most_common():
        print(f"{room:28} {count:9,}")
