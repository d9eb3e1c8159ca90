"""No cause is claimed by what a single pose says."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from calib import diagnose
from calib.dataset.dataset import Dataset
from calib.present.diagnosis.verdict import verdict
from calib.rendering.blocks import plain
from calib.screening.leverage import changes_without_each
from tests.support.changed import with_xyz
from tests.support.paired_cell import ARMS, compliance, draw_pairs, measured


def with_one_heavy_pose(push_mm: float) -> Dataset:
    """An arm with a soft joint 2, whose only pose with 8 kg is off as if that joint had yielded more."""
    rng = np.random.default_rng([5, 8])
    cell = draw_pairs(ARMS["RB5"], rng, 64, (0.0,))
    cell = replace(cell, payload_kg=np.where(np.arange(64) == 20, 8.0, 0.0))
    soft = [(compliance(1).cause, 20.0)]
    made = measured(cell, soft, rng, test_places=12)
    sag_mm = (cell.reported(soft)["jig"] - cell.reported([])["jig"])[20]
    xyz_mm = made.points.xyz_mm + np.where(np.arange(64) == 20, push_mm, 0.0)[:, None] * sag_mm / np.linalg.norm(sag_mm)
    return with_xyz(made, xyz_mm)


def test_a_cause_that_one_pose_carries_is_suspected_and_the_pose_is_told() -> None:
    found = diagnose(with_one_heavy_pose(1.2))
    assert (found.verdict, found.missing, found.suspected) == ("unexplained", (), ("nonlinear_stiffness",))
    assert found.hanging.pose == "p21_run1"
    assert "only pose p21_run1 speaks for nonlinear stiffness" in plain(verdict(found))
    right = diagnose(with_one_heavy_pose(0.0))
    assert (right.missing, right.hanging) == (("joint_compliance",), None)


def test_evidence_with_rows_left_out_is_that_of_a_fit_without_them() -> None:
    rng = np.random.default_rng(0)
    fitted, own, y = rng.standard_normal((40, 5)), rng.standard_normal((40, 2)), rng.standard_normal(40)
    y = y + own @ [1.0, -1.0]
    group = np.repeat(np.arange(10), 4)

    def evidence(rows: np.ndarray) -> float:
        basis = np.linalg.qr(fitted[rows])[0]
        residual, columns = (v[rows] - basis @ (basis.T @ v[rows]) for v in (y, own))
        noise = np.eye(len(residual)) + columns @ columns.T
        left = residual @ np.linalg.solve(noise, residual) / (residual @ residual)
        return -0.5 * np.linalg.slogdet(noise)[1] - 0.5 * (rows.sum() - 5) * np.log(left)

    basis = np.linalg.qr(fitted)[0]
    residual, columns = (v - basis @ (basis.T @ v) for v in (y, own))
    found = changes_without_each(residual, columns, basis, group, 35)
    assert np.allclose(found, [evidence(group != k) - evidence(group >= 0) for k in range(10)])
