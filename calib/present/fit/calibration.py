"""Presentation of a calibration: errors before and after, convergence, all parameters, and the identifiable sums."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any, Protocol

import numpy as np

from calib.array_types import Array
from calib.calibration.calibrate import HEAVY_FROM_MM
from calib.calibration.evaluation import Evaluation
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
from calib.effects.gravity import has_masses, tells_tool_mass
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
from calib.present.results import document, keys_of, presentation
from calib.rendering import numbers
from calib.rendering.blocks import (
    Block,
    Bullets,
    Coloured,
    Facts,
    FigurePlace,
    Paragraph,
    Presentation,
    Reference,
    Section,
    Table,
    Verdict,
    Words,
    joined,
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
    drawn = [(part.title, load(part.figures)(calibration)) for part in contributions(CalibrationPart)]
    return Presentation(
        f"Calibration of {calibration.dataset.name}",
        [*calibration_head(calibration), pose_errors(calibration)],
        [
            Section("Parameters", parameters(calibration)),
            redundancy_section(redundancy_of(calibration.dataset, residual=calibration.residual)),
            Section("Convergence", [falls]),
            *(Section(title, figures) for title, figures in drawn),
        ],
    )


def calibration_head(calibration: Calibration, way: Sequence[Calibration] = ()) -> list[Block]:
    """Blocks at the head of a calibration: errors at each stage, all errors, convergence, and warnings."""
    worse = worsening_sentence(calibration)
    return [
        error_headline(headline_of(way or (calibration,))),
        Verdict(numbers.capitalised(worse), BAD),
        *error_tables(calibration),
        Facts(fit_facts(calibration)),
        Bullets([remark for remark in calibration_warnings(calibration) if remark != worse]),
    ]


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
    if covered := coverage_words(promise(calibration)):
        facts.append((COVERAGE, covered))
    facts += instrument_facts(calibration)
    if calibration.face_labelling is not None:
        facts.append(("faces of the jig", face_labelling(calibration.face_labelling)))
    return facts


def instrument_facts(calibration: Calibration) -> list[tuple[str, object]]:
    """Facts on where the instrument is, and on what else is known of it."""
    noun = names.instrument(calibration.dataset)
    if calibration.model.robot.carries_scanner:
        facts = [place_fact(mount, f"{noun} on the flange") for mount in mounts(calibration)]
    else:
        facts = [place_fact(place, f"{noun} in the base's frame") for place in camera_places(calibration)]
    for part in contributions(CalibrationPart):
        facts += load(part.facts)(calibration)
    return facts


def camera_sections(calibration: Calibration) -> list[Section]:
    """Section on where a camera is and how its images are met; [] for other instruments and other residuals."""
    if calibration.residual != "pose" or calibration.dataset.usual_residual != "pose":
        return []
    figures = [figure for part in contributions(CalibrationPart) for figure in load(part.figures)(calibration)]
    return [Section("Camera", [Facts(instrument_facts(calibration)), *figures], brief=True)]


def place_fact(place: Mount | CameraPlace, where: str) -> tuple[str, object]:
    """Fact on where an instrument is, with sigmas."""
    sigmas, with_table = (np.sqrt(np.diag(c)) for c in (place.covariance, place.covariance_with_table))
    xyz = ", ".join(map(numbers.with_sigma, place.xyz_mm, sigmas))
    turns = ", ".join(numbers.signed(np.degrees(angle), ".3f") for angle in place.rpy_rad)
    return (
        f"{where}{place.setup and f', setup {place.setup}'}",
        f"{xyz} mm, roll, pitch, yaw {turns}° ± {np.degrees(sigmas[3:].max()):.2g}°; with the fitted table "
        f"± {numbers.length(with_table[:3].max())} and {np.degrees(with_table[3:].max()):.2g}°",
    )


@document.register(Mount)
@document.register(CameraPlace)
def _place_document(place: Mount | CameraPlace) -> dict[str, Any]:
    of_place: tuple[str, ...] = ("setup", "flange_T_scanner")
    if isinstance(place, CameraPlace):
        of_place = ("setup", "parent", "parent_T_camera", "board_parent", "board_parent_T_board", "covariance")
    with_table = _sigma_document(place.covariance_with_table)
    return {**keys_of(place, *of_place), **_sigma_document(place.covariance), "with_table": with_table}


def _sigma_document(covariance: Array) -> dict[str, Any]:
    sigmas = np.sqrt(np.diag(covariance))
    return {"sigma_mm": sigmas[:3], "turn_sigma_deg": np.degrees(sigmas[3:])}


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


def _open_directions(shifts: Array) -> str:
    """Sentence on the directions (K, 3) along which the poses leave scanner and targets undetermined; "" for none."""
    if len(shifts) == 0:
        return ""
    if len(shifts) >= 3:
        return (
            "the flange hardly turns, so the targets' positions in the world and the scanner's on the flange are "
            "known only together; poses that turn the flange about two axes tell them apart"
        )
    if len(shifts) == 1:
        along = shifts[0] * np.sign(shifts[0][np.argmax(np.abs(shifts[0]))])
        x, y, z = np.round(along, 2) + 0.0  # no -0.00
        return (
            f"the flange turns about little but one direction ({x:.2f}, {y:.2f}, {z:.2f} in the base frame), so "
            "the positions of targets and scanner along it are known only together; tilt the flange to part them"
        )
    return (
        "the poses leave two directions open, along which the positions of targets and scanner are known only "
        "together; turn the flange about two axes to tell them apart"
    )


def calibration_warnings(calibration: Calibration) -> tuple[str, ...]:
    """Warnings on the data, the tool, the fit and single poses, to be read before a calibration is used."""
    fitted = calibration.fitted_dataset
    sentences = [*fitted.warnings, *fitted.notes, *calibration.after.notes]
    if calibration.tool_shift is not None:
        sentences.append(tool_shift_sentence(calibration.tool_shift))
        sentences += tool_mass_question(calibration)
    sentences += table_doubts(calibration)
    points = fitted.points
    if calibration.residual != "pose" and points is not None and points.shared is not None:
        sentences.append(
            "the lens was found from the images, and a fit of anything but full poses takes its errors, which all of "
            "them share, for independent ones: sigmas come out too small; fit full poses (--residual pose)"
        )
    sentences.append(_open_directions(calibration.undetermined_shifts))
    if not calibration.fit.converged:
        sentences.append(f"the fit did not converge: {calibration.fit.reason}")
    sentences.append(worsening_sentence(calibration))
    if calibration.outliers:
        sentences.append(
            f"{_outlying(calibration)}, and did not count in the fit; outliers are often physics, look at them"
        )
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


def tool_mass_question(calibration: Calibration) -> list[str]:
    """Sentence that asks for the mass of a tool that robot.toml has elsewhere; [] where it is told or of no use."""
    robot = calibration.dataset.robot
    told = tells_tool_mass(robot, calibration.dataset.poses.payload_kg)
    shift = calibration.tool_shift
    if shift is None or shift.off_mm < HEAVY_FROM_MM or told or not has_masses(robot):
        return []
    return [
        "what reaches so far weighs something, and no file tells how much: give its mass, mass_kg under [tool] of "
        "robot.toml or payload_kg in poses.csv; until then a compliance is at most what was fitted"
    ]


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
        f"{numbers.column_mm(worse.before_mm)} to {numbers.column_mm(worse.after_mm)} mm; do not use it, "
        "find out why first (too few or too similar poses for what is fitted, another residual, no prior)"
    )


def outlier_hint(plain: Calibration, robust: Calibration) -> str:
    """Sentence on the outlying poses of a plain fit and the error without them (`fit_without_outliers`)."""
    it = "it" if len(robust.outliers) == 1 else "them"
    error, without_mm, with_mm = "the sigma per coordinate is", robust.sigma_mm, plain.sigma_mm
    if plain.after.test and robust.after.test:
        error, without_mm, with_mm = "the test poses are off by", robust.after.test_rmse_mm, plain.after.test_rmse_mm
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
    attitudes: list[tuple[Words, ...]] = []
    if calibration.orientation_errors is not None:
        before, after = calibration.orientation_errors
        attitudes = [
            (_of_role(role, name, colours), f"{was:.4f}", f"{now:.4f}", numbers.reduction(was, now))
            for role, first, last in _by_role(before, after)
            for key, name in (("rmse_rad", "RMSE"), ("max_rad", "max"))
            for was, now in [(1e3 * getattr(first, key), 1e3 * getattr(last, key))]
        ]
    return [
        error_table(calibration.before, calibration.after, colours),
        Paragraph("Distances are to the reference pose.", soft=True),
        Table(("attitude of the jig, mrad", *_CHANGES), attitudes),
    ]


def _by_role(before: Any, after: Any) -> Iterator[tuple[str, Any, Any]]:
    """Errors before and after, of training and of test poses, where both are known."""
    for role in ("train", "test"):
        first, last = getattr(before, role), getattr(after, role)
        if first is not None and last is not None:
            yield role, first, last


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
        for role, first, last in _by_role(before, after)
        for key, name in FIGURES
        for was, now in [(float(getattr(first, key)), float(getattr(last, key)))]
    ]
    return Table(("errors, mm", *_CHANGES), rows)


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
    fits = [(step.label, step.calibration) for step in steps]
    return [(label, fit.after.train_rmse_mm, fit.after.test_rmse_mm, fit.sigma_mm) for label, fit in fits]


class RoleRmse(Protocol):
    """3D RMSE of one model, mm, at training poses and at test poses."""

    @property
    def train_rmse_mm(self) -> float:
        """3D RMSE of the training poses; nan without any."""

    @property
    def test_rmse_mm(self) -> float:
        """3D RMSE of the test poses; nan without any."""


def change_of_error(before: RoleRmse, after: RoleRmse) -> tuple[str, float, float]:
    """Role of the poses that tell how an error changes ("test" where there are such poses), and their errors, mm."""
    if math.isfinite(before.test_rmse_mm) and math.isfinite(after.test_rmse_mm):
        return "test", before.test_rmse_mm, after.test_rmse_mm
    return "training", before.train_rmse_mm, after.train_rmse_mm


class ModelErrors(RoleRmse, Protocol):
    """Errors of one model in a sequence of models fitted one after the other."""

    @property
    def label(self) -> str:
        """Label of the change that made the model: "link errors", "+ backlash", "− backlash"."""

    @property
    def other_poses(self) -> bool:
        """Whether the errors are of other poses than the previous model's, so that the two cannot be compared."""


def last_change(models: Sequence[ModelErrors]) -> Verdict | None:
    """Verdict whether the last change of the model lowered the errors; None without a change or an error."""
    if len(models) < 2:
        return None
    old, new = models[-2:]
    role, before, after = change_of_error(old, new)
    if not (before > 0 and math.isfinite(after)):
        return None
    of = "test error" if role == "test" else "training error (there are no test poses)"
    figures = f"{numbers.column_mm(before)} → {numbers.column_mm(after)} mm"
    share = after / before - 1
    if new.other_poses:
        return Verdict(f"{new.label}: the {of} is {figures}, of the poses that count now.", NEUTRAL)
    helps_not, is_small = "It does not help; Undo takes it out again.", abs(share) < _SMALL_CHANGE
    if new.label.startswith("−"):
        helps_not = "It was not needed." if is_small else "It was needed; Undo brings it back."
    if is_small:
        return Verdict(f"{new.label}: the {of} hardly changed, {figures}. {helps_not}", NEUTRAL)
    if share < 0:
        return Verdict(f"{new.label}: the {of} fell by {numbers.share(-share)}, {figures}.", GOOD)
    return Verdict(f"{new.label}: the {of} rose by {numbers.share(share)}, {figures}. {helps_not}", BAD)


def state_of_model(models: Sequence[ModelErrors], effects: Sequence[SelectedEffect], calibration: Calibration) -> Facts:
    """Facts on a model: its effects, its errors, and the noise."""
    last, level = models[-1], noise_level(calibration)
    train, test = (f"{numbers.column_mm(mm)} mm" for mm in (last.train_rmse_mm, last.test_rmse_mm))
    floor = "not declared"
    if level.floor_mm is not None:
        floor = f"{numbers.column_mm(level.floor_mm)} mm{'' if level.is_declared else ', not declared'}"
    return Facts(
        [
            ("model", joined(["link errors", *map(with_joints, effects)], " + ")),
            ("training 3D RMSE", train),
            ("test 3D RMSE", test if math.isfinite(last.test_rmse_mm) else "no test poses"),
            (f"{level.name}, 3D", floor),
        ]
    )


def errors_by_version(versions: Sequence[Version], colours: Mapping[str, str]) -> Table:
    """Table of RMSE and largest 3D error of each version of a model, mm, and of noise alone."""
    rows: list[tuple[Words, ...]] = []
    for version in versions:
        of_roles = (version.evaluation.train, version.evaluation.test)
        cells = [numbers.column_mm(getattr(f, key, None)) for f in of_roles for key in ("rmse_mm", "max_mm")]
        rows.append((Coloured(version.name, colours[version.name]), *cells))
    level = noise_level(versions[-1].calibration)
    noise = "not declared" if level.floor_mm is None else numbers.column_mm(level.floor_mm)
    of_test = noise if level.floor_mm is not None and versions[-1].evaluation.test is not None else numbers.MISSING
    rows.append((level.name, noise, numbers.MISSING, of_test, numbers.MISSING))
    return Table(("model", "training", "max", "test", "max"), rows)


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
    train, test = numbers.length(evaluation.train_rmse_mm), numbers.length(evaluation.test_rmse_mm)
    if evaluation.test is None:
        return f"training RMSE {train}, no test poses" if evaluation.train else "no poses"
    return f"test RMSE {test}{f' (training {train})' if evaluation.train else ''}"


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
        Paragraph("Sums that are known better than their parts:" if sums else ""),
        Bullets(list(map(_sum, sums))),
        Paragraph("" if calibration.dataset.robot.is_cartesian else tool_sentence(tool)),
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
    if abs(change) < _UNCHANGED * sigma:
        value, change = nominal, 0.0
    fitted = (numbers.signed(value, digits), numbers.signed(change, f"+{digits}"), f"{sigma:.2g}")
    if not row["known"]:
        fitted = (_NOT_DETERMINED, numbers.MISSING, numbers.MISSING)
    return (numbers.parameter_label(name), numbers.signed(nominal, digits), *fitted, unit)


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
        "effects": calibration.model.family_names,
        "iterations": calibration.iteration_errors,
        "worse_than_nominal": worsening_sentence(calibration) or None,
        "links_held": calibration.holds_table,
        **keys_of(fit, "converged", "reason", "rank", "degrees_of_freedom"),
        **keys_of(calibration, "residual", "before", "sigma_mm", "outliers"),
        **document(calibration.after),
        **found_tool_document(calibration),
        "mounts": mounts(calibration),
        "hand_eye": camera_places(calibration),
        **_document_of_plugins(calibration),
        "attitudes": attitudes and dict(zip(("before", "after"), attitudes, strict=True)),
        "faces_named": None if labelling is None else face_labelling(labelling),
        "parameters": calibration.parameter_rows(),
        "known_sums": [
            {"parameters": one.coefficients, **keys_of(one, "value", "sigma", "worst_part_sigma")}
            for one in identifiable_combinations(calibration)
        ],
        "table_doubts": doubtful_entries(calibration),
        "leading_entry": leading_entry(calibration),
        "tool": tool_rows(calibration.dataset, residual=calibration.residual, model=calibration.model),
        "correlated": correlated_pairs(calibration),
        "stands": stands_document(calibration),
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
    found = (None, None) if shift is None else (shift.point_mm, shift.in_tip_mm)
    return dict(zip(("tool_found_mm", "tool_found_in_tip_mm"), found, strict=True))


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


@document.register
def _evaluation_document(evaluation: Evaluation) -> dict[str, Any]:
    return keys_of(evaluation, "train", "test")


@document.register
def _data_problem_document(problem: DataProblem) -> dict[str, Any]:
    return {
        **keys_of(problem, "kind", "joints"),
        "mend": problem.remedy,
        "rmse_mm": {"now": problem.now_mm, "then": problem.then_mm},
        "words": problem.warning,
    }
