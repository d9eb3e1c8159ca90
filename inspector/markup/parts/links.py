"""Names of poses and joints within sentences, as links: a click selects them."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass

from calib.dataset.dataset import Dataset
from calib.dataset.input_names import joint_input
from calib.effects.effect import Effect, parameters_by_name
from calib.kinematics.robot import PARAMETER_KINDS, Robot
from inspector.markup.parts.elements import Html, asking, joint_link, pose_link, text

_UNITS = r"\s?(?:[µm]?m|m?deg|mrad|rad|[°%])(?!\w)"  # behind a number that is no further joint
_MORE = r"(?:(?:,\s+|\s+and\s+|,\s+and\s+){0}(?![\w.-]*\w|" + _UNITS + "))*"  # "1" -> "1, 2 and 3"
_JOINTS = r"joints?\s+\d+(?!\w)" + _MORE.replace("{0}", r"\d+")
_POSES = r"poses?\s+[^\s,;:()]+" + _MORE.replace("{0}", r"[^\s,;:()]+")
_WORD = r"[^\s,;:()]+"
_STOPS = ".!?"


@dataclass(frozen=True)
class Names:
    """What a sentence about a dataset may name. `sure` are the ids that nothing else is written like."""

    poses: frozenset[str] = frozenset()
    joints: int = 0
    sure: frozenset[str] = frozenset()

    @staticmethod
    def of(dataset: Dataset) -> Names:
        """The poses and the joints of a dataset."""
        others = set(dataset.robot.parameter_names)
        sure = {
            pose
            for pose in dataset.poses.ids
            if re.search(r"\d", pose)
            and re.search(r"[^\W\d]", pose)
            and pose not in others
            and joint_input(pose) is None
        }
        return Names(frozenset(dataset.poses.ids), dataset.robot.n_joints, frozenset(sure))


def joints_by_parameter(robot: Robot, effects: Sequence[Effect] = ()) -> dict[str, int]:
    """The joint, from 1, of each parameter that belongs to one: of the table's rows and of these effects."""
    of_table = {f"{kind}{j + 1}": j + 1 for j in range(robot.n_joints) for kind in PARAMETER_KINDS}
    of_effects = {
        name: int(joint) + 1
        for name, (effect, _) in parameters_by_name(effects).items()
        if (joint := getattr(effect, "joint", None)) is not None
    }
    return of_table | of_effects


def joint_asks(joints: Iterable[int | None]) -> list[Html]:
    """What a click on each row of a table asks for: its joint, from 1; nothing where it has none."""
    return [Html("") if joint is None else asking("joint", joint) for joint in joints]


def links_to(poses: Collection[str], inputs: Collection[str] = ()) -> dict[str, Html]:
    """What `linked` takes for names that a sentence is known to hold: poses by id, inputs ("q4") by their joint."""
    joints = {name: of_joint[1] + 1 for name in inputs if (of_joint := joint_input(name)) is not None}
    return {
        **{name: joint_link(joint, name) for name, joint in joints.items()},
        **{p: pose_link(p) for p in poses},
    }


def linked(sentence: object, names: Names, known: Mapping[str, Html] | None = None) -> Html:
    """A sentence, escaped, in which the poses and joints that it names can be clicked.

    `known` (`links_to`) is linked wherever it stands as a word of its own. Beyond that "joint 4", "joints 1 and 2",
    "pose 7", and ids that can be nothing else are: numbers and common words alone are not.
    """
    words, known = str(sentence), known or {}
    exact = [re.escape(name) for name in sorted(known, key=len, reverse=True)]
    pattern = "|".join(
        [*(rf"(?<![\w.-]){name}(?![\w-]|\.\w)" for name in exact), rf"\b{_JOINTS}", rf"\b{_POSES}", _WORD]
    )
    out, end = [], 0
    for found in re.finditer(pattern, words):
        out += [text(words[end : found.start()]), _link(found.group(), names, known)]
        end = found.end()
    return Html("".join(out) + text(words[end:]))


def _link(words: str, names: Names, known: Mapping[str, Html]) -> str:
    if words in known:
        return known[words]
    if re.fullmatch(_JOINTS, words):
        return re.sub(r"\d+", lambda number: _joint(number.group(), names), words)
    if re.match(r"poses?\s", words):
        head, gap, rest = re.split(r"(\s+)", words, maxsplit=1)
        among = names.poses - {"and"}
        return head + gap + "".join(_pose(part, among) for part in re.split(r"([\s,]+)", rest))
    return _pose(words, names.sure)


def _joint(number: str, names: Names) -> str:
    return joint_link(int(number)) if 1 <= int(number) <= names.joints else number


def _pose(word: str, among: frozenset[str]) -> str:
    if word in among:
        return pose_link(word)
    bare = word.rstrip(_STOPS)
    return pose_link(bare) + text(word[len(bare) :]) if bare in among else text(word)
