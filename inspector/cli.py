"""The command `inspector`: each subcommand is a few lines over `calib`.

Exit 0: done. Exit 1: done, and the answer is "not good enough". Exit 2: bad input or usage, one line on stderr.
With --json exactly one JSON object goes to stdout; progress goes to stderr.
"""

from __future__ import annotations

import argparse
import multiprocessing
import os
import sys
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor, ProcessPoolExecutor
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NoReturn

from calib.calibration import calibrate, redundancy, structural_rank
from calib.checking import check
from calib.corners import CornerSearch, find_corners
from calib.correction import WHATS, corrected_joints
from calib.dataset import Dataset
from calib.dataset_file import find_datasets, load_dataset
from calib.errors import CalibError, DatasetError
from calib.knowledge import known_sums
from calib.learning import learning_curve
from calib.measurement import failed_searches, require_corners, with_corners
from calib.points_file import points_frame
from calib.residuals import RESIDUAL_KINDS
from calib.robot_file import BUILTIN_ROBOTS, builtin_robot, load_robot, robot_to_toml
from calib.targets_file import corrected_table, load_targets
from calib.toml_file import write_text_atomically
from calib.validation import cross_validate
from inspector import documents

MIN_SCANS_FOR_PROCESSES = 12  # below this, starting further interpreters takes longer than it saves


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command; returns its exit code."""
    options = _parser().parse_args(arguments)
    try:
        return int(options.run(options))
    except CalibError as error:
        print(f"inspector: {error}", file=sys.stderr)
        return 2
    except OSError as error:
        where = f"{error.filename}: " if error.filename else ""
        print(f"inspector: {where}{error.strerror or error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print("inspector: stopped", file=sys.stderr)
        return 130


class _Parser(argparse.ArgumentParser):
    """Wrong usage in one line."""

    def error(self, message: str) -> NoReturn:
        self.exit(2, f"inspector: {message}; see {self.prog} --help\n")


def _parser() -> argparse.ArgumentParser:
    parser = _Parser(
        prog="inspector",
        description="Calibrate a robot arm from scans of a three-faced jig, and see every step.",
    )
    commands = parser.add_subparsers(metavar="COMMAND", required=True)

    def command(name: str, run: Callable[[Any], int], help_: str, path: str = "dataset folder") -> Any:
        sub = commands.add_parser(name, help=help_, description=help_)
        sub.set_defaults(run=run)
        sub.add_argument("path", type=Path, metavar="PATH", help=path)
        return sub

    sub = command("serve", _serve, "the web app", "dataset folder, or a folder of them")
    sub.add_argument("--host", default="127.0.0.1", help="address to bind (default: this machine only)")
    sub.add_argument("--port", type=_port, default=8080, help="default 8080; 0 takes a free one")

    sub = command("corners", _corners, "find the jig's corner in every scan")
    sub.add_argument("--out", type=Path, metavar="FILE", help="write the corners as points.csv")
    _add_json(sub)

    sub = command(
        "redundancy", _redundancy, "which parameters say the same thing (Pearson), and the true rank"
    )
    _add_residual(sub)
    _add_json(sub)

    sub = command("calibrate", _calibrate, "fit the five-parameter model")
    _add_residual(sub)
    sub.add_argument("--out", type=Path, metavar="FILE", help="write the calibrated robot.toml")
    sub.add_argument("--force", action="store_true", help="write --out although the fit is no improvement")
    sub.add_argument("--no-prior", action="store_true", help="do not hold parameters within their tolerance")
    sub.add_argument(
        "--tolerance",
        action="append",
        default=[],
        type=_named_number,
        metavar="NAME=VALUE",
        help="tolerance of one parameter, mm or rad (default 1 mm, 0.0087 rad); may be given several times",
    )
    sub.add_argument(
        "--hold", action="append", default=[], metavar="NAME", help="keep a parameter at its nominal"
    )
    sub.add_argument("--robust", action="store_true", help="let points far from the model count less")
    _add_json(sub)

    sub = command(
        "validate", _validate, "how good the fit is away from its poses, and whether more would help"
    )
    sub.add_argument("--folds", type=int, default=5, help="default 5")
    _add_residual(sub)
    _add_json(sub)

    sub = command(
        "correct", _correct, "joint targets that bring the real arm where the nominal one should be"
    )
    sub.add_argument(
        "--joints", type=Path, required=True, metavar="FILE", help="targets, columns as poses.csv"
    )
    sub.add_argument("--out", type=Path, required=True, metavar="FILE", help="write the corrected targets")
    sub.add_argument("--what", choices=WHATS, help="default: pose for six joints and more, else position")
    sub.add_argument("--force", action="store_true", help="go on although the fit is no improvement")
    _add_residual(sub)
    _add_json(sub)

    sub = command("simulate", _simulate, "make a dataset with known truth", "folder to make")
    sub.add_argument("--robot", required=True, help=f"{', '.join(BUILTIN_ROBOTS)}, or a robot.toml")
    sub.add_argument("--poses", type=int, default=64, help="default 64")
    sub.add_argument(
        "--effect", action="append", default=[], metavar="NAME", help="may be given several times"
    )
    sub.add_argument("--scans", action="store_true", help="cast scans of the jig instead of points")
    sub.add_argument("--seed", type=int, default=0, help="default 0")
    sub.add_argument(
        "--noise-mm", type=float, default=0.05, help="of a measured point, each axis (default 0.05)"
    )
    _add_json(sub)

    sub = command(
        "check", _check, "the whole chain: pass or fail, and why", "dataset folder, or a folder of them"
    )
    sub.add_argument("--max-test-rmse-mm", type=float, metavar="X", help="what the test poses' error may be")
    _add_residual(sub)
    _add_json(sub)
    return parser


def _add_json(sub: argparse.ArgumentParser) -> None:
    sub.add_argument("--json", action="store_true", help="one JSON object on stdout, nothing else")


def _add_residual(sub: argparse.ArgumentParser) -> None:
    sub.add_argument("--residual", choices=RESIDUAL_KINDS, default="position", help="default position")


def _named_number(text: str) -> tuple[str, float]:
    name, _, value = text.partition("=")
    try:
        return name.strip(), float(value)
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text!r} is not NAME=VALUE, such as a1=0.5") from None


def _port(text: str) -> int:
    port = int(text)
    if not 0 <= port <= 65535:
        raise argparse.ArgumentTypeError(f"{port} is not a port; 0 to 65535")
    return port


def _serve(options: Any) -> int:
    from inspector.app import serve  # viser takes a second to load, and only this command needs it

    serve(options.path, host=options.host, port=options.port)
    return 0


def _corners(options: Any) -> int:
    dataset = _dataset(options.path)
    searches = _search(dataset)
    require_corners(dataset, searches)
    if options.out is not None:
        found = with_corners(dataset, searches)
        assert found.points is not None
        text = points_frame(found.poses, found.points).to_csv(index=False, lineterminator="\n")
        write_text_atomically(options.out, text)
    failed = failed_searches(searches)
    words = [search.summary() for search in searches.values()]
    words.append(f"{len(searches) - len(failed)} of {len(searches)} corners found")
    _print(options, documents.corners_document(searches), "\n".join(words))
    return 0


def _redundancy(options: Any) -> int:
    dataset = _dataset(options.path)
    result = redundancy(dataset, residual=options.residual)
    knowable = structural_rank(dataset.robot)
    words = (
        f"{result.summary()}\nDistances, or positions from an unknown place, can tell {knowable} at best "
        "(this arm at generic poses)."
    )
    _print(options, documents.redundancy_document(result, options.residual, knowable), words)
    return 0


def _calibrate(options: Any) -> int:
    dataset = _measured(_dataset(options.path))
    result = calibrate(
        dataset,
        residual=options.residual,
        fixed=options.hold,
        prior=not options.no_prior,
        tolerances=dict(options.tolerance),
        robust=options.robust,
    )
    if options.out is not None:
        result.require_improvement(force=options.force)
        write_text_atomically(options.out, robot_to_toml(result.robot))
    table = result.to_frame().to_string(index=False, float_format=lambda v: f"{v:.6g}")
    sums = "\n".join(f"known: {c.words} = {c.value:.6g} +- {c.sigma:.2g}" for c in known_sums(result))
    _print(options, documents.calibration_document(result), f"{table}\n{sums}\n{result.summary()}")
    return 0


def _validate(options: Any) -> int:
    dataset = _measured(_dataset(options.path))
    with _progress("fits", "fit") as on_progress:
        folds = cross_validate(
            dataset, folds=options.folds, residual=options.residual, on_progress=on_progress
        )
        curve = learning_curve(dataset, residual=options.residual, on_progress=on_progress)
    words = f"{folds.summary()}\n\n{curve.summary()}"
    _print(options, documents.validation_document(folds, curve), words)
    return 0


def _correct(options: Any) -> int:
    dataset = _dataset(options.path)
    targets = load_targets(options.joints, dataset.robot)
    result = calibrate(_measured(dataset), residual=options.residual)
    result.require_improvement(force=options.force)
    correction = corrected_joints(
        dataset.robot,
        result.model,
        targets.poses.q,
        x=result.fit.x,
        conditions=targets.poses,
        what=options.what,
    )
    write_text_atomically(options.out, corrected_table(targets, correction))
    ids = targets.poses.ids
    _print(options, documents.correction_document(correction, ids), correction.summary(ids))
    return 0 if correction.reached.all() else 1


def _simulate(options: Any) -> int:
    import numpy as np

    from calib.simulation import simulate_dataset, write_simulation

    if options.path.exists() and (not options.path.is_dir() or any(options.path.iterdir())):
        raise DatasetError(f"{options.path}: exists and is not empty; name a new folder")
    if options.seed < 0:
        raise DatasetError(f"--seed {options.seed}: a seed is 0 or more")
    robot = (
        builtin_robot(options.robot) if options.robot in BUILTIN_ROBOTS else load_robot(Path(options.robot))
    )
    simulation = simulate_dataset(
        robot,
        rng=np.random.default_rng(options.seed),
        effects=options.effect,
        poses=options.poses,
        noise_mm=options.noise_mm,
        scans=options.scans,
        name=options.path.resolve().name,
        description=f"simulated {robot.name}, seed {options.seed}",
    )
    with _progress("scans") as on_progress:
        write_simulation(simulation, options.path, on_progress=on_progress)
    truth = options.path / "truth.json"
    document = {
        "dataset": str(options.path),
        "truth": str(truth),
        "poses": options.poses,
        "effects": options.effect,
    }
    _print(
        options, document, f"{options.path}: {options.poses} poses of {robot.name}; the truth is in {truth}"
    )
    return 0


def _check(options: Any) -> int:
    results = []
    for folder in find_datasets(options.path):
        dataset = load_dataset(folder)
        searches = None
        if dataset.points is None:
            searches = _search(dataset)
            require_corners(dataset, searches)
        results.append(
            check(dataset, searches, residual=options.residual, max_test_rmse_mm=options.max_test_rmse_mm)
        )
        if not options.json:
            print(results[-1].summary(), flush=True)
    passed = all(result.passed for result in results)
    if options.json:
        each = [documents.check_document(result) for result in results]
        print(documents.to_json(each[0] if len(each) == 1 else {"passed": passed, "datasets": each}))
    return 0 if passed else 1


def _dataset(path: Path) -> Dataset:
    dataset = load_dataset(path)
    for warning in dataset.warnings:
        print(f"inspector: warning: {warning}", file=sys.stderr)
    return dataset


def _measured(dataset: Dataset) -> Dataset:
    """The dataset with points, found in its scans where it has none."""
    if dataset.points is not None:
        return dataset
    searches = _search(dataset)
    require_corners(dataset, searches)
    for pose_id, reason in failed_searches(searches).items():
        print(f"inspector: warning: {pose_id} has no corner and is left out: {reason}", file=sys.stderr)
    return with_corners(dataset, searches)


def _search(dataset: Dataset) -> dict[str, CornerSearch]:
    with _progress("corners") as on_progress, _processes(len(dataset.poses)) as executor:
        return find_corners(dataset, on_progress=on_progress, executor=executor)


@contextmanager
def _processes(scans: int) -> Iterator[Executor | None]:
    """A process for each core, where there are scans enough to keep them busy."""
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    if scans < MIN_SCANS_FOR_PROCESSES or cores < 2:
        yield None
        return
    # Not fork: Open3D and BLAS have threads by then, which a forked child would not have.
    with ProcessPoolExecutor(min(cores, scans), mp_context=multiprocessing.get_context("spawn")) as executor:
        yield executor


@contextmanager
def _progress(what: str, unit: str = "scan") -> Iterator[Callable[[int, int, str], None] | None]:
    """A bar on stderr where that is a terminal, nothing elsewhere."""
    if not sys.stderr.isatty():
        yield None
        return
    from tqdm import tqdm

    with tqdm(desc=what, unit=unit, file=sys.stderr, leave=False) as bar:

        def on_progress(done: int, total: int, pose_id: str) -> None:
            bar.total = total
            bar.set_postfix_str(pose_id, refresh=False)
            bar.update(done - bar.n)

        yield on_progress


def _print(options: Any, document: dict[str, Any], words: str) -> None:
    print(documents.to_json(document) if options.json else words)
