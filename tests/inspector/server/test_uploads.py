"""What pages send is taken within limits: whole, in order, of the told size, from the one button."""

from __future__ import annotations

import os
import subprocess
import sys
import zipfile
from collections.abc import Iterator
from io import BytesIO
from pathlib import Path
from typing import Any

import pytest
from viser import _messages

from calib.errors import CalibError
from inspector.server.arrived_files import add_file
from inspector.server.uploads import PART_BYTES, Upload, UploadLimits, Uploads, plain_name


class Desk:
    """Uploads with what they said."""

    def __init__(self, folder: Path, **limits: int) -> None:
        self.done: list[Upload] = []
        self.acks: list[tuple[int, int, int]] = []
        self.refused: list[str] = []
        limits = {"free_bytes": 0} | limits
        self.uploads = Uploads(
            folder,
            lambda client, ack: self.acks.append((client, ack.transferred_bytes, ack.total_bytes)),
            lambda client, why: self.refused.append(f"{client}: {why}"),
            UploadLimits(**limits),
        )
        self.uploads.buttons = {"button": self.done.append}

    def start(self, size: int, client: int = 1, uuid: str = "u", **changes: Any) -> None:
        told = {
            "source_component_uuid": "button",
            "transfer_uuid": uuid,
            "filename": "my.zip",
            "mime_type": "",
            "part_count": -(-size // PART_BYTES),
            "size_bytes": size,
        }
        self.uploads.start(client, _messages.FileTransferStartUpload(**(told | changes)))

    def part(self, index: Any, content: Any, client: int = 1, uuid: str = "u") -> None:
        self.uploads.part(client, _messages.FileTransferPart("button", uuid, index, content))


@pytest.fixture
def desk(tmp_path: Path) -> Iterator[Desk]:
    made = Desk(tmp_path / "data")
    yield made
    made.uploads.close()


def files(folder: Path) -> list[Path]:
    return [path for path in folder.rglob("*") if path.is_file()]


def test_a_file_comes_as_it_was_sent_and_leaves_nothing_behind(desk: Desk, tmp_path: Path) -> None:
    content = bytes(range(256)) * 5000
    desk.start(len(content))
    for k in range(3):
        desk.part(k, content[k * PART_BYTES : (k + 1) * PART_BYTES])
    (upload,) = desk.done
    assert (upload.client, upload.name) == (1, "my.zip")
    assert upload.path.read_bytes() == content
    assert upload.path.is_relative_to(tmp_path / "data")
    assert desk.acks[-1] == (1, len(content), len(content))
    desk.uploads.close()
    assert not (tmp_path / "data").exists()


def test_an_empty_file_is_a_file(desk: Desk) -> None:
    desk.start(0)
    assert desk.done[0].path.read_bytes() == b""
    assert desk.acks == [(1, 0, 0)]


@pytest.mark.parametrize(
    "changes",
    [
        {"source_component_uuid": "another"},
        {"source_component_uuid": ""},
        {"part_count": 2},
        {"part_count": 10**12},
        {"part_count": -1, "size_bytes": -PART_BYTES},
        {"size_bytes": "10"},
        {"size_bytes": 10.0},
        {"size_bytes": True},
        {"size_bytes": None, "part_count": None},
        {"filename": 7},
        {"filename": "x" * 2000},
        {"transfer_uuid": None},
    ],
)
def test_what_no_page_announces_opens_nothing(desk: Desk, tmp_path: Path, changes: dict[str, Any]) -> None:
    desk.start(10, **changes)
    desk.part(0, b"0123456789", uuid=changes.get("transfer_uuid", "u"))
    assert desk.done == []
    assert not (tmp_path / "data").exists()


@pytest.mark.parametrize(
    "parts",
    [
        [(1, b"x" * PART_BYTES)],
        [(0, b"x" * PART_BYTES), (0, b"x" * PART_BYTES)],
        [(0, b"short")],
        [(0, b"x" * (PART_BYTES + 1))],
        [(0, "text")],
        [(0, None)],
        [(False, b"x" * PART_BYTES)],
        [(-1, b"x" * PART_BYTES)],
        [(0, b"x" * PART_BYTES), (1, b"x" * PART_BYTES)],  # the last is shorter
    ],
)
def test_parts_out_of_order_or_of_another_length_end_the_transfer(
    desk: Desk, tmp_path: Path, parts: list[tuple[Any, Any]]
) -> None:
    desk.start(2 * PART_BYTES - 100)
    for index, content in parts:
        desk.part(index, content)
    desk.part(0, b"x" * PART_BYTES)
    desk.part(1, b"x" * (PART_BYTES - 100))
    assert desk.done == []
    assert files(tmp_path / "data") == []
    desk.start(3, uuid="next")
    desk.part(0, b"abc", uuid="next")
    assert len(desk.done) == 1


def test_no_part_is_written_to_another_page_s_transfer(desk: Desk) -> None:
    desk.start(3, client=1)
    desk.part(0, b"bad", client=2)
    desk.part(0, b"bad", client=1, uuid="another")
    desk.part(0, b"abc", client=1)
    assert [upload.path.read_bytes() for upload in desk.done] == [b"abc"]


def test_a_page_sends_one_file_at_a_time_until_it_stalls(desk: Desk, monkeypatch: pytest.MonkeyPatch) -> None:
    desk.start(3)
    desk.start(3, uuid="second")
    desk.part(0, b"abc", uuid="second")
    assert desk.done == []
    monkeypatch.setattr("inspector.server.uploads._STALLED_S", 0.0)
    desk.start(3, uuid="third")
    desk.part(0, b"abc", uuid="third")
    assert len(desk.done) == 1


def test_limits_of_a_page_and_of_all_are_told(tmp_path: Path) -> None:
    desk = Desk(tmp_path / "data", page_bytes=100, total_bytes=150, pages=2)
    desk.start(101)
    assert "0 MB are taken" in desk.refused[-1]
    for client in (1, 2):
        desk.start(60, client=client)
        desk.part(0, b"x" * 60, client=client)
    assert len(desk.done) == 2
    desk.start(60, client=1, uuid="more")
    assert "that are here already" in desk.refused[-1]
    desk.start(35, client=2, uuid="more")
    assert "too many files" in desk.refused[-1]
    desk.start(1, client=3)
    assert "too many pages" in desk.refused[-1]
    desk.uploads.leave(1)
    desk.start(60, client=3, uuid="later")
    assert len(desk.refused) == 4
    assert desk.acks.count((2, 35, 35)) == 1  # so that the page does not wait for ever
    desk.uploads.close()


def test_a_full_disk_is_told(tmp_path: Path) -> None:
    desk = Desk(tmp_path / "data", free_bytes=10**18)
    desk.start(10)
    assert "nearly full" in desk.refused[-1]
    desk.uploads.close()


def zip_of(size: int, name: str) -> bytes:
    """A zip of a file that packs a hundred times smaller."""
    made = BytesIO()
    with zipfile.ZipFile(made, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr(name, (b"0.1234567890 " * 50 + os.urandom(8)) * (size // 658))
    return made.getvalue()


def send(desk: Desk, content: bytes, client: int, name: str) -> None:
    """A zip of a page, and what the program does with it."""
    desk.start(len(content), client=client, uuid=name, filename=f"{name}.zip")
    for k in range(-(-len(content) // PART_BYTES)):
        desk.part(k, content[k * PART_BYTES : (k + 1) * PART_BYTES], client=client, uuid=name)
    upload = desk.done.pop()
    with desk.uploads.writing(client) as room_bytes:
        add_file(upload.path, upload.name, desk.uploads.of(client) / "files", room_bytes)


def test_what_a_zip_holds_counts_as_it_lies_on_the_disk(tmp_path: Path) -> None:
    desk = Desk(tmp_path / "data", page_bytes=5_000_000, total_bytes=9_000_000)
    content = zip_of(3_000_000, "a.csv")
    assert len(content) < 100_000
    send(desk, content, 1, "first")
    with pytest.raises(CalibError, match=r"unpacked it has .* MB; 1\.9"):  # of the page
        send(desk, zip_of(3_000_000, "b.csv"), 1, "second")
    send(desk, zip_of(3_000_000, "c.csv"), 2, "third")
    with pytest.raises(CalibError, match=r"unpacked it has .* MB; 2\.9"):  # of all pages
        send(desk, zip_of(4_000_000, "d.csv"), 3, "fourth")
    assert sum(path.stat().st_size for path in files(tmp_path / "data")) < 6_100_000
    desk.start(3_000_000, client=1, uuid="plain")
    assert "that are here already" in desk.refused[-1]
    desk.uploads.leave(1)
    send(desk, zip_of(4_000_000, "d.csv"), 3, "fifth")
    send(desk, zip_of(900_000, "d.csv"), 3, "again")  # in the place of the first
    assert desk.uploads.room_bytes(3) > 4_000_000
    desk.uploads.close()


def test_a_page_that_leaves_while_its_zip_is_unpacked_leaves_nothing(desk: Desk, tmp_path: Path) -> None:
    desk.start(3)
    desk.part(0, b"abc")
    with desk.uploads.writing(1):
        desk.uploads.leave(1)
        (desk.uploads.of(1) / "late.csv").write_text("1")
    assert files(tmp_path / "data") == []


def test_the_folder_has_a_total_with_the_datasets_that_are_there(tmp_path: Path) -> None:
    (tmp_path / "data" / "old").mkdir(parents=True)
    (tmp_path / "data" / "old" / "points.csv").write_bytes(b"1" * 6_000_000)
    desk = Desk(tmp_path / "data", folder_bytes=10_000_000)
    with pytest.raises(CalibError, match=r"unpacked it has 4.999 MB; 3\.9"):
        send(desk, zip_of(5_000_000, "a.csv"), 1, "large")
    send(desk, zip_of(2_000_000, "a.csv"), 1, "small")
    with pytest.raises(CalibError, match=r"0\.01 GB"):
        desk.uploads.refuse_copy(1)
    (tmp_path / "data" / "old" / "points.csv").unlink()
    desk.uploads.refuse_copy(1)
    desk.uploads.close()


def test_a_disk_that_a_zip_would_fill_is_told(tmp_path: Path) -> None:
    desk = Desk(tmp_path / "data")
    desk.uploads.limits = UploadLimits(free_bytes=10**18)
    assert desk.uploads.room_bytes(1) == 0
    desk.uploads.close()


LEFT = """
import sys, time
from pathlib import Path
from inspector.server.uploads import UploadLimits, Uploads
uploads = Uploads(Path(sys.argv[1]), print, print, UploadLimits(free_bytes=0))
(uploads.of(1) / "part.x").write_text("x")
print("there", flush=True)
time.sleep(60)
"""


@pytest.mark.slow
@pytest.mark.skipif(sys.platform == "win32", reason="no such lock there")
def test_what_a_killed_server_left_is_removed_at_the_next_start_and_not_before(tmp_path: Path) -> None:
    data = tmp_path / "data"
    (data / ".arriving-old" / "1").mkdir(parents=True)
    (data / ".arriving-old" / "1" / "part.y").write_text("y")
    (data / "cell").mkdir()
    (tmp_path / "elsewhere").mkdir()
    (data / ".arriving-link").symlink_to(tmp_path / "elsewhere")
    other = subprocess.Popen([sys.executable, "-c", LEFT, str(data)], stdout=subprocess.PIPE)
    assert other.stdout.readline() == b"there\n"
    assert [path.name for path in files(data)] == ["part.x"]
    Desk(data).uploads.close()
    assert [path.name for path in files(data)] == ["part.x"]  # the other one runs
    other.kill()
    other.communicate()
    Desk(data).uploads.close()
    assert files(data) == []
    assert sorted(path.name for path in data.iterdir()) == [".arriving-link", "cell"]
    assert (tmp_path / "elsewhere").is_dir()


def test_a_page_that_leaves_takes_its_files_along(desk: Desk, tmp_path: Path) -> None:
    desk.start(3)
    desk.part(0, b"abc")
    desk.start(2 * PART_BYTES, uuid="half")
    desk.part(0, b"x" * PART_BYTES, uuid="half")
    assert len(files(tmp_path / "data")) == 2
    desk.uploads.leave(1)
    assert files(tmp_path / "data") == []


@pytest.mark.parametrize(
    ("name", "plain"),
    [
        ("../../etc/passwd", "passwd"),
        ("C:\\Users\\me\\log.csv", "log.csv"),
        ("a\0b\n.csv", "a_b_.csv"),
        ("..", "file"),
        ("", "file"),
        (".hidden", "hidden"),
        ("x" * 500 + ".csv", "x" * 116 + ".csv"),
        ("Achsen größer.csv", "Achsen größer.csv"),
    ],
)
def test_a_name_is_its_last_part_without_what_no_name_holds(name: str, plain: str) -> None:
    assert plain_name(name) == plain
