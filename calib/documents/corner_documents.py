"""What `corners --json` prints. Nothing here computes."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from calib.corners.batch import CornerBatch
from calib.corners.search import CornerSearch
from calib.measurement.labels import FaceLabels
from calib.measurement.measured_points import failed_searches, label_faces
from calib.targets.assignment import Assignment, told_apart


def corners_document(searches: Mapping[str, CornerSearch], labels: FaceLabels, named: Assignment) -> dict[str, Any]:
    """What `corners --json` prints: the corners with their planes, the jig's orientations, and what failed and why.

    `targets` are all that have a name, where a dataset has others than one jig.
    """

    def scan(pose_id: str) -> dict[str, int | None]:
        count = searches[pose_id].count
        if count is None:
            return {"points": None, "dropped_points": None}
        return {"points": count.points, "dropped_points": count.dropped}

    found = []
    for pose_id, search in searches.items():
        corner = search.corner
        if corner is None:
            continue
        planes = [
            {"normal": f.normal, "offset_mm": f.offset_mm, "points": f.points, "rms_mm": f.rms_mm} for f in corner.faces
        ]
        found.append(
            {
                "pose": pose_id,
                "xyz_mm": corner.xyz_mm,
                "covariance_mm2": corner.covariance_mm2,
                "planes": planes,
                "seconds": search.seconds,
                **scan(pose_id),
                "sample_sets": search.filter_counts(),
                "plane_groups": len(search.groups),
                "quality": corner.quality.document(),
            }
        )
    failed = [
        {"pose": pose_id, "reason": reason, **scan(pose_id)} for pose_id, reason in failed_searches(searches).items()
    ]
    document = {"corners": found, "failed": failed, "orientations": labels.document()}
    return document | _targets_document(named)


def _targets_document(named: Assignment) -> dict[str, Any]:
    targets = [
        {
            "pose": pose_id,
            "target": name,
            "xyz_mm": place.xyz_mm,
            "covariance_mm2": place.covariance_mm2,
            "points": place.points,
            "rms_mm": place.rms_mm,
            "facts": dict(place.facts),
            "doubts": place.doubts,
        }
        for pose_id, of_pose in named.points.items()
        for name, place in of_pose.items()
    ]
    failed = [
        {"pose": pose_id, "target": name, "reason": reason}
        for pose_id, reasons in named.refused.items()
        for name, reason in reasons.items()
    ]
    return {"targets": targets, "targets_failed": failed} if targets or failed else {}


def batch_document(batch: CornerBatch) -> dict[str, Any]:
    """What `corners --json` prints, of the searches of a dataset's scans."""
    return corners_document(batch, label_faces(batch.dataset, batch), told_apart(batch.dataset, batch))
