"""Targets in URScript: joint lists and poses that are assigned, or given to a motion directly.

A variable that holds six numbers may also be a wrench or a speed. So an assigned list counts as a target where a motion
of the same program uses the variable, or where the program does nothing, as a list of points. The pose that
`pose_trans` puts behind a frame is a target in that frame, unless the frame is itself a target, with which it moves.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass, replace
from itertools import zip_longest
from math import pi

import numpy as np

from calib.extras.robot_programs.program_text.flow import FlowEvent, reaching
from calib.extras.robot_programs.program_text.pose_numbers import pose_transform
from calib.extras.robot_programs.program_text.source import (
    FramesOfUses,
    Group,
    NamedFrame,
    Number,
    ParsedTarget,
    ProgramTarget,
    ProgramTargets,
    SkippedLiteral,
    Source,
    Word,
    framed,
)

MASKED = re.compile(r"\"[^\"\r\n]*\"?|'[^'\r\n]*'?|#[^\r\n]*")
_MOTIONS = {"movej": 1, "movel": 1, "movep": 1, "movec": 2, "servoj": 1, "servoc": 1, "servol": 1}
_INVERSE = {"get_inverse_kin", "get_inverse_kin_has_solution"}
_TARGETS_OF = _MOTIONS | dict.fromkeys(_INVERSE, 1) | {"get_forward_kin": 1}
"""Functions, and how many of their first arguments are targets."""
_KEYWORDS = {"q", "x", "pose", "pose_to", "pose_via"}
_NEAR, _TCP = "qnear", "set_tcp"
_OFFSETS = {"pose_trans": 1, "pose_add": 1, "interpolate_pose": 2}
"""Functions that start from poses, and from how many."""
_READS = {"length", "size", "get_list_length", "pose_dist", "point_dist", "textmsg", "popup", "to_str", "str_cat"}
_DEEPEST = 4  # functions and variables by way of which a target is followed
_PLAIN = {"d2r", "pose_trans", _TCP}  # calls in a list of points
_UNKNOWN_TCP = NamedFrame("the controller's own TCP (no set_tcp before it)", None)
_ASSIGNED = re.compile(r"([A-Za-z_]\w*)\s*(?<![=<>!])=$")
_NAME = re.compile(r"[A-Za-z_]\w*")
_BASE = NamedFrame("base", np.eye(4))
_UNITS = {"d2r": pi / 180.0}
_BLOCKS = {"def": "routine", "thread": "routine", "sec": "routine", "if": "if", "while": "loop", "for": "loop"}
_AHEAD = 40  # characters behind a variable that are looked at


@dataclass(frozen=True)
class _Use:
    """One use of a variable."""

    place: int
    function: str  # "" outside of a call
    is_target: bool
    moves_along: bool = False  # the start of an offset, or one of its numbers
    is_hint: bool = False  # joints near which a pose is taken, or it is read only
    changes: bool = False  # one of its numbers is set anew
    call: Group | None = None


@dataclass(frozen=True)
class _Role:
    """What a literal is in a program."""

    name: str = ""  # of the variable that holds it, or the motion
    held: bool = False
    reason: str = ""  # why it is no target
    call: Group | None = None  # in which it stands directly
    frame: tuple[int, int] | None = None  # first argument of pose_trans, of a target behind it


def urscript_targets(source: Source) -> ProgramTargets:
    """Targets of a URScript program. Raises CalibError where brackets do not match."""
    return _Program(source).targets()


class _Program:
    def __init__(self, source: Source) -> None:
        self._source = source
        self._assigned = _assignments(source)
        self._by_start = {group.start: group for group in source.groups}
        self._acts = any(self._is_call(word) and word.text not in _PLAIN for word in source.words)
        self._structure = list(self._marks_of_blocks())
        self._parameters = set(self._read_parameters())
        self._words: dict[str, list[Word]] = {}
        for word in source.words:
            self._words.setdefault(word.text, []).append(word)
        self._frames: dict[str, dict[int, frozenset[NamedFrame]] | str] = {}

    def targets(self) -> ProgramTargets:
        """Targets with their frames, and what else looks like one."""
        source = self._source
        left: list[SkippedLiteral] = []
        found: list[tuple[ParsedTarget, _Role]] = []
        for group in source.own_groups:
            start = self._start(group)
            if start is None:
                continue
            line, what = source.line(start), source.literal(start, group.end)
            role = self._role(group, start)
            numbers = source.numbers(group.items, _UNITS)
            reason = role.reason or (numbers if isinstance(numbers, str) else "")
            if reason or isinstance(numbers, str):
                left.append(SkippedLiteral(line, what, reason))
                continue
            kind = "pose" if start < group.start else "joints"
            target = ProgramTarget(role.name, line, kind, numbers, start)  # type: ignore[arg-type]
            found.append((ParsedTarget(target, role.name.partition("[")[0] if role.held else ""), role))
        uses = {name: self._uses(name) for name in {held.variable for held, _ in found if held.variable}}
        kept: list[tuple[ParsedTarget, _Role]] = []
        for held, role in found:
            reason = self._unfit(held.variable, uses.get(held.variable, [])) if held.variable else ""
            if reason:
                left.append(SkippedLiteral(held.target.line, held.target.name, reason))
                continue
            calls = [role.call, *(use.call for use in uses.get(held.variable, []) if use.is_target)]
            near = next(filter(None, map(self._near, calls)), ()) or self._beside(held.variable)
            near = near if held.target.kind == "pose" else ()
            kept.append((replace(held, target=replace(held.target, near=near)), role))
        roles = {held.target.place: role for held, role in kept}
        places = {
            held.target.place: [use.place for use in uses.get(held.variable, []) if use.is_target]
            or [held.target.place]
            for held, _ in kept
        }
        tcps = self._tcps({place for each in places.values() for place in each})

        def frames_of(held: ParsedTarget) -> FramesOfUses | str:
            role = roles[held.target.place]
            works = [_BASE] if role.frame is None else self._frame(*role.frame)
            tools = [tcp for place in places[held.target.place] for tcp in tcps[place]]
            return works if isinstance(works, str) else (tools, works)

        targets, without = framed([held for held, _ in kept], frames_of)
        return ProgramTargets(tuple(targets), tuple(sorted([*left, *without], key=lambda each: each.line)))

    def _start(self, group: Group) -> int | None:
        """Place at which a list or pose of six begins; None for anything else."""
        if group.bracket != "[" or any(child.bracket == "[" for child in group.children) or len(group.items) != 6:
            return None
        before = self._source.code[max(0, group.start - 2) : group.start]
        if before.endswith("p") and not (len(before) > 1 and (before[0].isalnum() or before[0] == "_")):
            return group.start - 1
        is_index = before[-1:].isalnum() or before[-1:] in ("_", "]", ")")
        return None if is_index else group.start

    def _role(self, group: Group, start: int) -> _Role:
        source, parent = self._source, group.parent
        before = source.before(start)
        assigned = _ASSIGNED.search(before)
        if parent is None:
            return self._assigned_role(assigned, group)
        if parent.bracket == "[":
            outer = _ASSIGNED.search(source.before(parent.start))
            if (
                parent.parent is None
                and outer is not None
                and all(source.is_item(*span, parent) for span in self._spans(parent))
            ):
                k = parent.index_of(start) if group.end < parent.end else 0
                role = self._assigned_role(outer, parent)
                return replace(role, name=role.name and f"{role.name}[{k}]")
            return _Role(reason="an element of a list within a list; give it a variable of its own")
        if parent.bracket != "(":
            return _Role(reason="part of an expression")
        function = source.function_of(parent)
        whole = source.is_item(start, group.end, parent)
        if function == _TCP and whole:
            return _Role(reason="the tool's definition")
        if assigned is not None and function:
            if assigned[1] == _NEAR:
                return _Role(reason=f"joints near which {function} looks")
            fits = assigned[1] in _KEYWORDS and function in _TARGETS_OF
            return _Role(function, reason="" if fits else f"the argument {assigned[1]} of {function}", call=parent)
        if not whole:
            return _Role(reason="part of an expression")
        index = parent.index_of(start)
        if index < _TARGETS_OF.get(function, 0):
            return _Role(function, call=parent)
        if function in _INVERSE and index == 1:
            return _Role(reason=f"joints near which {function} looks")
        if function == "pose_trans" and index == 1 and len(parent.items) == 2 and start < group.start:
            return self._behind_frame(parent)
        return _Role(reason=f"an argument of {function}" if function else "part of an expression")

    def _spans(self, group: Group) -> list[tuple[int, int]]:
        return [(self._start(child) or child.start, child.end) for child in group.children if child.bracket == "["]

    def _assigned_role(self, assigned: re.Match[str] | None, group: Group) -> _Role:
        """Role of the value of a whole assignment."""
        if assigned is None:
            return _Role(reason="part of an expression")
        rest = self._source.code[group.end : self._source.line_end(group.end)].strip()
        return _Role(assigned[1], held=True, reason="" if rest in ("", ";") else "part of an expression")

    def _behind_frame(self, call: Group) -> _Role:
        """Role of the second argument of a `pose_trans`."""
        source = self._source
        start = source.code.rindex("pose_trans", 0, call.start)
        first = call.items[0]
        along = _Role(reason="an argument of pose_trans")
        text = source.code[slice(*first)].strip()
        if not _NAME.fullmatch(text) and not re.fullmatch(r"p\s*\[[^\[\]]*\]", text):
            return along
        outer = call.parent
        if outer is None:
            return replace(self._assigned_role(_ASSIGNED.search(source.before(start)), call), frame=first)
        function = source.function_of(outer) if outer.bracket == "(" else ""
        keyword = _ASSIGNED.search(source.before(start))
        fits = keyword is None or keyword[1] in _KEYWORDS
        if not fits or outer.index_of(start) >= _TARGETS_OF.get(function, 0):
            return along
        if keyword is None and not source.is_item(start, call.end, outer):
            return along
        return _Role(function, call=outer, frame=first)

    def _frame(self, start: int, end: int) -> Iterable[NamedFrame] | str:
        """Frames that the first argument of a `pose_trans` may be, or why the pose behind it is left."""
        source = self._source
        text = source.code[start:end].strip()
        if not _NAME.fullmatch(text):
            frame = self._literal(
                self._by_start[source.code.index("[", start)], f"the frame of {source.at_line(start)}"
            )
            return [frame] if frame.transform is not None else "it stands behind a frame that the program computes"
        frames = self._variable_frames(text)
        if isinstance(frames, str):
            return frames
        at = frames.get(start, frozenset())
        if self._assigned.get(text) and any(frame.transform is None for frame in at):
            return f"it stands behind {text}, which is not set on every way there"
        return sorted(at, key=lambda each: each.name)

    def _variable_frames(self, name: str) -> dict[int, frozenset[NamedFrame]] | str:
        """Frames that a variable may hold at its uses by `pose_trans`, or why these are not known."""
        if name not in self._frames:
            self._frames[name] = self._read_variable_frames(name)
        return self._frames[name]

    def _read_variable_frames(self, name: str) -> dict[int, frozenset[NamedFrame]] | str:
        source = self._source
        uses = self._uses(name)
        if any(use.is_target for use in uses):
            return f"an offset from {name}, which moves along with it"
        places = self._assigned.get(name, [])
        values = [self._value(place) for place in places]
        if name in self._parameters or None in values:
            return f"it stands behind {name}, which the program computes"
        if any(use.changes for use in uses):
            return f"it stands behind {name}, of which the program changes a number"
        marks: list[FlowEvent[NamedFrame]] = [
            FlowEvent(call.items[0][0], "use") for use in uses if (call := use.call) is not None
        ]
        for place, group in zip(places, values, strict=True):
            shown = f"{name} of {source.at_line(place)}" if len(places) > 1 else name
            marks.append(FlowEvent(place, "set", value=None if group is None else self._literal(group, shown)))
        return reaching([*self._structure, *marks], NamedFrame(name, None), top_first=True)

    def _value(self, place: int) -> Group | None:
        """Pose literal that is the whole value of an assignment."""
        source = self._source
        match = re.compile(r"\w+\s*=\s*p\s*(?=\[)").match(source.code, place)
        group = self._by_start.get(match.end()) if match else None
        if group is None or len(group.items) != 6:
            return None
        rest = source.code[group.end : source.line_end(group.end)].strip()
        return group if rest in ("", ";") and not isinstance(source.numbers(group.items, _UNITS), str) else None

    def _literal(self, group: Group, name: str) -> NamedFrame:
        numbers = self._source.numbers(group.items, _UNITS)
        return NamedFrame(name, None) if isinstance(numbers, str) or len(numbers) != 6 else _framed(name, numbers)

    def _is_call(self, word: Word) -> bool:
        end = word.place + len(word.text)
        return self._source.code[end : end + _AHEAD].lstrip()[:1] == "("

    def _marks_of_blocks(self) -> Iterable[FlowEvent[NamedFrame]]:
        defined: set[int] = set()
        words = self._source.words
        for word, following in zip_longest(words, words[1:]):
            kind = _BLOCKS.get(word.text)
            if kind == "routine" and following is not None:
                defined.add(following.place)
                yield FlowEvent(word.place, "routine", following.text)
            elif kind is not None and kind != "routine":
                yield FlowEvent(word.place, kind)  # type: ignore[arg-type]
            elif word.text in ("elif", "else"):
                yield FlowEvent(word.place, "else", "elif" if word.text == "elif" else "")
            elif word.text == "end":
                yield FlowEvent(word.place, "end")
            elif word.place not in defined and self._is_call(word):
                yield FlowEvent(word.place, "call", word.text)

    def _tcps(self, places: Iterable[int]) -> dict[int, frozenset[NamedFrame]]:
        """Tools that may be set at places."""
        source = self._source
        marks: list[FlowEvent[NamedFrame]] = [FlowEvent(place, "use") for place in places]
        for word in source.words:
            call = self._by_start.get(source.code.find("(", word.place)) if word.text == _TCP else None
            if call is None:
                continue
            name = f"the TCP of {source.at_line(word.place)}"
            start, end = call.items[0]
            text = source.code[start:end].strip()
            group = next((child for child in call.children if child.start < end), None)
            frame = NamedFrame(name, None)
            if group is not None and re.fullmatch(r"p?\s*\[[^\[\]]*\]", text):
                frame = self._literal(group, name)
            elif _NAME.fullmatch(text):
                assigned = self._assigned.get(text, [])
                value = self._value(assigned[0]) if len(assigned) == 1 and text not in self._parameters else None
                frame = NamedFrame(text, None) if value is None else self._literal(value, text)
            marks.append(FlowEvent(word.place, "set", value=frame))
        return reaching([*self._structure, *marks], _UNKNOWN_TCP, top_first=True)

    def _near(self, call: Group | None) -> tuple[float, ...]:
        """Joints near which a call of `get_inverse_kin` looks; () where none are told in plain numbers."""
        source = self._source
        if call is None or source.function_of(call) not in _INVERSE:
            return ()
        for k, (start, end) in enumerate(call.items):
            text = source.code[start:end].strip()
            keyword, equals, value = text.partition("=")
            if not (k == 1 and not equals) and keyword.strip() != _NEAR:
                continue
            name = (value if equals else text).strip()
            group = next((child for child in call.children if start <= child.start < end), None)
            return self._joints_of(name) if group is None else self._plain(group)
        return ()

    def _beside(self, name: str) -> tuple[float, ...]:
        """Joints that PolyScope notes beside a pose: NAME_q of NAME_p; () where there are none."""
        return self._joints_of(name.removesuffix("_p") + "_q") if name.endswith("_p") else ()

    def _joints_of(self, name: str) -> tuple[float, ...]:
        """Plain joint values that a variable holds once and for all; () for others."""
        assigned = self._assigned.get(name, [])
        match = re.compile(r"\w+\s*=\s*(?=\[)").match(self._source.code, assigned[0]) if len(assigned) == 1 else None
        return self._plain(self._by_start[match.end()]) if match and match.end() in self._by_start else ()

    def _plain(self, group: Group) -> tuple[float, ...]:
        numbers = self._source.numbers(group.items, _UNITS) if group.bracket == "[" else ""
        return () if isinstance(numbers, str) or len(numbers) != 6 else tuple(number.value for number in numbers)

    def _read_parameters(self) -> Iterable[str]:
        """Names of the parameters of the program's functions."""
        for mark in self._structure:
            call = self._by_start.get(self._source.code.find("(", mark.place)) if mark.kind == "routine" else None
            for start, end in () if call is None else call.items:
                yield self._source.code[start:end].partition("=")[0].strip()

    def _uses(self, name: str) -> list[_Use]:
        """Uses of a variable, its own assignments left out; where it is copied to another variable, those of that."""
        own = self._assigned.get(name, [])
        return [use for word in self._words.get(name, []) if word.place not in own for use in self._followed(word)]

    def _followed(self, word: Word, depth: int = 0) -> list[_Use]:
        source, use = self._source, self._use(word)
        if word.group is not None or use.changes or depth >= _DEEPEST:
            return [use]
        line = source.code[source.line_start(word.place) : source.line_end(word.place)]
        alias = re.fullmatch(rf"\s*(?:global\s+|local\s+)?([A-Za-z_]\w*)\s*=\s*{word.text}\s*(?:\[[^\]]*\])?\s*", line)
        if not alias or alias[1] == word.text:
            return [use]
        others = [each for each in self._words.get(alias[1], []) if each.place not in self._assigned.get(alias[1], [])]
        found = [more for each in others for more in self._followed(each, depth + 1)]
        return found or [replace(use, is_hint=True)]

    def _use(self, word: Word) -> _Use:
        source, group = self._source, word.group
        end = word.place + len(word.text)
        index = self._by_start.get(end) if source.code[end : end + 1] == "[" else None
        if index is not None:
            behind = source.code[index.end : source.line_end(index.end)]
            if group is None and re.match(r"\s*=(?!=)", behind):
                again = re.search(rf"\b{word.text}\b", behind)
                return _Use(word.place, "", False, moves_along=again is not None, changes=again is None)
            end = index.end
        if group is None or group.bracket != "(":
            return _Use(word.place, "", False, moves_along=index is not None)
        function = source.function_of(group)
        whole = source.is_item(word.place, end, group)
        keyword = _ASSIGNED.search(source.before(word.place))
        position = group.index_of(word.place)
        if function in _READS or (
            function in _INVERSE and (keyword[1] == _NEAR if keyword else whole and position == 1)
        ):
            return _Use(word.place, function, False, is_hint=True)
        first = position < _TARGETS_OF.get(function, 0)
        named = keyword is not None and keyword[1] in _KEYWORDS and function in _TARGETS_OF
        is_target = (whole and first) or named
        if index is not None and not is_target:
            return _Use(word.place, function, False, moves_along=True)
        moves_along = whole and position < _OFFSETS.get(function, 0)
        return _Use(word.place, function, is_target, moves_along, call=group)

    def _unfit(self, name: str, uses: list[_Use]) -> str:
        """Reason why a variable with these uses holds no target; "" where it does."""
        changed = next((use for use in uses if use.changes), None)
        if changed is not None:
            return f"{self._source.at_line(changed.place)} sets one of its numbers anew"
        is_moved_to = any(use.is_target for use in uses)
        if not is_moved_to and not uses:
            return "no motion of the program uses it" if self._acts else ""
        others = [
            use for use in uses if not use.is_target and not use.is_hint and not (use.moves_along and is_moved_to)
        ]
        if is_moved_to and not others:
            return ""
        first = next(iter(others), uses[0])
        if not is_moved_to and all(use.function == "pose_trans" for use in uses):
            return "a frame of pose_trans"
        by = f"by {first.function}" if first.function else "in an expression"
        return f"the variable is also used {by}" if is_moved_to else f"the variable is used {by}, in no motion"


def _assignments(source: Source) -> dict[str, list[int]]:
    """Places at which variables are assigned as a whole."""
    found: dict[str, list[int]] = {}
    for word in source.words:
        end = word.place + len(word.text)
        after = source.code[end : end + _AHEAD].lstrip()
        if word.group is None and after[:1] == "=" and after[:2] != "==":
            found.setdefault(word.text, []).append(word.place)
    return found


def _framed(name: str, numbers: tuple[Number, ...]) -> NamedFrame:
    return NamedFrame(name, pose_transform("URScript", np.array([number.value for number in numbers])))
