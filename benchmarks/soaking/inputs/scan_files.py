"""Spoiled scans of every format: the corner, a reason, or one clear error; and the same corner from the same points."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np

from calib.dataset.files.robot_toml import builtin_robot, robot_to_toml
from soaking.inputs import odd_values
from soaking.inputs.commands import ran
from soaking.inputs.material import SCENES
from soaking.inputs.odd_values import Rng
from soaking.record import Result
from tests.support.scan_mutations import CLOUDS, MUTATIONS, WRITERS

NAMES = (*WRITERS, "scan.e57")
TEXTS = ("text.ply", "text.pcd", "plain.xyz", "header.csv", "comments.txt", "text.stl", "mesh.obj")
MOST_OFF_MM = 1.0  # of a corner: further is another place
DATASET = """format = 1
name = "scans"
scans = "scans"

[scanner]
scan_sigma_mm = 0.02

[jig]
shape = "trihedral"
edge_mm = 60.0
"""


def _line_ends(rng: Rng, content: bytes) -> bytes:
    return content.replace(b"\n", b"\r\n")


def _blank_lines(rng: Rng, content: bytes) -> bytes:
    return content + b"\n\n"


def _as_other_suffix(name: str, rng: Rng) -> str:
    """Plain rows of numbers are read under each of these."""
    return f"p1{rng.choice(['.xyz', '.asc', '.pts', '.txt']) if name == 'plain.xyz' else Path(name).suffix}"


def attempt(number: int, rng: Rng, name: str, material: Path, scratch: Path) -> Result:
    """Run one case: a dataset of one pose, whose scan is spoiled."""
    scene = material / "scans" / str(int(rng.integers(SCENES)))
    apex_mm = np.loadtxt(scene / "apex_mm.txt")
    content = (scene / name).read_bytes()
    what, content, same = _spoiled(rng, name, content)
    scratch = scratch / "cell"
    (scratch / "scans").mkdir(parents=True)
    file = _as_other_suffix(name, rng)
    (scratch / "dataset.toml").write_text(DATASET)
    (scratch / "robot.toml").write_text(robot_to_toml(builtin_robot("rb5")))
    (scratch / "scans" / file).write_bytes(content)
    (scratch / "poses.csv").write_text(
        f"pose,role,scan,{','.join(f'q{k}_deg' for k in range(1, 7))}\np1,reference,{file},10,20,30,40,50,60\n"
    )
    result = ran(scratch, "corners", scratch, "--processes", 1, "--json")
    trouble, said = result.trouble, result.said
    if not trouble:
        found = json.loads(result.out)["corners"] if result.code == 0 else []
        off_mm = float(np.linalg.norm(np.array(found[0]["xyz_mm"]) - apex_mm)) if found else np.inf
        if same and not off_mm <= MOST_OFF_MM:
            trouble, said = "wrong", f"{off_mm:.3g} mm off; {result.said or result.out[:300]}"
    return Result(
        number, f"scan {name}", f"{what}{' (same)' if same else ''}; corners", str(result.code), trouble, said
    )


def _spoiled(rng: Rng, name: str, content: bytes) -> tuple[str, bytes, bool]:
    """Name of the damage, the damaged file, and whether it means the same."""
    share = rng.random()
    if share < 0.2:
        same: dict[str, Callable[[Rng, bytes], bytes]] = {"nothing": lambda rng, content: content}
        if name in TEXTS:
            same |= {"line ends": _line_ends, "empty lines at the end": _blank_lines}
        if name in ("plain.xyz", "header.csv", "comments.txt"):
            same["byte order mark"] = odd_values.byte_order_mark
        chosen = str(rng.choice([*same]))
        return chosen, same[chosen](rng, content), True
    if share < 0.35 and name in WRITERS:
        chosen = str(rng.choice([*CLOUDS]))
        with np.errstate(all="ignore"):
            return chosen, WRITERS[name](CLOUDS[chosen](rng)), False
    changes = MUTATIONS | odd_values.BYTES
    chosen = str(rng.choice([*changes]))
    return chosen, changes[chosen](rng, content), False
