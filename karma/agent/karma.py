"""KARMA: both memories in the prompt; without either memory it is an ablation of Table 2."""

from collections.abc import Mapping
from dataclasses import KW_ONLY, dataclass, field, replace
from pathlib import Path
from typing import Any, ClassVar, Self

from karma.agent.goal_mode.loop import GoalLoop
from karma.agent.goal_mode.names import nearest_text
from karma.agent.loop import KarmaAgent
from karma.agent.memory import AgentMemory
from karma.agent.options import settings_of
from karma.agent.planning.planner import Planner
from karma.agent.planning.prompt import GOALS, TOOLS
from karma.agent.seeing.eyes import perception_of
from karma.agent.settings import KarmaSettings
from karma.agent.tools.loop import ToolLoop
from karma.types.roles import Embedder, Recall, Resources, VisionModel, World
from karma.types.space import SceneRef


@dataclass(eq=False)
class KarmaMethod:
    """The agent of the paper's Fig. 1.

    `maps` is a folder of long-term memories, a file for each scene, made on the first visit and
    never changed by an episode unless it may `learn`; None: each episode explores.
    """

    settings_kind: ClassVar[type] = KarmaSettings
    planner: Planner
    recall: Recall
    vision: VisionModel
    settings: KarmaSettings = field(default_factory=KarmaSettings)
    _: KW_ONLY
    maps: Path | None = None
    learn: bool = False
    embedder: Embedder | None = None  # of names that a small model answers, in goal mode
    attempts: int = 3  # programs for one instruction; later ones quote the failures

    @property
    def name(self) -> str:
        """The row's name as the paper writes it, by the memories that it lacks."""
        kinds = {"long": self.settings.long_term, "short": self.settings.short_term}
        missing = " and ".join(word for word, is_used in kinds.items() if not is_used)
        return "KARMA" + (f" (w/o {missing} term memory)" if missing else "")

    @classmethod
    def build(cls, resources: Resources, options: Mapping[str, Any]) -> Self:
        """Make a row from its options, the fields of `KarmaSettings`."""
        settings = settings_of(KarmaSettings, options)
        return cls(
            Planner.of(resources),
            resources.recall,
            resources.vision,
            settings,
            maps=resources.maps,
            learn=resources.learn,
            embedder=resources.embedder,
        )

    def begin(self, world: World, scene: SceneRef, *, seed: int, folder: Path) -> KarmaAgent:
        """Start an episode: short-term memory empty, long-term memory loaded or explored."""
        perception = perception_of(self.settings.perception, self.vision)
        memory = AgentMemory(
            self.settings, self.recall, self.vision,
            maps=self.maps, learn=self.learn,
            keeps_tour=self.planner.profile in (GOALS, TOOLS),
            perception=perception, seed=seed, pictures=folder,
        )  # fmt: skip
        agent = KarmaAgent(world, self.planner, memory, perception, self.attempts)
        if self.planner.profile == TOOLS:
            agent = replace(agent, mode=ToolLoop(self.planner, memory).executor)
        elif self.planner.profile == GOALS:
            loop = GoalLoop(self.planner, memory, nearest_text(self.embedder))
            agent = replace(agent, mode=loop.executor)
        agent.enter(scene)
        return agent
