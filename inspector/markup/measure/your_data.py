"""HTML of an import: kinds of the files, meanings of the columns with reasons, doubts and faults."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from calib.dataset.dataset import Dataset
from calib.dataset.input_names import quantity_of
from calib.dataset_import.columns import Meaning, meaning_of
from calib.dataset_import.plan import ImportPlan, PlannedColumn
from calib.dataset_import.questions import Question
from calib.dataset_import.user_files import UNUSED, UserFile
from calib.present.fit.dataset import first_rows, preview
from calib.rendering import numbers
from inspector.markup.parts import elements
from inspector.markup.parts.elements import Html

_MOST_FILES, _MOST_UNUSED = 12, 6  # named each
_MOST_LINES = 30
_SHOWN_NOTES = ("is read so", "misses the points", "its table is", "the measured point is at")
_DOUBT, NOTED = "#E69F00", "#56B4E9"
_REASON = "display:inline-block;min-width:12rem;white-space:normal"  # on a phone the table scrolls sideways
# As wide as the table needs; viser makes its windows 440 pixels wide.
WIDE = (
    "<style>.mantine-Modal-content:has(.inspector-import){flex:0 0 min(54rem,94vw)}"
    ".mantine-Modal-inner:has(.inspector-import){padding-inline:2vw}</style>"
    "<div class='inspector-import' tabindex='-1' data-autofocus style='outline:none'></div>"  # else a list opens itself
)
OTHER_WAY = "other way round"
CORRECT = "Correct what a column is taken for"
CORRECT_IT = f"to change it, open “{CORRECT}”"


def files_html(files: Sequence[UserFile], folder: Path) -> str:
    """HTML on the kind recognised for each file; unusable files last, in one line."""
    used = [file for file in files if file.kind not in (UNUSED, "scan")]
    scans = [file for file in files if file.kind == "scan"]
    unused = [file for file in files if file.kind == UNUSED]
    rows: list[tuple[object, object, object]] = [
        (_name(file, folder), file.kind, elements.wrapping(file.why)) for file in used[:_MOST_FILES]
    ]
    if len(used) > _MOST_FILES:
        rows.append((f"{len(used) - _MOST_FILES} more", "", ""))
    if scans:
        rows.append((f"{len(scans)} files as {_name(scans[0], folder)}", "scans", "a point cloud a pose"))
    html = elements.table(("File", "is", "seen by"), rows, left=3) if rows else ""
    if unused:
        names = [f"{_name(file, folder)} ({file.why})" for file in unused]
        html += elements.note(f"Not used: {numbers.in_short(names, _MOST_UNUSED)}.")
    return html


def _name(file: UserFile, folder: Path) -> str:
    return str(file.path.relative_to(folder)) if file.path.is_relative_to(folder) else file.path.name


def meaning_words(meaning: Meaning | None) -> str:
    """Phrase for a meaning, such as "joint 3, deg, other way round"."""
    if meaning is None or meaning.name == "ignore":
        return "–"
    if quantity_of(meaning.name) != "q":
        return f"{meaning.name}, {meaning.unit}" if meaning.unit else meaning.name
    words = [f"joint {meaning.name[1:]}"]
    words += [meaning.unit] if meaning.unit else []
    words += [OTHER_WAY] if meaning.sign < 0 else []
    words += [f"{meaning.offset:+g}"] if meaning.offset else []
    words += [f"{'less' if sign < 0 else 'and'} joint {name[1:]}" for name, sign in meaning.others]
    return ", ".join(words)


def columns_html(columns: Sequence[PlannedColumn]) -> str:
    """HTML table of the columns: first value, meaning, and reason."""
    several = len({column.table for column in columns}) > 1
    rows = [
        (
            *([column.table.name] if several else []),
            column.name,
            column.examples[0][:24] if column.examples else "",
            Html(f"<b>{elements.text(meaning_words(column.meaning))}</b>"),
            Html(f"<span style='{_REASON}'>{elements.text(column.why or 'kept as it is')}</span>"),
        )
        for column in columns
    ]
    headers = (*(["Table"] if several else []), "Column", "First value", "Taken for", "Why")
    return elements.table(headers, rows, left=5 if several else 4, height="13.5rem") if rows else ""


def plan_html(plan: ImportPlan) -> str:
    """HTML on the plan beyond the columns: faults first, then doubts, then notes."""
    html = ""
    if plan.faults:
        count = "This keeps it" if len(plan.faults) == 1 else f"These {len(plan.faults)} faults keep it"
        html += elements.heading(f"{count} from being imported")
        html += "".join(elements.alert(_here(line)) for line in plan.faults[:_MOST_LINES])
        if len(plan.faults) > _MOST_LINES:
            html += elements.note(f"... and {len(plan.faults) - _MOST_LINES} more.")
    html += "".join(elements.alert(_here(line), colour=_DOUBT) for line in plan.doubts[:_MOST_LINES])
    left_out = () if plan.content is None else plan.content.notes
    html += "".join(elements.alert(line, colour=_DOUBT) for line in left_out)
    told = [line for line in plan.notes if any(words in line for words in _SHOWN_NOTES)]
    html += "".join(elements.alert(_here(line), colour=NOTED) for line in told)
    return html


def asked_html(asked: Mapping[str, Question]) -> str:
    """HTML on what no file tells, by the field that answers it: what is taken where it stays empty."""
    if not asked:
        return ""
    rows = [(field, *map(elements.wrapping, (one.what, one.guess))) for field, one in asked.items()]
    table = elements.table(("Field", "asks for", "taken if empty"), rows, left=3)
    return elements.heading("What no file tells") + table


def preview_html(dataset: Dataset) -> str:
    """HTML on the dataset that comes out: a sentence on its poses and points, and its first rows."""
    rows = first_rows(dataset)
    table = elements.table(rows.headers, rows.rows, left=len(rows.left))
    return elements.heading(f"What comes out: {preview(dataset)}") + table


def _here(line: str) -> str:
    """Line on options of the command, reworded for the page, which has lists and fields instead of options."""
    for said, on_page in _ON_PAGE:
        line = re.sub(said, on_page, line)
    return line


def _choice(told: re.Match[str]) -> str:
    """A column's meaning as it is chosen on the page, from an option of the command."""
    meaning = meaning_of(told["meaning"])
    words = told["meaning"] if meaning is None or "*" in told["meaning"] else meaning_words(meaning)
    return f"“{words}” for {told['column']} below"


_ON_PAGE: tuple[tuple[str, str | Callable[[re.Match[str]], str]], ...] = (
    ("--map says it otherwise|tell with --map$", CORRECT_IT),
    ("' --map", "', --map"),
    ("(?:tell it|tell|say so) (?:with|by) (?=--map)", "choose "),
    (r"--map '?(?P<column>[^'=]+)=(?P<meaning>[^'\s;,)]+)'?", _choice),
    ("--map", f"“{CORRECT}”"),
    (r"--points FILE(\.csv)?", "a table of points, dropped here"),
    ("--scans FOLDER", "scans, dropped here"),
    ("give --convention", "choose it under “Table is”"),
    ("(--images or --marker-poses)", r"the command “import” with \1"),
)
"""Words on the command's options, and those of the page."""
