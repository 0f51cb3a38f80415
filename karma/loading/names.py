"""Check every name that a run is told, before a model loads: the nearest known one is suggested."""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from inspect import signature
from pathlib import Path
from typing import Any

from karma import registry
from karma.agent.options import settings_of
from karma.agent.planning.prompt import check_mode
from karma.errors import KarmaError, ModelError, UnknownNameError, did_you_mean
from karma.models.manifest import ModelEntry, Role, find_model, is_gguf_path, read_manifest

MODELS = ("planner", "profile", "recall", "embedder", "vision")  # of [models]
_HOSTED = "openai"
_PLURALS = {
    "recall": "recalls",
    "embedder": "embedders",
    "vision": "vision_models",
    "world": "worlds",
}
_ROLES: Mapping[tuple[str, str], tuple[Role, ...]] = {  # of the model after "KIND:", where ours say
    ("embedders", "sentence"): ("text-embedder",),
    ("embedders", "clip"): ("image-embedder",),
    ("vision_models", "transformers"): ("vlm",),
}
_OPENERS: Mapping[tuple[str, str, str], str] = {  # what opens a model of that role and format
    ("embedders", "text-embedder", "safetensors"): "sentence",
    ("embedders", "image-embedder", "safetensors"): "clip",
    ("vision_models", "vlm", "safetensors"): "transformers",
    ("vision_models", "vlm", "gguf"): "llama",
}


def opened_as(role: str, entry: ModelEntry, place: str = "") -> str:
    """Return how a role names a model, "transformers:mysmol", or by its folder; "" if it cannot."""
    kind = _OPENERS.get((role, entry.role, entry.format))
    return f"{kind}:{place or entry.name}" if kind else ""


def whole_name(key: str, name: str) -> str:
    """Return the name of what fills a role with what opens it, where only the model was named."""
    role = _PLURALS[key]
    if not name or ":" in name or "/" in name or name in registry.names(role):
        return name
    entry = next((one for one in read_manifest().models if one.name == name), None)
    return (entry and opened_as(role, entry)) or name


def check_models(named: Mapping[str, str], prefix: str = "") -> None:
    """Check that the names of models stand for something; KarmaError says under which key.

    `named`: key of [models] -> its value, "" for none; `prefix` stands before the key in messages.
    """
    for key, name in named.items():
        with _at(f"{prefix}{key}"):
            if not name or name == _HOSTED:
                continue
            if key == "planner":
                if not is_gguf_path(name):
                    _check_role(name, ("planner",))
            elif key == "profile":
                check_mode(name)
            elif key == "recall":
                _check_recall(name)
            else:
                _check_filled(_PLURALS[key], name)


def check_row(name: str, method: str, options: Mapping[str, Any], named: Mapping[str, str]) -> None:
    """Check a row's method, its options down to the policy, and what it puts in the run's place."""
    with _at(f"row {name!r}"):
        check_options(method, options)
        check_models(named)


def check_options(method: str, options: Mapping[str, Any]) -> None:
    """Check the options of a method that says which it takes (`settings_kind`)."""
    kind = getattr(registry.load("methods", method), "settings_kind", None)
    if kind is not None:
        settings_of(kind, options)


def _check_recall(name: str) -> None:
    from karma.memory.recall import VERBALISERS

    kind, colon, text = name.partition(":")
    _check_filled("recalls", kind)
    if colon and text not in VERBALISERS:
        raise UnknownNameError(f"{name!r}: units are put in words as {' or '.join(VERBALISERS)}")


def _check_filled(role: str, name: str) -> None:
    kind, _, model = name.partition(":")
    known = kind in registry.names(role) or registry.extra_of(role, kind)
    if not known and not model:
        _check_listed(role, kind)
    made = registry.load(role, kind)
    if model and not _takes_model(made):
        raise UnknownNameError(f"{name!r}: {kind} takes no model\n  To fix: {kind!r}")
    for part in filter(None, model.split("+")):
        if (role, kind) in _ROLES and "/" not in part and not Path(part).is_dir():
            _check_role(part, _ROLES[role, kind])


def _takes_model(made: Any) -> bool:
    """Return whether an implementation is made of a model's name."""
    try:
        with suppress(ValueError):  # what is written in C need not say
            signature(made).bind("")
    except TypeError:
        return False
    return True


def _check_listed(role: str, name: str) -> None:
    """Say of what is no implementation that it is a model, but for another role; or nearly one."""
    roles = sorted({model for one, model, _ in _OPENERS if one == role})
    models = read_manifest().models
    if any(entry.name == name for entry in models):
        _check_role(name, roles)
    if Path(name).is_dir():
        kinds = sorted({kind for (one, *_), kind in _OPENERS.items() if one == role})
        ways = " or ".join(repr(f"{kind}:{name}") for kind in kinds)
        raise UnknownNameError(
            f"{name!r} is a folder, and what opens it stands before it\n  To fix: {ways}"
        )
    near = did_you_mean(name, [*registry.names(role), *(e.name for e in models if e.role in roles)])
    if near:
        model = ", nor such a model" if roles else ""
        raise UnknownNameError(f"no {role} named {name!r}{model}.{near}")


def _check_role(name: str, roles: Sequence[str]) -> None:
    entry = find_model(name)
    if entry.role not in roles:
        wanted = " or ".join(roles)
        raise ModelError(f"model {name!r} is not for role {wanted} but for {entry.role!r}")


@contextmanager
def _at(where: str) -> Iterator[None]:
    """Say where a name stood, in what is raised about it."""
    try:
        yield
    except KarmaError as error:
        kinds = (UnknownNameError, ModelError, KarmaError)
        kind = next(one for one in kinds if isinstance(error, one))
        raise kind(f"{where}: {error}") from error
