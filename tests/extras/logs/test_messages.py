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


def test_a_marker_that_two_cameras_see_is_two_points() -> None:
    def seen(frame: str, x: float) -> _Message:
        stamp = _Message(sec=5, nanosec=0)
        place = _Message(translation=_Message(x=x, y=0.0, z=1.0))
        header = _Message(frame_id=frame, stamp=stamp)
        return _Message(transforms=[_Message(header=header, child_frame_id="tag", transform=place)])

    _, points = series_of([("/tf", 5.0, seen("left", 1.0)), ("/tf", 5.1, seen("right", 2.0))])
    assert [each.label for each in points] == ["left/tag", "right/tag"]
