"""Presentation of what an arm's own signals tell: loads by measured torques, drives by encoders on the links."""

from __future__ import annotations

from typing import Any

from calib.kinematics.robot import DriveTerm, LinkEncoder, MeasuredLoad, Robot
from calib.present.effects import with_key
from calib.present.results import document, keys_of
from calib.rendering import numbers
from calib.rendering.blocks import Paragraph, Section, Words, joined, spans

DRIVES = "Between motors and links"
_SHOWN_VALUES = 2  # of a law, that are written out
_UNITS = {"joint_compliance": "rad/Nm", "joint_scale": "1"}


def drive_sections(robot: Robot) -> list[Section]:
    """Section on what encoders on the links show of the drives; [] where there are none."""
    sentences = drive_sentences(robot)
    return [Section(DRIVES, [Paragraph(words) for words in sentences], brief=True)] if sentences else []


def drive_sentences(robot: Robot) -> list[Words]:
    """A sentence for each encoder on a link: the difference to the motor, its causes, and what is left."""
    return [_drive(encoder) for encoder in robot.link_encoders]


def _drive(encoder: LinkEncoder) -> Words:
    rms = numbers.size(encoder.rms_rad, "rad")
    left = numbers.size(encoder.left_rad, "rad")
    off = f"Joint {encoder.joint + 1}: its link is off from its motor by {rms} RMS, beside a constant"
    terms = joined(spans(with_key(effect_of(term)), _values(term)) for term in encoder.terms)
    noise = ""
    if encoder.sigma_rad is not None:
        beyond = encoder.left_rad > 1.3 * encoder.sigma_rad
        declared = numbers.size(encoder.sigma_rad, "rad")
        noise = f", {'more than' if beyond else 'as'} the declared noise, {declared}{', explains' if beyond else ''}"
    nothing = "; no law of a drive explains it" if not encoder.terms else ""
    return spans(
        off, ": " if encoder.terms else "", terms,
        f"{nothing}. {numbers.capitalised(left)} are left{noise}. The model takes the encoder's angle, so none of this "
        "is fitted to the measured points; where the encoder was not read, these laws stand in.",
    )  # fmt: skip


def _values(term: DriveTerm) -> str:
    share = f" ({numbers.bounded_share(min(max(term.share, 0.0), 1.0))} of the squared difference"
    if len(term.values) > _SHOWN_VALUES:
        return f"{share})"
    waves = f", {term.law.removeprefix('harmonic ')} a turn" if term.law.startswith("harmonic") else ""
    unit = _UNITS.get(term.law, "rad")
    values = [numbers.with_sigma(v, s, unit) for v, s in zip(term.values, term.sigmas, strict=True)]
    return f"{share}{waves}, {numbers.listing(values)})"


def effect_of(term: DriveTerm) -> str:
    """Name in the catalogue of the effect that a law between motor and link stands for."""
    if term.law == "unknown_masses":
        return "joint_compliance"
    return "transmission_error" if term.law.startswith("harmonic") else term.law


def signals_document(robot: Robot) -> dict[str, Any]:
    """Keys of --json on measured torques and on encoders of links."""
    return {"measured_loads": robot.measured_loads, "drives": robot.link_encoders}


@document.register
def _measured_load_document(load: MeasuredLoad) -> dict[str, Any]:
    return {
        "joint": load.joint + 1,
        "column": f"torque{load.joint + 1}_nm",
        "of": "load" if load.sign > 0.0 else "drive",
        "explained_by_weight": load.explained,
        **keys_of(load, "sigma_nm", "sigma_from", "trust", "offset_nm", "friction_nm"),
    }


@document.register
def _link_encoder_document(encoder: LinkEncoder) -> dict[str, Any]:
    return {
        "joint": encoder.joint + 1,
        "column": f"link_q{encoder.joint + 1}_deg",
        **keys_of(encoder, "offset_rad", "rms_rad", "left_rad", "sigma_rad"),
        "causes": [
            {
                "cause": effect_of(term),
                **keys_of(term, "law", "values", "sigmas", "share"),
                "unit": _UNITS.get(term.law, "rad") if len(term.values) <= _SHOWN_VALUES else None,
            }
            for term in encoder.terms
        ],
    }
