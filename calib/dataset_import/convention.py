"""Convention of the robot's table and of the joints' signs, order and zeros, chosen by the measured points."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import degrees

import numpy as np

from calib.array_types import Array
from calib.calibration.calibrate import fit_measured
from calib.consistency.agreement import Sample, misfit_mm, sample_of
from calib.consistency.data_problem import Suspicions, suspicions
from calib.consistency.hypotheses import of_reading
from calib.consistency.joint_convention import FEWEST_POSES, joint_convention
from calib.consistency.joint_reading import JointReading
from calib.dataset.dataset import Dataset, Points, Poses
from calib.dataset_import.columns import AS_MAPPED, Column, Recognised
from calib.dataset_import.reading import ImportReport, MeantTable
from calib.errors import CalibError, DatasetError
from calib.kinematics.robot import Robot
from calib.rendering import numbers
from calib.robot_formats.conventions import TABLE_KINDS, RobotReading
from calib.robot_formats.robot_file import RobotFile
from calib.text_files.column_names import ANGLES_RAD

GAIN = 5.0  # ratio of misfits from which the gain is overwhelming
_FAR = 0.03  # the same, above which other conventions of the joints are tried
_FAR_OF_SCREWS = 0.005  # the same of an arm with slides, which a screw hardly moves
_MOST_LISTED = 4  # conventions that a sentence tells
AGREES = 0.1  # of the points' spread, at most, where arm and points belong together


@dataclass(frozen=True)
class Sheet:
    """Joint values and points as read from the file: one point per pose, all of one target and station."""

    ids: tuple[str, ...]  # (N,)
    q: Array  # (N, n) rad, mm
    points_mm: Array  # (N, 3), nan where nothing was measured

    @property
    def sample(self) -> Sample:
        """Sample of the poses for comparison with the nominal arm."""
        return sample_of(self.q, self.points_mm)

    def dataset(self, robot: Robot) -> Dataset:
        """Dataset of an arm with all measured poses as training poses."""
        known = np.flatnonzero(np.isfinite(self.q).all(axis=1) & np.isfinite(self.points_mm).all(axis=1))
        ids = tuple(self.ids[i] for i in known)
        role = np.array(["reference", *["train"] * (len(known) - 1)])
        poses = Poses(ids, role, self.q[known], np.full(len(known), ""), ids)
        points = Points(np.arange(len(known)), self.points_mm[known], np.full(len(known), "jig"))
        return Dataset("sheet", robot, poses, points)


@dataclass(frozen=True)
class ResolvedConventions:
    """Chosen robot, with what it is commanded by the joints' columns, which follow an order; with the reason."""

    robot: RobotFile
    joints: JointReading
    why: str = ""

    def applied(self, meant: Recognised, units: Sequence[str]) -> Recognised:
        """The recognised columns with joint k read from column order_k, and what its values are by the joints."""
        reading, n = self.joints, len(units)
        if reading == JointReading.plain(n):
            return meant
        columns = dict(meant.columns)
        by_joint = np.linalg.inv(reading.coupling)
        for k in range(n):
            source = meant.columns[f"q{reading.order[k] + 1}"]
            offset = degrees(reading.offsets_rad[k]) if units[k] == "deg" else reading.offsets_rad[k]
            columns[f"q{k + 1}"] = replace(
                source,
                meaning=f"q{k + 1}",
                sign=float(by_joint[k, k]) or 1.0,
                offset=offset,
                why=self.why if k + 1 in reading.joints else source.why,
                others=tuple((f"q{j + 1}", float(by_joint[k, j])) for j in range(n) if j != k and by_joint[k, j]),
            )
        return replace(meant, columns=columns)


def with_told_commands(robot: RobotReading, meant: Recognised, scale: Array) -> RobotReading:
    """Robot whose commanded values are those of the columns, with the signs, zeros and sums that the user told.

    scale: (n,) from the columns' units to rad and mm.
    """
    arm = robot.robot.robot
    of_joints = [meant.columns[f"q{k + 1}"] for k in range(arm.n_joints)]
    by_joint = np.diag([column.sign for column in of_joints])
    for k, column in enumerate(of_joints):
        for name, sign in column.others:
            if not 1 <= int(name[1:]) <= arm.n_joints:
                raise DatasetError(
                    f"--map {column.name}=...: {name} is no joint of {arm.name}, which has {arm.n_joints}"
                )
            by_joint[k, int(name[1:]) - 1] += sign
    if abs(np.linalg.det(by_joint)) < 0.5:  # of whole numbers
        raise DatasetError("--map: the columns of joints do not tell all joints; each needs a sum of its own")
    by_column = np.linalg.inv(by_joint)
    zeros = by_column @ (scale * [column.sign * column.offset for column in of_joints])
    return replace(robot, robot=replace(robot.robot, robot=_commanded(arm, by_column, zeros)))


def _commanded(robot: Robot, coupling: Array, zeros: Array) -> Robot:
    """Robot whose present commanded values follow from others: coupling @ others + zeros."""
    before = np.array(robot.coupling) if robot.coupling else np.eye(robot.n_joints)
    return robot.with_commands(before @ coupling, before @ zeros + robot.zeros)


def _as_read(robot: RobotFile, reading: JointReading, why: str) -> ResolvedConventions:
    """The choice of a robot whose joint values are what a reading makes of those that the columns give now."""
    arm, order = robot.robot, list(reading.order)
    now = np.array(arm.coupling)[np.ix_(order, order)] if arm.coupling else np.eye(arm.n_joints)
    arm = arm.with_commands(reading.coupling @ now, reading.coupling @ arm.zeros[order] + reading.offsets_rad)
    return ResolvedConventions(replace(robot, robot=arm), reading, why)


def has_known_unit(
    report: ImportReport, readings: Sequence[RobotReading], sheet: Sheet | None, joints: MeantTable
) -> bool:
    """Whether the points show the unit of joints that may be no angles at all; a fault is reported where not."""
    sample = None if sheet is None else sheet.sample
    if sample is not None and sample.is_enough:
        least = min(misfit_mm(each.robot.robot, sample) for each in readings)
        if least <= AGREES * sample.spread_mm:
            return True
    column, table = joints.named("q1"), joints.path
    report.fault(
        f"{table}: the unit of {column} ... is not told: degrees, radians or normalised, and the points do not show "
        f"which; tell it by --map '{column}=q1_deg' (or q1_rad) ..., or record joint angles"
    )
    return False


def settled(
    report: ImportReport,
    readings: Sequence[RobotReading],
    sheet: Sheet | None,
    joints: MeantTable,
    placements: Sequence[str] = (),
) -> ResolvedConventions:
    """Robot convention, and order, signs and zeros of the joints, that fit the points best; as given unless far worse.

    sheet  # None where no point belongs to a pose
    placements  # columns that may name where the instrument or a plate of known places stood
    """
    sample, meant, table = None if sheet is None else sheet.sample, joints.meant, joints.path
    asked = readings[0]
    arm, plain = asked.robot.robot, JointReading.plain(asked.robot.robot.n_joints)
    as_it_is = ResolvedConventions(asked.robot, plain)
    if len(readings) == 1 and not asked.asked:
        report.notes.append(f"{arm.name}: its table is {TABLE_KINDS[asked.convention]}, by its axes")
    if arm.is_cartesian:
        return as_it_is
    is_open = len(readings) > 1 and not any(each.asked for each in readings)
    if sheet is None or sample is None or len(sample.q) < FEWEST_POSES or not sample.spread_mm > 0.0:
        if is_open:
            report.fault(_ask_for_convention(asked, readings))
        return as_it_is
    misfits = [misfit_mm(each.robot.robot, sample) for each in readings]
    least, *others = sorted(misfits)
    best = readings[misfits.index(least)]
    is_clear = least <= AGREES * _scale_mm(best.robot.robot, sample) and bool(others) and others[0] >= GAIN * least
    if is_open and not is_clear:
        report.fault(_ask_for_convention(asked, readings))
        return as_it_is
    if is_clear and (is_open or best is not asked):
        report.notes.append(
            f"{arm.name}: its table is taken for {TABLE_KINDS[best.convention]}: so read, the nominal arm misses the "
            f"points by {least:.3g} mm rms, otherwise by {others[0]:.3g} mm"
        )
        report.notes += [f"{arm.name}: {note}" for note in best.robot.notes]
        return ResolvedConventions(best.robot, plain)
    names = [joints.named(f"q{k + 1}") for k in range(arm.n_joints)]
    scale_mm = _scale_mm(arm, sample)
    is_told = any(column.why == AS_MAPPED for name, column in meant.columns.items() if _is_joint(name))

    def read_so(mistake: str, change: str, fall: str, reading: JointReading) -> ResolvedConventions:
        report.notes.append(f"{table}: {mistake}, and is read so: {change} {fall}; --map says it otherwise")
        return _as_read(asked.robot, reading, f"so read, {fall}")

    far_mm = (_FAR if arm.is_revolute.all() else _FAR_OF_SCREWS) * scale_mm
    if misfits[0] > far_mm:
        columns = [meant.columns[f"q{k + 1}"] for k in range(arm.n_joints)]
        if wrong_unit := _other_unit(arm, sample, columns, misfits[0]):
            report.doubts.append(f"{table}: {wrong_unit}")
            return as_it_is
        convention = joint_convention(arm, sample.q, sample.points_mm)
        told = [of_reading(one, names, arm.is_revolute) for one in convention.readings]
        fall = _fall(convention.as_it_is_mm, convention.left_mm)
        mirrored_mm = misfit_mm(arm, replace(sample, points_mm=sample.points_mm * [1.0, 1.0, -1.0]))
        if told and mirrored_mm < far_mm:
            report.doubts.append(
                f"{table}: {told[0].mistake}, or the points are mirrored: their error falls from {misfits[0]:.3g} to "
                f"{mirrored_mm:.3g} mm so; where two axes have changed places, exchange them, as by --map "
                f"'{meant.columns['x'].name if 'x' in meant.columns else 'X'}=y' and the other way round, else say "
                "what the joints are with --map"
            )
            return as_it_is
        if len(told) == 1 and not is_told and convention.left_mm < far_mm:
            return read_so(told[0].mistake, told[0].change, fall, convention.readings[0])
        if told:
            mistakes = numbers.in_short([one.mistake for one in told], _MOST_LISTED)
            which = f" {told[0].change}" if len(told) == 1 else " these poses do not tell which;"
            report.doubts.append(f"{table}: {mistakes}:{which} {fall}; tell with --map")
            return as_it_is
    found = _suspicions(sheet, arm, names) if sample.is_enough else Suspicions(None)
    problem = found.problem
    if problem is not None and not (problem.hypothesis.angle_scale != 1.0 and _names_tell_units(meant)):
        reading = problem.hypothesis.reading
        if reading is not None and not problem.rivals and not is_told:
            fall = _fall(problem.now_mm, problem.then_mm)
            return read_so(problem.mistake, problem.hypothesis.change, fall, reading)
        report.doubts.append(f"{table}: {problem.warning}{'; tell with --map' if reading is not None else ''}")
        return as_it_is
    if found.likeliest is not None:
        report.doubts.append(
            f"{table}: {found.likeliest.warning}, or an effect of the arm looks so: inspector diagnose weighs them"
        )
    if misfits[0] > AGREES * scale_mm:
        stood = [
            f"; if column {name} names where the instrument, or a plate, stood, say so by --map '{name}=setup'"
            for name in placements[:1]
        ]
        report.doubts.append(
            f"{table}: the nominal arm misses the points by {misfits[0]:.3g} mm rms, and they spread by "
            f"{sample.spread_mm:.3g} mm: they may be of another robot, or in another order; no sign, order, zero "
            f"or sum of the joints explains it{''.join(stood)}"
        )
    return as_it_is


def _other_unit(robot: Robot, sample: Sample, columns: Sequence[Column], now_mm: float) -> str:
    """What to do where the joints' columns name one unit of angles and hold the other; "" where they do not."""
    named = {column.unit for column, turns in zip(columns, robot.is_revolute, strict=True) if turns}
    if named not in ({"deg"}, {"rad"}):
        return ""
    (unit,) = named
    other = "deg" if unit == "rad" else "rad"
    scale = np.where(robot.is_revolute, ANGLES_RAD[other] / ANGLES_RAD[unit], 1.0)
    then_mm = misfit_mm(robot, replace(sample, q=sample.q * scale))
    if then_mm > min(now_mm / GAIN, AGREES * _scale_mm(robot, sample)):
        return ""
    typed = " ".join(f"--map '{column.name}=q{k + 1}_{other}'" for k, column in enumerate(columns))
    return f"the joints are named {unit} and hold {other}: {_fall(now_mm, then_mm)} so; tell it by {typed}"


def _fall(now_mm: float, then_mm: float) -> str:
    return f"the error falls from {now_mm:.3g} to {then_mm:.3g} mm"


def _names_tell_units(meant: Recognised) -> bool:
    """Whether the name of each joint's column has the unit."""
    return all(column.unit for name, column in meant.columns.items() if _is_joint(name))


def _is_joint(meaning: str) -> bool:
    return meaning[:1] == "q" and meaning[1:].isdigit()


def _scale_mm(robot: Robot, sample: Sample) -> float:
    """Length to which the arm's misfit is compared: the points' spread, or what wrong joints would leave if more.

    Points of a few known places hardly spread, however the arm turns there.
    """
    if not robot.is_revolute.all():
        return sample.spread_mm
    return max(sample.spread_mm, misfit_mm(robot, replace(sample, q=np.roll(sample.q, 1, axis=1))))


def _suspicions(sheet: Sheet, robot: Robot, names: Sequence[str]) -> Suspicions:
    """Likely mistakes in the data, found by fitting the links; none where no fit is possible."""
    try:
        return suspicions(fit_measured(sheet.dataset(robot)), fit_measured, names)
    except CalibError:
        return Suspicions(None)


def _ask_for_convention(asked: RobotReading, readings: Sequence[RobotReading]) -> str:
    conventions = " or ".join(each.convention for each in readings)
    return (
        f"{asked.robot.robot.name}: its table of theta, d, a, alpha may be {conventions} Denavit-Hartenberg, and the "
        "points do not tell; give --convention"
    )
