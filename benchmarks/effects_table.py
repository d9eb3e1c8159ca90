"""README's table of effects, made of the catalogue's classes.

    python benchmarks/effects_table.py            # print it
    python benchmarks/effects_table.py --renew    # write it into README.md

`tests/effects/test_one_class.py` fails where README has another one.
"""

from __future__ import annotations

import argparse
import re
from pathlib import Path

from calib.effects.catalogue import descriptions

README = Path(__file__).parents[1] / "README.md"
HEAD = "| family | how it enters | needs |\n|---|---|---|\n"


def table() -> str:
    """Rows of all families, in the catalogue's order, below their heading."""
    return HEAD + "".join(f"| `{d.name}` | {d.equation} | {d.needs} |\n" for d in descriptions())


def main() -> None:
    """Print the table, or put it into README."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--renew", action="store_true", help="write it into README.md")
    if not parser.parse_args().renew:
        print(table(), end="")
        return
    text = README.read_text(encoding="utf-8")
    renewed, count = re.subn(re.escape(HEAD) + r"(\|.*\n)*", lambda _: table(), text)
    assert count == 1, f"README.md has the heading of the table {count} times"
    README.write_text(renewed, encoding="utf-8")


if __name__ == "__main__":
    main()
