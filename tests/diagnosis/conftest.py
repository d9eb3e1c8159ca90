"""What several files of this room ask of one diagnosis."""

from __future__ import annotations

import pytest

from calib import diagnose
from calib.diagnosis.result import Diagnosis
from tests.support import ROOT


@pytest.fixture(scope="session")
def found() -> Diagnosis:
    """The diagnosis of a sample dataset with two hidden effects."""
    return diagnose(ROOT / "sample_data" / "hidden_effect_b")
