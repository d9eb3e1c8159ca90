"""What to do next with a model built by hand: add the effect that leads, measure more, look closer, or stop.

The same thresholds as `calib.diagnosis.decision_rules`, for any fit: what is left is judged, then the ranking is read.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from calib.diagnosis.decision_rules import is_convincing, leading_fault, rank_candidates
from calib.diagnosis.explanation import left_in_short
from calib.screening.candidates import Screening
from calib.screening.residual_tests import ResidualTests

KINDS = ("add", "ambiguous", "done", "outliers", "unknown")


@dataclass(frozen=True)
class Advice:
    """The next step, and why, in words."""

    kind: str  # of KINDS
    effects: tuple[str, ...]  # that it is about, the best first
    words: str


def advise(screening: Screening, residual_tests: ResidualTests) -> Advice:
    """What the ranking and the residual_tests of one fit suggest."""
    convincing = [c for c in screening.candidates if is_convincing(c)]
    # What an effect explains may look like a story outside the catalogue too: with one at hand the pattern is told.
    left = f"What is left: {left_in_short(replace(residual_tests, fault=None) if convincing else residual_tests)}."
    simpler = leading_fault(screening) if convincing else None
    if simpler is not None:
        return Advice(
            "unknown",
            (),
            f"Outside the catalogue a simpler story says more than any effect: {simpler.words}. Look at that joint "
            "before you add anything.",
        )
    if convincing:
        best, margin, tied = rank_candidates(screening)
        if tied:
            names = tuple(c.name for c in tied)
            return Advice(
                "ambiguous",
                names,
                f"{left} {_listed(names)} could each explain it: their evidence lies within 3, these data cannot tell "
                "which. Measure what tells them apart, or add one and see which goes on to help.",
            )
        lead = f" and leads the next by {margin:.0f}" if margin is not None else ""
        return Advice(
            "add",
            (best.name,),
            f"{left} {best.name} is missing: its evidence is {best.log_evidence:.0f} (3 would do){lead}. Add it.",
        )
    if residual_tests.fault or residual_tests.structured or residual_tests.too_large:
        return Advice(
            "unknown",
            (),
            f"{left} No effect in the ranking explains it. Look at it in the tab Where it fails; a loose part, a hose "
            "or a slip would show so. An effect of your own can be tested with --effects-file.",
        )
    if residual_tests.outlier_poses:
        return Advice(
            "outliers",
            (),
            f"{left} No effect is missing. Measure those poses again before you leave them out.",
        )
    return Advice("done", (), f"{left} {_nothing(screening)}")


def _nothing(screening: Screening) -> str:
    """What "nothing is missing" covers: an effect that these data cannot test is not found absent."""
    if not screening.candidates:
        return "These data can test none of the catalogue's effects, so none can be found missing."
    # A scale of the scanner is left out, which hardly any data can test.
    blind = sum(silent.name != "scanner_scale" for silent in screening.untestable)
    known = f", as far as these data can tell: they cannot test {blind} of the effects" if blind else ""
    return f"No effect of the ranking would help: nothing more is missing{known}."


def _listed(names: tuple[str, ...]) -> str:
    return f"{', '.join(names[:-1])} and {names[-1]}" if len(names) > 1 else "".join(names)
