"""The subcommand that compares two calibrations."""

from __future__ import annotations

from calib.validation.comparison import compare
from inspector.cli.calibrate_command import fitted
from inspector.cli.dataset_commands import load, measured, show
from inspector.cli.options import CompareOptions
from inspector.export.comparison_documents import comparison_document


def run_compare(options: CompareOptions) -> int:
    """What differs between two datasets' calibrations."""
    datasets = [
        measured(load(path), orientation=options.residual == "pose") for path in (options.path, options.other)
    ]
    one, other = (fitted(options, dataset)[-1].calibration for dataset in datasets)
    compared = compare(one, other)
    show(options, comparison_document(compared), compared.summary())
    return 0
