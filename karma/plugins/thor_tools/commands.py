"""Commands that the plug-in brings; their modules are imported when they are used."""

from karma.cli.commands import CommandSpec

COMMANDS = (
    CommandSpec("world import", "Turn AI2-THOR metadata dumps into scene files.",
                "karma.plugins.thor_tools.cli:world_import"),
    CommandSpec("world replay-events", "Replay recorded AI2-THOR sessions and compare.",
                "karma.plugins.thor_tools.cli:world_replay_events"),
)  # fmt: skip
