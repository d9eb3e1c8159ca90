"""Hidden characters of a text are visible wherever it is shown."""

from __future__ import annotations

import json

import pytest

from calib.errors import is_one_line, printable, visible
from calib.html_text import escape, visible_value
from calib.strict_json import to_json
from calib.text_files.csv_text import rows_csv

HIDDEN = {
    "an escape sequence of a terminal": ("\x1b[31m", "\\x1b[31m"),
    "a bell": ("\a", "\\x07"),
    "C1": ("\x9b31m", "\\x9b31m"),
    "an override of direction": ("\u202e", "\\u202e"),
    "an isolate": ("\u2066", "\\u2066"),
    "a zero-width space": ("\u200b", "\\u200b"),
    "a joiner between Latin letters": ("\u200d", "\\u200d"),
    "a byte order mark": ("\ufeff", "\\ufeff"),
    "a soft hyphen": ("\u00ad", "\\xad"),
    "a tag": ("\U000e0041", "\\U000e0041"),
    "a line separator": ("\u2028", "\\u2028"),
    "a Hangul filler": ("\u3164", "\\u3164"),
    "a joiner of marks": ("\u034f", "\\u034f"),
    "an empty Braille cell": ("\u2800", "\\u2800"),
    "half a pair": ("\ud800", "\\ud800"),
}
NAMES = [
    "p01",
    "über größer",
    "Gelenk Ⅲ",
    "می\u200cخواهم",
    "क्\u200dष",
    "腕 1",
    "α → β",
    "⚙\ufe0f",
    "a\u00a0b",
]


@pytest.mark.parametrize("name", HIDDEN)
def test_what_is_hidden_becomes_an_escape_everywhere(name: str) -> None:
    hidden, escaped = HIDDEN[name]
    text = f"a{hidden}b"
    assert not is_one_line(text)
    for told in (visible(text), printable(text), escape(text), visible_value(text)):
        assert told == f"a{escaped}b"
    document = to_json({text: [text]})
    assert hidden not in document
    assert json.loads(document) == {text: [text]}
    assert rows_csv([["x", text]]) == f"x,a{escaped}b\n"


@pytest.mark.parametrize("name", NAMES)
def test_names_of_any_language_stay(name: str) -> None:
    assert is_one_line(name)
    assert visible(name) == printable(name) == escape(name) == name
    assert rows_csv([["x", name]]) == f"x,{name}\n"
    assert json.loads(to_json({"name": name})) == {"name": name}


def test_ends_of_lines_stay_where_lines_are() -> None:
    assert visible("a\nb\tc") == "a\nb\\tc"
    assert escape("a\n<b>\t") == "a\n&lt;b&gt;\t"
    assert rows_csv([["a\nb"]]) == '"a\nb"\n'
