"""What each kind of measurement can tell: counted by hand for simple arms, by the fits' own Jacobians for all."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from calib import redundancy
from calib.dataset.dataset import Dataset, Orientations, Points, Poses, Scanner
from calib.dataset.files.folder import write_dataset
from calib.dataset.files.robot_toml import builtin_robot
from calib.errors import FitError
from calib.fitting.model import geometric_model
from calib.fitting.observations import Observations
from calib.fitting.residual_kinds import make_residuals
from calib.identifiability.structural import free_frame_rank, structural_rank
from calib.kinematics.robot import Joint, Robot, Tool
from calib.present.fit.redundancy import free_frame_sentence
from calib.simulation.truth.equilibrium import Truth, base_T_target
from tests.support.commands import answered, printed

KINDS = ("position", "distance", "pairs", "pose")


def arm(name: str, tool: Tool, *joints: Joint) -> Robot:
    return Robot(name, joints, tool)


ARMS = {
    "rb5": builtin_robot("rb5"),
    "panda": builtin_robot("panda"),
    "planar": arm("planar", Tool(50.0), Joint(300.0), Joint(250.0, d_mm=20.0), Joint(120.0)),
    "gantry": arm(
        "gantry",
        Tool(),
        Joint(0.0, np.pi / 2, type="prismatic"),
        Joint(0.0, np.pi / 2, 0.0, np.pi / 2, type="prismatic"),
        Joint(type="prismatic"),
    ),
    "one joint": arm("one joint", Tool(), Joint(300.0, 0.0, 50.0)),
    "scara": arm(
        "scara",
        Tool(40.0, 0.0, 50.0),
        Joint(300.0, 0.0, 400.0),
        Joint(250.0, np.pi),
        Joint(type="prismatic"),
        Joint(),
    ),
}


def measured(robot: Robot, poses: int = 60, setups: int = 1) -> Dataset:
    """Exact full poses, as the nominal arm itself would give them."""
    rng = np.random.default_rng(4)
    q = rng.uniform(-1.0, 1.0, (poses, robot.n_joints)) * np.where(robot.is_revolute, 2.5, 300.0)
    base_T_jig = base_T_target(Truth.without_effects(robot, np.eye(4)), q)
    setup = np.array([f"s{i % setups}" for i in range(poses)])
    role = np.array(["reference", *["train"] * (poses - 1)])
    ids = tuple(f"p{i}" for i in range(poses))
    points = Points(
        np.arange(poses),
        base_T_jig[:, :3, 3],
        np.full(poses, "jig"),
        orientations=Orientations(base_T_jig[:, :3, :3]),
    )
    scanner = Scanner(0.05, orientation_sigma_rad=1e-4)
    return Dataset("exact", robot, Poses(ids, role, q, setup, tuple(f"{i}.ply" for i in ids)), points, scanner=scanner)


def rank_of_the_fit(dataset: Dataset, kind: str) -> int:
    """By the residual that a fit really makes small, its frames eliminated by its own means."""
    model = geometric_model(dataset.robot)
    residuals = make_residuals(kind, model, Observations.of(dataset))
    jacobian = residuals.linearise(np.zeros(len(model.scales))).jacobian * model.scales
    s = np.linalg.svd(jacobian, compute_uv=False)
    # A tolerance of the arm's moves what is measured by 1 to 1e4 sigmas; rounding is 1e-9 of that.
    return int(np.sum(s > 1e-5))


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("name", ARMS)
def test_the_rank_is_that_of_what_a_fit_makes_small(name: str, kind: str) -> None:
    dataset = measured(ARMS[name])
    rank = rank_of_the_fit(dataset, kind)
    assert structural_rank(dataset.robot, residual=kind) == rank
    unknown = free_frame_rank(dataset, residual=kind)
    assert unknown.here == rank == unknown.best[kind]


def test_simple_arms_counted_by_hand() -> None:
    """A planar arm by lengths: three links, two encoder offsets. A gantry: the angles between its axes. A circle: its
    radius, wherever it lies."""
    assert structural_rank(ARMS["planar"], residual="distance") == 5
    for kind in KINDS:
        assert structural_rank(ARMS["gantry"], residual=kind) == 3
        assert structural_rank(ARMS["one joint"], residual=kind) == 1
    # Positions of a planar arm also show its axes' tilts against each other, two each, which no length shows.
    assert structural_rank(ARMS["planar"], residual="position") == 5 + 4


def test_few_poses_tell_less_than_an_arm_could() -> None:
    dataset = measured(ARMS["rb5"], poses=6)
    unknown = free_frame_rank(dataset)
    assert unknown.here == 3 * 6 - 6
    assert unknown.best["position"] == 19
    assert "positions determine 12 parameters at these poses, and 19 at best" in free_frame_sentence(unknown)


def test_each_placement_of_the_scanner_is_unknown_by_itself() -> None:
    dataset = measured(ARMS["rb5"], poses=8, setups=2)
    assert free_frame_rank(dataset).here == 3 * 8 - 12
    assert free_frame_rank(dataset, residual="pose").here == rank_of_the_fit(dataset, "pose")


@pytest.mark.parametrize("kind", KINDS)
def test_the_command_tells_the_same(kind: str, tmp_path: Path) -> None:
    dataset = measured(ARMS["planar"])
    write_dataset(replace(dataset, points=replace(dataset.points, orientations=None)), tmp_path / "arm")
    document = answered("redundancy", tmp_path / "arm", "--residual", kind)
    assert document["rank"] == redundancy(dataset, residual=kind).rank
    assert document["rank_unknown_frame_here"] == structural_rank(dataset.robot, residual=kind)
    assert document["seen_by"] in printed("redundancy", tmp_path / "arm", "--residual", kind)


def test_an_unknown_kind_is_refused() -> None:
    with pytest.raises(FitError, match="no residual named 'length'"):
        redundancy(measured(ARMS["planar"]), residual="length")
