"""Computation of a refined corner's quality figures, from the three planes, their points and their covariance."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from calib.array_types import Array
from calib.corners.correlated_noise.plane_uncertainty import PlaneUncertainty
from calib.corners.faces.face_outline import FaceOutline, outline_shares
from calib.corners.intersection import intersection_covariance
from calib.corners.quality import CornerQuality, FaceQuality, angle_figures, incidence_deg
from calib.jig import Jig, Outline
from calib.planes.robust_fit import PlaneFit, height_lever


def height_covariance(planes: Sequence[PlaneFit], covariance: Array, point_mm: Array) -> Array:
    """Covariance (3, 3), mm^2, of the three planes' heights at one point (3,), from the planes' covariance (9, 9)."""
    lever = height_lever(planes, point_mm)
    return lever @ covariance @ lever.T


def quality_figures(
    planes: Sequence[PlaneFit],
    known: PlaneUncertainty,
    origin: Array,
    apex: Array,
    jig: Jig,
    outline: Outline,
    margin_mm: float,
    scan_sigma_mm: float | None,
    smooth_declared_mm: float,
) -> CornerQuality:
    """Quality figures of a refined corner of three free planes.

    origin, apex  # (3,) the first apex in the scanner's frame, and the last one about it.
    """
    normals = np.array([p.normal for p in planes])

    def apex_sigma_mm(plane_covariance: Array) -> float:
        heights = height_covariance(planes, plane_covariance, apex)
        return float(np.sqrt(np.trace(intersection_covariance(normals, heights))))

    def face(index: int) -> FaceQuality:
        plane = planes[index]
        slopes = known.covariance[3 * index + 1 : 3 * index + 3, 3 * index + 1 : 3 * index + 3]
        others = [p for p in planes if p is not plane]
        along = np.column_stack([np.abs(plane.points_mm @ p.normal - p.offset_mm) for p in others])
        filled, _, _ = outline_shares(
            along, np.zeros(len(along), dtype=bool), along[:0], FaceOutline.of(outline, index)
        )
        over_declared = None if not scan_sigma_mm else plane.sigma_mm / scan_sigma_mm
        return FaceQuality(
            len(plane.indices), incidence_deg(plane, origin), filled, plane.sigma_mm, over_declared,
            float(np.degrees(np.sqrt(np.linalg.eigvalsh(slopes)[-1]))),
        )  # fmt: skip

    middles = np.sqrt(sum(known.covariance[3 * i, 3 * i] for i in range(3)))
    return CornerQuality(
        faces=(face(0), face(1), face(2)),
        **angle_figures(planes, known.covariance, jig.face_angles_deg),
        condition=float(np.linalg.cond(normals)),
        amplification=apex_sigma_mm(known.covariance) / float(middles),
        smooth_error_mm=known.correlated_sigma_mm,
        smooth_length_mm=known.correlation_length_mm,
        smooth_factor=apex_sigma_mm(known.covariance) / apex_sigma_mm(known.white_covariance),
        margin_mm=margin_mm,
        notes=known.notes,
        smooth_declared_mm=smooth_declared_mm,
        smooth_shown_mm=known.shown_to_mm,
    )
