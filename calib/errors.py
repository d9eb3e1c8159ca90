"""Errors about the user's input; the text of each is one line: what was found, where, and what is expected.

Programs catch `CalibError`; the command line turns it into that line and exit code 2.
"""

from __future__ import annotations

from unicodedata import category

MOST_CHARACTERS = 1000  # of a line that a person reads
_OF_THE_START = 0.7  # share of a cut line: it begins with file and place and ends with what is expected
_JOINERS = "\u200c\u200d"  # belong between letters of Persian, Hindi and others; anywhere else they hide text
_BLANK = (  # letters and marks that show nothing: fillers, joiners of marks, selectors, the empty Braille cell
    "\u034f\u115f\u1160\u17b4\u17b5\u180b\u180c\u180d\u180f\u2800\u3164\uffa0"
)


def is_one_line(name: str) -> bool:
    """Whether a name can be part of a line of output: no line ends, control or hidden characters.

    Hidden characters are those that are not seen but turn or hide the text around them (Unicode's Cc, Cf, Zl, Zp, and
    halves of surrogate pairs).
    """
    return _is_plain(name) or not any(_is_hidden(name, k) for k in range(len(name)))


def printable(text: str) -> str:
    """A message's text with hidden characters escaped and each line cut to `MOST_CHARACTERS`."""
    text = visible(text)
    if len(text) <= MOST_CHARACTERS:
        return text
    return "\n".join(map(_cut, text.split("\n")))


def visible(text: str, kept: str = "\n") -> str:
    """A text with its hidden characters as escapes such as `\\u202e`, except the characters `kept`."""
    if _is_plain(text):
        return text
    return "".join(_escaped(c) if c not in kept and _is_hidden(text, k) else c for k, c in enumerate(text))


def _is_plain(text: str) -> bool:
    """Whether a text is printable ASCII, so that nothing can be hidden in it."""
    return text.isascii() and text.isprintable()


def _is_hidden(text: str, k: int) -> bool:
    """Whether the k-th character of a text shows nothing, or changes how its neighbours are shown."""
    character = text[k]
    if character in _JOINERS:
        return not (_joins(text[k - 1 : k]) and _joins(text[k + 1 : k + 2]))
    return character in _BLANK or category(character) in ("Cc", "Cf", "Cs", "Zl", "Zp")


def _joins(neighbour: str) -> bool:
    """Whether a character is a letter or mark of a script that may use invisible joiners, which Latin does not."""
    return neighbour > "\u0590" and category(neighbour)[0] in "LM"


def _escaped(character: str) -> str:
    """Python's escape of one character, such as `\\u202e`."""
    return character.encode("unicode_escape").decode("ascii")


def _cut(line: str) -> str:
    """A line with its middle replaced by [...] where it is longer than `MOST_CHARACTERS`."""
    if len(line) <= MOST_CHARACTERS:
        return line
    start = int(_OF_THE_START * MOST_CHARACTERS)
    return f"{line[:start]} [...] {line[start - MOST_CHARACTERS + 7 :]}"


class CalibError(Exception):
    """Error: the input does not allow the work to go on; its text is cleaned by `printable`."""

    def __str__(self) -> str:
        return printable(super().__str__())


class DatasetError(CalibError):
    """Error: a file of the dataset folder is missing, malformed or contradicts another."""


class ScanError(CalibError):
    """Error: a scan cannot be read as points."""


class CornerError(CalibError):
    """Error: no corner can be found in a scan, or in too few of the scans."""


class ModelFileError(CalibError):
    """Error: a model.json cannot be used."""


class FitError(CalibError):
    """Error: the measurements do not determine the requested fit."""


class TargetError(CalibError):
    """Error: a target cannot be found in a scan, or a finder of the user's own fails."""
