"""A fit that begins from what other arms of the type share, of `calibrate --type`."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from calib.calibration.result import Calibration
from calib.dataset.dataset import Dataset
from calib.errors import CalibError
from calib.extras.fleet.arm_type import ArmType, PooledFit, fit_from_type
from calib.extras.fleet.present.arm_types import pooled_block, pooled_document
from calib.extras.fleet.type_file import load_type
from calib.rendering.text import block_text
from inspector.cli.additions import CalibrateAddition
from inspector.cli.options.fits import CalibrateOptions
from inspector.extras.fleet.options import TypeOptions


class FromType(CalibrateAddition[TypeOptions, CalibrateOptions]):
    """The fit from an arm's type."""

    arm_type: ArmType
    pooled: PooledFit

    def fit(self, dataset: Dataset) -> Calibration | None:
        """Fit from the arm's type. Raises CalibError together with options that it has no use for."""
        assert self.asked.type is not None  # the only option
        self.arm_type = load_type(self.asked.type, dataset.robot)
        for name in ("effect", "add", "session", "model", "no_prior"):
            if getattr(self.command, name):
                option = name.replace("_", "-")
                raise CalibError(f"--type: effects and prior are those of the type; leave out --{option}")
        self.pooled = fit_from_type(dataset, self.arm_type, self.command.fit_options())
        return self.pooled.calibration

    def told(self, fit: Calibration) -> tuple[Mapping[str, Any], str]:
        """What the type says of the fit."""
        return {"type": pooled_document(self.pooled, self.arm_type)}, block_text(
            pooled_block(self.pooled, self.arm_type)
        )
