"""Rows that err, and mistakes with tables: what an import says of a board's poses that do not fit the arm's."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from calib.dataset.files.robot_toml import load_robot_toml
from calib.errors import CalibError
from calib.extras.camera.board import board_of
from calib.extras.camera.importing.camera_views import CameraPoints
from calib.extras.camera.observed import CameraViews
from calib.kinematics.cartesian import cartesian_arm, joints_of_poses
from tests.extras.camera.camera_dataset import true_lens
from tests.support.camera_scene import ROBOT_FILE, Scene, flange, transform

POSES = 20


def noisy(poses: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Poses with errors of 0.3 mm and 0.1 deg per axis."""
    turns = Rotation.from_rotvec(np.radians(0.1) * rng.normal(size=(len(poses), 3)))
    return np.array([
        transform(turn * Rotation.from_matrix(at[:3, :3]), at[:3, 3] + 0.3 * rng.normal(size=3))
        for turn, at in zip(turns, poses, strict=True)
    ])  # fmt: skip


@pytest.fixture(
    params=[True, pytest.param(False, marks=pytest.mark.thorough)],
    ids=["on the flange", "in the room"],
)
def cell(request) -> tuple[Scene, np.ndarray, np.random.Generator]:
    """A scene of an arm whose links err, and the board's poses as a camera tells them."""
    rng = np.random.default_rng(5)
    scene = Scene.draw(rng, on_flange=request.param, poses=POSES, link_mm=0.5, link_deg=0.1)
    return scene, noisy(scene.camera_T_board, rng), rng


def settled(
    scene: Scene, q: np.ndarray, seen: np.ndarray, setups: tuple[str, ...] = (), mount: str | None = None
) -> CameraPoints:
    """The board's poses as the import settles them."""
    given = CameraPoints(scene.names, seen, np.zeros((len(seen), 6, 6)), np.zeros((len(seen), 6, 0)), None, mount)
    return given.settled(load_robot_toml(Path(ROBOT_FILE)), scene.names, q, setups)


def flipped(at: np.ndarray) -> np.ndarray:
    """The other attitude that a flat marker seen from afar may have."""
    sight = at[:3, 3] / np.linalg.norm(at[:3, 3])
    axis = np.cross(at[:3, 2], sight)
    angle = 2.0 * np.arcsin(np.linalg.norm(axis))
    turn = Rotation.from_rotvec(angle * axis / np.linalg.norm(axis))
    return transform(turn * Rotation.from_matrix(at[:3, :3]), at[:3, 3])


def test_a_third_of_bad_rows_is_named_and_claims_no_size(cell):
    """Flips, which are right in place, rows that have changed places, and rows that are wrong altogether."""
    scene, seen, rng = cell
    seen[[3, 9]] = seen[[9, 3]]
    for k in (2, 7):
        seen[k] = flipped(seen[k])
    for k in (13, 18):
        seen[k] = transform(Rotation.random(random_state=k), seen[k][:3, 3] + 80.0 * rng.normal(size=3))
    found = settled(scene, scene.q, seen)
    assert set(scene.names) - set(found.names) == {"p3", "p4", "p8", "p10", "p14", "p19"}
    assert found.mount == ("flange" if scene.on_flange else "room")
    assert any("pose p4 is left out" in note and "changed places with p10" in note for note in found.notes)
    assert found.point_sigma_mm == pytest.approx(0.3, rel=0.4)
    assert found.orientation_sigma_deg == pytest.approx(0.1, rel=0.4)


def test_no_row_of_a_sound_cell_is_left_out(cell):
    scene, seen, _ = cell
    assert settled(scene, scene.q, seen).names == scene.names


def test_a_marker_of_a_slightly_other_size_is_doubted_and_bad_rows_doubt_none():
    rng = np.random.default_rng(6)
    scene = Scene.draw(rng, on_flange=False, poses=POSES, link_mm=0.5, link_deg=0.1)
    seen = noisy(scene.camera_T_board, rng)
    larger = seen.copy()
    larger[:, :3, 3] *= 1.03
    (doubt,) = settled(scene, scene.q, larger).doubts
    assert float(doubt.split("lengths ")[1].split()[0]) == pytest.approx(1 / 1.03, rel=0.005)
    seen[::3] = larger[::3]
    assert settled(scene, scene.q, seen).doubts == ()


@pytest.mark.parametrize("on_flange", [True, False])
def test_a_board_that_half_a_turn_leaves_alike_is_taken_the_way_up_that_the_arm_tells(on_flange):
    """A checkerboard of 10 x 8 squares was refused."""
    rng = np.random.default_rng(4)
    board = board_of("checkerboard:10x8:25")
    scene = Scene.draw(rng, on_flange=on_flange, poses=16, link_mm=0.5, link_deg=0.1)
    seen = noisy(scene.camera_T_board, rng)
    turned = rng.random(16) < 0.5
    turned[0] = False
    corners, count = board.corners_mm, len(board.corners_mm)
    corner = np.tile(np.arange(count), 16)
    pixels = np.concatenate([scene.pixels(k, -corners if turned[k] else corners) for k in range(16)])
    views = CameraViews(
        true_lens(), board.text, 0.1, tuple(np.repeat(scene.names, count)), corner, np.tile(corners, (16, 1)), pixels
    )
    shown = np.where(turned[:, None, None], seen @ np.diag([-1.0, -1.0, 1.0, 1.0]), seen)
    given = CameraPoints(scene.names, shown, np.tile(np.eye(6) * 1e-2, (16, 1, 1)), np.zeros((16, 6, 0)), views, None)
    found = given.settled(load_robot_toml(Path(ROBOT_FILE)), scene.names, scene.q, ())
    np.testing.assert_allclose(found.camera_T_board, seen, atol=1e-9)
    for k, name in enumerate(scene.names):
        view = found.views.of(name)
        np.testing.assert_allclose(scene.pixels(k, view.board_mm), view.pixels, atol=1e-6)


def test_a_wrong_mount_is_told_as_that(cell):
    scene, seen, _ = cell
    right, wrong = ("flange", "room") if scene.on_flange else ("room", "flange")
    assert settled(scene, scene.q, seen, mount=right).mount == right
    with pytest.raises(CalibError, match=f"--mount {wrong}: .*; give --mount {right}"):
        settled(scene, scene.q, seen, mount=wrong)


def test_distances_that_are_seen_badly_weigh_less_and_are_told_as_no_move():
    """Of a camera that errs by 12 mm along its sight: "board or camera was moved between ..."."""
    rng = np.random.default_rng(8)
    scene = Scene.draw(rng, on_flange=True, poses=POSES)
    seen = noisy(scene.camera_T_board, rng)
    seen[:, :3, 3] *= 1.0 + 0.03 * rng.normal(size=(POSES, 1))
    found = settled(scene, scene.q, seen)
    sight = seen[:, :3, 3] / np.linalg.norm(seen[:, :3, 3], axis=1, keepdims=True)
    along_mm = np.sqrt(np.einsum("mi,mij,mj->m", sight, found.covariance[:, :3, :3], sight))
    assert along_mm == pytest.approx(12.0, rel=0.4)
    assert found.point_sigma_mm < 0.7 * along_mm.mean()


def test_a_board_that_creeps_is_told_and_its_walk_is_no_noise():
    """As the world of a tracker or of visual odometry does: errors add up, and every later pose has them."""
    rng = np.random.default_rng(9)
    scene = Scene.draw(rng, on_flange=True, poses=24)
    seen = scene.camera_T_board.copy()
    seen[:, :3, 3] += np.cumsum(rng.normal(size=(24, 3)), axis=0)
    found = settled(scene, scene.q, seen)
    (doubt,) = found.doubts
    assert "errors of successive poses add up, by 0.7" in doubt
    assert found.shared.shape[2]
    assert found.point_sigma_mm < 1.0  # 2.4 where the walk is taken for noise


def test_each_placement_of_the_camera_is_judged_by_itself():
    rng = np.random.default_rng(6)
    first = Scene.draw(rng, on_flange=False, poses=12, link_mm=0.5, link_deg=0.1)
    turned = transform(Rotation.from_euler("y", 20, degrees=True), [200.0, -50.0, 80.0])
    seen = noisy(np.concatenate([first.camera_T_board, turned @ first.camera_T_board]), rng)
    names = tuple(f"p{k + 1}" for k in range(24))
    both = replace(first, names=names, q=np.concatenate([first.q, first.q]))
    assert settled(both, both.q, seen, ("a",) * 12 + ("b",) * 12).names == names


def _moved(scene: Scene, seen: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    arm = np.array([flange(scene.true_table, q) for q in scene.q])
    board = scene.parent_T_board @ transform(Rotation.from_rotvec([0.02, -0.01, 0.03]), [9.0, -6.0, 4.0])
    camera = scene.parent_T_camera
    late = np.linalg.inv(arm @ camera) @ board if scene.on_flange else np.linalg.inv(camera) @ arm @ board
    return np.concatenate([seen[:13], noisy(late[13:], rng)])


@pytest.mark.parametrize(
    ("mistake", "says"),
    [
        ("sign", "joint 3 turns the other way"), ("zero", "joint 5 is counted from"), ("step", "out of step"),
        ("moved", "was moved between poses"), ("size", "times as large"), ("nonsense", "do not belong together"),
        ("mirrored", "told in a left-handed frame"), ("axis", "y of the board's places has the other sign"),
        pytest.param("degrees", "angles are in degrees", marks=pytest.mark.thorough),
        pytest.param("quaternion", "attitudes agree and places do not", marks=pytest.mark.thorough),
        pytest.param("order", "q4_deg and q5_deg have changed places", marks=pytest.mark.thorough),
        pytest.param("reversed", "opposite order", marks=pytest.mark.thorough),
    ],
)  # fmt: skip
def test_a_mistake_is_told_as_what_it_is(cell, mistake, says):
    scene, seen, rng = cell
    q = scene.q.copy()
    if mistake == "sign":
        q[:, 2] *= -1.0
    elif mistake == "order":
        q[:, [3, 4]] = q[:, [4, 3]]
    elif mistake == "zero":
        q[:, 4] += 0.5 * np.pi
    elif mistake in ("reversed", "step"):
        seen = seen[::-1] if mistake == "reversed" else np.roll(seen, 1, axis=0)
    elif mistake == "mirrored":
        seen = np.diag([-1.0, 1.0, 1.0, 1.0]) @ seen @ np.diag([-1.0, 1.0, 1.0, 1.0])
    elif mistake == "axis":
        seen[:, 1, 3] *= -1.0
    elif mistake == "degrees":
        q = np.degrees(q)
    elif mistake == "quaternion":
        turns = Rotation.from_matrix(seen[:, :3, :3]).as_quat()
        seen[:, :3, :3] = Rotation.from_quat(np.roll(turns, 1, axis=1)).as_matrix()
    elif mistake == "moved":
        seen = _moved(scene, seen, rng)
    elif mistake == "size":
        seen[:, :3, 3] *= 1.1
    else:
        seen = np.array([transform(Rotation.random(random_state=k), 100.0 * rng.normal(size=3)) for k in range(POSES)])
    with pytest.raises(CalibError, match=says) as refused:
        settled(scene, q, seen)
    if mistake == "size":
        assert float(str(refused.value).split("lengths ")[1].split()[0]) == pytest.approx(1 / 1.1, rel=0.015)


@pytest.mark.parametrize("axes", [0, 1])
def test_a_flange_that_turns_about_no_axis_or_one_alone_is_told(axes):
    """Where board and camera are along the axis no pose tells: one was 387 mm off without a word."""
    rng = np.random.default_rng(5)
    turns = Rotation.from_rotvec(np.outer(rng.uniform(-1.0, 1.0, POSES), [0.0, 0.0, float(axes)]))
    poses = np.array([transform(turn, at) for turn, at in zip(turns, rng.uniform(0.0, 300.0, (POSES, 3)), strict=True)])
    camera = transform(Rotation.from_rotvec([0.1, 0.2, 0.3]), [40.0, 0.0, 60.0])
    seen = noisy(np.linalg.inv(poses @ camera) @ transform(Rotation.identity(), [500.0, 0.0, 100.0]), rng)
    names = tuple(f"p{k + 1}" for k in range(POSES))
    none = np.zeros((POSES, 6, 6))
    given = CameraPoints(names, seen, none, none[:, :, :0], None, "flange")
    if not axes:
        with pytest.raises(CalibError, match="the same attitude at all poses"):
            given.settled(cartesian_arm("arm"), names, joints_of_poses(poses), ())
    else:
        found = given.settled(cartesian_arm("arm"), names, joints_of_poses(poses), ())
        assert any("turns about one axis alone" in doubt for doubt in found.doubts)
