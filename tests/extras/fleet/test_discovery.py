"""Datasets below a folder: however deep, once each, in order, whatever links and locks there are."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from calib.errors import DatasetError
from calib.extras.fleet import discovery
from calib.extras.fleet.discovery import discover


def dataset(folder: Path) -> Path:
    folder.mkdir(parents=True)
    (folder / "dataset.toml").write_text("format = 1\n")
    return folder


def test_datasets_are_found_however_deep_and_in_order(tmp_path: Path) -> None:
    for name in ("b", "a/deep/er", "a/x"):
        dataset(tmp_path / name)
    dataset(tmp_path / "b" / "scans" / "inside")  # of b, no dataset of the fleet
    dataset(tmp_path / ".hidden" / "c")
    (tmp_path / "empty").mkdir()
    found = discover(tmp_path)
    assert found.datasets == ("a/deep/er", "a/x", "b")
    assert found.failures == ()
    assert discover(tmp_path / "b").datasets == (".",)


def test_a_circle_of_links_ends_and_a_folder_with_two_names_counts_once(tmp_path: Path) -> None:
    dataset(tmp_path / "site" / "a")
    (tmp_path / "site" / "up").symlink_to(tmp_path)
    (tmp_path / "site" / "self").symlink_to(tmp_path / "site" / "self")
    (tmp_path / "again").symlink_to(tmp_path / "site" / "a")
    (tmp_path / "gone").symlink_to(tmp_path / "nowhere")
    assert discover(tmp_path).datasets == ("again",)  # the first way in order


def test_a_folder_that_cannot_be_listed_is_told_and_the_others_are_found(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    dataset(tmp_path / "a")
    (tmp_path / "locked").mkdir()
    scandir = os.scandir

    def refusing(place: str | Path) -> object:
        if Path(place).name == "locked":
            raise PermissionError(13, "Permission denied", str(place))
        return scandir(place)

    monkeypatch.setattr(discovery.os, "scandir", refusing)
    found = discover(tmp_path)
    assert found.datasets == ("a",)
    assert [(f.path, f.reason) for f in found.failures] == [("locked", "cannot be looked into (Permission denied)")]
    with pytest.raises(DatasetError, match="Permission denied"):
        discover(tmp_path / "locked")


def test_what_holds_no_dataset_is_refused(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    for place, says in (
        (tmp_path, "no dataset.toml"),
        (tmp_path / "file", "is a file"),
        (tmp_path / "no", "no such"),
    ):
        with pytest.raises(DatasetError, match=says):
            discover(place)
