"""Entries of robot.toml that a fit moved much further than the links of arms usually are off: is it the right table?

A link that is a few millimetres off is no more than a large link error to a fit, which explains the data perfectly and
says nothing. Yet arms leave the factory with links right to half a millimetre, so that an entry ten millimetres off is
most likely a table of another size or series, or a flange or spacer that the table does not have.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass

import numpy as np

from calib.calibration.doubts import LinkDoubt
from calib.calibration.result import Calibration
from calib.calibration.uncertainty import Combination, combination, identifiable_combinations
from calib.kinematics.robot import LENGTH_KINDS
from calib.plugins import contributions, load
from calib.statistics import rms

USUAL_MM = 0.5
"""RMS deviation of a link's length from its table, over nine recordings of six real arms with a tracker or a socket."""
USUAL_RAD = float(np.radians(0.2))
"""The same of a link's twist (alpha, beta)."""
LEAST_TIMES = 8.0
"""How many times the usual deviation, from which an entry is doubted: 4 mm, 1.6 deg; those recordings reach 3.7."""
_OTHERS = 6.0  # how many times the median deviation of the others: an arm that is off everywhere is another matter
_SIGMAS = 5.0  # by which an entry's deviation is known to be that large
_MISFITS = 5.0  # times the residual sigma: a model that fits badly bends its links
_TWIST_KINDS = ("alpha", "beta")
_LEAST_SCALED_MM = 3.0 * USUAL_MM  # by which a common scale changes the longest length, from which it is told
_LONG_MM = 50.0  # lengths that show a scale
_FEWEST_LENGTHS = 3
_LEFT_OF_SCALE = 0.3  # share of the lengths' deviations that a common scale may leave


@dataclass(frozen=True)
class DoubtfulEntry:
    """Entry of the robot's table, or sum of entries that move the tool alike, that is far from what a fit found."""

    name: str  # "a2", "d6 + dTCP"
    off: float  # fitted minus table
    sigma: float
    usual: float  # deviation that links of arms usually have
    unit: str  # "mm" or "rad"
    of_tool: bool  # whether the tool's own row is part of it

    @property
    def times(self) -> float:
        """Deviation over the usual one."""
        return abs(self.off) / self.usual


def doubtful_entries(calibration: Calibration) -> tuple[DoubtfulEntry, ...]:
    """Lengths and twists of the robot's table that stand out as far from what a fit found, the furthest first.

    An entry counts if its deviation is known to five sigma, is eight times what links usually have, six times the
    median of the arm's other entries, and, for lengths, five times the residual sigma. None counts where the
    links have taken up something else.
    """
    if taken_up_by_links(calibration):
        return ()
    known = _known_entries(calibration)
    out: list[DoubtfulEntry] = []
    for unit, usual, kinds in (("mm", USUAL_MM, LENGTH_KINDS), ("rad", USUAL_RAD, _TWIST_KINDS)):
        entries = [(one, _off(calibration, one)) for one in known if one.unit == unit and _is_of(one, kinds)]
        for one, off in entries:
            others = [abs(other) for entry, other in entries if entry is not one]
            least = max(LEAST_TIMES * usual, _OTHERS * float(np.median(others)) if others else 0.0)
            if unit == "mm":
                least = max(least, _MISFITS * calibration.sigma_mm)
            if abs(off) - _SIGMAS * one.sigma > 0.0 and abs(off) > least:
                of_tool = any(name.endswith("TCP") for name in one.coefficients)
                out.append(DoubtfulEntry(one.description, off, one.sigma, usual, unit, of_tool))
    return tuple(sorted(out, key=lambda entry: -entry.times))


def taken_up_by_links(calibration: Calibration) -> list[str]:
    """Sentences on what else errs than the links, which have taken it up, without capital; [] where nothing shows."""
    told = [sentence for doubt in contributions(LinkDoubt) for sentence in load(doubt.sentences)(calibration)]
    scale = common_scale(calibration)
    if scale is None:
        return told
    return [
        *told,
        f"all lengths came out {abs(100.0 * scale):.2f} % {'longer' if scale > 0.0 else 'shorter'} than robot.toml's, "
        "alike: the scale of the instrument errs, or the size that its target is said to have, or a unit; measure a "
        "certified length, and do not take the links for that long",
    ]


def common_scale(calibration: Calibration) -> float | None:
    """Relative error that all lengths of a fitted table share, so that no arm has it but what measured it; or None."""
    lengths = [(one, _off(calibration, one)) for one in _known_entries(calibration) if _is_of(one, LENGTH_KINDS)]
    told = [(one.value - off, off) for one, off in lengths if abs(one.value - off) > _LONG_MM]
    if len(told) < _FEWEST_LENGTHS:
        return None
    nominal_mm, off_mm = np.array(told).T
    scale = float(nominal_mm @ off_mm) / float(nominal_mm @ nominal_mm)
    left_mm = off_mm - scale * nominal_mm
    shows = abs(scale) * float(np.abs(nominal_mm).max()) > _LEAST_SCALED_MM
    return scale if shows and rms(left_mm) < _LEFT_OF_SCALE * rms(off_mm) else None


def _known_entries(calibration: Calibration) -> list[Combination]:
    """Entries of the table, and sums of those that move the tool alike, that the fit determines."""
    fit = calibration.fit
    of_table = set(calibration.dataset.robot.parameter_names)
    usual = {"mm": USUAL_MM, "rad": USUAL_RAD}
    if not any(abs(x) > usual[p.unit] for x, p in zip(fit.x, fit.parameters, strict=True) if p.name in of_table):
        return []  # also a sum of as many entries as there are is not off by eight times the usual
    sums = [one for one in identifiable_combinations(calibration) if set(one.coefficients) <= of_table]
    in_sums = {name for one in sums for name in one.coefficients}
    single = [
        combination(calibration, {parameter.name: 1.0})
        for parameter in fit.parameters
        if parameter.name in of_table and parameter.name not in in_sums
    ]
    return [*sums, *(one for one in single if one.is_known)]


def _off(calibration: Calibration, entry: Combination) -> float:
    """Fitted value minus the table's value of an entry or sum of entries."""
    nominal = {parameter.name: parameter.nominal for parameter in calibration.fit.parameters}
    return entry.value - sum(weight * nominal[name] for name, weight in entry.coefficients.items())


def _is_of(entry: Combination, kinds: Collection[str]) -> bool:
    """Whether all parts of an entry are of some kinds ("a", "d", "alpha" ...)."""
    return all(name.rstrip("0123456789").removesuffix("TCP") in kinds for name in entry.coefficients)
