"""Laws that every effect of the catalogue obeys: it runs over all of them because they are in the catalogue."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest

from calib import calibrate
from calib.calibration.evaluation import evaluate
from calib.effects.catalogue import catalogue_names, effects_for, family_of
from calib.effects.catalogue.scanner import ScannerDistortion
from calib.effects.effect import (
    Effect,
    Parameter,
    apply_values,
    family_name,
    full_name,
    is_linear,
    state_derivative,
)
from calib.effects.link_errors import LinkErrors
from calib.effects.shaped import ShapedEffect
from calib.effects.state import RobotState
from calib.errors import CalibError
from calib.fitting.model import Model
from calib.fitting.observations import (
    Observations,
    nominal_state,
    with_nominal_scanner_frames,
)
from tests.support.arms import dataset_of
from tests.support.changed import with_poses, with_xyz
from tests.support.fit_cases import label, rich_dataset, some_of

DATASET = rich_dataset()


MEMBERS = [member for family in effects_for(DATASET) for member in some_of(family)]


def test_the_catalogue_is_what_is_described_and_all_of_it_runs_here() -> None:
    families = effects_for(DATASET)
    assert tuple(family.name for family in families) == catalogue_names()
    assert {family_name(member) for member in MEMBERS} == set(catalogue_names())
    assert {family.name for family in families if family.why_not and not family.never_testable} == set()
    assert all(isinstance(m, ShapedEffect) for family in families if family.sparse for m in family.members)
    assert {"joint_step", "joint_dent", "high_harmonic", "cable_drag"} < {f.name for f in families if f.sparse}
    assert all(family_name(member) == family.name for family in families for member in family.members)


def test_parameter_names_are_unique_and_carry_units() -> None:
    families = effects_for(DATASET)
    names = [full_name(m, p) for family in families for m in family.members for p in m.parameters]
    assert len(set(names)) == len(names)
    for member in MEMBERS:
        for p in member.parameters:
            assert p.name.isidentifier()
            assert p.unit
            assert p.scale > 0
            assert p.doc


@pytest.mark.parametrize("effect", [*MEMBERS, LinkErrors(DATASET.robot)], ids=label)
def test_zero_means_absent_bit_for_bit(effect: Effect) -> None:
    state = nominal_state(DATASET)
    after = apply_values(effect, state, np.zeros(len(effect.parameters)))
    np.testing.assert_array_equal(np.broadcast_to(state.vector, after.vector.shape), after.vector)
    np.testing.assert_array_equal(after.place(after.chain.target_mm), state.place(state.chain.target_mm))


@pytest.mark.slow
def test_with_its_loads_fixed_a_model_of_all_effects_has_an_exact_jacobian() -> None:
    """Link errors included: loads that followed them would be in the map and not in the derivative."""
    rng = np.random.default_rng(3)
    observed = with_nominal_scanner_frames(Observations.of(DATASET), DATASET.robot)
    poses, seen = observed.used_poses[0], observed.seen()
    model = Model(DATASET.robot, (LinkErrors(DATASET.robot), *MEMBERS))
    model = model.with_loads_at(rng.normal(size=len(model.parameters)) * model.scales)
    x = rng.normal(size=len(model.parameters)) * model.scales * 0.1
    points, jacobian = model.linearise(x, poses, seen=seen)
    np.testing.assert_allclose(points, model.predict(x, poses, seen=seen), atol=1e-9)
    for k in range(0, len(x), 7):
        step = np.zeros(len(x))
        step[k] = 1e-3 * model.scales[k]
        high, low = (model.predict(x + s, poses, seen=seen) for s in (step, -step))
        numeric = (high - low) / (2.0 * step[k])
        np.testing.assert_allclose(jacobian[..., k] * model.scales[k], numeric * model.scales[k], atol=2e-6)


@pytest.mark.parametrize(
    "effect",
    [e for e in (*MEMBERS, LinkErrors(DATASET.robot)) if not isinstance(e, ScannerDistortion)],
    ids=label,
)
def test_what_is_declared_linear_adds_a_multiple_of_each_value(effect: Effect) -> None:
    """The derivative, taken once at zero, makes the whole effect: at random values, upon a state with link errors."""
    assert is_linear(effect)
    rng = np.random.default_rng(2)
    links = LinkErrors(DATASET.robot)
    sizes = np.array([p.scale for p in links.parameters])
    state = apply_values(links, nominal_state(DATASET), sizes * rng.normal(size=len(sizes)))
    values = np.array([p.scale for p in effect.parameters]) * rng.normal(size=len(effect.parameters)) * 10.0
    added = sum(v * d for v, d in zip(values, state_derivative(effect, state, 0.0 * values), strict=True))
    after = apply_values(effect, state, values).vector - state.vector
    np.testing.assert_allclose(np.broadcast_to(added, after.shape), after, rtol=1e-9, atol=1e-11)


def test_an_effect_that_declares_nothing_is_differenced_where_it_stands() -> None:
    """As the catalogue's own, but not linear: theta += k^2 q."""

    @dataclass(frozen=True)
    class Squared:
        joint: int = 1
        parameters = (Parameter("k", unit="1", scale=1e-2),)

        def apply(self, state: RobotState, *, k: float) -> RobotState:
            return state.add_joint_error(self.joint, k**2 * state.q_rad[:, self.joint])

    state = nominal_state(DATASET)
    for k in (0.0, 0.03, -0.2):
        (derivative,) = state_derivative(Squared(), state, np.array([k]))
        expected = np.zeros_like(derivative)
        expected[:, 5 * 1 + 3] = 2.0 * k * state.q_rad[:, 1]
        np.testing.assert_allclose(derivative, expected, atol=1e-9)


@pytest.mark.parametrize("effect", MEMBERS, ids=label)
def test_an_effect_of_its_usual_size_moves_the_tool_by_a_sane_amount(effect: Effect) -> None:
    state = nominal_state(DATASET)
    sizes = np.array([p.scale for p in effect.parameters])
    after = apply_values(effect, state, sizes)
    moved = np.linalg.norm(after.place(after.chain.target_mm) - state.place(state.chain.target_mm), axis=1)
    assert moved.max() < 10.0
    # Joint 6 turns about an axis through the tool point, and gravity does not turn joint 1.
    still = {
        "joint_compliance.J1.c_rad_per_nm",
        "gravity_backlash.J1.b_rad",
        "nonlinear_stiffness.J1.c2_rad_per_nm2",
    }
    if getattr(effect, "joint", 0) < 5 and label(effect) not in still:
        assert moved.max() > 1e-3


def test_a_fitted_effect_is_reported_by_name_and_explains_what_it_made() -> None:
    """Simulated with the same map, so it proves the bookkeeping only; independent truths are in test_diagnosis."""
    dataset = rich_dataset(poses=60)
    family = family_of(dataset, "transmission_error")
    model = Model(dataset.robot, (LinkErrors(dataset.robot), *family.members[:6]))
    x = np.zeros(len(model.parameters))
    names = [p.name for p in model.parameters]
    x[names.index("transmission_error.J2.sin2_rad")] = 1e-3
    made = evaluate(model, x, dataset)
    spoiled = with_xyz(dataset, dataset.points.xyz_mm + made.error_mm - evaluate(model, 0 * x, dataset).error_mm)
    result = calibrate(spoiled, effects=family.members)
    assert result.model.family_names == ("transmission_error",)
    frame = result.to_frame().set_index("name")
    row = frame.loc["transmission_error.J2.sin2_rad"]
    assert row["unit"] == "rad"
    assert row["value"] == pytest.approx(1e-3, abs=5 * row["sigma"] + 2e-5)
    plain = calibrate(spoiled)
    assert result.after.train.rmse_mm < 0.6 * plain.after.train.rmse_mm


def test_families_without_their_data_say_why_and_what_would_help() -> None:
    bare = dataset_of(DATASET.robot, DATASET.robot, np.random.default_rng(0), poses=12)
    massless = replace(
        bare,
        robot=replace(bare.robot, joints=tuple(replace(j, mass_kg=None, gear_ratio=None) for j in bare.robot.joints)),
    )
    silent = {f.name for f in effects_for(massless) if f.why_not}
    assert silent >= {
        "strain_wave", "backlash", "gravity_backlash", "thermal_growth", "scanner_drift", "scanner_scale",
        "base_loosening", "warm_up", "nonlinear_stiffness", "link_torsion", "bearing_clearance",
    }  # fmt: skip
    assert not silent & {"transmission_error", "joint_scale", "axis_wobble", "tool_sag", "scanner_distortion"}
    assert all(f.would_help for f in effects_for(massless) if f.why_not)
    for name in ("joint_compliance", "link_bending", "base_compliance"):
        load = family_of(massless, name)
        assert "unknown masses" in load.note
        assert {"joint_compliance", "link_bending", "base_compliance", "gravity_backlash"} - {name} <= set(
            load.confounded_with
        )
        assert family_of(DATASET, name).confounded_with == ()
    constant = with_poses(DATASET, temperature_c=np.full(40, 21.0))
    assert "21 C at every pose" in family_of(constant, "thermal_growth").why_not
    one_sided = with_poses(DATASET, approach=np.ones((40, 6)))
    assert "same side" in family_of(one_sided, "backlash").why_not
    with pytest.raises(CalibError, match="no effect named 'magic'; there are joint_compliance"):
        family_of(DATASET, "magic")
