"""The checkout and the installed package: complete, light, and what pyproject.toml says.

Covered: data folders without code, file sizes, entry points, versions, the locks, import without
side effects. Not covered: `make setup` itself, which is what got the tests here.
"""

import os
import re
import subprocess
import sys
import tomllib
from importlib.metadata import entry_points, metadata, requires, version

import pytest
import yaml
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name
from support.paths import ROOT

import karma

PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
DECLARED = {
    (role, name): target
    for role, names in PROJECT["entry-points"].items()
    for name, target in names.items()
}
LARGEST_BYTES = 20_000_000


# ----------------------------------------------------------------- the checkout


def tracked() -> list[str]:
    """The paths that git knows."""
    if not (ROOT / ".git").exists():
        pytest.skip("not a git checkout, so nothing tells which files belong to it")
    command = ["git", "-c", f"safe.directory={ROOT}", "ls-files", "-z"]
    done = subprocess.run(command, cwd=ROOT, check=True, capture_output=True, text=True)
    return [path for path in done.stdout.split("\0") if path]


@pytest.mark.parametrize("folder", ["models", "eval"])
def test_data_folders_hold_no_python(folder):
    assert [*(ROOT / folder).rglob("*.py"), *(ROOT / folder).rglob("*.pyc")] == []


def test_files_in_git_stay_small():
    sizes = {path: (ROOT / path).stat().st_size for path in tracked() if (ROOT / path).is_file()}
    assert {path: size for path, size in sizes.items() if size > LARGEST_BYTES} == {}


# ----------------------------------------------------------------- the package


def test_version_is_one():
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
    assert karma.__version__ == PROJECT["version"] == version("karma-offline")
    assert citation["version"] == PROJECT["version"]
    assert citation["license"] == PROJECT["license"] == "Apache-2.0"


def test_installed_entry_points_are_the_declared_ones():
    groups = {group for group, _ in DECLARED}
    installed = {
        (ep.group, ep.name): ep.value
        for group in groups
        for ep in entry_points(group=group)
        if ep.dist is not None and canonicalize_name(ep.dist.name) == "karma-offline"
    }
    assert installed == DECLARED, "run `make setup` to install what pyproject.toml declares now"


@pytest.mark.parametrize(("group", "name"), sorted(DECLARED))
def test_entry_point_loads(group, name):
    (found,) = (
        ep for ep in entry_points(group=group, name=name)
        if ep.dist is not None and canonicalize_name(ep.dist.name) == "karma-offline"
    )  # fmt: skip
    assert callable(found.load()) == (
        group not in ("karma.commands", "pytest11")
    )  # a plug-in is a module


@pytest.mark.parametrize("module", ["karma", "karma.types.roles", "karma.registry", "karma.cli"])
def test_import_is_light_and_leaves_nothing_behind(module, tmp_path):
    program = (
        "import sys, threading\n"
        f"import {module}\n"
        "heavy = {'torch', 'transformers', 'sentence_transformers', 'llama_cpp', 'faiss'}\n"
        "print(sorted(heavy & set(sys.modules)), threading.active_count())\n"
    )
    environment = {**os.environ, "HOME": str(tmp_path), "PYTHONDONTWRITEBYTECODE": "1"}
    done = subprocess.run(
        [sys.executable, "-c", program],
        cwd=tmp_path, env=environment, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert (done.stdout, done.stderr) == ("[] 1\n", "")
    assert list(tmp_path.iterdir()) == []


# ----------------------------------------------------------------- the locks

RUNS, EXTRAS, DEVELOPS = (f"requirements{part}.lock" for part in ("", "-extras", "-dev"))


def locked(*files: str) -> dict[str, Requirement]:
    """The requirements of some locks by canonical name."""
    lines = [line for name in files for line in (ROOT / name).read_text("utf-8").splitlines()]
    found = [Requirement(line) for line in lines if line and not line.startswith("#")]
    names = [canonicalize_name(one.name) for one in found]
    assert len(names) == len(set(names))
    return dict(zip(names, found, strict=True))


def pinned_version(requirement: Requirement) -> str:
    (specifier,) = requirement.specifier
    assert specifier.operator == "=="
    return specifier.version


def needed(texts: list[str]) -> set[str]:
    """The canonical names of some installed packages and of all that they need here."""
    todo, seen = [Requirement(text) for text in texts], set()
    while todo:
        one = todo.pop()
        key = canonicalize_name(one.name), frozenset(one.extras)
        if key in seen:
            continue
        seen.add(key)
        for need in map(Requirement, requires(key[0]) or []):
            extras = ("", *one.extras)
            if need.marker is None or any(need.marker.evaluate({"extra": e}) for e in extras):
                todo.append(need)
    return {name for name, _ in seen}


def test_locks_pin_each_package_to_one_version_and_no_place():
    for name, requirement in locked(RUNS, EXTRAS, DEVELOPS).items():
        assert requirement.url is None, name
        assert re.fullmatch(r"[0-9][0-9a-z.]*", pinned_version(requirement)), name


def test_lock_takes_torch_first_and_in_any_build():
    extras = PROJECT["optional-dependencies"]
    first = next(iter(locked(RUNS).values()))
    assert str(first) == "torch==2.13.0"
    (ours,) = (r for r in map(Requirement, extras["vision"]) if r.name == "torch")
    assert not any(one.operator in ("==", "===") for one in ours.specifier)


def test_locks_cover_every_dependency_within_its_range():
    extras = PROJECT["optional-dependencies"]
    runs, more, all_ = locked(RUNS), locked(RUNS, EXTRAS), locked(RUNS, EXTRAS, DEVELOPS)
    for pins, texts in (
        (runs, [*PROJECT["dependencies"], *extras["rules"], *extras["vision"]]),
        (more, [*extras["thor"], *extras["hosted"]]),
        (all_, [text for extra in extras.values() for text in extra]),
    ):
        for wanted in map(Requirement, texts):
            pin = pins.get(canonicalize_name(wanted.name))
            assert pin is not None, f"{wanted.name} is not locked"
            assert wanted.specifier.contains(pinned_version(pin)), f"{pin} is outside {wanted}"


def test_each_lock_holds_what_its_part_needs_and_nothing_else():
    """What only extras need is no part of a bundle, what only `dev` needs of neither."""
    extras = PROJECT["optional-dependencies"]
    server = "llama-cpp-python[server]"  # docs/plugins/hosted.md tries hosted models with it
    base = needed([*PROJECT["dependencies"], *extras["rules"], *extras["vision"]])
    more = needed([*extras["thor"], *extras["hosted"], server])
    runs, added = (
        {name for name, r in locked(lock).items() if r.marker is None or r.marker.evaluate()}
        for lock in (RUNS, EXTRAS)
    )
    assert runs - base == set()
    assert added - more == set()
    assert added & base == set()
    assert set(locked(DEVELOPS)) & (base | more) == set()
    assert {"opencv-python", "botocore", "ai2thor", "openai"} <= added


def test_every_plug_in_has_an_extra_and_its_packages_are_no_dependencies():
    plugins = {one.name for one in (ROOT / "karma" / "plugins").iterdir() if one.is_dir()}
    extras = PROJECT["optional-dependencies"]
    assert plugins - {"__pycache__"} <= set(extras)
    names = {Requirement(text).name for text in PROJECT["dependencies"]}
    brought = {Requirement(t).name for one in plugins & set(extras) for t in extras[one]}
    assert brought & names == set()
    assert set(registry_names()) <= plugins


def registry_names():
    from karma.registry import _PLUGIN_NAMES

    return {plugin for names in _PLUGIN_NAMES.values() for plugin in names}


def test_no_package_of_bundles_is_under_the_gpl():
    for name, pin in locked(RUNS, EXTRAS).items():
        if pin.marker is None or pin.marker.evaluate():
            said = metadata(name)
            lines = [said.get("License-Expression") or "", *said.get_all("Classifier", [])]
            assert not [line for line in lines if re.search(r"\bA?GPL|GNU (Affero )?General", line)]
