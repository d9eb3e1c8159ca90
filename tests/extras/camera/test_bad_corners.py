"""Images with something in front of the board: the poses stay honest."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from calib.extras.camera.board import board_of
from calib.extras.camera.detection import Detected, measure
from calib.extras.camera.view import View
from tests.extras.camera.camera_dataset import squared_sigmas, true_lens
from tests.support.camera_scene import SIZE_PX, Scene

BOARD = board_of("charuco:9x7:25:18")
NOISE_PX = 0.03


def views_of(rng: np.random.Generator, poses: int) -> tuple[Scene, list[View]]:
    """Views of a scene."""
    scene, views = Scene.draw(rng, on_flange=True, poses=poses), []
    for k, name in enumerate(scene.names):
        pixels = scene.pixels(k, BOARD.corners_mm)
        number = np.arange(len(pixels))
        views.append(View(name, number, BOARD.corners_mm, pixels + NOISE_PX * rng.normal(size=pixels.shape)))
    return scene, views


def test_corners_of_what_is_in_front_of_the_board_are_left_out_and_an_image_full_of_them_is_named():
    rng = np.random.default_rng(4)
    scene, views = views_of(rng, 10)
    for k, count in ((2, 10), (5, 16), (7, 40)):
        pixels = views[k].pixels.copy()
        pixels[:count] += rng.uniform(2.0, 12.0, size=(count, 2))
        views[k] = replace(views[k], pixels=pixels)
    found = measure(Detected(BOARD, SIZE_PX, tuple(views), {}, ()), None)
    assert list(found.left_out) == [scene.names[7]]
    assert found.bad_corners == pytest.approx(26, abs=2)
    assert found.sigma_px == pytest.approx(NOISE_PX, rel=0.15)
    assert np.mean(squared_sigmas(scene, found)) < 1.8


def test_a_single_marker_keeps_its_four_corners_however_far_one_is_off():
    marker = board_of("apriltag:60")
    rng = np.random.default_rng(5)
    scene = Scene.draw(rng, on_flange=True, poses=8)
    views = []
    for k, name in enumerate(scene.names):
        pixels = scene.pixels(k, marker.corners_mm) + NOISE_PX * rng.normal(size=(4, 2))
        pixels[0] += 3.0 * (k == 2)
        views.append(View(name, np.arange(4), marker.corners_mm, pixels))
    found = measure(Detected(marker, SIZE_PX, tuple(views), {}, ()), true_lens())
    assert found.bad_corners == 0
    assert all(len(one.view.corner) == 4 for one in found.poses)
