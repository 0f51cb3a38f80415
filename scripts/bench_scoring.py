"""Measure skill scoring: naive scoring against the trie and best-first search.

    python scripts/bench_scoring.py [--candidates 200]
    python scripts/bench_scoring.py --lota-alfred 10

Two models with F16 weights: the shipped planner, and a Llama of random weights made here. That the
scores are exact is held by `tests/models/test_scoring.py`.

Speed: a prompt of 2,000 tokens and 200 candidates, one thread, seconds of the processor, so that
other jobs on the machine matter less. Naive scoring is timed on three candidates and multiplied,
since all 200 take the same. Each of ours is the median of several.

`--lota-alfred` chooses among the 214 skills of LoTa-Bench's ALFRED instead, with the shipped
planner, at every step of the expert's plans. It needs the reference data and a minute or two.
"""

import tempfile
import time
from collections.abc import Sequence
from itertools import product
from pathlib import Path
from statistics import mean, median
from typing import Annotated

import typer
from measuring import in_turns, table, taken
from support.every_score import every_score
from support.naive_scoring import PLACES, THINGS, Naive, lines, tokens_of

from karma.bench.engine.experiment_file import beside
from karma.models.llama.gguf_model import GgufModel
from karma.models.llama.opening import LlamaOptions
from karma.models.llama.scoring import SkillScorer
from karma.offline.guard import go_offline
from karma.plugins.alfred.eb_world.actions import LOTA_ALFRED, read_types, skills_of
from karma.plugins.alfred.eb_world.environment import Environment
from karma.plugins.alfred.suites.benchmark import read_rooms
from karma.plugins.alfred.suites.experiment import draw_tasks
from karma.plugins.alfred.suites.lota_planner import LotaPromptOptions, followed, score_prompt
from karma.plugins.alfred.suites.players import ExpertPlayer
from karma.seeds import stream
from karma.testing import make_llama
from karma.types.completion import Choice

NANO = Path("models/nano/planner.gguf")
LONG = 2000  # tokens of the prompt that speed is measured on
TIMED = 3  # naive candidates
REPEAT = 5
TIMED_PROMPTS = 40  # of LoTa-Bench's ALFRED, naive
LOTA_FILES = (
    "lota_alfred/splits_even.json", "eb_alfred/action_types.json", "alfred/valid_seen.jsonl.gz",
)  # fmt: skip
SHAPE = {"layers": 8, "width": 512, "heads": 8, "kv_heads": 8, "feed_forward": 1408,
         "vocabulary": 16_384}  # of the random one  # fmt: skip


def steps(count: int) -> list[str]:
    """Steps in words, as in `lota.score` with a general model."""
    verbs = ("find the", "pick up the", "put down the", "open the", "close the", "slice the")
    return ["done.", *(f"{v} {n.lower()}," for v, n in product(verbs, THINGS + PLACES))][:count]


def speed(model: GgufModel, texts: Sequence[str]) -> None:
    """Time a long prompt."""
    prompt, naive, scorer = long_prompt(model), Naive(model), SkillScorer(model)
    lengths = [len(tokens_of(model, text)) for text in texts]
    timed = stream(0, "timed").choice(len(texts), TIMED, replace=False).tolist()
    whole = len(texts) * median(taken(lambda n=n: naive.score(prompt, texts[n])) for n in timed)
    ways = {
        "all, warm prompt": lambda: every_score(scorer, prompt, texts),
        "argmax, warm prompt": lambda: scorer.choose(prompt, texts),
    }
    cold = []
    for _ in range(TIMED):
        scorer.choose(("#", "other"), texts)  # the long prompt is gone
        cold.append(taken(ways["all, warm prompt"]))
    found, best = every_score(scorer, prompt, texts), scorer.choose(prompt, texts)
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
    candidates: int = 200,
    skip_random: bool = False,
    lota: Annotated[int, typer.Option("--lota-alfred", help="So many tasks.")] = 0,
) -> None:
    """Time both models, or LoTa-Bench's tasks."""
    go_offline()
    if lota:
        lota_alfred(GgufModel(NANO, LlamaOptions(threads=1)), lota)
        return
    with tempfile.TemporaryDirectory() as folder:
        models = {"karma-nano": NANO}
        if not skip_random:
            models["random"] = make_llama(Path(folder) / "random.gguf", **SHAPE)
        for name, path in models.items():
            model = GgufModel(path, LlamaOptions(threads=1))
            print(f"\n## {name}: F16 weights, 1 thread")
            speed(model, (steps if name == "random" else lines)(candidates))
            model.close()


if __name__ == "__main__":
    typer.run(main)
