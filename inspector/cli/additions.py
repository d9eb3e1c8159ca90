"""What options that a plug-in adds to one of core's commands make it do. Nothing slow is imported."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Generic, TypeVar

if TYPE_CHECKING:
    from calib.calibration.result import Calibration
    from calib.dataset.dataset import Dataset
    from calib.dataset_import.plan import ImportSources
    from calib.models.fitted_model import FittedModel
    from calib.planning.plan import Plan

Asked = TypeVar("Asked")
Command = TypeVar("Command")


@dataclass
class Addition(Generic[Asked, Command]):
    """What a command asks of options that a plug-in adds, where one of them is given; by default they do nothing.

    Attributes:
        asked: the plug-in's options.
        command: the command's own.
    """

    asked: Asked
    command: Command

    def begin(self) -> None:
        """Check the options before the command begins. Raises CalibError for what cannot be done."""

    def inputs(self) -> Iterable[Path | None]:
        """Files that are read, which the command must not overwrite."""
        return ()

    def outputs(self) -> Iterable[Path | None]:
        """Files that will be written."""
        return ()


class CalibrateAddition(Addition[Asked, Command]):
    """What `calibrate` asks."""

    def fit(self, dataset: Dataset) -> Calibration | None:
        """Fit of a measured dataset in place of the command's own; None leaves it to the command."""
        return None

    def files(self, fit: Calibration) -> Mapping[Path, str | bytes]:
        """Content of the files that are to be written."""
        return {}

    def told(self, fit: Calibration) -> tuple[Mapping[str, Any], str]:
        """What is told beside the fit, or in another way: keys of the JSON document, and text."""
        return {}, ""


class PlanAddition(Addition[Asked, Command]):
    """What `plan` asks."""

    def files(self, plan: Plan) -> Mapping[Path, str]:
        """Content of the files that are to be written."""
        return {}


class CorrectAddition(Addition[Asked, Command]):
    """What `correct` asks."""

    def corrected(self, dataset: Dataset) -> Callable[[FittedModel], int] | None:
        """Writer of what is corrected in place of joint targets, which it reads at once; it returns the exit code."""
        return None


class ImportAddition(Addition[Asked, Command]):
    """What `import` asks."""

    def chosen(self, choice: ImportSources) -> ImportSources:
        """What is to be imported, and how."""
        return choice
