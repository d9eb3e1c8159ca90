"""The options of a fit hold for every fit that follows from it."""

from __future__ import annotations

import numpy as np
import pytest

from calib import calibrate, cross_validate, diagnose, frames, learning_curve, screen
from calib.calibration.model_versions import fits_same_points, versions
from calib.calibration.result import Calibration
from calib.dataset.dataset import Dataset
from calib.dataset.files.robot_toml import builtin_robot
from calib.effects.catalogue import effects_for
from calib.errors import FitError
from calib.fitting.observations import conditions_at
from calib.options import FitOptions, parameter_name
from calib.planning.effect_hypotheses import EffectHypothesis, predict
from calib.planning.start import offered_poses
from calib.rendering.numbers import parameter_label
from calib.screening.candidates import Candidate
from calib.simulation.simulate import simulate_dataset

ASKED = [
    FitOptions(fixed=("a2", "beta3")),
    FitOptions(tolerances={"a2": 0.01}),
    FitOptions(robust=True),
    FitOptions(prior=False),
    FitOptions(residual="distance"),
]


@pytest.fixture(scope="module")
def dataset() -> Dataset:
    return simulate_dataset("rb5", rng=8, effects=[("transmission_error", 4.0)], poses=45).dataset


def same_request(one: Calibration, other: Calibration) -> bool:
    """Whether two fits have equal parameters, tolerances, residual kind and weights."""
    links = [p for p in one.fit.parameters if p.name in one.dataset.robot.parameter_names]
    others = [p for p in other.fit.parameters if p.name in other.dataset.robot.parameter_names]
    return (
        links == others
        and one.residual == other.residual
        and one.options.robust == other.options.robust
        and one.outliers == other.outliers
        and one.fit.rows == other.fit.rows
    )


@pytest.mark.slow
@pytest.mark.parametrize("asked", ASKED[:3], ids=str)
def test_comparison_fits_the_link_errors_alone_as_was_asked(dataset: Dataset, asked: FitOptions) -> None:
    effects = next(f.members for f in effects_for(dataset) if f.name == "transmission_error")
    full = calibrate(dataset, asked, effects=effects)
    assert same_request(versions(full)[1].calibration, full)


@pytest.mark.parametrize("asked", ASKED[:4], ids=str)
def test_comparison_takes_no_fit_that_was_asked_otherwise(dataset: Dataset, asked: FitOptions) -> None:
    assert not fits_same_points(calibrate(dataset), calibrate(dataset, asked))


@pytest.mark.slow
@pytest.mark.parametrize("asked", ASKED[2:4], ids=str)
def test_what_hypotheses_predict_is_what_fits_as_was_asked_predict(dataset: Dataset, asked: FitOptions) -> None:
    result = calibrate(dataset, asked)
    first, second = (c for c in screen(result, effects_for(dataset)).candidates[:2])

    def places(candidate: Candidate, q: np.ndarray) -> np.ndarray:
        fitted = calibrate(dataset, asked, effects=candidate.members, prior_sigmas=candidate.prior_sigmas)
        at_mm = fitted.model.predict(fitted.fit.x, conditions_at(dataset.poses, q))
        return frames.apply(next(iter(fitted.after.scanner_T_base.values())), at_mm)

    poses = offered_poses(result, count=50)
    predicted = predict(result, (EffectHypothesis.of(first), EffectHypothesis.of(second)), poses)
    one, other = (hypothesis.mean * predicted.sigma_mm for hypothesis in predicted.hypotheses)
    apart = places(first, poses.q) - places(second, poses.q)
    assert np.linalg.norm(one - other - apart) < 0.3 * np.linalg.norm(apart)


def test_comparison_holds_only_what_the_link_errors_have(dataset: Dataset) -> None:
    effects = next(f.members for f in effects_for(dataset) if f.name == "transmission_error")
    held = calibrate(dataset, effects=effects).fit.parameters[-1].name
    full = calibrate(dataset, FitOptions(fixed=("a2", held)), effects=effects)
    links = versions(full)[1].calibration
    assert links.options == FitOptions(fixed=("a2",))
    assert versions(full, links)[1].calibration is links


@pytest.mark.parametrize("asked", ASKED[:3], ids=str)
@pytest.mark.thorough
def test_every_step_of_a_diagnosis_is_fitted_as_was_asked(dataset: Dataset, asked: FitOptions) -> None:
    found = diagnose(dataset, asked)
    assert found.named
    assert all(step.calibration.options == asked for step in found.steps)


@pytest.mark.slow
def test_every_fold_and_every_draw_is_fitted_as_was_asked(dataset: Dataset) -> None:
    asked = FitOptions(fixed=("a2", "beta3"), robust=True)
    whole = cross_validate(dataset, asked, folds=3).whole
    assert whole.options == asked
    assert whole.fit.x.size == calibrate(dataset).fit.x.size - 2
    with pytest.raises(FitError, match="nix"):
        learning_curve(dataset, FitOptions(fixed=("nix",)))


def test_parameters_may_be_named_as_tables_show_them() -> None:
    asked = FitOptions(fixed=("θ1", "βTCP", "a2", "α1.x", "alpha3"), tolerances={"α3": 0.01})
    assert asked.fixed == ("theta1", "betaTCP", "a2", "α1.x", "alpha3")  # α1.x: of a target that is called α1
    assert asked.tolerances == {"alpha3": 0.01}
    names = builtin_robot("rb5").parameter_names
    assert tuple(parameter_name(parameter_label(name)) for name in names) == names
