"""Fixtures for pytest, there wherever this package is installed (entry point `pytest11`).

Nothing heavy is imported before a test asks for it. No weights are needed and no network.
"""

from collections.abc import Callable, Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

if TYPE_CHECKING:
    from karma.agent.loop import KarmaAgent
    from karma.types.roles import Resources, VisionModel


@pytest.fixture
def karma_resources(tmp_path: Path) -> "Callable[..., Resources]":
    """Return what makes `Resources` of a planner's answers: stand-ins in all other roles."""
    from karma import registry
    from karma.testing import ScriptedModel, StubEmbedder, StubVision
    from karma.types.completion import Decoding
    from karma.types.roles import Resources

    def make(answers: Iterable[str], vision: "VisionModel | None" = None) -> "Resources":
        embedder = StubEmbedder()
        return Resources(
            model=ScriptedModel(answers),
            profile="compact",
            decoding=Decoding(),
            recall=registry.load("recalls", "cosine")(embedder),
            vision=vision or StubVision(),
            embedder=embedder,
            maps=tmp_path / "maps",
        )

    return make


@pytest.fixture
def karma_episode(
    karma_resources: "Callable[..., Resources]", tmp_path: Path
) -> "Callable[..., KarmaAgent]":
    """Return what begins an episode in a room: the agent, with a planner's answers given.

    `karma_episode(answers, scene="kitchen_1", vision=None, **options)`; options are those of a row.
    """

    def begin(
        answers: Iterable[str],
        scene: str = "kitchen_1",
        vision: "VisionModel | None" = None,
        **options: Any,
    ) -> "KarmaAgent":
        from karma.agent.karma import KarmaMethod
        from karma.loading.models import world_maker
        from karma.types.space import SceneRef

        method = KarmaMethod.build(karma_resources(answers, vision), options)
        world = world_maker("embedded", [options])()
        world.reset(scene)
        return method.begin(world, SceneRef.of(scene), seed=0, folder=tmp_path)

    return begin


@pytest.fixture(scope="session")
def karma_tiny_planner(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the path of a GGUF of random weights: it loads and plans as real ones do."""
    from karma.testing import make_planner

    return make_planner(tmp_path_factory.mktemp("karma") / "tiny.gguf")
