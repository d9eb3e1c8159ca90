"""What the size of a parameter means on the arm: degrees at the largest torque, stiffness, millimetres over the run."""

from __future__ import annotations

import numpy as np

from calib.calibration.result import Calibration


def meaning(name: str, size: float, unit: str, calibration: Calibration) -> str:
    """The consequence of a parameter in words, at this dataset's poses; "" where its value says it already.

    Args:
        name: full, such as "joint_compliance.J2.c".
        size: in its own unit.
        unit: such as "rad/Nm".
        calibration: whose poses, torques and times it acts at.
    """
    family, _, rest = name.partition(".")
    joint = rest.partition(".")[0]
    number = int(joint[1:]) - 1 if joint[:1] == "J" and joint[1:].isdigit() else None
    if not np.isfinite(size) or size == 0.0:
        return ""
    if unit == "rad":
        return f"{np.degrees(size):.2g}\N{DEGREE SIGN}"
    if unit == "rad/Nm":
        stiff = f"stiffness {_si(1.0 / abs(size))}Nm/rad"
        if family == "joint_compliance" and number is not None:
            torque_nm = _largest_torque_nm(calibration, number)
            if torque_nm > 0.0:
                return (
                    f"{np.degrees(abs(size)) * torque_nm:.2g}\N{DEGREE SIGN} at {torque_nm:.3g} Nm, {stiff}"
                )
        return stiff
    if unit == "1/K":
        return f"{size * 1e6:.2g} \N{MICRO SIGN}m a metre and kelvin"
    if unit in ("mm/s", "rad/s"):
        return _over_the_run(size, unit, calibration)
    if family == "joint_scale" and number is not None:
        travel = float(np.ptp(calibration.dataset.poses.q[:, number]))
        if calibration.dataset.robot.joints[number].is_revolute:
            turned = np.degrees(travel)
            return f"{turned * size:.2g}\N{DEGREE SIGN} over the {turned:.0f}\N{DEGREE SIGN} of its travel"
        return f"{travel * size:.2g} mm over the {travel:.0f} mm of its travel"
    if family == "joint_coupling":
        return f"{size:.2g}\N{DEGREE SIGN} for each degree of the driving joint"
    return f"{100.0 * size:.2g} %" if unit == "1" else ""


def _largest_torque_nm(calibration: Calibration, joint: int) -> float:
    torques = calibration.model.state(calibration.fit.x, calibration.dataset.poses).gravity_torques_nm
    return float(np.abs(torques[:, joint]).max(initial=0.0))


def _over_the_run(size: float, unit: str, calibration: Calibration) -> str:
    time_s = calibration.dataset.poses.time_s
    hours = float(np.ptp(time_s)) / 3600.0 if time_s is not None else 0.0
    if hours <= 0.0:
        return ""
    moved = size * 3600.0 * hours
    words = f"{moved:.2g} mm" if unit == "mm/s" else f"{np.degrees(moved):.2g}\N{DEGREE SIGN}"
    return f"{words} over the {hours:.2g} h measured"


def _si(value: float) -> str:
    """ "250 k" for 250 000: three figures with a prefix, ready for the unit."""
    for factor, prefix in ((1e9, "G"), (1e6, "M"), (1e3, "k")):
        if value >= factor:
            return f"{value / factor:.3g} {prefix}"
    return f"{value:.3g} "
