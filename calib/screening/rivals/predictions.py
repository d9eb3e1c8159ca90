"""What causes in doubt predict at poses that were not measured, each refitted with all that a fit may absorb.

Each rival is a linear model about the fit: link errors with their tolerances, the scanner's frames, and the rival's own
coefficients with the sizes that the evidence gave them,

    missing = J g + F f + A a + noise.

The measured poses give the posterior of all of them together, and so for further poses a mean and a covariance that
know what a refit could make of them (Box and Hill 1967, doi 10.1080/00401706.1967.10490441).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from calib import frames
from calib.array_types import Array, BoolArray
from calib.calibration.result import Calibration
from calib.dataset.dataset import Poses
from calib.effects.effect import Effect, full_name
from calib.effects.state import Seen
from calib.fitting.model import effect_columns, point_by_state
from calib.fitting.observations import linearise_points
from calib.fitting.scanner_frame import frame_motion
from calib.screening.candidates import Candidate
from calib.screening.member_columns import member_columns
from calib.screening.projected_residual import ProjectedResidual, project_residual

_FINEST = 1e-5  # times what counts as the noise: exact data leave less, and would drown the prior in rounding
_FRAME = np.array([1e3, 1e3, 1e3, 1.0, 1.0, 1.0])  # mm, rad: prior sigmas of a scanner's place, as good as unknown

# Weight of the tolerances. A screening leaves a direction free as soon as the data know it a tenth as well as these.
_HELD = 0.1
_NO_PRIOR = 1e-3  # weight of the tolerances where a fit was asked to do without them


@dataclass(frozen=True)
class Rival:
    """A cause in doubt: the members that carry it, the sizes of their parameters, and the evidence for it."""

    name: str
    members: tuple[Effect, ...]
    prior_sigmas: Mapping[str, float]  # by full parameter name
    log_evidence: float
    explained_share: float  # of the residual's sum of squares

    @classmethod
    def of(cls, candidate: Candidate) -> Rival:
        """A candidate as a screening proposes it."""
        return cls(
            candidate.name,
            candidate.members,
            candidate.prior_sigmas,
            candidate.log_evidence,
            candidate.explained_share,
        )

    @property
    def names(self) -> tuple[str, ...]:
        """Full names of its parameters."""
        return tuple(full_name(member, p) for member in self.members for p in member.parameters)

    @property
    def sizes(self) -> Array:
        """(K,) prior sigmas of its parameters."""
        return np.array([self.prior_sigmas[name] for name in self.names])


@dataclass(frozen=True)
class Prediction:
    """What one rival predicts at C poses, in sigmas of one coordinate of one measured point; W rows a pose.

    The covariance of what would be measured at poses a and b is spread[a] spread[b]^T, for a = b with the noise's unit
    matrix added.
    """

    name: str
    log_evidence: float
    mean: Array  # (C, W)
    spread: Array  # (C, W, P)


@dataclass(frozen=True)
class Predictions:
    """What all rivals predict at the same poses."""

    rivals: tuple[Prediction, ...]
    sigma_mm: float  # of one coordinate of what is measured at a pose
    freedom: int  # degrees of freedom by which the noise is known

    def with_shots(self, shots: int) -> Predictions:
        """The same where the mean of several measurements of each pose counts."""
        more = np.sqrt(shots)
        rivals = tuple(replace(one, mean=one.mean * more, spread=one.spread * more) for one in self.rivals)
        return replace(self, rivals=rivals, sigma_mm=self.sigma_mm / more)


def predict(calibration: Calibration, rivals: Sequence[Rival], poses: Poses) -> Predictions:
    """What each rival predicts at poses that were not measured.

    Args:
        calibration: a fit; rivals that are in its model are taken out of it again.
        rivals: of which one is true.
        poses: with their conditions, of setups that the fit knows.

    Raises FitError where no degree of freedom is left.
    """
    projected = project_residual(calibration)
    doubted = {name for rival in rivals for name in rival.names}
    stays = np.array([p.name not in doubted for p in projected.residuals.model.parameters], dtype=bool)
    left = float(projected.residual @ projected.residual)
    if stays.all():  # else the model has one of them, and the rest is noise
        left *= min(1.0 - rival.explained_share for rival in rivals)
    noise = max(float(np.sqrt(left / projected.freedom)), _FINEST)
    measured, missing, centre = _measured_rows(projected, stays)
    further = _FurtherRows.of(projected, poses, centre)
    nominal = np.concatenate([-(projected.x / projected.residuals.model.scales)[stays], np.zeros(6 * len(centre))])
    out = []
    for rival in rivals:
        effect = [member_columns(projected, member) for member in rival.members]
        shaped = _whitened(projected, np.concatenate(effect, axis=1)) * rival.sizes
        before = np.concatenate([measured / noise, shaped], axis=1)
        prior = np.concatenate([nominal, np.zeros(shaped.shape[1])])
        weight = np.ones(len(prior))
        weight[: np.sum(stays)] = _HELD if calibration.options.prior else _NO_PRIOR
        root, mean = _posterior(before, missing / noise, prior, weight)
        after = np.concatenate([further.common(stays) / noise, further.of_rival(rival)], axis=2)
        flat = after.reshape(-1, after.shape[2])
        spread = np.linalg.solve(root.T, flat.T).T.reshape(after.shape)
        # What the fit predicts is the zero of all rivals; their geometry is told from there.
        out.append(Prediction(rival.name, rival.log_evidence, (flat @ mean).reshape(after.shape[:2]), spread))
    return Predictions(tuple(out), noise * further.sigma_mm, projected.freedom)


def _posterior(columns: Array, missing: Array, prior: Array, weight: Array) -> tuple[Array, Array]:
    """R (P, P) with R^T R the posterior's precision, and its mean (P,).

    The noise is of unit size; the parameters are about `prior` (P,), each within 1 / weight (P,).
    """
    q, root = np.linalg.qr(np.concatenate([columns, np.diag(weight)]))
    return root, np.linalg.solve(root, q.T @ np.concatenate([missing, weight * prior]))


def _whitened(projected: ProjectedResidual, columns: Array) -> Array:
    return columns if projected.whitening is None else projected.whitening.apply(columns)


def _measured_rows(projected: ProjectedResidual, stays: BoolArray) -> tuple[Array, Array, dict[str, Array]]:
    """Columns (R, P) of link errors and frames at the measured poses, what is missing there (R,), and setups' centres.

    Units are the prior's sigmas. Parameters that do not stay are taken out: what they made is missing again.
    """
    residuals, x = projected.residuals, projected.x
    observed = residuals.observed
    to_residual = projected.base_to_residual
    at_mm, by_x = linearise_points(residuals.model, x, observed)
    columns = (to_residual @ by_x).reshape(-1, len(x))
    missing = columns[:, ~stays] @ x[~stays] - residuals.residual(x)
    placed = observed.scanner_T_base
    assert placed is not None
    blocks, centre = [], {}
    whiten = to_residual @ np.stack([placed[str(name)][:3, :3].T for name in observed.setup])
    for name in map(str, np.unique(observed.setup)):
        rows = observed.setup == name
        seen_mm = frames.apply(placed[name], at_mm[rows])
        centre[name] = seen_mm.mean(axis=0)
        block = np.zeros((len(at_mm), 3, 6))
        block[rows] = whiten[rows] @ frame_motion(seen_mm, centre[name]) * _FRAME
        blocks.append(block.reshape(-1, 6))
    common = np.concatenate([columns[:, stays] * residuals.model.scales[stays], *blocks], axis=1)
    missing = _whitened(projected, missing[:, None])[:, 0]
    return _whitened(projected, common), missing, centre


@dataclass(frozen=True)
class _FurtherRows:
    """Derivatives at C poses that were not measured, W = 3 rows a target, over the declared sigma."""

    by_x: Array  # (C, W, P) in the prior's sigmas
    by_frame: Array  # (C, W, 6 setups)
    by_state: Mapping[str, Array]  # by target (C, 3, S), in the scanner's frame
    projected: ProjectedResidual
    poses: Poses
    seen: Mapping[str, Seen]
    sigma_mm: float

    @classmethod
    def of(cls, projected: ProjectedResidual, poses: Poses, centre: Mapping[str, Array]) -> _FurtherRows:
        """At poses of setups with these centres of what was measured."""
        residuals, x = projected.residuals, projected.x
        model, observed = residuals.model, residuals.observed
        sigma2 = np.trace(observed.covariance_mm2, axis1=1, axis2=2) / 3.0
        sigma_mm = float(np.sqrt(np.median(sigma2)))
        placed = observed.scanner_T_base
        assert placed is not None
        scanner_T_base = np.stack([placed[str(name)] for name in poses.setup])
        turn = scanner_T_base[:, :3, :3] / sigma_mm
        by_x, by_frame, by_state, seen = [], [], {}, {}
        for target in observed.targets:
            points_mm = model.predict(x, poses, target)
            at_mm = np.einsum("cij,cj->ci", scanner_T_base[:, :3, :3], points_mm) + scanner_T_base[:, :3, 3]
            seen[target] = Seen(at_mm, observed.scanner_T_base_at(poses))
            by_x.append(turn @ model.linearise(x, poses, target, seen[target])[1] * model.scales)
            by_state[target] = turn @ point_by_state(model.state(x, poses, seen[target]), target)[1]
            block = np.zeros((len(poses), 3, 6 * len(centre)))
            for k, (name, middle_mm) in enumerate(centre.items()):
                rows = poses.setup == name
                block[rows, :, 6 * k : 6 * k + 6] = frame_motion(at_mm[rows], middle_mm) / sigma_mm * _FRAME
            by_frame.append(block)
        return cls(
            np.concatenate(by_x, axis=1),
            np.concatenate(by_frame, axis=1),
            by_state,
            projected,
            poses,
            seen,
            sigma_mm,
        )

    def common(self, stays: BoolArray) -> Array:
        """(C, W, P) of link errors and frames."""
        return np.concatenate([self.by_x[..., stays], self.by_frame], axis=2)

    def of_rival(self, rival: Rival) -> Array:
        """(C, W, K) of a rival's coefficients, each in its size."""
        model, x = self.projected.residuals.model, self.projected.x
        blocks = []
        for target, by_state in self.by_state.items():
            state = model.state(x, self.poses, self.seen[target])
            columns = [
                effect_columns(by_state, member, state, np.zeros(len(member.parameters))) for member in rival.members
            ]
            blocks.append(np.concatenate(columns, axis=2) * rival.sizes)
        return np.concatenate(blocks, axis=1)
