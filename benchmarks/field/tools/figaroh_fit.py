"""figaroh: BaseCalibration with the geometric parameters that its own choice keeps, one marker, base and tool unknown.

It knows one base frame: sets whose instrument or target stands at several places are beyond it, and it says so.
"""

from __future__ import annotations

import logging
from importlib.metadata import version
from pathlib import Path

import numpy as np
import pinocchio as pin
import yaml
from figaroh.calibration.base_calibration import BaseCalibration
from figaroh.calibration.calibration_tools import calc_updated_fkm
from problem import Answer, Array, Problem, onto
from scipy.spatial.transform import Rotation

from tools.dh import along, mdh_of, points_of, spin


class Calibration(BaseCalibration):
    """The package's calibration with the cost that its documentation shows, in the world's axes."""

    def cost_function(self, var: Array) -> Array:
        """Weighted errors of the positions."""
        seen = calc_updated_fkm(self.model, self.data, var, self.q_measured, self.calib_config)
        return self.apply_measurement_weighting(seen - self.PEE_measured)


def calibrate(problem: Problem, folder: Path, variant: str) -> Answer:
    """The answer in the frame of the instrument, metres inside."""
    del variant
    logging.disable(logging.CRITICAL)
    q, points, _ = problem.training
    if len(np.unique(problem.setup)) > 1:
        raise SystemExit("one base frame only; this set has several")
    (folder / "arm.urdf").write_text(urdf(problem.table))
    robot = pin.RobotWrapper.BuildFromURDF(str(folder / "arm.urdf"))
    joints = [f"joint{k + 1}" for k in range(q.shape[1])]
    rows = [",".join(["x1", "y1", "z1", *joints])]
    rows += [",".join(map(repr, [*(p / 1e3).tolist(), *values.tolist()])) for p, values in zip(points, q, strict=True)]
    (folder / "seen.csv").write_text("\n".join(rows))
    turn, shift = onto(points_of(problem.table, q), points)
    angles = Rotation.from_matrix(turn).as_euler("xyz")
    config = {
        "robot": {"name": "arm"},
        "tasks": {
            "calibration": {
                "enabled": True,
                "type": "kinematic_calibration",
                "kinematics": {"base_frame": "base", "tool_frame": "tool"},
                "joints": {"active_joints": joints},
                "parameters": {"calibration_level": "full_params"},
                "measurements": {
                    "markers": [{"measurable_dof": [True, True, True, False, False, False]}],
                    "poses": {"base_pose": [*(shift / 1e3).tolist(), *angles.tolist()], "tool_pose": [0.0] * 6},
                },
                "data": {"source_file": str(folder / "seen.csv"), "number_of_samples": len(q)},
            }
        },
    }
    (folder / "config.yaml").write_text(yaml.safe_dump(config))
    fit = Calibration(robot, str(folder / "config.yaml"))
    fit.calib_config |= {"known_baseframe": False, "known_tipframe": False}
    fit.initialize()
    fit.solve()
    fit.calib_config["NbSample"] = len(problem.q)
    found = calc_updated_fkm(fit.model, fit.data, fit.LM_result.x, problem.q, fit.calib_config)
    return Answer(found.reshape(3, -1).T * 1e3, len(fit.LM_result.x), fit.STATUS, version=version("figaroh"))


def urdf(table: Array) -> str:
    """The arm as a URDF whose joints turn about z."""
    mdh, tool = mdh_of(table)
    lines = ['<robot name="arm"><link name="base"/>']
    before = "base"
    for k, (alpha, a, theta, d) in enumerate(mdh):
        lines += [f'<link name="link{k + 1}"/>', f'<joint name="joint{k + 1}" type="revolute">']
        lines += [origin(along(a, alpha) @ spin(theta, d)), f'<parent link="{before}"/><child link="link{k + 1}"/>']
        lines += ['<axis xyz="0 0 1"/><limit lower="-7" upper="7" effort="1" velocity="1"/></joint>']
        before = f"link{k + 1}"
    lines += ['<link name="tool"/><joint name="fixed" type="fixed">', origin(tool)]
    return "".join([*lines, f'<parent link="{before}"/><child link="tool"/></joint></robot>'])


def origin(transform: Array) -> str:
    """A transform as URDF writes it."""
    angles = Rotation.from_matrix(transform[:3, :3]).as_euler("xyz")
    place = " ".join(map(repr, (transform[:3, 3] / 1e3).tolist()))
    return f'<origin xyz="{place}" rpy="{" ".join(map(repr, angles.tolist()))}"/>'
