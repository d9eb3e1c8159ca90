"""A ball in an image: its middle, from the cone of rays that touch it.

A sphere of radius R about c is seen within the cone of half-angle asin(R / |c|) about c. In the image that is an
ellipse, bent by the lens, whose middle is not where c is seen. So its outline is not fitted by an ellipse: for a c, the
cone's rays are projected through the lens, the image's edge is sought across each, and c moves by least squares of
these distances, in pixels.

Along the sight c follows from the outline's size alone. Besides the noise of its places, an edge that lies a little
inside or outside all around (light, blur, the camera's tone curve) moves c there by |c| / r per pixel, r the
outline's radius; the covariance counts both.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType

import numpy as np

from calib.array_types import Array, BoolArray
from calib.brief import Brief
from calib.errors import CalibError
from calib.extras.camera.detection import opencv, picture_of, wrong_resolution
from calib.extras.camera.lens import Lens, project
from calib.statistics import mad_sigma

_SEARCHED_PX = 800  # longest side of the image in which balls are sought first
_LEVELS = 16  # of brightness, at which outlines are drawn
_LEVEL_STEP = 5  # grey levels between them, at least
_LEAST_SEARCHED_PX = 5.0  # radius in the searched image
_ROUNDNESS = 0.75  # least share of the circle about an outline that the outline encloses
_MOST_TRIED = 12  # candidates, the largest
_PLACES = (48, 360)  # fewest and most along an outline
_APART_PX = 2.0  # between them
_REACHES = (0.12, 0.06, 0.04, 0.04, 0.04)  # across the outline, of its radius, in turn
_LEAST_REACH_PX = 4.0
_STEP_PX = 0.5
_LEAST_RISE = 6.0  # grey levels of an edge over two pixels
_FAR = 3.0  # sigmas
_LEAST_RADIUS_PX = 8.0
_LEAST_SEEN = 0.6  # share of the outline that shows an edge where it should be
_MOST_ROUGH_PX = 0.4  # sigma of the places of the edge, for an outline of 100 pixels' radius and less
_MOST_ROUGH = 0.004  # the same of the radius, for larger ones
_COMMON = 0.35  # sigma of an edge's error that the whole outline shares, of the edge's width
_SIDEWAYS_PX = 0.1  # sigma of an error of the outline's middle
_ALIKE_WITHIN = 0.1  # of the radius, where two channels show one outline
_ALIKE = 0.7  # of the largest ball's radius, from which another one is as likely the one that is meant


@dataclass(frozen=True)
class SeenBall(Brief):
    """A ball's middle in the camera's frame."""

    xyz_mm: Array  # (3,)
    covariance: Array  # (3, 3) mm^2
    middle_px: Array  # (2,) where the middle is seen
    radius_px: float  # of its outline
    rough_px: float  # standard deviation of the edge's places about the outline
    seen: float  # share of the outline where an edge is

    def _brief(self) -> str:
        return f"{self.radius_px:.0f} px radius, {self.seen:.0%} seen, {self.rough_px:.2f} px"


def balls_in(images: Mapping[str, Path], lens: Lens, radius_mm: float) -> tuple[dict[str, SeenBall], dict[str, str]]:
    """The ball in each image by its pose, and why images are left out by their files' names.

    Raises CalibError where no image is of the lens's resolution, or none shows a ball.
    """
    cv2 = opencv()
    found: dict[str, SeenBall] = {}
    left_out: dict[str, str] = {}
    sizes = []
    for pose, path in images.items():
        picture = picture_of(cv2, path, cv2.IMREAD_COLOR)
        if picture is None:
            left_out[path.name] = "cannot be read as an image"
            continue
        sizes.append((picture.shape[1], picture.shape[0]))
        if sizes[-1] != lens.size_px:
            left_out[path.name] = (
                f"has {sizes[-1][0]} x {sizes[-1][1]} pixels, the lens {lens.width_px} x {lens.height_px}"
            )
            continue
        colours = cv2.cvtColor(picture, cv2.COLOR_BGR2LAB)
        ball = find_ball(cv2, [np.ascontiguousarray(colours[..., k]) for k in range(3)], lens, radius_mm)
        if isinstance(ball, str):
            left_out[path.name] = ball
        else:
            found[pose] = ball
    if sizes and lens.size_px not in sizes:
        raise wrong_resolution(lens, sizes[0])
    if not found:
        name, why = next(iter(left_out.items()))
        raise CalibError(
            f"--images {images[next(iter(images))].parent}: no image shows a ball before a background of another "
            f"brightness or colour ({name}: {why}); --board tells what the images show"
        )
    return found, left_out


def find_ball(cv2: ModuleType, channels: Sequence[Array], lens: Lens, radius_mm: float) -> SeenBall | str:
    """The ball of a radius in an image, or why none is found.

    channels: grey images (H, W) of it, uint8, in the order of their sharpness: brightness, then colours.
    """
    refused = "shows no ball: nothing round stands out"
    found: list[SeenBall] = []
    for channel in channels:
        for start in _candidates(cv2, channel, lens, radius_mm):
            ball = _refined(cv2, channel, lens, radius_mm, start)
            if isinstance(ball, str):
                refused = ball
                continue
            apart = (np.hypot(*(ball.middle_px - other.middle_px)) > other.radius_px for other in found)
            same = next((k for k, is_apart in enumerate(apart) if not is_apart), None)
            if same is None:
                found.append(ball)
            elif (
                ball.rough_px < found[same].rough_px
                and abs(ball.radius_px / found[same].radius_px - 1.0) < _ALIKE_WITHIN
            ):
                found[same] = ball
    found.sort(key=lambda ball: -ball.radius_px)
    if len(found) > 1 and found[1].radius_px > _ALIKE * found[0].radius_px:
        return "shows several balls; which is meant is not known"
    return found[0] if found else refused


def _candidates(cv2: ModuleType, channel: Array, lens: Lens, radius_mm: float) -> list[Array]:
    """First guesses (3,) of the ball's middle, the largest first: round outlines at any brightness, and circles."""
    shrunk = min(1.0, _SEARCHED_PX / max(channel.shape))
    small = cv2.resize(channel, None, fx=shrunk, fy=shrunk, interpolation=cv2.INTER_AREA) if shrunk < 1.0 else channel
    small = cv2.GaussianBlur(small, (0, 0), 1.2)
    circles: list[tuple[float, float, float]] = []
    darkest, lightest = int(small.min()), int(small.max())
    for level in range(darkest + _LEVEL_STEP, lightest, max(_LEVEL_STEP, (lightest - darkest) // _LEVELS)):
        outlines, _ = cv2.findContours((small > level).astype(np.uint8), cv2.RETR_LIST, cv2.CHAIN_APPROX_NONE)
        for outline in outlines:
            if len(outline) < 2.0 * np.pi * _LEAST_SEARCHED_PX * _ROUNDNESS:
                continue
            (u, v), radius = cv2.minEnclosingCircle(outline)
            if radius >= _LEAST_SEARCHED_PX and cv2.contourArea(outline) > _ROUNDNESS * np.pi * radius**2:
                circles.append((u, v, float(np.sqrt(cv2.contourArea(outline) / np.pi))))
    hough = cv2.HoughCircles(
        small, cv2.HOUGH_GRADIENT_ALT, 1.5, 10, param1=60, param2=0.7, minRadius=int(_LEAST_SEARCHED_PX)
    )
    circles += [] if hough is None else [(float(u), float(v), float(r)) for u, v, r in hough.reshape(-1, 3)]
    circles.sort(key=lambda circle: -circle[2])
    kept: list[tuple[float, float, float]] = []
    for u, v, r in circles:
        if all(np.hypot(u - a, v - b) + abs(r - c) > 0.06 * c for a, b, c in kept):
            kept.append((u, v, r))
    starts = []
    for u, v, r in kept[:_MOST_TRIED]:
        middle = (np.array([[u + 0.5, v + 0.5]]) / shrunk - 0.5).reshape(1, 1, 2)
        x, y = cv2.undistortPoints(middle, lens.matrix, lens.distortion).ravel()
        sight = np.array([x, y, 1.0]) / np.sqrt(x * x + y * y + 1.0)
        scale_px = lens.numbers[0] * np.sqrt(x * x + y * y + 1.0)  # of an angle across the sight, roughly
        starts.append(sight * radius_mm / np.sin(np.arctan(r / shrunk / scale_px)))
    return starts


def outline_px(lens: Lens, xyz_mm: Array, radius_mm: float, around: Array) -> Array:
    """Pixels (N, 2) of the outline of a ball about a middle (3,), by angles (N,) around the sight to it."""
    distance = float(np.linalg.norm(xyz_mm))
    sight, lean = xyz_mm / distance, radius_mm / distance
    across = np.cross(sight, np.eye(3)[np.argmin(np.abs(sight))])
    across /= np.linalg.norm(across)
    other = np.cross(sight, across)
    turn = np.cos(around)[:, None] * across + np.sin(around)[:, None] * other
    return project(np.array(lens.numbers), np.sqrt(1.0 - lean**2) * sight + lean * turn)


def _refined(cv2: ModuleType, channel: Array, lens: Lens, radius_mm: float, start: Array) -> SeenBall | str:
    """The ball near a first guess (3,) of its middle, or why there is none."""
    xyz_mm = start
    for reach in _REACHES:
        if not xyz_mm[2] > 1.2 * radius_mm:
            return "shows something round that is no ball before the camera"
        limb = _Limb.of(lens, xyz_mm, radius_mm)
        if limb.radius_px < _LEAST_RADIUS_PX:
            return f"shows the ball with a radius of {limb.radius_px:.0f} pixels, too small to measure; go nearer"
        off_px, width_px, seen = _edges(cv2, channel, limb, max(_LEAST_REACH_PX, reach * limb.radius_px))
        if seen.sum() < max(_LEAST_SEEN * len(seen), 12):
            return f"shows something round of which {seen.mean():.0%} has an edge, {_LEAST_SEEN:.0%} is needed"
        by_middle = limb.by_middle(lens, radius_mm)
        kept = seen.copy()
        step: Array = np.zeros(3)
        for _ in range(8):
            step = np.asarray(np.linalg.lstsq(by_middle[kept], off_px[kept], rcond=None)[0], dtype=np.float64)
            left = off_px - by_middle @ step
            rough = max(mad_sigma(left[kept]), 0.02)
            kept = seen & (np.abs(left) < _FAR * rough)
            if kept.sum() < 12:
                return "shows something round that is no ball"
        xyz_mm = xyz_mm + step
    share = float(kept.mean())
    rough = float(np.sqrt(np.sum(left[kept] ** 2) / (kept.sum() - 3)))
    if share < _LEAST_SEEN:
        return f"shows something round of which {share:.0%} lies on a ball's outline, {_LEAST_SEEN:.0%} is needed"
    if rough > max(_MOST_ROUGH_PX, _MOST_ROUGH * limb.radius_px):
        return f"shows something round that is no ball: its edge is {rough:.1f} pixels rough"
    inverse = np.linalg.inv(by_middle[kept].T @ by_middle[kept])
    # What all places have in common, and what shifts the outline sideways, does not average over them.
    common_px = _COMMON * float(np.median(width_px[kept]))
    common = np.column_stack([np.full(len(off_px), common_px), _SIDEWAYS_PX * limb.outwards])[kept]
    moved = inverse @ by_middle[kept].T @ common
    middle = project(np.array(lens.numbers), xyz_mm)
    return SeenBall(xyz_mm, rough**2 * inverse + moved @ moved.T, middle, limb.radius_px, rough, share)


@dataclass(frozen=True)
class _Limb:
    """Places along the outline of a ball about a guessed middle."""

    xyz_mm: Array  # (3,)
    around: Array  # (N,) rad
    pixels: Array  # (N, 2)
    outwards: Array  # (N, 2) across the outline

    @classmethod
    def of(cls, lens: Lens, xyz_mm: Array, radius_mm: float) -> _Limb:
        rough = outline_px(lens, xyz_mm, radius_mm, np.linspace(0.0, 2.0 * np.pi, _PLACES[0], endpoint=False))
        length = float(np.sum(np.linalg.norm(rough - np.roll(rough, 1, axis=0), axis=1)))
        around = np.linspace(0.0, 2.0 * np.pi, int(np.clip(length / _APART_PX, *_PLACES)), endpoint=False)
        pixels = outline_px(lens, xyz_mm, radius_mm, around)
        along = outline_px(lens, xyz_mm, radius_mm, around + 1e-4) - pixels
        outwards = np.column_stack([along[:, 1], -along[:, 0]]) / np.linalg.norm(along, axis=1)[:, None]
        outwards *= np.sign(np.sum(outwards * (pixels - pixels.mean(axis=0))))
        return cls(xyz_mm, around, pixels, outwards)

    @property
    def radius_px(self) -> float:
        """Mean distance of the outline from its middle, pixels."""
        return float(np.mean(np.linalg.norm(self.pixels - self.pixels.mean(axis=0), axis=1)))

    def by_middle(self, lens: Lens, radius_mm: float) -> Array:
        """Derivative (N, 3) of the outline, outwards, by the ball's middle, pixels per mm, by differences."""
        step = 1e-5 * float(np.linalg.norm(self.xyz_mm))
        columns = [
            np.sum(
                (
                    outline_px(lens, self.xyz_mm + step * axis, radius_mm, self.around)
                    - outline_px(lens, self.xyz_mm - step * axis, radius_mm, self.around)
                )
                * self.outwards,
                axis=1,
            )
            / (2.0 * step)
            for axis in np.eye(3)
        ]
        return np.column_stack(columns)


def _edges(cv2: ModuleType, channel: Array, limb: _Limb, reach_px: float) -> tuple[Array, Array, BoolArray]:
    """Distances (N,) of the image's edge outwards from an outline, the edge's widths (N,), and where there is one.

    Whether the ball is the brighter or the darker side is not asked: it may be both along one outline.
    """
    across = np.arange(-reach_px, reach_px + 0.5 * _STEP_PX, _STEP_PX)
    places = limb.pixels[:, None] + across[None, :, None] * limb.outwards[:, None]
    u, v = np.moveaxis(places, -1, 0).astype(np.float32)
    level = cv2.remap(channel, u, v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE).astype(float)
    wide = round(2.0 / _STEP_PX)
    rise = np.abs(level[:, wide:] - level[:, :-wide])  # over two pixels
    middle = 0.5 * (across[wide:] + across[:-wide])
    peak = np.argmax(rise, axis=1)
    height = np.take_along_axis(rise, peak[:, None], axis=1)
    near = np.abs(middle[None] - middle[peak][:, None]) <= 2.5
    weight = np.where(near, np.maximum(rise - 0.3 * height, 0.0), 0.0)
    weight /= np.maximum(weight.sum(axis=1), 1e-9)[:, None]
    off_px = weight @ middle
    width_px = np.sqrt(np.maximum(weight @ middle**2 - off_px**2, 0.0))
    inside = (limb.pixels >= 1.0).all(axis=1) & (limb.pixels < np.array(channel.shape[::-1]) - 2.0).all(axis=1)
    return off_px, width_px, inside & (height[:, 0] >= _LEAST_RISE) & (np.abs(off_px) < reach_px - 1.0)
