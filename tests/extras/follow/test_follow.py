"""A folder that fills is followed: half-written files, late tables, wrong points, moved instruments, restarts."""

from __future__ import annotations

import json
import os
import shutil
import threading
import time
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from calib.array_types import Array
from calib.dataset.dataset import Dataset
from calib.dataset.files.folder import ArrivingDataset, write_dataset
from calib.dataset.files.robot_toml import builtin_robot
from calib.extras.follow.campaign import Campaign, PoseJudgement, with_arrivals
from calib.extras.follow.follower import PATIENCE_S, SETTLED_S, CampaignFollower, News
from calib.extras.follow.present.campaign import campaign_head, judgement_document
from calib.frames import best_fit_transform, rotation_from_rotvec
from calib.kinematics.chain import Chain, nominal_chain
from calib.kinematics.robot import Robot
from calib.rendering.text import block_text
from calib.simulation.simulate import simulate_dataset
from inspector.cli.parser import main

POSES = 40
ROBOT = builtin_robot("rb5")


@cache
def measured() -> Dataset:
    """40 poses of an RB5, every fourth a test pose, with points of 0.05 mm noise."""
    simulation = simulate_dataset(ROBOT, rng=np.random.default_rng(3), poses=POSES, noise_mm=0.05, name="campaign")
    return simulation.dataset


def with_moved(dataset: Dataset, since: int, what: str) -> Dataset:
    """The dataset with its instrument or its target moved since a pose."""
    points = dataset.points
    assert points is not None
    xyz_mm = points.xyz_mm.copy()
    rows = points.pose >= since
    if what == "instrument":
        xyz_mm[rows] = xyz_mm[rows] @ rotation_from_rotvec([0.0, 0.002, 0.0]).T + [1.0, -0.6, 0.4]
    else:
        moved = replace(dataset.robot, tool=replace(dataset.robot.tool, d_mm=dataset.robot.tool.d_mm + 1.5))
        at = [r.target_mm for r in (chain_of(dataset.robot, dataset), chain_of(moved, dataset))]
        shift = (at[1] - at[0])[points.pose]
        xyz_mm[rows] += (shift @ instrument_R_base(dataset).T)[rows]
    return dataset.with_points(replace(points, xyz_mm=xyz_mm))


def chain_of(robot: Robot, dataset: Dataset) -> Chain:
    return nominal_chain(robot, dataset.poses.q)


def instrument_R_base(dataset: Dataset) -> Array:
    """Attitude of the base in the instrument's frame, by the nominal robot."""
    points = dataset.points
    assert points is not None
    at_mm = chain_of(dataset.robot, dataset).target_mm[points.pose]
    return best_fit_transform(at_mm, points.xyz_mm)[:3, :3]


def first(dataset: Dataset, count: int) -> ArrivingDataset:
    """What has arrived once the first poses were measured."""
    points = dataset.points
    assert points is not None
    return ArrivingDataset(dataset.with_points(points.select(points.pose < count)))


def measured_in_steps(dataset: Dataset, counts: list[int]) -> Campaign:
    campaign = Campaign(dataset)
    for count in counts:
        campaign, _ = with_arrivals(campaign, first(dataset, count), {})
    return campaign


def test_the_error_is_predicted_and_falls_and_the_plan_is_followed() -> None:
    dataset = measured()
    early = measured_in_steps(dataset, [20])
    late = measured_in_steps(dataset, [20, POSES])
    assert early.outlook is not None
    assert late.outlook is not None
    assert late.outlook.now.geometry_mm < early.outlook.now.geometry_mm
    left = {dataset.poses.ids[i] for i in range(20, POSES) if not dataset.poses.is_test[i]}
    assert set(early.outlook.next) <= left
    assert late.outlook.next == ()
    assert "All planned poses are measured" in block_text(*campaign_head(late))
    assert len(late.in_state("good")) == POSES


def test_a_wrong_point_is_doubtful_at_once_and_good_when_it_was_measured_again() -> None:
    dataset = measured()
    points = dataset.points
    assert points is not None
    at = int(np.flatnonzero(~dataset.poses.is_test)[25])
    wrong = points.xyz_mm.copy()
    wrong[points.pose == at] += [1.0, 0.0, 0.0]
    spoilt = dataset.with_points(replace(points, xyz_mm=wrong))
    campaign = measured_in_steps(spoilt, [at])
    campaign, news = with_arrivals(campaign, first(spoilt, at + 1), {})
    name = dataset.poses.ids[at]
    assert [(j.pose, j.state, j.reason) for j in news] == [(name, "doubtful", "off")]
    assert news[0].error_mm == pytest.approx(1.0, rel=0.4)
    assert "measure it once more" in judgement_document(campaign, news[0])["why"]
    assert campaign.in_state("doubtful") == (name,)
    campaign, news = with_arrivals(campaign, first(dataset, at + 1), {})
    assert [(j.pose, j.state) for j in news] == [(name, "good")]


@pytest.mark.parametrize("what", ["instrument", "target"])
def test_what_moved_in_the_middle_is_told_with_the_pose_and_ends_with_a_setup_of_its_own(what: str) -> None:
    since = 24
    dataset = with_moved(measured(), since, what)
    campaign = measured_in_steps(dataset, [since, since + 7])
    first_off = campaign.off_since
    assert first_off is not None
    assert abs(dataset.poses.ids.index(first_off) - since) <= 2
    assert f"All poses since {first_off} are off" in block_text(*campaign_head(campaign))
    if what == "instrument":
        setup = np.where(np.arange(POSES) < since, "", "moved")
        told = replace(dataset, poses=replace(dataset.poses, setup=setup))
        campaign, _ = with_arrivals(campaign, first(told, POSES), {})
        assert campaign.off_since is None
        assert len(campaign.in_state("good")) >= POSES - 1


# ---- files ----------------------------------------------------------------------------------------------------------


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """The campaign's folder without any point."""
    write_dataset(measured(), tmp_path / "c")
    (tmp_path / "c" / "points.csv").rename(tmp_path / "points.csv")
    return tmp_path / "c"


class Clock:
    """Looks at a folder, as far apart as the test says."""

    def __init__(self, folder: Path) -> None:
        self.follower = CampaignFollower(folder)
        self.now_s = 100.0

    def look(self, after_s: float = 1.1 * SETTLED_S) -> News:
        self.now_s += after_s
        return self.follower.look(self.now_s)

    def settle(self) -> list[PoseJudgement]:
        """All news until the folder is at rest."""
        return [j for _ in range(3) for j in self.look().judged]


def test_a_line_that_is_half_written_waits_for_its_end(folder: Path) -> None:
    lines = (folder.parent / "points.csv").read_text().splitlines(keepends=True)
    clock = Clock(folder)
    assert clock.look().judged == ()  # the folder holds no points.csv yet
    half = len(lines[3]) // 2
    (folder / "points.csv").write_text("".join(lines[:3]) + lines[3][:half])
    assert [j.pose for j in clock.look().judged] == list(measured().poses.ids[:2])
    (folder / "points.csv").write_text("".join(lines[:4]))
    assert [j.pose for j in clock.settle()] == [measured().poses.ids[2]]


def test_a_restart_and_any_order_end_at_the_same_judgements(folder: Path) -> None:
    header, *lines = (folder.parent / "points.csv").read_text().splitlines(keepends=True)
    shuffled = [lines[i] for i in np.random.default_rng(0).permutation(len(lines))]
    slow, text = Clock(folder), header
    for k in range(0, POSES, 10):
        text += "".join(shuffled[k : k + 10])
        (folder / "points.csv").write_text(text)
        slow.settle()
    again = Clock(folder)
    again.settle()
    one, two = slow.follower.campaign, again.follower.campaign
    assert one is not None
    assert two is not None
    assert {i: j.state for i, j in one.judged.items()} == {i: j.state for i, j in two.judged.items()}
    assert one.outlook is not None
    assert two.outlook is not None
    assert one.outlook.now.geometry_mm == pytest.approx(two.outlook.now.geometry_mm, rel=1e-6)


def test_a_row_without_a_point_is_to_be_repeated_and_one_of_no_pose_waits(folder: Path) -> None:
    lines = (folder.parent / "points.csv").read_text().splitlines(keepends=True)
    name = lines[2].split(",")[0]
    blank = name + "," * lines[0].count(",") + "\n"
    (folder / "points.csv").write_text("".join([lines[0], lines[1], blank, "later" + lines[3][lines[3].index(",") :]]))
    judged = {j.pose: j for j in Clock(folder).settle()}
    assert judged[name].state == "repeat"
    assert judged[name].reason == "not seen"
    assert judged["later"].state == "unknown"


def test_a_fault_in_a_table_is_told_once_when_it_lasts_and_forgotten_when_mended(folder: Path) -> None:
    lines = (folder.parent / "points.csv").read_text().splitlines(keepends=True)
    clock = Clock(folder)
    (folder / "points.csv").write_text("".join(lines[:3]) + lines[3].replace(lines[3].split(",")[1], "oops", 1))
    first_look = clock.look()
    assert (first_look.fault, first_look.judged) == ("", ())  # perhaps a writer in the middle of it
    told = [clock.look(PATIENCE_S).fault for _ in range(3)]
    assert len([fault for fault in told if fault]) == 1
    assert "points.csv: line 4" in "".join(told)
    (folder / "points.csv").write_text("".join(lines[:4]))
    assert len(clock.settle()) == 3


def test_empty_files_hold_nothing_up(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    shutil.copy(folder.parent / "points.csv", folder)
    (folder / ".gitkeep").touch()
    assert main(["follow", str(folder), "--once"]) in (0, 1)
    assert f"{POSES} of {POSES} poses good" in capsys.readouterr().out


@pytest.mark.slow
def test_scans_are_searched_as_they_come_and_again_when_they_are_replaced(tmp_path: Path) -> None:
    sample = Path("sample_data/rb5_jang")
    folder = tmp_path / "scans"
    shutil.copytree(sample, folder, ignore=shutil.ignore_patterns("*.ply"))
    shutil.rmtree(folder / "scans")
    clock = Clock(folder)
    assert clock.look().judged == ()  # not even the folder of the scans is there
    (folder / "scans").mkdir()
    whole = (sample / "scans" / "p02.ply").read_bytes()
    (folder / "scans" / "p02.ply").write_bytes(whole[:-1000])
    assert clock.look().judged == ()
    told = [*clock.look().judged, *clock.look(PATIENCE_S).judged]
    assert [(j.pose, j.state, j.reason) for j in told] == [("p02", "repeat", "unreadable")]
    (folder / "scans" / "p02.ply").write_bytes(whole)
    shutil.copy(sample / "scans" / "p01.ply", folder / "scans")
    assert {(j.pose, j.state) for j in clock.settle()} == {("p02", "good"), ("p01", "good")}


def test_the_command_prints_a_json_line_for_each_pose_while_the_file_grows(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    lines = (folder.parent / "points.csv").read_text().splitlines(keepends=True)

    def write() -> None:
        with (folder / "points.csv").open("w") as file:
            for start in range(0, len(lines), 8):
                file.writelines(lines[start : start + 8])
                file.flush()
                time.sleep(0.05)

    writer = threading.Thread(target=write)
    writer.start()
    writer.join(0.1)
    status = main(["follow", str(folder), "--json", "--once"])
    writer.join()
    told = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    assert status in (0, 1)
    assert {line["pose"] for line in told} == set(measured().poses.ids)
    assert {"pose", "state", "why", "predicted_mm", "next"} <= set(told[-1])
    assert told[-1]["predicted_mm"] > 0.0


def test_a_folder_where_nothing_was_measured_is_bad_input(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["follow", str(folder), "--once"]) == 2
    assert "nothing was measured" in capsys.readouterr().err
    assert main(["follow", str(folder / "none")]) == 2


def test_a_name_that_the_plan_does_not_have_is_told_at_once_until_the_plan_has_it(folder: Path) -> None:
    header, *lines = (folder.parent / "points.csv").read_text().splitlines(keepends=True)
    ids = measured().poses.ids
    other = lines[1].replace(ids[1], "P-17"), lines[2].replace(ids[2], ids[2].upper() + " ")
    clock = Clock(folder)
    (folder / "points.csv").write_text("".join([header, lines[0], *other]))
    told = {j.pose: j.state for j in clock.look().judged}  # the writer may still be at it, but the lines are whole
    assert told == {ids[0]: "good", "P-17": "unknown", ids[2].upper(): "unknown"}
    assert clock.look().judged == ()
    campaign = clock.follower.campaign
    assert campaign is not None
    assert f"of no pose that poses.csv has (yet): P-17 and {ids[2].upper()}" in block_text(*campaign_head(campaign))
    poses = (folder / "poses.csv").read_text()
    (folder / "poses.csv").write_text(poses + poses.splitlines(keepends=True)[2].replace(ids[1], "P-17"))
    assert [(j.pose, j.state) for j in clock.settle()] == [("P-17", "good")]
    assert clock.follower.campaign is not None
    assert clock.follower.campaign.unknown == (ids[2].upper(),)


def test_the_command_tells_names_that_the_plan_does_not_have(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    header, *lines = (folder.parent / "points.csv").read_text().splitlines(keepends=True)
    ids = measured().poses.ids
    (folder / "points.csv").write_text(header + lines[0] + lines[1].replace(ids[1], "shot 2"))
    main(["follow", str(folder), "--json", "--once"])
    told = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    assert {line["pose"]: line["state"] for line in told} == {ids[0]: "good", "shot 2": "unknown"}
    assert all(line["unknown"] == ["shot 2"] for line in told)
    main(["follow", str(folder), "--once"])
    assert "shot 2 unknown: is of no pose that poses.csv has (yet)" in capsys.readouterr().out
    (folder / "points.csv").write_text(header + lines[1].replace(ids[1], "shot 2"))
    assert main(["follow", str(folder), "--once"]) == 2
    assert "nothing was measured; poses.csv has no pose shot 2" in capsys.readouterr().err


@pytest.mark.thorough
@pytest.mark.parametrize("seed", range(2))
def test_whatever_a_writer_does_to_the_tables_each_pose_is_told_once_and_all_ends_well(folder: Path, seed: int) -> None:
    rng = np.random.default_rng(seed)
    points, poses, top = (folder / name for name in ("points.csv", "poses.csv", "dataset.toml"))
    whole = (folder.parent / "points.csv").read_bytes()
    head, *rows = whole.splitlines(keepends=True)
    planned, told_toml = poses.read_bytes(), top.read_bytes()
    clock, have, count, told = Clock(folder), head, 0, []

    def garbled() -> None:
        part = int(rng.integers(0, len(planned)))
        match rng.integers(10):
            case 0:
                points.write_bytes(b"")
            case 1:
                points.unlink(missing_ok=True)
            case 2:
                points.write_bytes(have + bytes(64))  # the end of a block that the writer has not reached
            case 3:
                points.write_bytes(b"\xef\xbb\xbf" + have.replace(b"\n", b"\r\n"))
            case 4:
                points.write_bytes(head + b"".join(rows[i] for i in rng.permutation(count)))
            case 5 if points.exists():
                os.utime(points, (1e9, 1e9))  # a clock that was set back
            case 6:
                poses.write_bytes(planned[:part])
            case 7:
                top.write_bytes(told_toml[: min(part, len(told_toml))])
            case 8 if count:
                points.write_bytes(have + rows[int(rng.integers(count))])  # twice
            case _:
                points.write_bytes(have + rows[min(count, POSES - 1)][: int(rng.integers(1, 30))])

    for _ in range(30):
        if rng.random() < 0.5:
            garbled()
        else:
            count = min(count + 1, POSES)
            have = head + b"".join(rows[:count])
            for path, content in ((points, have), (poses, planned), (top, told_toml)):
                path.write_bytes(content)
        told += clock.look(float(rng.choice([0.1, 0.5, 1.0, 4.0]))).judged
    for path, content in ((points, whole), (poses, planned), (top, told_toml)):
        path.write_bytes(content)
    told += [j for _ in range(4) for j in clock.look(2.0).judged]
    fresh = Clock(folder)
    fresh.settle()
    one, two = clock.follower.campaign, fresh.follower.campaign
    assert one is not None
    assert two is not None
    assert clock.follower.is_at_rest
    assert {i: j.state for i, j in one.judged.items()} == {i: j.state for i, j in two.judged.items()}
    assert len(told) <= POSES + 4  # once each, but where a state changed


@pytest.mark.thorough
def test_rows_that_were_deleted_are_gone_once_that_lasts(folder: Path) -> None:
    whole = (folder.parent / "points.csv").read_text().splitlines(keepends=True)
    clock = Clock(folder)
    (folder / "points.csv").write_text("".join(whole[:13]))
    clock.settle()
    (folder / "points.csv").write_text("".join(whole[:12]))
    assert clock.look().judged == ()
    assert clock.follower.campaign is not None
    assert len(clock.follower.campaign.judged) == 12
    clock.look(PATIENCE_S)
    assert len(clock.follower.campaign.judged) == 11
    assert clock.follower.is_at_rest
