"""Joint targets as point lists for controllers: URScript, KUKA KRL, ABB RAPID.

Joint values are those that the controller is commanded with, as in poses.csv: URScript in rad, the others in degrees.
Sources: Universal Robots, *The URScript Programming Language* (lists of joint positions, rad); KUKA, *KSS System
Software, Operating and Programming Instructions for System Integrators* (structure AXIS, `.dat` files); ABB, *Technical
reference manual, RAPID Instructions, Functions and Data types* (`jointtarget`, 9E9 for an axis that is not connected).
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from calib.array_types import Array
from calib.errors import CalibError
from calib.robot_formats.programs.reserved_words import RESERVED

JOINTS = 6  # that a joint position of these languages holds
LONGEST = {
    ".script": 64,
    ".dat": 24,
    ".mod": 32,
}  # characters of a name: KRL 24, RAPID 32; URScript tells no limit
LANGUAGES = {".script": "URScript", ".dat": "KRL", ".mod": "RAPID"}
_COMMENT = {".script": "#", ".dat": ";", ".mod": "!"}


def is_point_list(path: Path) -> bool:
    """Whether a file of this name holds a controller's point list."""
    return path.suffix.lower() in LANGUAGES


def require_point_list(path: Path, is_revolute: Sequence[bool]) -> None:
    """Raise CalibError for an arm that this controller's joint positions cannot hold."""
    language = LANGUAGES[path.suffix.lower()]
    if list(is_revolute) != [True] * JOINTS:
        turning = sum(map(bool, is_revolute))
        sliding = len(is_revolute) - turning
        raise CalibError(
            f"{path}: a joint position of {language} holds six turning joints, this arm has {turning}"
            + (f" and {sliding} sliding" if sliding else "")
            + "; write the targets as .csv"
        )


@dataclass(frozen=True)
class JointTarget:
    """A place to go to, under the name that a user knows it by."""

    name: str
    q: Array  # (n,) rad or mm, as it is commanded
    left_out: str = ""  # why it is not to be gone to; "" where it is


def point_list(path: Path, targets: Sequence[JointTarget], heading: Sequence[str]) -> str:
    """The targets in the language that the file's name tells; those that are left out as comments with the reason.

    heading: lines that say what they are, put first as comments. For an arm that `require_point_list` takes.
    """
    suffix = path.suffix.lower()
    comment = _COMMENT[suffix]
    whole, *names = identifiers([path.stem, *(target.name for target in targets)], LONGEST[suffix])
    unit = "rad" if suffix == ".script" else "degrees"
    lines = [f"{comment} {_plain(words)}" for words in (*heading, f"Joint values in {unit}.")]
    for name, target in zip(names, targets, strict=True):
        said = f"  {comment} {_plain(target.name)}" if name != target.name else ""
        if target.left_out:
            lines.append(f"{comment} {name} is left out: {_plain(target.left_out)}")
        else:
            lines.append(_line(suffix, name, target.q) + said)
    return "\n".join(_wrapped(suffix, whole, lines)) + "\n"


def _line(suffix: str, name: str, q: Array) -> str:
    if suffix == ".script":
        return f"{name} = [{', '.join(f'{v:.9f}' for v in q)}]"
    angles = [f"{v:.7f}" for v in np.degrees(q)]
    if suffix == ".dat":
        return f"DECL GLOBAL AXIS {name}={{{','.join(f'A{k} {v}' for k, v in enumerate(angles, 1))}}}"
    return f"  CONST jointtarget {name}:=[[{','.join(angles)}],[{','.join(['9E9'] * JOINTS)}]];"


def _wrapped(suffix: str, name: str, lines: list[str]) -> list[str]:
    if suffix == ".dat":
        return [f"DEFDAT {name} PUBLIC", *lines, "ENDDAT"]
    if suffix == ".mod":
        return [f"MODULE {name}", *lines, "ENDMODULE"]
    return lines


def identifiers(ids: Sequence[str], longest: int) -> list[str]:
    """Names that all three languages take, each its own without regard to case: letters, digits and underscores.

    A word that one of the languages keeps for itself stands behind `p_`.
    """
    out: list[str] = []
    taken: set[str] = set()
    for pose_id in ids:
        base = re.sub(r"[^A-Za-z0-9_]", "_", pose_id)
        base = (base if base[:1].isalpha() else f"p{base}")[:longest]
        base = f"p_{base}"[:longest] if base.lower() in RESERVED else base
        name, number = base, 1
        while name.lower() in taken:
            number += 1
            name = f"{base[: longest - len(str(number)) - 1]}_{number}"
        taken.add(name.lower())
        out.append(name)
    return out


def _plain(text: str) -> str:
    """Text for a comment: one line of printable ASCII."""
    return re.sub(r"[^ -~]", "?", " ".join(text.split()))
