"""What every test gets: no network, the same examples each time, reference data if it exists."""

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
    """The folder of reference data beside (or in) the checkout; the test skips without it."""
    root = Path(__file__).parents[1]
    for folder in (root / "shared", root.parent / "shared"):
        if folder.is_dir():
            return folder
    pytest.skip("needs the reference data: no folder `shared` in or beside the checkout")
