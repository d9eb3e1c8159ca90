"""The figures of a run as a table, and whether all is well."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence

import numpy as np

from soaking.record import Result

MOST_WRONG_NAMES = 0.03  # of the arms: the rate that README tells, at the end of its interval
MOST_SATISFIED = 0.03
MOST_SLOPE_MB = 2.0  # that a page's server may grow by in 1,000 operations
COUNTED = (
    "wrong name",
    "falsely satisfied",
)  # trouble that a share of the arms may have, as any test at a level has


def trouble_line(part: str, result: Result) -> str:
    """Line about one case in trouble."""
    last = result.said.strip().splitlines()[-1:] or [""]
    return f"  {part} {result.number}: {result.trouble}: {result.kind}, {result.what}: {last[0][:300]}"


def table(found: Mapping[str, Sequence[Result]]) -> tuple[list[str], bool]:
    """The lines of the table and the list of what is in trouble, and whether nothing is."""
    lines = [f"{'part':12} {'cases':>6} {'trouble':>8} {'slowest':>9} {'memory':>8}   how they ended"]
    good = True
    for part, results in found.items():
        if not results:
            continue
        troubles = Counter(r.trouble for r in results if r.trouble)
        ends = ", ".join(f"{end or '-'} {n}" for end, n in Counter(r.end for r in results).most_common(8))
        cases = len(results) * (100 if part == "page" else 1)
        lines.append(
            f"{part:12} {cases:6} {sum(troubles.values()):8} {max(r.seconds for r in results):7.1f} s "
            f"{max(r.mb for r in results):5.0f} MB   {ends}"
        )
        if troubles:
            lines.append(f"{'':12} {', '.join(f'{name} {n}' for name, n in troubles.most_common())}")
        more, fine = {"arms": _arms, "page": _page, "files": _files, "clients": _clients}.get(part, _plain)(results)
        lines += [f"{'':12} {line}" for line in more]
        good = good and fine
    bad = [trouble_line(part, r) for part, results in found.items() for r in results if r.trouble]
    return [*lines, *bad[:200], "all is well" if good else "NOT all is well"], good


def _plain(results: Sequence[Result]) -> tuple[list[str], bool]:
    return [], not any(r.trouble for r in results)


def _files(results: Sequence[Result]) -> tuple[list[str], bool]:
    lines = []
    kinds = sorted({r.kind for r in results})
    for kind in kinds:
        of_kind = [r for r in results if r.kind == kind]
        ends = ", ".join(f"{end} {n}" for end, n in sorted(Counter(r.end for r in of_kind).items()))
        same = sum("(same)" in r.what for r in of_kind)
        lines.append(f"{kind:22} {len(of_kind):5}, {same:4} of the same meaning; {ends}")
    return lines, not any(r.trouble for r in results)


def _arms(results: Sequence[Result]) -> tuple[list[str], bool]:
    count = Counter(r.trouble for r in results)
    ratio = np.array([r.figures["over_bound"] for r in results if "over_bound" in r.figures])
    few = all(
        count[name] <= max(1, most * len(results))
        for name, most in zip(COUNTED, (MOST_WRONG_NAMES, MOST_SATISFIED), strict=True)
    )
    lines = [
        f"a wrong name claimed {count['wrong name']}, called clean or named although a cause is missing "
        f"{count['falsely satisfied']}, of {len(results)}"
    ]
    if len(ratio):
        middle, high = np.quantile(ratio, [0.5, 0.99])
        lines.append(
            f"held-out error over the Cramer-Rao bound where nothing is hidden or all is named ({len(ratio)} arms): "
            f"median {middle:.3f}, 99 % below {high:.2f}, most {ratio.max():.2f}"
        )
    return lines, few and not any(r.trouble and r.trouble not in COUNTED for r in results)


def _clients(results: Sequence[Result]) -> tuple[list[str], bool]:
    before = np.array([r.figures.get("honest_s", 0.0) for r in results])
    lines = [
        f"the honest page's slowest answer meanwhile {before.max():.2f} s (median {np.median(before):.3f} s); the "
        f"server's memory after each attack {min(r.mb for r in results):.0f} to {max(r.mb for r in results):.0f} MB"
    ]
    return lines, not any(r.trouble for r in results)


def slope_mb(results: Sequence[Result]) -> float:
    """Growth in MB per 1,000 operations after the first fifth, of the server that did most of them."""
    runs = Counter(r.figures["server"] for r in results)
    longest = runs.most_common(1)[0][0]
    mb = np.array([r.mb for r in sorted(results, key=lambda r: r.number) if r.figures["server"] == longest])
    kept = mb[len(mb) // 5 :]
    return float(np.polyfit(np.arange(len(kept)) / 10, kept, 1)[0]) if len(kept) > 2 else 0.0


def _page(results: Sequence[Result]) -> tuple[list[str], bool]:
    slope = slope_mb(results)
    lines = [f"memory after the first fifth: {slope:+.2f} MB per 1,000 operations (goal: below {MOST_SLOPE_MB:g})"]
    flat = slope < MOST_SLOPE_MB or len(results) < 10
    return lines, flat and not any(r.trouble for r in results)
