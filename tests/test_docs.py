"""Every link, path and command in the documents holds; the front page stays short."""

import os
import re
import subprocess
import sys
from collections.abc import Callable, Iterable
from functools import cache
from pathlib import Path
from typing import Any

import pytest
import typer.main
from support.documents import PAGES, anchors, code, commands, links, name_of, text_of
from support.paths import ROOT

from karma.cli import app
from karma.cli.commands import LazyGroup

HISTORY = ROOT / "CHANGELOG.md"  # it names what is no more
NOW = [page for page in PAGES if page != HISTORY]
FOREIGN = {"InteractionObject"}  # classes of others
MADE_LATER = ("models/weights", "models/local.toml")  # by users, ignored by git
NEEDS = re.compile(r"^\* (`[^`]+`(?:, `[^`]+`)*): (.+)$", re.MULTILINE)
PATHS = re.compile(r"(?<![\w/.~-])((?:karma|docs|tests|scripts|eval|models)/[\w./*-]*[\w*/])")


@cache
def needs() -> dict[tuple[str, ...], str]:
    """Return what each command needs, by its first words, from the list of docs/README.md."""
    table = text_of(ROOT / "docs/README.md").partition("## What each command needs")[2]
    return {
        tuple(command.split()): need
        for listed, need in NEEDS.findall(table)
        for command in re.findall(r"`([^`]+)`", listed)
    }


def row_of(words: list[str]) -> tuple[str, ...] | None:
    """Return the longest row of the table that a command begins with."""
    fits = [row for row in needs() if tuple(" ".join(words).split())[: len(row)] == unquoted(row)]
    return max(fits, key=len, default=None)


def unquoted(row: tuple[str, ...]) -> tuple[str, ...]:
    return tuple(" ".join(row).replace('"', "").split())


def on_pages(pages: Iterable[Path], wrong: Callable[[Path], list[str]]) -> dict[str, list[str]]:
    """Return what is wrong, by page, without the pages that are right."""
    return {name_of(page): found for page in pages if (found := wrong(page))}


# ----------------------------------------------------------------- links and paths


def test_every_link_leads_to_a_file_and_a_heading():
    assert not on_pages(PAGES, dead_links)


def dead_links(page: Path) -> list[str]:
    dead = []
    for link in links(page):
        path, _, anchor = link.partition("#")
        target = (page.parent / path).resolve() if path else page
        is_there = target.exists() and (not anchor or anchor in anchors(target))
        if not (re.match(r"[a-z]+:", link) or is_there):
            dead.append(link)
    return dead


def test_no_page_holds_a_conflict_that_was_not_solved():
    marks = re.compile(r"^(?:<{7} |>{7} |={7}$)", re.MULTILINE)
    assert not on_pages(PAGES, lambda page: marks.findall(text_of(page)))


def test_every_page_is_linked_from_the_index():
    home, index = ROOT / "README.md", ROOT / "docs/README.md"
    linked = {
        (page.parent / link.partition("#")[0]).resolve()
        for page in (home, index)
        for link in links(page)
    }
    wanted = {page for page in PAGES if page.parts[len(ROOT.parts)] not in ("eval", "models")}
    assert wanted - linked - {home, index} == set()


def test_every_path_that_is_named_exists():
    assert not on_pages(NOW, missing_paths)


def missing_paths(page: Path) -> list[str]:
    names = PATHS.findall(re.sub(r"https?://\S+", "", text_of(page)))
    meant = [n for n in names if not re.search(r"[A-Z]{3}", Path(n).stem)]  # not FILE, NAME
    there = [n for n in meant if n.startswith(MADE_LATER) or any(ROOT.glob(n.rstrip("/")))]
    return sorted(set(meant) - set(there))


def test_every_module_that_is_named_exists():
    assert not on_pages(NOW, missing_modules)


def missing_modules(page: Path) -> list[str]:
    groups = re.findall(r'entry-points\."(karma\.\w+)"', text_of(ROOT / "pyproject.toml"))
    folders = (ROOT / "karma", ROOT / "scripts", ROOT / "tests")
    files = {path.name for folder in folders for path in folder.rglob("*.py")}
    missing = set()
    for span in code(page):
        dotted = re.findall(r"(?<![\w/])karma(?:\.\w+)+", span)
        missing |= {n for n in dotted if n not in groups and not is_importable(n)}
        missing |= set(re.findall(r"(?<![\w/.*])\w+\.py\b", span)) - files
    return sorted(n for n in missing if not n.endswith((".tar", ".json")))


def test_every_class_that_is_named_exists():
    source = " ".join(
        text_of(path)
        for folder in ("karma", "scripts", "tests/support")
        for path in (ROOT / folder).rglob("*")
        if path.suffix in (".py", ".toml", ".txt")
    )
    words = set(re.findall(r"\w+", source)) | FOREIGN
    assert not on_pages(NOW, lambda page: sorted(named_classes(page) - words))


def named_classes(page: Path) -> set[str]:
    return {name for span in code(page) for name in re.findall(r"\b[A-Z][a-z]+[A-Z]\w+", span)}


def is_importable(name: str) -> bool:
    """Return whether a dotted name is a module, or a word in the module that it begins with."""
    parts = name.split(".")
    for length in range(len(parts), 0, -1):
        base = ROOT.joinpath(*parts[:length])
        file = base / "__init__.py" if base.is_dir() else base.with_suffix(".py")
        if file.exists():
            rest = parts[length:]
            return not rest or re.search(rf"\b{rest[0]}\b", text_of(file)) is not None
    return False


def test_front_page_has_at_most_a_hundred_lines_and_six_thousand_characters():
    text = text_of(ROOT / "README.md")
    assert len(text.splitlines()) <= 100
    assert len(text) <= 6000


def test_architecture_page_has_the_picture_and_line_counts_of_the_code():
    check = [sys.executable, "scripts/make_architecture.py", "--check"]
    done = subprocess.run(check, cwd=ROOT, check=False, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout


def test_architecture_page_lists_every_package_and_plug_in():
    page = text_of(ROOT / "docs/architecture.md")
    packages = {f"karma/{file.parent.name}/" for file in (ROOT / "karma").glob("*/__init__.py")}
    modules = {f"karma/{file.name}" for file in (ROOT / "karma").glob("*.py")} - {
        "karma/__init__.py"
    }
    table = page.partition("## Packages of the core")[2].partition("## Layers")[0]
    plugins = {f"karma/plugins/{p.parent.name}/" for p in ROOT.glob("karma/plugins/*/__init__.py")}
    assert not {name for name in packages | modules | plugins if f"`{name}`" not in table}


def test_every_plug_in_has_a_page():
    plugins = {path.parent.name for path in ROOT.glob("karma/plugins/*/__init__.py")}
    assert plugins <= {page.stem for page in ROOT.glob("docs/plugins/*.md")}


def test_reading_order_has_at_most_nine_thousand_lines():
    page = text_of(ROOT / "docs/architecture.md")
    total = page.partition("## Reading order")[2].partition("## Packages")[0]
    stops = re.findall(r"^\| (\d+|all) \| (.*?) \| .* \| (\d+) \|$", total, re.MULTILINE)
    *parts, (last, everything, lines) = stops
    assert last == "all" and int(lines) <= 9_000
    assert ", ".join(paths for _, paths, _ in parts) == everything


# ----------------------------------------------------------------- commands


def test_every_command_is_in_the_table_of_needs():
    assert not on_pages(NOW, lambda page: [" ".join(w) for w in commands(page) if not row_of(w)])


def test_every_command_can_be_given():
    assert not on_pages(NOW, lambda page: [wrong for w in commands(page) if (wrong := misuse(w))])


@cache
def command_line() -> Any:
    return typer.main.get_command(app)


def misuse(words: list[str]) -> str:
    """Return what is wrong with a command: no such target, file, subcommand or option."""
    match words:
        case ["karma", *rest]:
            return wrong_option(command_line(), rest)
        case ["make", *targets]:
            rules = re.findall(r"^([\w-]+):", text_of(ROOT / "Makefile"), re.MULTILINE)
            return " ".join(t for t in targets if "=" not in t and t not in rules)
        case ["python", script, *rest] if script != "-m":
            return unknown_script(script, rest)
        case ["pytest", *rest]:
            return unknown_tests([ROOT / w for w in rest if w.endswith(".py")], rest)
        case [script, *_] if script.startswith("scripts/"):
            return "" if (ROOT / script).exists() else f"no {script}"
    return ""


def wrong_option(command: Any, words: list[str]) -> str:
    """Return the subcommand or option that a command line has and the program has not."""
    flags = {"--help"}
    takes_value = set()
    for option in command.params:
        (flags if getattr(option, "is_flag", False) else takes_value).update(
            [*option.opts, *option.secondary_opts]
        )
    words = list(words)
    while words:
        word, _, value = words.pop(0).partition("=")
        if word in takes_value and not value:
            if not words:
                return f"{word} without a value"
            words.pop(0)
        elif word.startswith("-") and word not in flags | takes_value:
            return f"no option {word}"
        elif isinstance(command, LazyGroup) and word[:1].islower():
            below = command.command(word)
            return wrong_option(below, words) if below else f"no command {word}"
    return ""


def unknown_tests(files: list[Path], words: list[str]) -> str:
    """Return the file that is not there, or the word of -k that no test in the files has."""
    missing = [str(file) for file in files if not file.exists()]
    if missing or "-k" not in words:
        return " ".join(missing)
    wanted = words[words.index("-k") + 1]
    tests = [name for file in files for name in re.findall(r"def (test_\w+)", text_of(file))]
    return "" if any(wanted in name for name in tests) else f"no test has {wanted}"


def unknown_script(script: str, words: list[str]) -> str:
    """Return the option that neither a script nor a module that it imports speaks of."""
    if not (ROOT / script).exists():
        return f"no {script}"
    source = text_of(ROOT / script)
    for module in re.findall(r"^from (karma[\w.]*) import", source, re.MULTILINE):
        file = ROOT.joinpath(*module.split(".")).with_suffix(".py")
        source += text_of(file) if file.exists() else ""
    options = [word[2:].partition("=")[0] for word in words if word.startswith("--")]
    known = [o for o in options if re.search(rf"--{o}\b|\b{o.replace('-', '_')}\b", source)]
    return " ".join(sorted(set(options) - set(known)))


READY = [" ".join(row) for row, need in needs().items() if need == "nothing"]


@pytest.mark.parametrize("command", READY)
def test_command_that_needs_nothing_runs_as_it_stands(command, tmp_path, clean_models):
    for name in ("eval", "Makefile", "scripts"):
        (tmp_path / name).symlink_to(ROOT / name)
    here = Path(sys.executable).parent
    line = re.sub(r"^karma", str(here / "karma"), command)
    done = subprocess.run(
        line, shell=True, cwd=tmp_path, check=False, capture_output=True, text=True, timeout=300,
        env={**os.environ, "KARMA_MODELS": str(clean_models)},
    )  # fmt: skip
    assert done.returncode == 0, done.stdout + done.stderr
    assert done.stdout
