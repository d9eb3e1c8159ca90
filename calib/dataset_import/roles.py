"""Which poses a fit sees: as the user's table says, else a choice that is told."""

from __future__ import annotations

from collections.abc import Sequence

_WORDS = {
    "reference": "reference", "ref": "reference", "train": "train", "training": "train", "calibration": "train",
    "fit": "train", "test": "test", "testing": "test", "validation": "test", "verification": "test", "check": "test",
}  # fmt: skip
_ENOUGH = 25  # poses, so that some can be kept apart
_EVERY = 4


def roles_of(given: Sequence[str] | None, count: int, first: int = 0) -> tuple[list[str], str]:
    """A role for each pose, exactly one reference, and how they were chosen; "" where the table tells all.

    first  # the first pose that was measured
    """
    if given is None:
        roles = ["test" if count >= _ENOUGH and i % _EVERY == _EVERY - 1 else "train" for i in range(count)]
        kept = (
            f"every fourth is kept apart to test ({roles.count('test')} of {count})"
            if "test" in roles
            else "none is kept"
        )
        roles[first] = "reference"
        return roles, f"no column role: the first pose with a point is the reference, {kept}"
    roles = [_WORDS.get(word.strip().lower(), word.strip()) for word in given]
    if "reference" in roles or not roles:
        return roles, ""
    roles[roles.index("train") if "train" in roles else first] = "reference"
    return roles, "column role names no reference pose: the first for training is taken"
