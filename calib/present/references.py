"""Recognition of pose and joint names in sentences, so that the page can make them links."""

from __future__ import annotations

import re
from dataclasses import dataclass

from calib.dataset.dataset import Dataset
from calib.dataset.input_names import joint_input
from calib.rendering.blocks import Span, joint, pose

_UNITS = r"\s?(?:[µm]?m|m?deg|mrad|rad|[°%])(?!\w)"  # behind a number that is no further joint
_MORE = r"(?:(?:,\s+|\s+and\s+|,\s+and\s+){0}(?![\w.-]*\w|" + _UNITS + "))*"  # "1" -> "1, 2 and 3"
_JOINTS = r"joints?\s+\d+(?!\w)" + _MORE.replace("{0}", r"\d+")
_POSES = r"poses?\s+[^\s,;:()]+" + _MORE.replace("{0}", r"[^\s,;:()]+")
_NAMED = rf"\b{_JOINTS}|\b{_POSES}|[^\s,;:()]+"
_STOPS = ".!?"


@dataclass(frozen=True)
class Names:
    """Names of a dataset's poses and joints; as a function, it replaces these names in a text by references."""

    poses: frozenset[str] = frozenset()
    joints: int = 0
    sure: frozenset[str] = frozenset()  # ids of poses that nothing else is written like

    @staticmethod
    def of(dataset: Dataset) -> Names:
        """Names of the poses and joints of a dataset."""
        others = set(dataset.robot.parameter_names)
        sure = {
            pose_id
            for pose_id in dataset.poses.ids
            if re.search(r"\d", pose_id)
            and re.search(r"[^\W\d]", pose_id)
            and pose_id not in others
            and joint_input(pose_id) is None
        }
        return Names(frozenset(dataset.poses.ids), dataset.robot.n_joints, frozenset(sure))

    def __call__(self, words: str) -> tuple[Span, ...]:
        """A text with the names of poses and joints replaced by references.

        "joint 4", "joints 1 and 2", "pose 7", and ids that can be nothing else are: numbers and common words alone are
        not.
        """
        spans: list[Span] = []
        end = 0
        for match in re.finditer(_NAMED, words):
            spans += [words[end : match.start()], *_spans(match.group(), self)]
            end = match.end()
        return tuple(_joined([*spans, words[end:]]))


def _joined(spans: list[Span]) -> list[Span]:
    """Spans of a sentence with neighbouring texts joined and empty texts removed."""
    out: list[Span] = []
    for span in spans:
        if isinstance(span, str) and out and isinstance(out[-1], str):
            out[-1] += span
        elif span != "":
            out.append(span)
    return out


def _spans(words: str, names: Names) -> list[Span]:
    if re.fullmatch(_JOINTS, words):
        return [_joint(part, names) for part in re.split(r"(\d+)", words)]
    if re.match(r"poses?\s", words):
        head, gap, rest = re.split(r"(\s+)", words, maxsplit=1)
        among = names.poses - {"and"}
        return [head + gap, *(span for part in re.split(r"([\s,]+)", rest) for span in _pose(part, among))]
    return _pose(words, names.sure)


def _joint(part: str, names: Names) -> Span:
    return joint(int(part)) if part.isdigit() and 1 <= int(part) <= names.joints else part


def _pose(word: str, among: frozenset[str]) -> list[Span]:
    if word in among:
        return [pose(word)]
    bare = word.rstrip(_STOPS)
    return [pose(bare), word[len(bare) :]] if bare in among else [word]
