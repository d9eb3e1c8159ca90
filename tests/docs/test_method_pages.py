"""The pages of the method say what the code has: its constants, its modules."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from calib import statistics
from calib.corners.correlated_noise import likelihood, posterior
from calib.dataset.repeats import SIGMA_DOUBT
from calib.diagnosis import decision_rules, learning, search_space, verdict
from calib.effects.link_errors import TOLERANCE_MM, TOLERANCE_RAD
from calib.fitting import robust, trust_region
from calib.identifiability import redundancy
from calib.planes import clustering, robust_fit
from calib.planning import discrimination, prediction
from calib.screening import (
    blunders,
    evidence,
    member_columns,
    noise_search,
    nuisance,
    projected_residual,
    residual_tests,
    scan_statistic,
    smooth_motions,
    sparse_evidence,
)
from calib.screening.candidates import MIN_CONFOUNDED_OVERLAP, MIN_LOG_BAYES_FACTOR
from calib.screening.curves import curve_evidence, joint_curves, law_search, laws
from calib.screening.curves.smooth_joint_error import LAW_BOUNDS

ROOT = Path(__file__).parents[2]
METHOD = ROOT / "docs" / "method"


def percent(share: float) -> str:
    return f"{100.0 * share:g} %"


def row(values: object) -> str:
    """0.04, 0.12 and 0.35."""
    *some, last = (f"{value:g}" for value in np.atleast_1d(np.asarray(values)))
    return f"{', '.join(some)} and {last}"


# What a page says, with the code's constant in it.
SAID = [
    ("corners", f"$s$ = {statistics.MAD_TO_SIGMA:g} times the median"),
    ("corners", f"( h / {robust_fit.TUKEY:g} s )^2"),
    ("corners", f"$h$ of {row(clustering._NARROWING)} sigmas"),
    ("corners", f"{len(likelihood.LENGTHS)} lengths $l$ and {len(posterior.SIZES)} sizes"),
    ("redundancy", rf"$|r| \ge 1 - 10^{{{np.log10(redundancy._SAME):.0f}}}$"),
    ("redundancy", f"$10^{{{np.log10(redundancy._ZERO):.0f}}}$ of the largest"),
    ("redundancy", f"A rest below $10^{{{np.log10(redundancy._DEPENDENT):.0f}}}$"),
    ("fitting", f"({TOLERANCE_MM:g} mm, {np.degrees(TOLERANCE_RAD):g}°"),
    ("fitting", f"by more than {trust_region._CONVERGED:g} of its sigma"),
    ("fitting", f"F distribution with {robust._TAIL:g} degrees of freedom below, at {robust.LEVEL:g} over"),
    ("screening", f"s_i > {projected_residual._KNOWN:g} \\, \\sigma"),
    ("screening", f"less than {percent(member_columns._HIDDEN)} is left"),
    ("screening", f"each mass ({percent(nuisance.MASS_SHARE)} off)"),
    ("screening", f"each centre of mass ({nuisance.CENTRE_MM:g} mm off)"),
    ("screening", f"a grid of {len(evidence.SCALES)} from {evidence.SCALES[0]:g} to {evidence.SCALES[-1]:,.0f}"),
    ("screening", f"has to gain {evidence.GAIN:g} more"),
    ("screening", f"by ${evidence._SIGN_PRIOR:g} \\cdot 2^k"),
    ("screening", f"each member costs {sparse_evidence.RARITY:g} nats more"),
    ("screening", f"From {MIN_CONFOUNDED_OVERLAP:g} on the two are confounded"),
    ("decisions", f"has to be below {decision_rules.MAX_P_VALUE:g}"),
    ("decisions", f"Its log evidence has to be above {decision_rules.MIN_LOG_EVIDENCE:g}."),
    ("decisions", f"more than {MIN_LOG_BAYES_FACTOR:g} above that of every effect confounded with it"),
    ("decisions", f"confounded with it (overlap above {MIN_CONFOUNDED_OVERLAP:g}"),
    ("decisions", f"\\bar c > {decision_rules.MAX_WORSENING:g} \\;"),
    ("decisions", f"shared span above {decision_rules.EQUIVALENT_OVERLAP:g}, difference below"),
    ("decisions", f"below {decision_rules.EQUIVALENT_LOG_BAYES_FACTOR:g} nats"),
    ("decisions", f"at most {verdict.MAX_SIGMAS_LEFT:g} times the noise"),
    ("decisions", {3: "three times at most"}[search_space.MAX_EFFECTS]),
    ("decisions", {0.1: "up to a tenth"}[blunders.MAX_OUTLIER_SHARE]),
    *(("decisions", f"| `{name}` |") for name in verdict.VERDICTS),
    ("residual_tests", f"at {scan_statistic._CENTRES} centres"),
    ("residual_tests", f"$w$ = {row(scan_statistic._WIDTHS)}"),
    ("residual_tests", f"{residual_tests.DRAWS} draws of noise"),
    ("residual_tests", f"Below {residual_tests.STRUCTURE_LEVEL:g} the residual has a systematic pattern"),
    ("residual_tests", f"in {percent(residual_tests.OUTLIER_LEVEL)} of the draws"),
    ("residual_tests", f"From {residual_tests.FAULT_EVIDENCE:g} nats on"),
    ("residual_tests", f"$l$ = {row(smooth_motions._OWN_RAD)} rad over its own angle"),
    ("residual_tests", f"{row(smooth_motions._ARM_RAD)} rad over the first three"),
    ("residual_tests", f"|r|^2 / {SIGMA_DOUBT:g}^2"),
    ("curves", "harmonics $n$ = 1 to {}, or to {} or {}".format(*joint_curves._BANDS)),
    ("curves", f"has not fallen to {percent(joint_curves._MAY_GO_ON)}"),
    ("curves", "$n_0$ ({:g} to {:g})".format(*curve_evidence._BANDWIDTHS)),
    ("curves", "$p$ ({:g} to {:g})".format(*curve_evidence._SLOPES)),
    ("curves", f"is {joint_curves.MIN_LOG_EVIDENCE:g} or more over no curve"),
    ("curves", f"if it gains {joint_curves._MIN_GAIN:g} nats beyond"),
    ("curves", f"worth less than {joint_curves._MIN_MEMBER_GAIN:g} nats"),
    ("curves", f"move the residual by {joint_curves.MIN_VISIBLE:g} sigma"),
    ("curves", f"waves, $n$ to {laws._OWN_WAVES[-1]};"),
    ("curves", f"waves, $n$ to {laws._LOAD_WAVES[-1]}, and a slope"),
    ("curves", f"waves of $q_i$ to $n$ = {laws._OTHER_WAVES[-1]}"),
    ("curves", f"to $n$ = {laws._SUM_WAVES[-1]}, neighbours or not"),
    ("curves", f"needs {law_search.MIN_FIRST_GAIN:g} nats, up to two more {law_search.MIN_FURTHER_GAIN:g} each"),
    ("curves", f"within {joint_curves._MAY_LOSE:g} nats, with a third of their parameters"),
    ("curves", f"falls by {law_search.MIN_STANDARD_ERRORS:g} standard errors"),
    ("curves", f"every law is {learning.MIN_SIGMAS:g} sigma from zero, and below {LAW_BOUNDS[0].size:g} rad"),
    ("curves", f"the error of the test poses falls by {percent(learning.MIN_FALL)}"),
    ("curves", f"the laws that say as much within {law_search.AS_LIKELY:g} nats"),
    ("noise", f"A property gains {noise_search.MIN_GAIN:g} nats, after {noise_search._PARAMETER_COST:g} nats for each"),
    ("noise", f"tails have to lead gross errors by {noise_search.MIN_TAIL_GAIN:g}"),
    ("noise", f"$t$ with {noise_search._TAILS[0]:g} to {noise_search._TAILS[-1]:g} degrees"),
    ("planning", f"the band of {percent(prediction.SHARE)} of arms"),
    ("planning", f"{discrimination._DRAWS} draws for each hypothesis"),
]  # fmt: skip


@pytest.mark.parametrize(("page", "said"), SAID, ids=[f"{page}: {said[:40]}" for page, said in SAID])
def test_a_page_has_the_codes_constant(page: str, said: str):
    text = " ".join((METHOD / f"{page}.md").read_text(encoding="utf-8").split())
    assert " ".join(said.split()) in text


@pytest.mark.parametrize("page", sorted(METHOD.glob("*.md")), ids=lambda page: page.stem)
def test_modules_that_a_page_names_are_there(page: Path):
    """A name without a folder is in the folder that was named last, or below it."""
    folder = Path()
    for name in re.findall(r"`([\w./]+(?:\.py|/))`", page.read_text(encoding="utf-8")):
        named = name.startswith(("calib/", "inspector/", "benchmarks/", "tests/"))
        if named:
            assert (ROOT / name).exists(), name
            folder = (ROOT / name).parent if name.endswith(".py") else ROOT / name
        else:
            assert (folder / name).exists() or (ROOT / "benchmarks" / name).exists(), f"{name} in {folder}"


def test_every_page_has_its_parts():
    for page in METHOD.glob("*.md"):
        if page.stem in ("index", "glossary", "references"):
            continue
        text = page.read_text(encoding="utf-8")
        assert "$$" in text, page
        for part in ("## In the code", "## What was measured", "## Limits"):
            assert part in text, (page, part)
