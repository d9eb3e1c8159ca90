"""Files uploaded by a page: storing below a folder, and the robots and datasets available in them."""

from __future__ import annotations

import os
import shutil
from dataclasses import dataclass, replace
from pathlib import Path

from calib.dataset.dataset import Dataset
from calib.dataset.files.folder import load_dataset
from calib.dataset_import.archive import ArchiveLimits, unpack
from calib.dataset_import.import_dataset import plan_of_files, without_folder
from calib.dataset_import.plan import ImportPlan, ImportSources
from calib.dataset_import.user_files import UserFiles, look_through
from calib.errors import CalibError
from calib.options import BUILTIN_ROBOTS
from calib.robot_formats.robot_file import tips_of

_BUILT_IN = {f"{name} (built in)": name for name in BUILTIN_ROBOTS}


def robots_of(files: UserFiles) -> dict[str, str]:
    """Robot files that can be chosen, by their label on the page."""
    own = {str(path.relative_to(files.folder)): str(path) for path in files.robots}
    return own | _BUILT_IN


@dataclass(frozen=True)
class LookedThrough:
    """What uploaded files are: a dataset that can be opened, or what one can be made of, as far as that is known."""

    files: UserFiles
    plan: ImportPlan | None = None
    tips: tuple[str, ...] = ()  # possible end links of the arm in a URDF
    ready: Dataset | None = None
    faults: tuple[str, ...] = ()  # why what looks like a dataset cannot be opened


def looked_through(folder: Path, choice: ImportSources) -> LookedThrough:
    """Uploaded files recognised, and a dataset planned of them as far as it was chosen."""
    files = look_through(folder)
    if len(files.datasets) > 1:
        return LookedThrough(files, faults=(f"These are {len(files.datasets)} datasets; drop one of them alone.",))
    if files.datasets:
        try:
            return LookedThrough(files, ready=load_dataset(files.datasets[0]))
        except CalibError as error:
            return LookedThrough(files, faults=(str(error).replace(f"{files.folder}/", ""),))
    robot = choice.robot or next(map(str, files.robots), None)
    tips = _tips_or_none(robot)
    reading = choice.reading
    if len(tips) > 1 and reading.tip is None:
        reading = replace(reading, tip=tips[0])  # the longest arm; the list shows it
    plan = without_folder(plan_of_files(files, replace(choice, reading=reading)), folder)
    return LookedThrough(files, plan, tips)


def _tips_or_none(robot: str | None) -> tuple[str, ...]:
    """Possible end links of the arm in a URDF; () where there is no choice."""
    try:
        return () if robot is None or robot in BUILTIN_ROBOTS else tips_of(Path(robot))
    except CalibError:  # it is told as a fault of the plan
        return ()


def add_file(path: Path, name: str, folder: Path, room_bytes: int) -> None:
    """Store an uploaded file below the folder, replacing one of the same name; a zip is unpacked as space allows."""
    folder.mkdir(exist_ok=True)
    if not name.lower().endswith(".zip"):
        os.replace(path, folder / name)
        return
    fresh = path.with_name(f"{path.name}.unpacked")
    try:
        for file in unpack(path, fresh, ArchiveLimits(total_bytes=room_bytes)):
            place = folder / file.relative_to(fresh)
            place.parent.mkdir(parents=True, exist_ok=True)
            os.replace(file, place)
    except CalibError as error:
        raise CalibError(str(error).replace(str(path), name)) from None
    except OSError as error:
        raise CalibError(f"{name}: cannot be unpacked beside what is there ({error.strerror})") from None
    finally:
        path.unlink(missing_ok=True)
        shutil.rmtree(fresh, ignore_errors=True)
