"""What the tab Beside says of two calibrations, as HTML."""

from __future__ import annotations

from calib.calibration.evaluation import Evaluation
from calib.validation.comparison import Comparison, ParameterDifference, readable
from inspector.markup.parts import elements, numbers
from inspector.markup.parts.palette import BAD, BESIDE_COLOURS, GOOD, ROLE_WORDS

TOLD_FROM = 2.0  # sigmas


def headline_html(compared: Comparison) -> str:
    """What differs, in a sentence or two."""
    return elements.alert(numbers.typeset(compared.headline), colour=BAD if compared.differs else GOOD)


def tables_html(compared: Comparison) -> str:
    """The errors of both, and what differs beyond its sigma."""
    parts = []
    for name, only in zip(compared.names, compared.only_in, strict=True):
        if only:
            parts.append(elements.note(f"Only in the model of {name}: {numbers.listing(list(only))}."))
    return "".join([*parts, errors_html(compared), parameters_html(compared)])


def errors_html(compared: Comparison) -> str:
    """Before and after of both, training and test."""
    rows = []
    for k, (name, (before, after)) in enumerate(zip(compared.names, compared.errors, strict=True)):
        colour = BESIDE_COLOURS[1 - k]  # the one on show comes last
        for role in ("train", "test"):
            values = _rmse_mm(before, role), _rmse_mm(after, role)
            if values[1] is not None:
                label = elements.named_swatch(colour, f"{name}, {ROLE_WORDS[role]}")
                rows.append((label, *("–" if v is None else numbers.millimetres(v) for v in values)))
    return elements.heading("3D RMSE, mm") + elements.table(("", "nominal", "fitted"), rows)


def _rmse_mm(evaluation: Evaluation, role: str) -> float | None:
    figures = evaluation.train if role == "train" else evaluation.test
    return None if figures is None else figures.rmse_mm


def parameters_html(compared: Comparison) -> str:
    """The parameters that differ beyond two sigmas, the surest first."""
    apart = sorted((p for p in compared.parameters if abs(p.z) >= TOLD_FROM), key=lambda p: -abs(p.z))
    if not apart:
        return elements.note(f"No single parameter differs by {TOLD_FROM:g} sigmas or more.")
    rows = [_row(p) for p in apart]
    return (
        elements.heading(f"Parameters that differ by {TOLD_FROM:g} sigmas or more")
        + elements.table(("", *compared.names, "by", "sigma", ""), rows, height="300px")
        + elements.note(
            "Of many parameters one in twenty is beyond two sigmas by chance, and one real change moves those that it "
            "is confused with; the sentence above counts all of that."
        )
    )


def _row(p: ParameterDifference) -> tuple[str, ...]:
    (first, unit), (second, _) = (readable(v, p.unit) for v in p.values)
    (by, _), (sigma, _) = readable(p.difference, p.unit), readable(p.sigma, p.unit)
    return (
        numbers.parameter_label(p.name), f"{first:z.5g}", f"{second:z.5g}", f"{by:+z.3g}", f"{sigma:.2g}",
        "°" if unit == "deg" else unit,
    )  # fmt: skip
