"""Results as dicts and in notebooks: every name that points upwards leads somewhere, all is strict, all is escaped."""

from __future__ import annotations

import json
import math
import pickle
from dataclasses import is_dataclass, replace
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest

import calib
from calib import check, compare, redundancy
from calib.corners.batch import CornerBatch
from calib.corners.search import failed_search
from calib.dataset.dataset import Dataset
from calib.diagnosis.result import Diagnosis
from calib.options import FitOptions
from calib.planning.plan import Plan, plan_poses
from calib.planning.start import start_of_dataset
from calib.present.results import document, presentation
from calib.presented import Presented
from calib.rendering.numbers import parameter_label
from calib.strict_json import plain, to_json
from calib.validation.comparison import Comparison
from tests.support.commands import answered

SAMPLES = Path(__file__).parents[2] / "sample_data"
HOSTILE = "<script>alert('x')</script>"


@pytest.fixture(scope="module")
def dataset() -> Dataset:
    return calib.load_dataset(SAMPLES / "hidden_effect_a")


@pytest.fixture(scope="module")
def found(dataset: Dataset) -> Diagnosis:
    return calib.diagnose(dataset)


@pytest.fixture(scope="module")
def corners() -> CornerBatch:
    few = calib.load_dataset(SAMPLES / "rb5_repeats")
    out = [pose_id for pose_id in few.poses.ids if pose_id not in ("P1_01", "P2_01", "P3_01")]
    return calib.find_corners(few.leave_out(out), intermediate=False)


@pytest.fixture(scope="module")
def plan(dataset: Dataset) -> Plan:
    return plan_poses(start_of_dataset(dataset, FitOptions()), 3, candidates=60)


@pytest.fixture(scope="module")
def compared(found: Diagnosis) -> Comparison:
    one = found.steps[0].calibration
    return compare(one, replace(one, dataset=replace(one.dataset, name="again")))


class Fragment(HTMLParser):
    """Elements of a piece of HTML, checked to be closed in the order that they were opened."""

    VOID = ("br", "meta", "rect", "path", "circle")

    def __init__(self, html: str) -> None:
        super().__init__()
        self.seen: list[str] = []
        self.attributes: list[tuple[str, str | None]] = []
        self.text = ""
        self._open: list[str] = []
        self.feed(html)
        self.close()
        assert self._open == []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.seen.append(tag)
        self.attributes += attrs
        if tag not in self.VOID:
            self._open.append(tag)

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.seen.append(tag)
        self.attributes += attrs

    def handle_endtag(self, tag: str) -> None:
        if tag not in self.VOID:
            assert self._open.pop() == tag

    def handle_data(self, data: str) -> None:
        self.text += data


def safe(html: str) -> Fragment:
    """The fragment, which holds no script and nothing that a browser would fetch or run."""
    fragment = Fragment(html)
    assert fragment.seen[0] == "div"
    assert not {"script", "link", "iframe", "img", "object"} & set(fragment.seen)
    assert not [name for name, _ in fragment.attributes if name.startswith("on") or name in ("src", "href")]
    assert "url(" not in html.replace("url(#", "")
    assert "@import" not in html
    return fragment


def test_every_result_has_its_telling_and_its_document() -> None:
    with pytest.raises(TypeError, match="nothing is told of a object"):
        presentation(object())  # which loads all that register
    for kind in Presented.__subclasses__():
        assert presentation.dispatch(kind) is not presentation.dispatch(object), kind
        assert document.dispatch(kind) is not document.dispatch(object) or is_dataclass(kind), kind


def numbers_in(value: object) -> list[float]:
    if isinstance(value, dict):
        return [n for item in value.values() for n in numbers_in(item)]
    if isinstance(value, list):
        return [n for item in value for n in numbers_in(item)]
    return [value] if isinstance(value, float) else []


@pytest.mark.slow
def test_to_dict_is_what_the_command_prints(dataset: Dataset, found: Diagnosis) -> None:
    printed = answered("diagnose", SAMPLES / "hidden_effect_a")
    assert json.loads(json.dumps(found.to_dict(), allow_nan=False)) == printed
    printed = answered("calibrate", SAMPLES / "hidden_effect_a")
    own = calib.calibrate(dataset).to_dict()
    assert own.items() <= printed.items()  # the command adds its table and way


def test_the_dict_and_the_frame_of_corners_agree_and_both_are_pickled(corners: CornerBatch) -> None:
    document = corners.to_dict()
    assert [one["pose"] for one in document["corners"]] == list(corners)
    json.dumps(document, allow_nan=False)
    frame = corners.to_frame()
    assert frame["pose"].tolist() == list(corners)
    for row, one in zip(frame.to_dict("records"), document["corners"], strict=True):
        assert [row["x_mm"], row["y_mm"], row["z_mm"]] == one["xyz_mm"]
    again = pickle.loads(pickle.dumps(corners))
    assert isinstance(again, CornerBatch)
    assert list(again) == list(corners)


def test_poses_come_as_the_table_that_is_written(dataset: Dataset, plan: Plan) -> None:
    for frame, poses in ((dataset.to_frame(), dataset.poses), (plan.to_frame(), plan.poses)):
        assert tuple(frame["pose"]) == poses.ids
        np.testing.assert_allclose(np.radians(frame["q2_deg"]), poses.q[:, 1])


def test_a_diagnosis_is_shown_without_learning_anything(found: Diagnosis, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delattr("calib.diagnosis.effect_selection.learn_joint_curves")
    assert "transmission error" in found._repr_html_()


@pytest.mark.thorough
def test_dicts_are_strict_whatever_is_missing(
    dataset: Dataset, plan: Plan, compared: Comparison, corners: CornerBatch
) -> None:
    lost = CornerBatch(corners.dataset, {**corners, "P1_01": failed_search("P1_01", "nothing there")})
    results: list[Presented] = [plan, compared, lost, redundancy(dataset), check(dataset)]
    for result in results:
        document = result.to_dict()
        assert all(map(math.isfinite, numbers_in(document)))
        assert json.loads(json.dumps(document, allow_nan=False)) == document
    assert lost.to_dict()["failed"][0]["reason"] == "nothing there"
    assert plain({"a": float("nan"), "b": (1, 2.5)}) == json.loads(to_json({"a": math.nan, "b": [1, 2.5]}))


def hostile(dataset: Dataset) -> Dataset:
    named = replace(dataset, name=HOSTILE, description=HOSTILE, notes=(HOSTILE,), warnings=(HOSTILE,))
    poses = replace(dataset.poses, ids=tuple(f"{HOSTILE}{pose_id}" for pose_id in dataset.poses.ids))
    return replace(named, poses=poses, robot=replace(dataset.robot, name=HOSTILE))


@pytest.mark.slow
@pytest.mark.parametrize("with_figures", [False, True])
def test_views_escape_every_name(
    dataset: Dataset, corners: CornerBatch, with_figures: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    if not with_figures:  # as where the extra `page` is not installed
        monkeypatch.setattr("calib.present.results._installed_draw", lambda: None)
        monkeypatch.setattr("calib.present.results._installed_draw", lambda: None)
    names = hostile(dataset)
    found = calib.diagnose(names)
    odd = CornerBatch(names, {HOSTILE: failed_search(HOSTILE, HOSTILE), **corners})
    one = found.steps[0].calibration
    results: list[Presented] = [
        names, found, found.calibration, odd, plan_poses(start_of_dataset(names, FitOptions()), 2, candidates=60),
        compare(one, one), redundancy(names),
    ]  # fmt: skip
    told = [safe(result._repr_html_()) for result in results]
    assert all(HOSTILE in view.text for view in told[:-1])
    drawn = ["svg" in view.seen for view in told]
    assert drawn == [with_figures and of in (1, 2, 4, 6) for of in range(len(told))]


@pytest.mark.slow
def test_views_tell_the_numbers_of_the_results(dataset: Dataset, found: Diagnosis) -> None:
    of_dataset = safe(dataset._repr_html_()).text
    assert f"{dataset.robot.name}, {dataset.robot.n_joints} joints" in of_dataset
    test = found.calibration.after.test
    assert f"{test.rmse_mm:.4f}" in safe(found.calibration._repr_html_()).text
    of_diagnosis = safe(found._repr_html_()).text
    assert found.missing[0] in of_diagnosis
    for name in found.calibration.to_frame()["name"]:
        assert parameter_label(name.partition(".")[2] or name) in of_diagnosis


def test_ipython_shows_the_summary_as_plain_text(
    dataset: Dataset, found: Diagnosis, plan: Plan, corners: CornerBatch, compared: Comparison
) -> None:
    plain_text = pytest.importorskip("IPython.core.formatters").PlainTextFormatter()
    results: list[Presented] = [
        dataset, found, found.calibration, plan, corners, compared, redundancy(dataset),
    ]  # fmt: skip
    for result in results:
        assert plain_text(result) == result.summary()
        assert len(result.summary()) < 20_000
    assert "64: 1 reference, 50 training and 13 test" in dataset.summary()
