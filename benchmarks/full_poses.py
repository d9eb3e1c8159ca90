"""Gain of full poses in a calibration: knowable parameters, and the error at poses that no fit saw.

    python benchmarks/full_poses.py [--arms 10] [--poses 10 20 40 64]

Arms are the builtin RB5 and Panda with link errors drawn from 0.3 mm and 0.1 deg, measured at random poses by a
simulator that shares no code with the fit; the jig sits on the tool anyhow. Held out are 200 more random poses, their
true place and attitude without noise. Two instruments: 0.05 mm and 0.1 mrad a coordinate, and, as corners of 50,000
point scans have it, 0.003 mm and 0.04 mrad. Columns, medians over the arms:

    rank        parameters that the data can tell at best, of all
    known       directions that these data know better than the tolerances of manufacture
    place um    rms 3D error of the tool point at held-out poses, in the scanner's frame as the fit placed it
    turn urad   rms angle between predicted and true attitude of the jig there; its seat on the tool comes from the
                training poses' orientations, for a fit to positions too
    bound       the same of an efficient estimator in a linear world: from the covariance of arm, scanner's frame and
                seat together at the true arm, the tolerances of manufacture as prior
"""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Iterator
from dataclasses import replace

os.environ.setdefault("OMP_NUM_THREADS", "1")

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation
from simulated import random_q

from calib import calibrate
from calib.dataset.dataset import Dataset
from calib.dataset.files.robot_toml import builtin_robot
from calib.errors import FitError
from calib.fitting.model import geometric_model
from calib.fitting.observations import Observations, conditions_at
from calib.fitting.pose_residuals import PoseResiduals
from calib.frames import apply, make_transform, skew
from calib.identifiability.structural import structural_rank
from calib.options import FitOptions
from calib.simulation.simulate import simulate_dataset
from calib.simulation.truth.equilibrium import Truth, scanner_T_target
from calib.statistics import rms, rms_length

INSTRUMENTS = {"0.05 mm, 0.1 mrad": (0.05, 1e-4), "0.003 mm, 0.04 mrad": (0.003, 4e-5)}


def measured(robot: str, poses: int, noise_mm: float, sigma_rad: float, seed: int) -> tuple[Dataset, Truth, NDArray]:
    """An arm's full poses, all for training, its truth, and how the jig sits on the true tool (3, 3)."""
    made = simulate_dataset(
        builtin_robot(robot), rng=np.random.default_rng([seed, poses]), poses=poses,
        noise_mm=noise_mm, orientation_sigma_rad=sigma_rad,
    )  # fmt: skip
    dataset = made.dataset
    assert dataset.points is not None
    assert dataset.points.orientations is not None
    turn = Rotation.random(random_state=seed).as_matrix()
    given = dataset.points.orientations
    points = replace(dataset.points, orientations=replace(given, scanner_R_jig=given.scanner_R_jig @ turn))
    role = np.where(dataset.poses.role == "test", "train", dataset.poses.role)
    tool = scanner_T_target(made.truth, dataset.poses.q[:1])[0, :3, :3]
    seat = tool.T @ made.scanner_T_jig[0, :3, :3] @ turn
    return replace(dataset, points=points, poses=replace(dataset.poses, role=role)), made.truth, seat


def held_out(dataset: Dataset, truth: Truth, seat: NDArray, kind: str, seed: int) -> tuple[int, float, float]:
    """Directions known, place error in mm and attitude error in rad of one fit."""
    result = calibrate(dataset, FitOptions(kind))
    model, x, observed = result.model, result.fit.x, Observations.of(dataset)
    placed = PoseResiduals(model, observed).frames_and_hand_eye(x)
    frames = result.after.scanner_T_base if kind == "position" else placed.scanner_T_base
    (scanner_T_base,) = frames.values()
    q = random_q(dataset.robot, 200, np.random.default_rng([seed, 77]))
    true = scanner_T_target(truth, q) @ make_transform(seat, np.zeros(3))
    state = model.state(x, conditions_at(dataset.poses, q))
    off_mm = apply(scanner_T_base, state.place(state.chain.target_mm)) - true[:, :3, 3]
    (turned,) = placed.scanner_T_base.values()
    found = turned[:3, :3] @ state.attitude @ placed.tool_R_jig
    angle = Rotation.from_matrix(found @ np.swapaxes(true[:, :3, :3], 1, 2)).magnitude()
    return (
        result.fit.known,
        rms_length(off_mm),
        rms(angle),
    )


def bounds(
    dataset: Dataset, truth: Truth, kind: str, noise_mm: float, sigma_rad: float, seed: int
) -> tuple[float, float]:
    """Place in mm and attitude in rad as `held_out` has them, by linear theory; nan where nothing is told."""
    model = geometric_model(truth.robot)

    def columns(q: NDArray) -> NDArray:
        """(N, 6, P + 9) by the arm's parameters, a motion of the scanner and the seat."""
        place_mm, attitude, by_x = model.linearise_pose(np.zeros(len(model.scales)), conditions_at(dataset.poses, q))
        more = np.zeros((len(q), 6, 9))
        more[:, :3, :3] = more[:, 3:, 3:6] = np.eye(3)
        more[:, :3, 3:6] = -skew(place_mm)
        more[:, 3:, 6:] = attitude
        return np.concatenate([by_x, more], axis=2)

    sigma = np.repeat([noise_mm, sigma_rad], 3)[: 3 if kind == "position" else 6]
    told = (columns(dataset.poses.q)[:, : len(sigma)] / sigma[:, None]).reshape(-1, len(model.scales) + 9)
    # A scanner and a seat may be anywhere: a prior of 1e6 mm and 10 rad is none.
    size = np.concatenate([model.scales, np.full(3, 1e6), np.full(6, 10.0)])
    _, s, vt = np.linalg.svd(told * size)
    s = np.concatenate([s, np.zeros(len(size) - len(s))])
    root = size[:, None] * vt.T / np.hypot(s, 1.0)  # covariance = root root^T
    spread = np.sum((columns(random_q(dataset.robot, 200, np.random.default_rng([seed, 77]))) @ root) ** 2, axis=2)
    place, turn = spread[:, :3].sum(axis=1), spread[:, 3:].sum(axis=1)
    return float(np.sqrt(place.mean())), float(np.sqrt(turn.mean())) if kind == "pose" else float("nan")


def lines(poses: list[int], arms: int) -> Iterator[str]:
    """The table."""
    yield (
        f"{'arm':7}{'instrument':21}{'poses':>6}  {'fit to':10}{'rank':>9}{'known':>7}{'place um':>10}{'bound':>8}"
        f"{'turn urad':>11}{'bound':>7}"
    )
    for robot in ("rb5", "panda"):
        arm = builtin_robot(robot)
        for instrument, sigmas in INSTRUMENTS.items():
            for count in poses:
                made = [measured(robot, count, *sigmas, seed) for seed in range(arms)]
                for kind in ("position", "pose"):
                    rank = f"{structural_rank(arm, residual=kind)} of {arm.table.size}"
                    head = f"{robot:7}{instrument:21}{count:6}  {kind:10}{rank:>9}"
                    try:
                        each = [held_out(*one, kind, seed) for seed, one in enumerate(made)]
                    except FitError:
                        yield f"{head}   too few poses for a fit"
                        continue
                    known, place_mm, turn_rad = np.median(each, axis=0)
                    least = [bounds(one[0], one[1], kind, *sigmas, seed) for seed, one in enumerate(made)]
                    least_mm, least_rad = np.median(least, axis=0)
                    yield (
                        f"{head}{known:7.0f}{1e3 * place_mm:10.1f}{1e3 * least_mm:8.1f}{1e6 * turn_rad:11.0f}"
                        f"{1e6 * least_rad:7.0f}"
                    )


def main() -> None:
    """Print the table, a line as soon as it is known."""
    parser = argparse.ArgumentParser(description="what full poses add to a calibration")
    parser.add_argument("--arms", type=int, default=10, help="of each kind")
    parser.add_argument("--poses", type=int, nargs="*", default=[10, 20, 40, 64])
    arguments = parser.parse_args()
    for line in lines(arguments.poses, arguments.arms):
        sys.stdout.write(line + "\n")
        sys.stdout.flush()


if __name__ == "__main__":
    main()
