"""The cell of a dataset, mostly inferred from its measured poses, and the cell of a robot still to be measured."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from calib import frames
from calib.array_types import Array, IndexArray
from calib.dataset.dataset import Dataset, Surroundings
from calib.errors import CalibError
from calib.jig import Jig, jig_geometry
from calib.kinematics.chain import Chain, nominal_chain
from calib.kinematics.hand_eye import solve_hand_eye, with_world_targets
from calib.kinematics.joint_range import joint_range
from calib.kinematics.robot import Robot
from calib.kinematics.tool_point import ending_at_tool_point
from calib.plugins import contributions, load
from calib.workcell.bodies.arm_bodies import FIXED, ArmBodies, arm_bodies
from calib.workcell.bodies.link_mesh import LinkMesh, load_link_mesh
from calib.workcell.jig_on_tool import target_T_jig, with_jig
from calib.workcell.measurable import (
    BOX,
    BOX_HIDES,
    FLOOR,
    HIDDEN,
    ROOM_TARGET,
    SCANNER,
    SELF,
    incidence_cosines,
    measurable,
)
from calib.workcell.scan_field import JANG_FIELD, MAX_INCIDENCE_DEG, BoxField, ScanField, evident_field
from calib.workcell.scanner_place import fitted_scanner_place, likely_scanner_place
from calib.workcell.view_rules import ViewRule
from calib.workcell.workcell import InView, RoomTarget, Workcell, seen_target

CUBE_CORNER = Jig()
NOTHING_KNOWN = Surroundings()
_FEWEST_CARRIED = 6  # points that place a scanner on the flange and its target in the room
_MOST_REFUSED = 0.1  # of the measured poses: a rule that refuses more is left out
_THINNER = (1.0, 0.8, 0.6)  # shares of the guessed radii
_FEW = 0.03  # of the measured poses may be refused by bodies of the right thickness
_UNSEEN_DEG = 85.0  # a face that is measured is not steeper


def workcell_of_robot(
    robot: Robot,
    *,
    base_T_scanner: Array | None = None,
    jig: Jig | None = CUBE_CORNER,
    field: ScanField | BoxField | None = None,
    surroundings: Surroundings = NOTHING_KNOWN,
) -> Workcell:
    """Cell of a robot of which nothing has been measured; `notes` list the assumptions.

    Its robot has a tool row that reaches to the jig's apex, added where the given one has none.

    Args:
        base_T_scanner: (4, 4); None: in front of the arm (with a jig), or not considered (without).
        jig: None: a mirror or a ball, which is seen from everywhere.
        field: None: with a jig Jang's scanner.

    Raises:
        CalibError: a joint has no range.
    """
    robot = ending_at_tool_point(robot)
    notes: list[str] = []
    if jig is not None:
        longer = with_jig(robot, jig)
        if longer is not robot:
            notes.append(f"tool: [tool] reaches no jig, so it is taken {longer.tool.d_mm:g} mm long")
        robot = longer
        if field is None:
            field = replace(JANG_FIELD, max_incidence_deg=MAX_INCIDENCE_DEG)
            size = f"{field.width_mm:g} x {field.height_mm:g} x {field.depth_mm:g} mm at {field.distance_mm:g} mm"
            notes.append(f"scanner's field: {size}, assumed")
    tool_T_jig = target_T_jig(robot)
    if base_T_scanner is None and field is not None:
        distance_mm = field.distance_mm if isinstance(field, ScanField) else JANG_FIELD.distance_mm
        base_T_scanner = likely_scanner_place(robot, tool_T_jig, distance_mm)
        at = ", ".join(f"{v:.0f}" for v in base_T_scanner[:3, 3])
        looks = ", ".join(f"{v:.2f}" for v in base_T_scanner[:3, 2])
        notes.append(f"scanner: assumed at ({at}) mm of the base, looking along ({looks})")
    return _cell(
        robot, np.zeros((0, robot.n_joints)), surroundings, [*notes, *_limits_note(robot)], jig=jig,
        tool_T_jig=tool_T_jig, field=field, bodies=arm_bodies(robot, jig, tool_T_jig), base_T_scanner=base_T_scanner,
    )  # fmt: skip


def _cell(
    robot: Robot,
    q: Array,
    surroundings: Surroundings,
    notes: list[str],
    *,
    jig: Jig | None,
    tool_T_jig: Array,
    field: ScanField | BoxField | None,
    bodies: ArmBodies,
    base_T_scanner: Array | None = None,
    flange_T_scanner: Array | None = None,
    room_target: RoomTarget | None = None,
    in_view: InView | None = None,
) -> Workcell:
    """Cell with bodies as thick as measured poses q (N, n) allow, and with the declared or a likely floor and boxes."""
    reached = np.concatenate([q, joint_range(robot)])
    cell = Workcell(
        robot, reached.min(axis=0), reached.max(axis=0), jig, tool_T_jig, base_T_scanner, field, bodies,
        least_manipulability=surroundings.least_manipulability,
        notes=tuple(notes if in_view is None else [*notes, in_view.note]),
        flange_T_scanner=flange_T_scanner, room_target=room_target, in_view=in_view,
    )  # fmt: skip
    cell = _as_thick_as_measured(cell, q)
    cell = replace(cell, floor_z_mm=surroundings.floor_z_mm, boxes=surroundings.boxes)
    return _with_likely_floor(_with_doubt_of_declared(cell, q), q)


def workcell_of_dataset(
    dataset: Dataset, *, parent_T_scanner: Array | None = None, setup: str | None = None
) -> Workcell:
    """Cell in which a dataset was measured; `notes` list what its points imply and what is assumed.

    Measured poses can be measured: a rule that refuses more than a tenth of them (guessed bodies, an assumed floor, the
    jig's faces) is left out, and guessed bodies are made thinner until they hide none.

    Args:
        parent_T_scanner: (4, 4) where a fit has the scanner, in the base frame, or in the flange's if the arm carries
            it; None: where the robot's own table has it by the points.
        setup: which placement of the scanner; None: the first.

    Raises:
        CalibError: an unknown setup, a joint without range, or a mesh that cannot be read.
    """
    dataset = replace(dataset, robot=ending_at_tool_point(dataset.robot))
    names = list(dict.fromkeys(map(str, dataset.poses.setup)))
    setup = names[0] if setup is None else setup
    if setup not in names:
        raise CalibError(f"dataset {dataset.name}: no setup {setup!r}; its setups are {', '.join(names)}")
    if dataset.robot.carries_scanner:
        return _cell_of_carried_scanner(dataset, parent_T_scanner, setup)
    base_T_scanner = parent_T_scanner
    measured = _Measured.of(dataset, setup)
    jig = dataset.jig if dataset.shows_faces else None
    surroundings = dataset.surroundings
    if len(measured.rows) < 3 and base_T_scanner is None:
        field = None if dataset.scanner.field_mm is None else evident_field(dataset.scanner, np.zeros((0, 3)))[0]
        return workcell_of_robot(dataset.robot, jig=jig, field=field, surroundings=surroundings)
    notes: list[str] = []
    if base_T_scanner is None:
        base_T_scanner = fitted_scanner_place(measured.base_mm, measured.scanner_mm)
        notes.append(f"scanner: where the robot's own table has it by {len(measured.base_mm)} points")
    apex_mm = frames.apply(frames.invert(base_T_scanner), measured.chain.target_mm)
    field, field_note = evident_field(dataset.scanner, apex_mm)
    notes += [field_note, *_limits_note(dataset.robot)]
    tool_T_jig = target_T_jig(dataset.robot)
    if jig is not None:
        tool_T_jig, jig, faces = _mounted(jig, tool_T_jig, measured.chain, base_T_scanner[:3, 3])
        notes += faces
    return _cell(
        dataset.robot, measured.q, surroundings, notes, jig=jig, tool_T_jig=tool_T_jig, field=field,
        bodies=arm_bodies(dataset.robot, jig, tool_T_jig, _meshes(dataset)), base_T_scanner=base_T_scanner,
        in_view=_in_view(dataset, setup),
    )  # fmt: skip


def _in_view(dataset: Dataset, setup: str) -> InView | None:
    """What an instrument of a plug-in has to see, where one measured the dataset."""
    found = (load(rule.of_dataset)(dataset, setup) for rule in contributions(ViewRule))
    return next((each for each in found if each is not None), None)


def _meshes(dataset: Dataset) -> dict[int, LinkMesh]:
    """Meshes of the links that have one, by the joint from 0 that moves each."""
    found = {joint: load_link_mesh(dataset, joint) for joint in range(dataset.robot.n_joints)}
    return {joint: mesh for joint, mesh in found.items() if mesh is not None}


def _cell_of_carried_scanner(dataset: Dataset, flange_T_scanner: Array | None, setup: str) -> Workcell:
    """Cell of an arm that carries the scanner past a target in the room, as its measured poses show it.

    The target can be seen from the cone of directions from which it was seen. Raises CalibError with too few points.
    """
    if dataset.points is None or len(dataset.points) < _FEWEST_CARRIED:
        raise CalibError(
            f"dataset {dataset.name}: the scanner is on the flange, and where it sits there and where its target "
            f"stands are known from measured points alone; measure {_FEWEST_CARRIED} poses first"
        )
    notes: list[str] = []
    robot, points = dataset.robot, dataset.points
    at_setup = dataset.poses.setup[points.pose]
    if flange_T_scanner is None or not any(target.in_world for target in robot.targets):
        chain = nominal_chain(robot, dataset.poses.q[points.pose])
        turns = None if points.orientations is None else points.orientations.scanner_R_jig
        found = solve_hand_eye(chain.base_T_flange, points.xyz_mm, at_setup, points.target, turns)
        robot, flange_T_scanner = with_world_targets(robot, found.position_mm), found.flange_T_scanner[setup]
        notes.append(f"scanner: on the flange where the robot's own table has it by {len(points)} points")
    here = points.select(at_setup == setup)
    names, counts = np.unique(here.target, return_counts=True)
    name = str(names[np.argmax(counts)])
    place_mm = np.array(robot.target(name).xyz_mm)
    here = here.select(here.target == name)
    q = dataset.poses.q[np.unique(here.pose)]
    chain = nominal_chain(robot, q)
    eye_mm = (chain.base_T_flange @ flange_T_scanner)[:, :3, 3]
    target = seen_target(place_mm, eye_mm)
    x, y, z = target.outward
    notes.append(
        f"{name}: in the room, seen from within {target.within_deg:.0f} deg of ({x:.2f}, {y:.2f}, {z:.2f}), "
        "as it was measured and a little more"
    )
    field, field_note = evident_field(dataset.scanner, here.xyz_mm)
    tool_T_jig = target_T_jig(robot)
    return _cell(
        robot, q, dataset.surroundings, [*notes, field_note, *_limits_note(robot)], jig=None, tool_T_jig=tool_T_jig,
        field=field, bodies=arm_bodies(robot, None, tool_T_jig, _meshes(dataset), flange_T_scanner),
        flange_T_scanner=flange_T_scanner, room_target=target, in_view=_in_view(dataset, setup),
    )  # fmt: skip


@dataclass(frozen=True)
class _Measured:
    """Measurements of one setup: its measured and nominal points, and its poses, each once."""

    rows: IndexArray  # (N,) of the dataset's poses
    q: Array  # (N, n)
    chain: Chain
    base_mm: Array  # (M, 3)
    scanner_mm: Array  # (M, 3)

    @classmethod
    def of(cls, dataset: Dataset, setup: str) -> _Measured:
        """Measurements of a dataset in one setup."""
        robot, points = dataset.robot, dataset.points
        every = np.zeros(0, dtype=np.intp) if points is None else points.pose
        here = dataset.poses.setup[every] == setup
        rows = np.unique(every[here])
        chain = nominal_chain(robot, dataset.poses.q[rows])
        if points is None:
            return cls(rows, dataset.poses.q[rows], chain, np.zeros((0, 3)), np.zeros((0, 3)))
        pose = np.searchsorted(rows, every[here])
        base_mm = chain.target_mm[pose]
        for target in robot.targets:
            on = points.target[here] == target.name
            frame = chain.base_T_link(target.joint)[pose[on]]
            base_mm[on] = frame[:, :3, :3] @ np.array(target.xyz_mm) + frame[:, :3, 3]
        return cls(rows, dataset.poses.q[rows], chain, base_mm, points.xyz_mm[here])


def _limits_note(robot: Robot) -> list[str]:
    """Note on the joints without limits and the limits assumed; none where all have limits."""
    open_ended = [j for j in robot.joints if j.min is None or j.max is None]
    if not open_ended:
        return []
    names = ", ".join(j.name for j in open_ended)
    kinds = {j.type for j in open_ended}
    taken = {"revolute": "half a turn either way", "prismatic": "0 to 500 mm"}
    assumed = ", or ".join(words for kind, words in taken.items() if kind in kinds)
    return [f"joints without limits in robot.toml: {names}; {assumed} is assumed"]


def _bodies_note(bodies: ArmBodies) -> str:
    """Note on the arm's bodies: meshes of robot.toml, or estimated radii."""
    guessed = bodies.radius_mm[bodies.piece != FIXED]
    if not len(guessed):
        return f"the arm's bodies: {len(bodies.meshes)} meshes of robot.toml"
    with_mesh = f", {len(bodies.meshes)} links by their meshes" if bodies.meshes else ""
    return (
        f"the arm's bodies: guessed from its lengths, {guessed.min():.0f} to {guessed.max():.0f} mm "
        f"about the straight pieces of its chain{with_mesh}"
    )


def _mounted(jig: Jig, tool_T_jig: Array, chain: Chain, eye_mm: Array) -> tuple[Array, Jig | None, list[str]]:
    """Pose of the jig on the tool, turned to where it was seen from, the jig (None: seen from all sides), and notes."""
    _, normals = jig_geometry(jig)
    if _unseen(tool_T_jig, normals, chain, eye_mm) <= _MOST_REFUSED:
        return tool_T_jig, jig, []
    sight = eye_mm - chain.target_mm
    sight /= np.linalg.norm(sight, axis=1, keepdims=True)
    open_side = np.einsum("nji,nj->ni", chain.base_T_frame[:, -1, :3, :3], sight).mean(axis=0)
    open_side /= max(np.linalg.norm(open_side), 1e-9)
    axis = np.cross(-tool_T_jig[:3, 2], open_side)
    angle = np.arctan2(np.linalg.norm(axis), -tool_T_jig[:3, 2] @ open_side)
    turn = frames.rotation_from_rotvec(angle * axis / max(np.linalg.norm(axis), 1e-9))
    turned = frames.make_transform(turn @ tool_T_jig[:3, :3], np.zeros(3))
    if _unseen(turned, normals, chain, eye_mm) <= _MOST_REFUSED:
        x, y, z = -turned[:3, 2]
        return turned, jig, [f"jig: seen from ({x:.2f}, {y:.2f}, {z:.2f}) of the tool, so it points there"]
    return tool_T_jig, None, ["jig: its faces were seen from all sides, so none has to face the scanner"]


def _unseen(tool_T_jig: Array, normals: Array, chain: Chain, eye_mm: Array) -> float:
    """Share of the measured poses at which a face could not have been seen."""
    cosine = incidence_cosines(chain.base_T_frame[:, -1] @ tool_T_jig, normals, eye_mm)
    return float(np.mean(np.any(cosine < np.cos(np.radians(_UNSEEN_DEG)), axis=1)))


def _as_thick_as_measured(cell: Workcell, q: Array) -> Workcell:
    """Cell with the thickest arm bodies that neither collide nor hide the jig at the measured poses."""
    for share in _THINNER:
        thinner = replace(cell, bodies=cell.bodies.thinner(share))
        hidden, inside = _refused(thinner, q, (HIDDEN, SCANNER, ROOM_TARGET)), _refused(thinner, q, (SELF,))
        if max(hidden, inside) <= _FEW:
            return replace(thinner, notes=(*cell.notes, _bodies_note(thinner.bodies)))
    bodies, notes = cell.bodies, [*cell.notes, _bodies_note(cell.bodies)]
    if inside > _MOST_REFUSED:
        bodies = replace(bodies, pairs=bodies.pairs[:0])
        notes.append("collisions between them are not checked: the measured poses would have been refused")
    hidden = _refused(replace(cell, bodies=bodies), q, (HIDDEN, SCANNER, ROOM_TARGET))
    if hidden > _MOST_REFUSED:
        bodies, links = _without_doubtful_hiding(cell, bodies, q)
        by = f"links {', '.join(map(str, links))}" if bodies.hides.any() else "they"
        notes.append(f"whether {by} hide the target is not checked: they would hide it at measured poses")
    return replace(cell, bodies=bodies, notes=tuple(notes))


def _without_doubtful_hiding(cell: Workcell, bodies: ArmBodies, q: Array) -> tuple[ArmBodies, list[int]]:
    """Bodies of which those that hide the target at measured poses (N, n) hide nothing, and the links of these."""
    every = bodies.hides
    doubtful = np.zeros_like(every)
    for k in np.flatnonzero(every):
        alone = replace(bodies, hides=np.arange(len(every)) == k)
        doubtful[k] = _refused(replace(cell, bodies=alone), q, (HIDDEN,)) > _FEW
    kept = replace(bodies, hides=every & ~doubtful)
    if _refused(replace(cell, bodies=kept), q, (HIDDEN,)) > _MOST_REFUSED:
        return replace(bodies, hides=np.zeros_like(every)), []
    return kept, sorted({int(link) + 1 for link in bodies.link[doubtful]})


def _refused(cell: Workcell, q: Array, reasons: tuple[str, ...]) -> float:
    """Share of the poses that are refused for the given reasons."""
    return float(np.mean(np.isin(measurable(cell, q).reason, reasons))) if len(q) else 0.0


def _with_doubt_of_declared(cell: Workcell, q: Array) -> Workcell:
    """Cell with a note where measured poses lie in the floor or in a box that dataset.toml declares."""
    reasons = measurable(replace(cell, least_manipulability=0.0), q).reason
    inside = int(np.isin(reasons, (FLOOR, BOX, BOX_HIDES)).sum())
    if not inside:
        return cell
    note = f"floor or boxes of [cell]: in the way at {inside} of {len(q)} measured poses, so they or the bodies are off"
    return replace(cell, notes=(*cell.notes, note))


def _with_likely_floor(cell: Workcell, measured_q: Array) -> Workcell:
    """Cell with plane z = 0 of an upright arm's base as floor, unless one is declared or measured poses refute it."""
    robot = cell.robot
    if cell.floor_z_mm is not None or not len(cell.bodies):
        return cell
    down = np.array(robot.gravity_m_s2) / max(np.linalg.norm(robot.gravity_m_s2), 1e-9)
    floor = replace(cell, floor_z_mm=0.0)
    upright = down[2] < -0.9 and robot.joints[0].is_revolute and robot.base_T_first[2, 3] >= 0.0
    above = cell.base_T_scanner is None or cell.base_T_scanner[2, 3] > 0.0
    if not upright or not above or _refused(floor, measured_q, (FLOOR,)) > _MOST_REFUSED:
        return replace(cell, notes=(*cell.notes, "floor: not known; add [cell] floor_z_mm to dataset.toml"))
    return replace(
        floor, notes=(*cell.notes, "floor: the base's plane z = 0, assumed; [cell] floor_z_mm declares another")
    )
