"""Presentation of a calibration: errors before and after, convergence, all parameters, and the identifiable sums."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any, Protocol

import numpy as np

from calib.calibration.evaluation import Evaluation, Figures
from calib.calibration.model_versions import Version
from calib.calibration.mount import CameraPlace, Mount, camera_places, mounts
from calib.calibration.noise_level import SigmaCheck, noise_level
from calib.calibration.promise import promise
from calib.calibration.result import Calibration
from calib.calibration.table_doubts import DoubtfulEntry, doubtful_entries, taken_up_by_links
from calib.calibration.uncertainty import Combination, correlated_pairs, identifiable_combinations
from calib.consistency.data_problem import DataProblem
from calib.consistency.leading_entry import leading_entry
from calib.diagnosis.effect_selection import FitStep, SelectedEffect
from calib.diagnosis.headline import headline_of
from calib.fitting.tool_point import ToolShift
from calib.identifiability.structural import redundancy_of
from calib.identifiability.tool_rows import tool_rows
from calib.models.exported_table import ExportedTable
from calib.models.fitted_model import RoleErrors
from calib.plugins import CalibrationPart, contributions, load
from calib.present import names
from calib.present.effects import model_name, with_joints
from calib.present.fit.corners import face_labelling
from calib.present.fit.curves import curve_table, formulas
from calib.present.fit.error_headline import error_headline
from calib.present.fit.promise import COVERAGE, coverage_words, promise_document
from calib.present.fit.redundancy import redundancy_section, tool_sentence
from calib.present.results import document, presentation
from calib.rendering import numbers
from calib.rendering.blocks import (
    Block,
    Bullets,
    Coloured,
    Facts,
    FigurePlace,
    Headline,
    Paragraph,
    Presentation,
    Reference,
    Section,
    Table,
    Verdict,
    Words,
    spans,
)
from calib.rendering.colours import BAD, GOOD, NEUTRAL
from calib.screening.curves.fitted_curves import members_of_one_input
from calib.screening.curves.smooth_joint_error import LEARNED

FIGURES = (
    ("rmse_mm", "3D RMSE"),
    ("mean_mm", "3D mean"),
    ("max_mm", "3D max"),
    ("distance_mean_mm", "distance mean"),
    ("distance_max_mm", "distance max"),
)
_NOT_DETERMINED = "not determined"
_WHY_NOT_DETERMINED = (
    f"{numbers.capitalised(_NOT_DETERMINED)}: these data do not tell this parameter by itself; it has no influence, or "
    "others or the instrument's unknown place share its influence. A calibrated file has a value for it, which counts "
    "only together with the others."
)
_CHANGES = ("before", "after", "reduction")
_UNCHANGED = 1e-6  # sigmas: a change below this is rounding
_MOST_OUTLIERS = 8  # outlying poses that are named
_SMALL_CHANGE = 0.01  # share of an error below which a change of it counts as none


@presentation.register
def _calibration(calibration: Calibration) -> Presentation:
    falls = FigurePlace("convergence", (calibration,), "Error at each iteration.", height_px=280)
    analysis = redundancy_of(calibration.dataset, residual=calibration.residual)
    sections = [
        Section("Parameters", parameters(calibration)),
        redundancy_section(analysis),
        Section("Convergence", [falls]),
    ]
    for part in contributions(CalibrationPart):
        if figures := load(part.figures)(calibration):
            sections.append(Section(part.title, figures))
    return Presentation(
        f"Calibration of {calibration.dataset.name}",
        [*calibration_head(calibration), pose_errors(calibration)],
        sections,
    )


def calibration_head(calibration: Calibration, way: Sequence[Calibration] = ()) -> list[Block]:
    """Blocks at the head of a calibration: errors at each stage, all errors, convergence, and warnings."""
    worse = worsening_sentence(calibration)
    remarks = [remark for remark in calibration_warnings(calibration) if remark != worse]
    return [
        error_way(*(way or (calibration,))),
        *([Verdict(numbers.capitalised(worse), BAD)] if worse else []),
        *error_tables(calibration),
        Facts(fit_facts(calibration)),
        *([Bullets(remarks)] if remarks else []),
    ]


def error_way(*calibrations: Calibration) -> Headline:
    """Headline of the errors from the arm as delivered to the last of the fits."""
    return error_headline(headline_of(calibrations))


def fit_facts(calibration: Calibration) -> list[tuple[str, object]]:
    """Facts on the fit: parameters, equations, convergence, and the residual noise."""
    fit = calibration.fit
    facts: list[tuple[str, object]] = [
        ("model", model_name(calibration)),
        ("residual", f"{calibration.residual}, {numbers.count(fit.rows, 'equation')}"),
        ("parameters", f"{len(fit.parameters)}, of which {fit.rank} can be known (rank)"),
        ("fit", f"{'converged' if fit.converged else 'not converged'} after {_iterations(calibration)}: {fit.reason}"),
    ]
    if calibration.holds_table:
        facts.append(("links", "as robot.toml has them, as far as these points tell: they are held there"))
    if np.isfinite(calibration.sigma_mm):
        times = f", {numbers.times(fit.reduced_chi)} the declared" if calibration.dataset.declares_noise else ""
        facts.append(("residual sigma", f"{numbers.length(calibration.sigma_mm)} per coordinate{times}"))
    covered = coverage_words(promise(calibration))
    if covered:
        facts.append((COVERAGE, covered))
    facts += instrument_facts(calibration)
    if calibration.face_labelling is not None:
        facts.append(("faces of the jig", face_labelling(calibration.face_labelling)))
    return facts


def instrument_facts(calibration: Calibration) -> list[tuple[str, object]]:
    """Facts on where the instrument is, and on what else is known of it."""
    noun = names.instrument(calibration.dataset)
    facts: list[tuple[str, object]] = [_mount_fact(mount, noun) for mount in mounts(calibration)]
    if not calibration.model.robot.carries_scanner:
        facts += [_place_fact(place, noun) for place in camera_places(calibration)]
    for part in contributions(CalibrationPart):
        facts += load(part.facts)(calibration)
    return facts


def camera_sections(calibration: Calibration) -> list[Section]:
    """Section on where a camera is and how its images are met; [] for other instruments and other residuals."""
    if calibration.residual != "pose" or calibration.dataset.usual_residual != "pose":
        return []
    figures = [figure for part in contributions(CalibrationPart) for figure in load(part.figures)(calibration)]
    return [Section("Camera", [Facts(instrument_facts(calibration)), *figures], brief=True)]


def _mount_fact(mount: Mount, noun: str) -> tuple[str, str]:
    """Fact on where an instrument sits on the flange, with sigmas."""
    sigmas, with_table = (np.sqrt(np.diag(c)) for c in (mount.covariance, mount.covariance_with_table))
    place = ", ".join(numbers.with_sigma(x, sigma) for x, sigma in zip(mount.xyz_mm, sigmas, strict=False))
    turns = ", ".join(numbers.signed(np.degrees(angle), ".3f") for angle in mount.rpy_rad)
    return (
        f"{noun} on the flange{mount.setup and f', setup {mount.setup}'}",
        f"{place} mm, roll, pitch, yaw {turns}° ± {np.degrees(sigmas[3:].max()):.2g}°; with the fitted table "
        f"± {numbers.length(with_table[:3].max())} and {np.degrees(with_table[3:].max()):.2g}°",
    )


def _place_fact(place: CameraPlace, noun: str) -> tuple[str, str]:
    """Fact on where an instrument that sees full poses stands in the room, with sigmas."""
    where = ", ".join(numbers.with_sigma(x, sigma) for x, sigma in zip(place.xyz_mm, place.sigma_mm, strict=True))
    turns = ", ".join(numbers.signed(np.degrees(angle), ".3f") for angle in place.rpy_rad)
    table = np.sqrt(np.diag(place.covariance_with_table))
    return (
        f"{noun} in the base's frame{place.setup and f', setup {place.setup}'}",
        f"{where} mm, roll, pitch, yaw {turns}° ± {np.degrees(place.turn_sigma_rad.max()):.2g}°; with the fitted table "
        f"± {numbers.length(table[:3].max())} and {np.degrees(table[3:].max()):.2g}°",
    )


def _place_document(place: CameraPlace) -> dict[str, Any]:
    table = np.sqrt(np.diag(place.covariance_with_table))
    return {
        "setup": place.setup,
        "parent": place.parent,
        "parent_T_camera": place.parent_T_camera,
        "sigma_mm": place.sigma_mm,
        "turn_sigma_deg": np.degrees(place.turn_sigma_rad),
        "covariance": place.covariance,
        "with_table": {"sigma_mm": table[:3], "turn_sigma_deg": np.degrees(table[3:])},
        "board_parent": place.board_parent,
        "board_parent_T_board": place.board_parent_T_board,
    }


def _mount_document(mount: Mount) -> dict[str, Any]:
    sigmas, with_table = (np.sqrt(np.diag(c)) for c in (mount.covariance, mount.covariance_with_table))
    return {
        "setup": mount.setup,
        "flange_T_scanner": mount.flange_T_scanner,
        "sigma_mm": sigmas[:3],
        "turn_sigma_deg": np.degrees(sigmas[3:]),
        "with_table": {"sigma_mm": with_table[:3], "turn_sigma_deg": np.degrees(with_table[3:])},
    }


def _iterations(calibration: Calibration) -> str:
    return numbers.count(len(calibration.fit.iterations) - 1, "iteration")


def fit_sentence(calibration: Calibration) -> str:
    """Sentence on convergence, size and rank of the fit, and on the residual over the declared sigma."""
    fit = calibration.fit
    state = "converged" if fit.converged else "not converged"
    declared = calibration.dataset.declares_noise
    residual = f", residual {numbers.times(fit.reduced_chi)} the points' sigma" if declared else ""
    return (
        f"{state} after {_iterations(calibration)} ({fit.reason}); {numbers.count(fit.rows, 'equation')}, "
        f"{numbers.count(len(fit.x), 'parameter')}, rank {fit.rank}{residual}"
    )


# ---- warnings -------------------------------------------------------------------------------------------------------


def calibration_warnings(calibration: Calibration) -> tuple[str, ...]:
    """Warnings on the data, the tool, the fit and single poses, to be read before a calibration is used."""
    sentences = [*calibration.fitted_dataset.warnings, *calibration.fitted_dataset.notes, *calibration.after.notes]
    if calibration.tool_shift is not None:
        sentences.append(tool_shift_sentence(calibration.tool_shift))
    sentences += table_doubts(calibration)
    points = calibration.fitted_dataset.points
    if calibration.residual != "pose" and points is not None and points.shared is not None:
        sentences.append(
            "the lens was found from the images, and a fit of anything but full poses takes its errors, which all of "
            "them share, for independent ones: sigmas come out too small; fit full poses (--residual pose)"
        )
    sentences.append(calibration.hand_eye_ambiguity)
    if not calibration.fit.converged:
        sentences.append(f"the fit did not converge: {calibration.fit.reason}")
    sentences.append(worsening_sentence(calibration))
    if calibration.outliers:
        out = f"{_outlying(calibration)}, and did not count in the fit; outliers are often physics, look at them"
        sentences.append(out)
    return tuple(filter(None, sentences))


def tool_shift_sentence(shift: ToolShift) -> str:
    """Sentence on a tool point that was found far from robot.toml's, without capital and full stop."""
    from_tip = ", ".join(numbers.signed(value, "z.1f") for value in shift.in_tip_mm)
    x, y, z = (numbers.signed(value, "z.1f") for value in shift.point_mm)
    return (
        f"the tool point is {shift.off_mm:.1f} mm from where robot.toml has it (in the last joint's frame: "
        f"x {x}, y {y}, z {z} mm; from the tip: {from_tip} mm); it is a point of its own, and the tip stays where "
        "robot.toml has it: the measured points tell neither its place nor its attitude"
    )


def table_doubts(calibration: Calibration) -> list[str]:
    """Sentences on what else the links took up, or on entries of robot.toml that are far off."""
    return taken_up_by_links(calibration) or list(map(table_doubt, doubtful_entries(calibration)))


def table_doubt(entry: DoubtfulEntry) -> str:
    """Sentence on an entry of robot.toml that is far from what was fitted, without capital and full stop."""
    off, usual = numbers.size(abs(entry.off), entry.unit), numbers.size(entry.usual, entry.unit)
    question = (
        "is the tool that long, or is a flange, a spacer or a change of tool missing from the table"
        if entry.of_tool
        else "is this the right table, or is it that of another size or series"
    )
    side = "less" if entry.off > 0.0 else "more"
    return (
        f"in robot.toml {entry.name} is {off} {side} than measured, {entry.times:.0f} times what links of arms usually "
        f"are off ({usual}): {question}?"
    )


def leading_entry_sentence(calibration: Calibration) -> str:
    """Sentence on the entry of robot.toml that alone explains most of the delivered error; "" where there is none."""
    entry = leading_entry(calibration)
    if entry is None:
        return ""
    named = [_entry_name(name) for name in (entry.parameter, *entry.rivals)]
    or_others = f" (or {' or '.join(named[1:])}: these poses do not tell which)" if entry.rivals else ""
    return (
        f"Most of the error as delivered is one entry of robot.toml: {named[0]} is off by "
        f"{numbers.size(abs(entry.off), entry.unit)}{or_others}. Corrected alone, it takes the training poses from "
        f"{numbers.length(entry.delivered_mm)} to {numbers.length(entry.corrected_mm)}."
    )


def _entry_name(name: str) -> str:
    kind, number = name.rstrip("0123456789"), name[len(name.rstrip("0123456789")) :]
    return f"the zero of joint {number} ({name})" if kind == "theta" and number else name


def worsening_sentence(calibration: Calibration) -> str:
    """Sentence on a fit that is worse than the arm as delivered, with the errors; "" for any other fit."""
    worse = calibration.worsening
    if worse is None:
        return ""
    return (
        f"the fit is worse than robot.toml on the {names.role(worse.role)} poses: RMSE from "
        f"{numbers.column_mm(worse.before_mm)} to {numbers.column_mm(worse.after_mm)} mm; do not put it on the robot, "
        "find out why first (too few or too similar poses for what is fitted, another residual, no prior)"
    )


def outlier_hint(plain: Calibration, robust: Calibration) -> str:
    """Sentence on the outlying poses of a plain fit and the error without them (`fit_without_outliers`)."""
    it = "it" if len(robust.outliers) == 1 else "them"
    error, without_mm, with_mm = "the sigma per coordinate is", robust.sigma_mm, plain.sigma_mm
    before, after = plain.after.test, robust.after.test
    if before is not None and after is not None:
        error, without_mm, with_mm = "the test poses are off by", after.rmse_mm, before.rmse_mm
    return (
        f"{_outlying(robust)}: {error} {numbers.length(without_mm)} without, {numbers.length(with_mm)} with {it} in "
        f"the fit. Look at {it}; --robust leaves {it} out, --leave-out any pose"
    )


def _outlying(robust: Calibration) -> str:
    """Clause that names the poses left out by a robust fit, with their errors."""
    errors_mm = robust.outlier_errors_mm
    named = [f"{name} ({numbers.length(off_mm)} off)" for name, off_mm in errors_mm.items()]
    poses = "1 pose stands" if len(named) == 1 else f"{len(named)} poses stand"
    return f"{poses} out of all others, {numbers.in_short(named, _MOST_OUTLIERS)}"


# ---- errors ---------------------------------------------------------------------------------------------------------


def error_tables(calibration: Calibration, colours: Mapping[str, str] | None = None) -> list[Block]:
    """Tables of all errors before and after, including those of the jig's orientation where full poses were fitted.

    colours: of training and test poses in figures, by role.
    """
    attitudes = _attitude_rows(calibration, colours)
    distances = "Distances are to the reference pose."
    return [
        error_table(calibration.before, calibration.after, colours),
        Paragraph(distances, soft=True),
        *([Table(("attitude of the jig, mrad", *_CHANGES), attitudes)] if attitudes else []),
    ]


def error_table(
    before: Evaluation | RoleErrors,
    after: Evaluation | RoleErrors,
    colours: Mapping[str, str] | None = None,
    test: str = "test",
) -> Table:
    """Table of 3D and distance errors before and after, of training and test poses (or as `test` names them)."""
    rows = [
        (
            _of_role(test if role == "test" else role, name, colours),
            *map(numbers.column_mm, (was, now)),
            numbers.reduction(was, now),
        )
        for role, first, last in (("train", before.train, after.train), ("test", before.test, after.test))
        if first is not None and last is not None
        for key, name in FIGURES
        for was, now in [(float(getattr(first, key)), float(getattr(last, key)))]
    ]
    return Table(("errors, mm", *_CHANGES), rows)


def _attitude_rows(calibration: Calibration, colours: Mapping[str, str] | None) -> list[tuple[Words, ...]]:
    if calibration.orientation_errors is None:
        return []
    before, after = calibration.orientation_errors
    return [
        (_of_role(role, name, colours), f"{1e3 * was:.4f}", f"{1e3 * now:.4f}", numbers.reduction(was, now))
        for role, first, last in (("train", before.train, after.train), ("test", before.test, after.test))
        if first is not None and last is not None
        for name, was, now in (("RMSE", first.rmse_rad, last.rmse_rad), ("max", first.max_rad, last.max_rad))
    ]


def _of_role(role: str, figure: str, colours: Mapping[str, str] | None) -> str | Coloured:
    words = f"{names.role(role)} {figure}"
    return words if colours is None else Coloured(words, colours[role])


def pose_errors(calibration: Calibration) -> FigurePlace:
    """Placeholder of the figure of each pose's error."""
    caption = "3D error of each pose after the fit, with everything in the model: predicted minus measured, length."
    return FigurePlace("error_bars", (calibration,), caption, height_px=280)


def history_caption(calibration: Calibration) -> str:
    """Caption of the figure of the errors after each change of a model, of which `calibration` is the last fit."""
    level, has_tests = noise_level(calibration), calibration.after.test is not None
    roles = "training and test poses" if has_tests else "the fitted poses"
    noise = ""
    if level.floor_mm is not None:
        noise = f"; {'grey band: where 95 % of such test errors lie by' if has_tests else 'dashed:'} {level.name}"
    points = "; points: single test poses" if has_tests else ""
    return f"3D RMSE of {roles} after each change of the model{noise}{points}."


def step_table(steps: Sequence[tuple[str, float, float, float]]) -> Table:
    """Table of 3D RMSE after each change of the model: its label, training and test RMSE and residual sigma, mm."""
    rows = [(label, *map(numbers.column_mm, figures)) for label, *figures in steps]
    columns = ("model", "training, mm", "test, mm", "residual sigma, mm")
    return Table(columns, rows, caption="3D RMSE after each change of the model; the sigma is per coordinate")


def fit_steps(steps: Sequence[FitStep]) -> list[tuple[str, float, float, float]]:
    """Rows of `step_table` for a sequence of fits."""
    nan = math.nan
    return [
        (
            step.label,
            step.calibration.after.train.rmse_mm if step.calibration.after.train else nan,
            step.calibration.after.test.rmse_mm if step.calibration.after.test else nan,
            step.calibration.sigma_mm,
        )
        for step in steps
    ]


class ModelErrors(Protocol):
    """Errors of one model in a sequence of models fitted one after the other."""

    @property
    def label(self) -> str:
        """Label of the change that made the model: "link errors", "+ backlash", "− backlash"."""

    @property
    def train_rmse_mm(self) -> float:
        """3D RMSE of the training poses."""

    @property
    def test_rmse_mm(self) -> float:
        """3D RMSE of the test poses; nan without any."""

    @property
    def other_poses(self) -> bool:
        """Whether the errors are of other poses than the previous model's, so that the two cannot be compared."""


def last_change(models: Sequence[ModelErrors]) -> Verdict | None:
    """Verdict whether the last change of the model lowered the errors; None without a change or an error."""
    if len(models) < 2:
        return None
    old, new = models[-2:]
    tested = math.isfinite(old.test_rmse_mm) and math.isfinite(new.test_rmse_mm)
    before, after = (old.test_rmse_mm, new.test_rmse_mm) if tested else (old.train_rmse_mm, new.train_rmse_mm)
    if not (before > 0 and math.isfinite(after)):
        return None
    of = "test error" if tested else "training error (there are no test poses)"
    figures = f"{numbers.column_mm(before)} → {numbers.column_mm(after)} mm"
    share = after / before - 1
    if new.other_poses:
        return Verdict(f"{new.label}: the {of} is {figures}, of the poses that count now.", NEUTRAL)
    adds = not new.label.startswith("−")
    if abs(share) < _SMALL_CHANGE:
        more = "It does not help; Undo takes it out again." if adds else "It was not needed."
        return Verdict(f"{new.label}: the {of} hardly changed, {figures}. {more}", NEUTRAL)
    if share < 0:
        return Verdict(f"{new.label}: the {of} fell by {numbers.share(-share)}, {figures}.", GOOD)
    more = "It does not help; Undo takes it out again." if adds else "It was needed; Undo brings it back."
    return Verdict(f"{new.label}: the {of} rose by {numbers.share(share)}, {figures}. {more}", BAD)


def state_of_model(models: Sequence[ModelErrors], effects: Sequence[SelectedEffect], calibration: Calibration) -> Facts:
    """Facts on a model: its effects, its errors, and the noise."""
    last, level = models[-1], noise_level(calibration)
    test = last.test_rmse_mm
    floor = "not declared"
    if level.floor_mm is not None:
        floor = f"{numbers.column_mm(level.floor_mm)} mm{'' if level.is_declared else ', not declared'}"
    added = [part for one in effects for part in (" + ", with_joints(one))]
    return Facts(
        [
            ("model", spans("link errors", *added)),
            ("training 3D RMSE", f"{numbers.column_mm(last.train_rmse_mm)} mm"),
            ("test 3D RMSE", f"{numbers.column_mm(test)} mm" if math.isfinite(test) else "no test poses"),
            (f"{level.name}, 3D", floor),
        ]
    )


def errors_by_version(versions: Sequence[Version], colours: Mapping[str, str]) -> Table:
    """Table of RMSE and largest 3D error of each version of a model, mm, and of noise alone."""
    rows = [
        (Coloured(version.name, colours[version.name]), *_largest(version.evaluation.train, version.evaluation.test))
        for version in versions
    ]
    level = noise_level(versions[-1].calibration)
    noise = "not declared" if level.floor_mm is None else numbers.column_mm(level.floor_mm)
    of_test = noise if level.floor_mm is not None and versions[-1].evaluation.test is not None else numbers.MISSING
    noise_row = (level.name, noise, numbers.MISSING, of_test, numbers.MISSING)
    return Table(("model", "training", "max", "test", "max"), [*rows, noise_row])


def _largest(*figures: Figures | None) -> tuple[str, ...]:
    cells = ((None, None) if f is None else (f.rmse_mm, f.max_mm) for f in figures)
    return tuple(numbers.column_mm(mm) for pair in cells for mm in pair)


def pose_error_by_version(versions: Sequence[Version], pose: int, colours: Mapping[str, str]) -> Table:
    """Table of predicted minus measured at one pose by each version of a model, mm, where it has an error there."""
    errors = [(version.name, version.pose_error_vectors_mm()[pose]) for version in versions]
    rows = [
        (
            Coloured(name, colours[name]),
            *(numbers.signed(float(e), "+.4f") for e in error),
            numbers.column_mm(float(np.linalg.norm(error))),
        )
        for name, error in errors
        if np.isfinite(error).all()
    ]
    return Table(("model", "x", "y", "z", "length"), rows)


def evaluation_sentence(evaluation: Evaluation) -> str:
    """Phrase with the RMSE of test and training poses: "test RMSE 0.20 mm (training 0.19 mm)"."""
    train, test = evaluation.train, evaluation.test
    if test is None:
        return f"training RMSE {numbers.length(train.rmse_mm)}, no test poses" if train else "no poses"
    training = f" (training {numbers.length(train.rmse_mm)})" if train else ""
    return f"test RMSE {numbers.length(test.rmse_mm)}{training}"


def table_alone(table: ExportedTable) -> list[Block]:
    """Paragraph with the errors of robot.toml's table alone and of the full model; [] for a model without effects."""
    if not table.left_out:
        return []
    effects = numbers.listing(table.left_out)
    return [
        Paragraph(
            f"What robot.toml can hold, the table alone, fitted without {effects}: "
            f"{evaluation_sentence(table.errors)}; the model with {effects}: {evaluation_sentence(table.full.after)}."
        )
    ]


def sigma_sentence(check: SigmaCheck) -> str:
    """Sentence with the residual sigma, its 95 % interval and the declared sigma, and what the comparison means."""
    if not math.isfinite(check.sigma_mm):
        return "Residual sigma: no degree of freedom is left to tell it."
    low, high = numbers.length(check.low_mm), numbers.length(check.high_mm)
    found = (
        f"Residual sigma {numbers.length(check.sigma_mm)} per coordinate (95 %: {low} to {high}, "
        f"{check.degrees_of_freedom:.0f} degrees of freedom)"
    )
    if check.declared_mm is None:
        return f"{found}; no sigma is declared, so this holds noise and missing physics together."
    meaning = {
        "excess": "more than noise is left: physics is missing from the model, or sigma was declared too small",
        "as declared": "nothing but noise is left",
        "below": "less than declared: sigma was declared too large",
    }[check.verdict]
    times = numbers.times(check.sigma_mm / check.declared_mm)
    return f"{found}, {times} the declared {numbers.length(check.declared_mm)}: {meaning}."


# ---- parameters -----------------------------------------------------------------------------------------------------


def parameters(calibration: Calibration, table: ExportedTable | None = None) -> list[Block]:
    """Blocks with every parameter and its sigma, learned curves, identifiable sums, and the tool row."""
    sums = identifiable_combinations(calibration)
    tool = tool_rows(calibration.dataset, residual=calibration.residual, model=calibration.model)
    return [
        *parameter_tables(calibration),
        *([] if table is None else table_alone(table)),
        *([Paragraph("Sums that are known better than their parts:")] if sums else []),
        *([Bullets([_sum(known) for known in sums])] if sums else []),
        *([] if calibration.dataset.robot.is_cartesian else [Paragraph(tool_sentence(tool))]),
    ]


def parameter_tables(calibration: Calibration, height: str = "") -> list[Block]:
    """Tables of the arm's parameters, of each effect's parameters, and of the learned curves."""
    return [*_tables(calibration, height), Paragraph(_WHY_NOT_DETERMINED, soft=True)]


def _tables(calibration: Calibration, height: str) -> Iterator[Block]:
    rows: dict[str, list[tuple[str, ...]]] = {}
    undetermined: Counter[str] = Counter()  # of each effect, whose rows would say nothing
    selects: dict[str, list[Reference | None]] = {}
    joints = names.joints_by_parameter(calibration.model.robot, calibration.model.added_effects)
    for row in calibration.parameter_rows():
        full_name = str(row["name"])
        effect, dot, short = full_name.partition(".")
        key = effect if dot else ""
        if key == LEARNED:
            continue  # a mode's size says nothing by itself: the curves have a table of their own
        if not dot and calibration.dataset.robot.is_cartesian:
            continue  # rows of no arm
        if key and not row["known"]:
            undetermined[key] += 1
            rows.setdefault(key, [])
            continue
        rows.setdefault(key, []).append(_row(row, short if dot else full_name, of_arm=not dot))
        joint = joints.get(full_name)
        selects.setdefault(key, []).append(None if joint is None else Reference("joint", joint, full_name))
    columns = ("name", "nominal", "fitted", "change", "sigma", "unit")
    for key, of_key in rows.items():
        more = undetermined[key]
        if not of_key:
            yield Paragraph(f"{key}: none of its {numbers.count(more, 'parameter')} is determined by itself.")
            continue
        caption = f"{key}; not determined: {numbers.count(more, 'further parameter')}" if more else key
        yield Table(columns, of_key, caption=caption, left=(0, 5), rows_select=selects[key], height=height)
    if members_of_one_input(calibration):
        yield replace(curve_table(calibration), caption="learned curves of the joints")
        yield from map(Paragraph, formulas(calibration))


def _row(row: Mapping[str, Any], name: str, *, of_arm: bool) -> tuple[str, ...]:
    """Table row of a parameter: the arm's angles in degrees with four decimals; an effect's values in three digits.

    A value that the data do not determine is not shown.
    """
    unit = numbers.readable(0.0, row["unit"])[1] if of_arm else str(row["unit"])
    scale = math.degrees(1.0) if of_arm and row["unit"] == "rad" else 1.0
    nominal, value, change, sigma = (scale * float(row[key]) for key in ("nominal", "value", "change", "sigma"))
    digits = "z.4f" if of_arm else "z.3g"
    if not row["known"]:
        return (
            numbers.parameter_label(name),
            numbers.signed(nominal, digits),
            _NOT_DETERMINED,
            numbers.MISSING,
            numbers.MISSING,
            unit,
        )
    if abs(change) < _UNCHANGED * sigma:
        value, change = nominal, 0.0
    return (
        numbers.parameter_label(name),
        numbers.signed(nominal, digits),
        numbers.signed(value, digits),
        numbers.signed(change, f"+{digits}"),
        f"{sigma:.2g}",
        unit,
    )


def _sum(known: Combination) -> Words:
    """Text of an identifiable sum of parameters of one unit, for a table row; angles in degrees."""
    terms: list[Any] = []
    for name, coefficient in known.coefficients.items():
        sign = numbers.MINUS if coefficient < 0 else "+"
        terms.append(f" {sign} " if terms else (sign if coefficient < 0 else ""))
        if abs(abs(coefficient) - 1.0) >= 1e-9:
            terms.append(f"{abs(coefficient):.6g} ")
        terms.append(names.parameter(name))
    return (*terms, f" = {numbers.with_sigma(known.value, known.sigma, known.unit)}")


# ---- documents ------------------------------------------------------------------------------------------------------


@document.register
def calibration_document(calibration: Calibration) -> dict[str, Any]:
    """Document that `calibrate --json` prints."""
    fit, attitudes, labelling = calibration.fit, calibration.orientation_errors, calibration.face_labelling
    return {
        "dataset": calibration.dataset.name,
        "residual": calibration.residual,
        "effects": calibration.model.family_names,
        "iterations": [
            {
                "rmse_mm": step.train_rmse_mm,
                "test_rmse_mm": step.test_rmse_mm,
                "distance_rmse_mm": step.train_distance_rmse_mm,
                "test_distance_rmse_mm": step.test_distance_rmse_mm,
            }
            for step in calibration.iteration_errors
        ],
        "converged": fit.converged,
        "worse_than_nominal": worsening_sentence(calibration) or None,
        "reason": fit.reason,
        "rank": fit.rank,
        "links_held": calibration.holds_table,
        **document(calibration.after),
        "before": calibration.before,
        **found_tool_document(calibration),
        "mounts": [_mount_document(mount) for mount in mounts(calibration)],
        "hand_eye": [_place_document(place) for place in camera_places(calibration)],
        **_document_of_plugins(calibration),
        "attitudes": attitudes and dict(zip(("before", "after"), attitudes, strict=True)),
        "faces_named": None if labelling is None else face_labelling(labelling),
        "sigma_mm": calibration.sigma_mm,
        "degrees_of_freedom": fit.degrees_of_freedom,
        "parameters": calibration.parameter_rows(),
        "known_sums": [
            {"parameters": c.coefficients, "value": c.value, "sigma": c.sigma, "worst_part_sigma": c.worst_part_sigma}
            for c in identifiable_combinations(calibration)
        ],
        "table_doubts": doubtful_entries(calibration),
        "leading_entry": leading_entry(calibration),
        "tool": tool_rows(calibration.dataset, residual=calibration.residual, model=calibration.model),
        "correlated": correlated_pairs(calibration),
        "stands": stands_document(calibration),
        "outliers": calibration.outliers,
        "left_out": calibration.fitted_dataset.left_out,
        "warnings": calibration_warnings(calibration),
        **promise_document(promise(calibration), calibration.dataset.poses),
    }


def _document_of_plugins(calibration: Calibration) -> dict[str, Any]:
    documents: list[dict[str, Any]] = [load(part.document)(calibration) for part in contributions(CalibrationPart)]
    return {key: value for document in documents for key, value in document.items()}


def found_tool_document(calibration: Calibration) -> dict[str, Any]:
    """JSON keys on a tool point found far from robot.toml's, mm in the frames of last joint and tip; else None."""
    shift = calibration.tool_shift
    return {
        "tool_found_mm": None if shift is None else shift.point_mm,
        "tool_found_in_tip_mm": None if shift is None else shift.in_tip_mm,
    }


def stands_document(calibration: Calibration) -> dict[str, int] | None:
    """Number of repeat groups ("stands") and of measured points ("shots"); None where no pose was measured twice."""
    count = calibration.repeat_count
    return None if count is None else {"stands": count.groups, "shots": count.repeats}


def steps_document(steps: Sequence[FitStep]) -> list[dict[str, Any]]:
    """JSON keys of each fit step: the link errors, then one step per added effect with its prior sizes."""
    return [
        {
            "effect": step.effect,
            "sizes": step.selected[-1].prior_sigmas if step.selected else {},
            "sigma_mm": step.calibration.sigma_mm,
            **document(step.calibration.after),
        }
        for step in steps
    ]


def table_document(table: ExportedTable) -> dict[str, Any]:
    """JSON keys on the exported table alone: its errors, and the model's effects that the table cannot hold."""
    return {**document(table.errors), "without_effects": table.left_out}


_PLACES = 9  # of a parameter's value, beyond which there is rounding alone


@document.register
def _evaluation_document(evaluation: Evaluation) -> dict[str, Any]:
    return {"train": evaluation.train, "test": evaluation.test}


@document.register
def _data_problem_document(problem: DataProblem) -> dict[str, Any]:
    return {
        "kind": problem.kind,
        "joints": problem.joints,
        "mend": problem.remedy,
        "rmse_mm": {"now": problem.now_mm, "then": problem.then_mm},
        "words": problem.warning,
    }
