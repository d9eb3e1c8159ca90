"""Hostile clients at a live server: one after the other, then all at once, while an honest page is served."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator, Sequence
from pathlib import Path

from soaking.record import Result
from soaking.server.hostile_pages import ATTACKS
from soaking.server.live_server import ROOT, HonestPage, LiveServer

DATASET = ROOT / "sample_data" / "hidden_effect_b"
ALL = len(ATTACKS)  # the number of the last case, all of them at once
NORMAL_S = 10.0  # in which the page comes, and a pose is shown, after an attack; alone each takes some 0.05 s
MEANWHILE_S = 60.0  # which nobody waits longer for during one
MORE_MB = 350.0  # that the server may have more than before all attacks: it grows no further from then on
SETTLE_S = 90.0  # for what an attack has left to be over
ALL_S = 300.0  # for all at once to be done


def run(numbers: Sequence[int], out: Path) -> Iterator[Result]:
    """The cases of these numbers, at one server."""
    server = LiveServer(DATASET, out)
    try:
        honest = HonestPage(server.port)
        _attack(server, [ATTACKS[0]])  # loads what is only loaded where something is refused
        time.sleep(3.0)
        first_mb = server.rss_mb()
        for number in numbers:
            attacks = list(ATTACKS) if number == ALL else [ATTACKS[number]]
            name = "all at once" if number == ALL else attacks[0].__name__
            honest.slowest_s()
            began = time.monotonic()
            failure = _attack(server, attacks)
            trouble, said = _settled(server, honest, failure, first_mb)
            figures = {"honest_s": honest.slowest_s(), "answer_s": server.answer_s(), "first_mb": first_mb,
                       "repeats": honest.repeats}  # fmt: skip
            if not trouble and figures["honest_s"] > MEANWHILE_S:
                trouble, said = "hang", f"the honest page waited for {figures['honest_s']:.1f} s"
            what = (attacks[0].__doc__ or "").strip() if number != ALL else f"{len(attacks)} attacks"
            seconds = round(time.monotonic() - began, 2)
            mb = round(server.rss_mb(), 1)
            yield Result(number, name, what, "served", trouble, said, seconds=seconds, mb=mb, figures=figures)
            if honest.failure:
                honest = HonestPage(server.port)
        honest.close()
    finally:
        server.close()


def _attack(server: LiveServer, attacks: list) -> str:
    """Run attacks side by side; what one of them found, as text."""
    found: list[str] = []

    def run_one(attack) -> None:
        try:
            attack(server.port)
        except AssertionError as error:  # a door that stood open
            found.append(f"{attack.__name__}: {error}")
        except Exception as error:
            if len(attacks) == 1:  # beside a flood of connections an attack may be refused
                found.append(f"{attack.__name__}: {type(error).__name__}: {error}")

    threads = [threading.Thread(target=run_one, args=(attack,), daemon=True) for attack in attacks]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(ALL_S)
    return "; ".join(found)


def _settled(server: LiveServer, honest: HonestPage, failure: str, first_mb: float) -> tuple[str, str]:
    """The worst that an attack has left, once all that it began is over; ("", "") where nothing is."""
    if failure:
        return "attack", failure
    end = time.monotonic() + SETTLE_S
    words: tuple[str, str] = ("", "")
    while time.monotonic() < end:
        words = _left(server, honest, first_mb)
        if not words[0] or words[0] in ("died", "traceback", "honest page"):
            return words
        time.sleep(1.0)
    return words


def _left(server: LiveServer, honest: HonestPage, first_mb: float) -> tuple[str, str]:
    if server.process.poll() is not None:
        return "died", server.said()[-3000:]
    log = server.said()
    if "Traceback" in log:
        return "traceback", log[max(0, log.find("Traceback") - 200) :][:3000]
    if honest.failure:
        return "honest page", honest.failure
    try:
        answer_s = server.answer_s()
    except OSError as error:
        return "hang", f"the page does not come: {error}"
    if answer_s > NORMAL_S:
        return "hang", f"the page comes in {answer_s:.1f} s"
    if server.written():
        return "half-written", f"files: {server.written()[:5]}"
    if server.rss_mb() > first_mb + MORE_MB:
        return "memory", f"{first_mb:.0f} MB before, {server.rss_mb():.0f} MB after"
    return "", ""
