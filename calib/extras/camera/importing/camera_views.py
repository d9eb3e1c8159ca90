"""Measured board poses from a folder of images, or from marker poses that another program wrote."""

from __future__ import annotations

import re
import shutil
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from calib import frames
from calib.array_types import Array, IndexArray
from calib.blas_threads import one_blas_thread
from calib.calibration.calibrate import fit_measured
from calib.calibration.mount import arm_columns
from calib.dataset.dataset import Dataset, Orientations, Points, Poses
from calib.dataset.files.points_csv import points_frame
from calib.dataset_import.columns import Meaning
from calib.dataset_import.flange_poses import FlangePoses
from calib.dataset_import.pose_names import NameMatch, files_of_rows, matched
from calib.dataset_import.reading import ImportReport, pose_ids, recognised
from calib.errors import CalibError
from calib.extras.camera.board import board_of
from calib.extras.camera.board_hand_eye import MOUNTS, BoardHandEye, board_hand_eye, least_misfit_mm, misfit_mm
from calib.extras.camera.detection import MeasuredViews, image_files, measured_images
from calib.extras.camera.importing.board_rows import (
    FEWEST,
    bad_rows,
    board_poses,
    fits_of,
    flange_poses,
    of_setups,
    require_agreement,
    require_no_mistake,
)
from calib.extras.camera.importing.intrinsics import load_lens
from calib.extras.camera.importing.pose_files import marker_poses
from calib.extras.camera.importing.pose_noise import noise_of_poses
from calib.extras.camera.lens import LENS_NAMES
from calib.extras.camera.observed import NAME, CameraViews
from calib.extras.camera.view import covariance_of, shared_errors
from calib.fitting.observations import Observations, with_nominal_scanner_frames
from calib.fitting.pose_residuals import PoseResiduals
from calib.kinematics.robot import Robot
from calib.options import FitOptions
from calib.progress import OnProgress
from calib.text_files.csv_text import frame_csv
from calib.text_files.user_table import UserTable

_AT = {"flange": "on the flange", "room": "in the room"}
_FAR_MISFIT = 5.0  # ratio of misfits from which it is clear where the camera is
_WRONG_SCALE = 0.02  # by which a board's size differs from the arm's lengths where it was mistyped
_SURE = 4.5  # sigmas
_MOST_NAMED = 5
_CLEAR = 3.0  # ratio of misfits from which another reading of a marker's poses than the usual is the right one
_FILE_NAME = re.compile(r"[A-Za-z0-9][\w.+-]{0,99}", re.ASCII)  # names that a file can have everywhere
_EXPLAINED = 0.35  # of the misfit, which a size that explains it leaves at the most
_HELPS = 0.8  # the same of a size that explains a part, in place and at most poses
_LEAST_SIGMAS = np.repeat([1e-3, 2e-5], 3)  # mm, rad
_NOISE_ROUNDS = 3
_LEAST_TURN_DEG = 1.0  # root mean square about an axis, from which poses tell a place along others
_WAY_ROUNDS = 3  # in which a board is taken one way up or the other


@dataclass(frozen=True)
class CameraChoice:
    """What a user gives of a camera; images with a board, or poses of a marker."""

    images: Path | None = None
    board: str | None = None
    dictionary: str | None = None
    intrinsics: Path | None = None
    marker_poses: Path | None = None
    mount: str | None = None  # "flange" or "room"; None: by the data
    flange_poses: Path | None = None  # in place of joint values

    @property
    def is_given(self) -> bool:
        """Whether a camera measured at all."""
        return self.images is not None or self.marker_poses is not None

    def require_consistent(self) -> None:
        """Raise CalibError where options do not go together."""
        if self.images is not None and self.marker_poses is not None:
            raise CalibError("give --images or --marker-poses, not both")
        if self.images is not None and self.board is None:
            raise CalibError("--images: tell the board that they show, such as --board charuco:8x6:30:22")
        if self.mount is not None and not self.is_given:
            raise CalibError("--mount: goes with --images or --marker-poses")
        for name in ("board", "dictionary", "intrinsics"):
            if getattr(self, name) is not None and self.images is None:
                raise CalibError(f"--{name}: goes with --images FOLDER")


@dataclass(frozen=True)
class CameraPoints:
    """Poses of a board in the camera's frame, by pose id, ready to be written."""

    names: tuple[str, ...]  # (M,) ids of poses
    camera_T_board: Array  # (M, 4, 4)
    covariance: Array  # (M, 6, 6) mm and rad; 0 where it is not known
    shared: Array  # (M, 6, K)
    views: CameraViews | None
    mount: str | None
    notes: tuple[str, ...] = ()
    doubts: tuple[str, ...] = ()
    point_sigma_mm: float | None = None  # told, or estimated from what a fit leaves
    orientation_sigma_deg: float | None = None  # estimated from that
    images: Mapping[str, Path] = field(default_factory=dict)  # the image of each pose that can be kept by its name
    readings: tuple[FlangePoses, ...] = ()  # ways in which a table's numbers may be meant, where there are several

    def points(self, ids: Sequence[str]) -> Points:
        """Measured points for poses with given ids."""
        index = {pose_id: i for i, pose_id in enumerate(ids)}
        row = np.array([index[name] for name in self.names])
        noise = self.covariance
        attitudes = Orientations(self.camera_T_board[:, :3, :3], noise[:, 3:, 3:], noise[:, :3, 3:])
        shared = self.shared if self.shared.shape[2] else None
        places_mm, names = self.camera_T_board[:, :3, 3], np.full(len(row), "jig")
        return Points(row, places_mm, names, noise[:, :3, :3], attitudes, shared=shared)

    def points_text(self, ids: Sequence[str]) -> str:
        """Text of points.csv."""
        count = len(ids)
        poses = Poses(tuple(ids), np.full(count, "train"), np.zeros((count, 1)), np.full(count, ""), tuple(ids))
        return frame_csv(points_frame(poses, self.points(ids)))

    def select(self, rows: Sequence[int]) -> CameraPoints:
        """The same without all poses but some."""
        names = tuple(self.names[row] for row in rows)
        parts = {name: getattr(self, name)[rows] for name in ("camera_T_board", "covariance", "shared")}
        return replace(self, names=names, **parts)

    def settled(self, robot: Robot, ids: Sequence[str], q: Array, setups: Sequence[str]) -> CameraPoints:
        """The same by the arm as its table has it, see `settled_camera`. Raises CalibError."""
        return settled_camera(self, robot, ids, q, setups)

    def scanner_table(self, declared: Mapping[str, Any]) -> dict[str, Any]:
        """[scanner]: the camera's mount, and the noise of its poses where they have no covariances of their own."""
        table: dict[str, Any] = {"mount": self.mount or "room", **declared}
        if self.views is None:
            table |= {"kind": "camera", "orientation_sigma_deg": self.orientation_sigma_deg}
            if "point_sigma_mm" not in declared:
                table |= {"point_sigma_mm": self.point_sigma_mm, "sigmas": "estimated"}
        return table

    def write(self, folder: Path, *, with_files: bool) -> dict[str, Any]:
        """Write the corners, and the images if `with_files`; returns [camera] of dataset.toml."""
        if self.views is None:
            return {}
        self.views.write(folder)
        if not (self.images and with_files):
            return {NAME: self.views.document()}
        (folder / "images").mkdir()
        for pose_id, path in self.images.items():
            shutil.copyfile(path, folder / "images" / f"{pose_id}{path.suffix.lower()}")
        return {NAME: replace(self.views, images="images").document()}


def ids_of(table: UserTable, mapping: Mapping[str, Meaning], robot: Robot | None = None) -> list[str]:
    """Ids of the poses of a table's rows. Raises CalibError where it lacks joint values of a given robot."""
    report = ImportReport(robot)
    found = recognised(report, table, mapping, positions=False)
    report.raise_all()
    return pose_ids(ImportReport(None), found)


@one_blas_thread()
def camera_points(
    choice: CameraChoice, table: UserTable, ids: Sequence[str], on_progress: OnProgress | None = None
) -> CameraPoints:
    """Board poses from images or marker poses, by the ids of the rows of the arm's table. Raises CalibError."""
    if choice.marker_poses is not None:
        return _of_marker_poses(choice.marker_poses, choice.mount, table, ids)
    assert choice.images is not None
    assert choice.board is not None
    board = board_of(choice.board)
    lens = None if choice.intrinsics is None else load_lens(choice.intrinsics)
    images = image_files(choice.images)
    rows, how = files_of_rows(images, table, ids)
    if not rows:
        raise CalibError(
            f"{table.path}: none of its {len(ids)} rows has the name of one of the {len(images)} images in "
            f"{choice.images}; add a column `image` with the file's name to each row"
        )
    kept = {stem: images[stem] for stem in rows}
    detected, measured = measured_images(kept, board, lens, choice.dictionary, on_progress)
    left_out = {images[stem].name: f"no row of {table.path.name} has its name" for stem in images if stem not in rows}
    left_out |= {**detected.left_out, **measured.left_out}
    notes = [f"{choice.images}: images are matched to the rows of {table.path.name} {how}"] if how else []
    notes += [f"image {name} is left out: {reason}" for name, reason in list(left_out.items())[:_MOST_NAMED]]
    if more := list(left_out)[_MOST_NAMED:]:
        notes.append(f"{len(more)} more images are left out: {', '.join(more)}")
    poses = measured.poses
    names = tuple(ids[rows[one.view.pose]] for one in poses)
    views = CameraViews(
        lens=replace(measured.lens, covariance=None),
        board=board.text,
        sigma_px=measured.sigma_px,
        pose=tuple(name for name, one in zip(names, poses, strict=True) for _ in one.view.corner),
        corner=np.concatenate([one.view.corner for one in poses]),
        board_mm=np.concatenate([one.view.board_mm for one in poses]),
        pixels=np.concatenate([one.view.pixels for one in poses]),
        lens_from="images" if choice.intrinsics is None else choice.intrinsics.name,
    )
    return CameraPoints(
        names,
        np.stack([one.camera_T_board for one in poses]),
        np.stack([covariance_of(one, measured.sigma_px) for one in poses]),
        shared_errors(measured.lens, poses),
        views,
        choice.mount,
        (*notes, *detected.notes, *_told(choice.images, views, measured)),
        images={ids[rows[stem]]: path for stem, path in kept.items() if _FILE_NAME.fullmatch(ids[rows[stem]])},
    )


def _told(folder: Path, views: CameraViews, measured: MeasuredViews) -> list[str]:
    """Notes on what was seen, and on the lens."""
    lens = measured.lens
    seen = f"{folder}: {len(measured.poses)} images show {views.board}, {len(views.corner)} corners, "
    if views.lens_from != "images":
        told = f"the lens is that of {views.lens_from}, taken as exact"
    else:
        each = zip(LENS_NAMES[:4], lens.numbers, lens.sigmas, strict=False)
        four = ", ".join(f"{name} {value:.2f} ± {error:.2f}" for name, value, error in each)
        told = f"the lens is found from the images: {four} pixels; its errors are unknowns of every fit"
    return [f"{seen}{measured.sigma_px:.3f} pixels of noise", told]


def _of_marker_poses(path: Path, mount: str | None, table: UserTable, ids: Sequence[str]) -> CameraPoints:
    """Board poses that another program measured. Raises CalibError."""
    given = marker_poses(path)
    count = len(given.readings[0].base_T_flange)
    found = max((matched(names, ids) for names in given.names), key=lambda one: one.count, default=NameMatch(()))
    notes = [f"{path}: {given.readings[0].form}"] if len(given.readings) == 1 else []
    if 2 * found.count < count:
        if count != len(ids):
            raise CalibError(
                f"{path}: {count} poses, and {table.path} has {len(ids)} rows; name the pose of each, or give as many"
            )
        found = NameMatch(tuple(range(count)))
        if table.path != path:
            notes.append(f"{path}: names no poses; they are taken in the order of {table.path.name}")
    rows = [row for row, pose in enumerate(found.pose) if pose >= 0]
    if len(rows) < count:
        notes.append(f"{path}: {count - len(rows)} rows belong to no pose of {table.path.name} and are left out")
    readings = tuple(replace(one, base_T_flange=one.base_T_flange[rows]) for one in given.readings)
    names = tuple(ids[found.pose[row]] for row in rows)
    return CameraPoints(
        names, readings[0].base_T_flange, np.zeros((len(names), 6, 6)), np.zeros((len(names), 6, 0)), None, mount,
        tuple(notes),
        readings=readings if len(readings) > 1 else (),
    )  # fmt: skip


def _read_by_arm(given: CameraPoints, base_T_flange: Array) -> CameraPoints:
    """The same in the reading of its numbers by which the arm misses the board least; the usual one where none does."""
    off_mm = [least_misfit_mm(base_T_flange, one.base_T_flange) for one in given.readings]
    best = int(np.argmin(off_mm))
    chosen = given.readings[best if _CLEAR * off_mm[best] < off_mm[0] else 0]
    return replace(given, camera_T_board=chosen.base_T_flange, notes=(*given.notes, f"the marker's {chosen.form}"))


def _right_way_up(
    given: CameraPoints, views: CameraViews, base_T_flange: Array, setups: Sequence[IndexArray]
) -> CameraPoints:
    """The same with a board that half a turn leaves alike taken the way up that the arm tells, in each placement.

    Turns between two poses are as large for the board as for the flange; what is left open the fit to most tells.
    """
    ways = np.stack([given.camera_T_board, given.camera_T_board @ np.diag([-1.0, -1.0, 1.0, 1.0])], axis=1)
    chosen, is_turned = given.camera_T_board.copy(), np.zeros(len(ways), dtype=bool)
    for rows in setups:
        flange, either = base_T_flange[rows], ways[rows]
        off = np.abs(_turn(either[0, 0], either) - _turn(flange[0], flange)[:, None])
        for _ in range(_WAY_ROUNDS):
            way = np.argmin(off, axis=1)
            seen = either[np.arange(len(rows)), way]
            fits = [board_hand_eye(flange, seen, on_flange=mount == "flange") for mount in MOUNTS]
            off = _turn(min(fits, key=lambda fit: fit.misfit_mm).predicted(flange)[:, None], either)
        chosen[rows], is_turned[rows] = seen, way == 1
    turned = np.isin(views.pose, [name for name, one in zip(given.names, is_turned, strict=True) if one])
    board = board_of(views.board)
    corner = np.where(turned, len(board.corners_mm) - 1 - views.corner, views.corner)
    return replace(given, camera_T_board=chosen, views=replace(views, corner=corner, board_mm=board.corners_mm[corner]))


def _turn(one: Array, other: Array) -> Array:
    """Angles (...), rad, by which poses (..., 4, 4) are turned against each other."""
    return np.linalg.norm(
        frames.rotvec_from_rotation(np.swapaxes(one, -1, -2)[..., :3, :3] @ other[..., :3, :3]), axis=-1
    )


def settled_camera(
    given: CameraPoints, robot: Robot, ids: Sequence[str], q: Array, setups: Sequence[str]
) -> CameraPoints:
    """Board poses with the camera's mount, and their noise where it is not known, found by the arm as its table has it.

    Single poses that contradict the others are left out. ids: of the arm's N poses, with q (N, n) rad, mm, and the
    names of the camera's placements, [] for one. Raises CalibError where all contradict the arm, where the board's size
    does, or where the mount is not clear.
    """
    if len(given.names) < FEWEST:
        raise CalibError(f"the board is seen at {len(given.names)} poses; {FEWEST} and more are needed, better 20")
    role = np.array(["reference", *["train"] * (len(ids) - 1)])
    poses = Poses(tuple(ids), role, q, np.array(setups or [""] * len(ids)), tuple(ids))

    def to_fit(given: CameraPoints) -> Dataset:
        """What the camera saw, all poses for training, for a fit by which the import judges it."""
        return Dataset("", replace(robot, carries_scanner=given.mount == "flange"), poses, given.points(ids))

    plain = to_fit(given)
    if given.readings:
        given = _read_by_arm(given, flange_poses(plain))
        plain = to_fit(given)
    if given.views is not None and board_of(given.views.board).turns_alike:
        given = _right_way_up(given, given.views, flange_poses(plain), of_setups(plain))
        plain = to_fit(given)
    one_axis = _turns_about_one_axis(flange_poses(plain))
    notes, mount = list(given.notes), given.mount
    names = ("the arm's poses", "the images" if given.views is not None else "the marker's poses")
    both = {name: fits_of(plain, on_flange=name == "flange") for name in MOUNTS}
    if not all(both.values()):
        raise CalibError(f"no placement of the camera has {FEWEST} poses; name as one what was one, or give more")
    off_mm = {name: max(fit.misfit_mm for fit in fits) for name, fits in both.items()}
    best, other = sorted(off_mm, key=lambda name: off_mm[name])
    is_clear = off_mm[other] > _FAR_MISFIT * off_mm[best]
    if mount == other and is_clear:
        raise CalibError(
            f"--mount {mount}: with the camera {_AT[other]} arm and board disagree by {off_mm[other]:.3g} mm, with it "
            f"{_AT[best]} by {off_mm[best]:.3g} mm; give --mount {best}, or leave it out; poses of the camera in the "
            "board's frame, the inverse ones, would tell the same"
        )
    best, other = (best, other) if mount in (None, best) else (other, best)
    for name in (best,) if is_clear or mount else (best, other):
        require_no_mistake(plain, both[name], both[best], names)
    doubt = _doubted_size(plain, both[best], given)
    require_agreement(plain, both[best], names)
    if not is_clear and mount is None:
        raise CalibError(
            f"the poses do not tell where the camera is: on the flange arm and board disagree by "
            f"{off_mm['flange']:.3g} mm, in the room by {off_mm['room']:.3g} mm; give "
            "--mount flange or --mount room, and check that joints and images belong together"
        )
    notes.append(
        f"the camera is {_AT[best]}: arm and board disagree by {off_mm[best]:.3g} mm, and by "
        f"{off_mm[other]:.3g} mm if it were {_AT[other]}"
    )
    given = replace(given, mount=best)
    left_out = bad_rows(plain, both[best])
    if left_out:
        notes += [f"pose {given.names[row]} is left out: its board is {why}" for row, why in left_out.items()]
        given = given.select([row for row in range(len(given.names)) if row not in left_out])
    if given.views is None:
        given = _with_noise_of_fit(given, to_fit, both[best])
        left = "the arm as it was told leaves" if robot.is_cartesian else "a fit of the links leaves"
        notes.append(
            f"the poses' noise is not given: {given.point_sigma_mm:.2g} mm and {given.orientation_sigma_deg:.2g}° per "
            f"axis, along the sight and across it by what is left in each, weigh them, which {left}; give --sigma if "
            "you know it"
        )
    return replace(given, notes=tuple(notes), doubts=(*given.doubts, *filter(None, (doubt, one_axis))))


def _turns_about_one_axis(base_T_flange: Array) -> str | None:
    """What to doubt where a flange turns about one axis alone. Raises CalibError where it does not turn at all."""
    rotation = base_T_flange[:, :3, :3]
    turns = frames.rotvec_from_rotation(rotation @ frames.mean_rotation(rotation).T)
    size = np.degrees(np.linalg.svd(turns, compute_uv=False) / np.sqrt(len(turns)))
    remedy = "turn the flange by 20° and more about two axes"
    if size[0] < _LEAST_TURN_DEG:
        raise CalibError(f"the flange has the same attitude at all poses, so that nothing tells the places; {remedy}")
    if size[1] < _LEAST_TURN_DEG:
        return f"the flange turns about one axis alone: no pose tells where camera and board are along it; {remedy}"
    return None


def _with_noise_of_fit(
    given: CameraPoints, to_fit: Callable[[CameraPoints], Dataset], fits: Sequence[BoardHandEye]
) -> CameraPoints:
    """Board poses with the noise that a fit of links, camera and board leaves; of the table's, without one.

    A sigma of places that was told stays.
    """
    sigmas = np.array([max(fit.rms_mm for fit in fits), max(fit.rms_rad for fit in fits)]) / np.sqrt(3.0)
    unit = np.maximum(np.repeat(sigmas, 3), _LEAST_SIGMAS)
    plain = replace(given, covariance=np.broadcast_to(np.diag(unit**2), given.covariance.shape))
    given, noise = plain, None
    for _ in range(_NOISE_ROUNDS):
        try:
            fitted = fit_measured(to_fit(given), FitOptions("pose"))
        except CalibError:
            break
        model, x = fitted.model, fitted.fit.x
        observed = Observations.of(replace(fitted.fitted_dataset, points=to_fit(plain).points))
        observed = with_nominal_scanner_frames(observed, model.placed_robot)
        residuals = PoseResiduals(model, observed)
        at = residuals.nuisance(x)
        by_held, is_length = np.zeros((6 * len(at.error), 0)), np.zeros(0, dtype=bool)
        if not fitted.fits_links:
            by_held, is_length = arm_columns(fitted, observed, residuals, at)
        by_links, by_frames, by_held = (
            unit[:, None] * part.reshape(len(at.error), 6, -1) for part in (at.by_parameters, at.by_frames, by_held)
        )
        errors = at.error - by_links @ (x - model.means)
        noise = noise_of_poses(
            given.camera_T_board, errors, by_frames, by_links * model.scales, (by_held, is_length),
            sigma_mm=given.point_sigma_mm,
        )  # fmt: skip
        given = replace(given, covariance=noise.covariance, shared=noise.shared)
    sigma_mm, sigma_rad = unit[0], unit[3]
    if noise is not None:
        sigma_mm, sigma_rad = np.sqrt(noise.variances.reshape(2, 2) @ [2.0, 1.0] / 3.0)
    if noise is not None and noise.step.any():
        doubt = (
            f"errors of successive poses add up, by {noise.step[0]:.2g} mm and {np.degrees(noise.step[1]):.3f}° from "
            "one to the next: board or camera creeps or was bumped, or the clocks of arm and camera differ; the "
            "camera's place allows for it, and is the better for poses in mixed order, measured standing"
        )
        given = replace(given, doubts=(*given.doubts, doubt))
    return replace(
        given,
        point_sigma_mm=given.point_sigma_mm or float(sigma_mm),
        orientation_sigma_deg=float(np.degrees(sigma_rad)),
    )


def _doubted_size(dataset: Dataset, fits: Sequence[BoardHandEye], given: CameraPoints) -> str | None:
    """What to doubt where lengths of the arm contradict the declared size of a board; None where they do not.

    A size is told where it explains what arm and board disagree by, at most poses, in each placement of the camera
    alike: whatever else is wrong leaves its attitudes or its places, and a third of bad rows turns no claim. Raises
    CalibError where it explains nearly all.
    """
    for fit, rows in zip(fits, of_setups(dataset), strict=True):
        off = abs(1.0 / fit.scale - 1.0) if fit.scale > 0.0 else float("inf")
        if off < _WRONG_SCALE or abs(fit.scale - 1.0) < _SURE * fit.scale_sigma:
            return None
        flange, seen = flange_poses(dataset)[rows], board_poses(dataset)[rows]
        scaled = frames.make_transform(seen[:, :3, :3], fit.scale * seen[:, :3, 3])
        now_mm, then_mm = (misfit_mm(flange, each, on_flange=fit.on_flange) for each in (seen, scaled))
        if max(fit.scaled_mm / fit.rms_mm, then_mm / now_mm) > _HELPS:
            return None
    scales = [fit.scale for fit in fits]
    if np.ptp(scales) > _WRONG_SCALE * min(scales):
        return None
    fitting = f"fit the arm with {{}} {scales[0]:.4g} times as large (± {fits[0].scale_sigma:.2g})"
    if given.views is None:
        told = f"the marker's poses {fitting.format('lengths')}; check the units of both files, and the "
        told += "marker's size in the program that measured them"
    else:
        told = f"--board {given.views.board}: the images {fitting.format('a board')}; measure its squares, or check "
        told += "the robot's units"
    if all(fit.scaled_mm < _EXPLAINED * fit.rms_mm for fit in fits):
        raise CalibError(told)
    return told
