"""The command `import`: a dataset folder from a robot and tables, or from a zip or folder with these."""

from __future__ import annotations

import sys
from contextlib import nullcontext
from pathlib import Path
from typing import Any

from calib.dataset.dataset import ROLES, Dataset
from calib.dataset.files.atomic_write import require_free
from calib.dataset_import.columns import parsed_mapping
from calib.dataset_import.import_dataset import (
    copy_dataset,
    plan_of_files,
    scan_files,
    unpacked,
    without_folder,
    write_plan,
)
from calib.dataset_import.plan import ImportPlan, ImportSources
from calib.dataset_import.user_files import UserFiles
from calib.errors import CalibError, visible
from calib.present.diagnosis.diagnosis import diagnosis_document
from inspector.cli.dataset_commands import measured, show
from inspector.cli.options.datasets import ImportOptions
from inspector.cli.progress import progress, stages
from inspector.export.import_document import plan_document, plan_lines, question_lines


def run_import(options: ImportOptions) -> int:
    """Make a dataset folder from a user's files."""
    choice = _choice(options)
    is_named = options.robot is not None and options.joints is not None
    if options.source is None and choice.to_measure is None and not is_named and options.flange_poses is None:
        raise CalibError(
            "give --robot and --joints, --flange-poses with --points or alone, or --from with a zip or a folder that "
            "holds them"
        )
    if not options.dry_run:
        require_free(options.path)
    given = nullcontext(_named(options)) if options.source is None else unpacked(options.source)
    with given as files:
        if files.datasets:
            return _ready(options, files)
        unit = "" if choice.to_measure is None else choice.to_measure.unit
        with progress(f"{unit}s", unit) if unit else nullcontext() as on_progress:
            plan = without_folder(plan_of_files(files, choice, on_progress), files.folder)
        for doubt in plan.doubts:
            print(visible(f"inspector: warning: {doubt}"), file=sys.stderr)
        if options.dry_run:
            return _told(options, files, plan)
        try:
            dataset = write_plan(plan, options.path)
        except CalibError as error:
            if plan.can_leave_out:
                raise CalibError(f"{error}\n  {_skip_hint(plan)}") from None
            raise
    summary = [] if plan.robot is None else [plan.robot.summary]
    document = plan_document(plan, files.files)
    notes = [] if plan.robot is None else plan.robot.notes
    lines = [*summary, *plan.notes, *question_lines(plan)]
    return _finished(options, dataset, document | {"notes": notes}, lines)


def _named(options: ImportOptions) -> UserFiles:
    """Files that the options name, with their roles."""
    return UserFiles(Path(), (), {} if options.scans is None else scan_files(options.scans))


def _choice(options: ImportOptions) -> ImportSources:
    reading = options.reading(named=options.robot is not None)
    choice = ImportSources(
        robot=options.robot, reading=reading, joints=options.joints, points=options.points,
        mapping=parsed_mapping(options.map), point_sigma_mm=options.sigma, place_sigma_mm=options.place_sigma,
        tool_mm=options.tool, tool_mass_kg=options.tool_mass, edge_mm=options.edge, skip_bad_rows=options.skip_bad_rows,
        flange_poses=options.flange_poses,
    )  # fmt: skip
    for added in options.added:
        choice = added.chosen(choice)
    return choice


def _skip_hint(plan: ImportPlan) -> str:
    rows = "the row that cannot" if len(plan.bad_rows) == 1 else f"the {len(plan.bad_rows)} rows that cannot"
    return f"--skip-bad-rows leaves out {rows} be read"


def _told(options: ImportOptions, files: UserFiles, plan: ImportPlan) -> int:
    """Print the plan alone; returns exit code 1 where the plan has faults."""
    kinds = [f"{file.path.name}: {file.kind}, {file.why}" for file in files.files]
    faults = [f"fault: {fault}" for fault in plan.faults]
    lines = [*kinds, *plan_lines(plan), *faults, *([_skip_hint(plan)] if plan.can_leave_out else [])]
    show(options, {"dataset": None} | plan_document(plan, files.files), "\n".join(lines))
    return 1 if plan.faults else 0


def _ready(options: ImportOptions, files: UserFiles) -> int:
    """Import a zip or folder that already contains a dataset's folder."""
    if len(files.datasets) > 1:
        named = ", ".join(str(folder.relative_to(files.folder)) for folder in files.datasets)
        raise CalibError(f"{options.source}: holds {len(files.datasets)} datasets ({named}); give one of them")
    if options.sigma is not None or options.tool is not None or options.skip_bad_rows:
        raise CalibError(
            f"{options.source}: holds a dataset's folder, which is copied as it is; leave out --sigma, --tool and "
            "--skip-bad-rows, or change its files"
        )
    folder = files.datasets[0]
    said = f"{options.source}: holds a dataset's folder, which is copied as it is"
    document: dict[str, Any] = {"files": [], "columns": [], "recognised": [said], "doubts": [], "faults": []}
    if options.dry_run:
        show(options, {"dataset": None} | document, said)
        return 0
    return _finished(options, copy_dataset(folder, options.path), document, [said])


def _next_step(options: ImportOptions) -> str:
    """Command that a user would give next."""
    fits = options.flange_poses is not None or _choice(options).to_measure is not None
    return f"inspector {'calibrate' if fits else 'diagnose'} {options.path}"


def _finished(options: ImportOptions, dataset: Dataset, document: dict[str, Any], lines: list[str]) -> int:
    """Report the written dataset, and with --diagnose its verdict."""
    warnings = [*dataset.warnings, *dataset.notes]
    for warning in warnings:
        print(visible(f"inspector: warning: {warning}"), file=sys.stderr)
    roles = {role: int((dataset.poses.role == role).sum()) for role in ROLES}
    counts = ", ".join(f"{count} {role}" for role, count in roles.items())
    lines = [line for line in lines if line not in warnings]
    lines += [f"{options.path}: {len(dataset.poses)} poses ({counts})"]
    made = {"dataset": str(options.path), "robot": dataset.robot.name, "poses": len(dataset.poses), "roles": roles}
    document = document | made | {"warnings": warnings}
    if not options.diagnose:
        show(options, document, "\n".join([*lines, f"next: {_next_step(options)}"]))
        return 0
    from calib.api.causes import diagnose
    from calib.planning.discrimination import next_poses
    from inspector.cli.fit_commands import brief_text

    with stages() as on_step:
        result = diagnose(measured(dataset), on_step=on_step)
    poses = next_poses(result)
    text = "\n".join([*lines, "", brief_text(result, poses, options.path)])
    show(options, document | {"diagnosis": diagnosis_document(result, poses)}, text)
    return 0
