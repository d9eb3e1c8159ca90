"""A short formula in place of a learned curve, where it says as much: harmonics, a bump, a kink, a step, a square."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from calib.array_types import Array
from calib.dataset.input_names import quantity_of
from calib.screening.curves.curve_evidence import CurveColumns, CurveEvidence, Spectrum
from calib.screening.curves.smooth_joint_error import FormulaModes, FormulaTerm

_MOST_TERMS = 3
_HIGHEST_ORDER = 45
_PLACES = 24
_WIDTHS = (0.05, 0.1, 0.2, 0.35, 0.6)  # rad, of a bump
_MAY_LOSE = 2.0  # in log evidence: for so little the formula is given


@dataclass(frozen=True)
class FoundFormula:
    """A formula and the log of its terms' prior sigmas, over the noise."""

    modes: FormulaModes
    log_sizes: tuple[float, ...]  # one a term
    blocks: tuple[tuple[CurveColumns, float], ...]  # columns and log of the prior sigma of each term
    gain: float  # in log evidence over a flat curve, less what choosing the terms costs


def candidate_terms(input_name: str, u: Array) -> list[FormulaTerm]:
    """The terms that are tried over an input (N,)."""
    low, high = float(np.min(u)), float(np.max(u))
    places = np.linspace(low, high, _PLACES + 2)[1:-1].tolist()
    terms = [FormulaTerm("kink", place=p) for p in places] + [FormulaTerm("step", place=p) for p in places]
    if quantity_of(input_name) == "torque":
        return [*terms, FormulaTerm("square")]
    terms += [FormulaTerm("harmonic", order=n) for n in range(1, _HIGHEST_ORDER + 1)]
    return terms + [FormulaTerm("bump", place=p, width=w) for p in places for w in _WIDTHS if w < 0.5 * (high - low)]


def find_formula(
    evidence: CurveEvidence,
    flat: Spectrum,
    worth: float,
    input_name: str,
    u: Array,
    columns_of: Callable[[Array], Array],
) -> FoundFormula | None:
    """The terms, one by one, that raise the log evidence most; None where they say less than the curve.

    Args:
        evidence: of all curves.
        flat: the spectrum with this curve flat and the others as they are.
        worth: what the curve adds to the log evidence beside the others.
        input_name, u: its input, and the values at the used poses (N,).
        columns_of: (N, K) motions of the joint to whitened, projected columns (R, K).
    """
    terms = candidate_terms(input_name, u)
    blocks = [_block(columns_of(term.at(u))) for term in terms]
    price = float(np.log(len(terms)))
    chosen: list[int] = []
    sizes: list[float] = []
    gain = 0.0
    beside, at = evidence, flat
    for _ in range(_MOST_TERMS):
        gains = beside.gains(at, blocks)
        best = max(range(len(gains)), key=lambda k: gains[k][0])
        if gains[best][0] < price + 1.0:
            break
        chosen.append(best)
        sizes.append(gains[best][1])
        gain += gains[best][0] - price
        if gain >= worth - _MAY_LOSE:
            modes = FormulaModes(input_name, tuple(terms[k] for k in chosen))
            found = tuple((blocks[k], size) for k, size in zip(chosen, sizes, strict=True))
            return FoundFormula(modes, tuple(sizes), found, gain)
        logs = np.concatenate([at.logs[:-2], [gains[best][1]], at.logs[-2:]])
        beside = CurveEvidence(beside.curve.beside(blocks[best]), evidence.residual, evidence.dof)
        at = Spectrum(logs)
    return None


def _block(columns: Array) -> CurveColumns:
    zero = np.zeros(columns.shape[1], dtype=np.int64)
    return CurveColumns(columns, zero, zero, zero.astype(bool))
