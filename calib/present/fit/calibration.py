"""Presentation of a calibration: errors before and after, convergence, all parameters, and the identifiable sums."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from calib.array_types import Array
from calib.calibration.calibrate import HEAVY_FROM_MM
from calib.calibration.evaluation import Evaluation
from calib.calibration.model_versions import model_name
from calib.calibration.mount import CameraPlace, Mount, camera_places, mounts
from calib.calibration.promise import promise
from calib.calibration.result import Calibration
from calib.calibration.table_doubts import DoubtfulEntry, doubtful_entries, taken_up_by_links
from calib.calibration.uncertainty import Combination, correlated_pairs, identifiable_combinations
from calib.consistency.data_problem import DataProblem
from calib.consistency.flange_fit import FlangeFit
from calib.consistency.leading_entry import leading_entry
from calib.diagnosis.effect_selection import FitStep
from calib.diagnosis.headline import headline_of
from calib.effects.gravity import has_masses, tells_tool_mass
from calib.fitting.tool_point import ToolShift
from calib.frames import rpy_from_rotation
from calib.identifiability.structural import redundancy_of
from calib.identifiability.tool_rows import tool_rows
from calib.models.exported_table import ExportedTable
from calib.plugins import CalibrationPart, contributions, load
from calib.present import names
from calib.present.fit.corners import face_labelling
from calib.present.fit.errors import (
    COVERAGE,
    ErrorChange,
    coverage_words,
    error_headline,
    error_tables,
    pose_errors,
    promise_document,
    table_alone,
)
from calib.present.fit.learned import curve_table, formulas
from calib.present.fit.redundancy import redundancy_section, tool_sentence
from calib.present.results import document, keys_of, presentation
from calib.rendering import numbers
from calib.rendering.blocks import (
    Block,
    Bullets,
    Facts,
    Paragraph,
    Presentation,
    Reference,
    Section,
    Table,
    Verdict,
    Words,
)
from calib.rendering.colours import BAD
from calib.screening.curves.fitted_curves import members_of_one_input
from calib.screening.curves.smooth_joint_error import LEARNED

_NOT_DETERMINED = "not determined"
_WHY_NOT_DETERMINED = (
    f"{numbers.capitalised(_NOT_DETERMINED)}: these data do not determine this parameter by itself; it has no "
    "influence, or others or the instrument's unknown place share its influence. A calibrated file has a value for it, "
    "which counts only together with the others."
)
_UNCHANGED = 1e-6  # sigmas: a change below this is rounding
_MOST_OUTLIERS = 8  # outlying poses that are named


@presentation.register
def _calibration(calibration: Calibration) -> Presentation:
    drawn = [(part.title, load(part.figures)(calibration)) for part in contributions(CalibrationPart)]
    return Presentation(
        f"Calibration of {calibration.dataset.name}",
        [*calibration_head(calibration), pose_errors(calibration)],
        [
            Section("Parameters", parameters(calibration)),
            redundancy_section(redundancy_of(calibration.dataset, residual=calibration.residual)),
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
        ("model", model_name(calibration.model)),
        ("residual", f"{calibration.residual}, {numbers.count(fit.rows, 'equation')}"),
        ("parameters", f"{len(fit.parameters)}, of which {fit.rank} can be known (rank)"),
        ("fit", f"{_ended(calibration)}: {fit.reason}"),
    ]
    if calibration.links_fixed_to_table:
        facts.append(("links", "held as robot.toml has them; these points do not contradict it"))
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


@document.register
def _flange_document(found: FlangeFit) -> dict[str, Any]:
    frame = found.instrument_T_base
    of_base: dict[str, Any] = {"base_frame": None}
    if frame is not None:
        rpy_deg = np.degrees(rpy_from_rotation(frame[:3, :3]))
        sigma_mm, turn_sigma_deg = found.base_sigma[:3], np.degrees(found.base_sigma[3:])
        place = {"instrument_T_base": frame, "xyz_mm": frame[:3, 3], "rpy_deg": rpy_deg}
        of_base["base_frame"] = place | {"sigma_mm": sigma_mm, "turn_sigma_deg": turn_sigma_deg}
    return {"tool_point_mm": found.tool_point_mm, "tool_point_sigma_mm": found.tool_sigma_mm} | of_base


def _sigma_document(covariance: Array) -> dict[str, Any]:
    sigmas = np.sqrt(np.diag(covariance))
    return {"sigma_mm": sigmas[:3], "turn_sigma_deg": np.degrees(sigmas[3:])}


def _ended(calibration: Calibration) -> str:
    steps = numbers.count(len(calibration.fit.iterations) - 1, "iteration")
    return f"{'converged' if calibration.fit.converged else 'not converged'} after {steps}"


def fit_sentence(calibration: Calibration) -> str:
    """Sentence on convergence, size and rank of the fit, and on the residual over the declared sigma."""
    fit = calibration.fit
    declared = calibration.dataset.declares_noise
    residual = f", residual {numbers.times(fit.reduced_chi)} the points' sigma" if declared else ""
    return (
        f"{_ended(calibration)} ({fit.reason}); {numbers.count(fit.rows, 'equation')}, "
        f"{numbers.count(len(fit.x), 'parameter')}, rank {fit.rank}{residual}"
    )


# ---- warnings -------------------------------------------------------------------------------------------------------


def _open_directions(shifts: Array) -> str:
    """Sentence on the directions (K, 3) along which the poses leave scanner and targets undetermined; "" for none."""
    if not len(shifts):
        return ""
    along = " and ".join(f"({', '.join(f'{v + 0.0:.2f}' for v in np.round(shift, 2))})" for shift in shifts)
    where = f"along {along} of the base frame" if len(shifts) < 3 else "in all directions"
    return (
        f"{where} the positions of targets and scanner are known only together; poses that turn the flange about two "
        "axes separate them"
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
        "robot.toml has it: the measured points determine neither its place nor its attitude"
    )


def tool_mass_question(calibration: Calibration) -> list[str]:
    """Sentence that asks for the mass of a tool that robot.toml has elsewhere; [] where it is told or of no use."""
    robot = calibration.dataset.robot
    told = tells_tool_mass(robot, calibration.dataset.poses.payload_kg)
    shift = calibration.tool_shift
    if shift is None or shift.off_mm < HEAVY_FROM_MM or told or not has_masses(robot):
        return []
    return [
        "a tool that reaches so far has a mass, which no file gives: set it as mass_kg under [tool] of "
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
    or_others = f" (or {' or '.join(named[1:])}: these poses do not determine which)" if entry.rivals else ""
    return (
        f"Most of the error as delivered is one entry of robot.toml: {named[0]} is off by "
        f"{numbers.size(abs(entry.off), entry.unit)}{or_others}. With it alone corrected, "
        f"{ErrorChange('train', entry.delivered_mm, entry.corrected_mm).words()}."
    )


def _entry_name(name: str) -> str:
    kind, number = name.rstrip("0123456789"), name[len(name.rstrip("0123456789")) :]
    return f"the zero of joint {number} ({name})" if kind == "theta" and number else name


def worsening_sentence(calibration: Calibration) -> str:
    """Sentence on a fit that is worse than the arm as delivered, with the errors; "" for any other fit."""
    worse = calibration.worsening
    if worse is None:
        return ""
    told = ErrorChange(worse.role, worse.before_mm, worse.after_mm).words()
    if calibration.dataset.is_by_camera:
        return (
            f"with the fitted links the board is predicted worse than with robot.toml's: {told}; --hold links finds "
            "the camera's place for the arm as robot.toml has it"
        )
    return (
        f"the fit is worse than robot.toml: {told}; do not use it, find out why first (too few or too similar poses "
        "for what is fitted, another residual, no prior)"
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


# ---- parameters -----------------------------------------------------------------------------------------------------


def parameters(calibration: Calibration, table: ExportedTable | None = None) -> list[Block]:
    """Blocks with every parameter and its sigma, learned curves, identifiable sums, and the tool row."""
    sums = identifiable_combinations(calibration)
    tool = tool_rows(calibration.dataset, residual=calibration.residual, model=calibration.model)
    return [
        *parameter_tables(calibration),
        *([] if table is None else table_alone(table)),
        Paragraph("Combinations known better than their members:" if sums else ""),
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
        "links_held": calibration.links_fixed_to_table,
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
