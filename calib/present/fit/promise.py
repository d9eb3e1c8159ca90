"""What is told of the errors that a model promises for unseen poses, and how the test poses kept to it."""

from __future__ import annotations

from typing import Any

from calib.calibration.promise import PointPromise
from calib.dataset.dataset import Poses
from calib.rendering import numbers
from calib.statistics import rms

COVERAGE = "90 % intervals"


def coverage_words(promise: PointPromise) -> str:
    """Words on the promised sigma and its coverage: "cover 91 % of 900 test coordinates (sigma 0.07 mm)"; or ""."""
    share = promise.coverage_90
    if share is None:
        return ""
    sigma_mm = rms(promise.sigma_mm[promise.is_test])
    count = promise.error_mm[promise.is_test].size
    of_points = f"promised sigma {numbers.length(sigma_mm)} per coordinate"
    return f"cover {100.0 * share:.0f} % of {count} test coordinates; {of_points}"


def coverage_sentence(promise: PointPromise) -> str:
    """Sentence on the coverage of 90 % intervals; "" without test poses."""
    words = coverage_words(promise)
    return f"{COVERAGE} of the error {words}." if words else ""


def promise_document(promise: PointPromise, poses: Poses) -> dict[str, Any]:
    """JSON keys of all measured points with the sigma promised for a pose that no fit saw, and the coverage."""
    return {
        "poses": [
            {"pose": poses.ids[pose], "role": poses.role[pose], "target": target, "error_mm": error, "sigma_mm": sigma}
            for pose, target, error, sigma in zip(
                promise.pose, promise.target.tolist(), promise.error_mm, promise.sigma_mm, strict=True
            )
        ],
        "coverage_90": promise.coverage_90,
    }
