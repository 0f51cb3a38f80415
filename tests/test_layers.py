"""Imports point down only; every module has its layer."""

import tomllib
from pathlib import Path

from importlinter.cli import lint_imports

ROOT = Path(__file__).parents[1]
CONFIG = ROOT / "pyproject.toml"


def layers() -> list[str]:
    """The names in the contract, without the brackets of those that may be missing."""
    contracts = tomllib.loads(CONFIG.read_text(encoding="utf-8"))["tool"]["importlinter"]
    (contract,) = (c for c in contracts["contracts"] if c["type"] == "layers")
    return [name.strip("() ") for row in contract["layers"] for name in row.split("|")]


def linted(config: Path, monkeypatch) -> int:
    # import-linter puts the working folder first on sys.path; the fixture takes it away again
    monkeypatch.chdir(ROOT)
    monkeypatch.syspath_prepend(str(ROOT))
    return lint_imports(config_filename=str(config), no_cache=True)


def test_imports_point_down_only(monkeypatch, capsys):
    status = linted(CONFIG, monkeypatch)
    assert status == 0, capsys.readouterr().out


def test_imports_that_point_up_are_noticed(tmp_path, monkeypatch, capsys):
    config = tmp_path / "upside_down.toml"
    config.write_text(
        '[tool.importlinter]\nroot_package = "karma"\n[[tool.importlinter.contracts]]\n'
        'name = "wrong"\ntype = "layers"\nlayers = ["karma.errors", "karma.memory"]\n',
        encoding="utf-8",
    )
    assert linted(config, monkeypatch) != 0
    assert "karma.memory" in capsys.readouterr().out


def test_every_module_of_the_package_has_a_layer():
    entries = [*(ROOT / "karma").glob("*.py"), *(ROOT / "karma").glob("*/__init__.py")]
    names = {path.parent.name if path.stem == "__init__" else path.stem for path in entries}
    assert {f"karma.{name}" for name in names - {"karma"}} <= set(layers())
