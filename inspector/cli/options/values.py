"""Parsers of option values; a wrong value is reported in one line."""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable
from pathlib import Path

from calib.dataset_import.typed_values import typed_length_mm, typed_point_mm, typed_size
from calib.options import PLAN_REGIONS

_HEAVIEST_KG = 1e4
_LONGEST_S = 1e6  # what a lock of the system waits for is bounded


def named_number(text: str) -> tuple[str, float]:
    """Name and number of "a1=0.5"."""
    name, _, value = text.partition("=")
    try:
        return name.strip(), float(value)
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text!r} is not NAME=VALUE, such as a1=0.5") from None


def xacro_argument(text: str) -> tuple[str, str]:
    """Name and value of "name:=ur10e"."""
    name, between, value = text.partition(":=")
    if not between or not name.strip():
        raise argparse.ArgumentTypeError(f"{text!r} is not NAME:=VALUE, such as name:=ur10e")
    return name.strip(), value


def named_folder(text: str) -> tuple[str, Path]:
    """Name and folder of "ur_description=ros/ur_description"."""
    name, _, folder = text.partition("=")
    if not name.strip() or not folder:
        raise argparse.ArgumentTypeError(f"{text!r} is not NAME=FOLDER, such as ur_description=ros/ur_description")
    return name.strip(), Path(folder)


def process_count(text: str) -> int:
    """Number of processes, at least 1."""
    return whole(text, 1, 1024, "number of processes")


def port(text: str) -> int:
    """TCP port from an option's text; 0 selects a free one."""
    return whole(text, 0, 65535, "port")


def pose_count(text: str) -> int:
    """Number of poses to plan, from an option's text."""
    return whole(text, 1, 200, "number of poses")


def simulated_pose_count(text: str) -> int:
    """Number of poses to simulate, from an option's text."""
    return whole(text, 1, 100_000, "number of poses")


def seed(text: str) -> int:
    """Seed of random numbers, from an option's text."""
    return whole(text, 0, 2**63 - 1, "seed")


def plan_region(text: str) -> str | tuple[float, ...]:
    """Name of a region to plan for, or the box "x0,x1,y0,y1,z0,z1"."""
    if text in PLAN_REGIONS:
        return text
    try:
        return box(text)
    except argparse.ArgumentTypeError:
        known = ", ".join(PLAN_REGIONS)
        raise argparse.ArgumentTypeError(f"{text!r} is none of {known}, and no box X0,X1,Y0,Y1,Z0,Z1 in mm") from None


def box(text: str) -> tuple[float, ...]:
    """Box along the axes of the base frame, mm, from "x0,x1,y0,y1,z0,z1"."""
    numbers = tuple(map(_number, text.split(",")))
    ordered = len(numbers) == 6 and all(low < high for low, high in zip(numbers[::2], numbers[1::2], strict=True))
    if not ordered or not all(map(math.isfinite, numbers)):
        raise argparse.ArgumentTypeError(
            f"{text!r} is no box; give X0,X1,Y0,Y1,Z0,Z1 in mm of the base frame, each first number below its second"
        )
    return numbers


def scanner_place(text: str) -> tuple[float, ...]:
    """Scanner position and the point that it looks at, mm, from "x,y,z" or "x,y,z,x,y,z"."""
    try:
        numbers = tuple(float(word) for word in text.split(","))
    except ValueError:
        numbers = ()
    if len(numbers) not in (3, 6) or not all(map(math.isfinite, numbers)):
        raise argparse.ArgumentTypeError(
            f"{text!r} is no place; give X,Y,Z in mm, such as 1400,0,500, then the X,Y,Z that it looks at if you like"
        )
    return numbers


def sigma_mm(text: str) -> float:
    """Standard deviation above 0, mm."""
    try:
        return typed_length_mm(text)
    except ValueError as error:
        raise argparse.ArgumentTypeError(str(error)) from None


def length_or_mass(text: str) -> float:
    """Number above 0, mm or kg."""
    try:
        return typed_size(text)
    except ValueError as error:
        raise argparse.ArgumentTypeError(str(error)) from None


def tool_mm(text: str) -> tuple[float, float, float]:
    """Measured point in the flange's frame, mm, from "x,y,z"."""
    try:
        return typed_point_mm(text)
    except ValueError as error:
        raise argparse.ArgumentTypeError(str(error)) from None


def number_that(holds: Callable[[float], bool], fault: str) -> Callable[[str], float]:
    """Parser of a number for which a condition holds; `fault` is what it is not, and what is wanted."""

    def parse(text: str) -> float:
        value = _number(text)
        if not holds(value):
            raise argparse.ArgumentTypeError(f"{text} is not {fault}")
        return value

    return parse


def _number(text: str) -> float:
    """Number that a text holds; NaN, which is outside any range, where it holds none."""
    try:
        return float(text)
    except ValueError:
        return math.nan


def whole(text: str, low: int, high: int, what: str) -> int:
    """Whole number of a range; `what` it is."""
    if not text.isdecimal() or not low <= int(text) <= high:
        raise argparse.ArgumentTypeError(f"{text} is not a {what}; {low} to {high}")
    return int(text)


def number_above_0(fault: str) -> Callable[[str], float]:
    """Parser of a finite number above 0; `fault` is what any other is not, and what is wanted."""
    return number_that(lambda value: 0.0 < value < math.inf, fault)


rmse_mm = number_above_0("an error to ask for; a number of mm above 0")
mass_kg = number_that(lambda kg: 0.0 < kg < _HEAVIEST_KG, "a mass; kg above 0, such as 3")
seconds = number_that(lambda s: 0.0 < s <= _LONGEST_S, f"a time to wait; seconds above 0, {_LONGEST_S:g} at most")
