"""Positions in messages: markers by their identifiers, and seen by two cameras."""

from __future__ import annotations

import numpy as np

from calib.extras.logs.bags import positions, series_of


class _Message:
    def __init__(self, **parts: object) -> None:
        self.__dict__.update(parts)


def test_markers_of_a_list_are_named_by_the_identifiers_beside_it() -> None:
    """As ros2_aruco writes them: the place in the list changes with what is seen, the identifier does not."""
    places = [_Message(position=_Message(x=float(k), y=0.0, z=1.0)) for k in range(2)]
    header = _Message(frame_id="camera", stamp=_Message(sec=5, nanosec=0))
    message = _Message(header=header, marker_ids=np.array([12, 7]), poses=places)
    assert [(label, frame, xyz[0]) for label, frame, _, xyz in positions(message)] == [
        ("12", "camera", 0.0),
        ("7", "camera", 1.0),
    ]


def test_markers_of_an_array_are_named_by_namespace_and_identifier_and_a_deleted_one_is_none() -> None:
    def marker(number: int, action: int) -> _Message:
        return _Message(ns="smr", id=number, action=action, pose=_Message(position=_Message(x=1.0, y=0.0, z=2.0)))

    array = _Message(markers=[marker(1, 0), marker(3, 0), marker(4, 2)])
    assert [(label, xyz) for label, _, _, xyz in positions(array)] == [
        ("smr/1", (1.0, 0.0, 2.0)),
        ("smr/3", (1.0, 0.0, 2.0)),
    ]


def test_a_marker_that_two_cameras_see_is_two_points() -> None:
    def seen(frame: str, x: float) -> _Message:
        stamp = _Message(sec=5, nanosec=0)
        place = _Message(translation=_Message(x=x, y=0.0, z=1.0))
        header = _Message(frame_id=frame, stamp=stamp)
        return _Message(transforms=[_Message(header=header, child_frame_id="tag", transform=place)])

    _, points = series_of([("/tf", 5.0, seen("left", 1.0)), ("/tf", 5.1, seen("right", 2.0))])
    assert [each.label for each in points] == ["left/tag", "right/tag"]
