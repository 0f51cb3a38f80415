"""Write the picture, line counts and plug-ins of docs/architecture.md from the code.

python scripts/make_architecture.py            # rewrite the page
python scripts/make_architecture.py --check    # exit code 1 if a count is off by more than a tenth
"""

import ast
import re
import sys
import textwrap
import tomllib
from pathlib import Path

ROOT = Path(__file__).parents[1]
PAGE = ROOT / "docs" / "architecture.md"
TOLERANCE = 0.1
_COUNTED = re.compile(r"^\|(.*)\| (\d+) \|$", re.MULTILINE)  # a table row that ends in a number
_PATH = re.compile(r"`((?:karma|tests)/[\w./]*)`")
_PLUGIN = re.compile(r"^(\| \[\w+\].*?`karma/plugins/(\w+)/`) \|.*\| (\d+) \|$", re.MULTILINE)
_FLOW = re.compile(r"(?<=<!-- flow: from karma/__init__.py -->\n).*?(?=<!-- /flow -->)", re.DOTALL)


def lines_of(row: str) -> int:
    """Return the lines of all Python files that a table row names, by file or by folder."""
    paths = [ROOT / name for name in _PATH.findall(row)]
    files = [f for path in paths for f in (path.rglob("*.py") if path.is_dir() else [path])]
    return sum(len(file.read_text(encoding="utf-8").splitlines()) for file in files)


def flow_text() -> str:
    """Return the picture in the docstring of the package."""
    module = ast.parse((ROOT / "karma" / "__init__.py").read_text(encoding="utf-8"))
    drawn = re.search(r"::\n\n((?: {4}.*\n|\n)+)", ast.get_docstring(module) or "")
    return f"```\n{textwrap.dedent(drawn[1] if drawn else '').strip()}\n```\n"


def plugin_cells(name: str) -> str:
    """Return the entry-point groups and the imports of a plug-in, as two table cells."""
    groups = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]["entry-points"]
    own = f"karma.plugins.{name}."
    roles = [role for role, found in groups.items() if any(own in v for v in found.values())]
    source = "".join(f.read_text("utf-8") for f in (ROOT / f"karma/plugins/{name}").rglob("*.py"))
    imported = set(re.findall(r"^ *from karma\.plugins\.(\w+)", source, re.MULTILINE)) - {name}
    registers = ", ".join(f"`{role}`" for role in sorted(roles)) or "nothing"
    return f"{registers} | {', '.join(['core', *(f'`{plugin}`' for plugin in sorted(imported))])}"


def refreshed(page: str) -> str:
    """Return the page with today's picture, counts and plug-ins."""
    page = _PLUGIN.sub(lambda row: f"{row[1]} | {plugin_cells(row[2])} | {row[3]} |", page)
    page = _COUNTED.sub(lambda row: f"|{row[1]}| {lines_of(row[1])} |", page)
    return _FLOW.sub(lambda _: flow_text(), page)


def stale(page: str) -> list[str]:
    """Return what is out of date on the page, a sentence each."""
    found = []
    for row in _COUNTED.finditer(page):
        written, counted = int(row[2]), lines_of(row[1])
        if abs(written - counted) > TOLERANCE * counted:
            found.append(f"{written} lines, but there are {counted}: {row[1].strip()}")
    for row in _PLUGIN.finditer(page):
        if plugin_cells(row[2]) not in row[0]:
            found.append(f"{row[2]}: registers and imports are {plugin_cells(row[2])}")
    if _FLOW.findall(page) != [flow_text()]:
        found.append("the picture is not that of karma/__init__.py")
    return found


def main() -> int:
    """Check or rewrite the page; return the exit code."""
    page = PAGE.read_text(encoding="utf-8")
    if "--check" not in sys.argv[1:]:
        PAGE.write_text(refreshed(page), encoding="utf-8")
        return 0
    found = stale(page)
    for sentence in found:
        print(f"{PAGE.relative_to(ROOT)}: {sentence}")
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
