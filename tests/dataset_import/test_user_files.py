"""Kinds of a user's files, recognised by suffix and content, the likeliest first."""

from __future__ import annotations

import zipfile
from pathlib import Path

import pytest

from calib.dataset_import.import_dataset import unpacked
from calib.dataset_import.user_files import look_through
from calib.errors import CalibError
from calib.text_files.user_table import load_table
from tests.support.tiny_dataset import box_stl

JOINTS = "pose,q1,q2,q3\n1,0.1,0.2,0.3\n"
POINTS = "pose,x,y,z\n1,100,200,300\n"
FILES = {
    "arm.urdf": "<robot name='a'/>",
    "package.xml": "<package/>",
    "model.xml": "<robot/>",
    "robot.toml": "[[joints]]\na_mm = 1.0\n",
    "notes.toml": "a = 1\n",
    "config.yaml": "a: 1\n",
    "dh.csv": "theta_deg,d_m,a_m,alpha_deg\n0,1,2,3\n",
    "joints.csv": JOINTS,
    "tracker.csv": POINTS,
    "both.txt": "q1 q2 x y z\n1 2 3 4 5\n",
    "bare.csv": "1,2,3,4,5,6,7,8,9\n",
    "achsen_joint.csv": "alpha [deg];beta [deg]\n1;2\n",
    "readme.txt": "hello\n",
    "mesh/link.stl": box_stl((0.0, 0.0, 0.0)),
    "photo.jpg": "x",
}


def written(folder: Path, files: dict[str, str]) -> Path:
    for name, content in files.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(content)
    return folder


def test_each_file_is_recognised(tmp_path: Path) -> None:
    found = look_through(written(tmp_path, FILES))
    kinds = {str(file.path.relative_to(tmp_path)): file.kind for file in found.files}
    assert kinds == {
        "arm.urdf": "robot",
        "package.xml": "not used",
        "model.xml": "robot",
        "robot.toml": "robot",
        "notes.toml": "not used",
        "config.yaml": "not used",
        "dh.csv": "robot",
        "joints.csv": "joints",
        "tracker.csv": "points",
        "both.txt": "joints and points",
        "bare.csv": "joints and points",
        "achsen_joint.csv": "joints",
        "readme.txt": "not used",
        "mesh/link.stl": "not used",
        "photo.jpg": "not used",
    }
    assert all(file.why for file in found.files)
    assert found.robots[0].name == "robot.toml"
    assert not found.datasets


def test_joints_and_points_of_their_own_go_before_a_table_of_both(tmp_path: Path) -> None:
    found = look_through(written(tmp_path, {"j.csv": JOINTS, "p.csv": POINTS}))
    assert (found.joints, found.points) == (tmp_path / "j.csv", tmp_path / "p.csv")
    both = look_through(written(tmp_path / "both", {"log.csv": "q1,q2,x,y,z\n1,2,3,4,5\n"}))
    assert (both.joints, both.points) == (tmp_path / "both" / "log.csv", None)


def test_clouds_are_scans_and_so_are_many_texts_of_three_numbers(tmp_path: Path) -> None:
    clouds = look_through(written(tmp_path / "a", {f"scans/p{i}.ply": "ply\n" for i in range(3)} | {"j.csv": JOINTS}))
    assert sorted(clouds.scans) == ["p0", "p1", "p2"]
    texts = look_through(written(tmp_path / "b", {f"p{i}.txt": "1 2 3\n4 5 6\n" for i in range(5)} | {"j.csv": JOINTS}))
    assert sorted(texts.scans) == [f"p{i}" for i in range(5)]
    single = look_through(written(tmp_path / "c", {"tracker.txt": "1 2 3\n4 5 6\n", "j.csv": JOINTS}))
    assert not single.scans
    assert single.points == tmp_path / "c" / "tracker.txt"


def test_links_and_hidden_files_are_passed_over(tmp_path: Path) -> None:
    written(tmp_path / "in", {"j.csv": JOINTS, ".secret.csv": POINTS})
    written(tmp_path, {"outside.csv": POINTS})
    (tmp_path / "in" / "p.csv").symlink_to(tmp_path / "outside.csv")
    assert [file.path.name for file in look_through(tmp_path / "in").files] == ["j.csv"]


def test_a_zip_is_unpacked_while_inside_and_gone_after(tmp_path: Path) -> None:
    with zipfile.ZipFile(tmp_path / "a.zip", "w") as archive:
        archive.writestr("cell/j.csv", JOINTS)
    with unpacked(tmp_path / "a.zip") as files:
        folder = files.folder
        assert files.joints == folder / "cell" / "j.csv"
    assert not folder.exists()
    with pytest.raises(CalibError, match="no such file"), unpacked(tmp_path / "b.zip"):
        pass
    (tmp_path / "empty").mkdir()
    with pytest.raises(CalibError, match="holds no file"), unpacked(tmp_path / "empty"):
        pass
    written(tmp_path, {"x.csv": JOINTS})
    with pytest.raises(CalibError, match="is no zip"), unpacked(tmp_path / "x.csv"):
        pass


TABLE = "pose;Größe;q1 [°];q2 [°];x [mm];y [mm];z [mm]\np1;ä;1,5;2;3;4;5\np2;ß;2,5;3;4;5;6\n"


@pytest.mark.parametrize(
    "encoding", ["utf-8", "utf-8-sig", "utf-16", "utf-16-le", "utf-16-be", "utf-32", "cp1252", "latin-1"]
)
def test_tables_come_in_any_encoding_that_a_spreadsheet_writes(tmp_path: Path, encoding: str) -> None:
    path = tmp_path / "measured.csv"
    for text in (TABLE, TABLE.replace(";", "\t").replace("\n", "\r\n"), TABLE + "p3;ü;1;2;3;4;5\n" * 2000):
        path.write_bytes(text.encode(encoding))
        table = load_table(path, any_encoding=True)
        assert table.columns[:3] == ("pose", "Größe", "q1 [°]")
        assert table.text("Größe")[:2] == ["ä", "ß"]
        assert table.lines[:2] == (2, 3)
        files = look_through(tmp_path)
        assert files.joints == path
