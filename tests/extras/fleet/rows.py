"""Rows of a fleet, as tests make them."""

from __future__ import annotations

from calib.extras.fleet.row import EffectSize, Row


def row(path: str, *, joint: int | None = None, effect: str = "joint_compliance", **values: object) -> Row:
    """A fleet's row for one arm, with an effect on one joint where one is given."""
    sizes = (EffectSize(effect, joint, f"{effect}.J{joint}.k_rad_per_nm", 2e-5, 1e-6, "rad/Nm", 0.4),)
    told = {
        "name": path, "serial": "", "site": "", "date": "", "about": {}, "robot": "RB5", "joints": 6, "poses": 30,
        "points": 30, "passed": True, "verdict": "adequate" if joint is None else "named",
        "missing": () if joint is None else (effect,), "sizes": () if joint is None else sizes,
    }  # fmt: skip
    return Row(path=path, **{**told, **values})  # type: ignore[arg-type]
