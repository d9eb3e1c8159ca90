"""The command `inspector`: reads the command line, runs one subcommand, and turns errors into exit codes.

Exit 0: done. Exit 1: done, and the answer is "not good enough". Exit 2: bad input or usage, one line on stderr.
With --json exactly one JSON object goes to stdout; progress goes to stderr.
"""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Sequence
from contextlib import nullcontext, redirect_stdout
from importlib import import_module
from pathlib import Path
from typing import NoReturn

from calib.errors import CalibError, printable
from inspector.cli.subcommands import SUBCOMMANDS, Subcommand

EXTRA_OF = {
    "open3d": "scans",
    "trimesh": "scans",
    "viser": "page",
    "websockets": "page",
    "plotly": "page",
    "PIL": "page",
    "mcp": "agent",
    "resvg_py": "agent",
}
"""The extra of pyproject.toml that brings each package which not every installation has."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command; returns its exit code."""
    given = vars(_parser().parse_args(arguments))
    subcommand: Subcommand = given.pop("subcommand")
    if given.get("residual", "") is None:
        from calib.dataset.files.folder import usual_residual_of  # where a fit needs it; --help is quick

        given["residual"] = usual_residual_of(given["path"])
    if "json" in given:
        given["stdout"] = sys.stdout
    # What else prints, such as an effect of the user's, must not mix with the one JSON object.
    aside = redirect_stdout(sys.stderr) if given.get("json") else nullcontext()
    words = ("inspector", *(sys.argv[1:] if arguments is None else arguments))
    try:
        with aside:
            return _run(subcommand, subcommand.options(**given), words)
    except CalibError as error:
        return _refused(str(error))
    except BrokenPipeError:  # the reader of our output has closed it
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except OSError as error:
        where = f"{error.filename}: " if error.filename else ""
        return _refused(f"{where}{error.strerror or error}")
    except KeyboardInterrupt:
        print("inspector: stopped", file=sys.stderr)
        return 130
    except Exception as error:
        if os.environ.get("INSPECTOR_DEBUG"):
            raise
        if isinstance(error, ModuleNotFoundError) and (error.name or "").partition(".")[0] in EXTRA_OF:
            return _without(str(error.name).partition(".")[0])
        message = " ".join(f"{type(error).__name__}: {error}".split())
        return _refused(f"internal error, {message}; INSPECTOR_DEBUG=1 shows where, please report it")


def _refused(words: str) -> int:
    """Print an error on stderr; returns the exit code for it."""
    print(f"inspector: {printable(words)}", file=sys.stderr)
    return 2


def _without(module: str) -> int:
    print(
        f"inspector: this needs {module}, which is not installed: "
        f"pip install 'robot-calibration-inspector[{EXTRA_OF[module]}]', or [all] for everything",
        file=sys.stderr,
    )
    return 2


def _run(subcommand: Subcommand, options: object, words: Sequence[str]) -> int:
    """Load the subcommand's function and call it."""
    module, _, function = subcommand.run.rpartition(".")
    run = getattr(import_module(f"inspector.cli.{module}"), function)
    from calib.blas_threads import one_blas_thread  # with scipy, which takes a while to load
    from calib.dataset.files.origin import run_command

    run_command(words)
    with one_blas_thread():
        return int(run(options))


class _Version(argparse.Action):
    """Action that prints the version, which takes long to look up and is therefore read on request only."""

    def __call__(self, parser: argparse.ArgumentParser, *_: object) -> NoReturn:
        from importlib.metadata import version

        python = ".".join(map(str, sys.version_info[:3]))
        print(f"inspector {version('robot-calibration-inspector')}, Python {python}")
        parser.exit()


class _Parser(argparse.ArgumentParser):
    """Argument parser that reports wrong usage in one line."""

    def error(self, message: str) -> NoReturn:
        self.exit(2, f"inspector: {printable(message)}; see {self.prog} --help\n")


def _parser() -> argparse.ArgumentParser:
    parser = _Parser(
        prog="inspector", description="Calibrate a robot arm from scans of a three-faced jig, and see every step."
    )
    parser.add_argument("--version", action=_Version, nargs=0, default=argparse.SUPPRESS, help="which version this is")
    subparsers = parser.add_subparsers(metavar="COMMAND", required=True)
    for subcommand in SUBCOMMANDS:
        sub = subparsers.add_parser(subcommand.name, help=subcommand.help, description=subcommand.help)
        sub.set_defaults(subcommand=subcommand)
        if subcommand.path is not None:
            sub.add_argument("path", type=Path, metavar="PATH", help=subcommand.path)
        subcommand.add_arguments(sub)
    return parser
