from karma.assistant.agent import Agent as Agent

__version__: str
