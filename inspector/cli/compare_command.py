"""The commands `compare` (two calibrations) and `repeat` (recordings of one arm)."""

from __future__ import annotations

from calib.api.validation import compare, repeat
from inspector.cli.calibrate_command import fitted
from inspector.cli.dataset_commands import load, measured, show
from inspector.cli.options.fits import CompareOptions, RepeatOptions
from inspector.cli.progress import stages


def run_compare(options: CompareOptions) -> int:
    """Compare the calibrations of two datasets."""
    datasets = [measured(load(path), options.residual) for path in (options.path, options.other)]
    one, other = (fitted(options, dataset)[-1].calibration for dataset in datasets)
    compared = compare(one, other)
    show(options, compared.to_dict(), compared.summary())
    return 0


def run_repeat(options: RepeatOptions) -> int:
    """Report which causes come back in several recordings of one arm."""
    recordings = [measured(load(path)) for path in (options.path, *options.others)]
    with stages() as on_step:
        found = repeat(recordings, on_step=on_step)
    show(options, found.to_dict(), found.summary())
    return 0
