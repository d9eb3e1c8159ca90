"""Which convention the measurements speak for: of the robot's table, of the joints' signs, order and zeros."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import degrees
from pathlib import Path

from calib.dataset.input_names import quantity_of
from calib.dataset_import.agreement import Sample, misfit_mm
from calib.dataset_import.columns import AS_TOLD, Recognised
from calib.dataset_import.joint_reading import AGREES, GAIN, LOOKS_RIGHT, JointReading, better_reading
from calib.dataset_import.reading import Work
from calib.robot_formats.conventions import SCHOOLS, RobotReading
from calib.robot_formats.robot_file import RobotFile


@dataclass(frozen=True)
class Settled:
    """The robot and the reading of its joints' columns that are taken, and why those columns are read so."""

    robot: RobotFile
    joints: JointReading
    why: str = ""

    def applied(self, meant: Recognised, units: Sequence[str]) -> Recognised:
        """The columns as they are read: joint k from the column order_k, with its sign and zero."""
        reading, n = self.joints, len(units)
        if reading == JointReading.plain(n):
            return meant
        columns = dict(meant.columns)
        for k in range(n):
            source = meant.columns[f"q{reading.order[k] + 1}"]
            offset = degrees(reading.offsets_rad[k]) if units[k] == "deg" else reading.offsets_rad[k]
            changed = reading.order[k] != k or reading.signs[k] < 0 or offset != 0.0
            columns[f"q{k + 1}"] = replace(
                source,
                meaning=f"q{k + 1}",
                sign=reading.signs[k],
                offset=offset,
                why=self.why if changed else source.why,
            )
        return replace(meant, columns=columns)


def settled(
    work: Work, readings: Sequence[RobotReading], sample: Sample | None, meant: Recognised, table: Path
) -> Settled:
    """What the points speak for. What is taken is said; another reading is taken only where the gain is overwhelming.

    sample  # None where no point belongs to a pose
    """
    asked = readings[0]
    plain = JointReading.plain(asked.robot.robot.n_joints)
    as_it_is = Settled(asked.robot, plain)
    if len(readings) == 1 and not asked.asked:
        work.said.append(f"{asked.robot.robot.name}: its table is {SCHOOLS[asked.convention]}, by its axes")
    if sample is None or not sample.is_enough:
        if not any(each.asked for each in readings) and len(readings) > 1:
            work.fault(_ask_for_convention(asked, readings))
        return as_it_is
    misfits = [misfit_mm(each.robot.robot, sample.q, sample.points_mm) for each in readings]
    least = min(misfits)
    best = readings[misfits.index(least)]
    near = least <= AGREES * sample.spread_mm
    if not any(each.asked for each in readings) and len(readings) > 1:
        worse = min(m for m, each in zip(misfits, readings, strict=True) if each is not best)
        if not near or worse < GAIN * least:
            work.fault(_ask_for_convention(asked, readings))
            return as_it_is
        work.said.append(
            f"{best.robot.robot.name}: its table is {SCHOOLS[best.convention]}, with which the nominal arm misses the "
            f"points by {least:.3g} mm rms, and with the other one by {worse:.3g} mm"
        )
        return Settled(best.robot, plain)
    if best is not asked and near and misfits[0] >= GAIN * least:
        work.said.append(
            f"{asked.robot.robot.name}: its table is taken for {SCHOOLS[best.convention]}: so read, the nominal arm "
            f"misses the points by {least:.3g} mm rms, and by {misfits[0]:.3g} mm as {SCHOOLS[asked.convention]}, "
            "which robot.toml is written in"
        )
        work.said += [f"{asked.robot.robot.name}: {note}" for note in best.robot.notes]
        return Settled(best.robot, plain)
    if misfits[0] <= LOOKS_RIGHT * sample.spread_mm:
        return as_it_is
    found = better_reading(asked.robot.robot, sample, misfits[0])
    told = any(column.why == AS_TOLD for name, column in meant.columns.items() if quantity_of(name) == "q")
    if found is None:
        if misfits[0] > AGREES * sample.spread_mm:
            work.doubts.append(
                f"{table}: the nominal arm misses the points by {misfits[0]:.3g} mm rms, and they spread by "
                f"{sample.spread_mm:.3g} mm: they may be of another robot, or in another order; no sign, order or zero "
                "of the joints explains it"
            )
        return as_it_is
    words = _words(found.reading, meant)
    gain = (
        f"the nominal arm then misses the points by {found.misfit_mm:.3g} mm rms, and as it stands by "
        f"{misfits[0]:.3g} mm"
    )
    if told or found.rival is not None:
        rival = f" (or {_words(found.rival, meant)})" if found.rival is not None else ""
        work.doubts.append(f"{table}: {words}{rival} would fit better: {gain}; tell with --map")
        return as_it_is
    work.said.append(f"{table}: {words}: {gain}; --map says it otherwise")
    return Settled(asked.robot, found.reading, f"so read, {gain.replace(' then', '')}")


def _ask_for_convention(asked: RobotReading, readings: Sequence[RobotReading]) -> str:
    conventions = " or ".join(each.convention for each in readings)
    return (
        f"{asked.robot.robot.name}: its table of theta, d, a, alpha may be {conventions} Denavit-Hartenberg, and the "
        "points do not tell; give --convention"
    )


def _words(reading: JointReading, meant: Recognised) -> str:
    """What a reading changes, in words."""
    parts = []
    for k, (column, sign, offset) in enumerate(
        zip(reading.order, reading.signs, reading.offsets_rad, strict=True)
    ):
        name = meant.columns[f"q{column + 1}"].name
        changes = ["in another place"] if column != k else []
        changes += ["with the opposite sign"] if sign < 0 else []
        changes += [f"counted from {-degrees(offset):+.0f}°"] if offset else []
        if changes:
            parts.append(f"joint {k + 1} is {name} {' and '.join(changes)}")
    return ", ".join(parts)
