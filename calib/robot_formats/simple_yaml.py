"""The YAML that makers write joint origins in: nested `key: value` by indentation, and `{key: value}` on one line.

Anchors, lists, tags (but !degrees and !radians) and texts over several lines are refused with their line. Each value
remembers where it stands, so that a writer may change it and leave every other character as it is.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from pathlib import Path
from typing import NoReturn

from calib.robot_formats.chain.serial_chain import RobotFileError
from calib.robot_formats.urdf.safe_xml import read_bytes

_MOST_BYTES = 1024 * 1024
_MOST_DEPTH = 20
_MOST_CHARACTERS = 1000  # of a line
_LINE = re.compile(r"""(?P<space>[ \t]*)(?P<key>"[^"]*"|'[^']*'|[^\s:#'"{}\[\]&*!|>-][^:#{}\[\]]*?)\s*:(?=\s|$)""")
_PAIR = re.compile(r"""\s*(?P<key>"[^"]*"|'[^']*'|[^\s:,{}]+)\s*:\s*(?P<value>[^,{}]*)""")
_COMMENT = re.compile(r"(^|\s)#.*$")


@dataclass(frozen=True)
class YamlNode:
    """A value: a text, or the nodes below it by key."""

    line: int
    text: str = ""
    start: int = 0  # of the text in the file's characters
    children: dict[str, YamlNode] = field(default_factory=dict)


@dataclass(frozen=True)
class YamlFile:
    """A YAML file: its text and its nodes."""

    path: Path
    text: str
    root: YamlNode

    def fail(self, line: int, found: str, remedy: str) -> NoReturn:
        """Raise RobotFileError with file and line."""
        raise RobotFileError(f"{self.path}: line {line}: {found}; {remedy}")


def read_yaml(path: Path) -> YamlFile:
    """Read a file. Raises RobotFileError with the line of what is not of this kind."""
    try:
        text = read_bytes(path, _MOST_BYTES).decode("utf-8-sig")
    except UnicodeDecodeError as error:
        at_line = error.object[: error.start].count(b"\n") + 1
        raise RobotFileError(f"{path}: line {at_line}: is no UTF-8 text ({error.reason}); save it as UTF-8") from None
    root = YamlNode(1)
    file = YamlFile(path, text, root)
    open_: list[tuple[int, YamlNode]] = [(-1, root)]
    at = 0
    for number, whole in enumerate(text.splitlines(keepends=True), 1):
        start, at = at, at + len(whole)
        if len(whole) > _MOST_CHARACTERS:
            file.fail(number, f"the line has {len(whole)} characters", "lines of `key: value` are needed")
        line = _COMMENT.sub("", whole.rstrip("\r\n")).rstrip()
        if not line.strip() or line.strip() in ("---", "...") or line.startswith("%"):
            continue
        match = _LINE.match(line)
        if match is None:
            kind = "a list" if line.lstrip().startswith("- ") else f"{line.strip()[:40]!r}"
            file.fail(number, f"found {kind}", "lines of `key: value` are needed")
        if "\t" in match["space"]:
            file.fail(number, "the line is indented by tabs", "indent by spaces")
        indent, key = len(match["space"]), match["key"].strip("\"'").strip()
        while open_[-1][0] >= indent:
            open_.pop()
        parent = open_[-1][1]
        if parent.text:
            file.fail(number, f"{key[:40]!r} is indented below a value", "indent it as its neighbours")
        if key in parent.children:
            file.fail(number, f"{key[:40]!r} stands there twice", "remove one")
        rest = line[match.end() :]
        node = _value(file, number, rest.strip(), start + match.end() + len(rest) - len(rest.lstrip()))
        parent.children[key] = node
        open_.append((indent, node))
        if len(open_) > _MOST_DEPTH:
            file.fail(number, "too many levels", "a kinematics file has three or four")
    return file


def _value(file: YamlFile, line: int, text: str, start: int) -> YamlNode:
    """What stands behind `key:`."""
    if not text.startswith("{"):
        if text[:1] in ("&", "*", "|", ">", "[") or (text[:1] == "!" and not text.startswith(("!degrees", "!radians"))):
            file.fail(line, f"found {text[:40]!r}", "a number or a text is needed")
        return YamlNode(line, text, start)
    if not text.endswith("}") or text.count("{") > 1:
        file.fail(line, f"found {text[:40]!r}", "give {key: value, ...} on one line")
    node, at = YamlNode(line), 1
    while text[at:-1].strip():
        pair = _PAIR.match(text, at)
        if pair is None:
            file.fail(line, f"found {text[at:-1].strip()[:40]!r}", "give {key: value, ...} on one line")
        key = pair["key"].strip("\"'")
        if key in node.children:
            file.fail(line, f"{key[:40]!r} stands there twice", "remove one")
        node.children[key] = YamlNode(line, pair["value"].strip(), start + pair.start("value"))
        at = pair.end() + (text[pair.end() : pair.end() + 1] == ",")
    return node
