"""Labels of the jig's faces at every pose, which make the orientations of one jig comparable.

Three equal faces look alike under rotations by 120 degrees. What distinguishes them, in this order:

* `robot`: the corners' positions and the nominal arm give the scanner's frame, and so the attitude of the tool to a
  degree or so. The hand-eye rotation of the jig on the tool, tool_R_jig, is unknown but the same at all poses: the
  right labels are those that make it the same. One cyclic shift of the labels of all poses together remains, a mere
  convention: face 1 is the one whose normal lies nearest the tool's x axis, unless the jig's angles identify its faces;
* `angles`: a jig whose measured `face_angles_deg` differ by more than the scans' noise;
* `continuity`: without either, each pose is labelled as the one before it, which holds for small rotations between
  poses of one setup; where the joint angles give another rotation than the faces do, the pose is refused.

No jig is square to a scan's microradians. Where the mean angles of its faces over all poses differ from the jig's, and
those are not certified, the mean angles take their place: otherwise the orientation of each pose would be biased in a
direction that depends on the noise of its faces.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from calib import frames
from calib.array_types import Array, IndexArray
from calib.corners.intersection import Corner
from calib.corners.orientation import Orientation, candidates, oriented
from calib.dataset.dataset import Dataset, FaceLabelling, points_from_corners
from calib.effects.link_errors import LinkErrors
from calib.errors import FitError
from calib.fitting.model import geometric_model
from calib.fitting.observations import Observations, predict_points, with_nominal_scanner_frames, with_observed_targets
from calib.fitting.tool_point import search_tool_point
from calib.jig import Jig, angles_between_deg
from calib.kinematics import chain as kinematics

LEAST_MARGIN_DEG = 60.0
"""How much nearer the best of three labellings has to be than the next; they lie 120 degrees apart."""
LEAST_MISFIT_MARGIN = 12.0
"""How much less, in squared sigmas, the angles' misfit of one labelling has to be than that of the others."""
_MEASURE_MORE = "measure three poses or more there that lie apart, and not on one line"
_MARK_IT = "or mark the jig (unequal face_angles_deg in dataset.toml)"
_MOST_LOOSE_RAD = 0.2  # rms misfit over rms spread of a setup's corners, beyond which no attitude is predicted
_HYPOTHESES = 40
_MOST_CONTRADICTED = 0.25  # of the poses: beyond it, the predictions agree with the other poses by chance
_LEAST_POSES = 5  # for a mean of the angles between the faces
_CLEARLY_OFF = 5.0  # sigmas of the total misfit

Labellings = tuple[Orientation, Orientation, Orientation]  # one for each cyclic labelling of three faces


@dataclass(frozen=True)
class FaceLabels:
    """The jig's orientation at each pose, with its faces labelled alike at all poses."""

    by: str  # "robot", "angles" or "continuity"
    orientations: Mapping[str, Orientation]  # by pose id
    off: Mapping[str, float]  # by pose id: difference of the best labelling from what was expected; see `unit`
    margin: Mapping[str, float]  # by pose id: how much larger the next-best labelling's difference is
    unit: str  # of both: "deg", or "squared sigmas" where the jig's angles decide
    refused: Mapping[str, str]  # pose id -> why its faces cannot be labelled
    found_angles_deg: tuple[float, float, float] | None = None  # used instead of the jig's, where those do not fit
    lack: str = ""  # of the first refused pose: why it has no labels, and what would help

    @property
    def labelling(self) -> FaceLabelling:
        """Summary of the labelling: its method, its least margin, and the poses without labels."""
        return FaceLabelling(
            self.by,
            len(self.orientations),
            min(self.margin.values(), default=None),
            LEAST_MARGIN_DEG if self.unit == "deg" else LEAST_MISFIT_MARGIN,
            self.unit,
            len(self.refused),
            next(iter(self.refused.items()), None),
            self.found_angles_deg,
        )


def label_corners(dataset: Dataset, corners: Mapping[str, Corner]) -> FaceLabels:
    """Labels of the jig's faces at all poses that have a corner.

    Raises CornerError for face angles that no jig can have.
    """
    ids = [pose_id for pose_id in dataset.poses.ids if pose_id in corners]
    three = {pose_id: candidates(corners[pose_id], dataset.jig) for pose_id in ids}
    predicted, why = predicted_attitudes(dataset, corners) if ids else ({}, {})
    unequal = len(set(dataset.jig.face_angles_deg)) > 1
    labels = _label_by_robot(three, predicted, why, unequal) if predicted else None
    contradicted = 0 if labels is None else sum(pose_id in predicted for pose_id in labels.refused)
    if contradicted > max(1.0, _MOST_CONTRADICTED * len(predicted)):
        reason = (
            f"the nominal robot predicts another orientation of the jig at {contradicted} of {len(predicted)} poses; "
            "check the joint angles and their signs, of the last joint above all"
        )
        labels, why = None, dict.fromkeys(ids, reason)
    if labels is None:
        labels = (_label_by_angles(three) if unequal else None) or _label_by_continuity(three, why, dataset)
    return _with_measured_angles(labels, corners, dataset.jig)


def _with_measured_angles(labels: FaceLabels, corners: Mapping[str, Corner], jig: Jig) -> FaceLabels:
    """Labels with orientations by the mean measured angles between faces, where these differ from the jig's angles."""
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


def _turn_deg(rotation: Array) -> Array:
    """Angles (...,) in deg of rotations (..., 3, 3)."""
    cosine = 0.5 * (np.trace(rotation, axis1=-2, axis2=-1) - 1.0)
    return np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0)))


def predicted_attitudes(dataset: Dataset, corners: Mapping[str, Corner]) -> tuple[dict[str, Array], dict[str, str]]:
    """Predicted scanner_R_tool (3, 3) by pose id, from nominal arm and corners; and reasons for poses without one.

    Only for setups whose corners are spread enough to determine the scanner's frame.
    """
    points = points_from_corners(
        dataset,
        {pose_id: corner.xyz_mm for pose_id, corner in corners.items()},
        {pose_id: corner.covariance_mm2 for pose_id, corner in corners.items()},
    )
    try:
        observed = Observations.of_all(dataset.with_points(points))
    except FitError as error:
        return {}, dict.fromkeys(corners, str(error))
    robot = with_observed_targets(dataset.robot, observed)
    if not robot.carries_scanner:
        robot = search_tool_point(observed, LinkErrors(robot), ()) or robot
    model = geometric_model(robot)
    x = np.zeros(len(model.parameters))
    observed = with_nominal_scanner_frames(observed, robot)
    assert observed.scanner_T_base is not None
    base_mm = predict_points(model, x, observed)
    attitude = _nominal_attitudes(dataset)
    predicted: dict[str, Array] = {}
    why: dict[str, str] = {}
    for setup, scanner_T_base in observed.scanner_T_base.items():
        rows = np.flatnonzero(observed.setup == setup)
        ids = [dataset.poses.ids[pose] for pose in points.pose[rows]]
        spread = np.linalg.svd(base_mm[rows] - base_mm[rows].mean(axis=0), compute_uv=False)
        off_mm = np.linalg.norm(frames.apply(scanner_T_base, base_mm[rows]) - points.xyz_mm[rows])
        rms_mm = [float(value) / np.sqrt(len(rows)) for value in (off_mm, spread[1] if len(rows) > 1 else 0.0)]
        if len(rows) < 3 or rms_mm[1] < 1.0:
            few = f"{len(rows)} corner{'' if len(rows) == 1 else 's'}"
            why |= dict.fromkeys(ids, f"{few} of its setup do not place the scanner; {_MEASURE_MORE}")
        elif rms_mm[0] > _MOST_LOOSE_RAD * rms_mm[1]:
            reason = (
                f"the nominal robot has the corners of its setup {rms_mm[0]:.3g} mm (rms) from where they are, too far "
                "to place the scanner; check robot.toml, the joint angles with their signs, and the order of the poses"
            )
            why |= dict.fromkeys(ids, reason)
        else:
            placed = scanner_T_base[:3, :3]
            predicted |= {i: placed @ attitude[pose] for i, pose in zip(ids, points.pose[rows], strict=True)}
    return predicted, why


def _nominal_attitudes(dataset: Dataset) -> Array:
    """base_R_tool (N, 3, 3) of all poses; flange_R_base where the arm carries the scanner."""
    chain = kinematics.nominal_chain(dataset.robot, dataset.poses.q)
    if dataset.robot.carries_scanner:
        return np.swapaxes(chain.base_T_flange[:, :3, :3], 1, 2)
    return chain.base_T_frame[:, -1, :3, :3]


def _label_by_robot(
    three: Mapping[str, Labellings], predicted: Mapping[str, Array], why: Mapping[str, str], unequal: bool
) -> FaceLabels:
    """Labels under which the jig's rotation on the tool is the same at all poses.

    `predicted` is scanner_R_tool (3, 3) by pose id, `why` the reason where there is none; `unequal` says whether the
    jig's angles differ.
    """
    ids = [pose_id for pose_id in three if pose_id in predicted]
    # tool_R_jig (K, 3, 3, 3) for each pose and each labelling.
    hand_eye = np.array([[predicted[i].T @ o.scanner_R_jig for o in three[i]] for i in ids])
    tool_R_jig = _most_agreed(hand_eye)
    turn_deg = _turn_deg(np.swapaxes(tool_R_jig, -1, -2) @ hand_eye)  # (K, 3)
    best = np.argmin(turn_deg, axis=1)
    shift = _common_shift(three, ids, hand_eye, best, unequal)
    off, margin = _best_and_margin(turn_deg)
    refused = {i: why[i] for i in three if i not in predicted}
    refused |= {
        pose_id: f"the jig is {off[row]:.3g} deg from the nominal robot's prediction, under the next labelling "
        f"{off[row] + margin[row]:.3g} deg; check that pose's joint angles, or leave its orientation out"
        for row, pose_id in enumerate(ids)
        if margin[row] < LEAST_MARGIN_DEG
    }
    labelled = {i: three[i][(best[row] + shift) % 3] for row, i in enumerate(ids) if i not in refused}
    by_id = {i: row for row, i in enumerate(ids) if i not in refused}
    return FaceLabels(
        "robot",
        labelled,
        {i: float(off[row]) for i, row in by_id.items()},
        {i: float(margin[row]) for i, row in by_id.items()},
        "deg",
        refused,
        lack=next(iter(refused.values()), ""),
    )


def _most_agreed(hand_eye: Array) -> Array:
    """Rotation tool_R_jig (3, 3) with which most poses agree under one of their labellings, as a mean over these poses.

    hand_eye  # (K, 3, 3, 3) tool_R_jig of each pose under each labelling
    """
    tried = hand_eye[:: max(1, len(hand_eye) // _HYPOTHESES), 0]
    turns = [_turn_deg(one.T @ hand_eye) for one in tried]  # each (K, 3)
    best = int(np.argmin([np.median(turn.min(axis=1)) for turn in turns]))
    nearest = np.argmin(turns[best], axis=1)
    agreeing = turns[best].min(axis=1) < 0.5 * LEAST_MARGIN_DEG
    chosen = hand_eye[np.arange(len(hand_eye)), nearest][agreeing]
    return frames.mean_rotation(chosen)


def _common_shift(
    three: Mapping[str, Labellings], ids: list[str], hand_eye: Array, best: IndexArray, unequal: bool
) -> int:
    """Cyclic shift, 0 to 2, of all poses' labels: by the jig's angles, else with face 1 nearest the tool's x axis."""
    if unequal:
        total = [sum(three[i][(best[row] + k) % 3].misfit for row, i in enumerate(ids)) for k in range(3)]
        least, second = np.sort(total)[:2]
        if second - least > LEAST_MISFIT_MARGIN:
            return int(np.argmin(total))
    along_x = [np.mean(hand_eye[np.arange(len(hand_eye)), (best + k) % 3][:, 0, 0]) for k in range(3)]
    return int(np.argmax(along_x))


def _best_and_margin(values: Array) -> tuple[Array, Array]:
    """Least value (K,) of each row of (K, 3), and its difference from the second least (K,)."""
    ordered = np.sort(values, axis=1)
    return ordered[:, 0], ordered[:, 1] - ordered[:, 0]


def _label_by_angles(three: Mapping[str, Labellings]) -> FaceLabels | None:
    """Labels under which the jig's unequal angles fit best; None where the noise of a scan hides the difference."""
    misfits = np.array([[o.misfit for o in ways] for ways in three.values()]).reshape(-1, 3)
    off, margin = _best_and_margin(misfits)
    if np.any(margin < LEAST_MISFIT_MARGIN):
        return None
    return FaceLabels(
        "angles",
        {i: min(ways, key=lambda o: o.misfit) for i, ways in three.items()},
        dict(zip(three, off.tolist(), strict=True)),
        dict(zip(three, margin.tolist(), strict=True)),
        "squared sigmas",
        {},
    )


def _label_by_continuity(three: Mapping[str, Labellings], why: Mapping[str, str], dataset: Dataset) -> FaceLabels:
    """Labels under which each pose agrees with the pose before, where the jig turned little in between.

    At the first pose face 1 is the one nearest the scanner's x axis.
    """
    labelled: dict[str, Orientation] = {}
    off: dict[str, float] = {}
    margin: dict[str, float] = {}
    refused: dict[str, str] = {}
    attitude, setup = _nominal_attitudes(dataset), dataset.poses.setup
    before, lack = -1, ""  # the row of the pose labelled last
    for pose_id, ways in three.items():
        row = dataset.poses.index(pose_id)
        if before < 0:
            labelled[pose_id] = max(ways, key=lambda o: o.scanner_R_jig[0, 0])
            before = row
            continue
        last = dataset.poses.ids[before]
        turn_deg = _turn_deg(labelled[last].scanner_R_jig.T @ np.array([o.scanner_R_jig for o in ways]))
        (least,), (more,) = _best_and_margin(turn_deg[None])
        by_joints_deg = float(_turn_deg(attitude[before].T @ attitude[row]))
        help_ = f"{why[pose_id]}, {_MARK_IT}"
        if setup[row] != setup[before]:
            refused[pose_id] = f"the scanner's setup is not that of {last}, and {help_}"
        elif more < LEAST_MARGIN_DEG:
            refused[pose_id] = (
                f"it turned {least:.3g} deg since {last} by one name of the faces, {least + more:.3g} deg by another, "
                f"and {help_}"
            )
        elif abs(by_joints_deg - least) > 0.5 * LEAST_MARGIN_DEG:
            refused[pose_id] = (
                f"it turned {least:.3g} deg since {last} by its faces, {by_joints_deg:.3g} deg by the joint angles, "
                f"and {help_}"
            )
        else:
            labelled[pose_id] = ways[int(np.argmin(turn_deg))]
            off[pose_id], margin[pose_id] = float(least), float(more)
            before = row
        lack = lack or (help_ if pose_id in refused else "")
    return FaceLabels("continuity", labelled, off, margin, "deg", refused, lack=lack)
