"""The subcommands that fit a model, calibrate to check. A few lines over `calib` each."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from datetime import datetime
from pathlib import Path

from calib.calibration.plausibility import implausibility_reason, outlier_hint
from calib.calibration.result import Calibration
from calib.calibration.uncertainty import identifiable_combinations
from calib.compensation.target_correction import corrected_joints, needed_columns
from calib.compensation.targets_csv import corrected_table, load_targets, require_conditions
from calib.dataset.dataset import Dataset
from calib.dataset.files.atomic_write import write_bytes_atomically, write_text_atomically
from calib.dataset.files.folder import find_datasets, load_dataset
from calib.diagnosis.diagnose import diagnose
from calib.diagnosis.effect_selection import FitStep
from calib.diagnosis.search_space import add_in_turn
from calib.diagnosis.words.conclusion_text import verdict_text
from calib.diagnosis.words.phrases import untestable_line
from calib.effects.catalogue import effects_named
from calib.effects.catalogue.user_file import load_effects
from calib.effects.effect import Family
from calib.errors import CalibError, DatasetError
from calib.fitting.observations import nominal_state
from calib.measurement.measured_points import require_corners, with_corners
from calib.models.exported_table import ExportedTable, exported_table
from calib.models.model_file import save_model
from calib.screening.curves.effect_file import effect_file_text
from calib.screening.curves.fitted_curves import curve_lines, without_curves
from calib.validation.acceptance import check
from calib.validation.cross_validation import cross_validate
from calib.validation.learning_curve import learning_curve
from inspector.cli.dataset_commands import found_corners, load, measured, searched, show
from inspector.cli.model_commands import correct_by_model, validate_model
from inspector.cli.options import (
    CalibrateOptions,
    CheckOptions,
    CorrectOptions,
    DiagnoseOptions,
    ReportOptions,
    ValidateOptions,
)
from inspector.cli.output_paths import check_outputs
from inspector.cli.progress import progress, stages
from inspector.export import json_documents as documents
from inspector.export.csv_and_png import residuals_csv
from inspector.session.session import Session
from inspector.session.session_file import save_session
from inspector.session.transitions import with_face_labels, with_found, with_steps

SCENE_ARROWS = 100.0  # how many times longer residuals are drawn in a scene's file


def loaded_effects(effects_file: Path | None, dataset: Dataset) -> tuple[Family, ...]:
    """The families of --effects-file."""
    if effects_file is None:
        return ()
    return load_effects(effects_file, nominal_state(dataset))


def _fitted(options: CalibrateOptions | CorrectOptions, dataset: Dataset) -> tuple[FitStep, ...]:
    """The fits that were asked for: one, then one more for each --add."""
    user_effects = loaded_effects(options.effects_file, dataset)
    effects = effects_named(dataset, options.effect, user_effects)
    return add_in_turn(
        dataset, options.add, options.fit_options(), effects=effects, user_effects=user_effects
    )


def run_calibrate(options: CalibrateOptions) -> int:
    """Fit, and write the calibrated table, the model and more."""
    dataset = load(options.path, options.leave_out)
    outputs = [
        options.out, options.model_out, options.residuals, options.scene, options.session, options.learned_out
    ]  # fmt: skip
    check_outputs(dataset, outputs, [options.effects_file])
    dataset = measured(dataset, orientation=options.residual == "pose")
    steps = _fitted(options, dataset)
    result = steps[-1].calibration
    table = exported_table(result, steps[0].calibration)
    if options.out is not None or options.model_out is not None:
        _require_plausible(result, options.force)
    if options.out is not None:
        table.require_improvement(force=options.force)
    session = _as_session(options, dataset, steps) if options.session is not None else None
    learned = effect_file_text(result, options.learned_out.name) if options.learned_out is not None else ""
    if options.out is not None:
        write_text_atomically(options.out, table.to_toml())
    if options.model_out is not None:
        save_model(result, options.model_out)
    if options.residuals is not None:
        write_text_atomically(options.residuals, residuals_csv(result))
    if options.scene is not None:
        from inspector.export.glb_scene import scene_glb  # with trimesh, which takes a while to load

        write_bytes_atomically(options.scene, scene_glb(result, dataset.poses.reference, SCENE_ARROWS))
    if options.learned_out is not None:
        write_text_atomically(options.learned_out, learned)
    if session is not None and options.session is not None:
        save_session(options.session, session)
    hint = outlier_hint(result)
    document = documents.calibration_document(result) | {
        "steps": documents.additions(steps),
        "table_alone": documents.table_document(table),
    }
    document["warnings"] = [*document["warnings"], *filter(None, [hint])]
    show(options, document, "\n".join(filter(None, [_calibration_text(steps, table), hint])))
    return 0


def _calibration_text(steps: Sequence[FitStep], table: ExportedTable) -> str:
    """Parameters, learned curves, sums known better than their parts, errors after each addition, summary, table."""
    result = steps[-1].calibration
    parameters = without_curves(result.to_frame())
    lines = [parameters.to_string(index=False, float_format=lambda v: f"{v:.6g}"), *curve_lines(result)]
    lines += [
        f"known: {c.description} = {c.value:.6g} +- {c.sigma:.2g} {c.unit}".rstrip()
        for c in identifiable_combinations(result)
    ]
    if len(steps) > 1:
        lines.append(f"link errors: {_errors(steps[0].calibration)}")
        lines += [f"{step.label}: {_errors(step.calibration)}" for step in steps[1:]]
    return "\n".join(filter(None, [*lines, result.summary(), table.words]))


def _require_plausible(result: Calibration, force: bool) -> None:
    """Raise CalibError for a fit that is no improvement or implausible, unless `force`: nothing is written then."""
    result.require_improvement(force=force)
    doubt = "" if force else implausibility_reason(result)
    if doubt:
        raise CalibError(
            f"dataset {result.dataset.name}: {doubt}; nothing was written, --force writes it anyway"
        )


def _as_session(options: CalibrateOptions, dataset: Dataset, steps: Sequence[FitStep]) -> Session:
    """The fits as a session of the page holds them. Raises CalibError for options that a session cannot hold."""
    given = {
        "--effect": options.effect,
        "--hold": options.hold,
        "--tolerance": options.tolerance,
        "--no-prior": options.no_prior,
        "--robust": options.robust,
        "--leave-out": options.leave_out,
    }
    used = [name for name, value in given.items() if value]
    if used:
        raise CalibError(f"--session: a session holds fits by --residual and --add only; leave out {used[0]}")
    return with_steps(Session(dataset, user_effects=loaded_effects(options.effects_file, dataset)), steps)


def _errors(calibration: Calibration) -> str:
    train, test = calibration.after.train, calibration.after.test
    return ", ".join(
        f"{name} RMSE {of.rmse_mm:.4g} mm" for name, of in (("train", train), ("test", test)) if of
    )


def run_validate(options: ValidateOptions) -> int:
    """Cross-validate over poses, and measure the learning curve."""
    if options.model is not None:
        return validate_model(options, options.model)
    dataset = measured(load(options.path, options.leave_out), orientation=options.residual == "pose")
    asked = options.fit_options()
    effects = effects_named(dataset, options.effect, loaded_effects(options.effects_file, dataset))
    with progress("fits", "fit") as on_progress:
        folds = cross_validate(dataset, asked, folds=options.folds, effects=effects, on_progress=on_progress)
        curve = learning_curve(dataset, asked, effects=effects, on_progress=on_progress)
    show(options, documents.validation_document(folds, curve), f"{folds.summary()}\n\n{curve.summary()}")
    return 0


def run_correct(options: CorrectOptions) -> int:
    """Joint targets that bring the real arm where the nominal one was meant to be."""
    if options.model is not None:
        return correct_by_model(options, options.model)
    dataset = load(options.path, options.leave_out)
    check_outputs(dataset, [options.out], [options.joints, options.effects_file])
    targets = load_targets(options.joints, dataset.robot)
    dataset = measured(dataset, orientation=options.residual == "pose")
    result = _fitted(options, dataset)[-1].calibration
    _require_plausible(result, options.force)
    if result.tool_shift is not None:
        print(f"inspector: warning: {result.tool_shift.words}", file=sys.stderr)
    needed = needed_columns(result.model, result.fit.x, dataset.poses)
    require_conditions(targets, needed, result.model.family_names)
    correction = corrected_joints(
        dataset.robot,
        result.model,
        targets.poses.q,
        x=result.fit.x,
        conditions=targets.poses,
        what=options.what,
    )
    write_text_atomically(options.out, corrected_table(targets, correction))
    ids = targets.poses.ids
    show(options, documents.correction_document(correction, ids), correction.summary(ids))
    return 0 if correction.reached.all() else 1


def run_report(options: ReportOptions) -> int:
    """Diagnose, and write the report."""
    from inspector.report.content import report_of
    from inspector.report.report import is_report, report_html  # with plotly, which takes a while to load

    if options.out.exists() and not (options.force or is_report(options.out)):
        raise CalibError(
            f"{options.out}: exists and is no report; name another file, or --force to replace it"
        )
    dataset = load(options.path, options.leave_out)
    check_outputs(dataset, [options.out], [options.effects_file])
    session = Session(dataset, searched(dataset) if dataset.points is None else {})
    if options.residual == "pose":
        session = with_face_labels(session)
    given = session.measured_for(options.residual)
    user_effects = loaded_effects(options.effects_file, given)
    effects_named(given, options.effect, user_effects)  # refuses unknown names before the work starts
    with stages() as on_step:
        found = diagnose(
            given, options.fit_options(), effects=options.effect, user_effects=user_effects, on_step=on_step
        )
    report = report_of(with_found(session, found))
    write_text_atomically(options.out, report_html(report, now=datetime.now()))
    document = documents.diagnosis_document(found) | {"report": str(options.out)}
    verdict = verdict_text(found.explanation.verdict)
    show(options, document, f"{options.out}: {verdict}")
    return 0


def run_diagnose(options: DiagnoseOptions) -> int:
    """Select the missing effects step by step."""
    if options.max_steps < 0:
        raise DatasetError(f"--max-steps {options.max_steps}: a number of steps is 0 or more")
    dataset = load(options.path, options.leave_out)
    check_outputs(dataset, [options.learned_out, options.model_out], [options.effects_file])
    dataset = measured(dataset, orientation=options.residual == "pose")
    user_effects = loaded_effects(options.effects_file, dataset)
    effects_named(dataset, options.effect, user_effects)  # refuses unknown names before the work starts
    with stages() as on_step:
        result = diagnose(
            dataset,
            options.fit_options(),
            effects=options.effect,
            user_effects=user_effects,
            max_steps=options.max_steps,
            on_step=on_step,
        )
    if options.model_out is not None:
        _require_plausible(result.calibration, options.force)
        save_model(result.calibration, options.model_out)
    ranked = result.screenings[0].to_frame()
    ranking = "No effect can be ranked: none is testable with these data."
    if len(ranked):
        ranking = ranked.head(6).to_string(index=False, float_format=lambda v: f"{v:.3g}")
    steps = result.to_frame().to_string(index=False, float_format=lambda v: f"{v:.4g}", na_rep="-")
    silent = "\n".join(map(untestable_line, result.untestable))
    text = f"{ranking}\n\n{steps}\n\n{silent}\n\n{result.summary()}"
    if options.learned_out is not None and result.learned is not None:
        write_text_atomically(
            options.learned_out, effect_file_text(result.calibration, options.learned_out.name)
        )
    elif options.learned_out is not None:
        note = "no curves were learned, so there is nothing to write"
        print(f"inspector: warning: {options.learned_out}: {note}", file=sys.stderr)
    show(options, documents.diagnosis_document(result), text)
    return 0


def run_check(options: CheckOptions) -> int:
    """Corners, fit and diagnosis of each dataset; exit code 1 where one does not pass."""
    results = []
    for folder in find_datasets(options.path):
        dataset = load_dataset(folder).leave_out(options.leave_out)
        searches = None
        if dataset.points is None:
            searches = found_corners(dataset)
            require_corners(dataset, searches)
        with_points = dataset if searches is None else with_corners(dataset, searches)
        with stages() as on_step:
            results.append(
                check(
                    dataset,
                    searches,
                    options.fit_options(),
                    effects=options.effect,
                    user_effects=loaded_effects(options.effects_file, with_points),
                    max_test_rmse_mm=options.max_test_rmse_mm,
                    on_step=on_step,
                )
            )
        if not options.json:
            print(results[-1].summary(), flush=True)
    passed = all(result.passed for result in results)
    if options.json:
        each = [documents.check_document(result) for result in results]
        show(options, each[0] if len(each) == 1 else {"passed": passed, "datasets": each}, "")
    return 0 if passed else 1
