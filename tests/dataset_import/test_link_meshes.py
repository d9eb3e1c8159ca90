"""Meshes of a URDF's links at the import: they move with the arm as the URDF says, and nothing else is read."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import pytest

from calib import load_dataset, write_dataset
from calib.dataset_import.user_files import look_through
from calib.kinematics.chain import nominal_chain
from calib.robot_formats.robot_file import ReadOptions, read_robot
from calib.workcell.bodies.link_mesh import load_link_mesh
from inspector.cli.parser import main
from tests.support.mesh_urdf import corners_mm, in_order, link_frames, write_package

Q = np.random.default_rng(3).uniform(-1.5, 1.5, (24, 6))


def write_tables(folder: Path) -> tuple[str, str]:
    """Tables of joints and of the points that the tip reaches."""
    joints, points = folder / "joints.csv", folder / "points.csv"
    with joints.open("w", newline="") as file:
        csv.writer(file).writerows([[f"q{k + 1}_rad" for k in range(6)], *Q.tolist()])
    with points.open("w", newline="") as file:
        csv.writer(file).writerows([["x_mm", "y_mm", "z_mm"], *(link_frames(q)[-1][:3, 3].tolist() for q in Q)])
    return str(joints), str(points)


def importing(folder: Path, urdf: Path, *more: str) -> tuple[int, Path]:
    joints, points = write_tables(folder)
    out = folder / f"cell{len(more)}"
    told = ("import", str(out), "--robot", str(urdf), "--joints", joints, "--points", points)
    return main([*told, "--sigma", "0.05", *more]), out


def test_meshes_stand_where_the_urdf_puts_them(tmp_path, capsys):
    code, out = importing(tmp_path, write_package(tmp_path))
    assert code == 0
    assert "meshes of 6 links are taken" in capsys.readouterr().out
    copy = tmp_path / "copy"
    write_dataset(load_dataset(out), copy)
    for folder in (out, copy):
        dataset = load_dataset(folder)
        robot = dataset.robot
        assert [joint.mesh for joint in robot.joints] == [f"meshes/joint{k + 1}.stl" for k in range(6)]
        frames = nominal_chain(robot, Q[:3]).base_T_frame
        for q, at in zip(Q[:3], frames, strict=True):
            for k, true in enumerate(corners_mm(q)):
                mesh = load_link_mesh(dataset, k)
                placed = mesh.vertices_mm @ at[k + 1][:3, :3].T + at[k + 1][:3, 3]
                assert in_order(placed) == pytest.approx(true, abs=0.005)


def test_a_package_elsewhere_is_given_by_its_folder(tmp_path, capsys):
    urdf = write_package(tmp_path)
    alone = tmp_path / "alone" / "arm.urdf"
    alone.parent.mkdir()
    alone.write_bytes(urdf.read_bytes())
    code, out = importing(tmp_path, alone)
    assert code == 0
    assert load_dataset(out).robot.joints[5].mesh is None
    assert "give its folder by --package my_arm=FOLDER" in capsys.readouterr().out
    code, out = importing(tmp_path, alone, "--package", f"my_arm={urdf.parents[1]}")
    assert code == 0
    assert load_dataset(out).robot.joints[5].mesh is not None


@pytest.mark.parametrize("name", ["package://my_arm/../secret.stl", "../../secret.stl", "file:///{0}/secret.stl"])
def test_no_mesh_is_read_from_outside(tmp_path, name):
    urdf = write_package(tmp_path)
    (tmp_path / "secret.stl").write_bytes((urdf.parents[1] / "meshes" / "part.stl").read_bytes())
    text = urdf.read_text().replace("package://my_arm/meshes/part.stl", name.format(tmp_path))
    urdf.write_text(text)
    # A file of this machine is for the user's own command, and not where a visitor brings the robot.
    read = read_robot(urdf, ReadOptions(packages=None if name.startswith("file") else {}))
    assert read.meshes == ()
    assert any("are left out" in note for note in read.notes)


def test_packages_are_not_looked_for_where_nobody_named_the_file(tmp_path):
    urdf = write_package(tmp_path)
    assert look_through(tmp_path / "my_arm" / "urdf").robots == (urdf,)
    assert read_robot(urdf).meshes == ()
