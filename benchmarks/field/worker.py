"""One calibration by one tool, in the tool's own environment; the field's command calls it.

    PYTHON worker.py TOOL FOLDER ANSWER.npz

TOOL is "module" or "module:variant" of `tools/`; its function `calibrate(problem, folder, variant)` returns an
`Answer`. Imports and files are not in its seconds, which are the processor's.
"""

from __future__ import annotations

import sys
import time
from dataclasses import replace
from importlib import import_module
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))

from problem import Problem


def main() -> None:
    """Read the problem, calibrate, write the answer."""
    name, folder, out = sys.argv[1:4]
    module, _, variant = name.partition(":")
    tool = import_module(f"tools.{module}")
    problem = Problem.load(Path(folder))
    began = time.process_time()
    answer = tool.calibrate(problem, Path(folder), variant)
    replace(answer, seconds=time.process_time() - began).save(Path(out))


if __name__ == "__main__":
    main()
