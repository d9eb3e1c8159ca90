"""Reasons to refuse a corner whose three refined planes cannot be the jig's faces."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from calib.array_types import Array
from calib.corners.faces.face_outline import FaceOutline, along_edges, share_beyond
from calib.corners.quality import incidence_deg
from calib.errors import CornerError
from calib.jig import FACE_PAIRS, Jig, Outline
from calib.planes.robust_fit import TUKEY, PlaneFit

_SQUARENESS_DEG = 1.0
_MOST_INCIDENCE_DEG = 84.0
_DEEP = 0.035  # of the edge: points of which nine in ten lie nearer to an edge than this are not a face's
_ROUGHEST = 10.0  # times the scatter of the other faces; a face seen at 84 deg scatters some 6 times as much
_ROUGH = 1 / 3000  # of the edge: a scatter below this is not compared
_MOST_TILT_DEG = 3.0  # standard deviation of a face's direction; a depth camera's of a box are known to 1 to 2


@dataclass(frozen=True)
class RefinedFaces:
    """Three refined planes with their scan and jig, for the decision whether these are the jig's faces."""

    planes: Sequence[PlaneFit]  # three, about `origin_mm`
    covariance: Array  # (9, 9) of the planes' heights (mm) and slopes (rad) in turn
    points_mm: Array  # (N, 3) of the scan near the apex, about `origin_mm`
    origin_mm: Array  # (3,) first estimate of the apex, scanner frame
    jig: Jig
    outline: Outline  # of the faces in this order

    def tilt_deg(self) -> Array:
        """Standard deviation (3,) of each plane's direction in its weakest direction, deg."""
        slopes = [self.covariance[3 * i + 1 : 3 * i + 3, 3 * i + 1 : 3 * i + 3] for i in range(3)]
        return np.array([np.degrees(np.sqrt(np.linalg.eigvalsh(slope)[-1])) for slope in slopes])


def require_faces(faces: RefinedFaces) -> None:
    """Raise CornerError with the first reason in `_REFUSALS` that holds."""
    for reason_of in _REFUSALS:
        if reason := reason_of(faces):
            raise CornerError(reason)


def _goes_on_beyond_border(faces: RefinedFaces) -> str:
    """Reason where a plane goes on beyond the far border of its rectangle, else "".

    The planes before refinement are too inexact for this in noise: a long box leaves their tolerance at its end.
    """
    if not faces.outline.rectangular:
        return ""
    heights = np.column_stack([faces.points_mm @ plane.normal - plane.offset_mm for plane in faces.planes])
    for face, plane in enumerate(faces.planes):
        on = np.abs(heights[:, face]) < TUKEY * plane.sigma_mm
        one, other = along_edges(heights[on], face, faces.jig)
        legs_mm = FaceOutline.of(faces.outline, face).legs_mm
        a, b = one / legs_mm[0], other / legs_mm[1]
        for leg_mm, share in zip(legs_mm, (share_beyond(a, b), share_beyond(b, a)), strict=True):
            if share:
                return (
                    f"a face of {legs_mm[0]:g} x {legs_mm[1]:g} mm goes on beyond its {leg_mm:g} mm: the corner of "
                    f"something larger; correct edge_mm ({faces.jig.edges_text()}) or clear the view"
                )
    return ""


def _is_edge_on(faces: RefinedFaces) -> str:
    """Reason where a face would be seen at too large an incidence, else ""."""
    for plane in faces.planes:
        seen_at_deg = incidence_deg(plane, faces.origin_mm)
        if seen_at_deg > _MOST_INCIDENCE_DEG:
            return (
                f"the third face would be seen edge-on ({len(plane.indices)} points, {seen_at_deg:.1f} deg off its "
                f"normal; beyond {_MOST_INCIDENCE_DEG:g} deg stray points along an edge look the same); "
                "turn the jig so that three faces are seen"
            )
    return ""


def _is_bevel(faces: RefinedFaces) -> str:
    """Reason where the points of a face all lie near its edges, else ""."""
    for plane in faces.planes:
        others = [other for other in faces.planes if other is not plane]
        legs_mm = [np.abs(plane.points_mm @ other.normal - other.offset_mm) for other in others]
        deep_mm = float(np.quantile(np.min(legs_mm, axis=0), 0.9))
        if deep_mm < _DEEP * faces.jig.shortest_mm:
            return (
                f"the {len(plane.indices)} points taken for one of the faces lie within {deep_mm:.2g} mm of its edges, "
                "as those of a bevel do; turn the jig so that three faces are seen"
            )
    return ""


def _is_rough(faces: RefinedFaces) -> str:
    """Reason where the points of one face scatter far more than those of the other faces, else ""."""
    scatter_mm = np.array([plane.sigma_mm for plane in faces.planes])
    usual_mm = max(float(np.median(scatter_mm)), _ROUGH * faces.jig.shortest_mm)
    if scatter_mm.max() <= _ROUGHEST * usual_mm:
        return ""
    rough = faces.planes[int(np.argmax(scatter_mm))]
    return (
        f"the {len(rough.indices)} points taken for one of the faces scatter {rough.sigma_mm:.2g} mm, those of the "
        f"others {usual_mm:.2g} mm: they are no plane; turn the jig so that three faces are seen"
    )


def _is_loose(faces: RefinedFaces) -> str:
    """Reason where a face's direction is so uncertain that any angle between the faces would pass, else ""."""
    tilt_deg = faces.tilt_deg()
    loose = int(np.argmax(tilt_deg))
    if tilt_deg[loose] <= _MOST_TILT_DEG:
        return ""
    return (
        f"the {len(faces.planes[loose].indices)} points taken for one of the faces determine its direction to "
        f"{tilt_deg[loose]:.2g} deg only, where {_MOST_TILT_DEG:g} deg will do; turn the jig so that three faces "
        "are seen, or scan it finer"
    )


def _is_out_of_square(faces: RefinedFaces) -> str:
    """Reason where two faces meet at an angle that is no jig's, within its uncertainty, else ""."""
    tilt_deg = faces.tilt_deg()
    nominal_slack_deg = _SQUARENESS_DEG + faces.jig.out_of_square_deg()
    for i, j in FACE_PAIRS:
        cosine = np.clip(faces.planes[i].normal @ faces.planes[j].normal, -1, 1)
        off_deg = float(np.degrees(np.arcsin(cosine)))
        slack_deg = nominal_slack_deg + 3 * np.hypot(tilt_deg[i], tilt_deg[j])
        if abs(off_deg) > slack_deg:
            return (
                f"two of the faces meet {abs(off_deg):.2f} deg out of square, more than {slack_deg:.2f} deg; "
                "look at the chosen planes, and check face_angles_deg in dataset.toml"
            )
    return ""


_REFUSALS: tuple[Callable[[RefinedFaces], str], ...] = (
    _goes_on_beyond_border,
    _is_edge_on,
    _is_bevel,
    _is_rough,
    _is_loose,
    _is_out_of_square,
)
"""Each gives "what was found, with its numbers; what would help", or "". The first that holds refuses the corner."""
