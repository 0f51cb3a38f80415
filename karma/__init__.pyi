from karma.plugins.rules.talk.agent import Agent as Agent

__version__: str
