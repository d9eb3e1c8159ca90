"""A session: one dataset and all results obtained from it, as a frozen value."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np

from calib.calibration.model_versions import LINKS, NOMINAL, Version
from calib.calibration.pose_errors import PoseErrors
from calib.calibration.result import Calibration
from calib.corners.search import CornerSearch
from calib.dataset.dataset import Dataset
from calib.dataset.repeats import in_repeat_groups_of
from calib.diagnosis.advice import Advice
from calib.diagnosis.budget import ErrorBudget, error_budget
from calib.diagnosis.decision_rules import ranking_given_curves
from calib.diagnosis.effect_selection import FitStep, SelectedEffect
from calib.diagnosis.headline import Headline, headline_of
from calib.diagnosis.moves import AddCurves
from calib.diagnosis.result import Diagnosis
from calib.effects.effect import Family
from calib.identifiability.redundancy import Redundancy
from calib.measurement.face_labels import FaceLabels
from calib.measurement.measured_points import with_corners
from calib.planning.discrimination import NextPoses
from calib.screening.candidates import Screening
from calib.screening.curves.joint_curves import LearnedCurves
from calib.screening.residual_tests import ResidualTests

LEFT_OUT, TAKEN_IN = "− pose ", "+ pose "  # labels of steps, before the pose's id


@dataclass(frozen=True)
class StepErrors:
    """Errors of one model of the session's history."""

    label: str  # what was changed: "as delivered", "calibrated links", "+ backlash"
    train_rmse_mm: float  # 3D
    test_rmse_mm: float  # 3D; nan without test poses
    sigma_mm: float  # of a residual's coordinate; nan without a degree of freedom left, and for the nominal robot

    @property
    def other_poses(self) -> bool:
        """Whether this step changed which poses are used."""
        return self.label.startswith((LEFT_OUT, TAKEN_IN))


@dataclass(frozen=True)
class Session:
    """All results known for one dataset; a new corner drops the calibration, which is then out of date."""

    dataset: Dataset
    searches: Mapping[str, CornerSearch] = field(default_factory=dict)  # by pose id
    face_labels: FaceLabels | None = None  # which face of the jig is which there, once that was asked for
    redundancy: Redundancy | None = None
    calibration: Calibration | None = None
    effects: tuple[SelectedEffect, ...] = ()  # beyond the link errors
    screening: Screening | None = None  # of everything not in this calibration's model
    pose_errors: PoseErrors | None = None  # where the calibration is off; known with the screening
    residual_tests: ResidualTests | None = None  # known soon after the screening
    advice: Advice | None = None  # the move that leads on from this model; known with the residual tests
    diagnosis: Diagnosis | None = None  # the verdict on this model, where no move leads on
    next_poses: NextPoses | None = None  # that would tell apart what the diagnosis leaves open; known with it
    searched: bool = False  # whether the automatic search led to this model
    dropped: frozenset[str] = frozenset()  # effects taken out because others explain what they do
    steps: tuple[FitStep, ...] = ()  # the link errors, then each change of the model
    user_effects: tuple[Family, ...] = ()  # the user's effects beyond the catalogue
    versions: tuple[Version, ...] = ()  # of this calibration's model, side by side, once that was asked for
    left_out: tuple[str, ...] = ()  # ids of poses that count for nothing, as asked

    @property
    def counted(self) -> Dataset:
        """Dataset without the points of poses that are left out on request."""
        return self.dataset.leave_out(self.left_out) if self.left_out else self.dataset

    @property
    def asked_out(self) -> tuple[str, ...]:
        """Ids of all poses that are left out on request, in the session or when the dataset was loaded."""
        return tuple(dict.fromkeys((*self.dataset.left_out, *self.left_out)))

    @property
    def uncounted(self) -> frozenset[str]:
        """Ids of poses that no fit or test uses: left out on request, or found to be outliers."""
        found = self.calibration.fitted_dataset.left_out if self.calibration is not None else ()
        return frozenset((*self.asked_out, *found))

    @property
    def history(self) -> tuple[StepErrors, ...]:
        """Errors of the nominal robot, then of the model after each step; () before the first fit."""
        return (_nominal(self.steps[-1].calibration), *map(_errors_after, self.steps)) if self.steps else ()

    @property
    def headline(self) -> Headline | None:
        """Errors from the nominal arm to the model on show, and the noise; None before the first fit."""
        return headline_of([step.calibration for step in self.steps]) if self.steps else None

    @cached_property
    def budget(self) -> ErrorBudget | None:
        """Squared error of the nominal arm, divided between the causes in the model on show; None before a fit."""
        return error_budget([step.calibration for step in self.steps]) if self.steps else None

    @property
    def curves(self) -> LearnedCurves | None:
        """Learned curves of joints that may be added where no effect of the catalogue explains the residual."""
        move = self.advice.move if self.advice is not None else None
        return move.curves if isinstance(move, AddCurves) else None

    @property
    def left_to_curves(self) -> tuple[str, ...]:
        """Names of effects of single places for which learned curves have clearly more evidence; known with the advice.

        The search passes over these, however high they rank.
        """
        judged = self.advice is not None or self.diagnosis is not None
        screening = self.screening
        ranked = screening.candidates if screening is not None and judged else ()
        if screening is None or not ranked or not ranked[0].family.sparse:
            return ()
        kept = ranking_given_curves(screening, self.steps[-1].curves).candidates
        return tuple(c.name for c in ranked if c not in kept)

    @property
    def links_alone(self) -> Calibration | None:
        """Fit of the link errors alone, taken from the model's versions or from the first step."""
        of_versions = next((v.calibration for v in self.versions if v.name == LINKS), None)
        first = self.steps[0].calibration if self.steps else None
        return of_versions or (None if first is None or first.model.added_effects else first)

    @property
    def measured(self) -> Dataset:
        """Dataset with the points available for a fit: from points.csv, else the corners found so far."""
        return self.measured_for(self.calibration.residual if self.calibration is not None else "position")

    def measured_for(self, residual: str) -> Dataset:
        """Dataset with points as a fit of this residual requires; orientations only for full poses."""
        counted = self.counted
        if counted.points is not None:
            return counted
        names = self.face_labels if residual == "pose" else None
        return with_corners(counted, self.searches, orientation=names or False)

    @property
    def unlabelled(self) -> bool:
        """Whether a fit of full poses has to wait until the jig's faces are labelled in the corners found so far."""
        return self.dataset.points is None and self.face_labels is None and self.dataset.shows_faces

    @property
    def waiting(self) -> tuple[int, ...]:
        """Poses whose scan has not been searched yet."""
        if self.dataset.scan_folder is None:
            return ()
        return tuple(i for i, pose_id in enumerate(self.dataset.poses.ids) if pose_id not in self.searches)

    @property
    def needed(self) -> tuple[int, ...]:
        """Poses whose point has to come from their scan, and whose scan has not been searched yet."""
        return self.waiting if self.dataset.points is None else ()

    @property
    def is_measured(self) -> bool:
        """Whether all scans that are needed are searched, and a point is known at any pose."""
        found = self.dataset.points is not None or any(not search.failure for search in self.searches.values())
        return found and not self.needed

    @property
    def scans(self) -> int:
        """Number of poses that have a scan."""
        return 0 if self.dataset.scan_folder is None else len(self.dataset.poses)


def asked_out(step: FitStep) -> tuple[str, ...]:
    """Ids of poses left out of a step's fit on request, without the outliers that the search left out."""
    dataset = step.calibration.dataset
    found = np.flatnonzero(in_repeat_groups_of(dataset, step.left_out)) if step.left_out else ()
    stand_out = {dataset.poses.ids[i] for i in found}
    return tuple(pose_id for pose_id in dataset.left_out if pose_id not in stand_out)


def _nominal(last: Calibration) -> StepErrors:
    # Of the last fit, as in the headline: the tool point that is found counts as delivered, and each fit refines it.
    return StepErrors(NOMINAL, last.before.train_rmse_mm, last.before.test_rmse_mm, float("nan"))


def _errors_after(step: FitStep) -> StepErrors:
    after = step.calibration.after
    return StepErrors(step.label, after.train_rmse_mm, after.test_rmse_mm, step.calibration.sigma_mm)


def untested(session: Session) -> Session:
    """Session after a new fit, without the rankings, tests and diagnosis of the fit before."""
    return replace(session, **tests_of(Session(session.dataset), "screening", "pose_errors", "searched", "versions"))


def tests_of(session: Session, *further: str) -> dict[str, Any]:
    """Tests and verdict of a session, and further fields of it, by their names."""
    names = ("residual_tests", "advice", "diagnosis", "next_poses", *further)
    return {name: getattr(session, name) for name in names}
