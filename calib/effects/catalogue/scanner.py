"""The scanner: errors of the points that it reports, which depend on their place in the scanner's frame."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib.array_types import Vector
from calib.dataset.dataset import Dataset
from calib.effects.effect import CatalogueEffect, Family, NaturalBound, Parameter
from calib.effects.state import RobotState


def field_of(dataset: Dataset) -> tuple[Vector, float]:
    """Middle (3,) and half width, mm, of the training points' bounding box in the scanner's frame."""
    if dataset.points is None:
        return (0.0, 0.0, 0.0), 1.0
    xyz = dataset.points.xyz_mm[~dataset.poses.is_test[dataset.points.pose]]
    low, high = xyz.min(axis=0), xyz.max(axis=0)
    x, y, z = (0.5 * (low + high)).tolist()
    return (x, y, z), max(0.5 * float(np.max(high - low)), 1e-6)


_FAINT_MM = 0.03  # a radial error below which the middle of the optics cannot be determined


def _inverse(radial_mm: float, shift_mm: float) -> float:
    """Reciprocal of the radial error, bounded and smooth, so that the optics' middle moves under 1.5 half fields."""
    return radial_mm / (float(np.hypot(radial_mm**2, (shift_mm / 2.0) ** 2)) + _FAINT_MM**2)


@dataclass(frozen=True)
class ScannerDistortion(CatalogueEffect):
    """Depth and radial errors of the scanner's points, about the middle of the measured field.

    With u = (p - centre) / half: depth z += k1 u_z + k2 u_z^2, radial (x, y) += k r^2 (u_x, u_y), r^2 = u_x^2 + u_y^2.
    The true middle of the optics is not known: with it at u = -s the radial term is k |u + s|^2 (u + s), and k s are
    two more unknowns. No term divides by z, as that of a line scanner or tracker may be zero.
    """

    centre_mm: Vector
    half_mm: float
    name = "scanner_distortion"
    of = "instrument"
    noun = "the distortion of the instrument's field"
    equation = "z += k1 u + k2 u^2, radial k r^3 about the field's middle"
    symbols = (("depth1", "mm"), ("depth2", "mm"), ("radial", "mm"), ("decentre", "mm"))
    needs = "points spread over the field"
    confirm = "the same poses from a second place of the scanner (a second setup)"
    bounds = (NaturalBound(10.0, "mm", "instruments that measure arms are off by less at the edge of their field"),)
    notes = r"""
    With $u = (p - p_0) / h$, the point in the scanner's frame about the middle of the measured field over half its
    width,

    $$ \delta z = k_1 u_z + k_2 u_z^2, \qquad \delta (x, y) = k \, | u_{xy} + s |^2 \, ( u_{xy} + s ) $$

    The middle of the optics is off by $s$, which is unknown too. No term divides by $z$: the depth of a tracker's point
    may be zero.
    """
    position = 12
    parameters = (
        Parameter("depth1_mm", "mm", 0.1, "depth error at the edge of the field, linear"),
        Parameter("depth2_mm", "mm", 0.1, "depth error at the edge of the field, quadratic"),
        Parameter("radial_mm", "mm", 0.1, "radial error at the edge of the field"),
        Parameter("decentre_x_mm", "mm", 0.1, "radial error times the middle's shift along x, over half the field"),
        Parameter("decentre_y_mm", "mm", 0.1, "radial error times the middle's shift along y, over half the field"),
    )

    def apply(
        self,
        state: RobotState,
        *,
        depth1_mm: float,
        depth2_mm: float,
        radial_mm: float,
        decentre_x_mm: float,
        decentre_y_mm: float,
    ) -> RobotState:
        """Robot state with the reported points moved."""
        if state.seen is None:
            return state
        u = (state.seen.scanner_mm - np.array(self.centre_mm)) / self.half_mm
        out = np.zeros_like(u)
        out[:, 2] = depth1_mm * u[:, 2] + depth2_mm * u[:, 2] ** 2
        across = u[:, :2]
        square = np.sum(across**2, axis=1)[:, None]
        shift = np.array([decentre_x_mm, decentre_y_mm])
        # k |u + s|^2 (u + s) less its constant, which the scanner's frame absorbs, in powers of k s
        out[:, :2] = radial_mm * square * across + square * shift + 2.0 * (across @ shift)[:, None] * across
        aside = shift * _inverse(radial_mm, float(np.linalg.norm(shift)))  # s, bounded
        out[:, :2] += float(shift @ aside) * across + 2.0 * (across @ shift)[:, None] * aside
        return state.displace_in_scanner(out)

    @classmethod
    def family(cls, dataset: Dataset) -> Family:
        """Family of this effect with one member, centred on the middle of the training points."""
        return Family(cls.name, (cls(*field_of(dataset)),))


@dataclass(frozen=True)
class ScannerDrift(CatalogueEffect):
    """A scanner that moves during the session: p += (v + w x (p - centre)) t, t from the first pose on."""

    centre_mm: Vector
    half_mm: float
    start_s: float
    duration_s: float
    name = "scanner_drift"
    of = "instrument"
    noun = "the drift of the instrument"
    equation = "p += (v + w x p) t"
    symbols = (("v", "mm/s"), ("w", "rad/s"))
    needs = "time_s in poses.csv"
    confirm = "the first pose again at the end, and in between"
    bounds = ()  # how far it goes depends on how long it was measured
    notes = r"""
    $$ \delta p = \left( v + w \times ( p - p_0 ) \right) t $$

    $p_0$ is the middle of the measured field, $t$ the time since the first pose. Correlated drift without a
    direction looks alike; what that explains as well is not claimed ({doc}`/method/noise`).
    """
    position = 13
    linear = True

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """Velocity and turning rate; the usual size of each moves a point by 0.1 mm over the session."""
        move, turn = 0.1 / self.duration_s, 0.1 / self.half_mm / self.duration_s
        return (
            *(Parameter(f"v{a}_mm_per_s", "mm/s", move, f"drift along {a}") for a in "xyz"),
            *(Parameter(f"w{a}_rad_per_s", "rad/s", turn, f"turning about {a}") for a in "xyz"),
        )

    def apply(self, state: RobotState, **values: float) -> RobotState:
        """Robot state with the reported points moved; unchanged where no time was recorded."""
        if state.seen is None or state.poses.time_s is None:
            return state
        v = np.array([values[f"v{a}_mm_per_s"] for a in "xyz"])
        w = np.array([values[f"w{a}_rad_per_s"] for a in "xyz"])
        arm = state.seen.scanner_mm - np.array(self.centre_mm)
        since_s = (state.poses.time_s - self.start_s)[:, None]
        return state.displace_in_scanner((v + np.cross(w, arm)) * since_s).turn_in_scanner(w * since_s)

    @classmethod
    def family(cls, dataset: Dataset) -> Family:
        """Family of this effect with one member: a drift over the session, about the middle of the training points."""
        time_s = dataset.poses.time_s
        if time_s is None or float(np.ptp(time_s)) <= 0.0:
            return cls.untimed(time_s)
        start_s, duration_s = float(time_s.min()), float(np.ptp(time_s))
        return Family(cls.name, (cls(*field_of(dataset), start_s, duration_s),))


@dataclass(frozen=True)
class IncidenceBias(CatalogueEffect):
    """A range error that grows as the jig turns away: b (1 - cos phi) along the ray, phi between ray and jig axis."""

    name = "incidence_bias"
    of = "instrument"
    noun = "the instrument's error with the angle of incidence"
    equation = "b (1 - cos phi) along the ray"
    symbols = (("b", "mm"),)
    needs = "jig attitudes that vary"
    confirm = "one place with the jig turned in steps toward and away from the scanner"
    bounds = (NaturalBound(3.0, "mm", "scanners are off by tenths of a millimetre at grazing incidence"),)
    notes = r"""
    $$ \delta p = b \, ( 1 - \cos \, \phi ) \, \rho $$

    along the ray $\rho$, with $\phi$ the angle between ray and the jig's axis. For a jig with faces only; mirrors and
    balls do not turn away.
    """
    position = 15
    linear = True
    parameters = (Parameter("b_mm", "mm", 0.1, "range error at grazing incidence"),)

    def apply(self, state: RobotState, *, b_mm: float) -> RobotState:
        """Robot state with the reported points moved along the ray."""
        if state.seen is None:
            return state
        ray = state.seen.scanner_mm / np.maximum(np.linalg.norm(state.seen.scanner_mm, axis=1), 1e-9)[:, None]
        axis = np.einsum("nij,nj->ni", state.seen.scanner_T_base[:, :3, :3], state.loaded.chain.base_T_flange[:, :3, 2])
        cosine = np.abs(np.einsum("ni,ni->n", ray, axis))
        return state.displace_in_scanner(b_mm * (1.0 - cosine)[:, None] * ray)

    @classmethod
    def family(cls, dataset: Dataset) -> Family:
        """Family of this effect with one member, where the target is a jig."""
        if dataset.robot.carries_scanner:
            return cls.untestable(
                "the scanner is on the flange, and the orientation of the jig in the world is no part of the model",
                "put the scanner beside the arm and the jig on the flange",
            )
        if not dataset.shows_faces:
            return cls.untestable(
                "points.csv is of mirrors or balls, as a tracker measures them, and these have no faces that turn away",
                "where the points are of a jig with faces, say so in dataset.toml: [jig]",
            )
        return Family(cls.name, (cls(),))


@dataclass(frozen=True)
class ScannerScale(CatalogueEffect):
    """An isotropic scale error of the scanner: p times 1 + s, the same as a scaling of every length of the arm."""

    name = "scanner_scale"
    of = "instrument"
    noun = "the scale of the instrument"
    equation = "p times 1 + s"
    symbols = (("s", "1"),)
    needs = "a length standard; not testable without one"
    bounds = (NaturalBound(5e-3, "1", "instruments are made to 1e-4 and better"),)
    notes = r"""
    $$ p \to p \, ( 1 + s ) $$

    It equals a scaling of every length of the arm, so nothing is left of it after a fit, whatever the poses. A
    certified length, measured with the same scanner, tells it.
    """
    position = 16
    testable = False
    linear = True
    parameters = (Parameter("s", "1", 1e-4, "scale error"),)

    def apply(self, state: RobotState, *, s: float) -> RobotState:
        """Robot state with the reported points scaled."""
        return state if state.seen is None else state.displace_in_scanner(s * state.seen.scanner_mm)

    @classmethod
    def family(cls, dataset: Dataset) -> Family:
        """Family of this effect with one member, untestable, as only arm lengths relative to the scale are known."""
        return Family(
            cls.name,
            (cls(),),
            why_not="a scale error of the scanner equals a scaling of every length of the arm",
            would_help="measure a certified length (a ball bar, two targets on a gauge) with the same scanner",
        )
