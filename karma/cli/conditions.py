"""Examine what a run without a network needs on this machine; nothing is started."""

import os
from collections.abc import Iterator, Mapping
from importlib.metadata import PackageNotFoundError, entry_points, requires, version

from packaging.requirements import Requirement

from karma.errors import KarmaError
from karma.files import cache
from karma.models.manifest import check, find_model, read_manifest
from karma.offline.guard import DEFAULTS, OFFLINE, SWITCHES, is_armed, network_allowed
from karma.world.thor.builds import CheckResult

NEEDED = ("karma-nano", "minilm")  # what `karma run` can do with, where karma-mini is not here
_OURS, _GROUP = "karma-offline", "karma."  # our package, and how the groups of roles begin
_BY_ITSELF = "karma's commands do so themselves"


def examine(environment: Mapping[str, str] = os.environ) -> list[CheckResult]:
    """Return every condition of a run without a network; "note" is what a run can do without."""
    return [
        *_guard(environment),
        *_switches(environment),
        *_packages(),
        _plugins(),
        *_models(),
        _cache(),
    ]


def _guard(environment: Mapping[str, str]) -> Iterator[CheckResult]:
    armed, leave = is_armed(), network_allowed()
    found = "off" if not armed else "armed, with leave" if leave else "armed"
    fix = "leave --allow-network out; programs: go_offline()"
    yield CheckResult.of("guard", armed and not leave, found, fix)
    inherited = environment.get(OFFLINE) == "1"
    found = "1: what is started from here gets no leave either" if inherited else "not set"
    yield CheckResult.of(OFFLINE, inherited, found, f"export {OFFLINE}=1; {_BY_ITSELF}")


def _switches(environment: Mapping[str, str]) -> Iterator[CheckResult]:
    for name, wanted in {**SWITCHES, **DEFAULTS}.items():
        found = environment.get(name)
        good = found == wanted or (name in DEFAULTS and found is not None)
        fix = f"export {name}={wanted}; {_BY_ITSELF}"
        yield CheckResult.of(name, good, "not set" if found is None else found, fix)


def _packages() -> Iterator[CheckResult]:
    """Yield whether what the package says it needs is installed."""
    missing, count = [], 0
    for text in requires(_OURS) or ():
        need = Requirement(text)
        if need.marker is not None and not need.marker.evaluate({"extra": ""}):
            continue
        count += 1
        try:
            if not need.specifier.contains(version(need.name), prereleases=True):
                missing.append(f"{need} (here: {version(need.name)})")
        except PackageNotFoundError:
            missing.append(str(need))
    found = f"missing: {', '.join(missing)}" if missing else f"all {count} are installed"
    yield CheckResult.of(
        "packages", not missing, found, "karma bundle install BUNDLE --into FOLDER"
    )


def _plugins() -> CheckResult:
    """Return which packages registered something of their own for our roles: their code runs."""
    foreign = sorted(
        f"{one.dist.name}: {one.group}/{one.name}"
        for group in sorted(entry_points().groups)
        if group.startswith(_GROUP)
        for one in entry_points(group=group)
        if one.dist is not None and one.dist.name != _OURS
    )
    fix = "they run inside of every run that names them; uninstall what you do not trust"
    found = "; ".join(dict.fromkeys(foreign)) or "none"
    return CheckResult.of("plug-ins of others", not foreign, found, fix, else_="note")


def _models() -> Iterator[CheckResult]:
    """Yield each model's condition; what the default run needs must be right."""
    try:
        entries = read_manifest().models
        for name in NEEDED:
            find_model(name)
    except KarmaError as error:
        yield CheckResult.of("models", False, str(error), "see the message")
        return
    absent = []
    for entry in entries:
        found = check(entry)
        if found.state == "absent" and entry.name not in NEEDED:
            absent.append(entry.name)
            continue
        good = found.state == "ok"
        said = found.detail if good else found.state
        yield CheckResult.of(f"model {entry.name}", good, said, found.detail)
    if absent:
        yield CheckResult.of(
            "models that may be brought", False, f"not here: {', '.join(absent)}",
            "`karma models show NAME` says where one is from; only runs that name it need it",
            else_="note",
        )  # fmt: skip


def _cache() -> CheckResult:
    """Return whether the cache folder can be written."""
    folder = cache()
    near = next(path for path in (folder, *folder.parents) if path.exists())
    writable = os.access(near, os.W_OK)
    found = f"{folder}, {'writable' if writable else 'not writable'}"
    fix = "export KARMA_CACHE=/a/folder/of/yours"
    return CheckResult.of("cache folder", writable, found, fix, else_="note")
