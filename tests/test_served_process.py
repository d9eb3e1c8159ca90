"""Work on visitors' files in a bounded process: results and errors come back, and it cannot take the server with it."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from calib.dataset.files.folder import load_dataset
from calib.errors import CalibError, DatasetError
from calib.served_process import within_limits
from tests.support.copies import ROOT

pytestmark = pytest.mark.slow


def take(count: int) -> int:
    """Number of bytes that were to be had."""
    return len(bytearray(count))


def crash() -> None:
    """End the process as a parser that crashes does."""
    os.abort()


def sleep_on(note: Path) -> None:
    """Tell the process's number, and go on for ever."""
    note.write_text(str(os.getpid()))
    while True:
        time.sleep(0.01)


def test_results_and_errors_are_those_of_the_function(tmp_path: Path) -> None:
    folder = ROOT / "sample_data" / "hidden_effect_a"
    assert within_limits("it", load_dataset, folder).poses.ids == load_dataset(folder).poses.ids
    with pytest.raises(DatasetError, match="no such file; a dataset folder needs"):
        within_limits("it", load_dataset, tmp_path)


def test_what_asks_for_all_memory_or_crashes_is_one_line() -> None:
    with pytest.raises(CalibError, match=r"^sheet\.xlsx: needs more than 3072 MB of memory$"):
        within_limits("sheet.xlsx", take, 10**11)
    with pytest.raises(CalibError, match=r"^sheet\.xlsx: ended its reader"):
        within_limits("sheet.xlsx", crash)
    assert within_limits("sheet.xlsx", take, 10) == 10


def test_it_ends_with_a_server_that_is_killed(tmp_path: Path) -> None:
    note = tmp_path / "note"
    program = (
        "from pathlib import Path\nfrom calib.served_process import within_limits\n"
        "from tests.test_served_process import sleep_on\n"
        f"within_limits('it', sleep_on, Path({str(note)!r}))\n"
    )
    script = tmp_path / "server.py"
    script.write_text(f"if __name__ == '__main__':\n    {program.replace(chr(10), chr(10) + '    ')}")
    with subprocess.Popen([sys.executable, script], env=os.environ | {"PYTHONPATH": str(ROOT)}) as server:
        until = time.monotonic() + 60
        while not (note.exists() and note.read_text()) and time.monotonic() < until:
            time.sleep(0.02)
        number = int(note.read_text())
        server.send_signal(signal.SIGKILL)
    while _is_running(number) and time.monotonic() < until:
        time.sleep(0.02)
    assert not _is_running(number)


def _is_running(number: int) -> bool:
    """Whether a process still does something; one that has ended may wait for init to notice."""
    try:
        return ") Z " not in Path(f"/proc/{number}/stat").read_text()
    except OSError:
        return False
