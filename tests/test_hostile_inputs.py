"""Spoiled inputs through the commands, inputs that mean the same, and fits of the same arm told otherwise.

Whatever a file holds, a command ends with exit code 0, 1 or 2, one bounded line on 2, no traceback, no file changed or
left behind (`tests/support/promises.py`). A file that means what it meant gives the same result. `HOSTILE_EXAMPLES` in
the environment sets how many inputs each test draws; benchmarks/soak.py draws thousands every night.
"""

from __future__ import annotations

import json
import os
import re
import shutil
import tempfile
import tomllib
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from calib import calibrate
from calib.dataset.dataset import Dataset
from calib.dataset.files.folder import load_dataset, write_dataset
from calib.dataset.files.robot_toml import builtin_robot, robot_to_toml
from calib.errors import MOST_CHARACTERS, CalibError
from calib.kinematics.chain import target_points
from calib.simulation.simulate import simulate_dataset
from tests.support.arms import random_arm, random_transform
from tests.support.changed import with_xyz
from tests.support.promises import ran
from tests.support.scan_mutations import CLOUDS, MUTATIONS, WRITERS, mutated
from tests.support.scan_scene import make_scene

EXAMPLES = int(os.environ.get("HOSTILE_EXAMPLES", "25"))
SEEDS = st.integers(0, 2**32)
OF_A_SIGMA, RELATIVE = 1e-3, 1e-5  # which the order of sums and the end of an iteration leave
Rng = np.random.Generator
Change = Callable[[Rng, bytes], bytes]

CELL_TABLES = """
[cell]
floor_z_mm = -50.0
least_manipulability = 0.01

[[cell.boxes]]
name = "cabinet"
min_mm = [900.0, 900.0, 0.0]
max_mm = [1200.0, 1200.0, 900.0]

[about]
serial = "RB5-17"
date = "2024-05-17"
"""
EFFECT = '''"""An effect of the user's own."""
from dataclasses import dataclass

import numpy as np

from calib import Parameter


@dataclass(frozen=True)
class FifthHarmonic:
    joint: int = 2
    parameters = (Parameter("sin_rad", unit="rad", scale=1e-4),)

    def apply(self, state, *, sin_rad):
        return state.add_joint_error(self.joint, sin_rad * np.sin(5 * state.q_rad[:, self.joint]))
'''
SCANNED = """format = 1
name = "scans"
scans = "scans"

[scanner]
scan_sigma_mm = 0.02

[jig]
shape = "trihedral"
edge_mm = 60.0
"""


@pytest.fixture(scope="module")
def good(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A cell of 30 poses, with a model, a session, an effect of the user's own and a user's table of it."""
    folder = tmp_path_factory.mktemp("good")
    rng = np.random.default_rng(18)
    made = simulate_dataset("rb5", rng=rng, poses=30, noise_mm=0.05, conditions=True, name="cell")
    dataset, cell = made.dataset, folder / "cell"
    write_dataset(dataset, cell)
    with (cell / "dataset.toml").open("a") as file:
        file.write(CELL_TABLES)
    outputs = ("--model-out", folder / "model.json", "--session", folder / "session.json")
    kept = ran(folder, "calibrate", cell, "--add", "joint_compliance", *outputs, outputs=(folder,))
    assert (kept.code, kept.trouble) == (0, "")
    session = json.loads((folder / "session.json").read_text())
    session["dataset"]["folder"] = "cell"
    (folder / "session.json").write_text(json.dumps(session, indent=1))
    (folder / "own_effect.py").write_text(EFFECT)
    columns = ["pose", *(f"J{k} [rad]" for k in range(1, 7)), "X [m]", "Y [m]", "Z [m]"]
    values = zip(dataset.poses.ids, dataset.poses.q.tolist(), (dataset.points.xyz_mm / 1e3).tolist(), strict=True)
    rows = [[pose, *map(repr, q), *map(repr, place)] for pose, q, place in values]
    (folder / "measured.csv").write_bytes(_table([columns, *rows]))
    return folder


@contextmanager
def scratch() -> Iterator[Path]:
    """An empty folder for one drawn case."""
    with tempfile.TemporaryDirectory() as folder:
        yield Path(folder)


# ---- ways to spoil a file -------------------------------------------------------------------------------------------

ODD_VALUES = (
    "nan", "inf", "-inf", "1e308", "-1e308", "1e-320", "1e999", "0", "-1e5", "3", "9" * 400, "1_0", "1,5", "0x10", "١",
    "--1", "1.2.3", "5 mm", "", " ", "=1+1", "a" * 5000, "\u202eevil", "\ufeff", "\x00", "\x1b[31m", "true", "<b>x</b>",
    "../../../etc/passwd", "train", "test", "reference", '"', ",", ";",
)  # fmt: skip
ODD_TOML = (
    "nan", "-inf", "1e308", "0", "-1e5", "9" * 400, "{}", "[]", '""', '"text"', "true", "1979-05-27T07:32:00Z",
    "[" * 900 + "]" * 900, "[1, [2, 'a']]", f'"{"a" * 5000}"', "{a = 1}", "-9223372036854775809", "[nan, nan, nan]",
)  # fmt: skip
_KEY = re.compile(rb"(?m)^(\w+)( *= *)(.*)$")
_DECIMAL = re.compile(rb"(?<![\w.\"])-?\d+\.\d+(?![\w.])")


def _rows(content: bytes) -> list[list[str]]:
    return [line.split(",") for line in content.decode().strip("\n").split("\n")]


def _table(rows: list[list[str]]) -> bytes:
    return ("\n".join(",".join(row) for row in rows) + "\n").encode("utf-8", "surrogatepass")


def odd_cells(rng: Rng, content: bytes) -> bytes:
    """A table of which a few cells hold what nobody meant to give."""
    rows = _rows(content)
    for _ in range(int(rng.integers(1, 4))):
        row = rows[int(rng.integers(len(rows)))]
        row[int(rng.integers(len(row)))] = str(rng.choice(ODD_VALUES))
    return _table(rows)


def odd_columns(rng: Rng, content: bytes) -> bytes:
    """A table with a column left out, doubled, of one value, or in another unit than its name says."""
    rows = _rows(content)
    column, kind, odd = int(rng.integers(len(rows[0]))), int(rng.integers(4)), str(rng.choice(ODD_VALUES))
    for number, row in enumerate(rows):
        if kind == 0:
            del row[column]
        elif kind == 1:
            row.insert(column, row[column])
        elif kind == 2 and number:
            row[column] = odd
        elif kind == 3 and number and re.fullmatch(r"-?\d+\.\d+", row[column]):
            row[column] = repr(float(row[column]) * 57.29577951308232)
    return _table(rows)


def odd_toml(rng: Rng, content: bytes) -> bytes:
    """A document of which a few keys have odd values, or are left out, renamed or there twice."""
    for _ in range(int(rng.integers(1, 4))):
        keys = list(_KEY.finditer(content))
        if not keys:
            break
        key, kind = keys[int(rng.integers(len(keys)))], int(rng.integers(8))
        new = key[0] + b"\n" + key[0] if kind == 0 else b"" if kind == 1 else b"unknown" + key[2] + key[3]
        if kind > 2:
            new = key[1] + key[2] + str(rng.choice(ODD_TOML)).encode()
        content = content[: key.start()] + new + content[key.end() :]
    return content


def plausible(rng: Rng, content: bytes) -> bytes:
    """A file of which a few decimals are larger, smaller, negative, zero, or another's: it can be read, mostly."""
    for _ in range(int(rng.integers(1, 4))):
        found = list(_DECIMAL.finditer(content))
        if not found:
            break
        one, other = (found[int(k)] for k in rng.integers(len(found), size=2))
        factor = float(rng.choice([-1.0, 0.0, 2.0, 1e-6, 57.29577951308232, 1e3]))
        new = other[0] if rng.random() < 0.2 else repr(float(one[0]) * factor).encode()
        content = content[: one.start()] + new + content[one.end() :]
    return content


def odd_json(rng: Rng, content: bytes) -> bytes:
    """A JSON document of which one value is another."""
    tree: Any = json.loads(content)
    places: list[tuple[Any, Any]] = []
    waiting = [tree]
    while waiting:
        node = waiting.pop()
        items = node.items() if isinstance(node, dict) else enumerate(node) if isinstance(node, list) else ()
        for key, value in items:
            places.append((node, key))
            waiting.append(value)
    odd: list[Any] = [None, -1, 1e308, "x" * 5000, "../../etc/passwd", [], {}, [[1]], True, 0.0, float("nan"), 10**400]
    node, key = places[int(rng.integers(len(places)))]
    node[key] = odd[int(rng.integers(len(odd)))]
    return json.dumps(tree).encode()


ANYWHERE: tuple[Change, ...] = (*MUTATIONS.values(), lambda rng, content: mutated(content, rng))
SPOILING: dict[str, tuple[Change, ...]] = {
    ".csv": (odd_cells, odd_cells, odd_columns, plausible, plausible),
    ".toml": (odd_toml, odd_toml, plausible, plausible),
    ".json": (odd_json, odd_json, odd_json, plausible),
    ".py": (plausible,),
}


def spoiled(rng: Rng, name: str, content: bytes) -> bytes:
    """The bytes of a file after one damage; one in three is of a kind that any file may suffer."""
    ways = ANYWHERE if rng.random() < 0.33 else SPOILING[Path(name).suffix]
    with warnings.catch_warnings(), np.errstate(all="ignore"):
        warnings.simplefilter("ignore")
        return ways[int(rng.integers(len(ways)))](rng, content)


# ---- spoiled files through the commands -----------------------------------------------------------------------------

READERS = ("calibrate", "diagnose", "check", "redundancy", "validate", "plan", "report", "correct", "compare", "out")


def read_by(command: str, cell: Path, other: Path, out: Path) -> tuple[object, ...]:
    """The arguments of a command that reads a dataset, with its outputs below `out`."""
    told: dict[str, tuple[object, ...]] = {
        "report": ("report", cell, "--out", out / "report.html"),
        "correct": ("correct", cell, "--joints", cell / "poses.csv", "--out", out / "corrected.csv"),
        "compare": ("compare", other, cell),
        "out": ("calibrate", cell, "--out", out / "robot.toml", "--model-out", out / "model.json",
                    "--residuals", out / "residuals.csv", "--session", out / "session.json"),
    }  # fmt: skip
    return told.get(command, (command, cell, "--json"))


@pytest.mark.thorough
@settings(max_examples=4 * EXAMPLES)
@given(
    name=st.sampled_from(["dataset.toml", "robot.toml", "poses.csv", "points.csv"]),
    command=st.sampled_from(READERS),
    seed=SEEDS,
)
def test_a_spoiled_dataset_is_answered_or_refused_in_one_line(good: Path, name: str, command: str, seed: int) -> None:
    with scratch() as folder:
        cell = folder / "cell"
        shutil.copytree(good / "cell", cell)
        (cell / name).write_bytes(spoiled(np.random.default_rng(seed), name, (cell / name).read_bytes()))
        result = ran(folder, *read_by(command, cell, good / "cell", folder / "out"), outputs=(folder / "out",))
    assert not result.trouble, result


@pytest.mark.thorough
@settings(max_examples=2 * EXAMPLES)
@given(name=st.sampled_from(["model.json", "own_effect.py", "measured.csv"]), seed=SEEDS)
def test_a_spoiled_file_beside_the_dataset_is_answered_or_refused(good: Path, name: str, seed: int) -> None:
    with scratch() as folder:
        path, out = folder / name, folder / "out"
        path.write_bytes(spoiled(np.random.default_rng(seed), name, (good / name).read_bytes()))
        arguments: tuple[object, ...] = {
            "model.json": ("validate", good / "cell", "--model", path, "--json"),
            "own_effect.py": ("diagnose", good / "cell", "--effects-file", path, "--json"),
            "measured.csv": ("import", out, "--robot", "rb5", "--joints", path),
        }[name]
        result = ran(folder, *arguments, outputs=(out,), lists_faults=name == "measured.csv")
    assert not result.trouble, result


@pytest.mark.thorough
@settings(max_examples=EXAMPLES)
@given(seed=SEEDS)
def test_a_spoiled_session_is_opened_or_refused_in_one_line(good: Path, seed: int) -> None:
    """As `serve --session` opens it, up to the page."""
    from inspector.session.measuring import open_session
    from inspector.session.reopening import opening, reopened
    from inspector.session.session_file import load_session

    with scratch() as folder:
        path, said = folder / "session.json", ""
        path.write_bytes(spoiled(np.random.default_rng(seed), path.name, (good / path.name).read_bytes()))
        try:
            saved, _ = opening(load_session(path), good)
            reopened(open_session(saved.folder), saved.session)
        except CalibError as error:
            said = str(error)
    assert len(said.splitlines()) <= 1
    assert len(said) <= MOST_CHARACTERS


@cache
def scanned() -> tuple[np.ndarray, dict[str, bytes]]:
    """The apex of a small scene, and its scan in each format."""
    scene = make_scene(np.random.default_rng(1), 1500, field_mm=90)
    return scene.apex_mm, {name: write(scene.scan.points_mm) for name, write in WRITERS.items()}


@pytest.mark.thorough
@settings(max_examples=2 * EXAMPLES)
@given(name=st.sampled_from([*WRITERS]), way=st.sampled_from([*MUTATIONS, *CLOUDS]), seed=SEEDS)
def test_a_spoiled_scan_is_a_corner_a_reason_or_one_line(name: str, way: str, seed: int) -> None:
    rng = np.random.default_rng(seed)
    apex_mm, files = scanned()
    with scratch() as folder, np.errstate(all="ignore"):
        content = WRITERS[name](CLOUDS[way](rng)) if way in CLOUDS else MUTATIONS[way](rng, files[name])
        write_scanned(folder / "cell", f"p1{Path(name).suffix}", content)
        result = ran(folder, "corners", folder / "cell", "--processes", 1, "--json")
    assert not result.trouble, result
    if way == "none":
        assert np.linalg.norm(np.array(json.loads(result.out)["corners"][0]["xyz_mm"]) - apex_mm) < 1.0


def write_scanned(folder: Path, scan: str, content: bytes) -> None:
    """A dataset of one pose, with its scan."""
    (folder / "scans").mkdir(parents=True)
    (folder / "dataset.toml").write_text(SCANNED)
    (folder / "robot.toml").write_text(robot_to_toml(builtin_robot("rb5")))
    (folder / "scans" / scan).write_bytes(content)
    joints = ",".join(f"q{k}_deg" for k in range(1, 7))
    (folder / "poses.csv").write_text(f"pose,role,scan,{joints}\np1,reference,{scan},10,20,30,40,50,60\n")


# ---- datasets that are well formed and odd --------------------------------------------------------------------------


@pytest.mark.thorough
@settings(max_examples=2 * EXAMPLES)
@given(
    joints=st.sampled_from([1, 1, 2, 3, 4, 6, 7]),
    poses=st.sampled_from([1, 2, 3, 4, 6, 9, 15, 30]),
    noise_mm=st.sampled_from([0.0, 0.05, 0.05, 1e4]),
    declared_mm=st.sampled_from([None, 1e-6, 0.05, 30.0]),
    motion=st.sampled_from(["free", "free", "one joint still", "all joints still", "hundreds of turns"]),
    command=st.sampled_from(READERS),
    seed=SEEDS,
)
def test_an_odd_dataset_is_answered_or_refused_in_one_line(
    joints: int, poses: int, noise_mm: float, declared_mm: float | None, motion: str, command: str, seed: int
) -> None:
    rng = np.random.default_rng(seed)
    robot = random_arm(rng, joints, prismatic=int(rng.choice([-1, 0])))
    q = rng.uniform(-2.0, 2.0, (poses, joints)) * (40.0 if motion == "hundreds of turns" else 1.0)
    if motion == "one joint still":
        q[:, 0] = 0.3
    elif motion == "all joints still":
        q[:] = q[0]
    xyz_mm = target_points(robot, q) + noise_mm * rng.normal(size=(poses, 3))
    table = pd.DataFrame({"pose": [f"p{k}" for k in range(poses)]})
    table["role"] = rng.choice(["train", "train", "test"], poses) if rng.random() < 0.8 else "test"
    table.loc[int(rng.integers(poses)), "role"] = "reference"
    table["setup"] = rng.choice(["a", "b"], poses) if rng.random() < 0.3 else "a"
    for k, joint in enumerate(robot.joints):
        unit, values = ("deg", np.degrees(q[:, k])) if joint.is_revolute else ("mm", q[:, k])
        table[f"q{k + 1}_{unit}"] = values
    for name in ("temperature_c", "time_s", "payload_kg", "torque1_nm", "link_q1_deg", "approach9", "q9_deg", "hour"):
        if rng.random() < 0.2:
            table[name] = 20.0 if rng.random() < 0.5 else rng.normal(size=poses) * 10.0 ** rng.uniform(-9, 9)
    with scratch() as folder:
        cell = folder / "cell"
        cell.mkdir()
        sigma = "" if declared_mm is None else f"point_sigma_mm = {declared_mm}\n"
        head = 'format = 1\nname = "odd"\nrobot = "robot.toml"\nposes = "poses.csv"\npoints = "points.csv"\n'
        (cell / "dataset.toml").write_text(f"{head}[scanner]\n{sigma}")
        (cell / "robot.toml").write_text(robot_to_toml(robot))
        table.to_csv(cell / "poses.csv", index=False)
        points = pd.DataFrame(xyz_mm, columns=["x_mm", "y_mm", "z_mm"])
        points.insert(0, "pose", table["pose"])
        points[: poses if rng.random() < 0.9 else (poses + 1) // 2].to_csv(cell / "points.csv", index=False)
        result = ran(folder, *read_by(command, cell, cell, folder / "out"), outputs=(folder / "out",))
    assert not result.trouble, result


# ---- files that mean what they meant --------------------------------------------------------------------------------


def _columns_in_another_order(rng: Rng, content: bytes) -> bytes:
    order = [int(k) for k in rng.permutation(len(_rows(content)[0]))]
    return _table([[row[k] for k in order] for row in _rows(content)])


def _zeros_behind_decimals(rng: Rng, content: bytes) -> bytes:
    return re.sub(rb"(?<=\d)\.(\d+)(?=[,\n])", rb".\g<1>00", content)


def _comments(rng: Rng, content: bytes) -> bytes:
    return b"# a comment\n" + re.sub(rb"(?m)^(\[.*\])$", rb"\n# of a table\n\1  # and beside it", content)


SAME_ANYWHERE: tuple[Change, ...] = (
    lambda rng, content: b"\xef\xbb\xbf" + content,
    lambda rng, content: content.replace(b"\n", b"\r\n"),
    lambda rng, content: content + b"\n\n",
)
SAME: dict[str, tuple[Change, ...]] = {
    ".csv": (
        _columns_in_another_order,
        _zeros_behind_decimals,
        lambda rng, content: _table([[f'"{cell}"' for cell in row] for row in _rows(content)]),
        lambda rng, content: content.replace(b",", b", "),
        *SAME_ANYWHERE,
    ),
    ".toml": (_comments, lambda rng, content: _KEY.sub(rb"  \1   =   \3", content), *SAME_ANYWHERE),
}
SAME_CASES = [
    (name, way)
    for name in ("dataset.toml", "robot.toml", "poses.csv", "points.csv")
    for way in range(len(SAME[Path(name).suffix]))
]


@pytest.mark.thorough
@pytest.mark.parametrize(("name", "way"), SAME_CASES)
def test_a_file_that_means_the_same_gives_the_same_result(good: Path, tmp_path: Path, name: str, way: int) -> None:
    cell = tmp_path / "cell"
    shutil.copytree(good / "cell", cell)
    content = (cell / name).read_bytes()
    (cell / name).write_bytes(SAME[Path(name).suffix][way](np.random.default_rng(way), content))
    if name.endswith(".toml"):
        text = (cell / name).read_bytes().decode("utf-8-sig")
        assert tomllib.loads(text.replace("\r\n", "\n")) == tomllib.loads(content.decode())
    assert_same(load_dataset(good / "cell"), load_dataset(cell))


# ---- the same arm, told otherwise -----------------------------------------------------------------------------------


def assert_same(one: Dataset, other: Dataset) -> None:
    """The fits of two datasets agree to a thousandth of each parameter's sigma, their errors to 1e-5."""
    a, b = calibrate(one), calibrate(other)
    assert (a.fit.rank, a.fit.converged) == (b.fit.rank, b.fit.converged)
    sigma = np.sqrt(np.diag(a.fit.covariance))
    assert np.max(np.abs(a.fit.x - b.fit.x) / np.where(sigma > 0.0, sigma, 1.0)) < OF_A_SIGMA
    assert b.sigma_mm == pytest.approx(a.sigma_mm, rel=RELATIVE)
    for x, y in ((a.after.train, b.after.train), (a.after.test, b.after.test)):
        assert (x is None) == (y is None)
        assert x is None or y is None or y.rmse_mm == pytest.approx(x.rmse_mm, rel=RELATIVE)


def _elsewhere(dataset: Dataset, rng: Rng, folder: Path) -> Dataset:
    """Each placement of the scanner somewhere else in the room."""
    xyz_mm, setup = dataset.points.xyz_mm.copy(), dataset.poses.setup[dataset.points.pose]
    for name in np.unique(setup):
        moved = random_transform(rng)
        xyz_mm[setup == name] = xyz_mm[setup == name] @ moved[:3, :3].T + moved[:3, 3]
    return with_xyz(dataset, xyz_mm)


def _other_order(dataset: Dataset, rng: Rng, folder: Path) -> Dataset:
    """The rows of both tables in orders of their own."""
    for name in ("poses.csv", "points.csv"):
        head, *rows = (folder / name).read_text().splitlines()
        (folder / name).write_text("\n".join([head, *(rows[int(k)] for k in rng.permutation(len(rows)))]) + "\n")
    return load_dataset(folder)


def _other_names(dataset: Dataset, rng: Rng, folder: Path) -> Dataset:
    """Every name another: of the dataset, the arm, its joints, the poses and the placements."""
    joints = tuple(replace(joint, name=f"Achse {9 - k}") for k, joint in enumerate(dataset.robot.joints))
    ids = tuple(f"Ω {(7 * k) % 1009} ‹{k}›" for k in range(len(dataset.poses)))
    setup = np.array([f"Halle {name}" if name else "" for name in dataset.poses.setup])
    poses = replace(dataset.poses, ids=ids, setup=setup)
    return replace(dataset, name="ein anderer", robot=replace(dataset.robot, name="x", joints=joints), poses=poses)


def _other_units(dataset: Dataset, rng: Rng, folder: Path) -> Dataset:
    """Radians and metres in the tables, as `[units]` and the columns' names say."""
    with (folder / "dataset.toml").open("a") as file:
        file.write('\n[units]\nangle = "rad"\nlength = "m"\n')
    for name in ("poses.csv", "points.csv"):
        table = pd.read_csv(folder / name, dtype={"pose": str, "setup": str}, keep_default_na=False)
        for column in [c for c in table.columns if c.endswith(("_deg", "_mm"))]:
            values, angle = table.pop(column), column.endswith("_deg")
            new = column.removesuffix("_deg" if angle else "_mm") + ("_rad" if angle else "_m")
            table[new] = np.radians(values) if angle else values / 1000.0
        table.to_csv(folder / name, index=False)
    return load_dataset(folder)


@pytest.mark.thorough
@settings(max_examples=EXAMPLES)
@given(
    otherwise=st.sampled_from([_elsewhere, _other_order, _other_names, _other_units]),
    arm=st.sampled_from(["rb5", "panda"]),
    setups=st.sampled_from([1, 2]),
    effects=st.sampled_from([(), (("joint_compliance", 4.0),), (("transmission_error", 3.0),)]),
    seed=SEEDS,
)
def test_an_arm_told_otherwise_has_the_same_fit(
    otherwise: Callable[[Dataset, Rng, Path], Dataset],
    arm: str,
    setups: int,
    effects: tuple[tuple[str, float], ...],
    seed: int,
) -> None:
    rng = np.random.default_rng(seed)
    made = simulate_dataset(arm, rng=rng, effects=effects, poses=60, noise_mm=0.05, setups=setups)
    with scratch() as folder:
        write_dataset(made.dataset, folder)
        dataset = load_dataset(folder)
        assert_same(dataset, otherwise(dataset, rng, folder))


# ---- a promise that is broken is found ------------------------------------------------------------------------------
