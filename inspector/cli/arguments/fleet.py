"""Arguments of `fleet`. Nothing slow is imported."""

from __future__ import annotations

from argparse import ArgumentParser
from pathlib import Path

from inspector.cli.arguments import values
from inspector.cli.arguments.shared import add_json


def fleet_arguments(sub: ArgumentParser) -> None:
    """Add the arguments of `fleet`: where the work runs, and where the results are written."""
    sub.add_argument(
        "--out",
        type=Path,
        default=Path("fleet.csv"),
        metavar="TABLE",
        help="write the table, .csv or .parquet; page and results lie beside it (default fleet.csv)",
    )
    sub.add_argument("--workers", type=values.process_count, metavar="N", help="default: one for each core")
    sub.add_argument("--scheduler", metavar="ADDRESS", help="a Dask cluster that runs already, such as tcp://host:8786")
    sub.add_argument(
        "--timeout",
        type=values.seconds,
        default=1800.0,
        metavar="S",
        help="seconds that one dataset may take (default 1800)",
    )
    sub.add_argument("--max-test-rmse-mm", type=values.rmse_mm, metavar="X", help="what the test poses' error may be")
    again = sub.add_mutually_exclusive_group()
    again.add_argument(
        "--resume", dest="fresh", action="store_false", help="take over results whose files have not changed (default)"
    )
    again.add_argument("--fresh", action="store_true", help="drop what is there and judge all anew")
    sub.set_defaults(fresh=False)
    add_json(sub)
