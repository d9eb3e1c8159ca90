"""The user's own effects on the page: ranked and added like any other, and read again when their file changes."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from calib.dataset.dataset import Dataset
from calib.dataset.files.folder import load_dataset
from calib.errors import CalibError
from inspector.app.app import App
from inspector.app.serving import serving
from inspector.session.session import Session
from inspector.session.user_effects import UserEffects
from inspector.session.watch import Watch
from tests.support.app import idle, idle_app, shows
from tests.support.hidden_dataset import write_hidden
from tests.support.wire_client import WireClient

FILE = """
from dataclasses import dataclass
from typing import ClassVar
import numpy as np
from calib.effects.base import Parameter

@dataclass(frozen=True)
class Ripple:
    joint: int
    name: ClassVar[str] = "ripple"
    parameters: ClassVar = (
        Parameter("sin_rad", unit="rad", scale=1e-4, doc="sine amplitude"),
        Parameter("cos_rad", unit="rad", scale=1e-4, doc="cosine amplitude"),
    )

    def apply(self, state, sin_rad, cos_rad):
        q = state.poses.q[:, self.joint]
        return state.add_joint_error(self.joint, sin_rad * np.sin(ORDER * q) + cos_rad * np.cos(ORDER * q))
"""


def written(path: Path, order: int = 3) -> Path:
    path.write_text(FILE.replace("ORDER", str(order)))
    return path


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_hidden(tmp_path_factory.mktemp("hidden"))


@pytest.fixture(scope="module")
def dataset(folder: Path) -> Dataset:
    return load_dataset(folder)


def test_a_file_is_read_once_a_version_and_an_error_keeps_the_last_good(tmp_path: Path, dataset: Dataset) -> None:
    own = UserEffects(written(tmp_path / "mine.py"))
    assert own.stale("a", ())
    first = own.families("a", dataset)
    assert [family.name for family in first] == ["ripple"]
    assert own.families("a", dataset) is first
    assert not own.stale("a", first)
    written(tmp_path / "mine.py", 11)
    assert own.stale("a", first)
    second = own.families("a", dataset)
    assert second is not first
    assert own.families("b", dataset)[0].name == "ripple"
    (tmp_path / "mine.py").write_text("def broken(:\n")
    assert own.families("a", dataset) is second
    assert "line 1" in own.problem
    assert "ripple as before" in own.problem
    assert "\n" not in own.problem
    assert not own.stale("a", second)  # until the file changes again
    (tmp_path / "mine.py").unlink()
    assert own.families("a", dataset) is second
    assert "no such effects file" in own.problem
    written(tmp_path / "mine.py")
    assert own.families("a", dataset)[0].name == "ripple"
    assert own.problem == ""


def test_without_a_file_there_is_nothing(dataset: Dataset) -> None:
    own = UserEffects()
    assert own.families("a", dataset) == ()
    assert not own.stale("a", ())


def test_the_watch_tells_of_each_change_and_ends(tmp_path: Path) -> None:
    changed = threading.Event()
    own = UserEffects(written(tmp_path / "mine.py"))
    watch = Watch(lambda: own.version, changed.set)
    written(tmp_path / "mine.py", 12)
    assert changed.wait(20)
    watch.stop()


# ---- on the page ----------------------------------------------------------------------------------------------------


@pytest.fixture
def served(folder: Path, tmp_path: Path) -> Iterator[tuple[App, Path]]:
    path = written(tmp_path / "mine.py")
    with idle_app(folder, effects_file=path) as app:
        yield app, path


def session(app: App) -> Session:
    return app.state.now.session


@pytest.mark.thorough
def test_a_changed_file_is_taken_and_a_broken_one_told_in_a_line(served: tuple[App, Path]) -> None:
    app, path = served
    with WireClient(app.server.get_port()) as page:
        page.set("Effect", "ripple")
        page.click("Add to the model")
        shows(page, "calibrated links + ripple")
        idle(app)
        fitted = session(app).calibration
        path.write_text("import numppy\n")
        shows(page, "No module named 'numppy'; ripple as before")
        idle(app)
        assert session(app).calibration is fitted
        written(path, 9)
        page.wait(lambda p: "numppy" not in p.text(), 60)
        shows(page, "own effects read again")
        idle(app)
        again = session(app).calibration
        assert again.after.train.rmse_mm != pytest.approx(fitted.after.train.rmse_mm, rel=1e-3)
        assert np.isfinite(again.after.train.rmse_mm)
        path.write_text(FILE.replace("ORDER", "3").replace('"ripple"', '"wave"'))  # the old one is gone
        page.wait(lambda p: "wave" in p.props("Effect")["options"], 60)
        idle(app)
        assert session(app).effects == ()
        assert not page.notifications


def test_a_file_that_is_not_there_is_one_clear_error(folder: Path, tmp_path: Path) -> None:
    with (
        pytest.raises(CalibError, match="no such effects file"),
        serving(folder, port=0, effects_file=tmp_path / "none.py"),
    ):
        pass
