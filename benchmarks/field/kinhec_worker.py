"""KinHEC's sequences and the places that its own solvers find, inside KinHEC's environment; the field's command calls
it.

    PYTHON kinhec_worker.py TIER FOLDER OUT.npz

Generates the tier into FOLDER where it is not there yet, and writes for each sequence the flange poses, the board's
poses in the camera's frame, the truth, and each solver's camera on the flange (or board on it), in metres.
"""

from __future__ import annotations

import subprocess
import sys
import warnings
from pathlib import Path

import numpy as np
from kinhec import load_manifest
from kinhec.benchmark import SOLVERS, _keyframe_data
from kinhec.io import load_sequence

warnings.filterwarnings("ignore")
TWICE = ("andreff_scale", "ransac_park_martin")  # variants for tracks of their own


def main() -> None:
    """Generate, solve, write."""
    tier, folder, out = sys.argv[1], Path(sys.argv[2]), sys.argv[3]
    if not (folder / "sequences.parquet").exists():
        words = [sys.executable, "-m", "kinhec", "generate", "--tier", tier, "--out", str(folder)]
        subprocess.run(words, check=True, stdout=subprocess.DEVNULL)
    manifest = load_manifest(folder)
    found: dict[str, np.ndarray] = {}
    for name in manifest["sequence_id"]:
        sequence = load_sequence(folder, name, manifest)
        data = _keyframe_data(sequence, None if sequence.synchronous else sequence.time_offset)
        if data is None or sequence.scale != 1.0:
            continue
        found[f"{name}/flange"], found[f"{name}/seen"] = data[0], data[1]
        found[f"{name}/X"], found[f"{name}/on_flange"] = (
            sequence.X,
            np.array(sequence.manifest["configuration"] == "eye_in_hand"),
        )
        for solver in SOLVERS:
            if solver in TWICE:
                continue
            try:
                found[f"{name}/by {solver}"] = np.asarray(SOLVERS[solver](data, np.random.default_rng(0))["X"])
            except Exception as error:
                print(f"{name}: {solver}: {error}", file=sys.stderr)
    np.savez(out, **found)


if __name__ == "__main__":
    main()
