"""What constrained decoding costs: our automaton, llama.cpp's grammar, llguidance, nothing.

    python scripts/bench_decode.py [--vocabulary 8192 32768] [--repeat 3]

Random weights, so speeds only. Every variant decodes the same number of tokens from the same
prompt, variants interleaved, medians of the repeats; ratios are against no constraint within one
run. "selection" is the time between having logits and having a token.
"""

import argparse
import random
import statistics
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))

import numpy as np
from numpy.typing import NDArray
from support.llama_export import export_llama_gguf

from karma.contracts import ProgramSpec, Prompt, Skill
from karma.infer.llama.constrain import choose_token
from karma.infer.llama.gguf_files import new_tokenizer
from karma.infer.llama.model import LlamaModel
from karma.infer.llama.options import LlamaOptions
from karma.infer.programs.automaton import ProgramAutomaton
from karma.offline import go_offline

TOKENS = 120
NAMES = tuple(
    f"{kind}_{n}" for kind in ("Apple", "Mug", "Fridge", "Sofa", "Lamp") for n in range(12)
)
SPEC = ProgramSpec(
    skills=(
        *(Skill(name=n, arguments=("object",)) for n in (
            "GoToObject", "PickupObject", "OpenObject", "CloseObject", "SliceObject", "ToggleOn")),
        Skill(name="PutObject", arguments=("object", "object"), optional=1),
        Skill(name="Explore", arguments=("object", "positions"), optional=1),
    ),
    objects=NAMES,
    positions=tuple(f"node_{n}" for n in range(8)),
    max_calls=1000,
)  # fmt: skip


def gbnf() -> str:
    """The same language as a flat enumeration."""
    one = " | ".join(f'"{s.name}"' for s in SPEC.skills if len(s.arguments) == 1)
    names = " | ".join(f'"{name}"' for name in SPEC.objects)
    nodes = " | ".join(f'"{name}"' for name in SPEC.positions)
    return (
        'root ::= (line "\\n")+\n'
        f'line ::= ({one}) "(robot, " name ")" | "PutObject(robot, " name (", " name)? ")"'
        ' | "Explore(robot, " name (", [" node (", " node)* "]")? ")"\n'
        f'name ::= "\'" ({names}) "\'"\nnode ::= "\'" ({nodes}) "\'"\n'
    )


def corpus(words: int) -> list[str]:
    """Programs, and enough invented words to fill a vocabulary."""
    generator = np.random.default_rng(0)
    automaton = ProgramAutomaton(SPEC)
    letters = random.Random(0)
    texts = [automaton.random_program(generator, 10) for _ in range(200)]
    invented = [
        "".join(letters.choices("etaoinshrdlu", k=letters.randint(3, 9))) for _ in range(words)
    ]
    return texts + [" ".join(invented[i : i + 50]) for i in range(0, words, 50)] * 2


def make_model(path: Path, vocabulary: int) -> None:
    """Write a small random Llama with so many tokens."""
    import torch
    from transformers import LlamaConfig, LlamaForCausalLM

    torch.manual_seed(0)
    tokenizer = new_tokenizer(corpus(vocabulary * 2), vocabulary, ["<|eos|>"])
    config = LlamaConfig(
        vocab_size=vocabulary, hidden_size=256, intermediate_size=640, num_hidden_layers=6,
        num_attention_heads=8, num_key_value_heads=4, max_position_embeddings=4096,
        tie_word_embeddings=True, initializer_range=0.1,
    )  # fmt: skip
    export_llama_gguf(
        LlamaForCausalLM(config), tokenizer, path, name="bench", eos_token="<|eos|>", dtype="F16"
    )


Choose = Callable[[NDArray[np.float32]], int]


class Loop:
    """One decode loop with the selection timed apart.

    `wish` is what a trained model would do: it lifts the next token of a fixed program, so the
    best token is nearly always admitted. Without it, random weights propose nothing admitted.
    """

    def __init__(self, model: LlamaModel, wish: list[int] | None) -> None:
        self._llama, self._wish, self._model = model.gguf.llama, wish, model

    def run(self, choose: Choose) -> tuple[float, list[float]]:
        """Return seconds in all and of each selection, for TOKENS tokens."""
        self._model.complete(PROMPT, max_tokens=1)
        begun, selecting = time.perf_counter(), []
        for step in range(TOKENS):
            logits = self._model.gguf.logits().copy()
            if self._wish is not None:
                logits[self._wish[step]] += 100
            before = time.perf_counter()
            token = choose(logits)
            selecting.append(time.perf_counter() - before)
            self._llama.eval([token])
        return time.perf_counter() - begun, selecting


PROMPT = Prompt(
    stable="A kitchen with a fridge, a table and a lamp.\n" * 20, changing="Task: go.\n"
)


def nothing(model: LlamaModel) -> Choose:
    """No constraint: the best token."""
    return lambda logits: int(np.argmax(logits))


def ours(model: LlamaModel) -> Choose:
    """Sample-then-check."""
    automaton, tokens = ProgramAutomaton(SPEC), model.gguf.table
    state = automaton.start()

    def choose(logits: NDArray[np.float32]) -> int:
        nonlocal state
        if automaton.accepts(state):
            logits[list(tokens.end_tokens)] = -1e9  # go on, to decode as many tokens as the others
        choice = choose_token(logits, automaton, state, tokens)
        assert choice.state is not None
        state = choice.state
        return choice.token

    return choose


def grammar_first(model: LlamaModel) -> Choose:
    """GBNF over all tokens and then the best, as the class `Llama` does."""
    import llama_cpp
    from llama_cpp import LlamaGrammar, _internals

    sampler = _internals.LlamaSampler()
    sampler.add_grammar(model.gguf.llama._model, LlamaGrammar.from_string(gbnf(), verbose=False))
    array = _internals.LlamaTokenDataArray(n_vocab=model.gguf.llama.n_vocab())

    def choose(logits: NDArray[np.float32]) -> int:
        logits[list(model.gguf.table.end_tokens)] = -1e9
        array.copy_logits(logits)
        llama_cpp.llama_sampler_apply(sampler.sampler, array.candidates)
        token = int(array.candidates_data.id[np.argmax(array.candidates_data.logit)])
        sampler.accept(token)
        return token

    return choose


def llguidance_mask(model: LlamaModel) -> Choose:
    """Llguidance's mask over all tokens and then the best.

    Raises:
        ImportError: it is not installed.
    """
    import llguidance
    import llguidance.llamacpp
    import llguidance.numpy as masks

    tokenizer = llguidance.llamacpp.lltokenizer_from_vocab(model.gguf.llama._model.vocab)
    grammar = llguidance.LLMatcher.grammar_from_lark(_lark())
    matcher = llguidance.LLMatcher(tokenizer, grammar)
    assert not matcher.is_error(), matcher.get_error()
    mask = masks.allocate_token_bitmask(1, tokenizer.vocab_size)

    def choose(logits: NDArray[np.float32]) -> int:
        logits[list(model.gguf.table.end_tokens)] = -1e9
        masks.fill_next_token_bitmask(matcher, mask, 0)
        masks.apply_token_bitmask_inplace(logits, mask)
        token = int(np.argmax(logits))
        matcher.consume_token(token)
        return token

    return choose


def _lark() -> str:
    """The same language for llguidance."""
    one = " | ".join(f'"{s.name}"' for s in SPEC.skills if len(s.arguments) == 1)
    names = " | ".join(f"\"'{name}'\"" for name in SPEC.objects)
    nodes = " | ".join(f"\"'{name}'\"" for name in SPEC.positions)
    return (
        'start: (line "\\n")+\n'
        f'line: ({one}) "(robot, " name ")" | "PutObject(robot, " name (", " name)? ")"'
        ' | "Explore(robot, " name (", [" node (", " node)* "]")? ")"\n'
        f"name: {names}\nnode: {nodes}\n"
    )


VARIANTS = {
    "no constraint": nothing,
    "our automaton": ours,
    "llama.cpp GBNF, flat": grammar_first,
    "llguidance": llguidance_mask,
}


def table(model: LlamaModel, wish: list[int] | None, repeat: int) -> None:
    """Measure and print one table."""
    times: dict[str, list[tuple[float, list[float]]]] = {name: [] for name in VARIANTS}
    loop = Loop(model, wish)
    for _ in range(repeat):
        for name, make in VARIANTS.items():
            try:
                choose = make(model)
            except ImportError:
                continue
            times[name].append(loop.run(choose))
    print(
        "| variant | tokens/s | of unconstrained | selection, µs/token: median (p90) | of medians |"
    )
    print("|---|---|---|---|---|")
    base: tuple[float, float] | None = None
    for name, found in times.items():
        if not found:
            print(f"| {name} | – | – | – | – |")
            continue
        whole = statistics.median(f[0] for f in found)
        selections = sorted(one * 1e6 for f in found for one in f[1])
        select, late = statistics.median(selections), selections[len(selections) * 9 // 10]
        base = base or (whole, select)
        print(
            f"| {name} | {TOKENS / whole:.1f} | x{base[0] / whole:.2f} |"
            f" {select:.0f} ({late:.0f}) | x{select / base[1]:.1f} |"
        )


def first_token(path: Path, repeat: int) -> None:
    """Time to the first token, cold and warm."""
    prompt = Prompt(stable=PROMPT.stable * 5, changing="Please put the apple on the table.\n" * 3)
    other = Prompt(stable=PROMPT.stable, changing=".\n")
    model: Any = LlamaModel(path, options=LlamaOptions(threads=1))
    cold, warm = [], []
    for _ in range(repeat):
        model.complete(other, max_tokens=1)
        cold.append(model.complete(prompt, spec=SPEC, max_tokens=1))
        warm.append(model.complete(prompt, spec=SPEC, max_tokens=1))
    seconds = [statistics.median(c.first_token_s for c in found) for found in (cold, warm)]
    print(
        f"time to first token: cold {seconds[0] * 1e3:.1f} ms ({cold[0].prompt_tokens} tokens),"
        f" warm {seconds[1] * 1e3:.1f} ms ({warm[0].prompt_tokens - warm[0].reused_tokens} tokens),"
        f" x{seconds[0] / seconds[1]:.1f}"
    )


def main() -> None:
    """Run all of it."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--vocabulary", type=int, nargs="+", default=[8192, 32768])
    parser.add_argument("--repeat", type=int, default=3)
    options = parser.parse_args()
    text = ProgramAutomaton(SPEC).random_program(np.random.default_rng(1), 60).encode()
    for vocabulary in options.vocabulary:
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "bench.gguf"
            make_model(path, vocabulary)
            model = LlamaModel(path, options=LlamaOptions(threads=1))
            wish = model.gguf.llama.tokenize(text, add_bos=False)[:TOKENS]
            print(f"\n## {vocabulary} tokens, the best token is admitted (as trained)\n")
            table(model, wish, options.repeat)
            print(f"\n## {vocabulary} tokens, random weights choose (worst case)\n")
            table(model, None, options.repeat)
            print()
            first_token(path, options.repeat)


if __name__ == "__main__":
    go_offline()
    main()
