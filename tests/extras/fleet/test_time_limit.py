"""Work that takes too long ends, by an exception or with its process."""

from __future__ import annotations

import subprocess
import sys
import time

import pytest

from calib.extras.fleet.time_limit import OutOfTime, time_limit


def test_work_ends_by_an_exception_that_nothing_on_the_way_takes() -> None:
    def endless() -> None:
        with time_limit(0.05, end_process=False):
            while True:
                try:
                    time.sleep(0.001)
                except Exception:
                    pytest.fail("taken for its own")

    with pytest.raises(OutOfTime):
        endless()


def test_work_that_is_done_in_time_is_left_alone() -> None:
    for _ in range(20):
        with time_limit(0.2, end_process=True):
            pass
    time.sleep(0.3)


def test_a_process_that_no_longer_listens_is_ended() -> None:
    code = (
        "import time\nfrom calib.extras.fleet import time_limit as t\nt.GRACE_S = 0.05\n"
        "with t.time_limit(0.05, end_process=True): time.sleep(60)"
    )
    assert subprocess.run([sys.executable, "-c", code], check=False, timeout=30).returncode == 1
