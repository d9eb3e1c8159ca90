"""Zips from anybody: unpacked whole and imported, or refused with a reason and nothing left behind."""

from __future__ import annotations

import io
import stat
import zipfile
from collections.abc import Callable
from functools import lru_cache
from pathlib import Path

from soaking.inputs import odd_values, tables
from soaking.inputs.commands import ran
from soaking.inputs.odd_values import Rng, at
from soaking.record import Result

Files = dict[str, bytes]


def packed(files: Files, *, deflated: bool = True) -> bytes:
    """A zip of these files, in this order."""
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED if deflated else zipfile.ZIP_STORED) as archive:
        for name, content in files.items():
            archive.writestr(name, content)
    return out.getvalue()


def _bytes(rng: Rng, files: Files) -> bytes:
    change = odd_values.BYTES[str(rng.choice(["cut", "flipped bits", "a piece", "nothing"]))]
    return change(rng, packed(files, deflated=bool(rng.integers(2))))


def _inside(rng: Rng, files: Files) -> bytes:
    changes = tables.CHANGES
    name = "measured.csv"
    return packed(files | {name: changes[str(rng.choice([*changes]))](rng, files[name])})


def _robot_inside(rng: Rng, files: Files) -> bytes:
    return packed(files | {"robot.toml": odd_values.BYTES["odd numbers"](rng, files["robot.toml"])})


def _names(rng: Rng, files: Files) -> bytes:
    names = (
        "../evil.csv", "/etc/evil", "C:\\evil", "a\nb.csv", "x" * 300, "/".join("abcdefghij"), "\u202evil.csv", "con",
        "measured.csv/under.csv", " ", ".", "..", "a/./b.csv", "MEASURED.csv", "é.csv",
    )  # fmt: skip
    return packed(files | {str(names[at(rng, len(names))]): files["measured.csv"]})


def _link(rng: Rng, files: Files) -> bytes:
    out = io.BytesIO(packed(files))
    with zipfile.ZipFile(out, "a") as archive:
        info = zipfile.ZipInfo("points.csv")
        info.external_attr = ((stat.S_IFLNK, stat.S_IFIFO, stat.S_IFCHR)[rng.integers(3)] | 0o777) << 16
        archive.writestr(info, "/etc/passwd")
    return out.getvalue()


def _twice(rng: Rng, files: Files) -> bytes:
    import warnings

    out = io.BytesIO(packed(files))
    with zipfile.ZipFile(out, "a") as archive, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        archive.writestr("measured.csv", b"q1,x\n1,2\n")
    return out.getvalue()


def _bomb(rng: Rng, files: Files) -> bytes:
    kind = int(rng.integers(3))
    if kind == 0:
        return packed(files | {"zeros.csv": bytes(30_000_000)})
    if kind == 1:
        return packed(files | {f"f{k}.csv": b"1" for k in range(6000)})
    return packed(files | {"inner.zip": packed({"zeros.csv": b"0" * 5_000_000})})


def _missing(rng: Rng, files: Files) -> bytes:
    kept = list(files)
    del kept[at(rng, len(kept))]
    return packed({name: files[name] for name in kept})


def _further(rng: Rng, files: Files) -> bytes:
    return packed(files | {"further.csv": odd_values.lines(rng, files["measured.csv"]), "arm.urdf": b"<robot/>"})


CHANGES: dict[str, Callable[[Rng, Files], bytes]] = {
    "bytes": _bytes, "bytes again": _bytes, "a table inside": _inside, "a table inside again": _inside,
    "the robot inside": _robot_inside, "names": _names, "a link": _link, "a name twice": _twice,
    "much in little": _bomb, "a file left out": _missing, "further files": _further,
}  # fmt: skip

SAME: dict[str, Callable[[Rng, Files], bytes]] = {
    "stored": lambda rng, files: packed(files, deflated=False),
    "files in another order": lambda rng, files: packed(dict(reversed(files.items()))),
    "in a folder": lambda rng, files: packed({f"all/{name}": content for name, content in files.items()}),
    "litter": lambda rng, files: packed(files | {"__MACOSX/._x": b"x", ".DS_Store": b"x", "Thumbs.db": b"x"}),
}


def attempt(number: int, rng: Rng, material: Path, scratch: Path) -> Result:
    """Run one case."""
    forms = sorted((material / "tables").glob("*.csv"))
    form = forms[int(rng.integers(len(forms)))]
    files = {"robot.toml": (material / "cell" / "robot.toml").read_bytes(), "measured.csv": form.read_bytes()}
    same = rng.random() < 0.2
    chosen = str(rng.choice([*(SAME if same else CHANGES)]))
    path, out = scratch / "given.zip", scratch / "made"
    path.write_bytes((SAME if same else CHANGES)[chosen](rng, files))
    result = ran(scratch, "import", out, "--from", path, outputs=(out,), lists_faults=True)
    trouble, said = result.trouble, result.said
    if not trouble and same:
        wrong = result.said if result.code else differs_from_good(material, form, out, scratch / "good")
        trouble, said = ("wrong", wrong) if wrong else ("", said)
    if not trouble and any(scratch.parent.rglob("evil*")):
        trouble, said = "half-written", "a file outside of the folder"
    return Result(number, "import.zip", f"{chosen}{' (same)' if same else ''}; import", str(result.code), trouble, said)


@lru_cache
def _good(material: Path, form: Path, folder: Path) -> tuple[str, str]:
    result = ran(
        folder.parent,
        "import",
        folder,
        "--robot",
        "rb5",
        "--joints",
        form,
        outputs=(folder,),
        lists_faults=True,
    )
    assert result.code == 0, result
    return (folder / "poses.csv").read_text(), (folder / "points.csv").read_text()


def differs_from_good(material: Path, form: Path, made: Path, folder: Path) -> str:
    """Differences of an imported dataset from that of the undamaged table."""
    poses, points = _good(material, form, folder)
    for name, good in (("poses.csv", poses), ("points.csv", points)):
        if (made / name).read_text() != good:
            return f"{name} is another"
    return ""
