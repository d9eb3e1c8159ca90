"""Posterior variances of correlated errors, by form and kernel shape, and generalised least squares with them.

The variances are posterior means over no correlated error at all, or any size and length, as smooth as the errors of
lenses or as rough as speckle. The prior of a kernel and size grows with what the points would show of it, against the
harm it does to the point that is sought.

Where a correlated error is found or declared, points that share an error are to count less: parameters are fitted by
generalised least squares to the means of patches, with the posterior mean of the errors' covariance (Aitken 1936). A
Gaussian kernel alone would say that the error between two points is known from those around them, and would weigh by
differences that a slightly rougher error drowns, so a part of each is taken as exponential.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from calib.array_types import Array, BoolArray
from calib.corners.correlated_noise.likelihood import LENGTHS, SHAPES, exponential, partly_rough

SIZES = np.geomspace(0.02, 60.0, 32)
"""Sizes (W,) of correlated errors that are weighed, times the points' scatter."""
_MOST_SIZE = 5.0  # larger smooth errors than so many times a face's scatter leave more scatter than that
# The harm that white noise alone leaves of any one kernel and size, as a share of the apex's variance; with 0.3 the
# covariance under white noise comes out a tenth larger, with 1 a fifth.
_MOST_HARM = 0.3
_FOUND = 0.5  # probability of a correlated error from which on parameters are fitted with it
_LEAST_SHARE = 3e-4  # of the variance of the correlated error: kernels with less are left out of the weighting


@dataclass(frozen=True)
class CorrelatedVariances:
    """Posterior mean variances of correlated errors of F forms and S kernel shapes."""

    probability: Array  # (F, S, W) of each form, shape and size; the rest is that of white noise alone
    size_mm2: Array  # (F, S)

    @property
    def found(self) -> bool:
        """Whether a correlated error is likelier than none."""
        return float(self.probability.sum()) > _FOUND


def posterior_variances(
    likelihood: Array, white: float, harm: Array, expected_loss: Array, of_form: Sequence[float], allowed: BoolArray,
    sizes_mm: Array,
) -> CorrelatedVariances:  # fmt: skip
    """Variances of correlated errors from their log likelihoods (F, S, W), and that of white noise alone.

    harm is the variance of the point that is sought over that by white noise, expected_loss that of log likelihood
    where the noise is white, both (F, S, W). of_form are the forms' prior probabilities, allowed (F, S) the shapes that
    each may have. Kernels that would harm much and show little are all but left out: otherwise white noise alone would
    make the covariance larger than it is.
    """
    # Uniform in the standard deviation (Gelman 2006); the steps are equal in its logarithm.
    size = np.where(SIZES <= _MOST_SIZE, SIZES, 0.0)
    shape = np.array(of_form)[:, None] * allowed / allowed.sum(axis=1, keepdims=True)
    prior = np.multiply.outer(shape, size / size.sum())
    prior *= np.minimum(1.0, _MOST_HARM / np.maximum(harm * np.exp(-expected_loss), 1e-300))
    with np.errstate(divide="ignore"):
        log_odds = likelihood + np.log(prior) - white - np.log(1 - prior.sum())
    probability = np.exp(log_odds - np.logaddexp(0.0, np.logaddexp.reduce(log_odds, axis=None)))
    return CorrelatedVariances(probability, probability @ sizes_mm**2)


def patch_covariance(
    forms: Sequence[Callable[[Array], Array]],
    size_mm2: Array,
    declared_mm2: float,
    declared_length_mm: float,
    edge_mm: float,
) -> Array:
    """Covariance (B, B) of patches' means by correlated errors, Gaussian kernels being taken as partly rough.

    Each of the F forms gives the covariances (L, B, B) by errors of variance 1 and Gaussian kernels of lengths (L,);
    size_mm2 (F, S) are the errors' variances by form and shape, declared_mm2 that of a declared error of the first.
    """
    count = len(LENGTHS)
    smooth, rough = partly_rough(size_mm2[:, :count])
    of_length = smooth + exponential(rough, LENGTHS) + size_mm2[:, count:] @ SHAPES[count:]  # (F, L)
    covariance: Array = np.zeros(())
    if declared_mm2 > 0:
        one, rest = partly_rough(np.array([declared_mm2]))
        covariance = one * forms[0](np.array([declared_length_mm]))[0]
        of_length[0] += exponential(rest, np.array([declared_length_mm / edge_mm]))
    of_length[of_length < _LEAST_SHARE * (of_length.sum() + declared_mm2)] = 0
    for variances, form in zip(of_length, forms, strict=True):
        on = np.flatnonzero(variances)
        if len(on):
            covariance = covariance + np.einsum("l,lbc->bc", variances[on], form(LENGTHS[on] * edge_mm))
    return covariance


def generalised_fit(design: Array, mean_mm: Array, covariance: Array) -> tuple[Array, Array]:
    """Parameters (P,) and their covariance by generalised least squares on means (B,) of covariance (B, B)."""
    root = np.linalg.cholesky(covariance)
    whitened = np.linalg.solve(root, np.column_stack([design, mean_mm]))
    rows, values = whitened[:, :-1], whitened[:, -1]
    of_parameters = np.linalg.inv(rows.T @ rows)
    return of_parameters @ rows.T @ values, of_parameters
