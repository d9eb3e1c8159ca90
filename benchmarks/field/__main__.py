"""The field's common yardstick: what calibration tools reach on the same measurements of arms, and what they say of
them.

    .venv/bin/python benchmarks/field [--only NAME ...] [--tools NAME ...] [--cache DIR] [--jobs N]

Three tracks: arms, causes, hand-eye. Writes one record a tool and set into records/, and from all records there
docs/field.md with its picture. Peers get a virtual environment of their own in --cache, from PyPI; one that does not
install is told as that. `--only none` writes page and picture anew. README.md beside this file says how to add a tool
or a set.
"""

from __future__ import annotations

import argparse
import json
import os
import re
import subprocess
import sys
import tempfile
import venv
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

for variable in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(variable, "1")
HERE = Path(__file__).parent
sys.path[:0] = [str(HERE), str(HERE.parents[1])]

import causes  # noqa: E402
import hand_eye_track  # noqa: E402
from arms import SETS, FieldSet, problem_of  # noqa: E402
from problem import Answer, judged  # noqa: E402
from told import write_page  # noqa: E402

RECORDS = HERE / "records"
LIMIT_S = 600  # of one tool on one set
SHOWN = ("held_out_rms_mm", "exact", "wrong_claim", "median_mm", "refused", "failed")  # of a record, as it is written


@dataclass(frozen=True)
class Tool:
    """A tool as records name it, the module of tools/ that runs it, and the packages of its environment."""

    name: str
    module: str
    packages: tuple[str, ...] = ()  # () where this environment has all


TOOLS = (
    Tool("as delivered", "floors:nominal"),
    Tool("plain DH", "floors:dh"),
    Tool("DH and waves", "floors:waves"),
    Tool("pybotics", "pybotics_fit", ("pybotics",)),
    Tool("robotkinecal", "robotkinecal_fit", ("robotkinecal",)),
    Tool("figaroh", "figaroh_fit", ("figaroh",)),
    Tool("calib, links", "ours:links"),
    Tool("calib, diagnosed", "ours:diagnosed"),
)


def interpreter(tool: Tool, cache: Path) -> Path | RuntimeError:
    """A Python that has the tool's packages, or why they do not install; its environment is made at the first call."""
    if not tool.packages:
        return Path(sys.executable)
    folder = cache / tool.module
    python = folder / "bin" / "python"
    if not (folder / "ready").exists():
        venv.create(folder, with_pip=True, clear=True)
        words = [str(python), "-m", "pip", "install", "-q", *tool.packages]
        done = subprocess.run(words, capture_output=True, text=True, check=False)
        if done.returncode:
            return RuntimeError(f"does not install: {done.stderr.strip().splitlines()[-1][:200]}")
        (folder / "ready").touch()
    return python


def run(tool: Tool, python: Path | RuntimeError, folder: Path) -> Answer:
    """The tool's answer to a problem. Raises RuntimeError with its last words."""
    if isinstance(python, RuntimeError):
        raise python
    out = folder / f"{tool.module}.npz"
    words = [str(python), str(HERE / "worker.py"), tool.module, str(folder), str(out)]
    try:
        done = subprocess.run(words, capture_output=True, text=True, check=False, timeout=LIMIT_S)
    except subprocess.TimeoutExpired:
        raise RuntimeError(f"no end after {LIMIT_S} s") from None
    if done.returncode:
        raise RuntimeError((done.stderr.strip().splitlines() or ["no word"])[-1][:300])
    return Answer.load(out)


def record(track: str, tool: str, of_set: str, found: dict[str, object]) -> None:
    """Write the record of one tool and one set."""
    name = re.sub(r"[^a-z0-9_]+", "-", f"{track} {of_set} {tool}".lower())
    document = {"track": track, "tool": tool, "set": of_set} | found
    (RECORDS / f"{name}.json").write_text(json.dumps(document, indent=1) + "\n", encoding="utf-8")
    print(track, of_set, tool, {key: found[key] for key in SHOWN if key in found}, flush=True)


def measure(field_set: FieldSet, tools: list[Tool], pythons: dict[str, Path | RuntimeError]) -> None:
    """Every tool's record of one set."""
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        problem, measured, digest = problem_of(field_set.load(), folder)
        for tool in tools:
            found: dict[str, object] = {"arm": field_set.arm, "source": field_set.source, "digest": digest}
            try:
                answer = run(tool, pythons[tool.name], folder)
            except RuntimeError as error:
                record("arms", tool.name, field_set.name, found | {"failed": str(error)})
                continue
            found |= {"version": answer.version, "note": answer.note, "cause": answer.cause}
            record("arms", tool.name, field_set.name, found | judged(answer, problem, measured))


def main() -> None:
    """Records of all tools on all sets, then the page."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    names = [*(one.name for one in SETS), *causes.PER_CLASS, "kinhec"]
    parser.add_argument("--only", nargs="+", choices=[*names, "none"], default=names)
    parser.add_argument("--tools", nargs="+", choices=[one.name for one in TOOLS], default=[one.name for one in TOOLS])
    parser.add_argument("--cache", type=Path, default=HERE.parents[1] / "build" / "field")
    parser.add_argument("--jobs", type=int, default=2)
    options = parser.parse_args()
    RECORDS.mkdir(exist_ok=True)
    cache = options.cache.resolve()
    cache.mkdir(parents=True, exist_ok=True)
    sets = [one for one in SETS if one.name in options.only]
    tools = [one for one in TOOLS if one.name in options.tools and sets]
    pythons = {tool.name: interpreter(tool, cache) for tool in tools}
    with ThreadPoolExecutor(options.jobs) as pool:
        list(pool.map(lambda one: measure(one, tools, pythons), sets))
    for engine in (name for name in causes.PER_CLASS if name in options.only):
        record("causes", "calib", engine, causes.shares(engine, options.jobs))
    if "kinhec" in options.only:
        python = interpreter(Tool("KinHEC", "kinhec", ("kinhec",)), cache)
        if isinstance(python, RuntimeError):
            sys.exit(f"kinhec {python}")
        for one in hand_eye_track.records(python, cache, options.jobs):
            record("hand-eye", str(one["tool"]), str(one["set"]), one)
    write_page(RECORDS)


if __name__ == "__main__":
    main()
