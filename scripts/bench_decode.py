"""What constrained decoding costs: our automaton, llama.cpp's grammar, llguidance, nothing.

    python scripts/bench_decode.py [--vocabulary 8192 --vocabulary 32768] [--repeat 3]

Random weights, so speeds only. Every variant decodes the same number of tokens from the same
prompt, in turns, medians of the repeats; the reference is no constraint. "Selection" is the time
between having logits and having a token. First "as trained": the logit of the next token of a
fixed program is lifted, so the best token is nearly always admitted; then random weights choose,
which propose nothing admitted.
"""

import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from statistics import median
from typing import Annotated

import numpy as np
import typer
from measuring import table, taken
from numpy.typing import NDArray

from karma.contracts import ProgramSpec, Prompt, Skill
from karma.infer.llama.constrain import choose_token
from karma.infer.llama.model import LlamaModel
from karma.infer.llama.options import LlamaOptions
from karma.infer.programs.automaton import ProgramAutomaton
from karma.offline import go_offline
from karma.testing import make_llama

Choose = Callable[[NDArray[np.float32]], int]
TOKENS = 120
PLAIN = ("GoToObject", "PickupObject", "OpenObject", "CloseObject", "SliceObject", "ToggleOn")
SPEC = ProgramSpec(
    skills=(
        *(Skill(name=name, arguments=("object",)) for name in PLAIN),
        Skill(name="PutObject", arguments=("object", "object"), optional=1),
        Skill(name="Explore", arguments=("object", "positions"), optional=1),
    ),
    objects=tuple(
        f"{kind}_{n}" for kind in ("Apple", "Mug", "Fridge", "Sofa", "Lamp") for n in range(12)
    ),
    positions=tuple(f"node_{n}" for n in range(8)),
    max_calls=1000,
)
PROMPT = Prompt(
    stable="A kitchen with a fridge, a table and a lamp.\n" * 20, changing="Task: go.\n"
)
SHAPE = {"layers": 6, "width": 256, "heads": 8, "kv_heads": 4, "feed_forward": 640}


def grammar(start: str, rule: str) -> str:
    """Return the language as a flat enumeration, for llama.cpp ("::=") or llguidance (":")."""
    one, names, nodes = (
        " | ".join(f'"{quote}{word}{quote}"' for word in words)
        for words, quote in ((PLAIN, ""), (SPEC.objects, "'"), (SPEC.positions, "'"))
    )
    return (
        f'{start} {rule} (line "\\n")+\n'
        f'line {rule} ({one}) "(robot, " name ")" | "PutObject(robot, " name (", " name)? ")"'
        ' | "Explore(robot, " name (", [" node (", " node)* "]")? ")"\n'
        f"name {rule} {names}\nnode {rule} {nodes}\n"
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
        state = automaton.start() if choice.state is None else choice.state
        return choice.token

    return choose


def grammar_first(model: LlamaModel) -> Choose:
    """GBNF over all tokens and then the best, as the class `Llama` does."""
    import llama_cpp
    from llama_cpp import LlamaGrammar, _internals

    sampler = _internals.LlamaSampler()
    held = LlamaGrammar.from_string(grammar("root", "::="), verbose=False)
    sampler.add_grammar(model.gguf.llama._model, held)
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
    """Llguidance's mask over all tokens and then the best."""
    import llguidance
    import llguidance.llamacpp
    import llguidance.numpy as masks

    tokenizer = llguidance.llamacpp.lltokenizer_from_vocab(model.gguf.llama._model.vocab)
    held = llguidance.LLMatcher.grammar_from_lark(grammar("start", ":"))
    matcher = llguidance.LLMatcher(tokenizer, held)
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


VARIANTS = {
    "no constraint": nothing, "our automaton": ours, "llama.cpp GBNF, flat": grammar_first,
    "llguidance": llguidance_mask,
}  # fmt: skip


def decoded(model: LlamaModel, choose: Choose, wish: Sequence[int]) -> list[float]:
    """Decode TOKENS tokens; return the seconds of all, then of each selection."""
    model.complete(PROMPT, max_tokens=1)
    begun, selecting = time.perf_counter(), []
    for step in range(TOKENS):
        logits, chosen = model.gguf.logits().copy(), list[int]()
        if wish:
            logits[wish[step]] += 100
        selecting.append(taken(lambda: chosen.append(choose(logits)), time.perf_counter))  # noqa: B023
        model.gguf.llama.eval(chosen)
    return [time.perf_counter() - begun, *selecting]


def rows(model: LlamaModel, wish: Sequence[int], repeat: int) -> Iterator[Sequence[object]]:
    """Measure and yield a table."""
    found: dict[str, list[list[float]]] = {name: [] for name in VARIANTS}
    for _ in range(repeat):
        for name, make in VARIANTS.items():
            try:
                found[name].append(decoded(model, make(model), wish))
            except ImportError:
                continue
    against: list[float] = []
    for name, runs in found.items():
        if not runs:
            yield name, None, None, None, None, None
            continue
        selections = sorted(1e6 * one for run in runs for one in run[1:])
        whole, select = median(run[0] for run in runs), median(selections)
        against = against or [whole, select]
        late = selections[len(selections) * 9 // 10]
        yield name, TOKENS / whole, against[0] / whole, select, late, select / against[1]


def main(vocabulary: Annotated[list[int] | None, typer.Option()] = None, repeat: int = 3) -> None:
    """Print two tables for each vocabulary."""
    go_offline()
    text = ProgramAutomaton(SPEC).random_program(np.random.default_rng(1), 60).encode()
    for size in vocabulary or [8192, 32768]:
        with tempfile.TemporaryDirectory() as folder:
            path = make_llama(Path(folder) / "bench.gguf", **SHAPE, vocabulary=size)
            model = LlamaModel(path, options=LlamaOptions(threads=1, n_ctx=4096))
            tokens = model.gguf.llama.tokenize(text, add_bos=False)[:TOKENS]
            for how, wish in (("as trained", tokens), ("random weights choose", [])):
                print(f"\n## {size} tokens, {how}\n")
                table(
                    "variant | tokens/s | of no constraint | selection, µs: median | p90 |"
                    " times no constraint",
                    rows(model, wish, repeat),
                )
            model.close()


if __name__ == "__main__":
    typer.run(main)
