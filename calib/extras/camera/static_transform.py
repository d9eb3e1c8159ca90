"""A fixed transform, such as that of a camera, as ROS takes it: YAML with the command line of tf.

Lengths are metres and quaternions x, y, z, w, as everywhere in ROS. The camera's frame is the optical one (z along the
sight, x right, y down).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from calib.array_types import Array
from calib.errors import CalibError, is_one_line
from calib.frames import quaternion_from_rotation

_FORBIDDEN = set("\"'<>&{}[]:#, \t\\")


@dataclass(frozen=True)
class StaticTransform:
    """Transform from a child's frame to its parent's, with its covariance."""

    parent: str
    child: str
    parent_T_child: Array  # (4, 4) mm
    covariance: Array  # (6, 6) of place (mm) and small turn (rad), along and about the parent's axes

    def __post_init__(self) -> None:
        for name in (self.parent, self.child):
            if not name or not is_one_line(name) or set(name) & _FORBIDDEN:
                raise CalibError(f"{name!r} is no name of a frame; letters, digits, _ and / are needed")


def transform_text(path: Path, transforms: Sequence[StaticTransform]) -> str:
    """Text of a YAML file with transforms. Raises CalibError for another suffix."""
    if path.suffix.lower() not in (".yaml", ".yml"):
        raise CalibError(f"{path}: name it .yaml; --json has the same as hand_eye")
    return "---\n".join(_yaml(one) for one in transforms)


def _yaml(one: StaticTransform) -> str:
    """A geometry_msgs/TransformStamped as `ros2 topic pub` takes it, and what is known of its error.

    Its first line is the command that publishes it in ROS 2.
    """
    wxyz = quaternion_from_rotation(one.parent_T_child[:3, :3][None])[0]
    told = [*np.round(one.parent_T_child[:3, 3] / 1000.0, 9), *np.round(np.roll(wxyz, -1), 12)]
    x, y, z, qx, qy, qz, qw = numbers = [float(value) + 0.0 for value in told]  # no -0.0
    names = zip(("x", "y", "z", "qx", "qy", "qz", "qw"), numbers, strict=True)
    words = " ".join(f"--{name} {value!r}" for name, value in names)
    sigma = np.sqrt(np.diag(one.covariance))  # with a point in each number: YAML 1.1 takes 1e-10 for a word
    in_m = np.repeat([1e-3, 1.0], 3)
    covariance = ", ".join(f"{value:.6e}" for value in (one.covariance * np.outer(in_m, in_m)).ravel())
    return (
        f"# ros2 run tf2_ros static_transform_publisher {words} --frame-id {one.parent} --child-frame-id {one.child}\n"
        f"header:\n  frame_id: {one.parent}\nchild_frame_id: {one.child}\n"
        f"transform:\n  translation: {{x: {x:.9f}, y: {y:.9f}, z: {z:.9f}}}\n"
        f"  rotation: {{x: {qx:.12f}, y: {qy:.12f}, z: {qz:.12f}, w: {qw:.12f}}}\n"
        f"sigma_mm: [{', '.join(f'{value:.3e}' for value in sigma[:3])}]\n"
        f"turn_sigma_deg: [{', '.join(f'{value:.3e}' for value in np.degrees(sigma[3:]))}]\n"
        f"covariance: [{covariance}]  # 6 x 6, m and rad\n"
    )
