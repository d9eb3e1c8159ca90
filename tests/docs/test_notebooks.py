"""The notebook is run cell by cell: the error falls, nothing warns; and what its cells show becomes a page."""

from __future__ import annotations

import json
import sys
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.support import ROOT

interactiveshell = pytest.importorskip("IPython.core.interactiveshell")
capture = pytest.importorskip("IPython.utils.capture")
traitlets = pytest.importorskip("traitlets.config")

NOTEBOOK = ROOT / "docs" / "notebooks" / "diagnose.ipynb"


def cells(kind: str) -> list[dict[str, Any]]:
    return [cell for cell in json.loads(NOTEBOOK.read_text("utf-8"))["cells"] if cell["cell_type"] == kind]


@pytest.fixture
def shell(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Any]:
    """A shell in an empty folder that has the sample data."""
    (tmp_path / "sample_data").symlink_to(ROOT / "sample_data")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("IPYTHONDIR", str(tmp_path / "ipython"))
    monkeypatch.setenv("PLOTLY_RENDERER", "plotly_mimetype")
    hook, modules = sys.displayhook, dict(sys.modules)
    shell = interactiveshell.InteractiveShell(config=traitlets.Config({"HistoryManager": {"enabled": False}}))
    yield shell
    sys.displayhook = hook
    sys.modules["__main__"] = modules["__main__"]


def test_it_has_ten_cells_and_is_stored_without_outputs() -> None:
    code = cells("code")
    assert len(code) == 10
    assert all(cell["outputs"] == [] and cell["execution_count"] is None for cell in code)
    told = ["".join(cell["source"]) for cell in cells("markdown")]
    assert [text.splitlines()[0].split(".")[0] for text in told[1:-1]] == [f"## {k}" for k in range(1, 11)]


@pytest.mark.thorough  # each build of the documentation runs the cells too, and fails where one does or warns
def test_every_cell_runs_without_a_warning_and_the_error_falls(shell: Any, tmp_path: Path) -> None:
    for cell in cells("code"):
        with warnings.catch_warnings(), capture.capture_output() as said:
            warnings.simplefilter("error")
            done = shell.run_cell("".join(cell["source"]))
        assert done.success, cell["id"]
        assert said.stderr == "", cell["id"]
        assert said.stdout or said.outputs, f"cell {cell['id']} shows nothing"
    left = shell.user_ns
    errors = [step.calibration.after.test.rmse_mm for step in left["steps"]]
    errors.insert(0, left["calibration"].before.test.rmse_mm)
    assert all(np.diff(errors) < 0.0), errors
    # The folder's truth: compliance and backlash (tests/truth). Noise alone leaves sqrt(3) of a coordinate's.
    assert errors[-1] < 1.5 * np.sqrt(3.0) * left["dataset"].scanner.point_sigma_mm
    truth = json.loads((ROOT / "tests" / "truth" / "hidden_effect_b.json").read_text("utf-8"))
    assert set(left["found"].missing) == set(truth["effects"])
    assert left["correction"].reached.all()
    assert left["correction"].position_error_mm.max() < 1e-6
    assert (tmp_path / "model.json").is_file()
