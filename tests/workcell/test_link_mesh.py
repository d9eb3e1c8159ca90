"""Meshes of links: read in the link's own frame, or refused in one line."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from calib.dataset.dataset import Dataset
from calib.dataset.files import triangles
from calib.errors import DatasetError
from calib.simulation.simulate import simulate_dataset
from calib.workcell.bodies.link_mesh import load_link_mesh
from tests.support.tiny_dataset import box_stl


def dataset_with(folder: Path, mesh: str | None) -> Dataset:
    """Dataset whose second joint names this mesh."""
    dataset = simulate_dataset("rb5", rng=0, poses=8).dataset
    joints = list(dataset.robot.joints)
    joints[1] = replace(joints[1], mesh=mesh)
    return replace(dataset, folder=folder, robot=replace(dataset.robot, joints=tuple(joints)))


def test_a_mesh_comes_with_its_corners_in_mm(tmp_path: Path) -> None:
    (tmp_path / "meshes").mkdir()
    (tmp_path / "meshes" / "link2.stl").write_text(box_stl((1.0, 2.0, 3.0)))
    dataset = dataset_with(tmp_path, "meshes/link2.stl")
    mesh = load_link_mesh(dataset, 1)
    assert mesh.triangles.shape == (1, 3)
    expected = [[1, 2, 3], [11, 2, 3], [1, 22, 3]]
    np.testing.assert_allclose(sorted(mesh.vertices_mm[mesh.triangles[0]].tolist()), sorted(expected))
    assert load_link_mesh(dataset, 0) is None


@pytest.mark.parametrize(
    ("name", "says"),
    [
        ("../outside.stl", "outside the dataset's folder"),
        ("/etc/hostname", "outside the dataset's folder"),
        ("missing.stl", "no such file"),
        ("folder.stl", "no such file"),
        ("notes.md", ".stl, .ply, .obj, .off, .glb would do"),
        ("broken.stl", "cannot be read|no triangles"),
        ("empty.obj", "cannot be read|no triangles"),
        ("nan.obj", "no triangles with finite corners"),
    ],
)
def test_what_cannot_be_drawn_is_refused_in_one_line(tmp_path: Path, name: str, says: str) -> None:
    folder = tmp_path / "cell"
    folder.mkdir()
    (tmp_path / "outside.stl").write_text(box_stl((0, 0, 0)))
    (folder / "folder.stl").mkdir()
    (folder / "notes.md").write_text("no mesh")
    (folder / "broken.stl").write_bytes(b"\x00" * 90)
    (folder / "empty.obj").write_text("")
    (folder / "nan.obj").write_text("v nan 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    with pytest.raises(DatasetError, match=says) as caught:
        load_link_mesh(dataset_with(folder, name), 1)
    assert "\n" not in str(caught.value)
    assert "joint 2" in str(caught.value)


def test_a_mesh_that_is_too_large_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "link.stl").write_text(box_stl((0, 0, 0)))
    monkeypatch.setattr(triangles, "MOST_TRIANGLES", 0)
    with pytest.raises(DatasetError, match="1 triangles; 0 or fewer"):
        load_link_mesh(dataset_with(tmp_path, "link.stl"), 1)
