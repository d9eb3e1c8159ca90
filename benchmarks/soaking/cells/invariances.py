"""Invariances: the same arm with the scanner elsewhere, rows in another order, other names and units.

What is compared has gone through a dataset's folder, as a user's measurement has.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd

from calib.calibration.calibrate import calibrate
from calib.calibration.result import Calibration
from calib.dataset.dataset import Dataset
from calib.dataset.files.folder import load_dataset, write_dataset
from calib.diagnosis.diagnose import diagnose
from soaking.cells.drawn_arms import draw
from soaking.record import Result
from tests.support.arms import random_transform

KINDS = ("scanner elsewhere", "poses in another order", "other names", "radians and metres")
DIAGNOSED = 10  # one arm in so many is diagnosed too
OF_ITS_AXES = {
    "scanner_distortion",
    "incidence_bias",
}  # laws along the scanner's own axes: elsewhere it errs otherwise
OF_A_SIGMA, RELATIVE = 1e-3, 1e-5


def attempt(number: int, seed: int, material: Path, scratch: Path) -> Result:
    """Try one of the four invariances, by turns, on one arm."""
    kind, drawn = KINDS[number % len(KINDS)], number // len(KINDS)
    arm = draw(drawn, seed)
    write_dataset(arm.simulation.dataset, scratch / "as it was")
    dataset = load_dataset(scratch / "as it was")
    rng = np.random.default_rng([seed, 4, number])
    if kind == KINDS[0]:
        other = _elsewhere(dataset, rng)
    elif kind == KINDS[1]:
        other = _other_order(scratch / "as it was", scratch / "other", rng)
    elif kind == KINDS[2]:
        other = _other_names(dataset)
    else:
        other = _other_units(dataset, scratch / "as it was", scratch / "other")
    what = f"arm {drawn}, {arm.kind}"
    differs = difference(calibrate(dataset), calibrate(other))
    told_otherwise = kind != KINDS[0] or not OF_ITS_AXES & {*arm.effects}
    if not differs and drawn % DIAGNOSED == 0 and told_otherwise:
        what += ", diagnosed"
        first, second = diagnose(dataset), diagnose(other)
        if (first.verdict, {*first.missing}) != (second.verdict, {*second.missing}):
            differs = f"{first.verdict} {first.missing} and {second.verdict} {second.missing}"
    return Result(number, kind, what, "differs" if differs else "same", "wrong" if differs else "", differs)


def difference(a: Calibration, b: Calibration) -> str:
    """Differences of two calibrations beyond what the end of an iteration leaves; "" where there are none."""
    if len(a.fit.x) != len(b.fit.x):
        return f"{len(a.fit.x)} and {len(b.fit.x)} parameters"
    if a.fit.converged != b.fit.converged or a.fit.rank != b.fit.rank:
        return f"rank {a.fit.rank} and {b.fit.rank}, converged {a.fit.converged} and {b.fit.converged}"
    sigma = np.sqrt(np.diag(a.fit.covariance))
    off = np.abs(a.fit.x - b.fit.x) / np.where(sigma > 0, sigma, 1.0)
    if off.max() > OF_A_SIGMA:
        worst = int(off.argmax())
        return f"{a.fit.parameters[worst].name} by {off[worst]:.2g} sigma"
    pairs = [("sigma", a.sigma_mm, b.sigma_mm)]
    for name, one, two in (("train", a.after.train, b.after.train), ("test", a.after.test, b.after.test)):
        assert one is not None
        assert two is not None
        pairs.append((f"{name} RMSE", one.rmse_mm, two.rmse_mm))
    for name, x, y in pairs:
        if not np.isclose(x, y, rtol=RELATIVE, atol=1e-9):
            return f"{name}: {x:.9g} and {y:.9g} mm"
    return ""


def _elsewhere(dataset: Dataset, rng: np.random.Generator) -> Dataset:
    """Each placement of the scanner somewhere else in the room."""
    assert dataset.points is not None
    xyz_mm = dataset.points.xyz_mm.copy()
    setup = dataset.poses.setup[dataset.points.pose]
    for name in np.unique(setup):
        moved = random_transform(rng)
        xyz_mm[setup == name] = xyz_mm[setup == name] @ moved[:3, :3].T + moved[:3, 3]
    return replace(dataset, points=replace(dataset.points, xyz_mm=xyz_mm))


def _other_order(folder: Path, out: Path, rng: np.random.Generator) -> Dataset:
    """The rows of both tables in orders of their own."""
    out.mkdir()
    for path in folder.iterdir():
        (out / path.name).write_bytes(path.read_bytes())
    for name in ("poses.csv", "points.csv"):
        head, *rows = (folder / name).read_text().splitlines()
        (out / name).write_text("\n".join([head, *(rows[int(k)] for k in rng.permutation(len(rows)))]) + "\n")
    return load_dataset(out)


def _other_names(dataset: Dataset) -> Dataset:
    """Every name another: of the dataset, the arm, its joints, the poses and the placements."""
    joints = tuple(replace(joint, name=f"Achse {9 - k}") for k, joint in enumerate(dataset.robot.joints))
    ids = tuple(f"Ω {(7 * k) % 1009} ‹{k}›" for k in range(len(dataset.poses)))
    setup = np.array([f"Halle {name}" if name else "" for name in dataset.poses.setup])
    poses = replace(dataset.poses, ids=ids, setup=setup)
    return replace(dataset, name="ein anderer", robot=replace(dataset.robot, name="x", joints=joints), poses=poses)


def _other_units(dataset: Dataset, folder: Path, out: Path) -> Dataset:
    """Radians and metres in the tables, as `[units]` and the columns' names say."""
    out.mkdir()
    for path in folder.iterdir():
        (out / path.name).write_bytes(path.read_bytes())
    with (out / "dataset.toml").open("a") as file:
        file.write('\n[units]\nangle = "rad"\nlength = "m"\n')
    for name in ("poses.csv", "points.csv"):
        table = pd.read_csv(folder / name, dtype={"pose": str, "setup": str}, keep_default_na=False)
        for column in [c for c in table.columns if c.endswith(("_deg", "_mm"))]:
            values = table.pop(column)
            angle = column.endswith("_deg")
            new = column.removesuffix("_deg" if angle else "_mm") + ("_rad" if angle else "_m")
            table[new] = np.radians(values) if angle else values / 1000.0
        table.to_csv(out / name, index=False)
    return load_dataset(out)
