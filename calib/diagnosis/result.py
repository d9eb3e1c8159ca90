"""The result of a diagnosis: the findings, and the verdict that is decided from them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

from calib.brief import errors_in_short
from calib.calibration.model_versions import LINKS
from calib.calibration.result import FittedResult
from calib.diagnosis.budget import ErrorBudget, error_budget
from calib.diagnosis.contradictions import Contradiction, contradictions
from calib.diagnosis.headline import HeldOutError, held_out_beyond_noise
from calib.diagnosis.instrument_moves import InstrumentMove, instrument_moves
from calib.diagnosis.probabilities import CauseProbabilities, cause_probabilities
from calib.diagnosis.verdict import Conclusion, Findings, conclude
from calib.effects.catalogue import CATALOGUE, catalogue_names
from calib.effects.catalogue.order_steps import ScannerStep
from calib.intervention.joint_fit import JointFit, joint_fit
from calib.intervention.proof import Intervention, Proof, follows, interventions_of
from calib.lazy_modules import pd
from calib.presented import Presented


@dataclass(frozen=True, eq=False)
class Diagnosis(Presented, Findings, FittedResult):
    """Result of a diagnosis: the findings on a dataset, and the verdict.

    Poses that would tell confounded effects apart are chosen on demand: `calib.planning.discrimination.next_poses`.
    """

    @cached_property
    def conclusion(self) -> Conclusion:
        """The verdict and the standing of each effect, decided from the findings."""
        return conclude(self)

    @property
    def verdict(self) -> str:
        """Verdict on the dataset, one of `calib.diagnosis.verdict.VERDICTS`."""
        return self.conclusion.verdict

    @property
    def missing(self) -> tuple[str, ...]:
        """Effects that are claimed, in the order in which they were added."""
        return self.conclusion.missing

    @property
    def suspected(self) -> tuple[str, ...]:
        """Effects that were added but are not claimed."""
        return self.conclusion.suspected

    @property
    def ambiguous_set(self) -> tuple[str, ...]:
        """Effects between which these data cannot decide, those with one in the model first."""
        return self.conclusion.ambiguous_set

    @property
    def is_clean(self) -> bool:
        """Whether the residual is only noise and outliers, and each effect in the model leads what it is not alike."""
        if self.verdict == "ambiguous":
            return bool(self.confounded_sets) and not self.unproven and self.undecided is None
        return self.verdict in ("adequate", "named", "outliers")

    @cached_property
    def budget(self) -> ErrorBudget | None:
        """Squared error of the arm as delivered, divided between its causes; None where there is no such error."""
        return error_budget([step.calibration for step in self.steps])

    @cached_property
    def probabilities(self) -> CauseProbabilities:
        """Probability of each set of causes that remains, "something outside the catalogue" among them."""
        return cause_probabilities(self)

    @property
    def told_probabilities(self) -> CauseProbabilities | None:
        """The probabilities, where the data are not wrong themselves; else None."""
        return self.probabilities if self.data_problem is None else None

    @property
    def is_unexplained(self) -> bool:
        """Whether a part of the error has no known cause, whatever its size."""
        return self.verdict == "unexplained"

    @cached_property
    def interventions(self) -> tuple[Intervention, ...]:
        """What poses that were measured again under another condition prove; () where the data are wrong."""
        if self.data_problem is not None or self.implausible:
            return ()
        known = set(catalogue_names())
        own = tuple(c.family for c in self.candidates if c.name not in known)
        return interventions_of(self.steps[0].calibration, own)

    @property
    def proven(self) -> tuple[Proof, ...]:
        """Causes that differences of paired poses prove, without any fit of the whole."""
        return tuple(proof for one in self.interventions for proof in one.proofs)

    @property
    def instrument_moved(self) -> tuple[InstrumentMove, ...]:
        """Moves of the instrument that are claimed: between which poses, and by how much."""
        return instrument_moves(self.calibration) if ScannerStep.name in self.missing else ()

    @property
    def contradictions(self) -> tuple[Contradiction, ...]:
        """Proven causes that the fit of all poses contradicts."""
        return contradictions(self.proven, self.calibration, self.missing, self._moved_by_conditions)

    @cached_property
    def joint_fit(self) -> JointFit | None:
        """Fit of single poses and differences together, with all that is proven; None where nothing is."""
        refuted = {name for contradiction in self.contradictions for name in contradiction.instead}
        return joint_fit(self.calibration, self.interventions, refuted)

    @property
    def _moved_by_conditions(self) -> tuple[str, ...]:
        """Effects of the catalogue that the changed conditions move."""
        changed = {name for one in self.interventions for name in one.conditions}
        return tuple(kind.name for kind in CATALOGUE if follows(kind, changed))

    @property
    def held_out_beyond_noise(self) -> HeldOutError | None:
        """Error of the test poses where it exceeds that of noise alone; else None."""
        return held_out_beyond_noise(self.calibration, self.residual_tests.noise_mm)

    def to_frame(self) -> pd.DataFrame:
        """Table of the steps: effect, errors at training and test poses, sigma, p-value, log Bayes factor (margin)."""
        rows = []
        for step in self.steps:
            after = step.calibration.after
            rows.append(
                {
                    "effect": step.effect or LINKS,
                    "train_rmse_mm": after.train_rmse_mm,
                    "test_rmse_mm": after.test_rmse_mm,
                    "sigma_mm": step.calibration.sigma_mm,
                    "p_value": step.candidate.p_value if step.candidate else None,
                    "margin": step.log_bayes_factor,
                }
            )
        return pd.DataFrame(rows).astype({"p_value": float, "margin": float})  # None is NaN

    def _brief(self) -> str:
        last, first = self.calibration, self.steps[0].calibration
        named = ", ".join(self.named) or "none"
        return f"{last.dataset.name}: {self.verdict}, effects: {named}; {errors_in_short(first.before, last.after)}"
