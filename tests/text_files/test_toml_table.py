"""Untrusted TOML: time and memory for reading are bounded by the file's size."""

from __future__ import annotations

import tomllib
import tracemalloc
from pathlib import Path

import pytest

from calib.errors import DatasetError
from calib.text_files.toml_table import TomlTable

LONG = "a" + ".a" * 20_000
HOSTILE = {
    "a dotted key": f"{LONG} = 1\n",
    "a header": f"[{LONG}]\nx = 1\n",
    "a header of an array": f"[[{LONG}]]\nx = 1\n",
    "a key in an inline table": f"x = {{{LONG} = 1}}\n",
    "spaces around the dots": f"{LONG.replace('.', ' . ')} = 1\n",
    "quoted parts": f"""{'"a".' * 20_000}'a' = 1\n""",
    "empty parts": f"""{'"".' * 20_000}'' = 1\n""",
    "behind a text of several lines": f'x = """a"b""c\\"""d"""""\n{LONG} = 1\n',
    "behind a literal text that ends in quotes": f"x = {{y = '''a'''', {LONG} = 1, z = ''}}\n",
    "behind a text that ends in a backslash": f'x = "\\\\"\n{LONG} = "\\\\"\n',
    "behind a comment with a quote": f"""x = 1 # it's "\n{LONG} = 1 # '\n""",
    "behind a key in quotes": f"""'a"b' = 1\n{LONG} = "x"\n""",
    "arrays in arrays": "x = " + "[" * 10_000 + "]" * 10_000,
    "inline tables in each other": "x = " + "{a=" * 10_000 + "1" + "}" * 10_000,
    "arrays of tables in each other": "x = " + "[{a=" * 5_000 + "1" + "}]" * 5_000,
    "arrays without an end": "x = " + "[" * 10_000,
}


@pytest.mark.parametrize("name", HOSTILE)
def test_keys_of_thousands_of_parts_and_deep_nests_are_refused_before_parsing(tmp_path: Path, name: str) -> None:
    path = tmp_path / "dataset.toml"
    path.write_text(HOSTILE[name])
    tracemalloc.start()
    with pytest.raises(DatasetError, match=r"line \d: (a key of more than 20 parts|nested too deep)"):
        TomlTable.load(path)
    assert tracemalloc.get_traced_memory()[1] < 20e6
    tracemalloc.stop()


@pytest.mark.parametrize(
    "text",
    [
        'x = "' + "1." * 1000 + '"\n',
        'x = """' + "a.b\n" * 1000 + '"""\n',
        "x = '''" + "[{a.b=" * 1000 + "'''\n",
        "x = 1 # " + "[a." * 1000 + "\n",
        "x = [" + "1.5, " * 1000 + "]\n",
        "[a.b.c]\nd.e.f = {g.h = [[1.0, 2.0], [3.0, 4.0]]}\n",
        'x = "\\\\"\ny = "\\""\nz = "..................................."\n',
    ],
)
def test_dots_and_brackets_in_texts_comments_and_numbers_do_not_count(tmp_path: Path, text: str) -> None:
    path = tmp_path / "dataset.toml"
    path.write_text(text)
    assert TomlTable.load(path).data == tomllib.loads(text)


def depth(value: object) -> int:
    inside = value.values() if isinstance(value, dict) else value if isinstance(value, list) else ()
    return 1 + max(map(depth, inside), default=-1) if isinstance(value, dict | list) else 0
