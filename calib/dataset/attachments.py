"""What a plug-in attaches to a dataset: a value of its own, kept in a table of dataset.toml and in files beside it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol


@dataclass(frozen=True)
class Attachment:
    """Kind of an attached value, `Dataset.attachments` has it by its name."""

    name: str  # also of its table in dataset.toml
    load: str  # "module:name", (TomlTable, dataset's folder, Poses) -> AttachedValue, or None where nothing is there
    usual_residual: str = ""  # that is fitted unless another is asked for; "" leaves it open
    instrument: str = ""  # noun of what measured, such as "camera"
    target: str = ""  # noun of what was measured, such as "the board"


class AttachedValue(Protocol):
    """A value that can be kept in a dataset's folder."""

    def document(self) -> dict[str, Any]:
        """Table of dataset.toml that has it; `Attachment.load` reads it back."""

    def write(self, folder: Path) -> None:
        """Write what stands in files of its own to a dataset's folder."""

    def files(self, folder: Path, poses: Sequence[str]) -> list[Path]:
        """All of its files in a dataset's folder, with those of poses by their ids."""
