"""robot.toml as a result: the calibrated table that is best alone, with its own errors.

A controller takes a table and nothing else. Link errors that were fitted beside an effect are right only together with
it: without the effect they can be worse than those of a fit that never had it. So the exported table is fitted without
effects, to the same points and by the same options.
"""

from __future__ import annotations

from dataclasses import dataclass

from calib.calibration.calibrate import calibrate
from calib.calibration.evaluation import Evaluation
from calib.calibration.model_versions import fits_same_points, options_for_links
from calib.calibration.result import Calibration
from calib.dataset.files.robot_toml import robot_to_toml
from calib.display.brief import Brief
from calib.kinematics.robot import Robot


@dataclass(frozen=True)
class ExportedTable(Brief):
    """A robot whose table is best without any effect, beside the model that it came from."""

    full: Calibration  # the model, its effects included
    links: Calibration | None
    """The fit of the link errors alone; `full` itself where it has no effects, None where every link error is held."""

    @property
    def robot(self) -> Robot:
        """With the table to export."""
        return self.full.dataset.robot if self.links is None else self.links.robot

    @property
    def errors(self) -> Evaluation:
        """Errors of the arm with the table alone."""
        return self.full.before if self.links is None else self.links.after

    @property
    def left_out(self) -> tuple[str, ...]:
        """Families of the model that a table cannot hold."""
        return tuple(" ".join(name.split()) for name in self.full.model.family_names)

    @property
    def error_words(self) -> str:
        """The errors of the table alone."""
        return _errors(self.errors)

    @property
    def words(self) -> str:
        """The errors of the table alone and of the full model, in one line; "" where the two are the same."""
        if not self.left_out:
            return ""
        names = ", ".join(self.left_out)
        return (
            f"the table alone, fitted without {names}: {_errors(self.errors)}; "
            f"the model with {names}: {_errors(self.full.after)}"
        )

    def to_toml(self) -> str:
        """The text of robot.toml; its first line tells the errors where the model has more than the table."""
        comment = f"# {self.words}\n" if self.words else ""
        return comment + robot_to_toml(self.robot)

    def require_improvement(self, *, force: bool = False) -> None:
        """Raise as `Calibration.require_improvement` does, where the table alone is no improvement."""
        if self.links is not None:
            self.links.require_improvement(force=force)

    def _brief(self) -> str:
        return f"{self.robot.name}: {self.error_words}"


def exported_table(calibration: Calibration, links: Calibration | None = None) -> ExportedTable:
    """The table of a calibration that is best alone.

    `links` is a fit of the link errors alone; it counts where it is of the same points and options, else it is made.
    """
    if not calibration.model.added_effects:
        return ExportedTable(calibration, calibration)
    if set(calibration.model.geometry_names) <= calibration.model.held:
        return ExportedTable(calibration, None)
    if links is None or links.model.added_effects or not fits_same_points(links, calibration):
        links = calibrate(calibration.dataset, options_for_links(calibration))
    return ExportedTable(calibration, links)


def _errors(evaluation: Evaluation) -> str:
    """ "test RMSE 0.203 mm (training 0.195)"."""
    train, test = evaluation.train, evaluation.test
    if test is None:
        return f"training RMSE {train.rmse_mm:.4g} mm, no test poses" if train else "no poses"
    return f"test RMSE {test.rmse_mm:.4g} mm" + (f" (training {train.rmse_mm:.4g})" if train else "")
