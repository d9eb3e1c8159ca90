"""Each extra can be taken away by itself: the others, the commands and a diagnosis do without it."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests.support.copies import PACKAGES, ROOT, extras

SAMPLE = ROOT / "sample_data" / "hidden_effect_a"
TRIED = """
import json, sys
from calib import plugins
from inspector.cli.parser import main
from inspector import plugins as of_inspector
here = [plugins.load(f"{package}.extras").__path__ for package in ("calib", "inspector")]
try:
    main(["--help"])
except SystemExit as ended:
    assert ended.code == 0
code = main(["diagnose", sys.argv[1], "--json"])
print(json.dumps([code, of_inspector.left_out(), sorted(name for name in sys.modules if ".extras." in name)]))
"""


@pytest.mark.slow
@pytest.mark.parametrize("name", extras())
def test_help_and_a_diagnosis_do_without_it(name: str, tmp_path: Path) -> None:
    for package in PACKAGES:  # folders of links: quick, and nothing that was taken away can be found
        (tmp_path / package / "extras").mkdir(parents=True)
        for inside in (ROOT / package).iterdir():
            if inside.name not in ("extras", "__pycache__"):
                (tmp_path / package / inside.name).symlink_to(inside)
        for inside in (ROOT / package / "extras").iterdir():
            if inside.name not in (name, "__pycache__"):
                (tmp_path / package / "extras" / inside.name).symlink_to(inside)
    done = subprocess.run(
        [sys.executable, "-P", "-c", TRIED, str(SAMPLE)],
        cwd=tmp_path,
        env=os.environ | {"PYTHONPATH": str(tmp_path)},
        capture_output=True,
        text=True,
    )
    assert (done.returncode, done.stderr) == (0, "")
    code, left_out, loaded = json.loads(done.stdout.splitlines()[-1])
    assert (code, left_out) == (0, [])
    assert not [module for module in loaded if module.split(".")[2] == name]
