"""Errors about the user's input. Each carries one line: what was found, where, and what would do.

Programs catch `CalibError`; the command line turns it into that line and exit code 2.
"""

from __future__ import annotations

from unicodedata import category

MOST_CHARACTERS = 1000  # of a line that someone reads
_OF_THE_START = 0.7  # where file and place stand; the rest is for the end, which says what would do
_JOINERS = "\u200c\u200d"  # belong between letters of Persian, Hindi and others, and hide anywhere else
_BLANK = (  # letters and marks that show nothing: fillers, joiners of marks, selectors, the empty Braille cell
    "\u034f\u115f\u1160\u17b4\u17b5\u180b\u180c\u180d\u180f\u2800\u3164\uffa0"
)


def is_one_line(name: str) -> bool:
    """Whether a name can stand in a line of output.

    Without line ends, control characters, and what is not seen but turns the text round it or hides in it (Unicode's
    Cc, Cf, Zl, Zp, and halves of surrogate pairs).
    """
    return _is_plain(name) or not any(_is_hidden(name, k) for k in range(len(name)))


def shown(text: str) -> str:
    """A text as a message shows it: hidden characters escaped, each line of `MOST_CHARACTERS` at most."""
    text = visible(text)
    if len(text) <= MOST_CHARACTERS:
        return text
    return "\n".join(map(_cut, text.split("\n")))


def visible(text: str, kept: str = "\n") -> str:
    """A text with its hidden characters as escapes, `\\u202e`, but for those `kept`."""
    if _is_plain(text):
        return text
    return "".join(_escaped(c) if c not in kept and _is_hidden(text, k) else c for k, c in enumerate(text))


def _is_plain(text: str) -> bool:
    """Whether a glance tells that nothing is hidden in it."""
    return text.isascii() and text.isprintable()


def _is_hidden(text: str, k: int) -> bool:
    character = text[k]
    if character in _JOINERS:
        return not (_joins(text[k - 1 : k]) and _joins(text[k + 1 : k + 2]))
    return character in _BLANK or category(character) in ("Cc", "Cf", "Cs", "Zl", "Zp")


def _joins(neighbour: str) -> bool:
    """Whether a character is a letter or mark of a script that has joiners, none of which is in Latin's part."""
    return neighbour > "\u0590" and category(neighbour)[0] in "LM"


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
