"""What each family of the catalogue is, without any dataset: what `inspector effects` prints."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Description:
    """One family: its name, its equation, parameters with units, and what it needs."""

    name: str
    equation: str
    parameters: tuple[tuple[str, str], ...]  # name, unit
    needs: str


DESCRIPTIONS = (
    Description(
        "joint_compliance",
        "theta_j += c_j tau_j(q, payload)",
        (("c_j", "rad/Nm"),),
        "masses in robot.toml, or many poses; payload_kg where it varies",
    ),
    Description(
        "link_bending",
        "end of link j turns by c_j M_j, c_j = L / EI",
        (("c_j", "rad/Nm"),),
        "masses in robot.toml",
    ),
    Description(
        "transmission_error",
        "theta_j += A sin(n q_j) + B cos(n q_j), n = 1, 2, 3",
        (("sin_n", "rad"), ("cos_n", "rad")),
        "joint angles over a good part of a turn",
    ),
    Description(
        "strain_wave",
        "the same, n = gear ratio and 2 x gear ratio",
        (("sin_n", "rad"), ("cos_n", "rad")),
        "gear_ratio in robot.toml",
    ),
    Description(
        "joint_scale",
        "theta_j += k_j q_j",
        (("k_j", "1"),),
        "joint angles over a good range",
    ),
    Description(
        "joint_coupling",
        "theta_j += k q_i, neighbours of the wrist",
        (("k", "1"),),
        "three joints or more",
    ),
    Description(
        "backlash",
        "theta_j += b_j / 2 sign(approach_j)",
        (("b_j", "rad"),),
        "approach1 ... in poses.csv, from both sides",
    ),
    Description(
        "gravity_backlash",
        "theta_j += b_j / 2 sign(tau_j)",
        (("b_j", "rad"),),
        "masses in robot.toml",
    ),
    Description(
        "thermal_growth",
        "a, d times 1 + kappa (T - 20 C)",
        (("kappa", "1/K"),),
        "temperature_c in poses.csv, varying",
    ),
    Description(
        "base_compliance",
        "base turns by C M(q)",
        (("cx", "rad/Nm"), ("cy", "rad/Nm")),
        "masses in robot.toml",
    ),
    Description(
        "axis_wobble",
        "axis j tilts about its origin by sin, cos of n q_j, n = 1, 2",
        (("x_sin_n", "rad"), ("y_cos_n", "rad")),
        "joint angles over a good part of a turn",
    ),
    Description(
        "scanner_distortion",
        "z += k1 u + k2 u^2, radial k r^3 about the field's middle",
        (("depth1", "mm"), ("depth2", "mm"), ("radial", "mm"), ("decentre", "mm")),
        "points spread over the field",
    ),
    Description(
        "scanner_drift",
        "p += (v + w x p) t",
        (("v", "mm/s"), ("w", "rad/s")),
        "time_s in poses.csv",
    ),
    Description(
        "tool_sag",
        "target moves by R diag(c) R^T g",
        (("c", "mm"),),
        "tool attitudes that vary",
    ),
    Description(
        "incidence_bias",
        "b (1 - cos phi) along the ray",
        (("b", "mm"),),
        "jig attitudes that vary",
    ),
    Description(
        "scanner_scale",
        "p times 1 + s",
        (("s", "1"),),
        "a length standard; not testable without one",
    ),
)

FAMILY_NAMES = tuple(description.name for description in DESCRIPTIONS)
