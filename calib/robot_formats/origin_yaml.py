"""Joint origins in makers' YAML (UR, UFACTORY, Flexiv, Franka), read and written by changing numbers only.

Metres and radians, a block `x y z roll pitch yaw` per joint, which the maker's xacro puts into its <origin>. Joints
turn about their z axis. rpy is about fixed axes, as in URDF.

The YAML is nested `key: value` by indentation, and `{key: value}` on one line. Anchors and tags (but !degrees and
!radians) are refused with their line; lists and texts over several lines hold no joint and are passed over. Each value
keeps its position in the text, so that a writer may change it and leave every other character as it is.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass, field
from pathlib import Path
from typing import NoReturn

import numpy as np

from calib.array_types import Array
from calib.frames import make_transform, rotation_from_rpy, rpy_from_rotation
from calib.robot_formats.chain.serial_chain import ChainJoint, RobotFileError, SerialChain
from calib.robot_formats.urdf.safe_xml import read_bytes

_MOST_BYTES = 1024 * 1024
_MOST_DEPTH = 20
_MOST_CHARACTERS = 1000  # of a line
_LINE = re.compile(r"""(?P<space>[ \t]*)(?P<key>"[^"]*"|'[^']*'|[^\s:#'"{}\[\]&*!|>-][^:#{}\[\]]*?)\s*:(?=\s|$)""")
_PAIR = re.compile(r"""(?P<key>"[^"]*"|'[^']*'|[^\s:,{}]+)\s*:\s*(?P<value>[^,{}]*)""")
_MAP = re.compile(rf"\{{\s*(?:{_PAIR.pattern.replace('?P<key>', '?:').replace('?P<value>', '?:')}(?:,\s*|(?=\}})))*\}}")
_OF_JOINT = re.compile(r"joint|link|axis|shoulder|arm|wrist", re.IGNORECASE)
_COMMENT = re.compile(r"(^|\s)#.*$")


@dataclass(frozen=True)
class YamlNode:
    """A value of a YAML file: a text, or the nodes below it by key."""

    line: int
    text: str = ""
    start: int = 0  # of the text in the file's characters
    children: dict[str, YamlNode] = field(default_factory=dict)


@dataclass(frozen=True)
class YamlFile:
    """A YAML file with its text and its nodes."""

    path: Path
    text: str
    root: YamlNode

    def fail(self, line: int, found: str, remedy: str) -> NoReturn:
        """Raise RobotFileError that names file, line, what was found and a remedy."""
        raise RobotFileError(f"{self.path}: line {line}: {found}; {remedy}")


def read_yaml(path: Path) -> YamlFile:
    """Read a YAML file in the subset of makers' kinematics files. Raises RobotFileError with the line otherwise."""
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
        if match is None:  # a list, or the rest of a text: no block of a joint
            continue
        if "\t" in match["space"]:
            file.fail(number, "the line is indented by tabs", "indent by spaces")
        indent = len(match["space"])
        while open_[-1][0] >= indent:
            open_.pop()
        parent = open_[-1][1]
        if parent.text:
            file.fail(number, f"{match['key'][:40]!r} is indented below a value", "indent it as its neighbours")
        rest = line[match.end() :]
        node = _value(file, number, rest.strip(), start + match.end() + len(rest) - len(rest.lstrip()))
        _add(file, parent, match["key"], node)
        open_.append((indent, node))
        if len(open_) > _MOST_DEPTH:
            file.fail(number, "too many levels", "a kinematics file has three or four")
    return file


def _value(file: YamlFile, line: int, text: str, start: int) -> YamlNode:
    """Node of the text behind `key:`."""
    if not text.startswith("{"):
        if text[:1] in ("&", "*") or (text[:1] == "!" and not text.startswith(("!degrees", "!radians"))):
            file.fail(line, f"found {text[:40]!r}", "a number or a text is needed")
        return YamlNode(line, text, start)
    if not _MAP.fullmatch(text):
        file.fail(line, f"found {text[:40]!r}", "give {key: value, ...} on one line")
    node = YamlNode(line)
    for pair in _PAIR.finditer(text):
        _add(file, node, pair["key"], YamlNode(line, pair["value"].strip(), start + pair.start("value")))
    return node


def _add(file: YamlFile, parent: YamlNode, key: str, node: YamlNode) -> None:
    key = key.strip("\"'").strip()
    if key in parent.children:
        file.fail(node.line, f"{key[:40]!r} stands there twice", "remove one")
    parent.children[key] = node


KEYS = ("x", "y", "z", "roll", "pitch", "yaw")
_UR_LINKS = ("shoulder", "upper_arm", "forearm", "wrist_1", "wrist_2", "wrist_3")
_FRANKA_FLANGE = "joint8"  # no joint: the flange behind joint 7
_SAME = 5e-13  # m or rad
_MOST = 1e6


@dataclass(frozen=True)
class OriginYaml:
    """A kinematics file with its blocks in the order of the joints."""

    file: YamlFile
    blocks: dict[str, YamlNode]  # by name of the joint or link
    flange: YamlNode | None = None


def read_origin_yaml(path: Path) -> OriginYaml:
    """Read a kinematics file. Raises RobotFileError with file and line."""
    file = read_yaml(path)
    top = file.root.children.get("kinematics", file.root)
    blocks = {}
    for name, node in top.children.items():
        block = node.children.get("kinematic", node)
        if any(key in block.children for key in KEYS):
            missing = [key for key in KEYS if key not in block.children]
            if missing == list(KEYS[3:]) and not _OF_JOINT.search(name):  # a place alone, as of a centre of mass
                continue
            if missing:
                file.fail(block.line, f"{name} has no {', '.join(missing)}", "a block has x y z roll pitch yaw")
            blocks[name] = block
    if not blocks:
        raise RobotFileError(
            f"{path}: line {top.line}: found no block of x y z roll pitch yaw; a kinematics file has one a joint"
        )
    if set(blocks) == set(_UR_LINKS):
        blocks = {name: blocks[name] for name in _UR_LINKS}
    elif all(re.fullmatch(r"joint_?\d+", name) for name in blocks):
        blocks = dict(sorted(blocks.items(), key=lambda item: int(re.sub(r"\D", "", item[0]))))
    nested = any("kinematic" in node.children for node in top.children.values())
    flange = blocks.pop(_FRANKA_FLANGE, None) if nested else None
    return OriginYaml(file, blocks, flange)


def chain_of_yaml(origins: OriginYaml) -> SerialChain:
    """Chain of a kinematics file; each joint turns about z of its block's frame."""
    places = [_place(origins.file, name, block) for name, block in origins.blocks.items()]
    end = np.eye(4) if origins.flange is None else _place(origins.file, _FRANKA_FLANGE, origins.flange)
    joints = tuple(ChainJoint(name, place) for name, place in zip(origins.blocks, places, strict=True))
    notes = ["the joints turn about z of their blocks, as in the makers' descriptions; limits and masses are not in it"]
    chain = SerialChain(origins.file.path.stem, joints, end)
    if set(origins.blocks) == set(_UR_LINKS):
        notes.append(
            "rpy are read about fixed axes, as URDF reads them; the exporter of UR's driver writes turns about moving "
            "axes there"
        )
    return SerialChain(chain.name, chain.joints, chain.last_T_tip, notes=tuple(notes))


def with_yaml_origins(origins: OriginYaml, chain: SerialChain) -> tuple[str, tuple[str, ...]]:
    """Text of a YAML of joint origins with those of a serial chain instead, and the names of the changed joints."""
    wanted = [joint.before_T_joint for joint in chain.joints]
    blocks = list(origins.blocks.items())
    if origins.flange is not None:
        blocks.append((_FRANKA_FLANGE, origins.flange))
        wanted.append(chain.last_T_tip)
    text, edits, changed = origins.file.text, [], []
    for (name, block), place in zip(blocks, wanted, strict=True):
        before = _place(origins.file, name, block)
        new: dict[str, float] = {}
        if np.abs(place[:3, 3] - before[:3, 3]).max() > 1e3 * _SAME:
            new |= dict(zip("xyz", map(float, 1e-3 * place[:3, 3]), strict=True))
        if np.abs(place[:3, :3] - before[:3, :3]).max() > _SAME:
            new |= dict(zip(KEYS[3:], map(float, rpy_from_rotation(place[:3, :3])), strict=True))
        if new:
            changed.append(name)
        for key, value in new.items():
            node = block.children[key]
            edits.append((node.start, node.start + len(node.text), repr(value + 0.0)))
    for start, end, number in sorted(edits, reverse=True):
        text = text[:start] + number + text[end:]
    return text, tuple(changed)


def plain_yaml(chain: SerialChain) -> str:
    """Text of a new kinematics file for a chain whose joints turn about z. Raises RobotFileError for others."""
    lines = ["kinematics:"]
    for k, joint in enumerate(chain.joints, 1):
        if not joint.is_revolute or not np.allclose(joint.axis, (0.0, 0.0, 1.0), atol=1e-12):
            raise RobotFileError(
                f"robot {chain.name}: joint {k} does not turn about z; a kinematics file has such only"
            )
        values = [*(1e-3 * joint.before_T_joint[:3, 3]), *rpy_from_rotation(joint.before_T_joint[:3, :3])]
        lines.append(f"  {joint.name}:" if re.fullmatch(r"[\w-]+", joint.name) else f"  joint{k}:")
        lines += [f"    {key}: {float(value) + 0.0!r}" for key, value in zip(KEYS, values, strict=True)]
    return "\n".join([*lines, ""])


def _place(file: YamlFile, name: str, block: YamlNode) -> Array:
    """Transform (4, 4) of a block, mm."""
    x, y, z, *rpy = (number_of(file, name, key, block.children[key]) for key in KEYS)
    return make_transform(rotation_from_rpy(rpy), 1e3 * np.array([x, y, z]))


def number_of(file: YamlFile, name: str, key: str, node: YamlNode) -> float:
    """Number of a node, m or rad. Raises RobotFileError, which calls it `key` of `name`."""
    text, scale = node.text, 1.0
    if text.startswith("!degrees"):
        text, scale = text.removeprefix("!degrees"), math.pi / 180.0
    try:
        value = float(text.removeprefix("!radians").strip().strip("\"'")) * scale
    except ValueError:
        value = math.nan
    if not abs(value) <= _MOST or "_" in text:
        file.fail(node.line, f"{key} of {name} is {node.text[:40]!r}", "a number in metres or radians is needed")
    return value
