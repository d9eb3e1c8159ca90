"""The largest sizes that causes are known to have: a fitted value beyond them is hardly what its name says.

The usual size of a parameter, its prior's sigma, is `Parameter.scale`; these bounds are far above it. They are of what
drives, bearings, metals and bases are, as makers' tables and strength of materials have it, and generous.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

from calib.effects.checked_apply import is_users
from calib.effects.effect import Effect, Parameter, family_name


@dataclass(frozen=True)
class NaturalBound:
    """The most that a parameter in this unit is, and where that is from, as a clause."""

    size: float
    unit: str
    source: str
    refused: float = 10.0  # times it, from which no fit is believed; wrong masses make less than that


_GEAR = "the smallest strain wave gears turn by 1e-3 rad/Nm (makers' tables: 1 kNm/rad)"
_PLAY = "robot gears are made with 3e-4 rad of play (one arc minute), worn ones have a few times that"
_COUNTED = "gear ratios are whole numbers of teeth, and encoders count them to 1e-3 and better"
_SEEN = 3.0  # times what is seen with bare eyes

NATURAL_BOUNDS: Mapping[str, tuple[NaturalBound, ...]] = MappingProxyType(
    {
        "joint_compliance": (
            NaturalBound(1e-3, "rad/Nm", _GEAR),
            NaturalBound(5e-2, "rad kg/Nm", "that is 50 kg on the smallest strain wave gear (1 kNm/rad)"),
        ),
        "link_bending": (
            NaturalBound(5e-4, "rad/Nm", "half a metre of aluminium tube, 40 mm by 3 mm, bends by 1e-4 rad/Nm"),
            NaturalBound(2.5e-2, "rad kg/Nm", "that is 50 kg on a link of 2 kNm/rad"),
        ),
        "link_torsion": (
            NaturalBound(1e-3, "rad/Nm", "half a metre of aluminium tube, 40 mm by 3 mm, twists by 2e-4 rad/Nm"),
        ),
        "base_compliance": (
            NaturalBound(1e-4, "rad/Nm", "a light table gives way by 1e-4 rad/Nm, a bolted base far less"),
            NaturalBound(1e-2, "rad kg/Nm", "that is 100 kg on a light table (10 kNm/rad)"),
        ),
        "base_loosening": (NaturalBound(1e-3, "rad/Nm", "a base that gives way so far is seen to rock"),),
        "nonlinear_stiffness": (
            NaturalBound(1e-4, "rad/Nm^2", "the smallest gears lose a tenth of their stiffness for each Nm"),
        ),
        "bearing_clearance": (NaturalBound(3e-3, "rad", "bearings of joints have less than 1e-3 rad of clearance"),),
        "gravity_backlash": (NaturalBound(9e-3, "rad", _PLAY),),
        "backlash": (NaturalBound(9e-3, "rad", _PLAY),),
        "transmission_error": (
            NaturalBound(3.5e-3, "rad", "robot gears are made to 3e-4 rad (one arc minute), simple ones to 3e-3"),
        ),
        "strain_wave": (
            NaturalBound(1e-3, "rad", "strain wave gears are made to 4e-4 rad (makers' tables: 1.5 arc minutes)"),
        ),
        "high_harmonic": (NaturalBound(1e-3, "rad", "encoders interpolate to 1e-3 rad and better"),),
        "cable_drag": (NaturalBound(3.5e-3, "rad", "a drive gives way to a cable by 0.2 deg at the most"),),
        "joint_dent": (NaturalBound(9e-3, "rad", "a tooth that is gone shows by less than half a degree"),),
        "joint_scale": (NaturalBound(5e-3, "1", _COUNTED),),
        "asymmetric_scale": (NaturalBound(5e-3, "1", _COUNTED),),
        "joint_coupling": (NaturalBound(5e-2, "1", "wrists couple by one over a gear ratio of 20 and more"),),
        "following_error": (
            NaturalBound(5e-2, "1", "a drive that stands lags by less than a twentieth of its last move"),
        ),
        "axis_wobble": (
            NaturalBound(2e-3, "rad", "bearings of joints run true to 1e-4 rad, bad ones to ten times that"),
        ),
        "joint_step": (
            NaturalBound(5e-2, "rad", "a clutch or an encoder that slips by more is seen", _SEEN),
            NaturalBound(20.0, "mm", "a slide that slips by more is seen", _SEEN),
        ),
        "target_step": (NaturalBound(20.0, "mm", "a target that moved by more has come off", _SEEN),),
        "scanner_step": (
            NaturalBound(200.0, "mm", "a knock moves an instrument by less", _SEEN),
            NaturalBound(0.1, "rad", "a knock turns an instrument by less", _SEEN),
        ),
        "thermal_growth": (NaturalBound(3e-5, "1/K", "of an arm's metals aluminium grows most, by 23e-6/K"),),
        "warm_up": (NaturalBound(2e-3, "1", "aluminium grows by 1.4e-3 for 60 K"),),
        "tool_sag": (NaturalBound(10.0, "mm", "a tool that is screwed on does not hang by so much"),),
        "scanner_distortion": (
            NaturalBound(10.0, "mm", "instruments that measure arms are off by less at the edge of their field"),
        ),
        "scanner_scale": (NaturalBound(5e-3, "1", "instruments are made to 1e-4 and better"),),
        "incidence_bias": (NaturalBound(3.0, "mm", "scanners are off by tenths of a millimetre at grazing incidence"),),
        "scanner_drift": (),  # how far it goes depends on how long it was measured
    }
)
"""By family and unit."""


def exceeded_bound(effect: Effect, parameter: Parameter, value: float, sigma: float) -> NaturalBound | None:
    """The bound that a value exceeds by more than two sigmas; None where it exceeds none, or none is known."""
    bounds = () if is_users(effect) else NATURAL_BOUNDS.get(family_name(effect), ())
    for bound in bounds:
        if bound.unit == parameter.unit:
            return bound if abs(value) - 2.0 * sigma > bound.size else None
    return None
