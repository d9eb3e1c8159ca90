"""The earlier fit's prediction of new points, with what is known of it."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from calib import frames
from calib.array_types import Array
from calib.calibration.result import Calibration
from calib.calibration.uncertainty import JointKnowledge
from calib.dataset.dataset import Dataset
from calib.errors import FitError
from calib.fitting.observations import Observations, linearise_points, with_nominal_scanner_frames
from calib.fitting.scanner_frame import fit_scanner_frame, frame_motion, whitener
from calib.monitoring.change_tests import ALARM, AS_WELL, NAMED, ChangeTests, Found, KindTest, the_most_usual
from calib.monitoring.kinds import BASE, SCANNER, Kind, kind_words, kinds_of_the_arm
from calib.screening.evidence import holm

_FEWEST = 3  # check poses


@dataclass(frozen=True)
class Cell:
    """The earlier fit's prediction of the new points, with the scanner where it was and with its place free."""

    kinds: tuple[Kind, ...]
    kinds_with_scanner: tuple[Kind, ...]
    fixed: ChangeTests
    free: ChangeTests
    scanner_known: bool
    scanner: Kind
    rmse_mm: float
    rmse_free_mm: float
    expected_mm: float
    poses: int

    @classmethod
    def of(cls, base: Calibration, new: Dataset, *, scanner_moved: bool) -> Cell:
        """Raises FitError for too few poses."""
        poses = replace(new, poses=new.poses.measured_later())
        observed = Observations.of(poses, np.ones(len(new.poses), dtype=bool))
        count = len(np.unique(observed.points.pose))
        if count < _FEWEST:
            raise FitError(
                f"dataset {new.name}: found {count} measured poses; a check takes {_FEWEST} or more"
            )
        setups = np.unique(observed.setup)
        if len(setups) > 1:
            raise FitError(
                f"dataset {new.name}: found {len(setups)} placements of the scanner; watch each by itself"
            )
        known = not scanner_moved and str(setups[0]) in base.after.scanner_T_base
        observed = with_nominal_scanner_frames(observed, base.model.placed_robot)
        at_mm, by_x = linearise_points(base.model, base.fit.x, observed)
        whiten = whitener(observed.covariance_mm2)
        measured = observed.points.xyz_mm
        anew = fit_scanner_frame(at_mm, measured, observed.covariance_mm2)
        before = base.after.scanner_T_base[str(setups[0])] if known else anew
        noise = base.fit.noise if np.isfinite(base.fit.noise) else 1.0
        prior = JointKnowledge.of(base, str(setups[0]) if known else None)
        kinds = kinds_of_the_arm(base.model, base.fit.x, observed)

        def placed(scanner_T_base: Array) -> tuple[Array, Array, Array]:
            """Residual (3 M,), derivatives by x (3 M, P) and by the frame's motion (3 M, 6), whitened."""
            seen = frames.apply(scanner_T_base, at_mm)
            residual = np.einsum("mij,mj->mi", whiten, measured - seen).ravel()
            columns = (whiten @ scanner_T_base[:3, :3] @ by_x).reshape(len(residual), -1)
            motion = (whiten @ frame_motion(seen, prior.centre_mm)).reshape(len(residual), 6)
            return residual, columns, motion

        def to_rows(scanner_T_base: Array) -> Array:
            """(3 M, 3 M) from movements in the base frame, mm, to whitened residuals."""
            blocks = whiten @ scanner_T_base[:3, :3]
            out = np.zeros((len(blocks), 3, len(blocks), 3))
            out[np.arange(len(blocks)), :, np.arange(len(blocks))] = blocks
            return out.reshape(3 * len(blocks), -1)

        residual, columns, motion = placed(before)
        both = np.concatenate([columns, motion], axis=1)
        covariance = both @ prior.covariance @ both.T + noise**2 * np.eye(len(residual))
        root = np.linalg.inv(np.linalg.cholesky(covariance))
        fixed = ChangeTests(root @ residual, root @ to_rows(before), base.fit.degrees_of_freedom)
        rmse_mm = float(np.sqrt(np.mean(np.sum((measured - frames.apply(before, at_mm)) ** 2, axis=1))))

        residual, columns, motion = placed(anew)
        n = columns.shape[1]
        rest = np.linalg.svd(motion, full_matrices=True)[0][:, np.linalg.matrix_rank(motion) :]
        inside = rest.T @ columns
        covariance = inside @ prior.covariance[:n, :n] @ inside.T + noise**2 * np.eye(rest.shape[1])
        root = np.linalg.inv(np.linalg.cholesky(covariance)) @ rest.T
        free = ChangeTests(root @ residual, root @ to_rows(anew), base.fit.degrees_of_freedom)
        left = np.sum((measured - frames.apply(anew, at_mm)) ** 2, axis=1)

        by_frame = before[:3, :3].T @ frame_motion(frames.apply(before, at_mm), prior.centre_mm)
        scanner = Kind(SCANNER, None, "", "mm", by_frame)
        sigma2 = np.trace(observed.covariance_mm2, axis1=1, axis2=2)
        return cls(
            kinds, (*kinds, scanner), fixed, free, known, scanner, rmse_mm, float(np.sqrt(left.mean())),
            float(noise * np.sqrt(sigma2.mean())), count,
        )  # fmt: skip

    def scanner_moved(self, arm: list[Kind]) -> Found | None:
        """The scanner's motion beside these changes of the arm, where it shows; the base's would look the same."""
        if not self.scanner_known:
            return None
        test = next(iter(self.fixed.tests((self.scanner,), given=arm)), None)
        if test is None or test.p_value > (NAMED if arm else ALARM):
            return None
        if self.fixed.noise_explains(arm, self.scanner):
            return None
        found = self.fixed.found(self.scanner, [*arm, self.scanner])
        shift, turn = np.array(found.vector[:3]), np.array(found.vector[3:])
        moved = np.einsum("mik,k->mi", self.scanner.columns, np.concatenate([shift, turn]))
        size = float(np.sqrt(np.mean(np.sum(moved**2, axis=1))))
        sigma = size / max(np.sqrt(test.gain), 1e-9)
        as_well = [BASE] if arm else [BASE, *self._instead_of_scanner(test)]
        return replace(found, size=size, sigma=float(sigma), p_value=test.p_value, as_well=tuple(as_well))

    def _instead_of_scanner(self, moved: KindTest) -> list[str]:
        """Single changes of the arm that explain as much with the scanner where it was."""
        tests = self.fixed.tests(self.kinds)
        return [kind_words(t.kind) for t in tests if t.gain > moved.gain - AS_WELL and t.p_value < ALARM]

    def with_the_scanner_where_it_was(self) -> list[Found]:
        """The change of the arm that explains best what shows only where the scanner did not move."""
        tests = self.fixed.tests(self.kinds_with_scanner)
        best = the_most_usual(tests)
        if best is None or self.fixed.noise_explains([], best.kind):
            return []
        as_well = [
            kind_words(t.kind)
            for t in tests
            if t is not best and t.gain > best.gain - AS_WELL and t.kind.count <= max(best.kind.count, 1)
        ]
        as_well += [SCANNER] if best.kind.what != SCANNER else []
        found = self.fixed.found(best.kind, [best.kind])
        p = holm([test.p_value for test in tests])[tests.index(best)]
        return [replace(found, p_value=p, as_well=tuple(as_well))]
