"""Calibrated robot as a file (robot.toml, or the user's URDF or YAML), with the table that fits best without effects.

A controller takes a table and nothing else. Link errors that were fitted together with an effect are right only
together with it: without the effect they can be worse than those of a fit that never had it. So the exported table is
fitted without effects of the arm, to the same points and by the same options. Effects of the instrument and of the
target stay in that fit: the arm is without them wherever it works.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from calib.brief import Brief
from calib.calibration.calibrate import fit_measured
from calib.calibration.evaluation import Evaluation
from calib.calibration.model_versions import fits_same_points
from calib.calibration.result import Calibration
from calib.dataset.files.atomic_write import write_bytes_atomically
from calib.dataset.files.origin import PROGRAM, program_version
from calib.dataset.files.robot_toml import robot_to_toml
from calib.effects.effect import full_name, is_of_measuring
from calib.kinematics.robot import Robot
from calib.rendering import numbers
from calib.robot_formats.calibrated_file import CalibratedFile, in_template
from calib.robot_formats.robots import robot_content


@dataclass(frozen=True)
class ExportedTable(Brief):
    """A robot table fitted without any effect of the arm, for controllers that know none, and the full calibration."""

    full: Calibration  # the model, its effects included
    links: Calibration | None
    """Fit of the link errors beside effects of instrument and target; `full` itself where it has no others.

    None where every link error is held.
    """

    @property
    def robot(self) -> Robot:
        """The robot with the table to export."""
        return self.full.dataset.robot if self.links is None else self.links.robot

    @property
    def errors(self) -> Evaluation:
        """Errors of the arm with the exported table alone."""
        return self.full.before if self.links is None else self.links.after

    @property
    def left_out(self) -> tuple[str, ...]:
        """Names of the model's effects of the arm, which a table cannot hold."""
        return tuple(" ".join(name.split()) for name in self.full.model.arm_family_names)

    @property
    def comment(self) -> str:
        """Comment for a robot file: errors of the table alone and of the full model; "" where both are equal."""
        if not self.left_out:
            return ""
        names = numbers.listing(self.left_out)
        return (
            f"the table alone, fitted without {names}: {errors_in_words(self.errors)}; "
            f"the model with {names}: {errors_in_words(self.full.after)}"
        )

    def to_toml(self) -> str:
        """Text of robot.toml; the first line gives the errors where the full model has effects beyond the table."""
        first_line = f"# {self.comment}\n" if self.comment else ""
        return first_line + robot_to_toml(self.robot)

    def in_template(self, template: Path) -> CalibratedFile:
        """Calibrated URDF or YAML: the template with calibrated origins; a URDF's comment has dataset and errors.

        Raises RobotFileError where the template is not of the dataset's arm.
        """
        dataset = self.full.dataset
        names = ", ".join(self.left_out)
        by = f"{PROGRAM} {program_version()}"
        comment = f"origins calibrated by {by} with dataset {dataset.name}: {errors_in_words(self.errors)}"
        notes = []
        if names:
            notes.append(f"no origin holds {names}; these are the origins that are best without: {self.comment}")
            comment += f"; without {names}, which no origin holds"
        return in_template(template, self.robot, dataset.robot, comment).with_notes(notes)

    def save(self, path: str | Path, template: str | Path | None = None) -> None:
        """Write the robot as .toml, .urdf or .yaml; a template is the user's own file, whose origins are replaced."""
        path = Path(path)
        if template is not None:
            content = self.in_template(Path(template)).content
        elif path.suffix.lower() == ".toml":
            content = self.to_toml().encode()
        else:
            content, _ = robot_content(self.robot, path)
        write_bytes_atomically(path, content)

    def require_improvement(self, *, force: bool = False) -> None:
        """Raise FitError where the table alone is no improvement (`Calibration.require_improvement`)."""
        if self.links is not None:
            self.links.require_improvement(force=force)

    def _brief(self) -> str:
        return f"{self.robot.name}: {errors_in_words(self.errors)}"


def exported_table(calibration: Calibration, links: Calibration | None = None) -> ExportedTable:
    """Robot table that fits the data of a calibration best without the calibration's effects of the arm.

    `links` is a fit of the link errors alone; it is used where it has the same points and options, and the calibration
    no effect of instrument or target. Else one is made.
    """
    model = calibration.model
    if not model.arm_family_names:
        return ExportedTable(calibration, calibration)
    if set(model.geometry_names) <= model.fixed:
        return ExportedTable(calibration, None)
    kept = tuple(effect for effect in model.added_effects if is_of_measuring(effect))
    if links is None or kept or links.model.added_effects or not fits_same_points(links, calibration):
        names = {full_name(effect, parameter) for effect in kept for parameter in effect.parameters}
        sigmas = {name: sigma for name, sigma in model.prior_sigmas.items() if name in names}
        options = calibration.options.for_parameters((*model.geometry_names, *names))
        links = fit_measured(calibration.dataset, options, effects=kept, prior_sigmas=sigmas)
    return ExportedTable(calibration, links)


def errors_in_words(evaluation: Evaluation) -> str:
    """Phrase with the RMSE of test and training poses: "test RMSE 0.20 mm (training 0.19 mm)"."""
    train, test = numbers.length(evaluation.train_rmse_mm), numbers.length(evaluation.test_rmse_mm)
    if evaluation.test is None:
        return f"training RMSE {train}, no test poses" if evaluation.train else "no poses"
    return f"test RMSE {test}{f' (training {train})' if evaluation.train else ''}"
