"""Errors about the user's input. Each carries one line: what was found, where, and what would do.

Programs catch `CalibError`; the command line turns it into that line and exit code 2.
"""

from __future__ import annotations


class CalibError(Exception):
    """Something in the input does not allow the work to go on."""


class DatasetError(CalibError):
    """A file of the dataset folder is missing, malformed or contradicts another."""


class ScanError(CalibError):
    """A scan cannot be read as points."""


class CornerError(CalibError):
    """No corner can be had from the scans, or too few of them."""


class ModelFileError(CalibError):
    """A model.json cannot be used."""


class FitError(CalibError):
    """The measurements cannot carry the fit that was asked for."""


class TargetError(CalibError):
    """A target cannot be had from a scan, or a finder of the user's own fails."""
