"""Corners of a board in images, and a first guess of lens and poses, by OpenCV: the extra `camera`.

OpenCV finds markers and corners to a few hundredths of a pixel, which is its business; what follows from the corners is
computed in `calib.extras.camera.view`.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from types import ModuleType

import numpy as np

from calib import frames
from calib.array_types import Array, IndexArray
from calib.errors import CalibError
from calib.extras.camera.board import Board
from calib.extras.camera.lens import FREE_NAMES, Lens, opencv
from calib.extras.camera.marker_corners import refined_corners
from calib.extras.camera.observed import IMAGE_SUFFIXES
from calib.extras.camera.view import View, ViewPose, found_lens, noise_px, pose_of_view
from calib.progress import OnProgress
from calib.rendering import numbers
from calib.statistics import mad_sigma, rms_length

_OF_MARKER = 4  # corners of a single marker
_FEWEST = 6  # corners of a view of a board
_FEWEST_VIEWS = 8  # for a lens that is found
_REFINED_OVER = 0.28  # of a square's side, half the window about a corner of a checkerboard
_SETTLED = (3, 60, 1e-4)  # of cornerSubPix: at most 60 rounds, until a corner moves by less, pixels
_FEW_SHOW = 0.3  # share of the images
_TRIED = 6  # images in which dictionaries are compared, and by which it is told that none shows the board
_PART = (3, 3)  # inner corners, from which a whole checkerboard is counted
_COMPARED_PX = 1600  # longest side of these
_SOUGHT_PX = 1200  # longest side of an image in which a checkerboard is sought
_ORDERED_BY = 3  # markers of an image that tells their order on the board
_OTHER_ORDER = 5.0  # ratio of misfits from which it is clear that it is not OpenCV's
_DICTIONARIES = {
    "charuco": ("4X4_1000", "5X5_1000", "6X6_1000", "7X7_1000", "ARUCO_ORIGINAL", "APRILTAG_36h11", "ARUCO_MIP_36h12"),
    "aruco": ("4X4_1000", "5X5_1000", "6X6_1000", "7X7_1000", "ARUCO_ORIGINAL", "ARUCO_MIP_36h12"),
    "apriltag": ("APRILTAG_36h11", "APRILTAG_25h9", "APRILTAG_16h5", "APRILTAG_36h10"),
}
_LENS_ROUNDS = 2  # in which edges are freed of the distortion of a lens that is found from their corners
_ROUNDS = 4  # in which bad corners are left out
_FAR_OFF = 5.5  # sigmas; 1 corner in 4 million is as far by chance
_SAME_RAD = 1e-3  # turns by less are one
_TWO_WAYS = 16.0  # difference of squared sigmas, below which two attitudes of a board explain a view alike


Finder = Callable[[Array], tuple[IndexArray, Array]]
"""Function that finds corners in an image: their numbers on the board (N,) and pixels (N, 2)."""
Markers = list[tuple[int, Array]]
"""Numbers of markers in an image, and the corners (4, 2) of each, clockwise."""


@dataclass(frozen=True)
class Detected:
    """Views of a board in images, in the order of the images, and what was left out."""

    board: Board
    size_px: tuple[int, int]  # width, height
    views: tuple[View, ...]
    left_out: Mapping[str, str]  # the reason by the name of the image's file
    notes: tuple[str, ...]


def image_files(folder: Path) -> dict[str, Path]:
    """Images of a folder by stem, in natural order (2 before 10). Raises CalibError where there is none."""
    if not folder.is_dir():
        raise CalibError(f"--images {folder}: no such folder of images")
    found = [path for path in folder.iterdir() if path.is_file() and path.suffix.lower() in IMAGE_SUFFIXES]
    if not found:
        raise CalibError(f"--images {folder}: holds no image ({', '.join(IMAGE_SUFFIXES)})")
    twice = [stem for stem, count in Counter(path.stem for path in found).items() if count > 1]
    if twice:
        raise CalibError(f"--images {folder}: two images are named {twice[0]!r}; an image a pose is needed")
    return {path.stem: path for path in sorted(found, key=lambda path: numbers.natural_order(path.stem))}


def detect(
    images: Mapping[str, Path], board: Board, dictionary: str | None = None, on_progress: OnProgress | None = None
) -> Detected:
    """Corners of a board in images, each named by its pose; images that cannot be read or of another size are left out.

    `on_progress` is called with (done, total, file name) after each image. Raises CalibError where none shows it.
    """
    cv2 = opencv()
    folder = next(iter(images.values())).parent
    pictures, left_out = _pictures(cv2, images, folder)
    tried = list(pictures.values())[:: max(1, len(pictures) // _TRIED)][:_TRIED]
    finder, notes = _finder(cv2, board, dictionary, tried)
    fewest = _OF_MARKER if board.is_single else min(_FEWEST, len(board.corners_mm))
    seen = [len(finder(picture)[0]) for picture in tried]
    if sum(count >= fewest for count in seen) < _FEW_SHOW * len(tried):  # or a part of a larger board was taken for it
        _require_other_count(cv2, board, folder, tried)
        if max(seen) < fewest:
            raise CalibError(_nothing_seen(board, finder, folder, tried, max(seen)))
    views = []
    for done, (name, picture) in enumerate(pictures.items(), 1):
        number, pixels = finder(picture)
        if on_progress is not None:
            on_progress(done, len(pictures), images[name].name)
        if len(number) < fewest or _on_one_line(board.corners_mm[number]):
            few_seen = f"shows {len(number)} corners, of which no pose follows"
            left_out[images[name].name] = few_seen if len(number) else "does not show the board"
            continue
        views.append(View(name, number, board.corners_mm[number], pixels))
    height, width = tried[0].shape
    return Detected(board, (width, height), tuple(views), left_out, notes)


def measured_images(
    images: Mapping[str, Path],
    board: Board,
    given: Lens | None,
    dictionary: str | None = None,
    on_progress: OnProgress | None = None,
) -> tuple[Detected, MeasuredViews]:
    """Corners of a board in images, as `detect` finds them, and its poses with the lens given or found from them.

    A marker's corners are where its edges meet, which are straight but for the lens's distortion. Raises CalibError.
    """
    detected = detect(images, board, dictionary, on_progress)
    if not board.is_of_markers:
        return detected, measure(detected, given)
    lens = given
    for _ in range(_LENS_ROUNDS if given is None else 1):
        lens = given or measure(detected, None).lens
        views = tuple(_with_refined_corners(images[view.pose], view, lens) for view in detected.views)
        detected = replace(detected, views=views)
    return detected, measure(detected, given)


def _with_refined_corners(path: Path, view: View, lens: Lens) -> View:
    """A view of markers with their corners where their edges meet, freed of the lens's distortion."""
    cv2 = opencv()
    picture = _picture_of(cv2, path)
    assert picture is not None
    number = view.corner // _OF_MARKER
    pixels = view.pixels.copy()
    for marker in np.unique(number):
        here = np.flatnonzero(number == marker)
        pixels[here] = refined_corners(cv2, picture, pixels[here], lens)
    return replace(view, pixels=pixels)


def _pictures(cv2: ModuleType, images: Mapping[str, Path], folder: Path) -> tuple[dict[str, Array], dict[str, str]]:
    """Grey images of the size that most have, and why others are left out, by their files' names. Raises CalibError."""
    read = {name: _picture_of(cv2, path) for name, path in images.items()}
    sizes = Counter(picture.shape for picture in read.values() if picture is not None)
    if not sizes:
        raise CalibError(f"--images {folder}: none of them can be read as an image; save them anew")
    (height, width), _ = sizes.most_common(1)[0]
    pictures, left_out = {}, {}
    for name, picture in read.items():
        if picture is None:
            left_out[images[name].name] = "cannot be read as an image"
        elif picture.shape != (height, width):
            found = f"has {picture.shape[1]} x {picture.shape[0]} pixels"
            left_out[images[name].name] = f"{found}, most have {width} x {height}; one camera, one resolution"
        else:
            pictures[name] = picture
    return pictures, left_out


def _picture_of(cv2: ModuleType, path: Path) -> Array | None:
    """Grey image of a file; None where it is none.

    Pixels are taken as the sensor has them: how a program would turn them to be looked at says nothing of the camera.
    """
    if not path.stat().st_size:
        return None
    picture = cv2.imdecode(np.fromfile(path, dtype=np.uint8), cv2.IMREAD_GRAYSCALE | cv2.IMREAD_IGNORE_ORIENTATION)
    return None if picture is None else np.asarray(picture)


def _nothing_seen(board: Board, finder: Finder, folder: Path, pictures: Sequence[Array], most: int) -> str:
    """What to say where no image shows enough of the board."""
    mirrored = (np.ascontiguousarray(picture[:, ::-1]) for picture in pictures)
    if board.kind != "checkerboard" and any(len(finder(picture)[0]) > max(most, 3) for picture in mirrored):
        return (
            f"--images {folder}: the images are mirrored: the board {board.text} is seen in their mirror images; "
            "switch the camera's flip off, or flip them back"
        )
    found = f"at most {most} corners of it are seen" if most else "none shows it"
    return (
        f"--images {folder}: no image shows the board {board.text} ({found} in {len(pictures)} images); check the "
        "number of squares (not of inner corners), --dictionary, and that it is sharp and fills a fair part of the "
        "image"
    )


def _require_other_count(cv2: ModuleType, board: Board, folder: Path, pictures: Sequence[Array]) -> None:
    """Raise CalibError where images show other counts of squares, as where inner corners or rows first were given."""
    counts: Counter[tuple[int, int]] = Counter()
    if board.kind == "checkerboard":
        for picture in pictures:
            small = _shrunk(cv2, picture, _SOUGHT_PX)
            seen, _, meta = cv2.findChessboardCornersSBWithMeta(small, _PART, cv2.CALIB_CB_LARGER)
            if seen and meta.shape != _PART:
                long, short = sorted((meta.shape[0] + 1, meta.shape[1] + 1), reverse=True)
                counts[(long, short) if board.columns >= board.rows else (short, long)] += 1
    elif board.kind == "charuco":
        columns, rows = board.columns, board.rows
        for counted in ((columns, rows), (columns + 1, rows + 1), (rows, columns), (rows + 1, columns + 1)):
            finder = _finder(cv2, replace(board, columns=counted[0], rows=counted[1]), None, pictures)[0]
            counts[counted] = sum(len(finder(picture)[0]) for picture in pictures)
    (columns, rows), most = next(iter(counts.most_common(1)), ((0, 0), 0))
    if most and (columns, rows) != (board.columns, board.rows):
        kind, _, sizes = board.text.split(":", 2)
        raise CalibError(
            f"--images {folder}: the images show {columns} x {rows} squares, not {board.columns} x {board.rows}: give "
            f"the squares of a row and of a column, not their inner corners, by --board {kind}:{columns}x{rows}:{sizes}"
        )


def _on_one_line(board_mm: Array) -> bool:
    """Whether corners (N, 3) lie on one line, or nearly."""
    size = np.linalg.svd(board_mm - board_mm.mean(axis=0), compute_uv=False)
    return bool(size[1] < 1e-3 * max(size[0], 1e-9))


def _finder(
    cv2: ModuleType, board: Board, dictionary: str | None, tried: Sequence[Array]
) -> tuple[Finder, tuple[str, ...]]:
    """Function that finds the board's corners in an image, and notes on what was chosen."""
    if board.kind == "checkerboard":
        if dictionary is not None:
            raise CalibError(f"--dictionary {dictionary}: a checkerboard has no markers; leave it out")
        if board.columns == board.rows:
            raise CalibError(
                f"--board {board.text}: turned by a quarter it looks the same, so that its attitude cannot be told; "
                "take a board with more squares along one side than along the other"
            )
        return _checkerboard(cv2, board), ()
    seen_name = _dictionary(cv2, board, _DICTIONARIES[board.kind], tried)
    name = (dictionary or seen_name).removeprefix("DICT_")
    notes: tuple[str, ...] = ()
    if dictionary is None:
        notes = (f"{board.text}: its markers are of DICT_{name}, by the images",)
    elif not hasattr(cv2.aruco, f"DICT_{name}"):
        known = sorted(word for word in dir(cv2.aruco) if word.startswith("DICT_"))
        raise CalibError(f"--dictionary {dictionary}: no such dictionary; there are {', '.join(known)}")
    elif (shown := [one for one in (name, seen_name) if any(map(_markers(cv2, one), tried))]) == [seen_name]:
        raise CalibError(
            f"--dictionary {dictionary}: the images show markers of DICT_{shown[0]} and none of it; give that"
        )
    if board.kind == "charuco":
        finders = [_charuco_finder(cv2, board, name, legacy) for legacy in (False, True)[: 2 - board.rows % 2]]
        seen = [sum(len(finder(picture)[0]) for picture in tried) for finder in finders]
        legacy = int(np.argmax(seen))
        return finders[legacy], (*notes, *[f"{board.text}: in the pattern that OpenCV had before 4.6"] * legacy)
    if board.is_single:
        sides: Counter[int] = Counter()
        for picture in tried:
            sides.update({number: round(_side_px(four)) for number, four in _markers(cv2, name)(picture)})
        ((meant, _),) = sides.most_common(1) or [(0, 0)]
        if len(sides) > 1:
            notes += (f"{board.text}: it is marker {meant}, the largest in most images; others are seen too",)
        return _marker_finder(cv2, board, name, meant), notes
    finder = _marker_finder(cv2, board, name)
    order, note = _order_on_board(cv2, board, [finder(picture) for picture in tried])
    return (lambda picture: _renumbered(finder(picture), order)), (*notes, *note)


def _dictionary(cv2: ModuleType, board: Board, names: Sequence[str], tried: Sequence[Array]) -> str:
    """Name of the dictionary whose markers fill most of some images."""
    for pictures in ([_shrunk(cv2, picture, _COMPARED_PX) for picture in tried], tried):
        filled = {}
        for name in names:
            seen = [_markers(cv2, name)(picture) for picture in pictures]
            each = [[_side_px(four) for _, four in markers] for markers in seen]
            filled[name] = sum(max(sides, default=0.0) if board.is_single else len(sides) for sides in each)
        if any(filled.values()):
            break
    return max(filled, key=lambda name: filled[name])


def _shrunk(cv2: ModuleType, picture: Array, longest_px: int) -> Array:
    """An image of at most so many pixels along its longest side: photos of many megapixels take long to search."""
    share = longest_px / max(picture.shape)
    return picture if share >= 1.0 else cv2.resize(picture, None, fx=share, fy=share, interpolation=cv2.INTER_AREA)


def _charuco_finder(cv2: ModuleType, board: Board, name: str, legacy: bool) -> Finder:
    """Finder of a ChArUco board with markers of a dictionary."""
    markers = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, f"DICT_{name}"))
    if board.columns * board.rows // 2 > len(markers.bytesList):
        raise CalibError(f"--dictionary {name}: has {len(markers.bytesList)} markers, too few for {board.text}")
    printed = cv2.aruco.CharucoBoard((board.columns, board.rows), board.square_mm, board.inner_mm, markers)
    printed.setLegacyPattern(legacy)
    charuco = cv2.aruco.CharucoDetector(printed)

    def finder(picture: Array) -> tuple[IndexArray, Array]:
        pixels, number, _, _ = charuco.detectBoard(picture)
        if number is None or not len(number):
            return _none()
        return number.ravel().astype(np.int64), np.asarray(pixels, dtype=float).reshape(-1, 2)

    return finder


def _markers(cv2: ModuleType, name: str) -> Callable[[Array], Markers]:
    """Function that finds the markers of a dictionary in an image."""
    parameters = cv2.aruco.DetectorParameters()
    parameters.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
    dictionary = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, f"DICT_{name}"))
    detector = cv2.aruco.ArucoDetector(dictionary, parameters)

    def markers(picture: Array) -> Markers:
        corners, ids, _ = detector.detectMarkers(picture)
        found = [] if ids is None else ids.ravel().tolist()
        return [(one, np.asarray(four, dtype=float).reshape(4, 2)) for one, four in zip(found, corners, strict=False)]

    return markers


def _marker_finder(cv2: ModuleType, board: Board, name: str, meant: int | None = None) -> Finder:
    """Finder of a grid of markers of a dictionary, or of one with a number, by OpenCV's corners."""
    markers = _markers(cv2, name)

    def finder(picture: Array) -> tuple[IndexArray, Array]:
        seen = markers(picture)
        if board.is_single:
            seen = [(0, four) for one, four in seen if one == meant]
        seen = [(one, four) for one, four in seen if one < board.columns * board.rows]
        number = [4 * one + k for one, _ in seen for k in range(4)]
        if not number or len(number) != len(set(number)):  # several markers alike: which is meant is not known
            return _none()
        return np.array(number), np.concatenate([four for _, four in seen])

    return finder


def _side_px(four: Array) -> float:
    """Mean length of the sides of a marker's corners (4, 2), pixels."""
    return float(np.mean(np.linalg.norm(four - np.roll(four, 1, axis=0), axis=1)))


def _order_on_board(
    cv2: ModuleType, board: Board, seen: Sequence[tuple[IndexArray, Array]]
) -> tuple[IndexArray, tuple[str, ...]]:
    """Number on the board (4 K,) of each corner of K markers, and a note where they are not as OpenCV prints a grid.

    AprilTag's own images are turned by half a turn against OpenCV's, and Kalibr counts rows from the bottom. Corners
    of a wrong order lie on no plane: a homography misses them by a good part of a marker's side.
    """
    usual = np.arange(4 * board.columns * board.rows)
    rows, columns = np.divmod(usual // 4, board.columns)
    misfit = {}
    for upwards in (False, True):
        row = board.rows - 1 - rows if upwards else rows
        for quarters in range(4):
            order = 4 * (row * board.columns + columns) + (usual % 4 + quarters) % 4
            off = [
                _plane_misfit(cv2, board.corners_mm[order[number], :2], pixels)
                for number, pixels in seen
                if len(number) >= 4 * _ORDERED_BY
            ]
            misfit[upwards, quarters] = float(np.median(off or [0.0])), order
    best = min(misfit, key=lambda one: misfit[one][0])
    if misfit[False, 0][0] <= _OTHER_ORDER * misfit[best][0]:
        return usual, ()
    upwards, quarters = best
    words = ["the rows of its markers are counted from the bottom"] * upwards
    words += [f"its markers are turned by {90 * quarters}° against OpenCV's"] * (quarters > 0)
    return misfit[best][1], (f"{board.text}: {' and '.join(words)}, by the images",)


def _plane_misfit(cv2: ModuleType, board_mm: Array, pixels: Array) -> float:
    """Root mean square by which a homography of the board's plane misses corners, pixels."""
    matrix, _ = cv2.findHomography(board_mm, pixels, 0)
    return np.inf if matrix is None else rms_length(cv2.perspectiveTransform(board_mm[None], matrix)[0] - pixels)


def _renumbered(found: tuple[IndexArray, Array], order: IndexArray) -> tuple[IndexArray, Array]:
    """Corners with the numbers that they have on the board, in their order."""
    number = order[found[0]]
    rows = np.argsort(number)
    return number[rows], found[1][rows]


def _checkerboard(cv2: ModuleType, board: Board) -> Finder:
    inner = (board.columns - 1, board.rows - 1)

    def finder(picture: Array) -> tuple[IndexArray, Array]:
        # Its time grows with the pixels, fourfold with its own enlarging, which small squares need.
        for longest_px, how in ((_SOUGHT_PX, 0), (_COMPARED_PX, cv2.CALIB_CB_ACCURACY)):
            small = _shrunk(cv2, picture, longest_px)
            seen, pixels = cv2.findChessboardCornersSB(small, inner, flags=how)
            if seen:
                break
        else:
            return _none()
        grid = np.asarray(pixels, dtype=float).reshape(board.rows - 1, board.columns - 1, 2)
        grid = (grid + 0.5) * (picture.shape[1] / small.shape[1]) - 0.5
        # OpenCV's sector-based corners of one image are off by a common 0.015 pixels, at a tilt; refined, by 0.004.
        steps = [np.median(np.linalg.norm(np.diff(grid, axis=axis), axis=2)) for axis in (0, 1)]
        reach = max(2, round(_REFINED_OVER * float(min(steps))))
        start = grid.reshape(-1, 1, 2).astype(np.float32)
        refined = cv2.cornerSubPix(picture, start, (reach, reach), (-1, -1), _SETTLED).reshape(-1, 2).astype(float)
        pixels = refined if _first_is_dark(picture, grid) else refined[::-1]
        return np.arange(len(pixels)), pixels

    return finder


def _first_is_dark(picture: Array, grid_px: Array) -> bool:
    """Whether the square between the first four corners is darker than its right neighbour."""

    def level(row: int, column: int) -> float:
        x, y = grid_px[row : row + 2, column : column + 2].reshape(4, 2).mean(axis=0)
        return float(picture[round(y), round(x)])

    return level(0, 0) < level(0, 1)


def _none() -> tuple[IndexArray, Array]:
    return np.zeros(0, dtype=np.int64), np.zeros((0, 2))


@dataclass(frozen=True)
class MeasuredViews:
    """Lens, and the board's pose in each view that tells one."""

    lens: Lens
    poses: tuple[ViewPose, ...]
    sigma_px: float
    left_out: Mapping[str, str]  # the reason by the name of the pose


def measure(detected: Detected, given: Lens | None) -> MeasuredViews:
    """Board poses of the views, with the lens given, or else found from the views. Raises CalibError."""
    if given is not None and given.size_px != detected.size_px:
        raise CalibError(
            f"--intrinsics: they are of images of {given.width_px} x {given.height_px} pixels, and the images have "
            f"{detected.size_px[0]} x {detected.size_px[1]}; calibrate the camera at this resolution, or leave them out"
        )
    if given is None and (len(detected.views) < _FEWEST_VIEWS or detected.board.is_single):
        why = "of a single marker" if detected.board.is_single else f"{len(detected.views)} images show the board"
        raise CalibError(
            f"the lens cannot be found from the images ({why}; {_FEWEST_VIEWS} images of a board are needed); give it "
            "by --intrinsics FILE, such as ROS's camera_info.yaml"
        )
    views, left_out = detected.views, {}
    for _ in range(_ROUNDS):
        lens = given or found_lens(views, detected.size_px)
        both = [_best_poses(lens, view) for view in views]
        most_px = _FAR_OFF * max(mad_sigma(np.concatenate([one[0].error_px.ravel() for one in both])), 1e-6)
        kept = []
        for view, (best, *_) in zip(views, both, strict=True):
            near = np.linalg.norm(best.error_px, axis=1) <= most_px
            if len(near) <= _OF_MARKER or near.all():  # of a single marker's corners none can be spared
                kept.append(view)
            elif 2 * near.sum() < len(near):
                left_out[view.pose] = (
                    "its corners do not lie as on the board: is it blurred, or something in front of it?"
                )
            else:
                kept.append(view.select(near))
        if not kept or list(map(id, kept)) == list(map(id, views)):
            break
        views = tuple(kept)
    sigma_px = noise_px([one[0] for one in both], len(FREE_NAMES) if given is None else 0)
    poses = []
    for best, *rivals in both:
        if any(rival.squares - best.squares < _TWO_WAYS * sigma_px**2 for rival in rivals):
            left_out[best.view.pose] = "the board may be tilted either way: it is seen too small or too straight on"
        elif best.view.pose not in left_out:
            poses.append(best)
    if not poses:
        raise CalibError("no image tells the board's attitude: it is seen too small or too straight on; go nearer")
    return MeasuredViews(lens, tuple(poses), sigma_px, left_out)


def _best_poses(lens: Lens, view: View) -> list[ViewPose]:
    """Best pose of the board in a view, and the other of the two that a flat board has where that is another."""
    _, turns, shifts, _ = opencv().solvePnPGeneric(
        view.board_mm, view.pixels, lens.matrix, lens.distortion, flags=opencv().SOLVEPNP_IPPE
    )
    starts = (frames.make_transform(frames.rotation_from_rotvec(turn.ravel()), shift.ravel())
              for turn, shift in zip(turns, shifts, strict=True) if shift[2] > 0.0)  # fmt: skip
    found = sorted((pose_of_view(lens, view, start) for start in starts), key=lambda one: one.squares)
    if not found:
        raise CalibError(f"image {view.pose}: its corners fit no pose of the board before the camera; check --board")
    turned = found[0].camera_T_board[:3, :3].T @ found[-1].camera_T_board[:3, :3]
    return found if np.linalg.norm(frames.rotvec_from_rotation(turned)) > _SAME_RAD else found[:1]
