"""Names in the reference lead to their pages, here or in the library that has them; nothing of those is fetched."""

from __future__ import annotations

from importlib import import_module
from typing import Any

from docutils import nodes
from sphinx.addnodes import pending_xref
from sphinx.application import Sphinx
from sphinx.environment import BuildEnvironment
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
PAGE_OF_BUILTIN = {
    "None": "constants",
    "ValueError": "exceptions",
    "Exception": "exceptions",
    "object": "functions",
    "type": "functions",
}
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
NAMED = "calib-name"


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


def resolve(app: Sphinx, env: BuildEnvironment, node: pending_xref, content: nodes.TextElement) -> nodes.Element | None:
    """A name that no page of ours explains: a link to the library's page, or the name alone where it exists."""
    if node.get("reftype") == NAMED:
        page = documented(env, node["reftarget"])
        return make_refnode(app.builder, node["refdoc"], *page, content, node["reftarget"]) if page else content
    if node.get("refdomain") != "py":
        return None
    name = node["reftarget"].removeprefix("builtins.").replace("._local.", ".").replace("._base.", ".")
    short = name.rpartition(".")[2]
    if content.astext() == node["reftarget"]:
        content = nodes.Text(short) if isinstance(content, nodes.Text) else type(content)("", short)
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
    if any(exists(one) for one in known):
        return content
    return None


def named(
    name: str, rawtext: str, text: str, lineno: int, inliner: Any, *_: Any
) -> tuple[list[nodes.Node], list[nodes.system_message]]:
    """The role of plain backticks: a link where one class or function has this name, and code in any case."""
    words = nodes.literal(rawtext, text, classes=["py", "py-obj"])
    docname = inliner.document.settings.env.docname
    return [pending_xref("", words, reftype=NAMED, reftarget=text, refdomain="", refdoc=docname)], []


def documented(env: BuildEnvironment, name: str) -> tuple[str, str] | None:
    """Page and anchor of what has this name behind the last dot, where there is one such thing only."""
    objects = env.domains.python_domain.objects
    if _places.get("(count)") != len(objects):
        _places.clear()
        for full, entry in objects.items():
            if entry.objtype in ("class", "exception", "function", "type"):
                for known in {full, full.rpartition(".")[2]}:
                    _places.setdefault(known, set()).add((entry.docname, entry.node_id))
        _places["(count)"] = len(objects)
    found = _places.get(name, set())
    return next(iter(found)) if len(found) == 1 else None


_places: dict[str, Any] = {}  # by name, made anew when more pages are known
