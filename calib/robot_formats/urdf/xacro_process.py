"""Expansion of a xacro inside a bounded process: xacrodoc and xacro with their `eval` replaced.

xacro evaluates `${...}` and `$(eval ...)` as Python. Here they are arithmetic on plain data (`expressions`), and
anything else that the library would evaluate is refused. As a second barrier the process may only read below the named
folders while it expands; it cannot write, start processes, import or open connections.
"""

from __future__ import annotations

import math
import os
import re
import sys
from collections.abc import Callable
from pathlib import Path
from types import FrameType
from typing import Any, NoReturn
from xml.dom import expatbuilder, minidom

from calib.robot_formats.urdf.expressions import (
    BASICS,
    MATHS,
    MOST_TEXT,
    Budget,
    ExpressionError,
    Function,
    Namespace,
    evaluate,
    plain,
)

_PLACE = "place"
_MOST_BYTES = 64 * 1024 * 1024
_MOST_YAML_BYTES = 1024 * 1024
_MOST_ELEMENTS = 100_000  # that macros and includes make, those of all runs together
_MOST_FRAMES = 3000  # of nested macros, properties and expressions
_HARMLESS = {  # what xacro itself does while it expands, as Python's audit events name it
    "builtins.id", "compile", "cpython.PyInterpreterState_Clear", "glob.glob", "glob.glob/2", "object.__getattr__",
    "object.__setattr__", "sys._getframe", "sys.unraisablehook",
}  # fmt: skip
_OF_PATHS = {"open", "os.listdir", "os.scandir"}
_UNITS = {
    "!radians": 1.0, "!degrees": math.pi / 180.0, "!meters": 1.0, "!millimeters": 0.001, "!foot": 0.3048,
    "!inches": 0.0254,
}  # fmt: skip
_TOKEN = re.compile(
    r"(?P<escaped>\$\$+[{(])|\$\{(?P<expression>[^}]*)\}|\$\((?P<extension>[^)]*)\)|(?P<text>[^$]+|\$[^{($]+|\$\Z)"
)  # as xacro's own lexer has them


class Refused(Exception):
    """Error: a xacro does something that is not allowed."""


def prepare() -> None:
    """Import all modules that are needed, before access is restricted."""
    import encodings.utf_8_sig
    import glob
    import unicodedata

    import xacro.substitution_args
    import xacrodoc
    import yaml

    del encodings, glob, unicodedata, xacro, xacrodoc, yaml


def answer(asked: dict[str, Any]) -> dict[str, Any]:
    """Expand a xacro file.

    Args:
        asked: file, args, packages (name: folder), folders that may be read.

    Returns:
        text and places ([file, line] of each element in order), or error, file and line.
    """
    import xacro
    import xacrodoc

    path = asked["file"]
    os.chdir(Path(path).parent)  # what $(cwd) is
    sys.setrecursionlimit(_MOST_FRAMES)
    _Expansion(xacro, finder(asked["packages"])).take_over()
    xacrodoc.packages.get_path = finder(asked["packages"])
    xacro.parse = parser_with_places(path)
    xacro.init_stacks(path)
    fence_in([Path(folder) for folder in asked["folders"]])
    try:
        doc = xacrodoc.XacroDoc.from_file(path, walk_up=False, subargs=dict(asked["args"]), resolve_packages=False)
        places: list[Any] = []
        collect_places(doc.dom.documentElement, places)
        return {"text": doc.dom.toxml(), "places": places}
    except RecursionError as error:
        return {"error": "macros or properties go round in a circle"} | where(error, xacro.filestack)
    except MemoryError as error:
        return {"error": "needs more memory than a robot's description may"} | where(error, xacro.filestack)
    except Exception as error:  # whatever the library makes of a damaged file
        words = " ".join(str(refusal(error)).split()) or type(error).__name__
        return {"error": words[:300]} | where(error, xacro.filestack)


def refusal(error: BaseException) -> BaseException:
    """The `Refused` error among the causes of an error; the error itself where there is none."""
    behind: BaseException | None = error
    while behind is not None:
        if isinstance(behind, Refused):
            return behind
        behind = behind.__cause__ or behind.__context__
    return error


class _Expansion:
    """Replacement of xacro's evaluation functions, with one budget for all of a file."""

    def __init__(self, xacro: Any, find: Callable[[str], str]) -> None:
        self._xacro, self._find, self._budget, self._elements = xacro, find, Budget(), 0
        self._eval_all = xacro.eval_all

    def take_over(self) -> None:
        """Replace the evaluation functions of the xacro library by this object's."""
        xacro, arguments = self._xacro, self._xacro.substitution_args
        xacro.eval = arguments.eval = self._refuse_eval  # before Python's own, for what a later version evaluates
        xacro.safe_eval = lambda text, names, local=None: self._value(text, names)
        xacro.eval_text, xacro.eval_all = self.eval_text, self.eval_all
        xacro.load_yaml = self.load_yaml
        xacro.warning = xacro.error = xacro.message = xacro.print_location = lambda *given, **named: ""
        arguments._eval = self.eval_argument
        xacro._global_symbols.clear()
        xacro._global_symbols.update(self._globals())

    def _refuse_eval(self, *given: object) -> NoReturn:
        raise Refused("would be run as Python, which a robot's description may not")

    def _globals(self) -> dict[str, Any]:
        silent = Function("message", lambda *given, **named: "")
        own: dict[str, Any] = {
            "load_yaml": Function("load_yaml", self.load_yaml),
            "abs_filename": Function("abs_filename", lambda name: str(self._xacro.abs_filename_spec(name))),
            "dotify": Function("dotify", lambda table: table),
        }
        further: dict[str, Any] = {
            "arg": Function("arg", lambda name: self._arguments()[name]),
            "fatal": Function("fatal", _fatal),
            "tokenize": Function("tokenize", _tokens),
            **dict.fromkeys(("message", "warning", "error", "print_location"), silent),
        }
        spaces = {"math": MATHS, "python": BASICS, "xacro": own | further}
        return {**MATHS, **BASICS, **own, **{name: Namespace(names) for name, names in spaces.items()}}

    def _arguments(self) -> dict[str, str]:
        return self._xacro.substitution_args_context["arg"]

    def _value(self, text: Any, names: Any) -> Any:
        return evaluate(str(text), _Properties(names, self._xacro.NameSpace), self._budget)

    def eval_text(self, text: str, symbols: Any) -> Any:
        """Replacement of `xacro.eval_text`: the value of a text that is a single `${...}`, else the filled-in text."""
        results: list[Any] = []
        at = length = 0
        while at < len(text):
            found = _TOKEN.match(text, at)
            if found is None:
                raise self._xacro.XacroException("invalid expression: " + text[at : at + 100])
            at = found.end()
            self._budget.spend(1)
            if found["expression"] is not None:
                results.append(self._expression(found["expression"], symbols))
            elif found["extension"] is not None:
                inside = self.eval_text(found["extension"], symbols)
                results.append(self._xacro.eval_extension(f"$({inside})"))
            else:
                results.append(found["text"] or found["escaped"][1:])
            if len(results) > 1 or at < len(text):
                results[-1] = str(results[-1])
                length += len(results[-1])
                if length > MOST_TEXT:
                    raise Refused(f"makes a text of more than {MOST_TEXT} characters")
        return results[0] if len(results) == 1 else "".join(results)

    def _expression(self, text: str, symbols: Any) -> Any:
        try:
            return self._value(self.eval_text(text, symbols), symbols)
        except ExpressionError as error:
            raise self._xacro.XacroException(exc=error, suffix=f"in the expression {text.strip()[:100]!r}") from error

    def eval_all(self, node: Any, macros: Any, symbols: Any) -> None:
        """Replacement of `xacro.eval_all` with a bounded total number of elements."""
        self._elements += 1
        if self._elements > _MOST_ELEMENTS:
            raise Refused(f"makes more than {_MOST_ELEMENTS} elements")
        self._eval_all(node, macros, symbols)

    def eval_argument(self, text: str, context: dict[str, Any]) -> str:
        """Value of $(eval ...) as text."""
        given = context.get("arg") or {}
        names = {
            **MATHS, **BASICS, **{name: _literal(value) for name, value in given.items()}, "true": True, "false": False,
            "arg": Function("arg", lambda name: _literal(given[name])), "find": Function("find", self._find),
            "env": Function("env", _no_environment), "optenv": Function("optenv", lambda name, default="": default),
        }  # fmt: skip
        try:
            return str(evaluate(text, names, self._budget))
        except ExpressionError as error:
            raise Refused(f"{error} in the expression {text.strip()[:100]!r}") from None

    def load_yaml(self, name: Any) -> Any:
        """Read a YAML file as plain data of bounded size; anchors are allowed."""
        import yaml

        if not isinstance(name, str):
            raise ExpressionError("load_yaml() takes the name of a file")
        path = str(self._xacro.abs_filename_spec(name))
        try:
            with Path(path).open("rb") as file:
                content = file.read(_MOST_YAML_BYTES + 1)
        except OSError as error:
            raise Refused(f"{path}: {error.strerror or error}") from None
        if len(content) > _MOST_YAML_BYTES:
            raise Refused(f"{path}: is larger than a YAML file of a robot may be")
        try:
            return plain(yaml.load(content.decode("utf-8-sig"), self._yaml_loader(yaml)), self._budget)
        except (yaml.YAMLError, ExpressionError, UnicodeDecodeError, ValueError, TypeError) as error:
            raise Refused(f"{path}: {' '.join(str(error).split())[:200]}") from None

    def _yaml_loader(self, yaml: Any) -> Any:
        """PyYAML's safe loader with xacro's units, and with dates left as text."""

        def of_unit(scale: float) -> Callable[[Any, Any], float]:
            return lambda loader, node: (
                scale * float(self._value(loader.construct_scalar(node), self._xacro._global_symbols))
            )

        class Loader(yaml.SafeLoader):  # type: ignore[misc]
            yaml_implicit_resolvers = {  # noqa: RUF012
                first: [(tag, pattern) for tag, pattern in rules if not tag.endswith(":timestamp")]
                for first, rules in yaml.SafeLoader.yaml_implicit_resolvers.items()
            }

        for tag, scale in _UNITS.items():
            Loader.add_constructor(tag, of_unit(scale))
        return Loader


class _Properties:
    """xacro's table of properties as a `NameTable` for expressions."""

    def __init__(self, table: Any, space: type) -> None:
        self._table, self._space = table, space

    def __getitem__(self, name: str) -> Any:
        value = self._table[name]
        return Namespace(_Properties(value, self._space)) if isinstance(value, self._space) else value


def _fatal(*words: Any) -> NoReturn:
    raise Refused(" ".join(map(str, words)))


def _tokens(text: str, sep: str = ",; ", skip_empty: bool = True) -> list[str]:
    words = re.split(f"[{re.escape(sep)}]", text) if sep else [text]
    return [word for word in words if word or not skip_empty]


def _no_environment(name: Any) -> NoReturn:
    raise Refused(f"environment variable {name!r} is not set")


def _literal(text: Any) -> Any:
    """Value of an argument's text in $(eval ...): a number, a truth value, or else the text."""
    words = str(text)
    if len(words) <= 400:
        for kind in (float,) if "." in words else (int,):
            try:
                return kind(words)
            except ValueError:
                pass
    return {"true": True, "false": False}.get(words.lower(), words)


def finder(packages: dict[str, str]) -> Callable[[str], str]:
    """Function for $(find NAME) that knows the named package folders only."""

    def find(name: str) -> str:
        if name not in packages:
            raise Refused(f"$(find {name}) is not known: give --package {name}=FOLDER")
        return packages[name]

    return find


def parser_with_places(main_file: str) -> Callable[..., minidom.Document]:
    """Replacement of `xacro.parse`: elements and their copies keep file and line; a DOCTYPE is refused."""

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
    """DOM builder that stores file and line in each element."""

    def __init__(self, path: str) -> None:
        super().__init__()
        self._path = path

    def start_element_handler(self, name: Any, attributes: Any) -> None:
        super().start_element_handler(name, attributes)
        self.curNode.setUserData(_PLACE, (self._path, self.getParser().CurrentLineNumber), _KeepsPlace())

    def start_doctype_decl_handler(self, *given: object) -> None:
        raise Refused("has a DOCTYPE, which may define entities; remove it, a robot needs none")


class _KeepsPlace:
    """DOM handler that gives a copied element the file and line of its original."""

    def handle(self, operation: int, key: str, place: Any, source: minidom.Node, target: minidom.Node) -> None:
        if target is not None:
            target.setUserData(key, place, self)


def place_of(node: Any) -> tuple[str, int] | None:
    """File and line of an element or of its nearest ancestor that has them; None where none has."""
    while node is not None:
        place = node.getUserData(_PLACE) if isinstance(node, minidom.Node) else None
        if place is not None:
            return place
        node = getattr(node, "parentNode", None)
    return None


def collect_places(element: Any, places: list[Any]) -> None:
    """Append file and line of an element and all its descendants to `places`, in the order of the text."""
    waiting = [element]
    while waiting:
        node = waiting.pop()
        places.append(place_of(node))
        waiting += [child for child in reversed(node.childNodes) if child.nodeType == child.ELEMENT_NODE]


def where(error: BaseException, files: list[Any] | None) -> dict[str, Any]:
    """File and line of an error: from expat, else from the innermost element that was being expanded."""
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


def fence_in(folders: list[Path]) -> None:
    """Restrict the process from now on to reading files below some folders."""

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
                "its package, --package NAME=FOLDER"
            )
        raise Refused(f"does what a robot's description may not ({event})")

    sys.addaudithook(hook)
