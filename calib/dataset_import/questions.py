"""What no file tells of an import, asked once: noise, tool point, tool mass, the jig's edges, a unit that is open."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from calib.array_types import Array, Vector
from calib.calibration.calibrate import HEAVY_FROM_MM
from calib.consistency.agreement import Sample, nominal_places
from calib.dataset.dataset import Dataset
from calib.dataset.repeats import find_repeats, pooled_sigma_mm
from calib.dataset_import.reading import MeantTable
from calib.effects.gravity import has_masses, tells_tool_mass
from calib.frames import apply, invert
from calib.kinematics.chain import nominal_chain
from calib.kinematics.robot import Robot
from calib.kinematics.tool_point import (
    ending_at_tool_point,
    tip_T_last,
    tool_point_of,
    with_own_tool_point,
    with_tool_point,
)
from calib.robot_formats.chain.five_parameters import vector
from calib.robot_formats.robot_file import RobotFile

_FEWEST_REPEATS, _BLUNDER = 3, 5.0  # places; times what half of them scatter by, from which single ones are blunders
_NEAR_MM = 5.0  # of the end of the robot's file, within which the measured point is taken to be there


@dataclass(frozen=True)
class Question:
    """Something that the user is asked for, what is taken without an answer, and the option that answers it."""

    what: str
    guess: str  # "" where there is none
    option: str  # as it is typed, with the guess or a placeholder


def noise_question(dataset: Dataset) -> Question:
    """Question for the noise of a measured point, guessed by repeats where there are some."""
    repeats = find_repeats(dataset)
    usual = sorted(repeats, key=lambda one: float(one.sigma_mm @ one.sigma_mm))[: (len(repeats) + 1) // 2]
    is_sure = len(repeats) >= _FEWEST_REPEATS and pooled_sigma_mm(repeats) < _BLUNDER * pooled_sigma_mm(usual)
    guess = f"{pooled_sigma_mm(repeats):.2g}" if is_sure else ""
    by = f"{guess} mm by the repeats" if guess else "what a fit leaves"
    return Question("noise of a measured point, the standard deviation of each axis", by, f"--sigma {guess or 'MM'}")


def tool_found_mm(robot: Robot, sample: Sample) -> tuple[Array, float] | None:
    """Measured point in the last joint's frame by the nominal arm, its median, and the arm's misfit, mm.

    None for an arm that carries the instrument, stands for poses, or has too few points.
    """
    if robot.carries_scanner or robot.is_cartesian or not sample.is_enough:
        return None
    misfit_mm, base_mm = nominal_places(robot, sample)
    end = nominal_chain(robot, sample.q).base_T_frame[:, robot.n_joints]
    return np.median(np.einsum("nji,nj->ni", end[:, :3, :3], base_mm - end[:, :3, 3]), axis=0), misfit_mm


def _reach_mm(robot: Robot, sample: Sample | None) -> tuple[Array, bool]:
    """Measured point in the last joint's frame, and whether the points have it elsewhere than the robot's file."""
    reach_mm = np.asarray(tool_point_of(robot))
    found = None if sample is None else tool_found_mm(robot, sample)
    if found is None or np.linalg.norm(found[0] - reach_mm) <= max(_NEAR_MM, 2.0 * found[1]):
        return reach_mm, False
    return found[0], True


def tool_questions(
    file: RobotFile, sample: Sample | None, told_mm: Vector | None, payload_kg: Sequence[float] | None
) -> list[Question]:
    """Questions for the tool's point, where the points have it elsewhere than the robot's file, and for its mass.

    told_mm: the measured point as the user gave it; payload_kg: of each pose.
    """
    robot, out = file.robot, []
    reach_mm, is_elsewhere = _reach_mm(robot, None if told_mm is not None else sample)
    if is_elsewhere:
        place = apply(tip_T_last(robot) if file.chain is not None else invert(robot.flange.transform), reach_mm)
        guess = ",".join(f"{value + 0.0:.1f}" for value in place)
        what = f"the measured point in {end_of(file)}, mm"
        out.append(Question(what, f"{guess} by the nominal arm", f"--tool={guess}"))
    told = tells_tool_mass(robot, None if payload_kg is None else np.asarray(payload_kg))
    if has_masses(robot) and not told and np.linalg.norm(reach_mm) > HEAVY_FROM_MM:
        out.append(Question("mass of the tool, kg", "nothing, which no compliance will do without", "--tool-mass KG"))
    return out


def end_of(file: RobotFile) -> str:
    """Name of the frame at which a robot's file ends."""
    return file.chain.tip if file.chain is not None and file.chain.tip else "the flange's frame"


def with_tool_offset(file: RobotFile, offset_mm: Vector) -> RobotFile:
    """Robot whose measured point is at an offset, mm, from the end of its file.

    A URDF and other files of a chain end at a flange: the point becomes the target "jig" of robot.toml, at the offset
    in the flange's frame, and the tool row keeps the flange. In a robot.toml [tool] is the tool: the tool row then ends
    at the offset in the flange's frame.
    """
    point_mm = np.array(offset_mm, dtype=float)
    if file.chain is None:
        in_last_mm = apply(file.robot.flange.transform, point_mm)
        return replace(file, robot=with_tool_point(ending_at_tool_point(file.robot), in_last_mm))
    in_last_mm = apply(invert(tip_T_last(file.robot)), point_mm)
    return replace(file, robot=with_own_tool_point(file.robot, vector(in_last_mm)))


def with_tool_mass(file: RobotFile, sample: Sample | None, mass_kg: float) -> RobotFile:
    """Robot whose tool has a mass, its centre half way to the measured point, where the points have it or the file."""
    centre_mm = np.round(0.5 * _reach_mm(file.robot, sample)[0], 1)
    tool = replace(file.robot.tool, mass_kg=mass_kg, com_mm=vector(centre_mm))
    return replace(file, robot=replace(file.robot, tool=tool))


def unit_question(table: MeantTable, meaning: str, units: Sequence[str]) -> Question:
    """Question for a unit that neither names nor points tell."""
    name = table.named(meaning)
    options = " or ".join(f"--map '{name}={meaning}_{unit}'" for unit in units)
    return Question(f"unit of {name} ... in {table.path.name}", "", options)


def edge_question(edge_mm: float | None) -> Question:
    """Question for the length of the jig's edges, as the planes in the scans have it."""
    guess = "" if edge_mm is None else f"{edge_mm:g}"
    taken = f"{guess} mm by the planes in the scans" if guess else "60 mm"
    return Question("length of the jig's edges from its corner", taken, f"--edge {guess or 'MM'}")
