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
from sphinx.addnodes import pending_xref
from sphinx.application import Sphinx
from sphinx.environment import BuildEnvironment
from sphinx.pycode import ModuleAnalyzer
from sphinx.util.nodes import make_refnode

# Where the names of other packages are explained. Nothing of it is fetched; a reader may click on it.
ELSEWHERE = {
    "numpy": "https://numpy.org/doc/stable/reference/generated/{name}.html",
    "pandas": "https://pandas.pydata.org/docs/reference/api/{name}.html",
    "collections": "https://docs.python.org/3/library/{module}.html#{name}",
    "concurrent": "https://docs.python.org/3/library/{module}.html#{name}",
    "pathlib": "https://docs.python.org/3/library/pathlib.html#{name}",
    "typing": "https://docs.python.org/3/library/typing.html#{name}",
}
BUILTIN = "https://docs.python.org/3/library/{page}.html#{name}"
PAGE_OF_BUILTIN = {"ValueError": "exceptions", "Exception": "exceptions", "object": "functions"}
GENERATOR = "https://numpy.org/doc/stable/reference/random/generator.html"
TYPING = "https://numpy.org/doc/stable/reference/typing.html"
ALIASES = {  # names as Python knows them, or as annotations write them, which are documented under another
    "numpy.random._generator.Generator": GENERATOR,
    "numpy.random.Generator": GENERATOR,
    "np.random.Generator": GENERATOR,
    "ArrayLike": f"{TYPING}#numpy.typing.ArrayLike",
    "NDArray": f"{TYPING}#numpy.typing.NDArray",
    "pandas.core.frame.DataFrame": ELSEWHERE["pandas"].format(name="pandas.DataFrame"),
    "pandas.core.series.Series": ELSEWHERE["pandas"].format(name="pandas.Series"),
}
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
                if said:
                    before[statement.lineno] = f"{' ' * statement.col_offset}#: {escaped(' '.join(said))}"
    out = []
    for number, line in enumerate(lines, start=1):
        if number in before:
            out.append(before[number])
        out.append(line)
    return "\n".join(out) + "\n"


def escaped(text: str) -> str:
    """Words as they stand: what reStructuredText would take for markup is escaped, outside of `code`."""
    parts = re.split(r"(``[^`]*``|`[^`]*`)", text)
    return "".join(
        part if part.startswith("`") else ESCAPED.sub(lambda found: "\\" + found[0], part) for part in parts
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
        bare = inspect.signature(function)
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
        if not inspect.isclass(found) and home not in ("collections.abc", "typing"):
            return name[0]
        return own if home == "builtins" or not own else f"{home}.{own}"

    return re.sub(r"(?<![\w.'\"])[A-Za-z_][\w.]*", full, annotation)


def skipped(app: Sphinx, what: str, name: str, thing: Any, skip: bool, options: Any) -> bool | None:
    """Constants of a module are not its face."""
    return True if what == "module" and not (inspect.isclass(thing) or inspect.isroutine(thing)) else None


def default_text(value: object) -> str:
    """A default, of a dataclass its name alone."""
    return f"{type(value).__name__}()" if dataclasses.is_dataclass(value) else repr(value)


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
    section, example = "", False
    for line in lines:
        head = re.fullmatch(r"(Args|Raises|Returns):\s*", line)
        if head:
            section = head[1]
            out.append("")
        elif section and (entry := re.match(r" {4}(?=\S)([^:]+): (.*)", line)):
            out.append(f"{FIELD[section].format(name=entry[1])} {escaped(entry[2])}")
        elif section and line.startswith("    "):
            out.append(
                f"    {escaped(line.strip())}" if out[-1] else f":{section.lower()}: {escaped(line.strip())}"
            )
        else:
            if line.strip():
                section = ""
            if example and line.strip() and not line.startswith(" "):
                example = False
            plain = example or line.lstrip().startswith((":", ".. "))
            out.append(line if plain else escaped(line))
            example = example or line.rstrip().endswith("::")
    lines[:] = out


# ---- names ----------------------------------------------------------------------------------------------------------


def exists(name: str) -> bool:
    """Whether this is a module, or something in one."""
    parts = name.split(".")
    for split in range(len(parts), 0, -1):
        try:
            found: Any = import_module(".".join(parts[:split]))
        except ImportError:
            continue
        for part in parts[split:]:
            if not hasattr(found, part) and part not in getattr(found, "__dataclass_fields__", {}):
                return False
            found = getattr(found, part, None)
        return True
    return False


def resolve(
    app: Sphinx, env: BuildEnvironment, node: pending_xref, content: nodes.TextElement
) -> nodes.Element | None:
    """A name that no page of ours explains: a link to the library's page, or the name alone where it exists."""
    if node.get("refdomain") != "py":
        return None
    name = node["reftarget"].removeprefix("pathlib._local.")
    short = name.rpartition(".")[2]
    content = type(content)("", short) if content.astext() == name else content
    page = documented(env, name)
    if page is not None:
        docname, anchor = page
        return make_refnode(app.builder, node["refdoc"], docname, anchor, content, name)
    address = ""
    if name in ALIASES:
        address = ALIASES[name]
    elif name.partition(".")[0] in ELSEWHERE:
        module = name.rpartition(".")[0]
        address = ELSEWHERE[name.partition(".")[0]].format(name=name, module=module)
    elif name == "Path":
        address = ELSEWHERE["pathlib"].format(name="pathlib.Path")
    elif "." not in name and exists(f"builtins.{name}"):
        address = BUILTIN.format(page=PAGE_OF_BUILTIN.get(name, "stdtypes"), name=name)
    if address:
        link = nodes.reference("", "", content, refuri=address, internal=False)
        link["classes"].append("elsewhere")
        return link
    known = (f"{node.get('py:module')}.{name}", f"calib.{name}", name)
    if node["reftype"] == "obj" or any(exists(one) for one in known):
        return content
    return None


def documented(env: BuildEnvironment, name: str) -> tuple[str, str] | None:
    """Page and anchor of what has this name behind the last dot, where there is one such thing only."""
    objects = env.domains.python_domain.objects
    found = {
        (entry.docname, entry.node_id)
        for full, entry in objects.items()
        if entry.objtype in ("class", "exception", "function", "data", "type")
        and (full == name or ("." not in name and full.endswith(f".{name}")))
    }
    return found.pop() if len(found) == 1 else None


def setup(app: Sphinx) -> dict[str, bool]:
    """Connect to autodoc and to the search for references."""
    mark_comments()
    app.connect("autodoc-process-signature", written_signature)
    app.connect("autodoc-process-docstring", as_restructured)
    app.connect("autodoc-skip-member", skipped)
    app.connect("missing-reference", resolve)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
