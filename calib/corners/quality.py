"""Quality figures of a corner, and warnings derived from them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TypedDict

import numpy as np

from calib.array_types import Array, Vector
from calib.brief import Brief
from calib.corners.faces.angles import Plane, angle_derivative, fitted_angles_deg
from calib.planes.robust_fit import PlaneFit

HIGH_INCIDENCE_DEG = 75.0
FEW_POINTS = 50
LOW_COVERAGE = 0.4
HIGH_RMS = 3.0  # times the scanner's own figure
HIGH_AMPLIFICATION = 6.0
OUT_OF_SQUARE_SIGMA = 4.0
_MORE_THAN_DECLARED = 2.0  # times the declared correlated error: one scan shows its size to a factor of 2
_LONG_OF_SHOWN = 0.6  # a smooth error whose length is more than this share of the longest that a scan shows
HIGH_SMOOTH_SHARE = 1.5  # corner's sigma over what white noise alone would give


@dataclass(frozen=True)
class FaceQuality:
    """Quality figures of one face."""

    points: int
    incidence_deg: float  # between the line of sight to the face's middle and its normal
    coverage: float  # 0..1, share of the jig's face that has points
    rms_mm: float  # of the points' heights over the plane
    rms_over_scan_sigma: float | None  # None where the scanner's sigma is not known
    tilt_sigma_deg: float  # standard deviation of the plane's tilt in its weakest direction


@dataclass(frozen=True)
class CornerQuality(Brief):
    """Quality figures of a corner, and warnings derived from them."""

    faces: tuple[FaceQuality, FaceQuality, FaceQuality]
    angles_deg: Vector  # as measured, between faces 1-2, 2-3, 3-1
    angle_sigmas_deg: Vector
    angle_errors_deg: Vector  # measured less the jig's, under the labelling that fits best
    condition: float  # of the three normals: 1 where perpendicular; the worst amplification over the best
    amplification: float  # sigma of the apex over that of the planes at their middles: how far it is extrapolated
    smooth_error_mm: float  # standard deviation of the correlated part of the scanner's error
    smooth_length_mm: float  # its correlation length
    smooth_factor: float  # sigma of the apex over what white noise alone would make it
    margin_mm: float  # strip left out along every edge: rounding, blurred and flying pixels
    notes: tuple[str, ...] = field(default=(), metadata={"key": None})  # from the search itself, among the doubts
    smooth_declared_mm: float = 0.0  # as dataset.toml declares it; 0: not declared
    smooth_shown_mm: float = 0.0  # the longest correlation length of which this scan shows anything
    angles_held: str = ""  # as in `JigAngles.held`

    @property
    def rigid(self) -> bool:
        """Whether the angles between the faces are held at those of the jig."""
        return self.angles_held == "jig"

    def doubts(self) -> tuple[str, ...]:
        """Warnings about the corner, each with its number and what would help; () where there are none."""
        warnings = list(self.notes)
        for number, face in enumerate(self.faces, start=1):
            if face.incidence_deg > HIGH_INCIDENCE_DEG:
                warnings.append(
                    f"face {number} is seen at {face.incidence_deg:.0f}° off its normal; turn the jig so that all "
                    f"faces stay below {HIGH_INCIDENCE_DEG:.0f}°"
                )
            if face.points < FEW_POINTS:
                warnings.append(f"face {number} has {face.points} points only; scan finer or clear the view to it")
            if face.coverage < LOW_COVERAGE:
                warnings.append(f"only {100 * face.coverage:.0f} % of face {number} is seen; clear the view to it")
            if face.rms_over_scan_sigma is not None and face.rms_over_scan_sigma > HIGH_RMS:
                warnings.append(
                    f"face {number} scatters {face.rms_mm:.3g} mm, {face.rms_over_scan_sigma:.1f} times scan_sigma_mm; "
                    "clean the face, check the exposure, or correct scan_sigma_mm"
                )
        for pair, error, sigma in zip(("1-2", "2-3", "3-1"), self.angle_errors_deg, self.angle_sigmas_deg, strict=True):
            if abs(error) > max(OUT_OF_SQUARE_SIGMA * sigma, 0.02):
                warnings.append(
                    f"faces {pair} meet {error:+.3f}° off the jig's angle ({abs(error) / sigma:.0f} sigma); "
                    "measure the jig and give face_angles_deg, or look for something on the faces"
                )
        if self.amplification > HIGH_AMPLIFICATION:
            warnings.append(
                f"the apex is {self.amplification:.1f} times less certain than the planes at their middles; "
                "more of the faces near the apex has to be seen"
            )
        if (
            self.smooth_factor > HIGH_SMOOTH_SHARE
            and self.smooth_error_mm > _MORE_THAN_DECLARED * self.smooth_declared_mm
        ):
            warnings.append(
                f"the scanner's error is smooth over {self.smooth_length_mm:.0f} mm ({self.smooth_error_mm:.3f} mm), "
                f"which makes the apex {self.smooth_factor:.1f} times less certain; {self._advice_on_smooth_error()}"
            )
        return tuple(warnings)

    def _advice_on_smooth_error(self) -> str:
        """Advice on how to determine correlated errors of longer range than one scan can show."""
        if self.smooth_length_mm > _LONG_OF_SHOWN * self.smooth_shown_mm:
            return (
                "that is as far as this scan shows anything: repeats of the same pose with the jig moved in the view "
                "tell whether it is the scanner, or the shape of a face or of a surface around it"
            )
        return (
            f"only repeats with the jig moved in the view show what is smoother than {self.smooth_shown_mm:.0f} mm, "
            "or correlated_sigma_mm in dataset.toml declares it"
        )


class AngleFigures(TypedDict):
    """Angles between three faces: those fields of `CornerQuality` that follow from the planes."""

    angles_deg: Vector
    angle_sigmas_deg: Vector
    angle_errors_deg: Vector


def angle_figures(planes: Sequence[Plane], covariance: Array, jig_angles_deg: Vector) -> AngleFigures:
    """Angles between three planes of joint covariance (9, 9), with their sigmas and errors."""
    angles = fitted_angles_deg(planes)
    derivative = angle_derivative(planes) / np.sin(np.radians(angles))[:, None]
    one, two, three = np.degrees(np.sqrt(np.diag(derivative @ covariance @ derivative.T))).tolist()
    first, second, third = angle_errors(angles, jig_angles_deg).tolist()
    return AngleFigures(angles_deg=angles, angle_sigmas_deg=(one, two, three), angle_errors_deg=(first, second, third))


def angle_errors(angles_deg: Vector, jig_angles_deg: Vector) -> Array:
    """Measured minus nominal angles between the faces (3,), deg, under the labelling with the least errors.

    Rotating or mirroring the numbering of three faces permutes the three angles in every possible way.
    """
    measured = np.array(angles_deg)
    order = np.argsort(measured)
    errors = np.empty(3)
    errors[order] = measured[order] - np.sort(jig_angles_deg)
    return errors


def incidence_deg(plane: PlaneFit, origin: Array) -> float:
    """Angle between the plane's normal and the line of sight to the middle of its points."""
    way = plane.centre_mm + origin
    return float(np.degrees(np.arccos(np.abs(plane.normal @ way) / np.linalg.norm(way))))
