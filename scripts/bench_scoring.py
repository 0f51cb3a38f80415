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

`--lota-alfred` chooses among the 214 skills of LoTa-Bench's ALFRED instead, with the shipped
planner, at every step of the expert's plans. It needs the reference data and a minute or two.
"""

import random
import tempfile
import time
from collections import Counter
from collections.abc import Sequence
from itertools import product
from pathlib import Path
from statistics import mean, median
from typing import Annotated

import numpy as np
import typer
from measuring import in_turns, table, taken
from numpy.typing import NDArray

from karma.bench.experiment_file import beside
from karma.benchmarks.lota_alfred.experiment import draw_tasks
from karma.benchmarks.lota_alfred.planner import followed
from karma.benchmarks.lota_alfred.prompt import LotaPromptOptions, score_prompt
from karma.benchmarks.players import ExpertPlayer
from karma.benchmarks.trial_rooms import read_rooms
from karma.contracts import END, Choice
from karma.infer.llama.gguf_model import GgufModel
from karma.infer.llama.options import LlamaOptions
from karma.infer.llama.scoring import SkillScorer
from karma.offline import go_offline
from karma.seeds import stream
from karma.tasks.files import load_tasks
from karma.testing import make_llama
from karma.world.eb_alfred.actions import read_types
from karma.world.eb_alfred.environment import Environment
from karma.world.eb_alfred.protocol import LOTA_ALFRED
from karma.world.eb_alfred.skills import skills_of

NANO = Path("models/nano/planner.gguf")
TASKS = "eval/alfred_l/tasks.jsonl"
LONG = 2000  # tokens of the prompt that speed is measured on
TIMED = 3  # naive candidates
REPEAT = 5
TIMED_PROMPTS = 40  # of LoTa-Bench's ALFRED, naive
LOTA_FILES = (
    "lota_alfred/splits_even.json", "eb_alfred/action_types.json", "alfred/valid_seen.jsonl.gz",
)  # fmt: skip
SHAPE = {"layers": 8, "width": 512, "heads": 8, "kv_heads": 8, "feed_forward": 1408,
         "vocabulary": 16_384}  # of the random one  # fmt: skip
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
    equal, leads = Counter[str](), []
    for prompt in prompts(count):
        expected = np.array([naive.score(prompt, text) for text in texts])
        top = int(expected.argmax())
        values, best = scorer.scores(prompt, texts).values, scorer.choose(prompt, texts)
        gaps["path after path"].append(float(np.abs(values - expected).max()))
        gaps["best-first"].append(abs(best.score - float(expected[best.number])))
        equal["path after path"] += int(values.argmax() == top)
        equal["best-first"] += int(best.number == top)
        leads.append(float(np.diff(np.sort(expected)[-2:])[0]))
    print(f"\n{count} prompts x {len(texts)} candidates, smallest lead {min(leads):.1e}\n")
    table(
        "scored | argmax equal | largest difference | median of prompts | within 1e-3",
        (
            (
                name,
                equal[name],
                f"{max(off):.1e}",
                f"{median(off):.1e}",
                sum(x <= 1e-3 for x in off),
            )
            for name, off in gaps.items()
        ),
    )


def speed(model: GgufModel, texts: Sequence[str]) -> None:
    """Time one long prompt."""
    prompt, naive, scorer = long_prompt(model), Naive(model), SkillScorer(model)
    lengths = [len(tokens_of(model, text)) for text in texts]
    timed = stream(0, "timed").choice(len(texts), TIMED, replace=False).tolist()
    whole = len(texts) * median(taken(lambda n=n: naive.score(prompt, texts[n])) for n in timed)
    ways = {
        "all, warm prompt": lambda: scorer.scores(prompt, texts),
        "argmax, warm prompt": lambda: scorer.choose(prompt, texts),
    }
    cold = []
    for _ in range(TIMED):
        scorer.choose(("#", "other"), texts)  # the long prompt is gone
        cold.append(taken(ways["all, warm prompt"]))
    found, best = scorer.scores(prompt, texts), scorer.choose(prompt, texts)
    assert best.number == int(found.values.argmax())
    seconds = {name: median(times) for name, times in in_turns(ways, REPEAT).items()}
    rows = [
        ("naive", sum(found.prompt_tokens + n - 1 for n in lengths), whole),
        ("all, prompt included", found.prompt_tokens + found.run_tokens, median(cold)),
        ("all, warm prompt", found.run_tokens, seconds["all, warm prompt"]),
        ("argmax, warm prompt", best.run_tokens, seconds["argmax, warm prompt"]),
    ]
    print(
        f"\nprompt {found.prompt_tokens} tokens, {len(texts)} candidates of {min(lengths)} to"
        f" {max(lengths)} tokens; naive from {TIMED} of them\n"
    )
    table("way | tokens run | seconds | naive is so many times", ((*r, whole / r[2]) for r in rows))


def lota_alfred(model: GgufModel, count: int) -> None:
    """Choose at every step of expert plans in LoTa-Bench's ALFRED; time it, and the naive way."""
    lists, types, trials = (beside(Path(), f"../shared/data/{name}") for name in LOTA_FILES)
    rooms, kinds, scorer = read_rooms(trials), read_types(types), SkillScorer(model)
    texts = [followed(str(skill), strict=False) for skill in skills_of(kinds)]
    asked: list[tuple[str, ...]] = []
    found: list[Choice] = []
    choosing, begun = 0.0, time.process_time()
    for task in draw_tasks(lists, ("valid_seen_5_percent_seed_1",))[:count]:
        trial, player = rooms.trials[task.trial], ExpertPlayer()
        facts = rooms.facts[trial.scene.floor_plan]
        env = Environment(trial, facts, kinds, protocol=LOTA_ALFRED)
        while not env.end:
            said = trial.annotations[task.repeat].task_desc
            asked.append(score_prompt(said, env.steps, LotaPromptOptions()))
            choosing += taken(lambda: found.append(scorer.choose(asked[-1], texts)))
            env.step(*player.plan(env))
    playing = time.process_time() - begun - choosing
    naive, timed = Naive(model), asked[:: max(1, len(asked) // TIMED_PROMPTS)]
    one = mean(
        taken(lambda n=n, p=p: naive.score(p, texts[7 * n % len(texts)]))
        for n, p in enumerate(timed)
    )
    tokens = [choice.prompt_tokens for choice in found]
    print(
        f"LoTa-Bench's ALFRED: {count} tasks, {len(asked)} steps, {len(texts)} skills\n"
        f"prompts of {min(tokens)} to {max(tokens)} tokens; per step"
        f" {mean(choice.run_tokens for choice in found):.1f} tokens of skills run\n"
        f"per task: world {playing / count:.2f} s, choosing {choosing / count:.2f} s;"
        f" naively {len(texts) * one * len(asked) / count:.0f} s ({len(timed)} prompts timed with"
        " one skill each)"
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


def main(
    prompt_count: Annotated[int, typer.Option("--prompts")] = 200,
    candidates: int = 200,
    parity_candidates: Annotated[int, typer.Option(help="Spread over the list.")] = 200,
    skip_parity: bool = False,
    skip_speed: bool = False,
    skip_random: bool = False,
    skip_nano: bool = False,
    lota: Annotated[int, typer.Option("--lota-alfred", help="So many tasks.")] = 0,
) -> None:
    """Run all of it, or what --lota-alfred says."""
    go_offline()
    if lota:
        lota_alfred(GgufModel(NANO, LlamaOptions(threads=1)), lota)
        return
    with tempfile.TemporaryDirectory() as folder:
        models = {} if skip_nano else {"karma-nano": NANO}
        if not skip_random:
            models["random"] = make_llama(Path(folder) / "random.gguf", **SHAPE)
        for name, path in models.items():
            model = GgufModel(path, LlamaOptions(threads=1))
            print(f"\n## {name}: F16 weights, 1 thread")
            texts = (steps if name == "random" else lines)(candidates)
            if not skip_parity:
                parity(model, prompt_count, texts[:: max(1, len(texts) // parity_candidates)])
            if not skip_speed:
                speed(model, texts)
            model.close()


if __name__ == "__main__":
    typer.run(main)
