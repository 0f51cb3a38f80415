"""Open checked folders with transformers: from disk only, in silence, and only if all fits."""

import os
from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from karma.errors import KarmaError, ModelError
from karma.models.checks.folder import read_config
from karma.models.checks.memory import check_memory, weights_mb
from karma.models.manifest import Role, resolve_folder
from karma.plugins.vision.model_folder import CheckedFolder, check_folder


def checked_folder(
    model: str | Path,
    role: Role,
    families: Mapping[str, Collection[str]],
    *,
    needs: Sequence[Sequence[str]] = (),
) -> CheckedFolder:
    """Find a model by its name in the manifest or by its path, and check its folder.

    Errors as those of `resolve_folder` and `check_folder`.
    """
    place = resolve_folder(model, role)
    return check_folder(place.path, families, needs=needs, name=place.name, fix=place.fix)


def check_room(folder: CheckedFolder, device: str, *, half: bool = False) -> str:
    """Return the device of a model, "cuda" or "cpu"; `device` is "cpu", or "auto".

    ModelError, before weights are read, where it does not fit.
    """
    import torch

    chosen = "cuda" if device == "auto" and torch.cuda.is_available() else "cpu"
    count, each = folder.parameters, 2 if half else 4
    free = float(torch.cuda.mem_get_info(chosen)[0]) / 1e6 if chosen == "cuda" else None
    check_memory(
        str(folder.path), weights_mb(count, bytes_each=each), free_mb=free,
        parts=f"{count / 1e6:.1f} million parameters of {each} bytes, and room to compute",
        fix="take a smaller model (`karma models list`)",
    )  # fmt: skip
    return chosen


def load_weights(
    kind: str, folder: CheckedFolder, device: str = "auto", *, half: bool = False
) -> Any:
    """Open a model of a class of transformers on its device, ready to be asked.

    In bfloat16 if `half`, else in float32.

    Raises:
        ModelError: too little memory, or weights that are not this
            architecture's: transformers itself would fill what is missing with random numbers and
            say so in a warning only.
    """
    device = check_room(folder, device, half=half)
    import torch

    transformers = import_transformers()
    with quiet(), foreign(f"{folder.path}: not a {kind} that opens"):
        model, told = getattr(transformers, kind).from_pretrained(
            folder.path, local_files_only=True, use_safetensors=True,
            dtype=torch.bfloat16 if half else torch.float32,
            trust_remote_code=False, output_loading_info=True,
        )  # fmt: skip
    missing = sorted(map(str, told["missing_keys"]))
    if missing:
        raise ModelError(
            f"{folder.path}: not a whole {kind}: {len(missing)} weights are missing, "
            f"e.g. {missing[0]}"
        )
    return model.eval().to(device)


@contextmanager
def foreign(what: str) -> Iterator[None]:
    """Turn whatever a library makes of files from elsewhere into one ModelError.

    Errors of ours and the lack of memory stay as they are; `what` names the file, and its fault.
    """
    try:
        yield
    except (KarmaError, MemoryError):
        raise
    except BaseException as error:
        panics = type(error).__module__ == "pyo3_runtime"  # of tokenizers and safetensors, in Rust
        if not (panics or isinstance(error, Exception)):
            raise
        reason = str(error).strip().splitlines() or [type(error).__name__]
        raise ModelError(f"{what}: {reason[0][:300]}") from error


def place_of(model: Any) -> str:
    """Return where a loaded model is computed: device and numbers, "cpu, float32"."""
    dtype = str(next(model.parameters()).dtype).removeprefix("torch.")
    return f"{model.device}, {dtype}"


def import_transformers() -> Any:
    """Import transformers such that it never asks the package `kernels`, which downloads code."""
    os.environ.setdefault("USE_HUB_KERNELS", "0")
    import transformers

    return transformers


def load_image_processor(folder: CheckedFolder) -> Any:
    """Open what prepares pictures, the variant over Pillow whatever else is installed.

    ModelError where preprocessor_config.json cannot be used.
    """
    where = folder.path / "preprocessor_config.json"
    said = read_config(where, fix="bring the model's whole folder")
    kinds = [said.get(key) for key in ("image_processor_type", "feature_extractor_type")]
    if not any(isinstance(kind, str) for kind in kinds):  # else sizes would be guessed
        raise ModelError(f"{where}: cannot be used: no image_processor_type")
    with quiet(), foreign(f"{where}: cannot be used"):
        return import_transformers().AutoImageProcessor.from_pretrained(
            folder.path, local_files_only=True, trust_remote_code=False, backend="pil"
        )


def load_tokenizer(folder: CheckedFolder) -> Any:
    """Open tokenizer.json with the `tokenizers` library, which runs no code of the model's.

    ModelError where it is torn or no tokenizer.
    """
    from tokenizers import Tokenizer

    path = folder.path / "tokenizer.json"
    with foreign(f"{path}: not a tokenizer"):
        found = Tokenizer.from_file(str(path))
        found.encode("7 red apples")  # some open, and end in a panic of the library's when asked
        return found


@contextmanager
def quiet() -> Iterator[None]:
    """Show no progress bars and warnings of transformers meanwhile; leave no setting changed."""
    logging = import_transformers().utils.logging
    shown, level = logging.is_progress_bar_enabled(), logging.get_verbosity()
    logging.disable_progress_bar()
    logging.set_verbosity_error()
    try:
        yield
    finally:
        logging.set_verbosity(level)
        if shown:
            logging.enable_progress_bar()


@contextmanager
def threads(count: int | None) -> Iterator[None]:
    """Run torch on so many threads meanwhile, None: as it is set.

    On one, the same input gives the same bits anywhere.
    """
    import torch

    before = torch.get_num_threads()
    torch.set_num_threads(count or before)
    try:
        yield
    finally:
        torch.set_num_threads(before)
