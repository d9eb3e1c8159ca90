"""Commands that fit a model: validate, correct, report, diagnose, check."""

from __future__ import annotations

from datetime import datetime
from pathlib import Path

from calib.api.causes import diagnose
from calib.dataset.dataset import Dataset
from calib.dataset.files.atomic_write import write_text_atomically
from calib.dataset.files.folder import find_datasets, load_dataset
from calib.diagnosis.result import Diagnosis
from calib.diagnosis.search_space import MAX_EFFECTS
from calib.effects.catalogue import effects_named
from calib.errors import CalibError, DatasetError, visible
from calib.measurement.measured_points import require_corners, with_corners
from calib.models.model_file import save_model
from calib.planning.discrimination import NextPoses, next_poses
from calib.present.diagnosis.diagnosis import brief_presentation, diagnosis_document, diagnosis_presentation
from calib.rendering.text import block_text
from calib.rendering.text import text as plain_text
from inspector.cli.calibrate_command import loaded_effects, require_plausible
from inspector.cli.dataset_commands import found_corners, load, measured, searched, show, without
from inspector.cli.model_commands import validate_model
from inspector.cli.options.fits import CheckOptions, DiagnoseOptions, ReportOptions, ValidateOptions
from inspector.cli.output_paths import check_outputs
from inspector.cli.progress import progress, stages
from inspector.session.measuring import with_face_labels
from inspector.session.session import Session
from inspector.session.transitions import with_found

MORE = "--verbose prints reasons, all candidates and what cannot be tested; inspector report and --json have all of it"


def run_validate(options: ValidateOptions) -> int:
    """Cross-validate over poses, and measure the learning curve."""
    if options.model is not None:
        return validate_model(options, options.model)
    # No other command here needs these
    from calib.api.validation import cross_validate, learning_curve
    from calib.present.fit import validation as told

    dataset = measured(load(options.path, options, options.finder), options.residual)
    asked = options.fit_options()
    effects = effects_named(dataset, options.effect, loaded_effects(options.effects_file, dataset))
    with progress("fits", "fit") as on_progress:
        folds = cross_validate(dataset, asked, folds=options.folds, effects=effects, on_progress=on_progress)
        curve = learning_curve(dataset, asked, effects=effects, on_progress=on_progress)
    plan = [] if curve.flat_since is not None else [f"next: inspector plan {options.path} chooses those that help most"]
    validated = block_text(*told.cross_validation_blocks(folds), told.cross_validation_verdict(folds))
    learned = block_text(*told.learning_curve_blocks(curve), told.learning_curve_verdict(curve))
    show(options, told.validation_document(folds, curve), "\n".join([validated, "", learned, *plan, *without(dataset)]))
    return 0


def run_report(options: ReportOptions) -> int:
    """Diagnose a dataset and write the report as a page."""
    from inspector.report.report import is_report, report_html  # with plotly, which takes a while to load

    out = options.out
    if out.exists() and not (options.force or is_report(out)):
        raise CalibError(f"{out}: exists and is no report; name another file, or --force to replace it")
    dataset = load(options.path, options, options.finder)
    check_outputs(dataset, [out], [options.effects_file])
    session = Session(dataset, searched(dataset) if dataset.points is None else {})
    if options.residual == "pose":
        session = with_face_labels(session)
    found = diagnosed(session.measured_for(options.residual), options)
    session = with_found(session, found)
    write_text_atomically(out, report_html(session, now=datetime.now()))
    document = diagnosis_document(found, session.next_poses) | {"report": str(out)}
    show(options, document, f"{out}: {found.headline}")
    return 0


def diagnosed(dataset: Dataset, options: ReportOptions | DiagnoseOptions, max_steps: int = MAX_EFFECTS) -> Diagnosis:
    """Diagnosis of a measured dataset with the options of a command, its stages told on stderr."""
    user_effects = loaded_effects(options.effects_file, dataset)
    effects_named(dataset, options.effect, user_effects)  # refuses unknown names before the work starts
    with stages() as on_step:
        return diagnose(
            dataset,
            options.fit_options(),
            effects=options.effect,
            user_effects=user_effects,
            max_steps=max_steps,
            on_step=on_step,
        )


def run_diagnose(options: DiagnoseOptions) -> int:
    """Diagnose a dataset: add missing effects step by step."""
    if options.max_steps < 0:
        raise DatasetError(f"--max-steps {options.max_steps}: a number of steps is 0 or more")
    dataset = load(options.path, options, options.finder)
    check_outputs(dataset, [options.model_out], [options.effects_file])
    dataset = measured(dataset, options.residual)
    result = diagnosed(dataset, options, options.max_steps)
    if options.model_out is not None:
        require_plausible(result.calibration, options.force)
    poses = next_poses(result)
    document = diagnosis_document(result, poses)
    text = brief_text(result, poses, options.path)
    if options.verbose:
        next_steps = (f"next: {line}" for line in planned_next(result, poses, options.path))
        left_out = without(result.calibration.fitted_dataset)
        text = "\n".join([plain_text(diagnosis_presentation(result, poses)), *next_steps, *left_out])
    if options.model_out is not None:
        save_model(result.calibration, options.model_out)
    show(options, document, text)
    return 0


def planned_next(result: Diagnosis, poses: NextPoses | None, path: Path) -> list[str]:
    """Lines with the commands that lead on: they plan the next poses to measure, or write the calibrated table."""
    if poses is not None and poses.change is not None:
        return [f"inspector plan {path} --for {poses.purpose} names the poses to measure again"]
    if poses is not None:
        return [f"inspector plan {path} --for split plans the poses that settle it"]
    if result.verdict not in ("adequate", "named"):
        return []
    effects = "".join(f" --add {name}" for name in result.missing)
    calibrate = f"inspector calibrate {path}{effects} --out robot.toml writes the calibrated table"
    if result.calibration.dataset.robot.is_cartesian:
        return [f"inspector calibrate {path} tells the places and their sigmas"]
    if result.held_out_beyond_noise is None:
        return [calibrate]
    return [f"inspector plan {path} plans poses that determine the links better", calibrate]


def brief_text(result: Diagnosis, poses: NextPoses | None, path: Path) -> str:
    """Terminal text of a diagnosis without the reasons."""
    moved = [
        f"inspector diagnose {path} --new-setup {move.before} takes the instrument as set up anew from there on"
        for move in result.instrument_moved
    ]
    what_next = [*moved, *planned_next(result, poses, path), *without(result.calibration.fitted_dataset), MORE]
    return plain_text(brief_presentation(result, what_next))


def run_check(options: CheckOptions) -> int:
    """Check corners, fit and diagnosis of each dataset; exit code 1 where one does not pass."""
    from calib.api.validation import check  # no other command here needs it

    results = []
    for folder in find_datasets(options.path):
        dataset = options.of_dataset(load_dataset(folder))
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
            print(visible(results[-1].summary()), flush=True)
    passed = all(result.passed for result in results)
    if options.json:
        each = [result.to_dict() for result in results]
        show(options, each[0] if len(each) == 1 else {"passed": passed, "datasets": each}, "")
    return 0 if passed else 1
