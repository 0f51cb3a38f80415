"""Imports point down only; every module has its layer."""

import ast
import re
import subprocess
import sys
import tomllib
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import grimp
from support.paths import ROOT

CONFIG = ROOT / "pyproject.toml"


def layers() -> list[str]:
    """The names in the contract, without the brackets of those that may be missing."""
    contracts = tomllib.loads(CONFIG.read_text(encoding="utf-8"))["tool"]["importlinter"]
    contract = contracts["contracts"][0]
    return [name.strip("() ") for row in contract["layers"] for name in row.split("|")]


def linted(config: Path) -> subprocess.CompletedProcess[str]:
    """Run it apart: in this process it would switch off all loggers there are."""
    code = "import sys; from importlinter.cli import lint_imports as lint; "
    code += f"sys.exit(lint(config_filename={str(config)!r}, no_cache=True))"
    command = [sys.executable, "-c", code]
    return subprocess.run(command, cwd=ROOT, check=False, capture_output=True, text=True)


def test_imports_point_down_only():
    done = linted(CONFIG)
    assert done.returncode == 0, done.stdout + done.stderr


def test_every_module_of_the_package_has_a_layer():
    entries = [*(ROOT / "karma").glob("*.py"), *(ROOT / "karma").glob("*/__init__.py")]
    names = {path.parent.name if path.stem == "__init__" else path.stem for path in entries}
    assert {f"karma.{name}" for name in names - {"karma"}} <= {*layers(), "karma.plugins"}


def test_no_module_imports_itself_through_others_not_even_for_types_or_inside_functions():
    imports = grimp.build_graph("karma", cache_dir=None)
    graph = {name: imports.find_modules_directly_imported_by(name) for name in imports.modules}
    assert graph["karma.world.event"] >= {"karma.world.render.picture"}  # inside a function
    try:
        TopologicalSorter(graph).prepare()
    except CycleError as error:
        raise AssertionError("imports in a circle: " + " <- ".join(error.args[1])) from None


def test_every_class_of_the_core_has_a_name_of_its_own():
    found: dict[str, list[str]] = {}
    for path in sorted((ROOT / "karma").rglob("*.py")):
        if "plugins" in path.parts:
            continue
        for name in re.findall(r"^class (\w+)", path.read_text(encoding="utf-8"), re.MULTILINE):
            found.setdefault(name, []).append(str(path))
    assert {name: modules for name, modules in found.items() if len(modules) > 1} == {}


def test_tests_of_the_core_and_their_support_import_no_plug_in():
    tests = ROOT / "tests"
    own = {path: name_in(tests, path) for path in tests.rglob("*.py")}
    imports = {name: imported_by(path) for path, name in own.items() if "plugins" not in path.parts}
    reached = {name for name in imports if not name.startswith("support.")}
    while more := {name for one in reached for name in imports[one] & imports.keys()} - reached:
        reached |= more
    assert len(reached) > 100
    plugins = {
        name: sorted(one for one in imports[name] if one.startswith("karma.plugins"))
        for name in sorted(reached)
    }
    assert {name: found for name, found in plugins.items() if found} == {}


def name_in(folder: Path, path: Path) -> str:
    return ".".join(path.relative_to(folder).with_suffix("").parts).removesuffix(".__init__")


def imported_by(path: Path) -> set[str]:
    """All names of modules that a file may import, also inside functions."""
    found = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            found |= {one.name for one in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            found |= {node.module, *(f"{node.module}.{one.name}" for one in node.names)}
    return found


def test_core_tests_of_the_makefile_are_all_folders_of_the_core():
    text = (ROOT / "Makefile").read_text()
    named = re.search(r"CORE_TESTS = \$\(addprefix tests/,(.*?)\)", text, re.DOTALL)[1].split()
    others = {"abuse", "golden", "plugins", "support", "__pycache__"}
    folders = {path.name for path in (ROOT / "tests").iterdir() if path.is_dir()} - others
    assert {name for name in named if name not in ("\\",) and "." not in name} == folders
