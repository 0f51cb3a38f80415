"""Check a folder of safetensors and JSON before transformers sees it."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from karma.errors import ModelError
from karma.models.checks.folder import check_weights, read_config


@dataclass(frozen=True, slots=True, kw_only=True)
class CheckedFolder:
    """A folder that an adapter can open."""

    name: str
    path: Path
    model_type: str
    config: Mapping[str, Any]
    sizes: Mapping[str, int] = field(repr=False)  # parameters by the name of their tensor

    @property
    def parameters(self) -> int:
        """How many numbers there are."""
        return sum(self.sizes.values())


def check_folder(
    folder: Path,
    families: Mapping[str, Collection[str]],
    *,
    needs: Sequence[Sequence[str]],
    fix: str,
    name: str | None = None,
) -> CheckedFolder:
    """Check a model folder: architecture first, then processor files, then headers of the weights.

    `families`: `model_type` -> architectures that will do, as config.json has it; () = any. Of
    every group in `needs` at least one file must be there; `fix` says what to do about a missing
    one.

    Raises:
        ModelError: not a folder, the wrong architecture, a file missing, or a header damaged.
    """
    if not folder.is_dir():
        raise ModelError(f"{folder}: no such folder\n  To fix: {fix}")
    place = folder / "config.json"
    config = read_config(place, fix=fix)
    kind = str(config.get("model_type"))
    if kind not in families:
        wanted = ", ".join(sorted(families))
        raise ModelError(f"{place}: model_type is {kind!r}, this adapter opens {wanted}")
    named, known = config.get("architectures") or (), families[kind]
    if not isinstance(named, list | tuple) or not all(isinstance(one, str) for one in named):
        raise ModelError(f"{place}: architectures is {named!r}, not a list")
    if named and known and not set(named) & set(known):
        wanted = ", ".join(sorted(known))
        raise ModelError(f"{place}: architecture {', '.join(named)}, this adapter opens {wanted}")
    for group in needs:
        if not any((folder / name).is_file() for name in group):
            raise ModelError(f"{folder}: no {' nor '.join(group)}\n  To fix: {fix}")
    return CheckedFolder(
        name=name or folder.name, path=folder, model_type=kind, config=config,
        sizes=check_weights(folder, fix=fix),
    )  # fmt: skip
