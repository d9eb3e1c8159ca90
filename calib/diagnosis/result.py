"""The result of a diagnosis: what was found, with the explanation in words."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import pandas as pd

from calib.calibration.result import FittedResult
from calib.diagnosis.effect_selection import GEOMETRY
from calib.diagnosis.explanation import explain
from calib.diagnosis.findings import Findings
from calib.diagnosis.words.sentences import Explanation
from calib.diagnosis.words.text import explanation_text
from calib.display.brief import Brief, errors_in_short
from calib.display.shown import Documented, Viewed


@dataclass(frozen=True)
class Diagnosis(Brief, Findings, FittedResult, Documented, Viewed):
    """The verdict on a dataset, all that led to it, and why."""

    @cached_property
    def explanation(self) -> Explanation:
        """Why this verdict was reached, as sentences with their numbers."""
        return explain(self)

    def summary(self) -> str:
        """The explanation in words: several short paragraphs, the verdict last."""
        return explanation_text(self.explanation)

    def to_frame(self) -> pd.DataFrame:
        """The steps: effect, errors on training and test poses, residual sigma."""
        rows = []
        for step in self.steps:
            after = step.calibration.after
            rows.append(
                {
                    "effect": step.effect or GEOMETRY,
                    "train_rmse_mm": after.train.rmse_mm if after.train else float("nan"),
                    "test_rmse_mm": after.test.rmse_mm if after.test else float("nan"),
                    "sigma_mm": step.calibration.sigma_mm,
                    "p_value": step.candidate.p_value if step.candidate else None,
                    "margin": step.log_evidence_margin,
                }
            )
        return pd.DataFrame(rows).astype({"p_value": float, "margin": float})  # None is NaN

    def _brief(self) -> str:
        last, first = self.calibration, self.steps[0].calibration
        named = ", ".join(self.named) or "none"
        return f"{last.dataset.name}: {self.verdict}, effects: {named}; {errors_in_short(first.before, last.after)}"
