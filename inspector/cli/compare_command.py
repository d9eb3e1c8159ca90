"""The subcommands that compare: two calibrations, or a calibration with check poses measured later."""

from __future__ import annotations

from calib.monitoring.watch import watch
from calib.validation.comparison import compare
from inspector.cli.calibrate_command import fitted
from inspector.cli.dataset_commands import load, measured, show
from inspector.cli.options import CompareOptions, WatchOptions
from inspector.export.comparison_documents import comparison_document, watch_document


def run_compare(options: CompareOptions) -> int:
    """What differs between two datasets' calibrations."""
    datasets = [
        measured(load(path), orientation=options.residual == "pose") for path in (options.path, options.other)
    ]
    one, other = (fitted(options, dataset)[-1].calibration for dataset in datasets)
    compared = compare(one, other)
    show(options, comparison_document(compared), compared.summary())
    return 0


def run_watch(options: WatchOptions) -> int:
    """What changed since a calibration; 1 where anything did, so that a scheduled run can raise an alarm."""
    base = fitted(options, measured(load(options.path)))[-1].calibration
    seen = [watch(base, measured(load(path)), scanner_moved=options.scanner_moved) for path in options.new]
    show(options, watch_document(seen), "\n".join(w.summary() for w in seen))
    return 0 if all(w.verdict == "unchanged" for w in seen) else 1
