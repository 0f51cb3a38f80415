"""Commands that the plug-in brings; their modules are imported when they are used."""

from karma.cli.commands import CommandSpec

COMMANDS = (
    CommandSpec("world replay", "Replay ALFRED's demonstrations and compare.",
                "karma.plugins.alfred.cli:world_replay"),
    CommandSpec("world import-trials", "Turn ALFRED's trials into scene files.",
                "karma.plugins.alfred.cli:import_trials"),
)  # fmt: skip
