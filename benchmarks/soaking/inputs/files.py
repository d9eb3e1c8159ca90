"""Spoiled inputs of every kind, each given to a command; and inputs that mean the same, to give the same result.

A case is a kind of file, what is done to it, and the command that reads it, all drawn from the seed and its number.
"""

from __future__ import annotations

import shutil
from collections.abc import Callable
from functools import lru_cache
from pathlib import Path

import numpy as np
import tomli_w  # noqa: F401  (loaded before the first case is timed)

from soaking.inputs import documents, odd_cells, scan_files, tables, zips
from soaking.inputs.commands import Ran, ran
from soaking.inputs.compared import difference, difference_of_texts
from soaking.inputs.material import ROBOTS
from soaking.inputs.odd_values import Rng
from soaking.record import Result

Changes = dict[str, Callable[[Rng, bytes], bytes]]
SAME_SHARE = 0.25  # of the cases: those that mean what they meant

KINDS: dict[str, int] = {
    "dataset.toml": 18, "robot.toml": 18, "poses.csv": 26, "points.csv": 22,
    **{f"scan {name}": 3 for name in scan_files.NAMES},
    "arm.urdf": 10, "arm.xacro": 2, "arm.xml": 7, "arm.yaml": 3, "arm.conf": 2, "arm.csv": 3,
    "session.json": 8, "model.json": 10, "own_effect.py": 10, "import.zip": 8, "measured.csv": 8,
    "odd cell": 60,
}  # fmt: skip
"""By kind: how many of 260 cases."""

READERS = {
    "calibrate": 30, "check": 12, "diagnose": 12, "redundancy": 8, "validate": 6, "plan": 8, "report": 5, "correct": 4,
    "everything out": 8, "watch": 4, "compare": 3,
}  # fmt: skip
"""By command that reads a dataset: how often of 100."""


@lru_cache
def turns(seed: int) -> tuple[str, ...]:
    """The kinds in the order of their numbers."""
    kinds = [kind for kind, count in KINDS.items() for _ in range(count)]
    return tuple(kinds[int(k)] for k in np.random.default_rng([seed, 1]).permutation(len(kinds)))


def attempt(number: int, seed: int, material: Path, scratch: Path) -> Result:
    """Run one case."""
    rng = np.random.default_rng([seed, 2, number])
    kind = turns(seed)[number % len(turns(seed))]
    if kind.startswith("scan "):
        return scan_files.attempt(number, rng, kind.removeprefix("scan "), material, scratch)
    if kind == "odd cell":
        return odd_cells.attempt(number, rng, scratch)
    if kind == "import.zip":
        return zips.attempt(number, rng, material, scratch)
    same = rng.random() < SAME_SHARE
    changes, unchanging = _changes(kind)
    name = str(rng.choice([*(unchanging if same else changes)]))
    change = (unchanging if same else changes)[name]
    what, result, wrong = _READ.get(kind, _dataset)(rng, kind, change, same, material, scratch)
    trouble, said = result.trouble, result.said
    if not trouble and same and wrong:
        trouble, said = "wrong", wrong
    return Result(number, kind, f"{name}{' (same)' if same else ''}; {what}", str(result.code), trouble, said)


def _changes(kind: str) -> tuple[Changes, Changes]:
    if kind.endswith(".csv") and kind != "arm.csv":
        rows = {} if kind == "measured.csv" else {"rows in another order": tables.shuffled_rows}
        return tables.CHANGES, tables.SAME | rows
    return {
        ".toml": (documents.TOML_CHANGES, documents.TOML_SAME),
        ".json": (documents.JSON_CHANGES, documents.JSON_SAME),
        ".urdf": (documents.XML_CHANGES, documents.URDF_SAME),
        ".xacro": (documents.XML_CHANGES, documents.XACRO_SAME),
        ".xml": (documents.XML_CHANGES, documents.XML_SAME),
    }.get(Path(kind).suffix, (documents.TEXT_CHANGES, documents.TEXT_SAME))


def _spoil(rng: Rng, path: Path, change: Callable[[Rng, bytes], bytes]) -> None:
    path.write_bytes(change(rng, path.read_bytes()))


# ---- the four files of a dataset ------------------------------------------------------------------------------------


@lru_cache
def _good(material: Path, command: str, *options: str) -> str:
    """Output of a command for the undamaged dataset."""
    result = ran(material / "cell", command, material / "cell", "--json", *options)
    assert result.code in (0, 1), result
    assert not result.trouble, result
    return result.out


def _dataset(
    rng: Rng, kind: str, change: Callable[[Rng, bytes], bytes], same: bool, material: Path, scratch: Path
) -> tuple[str, Ran, str]:
    cell = scratch / "cell"
    shutil.copytree(material / "cell", cell)
    _spoil(rng, cell / kind, change)
    if same:
        command = str(rng.choice(["calibrate", "calibrate", "redundancy", "diagnose"]))
        result = ran(scratch, command, cell, "--json")
        if result.code != 0:
            return command, result, f"exit code {result.code}: {result.said}"
        # The diagnosis draws noise for its poses in their order, so that p-values move; what it says may not.
        keys = ("verdict", "missing", "suspected", "ambiguous_set") if command == "diagnose" else ()
        return command, result, difference_of_texts(_good(material, command), result.out, keys)
    command = str(rng.choice([*READERS], p=np.array([*READERS.values()]) / 100))
    out = scratch / "out"
    told: dict[str, tuple[object, ...]] = {
        "report": ("report", cell, "--out", out / "report.html"),
        "correct": ("correct", cell, "--joints", cell / "poses.csv", "--out", out / "corrected.csv"),
        "everything out": ("calibrate", cell, "--out", out / "robot.toml", "--model-out", out / "model.json",
                           "--residuals", out / "residuals.csv", "--session", out / "session.json"),
        "watch": ("watch", material / "cell", cell),
        "compare": ("compare", material / "cell", cell),
    }  # fmt: skip
    arguments = told.get(command, (command, cell, "--json"))
    return command, ran(scratch, *arguments, outputs=(out,)), ""


# ---- robots of other forms ------------------------------------------------------------------------------------------


@lru_cache
def _good_robot(material: Path, kind: str, folder: Path) -> str:
    out = folder / "good.toml"
    result = ran(folder, "convert", material / "robots" / kind, out, *ROBOTS[kind][1], outputs=(out,))
    assert result.code == 0, result
    text = out.read_text()
    out.unlink()
    return text


def _robot(
    rng: Rng, kind: str, change: Callable[[Rng, bytes], bytes], same: bool, material: Path, scratch: Path
) -> tuple[str, Ran, str]:
    import tomllib

    good = _good_robot(material, kind, scratch)
    path, out = (
        scratch / kind,
        scratch / f"out{rng.choice(['.toml', '.urdf', '.yaml']) if not same else '.toml'}",
    )
    path.write_bytes(change(rng, (material / "robots" / kind).read_bytes()))
    result = ran(scratch, "convert", path, out, *ROBOTS[kind][1], outputs=(out,))
    if not same:
        return "convert", result, ""
    if result.code != 0:
        return "convert", result, f"exit code {result.code}: {result.said}"
    return "convert", result, difference(tomllib.loads(good), tomllib.loads(out.read_text()))


# ---- sessions, models, effects, tables of users ---------------------------------------------------------------------


def _session(
    rng: Rng, kind: str, change: Callable[[Rng, bytes], bytes], same: bool, material: Path, scratch: Path
) -> tuple[str, Ran, str]:
    """`serve --session`, up to the page: its fits are done again in place of serving it."""
    import inspector.app.serving as serving
    from inspector.session import measuring
    from inspector.session.reopening import Opening, reopened

    def reopen(path: Path, *, saved: Opening, **_: object) -> None:
        reopened(measuring.open_session(saved.folder), saved.session)

    serving.serve = reopen  # type: ignore[assignment]
    path = scratch / kind
    path.write_bytes(change(rng, (material / kind).read_bytes()))
    result = ran(scratch, "serve", material, "--session", path, "--port", 0)
    return "serve", result, "" if result.code == 0 else f"exit code {result.code}: {result.said}"


def _model(
    rng: Rng, kind: str, change: Callable[[Rng, bytes], bytes], same: bool, material: Path, scratch: Path
) -> tuple[str, Ran, str]:
    path, cell = scratch / kind, material / "cell"
    path.write_bytes(change(rng, (material / kind).read_bytes()))
    if same or rng.random() < 0.5:
        result = ran(scratch, "validate", cell, "--model", path, "--json")
        if result.code != 0:
            return "validate --model", result, f"exit code {result.code}: {result.said}"
        if not same:
            return "validate --model", result, ""
        good = _good(material, "validate", "--model", str(material / kind))
        return "validate --model", result, difference_of_texts(good, result.out)
    out = scratch / "out.csv"
    arguments = ("correct", cell, "--model", path, "--joints", cell / "poses.csv", "--out", out)
    return "correct --model", ran(scratch, *arguments, outputs=(out,)), ""


def _effect(
    rng: Rng, kind: str, change: Callable[[Rng, bytes], bytes], same: bool, material: Path, scratch: Path
) -> tuple[str, Ran, str]:
    path, cell = scratch / kind, material / "cell"
    path.write_bytes(change(rng, (material / kind).read_bytes()))
    if not same and rng.random() < 0.5:
        return "diagnose --effects-file", ran(scratch, "diagnose", cell, "--effects-file", path, "--json"), ""
    options = ("--effect", "fifth_harmonic", "--effects-file")
    result = ran(scratch, "calibrate", cell, "--json", *options, path)
    if not same:
        return "calibrate --effects-file", result, ""
    if result.code != 0:
        return "calibrate --effects-file", result, f"exit code {result.code}: {result.said}"
    good = _good(material, "calibrate", *options, str(material / kind))
    return "calibrate --effects-file", result, difference_of_texts(good, result.out)


def _measured(
    rng: Rng, kind: str, change: Callable[[Rng, bytes], bytes], same: bool, material: Path, scratch: Path
) -> tuple[str, Ran, str]:
    forms = sorted((material / "tables").glob("*.csv"))
    form = forms[int(rng.integers(len(forms)))]
    path, out = scratch / kind, scratch / "made"
    path.write_bytes(change(rng, form.read_bytes()))
    result = ran(scratch, "import", out, "--robot", "rb5", "--joints", path, outputs=(out,), lists_faults=True)
    if not same:
        return f"import {form.stem}", result, ""
    if result.code != 0:
        return f"import {form.stem}", result, f"exit code {result.code}: {result.said}"
    return f"import {form.stem}", result, zips.differs_from_good(material, form, out, scratch / "good")


_READ = {
    **dict.fromkeys(ROBOTS, _robot),
    "session.json": _session,
    "model.json": _model,
    "own_effect.py": _effect,
    "measured.csv": _measured,
}
