"""Labels of the jig's faces: alike at every pose, whichever rule gives them, or refused with a reason."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, cast

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from calib.corners.intersection import Corner
from calib.corners.search import CornerSearch
from calib.dataset.dataset import Dataset
from calib.dataset.files.points_csv import points_frame
from calib.frames import mean_rotation
from calib.jig import Jig, jig_normals
from calib.kinematics.tool_point import tool_point, with_tool_point
from calib.measurement.face_labels import FaceLabels, label_corners
from calib.measurement.measured_points import with_corners
from calib.present import to_dict
from calib.present.fit.corners import face_labelling
from calib.simulation.simulate import Simulation, simulate_dataset
from tests.support.changed import with_poses
from tests.support.jig_corners import UNEVEN, corner_of, error_rad


def labelled(
    simulation: Simulation,
    rng: np.random.Generator,
    jig: Jig = Jig(),
    *,
    sigma_rad: float = 1e-4,
) -> tuple[Dataset, dict[str, Corner], np.ndarray]:
    """Corners of the simulation by pose with their faces in any order, and the jig's true orientations (N, 3, 3)."""
    dataset = replace(simulation.dataset, jig=jig)
    seat = Rotation.random(random_state=3).as_matrix()  # the jig is screwed on anyhow
    true = simulation.scanner_T_jig[:, :3, :3] @ seat
    corners = {}
    for i, pose_id in enumerate(dataset.poses.ids):
        normals = (jig_normals(jig.face_angles_deg) @ true[i].T)[rng.permutation(3)]
        corners[pose_id] = corner_of(normals, rng, sigma_rad=sigma_rad, apex=simulation.apex_mm[i])
    return dataset, corners, true


@pytest.fixture(scope="module")
def simulation() -> Simulation:
    return simulate_dataset("rb5", rng=5, poses=30)


@pytest.mark.parametrize("jig", [Jig(), UNEVEN])
def test_the_nominal_robot_names_the_faces_alike_at_every_pose(simulation, jig):
    dataset, corners, true = labelled(simulation, np.random.default_rng(6), jig)
    result = label_corners(dataset, corners)
    assert result.by == "robot"
    assert len(result.orientations) == 30
    assert not result.refused
    assert min(result.margin.values()) > 100.0
    turns = np.array([true[i].T @ o.scanner_R_jig for i, o in enumerate(result.orientations.values())])
    np.testing.assert_allclose(turns, turns[:1].repeat(30, axis=0), atol=3e-3)
    if jig is UNEVEN:  # the angles tell which faces they are, not a convention
        np.testing.assert_allclose(turns[0], np.eye(3), atol=3e-3)
    assert result.labelling.by == "robot"
    assert len(to_dict(result)["poses"]) == 30


def test_a_jig_that_is_not_as_declared_is_measured_over_all_poses(simulation):
    """The jig is 0.03 degrees out of square, undeclared: 500 microradians, with a noise of 60."""
    real = Jig(face_angles_deg=(90.03, 89.98, 90.01))
    dataset, corners, true = labelled(simulation, np.random.default_rng(14), real, sigma_rad=2e-5)

    def squared(result: FaceLabels) -> float:
        seats = np.array([true[i].T @ o.scanner_R_jig for i, o in enumerate(result.orientations.values())])
        seat = mean_rotation(seats)
        each = []
        for i, found in enumerate(result.orientations.values()):
            off = error_rad(true[i] @ seat, found.scanner_R_jig)
            each.append(off @ np.linalg.solve(found.covariance_rad2, off))
        return float(np.median(each))

    told = label_corners(replace(dataset, jig=Jig()), corners)
    angles = told.found_angles_deg
    assert angles is not None
    np.testing.assert_allclose(
        sorted(angles), sorted(real.face_angles_deg), atol=0.003
    )  # the mean of 30 has a sigma of 0.0009
    assert "meet at" in face_labelling(told.labelling)
    assert max(o.misfit for o in told.orientations.values()) < 21.1
    assert squared(told) < 5.0  # chi-squared of three has its median at 2.4
    right = label_corners(dataset, corners)
    assert right.found_angles_deg is None
    certified = label_corners(replace(dataset, jig=Jig(certified=True)), corners)
    assert certified.found_angles_deg is None
    assert np.median([o.misfit for o in certified.orientations.values()]) > 21.1


def test_corners_become_full_poses_where_their_faces_are_named(simulation):
    dataset, corners, true = labelled(simulation, np.random.default_rng(13))
    turned = Rotation.from_rotvec([1.05, 0.0, 0.0]).as_matrix() @ true[4]
    corners["p05"] = corner_of(turned.T, np.random.default_rng(8), apex=simulation.apex_mm[4])
    none = CornerSearch("", *[cast(Any, None)] * 5, None, "no corner", 0.0)
    searches = {i: replace(none, corner=corner) for i, corner in corners.items()}
    points = with_corners(dataset, searches, orientation=True).points
    assert np.flatnonzero(~points.orientations.known).tolist() == [4]
    columns = points_frame(dataset.poses, points).columns
    assert {"qw", "rxx_rad2", "z_rz_mm_rad"} <= set(columns)
    plain = with_corners(dataset, searches).points
    assert plain.orientations is None
    assert list(points_frame(dataset.poses, plain).columns) == list(columns[:10])


def test_a_pose_that_the_robot_contradicts_is_refused(simulation):
    dataset, corners, true = labelled(simulation, np.random.default_rng(7))
    turned = Rotation.from_rotvec([1.05, 0.0, 0.0]).as_matrix() @ true[4]
    corners["p05"] = corner_of(turned.T, np.random.default_rng(8), apex=simulation.apex_mm[4])
    result = label_corners(dataset, corners)
    assert set(result.refused) == {"p05"}
    assert "from the nominal robot's prediction" in result.refused["p05"]


def test_without_a_placed_scanner_unequal_angles_name_the_faces(simulation):
    dataset, corners, true = labelled(simulation, np.random.default_rng(9), UNEVEN)
    two = {pose_id: corners[pose_id] for pose_id in ("p01", "p02")}
    marked = label_corners(dataset, two)
    assert marked.by == "angles"
    for i, found in enumerate(marked.orientations.values()):
        assert np.linalg.norm(error_rad(true[i], found.scanner_R_jig)) < 3e-3


def two_poses(simulation: Simulation, turn_deg: float, second: np.ndarray):
    """Two poses of a square jig, the second one rotated as given, and joint 1 by the given angle."""
    dataset = replace(simulation.dataset, jig=Jig())
    q = dataset.poses.q.copy()
    q[1] = q[0]
    q[1, 0] += np.radians(turn_deg)  # about an axis that stands still
    rng = np.random.default_rng(10)
    corners = {"p01": corner_of(np.eye(3), rng), "p02": corner_of(second.T[[2, 0, 1]], rng)}
    return with_poses(dataset, q=q), corners


def test_without_a_placed_scanner_each_pose_is_named_as_the_one_before(simulation):
    small = Rotation.from_rotvec(np.radians([12.0, -6.0, 17.0])).as_matrix()
    dataset, corners = two_poses(simulation, 21.66, small)
    followed = label_corners(dataset, corners)
    assert followed.by == "continuity"
    first, second = (o.scanner_R_jig for o in followed.orientations.values())
    np.testing.assert_allclose(second @ first.T, small, atol=2e-3)
    assert "small turns from pose to pose" in face_labelling(followed.labelling)


def test_continuity_refuses_what_it_cannot_know_and_says_what_would_help(simulation):
    wild = Rotation.from_rotvec([np.pi / 3, 0.0, 0.0]).as_matrix()
    refused = label_corners(*two_poses(simulation, 60.0, wild)).refused
    assert set(refused) == {"p02"}
    assert "2 corners of its setup do not place the scanner" in refused["p02"]
    assert "unequal face_angles_deg" in refused["p02"]
    # By a turn of 120 degrees about its diagonal the jig looks as if it had not moved; the joint angles know.
    third = Rotation.from_rotvec(np.full(3, 2.0 * np.pi / 3.0 / np.sqrt(3.0))).as_matrix()
    looks_still = label_corners(*two_poses(simulation, 120.0, third))
    assert set(looks_still.refused) == {"p02"}
    assert "120 deg by the joint angles" in looks_still.refused["p02"]
    dataset, corners = two_poses(simulation, 0.0, np.eye(3))
    moved = np.array(["a", "b", *dataset.poses.setup[2:]])
    elsewhere = label_corners(with_poses(dataset, setup=moved), corners)
    assert "the scanner's setup is not that of p01" in elsewhere.refused["p02"]
    assert "1 corner of its setup" in elsewhere.refused["p02"]


def test_a_tool_point_far_off_names_the_faces_all_the_same(simulation):
    dataset, corners, _ = labelled(simulation, np.random.default_rng(6))
    right = label_corners(dataset, corners)
    point_mm = tool_point(dataset.robot.table) + np.array([0.0, 0.0, 250.0])
    wrong = label_corners(replace(dataset, robot=with_tool_point(dataset.robot, point_mm)), corners)
    assert not wrong.refused
    assert min(wrong.margin.values()) > 100.0
    assert [o.order for o in wrong.orientations.values()] == [o.order for o in right.orientations.values()]


def test_a_robot_that_does_not_fit_the_corners_is_told(simulation):
    """One joint's sign is wrong: its predictions label nothing, and the reason says where to look."""
    dataset, corners, _ = labelled(simulation, np.random.default_rng(7))
    q = dataset.poses.q.copy()
    q[:, 2] *= -1.0
    result = label_corners(with_poses(dataset, q=q), corners)
    assert len(result.orientations) < 10
    assert all("the joint angles with their signs" in reason for reason in result.refused.values())


def test_a_robot_that_is_wrong_at_many_poses_names_none(simulation):
    """The corner lies on the last joint's axis: with that joint's sign wrong all places fit and attitudes do not."""
    dataset, corners, _ = labelled(simulation, np.random.default_rng(7))
    q = dataset.poses.q.copy()
    q[:, 5] *= -1.0
    result = label_corners(with_poses(dataset, q=q), corners)
    assert result.by == "continuity"
    assert len(result.orientations) < 10
    assert all("of the last joint above all" in reason for reason in result.refused.values())
    marked, corners, true = labelled(simulation, np.random.default_rng(7), UNEVEN)  # such a jig needs no robot
    by_angles = label_corners(with_poses(marked, q=q), corners)
    assert by_angles.by == "angles"
    for i, found in enumerate(by_angles.orientations.values()):
        assert np.linalg.norm(error_rad(true[i], found.scanner_R_jig)) < 3e-3
