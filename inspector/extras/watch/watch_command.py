"""The command `watch`: what changed in a cell since a calibration."""

from __future__ import annotations

from datetime import datetime
from pathlib import Path

from calib.dataset.files.atomic_write import write_text_atomically
from calib.errors import CalibError
from calib.extras.watch.present.changes import series, watch_document, watch_summary
from calib.extras.watch.watched_cell import WatchedCell, watched_cell
from calib.present import to_dict
from calib.text_files.csv_text import frame_csv
from inspector.cli.calibrate_command import fitted
from inspector.cli.dataset_commands import load, measured, show
from inspector.cli.output_paths import check_outputs
from inspector.extras.watch.options import WatchOptions

WATCH_FILES = (".html", ".svg", ".csv")


def run_watch(options: WatchOptions) -> int:
    """Report changes since a calibration; exit code 1 where there are any, as an alarm for scheduled runs."""
    for out in options.out:
        if out.suffix.lower() not in WATCH_FILES:
            raise CalibError(f"{out}: found the suffix {out.suffix!r}; a watch is written as {' '.join(WATCH_FILES)}")
    dataset = load(options.path)
    check_outputs(dataset, options.out)
    base = fitted(options, measured(dataset))[-1].calibration
    later = [load(path) for path in options.new]
    for new in later:
        check_outputs(new, options.out)
    cell = watched_cell(
        base, list(map(measured, later)), scanner_moved=options.scanner_moved, tolerance_mm=options.tolerance_mm
    )
    for out in options.out:
        _write(out, base.dataset.name, cell)
    show(options, to_dict(watch_document(cell)), "\n".join(watch_summary(cell)))
    return 0 if cell.is_unchanged else 1


def _write(out: Path, base: str, cell: WatchedCell) -> None:
    if out.suffix.lower() == ".csv":
        write_text_atomically(out, frame_csv(series(cell.seen)))
        return
    from inspector.extras.watch.watch_page import watch_html, watch_svg  # with plotly, which takes a while to load

    page = watch_svg(cell) if out.suffix.lower() == ".svg" else watch_html(base, cell, now=datetime.now())
    write_text_atomically(out, page)
