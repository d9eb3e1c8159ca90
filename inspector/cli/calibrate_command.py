"""The command `calibrate`: the fit, the files made from it, and fits for other commands."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path

from calib.calibration.plausibility import fit_without_outliers, implausibility_reason
from calib.calibration.result import Calibration
from calib.consistency.flange_fit import bad_rows, flange_fit, poorly_known_sentence, tool_sentence
from calib.dataset.dataset import Dataset
from calib.dataset.files.atomic_write import write_all_atomically
from calib.dataset.repeats import without_poses
from calib.diagnosis.effect_selection import FitStep, first_step
from calib.diagnosis.search_space import add_in_turn
from calib.effects.catalogue import effects_named
from calib.effects.catalogue.user_file import load_effects
from calib.effects.effect import Family
from calib.errors import CalibError, FitError, visible
from calib.fitting.observations import nominal_state
from calib.models.exported_table import ExportedTable, exported_table
from calib.models.model_file import load_model
from calib.models.refit import refit
from calib.present.fit.calibration import (
    calibration_document,
    calibration_head,
    outlier_hint,
    parameters,
    steps_document,
    table_document,
)
from calib.present.fit.errors import step_table
from calib.present.results import to_dict
from calib.rendering import numbers
from calib.rendering.text import block_text
from calib.robot_formats.calibrated_file import in_template, kept_template
from calib.robot_formats.robot_form import forms_of, template_suffixes
from inspector.cli.dataset_commands import load, measured, show
from inspector.cli.options.fits import CalibrateOptions
from inspector.cli.options.shared import WithAdding
from inspector.cli.output_paths import check_outputs
from inspector.export.csv_files import residuals_csv
from inspector.session.session import Session
from inspector.session.session_file import session_text
from inspector.session.transitions import with_steps

_URDF, _YAML = (".urdf",), (".yaml", ".yml")  # suffixes of templates


def loaded_effects(effects_file: Path | None, dataset: Dataset) -> tuple[Family, ...]:
    """Families of the file given by --effects-file; what it does not do well is told on stderr."""
    if effects_file is None:
        return ()
    families = load_effects(effects_file, nominal_state(dataset))
    for family in families:
        if family.note:
            print(visible(f"inspector: warning: {effects_file}: effect {family.name}: {family.note}"), file=sys.stderr)
    return families


def fitted(options: WithAdding, dataset: Dataset) -> tuple[FitStep, ...]:
    """Fits as the options require: a first one, then another for each --add."""
    user_effects = loaded_effects(options.effects_file, dataset)
    effects = effects_named(dataset, options.effect, user_effects)
    return add_in_turn(dataset, options.add, options.fit_options(), effects=effects, user_effects=user_effects)


def run_calibrate(options: CalibrateOptions) -> int:
    """Fit a dataset, and write the calibrated table, the model and other files."""
    dataset = load(options.path, options, options.finder)
    outputs = [
        options.out, options.model_out, options.residuals, options.session,
        options.urdf_out, options.kinematics_out, *(path for added in options.added for path in added.outputs()),
    ]  # fmt: skip
    check_outputs(dataset, outputs, [options.effects_file, *options.template])
    templates = _templates(options, dataset)
    dataset = measured(dataset, options.residual)
    bad = bad_rows(dataset) if dataset.robot.is_cartesian and options.residual == "position" else {}
    dataset = without_poses(dataset, tuple(bad)) if bad else dataset
    begun = next((fit for added in options.added if (fit := added.fit(dataset)) is not None), None)
    steps = _steps(options, dataset) if begun is None else (first_step(begun),)
    result = steps[-1].calibration
    table = _table(options, steps)
    if options.out is not None or options.model_out is not None or templates:
        require_plausible(result, options.force)
    if options.out is not None or templates:
        table.require_improvement(force=options.force)
    robot_files = {out: table.in_template(template) for out, template in templates.items()}
    robust = fit_without_outliers(result)
    hint = "" if robust is None else outlier_hint(result, robust)
    said = "\n".join(f"{path}: {robot_file.summary}" for path, robot_file in robot_files.items())
    document = calibration_document(result) | {"steps": steps_document(steps), "table_alone": table_document(table)}
    for path, robot_file in robot_files.items():
        key = "urdf" if path == options.urdf_out else "kinematics"
        document[key] = {"changed": robot_file.changed, "left_out": table.left_out, "notes": robot_file.notes}
    document["warnings"] = [*document["warnings"], *filter(None, [hint])]
    text = "\n".join(filter(None, [_calibration_text(steps, table), hint, said]))
    tool = flange_fit(result)
    if tool is not None:
        document |= {**to_dict(tool), "bad_rows": [{"pose": pose, "off_mm": off_mm} for pose, off_mm in bad.items()]}
        left_out = (
            [f"left out as bad rows: {numbers.listing([f'{n} ({mm:.3g} mm)' for n, mm in bad.items()])}"] if bad else []
        )
        text = "\n".join(filter(None, [text, tool_sentence(tool), poorly_known_sentence(tool), *left_out]))
    for added in options.added:
        keys, words = added.told(result)
        document |= keys
        text = "\n".join(filter(None, [text, words]))
    contents: dict[Path, str | bytes] = {path: file.content for path, file in robot_files.items()}
    if options.out is not None:
        contents[options.out] = table.to_toml()
    if options.model_out is not None:
        contents[options.model_out] = result.fitted_model.to_json()
    for added in options.added:
        contents |= added.files(result)
    if options.residuals is not None:
        contents[options.residuals] = residuals_csv(result)
    if options.session is not None:
        session = _as_session(options, dataset, steps)
        contents[options.session] = session_text(session, beside=options.session.parent)
    write_all_atomically(contents)
    show(options, document, text)
    return 0


def _steps(options: CalibrateOptions, dataset: Dataset) -> tuple[FitStep, ...]:
    """Fits of a calibration; with --model the one refit of that model."""
    if options.model is None:
        if options.refit is not None:
            raise CalibError("--refit goes together with --model FILE.json, the model that is refitted")
        return fitted(options, dataset)
    given = {"--effect": options.effect, "--add": options.add, "--session": options.session}
    used = [name for name, value in given.items() if value]
    if used:
        raise CalibError(f"--model: the effects are those of the model; leave out {used[0]}")
    if options.refit is None:
        raise CalibError("--model goes together with --refit frame or --refit links: what is to be fitted anew")
    model = load_model(options.model, options.effects_file)
    return (first_step(refit(model, dataset, options.refit, options.fit_options())),)


def _table(options: CalibrateOptions, steps: Sequence[FitStep]) -> ExportedTable:
    """Table to be written; of a refit to few poses, which tell of no table without effects, that of robot.toml."""
    result = steps[-1].calibration
    if options.model is None:
        return exported_table(result, steps[0].calibration)
    try:
        return exported_table(result)
    except FitError:
        if options.out is not None or options.template:
            raise
        return ExportedTable(result, None)


def _templates(options: CalibrateOptions, dataset: Dataset) -> dict[Path, Path]:
    """Template of each robot file to be written: the file given, else the file kept at the dataset's import.

    Raises CalibError where a file has no template, a template no file, or a template is of another arm.
    """
    wanted = (
        (options.urdf_out, "--urdf-out", _URDF),
        (options.kinematics_out, "--kinematics-out", _kinematics_suffixes(options.kinematics_out)),
    )
    for path in options.template:
        if path.suffix.lower() not in template_suffixes():
            raise CalibError(
                f"--template {path}: a template is a {' or '.join(template_suffixes())}; a .xacro computes its "
                "origins: give --kinematics-out with the YAML of joint origins that it reads, or expand it first"
            )
    found: dict[Path, Path] = {}
    for out, option, suffixes in wanted:
        fitting = [path for path in options.template if path.suffix.lower() in suffixes]
        kept = kept_template(dataset.folder, suffixes)
        if out is not None and not fitting and kept is not None:
            fitting = [kept]
        if (out is not None) != (len(fitting) == 1):
            raise CalibError(f"{option} FILE and one --template ROBOT{suffixes[0]}, your own of this arm, go together")
        if out is not None:
            found[out] = fitting[0]
    for template in found.values():
        in_template(template, dataset.robot, dataset.robot)
    return found


def _kinematics_suffixes(out: Path | None) -> tuple[str, ...]:
    """Suffixes of the template of a kinematics file: its own form's where that has templates, else a YAML's."""
    forms = () if out is None else forms_of(out)
    return next((form.suffixes for form in forms if form.in_template and form.suffixes != _URDF), _YAML)


def _calibration_text(steps: Sequence[FitStep], table: ExportedTable) -> str:
    """Terminal text of a calibration: parameters, errors after each addition, and warnings."""
    result = steps[-1].calibration
    way = [step.calibration for step in steps]
    each = [step_table(steps)] if len(steps) > 1 else []
    return block_text(*parameters(result, table), *each, *calibration_head(result, way))


def require_plausible(result: Calibration, force: bool) -> None:
    """Raise CalibError, before anything is written, for a fit without improvement or implausible, unless `force`.

    Single poses that alone spoil the fit are named.
    """
    result.require_improvement(force=force)
    doubt = "" if force else implausibility_reason(result)
    if not doubt:
        return
    robust = fit_without_outliers(result)
    hint = "" if robust is None or implausibility_reason(robust) else f"; {outlier_hint(result, robust)}"
    raise CalibError(f"dataset {result.dataset.name}: {doubt}{hint}; nothing was written, --force writes it anyway")


def _as_session(options: CalibrateOptions, dataset: Dataset, steps: Sequence[FitStep]) -> Session:
    """The fits as a session of the page. Raises CalibError for options that a session cannot hold."""
    given = {
        "--effect": options.effect,
        "--hold": options.hold,
        "--tolerance": options.tolerance,
        "--no-prior": options.no_prior,
        "--robust": options.robust,
    }
    used = [name for name, value in given.items() if value]
    if used:
        raise CalibError(
            "--session: a session holds fits by --residual, --add, --leave-out and --new-setup only; leave out "
            f"{used[0]}"
        )
    return with_steps(Session(dataset, user_effects=loaded_effects(options.effects_file, dataset)), steps)
