"""A fit of `calibrate` that begins from what other arms of the type share (`--type`)."""

from __future__ import annotations

from calib.dataset.dataset import Dataset
from calib.errors import CalibError
from calib.extras.fleet.arm_type import fit_from_type
from calib.extras.fleet.present.arm_types import pooled_block, pooled_document
from calib.extras.fleet.type_file import load_type
from inspector.cli.calibrate_command import StartedFit
from inspector.cli.options.fits import CalibrateOptions


def start_from_type(options: CalibrateOptions, dataset: Dataset) -> StartedFit | None:
    """Fit that begins from the arm's type; None where no type is given.

    Raises CalibError together with options that it has no use for.
    """
    if options.type is None:
        return None
    arm_type = load_type(options.type, dataset.robot)
    given = {
        "--effect": options.effect, "--add": options.add, "--session": options.session, "--model": options.model,
        "--no-prior": options.no_prior,
    }  # fmt: skip
    used = [name for name, value in given.items() if value]
    if used:
        raise CalibError(f"--type: effects and prior are those of the type; leave out {used[0]}")
    fit = fit_from_type(dataset, arm_type, options.fit_options())
    return StartedFit(fit.calibration, {"type": pooled_document(fit, arm_type)}, pooled_block(fit, arm_type))
