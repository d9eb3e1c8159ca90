"""HTML page on a fleet: shared causes, changed arms, worst datasets, failures, and a row per dataset."""

from __future__ import annotations

import os
from datetime import datetime
from pathlib import Path
from urllib.parse import quote

from calib.extras.fleet.present.fleets import METHOD, fleet_presentation
from calib.extras.fleet.result import Fleet
from calib.rendering.blocks import Bullets, Facts, Link, Paragraph, Section
from inspector.report.page import render
from inspector.report.report import versions


def fleet_html(fleet: Fleet, page: Path, *, now: datetime) -> str:
    """HTML page on a fleet, to be written to the file `page`, so that links to the datasets work; `now` is its date."""
    made = now.astimezone().strftime("%Y-%m-%d %H:%M %Z").strip()
    page_folder = page.resolve().parent

    def link(path: str) -> Link:
        return Link(path, _address((fleet.folder / path).absolute(), page_folder))

    method = Section("Method", [Bullets(METHOD)])
    made_with = Section("Made with", [Facts(versions()), Paragraph(f"Made {made}.", soft=True)])
    return render(fleet_presentation(fleet, link, method, made_with))


def _address(folder: Path, page_folder: Path) -> str:
    """Address of a dataset's folder, relative to the page's where both are on one drive."""
    try:
        return quote(Path(os.path.relpath(folder, page_folder)).as_posix() + "/")
    except ValueError:  # on another drive
        return folder.as_uri()
