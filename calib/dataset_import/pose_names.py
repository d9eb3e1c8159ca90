"""Which pose each row of another table, or each file, belongs to, by its name.

People write "P 001" in one file and "p1" in the other, trackers put groups before and readings behind a name, scanners
number their files. Names of one list are held against those of the other in ever looser ways; a looser one counts only
where it explains more.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from calib.rendering.numbers import natural_order
from calib.text_files.user_table import UserTable

_PARTS = re.compile(r"\d{1,15}|[^\W\d_]+")
_SUFFIX = re.compile(r"\.[A-Za-z]\w{1,4}$")  # of a file's name in a cell
_FEWEST = 3  # names, by whose numbers alone they may be matched
SAME_NAMES = ("", "spelled otherwise")  # how names that are whole names of poses differ from these
Parts = tuple[str | int, ...]


@dataclass(frozen=True)
class NameMatch:
    """Index of the pose of each name, -1 where it has none, and how the names differ; "" where they are the poses'."""

    pose: tuple[int, ...]
    how: str = ""

    @property
    def count(self) -> int:
        """Number of names that belong to a pose."""
        return sum(index >= 0 for index in self.pose)


def comparable_id(name: str) -> str:
    """A pose's name for comparison with another table's, where 7, 7.0 and 007 are equal, and P1 and p1."""
    try:
        value = float(name)
    except ValueError:
        return name.lower()
    return f"#{int(value)}" if abs(value) < 1e15 and value == int(value) else name


def matched(names: Sequence[str], poses: Sequence[str]) -> NameMatch:
    """The pose that each name belongs to: the same name, spelled otherwise, within a longer one, or its number alone.

    Where one list counts from 0 and the other from 1, names are taken in their order, as many as there are poses.
    """
    by_id = {comparable_id(pose): i for i, pose in enumerate(poses)} | {pose: i for i, pose in enumerate(poses)}
    best = NameMatch(tuple(by_id.get(name, by_id.get(comparable_id(name), -1)) for name in names))
    counted, of_poses = _counted(names), _counted(poses)
    if counted and of_poses and (0 in counted.values()) != (0 in of_poses.values()):
        starts = min(counted.values()), min(of_poses.values())
        are_whole = len(counted) == len(names) == len(poses) == len(of_poses)
        if are_whole and _are_one_run(counted) and _are_one_run(of_poses):
            index = {number - starts[1]: i for i, number in of_poses.items()}
            of_each = tuple(index[counted[i] - starts[0]] for i in range(len(names)))
            return NameMatch(of_each, f"in their order, {names[0]} as {poses[of_each[0]]}")
        if sorted(starts) == [0, 1] and _are_one_run(counted):
            return NameMatch((-1,) * len(names))
    for how, found in (
        (SAME_NAMES[1], _within(names, poses, whole=True)),
        ("by the poses' names within them", _within(names, poses)),
        ("by their numbers", _by_number(counted, of_poses, len(names))),
    ):
        looser = NameMatch(found, how)
        if 2 * looser.count >= len(names) and looser.count > best.count:
            best = looser
    return best


def _parts(name: str) -> Parts:
    return tuple(int(part) if part.isdecimal() else part for part in _PARTS.findall(name.lower()))


def _shape(parts: Parts) -> Parts:
    return tuple("#" if isinstance(part, int) else part for part in parts)


def _within(names: Sequence[str], poses: Sequence[str], *, whole: bool = False) -> tuple[int, ...]:
    """Pose of each name by its words and numbers, which the name has in one run, or alone; -1 where not one fits.

    What else stands in a name has the same words in all that are matched.
    """
    of_pose = {_parts(pose): i for i, pose in enumerate(poses)}
    if len(of_pose) < len(poses):
        return (-1,) * len(names)
    lengths = sorted({len(parts) for parts in of_pose if parts}, reverse=True)
    found: list[tuple[int, Parts]] = []
    for name in names:
        parts = _parts(name)
        each: dict[int, Parts] = {}
        for n in lengths:
            starts = range(1 if whole and len(parts) == n else 0 if whole else len(parts) - n + 1)
            runs = {k: of_pose[parts[k : k + n]] for k in starts if parts[k : k + n] in of_pose}
            each = {index: (*_shape(parts[:k]), "|", *_shape(parts[k + n :])) for k, index in runs.items()}
            if each:
                break
        found.append(next(iter(each.items())) if len(each) == 1 else (-1, ()))
    usual = Counter(rest for index, rest in found if index >= 0).most_common(1)
    return tuple(index if usual and rest == usual[0][0] else -1 for index, rest in found)


def _counted(names: Sequence[str]) -> dict[int, int]:
    """Number of each name, by its index, where it is what names of the usual form differ by; {} where that is more."""
    parts = [_parts(name) for name in names]
    usual = Counter(map(_shape, parts)).most_common(1)
    of_form = {i: each for i, each in enumerate(parts) if _shape(each) == usual[0][0]}
    columns = [column for column in zip(*of_form.values(), strict=True) if len(set(column)) > 1]
    if len(columns) != 1 or len(of_form) < _FEWEST or 2 * len(of_form) < len(names):
        return {}
    return {i: int(number) for i, number in zip(of_form, columns[0], strict=True)}


def _are_one_run(counted: Mapping[int, int]) -> bool:
    numbers = sorted(counted.values())
    return numbers == list(range(numbers[0], numbers[0] + len(numbers)))


def _by_number(counted: Mapping[int, int], of_poses: Mapping[int, int], count: int) -> tuple[int, ...]:
    index = {number: i for i, number in of_poses.items()}
    is_clear = len(index) == len(of_poses)
    return tuple(index.get(counted.get(i, -1), -1) if is_clear else -1 for i in range(count))


def files_of_rows(files: Mapping[str, object], table: UserTable, ids: Sequence[str]) -> tuple[dict[str, int], str]:
    """Row of a table that each file belongs to, by the file's name without suffix, and how that was told.

    By the poses' ids, else by a column with the files' names, else in the order of their names where there are as many.
    """
    stems = list(files)
    best, how, most = NameMatch((-1,) * len(stems)), "", 0
    for name in ("", *table.columns):
        cells = [
            _SUFFIX.sub("", cell.replace("\\", "/").rpartition("/")[2]) for cell in (table.text(name) if name else ids)
        ]
        if len(set(cells)) < len(cells) or (name and not any(_PARTS.fullmatch(cell) is None for cell in cells)):
            continue
        found = matched(stems, cells)
        if found.count > most and len({i for i in found.pose if i >= 0}) == found.count:
            best, most = found, found.count
            how = f"column {name} names them" if name else found.how
        if not name and found.count == len(stems):
            break
    if 2 * most >= min(len(stems), len(ids)) and most:
        return {stem: row for stem, row in zip(stems, best.pose, strict=True) if row >= 0}, how
    if len(stems) == len(ids):
        ordered = sorted(stems, key=natural_order)
        return {stem: row for row, stem in enumerate(ordered)}, f"in the order of their names, {ordered[0]} first"
    return {}, ""
