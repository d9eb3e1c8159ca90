"""Arguments of the subcommands that fit a model. Nothing slow is imported."""

from __future__ import annotations

from argparse import ArgumentParser
from pathlib import Path

from calib.options import CORRECTION_KINDS, DEFAULT_FOLDS, NEW_ARM_POSES, REFITS
from inspector.cli.arguments import values
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
        "--kinematics-out",
        type=Path,
        metavar="FILE.yaml",
        help="the same for joint origins as makers' YAML, or for a UR controller's calibration.conf (.conf)",
    )
    sub.add_argument(
        "--template",
        type=Path,
        action="append",
        default=[],
        metavar="FILE",
        help="your own .urdf or .yaml of this arm; default: the file that `import` took the robot from",
    )
    sub.add_argument(
        "--hand-eye-out",
        type=Path,
        metavar="FILE",
        help="write where the camera is, for ROS: .yaml .launch.py .launch .json .txt (the tf command); with "
        "--residual pose",
    )
    sub.add_argument(
        "--parent-frame",
        metavar="NAME",
        help="your robot's name of the frame that carries the camera, such as tool0; of the base: base_link by default",
    )
    sub.add_argument(
        "--parent-at",
        choices=("flange", "tip"),
        default="flange",
        help="which frame that is: behind robot.toml's last joint (default), or behind its tool row, a URDF's tip link",
    )
    sub.add_argument(
        "--camera-frame",
        metavar="NAME",
        default="camera_optical_frame",
        help="its name of the camera's optical frame (default camera_optical_frame)",
    )
    sub.add_argument("--force", action="store_true", help="write although the fit is no improvement")
    sub.add_argument(
        "--residuals", type=Path, metavar="FILE.csv", help="write what is left over, a row a pose with all inputs"
    )
    sub.add_argument("--scene", type=Path, metavar="FILE.glb", help="write arm, points and residuals (x 100) in 3D")
    sub.add_argument("--session", type=Path, metavar="FILE.json", help="write a session that serve --session opens")
    add_learned_out(sub)
    add_model(sub, "hold the effects and curves of this saved model, with --refit")
    sub.add_argument(
        "--refit", choices=REFITS, help="what is fitted anew with --model: frame and tool, or links too (links)"
    )
    sub.add_argument(
        "--type", type=Path, metavar="FILE.json", help="begin from what other arms of the type share (of pool --out)"
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


def verify_arguments(sub: ArgumentParser) -> None:
    """Add the arguments of `verify`."""
    sub.add_argument("results", type=Path, nargs="+", metavar="RESULT", help="model.json, session.json or report.html")
    add_json(sub)


def pool_arguments(sub: ArgumentParser) -> None:
    """Add the arguments of `pool`."""
    sub.add_argument("others", type=Path, nargs="+", metavar="OTHER", help="datasets of further arms of the same type")
    sub.add_argument("--out", type=Path, metavar="FILE.json", help="write what they share, for calibrate --type")
    sub.add_argument(
        "--poses",
        type=values.pose_count,
        default=NEW_ARM_POSES,
        metavar="N",
        help=f"poses of an arm that is left out, to begin from the others (default {NEW_ARM_POSES})",
    )
    add_residual(sub)
    sub.add_argument(
        "--effect", action="append", default=[], metavar="NAME", help="an effect that the arms have, all joints"
    )
    add_json(sub)


def watch_arguments(sub: ArgumentParser) -> None:
    """Add the arguments of `watch`."""
    sub.add_argument(
        "new",
        type=Path,
        nargs="+",
        metavar="NEW",
        help="folder of check poses, three poses or more; three folders or more show drifts, too",
    )
    sub.add_argument(
        "--scanner-moved", action="store_true", help="the scanner was put up anew, which is no change to be told"
    )
    sub.add_argument(
        "--tolerance-mm",
        type=values.rmse_mm,
        metavar="MM",
        help="tell when the 3D error at the check poses reaches this, from three checks on",
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
    targets = sub.add_mutually_exclusive_group(required=True)
    targets.add_argument("--joints", type=Path, metavar="FILE", help="targets, columns as poses.csv")
    targets.add_argument(
        "--program",
        type=Path,
        metavar="FILE",
        help="a robot program to correct: .script (URScript), .src or .dat (KRL), .mod, .sys or .prg (RAPID)",
    )
    sub.add_argument(
        "--with",
        dest="others",
        type=Path,
        action="append",
        default=[],
        metavar="FILE",
        help="of --program: another file of the controller, which defines tools and bases or moves to the targets "
        "($config.dat, a module); give it several times for several",
    )
    for frame, words in (("tool", "on the flange"), ("work", "in the robot's base")):
        sub.add_argument(
            f"--{frame}-frame",
            action="append",
            default=[],
            metavar="[NAME=]NUMBERS",
            help=f"{frame} frame {words}, where the program does not define it (several by their names): "
            "x,y,z,rx,ry,rz (URScript, m and rad), "
            "X,Y,Z,A,B,C (KRL, mm and degrees), x,y,z,q1,q2,q3,q4 (RAPID, mm)",
        )
    sub.add_argument(
        "--out",
        type=Path,
        required=True,
        metavar="FILE",
        help="write the corrected targets: .csv, or a point list as .script (URScript), .dat (KRL), .mod (RAPID); "
        "of a program the corrected one, with its suffix",
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
