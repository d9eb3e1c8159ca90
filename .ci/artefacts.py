"""Builds wheel and sdist from the tracked files, checks their contents, and tries the wheel as a user would.

`.ci/artefacts` calls it. The wheel is installed without extras into a fresh environment, by uv where it is on the PATH,
else by pip; it has to give the right verdict from an empty folder and to stay below 350 MB.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import subprocess
import sys
import tarfile
import tempfile
import time
import tomllib
import venv
import zipfile
from collections.abc import Iterable
from email.parser import HeaderParser
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
STEM = f"{PROJECT['name'].replace('-', '_')}-{PROJECT['version']}"
WHEEL, SDIST = f"{STEM}-py3-none-any.whl", f"{STEM}.tar.gz"
SAMPLES = (
    "hidden_effect_a",
    "hidden_effect_b",
    "hidden_effect_c",
)  # those that nobody else made, points only
PAPERS = {"pyproject.toml", "README.md", "LICENSE", "CHANGELOG.md", "CITATION.cff"}
MOST_MB = 350.0
_BESIDE = Path(sys.executable).with_name("uv")
UV = shutil.which("uv") or (str(_BESIDE) if _BESIDE.is_file() else None)
HEAVY = ("open3d", "trimesh", "viser", "plotly", "PIL", "dask", "matplotlib")


def expect(holds: bool, words: str) -> None:
    """End with words where something does not hold."""
    if not holds:
        sys.exit(f"artefacts: {words}")


def tracked() -> set[str]:
    """The files of the repository, from its root."""
    listed = subprocess.run(["git", "ls-files", "-z"], cwd=ROOT, capture_output=True, check=True, text=True).stdout
    return {name for name in listed.split("\0") if name and (ROOT / name).is_file()}


# ---- building -------------------------------------------------------------------------------------------------------


def build(names: Iterable[str], dist: Path) -> None:
    """The sdist in `dist`, and the wheel that is built from the sdist.

    From a copy of the tracked files: what an earlier build left in build/ would else be taken into a wheel.
    """
    shutil.rmtree(dist, ignore_errors=True)
    with tempfile.TemporaryDirectory() as folder:
        for name in names:
            (Path(folder) / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(ROOT / name, Path(folder) / name)
        for installer in (["--installer", "uv"], []) if UV else ([],):  # pip where uv does not reach the index
            done = subprocess.run(
                [sys.executable, "-m", "build", *installer, "--outdir", dist, folder],
                env=os.environ | {"SOURCE_DATE_EPOCH": "1577836800"},  # the same files give the same bytes
                capture_output=True,
                text=True,
            )
            if done.returncode == 0:
                break
    expect(done.returncode == 0, f"the build failed:\n{done.stdout}{done.stderr}")


# ---- what they hold -------------------------------------------------------------------------------------------------


def check_wheel(wheel: Path, names: set[str]) -> None:
    """It holds the packages' tracked files, the samples, and nothing else."""
    code = {n: n for n in names if n.startswith(("calib/", "inspector/")) and not n.startswith("inspector/pictures/")}
    beside = f"{STEM}.data/data/share/{PROJECT['name']}/"
    samples = {beside + n: n for n in names if n.startswith(tuple(f"sample_data/{sample}/" for sample in SAMPLES))}
    sources = code | samples
    with zipfile.ZipFile(wheel) as archive:
        found = {name for name in archive.namelist() if not name.startswith(f"{STEM}.dist-info/")}
        lacking, unasked = sources.keys() - found, found - sources.keys()
        expect(not lacking, f"the wheel lacks {sorted(lacking)[:5]}")
        expect(not unasked, f"the wheel has {sorted(unasked)[:5]}, which are no tracked files of the packages")
        other = [name for name in sorted(found) if archive.read(name) != (ROOT / sources[name]).read_bytes()]
    expect(not other, f"in the wheel are others than here: {other[:5]}")
    with zipfile.ZipFile(wheel) as archive:
        metadata = HeaderParser().parsestr(archive.read(f"{STEM}.dist-info/METADATA").decode())
        points = archive.read(f"{STEM}.dist-info/entry_points.txt").decode()
        licence = archive.read(f"{STEM}.dist-info/licenses/LICENSE").decode()
    said = {key: metadata[key] for key in ("Name", "Version", "License-Expression", "Requires-Python")}
    told = {key: PROJECT[key.lower()] for key in ("Name", "Version", "Requires-Python")}
    expect(said == told | {"License-Expression": PROJECT["license"]}, f"its metadata say {said}")
    expect(metadata["Description-Content-Type"] == "text/markdown", "README is no Markdown in the metadata")
    expect(str(metadata.get_payload()).startswith("# "), "README is not in the metadata")
    expect(set(metadata.get_all("Provides-Extra", [])) == set(PROJECT["optional-dependencies"]), "other extras")
    expect("inspector = inspector.__main__:command" in points, "no entry point `inspector`")
    expect(licence == (ROOT / "LICENSE").read_text(encoding="utf-8"), "another licence")


def check_sdist(sdist: Path) -> None:
    """It holds what builds the wheel, the papers, and neither tests nor others' data."""
    with tarfile.open(sdist) as archive:
        names = {name.partition("/")[2] for name in archive.getnames()}
    expect(names >= PAPERS, f"the sdist lacks {sorted(PAPERS - names)}")
    tops = {name.partition("/")[0] for name in names if "/" in name}
    expect(
        tops == {"calib", "inspector", "sample_data", f"{STEM.partition('-')[0]}.egg-info"},
        f"it holds {tops}",
    )
    data = {name.split("/")[1] for name in names if name.startswith("sample_data/")}
    expect(data == set(SAMPLES), f"the sdist has the samples {sorted(data)}")


# ---- as a user has them ---------------------------------------------------------------------------------------------


def install(wheel: Path, folder: Path) -> tuple[Path, str]:
    """The wheel without extras in a fresh environment: its folder of programs, and by what it was installed."""
    programs = folder / ("Scripts" if os.name == "nt" else "bin")
    python, by = programs / "python", "uv"
    if UV:
        quiet = [UV, "--quiet"]
        subprocess.run([*quiet, "venv", "--python", sys.executable, folder], check=True)
        done = subprocess.run([*quiet, "pip", "install", "--compile-bytecode", "--python", python, wheel])
    if not UV or done.returncode:
        by = "pip"
        venv.create(folder, clear=True, with_pip=True)
        quiet = [str(python), "-m", "pip", "--quiet", "--disable-pip-version-check"]
        subprocess.run([*quiet, "install", "--no-input", wheel], check=True)
    present = subprocess.run(
        [python, "-c", f"import importlib.util as u; print(*[n for n in {HEAVY} if u.find_spec(n)])"],
        capture_output=True,
        check=True,
        text=True,
    ).stdout.split()
    expect(present == [], f"the core brings {present}")
    return programs, by


def megabytes(folder: Path) -> float:
    """What a folder takes, symbolic links not followed."""
    return sum(path.lstat().st_size for path in folder.rglob("*")) / 1e6


def try_core(wheel: Path) -> None:
    """Install it and ask for a version, a sample, a verdict and a page that is not there."""
    with tempfile.TemporaryDirectory() as folder:
        empty = Path(folder) / "empty"
        empty.mkdir()
        environment = {key: text for key, text in os.environ.items() if not key.startswith(("PYTHON", "INSPECTOR"))}

        start = time.monotonic()
        programs, by = install(wheel, Path(folder) / "venv")
        installed_s = time.monotonic() - start

        def inspector(*arguments: str) -> subprocess.CompletedProcess[str]:
            return subprocess.run(
                [programs / "inspector", *arguments],
                cwd=empty,
                env=environment,
                capture_output=True,
                encoding="utf-8",
            )

        def answer(*arguments: str) -> str:
            done = inspector(*arguments)
            expect(done.returncode == 0, f"inspector {' '.join(arguments)}: {done.stderr}")
            return done.stdout

        answer("sample", "hidden_effect_b")
        found = json.loads(answer("diagnose", "hidden_effect_b", "--json"))
        verdict_s = time.monotonic() - start
        truth = json.loads((ROOT / "tests/truth/hidden_effect_b.json").read_text(encoding="utf-8"))["effects"]
        expect(set(found["missing"]) == set(truth), f"it found {found['missing']}, the truth is {list(truth)}")
        expect(answer("--version").startswith(f"inspector {PROJECT['version']}, Python 3."), "another version")
        listed = {line.split()[0] for line in answer("sample").splitlines()}
        expect(listed == set(SAMPLES), f"`inspector sample` lists {sorted(listed)}")
        refused = inspector("serve", "hidden_effect_b", "--port", "0")
        expect(refused.returncode == 2 and refused.stderr.count("\n") == 1, f"serve: {refused.stderr}")
        expect("[page]" in refused.stderr and not refused.stdout, f"serve says {refused.stderr}")
        expect([path.name for path in empty.iterdir()] == ["hidden_effect_b"], "something else was written")
        size = megabytes(Path(folder) / "venv")
        print(
            f"artefacts: {wheel.name}, {wheel.stat().st_size / 1e6:.1f} MB, installs in {installed_s:.0f} s by "
            f"{by}; {size:.0f} MB with its libraries and their bytecode; first "
            f"verdict after {verdict_s:.0f} s: {', '.join(found['missing'])}, as simulated"
        )
        expect(size <= MOST_MB, f"{size:.0f} MB are more than {MOST_MB:.0f}")


def main() -> None:
    """Build unless told otherwise, check, try."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--built", action="store_true", help="build nothing, take what is in dist/")
    built = parser.parse_args().built
    dist, names = ROOT / "dist", tracked()
    if not built:
        build(names, dist)
    check_wheel(dist / WHEEL, names)
    check_sdist(dist / SDIST)
    try_core(dist / WHEEL)


if __name__ == "__main__":
    main()
