"""The three ways to tell the jig's equal faces apart: by the nominal robot, by unequal angles, by small turns.

Each takes, of every pose, the three orientations that the cyclic labellings of its faces give.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from calib import frames
from calib.array_types import Array, IndexArray
from calib.corners.intersection import Corner
from calib.corners.orientation import Orientation
from calib.dataset.dataset import Dataset, points_from_corners
from calib.effects.link_errors import LinkErrors
from calib.errors import FitError
from calib.fitting.model import geometric_model
from calib.fitting.observations import Observations, predict_points, with_nominal_scanner_frames, with_observed_targets
from calib.fitting.tool_point import search_tool_point
from calib.kinematics import chain as kinematics
from calib.measurement.labels import LEAST_MARGIN_DEG, LEAST_MISFIT_MARGIN, FaceLabels

Labellings = tuple[Orientation, Orientation, Orientation]  # one for each cyclic labelling of three faces

_MEASURE_MORE = "measure three poses or more there that lie apart, and not on one line"
_MARK_IT = "or mark the jig (unequal face_angles_deg in dataset.toml)"
_MOST_LOOSE_RAD = 0.2  # rms misfit over rms spread of a setup's corners, beyond which no attitude is predicted
_HYPOTHESES = 40


def _turn_deg(rotation: Array) -> Array:
    """(...,) by how much rotations (..., 3, 3) turn."""
    cosine = 0.5 * (np.trace(rotation, axis1=-2, axis2=-1) - 1.0)
    return np.asarray(np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0))))


def predicted_attitudes(dataset: Dataset, corners: Mapping[str, Corner]) -> tuple[dict[str, Array], dict[str, str]]:
    """scanner_R_tool (3, 3) by pose id, from the nominal arm and the corners' positions; of the other poses, why not.

    Only of setups whose corners are spread enough to determine the scanner's frame.
    """
    points = points_from_corners(
        dataset,
        {pose_id: corner.xyz_mm for pose_id, corner in corners.items()},
        {pose_id: corner.covariance_mm2 for pose_id, corner in corners.items()},
    )
    try:
        observed = Observations.of(dataset.with_points(points), np.ones(len(dataset.poses), dtype=bool))
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
    out: dict[str, Array] = {}
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
            words = (
                f"the nominal robot has the corners of its setup {rms_mm[0]:.3g} mm (rms) from where they are, too far "
                "to place the scanner; check robot.toml, the joint angles with their signs, and the order of the poses"
            )
            why |= dict.fromkeys(ids, words)
        else:
            placed = scanner_T_base[:3, :3]
            out |= {i: placed @ attitude[pose] for i, pose in zip(ids, points.pose[rows], strict=True)}
    return out, why


def _nominal_attitudes(dataset: Dataset) -> Array:
    """base_R_tool (N, 3, 3) of all poses; flange_R_base where the arm carries the scanner."""
    chain = kinematics.forward(
        dataset.robot.table, dataset.poses.q, dataset.robot.is_revolute, dataset.robot.base_T_first
    )
    if dataset.robot.carries_scanner:
        return np.swapaxes(chain.base_T_flange[:, :3, :3], 1, 2)
    return np.asarray(chain.base_T_frame[:, -1, :3, :3])


def label_by_robot(
    three: Mapping[str, Labellings], predicted: Mapping[str, Array], why: Mapping[str, str], unequal: bool
) -> FaceLabels:
    """The labels with which the jig sits on the tool alike at all poses.

    `predicted` is scanner_R_tool (3, 3) by pose id, `why` the reason where there is none; `unequal` says whether the
    jig's angles differ.
    """
    ids = [pose_id for pose_id in three if pose_id in predicted]
    # tool_R_jig (K, 3, 3, 3) for each pose and each labelling.
    seats = np.array([[predicted[i].T @ o.scanner_R_jig for o in three[i]] for i in ids])
    tool_R_jig = _most_agreed(seats)
    turn_deg = _turn_deg(np.swapaxes(tool_R_jig, -1, -2) @ seats)  # (K, 3)
    best = np.argmin(turn_deg, axis=1)
    shift = _common_shift(three, ids, seats, best, unequal)
    off, margin = _best_and_margin(turn_deg)
    refused = {i: why[i] for i in three if i not in predicted}
    refused |= {
        pose_id: f"the jig stands {off[row]:.3g} deg from where the nominal robot has it, the next name "
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


def _most_agreed(seats: Array) -> Array:
    """tool_R_jig (3, 3) that most poses agree with under one of their labellings; the mean over those that agree."""
    tried = seats[:: max(1, len(seats) // _HYPOTHESES), 0]
    turns = [_turn_deg(seat.T @ seats) for seat in tried]  # each (K, 3)
    best = int(np.argmin([np.median(turn.min(axis=1)) for turn in turns]))
    nearest = np.argmin(turns[best], axis=1)
    agreeing = turns[best].min(axis=1) < 0.5 * LEAST_MARGIN_DEG
    chosen = seats[np.arange(len(seats)), nearest][agreeing]
    return frames.mean_rotation(chosen)


def _common_shift(
    three: Mapping[str, Labellings], ids: list[str], seats: Array, best: IndexArray, unequal: bool
) -> int:
    """The cyclic shift of the labels of all poses: by the jig's angles, else face 1 nearest the tool's x axis."""
    if unequal:
        total = [sum(three[i][(best[row] + k) % 3].misfit for row, i in enumerate(ids)) for k in range(3)]
        least, second = np.sort(total)[:2]
        if second - least > LEAST_MISFIT_MARGIN:
            return int(np.argmin(total))
    along_x = [np.mean(seats[np.arange(len(seats)), (best + k) % 3][:, 0, 0]) for k in range(3)]
    return int(np.argmax(along_x))


def _best_and_margin(values: Array) -> tuple[Array, Array]:
    """The least value (K,) of each row of (K, 3), and the difference of the next to it (K,)."""
    ordered = np.sort(values, axis=1)
    return ordered[:, 0], ordered[:, 1] - ordered[:, 0]


def label_by_angles(three: Mapping[str, Labellings]) -> FaceLabels | None:
    """The labels with which the jig's unequal angles fit best; None where the noise of a scan hides the difference."""
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


def label_by_continuity(three: Mapping[str, Labellings], why: Mapping[str, str], dataset: Dataset) -> FaceLabels:
    """Each pose labelled as the one before it, where it turned little; the first with face 1 along the scanner's x."""
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
            refused[pose_id] = f"the scanner stands elsewhere than at {last}, and {help_}"
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
