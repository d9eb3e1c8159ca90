"""`import --images`: from rendered images of a board to a dataset, and one clear error for each possible mistake."""

from __future__ import annotations

import json
import shutil
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from calib import load_dataset, write_dataset
from calib.extras.camera.observed import camera_of
from inspector.cli.parser import main
from tests.support.camera_scene import SIZE_PX, Scene, charuco_drawing, write_images

LENS = {
    "image_width": 1280, "image_height": 960, "camera_matrix": [[1150.0, 0, 630], [0, 1146, 492], [0, 0, 1]],
    "dist_coeffs": [-0.11, 0.07, 0.0008, -0.0005, 0.01],
}  # fmt: skip
BOARD = "charuco:8x6:30:22"


@pytest.fixture(scope="module")
def cell(tmp_path_factory) -> tuple[Path, Scene]:
    """Nine images of a board by a camera on the flange, one of an empty table, joint values, and the lens."""
    folder = tmp_path_factory.mktemp("camera")
    rng = np.random.default_rng(4)
    scene = Scene.draw(rng, on_flange=True, poses=10)
    write_images(scene, folder / "images", charuco_drawing(8, 6, 30, 22), (240, 180), rng, poses=range(9), fine=1)
    cv2.imwrite(str(folder / "images" / "p10.png"), np.full(SIZE_PX[::-1], 200, np.uint8))
    scene.write_joints(folder / "joints.csv")
    (folder / "lens.json").write_text(json.dumps(LENS))
    return folder, scene


def importing(cell: Path, out: Path, *more: str, images: Path | None = None, board: str = BOARD) -> int:
    return main([
        "import", str(out), "--robot", "rb5", "--joints", str(cell / "joints.csv"),
        "--images", str(images or cell / "images"), "--board", board, *more,
    ])  # fmt: skip


@pytest.mark.slow
def test_images_become_a_dataset_with_honest_poses(cell, tmp_path, capsys):
    folder, scene = cell
    out = tmp_path / "cell"
    assert importing(folder, out, "--intrinsics", str(folder / "lens.json"), "--json") == 0
    told = json.loads(capsys.readouterr().out)
    assert any("p10.png is left out: does not show the board" in note for note in told["recognised"])
    assert any("the camera is on the flange" in note for note in told["recognised"])
    dataset = load_dataset(out)
    assert dataset.robot.carries_scanner
    assert camera_of(dataset) is not None
    assert camera_of(dataset).sigma_px < 0.1
    points = dataset.points
    assert len(points) == 9
    true = scene.camera_T_board[[scene.names.index(dataset.poses.ids[i]) for i in points.pose]]
    assert np.abs(points.xyz_mm - true[:, :3, 3]).max() < 0.15
    turn = Rotation.from_matrix(points.orientations.scanner_R_jig @ np.swapaxes(true[:, :3, :3], 1, 2))
    assert np.degrees(turn.magnitude()).max() < 0.08
    corners = camera_of(dataset).of("p1")
    off = corners.pixels - scene.pixels(0, corners.board_mm)
    assert np.abs(off).max() < 0.3
    write_dataset(dataset, tmp_path / "copy")
    again = load_dataset(tmp_path / "copy")
    assert np.allclose(camera_of(again).pixels, camera_of(dataset).pixels)
    assert camera_of(again).lens.numbers == camera_of(dataset).lens.numbers
    assert np.allclose(again.points.orientations.cross_mm_rad, points.orientations.cross_mm_rad)
    assert main(["calibrate", str(out), "--residual", "pose", "--hold", "links", "--json"]) == 0
    (place,) = json.loads(capsys.readouterr().out)["hand_eye"]
    assert place["parent"] == "flange"
    assert np.abs(np.array(place["parent_T_camera"])[:3, 3] - scene.parent_T_camera[:3, 3]).max() < 0.3
    assert main(["calibrate", str(out), "--residual", "pose", "--hand-eye-out", str(tmp_path / "tf.yaml")]) == 2
    assert "--parent-frame" in capsys.readouterr().err
    named = ["--parent-frame", "link6", "--hand-eye-out", str(tmp_path / "tf.yaml")]
    assert main(["calibrate", str(out), "--residual", "pose", "--hold", "links", *named]) == 0
    assert "frame_id: link6" in (tmp_path / "tf.yaml").read_text()


@pytest.mark.thorough
def test_a_lens_is_found_from_the_images_and_its_errors_are_shared(cell, tmp_path, capsys):
    folder, _ = cell
    assert importing(folder, tmp_path / "cell") == 0
    assert "the lens is found from the images" in capsys.readouterr().out
    dataset = load_dataset(tmp_path / "cell")
    fx, fy = camera_of(dataset).lens.numbers[:2]
    assert abs(fx - 1150) < 5
    assert abs(fy - 1146) < 5
    assert dataset.points.shared.shape == (9, 6, 9)
    write_dataset(dataset, tmp_path / "copy")
    assert np.allclose(load_dataset(tmp_path / "copy").points.shared, dataset.points.shared)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("what", "says"),
    [("mirrored", "mirrored"), ("DICT_6X6_50", "--dictionary DICT_6X6_50: the images show markers of DICT_4X4")],
)
def test_images_that_are_mirrored_or_show_another_dictionary_are_told(what, says, cell, tmp_path, capsys):
    folder, _ = cell
    images = tmp_path / "images"
    images.mkdir()
    path = folder / "images" / "p1.png"
    cv2.imwrite(str(images / path.name), cv2.imread(str(path))[:, :: -1 if what == "mirrored" else 1])
    more = ["--dictionary", what] if what.startswith("DICT") else []
    assert importing(folder, tmp_path / "cell", "--intrinsics", str(folder / "lens.json"), *more, images=images) == 2
    assert says in capsys.readouterr().err


def test_mistakes_are_told_one_by_one(cell, tmp_path, capsys, monkeypatch):
    folder, _ = cell
    images = tmp_path / "images"
    images.mkdir()
    for case, says in (
        ("empty", "holds no image"), ("broken", "can be read as an image"), ("none", "no image shows the board"),
        ("names", "add a column `image`"),
    ):  # fmt: skip
        shutil.rmtree(images)
        images.mkdir()
        if case == "broken":
            (images / "p1.png").write_bytes(b"no image")
        if case == "none":
            cv2.imwrite(str(images / "p1.png"), np.full((480, 640), 255, np.uint8))
        if case == "names":
            cv2.imwrite(str(images / "shot_a.png"), np.full((480, 640), 255, np.uint8))
        assert importing(folder, tmp_path / "out", images=images) == 2
        assert says in capsys.readouterr().err
    for more, says in (
        (["--marker-poses", "x.yaml"], "not both"), (["--dictionary", "DICT_9X9"], "no such dictionary"),
        (["--intrinsics", str(folder / "joints.csv")], "can be read"),
    ):  # fmt: skip
        assert importing(folder, tmp_path / "out", *more, images=images if "9X9" not in more[1] else None) == 2
        assert says in capsys.readouterr().err
    monkeypatch.setitem(sys.modules, "cv2", None)
    assert importing(folder, tmp_path / "out") == 2
    assert "robot-calibration-inspector[camera]" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("on_flange", [True, pytest.param(False, marks=pytest.mark.thorough)])
def test_marker_poses_of_another_program_become_a_dataset(tmp_path, capsys, on_flange):
    rng = np.random.default_rng(9)
    scene = Scene.draw(rng, on_flange=on_flange, poses=12)
    scene.write_joints(tmp_path / "joints.csv")
    samples = []
    for at in scene.camera_T_board:
        turn = Rotation.from_rotvec(rng.normal(size=3) * 2e-4) * Rotation.from_matrix(at[:3, :3])
        place = dict(zip("xyz", (at[:3, 3] / 1000 + rng.normal(size=3) * 1e-4).tolist(), strict=True))
        samples.append(
            {"optical": {"translation": place, "rotation": dict(zip("xyzw", turn.as_quat().tolist(), strict=True))}}
        )
    (tmp_path / "samples.json").write_text(json.dumps(samples))
    out = tmp_path / "cell"
    words = ["import", str(out), "--robot", "rb5", "--joints", str(tmp_path / "joints.csv")]
    assert main([*words, "--marker-poses", str(tmp_path / "samples.json")]) == 0
    assert f"the camera is {'on the flange' if on_flange else 'in the room'}" in capsys.readouterr().out
    assert main(["calibrate", str(out), "--residual", "pose", "--hold", "links", "--json"]) == 0
    (place,) = json.loads(capsys.readouterr().out)["hand_eye"]
    error = np.array(place["parent_T_camera"])[:3, 3] - scene.parent_T_camera[:3, 3]
    assert np.all(np.abs(error) < 4.0 * np.array(place["sigma_mm"]))
    assert max(place["sigma_mm"]) < 0.5
