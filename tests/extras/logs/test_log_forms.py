"""Logs in the layouts that controllers and motion capture write, with values of an arm by another code."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

from inspector.cli.parser import main
from tests.support.public_forms import Array, Form, Q, names, require_import, text
from tests.support.recorded_run import NAMES, robot_toml, tool_mm


def stop_and_go() -> tuple[Array, Array]:
    """Times (N,), s, and joints (N, 6): 1.2 s at each pose, 0.8 s on the way to the next."""
    t = np.arange(0.0, 2.0 * len(Q) - 0.8, 0.02)
    k = (t / 2.0).astype(int)
    share = np.clip((t - 2.0 * k - 1.2) / 0.8, 0.0, 1.0)[:, None]
    q = Q[k] + (3.0 * share**2 - 2.0 * share**3) * (Q[np.minimum(k + 1, len(Q) - 1)] - Q[k])
    return t, q


T, MOVING = stop_and_go()
SEEN = tool_mm(MOVING) + np.random.default_rng(1).normal(0.0, 0.03, MOVING[:, :3].shape)
WALL = np.array([900.0, 1500.0, 300.0]) + np.random.default_rng(2).normal(0.0, 0.03, SEEN.shape)
MOVING = MOVING + np.random.default_rng(0).normal(0.0, 1e-5, MOVING.shape)
OTHER = 10.0 * np.sin(np.arange(MOVING.size)).reshape(MOVING.shape)  # currents, torques
FRAMES = [str(k) for k in range(1, len(T) + 1)]
MS = [f"{1000 * t:.0f}" for t in T]
NS = [f"{1_700_000_000_000_000_000 + round(1e9 * t)}" for t in T]
SHUFFLED = (4, 0, 5, 2, 1, 3)


def log(head: Sequence[str], columns: Sequence[Array | Sequence[str]], **options: str) -> Form:
    """A controller's log beside a tracker's."""

    def write(folder: Path) -> list[str]:
        joints = text(folder / "log.csv", head, columns, **options)
        return ["--joints", joints, "--points", text(folder / "tracker.csv", ["time_s,x_mm,y_mm,z_mm"], [T, *SEEN.T])]

    return write


def capture(head: Sequence[str], columns: Sequence[Array | Sequence[str]], sep: str = ",") -> Form:
    """Motion capture beside a log of joints."""

    def write(folder: Path) -> list[str]:
        joints = text(folder / "log.csv", ["t," + ",".join(NAMES)], [T, *MOVING.T])
        return ["--joints", joints, "--points", text(folder / "capture.tsv", head, columns, sep=sep)]

    return write


QUALISYS = [f"NO_OF_FRAMES\t{len(T)}", "FREQUENCY\t50", "TIME_STAMP\t2024-03-05, 10:11:12\t1.5", "DATA_INCLUDED\t3D"]
LOGS: dict[str, Form] = {
    "RTDE": log(
        ["timestamp " + names("actual_q_{}", "actual_qd_{}").replace(",", " ")], [T, *MOVING.T, *OTHER.T], sep=" "
    ),
    "libfranka": log(
        ["time, success_rate, " + names("state.q[{}]", "state.q_d[{}]", "state.dq[{}]", "state.tau_J[{}]")],
        [MS, T * 0, *MOVING.T, *MOVING.T, *OTHER.T, *OTHER.T],
    ),
    "franka-interface": log(
        ["time_since_skill_started," + names("q_{}", "q_d_{}", "dq_{}")], [T, *MOVING.T, *MOVING.T, *OTHER.T]
    ),
    "KUKA FRI": log(
        ["index,time,tsec,tnsec," + names("mp{}", "ip{}", "mt{}", "et{}", first=1)],
        [FRAMES, T, FRAMES, FRAMES, *MOVING.T, *MOVING.T, *OTHER.T, *OTHER.T],
    ),
    "KUKA RSI": log(
        ["IPOC," + names("AIPos.A{}", "ASPos.A{}", "MACur.A{}", first=1)],
        [[f"{435413237 + int(m)}" for m in MS], *np.degrees(MOVING).T, *np.degrees(MOVING).T, *OTHER.T],
    ),
    "KUKA trace": log(
        [
            "Zeit [s];"
            + names("Istposition Achse {} [°]", "Sollposition Achse {} [°]", "Strom Achse {} [A]", first=1).replace(
                ",", ";"
            )
        ],
        [T, *np.degrees(MOVING).T, *np.degrees(MOVING).T, *OTHER.T],
        sep=";",
        decimal=",",
        encoding="cp1252",
    ),
    "ABB, two arms": log(
        ["timestamp,cmdnum," + names("J{}", "J{}_2", first=1)],
        [T, T * 0, *np.degrees(MOVING).T, *np.degrees(MOVING[::-1]).T],
    ),
    "rostopic echo -p": log(
        ["%time," + names("field.name{}", "field.position{}")],
        [NS, *([NAMES[k]] * len(T) for k in SHUFFLED), *MOVING.T[list(SHUFFLED)]],
    ),
    "ros2_control": log(
        ["__time," + names("/joint_states/position[{}]", "/joint_states/velocity[{}]")], [T, *MOVING.T, *OTHER.T]
    ),
    "dates": log(
        ["timestamp," + names("axis{} [deg]", first=1)],
        [[f"2024-03-05T10:{int(t // 60):02}:{t % 60:09.6f}" for t in T], *np.degrees(MOVING).T],
    ),
    "Motive": capture(
        [
            "Format Version,1.23,Take Name,a,Capture Frame Rate,50.0,Export Frame Rate,50.0,Length Units,Meters",
            "",
            ",Type," + "Rigid Body," * 8,
            ",Name," + "tool," * 8,
            ",ID," + '"7E1A",' * 8,
            ",,Rotation,Rotation,Rotation,Rotation,Position,Position,Position,Mean Marker Error",
            "Frame,Time (Seconds),X,Y,Z,W,X,Y,Z,",
        ],
        [FRAMES, T, *OTHER.T[:4], *SEEN.T / 1e3, T * 0],
    ),
    "Vicon": capture(
        ["Trajectories", "50", ",,tool:smr,,,wall:m1,,", "Frame,Sub Frame,X,Y,Z,X,Y,Z", ",,mm,mm,mm,mm,mm,mm"],
        [FRAMES, ["0"] * len(T), *SEEN.T, *WALL.T],
    ),
    "Vicon, segments": capture(
        ["Segments", "50", ",,tool:tool,,,,,", "Frame,Sub Frame,RX,RY,RZ,TX,TY,TZ", ",,deg,deg,deg,mm,mm,mm"],
        [FRAMES, ["0"] * len(T), *OTHER.T[:3], *SEEN.T],
    ),
    "Qualisys": capture(
        [
            *QUALISYS,
            "MARKER_NAMES\ttool\twall",
            "Frame\tTime\t" + "\t".join(f"{m} {a}" for m in ("tool", "wall") for a in "XYZ"),
        ],
        [FRAMES, T, *SEEN.T, *WALL.T],
        "\t",
    ),
    "Qualisys, points alone": capture([*QUALISYS, "MARKER_NAMES\ttool\twall"], [*SEEN.T, *WALL.T], "\t"),
}
USUAL = ("libfranka", "Motive", "Vicon")


@pytest.mark.parametrize("name", [pytest.param(n, marks=[] if n in USUAL else pytest.mark.thorough) for n in LOGS])
def test_public_logs_are_imported_without_a_mapping(name: str, tmp_path: Path) -> None:
    require_import(LOGS[name], tmp_path)


def test_a_log_without_times_is_refused_in_a_sentence(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "robot.toml").write_text(robot_toml())
    out, form = tmp_path / "cell", log([",".join(NAMES)], [*MOVING.T])
    assert main(["import", str(out), "--robot", str(tmp_path / "robot.toml"), *form(tmp_path)]) == 2
    assert re.search("are a recording, .* --map COLUMN=time_s", capsys.readouterr().err)
    assert not out.exists()
