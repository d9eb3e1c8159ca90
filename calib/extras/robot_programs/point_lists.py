"""Joint targets as programs: point lists in URScript, KUKA KRL and ABB RAPID.

Joint values are those that the controller is commanded with, as in poses.csv: URScript in rad, KRL and RAPID in
degrees. Sources: Universal Robots, *The URScript Programming Language* (lists of joint positions, rad); KUKA, *KSS
System Software, Operating and Programming Instructions for System Integrators* (structure AXIS, `.dat` files); ABB,
*Technical reference manual, RAPID Instructions, Functions and Data types* (`jointtarget`, 9E9 for an axis that is not
connected).
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from calib.extras.robot_programs.program_templates import (
    identifiers,
    plain_line,
    rendered,
    require_joints,
    template_pose,
)
from calib.kinematics.robot import Robot
from calib.robot_formats.joint_targets import JointTarget

LONGEST = {".script": 64, ".dat": 24, ".mod": 32}  # characters of a name: KRL 24, RAPID 32; URScript tells no limit
LANGUAGES = {".script": "URScript", ".dat": "KRL", ".mod": "RAPID"}


def require_point_list(path: Path, robot: Robot) -> None:
    """Raise CalibError for an arm whose joint values the point list of a file's suffix cannot hold."""
    require_joints(path, LANGUAGES[path.suffix.lower()], robot.is_revolute.tolist(), "; write the targets as .csv")


def point_list(path: Path, robot: Robot, targets: Sequence[JointTarget], heading: Sequence[str]) -> str:
    """Point list in the language of the file's suffix; targets that are left out become comments with the reason.

    heading: first lines, as comments. The arm has to pass `require_point_list`.
    """
    suffix = path.suffix.lower()
    program, *names = identifiers([path.stem, *(target.name for target in targets)], LONGEST[suffix])
    points = [template_pose(name, each, robot.is_revolute) for name, each in zip(names, targets, strict=True)]
    lines = [plain_line(line) for line in heading]
    return rendered(f"points{suffix}", {"program": program, "heading": lines, "points": points})
