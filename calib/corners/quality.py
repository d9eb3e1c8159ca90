"""Quality figures of a corner, the doubts that follow from them, and the limits beyond which there is no corner."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from calib.array_types import Array
from calib.errors import CornerError
from calib.jig import FACE_PAIRS, Jig
from calib.planes.robust_fit import PlaneFit

SQUARENESS_DEG = 1.0
MOST_INCIDENCE_DEG = 84.0
_DEEP = 0.035  # of the edge: points of which nine in ten lie nearer to an edge than this are not a face's
_ROUGHEST = 10.0  # times the scatter of the other faces; a face seen at 84 deg scatters some 6 times as much
_ROUGH = 1 / 3000  # of the edge: a scatter below this is not compared
_MOST_TILT_DEG = 3.0  # standard deviation of a face's direction; a depth camera's of a box are known to 1 to 2
HIGH_INCIDENCE_DEG = 75.0
FEW_POINTS = 50
LOW_COVERAGE = 0.4
HIGH_RMS = 3.0  # times the scanner's own figure
HIGH_AMPLIFICATION = 6.0
OUT_OF_SQUARE_SIGMA = 4.0
_MORE_THAN_TOLD = 2.0  # times the smooth error that is told: one scan shows its size to a factor of 2
_LONG_OF_SHOWN = 0.6  # a smooth error whose length is more than this share of the longest that a scan shows
HIGH_SMOOTH_SHARE = 1.5  # corner's sigma over what white noise alone would give


@dataclass(frozen=True)
class FaceQuality:
    """One face."""

    points: int
    incidence_deg: float  # between the line of sight to the face's middle and its normal
    coverage: float  # 0..1, share of the jig's face that has points
    rms_mm: float  # of the points' heights over the plane
    rms_over_scan_sigma: float | None  # None where the scanner's sigma is not known
    tilt_sigma_deg: float  # standard deviation of the plane's tilt in its weakest direction


@dataclass(frozen=True)
class CornerQuality:
    """The figures of a corner, and the doubts that follow from them."""

    faces: tuple[FaceQuality, FaceQuality, FaceQuality]
    angles_deg: tuple[float, float, float]  # as measured, between faces 1-2, 2-3, 3-1
    angle_sigmas_deg: tuple[float, float, float]
    angle_errors_deg: tuple[float, float, float]  # measured less the jig's, under the labelling that fits best
    condition: float  # of the three normals: 1 where perpendicular; the worst amplification over the best
    amplification: float  # sigma of the apex over that of the planes at their middles: how far it is extrapolated
    smooth_error_mm: float  # standard deviation of the correlated part of the scanner's error
    smooth_length_mm: float  # its correlation length
    smooth_factor: float  # sigma of the apex over what white noise alone would make it
    rigid: bool  # the faces were held to the certified angles
    margin_mm: float  # left out along every edge: rounding, blurred and flying pixels
    notes: tuple[str, ...] = field(default=())  # from the search itself
    smooth_told_mm: float = 0.0  # what dataset.toml tells of it; 0: nothing
    smooth_shown_mm: float = 0.0  # the longest correlation length of which this scan shows anything

    def doubts(self) -> tuple[str, ...]:
        """What should be checked, each with its number and what would help; () where nothing should."""
        said = list(self.notes)
        for number, face in enumerate(self.faces, start=1):
            if face.incidence_deg > HIGH_INCIDENCE_DEG:
                said.append(
                    f"face {number} is seen at {face.incidence_deg:.0f}° off its normal; turn the jig so that all "
                    f"faces stay below {HIGH_INCIDENCE_DEG:.0f}°"
                )
            if face.points < FEW_POINTS:
                said.append(f"face {number} has {face.points} points only; scan finer or clear the view to it")
            if face.coverage < LOW_COVERAGE:
                said.append(f"only {100 * face.coverage:.0f} % of face {number} is seen; clear the view to it")
            if face.rms_over_scan_sigma is not None and face.rms_over_scan_sigma > HIGH_RMS:
                said.append(
                    f"face {number} scatters {face.rms_mm:.3g} mm, {face.rms_over_scan_sigma:.1f} times scan_sigma_mm; "
                    "clean the face, check the exposure, or correct scan_sigma_mm"
                )
        for pair, error, sigma in zip(("1-2", "2-3", "3-1"), self.angle_errors_deg, self.angle_sigmas_deg, strict=True):
            if abs(error) > max(OUT_OF_SQUARE_SIGMA * sigma, 0.02):
                said.append(
                    f"faces {pair} meet {error:+.3f}° off the jig's angle ({abs(error) / sigma:.0f} sigma); "
                    "measure the jig and give face_angles_deg, or look for something on the faces"
                )
        if self.amplification > HIGH_AMPLIFICATION:
            said.append(
                f"the apex is {self.amplification:.1f} times less certain than the planes at their middles; "
                "more of the faces near the apex has to be seen"
            )
        if self.smooth_factor > HIGH_SMOOTH_SHARE and self.smooth_error_mm > _MORE_THAN_TOLD * self.smooth_told_mm:
            said.append(
                f"the scanner's error is smooth over {self.smooth_length_mm:.0f} mm ({self.smooth_error_mm:.3f} mm), "
                f"which makes the apex {self.smooth_factor:.1f} times less certain; {self._further()}"
            )
        return tuple(said)

    def _further(self) -> str:
        """What would show more of a smooth error than this scan does."""
        if self.smooth_length_mm > _LONG_OF_SHOWN * self.smooth_shown_mm:
            return (
                "that is as far as this scan shows anything: shots of the same pose with the jig moved in the view "
                "tell whether it is the scanner, or the shape of a face or of what stands beside"
            )
        return (
            f"only repeats with the jig moved in the view show what is smoother than {self.smooth_shown_mm:.0f} mm, "
            "or correlated_sigma_mm in dataset.toml tells it"
        )


def angle_errors(angles_deg: tuple[float, float, float], jig_angles_deg: tuple[float, float, float]) -> Array:
    """Measured angles less the jig's (3,), the jig's faces labelled so that the errors are least.

    Turning or mirroring the numbering of three faces permutes the three angles in every possible way.
    """
    measured = np.array(angles_deg)
    order = np.argsort(measured)
    errors = np.empty(3)
    errors[order] = measured[order] - np.sort(jig_angles_deg)
    return errors


def require_faces(planes: Sequence[PlaneFit], covariance: Array, origin: Array, jig: Jig) -> None:
    """Raise CornerError where the three refined planes cannot be the jig's faces. covariance  # (9, 9) of the planes"""
    for plane in planes:
        seen_at_deg = incidence_deg(plane, origin)
        if seen_at_deg > MOST_INCIDENCE_DEG:
            raise CornerError(
                f"the third face would be seen edge-on ({len(plane.indices)} points, {seen_at_deg:.1f} deg off its "
                f"normal; beyond {MOST_INCIDENCE_DEG:g} deg stray points along an edge look the same); "
                "turn the jig so that three faces are seen"
            )
    for plane in planes:
        legs_mm = [np.abs(plane.points_mm @ p.normal - p.offset_mm) for p in planes if p is not plane]
        deep_mm = float(np.quantile(np.min(legs_mm, axis=0), 0.9))
        if deep_mm < _DEEP * jig.shortest_mm:
            raise CornerError(
                f"the {len(plane.indices)} points taken for one of the faces lie within {deep_mm:.2g} mm of its edges, "
                "as those of a bevel do; turn the jig so that three faces are seen"
            )
    scatter = np.array([plane.sigma_mm for plane in planes])
    usual_mm = max(float(np.median(scatter)), _ROUGH * jig.shortest_mm)
    if scatter.max() > _ROUGHEST * usual_mm:
        rough = planes[int(np.argmax(scatter))]
        raise CornerError(
            f"the {len(rough.indices)} points taken for one of the faces scatter {rough.sigma_mm:.2g} mm, those of the "
            f"others {usual_mm:.2g} mm: they are no plane; turn the jig so that three faces are seen"
        )
    slopes = [covariance[3 * i + 1 : 3 * i + 3, 3 * i + 1 : 3 * i + 3] for i in range(3)]
    tilt_deg = [np.degrees(np.sqrt(np.linalg.eigvalsh(slope)[-1])) for slope in slopes]
    loose = int(np.argmax(tilt_deg))
    if tilt_deg[loose] > _MOST_TILT_DEG:  # any angle between the faces would pass
        raise CornerError(
            f"the {len(planes[loose].indices)} points taken for one of the faces tell its direction to "
            f"{tilt_deg[loose]:.2g} deg only, where {_MOST_TILT_DEG:g} deg will do; turn the jig so that three faces "
            "are seen, or scan it finer"
        )
    nominal_slack_deg = SQUARENESS_DEG + jig.out_of_square_deg()
    for i, j in FACE_PAIRS:
        off_deg = float(np.degrees(np.arcsin(np.clip(planes[i].normal @ planes[j].normal, -1, 1))))
        slack_deg = nominal_slack_deg + 3 * np.hypot(tilt_deg[i], tilt_deg[j])
        if abs(off_deg) > slack_deg:
            raise CornerError(
                f"two of the faces meet {abs(off_deg):.2f} deg out of square, more than {slack_deg:.2f} deg; "
                "look at the chosen planes, and check face_angles_deg in dataset.toml"
            )


def incidence_deg(plane: PlaneFit, origin: Array) -> float:
    """Angle between the line of sight to the middle of the plane's points and its normal."""
    way = plane.centre_mm + origin
    return float(np.degrees(np.arccos(np.abs(plane.normal @ way) / np.linalg.norm(way))))
