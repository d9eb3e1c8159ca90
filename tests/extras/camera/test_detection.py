"""Corners of boards in rendered images: where they truly are, and what is said of images that show something else."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from PIL import Image

from calib.errors import CalibError
from calib.extras.camera.board import Board, board_of
from calib.extras.camera.detection import detect, measured_images
from calib.statistics import rms
from tests.extras.camera.camera_dataset import squared_sigmas, true_lens
from tests.support.camera_scene import (
    DISTORTION,
    Scene,
    charuco_drawing,
    checkerboard_drawing,
    marker_drawing,
    with_margin,
)

MARGIN_MM = 10.0
DRAWN = {
    "checkerboard:10x7:25": lambda: checkerboard_drawing(10, 7, 25.0),
    "apriltag:6x4:30:9": lambda: marker_drawing(6, 4, 30.0, 9.0, "APRILTAG_36h11"),
    "aruco:100": lambda: marker_drawing(1, 1, 100.0, 0.0, "4X4_50"),
    "charuco:8x6:30:22": lambda: charuco_drawing(8, 6, 30.0, 22.0),
}


def images_of(
    text: str, folder: Path, *, count: int = 6, blur_px: float = 0.0, distortion: tuple[float, ...] = tuple(DISTORTION)
) -> tuple[Board, Scene, dict[str, Path]]:
    """Images of a board in a folder, their scene, and the files by pose."""
    board, rng = board_of(text), np.random.default_rng(5)
    scene = replace(Scene.draw(rng, on_flange=True, poses=count), distortion=np.array(distortion))
    drawing, size_mm = with_margin(DRAWN[text](), board.size_mm, MARGIN_MM)
    files = {}
    for k, name in enumerate(scene.names):
        picture = scene.render(k, drawing, size_mm, rng)
        picture = cv2.GaussianBlur(picture, (0, 0), blur_px) if blur_px else picture
        files[name] = folder / f"{name}.png"
        cv2.imwrite(str(files[name]), picture)
    return board, scene, files


def errors_px(board: Board, scene: Scene, files: dict[str, Path]) -> list[np.ndarray]:
    """Errors (N, 2) of the corners of each image; a checkerboard may be counted from its other end."""
    found = []
    for view in measured_images(files, board, true_lens())[0].views:
        k = scene.names.index(view.pose)
        ways = (board.corners_mm[view.corner], -board.corners_mm[view.corner])
        found.append(min((view.pixels - scene.pixels(k, at) for at in ways), key=lambda off: np.abs(off).max()))
    return found


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("text", "blur_px"),
    [
        pytest.param("checkerboard:10x7:25", 1.5, marks=pytest.mark.thorough),
        pytest.param("apriltag:6x4:30:9", 0.0, marks=pytest.mark.thorough),
        ("apriltag:6x4:30:9", 1.5),
        pytest.param("aruco:100", 1.5, marks=pytest.mark.thorough),
    ],
)
def test_corners_lie_where_they_are_in_sharp_and_soft_images(text, blur_px, tmp_path):
    """OpenCV's own corners of markers lie 0.2 and 0.5 pixels inside; a checkerboard's are off by 0.015 in common."""
    board, scene, files = images_of(text, tmp_path, count=4, blur_px=blur_px)
    errors = errors_px(board, scene, files)
    assert len(errors) >= 3
    assert np.median([rms(off) for off in errors]) < 0.06
    if board.kind == "checkerboard":
        assert np.std([off.mean(axis=0) for off in errors]) < 0.008


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("given", "shown"),
    [
        ("checkerboard:9x6:25", "checkerboard:10x7:25"),
        pytest.param("charuco:6x8:30:22", "charuco:8x6:30:22", marks=pytest.mark.thorough),
    ],
    ids=["inner corners", "rows first"],
)
def test_a_board_counted_otherwise_is_told(given, shown, tmp_path):
    _, _, files = images_of(shown, tmp_path, count=2)
    with pytest.raises(CalibError, match=f"by --board {shown}"):
        detect(files, board_of(given))


@pytest.mark.thorough
def test_images_of_another_size_or_of_none_are_left_out_with_the_reason(tmp_path):
    board, _, files = images_of("charuco:8x6:30:22", tmp_path, count=4)
    first, second, *_ = files.values()
    Image.open(first).resize((320, 240)).save(first)
    second.write_bytes(b"no image")
    found = detect(files, board)
    assert found.left_out[first.name].startswith("has 320 x 240 pixels, most have 1280 x 960")
    assert found.left_out[second.name] == "cannot be read as an image"
    assert len(found.views) == 2


@pytest.mark.thorough
def test_a_photo_that_is_to_be_shown_turned_is_taken_as_the_sensor_saw_it(tmp_path):
    board, scene, files = images_of("charuco:8x6:30:22", tmp_path, count=2)
    name, path = next(iter(files.items()))
    turned = Image.Exif()
    turned[0x0112] = 6  # shown turned by a quarter
    photo = tmp_path / "photo.jpg"
    Image.open(path).save(photo, quality=95, exif=turned)
    errors = errors_px(board, scene, {**files, name: photo})
    assert max(np.abs(off).max() for off in errors) < 0.5


@pytest.mark.slow
@pytest.mark.parametrize("from_bottom", [True, pytest.param(False, marks=pytest.mark.thorough)])
def test_grids_of_tags_that_are_turned_or_counted_from_the_bottom_are_seen_to_be_so(from_bottom, tmp_path):
    """As AprilTag's own images are against OpenCV's, and Kalibr's grids."""
    board, rng = board_of("apriltag:3x2:50:12"), np.random.default_rng(7)
    scene = Scene.draw(rng, on_flange=True, poses=2)
    size, step = 300, 372
    drawing = np.full((step + size, 2 * step + size), 255, np.uint8)
    tags = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36h11)
    for number in range(6):
        row, column = divmod(number, 3)
        v, u = step * (1 - row if from_bottom else row), step * column
        drawing[v : v + size, u : u + size] = cv2.aruco.generateImageMarker(tags, number, size)[::-1, ::-1]
    drawing, size_mm = with_margin(drawing, board.size_mm, MARGIN_MM)
    files = {name: tmp_path / f"{name}.png" for name in scene.names}
    for k, path in enumerate(files.values()):
        cv2.imwrite(str(path), scene.render(k, drawing, size_mm, rng, fine=1))
    assert any("180°" in note and ("bottom" in note) == from_bottom for note in detect(files, board).notes)
    errors = errors_px(board, scene, files)
    assert len(errors) == 2
    assert max(np.abs(off).max() for off in errors) < 0.3


@pytest.mark.thorough
def test_a_single_marker_is_told_from_smaller_ones_of_its_own_and_of_other_dictionaries(tmp_path):
    board, scene, files = images_of("aruco:100", tmp_path, count=3)
    for path in files.values():
        picture = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
        for u, (name, number) in zip((20, 120, 220), (("4X4_50", 7), ("6X6_50", 3), ("5X5_50", 1)), strict=True):
            tags = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, f"DICT_{name}"))
            picture[10:90, u - 10 : u + 70] = 255
            picture[20:80, u : u + 60] = cv2.aruco.generateImageMarker(tags, number, 60)
        cv2.imwrite(str(path), picture)
    errors = errors_px(board, scene, files)
    assert len(errors) == 3
    assert max(np.abs(off).max() for off in errors) < 0.3


@pytest.mark.slow
@pytest.mark.parametrize(
    ("text", "lens_is_given"),
    [
        ("apriltag:6x4:30:9", True),
        pytest.param("aruco:100", True, marks=pytest.mark.thorough),
        pytest.param("apriltag:6x4:30:9", False, marks=pytest.mark.thorough),
    ],
)
def test_markers_bent_by_a_lens_lie_where_their_straight_edges_meet(text, lens_is_given, tmp_path):
    """By lines in the image they were 0.13 mm too near, at 0.005 mm told."""
    distortion = (-0.3, 0.11, 0.0005, -0.0004, -0.02)
    board, scene, files = images_of(text, tmp_path, count=4 if lens_is_given else 10, distortion=distortion)
    given = true_lens(distortion) if lens_is_given else None
    found = measured_images(files, board, given)[1]
    assert len(found.poses) == len(files)
    assert found.sigma_px < 0.025
    assert np.mean(squared_sigmas(scene, found)) < 2.0
    true = [scene.camera_T_board[scene.names.index(one.view.pose)][2, 3] for one in found.poses]
    assert np.abs(np.mean([one.camera_T_board[2, 3] for one in found.poses] - np.array(true))) < 0.02
