"""An effect has its page, with its two pictures. The build of the documentation makes those of the whole catalogue."""

from __future__ import annotations

import re
import sys
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from calib.effects.catalogue import CATALOGUE
from calib.effects.catalogue.joints import JointScale
from calib.effects.effect import CatalogueEffect

DOCS = Path(__file__).parents[2] / "docs"
SOME = [kind for kind in CATALOGUE if kind.name in ("link_bending", "joint_scale", "joint_dent", "scanner_scale")]
pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def effects() -> ModuleType:
    sys.path.insert(0, str(DOCS / "extensions"))
    try:
        import effects
    finally:
        sys.path.pop(0)
    return effects


@pytest.fixture(scope="module")
def pages(effects: ModuleType, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("effects")
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(effects, "CATALOGUE", SOME)
        effects.write_pages(folder)
    return folder


@pytest.fixture(scope="module")
def standard(effects: ModuleType):
    return sys.modules["effect_signatures"].Standard.made()


@pytest.mark.parametrize("kind", SOME, ids=lambda kind: kind.name)
def test_every_effect_has_a_page_with_two_pictures_that_are_told_in_words(kind: type[CatalogueEffect], pages: Path):
    page = (pages / f"{kind.name}.md").read_text(encoding="utf-8")
    assert page.startswith(f"# {kind.name}\n")
    words = re.findall(r'<svg [^>]*role="img" aria-label="([^"]+)"', page)
    assert len(words) == 2
    assert all(kind.name in told and len(told) > 80 for told in words)
    assert kind.equation in page
    assert kind.needs in page
    assert len(page) < 80_000
    assert "nan" not in re.sub(r"[a-z]*nan[a-z]+", "", page)


def test_the_index_shows_all_of_them_once_with_a_picture(pages: Path):
    index = (pages / "index.inc").read_text(encoding="utf-8")
    assert sorted(re.findall(r"grid-item-card\} (\w+)", index)) == sorted(kind.name for kind in SOME)
    assert index.count("<svg ") == len(SOME)


def test_a_scale_of_the_scanner_leaves_nothing_and_the_page_says_so(standard, pages: Path):
    signature = standard.signature("scanner_scale")
    assert signature.rms_mm[0] > 0.05
    assert signature.left == 0.0
    assert "Nothing is left" in (pages / "scanner_scale.md").read_text(encoding="utf-8")


def test_joint_scale_is_drawn_over_its_joint_as_the_line_that_it_is(standard):
    signature = standard.signature("joint_scale")
    joint = signature.member.joint
    turn = signature.channel.of(signature.before_mm.ravel() / standard.noise_mm)
    shown = signature.channel.tells
    q = standard.state.poses.q[:, joint]
    assert signature.input.label == f"angle of joint {joint + 1}, deg"
    k = JointScale.parameters[0].scale
    np.testing.assert_allclose(turn[shown], 1e3 * k * q[shown], atol=1e-9)
