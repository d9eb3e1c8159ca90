"""The commands `fleet` (many datasets diagnosed, as a table and a page) and `pool` (what arms of a type share)."""

from __future__ import annotations

import sys
from contextlib import AbstractContextManager
from datetime import datetime

from calib.dataset.files.atomic_write import write_bytes_atomically, write_text_atomically
from calib.errors import CalibError, visible
from calib.extras.fleet.arm_type import type_report
from calib.extras.fleet.discovery import discover
from calib.extras.fleet.run import run_fleet
from calib.extras.fleet.table import is_table, require_table_kind, table_bytes
from calib.extras.fleet.type_file import save_type
from calib.extras.fleet.workers import Workers, cluster_workers, local_workers
from calib.options import FitOptions
from inspector.cli.dataset_commands import load, measured, show
from inspector.cli.output_paths import check_outputs
from inspector.cli.progress import cores, progress
from inspector.extras.fleet.fleet_page import fleet_html
from inspector.extras.fleet.options import FleetOptions, PoolOptions
from inspector.report.report import is_report

RESULTS, PAGE = ".results", ".html"  # suffixes beside the table


def run_fleet_command(options: FleetOptions) -> int:
    """Diagnose every dataset; exit code 1 where one has no result or does not pass."""
    out, page = options.out, options.out.with_suffix(PAGE)
    results = out.with_suffix(RESULTS)
    require_table_kind(out.suffix)
    if out.exists() and not is_table(out):
        raise CalibError(f"{out}: exists and is no table of a fleet; name another file")
    if page.exists() and not is_report(page):
        raise CalibError(f"{page}: exists and is no page of ours; name another table, the page lies beside it")
    found = discover(options.path)
    try:
        with _workers(options, len(found.datasets)) as workers, progress("datasets", "dataset") as on_progress:
            fleet = run_fleet(found, results, workers, on_progress=on_progress)
    except KeyboardInterrupt:
        print(visible(f"inspector: stopped; the same command goes on from what is in {results}"), file=sys.stderr)
        return 130
    write_bytes_atomically(out, table_bytes(fleet.rows, out.suffix))
    write_text_atomically(page, fleet_html(fleet, page, now=datetime.now()))
    document = fleet.to_dict() | {"table": str(out), "page": str(page), "results": str(results)}
    show(options, document, f"{fleet.summary()}\n{out}, {page}: the table and the page")
    return 0 if (not fleet.failures and all(row.passed for row in fleet.rows)) else 1


def run_pool(options: PoolOptions) -> int:
    """Learn what arms of a type share, and try it on each arm, left out in turn."""
    datasets = [load(path) for path in (options.path, *options.others)]
    for dataset in datasets:
        check_outputs(dataset, [options.out])
    datasets = [measured(dataset) for dataset in datasets]
    asked = FitOptions(residual=options.residual)
    report = type_report(datasets, asked, effects=options.effect, poses=options.poses)
    if options.out is not None:
        save_type(report.arm_type, options.out)
    show(options, report.to_dict(), report.summary())
    return 0


def _workers(options: FleetOptions, datasets: int) -> AbstractContextManager[Workers]:
    if options.scheduler is not None:
        if options.workers is not None:
            raise CalibError("--workers is of this machine; a cluster of --scheduler has its own")
        return cluster_workers(options.scheduler, options.path, options.timeout)
    return local_workers(min(options.workers or cores(), max(datasets, 1)), options.timeout)
