"""MuJoCo models (MJCF), compiled by MuJoCo itself (the extra `mujoco`) and read as a serial chain.

MuJoCo is not given the user's file. The parts of a serial arm are copied from it and its includes into one text:
bodies, joints, masses, shapes with their meshes, the defaults of these, and joints that follow others. Every file that
is named lies in the model's folder or below it. The text and the meshes go to MuJoCo in a process of its own with
bounded memory and time (`mjcf_process`), which reads no other file.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from xml.sax.saxutils import quoteattr

import numpy as np

from calib.bounded_process import ProcessFailed, ProcessLimits, ask
from calib.robot_formats.chain.serial_chain import ChainJoint, RobotFileError, SerialChain
from calib.robot_formats.urdf.safe_xml import Element, XmlFile, parse_xml, read_bytes

_LIMITS = ProcessLimits(seconds=60.0, memory_bytes=2 * 1024**3)
_MOST_FILES = 500
_MOST_BYTES = 512 * 1024**2  # of all meshes
_MOST_ELEMENTS = 100_000
_MOST_DEPTH = 200
_REFUSED = {  # code, other models, or any number of parts and any size of memory
    "plugin", "extension", "replicate", "composite", "flexcomp", "size", "attach", "model",
}  # fmt: skip
_IN_BODIES = {"body", "frame", "inertial", "joint", "freejoint", "geom", "site"}
_KEPT = {  # children by element; all else says nothing of where joints and masses are
    "mujoco": {"compiler", "option", "default", "asset", "worldbody", "equality"},
    "default": {"default", "mesh", "joint", "geom", "site"},
    "asset": {"mesh"},
    "equality": {"joint"},
    "worldbody": _IN_BODIES,
    "body": _IN_BODIES,
    "frame": _IN_BODIES,
}
_DIRECTORIES = {"meshdir", "assetdir", "texturedir", "strippath"}
_LEFT_OUT = {"material", "hfield"}  # attributes that name what is not kept


def chain_of_mjcf(file: XmlFile, tip: str | None, base: str | None) -> SerialChain:
    """Chain of the arm from a base body (None: the world) to a tip, a body or a site (None: the only end body).

    Raises RobotFileError in one line: MuJoCo is not installed or refuses the model, several tips, no serial arm.
    """
    model = _Model(file)
    request = {
        "text": model.text(),
        "meshes": {name: str(path) for name, path in model.meshes.items()},
        "file": str(file.path),
        "lines": model.lines,
        "tip": tip,
        "base": base,
    }
    try:
        answer = ask("calib.robot_formats.mjcf_process:answer", request, _LIMITS)
    except ProcessFailed as error:
        raise RobotFileError(
            f"{file.path}: MuJoCo cannot read it: it {error}; give the arm alone, or its URDF"
        ) from None
    if "error" in answer:
        raise RobotFileError(answer["error"])
    return chain_from_document(answer)


def chain_from_document(document: Mapping[str, Any]) -> SerialChain:
    """Chain from the dict that `mjcf_process` returns."""
    joints = tuple(
        ChainJoint(
            **joint
            | {
                "before_T_joint": np.array(joint["before_T_joint"]),
                "axis": tuple(joint["axis"]),
                "com_mm": tuple(joint["com_mm"]),
            }
        )
        for joint in document["joints"]
    )
    arrays = {
        "joints": joints,
        "last_T_tip": np.array(document["last_T_tip"]),
        "gravity_m_s2": tuple(document["gravity_m_s2"]),
    }
    return SerialChain(**{**document, **arrays})


@dataclass
class _Model:
    """A model and its includes, rewritten as a single text for MuJoCo."""

    file: XmlFile
    meshes: dict[str, Path] = field(default_factory=dict)  # by their names in the text
    lines: dict[str, int] = field(default_factory=dict)  # of names in the user's file; "" is the whole

    def __post_init__(self) -> None:
        self._folder = self.file.path.parent
        self._included = {self.file.path.resolve()}
        self._count = self._bytes = 0
        self._places: dict[str, str] = {}
        self.lines[""] = self.file.root.line

    def text(self) -> str:
        """Text for MuJoCo. Raises RobotFileError for elements outside serial arms and for files outside the folder."""
        root = self._whole(self.file, self.file.root, 0)
        for element in _below(root):
            if element.tag == "compiler":
                kept = {key: value for key, value in element.attributes.items() if key in _DIRECTORIES}
                self._places |= kept  # of several the last one counts, wherever the mesh stands
        return "".join(self._written(root))

    def _whole(self, file: XmlFile, element: Element, depth: int) -> Element:
        """Element with its includes replaced by their content, each child with the file of its origin."""
        self._count += 1
        if self._count > _MOST_ELEMENTS or depth > _MOST_DEPTH:
            file.fail(element, "too many elements or levels", "a serial arm has a few hundred")
        if element.tag in _REFUSED:
            file.fail(element, f"found <{element.tag}>", "a serial arm needs none; leave it out")
        name = element.attributes.get("name")
        if file is self.file and name is not None:
            self.lines.setdefault(name, element.line)
        children = self._children(file, element, depth + 1)
        return Element(element.tag, element.attributes, element.line, element.start, children, file.path)

    def _children(self, file: XmlFile, element: Element, depth: int) -> list[Element]:
        """Children of an element, with each <include> replaced by the children in the included file."""
        children: list[Element] = []
        for child in element.children:
            if child.tag == "include":
                inside = self._include(file, child)
                children += self._children(inside, inside.root, depth + 1)
            else:
                children.append(self._whole(file, child, depth))
        return children

    def _include(self, file: XmlFile, element: Element) -> XmlFile:
        """Parsed file of an <include>: relative to the model, as in MuJoCo, or to the including file."""
        name = element.attributes.get("file", "")
        path = self._inside(file, element, self._folder / name)
        if not path.is_file():
            path = self._inside(file, element, file.path.parent / name)
        if path.resolve() in self._included:
            file.fail(element, f"includes {name[:60]!r} twice", "MuJoCo takes each file once")
        self._included.add(path.resolve())
        if len(self._included) > _MOST_FILES:
            file.fail(element, "too many included files", "a robot has a few")
        return parse_xml(path, read_bytes(path))

    def _inside(self, file: XmlFile, element: Element, path: Path) -> Path:
        """The path unchanged. Raises RobotFileError where it leads, links followed, outside the model's folder."""
        if not path.resolve().is_relative_to(self._folder.resolve()):
            name = element.attributes.get("file", "")
            file.fail(element, f"names {name[:60]!r}, which is not below its folder", "put it there")
        return path

    def _written(self, element: Element) -> Iterator[str]:
        """Text of an element with those of its children that MuJoCo is to read."""
        attributes = {key: value for key, value in element.attributes.items() if key not in _LEFT_OUT}
        if element.tag == "compiler":
            attributes = {key: value for key, value in attributes.items() if key not in _DIRECTORIES}
        if element.tag == "mesh" and "file" in attributes:
            attributes = self._mesh(element, attributes)
        yield f"<{element.tag}"
        for key, value in attributes.items():
            yield f" {key}={quoteattr(value)}"
        yield ">"
        kept = _KEPT.get(element.tag, set())
        for child in element.children:
            if child.tag in kept and not _is_height_field(child):
                yield from self._written(child)
        yield f"</{element.tag}>"

    def _mesh(self, element: Element, attributes: dict[str, str]) -> dict[str, str]:
        """Attributes of a mesh, its file replaced by a name for the bytes that are passed to MuJoCo."""
        name = attributes["file"]
        assert element.file is not None
        named_in = XmlFile(element.file, b"", element)
        short = Path(name).name if self._places.get("strippath") == "true" else name
        directory = self._places.get("meshdir", self._places.get("assetdir", ""))
        path = self._inside(named_in, element, self._folder / directory / short)
        try:
            self._bytes += path.stat().st_size
            if not path.is_file():
                named_in.fail(element, f"{name[:60]!r} is no file", "name a mesh")
        except OSError as error:
            named_in.fail(element, f"names {name[:60]!r}: {error.strerror}", f"put it to {directory or 'its folder'}")
        if self._bytes > _MOST_BYTES or len(self.meshes) >= _MOST_FILES:
            named_in.fail(element, "too many or too large meshes", "a robot's have a few MB")
        key = f"mesh{len(self.meshes)}{path.suffix.lower()}"
        self.meshes[key] = path.resolve()
        return attributes | {"name": attributes.get("name", Path(name).stem), "file": key}


def _below(root: Element) -> Iterator[Element]:
    waiting = [root]
    while waiting:
        element = waiting.pop()
        yield element
        waiting += reversed(element.children)


def _is_height_field(element: Element) -> bool:
    return element.tag == "geom" and (element.attributes.get("type") == "hfield" or "hfield" in element.attributes)
