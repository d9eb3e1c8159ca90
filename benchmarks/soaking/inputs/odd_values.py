"""Values and bytes that nobody meant to give."""

from __future__ import annotations

import numpy as np

Rng = np.random.Generator

NUMBERS = (
    "nan", "inf", "-inf", "1e308", "-1e308", "1e-320", "1e999", "0", "-0", "1e9", "-1e5", "0.1", "1e-9", "3", "-1",
    "9" * 400, "9" * 5000, "1_0", "1,5", "0x10", "１２", "٣", "1e", "--1", "+5", "1.2.3", "5 mm", "1/0",
)  # fmt: skip
WORDS = (
    "", " ", "\t", "=1+1", "@SUM(A1)", "'=1", "a" * 5000, "\u202eevil", "\ufeff", "\x00", "\x1b[31m", "null",
    "true", "../../../etc/passwd", "%s%n", "{}", "<b>x</b>", "é", "日本", "train", "test", "reference", "p01",
    '"', "'", ",", ";",
)  # fmt: skip


def number(rng: Rng) -> str:
    """An odd number, or one as good as any."""
    return str(rng.choice(NUMBERS)) if rng.random() < 0.85 else f"{rng.normal(0, 100):.6g}"


def cell(rng: Rng) -> str:
    """An odd cell of a table."""
    return number(rng) if rng.random() < 0.6 else str(rng.choice(WORDS))


def at(rng: Rng, count: int) -> int:
    """Random index into something of this length."""
    return int(rng.integers(max(count, 1)))


def cut(rng: Rng, content: bytes) -> bytes:
    """The beginning of the bytes, cut at random."""
    return content[: at(rng, len(content))]


def flipped(rng: Rng, content: bytes) -> bytes:
    """The bytes with one to twenty bits flipped."""
    out = bytearray(content)
    for _ in range(int(rng.integers(1, 20))):
        out[at(rng, len(out))] ^= 1 << int(rng.integers(8))
    return bytes(out)


def piece(rng: Rng, content: bytes) -> bytes:
    """A piece left out, doubled or moved."""
    start, other = sorted((at(rng, len(content)), at(rng, len(content))))
    part, rest = content[start:other], content[:start] + content[other:]
    where = at(rng, len(rest))
    return (rest, content[:other] + part + content[other:], rest[:where] + part + rest[where:])[rng.integers(3)]


def recoded(rng: Rng, content: bytes) -> bytes:
    """The text in another encoding, or with bytes that UTF-8 does not have."""
    text = content.decode("utf-8", "replace")
    kind = int(rng.integers(5))
    if kind < 3:
        return text.encode(("utf-16", "utf-32", "utf-16-be")[kind])
    where = at(rng, len(content))
    return content[:where] + (b"\xe9\xff" if kind == 3 else b"\x00\x00") + content[where:]


def nothing(rng: Rng, content: bytes) -> bytes:
    """An empty file, one of blanks, one line, or one of random bytes."""
    return (b"", b"\n" * 50, content.split(b"\n")[0] + b"\n", rng.bytes(500))[rng.integers(4)]


def odd_number(rng: Rng, content: bytes) -> bytes:
    """The text with one to three numbers replaced."""
    import re

    for _ in range(int(rng.integers(1, 4))):
        found = list(re.finditer(rb"(?<![\w.])-?\d+\.?\d*(?:e-?\d+)?", content))
        if not found:
            break
        match = found[at(rng, len(found))]
        content = content[: match.start()] + number(rng).encode() + content[match.end() :]
    return content


def lines(rng: Rng, content: bytes) -> bytes:
    """The text with one to three lines left out, doubled, swapped, or inserted."""
    rows = content.split(b"\n")
    for _ in range(int(rng.integers(1, 4))):
        i, j = at(rng, len(rows)), at(rng, len(rows))
        kind = int(rng.integers(4))
        if kind == 0:
            del rows[i : i + int(rng.integers(1, 4))]
        elif kind == 1:
            rows.insert(i, rows[i])
        elif kind == 2:
            rows[i], rows[j] = rows[j], rows[i]
        else:
            rows.insert(i, cell(rng).encode("utf-8", "surrogatepass"))
        rows = rows or [b""]
    return b"\n".join(rows)


BYTES = {
    "cut": cut,
    "flipped bits": flipped,
    "a piece": piece,
    "another encoding": recoded,
    "nothing": nothing,
    "odd numbers": odd_number,
    "lines": lines,
}
"""By name: what any file may suffer. What it means is changed, mostly."""


def byte_order_mark(rng: Rng, content: bytes) -> bytes:
    """The text behind a byte order mark, as editors on Windows write it."""
    return b"\xef\xbb\xbf" + content


def windows_lines(rng: Rng, content: bytes) -> bytes:
    """Other line ends."""
    return content.replace(b"\n", b"\r\n")


def blank_lines(rng: Rng, content: bytes) -> bytes:
    """Further empty lines at the end."""
    return content + b"\n" * int(rng.integers(1, 5))
