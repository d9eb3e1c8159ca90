"""Arms of the two independent engines on which a search once went wrong: what went wrong, and what is told now."""

from __future__ import annotations

from pathlib import Path
from typing import cast

import numpy as np
import pytest

from calib import diagnose
from calib.calibration.result import Calibration
from calib.dataset.dataset import Dataset
from calib.dataset.files.folder import load_dataset
from calib.diagnosis.effect_selection import FitStep, SelectedEffect
from calib.diagnosis.verdict import ConfoundedSet, Findings, conclude
from calib.effects.catalogue import family_of
from calib.effects.catalogue.joints import AsymmetricScale, TransmissionError
from calib.screening.residual_tests import ResidualTests
from calib.simulation.simulate import simulate_dataset
from tests.support.changed import with_poses
from tests.support.engine.cases import Case as SecondCase
from tests.support.engine.cases import simulate as second
from tests.support.engine.classes import cases as second_cases
from tests.support.sweeps import sweep
from tests.support.third_engine.cases import Case
from tests.support.third_engine.cases import simulate as third
from tests.support.third_engine.folder import write_folder


def of_second(kind: str, number: int, seed: int) -> Dataset:
    """Dataset of the second engine, as its benchmark numbers them with ten of each class."""
    return second(second_cases(10, seed, (kind,))[number]).dataset


def of_third(folder: Path, kind: str, number: int, seed: int) -> Dataset:
    """Dataset of the third engine, read from a folder as users have it."""
    return load_dataset(write_folder(third(Case(kind, number, seed)), folder / "cell"))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("kind", "number", "seed", "missing", "left_open"),
    sweep(
        [
            # stood in for a member that the gear errors then lacked, and stayed when the coupling was found
            ("pair", 5, 1012, {"transmission_error", "joint_coupling"}, set()),
            # a gear error larger than any known, and its twin told in its place
            ("twin", 1, 1013, set(), {"transmission_error", "axis_wobble"}),
            # an exact twin that pays for two parameters more
            ("twin", 8, 1012, set(), {"transmission_error", "axis_wobble"}),
            # a single number, that a spring of several comes near
            ("single", 0, 1013, {"joint_scale"}, set()),
            # friction within ways far below all moves, which is the same
            ("shapes", 4, 1014, {"backlash"}, set()),
        ],
        every_run=[("twin", 1, 1013, set(), {"transmission_error", "axis_wobble"})],
    ),
)
def test_arms_of_the_second_engine(kind: str, number: int, seed: int, missing: set[str], left_open: set[str]) -> None:
    found = diagnose(of_second(kind, number, seed))
    assert (set(found.missing), set(found.ambiguous_set)) == (missing, left_open), found.summary()
    assert found.suspected == ()


@pytest.mark.slow
def test_two_causes_are_no_friction_that_follows_both() -> None:
    found = diagnose(second(SecondCase("pair", ("backlash", "joint_scale"), 0, 3)).dataset)
    assert {*found.missing, *found.suspected} == {"backlash", "joint_scale"}, found.summary()


@pytest.mark.slow
def test_a_curve_over_a_neighbours_angle_is_no_wobble() -> None:
    """The angle of joint 2 turns joint 1, as no wave does."""
    found = diagnose(second(SecondCase("tanh", ("steep_coupling",), 6, 2, poses=40, sigmas=(6.0,))).dataset)
    assert (found.verdict, found.missing) == ("unexplained", ()), found.summary()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("kind", "number", "seed", "missing"),
    sweep(
        [
            # a step and gear errors, which curves follow together and the step does not alone
            ("mixture of 3", 1, 1011, {"backlash", "joint_step", "transmission_error"}),
            # a slipped last joint, which a shifted target of three numbers contains
            ("knocks", 4, 1011, {"joint_step"}),
            # friction whose ways lie between those of the family
            ("path friction", 4, 1011, {"path_friction"}),
            # single readings of test poses held against means of four
            ("sister table", 3, 1011, set()),
        ],
        every_run=[("sister table", 3, 1011, set())],
    ),
)
def test_arms_of_the_third_engine(tmp_path: Path, kind: str, number: int, seed: int, missing: set[str]) -> None:
    found = diagnose(of_third(tmp_path, kind, number, seed))
    assert set(found.missing) == missing, found.summary()
    assert found.verdict == ("named" if missing else "adequate")


def test_a_part_that_grows_with_the_angle_is_not_claimed_beside_an_open_cause_on_the_same_joint() -> None:
    """Beside a load that is open for want of masses, or beside waves or a spring on that joint."""

    def claimed(scale: AsymmetricScale) -> tuple[str, ...]:
        selected = tuple(SelectedEffect(member.name, (member,), {}) for member in (TransmissionError(1, 1), scale))
        start = FitStep("", (), cast(Calibration, None))
        step = FitStep("", selected, cast(Calibration, None), effect=scale.name)
        noise = ResidualTests(0.5, 0.05, "dataset", 0.05, (), ())
        open_set = ConfoundedSet("transmission_error", ("counterbalance",), ())
        return conclude(Findings((start, step), noise, confounded_sets=(open_set,))).missing

    assert claimed(AsymmetricScale(1)) == ()
    assert claimed(AsymmetricScale(2)) == ("asymmetric_scale",)


def test_friction_that_never_slips_is_no_friction() -> None:
    dataset = simulate_dataset("rb5", rng=1, poses=40).dataset
    family = family_of(dataset, "path_friction")
    narrow = with_poses(dataset, q=0.05 * dataset.poses.q, came_from=np.zeros((0, 0)))
    wide = {member.length_deg for member in family.members if member.slips}
    assert max(wide) > max(m.length_deg for m in family_of(narrow, "path_friction").members if m.slips)
