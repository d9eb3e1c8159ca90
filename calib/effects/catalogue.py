"""The catalogue: which effects a dataset can speak about, and why it cannot about the others."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from calib.dataset.dataset import Dataset, Poses
from calib.effects.compliance import (
    BaseCompliance,
    GravityBacklash,
    JointCompliance,
    JointComplianceUnknownMasses,
    LinkBending,
    ToolSag,
)
from calib.effects.effect import Effect, family_name
from calib.effects.gravity import has_masses
from calib.effects.joints import (
    AxisWobble,
    Backlash,
    JointCoupling,
    JointScale,
    StrainWave,
    TransmissionError,
)
from calib.effects.scanner import IncidenceBias, ScannerDistortion, ScannerDrift, ScannerScale
from calib.effects.thermal import ThermalGrowth
from calib.errors import CalibError
from calib.kinematics.robot import Robot


@dataclass(frozen=True)
class Family:
    """An effect as it is named: one cause, with a member for each joint (and harmonic) that may carry it or not."""

    name: str
    members: tuple[Effect, ...]
    why_not: str = ""  # why this dataset cannot speak about it, "" where it can
    would_help: str = ""  # the data that would change that
    note: str = ""  # what was assumed, such as unknown masses


def effects_for(dataset: Dataset) -> tuple[Family, ...]:
    """Every family of the catalogue, made for this robot and these conditions; those without data say why.

    Whether poses are rich enough to tell a family from geometry is found by `calib.diagnosis.stepwise`, not here.
    """
    robot, poses = dataset.robot, dataset.poses
    joints = range(robot.n_joints)
    revolute = [j for j in joints if robot.joints[j].is_revolute]
    centre, half = _field(dataset)
    return (
        _joint_compliance(robot, poses),
        _needing_masses("link_bending", robot, tuple(LinkBending(j) for j in joints)),
        Family("transmission_error", tuple(TransmissionError(j, n) for j in revolute for n in (1, 2, 3))),
        _strain_wave(robot),
        Family("joint_scale", tuple(JointScale(j) for j in joints)),
        _joint_coupling(robot),
        _backlash(poses, robot),
        _needing_masses("gravity_backlash", robot, tuple(GravityBacklash(j) for j in joints)),
        _thermal(poses),
        _needing_masses("base_compliance", robot, (BaseCompliance(),)),
        Family("axis_wobble", tuple(AxisWobble(j, n) for j in revolute for n in (1, 2))),
        Family("scanner_distortion", (ScannerDistortion(centre, half),)),
        _drift(poses, centre, half),
        Family("tool_sag", (ToolSag(),)),
        Family("incidence_bias", (IncidenceBias(),)),
        Family(
            "scanner_scale",
            (ScannerScale(),),
            why_not="a scale error of the scanner equals a scaling of every length of the arm",
            would_help="measure a certified length (a ball bar, two targets on a gauge) with the same scanner",
        ),
    )


def family_of(dataset: Dataset, name: str, more: Sequence[Family] = ()) -> Family:
    """A family by its name, of the catalogue or of the user's own. Raises CalibError on an unknown name."""
    families = (*effects_for(dataset), *more)
    for family in families:
        if family.name == name:
            return family
    raise CalibError(f"no effect named {name!r}; there are {', '.join(f.name for f in families)}")


def families_from(effects: Sequence[Effect]) -> tuple[Family, ...]:
    """Effects of a user's own, those of one name together."""
    names = list(dict.fromkeys(family_name(effect) for effect in effects))
    return tuple(Family(name, tuple(e for e in effects if family_name(e) == name)) for name in names)


def _joint_compliance(robot: Robot, poses: Poses) -> Family:
    joints = range(robot.n_joints)
    if has_masses(robot):
        return Family("joint_compliance", tuple(JointCompliance(j) for j in joints))
    varies = poses.payload_kg is not None and bool(np.ptp(poses.payload_kg[~poses.is_test]) > 0.0)
    members = tuple(
        JointComplianceUnknownMasses(
            j, places=robot.n_joints + 1 - j if robot.joints[j].is_revolute else 1, payload=varies
        )
        for j in joints
    )
    note = "robot.toml has no masses: compliance times unknown masses is fitted"
    return Family("joint_compliance", members, note=note)


def _needing_masses(name: str, robot: Robot, members: tuple[Effect, ...]) -> Family:
    if has_masses(robot):
        return Family(name, members)
    return Family(
        name,
        members,
        why_not="robot.toml has no masses and centres of mass of the links",
        would_help="add mass_kg and com_mm to each [[joints]]; a maker's data sheet or CAD is good enough",
    )


def _strain_wave(robot: Robot) -> Family:
    members = tuple(
        StrainWave(j, factor * joint.gear_ratio)
        for j, joint in enumerate(robot.joints)
        if joint.gear_ratio is not None and joint.is_revolute
        for factor in (1.0, 2.0)
    )
    if members:
        return Family("strain_wave", members)
    return Family("strain_wave", (), "robot.toml has no gear_ratio", "add gear_ratio to each [[joints]]")


def _joint_coupling(robot: Robot) -> Family:
    n = robot.n_joints
    pairs = [(j, j - 1) for j in range(max(n - 2, 1), n)] + ([(n - 1, n - 3)] if n >= 3 else [])
    if n < 2:
        return Family("joint_coupling", (), "the arm has one joint", "nothing: there is no neighbour")
    return Family("joint_coupling", tuple(JointCoupling(joint, driver) for joint, driver in pairs))


def _backlash(poses: Poses, robot: Robot) -> Family:
    if poses.approach is None:
        return Family(
            "backlash",
            (),
            "poses.csv has no approach columns",
            "move to each pose from both sides and write approach1 ... (-1 or 1)",
        )
    both = [j for j in range(robot.n_joints) if len(np.unique(poses.approach[~poses.is_test, j])) > 1]
    if not both:
        return Family(
            "backlash",
            (),
            "every joint always came from the same side: backlash is then a joint offset",
            "come to some poses from the other side",
        )
    return Family("backlash", tuple(Backlash(j) for j in both))


def _thermal(poses: Poses) -> Family:
    temperature = poses.temperature_c
    if temperature is None:
        return Family(
            "thermal_growth", (), "poses.csv has no temperature_c", "write the arm's temperature a pose"
        )
    if float(np.ptp(temperature[~poses.is_test])) < 1e-6:
        return Family(
            "thermal_growth",
            (),
            f"the temperature was {temperature[0]:g} C at every pose",
            "measure cold and warmed up, 5 K apart or more",
        )
    return Family("thermal_growth", (ThermalGrowth(),))


def _drift(poses: Poses, centre: tuple[float, float, float], half_mm: float) -> Family:
    if poses.time_s is None:
        return Family(
            "scanner_drift", (), "poses.csv has no time_s", "write down when each pose was measured"
        )
    start, duration = float(poses.time_s.min()), float(np.ptp(poses.time_s))
    if duration <= 0.0:
        return Family(
            "scanner_drift", (), "time_s is the same at every pose", "write down when each pose was measured"
        )
    return Family("scanner_drift", (ScannerDrift(centre, half_mm, start, duration),))


def _field(dataset: Dataset) -> tuple[tuple[float, float, float], float]:
    """Middle and half width of where the training points lie in the scanner's frame."""
    if dataset.points is None:
        return (0.0, 0.0, 0.0), 1.0
    xyz = dataset.points.xyz_mm[~dataset.poses.is_test[dataset.points.pose]]
    low, high = xyz.min(axis=0), xyz.max(axis=0)
    x, y, z = (0.5 * (low + high)).tolist()
    return (x, y, z), max(0.5 * float(np.max(high - low)), 1e-6)
