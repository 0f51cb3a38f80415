"""Replays and stories as tests ask about them."""

from karma.bench.report.replay import replaying


def replay(*given, **named):
    """The replay that comes last, after the shares that are done."""
    *_, found = replaying(*given, **named)
    return found


def scene_of(story, moment):
    """The room that the agent is in after a moment."""
    if moment.kind == "enter":
        return moment.text
    return story.parts[moment.part].scene if moment.part >= 0 else story.scene
