"""The reference is made of the code: what a field holds stands in the comment beside it, and is shown with it.

Three things beyond autodoc's own: comments behind the fields of dataclasses become their text; a dataclass shows its
fields instead of one long signature; and a name in a signature leads to its page, here or in the library that has it.
"""

from __future__ import annotations

import ast
import builtins
import dataclasses
import inspect
import io
import re
import tokenize
from importlib import import_module
from typing import Any

from docutils import nodes
from docutils.statemachine import StringList
from reference_links import ALIASES, named, resolve
from sphinx.application import Sphinx
from sphinx.domains.python import PyAttribute, PyMethod, PyObject, PyProperty
from sphinx.pycode import ModuleAnalyzer
from sphinx.util.docutils import SphinxDirective
from sphinx.util.inspect import TypeAliasForwardRef

import calib
from calib import errors

FIELD = {"Args": ":param {name}:", "Raises": ":raises {name}:", "Returns": ":returns: {name}:"}
ESCAPED = re.compile(r"(?<![\w\\])[*|](?=\S)|(?<=\w)_(?![\w`])")


# ---- comments beside fields -----------------------------------------------------------------------------------------


def with_marked_comments(source: str) -> str:
    """The source with each field's comment before it, in the form that Sphinx takes for documentation."""
    comments: dict[int, str] = {}
    for token in tokenize.generate_tokens(io.StringIO(source).readline):
        if token.type == tokenize.COMMENT and not token.string.startswith("# fmt"):
            comments[token.start[0]] = token.string.lstrip("#: ").strip()
    lines = source.splitlines()
    before: dict[int, str] = {}
    for node in ast.walk(ast.parse(source)):
        if not isinstance(node, ast.ClassDef):
            continue
        for statement in node.body:
            if isinstance(statement, ast.AnnAssign):
                last = statement.end_lineno or statement.lineno
                said = [comments[line] for line in range(statement.lineno, last + 1) if line in comments]
                above = statement.lineno - 1
                while not said and above in comments and lines[above - 1].lstrip().startswith("#"):
                    above -= 1
                said = said or [comments[line] for line in range(above + 1, statement.lineno)]
                if said:
                    before[statement.lineno] = f"{' ' * statement.col_offset}#: {escaped(' '.join(said))}"
    out = []
    for number, line in enumerate(lines, start=1):
        if number in before:
            out.append(before[number])
        out.append(line)
    return "\n".join(out) + "\n"


def escaped(text: str) -> str:
    """Words as they stand: what would be markup is escaped, but for `code` and **bold**."""
    parts = re.split(r"(``[^`]*``|`[^`]*`|\*\*[^*]+\*\*)", text)
    return "".join(
        part if part.startswith(("`", "**")) else ESCAPED.sub(lambda found: "\\" + found[0], part) for part in parts
    )


def mark_comments() -> None:
    """Let Sphinx read sources so."""
    plain = ModuleAnalyzer.analyze

    def analyze(self: ModuleAnalyzer) -> None:
        if not getattr(self, "_analyzed", False) and self.modname.partition(".")[0] in ("calib", "inspector"):
            self.code = with_marked_comments(self.code)
        plain(self)

    ModuleAnalyzer.analyze = analyze  # type: ignore[method-assign]


# ---- autodoc --------------------------------------------------------------------------------------------------------


def written_signature(
    app: Sphinx, what: str, name: str, thing: Any, options: Any, signature: str | None, returns: str | None
) -> tuple[str, str | None] | None:
    """A function's annotations as the source has them; none for a dataclass, whose fields follow with defaults."""
    if signature is None:
        return None
    if what in ("class", "exception"):
        fields = dataclasses.is_dataclass(thing) or issubclass(thing, Exception)
        return ("", None) if fields or getattr(thing, "_is_protocol", False) else None
    if what in ("function", "method") and inspect.isroutine(inspect.unwrap(thing)):
        function = inspect.unwrap(thing)
        try:
            bare = inspect.signature(function)
        except ValueError:  # of C, and imported
            return None
        own = list(bare.parameters.values())
        if what == "method" and own and own[0].name in ("self", "cls"):
            own = own[1:]
        own = [
            p.replace(
                default=p.empty if p.default is p.empty else _Shown(default_text(p.default)),
                annotation=p.empty if p.annotation is p.empty else _Shown(full_names(p.annotation, function)),
            )
            for p in own
        ]
        result = bare.return_annotation
        return str(inspect.Signature(own)), None if result is bare.empty else full_names(result, function)
    return None


def full_names(annotation: Any, function: Any) -> str:
    """An annotation as it is written, each name with its module, which the page then leaves out again."""
    if not isinstance(annotation, str):
        return getattr(annotation, "__name__", str(annotation))

    def full(name: re.Match[str]) -> str:
        found: Any = vars(builtins) | function.__globals__
        for part in name[0].split("."):
            found = found.get(part) if isinstance(found, dict) else getattr(found, part, None)
        home, own = getattr(found, "__module__", ""), getattr(found, "__qualname__", "")
        last = name[0].rpartition(".")[2]
        if own != last or not (inspect.isclass(found) or home in ("collections.abc", "typing")):  # an alias
            known = last in ALIASES or last.endswith("Array") or last not in function.__globals__
            return name[0] if known else f"{function.__module__}.{last}"
        if home == "builtins" and own != "type":  # a bare `type` would be taken for a field of that name
            return own
        return f"{home}.{own}" if own else name[0]

    return re.sub(r"(?<![\w.'\"])[A-Za-z_][\w.]*", full, annotation)


def skipped(app: Sphinx, what: str, name: str, thing: Any, skip: bool, options: Any) -> bool | None:
    """Constants of a module are not its face."""
    return True if what == "module" and not (inspect.isclass(thing) or inspect.isroutine(thing)) else None


def default_text(value: object) -> str:
    """A default, of a dataclass its name alone."""
    if not dataclasses.is_dataclass(value) or isinstance(value, type):
        return repr(value)
    try:
        plain = value == type(value)()
    except TypeError:  # it has no defaults
        plain = False
    return f"{type(value).__name__}({'' if plain else '...'})"


class _Shown:
    """Text that `inspect.Signature` prints as it stands."""

    def __init__(self, text: str) -> None:
        self.text = text

    def __repr__(self) -> str:
        return self.text


def as_restructured(app: Sphinx, what: str, name: str, thing: Any, options: Any, lines: list[str]) -> None:
    """Docstrings are plain text but for `code`, indented examples, and the lists under `Args:` and `Raises:`."""
    if what in ("class", "exception") and lines and lines[0].startswith(f"{name.rpartition('.')[2]}("):
        lines.clear()  # a dataclass's own signature, which Python writes where nobody wrote a docstring
    out: list[str] = []
    section, example, doctest = "", False, False
    for line in lines:
        head = re.fullmatch(r"(Args|Raises|Returns):\s*", line)
        if head:
            section = head[1]
            out.append("")
        elif section and (entry := re.match(r" {4}(?=\S)([^:]+): (.*)", line)):
            names = [entry[1].replace("*", r"\*")]
            if section == "Raises":
                names = [full_error(one) for one in entry[1].split(", ")]
            out += [f"{FIELD[section].format(name=one)} {escaped(entry[2])}" for one in names]
        elif section and line.startswith("    "):
            out.append(f"    {escaped(line.strip())}" if out[-1] else f":{section.lower()}: {escaped(line.strip())}")
        else:
            if line.strip():
                section = ""
            if line.startswith(">>>"):  # up to the next empty line, as doctest has it
                doctest = True
            doctest = doctest and bool(line.strip())
            if example and line.strip() and not line.startswith(" "):
                example = False
            plain = doctest or example or line.lstrip().startswith((":", ".. "))
            out.append(line if plain else escaped(line))
            example = example or (line.rstrip().endswith("::") and not doctest)
    lines[:] = out


def full_error(name: str) -> str:
    """An error's name with its module, of which the page shows none."""
    return f"~calib.errors.{name}" if hasattr(errors, name) else name


class ModuleMembers(SphinxDirective):
    """Directive `.. module-members:: calib.frames`: the docstring of a module with its public classes and functions.

    Names after the module choose those alone. What `calib` itself offers has a place of its own.
    """

    required_arguments = 1
    optional_arguments = 1
    final_argument_whitespace = True

    def run(self) -> list[nodes.Node]:
        """The docstring of the module, then a directive for each name."""
        home = self.arguments[0]
        module = import_module(home)
        wanted = self.arguments[1].split() if len(self.arguments) > 1 else public_names(module)
        missing = [name for name in wanted if not hasattr(module, name)]
        if missing:
            raise self.error(f"{home} has no {', '.join(missing)}")
        lines = [f".. automodule:: {home}", "", f".. currentmodule:: {home}", ""]
        for name in wanted:
            lines += self._directive(name, getattr(module, name))
        return self.parse_text_to_nodes(StringList(lines, source=f"{self.get_source_info()[0]}: {home}"))

    @staticmethod
    def _directive(name: str, thing: Any) -> list[str]:
        if not inspect.isclass(thing):
            return [f".. autofunction:: {name}", ""]
        kind = "autoexception" if issubclass(thing, Exception) else "autoclass"
        return [f".. {kind}:: {name}", "   :members:", ""]


def public_names(module: Any) -> list[str]:
    """Classes and functions of a module in the order of the source, without functions that `calib` itself offers."""
    source = ast.parse(inspect.getsource(module))
    kinds = (ast.ClassDef, ast.FunctionDef)
    names = [node.name for node in source.body if isinstance(node, kinds) and not node.name.startswith("_")]
    face = {name for name, home in calib._HOME.items() if home == module.__name__}
    return [name for name in names if name not in face or inspect.isclass(getattr(module, name))]


def in_contents(kind: type[PyObject]) -> None:
    """Leave what a class holds out of the tables of contents, which are long enough with the classes."""
    kind._toc_entry_name = lambda self, signature: ""  # type: ignore[method-assign]


def setup(app: Sphinx) -> dict[str, bool]:
    """Connect to autodoc and to the search for references."""
    mark_comments()
    TypeAliasForwardRef.__repr__ = lambda alias: alias.name  # type: ignore[method-assign]
    for kind in (PyAttribute, PyMethod, PyProperty):
        in_contents(kind)
    app.add_role("named", named)
    app.add_directive("module-members", ModuleMembers)
    app.connect("autodoc-process-signature", written_signature)
    app.connect("autodoc-process-docstring", as_restructured)
    app.connect("autodoc-skip-member", skipped)
    app.connect("missing-reference", resolve)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
