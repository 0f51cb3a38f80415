"""KARMA Offline: a household agent that remembers, on local inference only.

How data flows; each arrow is a frozen dataclass of `karma.types`, save the world's event::

    see    world -Event-> perceive -Observation-> skills -Experience-> method -MemoryUnit-> memory
    plan   memory -Recalled-> method -PlanRequest-> planner -Prompt-> models -Completion-> planner
    act    planner -Plan-> method, planner -SkillCall-> skills -SkillResult-> method
    know   memory -Area-> method, memory -Area-> skills, memory -Known-> skills
    show   perceive -SeenObject-> method, perceive -SeenObject-> memory
    tell   perceive -SeenObject-> planner
    ask    perceive -SeenObject-> models

Skills act on the world by naming AI2-THOR's actions. `perceive` is the one reader of its events;
`planner` is prompt, answer, parser and inspector. `world`, `memory` and `models` do not know each
other: only `method` joins them.
"""

from importlib import import_module

__all__ = ["Agent", "__version__"]
__version__ = "0.4.0"


def __getattr__(name: str) -> object:
    """Return `Agent`, which is imported when it is asked for: the package itself stays light."""
    if name == "Agent":
        return import_module("karma.assistant.agent").Agent
    raise AttributeError(f"module 'karma' has no attribute {name!r}")
