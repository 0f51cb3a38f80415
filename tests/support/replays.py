"""Replays and stories as tests ask about them."""

from karma.bench.report.episodes import EpisodeReplay
from karma.bench.report.replay import replaying


def replay(*given, **named):
    """The replay that comes last, after the shares that are done."""
    *_, found = replaying(*given, **named)
    return found


def replayed(replayer, *records):
    """The episodes that can be stepped through, after the shares that are done."""
    return [one for one in replayer.replaying(*records) if isinstance(one, EpisodeReplay)]


def scene_of(story, moment):
    """The room that the agent is in after a moment."""
    if moment.kind == "enter":
        return moment.text
    return story.parts[moment.part].scene if moment.part >= 0 else story.scene
