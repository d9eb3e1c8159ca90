"""A dataset as frozen values: one robot, its poses, the measured points or scans, and the known surroundings.

Its files are read by `calib.dataset.files.folder`. Lengths mm, angles rad, masses kg, times s, temperatures
Celsius.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from difflib import get_close_matches
from functools import cached_property
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from calib import frames
from calib.array_types import Array, BoolArray, IndexArray, Vector
from calib.brief import Brief
from calib.dataset.attachments import AttachedValue, Attachment
from calib.dataset.further_columns import FurtherColumns
from calib.errors import DatasetError
from calib.jig import Jig
from calib.kinematics.robot import Robot
from calib.lazy_modules import pd
from calib.noise_shape import NoiseShape
from calib.plugins import contributions, load
from calib.presented import Presented
from calib.target_shapes import DeclaredTarget


@dataclass(frozen=True)
class Box:
    """An obstacle: a box along the axes of the base frame, between two of its corners."""

    name: str
    min_mm: Vector
    max_mm: Vector


@dataclass(frozen=True)
class Surroundings:
    """Obstacles of the arm (floor and boxes, in the base frame), and its least allowed manipulability.

    `floor_z_mm` is None where not known; `least_manipulability`, 0 to 1, is as `calib.workcell.measurable` defines it.
    """

    floor_z_mm: float | None = None
    boxes: tuple[Box, ...] = ()
    least_manipulability: float = 0.0
    extra: Mapping[str, Any] = field(default_factory=dict)


ROLES = ("reference", "train", "test")
PoseCondition = Literal["approach", "payload_kg", "temperature_c"]
"""Conditions of a pose, besides its joints, that whoever measures may choose: columns of poses.csv."""


def usual_residual(attached: Collection[str], *, by_camera: bool, sigmas_estimated: bool) -> str:
    """Kind of residual that is fitted unless another is asked for: full poses of a marker that a camera saw.

    attached: names of the attached values, whose kinds may want another.
    """
    wanted = (kind.usual_residual for kind in contributions(Attachment) if kind.name in attached)
    return next(filter(None, wanted), "pose" if by_camera or sigmas_estimated else "position")


@dataclass(frozen=True)
class Scanner:
    """Declared noise and field of the measuring instrument; None for what is not declared."""

    point_sigma_mm: float | None = None  # one measured point, each axis
    scan_sigma_mm: float | None = None  # one scan point, along the ray
    extra: Mapping[str, Any] = field(default_factory=dict)
    orientation_sigma_rad: float | None = None  # one measured orientation, about each axis
    field_mm: Vector | None = None  # width and height at that distance, and depth
    distance_mm: float | None = None  # from the scanner to the middle of its field; known where the field is
    max_incidence_deg: float | None = None  # the steepest face that it measures
    correlated_sigma_mm: float | None = None  # of a scan point's error that its neighbours share, along the ray
    correlation_length_mm: float | None = None  # l of its correlation exp(-r^2 / 2 l^2); known where its size is
    registration_sigma_mm: float | None = None  # by which surfaces joined of several views are off, each axis
    place_sigma_mm: float | None = None  # of each known place that the points are of, such as a socket, each axis
    is_camera: bool = False  # whose poses of a marker another program measured: no images were kept
    sigmas_estimated: bool = False  # from what a fit of the links leaves: they weigh, and prove nothing by their size


@dataclass(frozen=True)
class SignalNoise:
    """Declared noise of the signals of poses.csv (`calib.dataset.signals`); None for what is not declared."""

    torque_sigma_nm: float | None = None  # one measured torque
    link_sigma_rad: float | None = None  # one angle of an encoder on a link's side
    extra: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class About:
    """Details of a measurement for the report: arm, place, date and operator; "" for what is not recorded."""

    serial: str = ""
    operator: str = ""
    site: str = ""
    date: str = ""
    extra: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class Poses(Brief):
    """N poses of an arm with n joints, as commanded, with the recorded conditions."""

    ids: tuple[str, ...]  # (N,)
    role: NDArray[np.str_]  # (N,) of ROLES; exactly one reference
    q: Array  # (N, n) rad, mm for prismatic joints
    setup: NDArray[np.str_]  # (N,) station of the scanner; "" where there is only one
    scan_names: tuple[str, ...]  # (N,) file names in the scan folder
    payload_kg: Array | None = None  # (N,)
    temperature_c: Array | None = None  # (N,)
    time_s: Array | None = None  # (N,)
    approach: Array | None = None  # (N, n) of -1, 1
    extra: FurtherColumns = field(default_factory=FurtherColumns)  # unknown columns, kept and offered as inputs
    order: Array = field(default_factory=lambda: np.zeros(0))
    """Place (N,) in the order of measuring, from 0; inf for poses that come after all that were measured. Where it is
    not given: by time_s, else by row."""
    came_from: Array = field(default_factory=lambda: np.zeros((0, 0)))
    """Joints (N, n) of the pose measured before, of the first its own. Where it is not given, by `order`."""
    selected_from: Poses | None = None
    """All poses of the measurement, where these are some of them; dropped where `came_from` is not given."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "extra", FurtherColumns.of(self.extra))
        if len(self.order) != len(self.ids):
            rows = (
                np.arange(len(self.ids), dtype=float) if self.time_s is None else np.argsort(self.time_s, kind="stable")
            )
            object.__setattr__(self, "order", np.argsort(rows).astype(float))
        if len(self.came_from) != len(self.ids):
            object.__setattr__(self, "selected_from", None)
            sequence = np.argsort(self.order, kind="stable")
            came_from = np.array(self.q, dtype=float)
            came_from[sequence[1:]] = self.q[sequence[:-1]]
            object.__setattr__(self, "came_from", came_from)

    def __len__(self) -> int:
        return len(self.ids)

    @property
    def reference(self) -> int:
        """Index of the reference pose."""
        return int(np.flatnonzero(self.role == "reference")[0])

    @property
    def is_test(self) -> BoolArray:
        """Mask (N,) of the test poses, which no fit sees; all others, the reference too, are for training."""
        return self.role == "test"

    def select(self, rows: IndexArray) -> Poses:
        """Some of the poses, in the order of `rows` (K,)."""

        def pick(values: Array | None) -> Array | None:
            return None if values is None else values[rows]

        return Poses(
            ids=tuple(self.ids[i] for i in rows),
            role=self.role[rows],
            q=self.q[rows],
            setup=self.setup[rows],
            scan_names=tuple(self.scan_names[i] for i in rows),
            payload_kg=pick(self.payload_kg),
            temperature_c=pick(self.temperature_c),
            time_s=pick(self.time_s),
            approach=pick(self.approach),
            extra=self.extra.select(rows),
            order=self.order[rows],
            came_from=self.came_from[rows],
            selected_from=self.selected_from or self,
        )

    @cached_property
    def sequence(self) -> Poses:
        """All poses of the measurement in the order they were measured, used or not: what a history is made of.

        Those that a fit does without are in it: test poses, poses that were left out, poses without a point.
        """
        measured = self.selected_from or self
        return replace(measured.select(np.argsort(measured.order, kind="stable")), selected_from=None)

    def from_sequence(self, values: Array) -> Array:
        """Rows (N, ...) of values (L, ...) of `sequence` at these poses; 0 at poses `measured_later`."""
        place = np.searchsorted(self.sequence.order, self.order)
        later = ~np.isfinite(self.order)
        found = np.array(values[np.where(later, 0, np.minimum(place, len(values) - 1))], dtype=float)
        found[later] = 0.0
        return found

    def measured_later(self) -> Poses:
        """These poses as if measured after all fitted ones, so that effects of pose order keep their last value."""
        return replace(self, order=np.full(len(self), np.inf), came_from=self.q)

    @property
    def motion(self) -> Array:
        """Motion (N, n) of each joint from the pose before; 0 for the first pose and for poses `measured_later`."""
        return np.where(np.isfinite(self.order)[:, None], self.q - self.came_from, 0.0)

    def index(self, pose_id: str) -> int:
        try:
            return self.ids.index(pose_id)
        except ValueError:
            near = get_close_matches(pose_id, self.ids, n=3)
            hint = f"the nearest of {len(self)}: {', '.join(map(repr, near))}" if near else ""
            hint = hint or f"the first of {len(self)} is {self.ids[0]!r}"
            raise DatasetError(f"no pose named {pose_id!r}; {hint}") from None

    def _brief(self) -> str:
        roles = ", ".join(f"{n} {role}" for role in ROLES if (n := int(np.sum(self.role == role))))
        return f"{len(self)} poses of {self.q.shape[1]} joints: {roles}"


@dataclass(frozen=True)
class FaceLabelling(Brief):
    """Method by which the jig's faces, which look alike in scans, were labelled, and how certain the labels are."""

    by: str  # "robot", "angles" or "continuity", see `calib.measurement.face_labels`
    poses: int  # with labels
    least_margin: float | None  # by which the next labelling of a pose is worse; None without any pose
    needed_margin: float
    unit: str  # of both: "deg", or "squared sigmas"
    refused: int  # poses whose faces cannot be labelled
    first_refused: tuple[str, str] | None  # the first of them, and why
    found_angles_deg: Vector | None  # used instead of the jig's, where those do not fit


@dataclass(frozen=True)
class Orientations(Brief):
    """Orientation of the jig at M measured points, in the scanner's frame; NaN where it is not known.

    The covariances are of the small turn w about the scanner's axes: true = exp(w) scanner_R_jig.
    """

    scanner_R_jig: Array  # (M, 3, 3)
    covariance_rad2: Array | None = None  # (M, 3, 3)
    cross_mm_rad: Array | None = None  # (M, 3, 3) of the point's error (rows) with the turn (columns)
    labelling: FaceLabelling | None = None  # of the jig's faces; None where points.csv has orientations
    unlabelled_reason: str = ""  # why the faces have no labels at some poses, and what would help

    @property
    def known(self) -> BoolArray:
        """Mask (M,) of the points whose orientation is known."""
        return np.asarray(np.isfinite(self.scanner_R_jig).all(axis=(1, 2)))

    def select(self, keep: ArrayLike) -> Orientations:
        """The orientations of the selected points; `keep` is a mask (M,) or row numbers (K,)."""
        keep = np.asarray(keep)
        covariance, cross = self.covariance_rad2, self.cross_mm_rad
        return Orientations(
            self.scanner_R_jig[keep],
            None if covariance is None else covariance[keep],
            None if cross is None else cross[keep],
            self.labelling,
            self.unlabelled_reason,
        )


@dataclass(frozen=True)
class Lengths:
    """M measured lengths from anchors, such as of draw wires (`calib.dataset.lengths`)."""

    length_mm: Array  # (M,)
    anchor: NDArray[np.str_]  # (M,) name; "" where there is one alone
    direction: Array  # (M, 3) unit vector from the anchor to where the target is predicted, in the points' frame
    place_mm: Array  # (M, 3) of the anchor in the base frame; nan where it is not known

    def select(self, keep: ArrayLike) -> Lengths:
        """The selected lengths; `keep` is a mask (M,) or row numbers (K,)."""
        keep = np.asarray(keep)
        return Lengths(self.length_mm[keep], self.anchor[keep], self.direction[keep], self.place_mm[keep])

    @property
    def known_places(self) -> dict[str, Vector]:
        """Places of the anchors that are known, by name: mm, base frame."""
        first = {str(name): self.place_mm[i] for i, name in reversed(list(enumerate(self.anchor)))}
        return {name: (float(p[0]), float(p[1]), float(p[2])) for name, p in first.items() if np.isfinite(p).all()}


@dataclass(frozen=True)
class Points(Brief):
    """M measured points in the scanner's frame of their pose's setup; several points of one pose are repeats."""

    pose: IndexArray  # (M,) index into Poses
    xyz_mm: Array  # (M, 3)
    target: NDArray[np.str_]  # (M,) "jig", or the name of one of the robot's further targets
    covariance_mm2: Array | None = None  # (M, 3, 3)
    orientations: Orientations | None = None  # full poses, where the instrument tells more than points
    counts_as: Array | None = None  # (M,) how many measurements each counts as, where points are means of several
    lengths: Lengths | None = None  # where only lengths from anchors were measured: then `xyz_mm` starts there
    # (M, 6, K) changes of point, mm, and orientation, rad, by one sigma of each of K errors that all points share,
    # such as those of a camera's lens
    shared: Array | None = None
    shared_found: Array | None = None  # (K,) of these, in sigmas, that a fit found and that the points are free of

    def free_of(self, found: Array | None) -> Points:
        """The points free of given errors (K,), in sigmas, that all share; with None as they were measured."""
        if self.shared is None or (found is None and self.shared_found is None):
            return self
        moved = self
        for sign, errors in ((1.0, self.shared_found), (-1.0, found)):
            if errors is not None:
                moved = moved._moved(sign * (self.shared @ errors))
        return replace(moved, shared_found=found)

    def _moved(self, change: Array) -> Points:
        """The points moved by (M, 6): mm, and rotation vectors, rad, about the scanner's axes."""
        turned = self.orientations
        if turned is not None:
            rotations = frames.rotation_from_rotvec(change[:, 3:]) @ turned.scanner_R_jig
            turned = replace(turned, scanner_R_jig=rotations)
        return replace(self, xyz_mm=self.xyz_mm + change[:, :3], orientations=turned)

    @property
    def coordinates(self) -> int:
        """Number of coordinates that each point tells: 3, or 1 of a length."""
        return 3 if self.lengths is None else 1

    def __len__(self) -> int:
        return len(self.pose)

    def select(self, keep: ArrayLike) -> Points:
        """The selected points; `keep` is a mask (M,) or row numbers (K,)."""
        keep = np.asarray(keep)
        covariance = None if self.covariance_mm2 is None else self.covariance_mm2[keep]
        turned = None if self.orientations is None else self.orientations.select(keep)
        counts_as = None if self.counts_as is None else self.counts_as[keep]
        lengths = None if self.lengths is None else self.lengths.select(keep)
        shared = None if self.shared is None else self.shared[keep]
        return Points(
            self.pose[keep], self.xyz_mm[keep], self.target[keep], covariance, turned, counts_as, lengths, shared,
            self.shared_found,
        )  # fmt: skip

    def _brief(self) -> str:
        targets = ", ".join(map(str, np.unique(self.target)))
        what = "points" if self.lengths is None else "lengths"
        return f"{len(self)} {what} at {len(np.unique(self.pose))} poses of {targets}"


@dataclass(frozen=True)
class Dataset(Presented):
    """A robot, its poses and the measurements: `points`, or scans to find points in, or both (the points are used)."""

    name: str
    robot: Robot
    poses: Poses
    points: Points | None = None
    folder: Path | None = None
    scan_folder: str | None = None
    description: str = ""
    scanner: Scanner = field(default_factory=Scanner)
    jig: Jig = field(default_factory=Jig)
    warnings: tuple[str, ...] = ()
    extra: Mapping[str, Any] = field(default_factory=dict)
    jig_is_declared: bool = True  # False: dataset.toml has no [jig], so points.csv may be of mirrors or balls
    notes: tuple[str, ...] = ()  # what is no mistake, and worth knowing
    left_out: tuple[str, ...] = ()  # ids of poses that count for nothing
    new_setups: tuple[str, ...] = ()  # ids of poses from which on the instrument stands elsewhere, as asked
    noise: NoiseShape | None = None  # of the points, where it is known to differ from the declared one
    about: About = field(default_factory=About)
    surroundings: Surroundings = field(default_factory=Surroundings)
    targets: tuple[DeclaredTarget, ...] = ()  # besides the three-faced jig, as dataset.toml describes them
    signal_noise: SignalNoise = field(default_factory=SignalNoise)
    finder_file: Path | None = None  # of a finder of the user's own, for what is to be found in the scans
    attachments: Mapping[str, AttachedValue] = field(default_factory=dict)  # of plug-ins, by their names
    read_files: Mapping[str, str] = field(default_factory=dict, compare=False)
    """Hash of each file, scans apart, as it was read, by path below the folder: a file may change under a fit."""

    @property
    def all_targets(self) -> tuple[DeclaredTarget, ...]:
        """Targets to find in the scans: the jig, if declared or if nothing else is, and the declared others."""
        named = any("jig" in target.names for target in self.targets)
        if self.targets and (named or not self.jig_is_declared):
            return self.targets
        return (DeclaredTarget("jig", self.jig), *self.targets)

    def scan_path(self, pose: int) -> Path | None:
        """Path of the scan of a pose; None where the dataset has no scans."""
        if self.folder is None or self.scan_folder is None:
            return None
        return self.folder / self.scan_folder / self.poses.scan_names[pose]

    @property
    def kinds_of_attachments(self) -> tuple[Attachment, ...]:
        """What is known of the attached values' kinds."""
        return tuple(kind for kind in contributions(Attachment) if kind.name in self.attachments)

    @property
    def is_by_camera(self) -> bool:
        """Whether a camera measured, whose own place is what is asked for, and not a tracker or scanner."""
        return self.scanner.is_camera or any(kind.instrument == "camera" for kind in self.kinds_of_attachments)

    @property
    def usual_residual(self) -> str:
        """Kind of residual that is fitted unless another is asked for."""
        return usual_residual(
            self.attachments, by_camera=self.scanner.is_camera, sigmas_estimated=self.scanner.sigmas_estimated
        )

    @property
    def shows_faces(self) -> bool:
        """Whether the measured target is a jig with plane faces, rather than mirrors or balls."""
        if self.targets and not any(isinstance(target.shape, Jig) for target in self.all_targets):
            return False
        if self.scan_folder is not None or self.points is None:
            return True
        return self.jig_is_declared and bool(np.all(self.points.target == "jig"))

    @property
    def declares_noise(self) -> bool:
        """Whether the noise of the points is declared, by dataset.toml or by covariances of the points."""
        declared = self.scanner.point_sigma_mm is not None
        own = self.points is not None and self.points.covariance_mm2 is not None
        return (declared or own) and not self.scanner.sigmas_estimated

    def with_points(self, points: Points) -> Dataset:
        """The dataset with these measured points, except those of poses that are left out."""
        gone = [self.poses.index(pose_id) for pose_id in self.left_out]
        return replace(self, points=points.select(~np.isin(points.pose, gone)) if gone else points)

    def free_of_shared(self, found: Array | None) -> Dataset:
        """The dataset with its points free of errors (K,) that all share, see `Points.free_of`."""
        if self.points is None or self.points.shared is None:
            return self
        return replace(self, points=self.points.free_of(found))

    def leave_out(self, pose_ids: Sequence[str]) -> Dataset:
        """The dataset without the measured points of some poses, with a note; the poses themselves stay.

        Raises DatasetError on an id that no pose has.
        """
        ids = tuple(dict.fromkeys(pose_ids))
        for pose_id in ids:
            try:
                self.poses.index(pose_id)
            except DatasetError as error:
                raise DatasetError(f"dataset {self.name}: {error}; so it cannot be left out") from None
        if not ids:
            return self
        note = f"left out as asked: {', '.join(ids)}"
        asked = replace(self, left_out=ids, notes=(*self.notes, note))
        return asked if self.points is None else asked.with_points(self.points)

    def with_new_setups(self, pose_ids: Sequence[str]) -> Dataset:
        """The dataset with another place of the instrument from each of some poses on, until the setup ends.

        What was measured between the pose before and such a pose stays with the setup before.
        Raises DatasetError on an id that no pose has, and where no pose of its setup was measured earlier.
        """
        dataset = self
        for pose_id in dict.fromkeys(pose_ids):
            poses = dataset.poses
            try:
                at = poses.index(pose_id)
            except DatasetError as error:
                raise DatasetError(f"dataset {self.name}: {error}; so no setup can begin with it") from None
            of_setup = poses.setup == poses.setup[at]
            later = of_setup & (poses.order >= poses.order[at])
            if later.sum() == of_setup.sum():
                raise DatasetError(
                    f"dataset {self.name}: pose {pose_id!r} is the first of its setup; name the first pose after the "
                    "instrument was moved"
                )
            before = str(poses.setup[at])
            name = f"{before}, from {pose_id}" if before else f"from {pose_id}"
            setup = np.where(later, np.array(name), poses.setup)
            dataset = replace(
                dataset,
                poses=replace(poses, setup=setup),
                new_setups=(*dataset.new_setups, pose_id),
                notes=(*dataset.notes, f"a new setup begins with pose {pose_id}, as asked"),
            )
        return dataset

    def to_frame(self) -> pd.DataFrame:
        """Table of the poses with the columns of poses.csv, angles in degrees."""
        table: pd.DataFrame = load("calib.dataset.files.poses_csv:poses_frame")(self.poses, self.robot)
        return table

    def _brief(self) -> str:
        roles = ", ".join(f"{n} {role}" for role in ROLES if (n := int(np.sum(self.poses.role == role))))
        measured = "scans, no points yet" if self.points is None else f"{len(self.points)} points"
        arm = f"{self.robot.name}, {self.robot.n_joints} joints"
        return f"{self.name}: {arm}; {len(self.poses)} poses ({roles}); {measured}"


def points_from_corners(
    dataset: Dataset, xyz_mm: Mapping[str, ArrayLike], covariance_mm2: Mapping[str, ArrayLike]
) -> Points:
    """Measured points made of the corners found in scans, by pose id; poses without a corner have no point."""
    found = [i for i, pose_id in enumerate(dataset.poses.ids) if pose_id in xyz_mm]
    ids: Sequence[str] = [dataset.poses.ids[i] for i in found]
    return Points(
        pose=np.array(found, dtype=np.int64),
        xyz_mm=np.array([np.asarray(xyz_mm[i], float) for i in ids]).reshape(-1, 3),
        target=np.full(len(ids), "jig"),
        covariance_mm2=np.array([np.asarray(covariance_mm2[i], float) for i in ids]).reshape(-1, 3, 3),
    )
