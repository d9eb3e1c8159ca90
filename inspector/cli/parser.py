"""The command `inspector`: reads the command line, runs one subcommand, and turns errors into exit codes.

Exit 0: done. Exit 1: done, and the answer is "not good enough". Exit 2: bad input or usage, one line on stderr.
With --json exactly one JSON object goes to stdout; progress goes to stderr.
"""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Iterable, Mapping, Sequence
from contextlib import nullcontext, redirect_stdout
from dataclasses import fields, replace
from typing import Any, NoReturn

from calib.errors import CalibError, printable
from calib.plugins import load
from inspector.cli.commands import additions, commands, declarations, lacking, left_out, pip_extra_of
from inspector.cli.options.declaration import add_arguments, help_of
from inspector.plugins import Command


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command; returns its exit code."""
    words = sys.argv[1:] if arguments is None else arguments
    for line in left_out():
        print(f"inspector: warning: {printable(line)}", file=sys.stderr)
    there = commands()
    if why := lacking(words):
        return _refused(why)
    parsed = vars(parser_of(there.values()).parse_args(words))
    given: dict[str, Any] = {name: tuple(value) if isinstance(value, list) else value for name, value in parsed.items()}
    command: Command = given.pop("command")
    if given.get("residual", "") is None:
        from calib.dataset.files.folder import usual_residual_of  # where a fit needs it; --help is quick

        given["residual"] = usual_residual_of(given["path"])
    if "json" in given:
        given["stdout"] = sys.stdout
    # What else prints, such as an effect of the user's, must not mix with the one JSON object.
    aside = redirect_stdout(sys.stderr) if given.get("json") else nullcontext()
    try:
        with aside:
            return _run(command, _options(command, given), ("inspector", *words))
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
        missing = (error.name or "").partition(".")[0] if isinstance(error, ModuleNotFoundError) else ""
        if extra := pip_extra_of(missing):
            return _refused(
                f"this needs {missing}, which is not installed: "
                f"pip install 'robot-calibration-inspector[{extra}]', or [all] for everything"
            )
        message = " ".join(f"{type(error).__name__}: {error}".split())
        return _refused(f"internal error, {message}; INSPECTOR_DEBUG=1 shows where, please report it")


def _refused(words: str) -> int:
    """Print an error on stderr; returns the exit code for it."""
    print(f"inspector: {printable(words)}", file=sys.stderr)
    return 2


def _options(command: Command, given: Mapping[str, object]) -> Any:
    """The command's options, with the additions of plug-ins of which any option is given."""
    first, *further = (
        declared(**{field.name: given[field.name] for field in fields(declared) if field.name in given})
        for declared in declarations(command)
    )
    added = tuple(
        load(addition.does)(options, first)
        for addition, options in zip(additions(command), further, strict=True)
        if options != type(options)()
    )
    for one in added:
        one.begin()
    return replace(first, added=added) if added else first


def _run(command: Command, options: object, words: Sequence[str]) -> int:
    """Load the command's function and call it."""
    run = load(command.run)
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


def parser_of(there: Iterable[Command]) -> argparse.ArgumentParser:
    """Parser of a command line with one of these commands."""
    parser = _Parser(
        prog="inspector", description="Calibrate a robot arm from scans of a three-faced jig, and see every step."
    )
    parser.add_argument("--version", action=_Version, nargs=0, default=argparse.SUPPRESS, help="which version this is")
    subparsers = parser.add_subparsers(metavar="COMMAND", required=True)
    for command in there:
        options = declarations(command)
        sub = subparsers.add_parser(command.name, help=help_of(options[0]), description=help_of(options[0]))
        sub.set_defaults(command=command)
        add_arguments(sub, *options)
    return parser
