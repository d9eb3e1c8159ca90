"""Search for the tool point where robot.toml has it far off: its position on the last joint, and its uncertainty.

A point on the tool is fixed in the frame that turns (or slides) with the last joint. The last row of the table and the
tool's row move it alike; one point cannot tell which of them is wrong, nor how the tool is turned about it. A tool
point far from robot.toml's therefore becomes a point of its own in the last joint's frame (`jig.x`, `jig.y`, `jig.z`),
and the two rows, with them position and attitude of the tip, stay as robot.toml has them.

It is searched for with the rest of the table as robot.toml has it:

    s_i = Q (o_i + R_i p) + t

with the measured point s_i, the last joint's frame (R_i, o_i) of the nominal arm, the scanner's frame (Q, t) of each
setup, and the tool point p in the last joint's frame. Link errors of millimetres leave p a few millimetres off, near
enough to start a fit from.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass

import numpy as np

from calib import frames
from calib.array_types import Array, IndexArray, Vector
from calib.effects.link_errors import TOLERANCE_MM, TOLERANCE_RAD, LinkErrors, TargetOffsets, target_parameter_names
from calib.fitting.fit import Fit
from calib.fitting.model import Model
from calib.fitting.observations import Observations
from calib.fitting.scanner_frame import frame_columns, orthonormal
from calib.kinematics import chain as kinematics
from calib.kinematics.robot import PARAMETER_KINDS, Robot
from calib.kinematics.tool_point import tip_T_last, tool_point_of, with_own_tool_point

_KNOWN_PLACE_MM = 2.0  # tolerance of a target, up to which its place says how the last link is turned
_ROWS_BEHIND = 2  # of the table: what lies behind the last joint's axis


@dataclass(frozen=True)
class ToolShift:
    """Position of a tool point that was found far from robot.toml's."""

    point_mm: Vector  # where it is, in the nominal arm's last joint's frame
    off_mm: float  # from where robot.toml has it
    in_tip_mm: Vector  # where it is, in the frame of the tip


def tool_shift(nominal: Robot, calibrated: Robot) -> ToolShift:
    """Shift from the nominal arm's tool point to the calibrated arm's."""
    point_mm = tool_point_in_nominal(nominal, calibrated)
    x, y, z = point_mm.tolist()
    in_tip = frames.apply(tip_T_last(nominal), point_mm).tolist()
    off_mm = float(np.linalg.norm(point_mm - tool_point_of(nominal)))
    return ToolShift((x, y, z), off_mm, (in_tip[0], in_tip[1], in_tip[2]))


def tool_point_in_nominal(nominal: Robot, other: Robot) -> Array:
    """Tool point (3,) of another version of the arm, mm in the last joint's frame of the nominal arm."""
    nominal_T_other = frames.invert(_last_frame(nominal.table)) @ _last_frame(other.table)
    return frames.apply(nominal_T_other, tool_point_of(other))


def tip_turn_rad(nominal: Robot, other: Robot) -> float:
    """Angle, rad, by which the tip of another version of the arm is turned, the last joint's zero excluded."""
    axis_R_tip = []
    for robot in (nominal, other):
        rows = robot.table[-_ROWS_BEHIND:].copy()
        rows[0, PARAMETER_KINDS.index("theta")] = 0.0
        chain = kinematics.forward(rows, np.zeros((1, 1)), np.ones(1, dtype=bool))
        axis_R_tip.append(chain.base_T_frame[0, -1, :3, :3])
    return float(np.linalg.norm(frames.rotvec_from_rotation(axis_R_tip[0].T @ axis_R_tip[1])))


def _last_frame(table: Array) -> Array:
    """Transform (4, 4) of the last joint's frame in the frame that turns with the joint, at q = 0."""
    return kinematics.forward(table[-2:], np.zeros((1, 1)), np.ones(1, dtype=bool)).base_T_frame[0, 1]


def tolerance_covariance(robot: Robot, links: LinkErrors, fixed: Collection[str]) -> Array:
    """Covariance (3, 3), mm^2, of the tool point from the tolerances of the table's last two rows.

    Included are the last two rows, where they are not fixed, and a length's tolerance in each direction, as the rows
    may have no parameter for it. A point of its own has its own tolerance.
    """
    own = robot.own_tool_point
    if own is not None:
        return (own.tolerance_mm**2 + TOLERANCE_MM**2) * np.eye(3)
    base_T_joint = np.linalg.inv(_last_frame(robot.table))
    table = robot.table[-2:]
    chain = kinematics.forward(table, np.zeros((1, 1)), np.ones(1, dtype=bool))
    columns = kinematics.point_jacobian(chain, chain.target_mm)[0].reshape(3, -1)
    scales = [0.0 if p.name in fixed else p.scale for p in links.parameters[-columns.shape[1] :]]
    moved = base_T_joint[:3, :3] @ columns * np.array(scales)
    return np.asarray(moved @ moved.T) + TOLERANCE_MM**2 * np.eye(3)


def free_directions(robot: Robot, fixed: Collection[str]) -> Array:
    """Directions (3, K), last joint's frame, along which free parameters move the tool point."""
    own = robot.own_tool_point
    lengths = ("aTCP", "aTCP", "dTCP") if own is None else target_parameter_names(own)
    return np.eye(3)[:, [name not in fixed for name in lengths]]


def fixed_behind_tool_point(robot: Robot, observed: Observations) -> tuple[str, ...]:
    """Names of parameters behind the last axis to be fixed, as an independent tool point replaces them.

    They move the point as its own place does, or turn the tip about it. () where the tool point is the end of the
    tool's row; the tool's row alone where further targets on the last link, at known places, determine its orientation.
    """
    own = robot.own_tool_point
    if own is None or own.name not in observed.targets:
        return ()
    further = [
        t
        for t in robot.targets
        if t is not own and t.joint is None and t.name in observed.targets and t.tolerance_mm <= _KNOWN_PLACE_MM
    ]
    names = behind_last_axis(robot)
    return names[-len(PARAMETER_KINDS) :] if further else names


def behind_last_axis(robot: Robot) -> tuple[str, ...]:
    """Names of the parameters behind the last joint's axis: the last joint's row and the tool's row."""
    return robot.parameter_names[-_ROWS_BEHIND * len(PARAMETER_KINDS) :]


def angles_behind_last_axis(robot: Robot) -> tuple[str, ...]:
    """Names of the angles behind the last joint's axis that turn the tip; the last joint's zero is excluded."""
    zero = f"theta{robot.n_joints}"
    return tuple(n for n in behind_last_axis(robot) if n.startswith(("alpha", "beta", "theta")) and n != zero)


def with_found_tool(
    model: Model, links: LinkErrors, offsets: TargetOffsets | None, observed: Observations, found: Robot
) -> Model:
    """Model with the found tool point as a separate target, its distance from the nominal point as tolerance.

    links, offsets: the model's first effects, with the tolerances of the options.
    """
    nominal_mm = tool_point_of(links.robot)
    robot = with_own_tool_point(model.robot, nominal_mm)
    own = robot.own_tool_point
    assert own is not None
    off_mm = float(np.linalg.norm(tool_point_of(found) - nominal_mm))
    x, y, z = target_parameter_names(own)
    across_mm, along_mm = (links.tolerances.get(name, off_mm) for name in ("aTCP", "dTCP"))
    tolerances = {x: across_mm, y: across_mm, z: along_mm}
    others: tuple[TargetOffsets, ...] = () if offsets is None else (offsets,)
    targets = tuple(t for of in others for t in of.targets if t.name != own.name)
    place = TargetOffsets((own, *targets), {**tolerances, **(offsets.tolerances if offsets else {})})
    own_names = {"aTCP": (x, y), "dTCP": (z,)}
    own_fixed = [name for row_name, names in own_names.items() if row_name in model.fixed for name in names]
    geometry = (LinkErrors(robot, links.tolerances), place)
    return Model(
        robot,
        (*geometry, *model.effects[1 + len(others) :]),
        model.fixed.union(fixed_behind_tool_point(robot, observed), own_fixed),
        model.prior_sigmas,
        model.loads_of,
        found,
        model.prior_means,
    )


_STEPS = 50
_LEAST_DOF = 12  # equations beyond the unknowns; fewer say little of how sure the point is
_WIDEST_MM = 1000.0  # sigma that holds p in the directions of which the points tell nothing


@dataclass(frozen=True)
class SolvedToolPoint:
    """Tool point estimated from the measured points and the nominal table."""

    point_mm: Array  # (3,) in the last joint's frame
    covariance_mm2: Array  # (3, 3) by what is left over, as if that were white


@dataclass(frozen=True)
class ToolPointProblem:
    """Least-squares problem for the tool point p: M measured points and the nominal poses of the last joint's frame."""

    flange_mm: Array  # (M, 3) origin of the last joint's frame, base frame
    base_R_flange: Array  # (M, 3, 3)
    scanner_mm: Array  # (M, 3) measured
    setups: list[IndexArray]  # rows of each
    nominal_mm: Array  # (3,)
    directions: Array  # (3, K) orthonormal: along which p may move

    @classmethod
    def of(cls, observed: Observations, robot: Robot, nominal_mm: Array, directions: Array) -> ToolPointProblem:
        """Tool point problem for the measured points of the tool, without those of further targets."""
        poses, row = observed.used_poses
        is_tool = observed.points.target == "jig"
        flange = kinematics.nominal_chain(robot, poses.q).base_T_flange[row[is_tool]]
        setup = observed.setup[is_tool]
        return cls(
            flange_mm=flange[:, :3, 3],
            base_R_flange=flange[:, :3, :3],
            scanner_mm=observed.points.xyz_mm[is_tool],
            setups=[np.flatnonzero(setup == name) for name in np.unique(setup)],
            nominal_mm=nominal_mm,
            directions=directions,
        )

    @property
    def dof(self) -> int:
        """Degrees of freedom: equations beyond the unknowns."""
        return 3 * len(self.scanner_mm) - 6 * len(self.setups) - self.directions.shape[1]

    def at(self, moved_mm: Array) -> tuple[Array, Array]:
        """Residual (3 M,), mm, and its derivative (3 M, K), for a tool point shifted along K free directions."""
        base_mm = self.flange_mm + self.base_R_flange @ (self.nominal_mm + self.directions @ moved_mm)
        residual = np.empty_like(base_mm)
        columns = np.empty((*base_mm.shape, len(moved_mm)))
        for rows in self.setups:
            scanner_T_base = frames.best_fit_transform(base_mm[rows], self.scanner_mm[rows], np.ones(len(rows)))
            at_mm = frames.apply(scanner_T_base, base_mm[rows])
            residual[rows] = at_mm - self.scanner_mm[rows]
            block = scanner_T_base[:3, :3] @ self.base_R_flange[rows] @ self.directions
            block = block.reshape(3 * len(rows), -1)
            basis = orthonormal(frame_columns(at_mm, np.broadcast_to(np.eye(3), (len(rows), 3, 3))))
            columns[rows] = (block - basis @ (basis.T @ block)).reshape(len(rows), 3, -1)
        return residual.ravel(), columns.reshape(-1, len(moved_mm))


def solve_tool_point(problem: ToolPointProblem) -> SolvedToolPoint | None:
    """Tool point with the least squared error on the nominal arm; None where points are too few."""
    count = problem.directions.shape[1]
    if count == 0 or problem.dof < _LEAST_DOF:
        return None
    moved = np.zeros(count)
    residual, columns = problem.at(moved)
    hold = 0.0
    for _ in range(_STEPS):
        cost = float(residual @ residual)
        hold = cost / problem.dof / _WIDEST_MM**2
        # Least squares of columns and hold together: exact points hold nothing, and may tell nothing of a direction.
        stacked = np.concatenate([columns, np.sqrt(hold) * np.eye(count)])
        step = -np.linalg.lstsq(stacked, np.concatenate([residual, np.sqrt(hold) * moved]), rcond=1e-12)[0]
        for share in 0.5 ** np.arange(8):
            residual, columns = problem.at(moved + share * step)
            if float(residual @ residual) <= cost:
                break
        moved = moved + share * step
        if np.linalg.norm(share * step) < 1e-3:
            break
    noise2 = float(residual @ residual) / problem.dof
    _, size, turn = np.linalg.svd(columns, full_matrices=False)
    sigma_mm = 1.0 / np.sqrt(size**2 / max(noise2, 1e-12) + 1.0 / _WIDEST_MM**2)
    root = problem.directions @ turn.T * sigma_mm
    covariance = root @ root.T
    return SolvedToolPoint(problem.nominal_mm + problem.directions @ moved, covariance)


_FAR = 3.0  # sigmas
_SYSTEMATIC = 3.0  # sigmas of the search are those of white errors; link errors are not white


def search_tool_point(observed: Observations, links: LinkErrors, fixed: Collection[str]) -> Robot | None:
    """Nominal arm with the tool point estimated from the points; None where that is near robot.toml's.

    Far off is more than the tolerances of the last two rows allow. (A prior that is weighed by the residual constrains
    a parameter the more the worse the fit is: it would keep a tool that is off by 80 mm where robot.toml has it.)
    """
    robot = links.robot
    nominal_mm = tool_point_of(robot)
    solved = solve_tool_point(ToolPointProblem.of(observed, robot, nominal_mm, free_directions(robot, fixed)))
    if solved is None:
        return None
    covariance = tolerance_covariance(robot, links, fixed) + _SYSTEMATIC**2 * solved.covariance_mm2
    if not _is_far(solved.point_mm - nominal_mm, covariance):
        return None
    return with_own_tool_point(robot, solved.point_mm)


def fitted_tool_point(model: Model, fit: Fit, links: LinkErrors, fixed: Collection[str]) -> Robot | None:
    """Nominal arm with a fit's tool point; None where that is within the tolerances of robot.toml's.

    links, fixed: as in the options; the model may have wider tolerances and further fixed parameters.
    """
    if free_directions(links.robot, fixed).shape[1] == 0:
        return None
    point_mm = tool_point_in_nominal(links.robot, model.calibrated_robot(fit.x))
    off_mm = point_mm - tool_point_of(links.robot)
    if not _is_far(off_mm, tolerance_covariance(links.robot, links, fixed)):
        return None
    return with_own_tool_point(links.robot, point_mm)


def turning_tool_point(model: Model, fit: Fit, links: LinkErrors, fixed: Collection[str]) -> Robot | None:
    """Nominal arm with its tool point where a fit that turned the tip frame put it; None where that turn is negligible.

    Hardly is within an angle's tolerance; one point does not determine the attitude of the tip.
    """
    calibrated = model.calibrated_robot(fit.x)
    tolerance_rad = max(links.tolerances.get(name, TOLERANCE_RAD) for name in angles_behind_last_axis(links.robot))
    turned = tip_turn_rad(links.robot, calibrated) > tolerance_rad
    if free_directions(links.robot, fixed).shape[1] < 3 or not turned:
        return None
    return with_own_tool_point(links.robot, tool_point_in_nominal(links.robot, calibrated))


def _is_far(off_mm: Array, covariance_mm2: Array) -> bool:
    return bool(off_mm @ np.linalg.solve(covariance_mm2, off_mm) > _FAR**2)
