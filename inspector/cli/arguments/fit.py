"""Arguments of the subcommands that fit a model. Nothing slow is imported."""

from __future__ import annotations

from argparse import ArgumentParser
from pathlib import Path

from calib.options import CORRECTION_KINDS, DEFAULT_FOLDS, REFITS
from inspector.cli.arguments.shared import (
    add_adding,
    add_effects,
    add_fit,
    add_json,
    add_learned_out,
    add_model,
    add_model_out,
    add_residual,
)


def calibrate_arguments(sub: ArgumentParser) -> None:
    """Add the arguments of `calibrate`."""
    sub.add_argument("--out", type=Path, metavar="FILE", help="write robot.toml, its table the best without effects")
    add_model_out(sub)
    sub.add_argument(
        "--urdf-out", type=Path, metavar="FILE", help="write the template with calibrated origins, as --out"
    )
    sub.add_argument(
        "--kinematics-out", type=Path, metavar="FILE.yaml", help="the same for joint origins as makers' YAML"
    )
    sub.add_argument(
        "--template",
        type=Path,
        action="append",
        default=[],
        metavar="FILE",
        help="your own .urdf or .yaml of this arm; default: the file that `import` took the robot from",
    )
    sub.add_argument("--force", action="store_true", help="write although the fit is no improvement")
    sub.add_argument(
        "--residuals",
        type=Path,
        metavar="FILE.csv",
        help="write what is left over, a row a pose with all inputs",
    )
    sub.add_argument("--scene", type=Path, metavar="FILE.glb", help="write arm, points and residuals (x 100) in 3D")
    sub.add_argument("--session", type=Path, metavar="FILE.json", help="write a session that serve --session opens")
    add_learned_out(sub)
    add_model(sub, "hold the effects and curves of this saved model, with --refit")
    sub.add_argument(
        "--refit", choices=REFITS, help="what is fitted anew with --model: frame and tool, or links too (links)"
    )
    add_adding(sub)
    add_fit(sub)
    add_json(sub)


def compare_arguments(sub: ArgumentParser) -> None:
    """Add the arguments of `compare`."""
    sub.add_argument("other", type=Path, metavar="OTHER", help="dataset folder to compare it with")
    add_residual(sub)
    add_effects(sub)
    add_adding(sub)
    add_json(sub)


def repeat_arguments(sub: ArgumentParser) -> None:
    """Add the arguments of `repeat`."""
    sub.add_argument("others", type=Path, nargs="+", metavar="OTHER", help="further recordings of the same arm")
    add_json(sub)


def watch_arguments(sub: ArgumentParser) -> None:
    """Add the arguments of `watch`."""
    sub.add_argument("new", type=Path, nargs="+", metavar="NEW", help="dataset folder of check poses, three or more")
    sub.add_argument(
        "--scanner-moved",
        action="store_true",
        help="the scanner was put up anew, which is no change to be told",
    )
    sub.add_argument(
        "--out",
        type=Path,
        action="append",
        default=[],
        metavar="FILE",
        help="write the control chart: .svg, with tables .html, the series .csv; several times",
    )
    add_effects(sub)
    add_adding(sub)
    add_json(sub)


def validate_arguments(sub: ArgumentParser) -> None:
    """Add the arguments of `validate`."""
    sub.add_argument("--folds", type=int, default=DEFAULT_FOLDS, help=f"default {DEFAULT_FOLDS}")
    add_model(sub, "errors of this saved model at the dataset's points, as it is")
    add_fit(sub)
    add_json(sub)


def correct_arguments(sub: ArgumentParser) -> None:
    """Add the arguments of `correct`."""
    sub.add_argument("--joints", type=Path, required=True, metavar="FILE", help="targets, columns as poses.csv")
    sub.add_argument(
        "--out",
        type=Path,
        required=True,
        metavar="FILE",
        help="write the corrected targets: .csv, or a point list as .script (URScript), .dat (KRL), .mod (RAPID)",
    )
    sub.add_argument(
        "--what",
        choices=CORRECTION_KINDS,
        help="what is brought right (default: pose where the fit knows the attitude, else position)",
    )
    sub.add_argument("--force", action="store_true", help="go on although the fit is no improvement")
    add_model(sub, "use this saved model and fit nothing")
    add_adding(sub)
    add_fit(sub)
    add_json(sub)
