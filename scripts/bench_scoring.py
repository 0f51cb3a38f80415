"""What skill scoring costs, and that it is exact: naive scoring against the trie and best-first.

    python scripts/bench_scoring.py [--prompts 200] [--skip-parity] [--skip-speed]
    python scripts/bench_scoring.py --lota-alfred 10

Two models with F16 weights: the shipped planner, and a Llama of random weights made here.

Parity: on many short prompts every candidate is scored naively (an empty cache, prompt and
candidate in one run; log-probabilities summed in double precision) and by the scorer: path after
path, and by best-first search.

Speed: one prompt of 2,000 tokens and 200 candidates, one thread, seconds of the processor, so that
other jobs on the machine matter less. Naive scoring is timed on three candidates and multiplied,
since all 200 take the same. Each of ours is the median of several.

Figures of 2026-11-22 (more in docs/methods.md), the shipped planner and the random Llama, this
one with `--parity-candidates 50`: scores within 1.1e-6 and 5.3e-7 of naive ones, the argmax equal
on all 200 prompts; all scores on a warm prompt 461 and 226 times faster, the argmax 18,124 and
6,898 times. It takes 10 and 17 minutes.

`--lota-alfred` chooses among the 214 skills of LoTa-Bench's ALFRED instead, with the shipped
planner, at every step of the expert's plans. It needs the reference data and a minute or two.
"""

import argparse
import random
import statistics
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from functools import partial
from itertools import product
from pathlib import Path
from string import ascii_lowercase

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))

import numpy as np
from numpy.typing import NDArray
from support.llama_export import export_llama_gguf

from karma.bench.experiment_file import beside
from karma.benchmarks.alfred.experiment import draw_tasks
from karma.benchmarks.alfred.lota_planner import LotaPromptOptions, followed, score_prompt
from karma.benchmarks.alfred.players import ExpertPlayer
from karma.benchmarks.alfred.trial_rooms import read_rooms
from karma.contracts import END, Choice
from karma.infer.llama.gguf_files import new_tokenizer
from karma.infer.llama.gguf_model import GgufModel
from karma.infer.llama.options import LlamaOptions
from karma.infer.llama.scoring import Scores, SkillScorer
from karma.offline import go_offline
from karma.seeds import stream
from karma.tasks.files import load_tasks
from karma.world.eb_alfred.actions import read_types, skills_of
from karma.world.eb_alfred.environment import Environment
from karma.world.eb_alfred.protocol import LOTA_ALFRED

NANO = Path("models/nano/planner.gguf")
TASKS = "eval/alfred_l/tasks.jsonl"
LONG = 2000  # tokens of the prompt that speed is measured on
TIMED = 3  # naive candidates
REPEAT = 5
TIMED_PROMPTS = 40  # of LoTa-Bench's ALFRED, naive
LOTA_FILES = (
    "lota_alfred/splits_even.json", "eb_alfred/action_types.json", "alfred/valid_seen.jsonl.gz",
)  # fmt: skip
THINGS = (
    "Apple", "Bread", "Egg", "Lettuce", "Potato", "Tomato", "Mug", "Cup", "Bowl", "Plate", "Pot",
    "Pan", "Knife", "Fork", "Spoon", "Spatula", "DishSponge", "SoapBottle", "SaltShaker", "Book",
    "Pen", "Pencil", "CellPhone", "CreditCard", "KeyChain", "Laptop", "RemoteControl", "Vase",
)  # fmt: skip
PLACES = (
    "Fridge", "Microwave", "SinkBasin", "CounterTop", "DiningTable", "Cabinet", "Drawer",
    "GarbageCan", "Shelf", "Sofa", "Bed", "Desk", "CoffeeTable", "SideTable",
)  # fmt: skip


def lines(count: int) -> list[str]:
    """Lines of programs, and the end: what the shipped planner says."""
    found = [
        f"{skill}(robot, '{name}')\n"
        for skills, names in (
            (("GoToObject", "PickupObject", "SliceObject"), THINGS),
            (("GoToObject", "OpenObject", "CloseObject"), PLACES),
        )
        for skill, name in product(skills, names)
    ]
    pairs = [f"PutObject(robot, '{a}', '{b}')\n" for a, b in product(THINGS, PLACES)]
    random.Random(0).shuffle(pairs)
    return [END, *found, *pairs][:count]


def steps(count: int) -> list[str]:
    """Steps in words, as in `lota.score` with a general model."""
    verbs = ("find the", "pick up the", "put down the", "open the", "close the", "slice the")
    return ["done.", *(f"{v} {n.lower()}," for v, n in product(verbs, THINGS + PLACES))][:count]


def prompts(count: int) -> list[tuple[str, ...]]:
    """Instructions of our tasks as the compact profile gives them, some with a line behind them."""
    asked = [sub.instruction for task in load_tasks(TASKS) for sub in task.subtasks]
    found = []
    for number in range(count):
        text = asked[number % len(asked)].lower().rstrip(".!?")
        changing = f"#task {text}\n#memory\n#program\n"
        done = f"GoToObject(robot, '{THINGS[number % len(THINGS)]}')\n"
        found.append(("#areas\nunknown\n", changing, *([done] if number % 2 else [])))
    return found


def make_model(path: Path) -> None:
    """Write a Llama of 34 M random parameters, whose tokens are of other texts."""
    import torch
    from transformers import LlamaConfig, LlamaForCausalLM

    torch.manual_seed(0)
    letters = random.Random(0)
    words = [
        "".join(letters.choices(ascii_lowercase, k=letters.randint(2, 7))) for _ in range(40000)
    ]
    corpus = [" ".join(words[i : i + 50]) for i in range(0, len(words), 50)]
    tokenizer = new_tokenizer(corpus, 16384, ["<|eos|>"])
    config = LlamaConfig(
        vocab_size=16384, hidden_size=512, intermediate_size=1408, num_hidden_layers=8,
        num_attention_heads=8, num_key_value_heads=8, max_position_embeddings=4096,
        tie_word_embeddings=True,
    )  # fmt: skip
    model = LlamaForCausalLM(config)
    print(f"random model: {sum(p.numel() for p in model.parameters()) / 1e6:.1f} M parameters")
    export_llama_gguf(model, tokenizer, path, name="random", eos_token="<|eos|>", dtype="F16")


class Naive:
    """One sequence, and nothing kept between two candidates."""

    def __init__(self, model: GgufModel) -> None:
        import llama_cpp

        self._model, self._context = model, model.sequences(1, cells=model.limit)
        self._batch = llama_cpp.llama_batch_init(model.n_batch, 0, 1)

    def score(self, prompt: Sequence[str], text: str) -> float:
        """Return the sum of the log-probabilities of a candidate's tokens."""
        import llama_cpp

        llama_cpp.llama_memory_clear(llama_cpp.llama_get_memory(self._context.ctx), True)
        given = [
            token
            for number, part in enumerate(prompt)
            for token in self._model.tokens(part, begins=number == 0)
        ]
        tokens = tokens_of(self._model, text)
        whole, first = [*given, *tokens], len(given) - 1
        rows = [
            self._decode(whole[start : start + self._model.n_batch], start, first)
            for start in range(0, len(whole), self._model.n_batch)
        ]
        logits = np.concatenate(rows)[:-1].astype(np.float64)
        top = logits.max(axis=1)
        total = top + np.log(np.exp(logits - top[:, None]).sum(axis=1))
        return float((logits[np.arange(len(tokens)), tokens] - total).sum())

    def _decode(self, part: Sequence[int], place: int, first: int) -> NDArray[np.float32]:
        """Return the logits after every token from a place on."""
        import llama_cpp

        batch = self._batch
        batch.n_tokens = len(part)
        for i, token in enumerate(part):
            batch.token[i], batch.pos[i] = token, place + i
            batch.n_seq_id[i], batch.seq_id[i][0] = 1, 0
            batch.logits[i] = place + i >= first
        assert llama_cpp.llama_decode(self._context.ctx, batch) == 0
        count = max(0, min(len(part), place + len(part) - first))
        if count == 0:
            return np.empty((0, self._model.vocabulary), np.float32)
        pointer = llama_cpp.llama_get_logits(self._context.ctx)
        return np.ctypeslib.as_array(pointer, shape=(count, self._model.vocabulary)).copy()


def tokens_of(model: GgufModel, text: str) -> list[int]:
    """Return a candidate's tokens."""
    return [model.end_token] if text == END else model.tokens(text)


def parity(model: GgufModel, count: int, texts: Sequence[str]) -> None:
    """Compare on many prompts."""
    naive, scorer = Naive(model), SkillScorer(model)
    gaps: dict[str, list[float]] = {"path after path": [], "best-first": []}
    equal = dict.fromkeys(gaps, 0)
    leads = []
    for prompt in prompts(count):
        expected = np.array([naive.score(prompt, text) for text in texts])
        top = int(expected.argmax())
        values = scorer.scores(prompt, texts).values
        gaps["path after path"].append(float(np.abs(values - expected).max()))
        equal["path after path"] += int(values.argmax() == top)
        best = scorer.choose(prompt, texts)
        gaps["best-first"].append(abs(best.score - float(expected[best.number])))
        equal["best-first"] += int(best.number == top)
        two = np.sort(expected)[-2:]
        leads.append(float(two[1] - two[0]))
    print(f"  parity: {count} prompts x {len(texts)} candidates, smallest lead {min(leads):.1e}")
    for name, off in gaps.items():
        print(
            f"    {name}: argmax equal in {equal[name]}"
            f"; largest difference of a score {max(off):.1e}"
            f" (median of prompts {statistics.median(off):.1e},"
            f" within 1e-3 in {sum(gap <= 1e-3 for gap in off)})",
            flush=True,
        )


def seconds(work: Callable[[], object], repeat: int) -> float:
    """Return the median processor time of some work."""
    found = []
    for _ in range(repeat):
        begun = time.process_time()
        work()
        found.append(time.process_time() - begun)
    return statistics.median(found)


def speed(model: GgufModel, texts: Sequence[str]) -> None:
    """Time one long prompt."""
    prompt = long_prompt(model)
    naive, scorer = Naive(model), SkillScorer(model)
    lengths = [len(tokens_of(model, text)) for text in texts]
    timed = iter(stream(0, "timed").choice(len(texts), TIMED, replace=False).tolist())
    whole = len(texts) * seconds(lambda: naive.score(prompt, texts[next(timed)]), TIMED)

    def all_scores() -> Scores:
        return scorer.scores(prompt, texts)

    cold = []
    for _ in range(TIMED):
        scorer.choose(("#", "other"), texts)  # the long prompt is gone
        cold.append(seconds(all_scores, 1))
    found, best = all_scores(), scorer.choose(prompt, texts)
    assert best.number == int(found.values.argmax())
    run, asked = found.run_tokens, found.prompt_tokens + found.run_tokens
    rows = [
        ("naive, 3 timed x 200", sum(found.prompt_tokens + n - 1 for n in lengths), whole),
        ("all, prompt included", asked, statistics.median(cold)),
        ("all, warm prompt", run, seconds(all_scores, REPEAT)),
        ("argmax, warm prompt", best.run_tokens, seconds(lambda: scorer.choose(prompt, texts), 9)),
    ]
    print(
        f"  speed: prompt {found.prompt_tokens} tokens, {len(texts)} candidates of"
        f" {min(lengths)} to {max(lengths)} tokens (mean {statistics.mean(lengths):.1f})\n"
        "  | | tokens run | seconds | times faster |\n  |---|---|---|---|"
    )
    for name, run, taken in rows:
        print(f"  | {name} | {run} | {taken:.3f} | {whole / taken:.0f} |", flush=True)


def lota_alfred(model: GgufModel, count: int) -> None:
    """Choose at every step of expert plans in LoTa-Bench's ALFRED; time it, and the naive way."""
    lists, types, trials = (beside(Path(), f"../shared/data/{name}") for name in LOTA_FILES)
    rooms, kinds, scorer = read_rooms(trials), read_types(types), SkillScorer(model)
    texts = [followed(str(skill), strict=False) for skill in skills_of(kinds)]
    asked: list[tuple[str, ...]] = []
    found: list[Choice] = []
    playing, choosing = 0.0, 0.0
    for task in draw_tasks(lists, ("valid_seen_5_percent_seed_1",))[:count]:
        begun = time.process_time()
        trial, player = rooms.trials[task.trial], ExpertPlayer()
        facts = rooms.facts[trial.scene.floor_plan]
        env = Environment(trial, facts, kinds, protocol=LOTA_ALFRED)
        playing += time.process_time() - begun
        while not env.end:
            said = trial.annotations[task.repeat].task_desc
            asked.append(score_prompt(said, env.steps, LotaPromptOptions()))
            begun = time.process_time()
            found.append(scorer.choose(asked[-1], texts))
            middle = time.process_time()
            env.step(*player.plan(env))
            choosing, playing = choosing + middle - begun, playing + time.process_time() - middle
    naive, timed = Naive(model), asked[:: max(1, len(asked) // TIMED_PROMPTS)]
    one = statistics.mean(
        seconds(partial(naive.score, prompt, texts[7 * number % len(texts)]), 1)
        for number, prompt in enumerate(timed)
    )
    tokens = [choice.prompt_tokens for choice in found]
    print(
        f"  LoTa-Bench's ALFRED: {count} tasks, {len(asked)} steps, {len(texts)} skills\n"
        f"    prompts of {min(tokens)} to {max(tokens)} tokens; per step"
        f" {statistics.mean(choice.run_tokens for choice in found):.1f} tokens of skills run\n"
        f"    per task: world {playing / count:.2f} s, choosing {choosing / count:.2f} s;"
        f" naively {len(texts) * one * len(asked) / count:.0f} s ({len(timed)} prompts timed with"
        " one skill each)",
        flush=True,
    )


def long_prompt(model: GgufModel) -> tuple[str, ...]:
    """Return a prompt of LONG tokens: a map of many lines, and a task."""
    task = "#task put the apple in the fridge\n#memory\n#program\n"
    line = "node_1 CounterTop Fridge Cabinet Drawer\n"
    stable = "#areas\n"
    room = LONG - len(model.tokens(task))
    while len(model.tokens(stable + line)) <= room:
        stable += line
    while len(model.tokens(stable + "x\n")) <= room:
        stable += "x\n"
    return stable, task


def main() -> None:
    """Run all of it."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--prompts", type=int, default=200)
    parser.add_argument("--candidates", type=int, default=200)
    parser.add_argument("--parity-candidates", type=int, default=200, help="spread over the list")
    parser.add_argument("--skip-parity", action="store_true")
    parser.add_argument("--skip-speed", action="store_true")
    parser.add_argument("--skip-random", action="store_true")
    parser.add_argument("--skip-nano", action="store_true")
    parser.add_argument("--lota-alfred", type=int, default=0, metavar="TASKS")
    options = parser.parse_args()
    if options.lota_alfred:
        lota_alfred(GgufModel(NANO, LlamaOptions(threads=1)), options.lota_alfred)
        return
    with tempfile.TemporaryDirectory() as folder:
        models = {} if options.skip_nano else {"karma-nano": NANO}
        if not options.skip_random:
            models["random"] = Path(folder) / "random.gguf"
            make_model(models["random"])
        for name, path in models.items():
            model = GgufModel(path, LlamaOptions(threads=1))
            print(f"{name}: F16 weights, 1 thread")
            texts = (steps if name == "random" else lines)(options.candidates)
            spread = texts[:: max(1, len(texts) // options.parity_candidates)]
            if not options.skip_parity:
                parity(model, options.prompts, spread)
            if not options.skip_speed:
                speed(model, texts)
            model.close()


if __name__ == "__main__":
    go_offline()
    main()
