"""model.json: the same model comes back, and no file, whoever wrote it, does more than raise one line."""

from __future__ import annotations

import json
import math
import pkgutil
from collections.abc import Callable
from dataclasses import is_dataclass, replace
from importlib import import_module
from inspect import isabstract
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import calib
import calib.effects
import calib.screening.curves
from calib.calibration.result import Calibration
from calib.compensation.target_correction import plain_poses
from calib.dataset.dataset import Dataset
from calib.dataset.files.folder import load_dataset, write_dataset
from calib.dataset.files.robot_toml import builtin_robot
from calib.dataset.trained_range import TrainedRange
from calib.diagnosis.search_space import add_in_turn
from calib.effects.catalogue import CATALOGUE, effects_for, effects_named
from calib.effects.catalogue.joints import StrainWave
from calib.effects.catalogue.user_file import load_effects
from calib.effects.effect import apply_values
from calib.effects.link_errors import LinkErrors
from calib.effects.state import RobotState
from calib.errors import CalibError, FitError, ModelFileError
from calib.fitting.observations import nominal_state
from calib.models.effect_fields import MEMBER_KINDS, member_document, member_from
from calib.models.fitted_model import FittedModel
from calib.models.model_file import load_model, save_model
from calib.noise_shape import CorrelatedDrift, NoiseShape
from calib.options import FitOptions
from calib.screening.curves.smooth_joint_error import CurveModes, FormulaModes, FormulaTerm, SmoothJointError
from calib.simulation.simulate import simulate_dataset
from calib.strict_json import JsonFile
from tests.support.changed import with_poses
from tests.support.hidden_dataset import HIDDEN, write_hidden

FAMILIES = (HIDDEN, "joint_compliance", "backlash", "thermal_growth", "scanner_drift", "scanner_distortion")
OWN = """
from dataclasses import dataclass
import numpy as np
from calib import Parameter

@dataclass(frozen=True)
class Humid:
    joint: int
    parameters = (Parameter("k_rad", unit="rad", scale=1e-4),)

    def apply(self, state, *, k_rad):
        return state.add_joint_error(self.joint, k_rad * np.sin(3 * state.q_rad[:, self.joint]))
"""


@pytest.fixture(scope="module")
def dataset(tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    return load_dataset(write_hidden(tmp_path_factory.mktemp("data"), "cell"))


@pytest.fixture(scope="module")
def fitted(dataset: Dataset) -> Calibration:
    asked = FitOptions(fixed=("d5",), tolerances={"a2": 0.1})
    return calib.calibrate(dataset, asked, effects=effects_named(dataset, FAMILIES))


@pytest.fixture
def saved(fitted: Calibration, tmp_path: Path) -> Path:
    path = tmp_path / "model.json"
    calib.save_model(fitted, path)
    return path


@pytest.mark.slow
def test_the_same_model_comes_back(fitted: Calibration, dataset: Dataset, saved: Path) -> None:
    loaded = calib.load_model(saved)
    assert replace(loaded.model, prior_sigmas={}) == fitted.model
    assert loaded.options == fitted.options
    assert loaded.model.parameters == fitted.fit.parameters
    np.testing.assert_array_equal(loaded.x, fitted.fit.x)
    np.testing.assert_array_equal(loaded.sigma, fitted.fit.sigma)
    np.testing.assert_array_equal(np.tril(loaded.covariance), np.tril(fitted.fit.covariance))
    np.testing.assert_array_equal(loaded.covariance, loaded.covariance.T)
    np.testing.assert_array_equal(loaded.scanner_T_base[""], fitted.after.scanner_T_base[""])
    assert loaded.robot == fitted.robot
    assert (loaded.before.test, loaded.after.test) == (fitted.before.test, fitted.after.test)
    assert (loaded.before.train, loaded.after.train) == (fitted.before.train, fitted.after.train)
    assert loaded.sigma_mm == fitted.sigma_mm
    assert loaded.is_fitted_to(dataset)
    assert loaded.source.training_poses == tuple(
        name for name, role in zip(dataset.poses.ids, dataset.poses.role, strict=True) if role != "test"
    )
    again = saved.with_name("again.json")
    save_model(loaded, again)
    assert json.loads(again.read_text()) == json.loads(saved.read_text())


@pytest.mark.thorough
def test_it_predicts_and_corrects_the_same(fitted: Calibration, dataset: Dataset, saved: Path) -> None:
    loaded = load_model(saved)
    model, x, poses = fitted.model, fitted.fit.x, dataset.poses
    predicted = loaded.predict(poses.q, poses)
    np.testing.assert_allclose(predicted, model.predict(x, poses), rtol=0, atol=1e-12)
    some = poses.select(np.arange(4))
    expected = calib.corrected_joints(dataset.robot, model, some.q, x=x, conditions=some, kind="position")
    np.testing.assert_array_equal(loaded.correct(some.q, some, "position").q, expected.q)
    assert loaded.trained == TrainedRange.of(dataset)
    np.testing.assert_allclose(loaded.evaluate(dataset).error_mm, fitted.after.error_mm, rtol=0, atol=1e-12)
    with pytest.raises(FitError, match="depends on payload_kg, temperature_c"):
        loaded.predict(poses.q)
    with pytest.raises(FitError, match=r"depends on temperature_c through"):
        loaded.correct(some.q, replace(some, temperature_c=None))
    with pytest.raises(FitError, match="shape"):
        loaded.predict(poses.q[:, :3], poses)
    with pytest.raises(FitError, match="degrees"):
        loaded.predict(np.degrees(poses.q), poses)
    with pytest.raises(FitError, match="no target named 'smr2'"):
        loaded.predict(poses.q, poses, "smr2")


@pytest.mark.slow
def test_every_member_of_the_catalogue_comes_back() -> None:
    robot = builtin_robot("panda")
    dataset = simulate_dataset(robot, rng=0, poses=20, conditions=True).dataset
    file = JsonFile(Path("m.json"), "model file", "", ModelFileError)
    unweighed = replace(robot, joints=tuple(replace(j, mass_kg=None, com_mm=None) for j in robot.joints))
    unheated = with_poses(dataset, temperature_c=None)
    sets = (dataset, replace(dataset, robot=unweighed), unheated)
    members = [member for one in sets for family in effects_for(one) for member in family.members]
    assert len(members) > 150
    assert {type(member) for member in members} > set(CATALOGUE) - {StrainWave}
    for member in (*members, LinkErrors(robot, {"a2": 0.1})):
        document = json.loads(json.dumps(member_document(member)))
        again = member_from(file, [], document, robot)
        assert again == member
        assert type(again) is type(member)


def test_a_number_beyond_the_arm_or_beyond_memory_is_refused() -> None:
    file, robot = JsonFile(Path("m.json"), "model file", "", ModelFileError), builtin_robot("rb5")
    for fields in ({"joint": 9, "driver": 1}, {"joint": 1, "driver": -1}, {"joint": 1, "driver": 10**9}):
        with pytest.raises(ModelFileError, match=r"m\.json: fields\.(joint|driver): found"):
            member_from(file, [], {"family": "joint_coupling", "fields": fields}, robot)


def test_every_effect_of_this_program_can_be_saved() -> None:
    """A class that is not in `MEMBER_KINDS` would make a file that nothing reads."""
    found = set()
    for package in (calib.effects, calib.effects.catalogue, calib.screening.curves):
        for info in pkgutil.iter_modules(package.__path__, f"{package.__name__}."):
            for value in vars(import_module(info.name)).values():
                if isinstance(value, type) and is_dataclass(value) and {"apply", "parameters"} <= set(dir(value)):
                    found |= set() if isabstract(value) else {value}
    assert found == {kind for _, kind in MEMBER_KINDS}


def test_learned_curves_are_saved_by_their_fields_too() -> None:
    file, robot = JsonFile(Path("m.json"), "model file", "", ModelFileError), builtin_robot("rb5")
    rng = np.random.default_rng(1)
    curve = CurveModes("q3", np.array([1, 4, 9]), rng.normal(size=(6, 2)), start=0.3, low=-2.0)
    formula = FormulaModes("q2+q3", (FormulaTerm("harmonic", order=7), FormulaTerm("bump", place=0.1, width=0.2)))
    poses = plain_poses(rng.uniform(-2.0, 2.0, size=(9, 6)))
    state = RobotState.nominal(robot, poses)
    for modes, sigmas in ((curve, (1e-4, 2e-4)), (formula, (1e-4, 1e-4, 2e-4))):
        effect = SmoothJointError(2, modes, sigmas)
        document = json.loads(json.dumps(member_document(effect)))
        again = member_from(file, [], document, robot)
        assert again.parameters == effect.parameters
        values = rng.normal(size=len(sigmas))
        np.testing.assert_array_equal(
            apply_values(again, state, values).vector, apply_values(effect, state, values).vector
        )
        for place, wrong in (
            ("weights", "x"),
            ("weights", [[1.0], [2.0, 3.0]]),
            ("weights", [math.inf]),
            ("orders", None),
            ("input", 3),
            ("terms", [7]),
        ):
            spoiled = json.loads(json.dumps(document))
            spoiled["fields"]["modes"][place] = wrong
            with pytest.raises(ModelFileError, match=r"m\.json: fields\.modes[\w.\[\]]*: found"):
                member_from(file, [], spoiled, robot)


def test_a_selected_effect_keeps_its_prior_sigmas(dataset: Dataset, tmp_path: Path) -> None:
    result = add_in_turn(dataset, [HIDDEN])[-1].calibration
    save_model(result, tmp_path / "m.json")
    loaded = load_model(tmp_path / "m.json")
    assert loaded.model.parameters == result.model.parameters
    assert loaded.needs == ()
    at = loaded.predict(dataset.poses.q)
    np.testing.assert_allclose(at, result.model.predict(result.fit.x, dataset.poses), rtol=0, atol=1e-12)


def test_the_shape_of_the_noise_comes_back(dataset: Dataset, tmp_path: Path) -> None:
    shape = NoiseShape(0.5, 3.0, wander=CorrelatedDrift(0.5, 80.0), tail=4.0)
    save_model(calib.calibrate(dataset, FitOptions(noise=shape)), tmp_path / "m.json")
    assert load_model(tmp_path / "m.json").options.noise == shape
    text = (tmp_path / "m.json").read_text("utf-8").replace('"depth": 3.0', '"depth": 0.0')
    (tmp_path / "m.json").write_text(text, "utf-8")
    with pytest.raises(ModelFileError, match=r"options\.noise: found"):
        load_model(tmp_path / "m.json")


def test_a_tool_point_that_was_found_far_off_comes_back(dataset: Dataset, tmp_path: Path) -> None:
    table = dataset.robot.table
    table[-1, 0] += 120.0  # mm
    wrong = replace(dataset, robot=dataset.robot.with_table(table))
    result = calib.calibrate(wrong, effects=effects_named(wrong, [HIDDEN]))
    assert result.model.tool_found is not None
    save_model(result, tmp_path / "m.json")
    loaded = load_model(tmp_path / "m.json")
    assert loaded.model.placed_robot == result.model.placed_robot
    errors = loaded.evaluate(wrong)
    np.testing.assert_allclose(errors.error_mm, result.after.error_mm, rtol=0, atol=1e-12)


def test_effects_of_the_users_come_from_the_users_file(dataset: Dataset, tmp_path: Path) -> None:
    own, other, path = tmp_path / "own.py", tmp_path / "other.py", tmp_path / "m.json"
    own.write_text(OWN)
    other.write_text(OWN.replace("Humid", "Dry"))
    members = load_effects(own, nominal_state(dataset))[0].members
    result = calib.calibrate(dataset, effects=members[1:3])
    save_model(result, path)
    loaded = load_model(path, own)
    np.testing.assert_array_equal(loaded.predict(dataset.poses.q), result.model.predict(result.fit.x, dataset.poses))
    for given in (None, other):
        with pytest.raises(ModelFileError, match=r"effects\[1\]\.family: found 'humid'; .*--effects-file"):
            load_model(path, given)


def test_a_users_effect_that_is_no_data_is_refused_when_saving(dataset: Dataset, tmp_path: Path) -> None:
    own = tmp_path / "own.py"
    own.write_text(OWN.replace("joint: int", "f: object").replace("self.joint", "0") + "EFFECTS = (Humid(print),)")
    result = calib.calibrate(dataset, effects=load_effects(own, nominal_state(dataset))[0].members)
    with pytest.raises(CalibError, match="effect humid cannot be saved"):
        save_model(result, tmp_path / "m.json")
    assert not (tmp_path / "m.json").exists()


def test_it_is_of_one_arm(fitted: Calibration, dataset: Dataset, tmp_path: Path) -> None:
    loaded = FittedModel.of(fitted)
    panda = simulate_dataset("panda", rng=0, poses=20).dataset
    with pytest.raises(FitError, match="another arm"):
        loaded.evaluate(panda)
    table = dataset.robot.table
    table[-1, 2] += 5.0
    moved = replace(dataset, robot=dataset.robot.with_table(table))
    with pytest.raises(FitError, match=r"dTCP in its robot\.toml"):
        loaded.evaluate(moved)
    coupled = tuple(map(tuple, np.eye(6).tolist()))
    with pytest.raises(FitError, match="coupling in its robot"):
        loaded.evaluate(replace(dataset, robot=replace(dataset.robot, coupling=coupled)))
    write_dataset(replace(dataset, name="renamed"), tmp_path / "renamed")
    assert not loaded.is_fitted_to(load_dataset(tmp_path / "renamed"))
    assert not FittedModel.of(replace(fitted, dataset=replace(dataset, folder=None))).is_fitted_to(dataset)


# ---- hostile and damaged files --------------------------------------------------------------------------------------


def at(*place: str | int) -> Callable[[Any, Any], None]:
    """Puts a value at a place of a document."""

    def put(document: Any, value: Any) -> None:
        for key in place[:-1]:
            document = document[key]
        document[place[-1]] = value

    return put


WRONG: list[tuple[Callable[[Any, Any], None], Any, str]] = [
    (at("format"), "robot-calibration-inspector session", "format: found"),
    (at("version"), 2, "version: found 2; this program reads version 1"),
    (at("version"), True, "version: found True"),
    (at("parameters", 3, "change"), "x", r"parameters\[3\]\.change: found 'x'; a finite number"),
    (at("parameters", 3, "change"), 10**400, r"parameters\[3\]\.change"),
    (
        at("parameters", 3, "change"),
        -1e308,
        r"parameters\[3\]\.change: found -1e\+308; a number of 1e\+15 at most",
    ),
    (
        at("parameters", 3, "prior_sigma"),
        1e308,
        r"parameters\[3\]\.prior_sigma: found 1e\+308; a number of 1e\+15",
    ),
    (at("parameters", 3, "prior_sigma"), 0.0, r"parameters\[3\]\.prior_sigma: found 0"),
    (at("parameters", 3, "sigma"), -1.0, r"parameters\[3\]\.sigma"),
    (at("parameters", 3, "name"), "a1", "parameters: found one name twice"),
    (
        at("parameters", 3, "name"),
        "z",
        r"parameters\[3\]\.name: found 'z'; these effects have 'theta1' there",
    ),
    (at("parameters"), [], r"parameters\[0\]\.name: found nothing"),
    (at("parameters", 0, "change"), 1e308, "parameters|table"),
    (at("parameters", 0, "change"), 1.5, r"table\[0\]\[0\]: found"),
    (at("table", 2, 1), 7.0, r"table\[2\]\[1\]: found 7; it is not what"),
    (at("table"), [[1.0]], "table: found 1 rows; 7 rows of 5"),
    (at("loads_table"), [[1.0]], "loads_table: found 1 rows"),
    (at("loads_table"), 3, "loads_table: found 3"),
    (at("covariance"), [], "covariance: found 0 rows"),
    (at("covariance", 4), [1.0], "covariance"),
    (at("covariance", 0, 0), None, r"covariance\[0\]\[0\]: found nothing"),
    (at("effects"), [], "parameters"),
    (at("effects", 1, "family"), "no_such", r"effects\[1\]\.family: found 'no_such'"),
    (at("effects", 1, "family"), "../../x", r"effects\[1\]\.family"),
    (at("effects", 1, "fields"), {}, r"effects\[1\]\.fields\.joint: found nothing"),
    (at("effects", 1, "fields", "joint"), "1", r"effects\[1\]\.fields\.joint: found '1'"),
    (at("effects", 1, "fields", "joint"), -1, r"effects\[1\]\.fields\.joint: found -1; .* from 0 to 5"),
    (at("effects", 1, "fields", "joint"), 6, r"effects\[1\]\.fields\.joint: found 6"),
    (at("effects", 1, "fields", "order"), 10**9, r"parameters\[34\]\.name"),
    (at("effects", 1, "fields", "__class__"), "os.system", r"effects\[1\]\.fields: found '__class__'"),
    (at("effects", 1, "fields", "name"), "x", r"effects\[1\]\.fields: found 'name'"),
    (at("effects", -1, "fields", "half_mm"), 0.0, "no place can be predicted|fields that do not fit"),
    (at("effects", 1), 7, r"effects\[1\]"),
    (at("robot", "joints"), [], r"robot\.joints: found none"),
    (at("robot", "joints", 0, "type"), "screw", r"robot\.joints\[0\]\.type: found 'screw'"),
    (at("robot", "joints", 0, "a_mm"), 1e300, "beyond"),
    (at("robot", "joints", 0, "com_mm"), [1.0], r"robot\.joints\[0\]\.com_mm"),
    (at("robot", "coupling"), [[1.0]], r"robot\.coupling: found 1 rows; 6 rows of 6"),
    (at("robot"), None, "robot: found nothing"),
    (at("options", "residual"), "magic", "options.residual: found 'magic'"),
    (at("options"), [], "options: found"),
    (at("held"), ["\0"], r"held\[0\]"),
    (at("scanner_T_base", ""), np.zeros((4, 4)).tolist(), "scanner_T_base.: found no rigid motion"),
    (at("scanner_T_base", ""), [[1.0]], "scanner_T_base.: found 1 rows"),
    (at("scanner_T_base", ""), None, "scanner_T_base."),
    (at("dataset", "files"), {"robot.toml": 3}, r"dataset\.files\.robot\.toml: found 3"),
    (at("after", "test", "rmse_mm"), "best", r"after\.test\.rmse_mm: found 'best'"),
    (at("needs"), "time_s", "needs: found"),
]


@pytest.mark.parametrize(("put", "value", "says"), WRONG, ids=[f"{i}" for i in range(len(WRONG))])
def test_a_wrong_value_is_one_line_with_its_place(
    saved: Path, put: Callable[[Any, Any], None], value: Any, says: str
) -> None:
    document = json.loads(saved.read_text())
    put(document, value)
    saved.write_text(json.dumps(document))
    with pytest.raises(CalibError, match=says) as raised:
        load_model(saved)
    assert str(raised.value).startswith(f"{saved}: ")
    assert "\n" not in str(raised.value)
    assert len(str(raised.value)) < 400


@pytest.mark.parametrize("key", ["robot", "table", "effects", "parameters", "covariance", "after", "needs"])
def test_a_missing_key_is_named(saved: Path, key: str) -> None:
    document = json.loads(saved.read_text())
    del document[key]
    saved.write_text(json.dumps(document))
    with pytest.raises(ModelFileError, match=f"{key}: found nothing"):
        load_model(saved)


@pytest.mark.parametrize(
    "content", [b"", b"{", b"[]", b"\xff\xfe", b"[" * 100_000, b'{"format": NaN}', b"null", b"9" * 6000]
)
def test_no_json_is_one_line(saved: Path, content: bytes) -> None:
    saved.write_bytes(content)
    with pytest.raises(ModelFileError) as raised:
        load_model(saved)
    assert "\n" not in str(raised.value)


def test_every_cut_and_every_infinite_number_is_one_line(saved: Path) -> None:
    text = saved.read_text()
    for end in range(0, len(text) - 2, len(text) // 40):
        saved.write_text(text[:end])
        with pytest.raises(ModelFileError):
            load_model(saved)
    saved.write_text(text.replace('"change": ', '"change": 1e999, "was": ', 1))
    with pytest.raises(ModelFileError, match=r"parameters\[0\]\.change: found inf"):
        load_model(saved)


def test_a_missing_file_and_a_folder(tmp_path: Path) -> None:
    with pytest.raises(ModelFileError, match="no such model file"):
        load_model(tmp_path / "none.json")
    with pytest.raises(ModelFileError, match="this is no file"):
        load_model(tmp_path)
