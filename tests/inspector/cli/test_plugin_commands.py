"""Commands and options that plug-ins bring, and what is said of those that are not there."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from types import ModuleType

import pytest

from inspector import plugins
from inspector.cli import commands as of_commands
from inspector.cli.parser import main
from inspector.plugins import Command, CommandOptions, PipExtra
from tests.support.commands import printed, refused

SAMPLE = Path(__file__).parents[3] / "sample_data" / "hidden_effect_a"
MODULE = '''
from dataclasses import dataclass
from pathlib import Path

from calib.errors import CalibError
from inspector.cli.additions import CalibrateAddition
from inspector.cli.options.declaration import argument, option
from inspector.cli.options.shared import Output


@dataclass(frozen=True, kw_only=True)
class HelloOptions(Output):
    """Say hello."""

    name: str = argument("to whom", metavar="NAME")


def run_hello(options):
    print(f"Hello, {options.name}.")
    return 1


def run_without(options):
    import no_such_package


@dataclass(frozen=True, kw_only=True)
class NoteOptions:
    """A note beside the model."""

    note: Path | None = option("write a note", metavar="FILE")


class Note(CalibrateAddition):
    def outputs(self):
        return [self.asked.note]

    def files(self, fit):
        return {self.asked.note: f"{fit.dataset.name}, {self.command.residual}"}

    def told(self, fit):
        return {"note": str(self.asked.note)}, "A note was written."
'''


@pytest.fixture
def brings(monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[..., None]]:
    """Function that makes contributions those of the only plug-in, whose module is `elsewhere`."""
    module = ModuleType("elsewhere")
    monkeypatch.setitem(sys.modules, "elsewhere", module)
    exec(MODULE, module.__dict__)
    of_commands._readable.cache_clear()

    def bring(*found: object) -> None:
        monkeypatch.setattr(
            plugins, "contributions", lambda kind: tuple(each for each in found if isinstance(each, kind))
        )

    yield bring
    of_commands._readable.cache_clear()


def test_a_command_of_a_plug_in_stands_in_its_place_and_runs(brings: Callable[..., None]) -> None:
    brings(Command("hello", "elsewhere:HelloOptions", "elsewhere:run_hello", after="repeat"))
    names = list(of_commands.commands())
    assert names[names.index("repeat") + 1] == "hello"
    assert printed("hello", "World", code=1) == "Hello, World.\n"


def test_a_package_that_a_plug_in_needs_is_named_with_what_installs_it(brings: Callable[..., None]) -> None:
    brings(
        Command("hello", "elsewhere:HelloOptions", "elsewhere:run_without"),
        PipExtra("greetings", ("no_such_package",)),
    )
    assert "pip install 'robot-calibration-inspector[greetings]'" in refused("hello", "World")


def test_options_of_a_plug_in_are_asked_where_one_is_given(brings: Callable[..., None], tmp_path: Path) -> None:
    brings(CommandOptions("calibrate", "elsewhere:NoteOptions", "elsewhere:Note"))
    assert "note" not in printed("calibrate", SAMPLE)
    assert printed("calibrate", SAMPLE, "--note", tmp_path / "note.txt").endswith("A note was written.\n")
    assert (tmp_path / "note.txt").read_text().endswith(", position")
    assert main(["calibrate", str(SAMPLE), "--note", str(SAMPLE / "robot.toml")]) == 2


def test_options_that_cannot_be_imported_are_named_and_all_else_works(
    capsys: pytest.CaptureFixture[str], brings: Callable[..., None]
) -> None:
    brings(
        Command("hello", "elsewhere:NoSuchOptions", "elsewhere:run_hello"),
        CommandOptions("calibrate", "no_such_module:X", "elsewhere:Note"),
    )
    assert main(["effects"]) == 0
    first, second = capsys.readouterr().err.splitlines()
    assert "elsewhere:NoSuchOptions cannot be imported and are left out" in first
    assert "no_such_module:X" in second


def test_what_is_of_an_extra_that_is_not_there_is_answered_by_its_name(
    capsys: pytest.CaptureFixture[str], brings: Callable[..., None]
) -> None:
    brings()
    for name, extra in of_commands.EXTRA_OF.items():
        assert main(["calibrate", name, "x"] if name.startswith("--") else [name, "--help"]) == 2
        (line,) = capsys.readouterr().err.splitlines()
        assert line.startswith(f"inspector: {name} is of the extra {extra}, which is not here")
    assert not {*of_commands.EXTRA_OF} & {*of_commands.commands()}
    assert of_commands.lacking(["plan", "a", "--for", "watch"]) == ""  # a value, no command
