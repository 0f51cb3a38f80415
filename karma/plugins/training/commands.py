"""Commands that the plug-in brings; their modules are imported when they are used."""

from karma.cli.commands import MATERIAL, CommandSpec

COMMANDS = (
    CommandSpec("models tune", "Tune a GGUF on examples of your own.",
                "karma.plugins.training.cli:models_tune"),
    CommandSpec("vlm", "Score models that read states (open, dirty ...) out of pictures.",
                panel=MATERIAL),
    CommandSpec("vlm eval", "Score a vision model on rooms that its training never saw.",
                "karma.plugins.training.cli:vlm_eval"),
)  # fmt: skip
