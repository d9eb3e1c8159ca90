"""Writing of MuJoCo models (MJCF): a new plain file of a serial chain, a body for each link and the tip."""

from __future__ import annotations

from xml.sax.saxutils import quoteattr

import numpy as np

from calib.array_types import Array
from calib.frames import quaternion_from_rotation
from calib.kinematics.robot import Robot
from calib.robot_formats.chain.five_parameters import chain_of
from calib.robot_formats.chain.serial_chain import RobotFileError, SerialChain
from calib.robot_formats.robots import RobotContent, not_in_model
from calib.robot_formats.urdf.text import GYRATION_M, TOOL_POINT_LINK, numbers

_TIP_SITE = "attachment_site"  # as the models of MuJoCo's menagerie name it


def mjcf_content(robot: Robot) -> RobotContent:
    """The bytes of a plain MuJoCo model, and notes on what it cannot hold. Raises RobotFileError."""
    return plain_mjcf(chain_of(robot)).encode(), not_in_model(robot)


def plain_mjcf(chain: SerialChain) -> str:
    """A MuJoCo model of the chain's links and joints. Raises RobotFileError where names would be the same.

    A joint is at the origin of its body, whose pose is `before_T_joint`; angles are radians, lengths metres. Bodies
    without a mass get the least that MuJoCo computes with (`boundmass`).
    """
    names = [joint.name for joint in chain.joints]
    base, tip = chain.base or "base_link", chain.tip or "tool0"
    if len({*names, *(f"{name}_link" for name in names), base, tip}) < 2 * len(names) + 2:
        raise RobotFileError(f"robot {chain.name}: its joints have the same names; a MuJoCo model needs one for each")
    gravity = numbers(np.array(chain.gravity_m_s2))
    lines = [f"<mujoco model={quoteattr(chain.name)}>"]
    lines += [
        '  <compiler angle="radian" autolimits="true" boundmass="1e-3" boundinertia="1e-6"/>',
        f'  <option gravity="{gravity}"/>',
        "  <worldbody>",
        f"    <body name={quoteattr(base)}>",
    ]
    indent = "      "
    for joint in chain.joints:
        scale = 1.0 if joint.is_revolute else 1e-3
        lines.append(f"{indent}<body name={quoteattr(f'{joint.name}_link')} {_place(joint.before_T_joint)}>")
        indent += "  "
        kind = "hinge" if joint.is_revolute else "slide"
        limits = ""
        if joint.min is not None and joint.max is not None:
            limits = f' range="{scale * joint.min!r} {scale * joint.max!r}"'
        axis = numbers(np.array(joint.axis))
        lines.append(f'{indent}<joint name={quoteattr(joint.name)} type="{kind}" axis="{axis}"{limits}/>')
        if joint.mass_kg and joint.com_mm is not None:
            inertia = numbers(np.full(3, joint.mass_kg * GYRATION_M**2))
            com = numbers(1e-3 * np.array(joint.com_mm))
            lines.append(f'{indent}<inertial pos="{com}" mass="{joint.mass_kg!r}" diaginertia="{inertia}"/>')
    lines.append(f"{indent}<body name={quoteattr(tip)} {_place(chain.last_T_tip)}>")
    lines.append(f'{indent}  <site name="{_TIP_SITE}"/>')
    if chain.tool_point_mm is not None:
        at = numbers(1e-3 * np.array(chain.tool_point_mm))
        lines.append(f'{indent}  <site name="{TOOL_POINT_LINK}" pos="{at}"/>')
    lines.append(f"{indent}</body>")
    for _ in range(len(chain.joints) + 1):
        indent = indent[:-2]
        lines.append(f"{indent}</body>")
    return "\n".join([*lines, "  </worldbody>", "</mujoco>", ""])


def _place(transform: Array) -> str:
    """Position, m, and unit quaternion w, x, y, z of a transform, with all their digits."""
    return f'pos="{numbers(1e-3 * transform[:3, 3])}" quat="{numbers(quaternion_from_rotation(transform[:3, :3]))}"'
