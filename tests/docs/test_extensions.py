"""What the documentation is built with: equations as MathML, comments beside fields, scripts of the gallery."""

from __future__ import annotations

import re
import sys
from importlib import import_module
from typing import Any

import pytest

from tests.support import ROOT

pytest.importorskip("sphinx")


@pytest.fixture(scope="module", autouse=True)
def extensions() -> Any:
    sys.path.insert(0, str(ROOT / "docs" / "extensions"))
    yield
    sys.path.remove(str(ROOT / "docs" / "extensions"))


def test_comments_beside_fields_become_their_documentation():
    from sphinx.pycode import ModuleAnalyzer

    source = '''
class Points:
    """Points."""

    xyz_mm: list  # (M, 3), *scanner* frame
    covariance: list = None  # (M, 3, 3)
    # (K, 3) told before it,
    # in two lines
    normals: list
    order: int = 0
    """(M,) told behind it."""
    bare: int = 1
'''
    marked = import_module("reference").with_marked_comments(source)
    docs = ModuleAnalyzer.for_string(marked, "made").find_attr_docs()
    assert docs["Points", "xyz_mm"][0] == r"(M, 3), \*scanner* frame"
    assert docs["Points", "covariance"][0] == "(M, 3, 3)"
    assert docs["Points", "normals"][0] == "(K, 3) told before it, in two lines"
    assert docs["Points", "order"][0] == "(M,) told behind it."
    assert ("Points", "bare") not in docs


def test_every_name_of_the_public_face_is_in_the_reference():
    import calib

    text = "\n".join(path.read_text(encoding="utf-8") for path in (ROOT / "docs" / "api").glob("*.md"))
    directives = re.findall(r"^\.\. module-members:: (\S+)(.*)$", text, re.MULTILINE)
    modules = {module: names.split() for module, names in directives}

    def is_there(name: str, module: str) -> bool:
        in_module = module in modules and isinstance(getattr(calib, name), type) and name in (modules[module] or [name])
        return in_module or any(f".. auto{kind}:: {name}\n" in text for kind in KINDS)

    assert [name for name, module in calib._HOME.items() if not is_there(name, module)] == []


KINDS = ("function", "class", "exception")


def test_a_name_in_a_signature_leads_to_what_it_names():
    """An alias such as ArrayLike keeps its name: it is no `Union`."""
    from calib.dataset.dataset import Points
    from calib.simulation.simulate import simulate_dataset

    full_names = import_module("reference").full_names
    select, simulate = Points.select, simulate_dataset
    assert full_names("ArrayLike | None", select) == "ArrayLike | None"
    assert full_names("Array", select) == "Array"
    assert full_names("Mapping[str, Robot]", select) == "collections.abc.Mapping[str, calib.kinematics.robot.Robot]"
    assert full_names("Sequence[EffectRequest]", simulate).endswith("Sequence[calib.simulation.simulate.EffectRequest]")
