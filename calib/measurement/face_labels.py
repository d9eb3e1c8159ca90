"""Which face of the jig is which, at every pose: what makes orientations of one jig comparable.

Three equal faces look alike under turns by 120 degrees. What tells them apart, in this order:

* `robot`: the corners' positions and the nominal arm give the scanner's frame, and so the attitude of the tool to a
  degree or so. How the jig sits on the tool, tool_R_jig, is unknown but the same at all poses: the right labels are
  those that make it the same. One cyclic shift of the labels of all poses together remains, a mere convention: face 1
  is the one whose normal lies nearest the tool's x axis, unless the jig's angles tell its faces apart;
* `angles`: a jig whose measured `face_angles_deg` differ by more than the scans' noise;
* `continuity`: without either, each pose is labelled as the one before it, which holds for small turns between poses of
  one setup; where the joint angles give another turn than the faces do, the pose is refused.

No jig is square to a scan's microradians. Where the mean angles of its faces over all poses differ from the jig's, and
those are not certified, the mean angles take their place: otherwise the orientation of each pose would be biased in a
direction that depends on the noise of its faces.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from calib.corners.intersection import Corner
from calib.corners.orientation import candidates, oriented
from calib.dataset.dataset import Dataset
from calib.jig import Jig, angles_between_deg
from calib.measurement.labelling_rules import (
    label_by_angles,
    label_by_continuity,
    label_by_robot,
    predicted_attitudes,
)
from calib.measurement.labels import FaceLabels

_MOST_CONTRADICTED = 0.25  # of the poses: beyond it, the predictions agree with the other poses by chance
_LEAST_POSES = 5  # for a mean of the angles between the faces
_CLEARLY_OFF = 5.0  # sigmas of the total misfit


def label_corners(dataset: Dataset, corners: Mapping[str, Corner]) -> FaceLabels:
    """Label the jig's faces at all poses that have a corner.

    Raises CornerError for face angles that no jig can have.
    """
    ids = [pose_id for pose_id in dataset.poses.ids if pose_id in corners]
    three = {pose_id: candidates(corners[pose_id], dataset.jig) for pose_id in ids}
    predicted, why = predicted_attitudes(dataset, corners) if ids else ({}, {})
    unequal = len(set(dataset.jig.face_angles_deg)) > 1
    labels = label_by_robot(three, predicted, why, unequal) if predicted else None
    contradicted = 0 if labels is None else sum(pose_id in predicted for pose_id in labels.refused)
    if contradicted > max(1.0, _MOST_CONTRADICTED * len(predicted)):
        reason = (
            f"the nominal robot has the jig stand otherwise at {contradicted} of {len(predicted)} poses; check the "
            "joint angles and their signs, of the last joint above all"
        )
        labels, why = None, dict.fromkeys(ids, reason)
    if labels is None:
        labels = (label_by_angles(three) if unequal else None) or label_by_continuity(three, why, dataset)
    return _with_found_angles(labels, corners, dataset.jig)


def _with_found_angles(labels: FaceLabels, corners: Mapping[str, Corner], jig: Jig) -> FaceLabels:
    """The same labels; orientations by the mean angles between the faces where those differ from the jig's."""
    before = labels.orientations
    misfit, count = sum(o.misfit for o in before.values()), len(before)
    if jig.certified or count < _LEAST_POSES or misfit < 3.0 * count + _CLEARLY_OFF * np.sqrt(6.0 * count):
        return labels
    in_jig = np.zeros((3, 3))
    for pose_id, found in before.items():
        in_jig += np.array([corners[pose_id].faces[i].normal for i in found.order]) @ found.scanner_R_jig
    in_jig /= np.linalg.norm(in_jig, axis=1, keepdims=True)
    truer = replace(jig, face_angles_deg=angles_between_deg(in_jig))
    after = {pose_id: oriented(corners[pose_id], truer, found.order) for pose_id, found in before.items()}
    return replace(labels, orientations=after, found_angles_deg=truer.face_angles_deg)
