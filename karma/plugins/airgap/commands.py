"""Commands that the plug-in brings; their modules are imported when they are used."""

from karma.cli.commands import MACHINES, CommandSpec

COMMANDS = (
    CommandSpec("bundle", "All in one archive, for a machine without a network.", panel=MACHINES),
    CommandSpec("bundle build", "Write a bundle.", "karma.plugins.airgap.cli:BuildCommand"),
    CommandSpec("bundle verify", "Check every file without unpacking.",
                "karma.plugins.airgap.cli:bundle_verify"),
    CommandSpec("bundle install", "Verify and install, with no network.",
                "karma.plugins.airgap.cli:bundle_install"),
)  # fmt: skip
