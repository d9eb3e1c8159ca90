"""Damage to TOML, JSON, XML and Python files, and changes that leave their meaning."""

from __future__ import annotations

import json
import re
import xml.etree.ElementTree as ET
from collections.abc import Callable
from typing import Any

from soaking.inputs import odd_values
from soaking.inputs.odd_values import Rng, at
from tests.support.robot_mutations import mutated

Change = Callable[[Rng, bytes], bytes]
_KEY = re.compile(rb"(?m)^(\w+)( *= *)(.*)$")


# ---- TOML -----------------------------------------------------------------------------------------------------------


def _toml_value(rng: Rng, content: bytes) -> bytes:
    """Another value for one to three keys."""
    odd = [
        "[" * 900 + "]" * 900, "{}", "[]", '""', '"text"', "true", "1979-05-27T07:32:00Z", "[1, [2, 'a']]", '"\\u202e"',
        f'"{"a" * 5000}"', "'''a\nb'''", "{a = 1}", "-9223372036854775809", "[nan, nan, nan]", "[1e308, 1e308, 1e308]",
    ]  # fmt: skip
    for _ in range(int(rng.integers(1, 4))):
        keys = list(_KEY.finditer(content))
        if not keys:
            return content
        key = keys[at(rng, len(keys))]
        value = str(rng.choice(odd)) if rng.random() < 0.5 else odd_values.number(rng)
        content = content[: key.start(3)] + value.encode() + content[key.end(3) :]
    return content


def _toml_key(rng: Rng, content: bytes) -> bytes:
    """A key left out, renamed, doubled, or in another table."""
    keys = list(_KEY.finditer(content))
    key = keys[at(rng, len(keys))]
    kind = int(rng.integers(4))
    if kind == 0:
        return content[: key.start()] + content[key.end() :]
    if kind == 1:
        return content[: key.start()] + b"unknown" + content[key.end(1) :]
    where = key.end() if kind == 2 else keys[at(rng, len(keys))].start()
    return content[:where] + b"\n" + key[0] + b"\n" + content[where:]


def _toml_table(rng: Rng, content: bytes) -> bytes:
    """A table left out, doubled or moved; or very many of them."""
    parts = re.split(rb"(?m)^(?=\[)", content)
    i, j = at(rng, len(parts)), at(rng, len(parts))
    kind = int(rng.integers(4))
    if kind == 0:
        del parts[i]
    elif kind == 1:
        parts.insert(j, parts[i])
    elif kind == 2:
        parts[i], parts[j] = parts[j], parts[i]
    else:
        parts += [parts[-1]] * 300
    return b"".join(parts)


_FLOAT = re.compile(rb"(?<![\w.\"])-?\d+\.\d+(?![\w.])")


def _toml_plausible(rng: Rng, content: bytes) -> bytes:
    """A TOML document with one to three decimals larger, smaller, negative, zero, or another's."""
    for _ in range(int(rng.integers(1, 4))):
        found = list(_FLOAT.finditer(content))
        if not found:
            break
        one, other = found[at(rng, len(found))], found[at(rng, len(found))]
        factor = float(rng.choice([-1.0, 0.0, 2.0, 0.5, 1e-6, 10.0, 1000.0]))
        new = other[0] if rng.random() < 0.2 else repr(float(one[0]) * factor).encode()
        content = content[: one.start()] + new + content[one.end() :]
    return content


TOML_CHANGES: dict[str, Change] = {
    **{f"plausible numbers {k}": _toml_plausible for k in (1, 2, 3, 4)},
    "values": _toml_value,
    "values again": _toml_value,
    "keys": _toml_key,
    "tables": _toml_table,
    **odd_values.BYTES,
}


def _toml_comments(rng: Rng, content: bytes) -> bytes:
    return b"# a comment\n" + re.sub(rb"(?m)^(\[.*\])$", rb"\n# of a table\n\1  # and beside it", content)


def _toml_blanks(rng: Rng, content: bytes) -> bytes:
    return _KEY.sub(rb"  \1   =   \3", content)


def _toml_order(rng: Rng, content: bytes) -> bytes:
    """The keys before the first table in another order, where each is a line."""
    head, first, rest = content.partition(b"\n[")
    lines = head.split(b"\n")
    if not all(_KEY.fullmatch(line) and not line.endswith(b"[") for line in lines if line):
        return content
    return b"\n".join(lines[int(k)] for k in rng.permutation(len(lines))) + first + rest


TOML_SAME: dict[str, Change] = {
    "comments": _toml_comments,
    "blanks about =": _toml_blanks,
    "keys in another order": _toml_order,
    "byte order mark": odd_values.byte_order_mark,
    "line ends": odd_values.windows_lines,
    "empty lines at the end": odd_values.blank_lines,
}


# ---- JSON -----------------------------------------------------------------------------------------------------------


def _places(tree: Any) -> list[tuple[Any, Any]]:
    """Every (container, key) of a document."""
    out, todo = [], [tree]
    while todo:
        node = todo.pop()
        items = node.items() if isinstance(node, dict) else enumerate(node) if isinstance(node, list) else ()
        for key, value in items:
            out.append((node, key))
            todo.append(value)
    return out


def _json_values(rng: Rng, content: bytes) -> bytes:
    """A JSON document with one to three values replaced, left out, doubled, or exchanged for one another."""
    tree = json.loads(content)
    odd: list[Any] = [
        None, True, 0, -1, 1e308, float("nan"), float("inf"), 10**400, "", "a" * 5000, [], {}, [[]], {"a": 1},
        "../../x", "\u202e", "\x00", [1] * 10000, 1e-320, "smooth_joint_error", "joint_step",
    ]  # fmt: skip
    for _ in range(int(rng.integers(1, 4))):
        places = _places(tree)
        if not places:
            break
        node, key = places[at(rng, len(places))]
        kind = int(rng.integers(5))
        if kind == 0:
            del node[key]
        elif kind == 1 and isinstance(node, list):
            node.insert(key, node[key])
        elif kind == 2:
            other, theirs = places[at(rng, len(places))]
            node[key] = json.loads(json.dumps(other[theirs]))
        elif kind == 3 and isinstance(node[key], float):
            node[key] *= float(rng.choice([-1.0, 1e3, 1e-3, 1e30, 0.0]))
        else:
            node[key] = odd[at(rng, len(odd))]
    return json.dumps(tree).encode()


def _json_deep(rng: Rng, content: bytes) -> bytes:
    deep = int(rng.choice([100, 900, 100_000]))
    found = list(re.finditer(rb": ", content))
    where = found[at(rng, len(found))].end()
    return content[:where] + b"[" * deep + b"]" * deep + content[where:]


JSON_CHANGES: dict[str, Change] = {
    "values": _json_values,
    "values again": _json_values,
    "values once more": _json_values,
    "nesting": _json_deep,
    **odd_values.BYTES,
}


def _json_order(rng: Rng, content: bytes) -> bytes:
    """The keys of every object in another order; those of the same object hold what they held."""

    def shuffled(tree: Any) -> Any:
        if isinstance(tree, dict):
            keys = list(tree)
            return {keys[int(k)]: shuffled(tree[keys[int(k)]]) for k in rng.permutation(len(keys))}
        return [shuffled(value) for value in tree] if isinstance(tree, list) else tree

    return json.dumps(shuffled(json.loads(content))).encode()


def _json_indent(rng: Rng, content: bytes) -> bytes:
    return json.dumps(json.loads(content), indent=int(rng.integers(0, 9))).encode()


JSON_SAME: dict[str, Change] = {"indents": _json_indent, "line ends": odd_values.windows_lines}


# ---- XML ------------------------------------------------------------------------------------------------------------


def _xml_elements(rng: Rng, content: bytes) -> bytes:
    """Elements left out, doubled, moved; attributes replaced."""
    root = ET.fromstring(content)
    for _ in range(int(rng.integers(1, 4))):
        pairs = [(parent, child) for parent in root.iter() for child in parent]
        if not pairs:
            break
        (parent, child), (other, _) = pairs[at(rng, len(pairs))], pairs[at(rng, len(pairs))]
        kind = int(rng.integers(5))
        if kind == 0:
            parent.remove(child)
        elif kind == 1:
            parent.append(child)
        elif kind == 2 and other is not child and other not in child.iter():
            parent.remove(child)
            other.insert(0, child)
        elif child.attrib:
            name = list(child.attrib)[at(rng, len(child.attrib))]
            parts = child.attrib[name].split() or [""]
            parts[at(rng, len(parts))] = re.sub(r"[\x00-\x1f\ufffe]", "", odd_values.cell(rng))
            child.attrib[name] = " ".join(parts)
    return ET.tostring(root, encoding="utf-8")


def _xml_bomb(rng: Rng, content: bytes) -> bytes:
    """Entities of entities, an entity of another file, or very many levels."""
    if rng.random() < 0.3:
        at_root = content.rindex(b"</")
        return content[:at_root] + b"<link>" * 5000 + content[at_root:]
    entities = "".join(f'<!ENTITY e{k} "{f"&e{k - 1};" * 10 if k else "a" * 50}">' for k in range(9))
    if rng.random() < 0.3:
        entities = '<!ENTITY e8 SYSTEM "file:///etc/hostname">'
    body = re.sub(rb"^<\?xml.*?\?>", b"", content.lstrip(), count=1)
    body = re.sub(rb'name="[^"]*"', b'name="&e8;"', body, count=1)
    return f"<!DOCTYPE robot [{entities}]>".encode() + body


XML_CHANGES: dict[str, Change] = {
    "elements": _xml_elements,
    "elements again": _xml_elements,
    "entities": _xml_bomb,
    "an editor's slip": lambda rng, content: mutated(content, rng),
    **odd_values.BYTES,
}


def _xml_order(rng: Rng, content: bytes) -> bytes:
    """Links and joints of a URDF in another order."""
    root = ET.fromstring(content)
    children = list(root)
    root[:] = [children[int(k)] for k in rng.permutation(len(children))]
    return ET.tostring(root)


def _xml_attributes(rng: Rng, content: bytes) -> bytes:
    """The attributes of each element in another order."""
    root = ET.fromstring(content)
    for element in root.iter():
        items = list(element.attrib.items())
        element.attrib.clear()
        element.attrib.update(dict(items[int(k)] for k in rng.permutation(len(items))))
    return ET.tostring(root)


def _xml_comments(rng: Rng, content: bytes) -> bytes:
    return content.replace(b">\n", b">\n<!-- a comment -->\n")


XML_SAME: dict[str, Change] = {
    "attributes in another order": _xml_attributes,
    "comments": _xml_comments,
    "line ends": odd_values.windows_lines,
}
XACRO_SAME = {name: XML_SAME[name] for name in ("comments", "line ends")}  # it knows its own prefix alone
URDF_SAME: dict[str, Change] = {"elements in another order": _xml_order, **XML_SAME}

TEXT_CHANGES: dict[str, Change] = {
    "an editor's slip": lambda rng, content: mutated(content, rng),
    **odd_values.BYTES,
}
TEXT_SAME: dict[str, Change] = {
    "line ends": odd_values.windows_lines,
    "empty lines at the end": odd_values.blank_lines,
}
