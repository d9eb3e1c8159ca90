"""What the tab Fit says of a calibration, as HTML: errors before and after, parameters."""

from __future__ import annotations

import math

import numpy as np

from calib.calibration.result import Calibration
from calib.models.exported_table import exported_table
from calib.present import names, numbers
from calib.present.numbers import parameter_label
from calib.screening.curves.fitted_curves import learned_members, without_curves
from calib.screening.curves.smooth_joint_error import LEARNED
from inspector.markup.learn.curves import curves_table_html
from inspector.markup.parts import elements
from inspector.markup.parts.links import Names, joint_asks, joints_by_parameter, linked
from inspector.markup.parts.palette import ROLE_COLOURS
from inspector.session.measuring import measured_kinds, no_full_poses
from inspector.session.session import Session

PARAMETER_COLUMNS = ("name", "nominal", "fitted", "change", "sigma", "unit")
EFFECT_COLUMNS = ("name", "fitted", "sigma", "unit")  # without an effect its sizes are zero
FIGURES = (
    ("rmse_mm", "3D RMSE"),
    ("mean_mm", "3D mean"),
    ("max_mm", "3D max"),
    ("distance_mean_mm", "distance mean"),
    ("distance_max_mm", "distance max"),
)
NO_POSES = "pose cannot be fitted: "


def faces_words(session: Session) -> str:
    """What a fit of full poses has to go by, or what it lacks, in a sentence."""
    if session.unlabelled:
        return "pose needs the jig's faces named in the scans, which is done once their corners are found."
    if "pose" not in measured_kinds(session):
        if session.dataset.points is None:
            return "Full poses are not offered: what is scanned is no jig with three faces."
        return "Full poses are not offered: points.csv has no orientations (qw, qx, qy, qz)."
    problem = no_full_poses(session)
    if problem:
        return NO_POSES + problem.removeprefix(f"dataset {session.dataset.name}: ")
    if session.face_labels is not None:
        return f"pose can be fitted: {session.face_labels.summary()}."
    return "pose can be fitted: points.csv has orientations."


def what_is_fitted(result: Calibration) -> str:
    """The error that the figures show."""
    return "distance" if result.residual == "distance" else "3D"


def state_html(result: Calibration) -> str:
    """What kind of fit it was and how it ended."""
    fit = result.fit
    rows: list[tuple[str, object]] = [
        ("residual", f"{result.residual}, {numbers.count(fit.rows, 'equation')}"),
        ("parameters", f"{len(fit.parameters)}, of which {fit.rank} can be told apart"),
        ("iterations", len(result.iteration_errors) - 1),
        ("ended", fit.reason),
    ]
    if np.isfinite(result.sigma_mm):
        rows.append(("residual sigma, one axis", numbers.length(result.sigma_mm)))
    return elements.facts(rows) + "".join(
        elements.alert(linked(w, Names.of(result.dataset)), colour="#E69F00") for w in result.warnings
    )


def before_and_after(result: Calibration) -> list[tuple[str, str, float, float]]:
    """Role, name of the figure, its value before and after in mm: of training poses, then of test poses."""
    return [
        (role, name, float(getattr(before, key)), float(getattr(after, key)))
        for role, before, after in (
            ("train", result.before.train, result.after.train),
            ("test", result.before.test, result.after.test),
        )
        if before is not None and after is not None
        for key, name in FIGURES
    ]


def figures_html(result: Calibration) -> str:
    """Before and after, training and test, with the reduction."""
    rows = [
        (
            elements.named_swatch(ROLE_COLOURS[role], f"{names.role(role)} {name}"),
            *(numbers.column_mm(value) for value in (before, after)),
            numbers.reduction(before, after),
        )
        for role, name, before, after in before_and_after(result)
    ]
    columns = ("", "before", "after", "reduction")
    lengths = elements.heading("Errors before and after, mm") + elements.table(columns, rows)
    turns = attitude_rows(result)
    return lengths + (
        elements.heading("Attitude of the jig before and after, mrad") + elements.table(columns, turns) if turns else ""
    )


def table_alone_html(session: Session) -> str:
    """What robot.toml is worth without the model's effects; "" where there are none."""
    if session.calibration is None or session.links_alone is None:
        return ""
    words = exported_table(session.calibration, session.links_alone).words
    return elements.note(f"What robot.toml will hold: {words}.") if words else ""


def attitude_rows(result: Calibration) -> list[tuple[object, ...]]:
    """How far the jig's predicted attitude is from the measured one, where full poses were fitted; mrad."""
    if result.orientation_errors is None:
        return []
    before, after = result.orientation_errors
    rows: list[tuple[object, ...]] = []
    for role, was, now in (("train", before.train, after.train), ("test", before.test, after.test)):
        if was is None or now is None:
            continue
        for name, b, a in (("RMSE", was.rmse_rad, now.rmse_rad), ("max", was.max_rad, now.max_rad)):
            named = elements.named_swatch(ROLE_COLOURS[role], f"{names.role(role)} {name}")
            rows.append((named, f"{1e3 * b:.4f}", f"{1e3 * a:.4f}", numbers.reduction(b, a)))
    return rows


def parameter_rows(result: Calibration) -> list[tuple[str, ...]]:
    """Name, nominal, fitted, change, sigma, unit of each parameter that is no learned curve's.

    What the data do not know has a star.
    """
    rows = []
    for row in without_curves(result.to_frame()).to_dict("records"):
        own = "." in str(row["name"])  # of an effect: its name says its unit
        angle = row["unit"] == "rad" and not own  # people read degrees, as the files have them
        nominal, value, change, sigma = (
            math.degrees(row[key]) if angle else row[key] for key in ("nominal", "value", "change", "sigma")
        )
        # Link errors are read beside the data sheet's four decimals; an effect's sizes run from 1e-6 to 1.
        few = "z.3g" if own else "z.4f"  # z: no minus before zero
        rows.append(
            (
                parameter_label(str(row["name"])),
                *(f"{v:{few}}" for v in (nominal, value)),
                f"{change:+{few}}",
                f"{sigma:.2g}" + ("" if row["known"] else " *"),
                "°" if angle else row["unit"],
            )
        )
    return rows


def parameters_html(result: Calibration) -> str:
    """The parameters as a table; what the data do not know is said."""
    rows = parameter_rows(result)
    links = [row for row in rows if "." not in row[0]]
    of_joint = joints_by_parameter(result.model.robot, result.model.added_effects)
    own = without_curves(result.to_frame())["name"]  # as the fit calls them, a row each
    asks = joint_asks(of_joint.get(str(name)) for name in own)
    effects: dict[str, list[tuple[object, ...]]] = {}
    asks_of: dict[str, list[elements.Html]] = {}
    for (name, _, fitted, _, sigma, unit), ask in zip(rows[len(links) :], asks[len(links) :], strict=True):
        effect, _, short = name.partition(".")
        effects.setdefault(effect, []).append((elements.wrapping(short), fitted, sigma, unit))
        asks_of.setdefault(effect, []).append(ask)
    return (
        elements.heading("Parameters")
        + elements.table(PARAMETER_COLUMNS, links, height="420px", asks=asks[: len(links)])
        + "".join(
            elements.heading(f"Effect {effect}")
            + elements.table(EFFECT_COLUMNS, of_it, height="260px", asks=asks_of[effect])
            for effect, of_it in effects.items()
        )
        + (elements.heading(f"Effect {LEARNED}") + curves_table_html(result) if learned_members(result) else "")
        + elements.note(
            "* the data tell next to nothing of it by itself: the value is held by its tolerance, or shared."
        )
    )
