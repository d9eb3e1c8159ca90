"""Kind of a plug-in that brings a form of a user's files to the import, beyond robots, tables of poses and scans."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class ImportSource:
    """Functions that know files of one form, each as "module:name"."""

    owns: str  # path -> whether a file or folder is of this form, and of no other
    folder_marks: tuple[str, ...]  # paths in a folder by which it may be one of this form, such as "meta/info.json"
    judged: str  # path that is owned -> its UserFile
    describe: str  # UserTable -> whether it has joints, and points, where it may be of this form, too
    reads: str  # path and mapping -> whether this form's tables are made of it
    tables: str  # ImportSources -> the same with tables of a row a pose; raises DatasetError
