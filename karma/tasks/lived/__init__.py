"""What residents ask of the robot at home: drawn with the truth, judged by it, read by rules."""

from karma.tasks.lived.drawing import draw_request
from karma.tasks.lived.reading import Reader
from karma.tasks.lived.request import (
    HomeView,
    LivedKind,
    LivedRequest,
    answered_rightly,
    done,
    room_right,
)

__all__ = [
    "HomeView",
    "LivedKind",
    "LivedRequest",
    "Reader",
    "answered_rightly",
    "done",
    "draw_request",
    "room_right",
]
