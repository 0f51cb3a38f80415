"""Write the picture and the line counts of docs/architecture.md from the code.

python scripts/make_architecture.py            # rewrite the page
python scripts/make_architecture.py --check    # exit code 1 if a count is off by more than a tenth
"""

import ast
import re
import sys
import textwrap
from pathlib import Path

ROOT = Path(__file__).parents[1]
PAGE = ROOT / "docs" / "architecture.md"
TOLERANCE = 0.1
_COUNTED = re.compile(r"^\|(.*)\| (\d+) \|$", re.MULTILINE)  # a table row that ends in a number
_PATH = re.compile(r"`((?:karma|tests)/[\w./]*)`")
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


def refreshed(page: str) -> str:
    """Return the page with today's picture and counts."""
    page = _COUNTED.sub(lambda row: f"|{row[1]}| {lines_of(row[1])} |", page)
    return _FLOW.sub(lambda _: flow_text(), page)


def stale(page: str) -> list[str]:
    """Return what the page says wrongly, one sentence each."""
    found = []
    for row in _COUNTED.finditer(page):
        said, true = int(row[2]), lines_of(row[1])
        if abs(said - true) > TOLERANCE * true:
            found.append(f"{said} lines, but there are {true}: {row[1].strip()}")
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
