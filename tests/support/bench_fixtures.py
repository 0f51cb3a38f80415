"""What several tests of the benchmark begin with."""

import pytest

from support.chromium import chromium
from support.tiny import export_tiny


@pytest.fixture(scope="module")
def planner(tmp_path_factory):
    """The file of a planner with few and random weights."""
    return export_tiny(tmp_path_factory.mktemp("planner") / "tiny.gguf")


@pytest.fixture(scope="module")
def browser(tmp_path_factory):
    """A browser of the module's own; skips without Chromium."""
    with chromium(tmp_path_factory.mktemp("profile")) as found:
        yield found


@pytest.fixture
def tab(browser, page, tmp_path):
    """The browser for a report's page, which asks for nothing else and complains of nothing."""
    path = tmp_path / "report.html"
    path.write_text(page, encoding="utf-8")
    browser.page = path.as_uri()
    yield browser
    assert set(browser.requests()) <= {browser.page}
    assert browser.complaints() == []
    assert browser.value("document.title") != "owned"
