"""Subcommands with their arguments. Nothing slow is imported, so that `--help` and wrong words are answered at once."""

from __future__ import annotations

from argparse import ArgumentParser
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from calib.options import BUILTIN_ROBOTS, RESIDUAL_KINDS
from inspector.cli import options
from inspector.cli.arguments import values
from inspector.cli.arguments.fit import (
    calibrate_arguments,
    compare_arguments,
    correct_arguments,
    pool_arguments,
    repeat_arguments,
    validate_arguments,
    verify_arguments,
    watch_arguments,
)
from inspector.cli.arguments.fleet import fleet_arguments
from inspector.cli.arguments.plan import plan_arguments
from inspector.cli.arguments.shared import (
    add_finder,
    add_fit,
    add_json,
    add_learned_out,
    add_leave_out,
    add_model_out,
    add_residual,
    convert_arguments,
    import_arguments,
)

A_DATASET = "dataset folder"
DATASETS = "dataset folder, or a folder of them"


@dataclass(frozen=True)
class Subcommand:
    """Name, help text, arguments and function of a subcommand."""

    name: str
    run: str  # "module.function" in `inspector.cli`; loaded when it runs
    options: type  # a dataclass of `inspector.cli.options`: what the function takes, a field an argument
    add_arguments: Callable[[ArgumentParser], None]
    help: str
    path: str | None = A_DATASET  # help of the argument PATH; None: the command takes none


def _serve(sub: ArgumentParser) -> None:
    sub.add_argument("--host", default="127.0.0.1", help="address to bind (default: this machine only)")
    sub.add_argument("--port", type=values.port, default=8080, help="default 8080; 0 takes a free one")
    sub.add_argument("--session", type=Path, metavar="FILE.json", help="open a saved session again")
    sub.add_argument(
        "--data", type=Path, metavar="DIR", help="let pages import datasets to this folder, and list those in it"
    )
    sub.add_argument(
        "--effects-file", type=Path, metavar="FILE.py", help="effects of your own, read again when it changes"
    )


def _corners(sub: ArgumentParser) -> None:
    sub.add_argument("--out", type=Path, metavar="FILE", help="write the corners as points.csv")
    sub.add_argument("--orientation", action="store_true", help="with the jig's orientation in --out")
    sub.add_argument("--processes", type=values.process_count, metavar="N", help="default: one for each core")
    add_finder(sub)
    add_json(sub)


def _redundancy(sub: ArgumentParser) -> None:
    sub.add_argument("--out", type=Path, metavar="FILE.csv", help="write Pearson's r of all pairs")
    add_residual(sub)
    add_leave_out(sub)
    add_json(sub)


def _diagnose(sub: ArgumentParser) -> None:
    sub.add_argument("--max-steps", type=int, default=3, metavar="N", help="effects to add at the most (default 3)")
    add_learned_out(sub)
    add_model_out(sub)
    sub.add_argument("--force", action="store_true", help="write although the fit is no improvement")
    add_fit(sub)
    add_json(sub)


def _report(sub: ArgumentParser) -> None:
    sub.add_argument("--out", type=Path, required=True, metavar="FILE", help="write the page; FILE.pdf: its print")
    sub.add_argument("--pdf", type=Path, metavar="FILE.pdf", help="print it, too (by an installed Chromium or Chrome)")
    sub.add_argument("--force", action="store_true", help="replace a file that is no report")
    add_fit(sub)
    add_json(sub)


def _figures(sub: ArgumentParser) -> None:
    sub.add_argument("--out", type=Path, metavar="FOLDER", help="write them, a file each; without it they are listed")
    sub.add_argument("--name", action="append", default=[], metavar="NAME", help="this one only; several times")
    sub.add_argument("--png", action="store_true", help="as PNG instead of SVG (the extra `agent`)")
    add_fit(sub)
    add_json(sub)


def _mcp(sub: ArgumentParser) -> None:
    sub.add_argument(
        "--root",
        type=Path,
        action="append",
        default=[],
        metavar="FOLDER",
        help="what may be read and written, with all in it (default: the working folder); several times",
    )
    sub.add_argument(
        "--allow-code",
        action="store_true",
        help="offer options that run a Python file: effects and finders of one's own",
    )
    sub.add_argument(
        "--timeout-s", type=values.seconds, default=600.0, metavar="S", help="end a call after this (default 600)"
    )


def _sample(sub: ArgumentParser) -> None:
    sub.add_argument("name", nargs="?", metavar="NAME", help="the sample to write; without it they are listed")
    sub.add_argument("--out", type=Path, metavar="FOLDER", help="where to (default: a folder of its name)")
    add_json(sub)


def _jig(sub: ArgumentParser) -> None:
    sub.add_argument("part", choices=("plate", "corner", "stem"), help="sockets for a ball, three faces, a ball's stem")
    sub.add_argument("--out", type=Path, metavar="FILE.stl", help="default: a file of the part's name")
    sub.add_argument(
        "--sockets", type=values.grid, default=(2, 2), metavar="NxM", help="columns and rows of a plate (default: 2x2)"
    )
    sub.add_argument(
        "--pitch-mm", type=values.size_mm, default=100.0, metavar="MM", help="between sockets (default: 100)"
    )
    sub.add_argument("--ball-mm", type=values.size_mm, default=20.0, metavar="MM", help="ball's diameter (default: 20)")
    sub.add_argument(
        "--edge-mm", type=values.size_mm, default=60.0, metavar="MM", help="edges of the corner (default: 60)"
    )
    sub.add_argument(
        "--length-mm", type=values.size_mm, default=80.0, metavar="MM", help="flange to the ball's centre (default: 80)"
    )
    sub.add_argument("--bolts", default="50-4-M6", metavar="D-N-M", help="bolt circle by ISO 9409-1 (default: 50-4-M6)")
    add_json(sub)


def _simulate(sub: ArgumentParser) -> None:
    sub.add_argument("--robot", required=True, help=f"{', '.join(BUILTIN_ROBOTS)}, or a robot.toml")
    sub.add_argument("--poses", type=int, default=64, help="default 64")
    sub.add_argument("--effect", action="append", default=[], metavar="NAME", help="may be given several times")
    sub.add_argument("--scans", action="store_true", help="cast scans of the jig instead of points")
    noise = sub.add_mutually_exclusive_group()
    noise.add_argument(
        "--smooth-noise-mm",
        type=float,
        metavar="X",
        help="of a scan point, along its ray: the error that it shares with its neighbours (default 0.06)",
    )
    noise.add_argument(
        "--white", action="store_true", help="scans whose points have an error each for itself, of 0.02 mm"
    )
    sub.add_argument(
        "--correlation-mm",
        type=float,
        metavar="L",
        help="how far the smooth error reaches across the view (default 25)",
    )
    sub.add_argument(
        "--mount",
        choices=("room", "flange"),
        default="room",
        help="where the scanner is; on the flange it sees a jig that stands in the room (default room)",
    )
    sub.add_argument("--seed", type=int, default=0, help="default 0")
    sub.add_argument("--noise-mm", type=float, default=0.05, help="of a measured point, each axis (default 0.05)")
    add_json(sub)


def _follow(sub: ArgumentParser) -> None:
    sub.add_argument(
        "--tolerance-mm", type=values.rmse_mm, metavar="X", help="enough is where the predicted error is within this"
    )
    sub.add_argument("--once", action="store_true", help="end when all that is there was judged, do not wait for more")
    sub.add_argument("--until-enough", action="store_true", help="end when more poses no longer pay")
    sub.add_argument(
        "--residual",
        choices=[kind for kind in RESIDUAL_KINDS if kind not in ("pose", "distance")],
        default="position",
        help="as of calibrate (position)",
    )
    sub.add_argument("--json", action="store_true", help="a JSON object for each pose, a line each, on stdout")


def _check(sub: ArgumentParser) -> None:
    sub.add_argument("--max-test-rmse-mm", type=values.rmse_mm, metavar="X", help="what the test poses' error may be")
    add_fit(sub)
    add_json(sub)


SUBCOMMANDS = (
    Subcommand("serve", "dataset_commands.run_serve", options.ServeOptions, _serve, "the web app", path=DATASETS),
    Subcommand(
        "corners",
        "dataset_commands.run_corners",
        options.CornersOptions,
        _corners,
        "find the jig's corner in every scan",
    ),
    Subcommand(
        "redundancy",
        "dataset_commands.run_redundancy",
        options.RedundancyOptions,
        _redundancy,
        "which parameters cannot be told apart (Pearson's r), and the rank of the model",
    ),
    Subcommand(
        "calibrate",
        "calibrate_command.run_calibrate",
        options.CalibrateOptions,
        calibrate_arguments,
        "fit the five-parameter model",
    ),
    Subcommand(
        "validate",
        "fit_commands.run_validate",
        options.ValidateOptions,
        validate_arguments,
        "how good the fit is away from its poses, and whether more would help",
    ),
    Subcommand(
        "correct",
        "correct_command.run_correct",
        options.CorrectOptions,
        correct_arguments,
        "joint targets that bring the real arm where the nominal one should be",
    ),
    Subcommand(
        "diagnose",
        "fit_commands.run_diagnose",
        options.DiagnoseOptions,
        _diagnose,
        "which physical effect is missing, step by step",
    ),
    Subcommand(
        "compare",
        "compare_command.run_compare",
        options.CompareOptions,
        compare_arguments,
        "what differs between two calibrations: before and after a repair, or two arms of a type",
    ),
    Subcommand(
        "repeat",
        "compare_command.run_repeat",
        options.RepeatOptions,
        repeat_arguments,
        "which causes come back in several recordings of one arm, and whether their sizes agree",
        path="dataset folder of the first recording",
    ),
    Subcommand(
        "verify",
        "dataset_commands.run_verify",
        options.VerifyOptions,
        verify_arguments,
        "whether models, sessions and reports were made of exactly a dataset's files; when, by whom and how",
    ),
    Subcommand(
        "pool",
        "fleet_command.run_pool",
        options.PoolOptions,
        pool_arguments,
        "what arms of a type share, from which a new one begins with few poses",
        path="dataset folder of the first arm",
    ),
    Subcommand(
        "watch",
        "compare_command.run_watch",
        options.WatchOptions,
        watch_arguments,
        "what changed in a cell since a calibration, by a few check poses",
        path="dataset folder of the earlier calibration",
    ),
    Subcommand(
        "follow",
        "follow_command.run_follow",
        options.FollowOptions,
        _follow,
        "a campaign while it is measured: each pose judged as it arrives, the error predicted, the next pose named",
        path="dataset folder that is being filled: points.csv grows, or scans arrive",
    ),
    Subcommand(
        "plan",
        "planning.plan_command.run_plan",
        options.PlanOptions,
        plan_arguments,
        "which poses to measure, and the error that they will leave",
        path="dataset folder, or a robot: a file of any form, rb5 or panda",
    ),
    Subcommand(
        "report",
        "fit_commands.run_report",
        options.ReportOptions,
        _report,
        "one self-contained HTML page to send to someone",
    ),
    Subcommand(
        "figures",
        "fit_commands.run_figures",
        options.FiguresOptions,
        _figures,
        "the figures of a diagnosis as files, for a paper or a slide",
    ),
    Subcommand(
        "effects", "dataset_commands.run_effects", options.Output, add_json, "the catalogue of effects", path=None
    ),
    Subcommand(
        "sample",
        "robots.sample_command.run_sample",
        options.SampleOptions,
        _sample,
        "a sample dataset to try things on",
        path=None,
    ),
    Subcommand(
        "jig",
        "robots.jig_command.run_jig",
        options.JigOptions,
        _jig,
        "parts to print for measuring: sockets for a ball, a three-faced corner",
        path=None,
    ),
    Subcommand(
        "simulate",
        "robots.simulate_command.run_simulate",
        options.SimulateOptions,
        _simulate,
        "make a dataset with known truth",
        path="folder to make",
    ),
    Subcommand(
        "check",
        "fit_commands.run_check",
        options.CheckOptions,
        _check,
        "the whole chain: pass or fail, and why",
        path=DATASETS,
    ),
    Subcommand(
        "fleet",
        "fleet_command.run_fleet_command",
        options.FleetOptions,
        fleet_arguments,
        "hundreds of datasets: a table and a page of which arms drifted and which causes they share",
        path="folder with datasets, however deep",
    ),
    Subcommand(
        "convert",
        "robots.convert_command.run_convert",
        options.ConvertOptions,
        convert_arguments,
        "a robot from one form into another: URDF, robot.toml, YAML, tables",
        path=None,
    ),
    Subcommand(
        "import",
        "robots.import_command.run_import",
        options.ImportOptions,
        import_arguments,
        "a dataset folder from a robot, joint values and measured points, or from a zip of them",
        path="folder to make",
    ),
    Subcommand(
        "mcp",
        "agent.server.run_mcp",
        options.McpOptions,
        _mcp,
        "these commands as tools of the Model Context Protocol, on stdin and stdout",
        path=None,
    ),
)
