"""Poses in the numbers of robots' makers, and a controller that finds joints for them, in numpy and SciPy alone."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

LANGUAGES = {"URScript": ".script", "KRL": ".src", "RAPID": ".mod"}
NUMBER = r"[+-]?\d+\.?\d*(?:[eE][+-]?\d+)?"


def transform(rotation: Rotation, position: object) -> np.ndarray:
    out = np.eye(4)
    out[:3, :3], out[:3, 3] = rotation.as_matrix(), position
    return out


def inverse(flange: Callable[[np.ndarray], np.ndarray], goal: np.ndarray, start: np.ndarray) -> np.ndarray:
    """Joints near a start with which an arm's flange stands at a goal, as a controller finds them."""

    def off(q: np.ndarray) -> np.ndarray:
        at = flange(q)
        return np.r_[at[:3, 3] - goal[:3, 3], 1000.0 * (at[:3, :3] - goal[:3, :3]).ravel()]

    found = least_squares(off, start, xtol=1e-15, ftol=1e-15, gtol=1e-15)
    assert np.abs(off(found.x)).max() < 1e-6
    return found.x


def makers(language: str, pose: np.ndarray) -> np.ndarray:
    """Numbers of a pose in the maker's convention."""
    turn, position = Rotation.from_matrix(pose[:3, :3]), pose[:3, 3]
    if language == "URScript":
        return np.r_[position / 1000.0, turn.as_rotvec()]
    if language == "KRL":
        return np.r_[position, turn.as_euler("ZYX", degrees=True)]
    x, y, z, w = turn.as_quat()
    return np.r_[position, w, x, y, z]


def of_maker(language: str, values: np.ndarray) -> np.ndarray:
    position, turn = values[:3], values[3:]
    if language == "URScript":
        return transform(Rotation.from_rotvec(turn), 1000.0 * position)
    if language == "KRL":
        return transform(Rotation.from_euler("ZYX", turn, degrees=True), position)
    return transform(Rotation.from_quat([*turn[1:], turn[0]]), position)


def listed(language: str, values: np.ndarray, decimals: int = 9) -> str:
    texts = [f"{value:.{decimals}f}" for value in values]
    if language == "KRL":
        return ",".join(f"{name} {text}" for name, text in zip("XYZABC", texts, strict=True))
    if language == "RAPID":
        return f"[{','.join(texts[:3])}],[{','.join(texts[3:])}]"
    return f"p[{', '.join(texts)}]"


def program_of(
    language: str,
    stands: Callable[[np.ndarray], np.ndarray],
    joints: np.ndarray,
    flange_T_tool: np.ndarray,
    base_T_work: np.ndarray,
) -> str:
    """A program with joint targets (N, 6), rad, each followed by the pose at its place; URScript has no work frame."""
    work = np.eye(4) if language == "URScript" else base_T_work
    poses = [np.linalg.inv(work) @ stands(q) @ flange_T_tool for q in joints]
    tool, base = (listed(language, makers(language, frame)) for frame in (flange_T_tool, work))
    lines = []
    if language == "URScript":
        lines = ["def prog():", f"  set_tcp({tool})  # the tool"]
        for q, pose in zip(joints, poses, strict=True):
            lines.append(f"  movej([{', '.join(f'{v:.9f}' for v in q)}], a=1.4)")
            lines.append(f"  movel({listed(language, makers(language, pose))}, v=0.1)")
        return "\n".join([*lines, "end", ""])
    degrees = np.degrees(joints)
    if language == "KRL":
        lines = ["DEF prog()", f"$TOOL={{{tool}}}", f"$BASE={{{base}}} ; the fixture"]
        for q, pose in zip(degrees, poses, strict=True):
            lines.append(f"PTP {{{','.join(f'A{k + 1} {v:.7f}' for k, v in enumerate(q))},E1 3.5}}")
            turns = sum(int(v < 0.0) << k for k, v in enumerate(q))
            lines.append(f"LIN {{{listed(language, makers(language, pose))},S 2,T {turns},E1 3.5}} C_DIS")
        return "\r\n".join([*lines, "END", ""])
    lines = [
        "MODULE M",
        f"PERS tooldata grip:=[TRUE,[{tool}],[1,[0,0,1],[1,0,0,0],0,0,0]];",
        f'PERS wobjdata table:=[FALSE,TRUE,"",[{base}],[[0,0,0],[1,0,0,0]]];',
    ]
    axes = "[9E9,9E9,9E9,9E9,9E9,9E9]"
    for k, (q, pose) in enumerate(zip(degrees, poses, strict=True)):
        lines.append(f"CONST jointtarget j{k}:=[[{','.join(f'{v:.7f}' for v in q)}],{axes}]; ! {k}")
        quadrants = ",".join(str(int(np.floor(q[axis] / 90.0))) for axis in (0, 3, 5))
        lines.append(
            f"CONST robtarget p{k}:=[{listed(language, makers(language, pose))},[{quadrants},0],{axes}]; ! {k}"
        )
    lines += ["PROC main()", *(f"MoveL p{k},v100,z10,grip\\WObj:=table;" for k in range(len(poses))), "ENDPROC"]
    return "\n".join([*lines, "ENDMODULE", ""])


def read_back(language: str, text: str) -> tuple[np.ndarray, np.ndarray]:
    """Joints, rad, and the numbers of the poses in a program of `program_of`."""
    patterns = {
        "URScript": (r"movej\(\[([^\]]*)\]", r"movel\(p\[([^\]]*)\]"),
        "KRL": (r"PTP \{([^}]*?),E1", r"LIN \{([^}]*?)(?:,S|,E1)"),
        "RAPID": (r"jointtarget j\d:=\[\[([^\]]*)\]", r"robtarget p\d:=\[\[([^\]]*\],\[[^\]]*)\]"),
    }[language]
    found = []
    for pattern in patterns:
        cleaned = [re.sub(r"[A-Z]\d? ", "", m[1]) for m in re.finditer(pattern, text)]
        found.append(np.array([[float(v) for v in re.findall(NUMBER, each)] for each in cleaned]))
    return (found[0] if language == "URScript" else np.radians(found[0])), found[1]


@dataclass(frozen=True)
class Arm:
    """An arm of joints with their origins in the frame before, and a fixed flange behind the last."""

    places: np.ndarray  # (7, 4, 4) mm
    axes: np.ndarray  # (6, 3)

    @classmethod
    def of(cls, xyz_mm: object, rpy: object, axes: object) -> Arm:
        """The arm of a URDF's numbers."""
        places = [transform(Rotation.from_euler("xyz", turn), xyz) for xyz, turn in zip(xyz_mm, rpy, strict=True)]  # type: ignore[call-overload]
        return cls(np.array(places), np.array(axes, dtype=float))

    def with_errors(self, rng: np.random.Generator) -> Arm:
        """The same arm with links that are some tenths of a millimetre and mrad off."""
        wrong = [transform(Rotation.from_rotvec(rng.normal(0, 8e-4, 3)), rng.normal(0, 0.3, 3)) for _ in range(6)]
        return Arm(self.places @ np.array([*wrong, np.eye(4)]), self.axes)

    def stands(self, q: np.ndarray) -> np.ndarray:
        """base_T_flange at joints (6,), rad."""
        at = np.eye(4)
        for place, axis, angle in zip(self.places, self.axes, q, strict=False):
            at = at @ place @ transform(Rotation.from_rotvec(axis * angle), [0.0, 0.0, 0.0])
        return at @ self.places[-1]

    def urdf(self, path: Path) -> Path:
        """The arm as a URDF, its flange called tool0."""
        lines = ["<robot name='arm'><link name='l0'/>"]
        for k, place in enumerate(self.places):
            xyz, rpy = place[:3, 3] / 1000.0, Rotation.from_matrix(place[:3, :3]).as_euler("xyz")
            kind, child = ("fixed", "tool0") if k == 6 else ("continuous", f"l{k + 1}")
            axis = "" if k == 6 else f"<axis xyz='{' '.join(map(repr, self.axes[k].tolist()))}'/>"
            origin = f"<origin xyz='{' '.join(map(repr, xyz.tolist()))}' rpy='{' '.join(map(repr, rpy.tolist()))}'/>"
            ends = f"<parent link='l{k}'/><child link='{child}'/>"
            lines.append(f"<link name='{child}'/><joint name='j{k}' type='{kind}'>{ends}{origin}{axis}</joint>")
        path.write_text("\n".join([*lines, "</robot>"]))
        return path
