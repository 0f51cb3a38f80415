"""Write line counts and layers into docs/architecture.md, from the code and pyproject.toml.

python scripts/count_lines.py            # rewrite the page
python scripts/count_lines.py --check    # exit code 1 if they are stale by more than a tenth
"""

import re
import sys
import tomllib
from pathlib import Path

ROOT = Path(__file__).parents[1]
PAGE = ROOT / "docs" / "architecture.md"
TOLERANCE = 0.1
_COUNTED = re.compile(r"^\|(.*)\| (\d+) \|$", re.MULTILINE)  # a table row that ends in a number
_PATH = re.compile(r"`((?:karma|tests)/[\w./]*)`")
_LAYERS = re.compile(
    r"(?<=<!-- layers: from pyproject.toml -->\n).*?(?=<!-- /layers -->)", re.DOTALL
)


def lines_of(row: str) -> int:
    """Return the lines of all Python files that a table row names, by file or by folder."""
    paths = [ROOT / name for name in _PATH.findall(row)]
    files = [f for path in paths for f in (path.rglob("*.py") if path.is_dir() else [path])]
    return sum(len(file.read_text(encoding="utf-8").splitlines()) for file in files)


def layers_text() -> str:
    """Return the import contracts of pyproject.toml, each with its layers, the top one first."""
    config = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    texts = []
    for contract in config["tool"]["importlinter"]["contracts"]:
        parts = [
            key for key in ("containers", "source_modules", "modules", "layers") if key in contract
        ]
        rows = [f"    {row}" for key in parts for row in contract[key]]
        texts.append("\n".join([contract["name"], *rows]))
    return "```\n" + "\n\n".join(texts) + "\n```\n"


def refreshed(page: str) -> str:
    """Return the page with today's counts and layers."""
    counted = _COUNTED.sub(lambda row: f"|{row[1]}| {lines_of(row[1])} |", page)
    return _LAYERS.sub(lambda _: layers_text(), counted)


def stale(page: str) -> list[str]:
    """Return what the page says wrongly, one sentence each."""
    found = []
    for row in _COUNTED.finditer(page):
        said, true = int(row[2]), lines_of(row[1])
        if abs(said - true) > TOLERANCE * true:
            found.append(f"{said} lines, but there are {true}: {row[1].strip()}")
    if _LAYERS.findall(page) != [layers_text()]:
        found.append("the layers are not those of pyproject.toml")
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
