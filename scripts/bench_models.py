"""Measure planners of common sizes: speed relative to llama.cpp, first tokens, memory.

    python scripts/bench_models.py [nano 0.5b 1.5b 3b 8b] [--type f16 --type q8_0] [--threads 1]
        [--folder runs/bench_models] [--repeat 3]

Weights are random, so speed and memory only; files are made once and stay in the folder. Each file
is measured in a process of its own. "llama.cpp" is llama_decode over the same weights, options and
numbers of tokens in the same process, interleaved with ours. On one thread speeds are by processor
time, which on a free core is the time on the wall; first tokens are by the wall. All are the best
of the repeats: others who use the machine only slow.
"""

import json
import subprocess
import sys
import time
from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Annotated, Any

import typer
from measuring import CHILDREN, Clock, resident_mb, table, taken

from karma.files import sha256_of
from karma.models.checks.gguf import check_gguf
from karma.models.checks.memory import gguf_parts_mb
from karma.models.constraint import Constraint
from karma.models.llama.answer import CertaintyLog, StreamingAnswer
from karma.models.llama.model import Draw, LlamaModel
from karma.models.llama.opening import LlamaOptions, open_context
from karma.models.manifest import resolve_planner
from karma.offline.guard import go_offline
from karma.testing import make_llama
from karma.types.planning import ProgramSpec, Prompt, Skill

NANO = "nano"  # the planner that ships
CLASSES = {  # shapes of Qwen 2.5 0.5B and 1.5B, Llama 3.2 3B, Llama 3.1 8B
    "0.5b": {"layers": 24, "width": 896, "heads": 14, "kv_heads": 2, "feed_forward": 4864,
             "vocabulary": 151_936},
    "1.5b": {"layers": 28, "width": 1536, "heads": 12, "kv_heads": 2, "feed_forward": 8960,
             "vocabulary": 151_936},
    "3b": {"layers": 28, "width": 3072, "heads": 24, "kv_heads": 8, "feed_forward": 8192,
           "vocabulary": 128_256},
    "8b": {"layers": 32, "width": 4096, "heads": 32, "kv_heads": 8, "feed_forward": 14_336,
           "vocabulary": 128_256, "tied": False},
}  # fmt: skip
SPEC = ProgramSpec(
    skills=(
        Skill(name="GoToObject", arguments=("object",)),
        Skill(name="PutObject", arguments=("object", "object"), optional=1),
    ),
    objects=tuple(f"{kind}_{n}" for kind in ("Apple", "Mug", "Fridge", "Lamp") for n in range(15)),
    positions=(),
    max_calls=1000,
)
OTHER = Prompt(stable="Another room.\n", changing="Go.\n")


@dataclass(frozen=True, slots=True, kw_only=True)
class Wanted:
    """Parameters of a measurement."""

    name: str
    path: str
    stable: int  # tokens
    changing: int
    answer: int
    threads: int
    repeat: int
    prefills: int  # cold prefills of each; ours has another

    @property
    def clock(self) -> Clock:
        """The clock: processor time on a single thread, else wall-clock time."""
        return time.process_time if self.threads == 1 else time.perf_counter


@dataclass(slots=True)
class Found:
    """Figures of a file; every list holds a value per repeat."""

    prompt: int  # tokens
    prefill_s: defaultdict[str, list[float]] = field(default_factory=lambda: defaultdict(list))
    token_s: defaultdict[str, list[float]] = field(default_factory=lambda: defaultdict(list))
    first_s: defaultdict[str, list[float]] = field(default_factory=lambda: defaultdict(list))
    same: bool = True  # all answers and logits to the same prompt, to the bit

    def row(self, wanted: Wanted, memory_mb: float, predicted_mb: float) -> list[object]:
        """Return a line of the table."""
        prefill = {what: self.prompt / min(times) for what, times in self.prefill_s.items()}
        decode = {what: 1 / min(times) for what, times in self.token_s.items()}
        slower = max(
            prefill["llama.cpp"] / prefill["ours"],
            decode["llama.cpp"] / min(decode["constrained"], decode["unconstrained"]),
        )
        return [
            wanted.name, Path(wanted.path).stat().st_size / 1e6, self.prompt,
            prefill["ours"], prefill["llama.cpp"], decode["constrained"],
            decode["unconstrained"], decode["llama.cpp"], f"x{slower:.2f}",
            *(f"{min(self.first_s[what]):.3f}" for what in ("cold", "kept")),
            memory_mb, predicted_mb,
            f"{100 * (predicted_mb / memory_mb - 1):+.0f} %", "yes" if self.same else "NO",
        ]  # fmt: skip


# ------------------------------------------------------------------------------------- one file


def measure(wanted: Wanted) -> list[object]:
    """Measure a file; the process should do nothing else."""
    import llama_cpp  # before memory is looked at

    llama_cpp.llama_backend_init()
    before, path = resident_mb(), Path(wanted.path)
    model = opened(wanted)
    prompt, gguf = prompt_of(model, wanted), model.gguf
    tokens = [*gguf.tokens(prompt.stable, begins=True), *gguf.tokens(prompt.changing)]
    found = Found(len(tokens))
    cold = taken(lambda: model.complete(prompt, spec=SPEC, max_tokens=1), wanted.clock)
    found.prefill_s["ours"].append(cold)
    memory_mb = resident_mb() - before
    parts = gguf_parts_mb(path, check_gguf(path), context=gguf.n_ctx, batch=gguf.n_batch)
    raw = Raw(model, wanted, tokens)
    speeds(model, raw, prompt, wanted, found)
    raw.close()
    model.close()
    first_tokens(prompt, wanted, found)
    return found.row(wanted, memory_mb, parts)


def opened(wanted: Wanted) -> LlamaModel:
    """Open a file that needs no trial: it was made here."""
    needed = wanted.stable + wanted.changing + wanted.answer
    options = LlamaOptions(n_ctx=-(-needed // 256) * 256, threads=wanted.threads)
    path = Path(wanted.path)
    return LlamaModel(path, options=options, sha256=sha256_beside(path))


def prompt_of(model: LlamaModel, wanted: Wanted) -> Prompt:
    """Return a prompt of so many tokens, or as many as leave room for an answer."""

    def text(tokens: int, line: str) -> str:
        lines = ""
        for number in range(tokens):
            longer = f"{lines}{line} {number}\n"
            if len(model.gguf.tokens(longer)) > tokens:
                break
            lines = longer
        return lines

    room = model.gguf.n_ctx - wanted.changing - wanted.answer - 1
    return Prompt(
        stable=text(min(wanted.stable, room), "node_1: Fridge, Sink, CounterTop, CoffeeMachine"),
        changing=text(wanted.changing, "Put the apple in the fridge, then close it."),
    )


def speeds(model: LlamaModel, raw: "Raw", prompt: Prompt, wanted: Wanted, found: Found) -> None:
    """Time prefill and answers, ours and llama.cpp's in turns."""
    for number in range(wanted.prefills):
        found.prefill_s["llama.cpp"].append(raw.prefill())
        if number:  # the first was timed, and one more will be
            model.complete(OTHER, max_tokens=1)
            again = taken(lambda: model.complete(prompt, max_tokens=1), wanted.clock)
            found.prefill_s["ours"].append(again)
    texts = set()
    for _ in range(wanted.repeat):
        for name, spec in (("constrained", SPEC), ("unconstrained", None)):
            held = Constraint(model.gguf.grammar_tokens, spec.grammar) if spec else None
            log = CertaintyLog(model.gguf.table, may_refuse=False)
            answer = StreamingAnswer(None, None)
            model.gguf.evaluate(model._cut(prompt))
            begun = wanted.clock()
            said = model._decode(held, wanted.answer, Draw(), answer, log)
            found.token_s[name].append((wanted.clock() - begun) / max(1, said.tokens - 1))
            texts.add(said.text)
        found.token_s["llama.cpp"].append(raw.answer())
    found.same = len(texts) == 2


def first_tokens(prompt: Prompt, wanted: Wanted, found: Found) -> None:
    """Time the first token with the room's state evaluated, and kept."""
    logits = set()
    for _ in range(wanted.repeat):
        model = opened(wanted)
        model.complete(OTHER, max_tokens=1)
        for name in ("cold", "kept"):
            begun = wanted.clock()
            said = model.complete(prompt, spec=SPEC, max_tokens=1)
            if name == "cold":
                found.prefill_s["ours"].append(wanted.clock() - begun)
            logits.add(model.gguf.logits().tobytes())
            found.first_s[name].append(said.first_token_s or 0.0)
            model.complete(OTHER, max_tokens=1)  # another room in between
        model.close()
    found.same = found.same and len(logits) == 1


class Raw:
    """Calls of llama_decode in a second context over the same weights, and nothing else.

    Args:
        model: whose weights and options are used.
        wanted: how many tokens an answer has.
        prompt: its tokens; fed in the batches that ours are.
    """

    def __init__(self, model: LlamaModel, wanted: Wanted, prompt: Sequence[int]) -> None:
        import llama_cpp

        self._cpp: Any = llama_cpp
        self._context = open_context(model.gguf.llama, model.gguf.n_ctx)
        self._memory = llama_cpp.llama_get_memory(self._context.ctx)
        self._prompt, self._batch, self._answer = prompt, model.gguf.n_batch, wanted.answer
        self._clock = wanted.clock

    def prefill(self) -> float:
        """Return the seconds that the prompt takes."""
        self._cpp.llama_memory_seq_rm(self._memory, 0, 0, -1)
        begun = self._clock()
        for first in range(0, len(self._prompt), self._batch):
            self._decode(self._prompt[first : first + self._batch])
        self._cpp.llama_synchronize(self._context.ctx)
        return self._clock() - begun

    def answer(self) -> float:
        """Return the seconds that a token behind the prompt takes."""
        self._cpp.llama_memory_seq_rm(self._memory, 0, len(self._prompt), -1)
        begun = self._clock()
        for number in range(self._answer - 1):
            self._decode([300 + number])
            self._cpp.llama_synchronize(self._context.ctx)
        return (self._clock() - begun) / (self._answer - 1)

    def close(self) -> None:
        """Free the context."""
        self._context.close()

    def _decode(self, tokens: Sequence[int]) -> None:
        array = (self._cpp.llama_token * len(tokens))(*tokens)
        batch = self._cpp.llama_batch_get_one(array, len(tokens))
        if self._cpp.llama_decode(self._context.ctx, batch) != 0:
            raise SystemExit("llama_decode failed")


# ------------------------------------------------------------------------------------ all files


def made(name: str, kind: str, folder: Path) -> Path:
    """Return the file of a size class, made if it is not there; F16 first, others from that."""
    if name == NANO:
        return Path(resolve_planner("karma-nano").path)
    path, whole = folder / f"{name}-{kind}.gguf", folder / f"{name}-f16.gguf"
    if path.exists():
        return path
    folder.mkdir(parents=True, exist_ok=True)
    if not whole.exists():
        shape: dict[str, Any] = CLASSES[name]
        make_llama(folder / "being.gguf", **shape)
        (folder / "being.gguf").rename(whole)
    if path != whole:
        quantise(whole, path, kind)
    return path


def quantise(whole: Path, path: Path, kind: str) -> None:
    """Write a file in fewer bits."""
    import ctypes

    import llama_cpp

    options = llama_cpp.llama_model_quantize_default_params()
    options.ftype = getattr(llama_cpp, f"LLAMA_FTYPE_MOSTLY_{kind.upper()}")
    begun = str(path.with_suffix(".being")).encode()
    if llama_cpp.llama_model_quantize(str(whole).encode(), begun, ctypes.byref(options)) != 0:
        raise SystemExit(f"{whole}: cannot be written as {kind}")
    Path(begun.decode()).rename(path)


def sha256_beside(path: Path) -> str:
    """Return a file's hash, kept beside it where it was made here."""
    kept = path.with_suffix(".sha256")
    if path.name == "planner.gguf":
        return sha256_of(path)
    if not kept.exists():
        kept.write_text(sha256_of(path))
    return kept.read_text()


def main(
    classes: Annotated[list[str] | None, typer.Argument()] = None,
    kinds: Annotated[list[str] | None, typer.Option("--type")] = None,
    threads: int = 1,
    stable: int = 2000,
    answer: int = 48,
    repeat: int = 3,
    prefills: int = 2,
    folder: Path = Path("runs/bench_models"),
    one: Annotated[str, typer.Option(hidden=True)] = "",
) -> None:
    """Measure all files, or the file that the parent process names."""
    go_offline()
    folder.mkdir(parents=True, exist_ok=True)
    if one:
        with TemporaryDirectory(dir=folder) as place:
            print(json.dumps(measure(Wanted(**json.loads(one)), Path(place))))
        return

    def rows() -> Iterator[Sequence[object]]:
        for name in classes or [NANO, "0.5b"]:
            for kind in ["q8_0"] if name == NANO else kinds or ["q8_0"]:
                wanted = Wanted(
                    name=f"{name}, {kind}", path=str(made(name, kind, folder)), stable=stable,
                    changing=100, answer=answer, threads=threads, repeat=repeat,
                    prefills=prefills,
                )  # fmt: skip
                told = json.dumps(asdict(wanted))
                command = [sys.executable, __file__, "--one", told, "--folder", str(folder)]
                done = subprocess.run(
                    command, stdout=subprocess.PIPE, text=True, check=True, env=CHILDREN
                )
                yield json.loads(done.stdout.splitlines()[-1])

    table(
        "model | file, MB | prompt | prefill, tokens/s: ours | llama.cpp |"
        " decode, tokens/s: constrained | unconstrained | llama.cpp | slower by |"
        " first token: cold, s | kept, s | memory, MB | predicted | off |"
        " bits equal",
        rows(),
    )


if __name__ == "__main__":
    typer.run(main)
