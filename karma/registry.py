"""Name -> implementation, by entry point: lazy, and loud about unknown names."""

import sys
import traceback
from collections.abc import Mapping, Sequence
from functools import lru_cache
from importlib.metadata import EntryPoint, entry_points
from itertools import pairwise
from pathlib import Path
from types import MappingProxyType
from typing import Any

from karma.errors import UnknownNameError, did_you_mean
from karma.files import repair

_REQUIRED: Mapping[str, Sequence[str]] = MappingProxyType(  # methods of a role's Protocol
    {
        "policies": ("touch", "discard", "__contains__", "__len__", "__iter__"),
        "recalls": ("recall",),
        "methods": ("build", "begin"),
        "worlds": ("reset", "step", "stop"),
    }
)
_PLUGINS = ("karma", "plugins")  # the folder of our own
# the names that our own plug-ins register, by role: without its plug-in a name is still explained
_PLUGIN_NAMES: Mapping[str, Mapping[str, Sequence[str]]] = MappingProxyType(
    {
        "benchmarks": {"alfred": ("eb_alfred", "lota_alfred"), "homes": ("lived",)},
        "commands": {
            "airgap": ("bundle",),
            "alfred": ("world replay", "world import-trials"),
            "homes": ("home",),
            "rules": ("read",),
            "thor_tools": ("world import", "world replay-events"),
            "training": ("models tune", "vlm"),
        },
        "assistants": {"rules": ("rules",)},
        "clusters": {"cluster": ("ray",)},
        "cassettes": {"hosted": ("file",)},
        "homes": {"homes": ("kept", "seconds-away")},
        "embedders": {"hosted": ("openai",), "vision": ("clip", "sentence")},
        "language_models": {"hosted": ("openai",)},
        "methods": {
            "baselines": ("capeam", "helper", "lota.generate", "lota.score"),
            "rules": ("rules",),
        },
        "parsers": {"rules": ("spacy",)},
        "phrase_readers": {"rules": ("rules",)},
        "recalls": {"rules": ("stateful",), "vision": ("multimodal",)},
        "task_pools": {"alfred": ("alfred",)},
        "task_sources": {"alfred": ("alfred", "authors")},
        "planners": {"hosted": ("openai",)},
        "perceptions": {"vision": ("pictures",)},
        "vision_models": {"hosted": ("openai",), "vision": ("nano-vlm", "transformers")},
    }
)


def names(role: str) -> list[str]:
    """Return the registered names of a role ("policies", "worlds", ...), sorted."""
    return sorted(ep.name for ep in _installed().select(group=f"karma.{role}"))


def load(role: str, name: str) -> Any:
    """Return the object registered as `name` under `role`.

    Raises:
        UnknownNameError: nothing has that name; the message suggests the nearest one. Or what is
            installed under it is no longer there.
    """
    found = {ep.name: ep for ep in _installed().select(group=f"karma.{role}")}
    if name not in found:
        if extra := extra_of(role, name):
            raise UnknownNameError(f"{name!r} needs a plug-in. {fix_of(extra)}")
        hint = did_you_mean(name, found)
        raise UnknownNameError(f"no {role} named {name!r}.{hint} Installed: {sorted(found)}")
    try:
        made = found[name].load()
    except (AttributeError, ModuleNotFoundError) as error:
        said = f"{_where(role, found[name])}: {error}"
        extra = _extra_without(error, found[name].module)
        raise UnknownNameError(
            f"{said}\n  {fix_of(extra) if extra else f'To fix: {repair()}'}"
        ) from error
    except (Exception, SystemExit) as error:  # a package's module may do anything when imported
        said = f"{_where(role, found[name])}: importing it raised {type(error).__name__}: {error}"
        raise UnknownNameError(f"{said}\n  To fix: mend or uninstall that package") from error
    if missing := _missing(role, made):
        raise UnknownNameError(
            f"{_where(role, found[name])}: {missing}\n"
            "  To fix: docs/plugins/README.md has one of each kind that works"
        )
    return made


def extra_of(role: str, name: str) -> str:
    """Return which of our plug-ins registers a name, "" if none does."""
    plugins = _PLUGIN_NAMES.get(role, {})
    return next((one for one, registered in plugins.items() if name in registered), "")


def fix_of(extra: str) -> str:
    """Return the sentence that says how to install a plug-in of ours."""
    return f"To fix: pip install 'karma-offline[{extra}]'"


def missing_package(error: BaseException) -> str:
    """Return what is said of a package that a plug-in of ours lacks; "" of any other error."""
    for frame in reversed(traceback.extract_tb(error.__traceback__)):
        parts = Path(frame.filename).parts
        if _PLUGINS in pairwise(parts):
            plugin = parts[len(parts) - parts[::-1].index("plugins")]
            if extra := _extra_without(error, f"karma.plugins.{plugin}"):
                return f"{error}\n  {fix_of(extra)}"
    return ""


def _extra_without(error: BaseException, module: str) -> str:
    """Return the extra of our plug-in in which a foreign package was not found, else ""."""
    foreign = isinstance(error, ModuleNotFoundError) and (error.name or "").split(".")[0] != "karma"
    parts = module.split(".")
    return parts[2] if foreign and tuple(parts[:2]) == _PLUGINS else ""


def plug_in_of(error: BaseException) -> str:
    """Return which plug-in an error came out of, in words; "" where it was none.

    A plug-in is what another package has registered under a role of ours.
    """
    files = {frame.filename for frame in traceback.extract_tb(error.__traceback__)}
    for role in sorted(one for one in _installed().groups if one.startswith("karma.")):
        for entry in _installed().select(group=role):
            module = sys.modules.get(entry.module)
            ours = entry.module.partition(".")[0] == __name__.partition(".")[0]
            if not ours and getattr(module, "__file__", None) in files:
                return _where(role.removeprefix("karma."), entry)
    return ""


def _installed() -> Any:
    """Return all that is registered, read again where what lies on the path has changed."""
    return _read(tuple((place, _changed_ns(place)) for place in sys.path))


@lru_cache(maxsize=1)
def _read(path: tuple[tuple[str, int], ...]) -> Any:
    return entry_points()


def _changed_ns(place: str) -> int:
    try:
        return Path(place).stat().st_mtime_ns
    except OSError:
        return 0


def _where(role: str, entry: EntryPoint) -> str:
    package = f" of the package {entry.dist.name}" if entry.dist else ""
    return f"{role} {entry.name!r} is installed as {entry.value}{package}"


def _missing(role: str, made: Any) -> str:
    """Return what an implementation lacks of its role's Protocol, or "" if it is complete."""
    if not callable(made) and role != "commands":
        return f"it is no class or function but {type(made).__name__}"
    required = _REQUIRED.get(role, ()) if isinstance(made, type) else ()
    lacking = [name for name in required if not callable(getattr(made, name, None))]
    return f"it has no method {', '.join(lacking)}" if lacking else ""
