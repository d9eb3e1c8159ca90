"""A cell watched by eight check poses: alarms where nothing changed, changes found and named, beside the bound.

Truth and measurements come from MuJoCo (`tests.support.checked_cell`), and so does the bound: the information that the
calibration's training poses and the check poses have together of one change, with every entry of the table and the
scanner's frame unknown beside it, by differences of MuJoCo's own points. *found*: in brackets what the best test of
that one change finds at an alarm rate of 1 %, the scanner where it was, and what it finds where each joint, the tool
and the scanner have an equal share of that rate. *named*: in brackets the same at 0.3 % with the scanner's place free,
as nothing may be blamed on the arm that a moved scanner explains.
"""

from __future__ import annotations

import argparse
import os
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
from promise import half
from scipy.stats import chi2, ncx2
from simulated import unit, ur10e

from calib import calibrate, diagnose, frames
from calib.array_types import Array
from calib.calibration.result import Calibration
from calib.dataset.dataset import About, Dataset
from calib.dataset.files.folder import load_dataset
from calib.dataset.files.robot_toml import builtin_robot
from calib.effects.catalogue.order_steps import Step
from calib.extras.watch.change_models import SCANNER
from calib.extras.watch.plugin import CHECK_POSES
from calib.extras.watch.series import watch_series
from calib.extras.watch.watch import ChangeReport, watch
from calib.extras.watch.watch_criterion import ForWatch, check_poses, usual_changes
from calib.fitting.observations import conditions_at
from calib.kinematics.joint_range import random_poses
from calib.planning.plan import plan_poses
from calib.planning.start import FromFit
from calib.planning.unknowns import unknowns_of_fit
from calib.simulation.simulate import rounded
from tests.support.checked_cell import TOLERANCES, Cell

SLIP_RAD, SHIFT_MM = np.radians(0.02), 0.1
ALARM, BLAME = 0.01, 0.003  # of the bounds
ROBOTS = {"RB5": lambda: builtin_robot("rb5"), "Panda": lambda: builtin_robot("panda"), "UR10e": ur10e}


@dataclass(frozen=True)
class Change:
    """A change of the cell and the name that it should be given."""

    name: str
    what: str
    joint: int | None
    of: Callable[[Cell, np.random.Generator], Cell]


def changes_of(joints: int) -> Iterator[Change]:
    """Each joint's zero and the tool."""
    for j in range(1, joints + 1):
        yield Change(f"joint {j}, 0.02 deg", "joint_zero", j, lambda c, rng, j=j: slipped(c, rng, j))
    yield Change("tool, 0.1 mm", "tool", None, lambda c, rng: c.with_tool_shifted(SHIFT_MM * unit(rng.normal(size=3))))


def slipped(cell: Cell, rng: np.random.Generator, joint: int) -> Cell:
    """The cell with the zero of one joint changed, to either side."""
    return cell.with_changes({f"theta{joint}": rng.choice([-1.0, 1.0]) * SLIP_RAD})


def scanner_moved(cell: Cell, rng: np.random.Generator) -> Cell:
    """The cell with its scanner moved by 0.05 to 10 mm and 0.003 to 0.6 deg."""
    return cell.with_scanner_moved(
        rng.normal(size=3) * 10 ** rng.uniform(-4.3, -2), rng.normal(size=3) * 10 ** rng.uniform(-1.3, 1)
    )


class Bound:
    """The information of a calibration's poses, by differences of MuJoCo's points, in units of the noise."""

    def __init__(self, cell: Cell, base: Dataset) -> None:
        self.cell = cell
        arm, frame = self._columns(base.poses.q[~base.poses.is_test])
        n = arm.shape[1]
        self.information = np.concatenate([arm, frame], axis=1)
        self.information = self.information.T @ self.information
        prior = np.tile(TOLERANCES, n // len(TOLERANCES)) ** -2.0
        self.information[np.arange(n), np.arange(n)] += prior

    def _columns(self, q: Array) -> tuple[Array, Array]:
        """(3 N, P) by the entries of the table, and (3 N, 6) by the frame's motion."""
        cell, step = self.cell, 1e-3 * TOLERANCES
        at = cell.seen_mm(q)
        names = cell.nominal.parameter_names
        by = [
            (cell.with_changes({name: step[k % 5]}).seen_mm(q) - at).ravel() / step[k % 5]
            for k, name in enumerate(names)
        ]
        arms = at - cell.scanner_T_base[:3, 3]
        frame = np.concatenate([np.broadcast_to(np.eye(3), (len(q), 3, 3)), -frames.skew(arms)], axis=-1)
        return np.stack(by, axis=1) / cell.noise_mm, frame.reshape(-1, 6) / cell.noise_mm

    def sigmas(self, q: Array, changed: Cell) -> tuple[float, float]:
        """Sigmas by which check poses at q (N, n) show a change, with the scanner's place known and free."""
        arm, frame = self._columns(q)
        change = (changed.seen_mm(q) - self.cell.seen_mm(q)).ravel() / self.cell.noise_mm
        fixed = self._beside(np.concatenate([arm, frame], axis=1), self.information, change)
        none = np.zeros((len(self.information), 6))
        information = np.block([[self.information, none], [none.T, 1e-9 * np.eye(6)]])
        free = self._beside(np.concatenate([arm, 0.0 * frame, frame], axis=1), information, change)
        return fixed, free

    def _beside(self, columns: Array, information: Array, change: Array) -> float:
        scale = 1.0 / np.sqrt(np.diag(information) + np.sum(columns**2, axis=0))
        both = scale[:, None] * (information + columns.T @ columns) * scale
        mixed = scale * (columns.T @ change)
        return float(np.sqrt(max(change @ change - mixed @ np.linalg.solve(both, mixed), 0.0)))


def power(sigmas: float, alarm: float, freedom: int) -> float:
    """Power of the best test of a change of one number, or of three whose direction is not known."""
    return float(ncx2.sf(chi2.isf(alarm, freedom), freedom, sigmas**2))


def named(seen: ChangeReport, change: Change) -> bool:
    """Whether this change and nothing else is named, without doubt."""
    return seen.verdict == "changed" and [(c.what, c.joint) for c in seen.changes] == [(change.what, change.joint)]


def in_doubt(seen: ChangeReport, change: Change) -> bool:
    """Whether the change is named, or said to be as likely as what is named."""
    name = f"{change.what} {change.joint or ''}".strip()
    return any((c.what, c.joint) == (change.what, change.joint) or name in c.as_well for c in seen.changes)


def told(seen: ChangeReport) -> str:
    """Names of what is said to have changed."""
    return ", ".join(f"{c.what} {c.joint or ''}".strip() for c in seen.changes)


Chooser = Callable[[Cell, Calibration, np.random.Generator], Array]


def random_checks(cell: Cell, base: Calibration, rng: np.random.Generator) -> Array:
    """Eight poses all over."""
    return rounded(cell.nominal, random_poses(cell.nominal, CHECK_POSES, rng=rng))


def planned_checks(cell: Cell, base: Calibration, rng: np.random.Generator) -> Array:
    """Eight of 300 poses all over, as `plan --for watch` chooses."""
    candidates = rounded(cell.nominal, random_poses(cell.nominal, 300, rng=rng))
    poses = conditions_at(base.dataset.poses, candidates)
    unknowns = unknowns_of_fit(base)
    return candidates[check_poses(usual_changes(unknowns, poses, unknowns.rows(poses)), CHECK_POSES)]


def run(
    name: str, choose: Chooser, *, arms: int, unchanged: int, moved: int, each: int, shots: int, tell: bool
) -> list[int]:
    """Counts: false alarms, unchanged cells, moved scanners blamed on the arm, moved scanners."""
    robot = ROBOTS[name]()
    changes = list(changes_of(robot.n_joints))
    counts = {c.name: Counter() for c in changes}
    bounds = {c.name: [] for c in changes}
    alarms, blamed, total, total_moved, found_moved = 0, 0, 0, 0, 0
    for seed in range(arms):
        rng = np.random.default_rng([seed, *name.encode()])
        cell = Cell.drawn(rng, robot)
        dataset = cell.measured(rng, 64, "base")
        base, bound = calibrate(dataset), Bound(cell, dataset)
        planned = choose(cell, base, rng)

        def checks(
            cell: Cell = cell,
            base: Calibration = base,
            rng: np.random.Generator = rng,
            planned: Array = planned,
        ) -> Array:
            q = planned if choose is planned_checks else choose(cell, base, rng)
            return np.repeat(q, shots, axis=0)

        def checked(now: Cell, q: Array, base: Calibration = base, rng: np.random.Generator = rng) -> ChangeReport:
            return watch(base, now.measured(rng, q=q))

        for _ in range(unchanged):
            seen = checked(cell, checks())
            alarms, total = alarms + (seen.verdict != "unchanged"), total + 1
            if tell and seen.verdict != "unchanged":
                print(f"  alarm, arm {seed}: {told(seen)}")
        for _ in range(moved):
            seen = checked(scanner_moved(cell, rng), checks())
            wrong = any(c.what not in ("scanner", "base", "noise") for c in seen.changes if "scanner" not in c.as_well)
            blamed, total_moved = blamed + wrong, total_moved + 1
            found_moved += any(c.what == "scanner" for c in seen.changes)
            if tell and wrong:
                print(f"  blamed, arm {seed}: {seen.headline}")
        for change in changes:
            for _ in range(each):
                q, after = checks(), change.of(cell, rng)
                seen, sigmas = checked(after, q), bound.sigmas(q, after)
                n = 3 if change.what == "tool" else 1
                bounds[change.name].append(
                    (
                        power(sigmas[0], ALARM, n),
                        power(sigmas[0], ALARM / (robot.n_joints + 2), n),
                        power(sigmas[1], BLAME / (robot.n_joints + 1), n),
                        *sigmas,
                    )
                )
                counts[change.name] += Counter(
                    total=1,
                    found=seen.verdict != "unchanged",
                    named=named(seen, change),
                    doubt=in_doubt(seen, change),
                )
    print(
        f"{name}: {alarms} alarms of {total} unchanged cells; scanner moved: {blamed} of {total_moved} blamed on the "
        f"arm, {found_moved} found"
    )
    print(f"  {'':18} found (alone, shared)   named (shared)   named or among those said   sigmas: fixed, free")
    for change in changes if each else ():
        c, b = counts[change.name], np.mean(bounds[change.name], axis=0)
        share = {k: 100.0 * c[k] / c["total"] for k in ("found", "named", "doubt")}
        print(
            f"  {change.name:18} {share['found']:4.0f} ({100 * b[0]:4.0f}, {100 * b[1]:4.0f}) %"
            f"     {share['named']:4.0f} ({100 * b[2]:4.0f}) %"
            f"         {share['doubt']:4.0f} %                     {b[3]:5.1f} {b[4]:5.1f}"
        )
    return [alarms, total, blamed, total_moved]


def promises_held(name: str, arms: int, each: int) -> Counter:
    """Counts by change and whether it was found: changes of the sizes that a plan promises, measured by MuJoCo."""
    robot, counts = ROBOTS[name](), Counter()
    sizes: dict[str, list[float]] = {}
    for seed in range(arms):
        rng = np.random.default_rng([seed, *name.encode(), 7])
        cell = Cell.drawn(rng, robot)
        base = calibrate(cell.measured(rng, 64, "base"))
        offered = conditions_at(base.dataset.poses, planned_checks(cell, base, rng))
        plan = plan_poses(FromFit(base), CHECK_POSES, criterion=ForWatch(), candidates=offered)
        for promise in plan.outcome.changes:
            label = f"zero of joint {promise.joint}" if promise.joint else promise.what
            if promise.size is None:
                counts[label, "never"] += 1
                continue
            sizes.setdefault(label, []).append(promise.size)
            for _ in range(each):
                if promise.joint:
                    after = cell.with_changes({promise.parameter: rng.choice([-1.0, 1.0]) * promise.size})
                else:
                    after = cell.with_tool_shifted(promise.size * unit(rng.normal(size=3)))
                seen = watch(base, after.measured(rng, q=plan.poses.q))
                counts[label, "held" if seen.verdict != "unchanged" else "broken"] += 1
    print(f"{name}: promised 19 of 20; found, at the median promised size; never promised of {arms} arms")
    for label in dict.fromkeys(label for label, _ in counts):
        held, broken, never = (counts[label, word] for word in ("held", "broken", "never"))
        size = np.median(sizes.get(label, [np.nan]))
        told = f"{np.degrees(size):.4f} deg" if label != "tool" else f"{size:.3f} mm"
        print(f"  {label:16} {held:4d} of {held + broken:4d} at {told:>10}, {never:2d} never", flush=True)
    return counts


def recorded(folders: Sequence[Path], diagnosed: bool, draws: int, *, by_time: bool, tell: bool) -> None:
    """Print the alarms of unchanged cells: splits of each recording into a calibration and checks of 8 poses.

    Two splits at random, or by time: the first two thirds, and the first half, are the calibration, and what was
    measured later are the checks, as it is where a cell is watched. A model that says that something changed at a pose
    (a step) holds for what came later: poses from before it, drawn at random, are no later check.
    """
    counts = np.zeros(2, dtype=int)
    for folder in folders:
        dataset, alarms, total = load_dataset(folder), 0, 0
        setup = np.array(list(map(str, dataset.poses.setup)))
        for seed in range(2):
            rng = np.random.default_rng(seed)
            if by_time:
                in_time = np.argsort(dataset.poses.order, kind="stable")
                cut = 2 * len(in_time) // 3 if seed == 0 else len(in_time) // 2
                first, rest = np.sort(in_time[:cut]), np.sort(in_time[cut:])
                rest = rest[np.isin(setup[rest], setup[first])]  # from a place that the calibration knows
            else:
                order = rng.permutation(len(setup))
                first, rest = np.sort(order[: 2 * len(order) // 3]), np.sort(order[2 * len(order) // 3 :])
            part = half(dataset, first, dataset.name)
            base = diagnose(part).calibration if diagnosed else calibrate(part)
            steps = [member.start.first for member in base.model.effects if isinstance(member, Step)]
            # Places in the order of measuring are kept as they were, so that they compare.
            rest = rest[dataset.poses.order[rest] >= max(steps, default=0)]
            names: Counter[str] = Counter()
            of_split = 0
            for _ in range(draws if len(rest) else 0):
                pool = rest[setup[rest] == rng.choice(np.unique(setup[rest]))]
                if len(pool) < 4:
                    continue
                rows = np.sort(rng.choice(pool, min(CHECK_POSES, len(pool)), replace=False))
                seen = watch(base, half(dataset, rows, "check"))
                alarms, total = alarms + (seen.verdict != "unchanged"), total + 1
                if seen.verdict != "unchanged":
                    of_split += 1
                    names[told(seen)] += 1
            if tell:
                model = ", ".join(base.model.family_names) or "link errors"
                print(f"  split {seed}: {of_split} alarms {dict(names)}; model: {model}", flush=True)
        print(f"{dataset.name}: {alarms} alarms of {total} unchanged cells", flush=True)
        counts += alarms, total
    print(f"all: {counts[0]} alarms of {counts[1]} unchanged cells")


DRIFTS = {  # a day, of joints whose zero the eight poses show
    "nothing changes": lambda cell, day: cell,
    "joint 2 drifts 0.001 deg a day": lambda cell, day: cell.with_changes({"theta2": np.radians(1e-3) * day}),
    "joint 3 drifts 0.001 deg a day": lambda cell, day: cell.with_changes({"theta3": np.radians(1e-3) * day}),
    "joint 3 slips 0.01 deg on day 10": lambda cell, day: cell.with_changes({"theta3": np.radians(0.01) * (day >= 10)}),
    "the scanner creeps 0.01 mm a day": lambda cell, day: cell.with_scanner_moved(
        np.zeros(3), np.array([0.01, 0.0, 0.0]) * day
    ),
}
DAYS = 18


def on_day(dataset: Dataset, day: int) -> Dataset:
    """The dataset as measured on a day of March."""
    return replace(dataset, about=About(date=f"2026-03-{day + 1:02d}"))


def over_days(name: str, arms: int) -> None:
    """Print how often a series of daily checks alarms and names what changes."""
    for what, course in DRIFTS.items():
        alarms, named, inside, wrong = 0, 0, 0, 0
        for seed in range(arms):
            rng = np.random.default_rng([seed, len(name)])
            cell = Cell.drawn(rng, ROBOTS[name]())
            base = calibrate(on_day(cell.measured(rng, 64, "before"), 0))
            q = random_checks(cell, base, rng)
            checks = [
                on_day(course(cell, day).measured(rng, name=f"day {day}", q=q), day) for day in range(1, DAYS + 1)
            ]
            found = watch_series(base, checks)
            alarms += not found.is_steady
            joint = int(what.split()[1]) if what.startswith("joint") else None
            if found.change is not None:
                right = found.change.joint == joint if joint else found.change.what == SCANNER
                named += right and not found.change.as_well
                wrong += not right and not (joint and f"joint_zero {joint}" in found.change.as_well)
                truth = np.radians(1e-3) if "drifts" in what else np.radians(0.01) if "slips" in what else 0.01  # mm
                inside += right and abs(found.change.size - truth) < 1.96 * found.change.sigma
        print(
            f"{name}, {what}: {alarms} of {arms} told, {named} by its name alone, {wrong} by another name; "
            f"{inside} within 1.96 sigma"
        )


def main() -> None:
    """Print the rates of each robot."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--arms", type=int, default=20, help="base fits of each robot")
    parser.add_argument("--unchanged", type=int, default=17, help="unchanged cells of each")
    parser.add_argument("--moved", type=int, default=17, help="moved scanners of each")
    parser.add_argument("--each", type=int, default=5, help="of each change, for each base fit")
    parser.add_argument("--robot", choices=ROBOTS, action="append")
    parser.add_argument("--planned", action="store_true", help="check poses as `plan --for watch` chooses them")
    parser.add_argument("--shots", type=int, default=1, help="measurements of each check pose")
    parser.add_argument("--tell", action="store_true", help="print each wrong alarm")
    parser.add_argument("--recordings", type=Path, nargs="+", metavar="FOLDER", help="real recordings, split, instead")
    parser.add_argument("--diagnosed", action="store_true", help="these by the last model of a diagnosis")
    parser.add_argument(
        "--by-time", action="store_true", help="these split by time: what was measured later is checked"
    )
    parser.add_argument("--series", action="store_true", help="daily checks with drifts and steps instead")
    parser.add_argument("--promised", action="store_true", help="changes of the sizes that a plan promises instead")
    args = parser.parse_args()
    if args.promised:
        counts = sum((promises_held(name, args.arms, args.each) for name in args.robot or ROBOTS), Counter())
        held, broken = (sum(n for k, n in counts.items() if k[1] == word) for word in ("held", "broken"))
        print(f"all: found {held} of {held + broken}")
        return
    if args.series:
        for name in args.robot or ROBOTS:
            over_days(name, args.arms)
        return
    if args.recordings:
        recorded(args.recordings, args.diagnosed, draws=20, by_time=args.by_time, tell=args.tell)
        return
    counts = np.zeros(4, dtype=int)
    choose = planned_checks if args.planned else random_checks
    for name in args.robot or ROBOTS:
        counts += run(
            name, choose, arms=args.arms, unchanged=args.unchanged, moved=args.moved, each=args.each,
            shots=args.shots, tell=args.tell,
        )  # fmt: skip
    print(
        f"all: {counts[0]} alarms of {counts[1]} unchanged cells, {counts[2]} of {counts[3]} moved scanners blamed on "
        "the arm"
    )


if __name__ == "__main__":
    main()
