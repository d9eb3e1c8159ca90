"""A simulated session written as the dataset folder that an inspector is handed."""

from __future__ import annotations

import zlib
from pathlib import Path

import numpy as np

from tests.support.third_engine.arms import Make
from tests.support.third_engine.cases import Simulated
from tests.support.third_engine.screws import Array


def write_folder(simulated: Simulated, folder: Path, *, freed: bool = False) -> Path:
    """Write the four files; `freed`: the points as they would have been measured without the hidden causes."""
    folder.mkdir(parents=True, exist_ok=True)
    case = simulated.case
    (folder / "dataset.toml").write_text(
        f'format = 1\nname = "{case.kind} {case.number}"\nrobot = "robot.toml"\nposes = "poses.csv"\n'
        f'points = "points.csv"\n\n[scanner]\npoint_sigma_mm = {simulated.declared_mm:.6g}\n',
        encoding="utf-8",
    )
    (folder / "robot.toml").write_text(_robot(simulated), encoding="utf-8")
    (folder / "poses.csv").write_text(_poses(simulated), encoding="utf-8")
    points = simulated.freed_mm if freed else simulated.reading_mm
    (folder / "points.csv").write_text(_points(simulated, points), encoding="utf-8")
    return folder


def _row(row: tuple[float, ...]) -> str:
    a, alpha, d, theta, beta = row
    return f"a_mm = {a:.9g}\nalpha_deg = {alpha:.9g}\nd_mm = {d:.9g}\ntheta_deg = {theta:.9g}\nbeta_deg = {beta:.9g}\n"


def _list(values: tuple[float, ...]) -> str:
    return "[" + ", ".join(f"{value:.9g}" for value in values) + "]"


def _robot(simulated: Simulated) -> str:
    make = simulated.session.make
    rows = _sister_rows(make, simulated)
    out = f'name = "{make.name}"\ngravity_m_s2 = {_list(make.gravity)}\n'
    for j in range(make.n):
        low, high = make.limits[j]
        unit = "mm" if make.slides[j] else "deg"
        out += (
            f'\n[[joints]]\nname = "J{j + 1}"\ntype = "{"prismatic" if make.slides[j] else "revolute"}"\n'
            f"{_row(rows[j])}min_{unit} = {low:.9g}\nmax_{unit} = {high:.9g}\n"
            f"mass_kg = {make.mass_kg[j]:.9g}\ncom_mm = {_list(make.com_mm[j])}\n"
        )
        if not make.slides[j]:
            out += f"gear_ratio = {make.gear:.9g}\n"
    return out + (
        f"\n[tool]\n{_row(rows[-1])}mass_kg = {make.tool_kg:.9g}\ncom_mm = {_list(make.tool_com_mm)}\n"
        f"payload_com_mm = {_list(make.payload_com_mm)}\n"
    )


def _sister_rows(make: Make, simulated: Simulated) -> list[tuple[float, ...]]:
    """Rows of the make or, as the sheet has them then, of its sister: a link or the flange differs by 5 to 20 mm."""
    rows = [tuple(row) for row in make.rows]
    sister = simulated.plan.sister
    if not sister:
        return rows
    rng = np.random.default_rng([zlib.crc32(sister.encode()), *simulated.case.key])
    by = float(rng.choice([-1.0, 1.0]) * np.round(rng.uniform(5.0, 20.0), 1))
    turning = [j for j in range(make.n - 1) if not make.slides[j]]
    j = make.n - 1 if sister == "flange" else int(rng.choice(turning))
    k = 2 if sister == "flange" or abs(rows[j][2]) > abs(rows[j][0]) else 0
    rows[j] = tuple(value + (by if i == k else 0.0) for i, value in enumerate(rows[j]))
    return rows


def _poses(simulated: Simulated) -> str:
    session, columns = simulated.session, simulated.columns
    n = session.make.n
    head = ["pose", "role", *(f"q{j + 1}_{'mm' if session.make.slides[j] else 'deg'}" for j in range(n))]
    payload = np.ptp(session.payload_kg) > 0.0
    head += ["payload_kg"] * bool(payload) + [name for name in ("temperature_c", "time_s") if name in columns]
    sides = "approach" in columns
    head += [f"approach{j + 1}" for j in range(n)] * sides + ["setup"] * (len(session.view) > 1)
    lines = [",".join(head)]
    for k in range(session.count):
        q = np.where(session.make.slides, session.q[k], np.degrees(session.q[k]))
        cells = [f"p{k + 1:03d}", simulated.role[k], *(f"{value:.3f}" for value in q)]
        cells += [f"{session.payload_kg[k]:.6g}"] * bool(payload)
        cells += [f"{getattr(session, name)[k]:.6g}" for name in ("temperature_c", "time_s") if name in columns]
        cells += [f"{side:.0f}" for side in session.approach[k]] * sides
        cells += [f"day{session.setup[k] + 1}"] * (len(session.view) > 1)
        lines.append(",".join(cells))
    return "\n".join(lines) + "\n"


def _points(simulated: Simulated, points: Array) -> str:
    told = simulated.covariance_mm2
    head = "pose,x_mm,y_mm,z_mm" + (",sxx_mm2,sxy_mm2,sxz_mm2,syy_mm2,syz_mm2,szz_mm2" if told is not None else "")
    upper = np.triu_indices(3)
    lines = [head]
    for k, point in enumerate(points):
        more = [] if told is None else told[k][upper].tolist()
        lines.append(",".join([f"p{int(simulated.pose[k]) + 1:03d}", *(f"{value:.9g}" for value in (*point, *more))]))
    return "\n".join(lines) + "\n"
