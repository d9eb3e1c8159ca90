"""A ball in rendered images: where it truly is, what is no ball, and the dataset that the import makes of it."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np
import pytest

from calib import calibrate, load_dataset
from calib.extras.camera.ball import find_ball
from calib.extras.camera.ball_hand_eye import ball_hand_eye
from calib.extras.camera.lens import Lens
from inspector.cli.parser import main
from tests.support.camera_scene import Scene

SIZE = (640, 480)
MATRIX = np.array([[560.0, 0, 326], [0, 558.0, 236], [0, 0, 1]])
DISTORTION = np.array([-0.16, 0.06, 0.0007, -0.0004, 0.0])
LENS = Lens(*SIZE, (560.0, 558.0, 326.0, 236.0, *DISTORTION, 0.0, 0.0, 0.0))
RADIUS_MM = 30.0
FINE = 3


def rays(fine: int) -> np.ndarray:
    """Directions (H fine, W fine, 3) of the rays of an image, several to a pixel each way."""
    u, v = np.meshgrid(*((np.arange(size * fine) + 0.5) / fine - 0.5 for size in SIZE))
    flat = cv2.undistortPoints(np.stack([u, v], axis=-1).reshape(-1, 1, 2), MATRIX, DISTORTION).reshape(*u.shape, 2)
    ray = np.concatenate([flat, np.ones((*u.shape, 1))], axis=-1)
    return ray / np.linalg.norm(ray, axis=-1, keepdims=True)


RAYS = rays(FINE)


def photo(
    rng: np.random.Generator,
    *balls: np.ndarray,
    ball=(40, 130, 230),
    light=(-0.5, -0.6, -0.6),
    tiles=(90, 60),
    blur=0.8,
) -> np.ndarray:
    """Image (H, W, 3) of shaded balls about their middles before a tiled wall, by rays that meet spheres or do not."""
    wall = RAYS[..., :2] / RAYS[..., 2:] * 900.0
    tile = np.floor(wall / 130.0).sum(axis=-1) % 2
    image = np.where(tile, *map(float, tiles))[..., None] * np.ones(3)
    for middle in balls:
        along = RAYS @ middle
        square = along**2 - middle @ middle + RADIUS_MM**2
        hit = square > 0.0
        normal = ((along[hit] - np.sqrt(square[hit]))[:, None] * RAYS[hit] - middle) / RADIUS_MM
        shade = 0.55 + 0.45 * np.maximum(normal @ (np.array(light) / np.linalg.norm(light)), 0.0)
        image[hit] = shade[:, None] * np.array(ball, dtype=float)
    image = image.reshape(SIZE[1], FINE, SIZE[0], FINE, 3).mean(axis=(1, 3))
    image = cv2.GaussianBlur(image, (0, 0), blur) + rng.normal(size=image.shape) * 1.5
    return np.clip(np.round(image), 0, 255).astype(np.uint8)


def found(image: np.ndarray):
    colours = cv2.cvtColor(image, cv2.COLOR_BGR2LAB)
    return find_ball(cv2, [np.ascontiguousarray(colours[..., k]) for k in range(3)], LENS, RADIUS_MM)


@pytest.mark.parametrize(
    ("look", "xyz_mm"),
    [
        ({}, (60.0, -40.0, 300.0)),
        ({"ball": (15, 15, 15), "tiles": (190, 150)}, (-150.0, 90.0, 380.0)),
        ({"ball": (70, 90, 200), "tiles": (105, 105)}, (20.0, 80.0, 260.0)),
    ],
    ids=["bright", "dark", "of another colour alone"],
)
def test_a_ball_is_found_where_it_is(look, xyz_mm):
    """Off the axis the middle of its outline is not where its middle is seen, by 0.5 mm and more."""
    true = np.array(xyz_mm)
    ball = found(photo(np.random.default_rng(2), true, **look))
    assert not isinstance(ball, str), ball
    error, sight = ball.xyz_mm - true, true / np.linalg.norm(true)
    along = error @ sight
    assert error @ np.linalg.solve(ball.covariance, error) < 16.0
    assert np.linalg.norm(error - along * sight) < 0.08
    sigma = np.sqrt(np.linalg.eigvalsh(ball.covariance))
    assert abs(along) < 3.0 * sigma[2] < 9.0
    assert sigma[1] < 0.15


def test_what_is_no_ball_is_told():
    rng = np.random.default_rng(3)
    empty = photo(rng)
    assert isinstance(found(empty), str)
    near, far = np.array([-50.0, 0.0, 300.0]), np.array([60.0, 10.0, 330.0])
    assert "several balls" in found(photo(rng, near, far))
    for draw in (
        lambda image: cv2.ellipse(image, (320, 240), (60, 42), 20, 0, 360, (230, 230, 230), -1, cv2.LINE_AA),
        lambda image: cv2.rectangle(image, (250, 180), (350, 280), (230, 230, 230), -1),
    ):
        assert isinstance(found(draw(empty.copy())), str)


@pytest.mark.parametrize("on_flange", [True, pytest.param(False, marks=pytest.mark.thorough)])
def test_a_third_of_the_places_may_be_wrong_and_so_may_the_diameter(on_flange):
    """The wrong ones are all of one other ball that stands still, which is the worst: they agree with each other."""
    rng = np.random.default_rng(4)
    scene = Scene.draw(rng, on_flange=on_flange, poses=18, link_mm=0.5, link_deg=0.05)
    true = scene.camera_T_board[:, :3, 3]
    sight = true / np.linalg.norm(true, axis=1)[:, None]
    covariance = 0.05**2 * np.eye(3) + 2.0**2 * sight[:, :, None] * sight[:, None, :]
    seen = true + np.array([rng.multivariate_normal(np.zeros(3), one) for one in covariance])
    wrong = np.arange(18) % 3 == 1
    seen[wrong] = np.array([-60.0, 40.0, 450.0]) + rng.normal(size=(6, 3))
    told = seen / 1.1  # of a ball 10 % larger than told
    fits = [ball_hand_eye(scene.flanges(), told, covariance, rng, on_flange=at) for at in (on_flange, not on_flange)]
    assert np.array_equal(fits[0].kept, ~wrong)
    assert abs(fits[0].scale - 1.1) < 4.0 * fits[0].scale_sigma < 0.03
    assert fits[0].misfit < 4.0 < 20.0 < fits[1].misfit


@pytest.fixture(scope="module")
def cell(tmp_path_factory) -> tuple[Path, Scene]:
    """Images of a ball on the flange by a camera in the room; the second shows another ball elsewhere."""
    folder = tmp_path_factory.mktemp("ball")
    rng = np.random.default_rng(6)
    scene = Scene.draw(rng, on_flange=False, poses=14, link_mm=0.3, link_deg=0.03)
    (folder / "images").mkdir()
    for k, name in enumerate(scene.names):
        middle = scene.camera_T_board[k][:3, 3] if k != 1 else np.array([-30.0, 50.0, 420.0])
        cv2.imwrite(str(folder / "images" / f"{name}.png"), photo(rng, middle))
    scene.write_joints(folder / "joints.csv")
    lens = {"image_width": SIZE[0], "image_height": SIZE[1], "camera_matrix": MATRIX.tolist()}
    (folder / "lens.json").write_text(json.dumps(lens | {"dist_coeffs": DISTORTION.tolist()}))
    return folder, scene


def importing(cell: Path, out: Path, *more: str) -> int:
    return main([
        "import", str(out), "--robot", "rb5", "--joints", str(cell / "joints.csv"),
        "--images", str(cell / "images"), "--board", "ball:60", *more,
    ])  # fmt: skip


@pytest.mark.slow
def test_images_of_a_ball_become_a_dataset_of_points(cell, tmp_path, capsys):
    folder, scene = cell
    out = tmp_path / "cell"
    assert importing(folder, out, "--intrinsics", str(folder / "lens.json"), "--json") == 0
    told = json.loads(capsys.readouterr().out)["recognised"]
    assert any("the camera is in the room" in note for note in told)
    assert any("pose p2 is left out" in note for note in told)
    dataset = load_dataset(out)
    assert not dataset.robot.carries_scanner
    points = dataset.points
    assert len(points) == 13
    true = scene.camera_T_board[[scene.names.index(dataset.poses.ids[i]) for i in points.pose], :3, 3]
    error = points.xyz_mm - true
    square = [e @ np.linalg.solve(c, e) for e, c in zip(error, points.covariance_mm2, strict=True)]
    assert np.mean(square) < 6.0
    fitted = calibrate(dataset)
    assert fitted.residual == "position"
    assert fitted.fit.reduced_chi < 1.5


@pytest.mark.thorough
def test_a_ball_of_another_size_is_told(cell, tmp_path, capsys):
    folder, _ = cell
    lens = ("--intrinsics", str(folder / "lens.json"))
    assert importing(folder, tmp_path / "cell", *lens, "--board", "ball:66") == 2
    said = capsys.readouterr().err
    assert "--board ball:66: the images fit the arm with a ball 0.9" in said
    assert "measure its diameter" in said


def test_a_ball_needs_a_lens(cell, tmp_path, capsys):
    folder, _ = cell
    assert importing(folder, tmp_path / "cell") == 2
    assert "--intrinsics FILE" in capsys.readouterr().err
    assert importing(folder, tmp_path / "cell", "--dictionary", "DICT_4X4_50") == 2
    assert "a ball has no markers" in capsys.readouterr().err
    assert not (tmp_path / "cell").exists()
