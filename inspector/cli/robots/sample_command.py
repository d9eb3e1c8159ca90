"""The command `sample`: sample datasets, available also without a checkout of the project."""

from __future__ import annotations

import shutil
import tomllib
from importlib import metadata
from pathlib import Path

from calib.dataset.files.atomic_write import new_folder
from calib.errors import DatasetError
from inspector.cli.dataset_commands import show
from inspector.cli.options.datasets import SampleOptions

DISTRIBUTION = "robot-calibration-inspector"
_CHECKOUT = Path(__file__).parents[3]


def run_sample(options: SampleOptions) -> int:
    """List the samples, or copy one of them to a new folder."""
    samples = sample_folders()
    if options.name is None:
        if options.out is not None:
            raise DatasetError("--out: name the sample that is to be written; without a name they are listed")
        about = {name: _description(folder) for name, folder in samples.items()}
        width = max(map(len, about), default=0)
        document = {"samples": [{"name": name, "about": text} for name, text in about.items()]}
        show(options, document, "\n".join(f"{name:<{width}}  {text}" for name, text in about.items()))
        return 0
    if options.name not in samples:
        raise DatasetError(f"{options.name}: no such sample; there are {', '.join(samples)}")
    out = options.out or Path(options.name)
    _copy(samples[options.name], out)
    show(
        options,
        {"sample": options.name, "dataset": str(out)},
        f"{out}: {_description(samples[options.name])}. Now type: inspector diagnose {out}",
    )
    return 0


def sample_folders() -> dict[str, Path]:
    """Folders of the available samples by name: a wheel installs the small simulated ones, a checkout has all.

    Raises:
        DatasetError: there are none.
    """
    found = _installed() or sorted((_CHECKOUT / "sample_data").glob("*/dataset.toml"))
    if not found:
        raise DatasetError("this installation has no sample data; `inspector simulate` makes a dataset")
    return {file.parent.name: file.parent for file in found}


def _installed() -> list[Path]:
    """dataset.toml of each sample installed with the package, below share/."""
    try:
        files = metadata.files(DISTRIBUTION) or []
    except metadata.PackageNotFoundError:  # run from its source
        return []
    placed = (
        Path(str(file.locate()))
        for file in files
        if file.name == "dataset.toml" and file.parts[-4:-2] == (DISTRIBUTION, "sample_data")
    )
    return sorted(path.resolve() for path in placed if path.is_file())


def _description(folder: Path) -> str:
    return str(tomllib.loads((folder / "dataset.toml").read_text(encoding="utf-8"))["description"])


def _copy(sample: Path, out: Path) -> None:
    """Copy a sample's files to `out` atomically, owned by the user."""
    with new_folder(out) as whole:
        for file in sorted(path for path in sample.rglob("*") if path.is_file()):
            place = whole / file.relative_to(sample)
            place.parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(file, place)
