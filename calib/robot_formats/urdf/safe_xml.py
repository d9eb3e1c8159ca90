"""Safe parser of untrusted XML: no entities, no document type, no other files, bounded size and depth.

Each element keeps its line and the position of its start tag in the file's bytes, so that a writer may change an
attribute and leave every other byte as it is.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import NoReturn
from xml.parsers import expat

from calib.robot_formats.chain.serial_chain import RobotFileError

_CONFLICT = re.compile(rb"^<{7} .*(?:\n.*)*?\n={7}\r?\n(?:.*\n)*?>{7} ", re.MULTILINE)  # as git leaves it
_MOST_BYTES = 64 * 1024 * 1024
_MOST_ELEMENTS = 1_000_000
_MOST_DEPTH = 200


@dataclass(frozen=True)
class Element:
    """An XML element with its attributes, children and place in the file, without its text."""

    tag: str
    attributes: Mapping[str, str]
    line: int
    start: int  # of its start tag in the file's bytes
    children: list[Element] = field(default_factory=list)

    def all(self, tag: str) -> Iterator[Element]:
        """Children with a tag."""
        return (child for child in self.children if child.tag == tag)

    def first(self, tag: str) -> Element | None:
        """First child with a tag; None where there is none."""
        return next(self.all(tag), None)

    def with_all_below(self) -> Iterator[Element]:
        """The element and all that are in it, in the order of the text."""
        waiting = [self]
        while waiting:
            element = waiting.pop()
            yield element
            waiting += reversed(element.children)


@dataclass(frozen=True)
class XmlFile:
    """An XML file with its bytes and its elements."""

    path: Path
    content: bytes
    root: Element

    def fail(self, at: Element | int, found: str, remedy: str) -> NoReturn:
        """Raise RobotFileError that names file, line, what was found and a remedy."""
        line = at if isinstance(at, int) else at.line
        raise RobotFileError(f"{self.path}: line {line}: {found}; {remedy}")


def read_bytes(path: Path, most: int = _MOST_BYTES) -> bytes:
    """Bytes of a file of bounded size. Raises RobotFileError."""
    try:
        if path.exists() and not path.is_file():  # reading a pipe would wait for ever
            raise RobotFileError(f"{path}: is no file; name the robot's file")
        with path.open("rb") as file:
            content = file.read(most + 1)
    except OSError as error:
        raise RobotFileError(f"{path}: {error.strerror or error}; name the robot's file") from None
    if len(content) > most:
        raise RobotFileError(f"{path}: is larger than {most // 2**20} MB; a robot's description is a few kB")
    if (conflict := _CONFLICT.search(content)) is not None:
        line = content[: conflict.start()].count(b"\n") + 1
        raise RobotFileError(
            f"{path}: line {line}: a merge conflict that is not settled; keep one side and remove the marks <<<<<<<, "
            "======= and >>>>>>>"
        )
    return content


def parse_xml(path: Path, content: bytes) -> XmlFile:
    """Parse an XML text. Raises RobotFileError with the line where it is not well-formed or not safe."""
    if content[:2] in (b"\xff\xfe", b"\xfe\xff") or b"\0" in content[:200]:
        raise RobotFileError(f"{path}: line 1: the text is UTF-16; save it as UTF-8")
    reader = _Reader(path)
    try:
        reader.parser.Parse(content, True)
    except expat.ExpatError as error:
        message = expat.errors.messages.get(error.code) or expat.ErrorString(error.code)
        raise RobotFileError(f"{path}: line {error.lineno}: not valid XML: {message}") from None
    except (UnicodeDecodeError, LookupError, ValueError) as error:
        words = " ".join(str(error).split())
        raise RobotFileError(f"{path}: line {reader.line}: not valid XML: {words}; save it as UTF-8") from None
    assert reader.root is not None  # expat refuses a text without an element
    return XmlFile(path, content, reader.root)


class _Reader:
    """Expat handler that builds the elements."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.root: Element | None = None
        self._open: list[Element] = []
        self._count = 0
        self.parser = expat.ParserCreate()
        self.parser.StartElementHandler = self._start
        self.parser.EndElementHandler = self._end
        self.parser.StartDoctypeDeclHandler = self._doctype
        self.parser.EntityDeclHandler = self._doctype
        self.parser.ExternalEntityRefHandler = self._doctype

    @property
    def line(self) -> int:
        return self.parser.CurrentLineNumber

    def _start(self, tag: str, attributes: dict[str, str]) -> None:
        self._count += 1
        if self._count > _MOST_ELEMENTS or len(self._open) >= _MOST_DEPTH:
            what = "elements" if self._count > _MOST_ELEMENTS else "levels"
            raise RobotFileError(f"{self.path}: line {self.line}: too many {what} for a robot's description")
        element = Element(tag, attributes, self.line, self.parser.CurrentByteIndex)
        if self._open:
            self._open[-1].children.append(element)
        else:
            self.root = element
        self._open.append(element)

    def _end(self, tag: str) -> None:
        self._open.pop()

    def _doctype(self, *given: object) -> NoReturn:
        raise RobotFileError(
            f"{self.path}: line {self.line}: has a DOCTYPE, which may define entities; remove it, a robot needs none"
        )
