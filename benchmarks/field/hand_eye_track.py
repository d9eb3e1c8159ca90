"""Hand-eye calibration on KinHEC's simulated sequences beside its own solvers and OpenCV's, by its own measure.

What counts is where the camera is on the flange, or the board where the camera stands in the room (KinHEC's X). Ours
goes the way of a user: `inspector import` of the two tables of poses, then `inspector calibrate`, with nothing told
but the mount.
"""

from __future__ import annotations

import contextlib
import io
import json
import subprocess
import tempfile
from collections import defaultdict
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path

import cv2
import numpy as np
from problem import Array

from calib import frames
from calib.text_files.csv_text import rows_csv
from inspector.cli.parser import main as inspector

WORKER = Path(__file__).with_name("kinhec_worker.py")
OPENCV = ("TSAI", "PARK", "HORAUD", "ANDREFF", "DANIILIDIS")
Sequence = tuple[
    Array, Array, Array, bool
]  # flange poses, board poses in the camera's frame, X, is the camera on the flange


def sequences(python: Path, cache: Path, tier: str) -> Iterator[tuple[str, Sequence, dict[str, Array]]]:
    """Name, sequence (mm) and KinHEC's solutions of each sequence of a tier."""
    out = cache / f"kinhec_{tier}.npz"
    if not out.exists():
        words = [str(python), str(WORKER), tier, str(cache / f"kinhec_{tier}"), str(out)]
        subprocess.run(words, check=True, cwd=cache, capture_output=True)
    with np.load(out) as file:
        found = dict(file)
    for name in sorted({key.split("/")[0] for key in found}):
        own = {key.split("/")[1]: value for key, value in found.items() if key.startswith(f"{name}/")}
        on_flange = bool(own["on_flange"])
        seen = frames.invert(own["seen"]) if on_flange else own["seen"]
        by = {key.removeprefix("by "): _in_mm(value) for key, value in own.items() if key.startswith("by ")}
        yield name, (_in_mm(own["flange"]), _in_mm(seen), _in_mm(own["X"]), on_flange), by


def _in_mm(transform: Array) -> Array:
    out = np.array(transform)
    out[..., :3, 3] *= 1000.0
    return out


def by_opencv(sequence: Sequence, method: str) -> Array:
    """X by one of OpenCV's methods."""
    flange, seen, _, on_flange = sequence
    target = seen if on_flange else frames.invert(seen)  # where the board is on the flange, it takes the camera's part
    parts = [list(each) for each in (flange[:, :3, :3], flange[:, :3, 3], target[:, :3, :3], target[:, :3, 3])]
    turn, shift = cv2.calibrateHandEye(*parts, method=getattr(cv2, f"CALIB_HAND_EYE_{method}"))
    return frames.make_transform(turn, shift.ravel())


def by_ours(sequence: Sequence) -> Array:
    """X by the commands a user types. Raises RuntimeError with the refusal."""
    flange, seen, _, on_flange = sequence
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        for name, poses in (("flange.csv", flange), ("marker.csv", seen)):
            turns = frames.quaternion_from_rotation(poses[:, :3, :3])
            rows = [["pose", "x_mm", "y_mm", "z_mm", "qw", "qx", "qy", "qz"]]
            rows += [
                [f"p{k + 1}", *map(repr, [*at[:3, 3].tolist(), *turn.tolist()])]
                for k, (at, turn) in enumerate(zip(poses, turns, strict=True))
            ]
            (folder / name).write_text(rows_csv(rows))
        mount = "flange" if on_flange else "room"
        tables = ["--flange-poses", folder / "flange.csv", "--marker-poses", folder / "marker.csv"]
        _said("import", folder / "cell", *tables, "--mount", mount)
        document = json.loads(_said("calibrate", folder / "cell", "--json"))["hand_eye"][0]
    return np.array(document["parent_T_camera" if on_flange else "board_parent_T_board"])


def _said(*words: object) -> str:
    """What a command prints. Raises RuntimeError with its last line where it refuses."""
    out, faults = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(faults):
        code = inspector([str(word) for word in words])
    if code:
        raise RuntimeError(faults.getvalue().strip().splitlines()[-1])
    return out.getvalue()


def judged(task: tuple[str, Sequence, dict[str, Array]]) -> tuple[str, dict[str, tuple[float, float]]]:
    """Track, and the error in mm and deg of each method on one sequence; nan where it refuses or fails."""
    name, sequence, by = task
    found = {f"KinHEC {solver}": at for solver, at in by.items()}
    for method in OPENCV:
        with contextlib.suppress(cv2.error):
            found[f"OpenCV {method}"] = by_opencv(sequence, method)
    with contextlib.suppress(RuntimeError):
        found["calib"] = by_ours(sequence)
    errors = {tool: _apart(at, sequence[2]) for tool, at in found.items()}
    return name.rsplit("-", 1)[0], {"calib": (np.nan, np.nan)} | errors


def _apart(found: Array, true: Array) -> tuple[float, float]:
    """Distance, mm, and turn, deg, between two transforms."""
    turn = np.arccos(np.clip((np.trace(found[:3, :3].T @ true[:3, :3]) - 1.0) / 2.0, -1.0, 1.0))
    return float(np.linalg.norm(found[:3, 3] - true[:3, 3])), float(np.degrees(turn))


def records(python: Path, cache: Path, jobs: int, tier: str = "smoke") -> list[dict[str, object]]:
    """One record a method and track: median error, share of sequences 10 % worse than the best other, refused."""
    rows: dict[str, list[dict[str, tuple[float, float]]]] = defaultdict(list)
    with ProcessPoolExecutor(jobs, mp_context=get_context("spawn")) as pool:
        for track, errors in pool.map(judged, sequences(python, cache, tier)):
            rows[track].append(errors)
    out: list[dict[str, object]] = []
    for track, found in rows.items():
        tools = sorted({tool for errors in found for tool in errors})
        table = {tool: np.array([errors.get(tool, (np.nan, np.nan)) for errors in found]) for tool in tools}
        medians = {tool: float(np.nanmedian(errors[:, 0])) for tool, errors in table.items()}
        best = min((tool for tool in tools if tool != "calib"), key=lambda tool: medians[tool])
        for tool, errors in table.items():
            out.append(
                {
                    "tool": tool,
                    "set": f"kinhec {tier}, {track}",
                    "sequences": len(found),
                    "median_mm": medians[tool],
                    "median_deg": float(np.nanmedian(errors[:, 1])),
                    "worse_than_best": float(np.mean(errors[:, 0] > 1.1 * table[best][:, 0])),
                    "refused": int(np.isnan(errors[:, 0]).sum()),
                }
            )
    return out
