"""What planners of real sizes cost here: speed against llama.cpp itself, first tokens, memory.

    python scripts/bench_models.py [nano 0.5b 1.5b 3b 8b] [--types f16 q8_0 q4_k_m] [--threads 1]
        [--llama-bench PATH] [--folder runs/bench_models] [--repeat 3] [--json FILE]

Weights are random, so speed and memory only; files are made once and stay in the folder. Each file
is measured in a process of its own. "llama.cpp" is llama_decode over the same weights, options and
numbers of tokens in the same process, interleaved with ours; llama-bench, where its program is
given, runs right after. On one thread speeds are by processor time, which on a free core is the
time on the wall; llama-bench's and first tokens are by the wall. All are the best of the repeats:
others who use the machine only slow. A state is loaded after the system was told to drop the file
from its cache. Memory is without the states that are kept of other rooms.
"""

import argparse
import json
import os
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from karma.contracts import ProgramSpec, Prompt, Skill
from karma.files import sha256_of, to_json
from karma.infer.checks.gguf import check_gguf
from karma.infer.checks.memory import gguf_parts_mb
from karma.infer.llama.model import LlamaModel
from karma.infer.llama.options import LlamaOptions
from karma.infer.llama.room_states import StateOptions
from karma.infer.manifest.manifest import resolve_planner
from karma.infer.programs.automaton import ProgramAutomaton
from karma.offline import go_offline
from karma.testing import make_llama

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
    """What to measure one file with."""

    stable: int  # tokens
    changing: int
    answer: int
    threads: int
    repeat: int
    prefills: int  # cold ones of each; they are what takes time, and ours is one more


@dataclass(slots=True, kw_only=True)
class Measured:
    """One file; every list holds one figure per repeat."""

    file_mb: float
    prompt_tokens: int
    prefill_s: dict[str, list[float]] = field(default_factory=dict)
    token_s: dict[str, list[float]] = field(default_factory=dict)  # per token, medians of answers
    first_token_s: dict[str, list[float]] = field(default_factory=dict)
    states: dict[str, str] = field(default_factory=dict)  # what the answers said of themselves
    same: bool = True  # all answers and logits to the same prompt, to the bit
    state_mb: float = 0.0
    memory_mb: float = 0.0
    predicted_mb: float = 0.0


# ------------------------------------------------------------------------------------- one file


def measure(path: Path, wanted: Wanted, folder: Path) -> Measured:
    """Measure one file; the process should do nothing else."""
    import llama_cpp  # before memory is looked at

    llama_cpp.llama_backend_init()
    before = resident()
    model = opened(path, wanted, StateOptions(memory_mb=0))
    prompt = prompt_of(model, wanted)
    tokens = [*model.gguf.tokens(prompt.stable, begins=True), *model.gguf.tokens(prompt.changing)]
    found = Measured(file_mb=path.stat().st_size / 1e6, prompt_tokens=len(tokens))
    clock = clock_of(wanted)
    begun = clock()
    model.complete(prompt, spec=SPEC, max_tokens=1)
    note(found.prefill_s, "ours", clock() - begun)
    found.memory_mb = resident() - before
    gguf = model.gguf
    found.predicted_mb = gguf_parts_mb(
        path, check_gguf(path), context=gguf.n_ctx, batch=gguf.n_batch
    )
    raw = Raw(model, wanted, tokens)
    speeds(model, raw, prompt, wanted, found)
    raw.close()
    model.close()
    first_tokens(path, prompt, wanted, folder, found)
    return found


def opened(path: Path, wanted: Wanted, states: StateOptions) -> LlamaModel:
    """Open a file that needs no trial: it was made here."""
    needed = wanted.stable + wanted.changing + wanted.answer
    options = LlamaOptions(n_ctx=-(-needed // 256) * 256, threads=wanted.threads)
    return LlamaModel(path, options=options, sha256=sha256_beside(path), states=states)


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


def speeds(model: LlamaModel, raw: "Raw", prompt: Prompt, wanted: Wanted, found: Measured) -> None:
    """Time prefill and answers, ours and llama.cpp's in turns."""
    clock = clock_of(wanted)
    for number in range(wanted.prefills):
        note(found.prefill_s, "llama.cpp", raw.prefill())
        if number:  # the first was timed, and one more will be
            model.complete(OTHER, max_tokens=1)
            begun = clock()
            model.complete(prompt, max_tokens=1)
            note(found.prefill_s, "ours", clock() - begun)
    texts = set()
    for _ in range(wanted.repeat):
        for name, automaton in (("constrained", ProgramAutomaton(SPEC)), ("unconstrained", None)):
            model.gguf.evaluate(*model._cut(prompt))
            begun = clock()
            said = model._decode(automaton, wanted.answer, 0.0, None, 0.0)
            note(found.token_s, name, (clock() - begun) / max(1, said.tokens - 1))
            texts.add(said.text)
        note(found.token_s, "llama.cpp", raw.answer())
    found.same = len(texts) == 2


def clock_of(wanted: Wanted) -> Callable[[], float]:
    """Return what tells the time: on one thread its own, which others on the machine do not eat."""
    return time.process_time if wanted.threads == 1 else time.perf_counter


def first_tokens(path: Path, prompt: Prompt, wanted: Wanted, folder: Path, found: Measured) -> None:
    """Time the first token with the room's state evaluated, kept, and loaded."""
    states = StateOptions(folder=folder)
    told, clock = set(), clock_of(wanted)
    for number in range(wanted.repeat + 1):
        model = opened(path, wanted, states)
        model.complete(OTHER, max_tokens=1)
        for name in ("loaded" if number else "cold", "kept"):
            begun = clock()
            said = model.complete(prompt, spec=SPEC, max_tokens=1)
            if name == "cold":
                note(found.prefill_s, "ours", clock() - begun)
            told.add(model.gguf.logits().tobytes())
            note(found.first_token_s, name, said.first_token_s or 0.0)
            found.states[name] = said.state or ""
            model.complete(OTHER, max_tokens=1)  # another room in between
        model.close()
        for file in folder.iterdir():
            found.state_mb = max(found.state_mb, file.stat().st_size / 1e6)
            dropped_from_cache(file)
    found.same = found.same and len(told) == 1


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
        self._context = model.gguf.sequences(1, cells=model.gguf.n_ctx)
        self._memory = llama_cpp.llama_get_memory(self._context.ctx)
        self._prompt, self._batch, self._answer = prompt, model.gguf.n_batch, wanted.answer
        self._clock = clock_of(wanted)

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


def note(into: dict[str, list[float]], name: str, value: float) -> None:
    """Add one repeat's figure."""
    into.setdefault(name, []).append(value)


def resident() -> float:
    """Return what this process holds of memory, mapped files counted, in MB."""
    for line in Path("/proc/self/status").read_text().splitlines():
        if line.startswith("VmRSS:"):
            return int(line.split()[1]) * 1024 / 1e6
    raise SystemExit("no VmRSS in /proc/self/status")


def dropped_from_cache(path: Path) -> None:
    """Ask the system to forget what it holds of a file."""
    with path.open("rb") as file:
        os.fsync(file.fileno())
        os.posix_fadvise(file.fileno(), 0, 0, os.POSIX_FADV_DONTNEED)


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
    """Return a file's hash, kept beside it."""
    kept = path.with_suffix(".sha256")
    if path.name == "planner.gguf" or not kept.exists():
        found = sha256_of(path)
        if path.name != "planner.gguf":
            kept.write_text(found)
        return found
    return kept.read_text()


def bench(program: str, path: Path, wanted: Wanted, prompt: int) -> dict[str, float]:
    """Return tokens per second as llama-bench measures them, the best of its repeats."""
    same = ["-m", path, "-t", wanted.threads, "-b", 512, "-ub", 512, "-fa", "off", "-ngl", 0]
    found = {}
    for what, numbers, repeat in (
        ("prefill", ["-p", prompt, "-n", 0], wanted.prefills),
        ("decode", ["-p", 0, "-n", wanted.answer, "-d", prompt], wanted.repeat),
    ):
        command = [program, *same, *numbers, "-r", repeat, "--no-warmup", "-o", "json"]
        said = subprocess.run(
            list(map(str, command)), capture_output=True, text=True, check=True
        ).stdout
        found[what] = max(json.loads(said)[0]["samples_ts"])
    return found


HEADER = (
    "| model | file, MB | prompt | prefill, tokens/s: ours | llama.cpp | llama-bench |"
    " decode, tokens/s: constrained | unconstrained | llama.cpp | llama-bench | slower by |"
    " first token: cold, s | kept, s | loaded, s | state, MB | memory, MB | predicted | off by |"
    " bits equal |\n|" + "---|" * 19
)


def row(name: str, one: Measured, other: dict[str, float]) -> str:
    """Return a line of the table."""
    prefill = {what: one.prompt_tokens / min(times) for what, times in one.prefill_s.items()}
    decode = {what: 1 / min(times) for what, times in one.token_s.items()}
    slower = max(
        prefill["llama.cpp"] / prefill["ours"],
        decode["llama.cpp"] / min(decode["constrained"], decode["unconstrained"]),
    )
    first = {what: min(times) for what, times in one.first_token_s.items()}
    cells = [
        name, f"{one.file_mb:.0f}", one.prompt_tokens, f"{prefill['ours']:.1f}",
        f"{prefill['llama.cpp']:.1f}", figure(other.get("prefill")),
        f"{decode['constrained']:.2f}", f"{decode['unconstrained']:.2f}",
        f"{decode['llama.cpp']:.2f}", figure(other.get("decode")), f"x{slower:.2f}",
        *(f"{first[what]:.3f}" for what in ("cold", "kept", "loaded")), f"{one.state_mb:.0f}",
        f"{one.memory_mb:.0f}", f"{one.predicted_mb:.0f}",
        f"{100 * (one.predicted_mb / one.memory_mb - 1):+.0f} %", "yes" if one.same else "NO",
    ]  # fmt: skip
    return f"| {' | '.join(map(str, cells))} |"


def figure(value: float | None) -> str:
    """Return a speed, or that it was not measured."""
    return "–" if value is None else f"{value:.1f}"


def children(options: argparse.Namespace) -> Iterator[tuple[str, Path, Measured]]:
    """Measure every file in a process of its own."""
    for name in options.classes:
        for kind in ["q8_0"] if name == NANO else options.types:
            path = made(name, kind, options.folder)
            command = [sys.executable, __file__, "--one", str(path), "--repeat", options.repeat]
            command += ["--prefills", options.prefills, "--threads", options.threads]
            command += ["--answer", options.answer, "--stable", options.stable]
            command += ["--folder", options.folder]
            done = subprocess.run(
                list(map(str, command)), stdout=subprocess.PIPE, text=True, check=True
            )
            yield f"{name}, {kind}", path, Measured(**json.loads(done.stdout.splitlines()[-1]))


def main() -> None:
    """Run all of it, or one file as told by the parent."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("classes", nargs="*", default=[NANO, "0.5b"])
    parser.add_argument("--types", nargs="+", default=["q8_0"])
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--stable", type=int, default=2000)
    parser.add_argument("--answer", type=int, default=48)
    parser.add_argument("--repeat", type=int, default=3)
    parser.add_argument("--prefills", type=int, default=2)
    parser.add_argument("--llama-bench", default="")
    parser.add_argument("--folder", type=Path, default=Path("runs/bench_models"))
    parser.add_argument("--json", type=Path)
    parser.add_argument("--one", type=Path, help=argparse.SUPPRESS)
    options = parser.parse_args()
    wanted = Wanted(
        stable=options.stable, changing=100, answer=options.answer, threads=options.threads,
        repeat=options.repeat, prefills=options.prefills,
    )  # fmt: skip
    say: Callable[..., None] = print
    if options.one is not None:
        with TemporaryDirectory(dir=options.folder) as folder:
            say(json.dumps(asdict(measure(options.one, wanted, Path(folder)))))
        return
    say(HEADER, flush=True)
    lines = []
    for name, path, one in children(options):
        other = {}
        if options.llama_bench:
            other = bench(options.llama_bench, path, wanted, one.prompt_tokens)
        lines.append({"name": name, "llama_bench": other, **asdict(one)})
        say(row(name, one, other), flush=True)
        if options.json:
            options.json.write_bytes(to_json(lines, indent=2))


if __name__ == "__main__":
    go_offline()
    main()
