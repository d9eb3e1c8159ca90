"""Coverage of 90 % intervals: the share of test coordinates within 1.645 promised standard deviations.

    python benchmarks/promise.py [FOLDER ...] [--arms 40] [--diagnosed 12]
    python benchmarks/promise.py FOLDER ... --halves

FOLDER: recordings of real arms, by link errors alone (`calibrate`) and by the last model of `diagnose`, beside the rms
of the training errors taken for sigma. Then simulated arms with 20, 50 and 200 training poses, nothing hidden and with
an effect that the fit does not have, and diagnosed ones.

--halves: two halves of each recording, drawn at random and apart in joint space (by places where there are several),
compared by link errors: the share of parameters within two sigma, and the changes that are told; first with sigmas of
independent errors, then as `compare` has them.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from unittest.mock import patch

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import calib
from calib.array_types import BoolArray, IndexArray
from calib.calibration.promise import Z_90, misfit_inflation, promise
from calib.calibration.result import Calibration, FittedResult
from calib.dataset.dataset import Dataset
from calib.statistics import rms
from calib.validation import comparison

TEST = 80  # test poses of a simulated arm


def coverages(fit: Calibration) -> tuple[float, float]:
    """Shares of test coordinates within 1.645 rms of the training errors, and within 1.645 promised sigmas."""
    own = promise(fit)
    rms_mm = rms(own.error_mm[~own.is_test])
    assert own.coverage_90 is not None
    return float(np.mean(np.abs(own.error_mm[own.is_test]) <= Z_90 * rms_mm)), own.coverage_90


def simulated(seed: int, train: int, effects: Sequence[str]) -> Dataset:
    """An RB5 with 0.05 mm noise, so many training poses and `TEST` test poses."""
    dataset = calib.simulate_dataset(
        "rb5", rng=seed, effects=effects, poses=train + TEST, conditions=bool(effects)
    ).dataset
    role = np.array(["reference", *["train"] * (train - 1), *["test"] * TEST])
    return replace(dataset, poses=replace(dataset.poses, role=role))


def over(arms: int, train: int, effects: Sequence[str], fit: Callable[[Dataset], FittedResult]) -> str:
    """Mean coverages over simulated arms, as a line's end."""
    both = np.array([coverages(fit(simulated(seed, train, effects)).calibration) for seed in range(arms)])
    error = both[:, 1].std(ddof=1) / np.sqrt(arms)
    return f"{both[:, 0].mean():.3f} -> {both[:, 1].mean():.3f} +- {error:.3f}"


def half(dataset: Dataset, rows: IndexArray, name: str) -> Dataset:
    """Some poses of a dataset, all for training."""
    points = dataset.points
    assert points is not None
    own = points.select(np.isin(points.pose, rows))
    role = np.array(["reference", *["train"] * (len(rows) - 1)])
    poses = replace(dataset.poses.select(rows), role=role)
    return replace(dataset, name=name, poses=poses, points=replace(own, pose=np.searchsorted(rows, own.pose)))


def halves(dataset: Dataset) -> dict[str, BoolArray]:
    """Masks (N,) of the first half of N poses, by the way in which they are chosen."""
    poses = dataset.poses
    drawn = np.zeros(len(poses), dtype=bool)
    drawn[np.random.default_rng(0).permutation(len(poses))[: len(poses) // 2]] = True
    places = sorted(set(map(str, poses.setup)))
    if len(places) > 1:
        return {"random": drawn, "apart": np.isin(poses.setup, places[: len(places) // 2])}
    scaled = (poses.q - poses.q.mean(axis=0)) / np.maximum(poses.q.std(axis=0), 1e-3)
    along = scaled @ np.linalg.svd(scaled, full_matrices=False)[2][0]
    return {"random": drawn, "apart": along < np.median(along)}


def compare_halves(folders: Sequence[Path]) -> None:
    """Print how well the halves of each recording agree."""
    kinds = {"independent": lambda _: 1.0, "as compare": misfit_inflation}
    shares: dict[tuple[str, str], list[float]] = {}
    told: dict[tuple[str, str], int] = {}
    for folder in folders:
        dataset = calib.load_dataset(folder)
        for way, first in halves(dataset).items():
            sides = [calib.calibrate(half(dataset, np.flatnonzero(of), way)) for of in (first, ~first)]
            for kind, inflation in kinds.items():
                with patch.object(comparison, "misfit_inflation", inflation):
                    found = comparison.comparison_of(*sides)
                z = np.array([each.z for each in found.parameters if each.sigma > 0.0])
                share, changes = float(np.mean(np.abs(z) < 2.0)), [change.name for change in found.changes]
                shares.setdefault((way, kind), []).append(share)
                told[way, kind] = told.get((way, kind), 0) + bool(changes)
                print(f"{folder.name}, {way}, {kind}: {share:.2f} within two sigma, changes {changes}", flush=True)
    for (way, kind), values in shares.items():
        print(f"{way}, {kind}: {np.mean(values):.3f}; changes in {told[way, kind]} of {len(values)}")


def main() -> None:
    """Print the coverages."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folders", nargs="*", type=Path, metavar="FOLDER")
    parser.add_argument("--arms", type=int, default=40)
    parser.add_argument("--diagnosed", type=int, default=12)
    parser.add_argument("--halves", action="store_true")
    options = parser.parse_args()
    if options.halves:
        compare_halves(options.folders)
        return
    print("training rms -> promised sigma")
    for folder in options.folders:
        for name, fit in (("links", calib.calibrate(folder)), ("diagnosed", calib.diagnose(folder).calibration)):
            rms, share = coverages(fit)
            print(f"{folder.name}, {name}: {rms:.3f} -> {share:.3f}", flush=True)
    for train in (20, 50, 200):
        for effects in ((), ("transmission_error",), ("joint_compliance",), ("fine_ripple",)):
            said = over(options.arms, train, effects, calib.calibrate)
            print(f"{train} poses, hidden: {', '.join(effects) or 'nothing'}: {said}", flush=True)
    for effects in ((), ("transmission_error",), ("joint_compliance",), ("fine_ripple",)):
        said = over(options.diagnosed, 64, effects, calib.diagnose)
        print(f"64 poses, diagnosed, hidden: {', '.join(effects) or 'nothing'}: {said}", flush=True)


if __name__ == "__main__":
    main()
