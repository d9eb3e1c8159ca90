"""Poses that are planned for a camera: the image shows the whole board, by OpenCV's projection of the true scene."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from calib.extras.camera.board import board_of
from calib.workcell.candidates import candidate_poses
from calib.workcell.known_cell import workcell_of_dataset
from tests.extras.camera.camera_dataset import simulated_dataset, true_lens
from tests.support.camera_scene import SIZE_PX, Scene, flange, nominal_table

BOARD = board_of("charuco:8x6:30:22")


@pytest.mark.parametrize("on_flange", [True, pytest.param(False, marks=pytest.mark.thorough)])
def test_candidates_for_a_camera_show_the_whole_board(on_flange):
    rng = np.random.default_rng(8)
    scene = Scene.draw(rng, on_flange=on_flange, poses=16, distance=(420.0, 560.0))
    dataset = simulated_dataset(scene, BOARD, rng, sigma_px=0.1, lens=true_lens())
    cell = workcell_of_dataset(dataset)
    assert any("whole board" in note for note in cell.notes)
    q = candidate_poses(cell, 20, rng=rng)
    arm = np.array([flange(nominal_table(), joints) for joints in q])
    camera, board = scene.parent_T_camera, scene.parent_T_board
    seen = np.linalg.inv(arm @ camera) @ board if on_flange else np.linalg.inv(camera) @ arm @ board
    scene = replace(scene, camera_T_board=seen)
    for k in range(len(q)):
        pixels = scene.pixels(k, BOARD.corners_mm)
        assert np.all((pixels > 0) & (pixels < np.array(SIZE_PX)))
    assert np.all(seen[:, 2, 2] > np.cos(np.radians(65)))
