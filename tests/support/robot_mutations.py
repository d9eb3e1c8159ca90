"""Damage to a robot's files and tables, as editors, transfers and bad will do it."""

from __future__ import annotations

import re

import numpy as np

_WORDS = [
    b"nan", b"inf", b"-inf", b"1e999", b"-1e308", b"1e5", b"", b" ", b"-", b"0x10", b"1_000", b"1,5", "\u0663".encode(),
    b"\0", b"&x;", b"%s", b"{}", b"[", b"]]>", b"<!--", b"-->", b"\xff\xfe", b"\t", b"\n", b"'", b'"', b"null", b"true",
    b"!!python/object", b"../../../etc/passwd", b"a" * 5000, b"*a", b"&a", b"=", b";", b"9" * 400,
]  # fmt: skip
_NUMBER = re.compile(rb"-?\d+\.?\d*(?:e-?\d+)?")


def mutated(content: bytes, rng: np.random.Generator) -> bytes:
    """A file's content with one to three random damages."""
    for _ in range(int(rng.integers(1, 4))):
        content = _damaged(content, rng)
    return content


def _damaged(content: bytes, rng: np.random.Generator) -> bytes:
    kind = int(rng.integers(0, 9))
    if not content:
        return b"x"
    at = int(rng.integers(0, len(content)))
    end = min(len(content), at + int(rng.integers(1, 60)))
    word = _WORDS[int(rng.integers(len(_WORDS)))]
    if kind == 0:
        return content[:at] + content[end:]
    if kind == 1:
        return content[:at] + content[at:end] * int(rng.integers(2, 6)) + content[end:]
    if kind == 2:
        return content[:at] + word + content[at:]
    if kind == 3:
        return content[:at]
    if kind == 4:
        return content[:at] + bytes(rng.integers(0, 256, end - at, dtype=np.uint8)) + content[end:]
    lines = content.splitlines(keepends=True)
    i = int(rng.integers(len(lines)))
    if kind == 5:
        return b"".join(lines[:i] + lines[i + 1 :])
    if kind == 6:
        return b"".join([*lines[: i + 1], lines[i], *lines[i + 1 :]])
    if kind == 7:
        j = int(rng.integers(len(lines)))
        lines[i], lines[j] = lines[j], lines[i]
        return b"".join(lines)
    numbers = list(_NUMBER.finditer(content))
    if not numbers:
        return content + word
    number = numbers[int(rng.integers(len(numbers)))]
    return content[: number.start()] + word + content[number.end() :]
