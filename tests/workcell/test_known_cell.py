"""The cell of a robot and of a dataset: what is assumed, and what follows from measured points."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from calib import frames
from calib.dataset.dataset import Box, Dataset, Points, Poses, Scanner, Surroundings
from calib.dataset.files.folder import load_dataset
from calib.dataset.files.robot_toml import load_robot_toml
from calib.errors import CalibError
from calib.kinematics.robot import Target
from calib.workcell.bodies.link_mesh import load_link_mesh
from calib.workcell.candidates import candidate_poses
from calib.workcell.known_cell import workcell_of_dataset, workcell_of_robot
from calib.workcell.measurable import BOX, FLOOR, HIDDEN, LIMIT, measurable
from calib.workcell.scan_field import BoxField, ScanField
from tests.support import ROOT


@pytest.mark.slow
@pytest.mark.parametrize("name", ["rb5", "panda"])
def test_a_robot_alone_has_poses_that_can_be_measured(name: str) -> None:
    cell = workcell_of_robot(load_robot_toml(ROOT / "calib" / "robots" / f"{name}.toml"))
    q = candidate_poses(cell, 50, rng=np.random.default_rng(1))
    assert q.shape == (50, len(cell.low))
    assert measurable(cell, q).ok.all()
    assert any(note.startswith("scanner: assumed") for note in cell.notes)
    again = candidate_poses(cell, 50, rng=np.random.default_rng(1))
    assert np.array_equal(q, again)


def test_measured_poses_can_be_measured() -> None:
    dataset = load_dataset(ROOT / "sample_data" / "ur10_ipa")
    cell = workcell_of_dataset(dataset)
    assert measurable(cell, dataset.poses.q).ok.mean() > 0.9
    assert measurable(cell, candidate_poses(cell, 100, rng=np.random.default_rng(0))).ok.all()


@pytest.mark.slow
def test_what_is_in_the_way_is_told_in_counts() -> None:
    robot = load_robot_toml(ROOT / "calib" / "robots" / "rb5.toml")
    everywhere = Box("wall", (-3000.0, -3000.0, -100.0), (3000.0, 3000.0, 3000.0))
    cell = workcell_of_robot(robot, surroundings=Surroundings(0.0, (everywhere,)))
    with pytest.raises(CalibError, match=r"found 0 of 5 .* tries .*\d+ the arm in a box"):
        candidate_poses(cell, 5, rng=np.random.default_rng(0))
    above = replace(cell, boxes=(), floor_z_mm=5000.0)
    q = candidate_poses(replace(cell, boxes=()), 20, rng=np.random.default_rng(0))
    assert set(measurable(cell, q).reason) == {BOX}
    assert set(measurable(above, q).reason) == {FLOOR}
    assert set(measurable(cell, q + 2.1 * np.pi).reason) == {LIMIT}


def simulated(noise_mm: float = 0.02) -> Dataset:
    """RB5 dataset of points whose jig a scanner saw in its field."""
    robot = load_robot_toml(ROOT / "calib" / "robots" / "rb5.toml")
    rng = np.random.default_rng(4)
    cell = workcell_of_robot(robot)
    assert cell.base_T_scanner is not None
    q = candidate_poses(cell, 40, rng=rng)
    seen_mm = frames.apply(frames.invert(cell.base_T_scanner), cell.chain(q).target_mm)
    poses = Poses(
        ids=tuple(f"p{k}" for k in range(40)),
        role=np.array(["reference"] + ["train"] * 39),
        q=q,
        setup=np.full(40, ""),
        scan_names=tuple(f"p{k}.ply" for k in range(40)),
    )
    points = Points(np.arange(40), seen_mm + noise_mm * rng.standard_normal(seen_mm.shape), np.full(40, "jig"))
    return Dataset("seen", robot, poses, points)


def test_a_dataset_tells_its_scanner_s_place_and_field() -> None:
    dataset = simulated()
    truth = workcell_of_robot(dataset.robot)
    cell = workcell_of_dataset(dataset)
    assert np.allclose(cell.base_T_scanner[:3, 3], truth.base_T_scanner[:3, 3], atol=0.5)
    assert isinstance(cell.field, ScanField)
    assert abs(cell.field.distance_mm - 700.0) < 60.0
    assert 330.0 <= cell.field.width_mm <= 420.0  # 330 mm in which the apexes were, and 40 either side
    assert measurable(cell, dataset.poses.q).ok.all()
    assert cell.jig is not None
    told = Scanner(field_mm=(200.0, 200.0, 100.0), distance_mm=700.0, max_incidence_deg=60.0)
    narrow = workcell_of_dataset(replace(dataset, scanner=told)).field
    assert isinstance(narrow, ScanField)
    assert (narrow.width_mm, narrow.max_incidence_deg) == (200.0, 60.0)


def test_what_dataset_toml_tells_of_the_cell_is_asked() -> None:
    box = Box("fixture", (-50.0, -50.0, -50.0), (50.0, 50.0, 50.0))
    told = replace(simulated(), surroundings=Surroundings(-30.0, (box,), 0.1))
    cell = workcell_of_dataset(told)
    assert (cell.floor_z_mm, cell.boxes, cell.least_manipulability) == (-30.0, (box,), 0.1)
    assert not any(note.startswith("floor") for note in cell.notes)
    around = replace(box, min_mm=(-900.0, -900.0, 300.0), max_mm=(900.0, 900.0, 900.0))
    doubtful = workcell_of_dataset(replace(told, surroundings=Surroundings(None, (around,))))
    assert any("in the way at 40 of 40 measured poses" in note for note in doubtful.notes)


def test_a_jig_that_was_seen_from_the_side_points_to_the_side() -> None:
    dataset = simulated()
    tool = dataset.robot.tool
    aside = replace(dataset.robot, tool=replace(tool, alpha_rad=np.pi / 2))  # the same point, turned axes
    cell = workcell_of_dataset(replace(dataset, robot=aside))
    assert cell.jig is not None
    assert any(note.startswith("jig: seen from") for note in cell.notes)
    real = workcell_of_robot(dataset.robot)
    into = cell.chain(dataset.poses.q).base_T_frame[:, -1, :3, :3] @ cell.tool_T_jig[:3, 2]
    true_into = real.chain(dataset.poses.q).base_T_frame[:, -1, :3, :3] @ real.tool_T_jig[:3, 2]
    assert np.degrees(np.arccos(np.sum(into * true_into, axis=1).clip(-1, 1))).max() < 8.0


def test_points_all_around_ask_for_no_faces() -> None:
    dataset = load_dataset(ROOT / "sample_data" / "hidden_effect_a")
    cell = workcell_of_dataset(dataset)
    assert cell.jig is None
    assert isinstance(cell.field, BoxField)
    q = candidate_poses(cell, 100, rng=np.random.default_rng(0))
    assert measurable(cell, q).ok.all()


def test_further_targets_tell_the_scanner_s_place_as_well() -> None:
    dataset = simulated()
    ball = Target("ball", (12.0, -40.0, 80.0))
    robot = replace(dataset.robot, targets=(ball,))
    truth = workcell_of_robot(dataset.robot)
    assert truth.base_T_scanner is not None
    flange = truth.chain(dataset.poses.q).base_T_flange
    ball_mm = flange[:, :3, :3] @ np.array(ball.xyz_mm) + flange[:, :3, 3]
    points = Points(
        dataset.points.pose,
        frames.apply(frames.invert(truth.base_T_scanner), ball_mm),
        np.full(40, "ball"),
    )
    cell = workcell_of_dataset(replace(dataset, robot=robot, points=points))
    assert cell.base_T_scanner is not None
    assert np.allclose(cell.base_T_scanner, truth.base_T_scanner, atol=1e-6)
    assert cell.jig is None  # balls have no faces
    assert measurable(cell, dataset.poses.q).ok.all()


def test_an_unknown_setup_is_refused_with_those_there_are() -> None:
    with pytest.raises(CalibError, match=r"no setup 'B'; its setups are "):
        workcell_of_dataset(simulated(), setup="B")


@pytest.mark.slow
def test_a_link_s_mesh_hides_as_it_is_and_not_as_its_capsule(tmp_path: Path) -> None:
    import trimesh

    dataset = simulated()
    joints = list(dataset.robot.joints)
    joints[5] = replace(joints[5], mesh="flange.stl")
    disc = trimesh.creation.annulus(r_min=150.0, r_max=160.0, height=5.0)  # a ring about the line of sight
    disc.apply_translation([0.0, 0.0, -120.0])  # before the jig: [tool] d_mm is -88
    disc.export(tmp_path / "flange.stl")
    ringed = replace(dataset, robot=replace(dataset.robot, joints=tuple(joints)), folder=tmp_path)
    cell = workcell_of_dataset(ringed)
    assert 5 in cell.bodies.meshes
    through = measurable(cell, dataset.poses.q).ok
    assert through.all()  # its bounding capsule would hide every face
    trimesh.creation.cylinder(160.0, 5.0).apply_translation([0.0, 0.0, -120.0]).export(tmp_path / "flange.stl")
    closed = replace(cell, bodies=workcell_of_dataset(ringed).bodies)
    bodies = replace(closed.bodies, hides=cell.bodies.hides, meshes={5: load_link_mesh(ringed, 5)})
    assert set(measurable(replace(cell, bodies=bodies), dataset.poses.q).reason) == {HIDDEN}
