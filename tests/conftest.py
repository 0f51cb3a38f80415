"""What every test gets: no network, the same examples each time, reference data if it exists."""

import gc
import os
from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import settings
from support.paths import ROOT, SHARED

from karma.models.manifest import PLANNER, find_model, is_present, verify
from karma.offline import guard as offline

pytest_plugins = ("support.bench_fixtures",)
collect_ignore = ["support"]  # no tests or examples there; some of it needs a plug-in

# The same examples in every run of a tree, and no deadline: two cores are shared with other work.
EXAMPLES = int(os.environ.get("KARMA_EXAMPLES", "50"))  # where a test says no other number
settings.register_profile("karma", derandomize=True, deadline=None, max_examples=EXAMPLES)
settings.load_profile("karma")

os.environ.setdefault(PLANNER, "karma-nano")  # small weights; who tests others names them

offline.go_offline()  # before torch and transformers are imported, who read the switches then


@pytest.fixture(autouse=True)
def no_network():
    """Nobody asks for the network, or the test fails and says who."""
    offline.forget()
    yield
    offline.settle()


@pytest.fixture(scope="session")
def shared() -> Path:
    """The reference data: $KARMA_SHARED, or `shared` beside the checkout."""
    return SHARED


@pytest.fixture(scope="session")
def smollm() -> Path:
    """Real weights of somebody else's, SmolLM2-135M as a GGUF; skips where set-up had none."""
    return _brought("smollm2-135m")


@pytest.fixture(scope="session")
def mini() -> Path:
    """The tuned planner; skips where set-up could not make it."""
    return _brought("karma-mini")


@pytest.fixture(scope="session")
def nano(tmp_path_factory):
    """Models of an agent with karma-nano, loaded once."""
    from support.needs import need_models

    from karma.assistant.agent import asking
    from karma.loading.models import Models, load_resources

    need_models("karma-nano")
    maps = tmp_path_factory.mktemp("maps")
    return load_resources(asking(Models(planner="karma-nano")), maps=maps, seed=0, learn=True)


@pytest.fixture
def agent_in(nano, tmp_path):
    """A function that returns an agent with karma-nano in a room that it does not know."""
    from karma.assistant.agent import Agent

    def begin(scene, name="run"):
        maps = tmp_path / f"maps-{name}"
        loaded = replace(nano, maps=maps)
        return Agent(scene, resources=loaded, folder=tmp_path / name, maps=maps)

    return begin


@pytest.fixture(scope="session")
def clean_models(tmp_path_factory) -> Path:
    """The folder `models` without the gigabytes that may be brought, which take long to hash."""
    folder = tmp_path_factory.mktemp("models")
    (folder / "weights").mkdir()
    for path in (*(ROOT / "models").iterdir(), ROOT / "models/weights/karma-mini"):
        link = folder / path.relative_to(ROOT / "models")
        if path.exists() and not link.exists() and path.name != "local.toml":
            link.symlink_to(path)
    return folder


@pytest.fixture(scope="session")
def server(tmp_path_factory):
    """The base URL of llama-cpp-python's server with the nano planner; it wants the key."""
    from support.hosted_server import KEY, llama_server
    from support.needs import need_models

    need_models("karma-nano")
    with llama_server(tmp_path_factory.mktemp("server"), key=KEY) as url:
        yield url


def _brought(name: str) -> Path:
    entry = find_model(name)
    if not is_present(entry):
        pytest.skip(f"needs real weights, which set-up could not have: {entry.fix}")
    return verify(entry)[0]


def pytest_collection_modifyitems(items):
    """Who asks for the reference data is marked `shared`."""
    for item in items:
        if "shared" in getattr(item, "fixturenames", ()):
            item.add_marker("shared")


def pytest_collection_finish():
    """What was imported stays: no search for garbage goes through it again."""
    gc.freeze()


def pytest_runtest_setup(item):
    """Skip what is marked `shared` where the reference data is not: here, and nowhere else."""
    if item.get_closest_marker("shared") and not (SHARED / "data").is_dir():
        pytest.skip(f"needs the reference data: no folder {SHARED / 'data'}")
