"""Commands on datasets: each calls `calib`, prints text or one JSON object, and returns an exit code.

Those that fit a model are in `inspector.cli.fit_commands`.
"""

from __future__ import annotations

import sys
import threading
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from calib.api.fits import redundancy
from calib.corners.batch import CornerBatch
from calib.corners.search import CornerSearch
from calib.dataset.dataset import Dataset
from calib.dataset.files.atomic_write import write_text_atomically
from calib.dataset.files.folder import load_dataset
from calib.effects.catalogue import descriptions
from calib.errors import printable, visible
from calib.identifiability.structural import free_frame_rank
from calib.kinematics.cartesian import require_links
from calib.measurement.measured_points import failed_searches, label_faces, require_corners, with_corners
from calib.present import to_dict
from calib.present.effects import effects_document
from calib.present.fit.corners import batch_blocks, corners_document
from calib.present.fit.redundancy import free_frame_sentence, redundancy_blocks, redundancy_document
from calib.rendering.blocks import Paragraph
from calib.rendering.text import block_text
from calib.strict_json import to_json
from calib.targets.assignment import assign_targets
from calib.targets.protocol.finder import load_finder
from calib.targets.search import find_targets
from inspector.cli.options.datasets import CornersOptions, RedundancyOptions, ServeOptions
from inspector.cli.options.shared import Output, WithLeaveOut
from inspector.cli.output_paths import check_outputs
from inspector.cli.progress import processes, progress
from inspector.export.csv_files import corners_csv, redundancy_csv


def run_serve(options: ServeOptions) -> int:
    """Serve the web app until Ctrl-C; its address is printed on stdout."""
    from inspector.app.serving import serving
    from inspector.server.viser_server import url_of
    from inspector.session.reopening import opening
    from inspector.session.session_file import load_session

    saved = None
    if options.session is not None:
        saved, notes = opening(load_session(options.session), options.path, options.effects_file)
        for note in notes:
            print(visible(f"inspector: warning: {options.session}: {note}"), file=sys.stderr)
    effects_file, data = options.effects_file, options.data
    with serving(
        options.path, host=options.host, port=options.port, effects_file=effects_file, saved=saved, data=data
    ) as app:
        if data is not None:
            print(f"Your own data, dropped on the page, goes to {visible(str(data.resolve()))}.")
        print(f"Open {url_of(app.server)} in a browser. Ctrl-C ends.", flush=True)
        try:
            threading.Event().wait()
        except KeyboardInterrupt:
            print()
    return 0


def run_corners(options: CornersOptions) -> int:
    """Find the corner in every scan."""
    dataset = load(options.path, finder=options.finder)
    check_outputs(dataset, [options.out], [options.finder])
    searches = found_corners(dataset, options.processes)
    require_corners(dataset, searches)
    named = assign_targets(dataset, searches)
    labels = label_faces(dataset, searches)
    if options.out is not None:
        found = with_corners(dataset, searches, orientation=labels if options.orientation else False)
        write_text_atomically(options.out, corners_csv(found))
    blocks = batch_blocks(searches, named, labels if dataset.shows_faces else None)
    show(options, corners_document(searches, labels, named), block_text(*blocks))
    return 0


def run_redundancy(options: RedundancyOptions) -> int:
    """Print the redundancy of the parameters (Park section 3), and the rank with the scanner's frame unknown."""
    dataset = load(options.path, options)
    require_links(dataset.robot, "the redundancy of parameters")
    check_outputs(dataset, [options.out])
    result = redundancy(dataset, residual=options.residual)
    if options.out is not None:
        write_text_atomically(options.out, redundancy_csv(result))
    unknown = free_frame_rank(dataset, residual=options.residual)
    document = redundancy_document(result, unknown) | {"left_out": dataset.left_out}
    text = block_text(*redundancy_blocks(result), Paragraph(free_frame_sentence(unknown)))
    show(options, document, "\n".join([text, *without(dataset)]))
    return 0


def run_effects(options: Output) -> int:
    """List the catalogue of effects."""
    lines = [
        f"{d.name}: {d.equation}  [{', '.join(f'{n} {u}' for n, u in d.symbols)}]; needs {d.needs}"
        for d in descriptions()
    ]
    show(options, effects_document(), "\n".join(lines))
    return 0


def load(path: Path, options: WithLeaveOut | None = None, finder: Path | None = None) -> Dataset:
    """Load a dataset, its poses counting as options say; warnings and notes go to stderr.

    `finder` is the file of a finder of the user's own, which is tried at once.
    """
    dataset = load_dataset(path)
    dataset = dataset if options is None else options.of_dataset(dataset)
    if finder is not None:
        dataset = replace(dataset, finder_file=load_finder(finder).path)
    for warning in dataset.warnings:
        print(f"inspector: warning: {printable(warning)}", file=sys.stderr)
    for note in dataset.notes:
        print(f"inspector: note: {printable(note)}", file=sys.stderr)
    return dataset


def without(dataset: Dataset) -> list[str]:
    """Line that lists the poses left out; none where all are in use."""
    return [f"left out: {', '.join(dataset.left_out)}"] if dataset.left_out else []


def measured(dataset: Dataset, residual: str = "distance") -> Dataset:
    """Dataset with points as a residual requires them, found in its scans if it has none."""
    if dataset.points is not None:
        return dataset
    return with_corners(dataset, searched(dataset), orientation=residual == "pose")


def searched(dataset: Dataset) -> dict[str, CornerSearch]:
    """Corner searches of a dataset's scans, by pose; scans without a corner are reported on stderr."""
    searches = found_corners(dataset)
    require_corners(dataset, searches)
    for pose_id, reason in failed_searches(searches).items():
        print(visible(f"inspector: warning: {pose_id} has no corner and is left out: {reason}"), file=sys.stderr)
    for line in assign_targets(dataset, searches).lines():
        print(visible(f"inspector: warning: {line}"), file=sys.stderr)
    return searches


def found_corners(dataset: Dataset, wanted: int | None = None) -> CornerBatch:
    """Corner searches on a number of processes; None for one process per core."""
    scans = 0 if dataset.scan_folder is None else len(dataset.poses)
    with progress("corners") as on_progress, processes(scans, wanted) as executor:
        return find_targets(dataset, on_progress=on_progress, executor=executor, intermediate=False)


def show(options: Output, document: Mapping[str, Any], text: str) -> None:
    """Print a text, or with --json one object."""
    print(to_json(to_dict(document)) if options.json else visible(text), file=options.stdout)
