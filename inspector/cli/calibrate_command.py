"""`calibrate`: the fit, and all that can be written of it; what other commands need of a fit too."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pandas as pd

from calib.calibration.plausibility import implausibility_reason, outlier_hint
from calib.calibration.result import Calibration
from calib.calibration.uncertainty import Combination, identifiable_combinations
from calib.dataset.dataset import Dataset
from calib.dataset.files.atomic_write import write_bytes_atomically, write_text_atomically
from calib.diagnosis.effect_selection import FitStep
from calib.diagnosis.search_space import add_in_turn
from calib.effects.catalogue import effects_named
from calib.effects.catalogue.user_file import load_effects
from calib.effects.effect import Family
from calib.errors import CalibError
from calib.fitting.observations import nominal_state
from calib.identifiability.tool_rows import tool_rows
from calib.models.exported_table import ExportedTable, exported_table, require_template_of
from calib.screening.curves.fitted_curves import curve_lines, effect_file_text, without_curves
from inspector.cli.dataset_commands import load, measured, show
from inspector.cli.options import CalibrateOptions, CompareOptions, CorrectOptions, WatchOptions
from inspector.cli.output_paths import check_outputs
from inspector.export import json_documents as documents
from inspector.export.csv_and_png import residuals_csv
from inspector.session.session import Session
from inspector.session.session_file import session_text
from inspector.session.transitions import with_steps

SMALLEST_CHANGE = 1e-6  # in sigmas: what is printed as no change of a parameter
SCENE_ARROWS = 100.0  # how many times longer residuals are drawn in a scene's file


def loaded_effects(effects_file: Path | None, dataset: Dataset) -> tuple[Family, ...]:
    """The families of --effects-file."""
    if effects_file is None:
        return ()
    return load_effects(effects_file, nominal_state(dataset))


def fitted(
    options: CalibrateOptions | CorrectOptions | CompareOptions | WatchOptions, dataset: Dataset
) -> tuple[FitStep, ...]:
    """The fits that were asked for: one, then one more for each --add."""
    user_effects = loaded_effects(options.effects_file, dataset)
    effects = effects_named(dataset, options.effect, user_effects)
    return add_in_turn(dataset, options.add, options.fit_options(), effects=effects, user_effects=user_effects)


def run_calibrate(options: CalibrateOptions) -> int:
    """Fit, and write the calibrated table, the model and more."""
    dataset = load(options.path, options.leave_out, options.finder)
    outputs = [
        options.out, options.model_out, options.residuals, options.scene, options.session, options.learned_out,
        options.urdf_out, options.kinematics_out,
    ]  # fmt: skip
    check_outputs(dataset, outputs, [options.effects_file, *options.template])
    templates = _templates(options, dataset)
    dataset = measured(dataset, orientation=options.residual == "pose")
    steps = fitted(options, dataset)
    result = steps[-1].calibration
    table = exported_table(result, steps[0].calibration)
    if options.out is not None or options.model_out is not None or templates:
        require_plausible(result, options.force)
    if options.out is not None or templates:
        table.require_improvement(force=options.force)
    robot_files = {out: table.in_template(template) for out, template in templates.items()}
    hint = outlier_hint(result)
    said = "\n".join(f"{path}: {robot_file.summary}" for path, robot_file in robot_files.items())
    document = documents.calibration_document(result) | {
        "steps": documents.additions(steps),
        "table_alone": documents.table_document(table),
    }
    for path, robot_file in robot_files.items():
        key = "urdf" if path == options.urdf_out else "kinematics"
        document[key] = {"changed": robot_file.changed, "left_out": table.left_out, "notes": robot_file.notes}
    document["warnings"] = [*document["warnings"], *filter(None, [hint])]
    text = "\n".join(filter(None, [_calibration_text(steps, table), hint, said]))
    contents: dict[Path, str | bytes] = {path: file.content for path, file in robot_files.items()}
    if options.out is not None:
        contents[options.out] = table.to_toml()
    if options.model_out is not None:
        contents[options.model_out] = result.fitted_model.to_json()
    if options.residuals is not None:
        contents[options.residuals] = residuals_csv(result)
    if options.scene is not None:
        from inspector.export.glb_scene import scene_glb  # with trimesh, which takes a while to load

        contents[options.scene] = scene_glb(result, dataset.poses.reference, SCENE_ARROWS)
    if options.learned_out is not None:
        contents[options.learned_out] = effect_file_text(result, options.learned_out.name)
    if options.session is not None:
        session = _as_session(options, dataset, steps)
        contents[options.session] = session_text(session, beside=options.session.parent)
    for path, content in contents.items():  # all are made before the first is written
        if isinstance(content, bytes):
            write_bytes_atomically(path, content)
        else:
            write_text_atomically(path, content)
    show(options, document, text)
    return 0


def _templates(options: CalibrateOptions, dataset: Dataset) -> dict[Path, Path]:
    """The template of each robot's file that is to be written.

    Raises CalibError where a file has no template, a template no file, or a template is of another arm.
    """
    wanted = (
        (options.urdf_out, "--urdf-out", (".urdf",)),
        (options.kinematics_out, "--kinematics-out", (".yaml", ".yml")),
    )
    known = [suffix for _, _, suffixes in wanted for suffix in suffixes]
    for path in options.template:
        if path.suffix.lower() not in known:
            raise CalibError(
                f"--template {path}: a template is a .urdf or .yaml; the origins of a .xacro are computed: give "
                "--kinematics-out with the YAML of joint origins that it reads, or expand it first"
            )
    found: dict[Path, Path] = {}
    for out, option, suffixes in wanted:
        fitting = [path for path in options.template if path.suffix.lower() in suffixes]
        if (out is not None) != (len(fitting) == 1):
            raise CalibError(f"{option} FILE and one --template ROBOT{suffixes[0]}, your own of this arm, go together")
        if out is not None:
            found[out] = fitting[0]
    for template in found.values():
        require_template_of(template, dataset.robot)
    return found


def _calibration_text(steps: Sequence[FitStep], table: ExportedTable) -> str:
    """Parameters, learned curves, sums known better than their parts, errors after each addition, summary, table."""
    result = steps[-1].calibration
    parameters = as_printed(in_file_units(without_curves(result.to_frame())))
    lines = [parameters.to_string(index=False, float_format=lambda v: f"{v:.6g}"), *curve_lines(result)]
    lines += [_known(c) for c in identifiable_combinations(result)]
    lines.append(tool_rows(result.dataset, residual=result.residual, model=result.model).summary())
    if len(steps) > 1:
        lines.append(f"link errors: {_errors(steps[0].calibration)}")
        lines += [f"{step.label}: {_errors(step.calibration)}" for step in steps[1:]]
    return "\n".join(filter(None, [*lines, result.summary(), table.words]))


def in_file_units(parameters: pd.DataFrame) -> pd.DataFrame:
    """A calibration's table of parameters with the angles of the links in degrees, as robot.toml has them.

    Parameters of effects carry their unit in their name, so they stay.
    """
    out = parameters.copy()
    angles = (out["unit"] == "rad") & ~out["name"].str.contains(".", regex=False)
    lengths = ["nominal", "value", "change", "sigma", "tolerance"]
    out.loc[angles, lengths] = np.degrees(out.loc[angles, lengths].to_numpy(dtype=float))
    out.loc[angles, "unit"] = "deg"
    return out


def as_printed(parameters: pd.DataFrame) -> pd.DataFrame:
    """The same table for people: no rounding error in place of a parameter that stayed, `yes` or `no` for `known`."""
    out = parameters.copy()
    stayed = out["change"].abs() < SMALLEST_CHANGE * out["sigma"]
    out.loc[stayed, "change"] = 0.0
    out.loc[stayed, "value"] = out.loc[stayed, "nominal"]
    out["known"] = np.where(out["known"], "yes", "no")
    return out


def _known(sum_: Combination) -> str:
    """A sum that is known better than its parts, angles in degrees."""
    angle = sum_.unit == "rad"
    scale, unit = (float(np.degrees(1.0)), "deg") if angle else (1.0, sum_.unit)
    return f"known: {sum_.description} = {scale * sum_.value:.6g} +- {scale * sum_.sigma:.2g} {unit}".rstrip()


def require_plausible(result: Calibration, force: bool) -> None:
    """Raise CalibError for a fit that is no improvement or implausible, unless `force`: nothing is written then."""
    result.require_improvement(force=force)
    doubt = "" if force else implausibility_reason(result)
    if doubt:
        raise CalibError(f"dataset {result.dataset.name}: {doubt}; nothing was written, --force writes it anyway")


def _as_session(options: CalibrateOptions, dataset: Dataset, steps: Sequence[FitStep]) -> Session:
    """The fits as a session of the page holds them. Raises CalibError for options that a session cannot hold."""
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
            f"--session: a session holds fits by --residual, --add and --leave-out only; leave out {used[0]}"
        )
    return with_steps(Session(dataset, user_effects=loaded_effects(options.effects_file, dataset)), steps)


def _errors(calibration: Calibration) -> str:
    train, test = calibration.after.train, calibration.after.test
    return ", ".join(f"{name} RMSE {of.rmse_mm:.4g} mm" for name, of in (("train", train), ("test", test)) if of)
