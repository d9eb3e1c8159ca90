"""pybotics: its OptimizationHandler under scipy's least_squares, as in the project's example notebook, scaled.

The notebook's call has no scales, which mm and rad side by side ask for; it is compared with `x_scale="jac"`, to the
package's advantage. The package knows one base frame; several places are brought into it by their best motion
at every step.
"""

from __future__ import annotations

from importlib.metadata import version
from pathlib import Path

import numpy as np
from problem import Answer, Array, Problem
from pybotics.kinematic_chain import MDHKinematicChain
from pybotics.optimization import OptimizationHandler
from pybotics.robot import Robot
from pybotics.tool import Tool
from scipy.optimize import least_squares

from tools.dh import mdh_of
from tools.floors import in_base


def calibrate(problem: Problem, folder: Path, variant: str) -> Answer:
    """All 4 n modified DH parameters and the tool's point."""
    del folder, variant
    q, points, setup = problem.training
    mdh, tool = mdh_of(problem.table)
    robot = Robot(MDHKinematicChain.from_parameters(mdh), tool=Tool(matrix=tool))
    handler = OptimizationHandler(robot, kinematic_chain_mask=True, tool_mask=[True] * 3 + [False] * 3)

    def predict(joints: Array) -> Array:
        return np.array([handler.robot.fk(row)[:3, 3] for row in joints])

    def errors(x: Array) -> Array:
        handler.apply_optimization_vector(x)
        predicted = predict(q)
        return np.linalg.norm(in_base(points, predicted, setup) - predicted, axis=1)

    found = least_squares(errors, handler.generate_optimization_vector(), x_scale="jac")
    handler.apply_optimization_vector(found.x)
    return Answer(predict(problem.q), found.x.size, f"{found.nfev} steps: {found.message}", version=version("pybotics"))
