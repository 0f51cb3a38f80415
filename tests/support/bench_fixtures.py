"""What several tests of the benchmark begin with."""

import pytest

from support.tiny import export_tiny


@pytest.fixture(scope="module")
def planner(tmp_path_factory):
    """The file of a planner with few and random weights."""
    return export_tiny(tmp_path_factory.mktemp("planner") / "tiny.gguf")
