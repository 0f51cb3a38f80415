"""Each plug-in can be deleted: `karma --help`, an episode of the demo and core tests still run.

A tree of links stands for the copy: it lacks the plug-in's folder, its tests and its entry points.
"""

import os
import re
import subprocess
import sys
import tomllib

import pytest
from support.needs import need_models
from support.paths import ROOT

from karma.models.manifest import resolve_planner

PLUGINS = sorted(path.parent.name for path in (ROOT / "karma" / "plugins").glob("*/__init__.py"))
FAST = (
    "agent/test_program.py", "bench/test_metrics.py", "memory/test_short_term.py",
    "household/test_containment.py", "household/test_types.py", "world/test_world_actions_hand.py",
)  # fmt: skip
COMMAND = {  # a command that each plug-in brings, where it brings one
    "airgap": ("bundle", "verify", "x.tar"), "alfred": ("world", "replay", "x"),
    "homes": ("home", "list"), "rules": ("read", "wash the mug"),
    "thor_tools": ("world", "replay-events", "x"), "training": ("vlm", "eval"),
    "vision": ("eval", "eval/alfred_l_vlm.toml", "--out", "out"),
}  # fmt: skip


def tree_without(plugin, folder):
    """Make a tree of links to this one, without a plug-in."""
    for name in ("karma", "karma/plugins", "tests", "tests/plugins"):
        (folder / name).mkdir(parents=True)
        for path in (ROOT / name).iterdir():
            link = folder / name / path.name
            if path.name not in ("plugins", "__pycache__", plugin) and not link.exists():
                link.symlink_to(path)
    for name in ("eval", "models", "pyproject.toml", "setup.py"):
        (folder / name).symlink_to(ROOT / name)
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    lines = []
    for group, entries in project["entry-points"].items():
        own = [f"{k} = {v}" for k, v in entries.items() if f"plugins.{plugin}." not in v]
        lines += [f"[{group}]", *own]
    info = folder / "karma_offline-0.dist-info"
    info.mkdir()
    (info / "entry_points.txt").write_text("\n".join(lines))
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: karma-offline\nVersion: 0\n")
    return folder


def ran(tree, *command):
    environment = {**os.environ, "PYTHONPATH": str(tree), "COLUMNS": "100"}
    return subprocess.run(
        [sys.executable, *command], cwd=tree, check=False, capture_output=True, text=True,
        env=environment, timeout=300,
    )  # fmt: skip


def without_hints(folder):
    """Return options for karma-nano without its words file: the plug-in `rules` reads that."""
    weights = resolve_planner("karma-nano").path
    (folder / "bare.gguf").symlink_to(weights)
    return "--set", f"models.planner={folder / 'bare.gguf'}", "--set", "models.profile=compact"


@pytest.mark.parametrize("plugin", PLUGINS)
def test_core_runs_without_a_plug_in(plugin, tmp_path):
    need_models("karma-nano")
    tree = tree_without(plugin, tmp_path / "tree")
    shown = ran(tree, "-m", "karma", "--help")
    assert shown.returncode == 0, shown.stderr
    assert "eval" in shown.stdout
    if plugin in COMMAND:
        refused = ran(tree, "-m", "karma", *COMMAND[plugin])
        assert refused.returncode in (1, 2), refused.stdout + refused.stderr
        assert re.search(rf"karma-offline\[{plugin}\]", refused.stderr)
    bare = without_hints(tmp_path) if plugin == "rules" else ()
    demo = ran(
        tree, "-m", "karma", "eval", "eval/demo.toml", "--out", str(tmp_path / "run"),
        "--limit", "1", "--workers", "1", *bare,
    )  # fmt: skip
    assert demo.returncode == 0, demo.stdout + demo.stderr
    assert (tmp_path / "run" / "results.json").exists()
    tests = ran(
        tree,
        "-m",
        "pytest",
        "-q",
        "-x",
        "-p",
        "no:cacheprovider",
        *(f"tests/{one}" for one in FAST),
    )
    assert tests.returncode == 0, tests.stdout[-3000:] + tests.stderr[-2000:]
