"""Whether poses of a board and those of the arm belong together: rows that err, changed places, a wrong sign, a move.

A third of the rows may err, in place or in attitude: they are named and left out. Where more do, or where what is left
is more than arms err by, the mistakes that people make with tables are tried: another sign, order or zero of the
joints, rows that are out of step or turned round, and a board or camera that was moved.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from calib import frames
from calib.array_types import Array, IndexArray
from calib.consistency.hypotheses import (
    MIRRORED,
    UNITS,
    DataHypothesis,
    column_names,
    of_reading,
    of_shifts,
    simplest_of,
)
from calib.consistency.joint_reading import simple_readings
from calib.dataset.dataset import Dataset
from calib.errors import CalibError
from calib.extras.camera.board_hand_eye import FAR, MOST, BoardHandEye, board_hand_eye, misfit_mm
from calib.kinematics.cartesian import joints_of_poses
from calib.kinematics.chain import nominal_chain

FEWEST = 5  # poses of a hand-eye calibration that is judged
_QUIET_MM, _QUIET_SHARE = 2.0, 0.85  # misfit and share of good rows, up to which and from which no mistake is sought
_CLEAR = 3.0  # ratio of misfits from which a mistake explains them
_CLEAR_MOVE = 2.0  # the same of a move, after which few poses are left for each part
_AS_GOOD = 1.3  # ratio of misfits up to which a simpler mistake explains them as well
_LEAST_SHARE = 0.65  # of the rows, which have to agree
_MOST_DEG, _MOST_SHARE = 8.0, 0.2  # errors that no arm has: of attitudes; of places, a share of the flange's spread
_SURE_DEG, _SURE_SHARE = 2.0, 0.4  # where all attitudes agree to so much, places may err by so much
_NEARLY_ALL = 0.9  # of the poses before and after a move


def flange_poses(dataset: Dataset) -> Array:
    """Poses (M, 4, 4) of the flange at the points of a dataset, by its table."""
    assert dataset.points is not None
    return nominal_chain(dataset.robot, dataset.poses.q[dataset.points.pose]).base_T_flange


def board_poses(dataset: Dataset) -> Array:
    """Poses (M, 4, 4) of the board at the points of a dataset."""
    points = dataset.points
    assert points is not None
    assert points.orientations is not None
    return frames.make_transform(points.orientations.scanner_R_jig, points.xyz_mm)


def of_setups(dataset: Dataset) -> list[IndexArray]:
    """Rows of the points of each placement of the camera that has enough to be judged."""
    assert dataset.points is not None
    setup = dataset.poses.setup[dataset.points.pose]
    rows = (np.flatnonzero(setup == name) for name in np.unique(setup))
    return [each for each in rows if len(each) >= FEWEST]


def fits_of(dataset: Dataset, *, on_flange: bool) -> list[BoardHandEye]:
    """Hand-eye calibration of each placement of the camera."""
    flange, seen = flange_poses(dataset), board_poses(dataset)
    return [board_hand_eye(flange[rows], seen[rows], on_flange=on_flange) for rows in of_setups(dataset)]


def require_no_mistake(
    dataset: Dataset, fits: Sequence[BoardHandEye], best: Sequence[BoardHandEye], names: Sequence[str]
) -> None:
    """Raise CalibError where a mistake in the data explains what hand-eye calibrations leave.

    best: those of the mount that leaves least, which a mistake with another mount has to beat as well.
    names: of the files, which the error tells.
    """
    on_flange, count = fits[0].on_flange, sum(len(fit.good) for fit in fits)
    now_mm = min(_misfit_mm(dataset, each[0].on_flange) for each in (fits, best))
    share = sum(int(fit.good.sum()) for fit in fits) / count
    if now_mm < _QUIET_MM and share > _QUIET_SHARE:
        return
    where = " and ".join(names)
    if all(fit.scale < 0.0 and fit.scaled_mm < fit.rms_mm / _CLEAR for fit in best):
        raise CalibError(
            f"{where}: places and attitudes agree as in a mirror: one of both is told in a left-handed frame; negate "
            "one axis there, of places and attitudes alike"
        )
    found = {one: _misfit_mm(one.of_dataset(dataset), on_flange) for one in _mistakes(dataset)}
    best_mm = min(found.values(), default=np.inf)
    if best_mm < now_mm / _CLEAR:
        likely = simplest_of([one for one, off_mm in found.items() if off_mm < _AS_GOOD * best_mm])
        told = min(likely, key=lambda one: found[one])
        raise CalibError(
            f"{where}: {told.mistake}; {told.change} arm and board disagree {now_mm / found[told]:.0f} times less; "
            f"{told.remedy}"
        )
    _require_not_moved(dataset, fits, best, where)


def require_agreement(dataset: Dataset, fits: Sequence[BoardHandEye], names: Sequence[str]) -> None:
    """Raise CalibError where too few poses agree, or agree by no more than chance."""
    share = sum(int(fit.good.sum()) for fit in fits) / sum(len(fit.good) for fit in fits)
    off_mm, off_deg = max(fit.rms_mm for fit in fits), float(np.degrees(max(fit.rms_rad for fit in fits)))
    spread_mm = float(np.linalg.norm(np.std(flange_poses(dataset)[:, :3, 3], axis=0)))
    most = _SURE_SHARE if share == 1.0 and off_deg < _SURE_DEG else _MOST_SHARE
    if share < _LEAST_SHARE or off_deg > _MOST_DEG or off_mm > most * max(spread_mm, 100.0):
        why = (
            "no sign, order, zero or unit of joints, no axis of places, no shift of rows and no move explains it; "
            "check that robot, joints and what the camera saw are of one run, and that each row has its own image"
        )
        if off_mm < _QUIET_MM and off_deg > _MOST_DEG:
            why = "places agree and attitudes do not: the board is seen too small or straight on, and flips; go nearer"
        elif off_deg < _SURE_DEG:
            why = "attitudes agree and places do not: check axes, signs, and the order of the quaternions' numbers"
        raise CalibError(
            f"{' and '.join(names)} do not belong together: {share:.0%} of them agree, to {off_mm:.3g} mm and "
            f"{off_deg:.2g}°, where the flange spreads by {spread_mm:.3g} mm; {why}"
        )


def _misfit_mm(dataset: Dataset, on_flange: bool, most: float = MOST) -> float:
    """Misfit of the worst placement of the camera, by a share of its poses."""
    flange, seen = flange_poses(dataset), board_poses(dataset)
    each = [misfit_mm(flange[rows], seen[rows], on_flange=on_flange, most=most) for rows in of_setups(dataset)]
    return max(each, default=float("inf"))


@dataclass(frozen=True, eq=False)
class _OtherPoses(DataHypothesis):
    """A mistake in how poses are told: of the board, or of the flange of an arm that stands for them."""

    corrected: Callable[[Array], Array] = np.array
    of_flange: bool = False

    def of_dataset(self, dataset: Dataset) -> Dataset:
        """Dataset with the poses corrected."""
        points = dataset.points
        assert points is not None
        if self.of_flange:
            flange = nominal_chain(dataset.robot, dataset.poses.q).base_T_flange
            return replace(dataset, poses=replace(dataset.poses, q=joints_of_poses(self.corrected(flange))))
        seen = self.corrected(board_poses(dataset))
        assert points.orientations is not None
        turned = replace(points.orientations, scanner_R_jig=seen[:, :3, :3])
        return replace(dataset, points=replace(points, xyz_mm=seen[:, :3, 3], orientations=turned))


def _mistakes(dataset: Dataset) -> Iterator[DataHypothesis]:
    """Mistakes that the data may have, changes of a dataset."""
    robot = dataset.robot
    if not robot.is_cartesian:
        for reading in simple_readings(robot.is_revolute):
            if reading.edits:
                yield of_reading(reading, column_names(robot))
        most = float(np.abs(dataset.poses.q[:, robot.is_revolute]).max(initial=0.0))
        for unit, name, scale, may_be in (
            ("degrees", "deg", np.pi / 180.0, most > 2.0 * np.pi),
            ("radians", "rad", 180.0 / np.pi, most < np.radians(2.0 * np.pi)),
        ):
            mistake, change = f"the joints' angles are in {unit}", f"with them read as {unit}"
            if may_be:
                yield DataHypothesis(UNITS, mistake, change, f"name the columns q1_{name} ...", angle_scale=scale)
    yield from of_shifts(dataset)
    for what in ("board", "flange")[: 1 + robot.is_cartesian]:
        for k, axis in enumerate("xyz"):
            sign = np.ones((4, 4))
            sign[k, 3] = -1.0
            yield _OtherPoses(
                MIRRORED, f"{axis} of the {what}'s places has the other sign", f"with {axis} negated",
                f"negate it, or check the handedness of the {what}'s frame",
                corrected=sign.__mul__, of_flange=what == "flange",
            )  # fmt: skip


def _require_not_moved(
    dataset: Dataset, fits: Sequence[BoardHandEye], best: Sequence[BoardHandEye], where: str
) -> None:
    """Raise CalibError where fits to the rows before and after one of them leave much less than one to all of them."""
    flange, seen, points = flange_poses(dataset), board_poses(dataset), dataset.points
    assert points is not None
    on_flange, cuts = fits[0].on_flange, range(FEWEST + 1, len(points) - FEWEST)
    if len(of_setups(dataset)) != 1 or not cuts:
        return

    def misfits(cut: int) -> float:
        parts = ((flange[:cut], seen[:cut]), (flange[cut:], seen[cut:]))
        return max(misfit_mm(*part, on_flange=on_flange, most=_NEARLY_ALL) for part in parts)

    cut = min(cuts, key=misfits)
    parts = (board_hand_eye(flange[rows], seen[rows], on_flange=on_flange) for rows in (slice(cut), slice(cut, None)))
    moved_mm = max(fit.misfit_of_most(_NEARLY_ALL) for fit in parts)
    now_mm = min(each[0].misfit_of_most(_NEARLY_ALL) for each in (fits, best))
    if moved_mm < now_mm / _CLEAR_MOVE:
        last, first = (dataset.poses.ids[points.pose[row]] for row in (cut - 1, cut))
        moved = "board or camera was moved" + ", or tool or base frame changed," * dataset.robot.is_cartesian
        raise CalibError(
            f"{where}: {moved} between poses {last} and {first}: taken apart there, arm and board disagree "
            f"{now_mm / moved_mm:.1f} times less; import the poses before and after it apart"
        )


def bad_rows(dataset: Dataset, fits: Sequence[BoardHandEye]) -> dict[int, str]:
    """Why rows of the points are left out, by row: poses of the board that agree with most others do not."""
    flange, seen, points = flange_poses(dataset), board_poses(dataset), dataset.points
    assert points is not None
    assert points.orientations is not None
    assert points.covariance_mm2 is not None
    assert points.orientations.covariance_rad2 is not None
    both = np.stack([points.covariance_mm2, points.orientations.covariance_rad2])
    own = np.sqrt(np.trace(both, axis1=2, axis2=3) / 3.0)  # of an axis: what is seen badly may be far off
    out = {}
    for rows, fit in zip(of_setups(dataset), fits, strict=True):
        off = np.stack([np.linalg.norm(error, axis=1) for error in (fit.error_mm, fit.error_rad)])
        gone = ~fit.good & np.any(off > FAR * own[:, rows], axis=0)
        bad = rows[gone]
        for row, off_mm, off_rad in zip(bad, *off[:, gone], strict=True):
            told = f"{off_mm:.3g} mm and {np.degrees(off_rad):.2g}° from where arm and most others put it"
            there = np.repeat(flange[[row]], len(bad), axis=0)
            owner = bad[fit.agrees(flange[bad], np.repeat(seen[[row]], len(bad), axis=0))]
            mine = bad[fit.agrees(there, seen[bad])]
            for other in owner if np.array_equal(owner, mine) else ():
                told += f"; it has changed places with {dataset.poses.ids[points.pose[other]]}"
            out[int(row)] = told
    return out
