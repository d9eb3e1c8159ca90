"""E57 files as pye57 and libE57 write them; choice among several scans; damaged files; the library missing."""

from __future__ import annotations

import builtins
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from calib.dataset.files.fingerprint import fingerprint
from calib.dataset.files.folder import dataset_files, load_dataset, write_dataset
from calib.errors import DatasetError, ScanError
from calib.jig import Jig
from calib.scans.scan import load_scan
from tests.support.arms import dataset_of, jang_arm
from tests.support.scan_mutations import MUTATIONS

pye57 = pytest.importorskip("pye57")
E57, libe57 = pye57.E57, pye57.libe57

RNG = np.random.default_rng(8)
POINTS = RNG.uniform(-0.3, 0.9, (400, 3)).astype(np.float32).astype(np.float64)  # metres, in the scanner's frame
QUARTER_TURN = np.array([np.sqrt(0.5), 0.0, 0.0, np.sqrt(0.5)])  # w x y z


def write(path: Path, *scans: tuple[str, NDArray], invalid: NDArray | None = None) -> None:
    with E57(str(path), mode="w") as file:
        for name, points in scans:
            data = {f"cartesian{axis}": column for axis, column in zip("XYZ", points.T, strict=True)}
            if invalid is not None:
                data["cartesianInvalidState"] = invalid
            file.write_scan_raw(data, name=name, rotation=QUARTER_TURN, translation=np.array([9.0, 8.0, 7.0]))


def test_the_scanners_own_frame_in_millimetres(tmp_path: Path) -> None:
    write(tmp_path / "a.e57", ("left", POINTS))
    scan = load_scan(tmp_path / "a.e57")
    assert (scan.name, scan.dropped, scan.normals) == ("a", 0, None)
    np.testing.assert_allclose(scan.points_mm, 1000 * POINTS, rtol=1e-12)
    with E57(str(tmp_path / "a.e57")) as file:  # the pose is in the file, and would move the points
        moved = file.read_scan(0, ignore_missing_fields=True)
    assert abs(moved["cartesianX"] - POINTS[:, 0]).min() > 5


def test_what_is_marked_invalid_is_dropped_and_counted(tmp_path: Path) -> None:
    state = (np.arange(400) % 5 == 0) * (1 + np.arange(400) % 2)  # 1: a direction alone, 2: nothing
    write(tmp_path / "a.e57", ("left", POINTS), invalid=state.astype(np.int8))
    scan = load_scan(tmp_path / "a.e57")
    assert scan.dropped == 80
    np.testing.assert_allclose(scan.points_mm, 1000 * POINTS[state == 0], rtol=1e-12)


def test_spherical_coordinates_as_scaled_integers(tmp_path: Path) -> None:
    """Azimuth from x towards y, elevation from their plane; written by libE57 itself, to 1 um and 1 urad."""
    span = np.linalg.norm(POINTS, axis=1)
    azimuth, elevation = np.arctan2(POINTS[:, 1], POINTS[:, 0]), np.arcsin(POINTS[:, 2] / span)
    columns = {"sphericalRange": span, "sphericalAzimuth": azimuth, "sphericalElevation": elevation}
    with E57(str(tmp_path / "a.e57"), mode="w") as file:
        image = file.image_file
        prototype = libe57.StructureNode(image)
        for name in columns:
            prototype.set(name, libe57.ScaledIntegerNode(image, 0, -(2**31), 2**31 - 1, 1e-6, 0.0))
        points = libe57.CompressedVectorNode(image, prototype, libe57.VectorNode(image, True))
        scan = libe57.StructureNode(image)
        scan.set("guid", libe57.StringNode(image, "{1}"))
        scan.set("points", points)  # no name: a scan need not have one
        file.data3d.append(scan)
        buffers = libe57.VectorSourceDestBuffer()
        for name, column in columns.items():
            buffers.append(libe57.SourceDestBuffer(image, name, column, len(column), True, True))
        writer = points.writer(buffers)
        writer.write(400)
        writer.close()
    np.testing.assert_allclose(load_scan(tmp_path / "a.e57").points_mm, 1000 * POINTS, atol=2e-3)


def test_of_several_scans_one_is_named(tmp_path: Path) -> None:
    write(
        tmp_path / "cell.e57",
        ("left", POINTS),
        ("2", 2 * POINTS),
        ("right", 3 * POINTS),
        ("right", 4 * POINTS),
    )
    for part, times in {"left": 1, "2": 2, "1": 1, "3": 3, "4": 4}.items():
        scan = load_scan(tmp_path / f"cell.e57#{part}")
        assert scan.name == f"cell.e57#{part}"
        np.testing.assert_allclose(scan.points_mm, 1000 * times * POINTS, rtol=1e-6)  # written as float32
    with pytest.raises(ScanError, match=r"4 scans \(1 'left', 2 '2', 3 'right', 4 'right'\), which one is not said"):
        load_scan(tmp_path / "cell.e57")
    for part in ("right", "5", "up"):
        with pytest.raises(ScanError, match=f"none of them is '{part}'; write cell.e57#1"):
            load_scan(tmp_path / f"cell.e57#{part}")
    with pytest.raises(ScanError, match="no such file"):
        load_scan(tmp_path / "other.e57#1")


def test_a_dataset_whose_scans_lie_in_one_file(tmp_path: Path) -> None:
    robot = jang_arm()
    dataset = dataset_of(robot, robot, np.random.default_rng(0), poses=3, test=0)
    names = tuple(f"cell.e57#{pose_id}" for pose_id in dataset.poses.ids)
    poses = replace(dataset.poses, scan_names=names)
    dataset = replace(dataset, points=None, folder=None, scan_folder="scans", poses=poses, jig=Jig())
    write_dataset(dataset, tmp_path / "one")
    write(tmp_path / "one" / "scans" / "cell.e57", *((pose_id, POINTS) for pose_id in dataset.poses.ids))
    loaded = load_dataset(tmp_path / "one")
    assert [path.name for path in dataset_files(loaded) if path.parent.name == "scans"] == ["cell.e57"]
    assert [name for name in fingerprint(loaded) if name.startswith("scans/")] == ["scans/cell.e57"]
    write_dataset(loaded, tmp_path / "two")  # with the file
    for pose in range(3):
        path = load_dataset(tmp_path / "two").scan_path(pose)
        assert path is not None
        assert len(load_scan(path).points_mm) == 400
    (tmp_path / "two" / "scans" / "cell.e57").unlink()
    with pytest.raises(DatasetError, match="no such scan"):
        load_dataset(tmp_path / "two")


def test_a_cut_file_an_empty_one_and_another(tmp_path: Path) -> None:
    write(tmp_path / "a.e57", ("left", POINTS))
    whole = (tmp_path / "a.e57").read_bytes()
    for content, said in {
        whole[:-1024]: f"promises {len(whole)} bytes, it holds {len(whole) - 1024}",
        whole[:20]: "promises",
        b"ply\n" + whole[4:]: "not an .e57",
        whole[:1200] + b"x" + whole[1201:]: "not a readable .e57",
    }.items():
        (tmp_path / "a.e57").write_bytes(content)
        with pytest.raises(ScanError, match=said) as caught:
            load_scan(tmp_path / "a.e57")
        assert "\n" not in str(caught.value)
    with E57(str(tmp_path / "none.e57"), mode="w"):
        pass
    with pytest.raises(ScanError, match="holds no scan"):
        load_scan(tmp_path / "none.e57")


@pytest.mark.parametrize("mutation", MUTATIONS)
def test_a_damaged_file_is_points_or_one_error(
    tmp_path: Path, mutation: str, capfd: pytest.CaptureFixture[str]
) -> None:
    write(tmp_path / "a.e57", ("left", POINTS))
    whole = (tmp_path / "a.e57").read_bytes()
    for seed in range(10):
        (tmp_path / "a.e57").write_bytes(MUTATIONS[mutation](np.random.default_rng(seed), whole))
        said = ""
        try:
            load_scan(tmp_path / "a.e57")
        except ScanError as error:
            said = str(error)
        assert not said or said.startswith(str(tmp_path / "a.e57"))
        assert "\n" not in said
        assert len(said) < len(str(tmp_path)) + 400
    assert capfd.readouterr() == ("", "")


def test_without_the_library_it_says_what_to_install(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write(tmp_path / "a.e57", ("left", POINTS))
    whole_import = builtins.__import__

    def without(name: str, *rest: Any, **more: Any) -> Any:
        if name == "pye57":
            raise ImportError(name)
        return whole_import(name, *rest, **more)

    monkeypatch.setattr(builtins, "__import__", without)
    with pytest.raises(ScanError, match=r"pip install 'robot-calibration-inspector\[e57\]'"):
        load_scan(tmp_path / "a.e57")
