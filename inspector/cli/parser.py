"""The command `inspector`: what it takes. What each subcommand does is in `inspector.cli.dataset_commands`.

Exit 0: done. Exit 1: done, and the answer is "not good enough". Exit 2: bad input or usage, one line on stderr.
With --json exactly one JSON object goes to stdout; progress goes to stderr.
"""

from __future__ import annotations

import argparse
import math
import os
import sys
from collections.abc import Callable, Sequence
from contextlib import nullcontext, redirect_stdout
from importlib import import_module
from pathlib import Path
from typing import Any, NoReturn

from calib.errors import CalibError
from calib.options import BUILTIN_ROBOTS, CORRECTION_KINDS, RESIDUAL_KINDS


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command; returns its exit code."""
    options = _parser().parse_args(arguments)
    options.stdout = sys.stdout
    # What else prints, such as an effect of the user's, must not mix with the one JSON object.
    aside = redirect_stdout(sys.stderr) if getattr(options, "json", False) else nullcontext()
    try:
        with aside:
            return int(options.run(options))
    except CalibError as error:
        print(f"inspector: {error}", file=sys.stderr)
        return 2
    except BrokenPipeError:  # whoever reads our output has seen enough
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except OSError as error:
        where = f"{error.filename}: " if error.filename else ""
        print(f"inspector: {where}{error.strerror or error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print("inspector: stopped", file=sys.stderr)
        return 130
    except Exception as error:
        if os.environ.get("INSPECTOR_DEBUG"):
            raise
        words = " ".join(f"{type(error).__name__}: {error}".split())
        print(
            f"inspector: internal error, {words}; INSPECTOR_DEBUG=1 shows where, please report it",
            file=sys.stderr,
        )
        return 2


class _Parser(argparse.ArgumentParser):
    """Wrong usage in one line."""

    def error(self, message: str) -> NoReturn:
        self.exit(2, f"inspector: {message}; see {self.prog} --help\n")


def _later(module: str, name: str) -> Callable[[Any], int]:
    """A subcommand's function, which is loaded once it runs: `--help` and a wrong word are answered at once."""

    def run(options: Any) -> int:
        command = getattr(import_module(f"inspector.cli.{module}"), name)
        from calib.blas_threads import one_blas_thread  # with scipy, which takes a while to load

        with one_blas_thread():
            return int(command(options))

    run.__qualname__ = f"{module}.{name}"
    return run


def _parser() -> argparse.ArgumentParser:
    parser = _Parser(
        prog="inspector",
        description="Calibrate a robot arm from scans of a three-faced jig, and see every step.",
    )
    subcommands = parser.add_subparsers(metavar="COMMAND", required=True)

    def command(name: str, run: Callable[[Any], int], help_: str, path: str = "dataset folder") -> Any:
        sub = subcommands.add_parser(name, help=help_, description=help_)
        sub.set_defaults(run=run)
        sub.add_argument("path", type=Path, metavar="PATH", help=path)
        return sub

    sub = command(
        "serve", _later("dataset_commands", "run_serve"), "the web app", "dataset folder, or a folder of them"
    )
    sub.add_argument("--host", default="127.0.0.1", help="address to bind (default: this machine only)")
    sub.add_argument("--port", type=_port, default=8080, help="default 8080; 0 takes a free one")
    sub.add_argument("--session", type=Path, metavar="FILE.json", help="open a saved session again")
    sub.add_argument(
        "--effects-file", type=Path, metavar="FILE.py", help="effects of your own, read again when it changes"
    )

    sub = command("corners", _later("dataset_commands", "run_corners"), "find the jig's corner in every scan")
    sub.add_argument("--out", type=Path, metavar="FILE", help="write the corners as points.csv")
    sub.add_argument("--orientation", action="store_true", help="with the jig's orientation in --out")
    sub.add_argument("--processes", type=_count, metavar="N", help="default: one for each core")
    _add_json(sub)

    sub = command(
        "redundancy",
        _later("dataset_commands", "run_redundancy"),
        "which parameters say the same thing (Pearson), and the true rank",
    )
    sub.add_argument("--out", type=Path, metavar="FILE.csv", help="write Pearson's r of all pairs")
    _add_residual(sub)
    _add_json(sub)

    sub = command("calibrate", _later("fit_commands", "run_calibrate"), "fit the five-parameter model")
    sub.add_argument("--out", type=Path, metavar="FILE", help="write the calibrated robot.toml")
    sub.add_argument("--force", action="store_true", help="write --out although the fit is no improvement")
    sub.add_argument(
        "--residuals",
        type=Path,
        metavar="FILE.csv",
        help="write what is left over, a row a pose with all inputs",
    )
    sub.add_argument(
        "--scene", type=Path, metavar="FILE.glb", help="write arm, points and residuals (x 100) in 3D"
    )
    sub.add_argument(
        "--session", type=Path, metavar="FILE.json", help="write a session that serve --session opens"
    )
    _add_adding(sub)
    _add_fit(sub)
    _add_json(sub)

    sub = command(
        "validate",
        _later("fit_commands", "run_validate"),
        "how good the fit is away from its poses, and whether more would help",
    )
    sub.add_argument("--folds", type=int, default=5, help="default 5")
    _add_fit(sub)
    _add_json(sub)

    sub = command(
        "correct",
        _later("fit_commands", "run_correct"),
        "joint targets that bring the real arm where the nominal one should be",
    )
    sub.add_argument(
        "--joints", type=Path, required=True, metavar="FILE", help="targets, columns as poses.csv"
    )
    sub.add_argument("--out", type=Path, required=True, metavar="FILE", help="write the corrected targets")
    sub.add_argument(
        "--what", choices=CORRECTION_KINDS, help="default: pose for six joints and more, else position"
    )
    sub.add_argument("--force", action="store_true", help="go on although the fit is no improvement")
    _add_adding(sub)
    _add_fit(sub)
    _add_json(sub)

    sub = command(
        "diagnose", _later("fit_commands", "run_diagnose"), "which physical effect is missing, step by step"
    )
    sub.add_argument(
        "--max-steps", type=int, default=3, metavar="N", help="effects to add at the most (default 3)"
    )
    _add_effects(sub)
    _add_json(sub)

    sub = command(
        "report", _later("fit_commands", "run_report"), "one self-contained HTML page to send to someone"
    )
    sub.add_argument("--out", type=Path, required=True, metavar="FILE.html", help="write the page")
    sub.add_argument("--force", action="store_true", help="replace a file that is no report")
    _add_effects(sub)
    _add_json(sub)

    sub = subcommands.add_parser(
        "effects", help="the catalogue of effects", description="the catalogue of effects"
    )
    sub.set_defaults(run=_later("dataset_commands", "run_effects"))
    _add_json(sub)

    sub = command(
        "simulate",
        _later("dataset_commands", "run_simulate"),
        "make a dataset with known truth",
        "folder to make",
    )
    sub.add_argument("--robot", required=True, help=f"{', '.join(BUILTIN_ROBOTS)}, or a robot.toml")
    sub.add_argument("--poses", type=int, default=64, help="default 64")
    sub.add_argument(
        "--effect", action="append", default=[], metavar="NAME", help="may be given several times"
    )
    sub.add_argument("--scans", action="store_true", help="cast scans of the jig instead of points")
    sub.add_argument("--seed", type=int, default=0, help="default 0")
    sub.add_argument(
        "--noise-mm", type=float, default=0.05, help="of a measured point, each axis (default 0.05)"
    )
    _add_json(sub)

    sub = command(
        "check",
        _later("dataset_commands", "run_check"),
        "the whole chain: pass or fail, and why",
        "dataset folder, or a folder of them",
    )
    sub.add_argument(
        "--max-test-rmse-mm", type=_rmse_mm, metavar="X", help="what the test poses' error may be"
    )
    _add_residual(sub)
    _add_json(sub)
    return parser


def _add_json(sub: argparse.ArgumentParser) -> None:
    sub.add_argument("--json", action="store_true", help="one JSON object on stdout, nothing else")


def _add_fit(sub: argparse.ArgumentParser) -> None:
    """What a fit is to be like: see `fit_commands.fit_options`."""
    _add_residual(sub)
    _add_effects(sub)
    sub.add_argument("--no-prior", action="store_true", help="do not hold parameters within their tolerance")
    sub.add_argument(
        "--tolerance",
        action="append",
        default=[],
        type=_named_number,
        metavar="NAME=VALUE",
        help="tolerance of one parameter, mm or rad (default 1 mm, 0.0087 rad); may be given several times",
    )
    sub.add_argument(
        "--hold", action="append", default=[], metavar="NAME", help="keep a parameter at its nominal"
    )
    sub.add_argument("--robust", action="store_true", help="let points far from the model count less")


def _add_adding(sub: argparse.ArgumentParser) -> None:
    sub.add_argument(
        "--add",
        action="append",
        default=[],
        metavar="NAME",
        help="add an effect as the ranking proposes it: only the joints that show it, as the page's button does",
    )


def _add_effects(sub: argparse.ArgumentParser) -> None:
    sub.add_argument(
        "--effect",
        action="append",
        default=[],
        metavar="NAME",
        help="put a whole effect into the model, all joints",
    )
    sub.add_argument("--effects-file", type=Path, metavar="FILE.py", help="effects of your own")


def _add_residual(sub: argparse.ArgumentParser) -> None:
    sub.add_argument("--residual", choices=RESIDUAL_KINDS, default="position", help="default position")


def _named_number(text: str) -> tuple[str, float]:
    name, _, value = text.partition("=")
    try:
        return name.strip(), float(value)
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text!r} is not NAME=VALUE, such as a1=0.5") from None


def _count(text: str) -> int:
    return _whole(text, 1, 1024, "number of processes")


def _port(text: str) -> int:
    return _whole(text, 0, 65535, "port")


def _whole(text: str, low: int, high: int, what: str) -> int:
    if not text.isdecimal() or not low <= int(text) <= high:
        raise argparse.ArgumentTypeError(f"{text} is not a {what}; {low} to {high}")
    return int(text)


def _rmse_mm(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not 0.0 < value < math.inf:
        raise argparse.ArgumentTypeError(f"{text} is not an error to ask for; a number of mm above 0")
    return value
