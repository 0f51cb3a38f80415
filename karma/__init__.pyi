from karma.talk.agent import Agent as Agent

__version__: str
