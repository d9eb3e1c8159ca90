"""The origin of models, sessions and reports, and `inspector verify`."""

from __future__ import annotations

import hashlib
import shutil
from pathlib import Path

import pytest

from calib.dataset.files.folder import load_dataset
from calib.dataset.files.origin import CHANGED, MISSING, NEW, SAME, read_origin, verify
from calib.errors import DatasetError
from tests.support.commands import answered, printed

ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder with a dataset, and a model and a session that were made of it."""
    folder = tmp_path_factory.mktemp("made")
    shutil.copytree(ROOT / "sample_data" / "hidden_effect_a", folder / "arm")
    out = ["--model-out", str(folder / "model.json"), "--session", str(folder / "session.json")]
    printed("calibrate", folder / "arm", *out)
    return folder


def test_model_and_session_carry_hashes_that_any_tool_computes_and_the_command(made: Path) -> None:
    for name in ("model.json", "session.json"):
        origin = read_origin(made / name)
        assert set(origin.files) == {"dataset.toml", "robot.toml", "poses.csv", "points.csv"}
        for path, found in origin.files.items():
            assert found == hashlib.sha256((made / "arm" / path).read_bytes()).hexdigest()
        assert origin.command[:3] == ("inspector", "calibrate", "arm")  # of an absolute path the name alone
        assert origin.made.endswith("+00:00")
        assert origin.program_version


def test_verify_tells_the_same_files_from_others(made: Path, tmp_path: Path) -> None:
    results = [str(made / name) for name in ("model.json", "session.json")]
    assert printed("verify", made / "arm", *results).count("made of exactly these 4 files") == 2
    shutil.copytree(made / "arm", tmp_path / "arm")
    poses = tmp_path / "arm" / "poses.csv"
    poses.write_text(poses.read_text().replace("train", "test", 1))
    document = answered("verify", tmp_path / "arm", *results, code=1)
    assert document["same"] is False
    states = {file["path"]: file["state"] for file in document["results"][0]["files"]}
    assert states == {"dataset.toml": SAME, "robot.toml": SAME, "poses.csv": CHANGED, "points.csv": SAME}


def test_files_of_another_name_are_missing_and_new(made: Path, tmp_path: Path) -> None:
    shutil.copytree(made / "arm", tmp_path / "arm")
    top = tmp_path / "arm" / "dataset.toml"
    (tmp_path / "arm" / "points.csv").rename(tmp_path / "arm" / "again.csv")
    top.write_text(top.read_text().replace("points.csv", "again.csv"))
    found = verify(made / "model.json", load_dataset(tmp_path / "arm"))
    states = {file.path: file.state for file in found.files}
    assert (states["points.csv"], states["again.csv"], states["dataset.toml"]) == (MISSING, NEW, CHANGED)
    assert not found.is_same


@pytest.mark.parametrize(
    "content", [b"", b"\xff\xfe\x00", b"{}", b'{"format": 3}', b"[" * 5000, b'<meta name="origin" content="{">']
)
def test_what_carries_no_origin_is_said_in_one_line(made: Path, tmp_path: Path, content: bytes) -> None:
    (tmp_path / "other.json").write_bytes(content)
    with pytest.raises(DatasetError, match=r"other\.json: carries no hashes of the files"):
        verify(tmp_path / "other.json", load_dataset(made / "arm"))
    with pytest.raises(DatasetError, match="no such file"):
        verify(tmp_path / "none.json", load_dataset(made / "arm"))
