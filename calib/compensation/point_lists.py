"""Corrected joint targets as point lists for controllers: URScript, KUKA KRL, ABB RAPID.

Joint values are those that the controller is commanded with, as in poses.csv: URScript in rad, the others in degrees.
Sources: Universal Robots, *The URScript Programming Language* (lists of joint positions, rad); KUKA, *KSS System
Software, Operating and Programming Instructions for System Integrators* (structure AXIS, `.dat` files); ABB, *Technical
reference manual, RAPID Instructions, Functions and Data types* (`jointtarget`, 9E9 for an axis that is not connected).
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from calib.array_types import Array
from calib.compensation.target_correction import Correction
from calib.compensation.targets_csv import Targets, corrected_table
from calib.errors import CalibError

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


def corrected_file(path: Path, targets: Targets, correction: Correction) -> str:
    """What a file of this name is to hold: a controller's point list, or the table with corrected joints."""
    if is_point_list(path):
        return point_list(path, correction, targets.poses.ids)
    return corrected_table(targets, correction)


def point_list(path: Path, correction: Correction, ids: Sequence[str]) -> str:
    """The targets that are reached, in the language that the file's name tells; the others as comments with the reason.

    Raises as `require_point_list`.
    """
    suffix = path.suffix.lower()
    require_point_list(path, correction.robot.is_revolute.tolist())
    comment = _COMMENT[suffix]
    names = identifiers(ids, LONGEST[suffix])
    commanded = correction.robot.commands_of(correction.q)
    lines = [
        f"{comment} {words}"
        for words in (
            f"Joint targets of {_plain(correction.robot.name)}, corrected for the calibrated arm ({correction.what}).",
            f"{int(correction.reached.sum())} of {len(names)} targets are reached; joint values in "
            f"{'rad' if suffix == '.script' else 'degrees'}.",
        )
    ]
    for name, pose_id, q, reached, reason in zip(
        names, ids, commanded, correction.reached, correction.reasons, strict=True
    ):
        said = f"  {comment} {_plain(pose_id)}" if name != pose_id else ""
        if reached:
            lines.append(_line(suffix, name, q) + said)
        else:
            lines.append(f"{comment} {name} is left out: {_plain(reason)}")
    return "\n".join(_wrapped(suffix, path.stem, lines)) + "\n"


def _line(suffix: str, name: str, q: Array) -> str:
    if suffix == ".script":
        return f"{name} = [{', '.join(f'{v:.9f}' for v in q)}]"
    angles = [f"{v:.7f}" for v in np.degrees(q)]
    if suffix == ".dat":
        return f"DECL GLOBAL AXIS {name}={{{','.join(f'A{k} {v}' for k, v in enumerate(angles, 1))}}}"
    return f"  CONST jointtarget {name}:=[[{','.join(angles)}],[{','.join(['9E9'] * JOINTS)}]];"


def _wrapped(suffix: str, stem: str, lines: list[str]) -> list[str]:
    name = identifiers([stem], LONGEST[suffix])[0]
    if suffix == ".dat":
        return [f"DEFDAT {name} PUBLIC", *lines, "ENDDAT"]
    if suffix == ".mod":
        return [f"MODULE {name}", *lines, "ENDMODULE"]
    return lines


def identifiers(ids: Sequence[str], longest: int) -> list[str]:
    """Names that all three languages take, each its own without regard to case: letters, digits and underscores."""
    out: list[str] = []
    taken: set[str] = set()
    for pose_id in ids:
        base = re.sub(r"[^A-Za-z0-9_]", "_", pose_id)
        base = (base if base[:1].isalpha() else f"p{base}")[:longest]
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
