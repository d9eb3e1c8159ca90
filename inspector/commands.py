"""What each subcommand does: a few lines over `calib`, words or one JSON object to stdout, an exit code back."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

from calib.calibration import calibrate, redundancy, structural_rank
from calib.checking import check
from calib.corners import CornerSearch, find_corners
from calib.correction import corrected_joints
from calib.dataset import Dataset
from calib.dataset_file import find_datasets, load_dataset
from calib.diagnosis import diagnose, effects_named
from calib.effects.catalogue import Family
from calib.effects.descriptions import DESCRIPTIONS
from calib.effects.own import load_effects
from calib.errors import DatasetError
from calib.explanation import explain
from calib.knowledge import known_sums
from calib.learning import learning_curve
from calib.measurement import failed_searches, require_corners, with_corners
from calib.points_file import points_frame
from calib.robot_file import BUILTIN_ROBOTS, builtin_robot, load_robot, robot_to_toml
from calib.targets_file import corrected_table, load_targets
from calib.toml_file import write_text_atomically
from calib.validation import cross_validate
from inspector import documents
from inspector.progress import processes, progress, stages


def _own_effects(options: Any, dataset: Dataset) -> tuple[Family, ...]:
    return load_effects(options.effects_file, dataset) if options.effects_file is not None else ()


def run_serve(options: Any) -> int:
    """The web app until Ctrl-C."""
    from inspector.app import serve  # viser takes a second to load, and only this command needs it

    serve(options.path, host=options.host, port=options.port)
    return 0


def run_corners(options: Any) -> int:
    """Scans to corners."""
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


def run_redundancy(options: Any) -> int:
    """Which parameters say the same thing."""
    dataset = _dataset(options.path)
    result = redundancy(dataset, residual=options.residual)
    knowable = structural_rank(dataset.robot)
    words = (
        f"{result.summary()}\nDistances, or positions from an unknown place, can tell {knowable} at best "
        "(this arm at generic poses)."
    )
    _print(options, documents.redundancy_document(result, options.residual, knowable), words)
    return 0


def run_calibrate(options: Any) -> int:
    """Fit, and write the calibrated table."""
    dataset = _measured(_dataset(options.path))
    result = calibrate(
        dataset,
        residual=options.residual,
        effects=effects_named(dataset, options.effect, _own_effects(options, dataset)),
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


def run_validate(options: Any) -> int:
    """Folds over poses, and a learning curve."""
    dataset = _measured(_dataset(options.path))
    effects = effects_named(dataset, options.effect, _own_effects(options, dataset))
    with progress("fits", "fit") as on_progress:
        more: dict[str, Any] = {"residual": options.residual, "effects": effects, "on_progress": on_progress}
        folds = cross_validate(dataset, folds=options.folds, **more)
        curve = learning_curve(dataset, **more)
    words = f"{folds.summary()}\n\n{curve.summary()}"
    _print(options, documents.validation_document(folds, curve), words)
    return 0


def run_correct(options: Any) -> int:
    """Joint targets that bring the real arm where the nominal one was meant to be."""
    dataset = _dataset(options.path)
    targets = load_targets(options.joints, dataset.robot)
    dataset = _measured(dataset)
    effects = effects_named(dataset, options.effect, _own_effects(options, dataset))
    result = calibrate(dataset, residual=options.residual, effects=effects)
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


def run_diagnose(options: Any) -> int:
    """Which physical effect is missing."""
    if options.max_steps < 0:
        raise DatasetError(f"--max-steps {options.max_steps}: a number of steps is 0 or more")
    dataset = _measured(_dataset(options.path))
    own = _own_effects(options, dataset)
    effects_named(dataset, options.effect, own)  # refuses unknown names before the work starts
    with stages() as on_step:
        result = diagnose(
            dataset, effects=options.effect, own=own, max_steps=options.max_steps, on_step=on_step
        )
    ranking = (
        result.steps[0].screening.to_frame().head(6).to_string(index=False, float_format=lambda v: f"{v:.3g}")
    )
    steps = result.to_frame().to_string(index=False, float_format=lambda v: f"{v:.4g}")
    silent = "\n".join(f"not testable: {u.name}: {u.why}; {u.would_help}" for u in result.untestable)
    _print(
        options,
        documents.diagnosis_document(result),
        f"{ranking}\n\n{steps}\n\n{silent}\n\n{explain(result)}",
    )
    return 0


def run_effects(options: Any) -> int:
    """The catalogue."""
    lines = [
        f"{d.name}: {d.equation}  [{', '.join(f'{n} {u}' for n, u in d.parameters)}]; needs {d.needs}"
        for d in DESCRIPTIONS
    ]
    _print(options, documents.effects_document(), "\n".join(lines))
    return 0


def run_simulate(options: Any) -> int:
    """A dataset with known truth."""
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
    with progress("scans") as on_progress:
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


def run_check(options: Any) -> int:
    """The whole chain: exit code 1 where it is not good enough."""
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
    with progress("corners") as on_progress, processes(len(dataset.poses)) as executor:
        return find_corners(dataset, on_progress=on_progress, executor=executor)


def _print(options: Any, document: dict[str, Any], words: str) -> None:
    print(documents.to_json(document) if options.json else words)
