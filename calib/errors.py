"""Errors about the user's input. Each carries one line: what was found, where, and what would do.

Programs catch `CalibError`; the command line turns it into that line and exit code 2.
"""

from __future__ import annotations

from unicodedata import category

MOST_CHARACTERS = 1000  # of a line that someone reads
_OF_THE_START = 0.7  # where file and place stand; the rest is for the end, which says what would do
_JOINERS = "\u200c\u200d"  # belong to names in Persian and Hindi, and turn nothing round


def is_one_line(name: str) -> bool:
    """Whether a name can stand in a line of output.

    Without line ends, control characters, and what is not seen but turns the text round it or hides in it (Unicode's
    Cc, Cf, Zl, Zp, and halves of surrogate pairs).
    """
    return name.isprintable() or not any(map(_is_hidden, name))


def shown(text: str) -> str:
    """A text as a message shows it: hidden characters escaped, each line of `MOST_CHARACTERS` at most."""
    if not text.isprintable():
        text = "".join(_escaped(c) if _is_hidden(c) and c != "\n" else c for c in text)
    if len(text) <= MOST_CHARACTERS:
        return text
    return "\n".join(map(_cut, text.split("\n")))


def _is_hidden(character: str) -> bool:
    return category(character) in ("Cc", "Cf", "Cs", "Zl", "Zp") and character not in _JOINERS


def _escaped(character: str) -> str:
    return character.encode("unicode_escape").decode("ascii")


def _cut(line: str) -> str:
    """A line with its middle left out where it is long."""
    if len(line) <= MOST_CHARACTERS:
        return line
    start = int(_OF_THE_START * MOST_CHARACTERS)
    return f"{line[:start]} [...] {line[start - MOST_CHARACTERS + 7 :]}"


class CalibError(Exception):
    """Something in the input does not allow the work to go on. Its text is as `shown` has it."""

    def __str__(self) -> str:
        return shown(super().__str__())


class DatasetError(CalibError):
    """A file of the dataset folder is missing, malformed or contradicts another."""


class ScanError(CalibError):
    """A scan cannot be read as points."""


class CornerError(CalibError):
    """No corner can be had from the scans, or too few of them."""


class ModelFileError(CalibError):
    """A model.json cannot be used."""


class FitError(CalibError):
    """The measurements cannot carry the fit that was asked for."""


class TargetError(CalibError):
    """A target cannot be had from a scan, or a finder of the user's own fails."""
