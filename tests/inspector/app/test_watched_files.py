"""The page follows its files: a changed dataset.toml is read again, a new folder is listed, without a restart."""

from __future__ import annotations

import shutil
import time
from collections.abc import Callable
from pathlib import Path

from tests.support.app import IDLE_S, idle_app
from tests.support.hidden_dataset import write_hidden


def waits_for(is_so: Callable[[], bool]) -> bool:
    end = time.monotonic() + IDLE_S
    while not is_so() and time.monotonic() < end:
        time.sleep(0.1)
    return is_so()


def test_a_changed_dataset_is_read_again_and_a_new_one_listed(tmp_path: Path) -> None:
    folder = write_hidden(tmp_path / "served" / "first")
    with idle_app(folder.parent) as app:
        described = folder / "dataset.toml"
        described.write_text('description = "measured again"\n' + described.read_text())
        assert waits_for(lambda: app.state.session.dataset.description == "measured again")
        shutil.copytree(folder, folder.with_name("second"))
        assert waits_for(lambda: "second" in app.panels.review.dataset.options)
