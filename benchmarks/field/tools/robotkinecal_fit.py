"""robotkinecal: SerialRobotKineCal by positions, in millimetres, where its tolerance is finer than in metres.

It knows one base frame. Its iterations therefore alternate with placing each setup by its best motion until the
training error no longer falls, and the best is kept.
"""

from __future__ import annotations

from importlib.metadata import version
from pathlib import Path

import numpy as np
import roboticstoolbox as rtb
from problem import Answer, Array, Problem
from robotkinecal import SerialRobotKineCal
from spatialmath import SE3

from tools.dh import along, mdh_of, spin
from tools.floors import in_base

ROUNDS = 30


def calibrate(problem: Problem, folder: Path, variant: str) -> Answer:
    """Screws of the joints and the tool's point."""
    del folder, variant
    q, points, setup = problem.training
    mdh, tool = mdh_of(problem.table)
    np.random.seed(0)  # noqa: NPY002  its bases are drawn at random
    links: list[rtb.Link] = []
    for i, (alpha, a, theta, d) in enumerate(mdh):
        fixed = rtb.ET.SE3(SE3(along(a, alpha) @ spin(theta, d), check=False))
        links.append(rtb.Link(fixed * rtb.ET.Rz(), name=f"link{i + 1}", parent=links[-1] if links else None))
    links.append(rtb.Link(rtb.ETS(rtb.ET.SE3(SE3(tool, check=False))), name="tool", parent=links[-1]))
    calibration = SerialRobotKineCal(rtb.Robot(links), "tool")

    def predict(joints: Array) -> Array:
        count = calibration.N_JOINTS + 1
        return np.array([calibration.forward_kinematics(count, row).t for row in joints])

    def placed() -> tuple[Array, float]:
        predicted = predict(q)
        seen = in_base(points, predicted, setup)
        return seen, float(np.sqrt(np.mean(np.sum((seen - predicted) ** 2, axis=1))))

    seen, best = placed()
    note = f"{ROUNDS} rounds"
    for done in range(ROUNDS):
        kept = (list(calibration.joint_screw_axis), SE3(calibration.zero_conf_EE_pose.A.copy(), check=False))
        calibration.set_observations(list(q), list(seen))
        calibration.solve(max_iterations=1)
        seen, now = placed()
        if now >= best * (1.0 - 1e-5):
            calibration.joint_screw_axis, calibration.zero_conf_EE_pose = kept
            note = f"{done} rounds, training error {best:.3g} mm"
            break
        best = now
    return Answer(predict(problem.q), 4 * calibration.N_JOINTS + 3, note, version=version("robotkinecal"))
