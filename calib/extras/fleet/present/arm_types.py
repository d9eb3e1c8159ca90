"""Presentation of what arms of a type share, and of a fit that began from it."""

from __future__ import annotations

from typing import Any

import numpy as np

from calib.extras.fleet.arm_type import ArmType, LeftOutArm, PooledFit, TypeReport
from calib.present.results import document, keys_of, presentation
from calib.rendering import numbers
from calib.rendering.blocks import Block, Paragraph, Presentation, Section, Table, Verdict
from calib.rendering.colours import DOUBT, GOOD

_TOLD = 3.0  # sigmas of the mean, from which arms share a value other than zero


@presentation.register
def _type_report(report: TypeReport) -> Presentation:
    of = report.arm_type
    head: list[Block] = [Verdict(_verdict(report), GOOD if report.left_out else DOUBT)]
    sections = []
    if report.left_out:
        sections.append(Section("Each arm left out, and begun from the others", [_table(report)], brief=True))
    shared = _shared(of)
    if shared.rows:
        sections.append(Section("What the arms share most", [shared], brief=True))
    return Presentation(f"What {len(of.arms)} arms of the type {of.robot} share", head, sections)


def _verdict(report: TypeReport) -> str:
    arms = numbers.listing(report.arm_type.arms)
    if not report.left_out:
        return f"Learned from {arms}; with three arms or more it could be tried on each."
    worst = max(report.left_out, key=lambda one: one.ratio)
    poses = report.left_out[0].poses
    return (
        f"With {numbers.count(poses, 'pose')}, an arm that begins from its type has "
        f"{numbers.share(report.mean_ratio)} of the error that it has alone (geometric mean of "
        f"{len(report.left_out)} arms, each fitted from the others); {worst.name} gains least, "
        f"{numbers.share(worst.ratio)}."
    )


def _table(report: TypeReport) -> Table:
    rows = [
        (
            one.name, numbers.column_mm(one.alone_mm), numbers.column_mm(one.pooled_mm), numbers.share(one.ratio),
            f"{one.log_bayes_factor:.1f}", "type" if one.is_of_type else "arm alone",
        )
        for one in report.left_out
    ]  # fmt: skip
    columns = ("arm", "alone, mm", "from its type, mm", "share", "log Bayes factor", "prior")
    return Table(columns, rows, caption="3D RMSE at all poses that were not fitted")


def _shared(of: ArmType) -> Table:
    """Parameters whose mean is not zero, the clearest first, a dozen at most."""
    found = [(name, mean, of.prior.sigmas[name]) for name, mean in of.prior.means.items()]
    clear = [one for one in found if abs(one[1]) * np.sqrt(len(of.arms)) > _TOLD * one[2]]
    clear = sorted(clear, key=lambda one: -abs(one[1]) / one[2])[:12]
    rows = [(numbers.parameter_label(name), f"{mean:.3g}", f"{sigma:.2g}") for name, mean, sigma in clear]
    return Table(("parameter", "mean, mm or rad or the effect's unit", "another arm's sigma about it"), rows)


@document.register
def _type_report_document(report: TypeReport) -> dict[str, Any]:
    return {
        **keys_of(report.arm_type, "robot", "arms", "parameters"),
        "mean_ratio": report.mean_ratio if report.left_out else None,
        "left_out": [_left_out(one) for one in report.left_out],
    }


def _left_out(one: LeftOutArm) -> dict[str, Any]:
    told = {"arm": one.name, "alone_rmse_mm": one.alone_mm, "pooled_rmse_mm": one.pooled_mm}
    return told | keys_of(one, "poses", "ratio", "is_of_type", "log_bayes_factor")


def pooled_block(found: PooledFit, arm_type: ArmType) -> Paragraph:
    """Sentence on whether a fit began from its type."""
    arms, lead = f"{numbers.count(len(arm_type.arms), 'arm')} of the type {arm_type.robot}", found.log_bayes_factor
    if not found.is_of_type:
        return Paragraph(f"Fitted alone: that it is like {arms} does not show (log Bayes factor {lead:.1f}).")
    return Paragraph(f"Began from {arms}: the log Bayes factor over the arm alone is {lead:.1f}.")


def pooled_document(found: PooledFit, arm_type: ArmType) -> dict[str, Any]:
    """JSON value of how a fit began."""
    return keys_of(arm_type, "robot", "arms") | keys_of(found, "is_of_type", "log_bayes_factor")
