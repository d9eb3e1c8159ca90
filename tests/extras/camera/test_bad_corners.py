"""Images with something in front of the board: the poses stay honest."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from calib.extras.camera.board import board_of
from calib.extras.camera.detection import Detected, measure
from calib.extras.camera.view import View
from tests.extras.camera.camera_dataset import squared_sigmas
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


def test_images_with_something_in_front_of_the_board_are_named_and_left_out():
    rng = np.random.default_rng(4)
    scene, views = views_of(rng, 10)
    for k, count in ((2, 10), (7, 40)):
        pixels = views[k].pixels.copy()
        pixels[:count] += rng.uniform(2.0, 12.0, size=(count, 2))
        views[k] = replace(views[k], pixels=pixels)
    found = measure(Detected(BOARD, SIZE_PX, tuple(views), {}, ()), None)
    assert set(found.left_out) == {scene.names[2], scene.names[7]}
    assert found.sigma_px == pytest.approx(NOISE_PX, rel=0.15)
    assert np.mean(squared_sigmas(scene, found)) < 1.8
