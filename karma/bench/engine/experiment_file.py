"""Reading an experiment: a TOML file, what is set otherwise, and where its paths begin.

A path in a file is relative to that file, one that a command gives to the working directory. Names,
such as those of the manifest, stay names; what could be either is a path if it has a "/" in it.
"""

import os
import re
import tomllib
from collections.abc import Iterable, Mapping, Sequence
from copy import deepcopy
from dataclasses import dataclass
from difflib import get_close_matches
from pathlib import Path
from typing import Any, TypeVar, get_args

import msgspec

from karma.bench.engine.experiment import MOST_SEEDS, Experiment, is_called
from karma.errors import FileError, KarmaError, did_you_mean
from karma.files import read_toml
from karma.journal.header import Kind, each_path
from karma.loading.names import MODELS, check_models, check_row

T = TypeVar("T", bound=msgspec.Struct)
TRACE = "trace"  # `kind` of a figure of policies, see `karma.bench.policies.figure`
_SHARED = re.compile(r"(\.\./)+shared/")
_SETTING = re.compile(r'((?:"[^"]*"|[^"])*?\.\w+|\w+)=(.*)', re.DOTALL)


@dataclass(frozen=True, slots=True, kw_only=True)
class Setting:
    """One key of an experiment said otherwise: "models.planner", "rows.NAME.options.recall_k"."""

    key: str  # "rows.*.options.recall_k" is of all rows
    value: Any  # as TOML has it
    folder: Path = Path()  # that a path in it is relative to


@dataclass(frozen=True, slots=True, kw_only=True)
class Changes:
    """How an experiment differs from what its file says."""

    settings: tuple[Setting, ...] = ()
    rows: tuple[str, ...] = ()  # names of those that are done, "*" is any text; () = all


# ----------------------------------------------------------------- what a command sets


def setting_of(text: str) -> Setting:
    """Return what `--set KEY=VALUE` says; a value that TOML cannot read is text.

    >>> setting_of("models.examples=5").value, setting_of("models.planner=nano").value
    (5, 'nano')

    Raises:
        KarmaError: there is no "=" in it.
    """
    found = _SETTING.match(text)  # a row's name may have "=" in it
    key, equals, value = (found[1], "=", found[2]) if found else text.partition("=")
    if not equals or not key.strip():
        raise KarmaError(
            f"--set {text}: it is KEY=VALUE\n  To fix: --set models.planner=karma-nano"
        )
    return Setting(key=key.strip(), value=_plain_value(value.strip()))


def _plain_value(text: str) -> Any:
    try:
        return tomllib.loads(f"value = {text}")["value"]
    except (ValueError, RecursionError):  # no TOML, or a number without end
        return text


def seeds_of(text: str) -> list[int]:
    """Return the seeds that a command lists.

    >>> seeds_of("0-2,7")
    [0, 1, 2, 7]

    Raises:
        KarmaError: it is no such list.
    """
    found: list[int] = []
    for part in text.split(","):
        ends = re.fullmatch(r"\s*(\d{1,6})(?:\s*-\s*(\d{1,6}))?\s*", part)
        if ends is None:
            raise KarmaError(f"--seeds {text}: no list of seeds\n  To fix: --seeds 0-4, or 0,2,5")
        found += range(int(ends[1]), int(ends[2] or ends[1]) + 1)
        if len(found) > MOST_SEEDS:
            raise KarmaError(f"--seeds {text[:80]}: too many; {MOST_SEEDS} at most")
    return found


# ----------------------------------------------------------------- reading


def read_experiment(path: Path, changes: Changes | None = None) -> Experiment:
    """Read an experiment; paths in it come back whole.

    Raises:
        FileError: it is damaged, a key or a name in it is unknown, or something stands twice.
        KarmaError: a change is of no key there is, or of the wrong type.
    """
    experiment = read_as(path, Experiment, changes)
    named = {key: getattr(experiment.models, key) for key in MODELS}
    try:
        check_models(named, "models.")
        for row in experiment.rows:
            placed = {"vision": row.vision, "recall": row.recall}
            check_row(row.name, row.method, row.all_options, placed)
        check_models({"world": experiment.world})
    except KarmaError as error:
        raise FileError(path, str(error)) from error
    return experiment


def read_as(path: Path, kind: type[T], changes: Changes | None = None) -> T:
    """Read an experiment of any form, with changes.

    Raises:
        FileError: it is damaged, or a key in it is unknown.
        KarmaError: a change is of no key there is, or of the wrong type.
    """
    fix = None if path.is_file() else "karma eval demo"
    tree = _whole(read_toml(path, dict[str, Any], fix=fix), path.parent)
    plain = _converted(path, tree, kind)
    if changes is None:
        return plain
    for setting in changes.settings:
        parts = _parts(setting.key, [row["name"] for row in tree.get("rows", ())])
        value = _whole(_typed(kind, parts, setting), setting.folder, _general(parts))
        _put(tree, parts, value)
    if changes.rows:
        tree["rows"] = _chosen(tree.get("rows", ()), changes.rows)
    said = ", ".join(f"{one.key} = {one.value!r}" for one in changes.settings)
    return _converted(path, tree, kind, f" (with {said})" if said else "")


class _Told(msgspec.Struct, frozen=True):
    """What tells experiments of all forms apart."""

    benchmark: str = ""
    kind: str = ""


def kind_of(path: Path, changes: Changes | None = None) -> Kind:
    """Return what kind of run an experiment makes.

    Raises:
        FileError: it cannot be read; of one with our own tasks, also as `read_experiment`.
        KarmaError: see `read_as`.
    """
    said = read_toml(path, _Told, fix=None if path.is_file() else "karma eval demo")
    if said.benchmark:
        return "benchmark"
    if said.kind == TRACE:
        return "figure"
    return "run"


def _converted(path: Path, tree: Mapping[str, Any], kind: type[T], said: str = "") -> T:
    try:
        return msgspec.convert(tree, kind)
    except (msgspec.ValidationError, ValueError) as error:
        raise FileError(path, f"{error}{said}", fix=_meant(str(error), kind)) from error


def _meant(reason: str, kind: type[msgspec.Struct]) -> str | None:
    """Return what helps where a key is unknown: the nearest known one, or all that are known."""
    found = re.search(r"unknown field `(.+?)`(?: - at `\$\.?([^`]*)`)?", reason)
    if found is None:
        return None
    known = _keys_of(kind)
    for part in filter(None, re.sub(r"\[[^]]*\]", "", found[2] or "").split(".")):
        known = known and _keys_of(known[part])
    return None if known is None else _nearest(found[1], known)


def _nearest(key: str, known: Iterable[str]) -> str:
    near = get_close_matches(key, known, n=1)
    return f"write {near[0]!r}" if near else f"known here: {', '.join(known)}"


# ----------------------------------------------------------------- one key


def _parts(key: str, rows: Sequence[str]) -> tuple[str, ...]:
    """Return a dotted key in parts; that of a row has the row's name, dots and all, or "*".

    >>> _parts("rows.K = 1.5.options.recall_k", ["K = 1.5"])
    ('rows', 'K = 1.5', 'options', 'recall_k')

    Raises:
        KarmaError: there is no such row.
    """
    if not key.startswith("rows."):
        return tuple(key.split("."))
    rest = key.removeprefix("rows.")
    for name in sorted(("*", *rows), key=len, reverse=True):
        for said in (name, f'"{name}"'):
            if rest.startswith(f"{said}."):
                return "rows", name, *rest[len(said) + 1 :].split(".")
    raise KarmaError(f"{key}: no such row{_rows_meant(rest.partition('.')[0], rows)}")


def _rows_meant(name: str, rows: Sequence[str]) -> str:
    return f".{did_you_mean(name, rows)} There are {', '.join(map(repr, rows))}"


def _general(parts: Sequence[str]) -> str:
    """Return a key as `karma.journal.header` has it: without the row's name."""
    return ".".join((parts[0], *parts[2:]) if parts[0] == "rows" else parts)


def _typed(kind: type[msgspec.Struct], parts: Sequence[str], setting: Setting) -> Any:
    """Return a value as its key takes it; a word may look like a number.

    Raises:
        KarmaError: there is no such key, or it takes no such value.
    """
    takes: Any = kind
    for part in _general(parts).split("."):
        known = _keys_of(takes)
        if known is None:  # a free table, such as a row's options, which its method reads
            return setting.value
        if part not in known:
            fix = _nearest(part, known)
            raise KarmaError(f"{setting.key}: no key {part!r}\n  To fix: {fix}")
        takes = known[part]
    reasons: list[str] = []
    for value in (setting.value, str(setting.value)):
        try:
            msgspec.convert(value, takes)
        except msgspec.ValidationError as error:
            reasons.append(str(error))
        else:
            return value
        if not isinstance(setting.value, int | float) or isinstance(setting.value, bool):
            break
    raise KarmaError(f"{setting.key} = {setting.value!r}: {reasons[0]}")


def _keys_of(kind: Any) -> dict[str, Any] | None:
    """Return what a table, or one of a tuple or an option, may have: keys with types; None: any."""
    if isinstance(kind, type) and issubclass(kind, msgspec.Struct):
        return {one.encode_name: one.type for one in msgspec.structs.fields(kind)}
    return next(filter(None, map(_keys_of, get_args(kind))), None)


def _put(tree: dict[str, Any], parts: Sequence[str], value: Any) -> None:
    """Set a key, of all rows that it is meant for."""
    if parts[0] == "rows" and len(parts) > 1:
        for row in tree["rows"]:
            if parts[1] in ("*", row["name"]):
                _put(row, parts[2:], deepcopy(value))
        return
    for part in parts[:-1]:
        below = tree.setdefault(part, {})
        if not isinstance(below, dict):
            raise KarmaError(f"{'.'.join(parts)}: {part} is no table")
        tree = below
    tree[parts[-1]] = value


def _chosen(rows: Sequence[dict[str, Any]], names: Sequence[str]) -> list[dict[str, Any]]:
    """Return the rows of some names, in their order; KarmaError where no row has such a name."""
    known = [row["name"] for row in rows]
    for name in names:
        if not any(is_called(one, name) for one in known):
            raise KarmaError(f"no row {name!r}{_rows_meant(name, known)}")
    return [row for row in rows if any(is_called(row["name"], name) for name in names)]


# ----------------------------------------------------------------- paths


def beside(folder: Path, path: str) -> Path:
    """Return a path that a file in a folder names; $KARMA_SHARED stands for "../shared"."""
    shared, inside = os.environ.get("KARMA_SHARED"), _SHARED.match(path)
    if shared and inside:
        return Path(shared) / path[inside.end() :]
    return Path(os.path.normpath((folder / Path(path).expanduser()).absolute()))  # links stay


def _whole(tree: Any, folder: Path, key: str = "") -> Any:
    """Return a tree with its paths made whole."""
    return each_path(tree, key, lambda path: str(beside(folder, path)))
