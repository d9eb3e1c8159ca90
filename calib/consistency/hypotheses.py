"""Hypotheses on mistakes in joints, points or the robot's table, each a change of a dataset."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cache
from math import degrees

import numpy as np

from calib.array_types import Array, BoolArray, IndexArray
from calib.consistency.agreement import Sample, misfit_columns, with_entries_fitted
from calib.consistency.joint_reading import JointReading
from calib.consistency.known_tables import KnownTables
from calib.dataset.dataset import Dataset, Points, Poses
from calib.dataset.files.robot_toml import builtin_robot
from calib.kinematics.chain import target_points
from calib.kinematics.commanded import sums_in_words
from calib.kinematics.robot import LENGTH_KINDS, PARAMETER_KINDS, Robot
from calib.options import BUILTIN_ROBOTS
from calib.plugins import contributions, load
from calib.rendering import numbers

JOINT_SIGN, JOINT_ORDER, JOINT_ZERO, JOINT_SUM = "joint_sign", "joint_order", "joint_zero", "joint_sum"
UNITS, ROBOT_TABLE, ROW_ORDER, MIRRORED = "units", "robot_table", "row_order", "mirrored"
_MIRROR = np.array([-1.0, 1.0, 1.0])  # any other reflection is this one and a turn

_LENGTHS = {"inch": 25.4, "m": 1000.0, "cm": 10.0}  # that a file may be in where mm are expected
_SHIFTS = (1, -1, 2, -2, 3, -3)  # rows by which a sheet may be out of step
_NOT_THERE = -1
_MOST_LENGTHS = 3  # of a table that may be another arm's; more are another robot
_LEAST_CHANGE_MM = 5.0  # of a length that is another arm's
_SHOWN = 1e-6  # of the most that a length moves the points, squared, below which they do not show it
_NAMED_ROWS = 6  # that a sentence tells one by one


@dataclass(frozen=True, eq=False)
class DataHypothesis:
    """A possible mistake in the data; fields at their default leave the dataset unchanged."""

    kind: str
    mistake: str  # a clause: "joint 6 turns the other way than robot.toml says"
    change: str  # the change that mends it: "with q6 negated"
    remedy: str  # what the user should do
    joints: tuple[int, ...] = ()  # counted from 1
    reading: JointReading | None = None
    angle_scale: float = 1.0
    slide_scale: float = 1.0
    points_scale: float = 1.0
    mirrored: bool = False
    robot: Robot | None = None
    rows: tuple[int, ...] = ()  # (N,) the row of joints that belongs to each pose; -1: none
    chosen_from: int = 1  # for tables with other lengths: how many there were to choose each of
    edits: int = 1  # how many things it changes: of two that say as much the simpler one is taken

    @property
    def moved_rows(self) -> int:
        """Number of poses that get the joint values of another row of the file."""
        return sum(row != k for k, row in enumerate(self.rows))

    def of_sample(self, sample: Sample, robot: Robot) -> Sample:
        """Sample with the mistake corrected, for hypotheses that concern neither rows nor robot table."""
        q = self._joints_of(sample.q, robot.is_revolute)
        points_mm = sample.points_mm * (self.points_scale * _MIRROR if self.mirrored else self.points_scale)
        return replace(sample, q=q, points_mm=points_mm)

    def of_dataset(self, dataset: Dataset) -> Dataset:
        """Dataset with the mistake corrected."""
        poses, points, robot = dataset.poses, dataset.points, self.robot or dataset.robot
        if robot is not dataset.robot:
            robot = replace(robot, targets=dataset.robot.targets, carries_scanner=dataset.robot.carries_scanner)
        if self.rows:
            poses, points = _reordered(poses, points, np.array(self.rows))
        poses = self._poses(poses, robot.is_revolute)
        if points is not None and self.points_scale != 1.0:
            points = _scaled(points, self.points_scale)
        if points is not None and self.mirrored:
            points = _mirrored(points)
        scanner, sigma_mm = dataset.scanner, dataset.scanner.point_sigma_mm
        if sigma_mm is not None:
            scanner = replace(scanner, point_sigma_mm=sigma_mm * self.points_scale)
        return replace(dataset, poses=poses, points=points, robot=robot, scanner=scanner)

    def _joints_of(self, q: Array, is_revolute: BoolArray) -> Array:
        q = q * np.where(is_revolute, self.angle_scale, self.slide_scale)
        return q if self.reading is None else self.reading.of(q)

    def _poses(self, poses: Poses, is_revolute: BoolArray) -> Poses:
        q = self._joints_of(poses.q, is_revolute)
        if q is poses.q or np.array_equal(q, poses.q):
            return poses
        approach = poses.approach
        if approach is not None and self.reading is not None:
            approach = approach[:, list(self.reading.order)] * np.array(self.reading.signs)
        return replace(poses, q=q, approach=approach, came_from=np.zeros((0, 0)))


def simplest_of(hypotheses: Sequence[DataHypothesis]) -> list[DataHypothesis]:
    """Hypotheses with the fewest changes; a wrong sign is preferred to a wrong zero, which may look the same."""

    def rank(hypothesis: DataHypothesis) -> tuple[int, bool]:
        return hypothesis.edits, hypothesis.kind == JOINT_ZERO

    least = min(map(rank, hypotheses))
    return [hypothesis for hypothesis in hypotheses if rank(hypothesis) == least]


def _scaled(points: Points, scale: float) -> Points:
    covariance = points.covariance_mm2
    return replace(
        points, xyz_mm=points.xyz_mm * scale, covariance_mm2=None if covariance is None else covariance * scale**2
    )


def _mirrored(points: Points) -> Points:
    covariance = points.covariance_mm2
    turned = None if covariance is None else covariance * np.outer(_MIRROR, _MIRROR)
    return replace(points, xyz_mm=points.xyz_mm * _MIRROR, covariance_mm2=turned)


def of_mirroring() -> DataHypothesis:
    """Hypothesis that the points are told in a left-handed frame."""
    return DataHypothesis(
        MIRRORED,
        "the points are told in a left-handed frame, as in a mirror",
        "with x negated",
        "negate one of the columns x, y and z of the points, or exchange two",
        mirrored=True,
    )


def _reordered(poses: Poses, points: Points | None, rows: IndexArray) -> tuple[Poses, Points | None]:
    """Poses with the joint values of other rows; a pose without such a row loses its points."""
    known = rows != _NOT_THERE
    source = np.where(known, rows, np.arange(len(rows)))
    approach = None if poses.approach is None else poses.approach[source]
    poses = replace(poses, q=poses.q[source], approach=approach, came_from=np.zeros((0, 0)))
    return poses, None if points is None else points.select(known[points.pose])


# ---- joints --------------------------------------------------------------------------------------------------------


def of_reading(reading: JointReading, names: Sequence[str], turns: BoolArray | None = None) -> DataHypothesis:
    """Hypothesis that the joint columns have other signs, another order or other zeros, or are sums of joints.

    turns: (n,) which joints turn; None: all.
    """
    by_joint = np.asarray(np.linalg.inv(reading.coupling))
    summed = np.flatnonzero(np.count_nonzero(by_joint, axis=1) > 1).tolist()
    turned = [k for k, sign in enumerate(reading.signs) if sign < 0 and k not in summed]
    moved = [k for k, column in enumerate(reading.order) if column != k]
    zeros = [k for k, offset in enumerate(reading.offsets_rad) if offset]
    mistake, change, remedy = [], [], []
    if turned:
        those = [names[reading.order[k]] for k in turned]
        turn = "turn" if len(turned) > 1 else "turns"
        mistake.append(f"{_joints_words(turned)} {turn} the other way than robot.toml says")
        change.append(f"{_and(those)} negated")
        remedy.append(f"negate column{'s' if len(those) > 1 else ''} {_and(those)}")
    if moved:
        asked = [names[k] for k in moved]
        given = [names[reading.order[k]] for k in moved]
        backwards = reading.order == tuple(reversed(range(len(names))))
        mistake.append("the joints stand backwards" if backwards else f"the columns {_and(asked)} have changed places")
        change.append("the columns put back")
        remedy.append(f"take {', '.join(f'{b} for {a}' for a, b in zip(asked, given, strict=True))}")
    for k in zeros:
        by = degrees(reading.offsets_rad[k])
        mistake.append(f"joint {k + 1} is counted from {-by:+.0f} deg")
        change.append(f"{by:+.0f} deg added to {names[reading.order[k]]}")
        remedy.append(f"add {by:+.0f} deg to column {names[reading.order[k]]}")
    told = sums_in_words(by_joint, np.ones(len(names), dtype=bool) if turns is None else turns)
    for k in summed:
        name = names[reading.order[k]]
        mistake.append(f"{name} of the table is {told[k]} of the robot")
        change.append(f"{name} taken so")
        remedy.append(
            f"import with --map '{name}={told[k].replace('J', 'q').replace(' ', '')}' (coupling in robot.toml)"
        )
    kind = JOINT_SUM if summed else JOINT_ORDER if moved else JOINT_SIGN if turned else JOINT_ZERO
    return DataHypothesis(
        kind, _and(mistake), f"with {_and(change)}", _and(remedy), reading.joints, reading=reading, edits=reading.edits
    )


def column_names(robot: Robot) -> tuple[str, ...]:
    """Names of the joints' columns in poses.csv: q1_deg q2_deg ... q4_mm."""
    return tuple(f"q{k + 1}_{'deg' if turns else 'mm'}" for k, turns in enumerate(robot.is_revolute))


def _joints_words(joints: Sequence[int]) -> str:
    numbers = [str(k + 1) for k in joints]
    return f"joint{'s' if len(numbers) > 1 else ''} {_and(numbers)}"


def _and(words: Sequence[str]) -> str:
    return numbers.listing(words)


# ---- units ---------------------------------------------------------------------------------------------------------


def of_units(robot: Robot, sample: Sample) -> Iterator[DataHypothesis]:
    """Hypotheses that points, angles or slides are in other units than declared."""
    turns = robot.is_revolute
    deg = np.pi / 180.0
    angles = {
        1.0: ("", "", ""),
        1.0 / deg: ("the joints' angles are in radians", "read as radians", "name the columns q1_rad ..."),
        deg: ("the joints' angles are in degrees", "read as degrees", "name the columns q1_deg ..."),
    }
    slides = {1.0: ("", "", "")}
    if not turns.all():
        slides |= {
            scale: (f"the slides are in {unit}", f"the slides read in {unit}", f"multiply the slides by {scale:g}")
            for unit, scale in _LENGTHS.items()
        }
    lengths: dict[float, tuple[str, str, str]] = {1.0: ("", "", "")}
    for unit, scale in _LENGTHS.items():
        lengths[scale] = (
            f"the points are in {unit}", f"the points read in {unit}", f"multiply x, y and z by {scale:g}"
        )  # fmt: skip
        lengths[1.0 / scale] = (
            f"the lengths of robot.toml are in {unit}",
            f"the lengths of robot.toml read in {unit}",
            f"multiply the lengths of robot.toml by {scale:g}, or the points by {1.0 / scale:.4g} if they are wrong",
        )
    for angle, angle_words in angles.items() if turns.any() else [(1.0, angles[1.0])]:
        for slide, slide_words in slides.items():
            q = sample.q * np.where(turns, angle, slide)
            spread = replace(sample, points_mm=target_points(robot, q)).spread_mm
            if not spread > 0.0:
                continue
            length = min(lengths, key=lambda scale: abs(np.log(scale * sample.spread_mm / spread)))
            changed = [words for words in (angle_words, slide_words, lengths[length]) if words[0]]
            if changed:
                mistake, change, remedy = (_and(list(words)) for words in zip(*changed, strict=True))
                yield DataHypothesis(
                    UNITS, mistake, f"with {change}", remedy,
                    angle_scale=angle, slide_scale=slide, points_scale=length, edits=len(changed),
                )  # fmt: skip


# ---- rows ----------------------------------------------------------------------------------------------------------


def of_shifts(dataset: Dataset) -> Iterator[DataHypothesis]:
    """Hypotheses that joint rows are shifted against the points by a few rows, or are in reverse order."""
    count = len(dataset.poses)
    place = np.arange(count)
    for by in _SHIFTS:
        rows = np.where((place + by >= 0) & (place + by < count), place + by, _NOT_THERE)
        where, number = ("below" if by > 0 else "above"), abs(by)
        lines = "line" if number == 1 else f"{number} lines"
        yield DataHypothesis(
            ROW_ORDER,
            f"the rows of points and joints are out of step: each point belongs to the joints {number} "
            f"row{'s' if number > 1 else ''} {where}",
            f"with the joints moved by {number} row{'s' if number > 1 else ''}",
            f"move the columns of joints {'up' if by > 0 else 'down'} by {'one ' if number == 1 else ''}{lines}, and "
            "look for the row that is missing",
            rows=tuple(map(int, rows)),
        )
    yield DataHypothesis(
        ROW_ORDER,
        "the rows of points stand in the opposite order of the joints",
        "with the joints' rows turned upside down",
        "turn the order of the points' rows, or of the joints'",
        rows=tuple(map(int, place[::-1])),
    )


def of_matching(dataset: Dataset, poses: IndexArray, source: IndexArray) -> DataHypothesis:
    """Hypothesis that some poses have the joint values of other poses, as matched by their points."""
    rows = np.arange(len(dataset.poses))
    rows[poses] = source
    wrong = [dataset.poses.ids[i] for i in poses[poses != source]]
    pairs = ", ".join(
        f"{dataset.poses.ids[i]} has the joints of {dataset.poses.ids[k]}"
        for i, k in zip(poses, source, strict=True)
        if i != k
    )
    which = pairs if len(wrong) <= _NAMED_ROWS else numbers.in_short(wrong, _NAMED_ROWS)
    return DataHypothesis(
        ROW_ORDER,
        f"the points of {len(wrong)} of {len(poses)} poses belong to the joints of other rows ({which})",
        "with each point given to the joints that reach it",
        "put the rows of points and joints into one order; a column that names the pose in both tables keeps them so",
        rows=tuple(map(int, rows)),
        edits=2,
    )


# ---- tables --------------------------------------------------------------------------------------------------------


def of_sister_tables(robot: Robot) -> Iterator[DataHypothesis]:
    """Hypotheses that the arm is another known one with the same number and types of joints."""
    for name, other in known_tables():
        alike = np.array_equal(other.is_revolute, robot.is_revolute)
        if alike and not np.allclose(other.table[:-1], robot.table[:-1], atol=1e-6):
            yield DataHypothesis(
                ROBOT_TABLE,
                f"the links are those of a {name}, not those of robot.toml ({robot.name})",
                f"with the table of the {name}",
                f"give the table of the {name} as robot.toml, with your tool",
                robot=other,
            )


def of_other_lengths(robot: Robot, sample: Sample) -> Iterator[DataHypothesis]:
    """Hypotheses that one, two or three lengths of the table are another arm's: an arm of another size, or a misprint.

    At each step the length that explains most of the misfit is freed, with frames and tool point free too, and all that
    are free are fitted: orthogonal matching pursuit, with Gauss-Newton steps as the misfit is not linear.
    """
    lengths = [k for k, name in enumerate(robot.parameter_names) if robot.parameter_units[k] == "mm"]
    lengths = lengths[: -sum(kind in LENGTH_KINDS for kind in PARAMETER_KINDS)]  # the tool is free anyhow
    free: list[int] = []
    now = robot
    for _ in range(_MOST_LENGTHS):
        off, columns = misfit_columns(now, sample, lengths)
        squares = np.sum(columns**2, axis=0)
        shown = squares > _SHOWN * np.max(squares, initial=0.0)
        gain = np.where(shown, (columns.T @ off) ** 2 / np.maximum(squares, 1e-300), 0.0)
        gain[[lengths.index(k) for k in free]] = 0.0
        if not gain.any():
            return
        free.append(lengths[int(np.argmax(gain))])
        now = with_entries_fitted(now, sample, free)
        changed = (now.table - robot.table).ravel()[free]
        if np.abs(changed).min() < _LEAST_CHANGE_MM:
            return
        told = _and([f"{robot.parameter_names[k]} is {by:+.1f} mm" for k, by in zip(free, changed, strict=True)])
        yield DataHypothesis(
            ROBOT_TABLE,
            f"the links are not those of robot.toml ({robot.name}): against it {told}",
            "with these lengths",
            "give the table of this size of the arm as robot.toml, or measure these lengths",
            robot=now,
            edits=len(free),
            chosen_from=len(lengths),
        )


@cache
def known_tables() -> tuple[tuple[str, Robot], ...]:
    """Robots, by name, whose tables come with the package and its plug-ins."""
    further = [robot for tables in contributions(KnownTables) for robot in load(tables.robots)()]
    return (*further, *((builtin_robot(name).name, builtin_robot(name)) for name in BUILTIN_ROBOTS))
