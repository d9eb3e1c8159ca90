"""A xacro's expansion, in a process of its own: run as a file, it imports nothing of this library.

stdin: JSON of path (sys.path), file, args, packages (name: folder), folders that may be read. stdout: JSON of text and
places ([file, line] of each element in order), or of error, file, line. xacro's expressions are Python with few names;
so this process has no environment, reads below those folders only, writes, connects and starts nothing, and its memory
and time are bounded.
"""

from __future__ import annotations

import importlib
import json
import os
import sys
from collections.abc import Callable
from pathlib import Path
from types import FrameType
from typing import Any
from xml.dom import expatbuilder, minidom

_PLACE = "place"
_MOST_BYTES = 64 * 1024 * 1024
_MOST_MEMORY = 4 * 1024**3
_HARMLESS = {
    "builtins.id", "code.__new__", "compile", "cpython.PyInterpreterState_Clear", "exec", "glob.glob", "glob.glob/2",
    "import", "marshal.loads", "object.__getattr__", "object.__setattr__", "sys._getframe", "sys.unraisablehook",
}  # fmt: skip
_OF_PATHS = {"open", "os.listdir", "os.scandir"}


class Refused(Exception):
    """What a xacro may not do."""


def main() -> None:
    """Read the request, expand, answer."""
    asked = json.loads(sys.stdin.buffer.read())
    answer_to = os.fdopen(os.dup(1), "wb")
    sys.stdout = sys.stderr
    sys.path[:] = asked["path"]
    bound_memory()
    answer_to.write(json.dumps(answer(asked)).encode())
    answer_to.flush()
    os._exit(0)  # what is left to close would be refused


def answer(asked: dict[str, Any]) -> dict[str, Any]:
    """The expanded text with the place of each element, or what is wrong and where."""
    import xacro
    import xacrodoc

    importlib.import_module("yaml")  # which xacro imports when it needs it: before reading is fenced in
    path = asked["file"]
    xacrodoc.packages.get_path = finder(asked["packages"])
    xacro.parse = parser_with_places(path)
    xacro.init_stacks(path)
    fence_in([Path(folder) for folder in asked["folders"]])
    try:
        doc = xacrodoc.XacroDoc.from_file(
            path, walk_up=False, subargs=dict(asked["args"]), resolve_packages=False
        )
        places: list[Any] = []
        collect_places(doc.dom.documentElement, places)
        return {"text": doc.dom.toxml(), "places": places}
    except RecursionError as error:
        return {"error": "macros or properties go round in a circle"} | where(error, xacro.filestack)
    except MemoryError as error:
        return {"error": "needs more memory than a robot's description may"} | where(error, xacro.filestack)
    except Exception as error:  # whatever an expression of the file may raise
        words = " ".join(str(refusal(error)).split()) or type(error).__name__
        return {"error": words[:300]} | where(error, xacro.filestack)


def refusal(error: BaseException) -> BaseException:
    """What was refused, behind what xacro makes of it; else the error itself."""
    behind: BaseException | None = error
    while behind is not None:
        if isinstance(behind, Refused):
            return behind
        behind = behind.__cause__ or behind.__context__
    return error


def finder(packages: dict[str, str]) -> Callable[[str], str]:
    """What $(find NAME) is: folders that were named, and no others."""

    def find(name: str) -> str:
        if name not in packages:
            raise Refused(f"$(find {name}) is not known: give --xacro-package {name}=FOLDER")
        return packages[name]

    return find


def parser_with_places(main_file: str) -> Callable[..., minidom.Document]:
    """In place of xacro.parse: each element keeps its file and line, copies of it too; no DOCTYPE."""

    def parse(text: Any, filename: str | None = None) -> minidom.Document:
        if not isinstance(text, str | bytes | type(None)):
            return text  # a document already
        try:
            content = Path(filename or main_file).read_bytes() if text is None else text
        except OSError as error:
            raise Refused(f"{filename}: {error.strerror or error}") from None
        return _Builder(str(filename or main_file)).parseString(content)

    return parse


class _Builder(expatbuilder.ExpatBuilderNS):
    """A document whose elements know where they stood."""

    def __init__(self, path: str) -> None:
        super().__init__()
        self._path = path

    def start_element_handler(self, name: Any, attributes: Any) -> None:
        super().start_element_handler(name, attributes)
        self.curNode.setUserData(_PLACE, (self._path, self.getParser().CurrentLineNumber), _KeepsPlace())

    def start_doctype_decl_handler(self, *given: object) -> None:
        raise Refused("has a DOCTYPE, which may define entities; remove it, a robot needs none")


class _KeepsPlace:
    """A copy of an element stood where the element did."""

    def handle(
        self, operation: int, key: str, place: Any, source: minidom.Node, target: minidom.Node
    ) -> None:
        if target is not None:
            target.setUserData(key, place, self)


def place_of(node: Any) -> tuple[str, int] | None:
    """File and line of an element, or of the nearest that it stands in."""
    while node is not None:
        place = node.getUserData(_PLACE) if isinstance(node, minidom.Node) else None
        if place is not None:
            return place
        node = getattr(node, "parentNode", None)
    return None


def collect_places(element: Any, places: list[Any]) -> None:
    """The places of an element and all below it, in the order of the text."""
    waiting = [element]
    while waiting:
        node = waiting.pop()
        places.append(place_of(node))
        waiting += [child for child in reversed(node.childNodes) if child.nodeType == child.ELEMENT_NODE]


def where(error: BaseException, files: list[Any] | None) -> dict[str, Any]:
    """File and line of an error: what expat says, else the innermost element that was worked on."""
    line = getattr(error, "lineno", None)
    if line is not None and hasattr(error, "offset") and hasattr(error, "code"):
        return {"file": (files or [None])[-1], "line": line}
    frames: list[FrameType] = []
    trace = error.__traceback__
    while trace is not None:
        frames.append(trace.tb_frame)
        trace = trace.tb_next
    for frame in reversed(frames):
        for name in ("node", "elt"):
            place = place_of(frame.f_locals.get(name))
            if place is not None:
                return {"file": place[0], "line": place[1]}
    return {"file": (files or [None])[-1], "line": None}


def bound_memory() -> None:
    """Where the system can."""
    try:
        import resource
    except ImportError:
        return
    resource.setrlimit(resource.RLIMIT_AS, (_MOST_MEMORY, _MOST_MEMORY))


def fence_in(folders: list[Path]) -> None:
    """From here on nothing is read but below the folders, and nothing written, started or connected to."""

    def hook(event: str, given: tuple[Any, ...]) -> None:
        if event in _HARMLESS:
            return
        if event in _OF_PATHS and isinstance(given[0], str | bytes | os.PathLike):
            path = Path(os.path.realpath(os.fsdecode(given[0])))
            reads = event != "open" or given[1] in (None, "r", "rb", "rt")
            if reads and any(path.is_relative_to(folder) for folder in folders):
                if event == "open" and path.exists() and not path.is_file():
                    raise Refused(f"{path}: is no file")
                if event == "open" and path.exists() and path.stat().st_size > _MOST_BYTES:
                    raise Refused(f"{path}: is larger than a robot's description may be")
                return
            raise Refused(
                f"names {os.fsdecode(given[0])!r}, which is not below its folder: put it there, or name the folder of "
                "its package, --xacro-package NAME=FOLDER"
            )
        raise Refused(f"does what a robot's description may not ({event})")

    sys.addaudithook(hook)


if __name__ == "__main__":
    main()
