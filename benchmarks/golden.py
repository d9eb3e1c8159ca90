"""Compare what the program says of the sample data with tests/golden, or write it there anew.

    python benchmarks/golden.py [NAME ...] [--renew] [--kernels]

Without options every difference beyond its tolerance is a line, "hidden_effect_b: diagnose.verdict 'named' ->
'unexplained'", words first, and the exit code 1 where there is one; tests/test_golden.py asks the same. --renew writes
what differs; what is the same to its tolerance stays as it stood. --kernels runs each dataset by OpenBLAS's kernels for
other processors, whose sums go in other orders, and prints the largest difference over its tolerance: how far another
machine is from failing.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import time
from pathlib import Path

for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ.setdefault(_name, "1")
ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

from tests.support import golden  # noqa: E402

KERNELS = ("Prescott", "Nehalem", "Sandybridge", "Haswell", "SkylakeX")


def by_kernel(name: str, kernel: str) -> golden.Entries:
    """The result of a process whose OpenBLAS takes this kernel."""
    environment = {**os.environ, "OPENBLAS_CORETYPE": kernel}
    ran = subprocess.run(
        [sys.executable, __file__, name, "--print"],
        env=environment,
        stdout=subprocess.PIPE,
        check=True,
        text=True,
    )
    entries: golden.Entries = json.loads(ran.stdout)
    return entries


def main() -> int:
    """Compare, renew, or measure."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("names", nargs="*", metavar="NAME", help=f"of {', '.join(golden.NAMES)}; default: all")
    parser.add_argument("--renew", action="store_true", help="write what differs")
    parser.add_argument("--kernels", action="store_true", help="how much other processors' sums change")
    parser.add_argument("--print", action="store_true", help=argparse.SUPPRESS)
    options = parser.parse_args()
    unknown = set(options.names) - set(golden.NAMES)
    if unknown:
        parser.error(f"no sample dataset {', '.join(sorted(unknown))}; there are {', '.join(golden.NAMES)}")
    changed = False
    for name in options.names or golden.NAMES:
        began = time.perf_counter()
        if options.print:
            print(golden.text_of(golden.observed(name)))
            continue
        stored = golden.load(name) if golden.path_of(name).exists() else {}
        if options.kernels:
            others = [by_kernel(name, kernel) for kernel in KERNELS]
            share, place = golden.largest_share(stored, others)
            words = {line for other in others for line in golden.differences(name, stored, other)}
            print(f"{name}: at most {share:.2g} of a tolerance, at {place}; {len(words)} beyond", flush=True)
            print("".join(f"  {line}\n" for line in sorted(words)), end="")
            changed = changed or bool(words)
            continue
        now = golden.observed(name)
        lines = golden.differences(name, stored, now)
        seconds = time.perf_counter() - began
        print("\n".join(lines or [f"{name}: {len(now)} entries, all the same ({seconds:.1f} s)"]), flush=True)
        changed = changed or bool(lines)
        if options.renew and lines:
            golden.path_of(name).write_text(golden.text_of(golden.renewed(stored, now)))
    return int(changed and not options.renew)


if __name__ == "__main__":
    sys.exit(main())
