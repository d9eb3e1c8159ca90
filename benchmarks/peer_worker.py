"""Calibration by a peer inside the peer's own environment; `peers.py` calls it.

    PEER_PYTHON peer_worker.py VARIANT PROBLEM.npz RESULT.npz

The problem holds the nominal DH table (rows a, alpha, d, theta; the last is the tool), joint vectors and measured
points in mm, and the setup of each. The result holds the predicted points in the base frame and the processor's
seconds, imports and files not counted.
"""

from __future__ import annotations

import sys
import time

import numpy as np


def mdh_of(table):  # type: ignore[no-untyped-def]
    """DH rows as modified DH (alpha, a, theta, d), pybotics' convention, and the tool's transform."""
    a, alpha, d, theta = table[:-1].T
    before_a, before_alpha = np.r_[0.0, a[:-1]], np.r_[0.0, alpha[:-1]]
    tool = along(a[-1], alpha[-1]) @ spin(table[-1, 3], table[-1, 2]) @ along(table[-1, 0], table[-1, 1])
    return np.column_stack([before_alpha, before_a, theta, d]), tool


def along(a, alpha):  # type: ignore[no-untyped-def]
    """Trans(a, 0, 0) Rx(alpha)"""
    c, s = np.cos(alpha), np.sin(alpha)
    return np.array([[1, 0, 0, a], [0, c, -s, 0], [0, s, c, 0], [0, 0, 0, 1.0]])


def spin(theta, d):  # type: ignore[no-untyped-def]
    """Rz(theta) Trans(0, 0, d)"""
    c, s = np.cos(theta), np.sin(theta)
    return np.array([[c, -s, 0, 0], [s, c, 0, 0], [0, 0, 1, d], [0, 0, 0, 1.0]])


def onto(source, target):  # type: ignore[no-untyped-def]
    """Rotation and shift of the least squares motion from source to target (Kabsch)."""
    u, _, vt = np.linalg.svd((target - target.mean(0)).T @ (source - source.mean(0)))
    r = u @ np.diag([1, 1, np.sign(np.linalg.det(u @ vt))]) @ vt
    return r, target.mean(0) - r @ source.mean(0)


def in_base(points, predicted, setup):  # type: ignore[no-untyped-def]
    """Measured points brought into the base frame, each setup by its best motion; as they are without setups."""
    if len(setup) == 0:
        return points
    out = np.empty_like(points)
    for name in np.unique(setup):
        rows = setup == name
        r, t = onto(points[rows], predicted[rows])
        out[rows] = points[rows] @ r.T + t
    return out


def pybotics(problem, variant):  # type: ignore[no-untyped-def]
    """OptimizationHandler and scipy's least_squares, as in the project's example notebook.

    "documented": the notebook's call, `least_squares(optimize_accuracy, x0, args=...)` and nothing else.
    "scaled": the same with x_scale="jac", which mm and rad side by side ask for.
    "vector": scaled, with the three coordinates of each error for residual in place of its length.
    "tight": scaled, with tolerances of 1e-12 in place of 1e-8. "vector tight": both.
    """
    from pybotics.kinematic_chain import MDHKinematicChain
    from pybotics.optimization import OptimizationHandler, optimize_accuracy
    from pybotics.robot import Robot
    from pybotics.tool import Tool
    from scipy.optimize import least_squares

    q, points, setup = problem["q"], problem["points"], problem["setup"]
    mdh, tool = mdh_of(problem["table"])
    began = time.process_time()
    robot = Robot(MDHKinematicChain.from_parameters(mdh), tool=Tool(matrix=tool))
    handler = OptimizationHandler(robot, kinematic_chain_mask=True, tool_mask=[True] * 3 + [False] * 3)

    def predict(joints):  # type: ignore[no-untyped-def]
        return np.array([handler.robot.fk(row)[:3, 3] for row in joints])

    def errors(x):  # type: ignore[no-untyped-def]
        handler.apply_optimization_vector(x)
        predicted = predict(q)
        return in_base(points, predicted, setup) - predicted

    settings = {} if variant == "documented" else {"x_scale": "jac"}
    if variant.endswith("tight"):
        settings |= {"ftol": 1e-12, "xtol": 1e-12, "gtol": 1e-12}
    start = handler.generate_optimization_vector()
    if variant.startswith("vector"):
        result = least_squares(lambda x: errors(x).ravel(), start, **settings)
    elif len(setup):  # the package knows one base frame only; several places are beyond its own residual
        result = least_squares(lambda x: np.linalg.norm(errors(x), axis=1), start, **settings)
    else:
        result = least_squares(optimize_accuracy, start, args=(handler, q, points), **settings)
    handler.apply_optimization_vector(result.x)
    seconds = time.process_time() - began
    return predict, seconds, len(start), f"{result.nfev} steps: {result.message}"


def robotkinecal(problem, variant):  # type: ignore[no-untyped-def]
    """SerialRobotKineCal with positions, in metres as in its examples.

    "mm": in millimetres, where its tolerance is finer. It knows one base frame only: with several places its iterations
    alternate with fitting the places' frames until the training error no longer falls, and the best is kept.
    """
    import roboticstoolbox as rtb
    from robotkinecal import SerialRobotKineCal
    from spatialmath import SE3

    unit = 1.0 if variant == "mm" else 1e-3
    q, setup = problem["q"], problem["setup"]
    points = problem["points"] * unit
    mdh, tool = mdh_of(problem["table"])
    np.random.seed(0)  # noqa: NPY002  its bases are drawn at random
    began = time.process_time()
    links = []
    for i, (alpha, a, theta, d) in enumerate(mdh):
        fixed = rtb.ET.SE3(SE3(along(a * unit, alpha) @ spin(theta, d * unit), check=False))
        links.append(rtb.Link(fixed * rtb.ET.Rz(), name=f"link{i + 1}", parent=links[-1] if links else None))
    home = tool.copy()
    home[:3, 3] *= unit
    links.append(rtb.Link(rtb.ETS(rtb.ET.SE3(SE3(home, check=False))), name="tool", parent=links[-1]))
    calibration = SerialRobotKineCal(rtb.Robot(links), "tool")

    def predict(joints):  # type: ignore[no-untyped-def]
        count = calibration.N_JOINTS + 1
        return np.array([calibration.forward_kinematics(count, row).t for row in joints]) / unit

    def rmse():  # type: ignore[no-untyped-def]
        predicted = predict(q)
        return np.sqrt(np.mean(np.sum((in_base(problem["points"], predicted, setup) - predicted) ** 2, axis=1)))

    if len(setup) == 0:
        calibration.set_observations(list(q), list(points))
        result = calibration.solve()
        note = f"{result.nb_iterations_executed} iterations, converged {result.has_converged}"
    else:
        best, note = rmse(), "30 rounds"
        for round_ in range(30):
            kept = (
                list(calibration.joint_screw_axis),
                SE3(calibration.zero_conf_EE_pose.A.copy(), check=False),
            )
            calibration.set_observations(list(q), list(unit * in_base(problem["points"], predict(q), setup)))
            calibration.solve(max_iterations=1)
            now = rmse()
            if now >= best * (1.0 - 1e-5):
                calibration.joint_screw_axis, calibration.zero_conf_EE_pose = kept
                note = f"stopped after {round_ + 1} rounds, when the error was {now:.3g} mm; the best is kept"
                break
            best = now
    seconds = time.process_time() - began
    return predict, seconds, 4 * calibration.N_JOINTS + 3, note


def main() -> None:
    """Read the problem, calibrate, write the result."""
    peer, variant = sys.argv[1].split(":")
    with np.load(sys.argv[2]) as file:
        problem = dict(file)
    predict, seconds, parameters, note = {"pybotics": pybotics, "robotkinecal": robotkinecal}[peer](problem, variant)
    np.savez(
        sys.argv[3],
        train=predict(problem["q"]),
        test=predict(problem["q_test"]),
        seconds=seconds,
        parameters=parameters,
        note=note,
    )


if __name__ == "__main__":
    main()
