"""The command `jig`: parts to print for measuring an arm, as STL."""

from __future__ import annotations

from pathlib import Path

from calib.dataset.files.atomic_write import write_all_atomically
from calib.extras.printed_parts.flange_parts import BallStem, CornerJig
from calib.extras.printed_parts.part import PartError, PrintedPart
from calib.extras.printed_parts.presentation import printed_part_blocks, printed_part_document
from calib.extras.printed_parts.socket_plate import SocketPlate
from calib.rendering.text import block_text
from inspector.cli.dataset_commands import show
from inspector.extras.printed_parts.options import JigOptions


def run_jig(options: JigOptions) -> int:
    """Write a part as STL, and the places of a plate's sockets as a table beside it."""
    part = _part(options)
    out = options.out or Path(f"{options.part}.stl")
    if out.suffix.lower() != ".stl":
        raise PartError(f"{out}: parts are written as STL; name a file that ends in .stl")
    files: dict[Path, str | bytes] = {out: part.stl()}
    if part.kind == "sockets":
        rows = [f"{point.name},{','.join(f'{value:g}' for value in point.xyz_mm)}" for point in part.points]
        files[out.with_suffix(".csv")] = "\n".join(["socket,x_mm,y_mm,z_mm", *rows]) + "\n"
    write_all_atomically(files)
    names = [str(file) for file in files]
    show(options, printed_part_document(part, names), block_text(*printed_part_blocks(part, names)))
    return 0


def _part(options: JigOptions) -> PrintedPart:
    columns, rows = options.sockets
    if options.part == "plate":
        plate = SocketPlate(columns=columns, rows=rows, pitch_mm=options.pitch_mm, ball_mm=options.ball_mm)
        return plate.part()
    if options.part == "stem":
        return BallStem(ball_mm=options.ball_mm, bolts=options.bolts, length_mm=options.length_mm).part()
    return CornerJig(edge_mm=options.edge_mm, bolts=options.bolts).part()
