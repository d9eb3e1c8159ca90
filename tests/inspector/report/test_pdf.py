"""The report printed as PDF: pages, a clear error without a browser, nothing half-written, no process left."""

from __future__ import annotations

import re
import stat
import time
from pathlib import Path

import pytest

from calib.errors import CalibError
from inspector.report.pdf import is_report_pdf, pdf_of
from inspector.report.report import is_report
from tests.support.browser import need_chromium
from tests.support.commands import printed, refused
from tests.support.hidden_dataset import write_hidden

PAGE = "<!DOCTYPE html><meta charset=utf-8><title>t</title><p style='break-after:page'>one<p>two"
POINTS_OF_A4 = (595.0, 842.0)


@pytest.fixture
def no_browser(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.delenv("CHROMIUM", raising=False)
    monkeypatch.setenv("PATH", str(tmp_path / "empty"))


def program(path: Path, script: str) -> Path:
    path.write_text(f"#!/bin/sh\n{script}\n")
    path.chmod(path.stat().st_mode | stat.S_IXUSR)
    return path


@pytest.mark.thorough
@pytest.mark.browser
def test_both_files_are_written_and_the_pdf_has_pages_of_a4(tmp_path: Path) -> None:
    need_chromium()
    page, pdf = tmp_path / "report.html", tmp_path / "report.pdf"
    printed("report", write_hidden(tmp_path), "--out", page, "--pdf", pdf)
    content = pdf.read_bytes()
    assert content.startswith(b"%PDF")
    assert len(re.findall(rb"/Type\s*/Page\b", content)) >= 3
    boxes = {tuple(map(float, box.split())) for box in re.findall(rb"/MediaBox\s*\[([^\]]*)\]", content)}
    assert all(box[2:] == pytest.approx(POINTS_OF_A4, abs=1.0) for box in boxes)
    assert is_report(page)
    assert is_report(pdf)  # so that both may be replaced
    assert str(tmp_path) not in page.read_text()
    assert str(tmp_path).encode() not in content


@pytest.mark.browser
def test_a_page_is_printed_page_by_page(tmp_path: Path) -> None:
    need_chromium()
    content = pdf_of(PAGE)
    assert len(re.findall(rb"/Type\s*/Page\b", content)) == 2
    (tmp_path / "a.pdf").write_bytes(content)
    assert is_report_pdf(tmp_path / "a.pdf")
    (tmp_path / "a.pdf").write_bytes(b"%PDF-1.4 of someone else")
    assert not is_report_pdf(tmp_path / "a.pdf")


@pytest.mark.usefixtures("no_browser")
@pytest.mark.parametrize("option", ["--out", "--pdf"])
def test_without_a_browser_one_line_says_what_to_install(option: str, tmp_path: Path) -> None:
    folder = write_hidden(tmp_path)
    out = {"--out": str(tmp_path / "report.html"), option: str(tmp_path / "report.pdf")}
    captured = refused("report", folder, *(word for pair in out.items() for word in pair))
    for told in ("install Chromium or Chrome", "CHROMIUM", "--out report.html"):
        assert told in captured
    assert not (tmp_path / "report.html").exists()
    assert not (tmp_path / "report.pdf").exists()


def test_a_named_browser_that_is_none_is_told(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("CHROMIUM", str(tmp_path / "nowhere"))
    with pytest.raises(CalibError, match="nowhere is no program"):
        pdf_of(PAGE)


def test_a_browser_that_prints_nothing_or_hangs_is_told_and_ended(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv("CHROMIUM", str(program(tmp_path / "silent", "exit 0")))
    with pytest.raises(CalibError, match="printed no PDF"):
        pdf_of(PAGE)
    alive = tmp_path / "alive"
    script = f"(while true; do touch {alive}; sleep 0.05; done) & wait"  # a process of its own beside it
    monkeypatch.setenv("CHROMIUM", str(program(tmp_path / "slow", script)))
    with pytest.raises(CalibError, match="within"):
        pdf_of(PAGE, timeout_s=0.3)
    time.sleep(0.2)
    seen = alive.stat().st_mtime if alive.exists() else 0.0
    time.sleep(0.2)
    assert (alive.stat().st_mtime if alive.exists() else 0.0) == seen


def test_another_files_pdf_is_not_replaced(tmp_path: Path) -> None:
    pdf = tmp_path / "invoice.pdf"
    pdf.write_bytes(b"%PDF-1.4 precious")
    assert "--force" in refused("report", write_hidden(tmp_path), "--out", pdf)
    assert pdf.read_bytes() == b"%PDF-1.4 precious"
