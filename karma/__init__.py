"""KARMA Offline: a household agent that remembers, on local inference only.

One direction of data (each arrow is a frozen dataclass of `karma.contracts`)::

    World -Event-> perceive -Observation, MemoryUnit-> memory -Recalled-> prompt
      ^                                                                     |
      |                                                                   Prompt
      |                                                                     v
    skills <-SkillCall- program <-Completion- infer <----------------------+

`world`, `memory` and `infer` do not know each other; only `methods` joins them.
"""

__version__ = "0.1.0"
