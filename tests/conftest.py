"""What every test gets: no network, the same examples each time, reference data if it exists."""

import os
import socket
from pathlib import Path

import pytest
from hypothesis import settings

# The same examples in every run, and no deadline: two cores are shared with other work.
settings.register_profile("karma", derandomize=True, deadline=None, max_examples=100)
settings.load_profile("karma")

_LOOPBACK = ("127.", "::1", "localhost")


def _refusing(original):
    def connect(self, address):
        if self.family == socket.AF_UNIX or str(address[0]).startswith(_LOOPBACK):
            return original(self, address)
        raise OSError(f"tests have no network: a connection to {address!r} was refused")

    return connect


@pytest.fixture(autouse=True)
def no_network(monkeypatch):
    """Sockets reach this machine only."""
    for name in ("connect", "connect_ex"):
        monkeypatch.setattr(socket.socket, name, _refusing(getattr(socket.socket, name)))


@pytest.fixture(scope="session")
def shared() -> Path:
    """The reference data: $KARMA_SHARED, or `shared` beside the checkout; skips without it."""
    folder = Path(os.environ.get("KARMA_SHARED", Path(__file__).parents[2] / "shared"))
    if not folder.is_dir():
        pytest.skip(f"needs the reference data: no folder {folder}")
    return folder
