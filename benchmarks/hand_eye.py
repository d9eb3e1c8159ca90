"""Hand-eye calibration beside OpenCV's on the same board poses: an exact arm, and one with link errors.

    .venv/bin/python benchmarks/hand_eye.py [--sets 20] [--poses 25]

A camera sees a ChArUco board (8 x 6 squares of 30 mm, 320 to 560 mm away, 0.1 px of noise, lens found from images),
by a simulation that shares no code with the product (tests/support/camera_scene.py). Every method gets the same poses
of the board. Printed are the root mean square over the sets of the camera's error on flange or in the room, mm and
deg, and of the prediction, mm, of where the board's middle is seen at 40 new poses, which is what a user of the
result meets.
"""

from __future__ import annotations

import argparse
from collections import defaultdict
from collections.abc import Callable

import cv2
import numpy as np

from calib import calibrate, frames
from calib.array_types import Array
from calib.calibration.mount import camera_places
from calib.calibration.result import Calibration
from calib.dataset.dataset import Dataset
from calib.extras.camera.board import board_of
from calib.fitting.observations import conditions_at
from tests.extras.camera.camera_dataset import simulated_dataset
from tests.support.camera_scene import Scene, flange, nominal_table

BOARD = board_of("charuco:8x6:30:22")
HAND_EYE = ("TSAI", "PARK", "HORAUD", "ANDREFF", "DANIILIDIS")
ROBOT_WORLD = ("SHAH", "LI")
Result = tuple[Array, Callable[[Array], Array]]  # parent_T_camera, and joints to the board's middle in the camera, mm


def opencv_results(scene: Scene, dataset: Dataset) -> dict[str, Result]:
    """Results of OpenCV's methods on the dataset's board poses, with the nominal arm."""
    points = dataset.points
    assert points is not None
    assert points.orientations is not None
    table = nominal_table()
    base_T_flange = np.array([flange(table, dataset.poses.q[i]) for i in points.pose])
    seen = frames.make_transform(points.orientations.scanner_R_jig, points.xyz_mm)
    robot = base_T_flange if scene.on_flange else frames.invert(base_T_flange)
    out = {}
    for name in HAND_EYE:
        turn, shift = cv2.calibrateHandEye(
            list(robot[:, :3, :3]), list(robot[:, :3, 3]), list(seen[:, :3, :3]), list(seen[:, :3, 3]),
            method=getattr(cv2, f"CALIB_HAND_EYE_{name}"),
        )  # fmt: skip
        camera = frames.make_transform(turn, shift.ravel())
        places = robot @ camera @ seen  # of the board, where the camera's parent is fixed
        board = frames.make_transform(frames.mean_rotation(places[:, :3, :3]), places[:, :3, 3].mean(axis=0))
        out[f"calibrateHandEye {name}"] = (camera, board)
    for name in ROBOT_WORLD:
        back = frames.invert(robot)
        turn_b, shift_b, turn_c, shift_c = cv2.calibrateRobotWorldHandEye(
            list(seen[:, :3, :3]), list(seen[:, :3, 3]), list(back[:, :3, :3]), list(back[:, :3, 3]),
            method=getattr(cv2, f"CALIB_ROBOT_WORLD_HAND_EYE_{name}"),
        )  # fmt: skip
        board = frames.invert(frames.make_transform(turn_b, shift_b.ravel()))
        out[f"calibrateRobotWorldHandEye {name}"] = (
            frames.invert(frames.make_transform(turn_c, shift_c.ravel())),
            board,
        )
    return {name: (camera, _nominal_prediction(scene, camera, board)) for name, (camera, board) in out.items()}


def _nominal_prediction(scene: Scene, camera: Array, board: Array) -> Callable[[Array], Array]:
    """Function from joints to the board's middle in the camera's frame, for the nominal arm."""
    table = nominal_table()

    def predict(q: Array) -> Array:
        robot = flange(table, q) if scene.on_flange else np.linalg.inv(flange(table, q))
        return np.asarray((np.linalg.inv(robot @ camera) @ board)[:3, 3])

    return predict


def own_result(scene: Scene, calibration: Calibration) -> Result:
    """This project's result: the camera's place, and predictions by the fitted arm."""
    place = camera_places(calibration)[0]
    model = calibration.model

    def predict(q: Array) -> Array:
        poses = conditions_at(calibration.dataset.poses, q[None])
        seen = model.predict(calibration.fit.x, poses)
        return np.asarray(frames.apply(frames.invert(place.parent_T_camera), seen)[0])

    return place.parent_T_camera, predict


def compare(on_flange: bool, link_mm: float, sets: int, poses: int) -> dict[str, Array]:
    """Root mean square errors by method: mount mm, mount deg, prediction mm."""
    errors: dict[str, list[tuple[float, float, float]]] = defaultdict(list)
    for seed in range(sets):
        rng = np.random.default_rng(500 + seed)
        scene = Scene.draw(rng, on_flange=on_flange, poses=poses, link_mm=link_mm, link_deg=0.1 * link_mm)
        dataset = simulated_dataset(scene, BOARD, rng, sigma_px=0.1)
        results = opencv_results(scene, dataset)
        results["this, arm free"] = own_result(scene, calibrate(dataset, residual="pose"))
        results["this, --hold links"] = own_result(scene, calibrate(dataset, residual="pose", fixed=["links"]))
        new = scene.more_poses(rng, 40)
        for name, (camera, predict) in results.items():
            turn = frames.rotvec_from_rotation((camera[:3, :3] @ scene.parent_T_camera[:3, :3].T)[None])[0]
            shift = camera[:3, 3] - scene.parent_T_camera[:3, 3]
            off = [np.sum((predict(q) - at[:3, 3]) ** 2) for q, at in zip(new.q, new.camera_T_board, strict=True)]
            errors[name].append((float(shift @ shift), float(np.degrees(turn) @ np.degrees(turn)), float(np.mean(off))))
    return {name: np.sqrt(np.mean(rows, axis=0)) for name, rows in errors.items()}


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--sets", type=int, default=20)
    parser.add_argument("--poses", type=int, default=25)
    asked = parser.parse_args()
    for on_flange in (True, False):
        for link_mm in (0.0, 1.0):
            arm = "exact arm" if link_mm == 0.0 else "link errors of 1 mm and 0.1 deg (sigma)"
            print(
                f"camera {'on the flange' if on_flange else 'in the room'}, {arm}, {asked.sets} sets of {asked.poses}"
            )
            print(f"  {'':34s} camera mm      deg   board predicted mm")
            for name, (mm, deg, predicted) in compare(on_flange, link_mm, asked.sets, asked.poses).items():
                print(f"  {name:34s} {mm:9.4f} {deg:8.4f} {predicted:12.4f}", flush=True)


if __name__ == "__main__":
    main()
