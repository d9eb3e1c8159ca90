"""Programs that measure planned poses: move to each, settle, record the joints, and stand while it is measured.

Each language has a text template in `templates/` (Jinja2). Every move is a joint move that ends at rest, as the ways
between poses were checked for collisions that way. Joint values are those that the controller is commanded with:
URScript in rad, KRL and RAPID in degrees. Sources: Universal Robots, *The URScript Programming Language* (`movej`,
`is_steady`, `popup`); KUKA, *KSS System Software, Operating and Programming Instructions for System Integrators*
(`PTP`, `$VEL_AXIS`, `$AXIS_ACT`, values of a data list that outlive the run); ABB, *Technical reference manual, RAPID
Instructions, Functions and Data types* (`MoveAbsJ`, `WaitTime \\InPos`, `CJointT`, `Open`, `Write`, strings of 80
characters at most).
"""

from __future__ import annotations

import re
import textwrap
from collections.abc import Sequence
from importlib.resources import files
from pathlib import Path

import numpy as np
from jinja2 import Environment, StrictUndefined

from calib.errors import CalibError
from calib.planning.plan import Plan
from calib.planning.ways import steps_of

_LANGUAGES = {  # by the suffix; further templates are of files that stand beside the program
    ".script": ("URScript", ("measure.script",)),
    ".src": ("KRL", ("measure.src", "measure.dat")),
    ".mod": ("RAPID", ("measure.mod",)),
}
_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_]{0,23}")  # of a program, in any of the languages
_JOINTS = 6  # that a joint position of these languages holds
_LONGEST_LABEL = 40  # characters, as a string of RAPID holds 80, and the recorded joints follow it


def program_files(path: Path) -> tuple[Path, ...]:
    """Files of a program: its own, and those that come with it. Raises CalibError for a name that is none of one."""
    if path.suffix.lower() not in _LANGUAGES:
        raise CalibError(
            f"{path}: a measuring program is written as .script (URScript), .src (KRL, with its .dat) or .mod (RAPID); "
            "for another controller write the poses as .csv (--out)"
        )
    if not _NAME.fullmatch(path.stem):
        raise CalibError(f"{path}: no program can be called {path.stem!r}; take up to 24 letters, digits and _")
    _, templates = _LANGUAGES[path.suffix.lower()]
    return tuple(path if k == 0 else path.with_suffix(Path(name).suffix) for k, name in enumerate(templates))


def measuring_program(path: Path, plan: Plan) -> dict[Path, str]:
    """Files of the program that measures a plan's poses, with their content, by the language of the path's suffix.

    Raises CalibError for an arm that the language cannot hold, and for a pose to which no free way was found.
    """
    (language, templates), robot, names = _LANGUAGES[path.suffix.lower()], plan.start.dataset.robot, plan.poses.ids
    require_joints(path, language, robot.is_revolute.tolist(), "; write the poses as .csv")
    closed = [k for k, way in enumerate(plan.ways) if not way.clear]
    if closed:
        from_there = f"from {names[closed[0] - 1]} " if closed[0] else ""
        more = f", and {len(closed) - 1} more" if len(closed) > 1 else ""
        raise CalibError(
            f"{path}: no way {from_there}to {names[closed[0]]} past floor, boxes, instrument and the arm itself was "
            f"found{more}; plan with another --seed, or write the poses without motions (--out)"
        )
    values = {
        "program": path.stem,
        "about": quoted(
            f"Measures {len(names)} poses of {robot.name}, planned for {plan.criterion.name}, in this order."
        ),
        "steps": steps_of(robot, plan.poses, plan.ways),
    }
    texts = [(files("calib.extras.robot_programs") / "templates" / name).read_text("utf-8") for name in templates]
    made = (_ENVIRONMENT.from_string(text).render(values) for text in texts)
    return dict(zip(program_files(path), made, strict=True))


def require_joints(path: Path, language: str, is_revolute: Sequence[bool], remedy: str = "") -> None:
    """Raise CalibError for an arm whose joint values the controller's joint positions cannot hold."""
    if list(is_revolute) != [True] * _JOINTS:
        turning = sum(map(bool, is_revolute))
        sliding = len(is_revolute) - turning
        raise CalibError(
            f"{path}: a joint position of {language} holds six turning joints, this arm has {turning}"
            + (f" and {sliding} sliding" if sliding else "")
            + remedy
        )


def quoted(text: str) -> str:
    """Text for a comment or string of any language: one line of printable ASCII without quotes and backslashes."""
    return re.sub(r"[^ -~]", "?", " ".join(text.split())).replace('"', "'").replace("\\", "/")


_ENVIRONMENT = Environment(undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True, keep_trailing_newline=True)
_ENVIRONMENT.filters |= {
    "label": lambda target: quoted(target.name)[:_LONGEST_LABEL],
    "quoted": quoted,
    "lines": lambda text: textwrap.wrap(quoted(text), 70),
    "rad": lambda target: ", ".join(f"{value:.9f}" for value in target.q),
    "deg": lambda target: [f"{value:.7f}" for value in np.degrees(target.q)],
}
