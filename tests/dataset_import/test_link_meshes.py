"""Meshes of a URDF's links at the import: they move with the arm as the URDF says, and nothing else is read."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import pytest
import trimesh

from calib import load_dataset, write_dataset
from calib.dataset_import.user_files import look_through
from calib.kinematics.chain import nominal_chain
from calib.robot_formats.robot_file import ReadOptions, read_robot
from calib.robot_formats.urdf.meshes import stl_of_links
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


COLLADA = """<?xml version="1.0"?>
<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">
<asset><unit name="centimeter" meter="0.01"/><up_axis>Y_UP</up_axis></asset>
<library_images><image id="i"><init_from>/etc/passwd</init_from></image></library_images>
<library_geometries><geometry id="g"><mesh>
<source id="s"><float_array id="f" count="24">{}</float_array><technique_common>
<accessor source="#f" count="8" stride="3"><param name="X" type="float"/><param name="Y" type="float"/>
<param name="Z" type="float"/></accessor></technique_common></source>
<vertices id="v"><input semantic="POSITION" source="#s"/></vertices>
<triangles count="12"><input semantic="VERTEX" source="#v" offset="0"/><p>{}</p></triangles>
</mesh></geometry></library_geometries>
<library_visual_scenes><visual_scene id="a"><node id="n"><scale>2 2 2</scale><instance_geometry url="#g"/></node>
</visual_scene></library_visual_scenes><scene><instance_visual_scene url="#a"/></scene></COLLADA>
"""


def with_collada(folder: Path) -> Path:
    """The package with the same box in COLLADA: in cm, its node twice as large as its numbers."""
    urdf = write_package(folder)
    meshes = urdf.parents[1] / "meshes"
    box = trimesh.load_mesh(meshes / "part.stl")
    words = [" ".join(map(str, part.ravel().tolist())) for part in (50.0 * box.vertices, box.faces)]
    (meshes / "part.dae").write_text(COLLADA.format(*words))
    (meshes / "part.stl").unlink()
    urdf.write_text(urdf.read_text().replace("part.stl", "part.dae"))
    return urdf


def test_collada_is_read_in_its_unit(tmp_path, capsys):
    pytest.importorskip("collada")
    urdf = with_collada(tmp_path)
    code, out = importing(tmp_path, urdf)
    assert code == 0, capsys.readouterr().err
    dataset = load_dataset(out)
    frames = nominal_chain(dataset.robot, Q[:1]).base_T_frame
    for k, true in enumerate(corners_mm(Q[0])):
        mesh = load_link_mesh(dataset, k)
        at = frames[0][k + 1]
        assert in_order(mesh.vertices_mm @ at[:3, :3].T + at[:3, 3]) == pytest.approx(true, abs=0.005)
    mesh = urdf.parents[1] / "meshes" / "part.dae"
    for old, new, told in (
        ('<?xml version="1.0"?>', '<!DOCTYPE x [<!ENTITY e "e">]>', "part.dae"),
        ('meter="0.01"', 'meter="nan"', "its unit is no length"),
    ):
        mesh.write_text(COLLADA.replace(old, new))
        parts, notes = stl_of_links(read_robot(urdf, ReadOptions(packages={})).meshes)
        assert parts == (None,) * 6
        assert all(told in note for note in notes)


def test_collada_without_its_package_is_told(tmp_path, monkeypatch):
    monkeypatch.setattr("calib.robot_formats.urdf.meshes.find_spec", lambda name: None)
    read = read_robot(with_collada(tmp_path), ReadOptions(packages={}))
    assert read.meshes == ()
    assert any("pip install 'robot-calibration-inspector[collada]'" in note for note in read.notes)


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
