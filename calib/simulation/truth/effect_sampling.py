"""Draw each simulated effect: which joints carry it and in which proportion. Its magnitude is set afterwards.

A fault is seldom spread evenly: about half of the time one to three joints carry all of it.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from calib.array_types import Array
from calib.errors import CalibError
from calib.simulation.truth.carriers import Rng, carriers, magnitudes, one_joint
from calib.simulation.truth.effect import TrueEffect
from calib.simulation.truth.further_sampling import FURTHER
from calib.simulation.truth.joint_effects import (
    AxisWobble,
    Backlash,
    FineRipple,
    JointCoupling,
    JointScale,
    RoughGear,
    StrainWave,
    ThermalGrowth,
    TransmissionError,
)
from calib.simulation.truth.load_effects import (
    BaseCompliance,
    GravityBacklash,
    HosePull,
    JointCompliance,
    LinkBending,
    ToolSag,
)
from calib.simulation.truth.mechanism import Arm
from calib.simulation.truth.scanner_effects import (
    FieldBump,
    IncidenceBias,
    ScannerDistortion,
    ScannerDrift,
    ScannerScale,
)
from calib.simulation.truth.visibility import SimulatedCell, gravity_torques


def _joint_compliance(cell: SimulatedCell, rng: Rng) -> TrueEffect:
    """Joints of one make, 35 % apart; the wrist is about four times softer."""
    n = cell.nominal.n_joints
    size = 1e-5 * np.where(np.arange(n) < n - 3, 1.0, 4.0) * np.exp(0.35 * rng.standard_normal(n))
    return JointCompliance(carriers(cell, rng, JointCompliance, size * cell.nominal.is_revolute))


def _gravity_backlash(cell: SimulatedCell, rng: Rng) -> TrueEffect:
    """Play in joints that gravity loads clearly: a median torque above 0.3 Nm."""
    loaded = np.median(np.abs(gravity_torques(cell)), axis=0) > 0.3
    return GravityBacklash(carriers(cell, rng, GravityBacklash, 2e-4 * magnitudes(cell, rng) * loaded))


def _link_bending(cell: SimulatedCell, rng: Rng) -> TrueEffect:
    """Links from 50 mm on; c = L / EI grows towards the thin end of the arm."""
    ends = Arm.commanded_to(cell.nominal, cell.q)
    spans = [
        after[0, :3, 3] - before[0, :3, 3] for before, after in zip(ends.base_T_axis, ends.base_T_straight, strict=True)
    ]
    length_mm = np.linalg.norm(spans, axis=1)
    size = 2e-6 * magnitudes(cell, rng) * (length_mm / 400.0) * (length_mm > 50.0)
    return LinkBending(carriers(cell, rng, LinkBending, size * np.linspace(1.0, 3.0, len(size))))


def _transmission_error(cell: SimulatedCell, rng: Rng) -> TrueEffect:
    """Each joint mostly at one of n = 1, 2, 3: eccentric ring, oval generator, three screws."""
    n = cell.nominal.n_joints
    share = 0.15 + 0.85 * np.eye(3)[rng.integers(3, size=n)]
    wave = 1e-4 * share * np.exp(2j * np.pi * rng.random((n, 3)))

    def make(size: Array) -> TrueEffect:
        return TransmissionError(size[:, None] * wave.real, size[:, None] * wave.imag)

    return make(carriers(cell, rng, make, magnitudes(cell, rng)))


def _strain_wave(cell: SimulatedCell, rng: Rng) -> TrueEffect:
    robot = cell.nominal
    without = [
        joint.name or f"J{j + 1}"
        for j, joint in enumerate(robot.joints)
        if joint.is_revolute and joint.gear_ratio is None
    ]
    if without:
        raise CalibError(f"robot {robot.name}: no gear_ratio for {', '.join(without)}; strain_wave needs them")
    ratio = np.array([joint.gear_ratio or 1.0 for joint in robot.joints])
    share = rng.uniform(0.2, 1.0, (robot.n_joints, 2))  # once a motor turn, twice
    wave = 1e-4 * share * np.exp(2j * np.pi * rng.random(share.shape))

    def make(size: Array) -> TrueEffect:
        return StrainWave(size[:, None] * wave.real, size[:, None] * wave.imag, ratio)

    return make(carriers(cell, rng, make, magnitudes(cell, rng)))


def _joint_scale(cell: SimulatedCell, rng: Rng) -> TrueEffect:
    return JointScale(carriers(cell, rng, JointScale, 1e-4 * magnitudes(cell, rng, signed=True)))


def _joint_coupling(cell: SimulatedCell, rng: Rng) -> TrueEffect:
    """In the wrist a joint's shaft runs through the next one: the last three joints, each dragged by the one before."""
    n = cell.nominal.n_joints

    def make(size: Array) -> TrueEffect:
        return JointCoupling(np.diag(size[1:], k=-1))

    dragged = (np.arange(n) >= n - 2) & cell.nominal.is_revolute
    size = 1e-4 * magnitudes(cell, rng, signed=True) * dragged
    return make(carriers(cell, rng, make, size))


def _backlash(cell: SimulatedCell, rng: Rng) -> TrueEffect:
    return Backlash(carriers(cell, rng, Backlash, 2e-4 * magnitudes(cell, rng)))


def _thermal_growth(cell: SimulatedCell, rng: Rng) -> TrueEffect:
    return ThermalGrowth(rng.uniform(12e-6, 24e-6))  # steel to aluminium


def _base_compliance(cell: SimulatedCell, rng: Rng) -> TrueEffect:
    return BaseCompliance(1e-6 * np.array([*rng.uniform(0.6, 1.4, 2), 0.0]))


def _axis_wobble(cell: SimulatedCell, rng: Rng) -> TrueEffect:
    wave = 1e-4 * rng.standard_normal((2, cell.nominal.n_joints, 2, 2))

    def make(size: Array) -> TrueEffect:
        return AxisWobble(size[:, None, None] * wave[0], size[:, None, None] * wave[1])

    return make(carriers(cell, rng, make, magnitudes(cell, rng)))


def _scanner_distortion(cell: SimulatedCell, rng: Rng) -> TrueEffect:
    """One of the three terms leads; each is given the size that moves a point at the field's edge alike."""
    middle_mm = cell.plain_mm.mean(axis=0)
    reach_mm = float(np.sqrt(np.mean(np.sum((cell.plain_mm - middle_mm) ** 2, axis=1))))
    k = 0.2 * rng.choice([-1.0, 1.0], 3) * (0.2 + 0.8 * np.eye(3)[rng.integers(3)])
    return ScannerDistortion(k[0] / reach_mm, k[1] / reach_mm**2, k[2] / reach_mm**3, middle_mm)


def _scanner_drift(cell: SimulatedCell, rng: Rng) -> TrueEffect:
    return ScannerDrift(1e-4 * rng.standard_normal(3), 1e-7 * rng.standard_normal(3))


def _tool_sag(cell: SimulatedCell, rng: Rng) -> TrueEffect:
    """Softer across the tool than along it."""
    return ToolSag(0.2 * rng.uniform(0.5, 1.5, 3) * np.array([1.0, 1.0, 0.3]))


def _incidence_bias(cell: SimulatedCell, rng: Rng) -> TrueEffect:
    return IncidenceBias(0.2 * float(rng.choice([-1.0, 1.0])))


def _scanner_scale(cell: SimulatedCell, rng: Rng) -> TrueEffect:
    return ScannerScale(2e-4 * float(rng.choice([-1.0, 1.0])))


def _hose_pull(cell: SimulatedCell, rng: Rng) -> TrueEffect:
    """From above and behind the base to the side of the forearm; joints as stiff as real ones."""
    n = cell.nominal.n_joints
    reach_mm = float(np.linalg.norm(Arm.commanded_to(cell.nominal, cell.q).base_T_frame[-1][:, :3, 3], axis=1).max())
    return HosePull(
        stiffness_n_per_mm=0.05,
        rest_length_mm=0.3 * reach_mm,
        anchor_mm=reach_mm * np.array([rng.uniform(-0.6, -0.2), rng.uniform(-0.5, 0.5), rng.uniform(0.6, 1.2)]),
        held_mm=rng.uniform(-80.0, 80.0, 3),
        link=n // 2 - (n % 2 == 0),
        c_rad_per_nm=1e-5 * magnitudes(cell, rng),
    )


def _field_bump(cell: SimulatedCell, rng: Rng) -> TrueEffect:
    """Where the points are, and a quarter as wide as their cloud."""
    middle_mm = cell.plain_mm.mean(axis=0)
    reach_mm = float(np.sqrt(np.mean(np.sum((cell.plain_mm - middle_mm) ** 2, axis=1))))
    direction = rng.standard_normal(3) * np.array([0.3, 0.3, 1.0])
    place_mm = cell.plain_mm[rng.integers(len(cell.q))]
    return FieldBump(0.3 * direction / np.linalg.norm(direction), place_mm, reach_mm * rng.uniform(0.25, 0.4))


def _waves(kind: Callable[[Array, Array], TrueEffect], count: int) -> Callable[[SimulatedCell, Rng], TrueEffect]:
    """So many waves of one joint, each as large as the others."""

    def draw(cell: SimulatedCell, rng: Rng) -> TrueEffect:
        turn_rad = rng.uniform(0.0, 2.0 * np.pi, count)

        def make(size: Array) -> TrueEffect:
            return kind(np.outer(size, np.cos(turn_rad)), np.outer(size, np.sin(turn_rad)))

        return make(one_joint(cell, rng, make))

    return draw


CATALOGUE: dict[str, Callable[[SimulatedCell, Rng], TrueEffect]] = {
    "joint_compliance": _joint_compliance,
    "link_bending": _link_bending,
    "transmission_error": _transmission_error,
    "strain_wave": _strain_wave,
    "joint_scale": _joint_scale,
    "joint_coupling": _joint_coupling,
    "backlash": _backlash,
    "gravity_backlash": _gravity_backlash,
    "thermal_growth": _thermal_growth,
    "base_compliance": _base_compliance,
    "axis_wobble": _axis_wobble,
    "scanner_distortion": _scanner_distortion,
    "scanner_drift": _scanner_drift,
    "tool_sag": _tool_sag,
    "incidence_bias": _incidence_bias,
    "scanner_scale": _scanner_scale,
    **FURTHER,
}
"""Effects of the catalogue, which a diagnosis can name."""

OUTSIDE: dict[str, Callable[[SimulatedCell, Rng], TrueEffect]] = {
    "hose_pull": _hose_pull,
    "field_bump": _field_bump,
    "rough_gear": _waves(RoughGear, 5),
    "fine_ripple": _waves(FineRipple, 1),
}
"""Effects outside the catalogue, which a diagnosis has to leave unexplained."""
