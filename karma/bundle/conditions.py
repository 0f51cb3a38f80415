"""What a run without a network needs on this machine, looked at one by one; nothing is started."""

import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Literal

from packaging.requirements import Requirement

from karma.bundle.wheels import cache_folder, kept_wheels
from karma.errors import KarmaError
from karma.infer.manifest.manifest import check, find_model, read_manifest
from karma.offline import DEFAULTS, LOG, OFFLINE, SWITCHES, is_armed, network_allowed

NEEDED = ("karma-nano", "minilm")  # what `karma run` takes when nothing else is asked for
_PROXIES = ("HTTP_PROXY", "HTTPS_PROXY", "ALL_PROXY", "http_proxy", "https_proxy", "all_proxy")
_KEYS = ("HF_TOKEN", "HUGGING_FACE_HUB_TOKEN", "OPENAI_API_KEY", "ANTHROPIC_API_KEY")

Status = Literal["ok", "note", "problem"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Finding:
    """One condition: whether it holds, what was found, and what mends it."""

    name: str
    status: Status
    found: str
    fix: str = ""


def examine(environment: Mapping[str, str] = os.environ) -> list[Finding]:
    """Return every condition of a run without a network; "note" is what a run can do without."""
    return [
        *_guard(environment),
        *_switches(environment),
        *_surroundings(environment),
        *_packages(),
        *_models(),
        *_folders(environment),
    ]


def holds(findings: list[Finding]) -> bool:
    """Return whether nothing is missing that a run needs."""
    return all(one.status != "problem" for one in findings)


def _guard(environment: Mapping[str, str]) -> Iterator[Finding]:
    armed, leave = is_armed(), network_allowed()
    yield Finding(
        name="guard",
        status="ok" if armed and not leave else "problem",
        found="off" if not armed else "armed, with leave" if leave else "armed",
        fix="" if armed and not leave else "leave --allow-network out; programs: go_offline()",
    )
    inherited = environment.get(OFFLINE) == "1"
    yield Finding(
        name=OFFLINE,
        status="ok" if inherited else "problem",
        found="1: what is started from here gets no leave either" if inherited else "not set",
        fix="" if inherited else f"export {OFFLINE}=1; karma's commands do so themselves",
    )
    if environment.get(LOG):
        yield Finding(name=LOG, status="ok", found=environment[LOG])


def _switches(environment: Mapping[str, str]) -> Iterator[Finding]:
    for name, wanted in {**SWITCHES, **DEFAULTS}.items():
        found = environment.get(name)
        good = found == wanted or (name in DEFAULTS and found is not None)
        yield Finding(
            name=name,
            status="ok" if good else "problem",
            found="not set" if found is None else found,
            fix="" if good else f"export {name}={wanted}; karma's commands do so themselves",
        )


def _surroundings(environment: Mapping[str, str]) -> Iterator[Finding]:
    """Yield what no run needs, and what is better not there."""
    if proxies := [name for name in _PROXIES if environment.get(name)]:
        fix = f"unset {' '.join(proxies)}"
        found = f"{', '.join(proxies)} set; calls to a server on this machine would go there"
        yield Finding(name="proxy", status="note", found=found, fix=fix)
    else:
        yield Finding(name="proxy", status="ok", found="none")
    keys = [name for name in _KEYS if environment.get(name)]
    yield Finding(
        name="keys of services",
        status="note" if keys else "ok",
        found=", ".join(keys) if keys else "none",
        fix=f"unset {' '.join(keys)}; nothing here uses them offline" if keys else "",
    )
    yield Finding(name="name server", status="ok", found="not asked, and not needed")
    up = _interfaces()
    yield Finding(
        name="interfaces",
        status="note" if up else "ok",
        found=", ".join(up) if up else "none but loopback",
        fix="`unshare -rn karma ...` runs without them; the guard holds either way" if up else "",
    )


def _interfaces() -> list[str]:
    import socket

    try:
        return sorted(name for _, name in socket.if_nameindex() if name != "lo")
    except OSError:
        return []


def _packages() -> Iterator[Finding]:
    """Yield whether what the package says it needs is installed."""
    from importlib.metadata import requires

    missing, count = [], 0
    for text in requires("karma-offline") or ():
        need = Requirement(text)
        if need.marker is not None and not need.marker.evaluate({"extra": ""}):
            continue
        count += 1
        try:
            if not need.specifier.contains(version(need.name), prereleases=True):
                missing.append(f"{need} (here: {version(need.name)})")
        except PackageNotFoundError:
            missing.append(str(need))
    yield Finding(
        name="packages",
        status="problem" if missing else "ok",
        found=f"missing: {', '.join(missing)}" if missing else f"all {count} are installed",
        fix="karma bundle install BUNDLE --into FOLDER" if missing else "",
    )


def _models() -> Iterator[Finding]:
    """Yield each model's condition; what the default run needs must be right."""
    try:
        entries = read_manifest().models
        for name in NEEDED:
            find_model(name)
    except KarmaError as error:
        yield Finding(name="models", status="problem", found=str(error), fix="see the message")
        return
    absent = []
    for entry in entries:
        found = check(entry)
        if found.state == "absent" and entry.name not in NEEDED:
            absent.append(entry.name)
            continue
        good = found.state == "ok"
        yield Finding(
            name=f"model {entry.name}",
            status="ok" if good else "problem",
            found=found.detail if good else found.state,
            fix="" if good else found.detail,
        )
    if absent:
        yield Finding(
            name="models that may be brought",
            status="note",
            found=f"not here: {', '.join(absent)}",
            fix="`karma models show NAME` says where one is from; only runs that name it need it",
        )


def _folders(environment: Mapping[str, str]) -> Iterator[Finding]:
    """Yield folders that a run does without, but somebody may look for."""
    kept = sorted(path.name for path in kept_wheels().glob("*.whl"))
    yield Finding(
        name="wheel cache",
        status="ok",
        found=f"{kept_wheels()}: {', '.join(kept) or 'empty'}; for set-up and bundles only",
    )
    hub = Path(environment.get("HF_HOME") or Path.home() / ".cache" / "huggingface")
    there = hub.is_dir() and any(hub.iterdir())
    yield Finding(
        name="hub cache",
        status="ok",
        found=f"{hub}: {'there, never read' if there else 'none, and none is needed'}",
    )
    shared = environment.get("KARMA_SHARED")
    lost = shared is not None and not Path(shared).is_dir()
    yield Finding(
        name="KARMA_SHARED",
        status="note" if lost else "ok",
        found=f"{shared}: no such folder" if lost else shared or "not set; optional",
        fix="unset KARMA_SHARED, or bring the reference data" if lost else "",
    )
    folder = cache_folder()
    near = next(path for path in (folder, *folder.parents) if path.exists())
    writable = os.access(near, os.W_OK)
    yield Finding(
        name="cache folder",
        status="ok" if writable else "note",
        found=f"{folder}, {'writable' if writable else 'not writable'}",
        fix="" if writable else "export KARMA_CACHE=/a/folder/of/yours",
    )
