"""GGUF files as llama.cpp has them: tokenizers, headers, new files, merged adapters.

llama.cpp loads a file with a wrong tokenizer name or unpermuted attention rows without a word and
then computes something else, so this is checked by comparing tokens and logits
(`tests/models/test_gguf_files.py`).

A LoRA adapter is merged into the GGUF that it was trained on, the same bytes everywhere: each
product B A is summed rank by rank in float32, so no library's order of additions is in it; the
matrices that change become Q8_0, all else stays as it is, to the byte.
"""

import json
import tempfile
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from karma.errors import FileError, ModelError
from karma.files import read_bytes, write_atomic
from karma.models.checks.gguf import TEMPLATE
from karma.models.manifest import ModelEntry, check_file, file_paths, find_model, verify

# The expression llama.cpp uses for tokenizer.ggml.pre = "llama-bpe"; letter case is spelled out
# because "(?i:...)" would also admit letters that fold to these.
LLAMA_BPE_REGEX = (
    r"(?:'[sS]|'[tT]|'[rR][eE]|'[vV][eE]|'[mM]|'[lL][lL]|'[dD])"
    r"|[^\r\n\p{L}\p{N}]?\p{L}+|\p{N}{1,3}| ?[^\s\p{L}\p{N}]+[\r\n]*|\s*[\r\n]+|\s+(?!\S)|\s+"
)

SPLITS = {
    "llama-bpe": LLAMA_BPE_REGEX,
    "qwen2": LLAMA_BPE_REGEX.replace("{1,3}", ""),  # each digit for itself
    "smollm": "",  # digits for themselves, then as GPT-2 does
}


def new_tokenizer(corpus: Iterable[str], vocab_size: int, special_tokens: Sequence[str]) -> Any:
    """Train a byte-level BPE `tokenizers.Tokenizer` that llama.cpp reproduces token for token.

    At most `vocab_size` tokens, special ones included, which get the first ids in their order; 256
    are single bytes, so every text can be encoded.
    """
    from tokenizers import pre_tokenizers, trainers

    tokenizer = bare_tokenizer()
    trainer = trainers.BpeTrainer(
        vocab_size=vocab_size, special_tokens=list(special_tokens), show_progress=False,
        initial_alphabet=sorted(pre_tokenizers.ByteLevel.alphabet()),
    )  # fmt: skip
    tokenizer.train_from_iterator(corpus, trainer)
    tokenizer.model.ignore_merges = True  # as llama.cpp does for "llama-bpe"
    return tokenizer


def bare_tokenizer(
    vocabulary: Mapping[str, int] | None = None,
    merges: Sequence[tuple[str, str]] = (),
    pre: str = "llama-bpe",
) -> Any:
    """Return a `tokenizers.Tokenizer` of these pieces that splits and joins as llama.cpp does.

    ModelError where `pre`, llama.cpp's name for how a text is split, is none of `SPLITS`.
    """
    from tokenizers import Regex, Tokenizer, decoders, models, pre_tokenizers

    if pre not in SPLITS:
        raise ModelError(f"texts are split in the way {pre!r}; known are: {', '.join(SPLITS)}")
    known: dict[str, Any] = {}
    if vocabulary is not None:
        known = {"vocab": dict(vocabulary), "merges": list(merges)}
    tokenizer = Tokenizer(models.BPE(**known, ignore_merges=pre == "llama-bpe"))
    first: Any = pre_tokenizers.Digits(individual_digits=True)
    if pre != "smollm":
        first = pre_tokenizers.Split(Regex(SPLITS[pre]), behavior="isolated")
    then = pre_tokenizers.ByteLevel(add_prefix_space=False, use_regex=pre == "smollm")
    tokenizer.pre_tokenizer = pre_tokenizers.Sequence([first, then])
    tokenizer.decoder = decoders.ByteLevel()
    return tokenizer


def gguf_reader(path: Path) -> Any:
    """Return a `gguf.GGUFReader`; FileError where there is no such file, or no GGUF."""
    import gguf

    if not path.is_file():
        raise FileError(path, "no such file")
    try:
        return gguf.GGUFReader(path)
    except (ValueError, IndexError) as error:
        raise FileError(path, f"not a GGUF: {error}") from error


def add_vocabulary(writer: Any, tokenizer: Any, vocab_size: int, *, pre: str = "llama-bpe") -> None:
    """Write tokens in id order, their types, and the merges in rank order.

    Ids below `vocab_size` that the tokenizer (of `new_tokenizer`) lacks are never said. `pre` is
    how llama.cpp splits a text; only with the default are its tokens the tokenizer's.
    """
    import gguf

    tokens = [f"[unused{i}]" for i in range(vocab_size)]
    types = [int(gguf.TokenType.UNUSED)] * vocab_size
    for text, token in tokenizer.get_vocab(with_added_tokens=False).items():
        tokens[token], types[token] = text, int(gguf.TokenType.NORMAL)
    for token, added in tokenizer.get_added_tokens_decoder().items():
        kind = gguf.TokenType.CONTROL if added.special else gguf.TokenType.USER_DEFINED
        tokens[token], types[token] = added.content, int(kind)
    merges = json.loads(tokenizer.to_str())["model"]["merges"]
    writer.add_tokenizer_model("gpt2")
    writer.add_tokenizer_pre(pre)
    writer.add_token_list(tokens)
    writer.add_token_types(types)
    writer.add_token_merges([m if isinstance(m, str) else " ".join(m) for m in merges])


def add_special_tokens(
    writer: Any, tokenizer: Any, specials: Mapping[str, str | None], *, add_bos: bool
) -> None:
    """Write the ids of the tokens "bos", "eos" and "pad", where there are such."""
    add = {
        "bos": writer.add_bos_token_id,
        "eos": writer.add_eos_token_id,
        "pad": writer.add_pad_token_id,
    }
    for use, text in specials.items():
        if text is not None:
            add[use](tokenizer.token_to_id(text))
    writer.add_add_bos_token(add_bos)
    writer.add_add_eos_token(False)


def interleave(array: NDArray[np.float32], heads: int) -> NDArray[np.float32]:
    """Reorder rotary rows from transformers' half-split to llama.cpp's interleaved pairs."""
    rows, columns = array.shape
    halves = array.reshape(heads, 2, rows // heads // 2, columns)
    return np.ascontiguousarray(halves.swapaxes(1, 2).reshape(rows, columns))


def write_gguf(path: Path, fill: Any, architecture: str = "llama") -> None:
    """Let `fill` build the file elsewhere, then put it in its place."""
    import gguf

    try:
        with tempfile.TemporaryDirectory() as folder:
            made = Path(folder) / "made.gguf"
            writer = gguf.GGUFWriter(made, architecture)
            fill(writer)
            writer.write_header_to_file()
            writer.write_kv_data_to_file()
            writer.write_tensors_to_file()
            writer.close()
            write_atomic(path, made.read_bytes())
    except OSError as error:
        fix = "free some space there, or set TMPDIR to another folder"
        raise FileError(path, f"cannot write: {error.strerror or error}", fix=fix) from error


_PREFIX = "base_model.model."  # of peft's names
_A, _B = ".lora_A.weight", ".lora_B.weight"
Floats = NDArray[np.float32]


def make_merged(
    entry: ModelEntry, *, progress: Callable[[float], None] = lambda share: None
) -> Path:
    """Make the file of a model that is another one with an adapter, and check its hash.

    The entry's files are what is made, the adapter and its config; `progress` hears the share done.

    Raises:
        ModelError: the base or the adapter is not here or not right, or what was made is not what
            the manifest names.
        FileError: it cannot be written.
    """
    (base,) = verify(find_model(entry.base))
    places = file_paths(entry)
    made, adapter, config = places[:3]
    for file, place in zip(entry.files[1:], places[1:], strict=True):
        check_file(place, file.sha256, size=file.bytes, restore="git checkout -- models")
    is_chat = entry.prompt_profile == "tools"
    merge_adapter(
        base, adapter, config, made, name=entry.name, keeps_template=is_chat, progress=progress
    )
    try:
        check_file(made, entry.files[0].sha256, size=entry.files[0].bytes)
    except ModelError:
        made.unlink()
        raise
    return made


class AdapterConfig(msgspec.Struct, frozen=True):
    """What peft's adapter_config.json says of an adapter; other keys are left alone."""

    r: int
    lora_alpha: float
    use_rslora: bool = False
    use_dora: bool = False


def merge_adapter(
    base: Path,
    adapter: Path,
    config: Path,
    out: Path,
    *,
    name: str,
    keeps_template: bool = False,
    progress: Callable[[float], None] = lambda share: None,
) -> None:
    """Write base and adapter as one GGUF; it appears whole or not at all.

    The base is of llama or qwen2; adapter and config are peft's; `progress` hears the share done.
    A model that was tuned on chats keeps its chat template.

    Raises:
        FileError: one cannot be read, or the file cannot be written.
        ModelError: the adapter does not fit the base.
    """
    import gguf

    reader = gguf_reader(base)
    said = {key: field.contents() for key, field in reader.fields.items()}
    kind = said["general.architecture"]
    changes = _changes(adapter, config, kind, said)
    names = {tensor.name for tensor in reader.tensors}
    if lost := sorted(changes.keys() - names):
        raise ModelError(f"{adapter} changes {lost[0]}, which {base} has not")

    def fill(writer: Any) -> None:
        _copy_fields(writer, reader, name, () if keeps_template else (TEMPLATE,))
        for number, tensor in enumerate(reader.tensors):
            progress(number / len(reader.tensors))
            change = changes.get(tensor.name)
            if change is None:
                writer.add_tensor(tensor.name, tensor.data, raw_dtype=tensor.tensor_type)
                continue
            rows = gguf.quants.dequantize(tensor.data, tensor.tensor_type)
            rows = _added(rows, *change)
            q8 = gguf.GGMLQuantizationType.Q8_0
            writer.add_tensor(tensor.name, gguf.quants.quantize(rows, q8), raw_dtype=q8)

    write_gguf(out, fill, kind)


def _changes(
    adapter: Path, config: Path, kind: str, said: Mapping[str, Any]
) -> dict[str, tuple[Floats, Floats]]:
    """Return GGUF tensor -> (B times its scale, A), rows in the base's order."""
    import gguf
    from safetensors import SafetensorError
    from safetensors.numpy import load

    try:
        read = msgspec.json.decode(read_bytes(config), type=AdapterConfig)
        parts = {key: value.astype(np.float32) for key, value in load(read_bytes(adapter)).items()}
    except (msgspec.DecodeError, SafetensorError) as error:
        raise FileError(adapter, f"no adapter of peft's: {error}") from error
    if read.use_rslora or read.use_dora:
        raise ModelError(f"{config}: rsLoRA and DoRA cannot be merged")
    arch = next(a for a, text in gguf.MODEL_ARCH_NAMES.items() if text == kind)
    table = gguf.get_tensor_name_map(arch, said[f"{kind}.block_count"])
    heads = {
        "attn_q": said[f"{kind}.attention.head_count"],
        "attn_k": said[f"{kind}.attention.head_count_kv"],
    }
    scale = np.float32(read.lora_alpha / read.r)
    found = {}
    for key in sorted(key for key in parts if key.endswith(_A)):
        own = key.removeprefix(_PREFIX).removesuffix(_A)
        name = table.get_name(f"{own}.weight", try_suffixes=(".weight",))
        if name is None:
            raise ModelError(f"{adapter}: {own} has no place in a GGUF")
        wide = parts[key.removesuffix(_A) + _B] * scale
        part = name.split(".")[-2]
        if kind == "llama" and part in heads:
            wide = interleave(wide, heads[part])
        found[name] = (wide, parts[key])
    return found


def _added(rows: Floats, wide: Floats, low: Floats) -> Floats:
    """Return rows + wide @ low, added rank by rank."""
    if rows.shape != (len(wide), low.shape[1]):
        raise ModelError(f"the adapter has {len(wide)} x {low.shape[1]}, the base {rows.shape}")
    found = np.array(rows, np.float32)
    for column, row in zip(wide.T, low, strict=True):
        found += column[:, None] * row
    return found


def _copy_fields(writer: Any, reader: Any, name: str, without: Sequence[str]) -> None:
    """Copy the fields of the base but some, with another name."""
    import gguf

    left = ("GGUF.", "general.architecture", "general.name", "general.file_type", *without)
    for field in reader.fields.values():
        if not field.name.startswith(left):
            kind = field.types[0]
            inner = field.types[-1] if kind == gguf.GGUFValueType.ARRAY else None
            writer.add_key_value(field.name, field.contents(), kind, sub_type=inner)
    writer.add_name(name)
    writer.add_file_type(gguf.LlamaFileType.MOSTLY_Q8_0)
