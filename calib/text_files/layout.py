"""Layout of a table of text: separator, way of writing numbers, and where its names and rows begin.

People and instruments write titles, comments, units and groups of names above and below the names of the columns.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from statistics import median

from calib.text_files.column_names import UNITS
from calib.text_files.csv_text import as_number, lines_of

_SEPARATORS = (",", ";", "\t")
_COMMENT = re.compile(r"^\s*(?:#|//|%(?=\s))\s*")
_SEPARATOR_LINE = re.compile(r"^\s*\"?sep=(?P<separator>.)\"?\s*$", re.IGNORECASE)  # for a spreadsheet program
_SAMPLE = 200  # lines and rows by which a layout is judged
_BEGINNING = 100_000  # characters in which titles and comments are
_COMMA_NUMBER = re.compile(r"[+-]?\d*,\d+(?:[eE][+-]?\d+)?")
_DECIMAL_COMMA = re.compile(r"[+-]?(?:\d{4,}|\d{1,3}(?:[ .'’]\d{3})+|\d*),\d+(?:[eE][+-]?\d+)?")
_EITHER_COMMA = re.compile(r"[+-]?[1-9]\d{0,2},\d{3}")  # 1,234 is one or a thousand
_COMMA_GROUPS = re.compile(r"[+-]?\d{1,3}(?:(?:,\d{3})+\.\d+|(?:,\d{3}){2,})")
_GROUPS = {  # of thousands, by the decimal sign
    ".": re.compile(r"[+-]?\d{1,3}(?:[ ,'’]\d{3})+(?:\.\d*)?"),
    ",": re.compile(r"[+-]?\d{1,3}(?:[ .'’]\d{3})+(?:,\d*)?"),
}
_UNIT_CELL = re.compile(r"[\[(]?(?P<unit>[^\W\d_]{0,8}(?:/[^\W\d_]{1,4}[²2]?)?|[°%µ-][^\W\d_]{0,2}(?:/s[²2]?)?)[\])]?")
_UNITS = {*UNITS, "ms", "ns", "nm", "n", "a"}
_UNIT_BEHIND = re.compile(r"\s*[\[(][^\[\]()]+[\])]\s*$")  # a name of a group or a column
_NOT_GROUPS = ("type", "id", "parent")  # lines of Motive that name nothing
_FULL = 0.9  # of the columns are named by a line of names
_PART = 0.5
_RATES = ("frequency", "frame rate", "capture frame rate", "export frame rate")
_CAPTURES = ("trajectories", "segments", "model outputs")  # of Vicon, above their rate
_LENGTH_UNITS = {"meters": "m", "centimeters": "cm", "millimeters": "mm", "inches": "in"}

Rows = Sequence[tuple[int, list[str]]]  # line and cells


@dataclass(frozen=True)
class NumberStyle:
    """Way of writing numbers: decimal sign, and whether dots part thousands."""

    decimal: str = "."
    has_dot_groups: bool = False

    def plain(self, cell: str) -> str:
        """The cell as Python writes its number; unchanged where it holds none."""
        if cell.isalpha() or not cell or (self.decimal == "." and as_number(cell) is not None):
            return cell
        is_grouped = _GROUPS[self.decimal].fullmatch(cell) is not None
        if is_grouped and (self.decimal == "." or self.has_dot_groups or "," in cell or "." not in cell):
            cell = re.sub(r"[ '’,]" if self.decimal == "." else r"[ '’.]", "", cell)
        elif self.decimal == "." or cell.count(",") != 1:
            return cell
        plain = cell.replace(",", ".")
        return plain if as_number(plain) is not None else cell


def number_style(cells: Sequence[str], separator: str) -> NumberStyle:
    """Way in which the numbers of cells are written; the point where they do not tell."""
    with_comma = [cell for cell in cells if "," in cell]
    sure = any(_DECIMAL_COMMA.fullmatch(cell) and not _EITHER_COMMA.fullmatch(cell) for cell in with_comma)
    has_groups = any(_COMMA_GROUPS.fullmatch(cell) for cell in with_comma)
    if has_groups or not (sure or (separator == ";" and with_comma)):
        return PLAIN_NUMBERS
    return NumberStyle(",", any("." in cell and _DECIMAL_COMMA.fullmatch(cell) for cell in with_comma))


def separator_of(text: str) -> str:
    """Separator of a table of text; " " for white space.

    That of the first line, unless the lines below have fewer: then it is a title, and they tell.
    """
    lines = [line for line in text[:_BEGINNING].splitlines()[: 2 * _SAMPLE] if line.strip()]
    told = _SEPARATOR_LINE.match(lines[0]) if lines else None
    if told:
        return told["separator"]
    below = [line for line in lines if not _COMMENT.match(line)] or lines
    first, body = below[0], below[len(below) // 2 :]

    def usual(separator: str) -> float:
        return median(line.count(separator) for line in body)

    words = [line.split() for line in body]
    is_parted = any(usual(separator) >= 1 and first.count(separator) for separator in "\t;")
    if (
        not is_parted
        and median(map(len, words)) > 1
        and all(_COMMA_NUMBER.fullmatch(word) for line in words for word in line[1:])
    ):
        return " "  # with decimal commas
    best = max(_SEPARATORS, key=first.count)
    if len(below) == len(lines) and 1 <= first.count(best) <= usual(best):
        return best
    return next((each for each in ("\t", ";", ",") if usual(each) >= 1), " ")


def without_comments(text: str, separator: str) -> str:
    """Text with empty lines in place of comments at its beginning, but for one that names the columns below it."""
    if not any(map(_COMMENT.match, lines_of(text[:_BEGINNING]))) and not _SEPARATOR_LINE.match(
        text[:20].partition("\n")[0]
    ):
        return text
    lines = text.splitlines()
    k = 0
    while k < len(lines) and (not lines[k].strip() or _COMMENT.match(lines[k]) or _SEPARATOR_LINE.match(lines[k])):
        k += 1
    if k == 0 or k == len(lines):
        return text

    def cells(line: str) -> list[str]:
        return line.split() if separator == " " else line.split(separator)

    first, above = cells(lines[k]), [_COMMENT.sub("", line) for line in lines[:k]]
    name = None
    if _numbers(first):
        for i in range(k - 1, -1, -1):
            found = [cells(above[i]), above[i].split(), re.split(r"\s*,\s*", above[i])]
            name = next((cell for cell in found if len(cell) == len(first) and not _numbers(cell)), None)
            if name is not None:
                break
    kept = [""] * k
    if name is not None:
        kept[k - 1] = (" " if separator == " " else separator).join(name)
    return "\n".join([*kept, *lines[k:]])


PLAIN_NUMBERS = NumberStyle()


@dataclass(frozen=True)
class Header:
    """Names of a table's columns, and the index of the first row of values."""

    names: tuple[str, ...]  # (): there are none
    first: int
    line: int = 1  # of the names
    rate_hz: float = 0.0  # of the rows, where the lines above tell it, as those of motion capture do


def header_of(rows: Rows) -> Header:
    """Header of a table: the names above its first row of numbers, with units and groups beside them."""
    sample = rows[:_SAMPLE]
    cells = [row for _, row in sample]
    numbers = [_numbers(row) for row in cells]
    usual = median(numbers[len(numbers) // 2 :])
    width = median(sum(map(bool, row)) for row in cells[len(cells) // 2 :])
    is_body = [count > 0 and count >= _PART * usual for count in numbers]
    first = next((k for k in range(len(is_body)) if all(is_body[k : k + 2])), 1)
    if first == 0 and ((len(rows) == 1 and numbers[0] < sum(map(bool, cells[0]))) or _are_counted(cells[0])):
        first = 1
    if first == 0:
        return Header((), 0, rows[0][0])
    names = _trimmed(cells[0])
    if numbers[0] == 0 and sum(map(bool, names)) >= _FULL * width and len(set(names)) == len(names):
        units = first > 1 and _is_units(cells[1])
        return Header(_with_units(names, cells[1]) if units else tuple(names), 2 if units else 1, rows[0][0])
    at = first - 1
    while at > 0 and (_is_units(cells[at]) or sum(map(bool, cells[at])) < _PART * width):
        at -= 1
    names = _grouped(cells, at)
    if at + 1 < first and _is_units(cells[at + 1]):
        names = list(_with_units(names, cells[at + 1]))
    return replace(_captured(cells[: at + 1], names), first=first, line=rows[at][0])


def _grouped(cells: Sequence[list[str]], at: int) -> list[str]:
    """Names of a line; those that are empty or stand there several times with the groups in the lines above them."""
    names = list(cells[at])
    wanting = [not name or names.count(name) > 1 for name in names]
    for above in range(at - 1, -1, -1):
        row = cells[above][: len(names)] + [""] * (len(names) - len(cells[above]))
        label = next((cell.lower() for cell in row if cell), "")
        if not any(row[1:]) or _numbers(row):
            if label in _NOT_GROUPS:
                continue
            break
        if label in _NOT_GROUPS:
            continue
        group = ""
        for k, cell in enumerate(row):
            group = cell or group
            if wanting[k] and group:
                unit = _UNIT_BEHIND.search(group)
                behind = f" {unit[0].strip()}" if unit and not _UNIT_BEHIND.search(names[k]) else ""
                names[k] = f"{_UNIT_BEHIND.sub('', group)} {names[k]}{behind}".strip()
    return _trimmed(names)


def _captured(cells: Sequence[list[str]], names: list[str]) -> Header:
    """Header of motion capture, whose first lines tell rate and unit: Motive, Vicon, Qualisys."""
    told: dict[str, str] = {}
    for k, row in enumerate(cells):
        pairs = [(row[i].lower(), row[i + 1]) for i in range(len(row) - 1)]
        told |= {key: value for key, value in pairs if key in (*_RATES, "length units")}
        if k and not any(row[1:]) and cells[k - 1][0].lower() in _CAPTURES:
            told["frequency"] = row[0]
    unit = _LENGTH_UNITS.get(told.get("length units", "").lower(), "")
    if names[:1] == ["MARKER_NAMES"]:
        names, unit = [f"{marker} Position {axis}" for marker in names[1:] for axis in "XYZ"], "mm"
    if unit:
        names = [f"{name} [{unit}]" if re.search(r"\bPosition [XYZ]$", name) else name for name in names]
    rate = next((as_number(told[key]) for key in reversed(_RATES) if key in told), None)
    return Header(tuple(names), 0, rate_hz=rate or 0.0)


def _with_units(names: Sequence[str], units: Sequence[str]) -> tuple[str, ...]:
    """Names with the units of the line below them."""
    bare = [cell.strip("[]() ") for cell in units] + [""] * len(names)
    return tuple(
        f"{name} [{unit}]" if unit.strip("-/") and "[" not in name else name
        for name, unit in zip(names, bare, strict=False)
    )


def _is_units(row: Sequence[str]) -> bool:
    """Whether the cells of a line are units, half of them such as joints and points have."""
    filled = [match["unit"].lower() for cell in row if cell and (match := _UNIT_CELL.fullmatch(cell))]
    known = sum(unit in _UNITS or unit.startswith(("deg", "millim", "meter", "metre", "grad")) for unit in filled)
    return len(filled) == sum(map(bool, row)) > 0 and known >= _PART * len(filled)


def _numbers(row: Sequence[str]) -> int:
    return sum(as_number(cell) is not None for cell in row)


def _are_counted(row: Sequence[str]) -> bool:
    """Whether the numbers of a line count, as names of joints 1, 2, 3 do."""
    found = [value for cell in row if (value := as_number(cell)) is not None]
    return len(found) > 1 and len(found) < len(row) and found == [found[0] + k for k in range(len(found))]


def _trimmed(names: Sequence[str]) -> list[str]:
    names = list(names)
    while names and not names[-1]:
        names.pop()
    return names
