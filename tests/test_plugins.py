"""A plug-in that is not what its role asks for is named at load, with its package."""

import sys
import tomllib
from importlib.metadata import EntryPoints

import pytest
from support.paths import ROOT

from karma import registry
from karma.errors import UnknownNameError

MODULE = """
class Mute:
    def __init__(self, capacity): self.capacity = capacity
    def touch(self, key): return None

NUMBER = 3

class Good:
    def __init__(self, embedder, *, text="listing"): pass
    def recall(self, query, units, k): return []
"""
POINTS = {
    ("recalls", "number"): ("planted:NUMBER", "no class or function but int"),
    ("recalls", "gone"): ("planted:Gone", "has no attribute 'Gone'"),
    ("recalls", "raising"): ("planted_raising:X", "importing it raised RuntimeError: early"),
    ("recalls", "good"): ("planted:Good", ""),
    ("policies", "mute"): ("planted:Mute", "no method discard"),
}


@pytest.fixture
def planted(tmp_path, monkeypatch):
    (tmp_path / "planted.py").write_text(MODULE)
    (tmp_path / "planted_raising.py").write_text("raise RuntimeError('early')\n")
    info = tmp_path / "planted_package-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: planted-package\nVersion: 1.0\n")
    lines: dict[str, list[str]] = {}
    for (role, name), (value, _) in POINTS.items():
        lines.setdefault(role, [f"[karma.{role}]"]).append(f"{name} = {value}")
    (info / "entry_points.txt").write_text(
        "\n".join("\n".join(part) for part in lines.values()) + "\n"
    )
    monkeypatch.syspath_prepend(tmp_path)
    yield
    for name in ("planted", "planted_raising"):
        sys.modules.pop(name, None)


@pytest.mark.parametrize("role, name", POINTS)
def test_plugin_that_is_not_its_role_is_named_with_package_and_lack(role, name, planted):
    value, lack = POINTS[role, name]
    if not lack:
        assert registry.load(role, name).__name__ == "Good"
        return
    with pytest.raises(UnknownNameError) as told:
        registry.load(role, name)
    assert all(part in str(told.value) for part in (name, value, lack, "To fix"))
    assert "planted-package" in str(told.value)
    assert len(str(told.value).splitlines()) == 2


@pytest.mark.parametrize(
    ("role", "name"),
    [
        (role, name)
        for role, plugins in registry._PLUGIN_NAMES.items()
        for names in plugins.values()
        for name in names
    ],
)
def test_name_of_a_plug_in_that_is_missing_names_its_extra(monkeypatch, role, name):
    monkeypatch.setattr(registry, "_installed", EntryPoints)
    with pytest.raises(UnknownNameError, match=r"pip install 'karma-offline\[\w+\]'"):
        registry.load(role, name)


def ours():
    """The names that our own plug-ins register: role, name, plug-in."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    for group, entries in project["entry-points"].items():
        for name, target in entries.items():
            if target.startswith("karma.plugins."):
                yield group.removeprefix("karma."), name, target.split(".")[2]
    for name in registry.names("commands"):
        for spec in registry.load("commands", name):
            if spec.target:
                yield "commands", spec.path, name


def test_every_name_of_our_plug_ins_is_explained_without_them():
    unexplained = [
        (role, name)
        for role, name, plugin in ours()
        if role != "commands" or name != plugin  # the entry points of commands are no commands
        if plugin not in (registry.extra_of(role, name), registry.extra_of(role, name.split()[0]))
    ]
    assert unexplained == []
