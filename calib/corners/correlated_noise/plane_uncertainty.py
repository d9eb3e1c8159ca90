"""Covariance of three fitted planes where the errors of neighbouring points are correlated, and their fit with it.

A structured-light scanner's error is white noise and a correlated part that is smooth over some millimetres to
decimetres. A covariance for independent points is then too small, the more so the more points there are. The size and
the length of the correlated part show in a scan in three ways:

- the residuals' means over patches of each face have, besides the white noise of a patch, the covariance of the
  correlated part (`likelihood.py`), in one of two forms: an error along the line of sight that is continuous over the
  scanner's image, or unevenness of each face by itself;
- an error that is smooth over more than a face tilts and shifts its plane and leaves no residuals, but it tilts each
  face differently: the angles between the faces differ from the jig's;
- it is continuous beyond the jig: a wall behind shows it over a longer range (`surroundings.py`).

The covariance is the posterior mean over no correlated part at all, or any size and length (`posterior.py`). Lengths of
which nothing in the scan would show anything are left out: there only repeats tell, or what is declared of the scanner
(`declared.py`). Where a correlated error is found or declared, the planes are then fitted anew by generalised least
squares to the means of smaller patches.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from calib.array_types import Array, IndexArray
from calib.corners.correlated_noise.bow import BowEvidence, bow_columns, bow_evidence, quadratic, shows_bows
from calib.corners.correlated_noise.declared import (
    MESH_NOTE,
    NOTHING_DECLARED,
    DeclaredNoise,
    apex_variance_mm2,
    note_on_cells,
    note_on_views,
    registration_covariance,
    share_of_declared,
)
from calib.corners.correlated_noise.likelihood import LENGTHS, SHAPE_LENGTHS, SHAPES, evidence_of, gaussian_kernels
from calib.corners.correlated_noise.patches import Patches, ScannerView, joined, patches_of
from calib.corners.correlated_noise.posterior import SIZES, generalised_fit, patch_covariance, posterior_variances
from calib.corners.correlated_noise.surroundings import evidence_of_surroundings, patches_of_surroundings
from calib.corners.correlated_noise.views import cell_mm, joined_views
from calib.corners.faces.angles import angle_derivative, fitted_angles_deg
from calib.jig import FACE_PAIRS, Jig
from calib.planes.robust_fit import PlaneFit

_PATCHES_AN_EDGE = 6
_PATCHES_A_FACE = 36  # at most, of a triangle; a cube's face has 18, that of a long box had hundreds
_FINE_PATCHES = 10, 100  # an edge, and at most a face, to weigh points by: with 14 an edge the error is the same
_POINTS_A_PATCH = 4  # at least, on average: otherwise the patches are larger
_POINTS_OF_OTHERS = 3
_PRIOR = 0.5, 0.2  # of a correlated error along the sight, and of uneven faces
_LONGEST_ON_FACE = 0.6  # edges: longer ones leave too little in a face's residuals to be distinguished
_DOUBLED, _SEEN = 3.0, 1.0  # variance added to that by white noise; expected loss of log likelihood
_AS_IN_MESHES, _LIKELY = 1 / 14, 0.4  # edges, of a smooth error; its probability
_OF_MEANS = 2.0  # what joined views are taken as off by, over the scatter of means of some of their points
_MADE_TO_DEG = 0.02  # angles of a jig
_OUT_OF_SQUARE = 3.0  # times that: a jig that is off by more says nothing about the scanner


@dataclass(frozen=True)
class PlaneUncertainty:
    """Joint covariance of the three planes, their fit with it, and the correlated part of the scanner's error."""

    planes: tuple[PlaneFit, ...]  # as given, or fitted by generalised least squares where errors are correlated
    covariance: Array  # (9, 9) of height (mm) and two slopes (rad) of each plane in turn, as in PlaneFit.design
    white_covariance: Array  # (9, 9) as if all residuals were white noise
    correlated_sigma_mm: float  # standard deviation of the correlated part; near 0 where there is none
    correlation_length_mm: float  # l of its correlation exp(-r^2 / 2 l^2) or exp(-r / l)
    shown_to_mm: float  # the longest such length of which this scan shows anything
    notes: tuple[str, ...]  # what the scan cannot show
    bows: BowEvidence  # of the faces


@dataclass(frozen=True)
class _Faces:
    """The B patches of the three faces, and how their mean heights move the planes."""

    mean_mm: Array  # (B,) residual
    variance_mm2: Array  # (B,) of that mean, from white noise
    design: Array  # (B, 9) mean of the design's rows
    influence: Array  # (B, 9) how the nine plane parameters move with each patch's mean
    face: IndexArray  # (B,) 0, 1, 2
    patches: tuple[Patches, Patches, Patches]
    white: Array  # (9, 9) covariance of the planes from white noise

    def along_sight(self, lengths_mm: Array) -> Array:
        """Covariance (L, B, B) of patch heights by an error of variance 1 along the rays, continuous across faces."""
        cosine = np.concatenate([p.cosine for p in self.patches])
        image = joined([p.image for p in self.patches])
        return gaussian_kernels(image, lengths_mm) * np.outer(cosine, cosine)

    def uneven(self, lengths_mm: Array) -> Array:
        """Covariance (L, B, B) of patch heights by unevenness of variance 1, independent from face to face."""
        kernels = np.zeros((len(lengths_mm), len(self.face), len(self.face)))
        for number, patches in enumerate(self.patches):
            on = np.flatnonzero(self.face == number)
            kernels[:, on[:, None], on] = gaussian_kernels(patches.face, lengths_mm)
        return kernels

    def covariance(self, size_mm2: Array, declared_mm2: float, declared_length_mm: float, edge_mm: float) -> Array:
        """Covariance (B, B) of patch heights by white noise and errors of variances (2, S), see `patch_covariance`."""
        forms = (self.along_sight, self.uneven)
        correlated = patch_covariance(forms, size_mm2, declared_mm2, declared_length_mm, edge_mm)
        return correlated + np.diag(self.variance_mm2)

    def moved(self, kernels: Array) -> Array:
        """Covariance (L, 9, 9) of the planes by errors whose covariance over the patches is `kernels` (L, B, B)."""
        return self.influence.T @ kernels @ self.influence


def plane_uncertainty(
    planes: Sequence[PlaneFit],
    jig: Jig,
    origin_mm: Array,
    surroundings: Sequence[PlaneFit] = (),
    declared: DeclaredNoise = NOTHING_DECLARED,
    *,
    rectangular: bool = False,
) -> PlaneUncertainty:
    """Joint covariance of three fitted planes under white and correlated noise.

    The faces are triangles, or rectangles where `rectangular`.

    origin_mm  # (3,) of the coordinates of all planes, near the apex, in the scanner's frame; surroundings are flat
    surfaces around the jig, as in `flat_surroundings`.
    """
    edge_mm = jig.shortest_mm
    view = ScannerView.of(origin_mm, edge_mm)
    faces = _patches_of_faces(planes, view, edge_mm)
    flat = [p for p in (patches_of_surroundings(plane, view, edge_mm) for plane in surroundings) if p]
    sizes_mm = SIZES * max(plane.sigma_mm for plane in planes)
    kernels = faces.along_sight(LENGTHS * edge_mm), faces.uneven(LENGTHS * edge_mm)
    moved = np.array([faces.moved(kernel) for kernel in kernels])  # (2, L, 9, 9)
    around, around_loss = np.zeros((2, 2, len(SHAPES), len(sizes_mm)))
    white = 0.0
    for patches in flat:
        waves, none, expected_loss = evidence_of_surroundings(patches, edge_mm, sizes_mm)
        around += np.array([waves, np.full_like(waves, none)])
        around_loss[0] += expected_loss
        white += none
    likelihood, loss = _evidence_of_faces(faces, planes, jig, kernels, sizes_mm)  # (2, S, W)
    likelihood, loss = likelihood + around, loss + around_loss
    harm = (apex_variance_mm2(planes, moved) @ SHAPES.T)[:, :, None] * sizes_mm**2  # (2, S, W)
    harm /= apex_variance_mm2(planes, faces.white)
    on_face = SHAPE_LENGTHS < _LONGEST_ON_FACE
    allowed = np.array([on_face | bool(flat), on_face])
    posterior = posterior_variances(likelihood, white, harm, loss, _PRIOR, allowed, sizes_mm)
    size_mm2 = posterior.size_mm2
    smooth = np.einsum("fs,sl,flij->ij", size_mm2, SHAPES, moved)
    declared_mm2 = 0.0
    if declared.correlated_sigma_mm > 0:
        kernel = faces.along_sight(np.array([declared.correlation_length_mm]))
        by_declared = declared.correlated_sigma_mm**2 * faces.moved(kernel)[0]
        declared_mm2 = declared.correlated_sigma_mm**2 * share_of_declared(planes, smooth, by_declared)
        smooth = smooth + declared_mm2 / declared.correlated_sigma_mm**2 * by_declared
    columns = bow_columns(planes, faces.patches, jig.longest_mm, rectangular)
    shown = shows_bows(faces.mean_mm, faces.variance_mm2, faces.design, columns)
    covariance, fitted = faces.white + smooth, tuple(planes)
    moves = np.zeros(9)
    if posterior.found or declared_mm2 > 0:
        fine = _patches_of_faces(planes, view, edge_mm, *_FINE_PATCHES)
        of_patches = fine.covariance(size_mm2, declared_mm2, declared.correlation_length_mm, edge_mm)
        moves, covariance = generalised_fit(fine.design, fine.mean_mm, of_patches)
        fitted = tuple(plane.moved(moves[3 * i : 3 * i + 3]) for i, plane in enumerate(planes))
    of_less = posterior
    if shown:  # as if the faces had any bow, so that what is left tells the scanner's error
        free, free_loss = _evidence_of_faces(faces, planes, jig, kernels, sizes_mm, quadratic(columns))
        of_less = posterior_variances(free + around, white, harm, free_loss + around_loss, _PRIOR, allowed, sizes_mm)
    fine = _patches_of_faces([p.with_heights() for p in planes], view, edge_mm, *_FINE_PATCHES)
    size_of_less = of_less.size_mm2 if of_less.found else np.zeros_like(size_mm2)
    of_patches = fine.covariance(size_of_less, declared_mm2, declared.correlation_length_mm, edge_mm)
    columns = bow_columns(planes, fine.patches, jig.longest_mm, rectangular)
    bows = bow_evidence(planes, fine.mean_mm, fine.design, columns, of_patches, rectangular=rectangular, shown=shown)
    registration_mm, views_note = declared.registration_sigma_mm, tuple[str, ...]()
    if not registration_mm and (views := joined_views(planes, view)).overlap:
        registration_mm = views.registration_mm
        views_note = (note_on_views(registration_mm),)
    elif not registration_mm and (cells_mm := cell_mm(planes)):
        registration_mm = _OF_MEANS * float(np.median([plane.sigma_mm for plane in planes]))
        views_note = (note_on_cells(cells_mm, registration_mm),)
    of_registration = registration_covariance(fitted, registration_mm)
    covariance = covariance + of_registration
    bows = bows.from_planes(moves, of_registration)
    total_mm2 = float(size_mm2.sum())
    length_mm = float(np.exp(size_mm2.sum(axis=0) @ np.log(SHAPE_LENGTHS) / max(total_mm2, 1e-300))) * edge_mm
    # Of a length that the scan shows, a size that makes the apex twice less certain would be seen.
    at = np.argmin(np.abs(np.log(harm[0] / _DOUBLED)), axis=1)
    seen = loss[0][np.arange(len(SHAPES)), at] > _SEEN
    shown_mm = float(SHAPE_LENGTHS[seen].max(initial=0.0)) * edge_mm
    short = float(posterior.probability[:, np.flatnonzero(LENGTHS < _AS_IN_MESHES)].sum()) > _LIKELY
    notes = ((MESH_NOTE,) if short else views_note) if declared == NOTHING_DECLARED else ()
    return PlaneUncertainty(
        fitted, covariance, faces.white, float(np.sqrt(total_mm2)), length_mm, shown_mm, notes, bows
    )


def _patches_of_faces(
    planes: Sequence[PlaneFit],
    view: ScannerView,
    edge_mm: float,
    patches_an_edge: int = _PATCHES_AN_EDGE,
    patches_a_face: int = _PATCHES_A_FACE,
) -> _Faces:
    """Patches of the three faces, at most so many of each, with their white noise.

    The noise of a face of ten points is hardly known from them: the largest variance of the faces counts as that of
    three further points.
    """
    variances = [float(np.sum(p.psi_mm**2)) / p.slope**2 / max(len(p.psi_mm) - 3, 1) for p in planes]
    white = np.zeros((9, 9))
    patches_of_faces, designs, influences, within = [], [], [], []
    for face, plane in enumerate(planes):
        # Cells along the face's two edges, counted from the apex, so that the patches turn with the scan.
        along = np.column_stack([plane.points_mm @ p.normal - p.offset_mm for p in planes if p is not plane])
        area = 0.5 * float(np.prod(np.ptp(along, axis=0)))
        total = len(plane.psi_mm)
        least_mm2 = max(_POINTS_A_PATCH / total, 1 / patches_a_face) * area
        side_mm = max(edge_mm / patches_an_edge, float(np.sqrt(least_mm2)))
        patches = patches_of(plane, view, along, side_mm)
        # Differences within a patch have no smooth part, so this is the white one; the plane is subtracted already.
        squares = float(np.sum(patches.within_mm2)) + _POINTS_OF_OTHERS * max(variances)
        freedom = max(total - max(len(patches.count), 3), 0) + _POINTS_OF_OTHERS
        variance = max(squares / freedom, 1e-24)
        design = plane.design(plane.points_mm)
        normal_matrix = np.linalg.inv(design.T @ design)
        own = slice(3 * face, 3 * face + 3)
        wide, influence = np.zeros((2, len(patches.count), 9))
        wide[:, own] = patches.design
        influence[:, own] = (patches.design * patches.count[:, None]) @ normal_matrix
        white[own, own] = variance * normal_matrix
        patches_of_faces.append(patches)
        designs.append(wide)
        influences.append(influence)
        within.append(variance / patches.count)
    return _Faces(
        np.concatenate([p.mean_mm for p in patches_of_faces]), np.concatenate(within), np.concatenate(designs),
        np.concatenate(influences), np.repeat(np.arange(3), [len(p.count) for p in patches_of_faces]),
        (patches_of_faces[0], patches_of_faces[1], patches_of_faces[2]), white,
    )  # fmt: skip


def _evidence_of_faces(
    faces: _Faces,
    planes: Sequence[PlaneFit],
    jig: Jig,
    kernels: Sequence[Array],
    sizes_mm: Array,
    free: Array | None = None,
) -> tuple[Array, Array]:
    """Log likelihood and expected loss (F, S, W) of correlated errors of F forms, each with kernels (L, B, B).

    From the faces' residuals, of which parts along `free` (B, K) tell nothing, and the angles between the faces. These
    are three more measurements of the planes, as exact as the jig was made; not so for a certified jig, against which
    the planes are still to be tested.
    """
    mean_mm, variance_mm2, design = faces.mean_mm, faces.variance_mm2, faces.design
    if free is not None:
        design = np.column_stack([design, free])
    if not jig.certified:
        normals = np.array([plane.normal for plane in planes])
        found_deg = np.array(fitted_angles_deg(planes))
        made_deg = np.empty(3)
        made_deg[np.argsort(found_deg)] = np.sort(jig.face_angles_deg)
        worst_deg = float(np.abs(found_deg - made_deg).max())
        slack_deg = worst_deg if worst_deg > _OUT_OF_SQUARE * _MADE_TO_DEG else _MADE_TO_DEG
        off = [normals[i] @ normals[j] + np.cos(np.radians(made_deg[row])) for row, (i, j) in enumerate(FACE_PAIRS)]
        mean_mm = np.concatenate([mean_mm, np.negative(off)])
        variance_mm2 = np.concatenate([variance_mm2, np.full(3, np.radians(slack_deg) ** 2)])
        by_planes = np.zeros((3, design.shape[1]))
        by_planes[:, :9] = angle_derivative(planes)
        design = np.vstack([design, by_planes])
        kernels = [np.pad(of_form, ((0, 0), (0, 3), (0, 3))) for of_form in kernels]
    found = [evidence_of(mean_mm, variance_mm2, design, of_form, sizes_mm) for of_form in kernels]
    return np.array([one.log_likelihood for one in found]), np.array([one.expected_loss for one in found])
